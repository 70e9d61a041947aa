"""Confirmation: which hypotheses become tracks, and with which hits.

The end of the velocity prior at v_max: evidence of hypotheses whose velocity is in the disc.

The tree's filters have a Gaussian prior of the velocity, of variance v_max^2 / 4 on each axis. The
prior that is meant ends at v_max. Of the Gaussian truncated there, the likelihood ratio of a
hypothesis with the posterior N(x, P) is exactly ::

    s <- s + ln P(|v| <= v_max | N(x, P)) - ln P_0,    P_0 = 1 - exp(-2) of the prior

That is 0.15 more where the velocity is surely inside, and much less where it is surely outside. It
is a likelihood ratio of mean 1 under clutter as before: the bound on false confirmations holds.

Which hits are a target's, and its state, over the hypotheses that may be the target's.

With i over the hypotheses that end in one detection and their rivals, which are of the same target
and end in another detection, or in none::

    P(hit)        sum of w_i over i with the hit,  w_i ~ exp(s_i)
    hits          the detections of a probability of at least 0.9, or, where these are fewer than
                  3, the 3 most probable, each more probable than not
    resolved      sum of w_i over i with more than half of the hits is at least 0.9, with the
                  hypotheses of a single hit among all i (by 8 hits, whose probabilities may be
                  smaller: more than half; a smaller sum at high target rates)
    state         x = sum_i w_i x_i over these i,  P = sum_i w_i (P_i + (x_i - x)(x_i - x)')

x_i and P_i are fitted to the hits of hypothesis i alone.

The rule that starts tracks: sufficient evidence, and hits that are clearly of a single target.

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
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Protocol

import numpy as np
from scipy.special import softmax

from tsepm_ros.methods.score.hypotheses import Grown, Hypotheses
from tsepm_ros.methods.score.score_options import MIN_HITS
from tsepm_ros.methods.score.tree import RELATIVE_PRUNING
from tsepm_ros.numerics import grouped
from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray, changed
from tsepm_ros.numerics.gaussian import mixture
from tsepm_ros.numerics.grouped import sums_over_hits
from tsepm_ros.tracker import motion
from tsepm_ros.tracker.detection_window import DetectionWindow
from tsepm_ros.tracker.maintenance.track_maintenance import MIN_EXISTENCE
from tsepm_ros.tracker.path_fit import NO_HIT
from tsepm_ros.tracker.tracker import NEW_TRACK_EXISTENCE

LOG_GAIN = -math.log(-math.expm1(-2.0))
"""-ln P_0: what the evidence gains where the velocity is surely inside."""


def ended_at(grown: Grown, threshold: float, max_speed: float) -> Grown:
    """The tree with the evidence under the prior that ends at v_max.

    Only hypotheses that count where evidence may reach the threshold are changed.

    Parameters
    ----------
    grown : Grown
    threshold : float
        Of the evidence.
    max_speed : float
        v_max, m/s.
    """
    return with_rivals(grown, decided_by_speed(grown, threshold, max_speed), threshold, max_speed)


def decided_by_speed(grown: Grown, threshold: float, max_speed: float) -> Grown:
    """As `ended_at`, for the evidence alone: rivals in other detections are as they were."""
    strong = _strong(grown, threshold)
    if not strong.any():
        return grown
    return replace(grown, ended=_ended_at(grown.ended, strong[grown.newest], max_speed))


def with_rivals(grown: Grown, decided: Grown, threshold: float, max_speed: float) -> Grown:
    """As `ended_at`, of the tree and what `decided` made of it."""
    strong, passed = _strong(grown, threshold), decided.evidence >= threshold
    if not strong.any() or not passed.any():
        return decided  # no start, and no rival of any
    # Of other detections, those that may be rivals of a start: they share a hit with it.
    hits = np.unique(grown.ended.hits[passed[grown.newest]])
    hits = hits[hits != NO_HIT]
    least = threshold + RELATIVE_PRUNING - LOG_GAIN

    def rival(hypotheses: Hypotheses) -> BoolArray:
        likely = hypotheses.score >= least
        likely[likely] = np.isin(hypotheses.hits[likely], hits).any(axis=1)
        return likely

    return replace(
        grown,
        ended=_ended_at(grown.ended, strong[grown.newest] | rival(grown.ended), max_speed),
        missed=_ended_at(grown.missed, rival(grown.missed), max_speed),
    )


def _strong(grown: Grown, threshold: float) -> BoolArray:
    """Which detections (d,) may reach the threshold."""
    strong: BoolArray = grown.evidence + LOG_GAIN >= threshold
    hits = grown.ended.hit_count.astype(float)
    strong &= grouped.largest_of(hits, grown.newest, len(grown.ids)) >= MIN_HITS
    return strong


def _ended_at(hypotheses: Hypotheses, counts: BoolArray, max_speed: float) -> Hypotheses:
    """The hypotheses; those that count (n,) with their scores under the prior that ends at v_max.

    That of a single hit is as before: its posterior is the prior.
    """
    rows = np.flatnonzero(counts & (hypotheses.hit_count >= 2))
    gain = np.zeros(len(hypotheses))
    gain[rows] = LOG_GAIN + motion.log_speed_probability(
        hypotheses.state[rows], hypotheses.covariance[rows], max_speed
    )
    return changed(
        hypotheses,
        score=hypotheses.score + gain,
        score_given_held=hypotheses.score_given_held + gain,
    )


MIN_HIT_PROBABILITY = 0.5
"""Posterior probability that every hit of a confirmed track exceeds, but of those by 8 hits."""
SURE_HIT_PROBABILITY = 0.9
"""Posterior probability from which a detection is a hit in any case: a choice.

