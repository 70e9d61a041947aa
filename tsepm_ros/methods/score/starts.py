"""The rule that starts tracks: sufficient evidence, and hits that are clearly of a single target.

With the evidence E of the hypotheses that end in one detection, summed under the velocity prior
that ends at v_max (`speed_prior`), and the threshold A::

    confirmed     E >= A, by at least 3 hits, at most half of them due to held tracks, more
                  than half of them the target's with a probability of at least 0.9, or by 8
                  hits (a lower probability at target rates above 3000 per hour); of a second target
                  E >= A + ln 1000, with the density due to held tracks added to lambda

Hits, purity and state are those of `credible_hits`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Protocol

import numpy as np

from tsepm_ros.initiation.initiator import NEW_TRACK_EXISTENCE
from tsepm_ros.maintenance.track_maintenance import MIN_EXISTENCE
from tsepm_ros.methods.score import speed_prior
from tsepm_ros.methods.score.credible_hits import (
    MIN_HIT_PROBABILITY,
    MIN_PURITY_PROBABILITY,
    HitFit,
    Start,
    held_share,
    resolved,
)
from tsepm_ros.methods.score.grown import Grown
from tsepm_ros.methods.score.hypotheses import Hypotheses
from tsepm_ros.methods.score.score_options import MIN_HITS
from tsepm_ros.numerics import grouped
from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.sensing.detection_window import DetectionWindow

MAX_RATE_OF_PURE_STARTS = 3000.0
"""Target false-track rate, per hour, above which a start need not be as pure: a choice."""
MAX_HELD_SHARE = 0.5
"""Share of the hits due to held tracks above which a hypothesis is of a held target: a choice.

A false held track takes part of the detections of a target that comes near it. A smaller share
lets it hide the target; a larger share makes redundant tracks. docs/score.md compares values.
"""
MAX_HELD_PROBABILITY = 0.5
"""Probability that a held track caused a detection above which it starts no other by itself."""
SECOND_TARGET_MARGIN = math.log(1e3)
"""Evidence above the threshold, given held tracks, that a second target needs: a choice.

A second track competes for the held track's detections, and a start with wrong hits briefly looks
like two targets.
"""
TARGET_BIRTH_RATE = 500.0
"""Assumed target births per hour; sets the existence probability of new tracks: a choice.

