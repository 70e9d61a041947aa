# Copyright 2026 tsepm_ros developers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.
"""Confirmation: which hypotheses become tracks, and with which hits.

With the evidence E of the hypotheses that end in one detection, given the confirmed tracks and
under the velocity prior that ends at v_max (`evaluation.within_max_speed`), and the threshold A::

    confirmed     E >= A, by at least 3 hits, more than half of them the target's with a probability
                  of at least 0.9, or by 8 hits (a lower probability at target rates above 30 per
                  hour); E >= A + ln 1000 beside a confirmed track that was detected in this scan

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
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.special import softmax

from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray, sums_over_hits
from tsepm_ros.numerics.gaussian import mixture
from tsepm_ros.tracker import merging
from tsepm_ros.tracker.evaluation import LOG_GAIN, within_max_speed
from tsepm_ros.tracker.hypotheses import Hypotheses, Start, Tree, given_starts
from tsepm_ros.tracker.initial_state import NO_HIT
from tsepm_ros.tracker.measurement import MeasurementWindow
from tsepm_ros.tracker.observation import Observation
from tsepm_ros.tracker.options import MIN_HITS
from tsepm_ros.tracker.pruning import RELATIVE_PRUNING
from tsepm_ros.tracker.tracks import (
    EVEN_PROBABILITY,
    NEW_TRACK_EXISTENCE,
    SURE_PROBABILITY,
)

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
PURE_RATE, LEAST_PURE_RATE = 30.0, 1000.0
"""Target false-track rates, per hour, between which the purity falls to more probable than not.

Who accepts so many false tracks wants each target early: a choice.
"""
MIN_NEW_EXISTENCE = 0.02
"""Least existence probability of new tracks."""
TARGET_BIRTH_RATE = 500.0
"""Assumed target births per hour; sets the existence probability of new tracks: a choice.