Less probable hits are published only where these are fewer than `MIN_HITS`: each further doubtful
hit would make it more probable that most of the hits are wrong.
"""
MIN_PURITY_PROBABILITY = 0.9
"""Minimum posterior probability that more than half of a new track's hits are its target's.

A less certain start waits: a track with half of its hits wrong is useless, and hides its target. A
choice; docs/score.md compares other values. Where false tracks are many by choice, it is lower, see
`starts.min_purity_probability`.
"""
MAX_UNRESOLVED_HITS = 8
"""Hits of the best hypothesis from which a start waits no longer: a choice.

The hits may stay ambiguous where a target has several detections a ping.
"""
MIN_COMMON_SHARE = 0.3
"""Share of common hits above which two hypotheses are of the same target."""
MIN_RELATIVE_WEIGHT = 0.01
"""Part of the best weight below which a hypothesis does not count in the state."""
HitFit = Callable[[Hypotheses], tuple[FloatArray, FloatArray]]
"""States (n, 4) and covariances (n, 4, 4) of hypotheses, from their hits alone."""


@dataclass(frozen=True)
class Start:
    """A track to be confirmed.

    Attributes
    ----------
    hits : (h,) ndarray of int
        Detections that are credible hits of the target, ascending, see `credible_hits`.
    detections, probability : (c,) ndarray
        All detections that may be the target's, ascending, and the probability of each.
    state, covariance : (4,), (4, 4) ndarray
    evidence : float
        Of the newest detection.
    """

    hits: IntArray
    detections: IntArray
    probability: FloatArray
    state: FloatArray
    covariance: FloatArray
    evidence: float

    @property
    def probable(self) -> IntArray:
        """Detections that are more probably the target's than not, ascending."""
        return self.detections[self.probability > MIN_HIT_PROBABILITY]


def resolved(
    members: Hypotheses,
    grown: Grown,
    window: DetectionWindow,
    max_held_share: float,
    min_time: float,
    fit: HitFit,
    min_purity: float = MIN_PURITY_PROBABILITY,
) -> Start | None:
    """The track of hypotheses with one newest detection.

    None while the target's hits are not resolved, up to `MAX_UNRESOLVED_HITS` hits, and
    where more than `max_held_share` of them are due to held tracks. They are resolved where more
    than half of the hits are right with a probability of `min_purity`.

    The newest detection is as uncertain as the others: hypotheses of the same target that end in
    another detection, or miss the scan, are rivals.
    """
    evidence = float(np.logaddexp.reduce(members.score))
    rivals = rivals_of(members, grown, evidence)
    begun = rivals[rivals.hit_count == 1]
    rivals = rivals[spans_time(rivals, 2, window, min_time)]
    long = spans_time(rivals, MIN_HITS, window, min_time)
    if not long.any():
        return None
    same_group = np.zeros(len(rivals), np.int64)
    if held_share(rivals, same_group, 1, window)[0] > max_held_share:
        return None
    detections, probability = hit_probabilities(rivals)
    best = np.argmax(np.where(long, rivals.score, -np.inf))
    waits = rivals.hit_count[best] < MAX_UNRESOLVED_HITS
    if waits and (probability > MIN_HIT_PROBABILITY).sum() < MIN_HITS:
        return None
    hits = credible_hits(detections, probability, rivals.hits[best])
    common = np.isin(rivals.hits, hits).sum(axis=1)
    right = common > 0.5 * len(hits)
    # A strong echo may as well be the first of its target, and the hits before it clutter.
    share = softmax(np.append(rivals.score, begun.score))[: len(rivals)]
    least = min_purity if waits else MIN_HIT_PROBABILITY
    if share[right].sum() < least:
        return None
    state, covariance = mixed(rivals[right], fit)
    return Start(hits, detections, probability, state, covariance, evidence)


