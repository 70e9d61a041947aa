"""Which hits are a target's, and its state, over the hypotheses that may be the target's.

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

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.special import softmax

from tsepm_ros.methods.score.grown import Grown
from tsepm_ros.methods.score.hypotheses import Hypotheses
from tsepm_ros.methods.score.score_options import MIN_HITS
from tsepm_ros.methods.score.tree import RELATIVE_PRUNING
from tsepm_ros.numerics import grouped
from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray
from tsepm_ros.numerics.gaussian import mixture
from tsepm_ros.numerics.grouped import sums_over_hits
from tsepm_ros.sensing.detection_window import DetectionWindow
from tsepm_ros.stages.paths import NO_HIT

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