The existence probability weights the association of detections with a new track. The rate is high:
the weight falls clearly below 1 only at useless false-track rates.
"""
MIN_NEW_EXISTENCE = 2.0 * MIN_EXISTENCE
"""Minimum existence probability of a new track: it is held for a scan at least."""


class StartRule(Protocol):
    """Decides which tracks a scan starts."""

    def starts(
        self,
        grown: Grown,
        window: DetectionWindow,
        threshold: float,
        *,
        min_time: float,
        false_tracks_per_hour: float,
        max_speed: float,
        fit: HitFit,
    ) -> list[Start]:
        """The tracks that the tree starts.

        Parameters
        ----------
        grown : Grown
            The tree after the scan.
        window : DetectionWindow
            The detections, with the probability that held tracks caused each; new tracks are added.
        threshold : float
            Of the evidence; infinite where no evidence can reach it.
        min_time : float
            Time from the first hit to the last that a velocity needs, s.
        false_tracks_per_hour : float
            The target rate.
        max_speed : float
            v_max, m/s, at which the velocity prior ends.
        fit : callable
            States and covariances of hypotheses, from their hits alone.
        """


@dataclass(frozen=True)
class SummedEvidence:
    """The default rule: summed evidence, resolved hits, and a margin given held tracks."""

    def starts(
        self,
        grown: Grown,
        window: DetectionWindow,
        threshold: float,
        *,
        min_time: float,
        false_tracks_per_hour: float,
        max_speed: float,
        fit: HitFit,
    ) -> list[Start]:
        """Start a track where the evidence of a detection reaches the threshold.

        The strongest detection comes first. A start waits until its target's hits are resolved.
        Where more than `MAX_HELD_SHARE` of these are due to held tracks, or the detection probably
        is, the evidence given the held tracks must exceed the threshold by `SECOND_TARGET_MARGIN`.

        See `StartRule.starts`.
        """
        if math.isinf(threshold) or attainable(grown, window).max(initial=-math.inf) < threshold:
            return []
        decided = speed_prior.decided(grown, threshold, max_speed)
        group, n, sums = grown.newest, len(grown.ids), decided.evidence
        strong = sums >= threshold
        strong &= grouped.largest_of(decided.ended.hit_count.astype(float), group, n) >= MIN_HITS
        rows = np.flatnonzero(strong[group])
        ending, group = decided.ended[rows], group[rows]
        new = held_share(ending, group, n, window) <= MAX_HELD_SHARE
        new &= window.held_probability(grown.ids) <= MAX_HELD_PROBABILITY
        strong &= new | (
            grouped.summed(ending.score_given_held, group, n) >= threshold + SECOND_TARGET_MARGIN
        )
        if not strong.any():
            return []
        grown = speed_prior.with_rivals(grown, decided, threshold, max_speed)
        purity = min_purity_probability(false_tracks_per_hour)
        starts: list[Start] = []
        for newest in sorted(np.flatnonzero(strong), key=lambda detection: -sums[detection]):
            members = ending[group == newest]
            start = None
            if (
                new[newest]
                and window.held_probability(grown.ids[[newest]])[0] <= MAX_HELD_PROBABILITY
            ):
                start = resolved(members, grown, window, MAX_HELD_SHARE, min_time, fit, purity)
            if start is None:
                members = given_starts(members, starts).scored_given_held()
                if np.logaddexp.reduce(members.score) >= threshold + SECOND_TARGET_MARGIN:
                    rest = grown_given_starts(grown, starts)
                    rest = rest.of_each(Hypotheses.scored_given_held)
                    start = resolved(members, rest, window, 1.0, min_time, fit, purity)
            if start is not None:
                starts.append(start)
                beyond = np.array([start.evidence - threshold])
                exists = existence(beyond, false_tracks_per_hour)
                window.note_held(start.detections, start.probability * exists)
        return starts


def attainable(grown: Grown, window: DetectionWindow) -> FloatArray:
    """Upper bound of the evidence by which each detection may start a track, (d,).

    Less than its evidence where it is a held track's: what is left given these, without the margin
    that a second target needs. -inf where every hypothesis has too few hits.
    """
    group, n = grown.newest, len(grown.ids)
    evidence = grown.evidence + speed_prior.LOG_GAIN
    enough = np.zeros(n, bool)
    enough[group[grown.ended.hit_count >= MIN_HITS]] = True
    held = window.held_probability(grown.ids) > MAX_HELD_PROBABILITY
    if not (enough & held).any():
        return np.where(enough, evidence, -np.inf)
    second = grouped.summed(grown.ended.score_given_held, group, n) + speed_prior.LOG_GAIN
    of_held = np.minimum(evidence, second - SECOND_TARGET_MARGIN)
    return np.where(enough, np.where(held, of_held, evidence), -np.inf)


def existence(evaluation: FloatArray, false_tracks_per_hour: float) -> FloatArray:
    """Posterior probability that targets exist, (n,), from the evidence above the threshold, (n,).

    The prior is `TARGET_BIRTH_RATE`: at the threshold, the odds are this rate over the target
    false-track rate.
    """
    false = false_tracks_per_hour * np.exp(-evaluation)
    return np.clip(
        TARGET_BIRTH_RATE / (TARGET_BIRTH_RATE + false), MIN_NEW_EXISTENCE, NEW_TRACK_EXISTENCE
    )


def given_starts(hypotheses: Hypotheses, starts: Sequence[Start]) -> Hypotheses:
    """The hypotheses given the new tracks."""
    for start in starts:
        hypotheses = hypotheses.given_track(start.detections, start.probability)
    return hypotheses


def grown_given_starts(grown: Grown, starts: Sequence[Start]) -> Grown:
    """The tree with the scores of its hypotheses given the new tracks."""
    return grown.of_each(partial(given_starts, starts=starts))


def min_purity_probability(false_tracks_per_hour: float) -> float:
    """Minimum probability that more than half of a start's hits are its target's, 0.5 to 0.9.

    It falls as the inverse of the target rate (per hour) above `MAX_RATE_OF_PURE_STARTS`: such
    rates are those of published methods, for comparison. A start with wrong hits is then a false
    track among many, whose low existence probability leaves the target's detections free.
    """
    excess = max(false_tracks_per_hour / MAX_RATE_OF_PURE_STARTS, 1.0)
    return max(MIN_PURITY_PROBABILITY / excess, MIN_HIT_PROBABILITY)