def held_share(
    hypotheses: Hypotheses, group: IntArray, count: int, window: DetectionWindow
) -> FloatArray:
    """Share of each group's hits that are a held track's, over its hypotheses, (count,).

    ``sum_i w_i c_i / sum_i w_i n_i`` with c_i of the n_i hits of hypothesis i due to held tracks.
    """
    weight = np.exp(hypotheses.score - grouped.largest_of(hypotheses.score, group, count)[group])
    hit = hypotheses.hits != NO_HIT
    held = np.zeros(hypotheses.hits.shape)
    held[hit] = window.held_probability(hypotheses.hits[hit])
    held_hits = np.bincount(group, weight * held.sum(axis=1), minlength=count)
    hits = np.bincount(group, weight * hypotheses.hit_count, minlength=count)
    return np.asarray(held_hits / np.maximum(hits, 1e-300))


def rivals_of(members: Hypotheses, grown: Grown, evidence: float) -> Hypotheses:
    """Hypotheses of the same target as `members`, whatever detection they end in.

    A single hit is a hypothesis of its own where it has a strength.
    """
    likely, probability = hit_probabilities(members)
    pool = [
        part[
            (part.score > evidence + RELATIVE_PRUNING) & (part.hit_count + part.strength_count >= 2)
        ]
        for part in (grown.ended, grown.missed)
    ]
    rivals = Hypotheses.joined(*pool)
    common = sums_over_hits(rivals.hits, likely, probability)
    least = np.minimum(rivals.hit_count, probability.sum())
    return rivals[common > MIN_COMMON_SHARE * least]


def hit_probabilities(members: Hypotheses) -> tuple[IntArray, FloatArray]:
    """Detections of hypotheses of one target, (h,), and the probability of each."""
    share = softmax(members.score)
    detections, place = np.unique(members.hits, return_inverse=True)
    mass = np.bincount(place.ravel(), np.repeat(share, members.hits.shape[1]))
    hit = detections != NO_HIT
    return detections[hit], mass[hit]


def credible_hits(detections: IntArray, probability: FloatArray, best: IntArray) -> IntArray:
    """The detections (c,), ascending, that are credible as hits.

    Those that are sure; where these are too few, the most probable of all that are more probable
    than not; where these are too few, the most probable of the `best` hypothesis.
    """
    sure = detections[probability >= SURE_HIT_PROBABILITY]
    if len(sure) >= MIN_HITS:
        return sure
    if (probability > MIN_HIT_PROBABILITY).sum() >= MIN_HITS:
        return np.sort(detections[np.argsort(-probability, kind="stable")[:MIN_HITS]])
    path = best[best != NO_HIT]
    of_path = probability[np.searchsorted(detections, path)]
    return np.sort(path[np.argsort(-of_path, kind="stable")[:MIN_HITS]])


def spans_time(
    hypotheses: Hypotheses, min_hits: int, window: DetectionWindow, min_time: float
) -> BoolArray:
    """Which hypotheses have enough hits over more than a minimum time (s), (n,)."""
    enough = hypotheses.hit_count >= min_hits
    if not enough.any():
        return enough
    newest = window[hypotheses.last_hit]["time"]
    oldest = window[hypotheses.hits[:, 0]]["time"]
    return enough & (np.abs(newest - oldest) > min_time)


def mixed(members: Hypotheses, fit: HitFit) -> tuple[FloatArray, FloatArray]:
    """State and covariance over the hypotheses of one track, each fitted to its hits alone."""
    share = softmax(members.score)
    counted = share >= MIN_RELATIVE_WEIGHT * share.max()
    states, covariances = fit(members[counted])
    return mixture(share[counted] / share[counted].sum(), states, covariances)


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
        decided = decided_by_speed(grown, threshold, max_speed)
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
        grown = with_rivals(grown, decided, threshold, max_speed)
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
    evidence = grown.evidence + LOG_GAIN
    enough = np.zeros(n, bool)
    enough[group[grown.ended.hit_count >= MIN_HITS]] = True
    held = window.held_probability(grown.ids) > MAX_HELD_PROBABILITY
    if not (enough & held).any():
        return np.where(enough, evidence, -np.inf)
    second = grouped.summed(grown.ended.score_given_held, group, n) + LOG_GAIN
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