The existence probability weights the association of detections with a new track. The rate is high:
the weight falls clearly below 1 only at useless false-track rates.
"""


def confirm(
    tree: Tree,
    observed: Observation,
    threshold: float,
    false_tracks_per_hour: float,
    *,
    min_time: float,
    max_speed: float,
    fit: HitFit,
) -> tuple[list[Start], int]:
    """Start a track where the evidence of a detection reaches the threshold, ``E >= A``.

    The strongest detection comes first; the others are tested given its start, so that one target
    has one. A start waits until its target's hits are resolved, and beside a confirmed track that
    was detected in this scan until the evidence exceeds the threshold by `SECOND_TARGET_MARGIN`.

    Parameters
    ----------
    tree : Tree
        After the scan.
    observed : Observation
        The scan.
    threshold : float
        A; infinite where no evidence can reach it.
    false_tracks_per_hour : float
        The target rate.
    min_time : float
        Time from the first hit to the last that a velocity needs, s.
    max_speed : float
        v_max, m/s, at which the velocity prior ends.
    fit : callable
        States and covariances of hypotheses, from their hits alone.

    Returns
    -------
    starts : list of Start
    merged : int
        Detections of enough evidence that are of a target which has a start already.
    """
    if (
        tree.evidence.max(initial=-math.inf) + LOG_GAIN < threshold  # as of most scans
        or attainable(tree).max(initial=-math.inf) < threshold
    ):
        return [], 0
    tested = decided_by_speed(tree, threshold, max_speed)
    purity = min_purity_probability(false_tracks_per_hour)
    detected = observed.tracks.where(observed.detected)
    starts, merged = list[Start](), 0
    strong = np.flatnonzero((tested.evidence >= threshold) & _has_hits(tree))
    for end in strong[np.argsort(-tested.evidence[strong], kind="stable")].tolist():
        members = tested.ending_in(end)
        if np.logaddexp.reduce(members.score) < threshold:
            merged += 1
            continue
        start = resolved(members, tested, observed.window, min_time, fit, purity)
        if start is None or (
            start.evidence < threshold + merging.SECOND_TARGET_MARGIN
            and merging.same_place(start.state, start.covariance, detected).any()
        ):
            continue
        starts.append(start)
        tested = replace(tested, hypotheses=given_starts(tested.hypotheses, [start]))
    return starts, merged


def _has_hits(tree: Tree) -> BoolArray:
    """Which detections (d,) end a hypothesis of enough hits."""
    enough = tree.hypotheses.hit_count[tree.missed :] >= MIN_HITS
    return np.bincount(tree.newest[enough], minlength=len(tree.ids)) > 0


def attainable(tree: Tree) -> FloatArray:
    """Upper bound of the evidence by which each detection may start a track, (d,).

    -inf where every hypothesis has too few hits.
    """
    return np.where(_has_hits(tree), tree.evidence + LOG_GAIN, -np.inf)


def decided_by_speed(tree: Tree, threshold: float, max_speed: float) -> Tree:
    """The tree under the prior that ends at v_max, where the evidence may be enough.

    So are the rivals of starts in other detections: those that share a hit with a start.
    """
    hypotheses = tree.hypotheses
    strong = (attainable(tree) >= threshold)[tree.newest]
    hits = np.unique(hypotheses.hits[tree.missed :][strong])
    rival = hypotheses.score >= threshold + RELATIVE_PRUNING - LOG_GAIN
    rival[rival] = np.isin(hypotheses.hits[rival], hits[hits != NO_HIT]).any(axis=1)
    rival[tree.missed :] |= strong
    return replace(tree, hypotheses=within_max_speed(hypotheses, rival, max_speed))


def resolved(
    members: Hypotheses,
    tree: Tree,
    window: MeasurementWindow,
    min_time: float,
    fit: HitFit,
    min_purity: float = SURE_PROBABILITY,
) -> Start | None:
    """The track of hypotheses with one newest detection.

    None while the target's hits are not resolved, up to `MAX_UNRESOLVED_HITS` hits. They are
    resolved where more than half of the hits are right with a probability of `min_purity`.

    The newest detection is as uncertain as the others: hypotheses of the same target that end in
    another detection, or miss the scan, are rivals.
    """
    evidence = float(np.logaddexp.reduce(members.score))
    rivals = rivals_of(members, tree, evidence)
    begun = rivals[rivals.hit_count == 1]
    rivals = rivals[spans_time(rivals, 2, window, min_time)]
    long = spans_time(rivals, MIN_HITS, window, min_time)
    if not long.any():
        return None
    detections, probability = hit_probabilities(rivals)
    best = np.argmax(np.where(long, rivals.score, -np.inf))
    waits = rivals.hit_count[best] < MAX_UNRESOLVED_HITS
    if waits and (probability > EVEN_PROBABILITY).sum() < MIN_HITS:
        return None
    hits = hit_posterior(detections, probability, rivals.hits[best])
    common = np.isin(rivals.hits, hits).sum(axis=1)
    right = common > 0.5 * len(hits)
    # A strong echo may as well be the first of its target, and the hits before it clutter.
    share = softmax(np.append(rivals.score, begun.score))[: len(rivals)]
    least = min_purity if waits else EVEN_PROBABILITY
    if share[right].sum() < least:
        return None
    state, covariance = mixed(rivals[right], fit)
    path = rivals.hits[best][: rivals.hit_count[best]]
    return Start(
        hits,
        path,
        detections,
        probability,
        state,
        covariance,
        evidence,
        int(members.last_hit[0]),
    )


def rivals_of(members: Hypotheses, tree: Tree, evidence: float) -> Hypotheses:
    """Hypotheses of the same target as `members`, whatever detection they end in.

    A single hit is a hypothesis of its own where it has an amplitude.
    """
    likely, probability = hit_probabilities(members)
    hypotheses = tree.hypotheses
    pool = (hypotheses.score > evidence + RELATIVE_PRUNING) & (
        hypotheses.hit_count + hypotheses.amplitude_count >= 2
    )
    rivals = hypotheses[pool]
    common = sums_over_hits(rivals.hits, likely, probability)
    least = np.minimum(rivals.hit_count, probability.sum())
    return rivals[common > MIN_COMMON_SHARE * least]


def hit_probabilities(members: Hypotheses) -> tuple[IntArray, FloatArray]:
    """Detections of hypotheses of one target, (h,), and the probability of each."""
    share = softmax(members.score)
    detections, index = np.unique(members.hits, return_inverse=True)
    mass = np.bincount(index.ravel(), np.repeat(share, members.hits.shape[1]))
    hit = detections != NO_HIT
    return detections[hit], mass[hit]


def hit_posterior(detections: IntArray, probability: FloatArray, best: IntArray) -> IntArray:
    """The detections (c,), ascending, that are credible as hits.

    Those that are sure; where these are too few, the most probable of all that are more probable
    than not; where these are too few, the most probable of the `best` hypothesis. Each further
    doubtful hit would make it more probable that most of the hits are wrong.
    """
    sure = detections[probability >= SURE_PROBABILITY]
    if len(sure) >= MIN_HITS:
        return sure
    if (probability > EVEN_PROBABILITY).sum() >= MIN_HITS:
        return np.sort(detections[np.argsort(-probability, kind="stable")[:MIN_HITS]])
    path = best[best != NO_HIT]
    of_path = probability[np.searchsorted(detections, path)]
    return np.sort(path[np.argsort(-of_path, kind="stable")[:MIN_HITS]])


def spans_time(
    hypotheses: Hypotheses, min_hits: int, window: MeasurementWindow, min_time: float
) -> BoolArray:
    """Which hypotheses have enough hits over more than a minimum time (s), (n,)."""
    enough = hypotheses.hit_count >= min_hits
    newest = window[hypotheses.last_hit]["time"]
    oldest = window[hypotheses.hits[:, 0]]["time"]
    return enough & (np.abs(newest - oldest) > min_time)


def mixed(members: Hypotheses, fit: HitFit) -> tuple[FloatArray, FloatArray]:
    """State and covariance over the hypotheses of one track, each fitted to its hits alone."""
    share = softmax(members.score)
    counted = share >= MIN_RELATIVE_WEIGHT * share.max()
    states, covariances = fit(members[counted])
    return mixture(share[counted] / share[counted].sum(), states, covariances)


def existence(evaluation: FloatArray, false_tracks_per_hour: float) -> FloatArray:
    """Posterior probability that targets exist, (n,), from the evidence above the threshold, (n,).

    The prior is `TARGET_BIRTH_RATE`: at the threshold, the odds are this rate over the target
    false-track rate.
    """
    false = false_tracks_per_hour * np.exp(-evaluation)
    return np.clip(
        TARGET_BIRTH_RATE / (TARGET_BIRTH_RATE + false), MIN_NEW_EXISTENCE, NEW_TRACK_EXISTENCE
    )


def min_purity_probability(false_tracks_per_hour: float) -> float:
    """Minimum probability that more than half of a start's hits are its target's, 0.5 to 0.9.

    A less certain start waits: a track with half of its hits wrong is useless, and hides its
    target. The minimum falls with the logarithm of the target rate (per hour) from `PURE_RATE` to
    `LEAST_PURE_RATE`: a start with wrong hits is then a false track among many, whose low existence
    probability leaves the target's detections free.
    """
    rates, purities = (PURE_RATE, LEAST_PURE_RATE), (SURE_PROBABILITY, EVEN_PROBABILITY)
    return float(np.interp(math.log(false_tracks_per_hour), np.log(rates), purities))
