"""Hypotheses of the tree, and what they have grown to.

Hypotheses of the likelihood-ratio method: which detections are one target's, and where it is.

The tree of hypotheses after a scan, before it is pruned.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from tsepm_ros.numerics import grouped
from tsepm_ros.numerics.arrays import FloatArray, IntArray, changed
from tsepm_ros.numerics.grouped import sums_over_hits
from tsepm_ros.tracker.path_fit import Paths


@dataclass(frozen=True)
class Hypotheses(Paths):
    """Hypotheses as arrays, a row each.

    Attributes
    ----------
    hits, hit_count, first_scan
        As in `Paths`, for at most `window` hits.
    state, covariance : (n, 4), (n, 4, 4) ndarray
        At the last scan's stamp.
    score : (n,) ndarray
        Log-likelihood ratio.
    score_given_held : (n,) ndarray
        The same for one more target, where the density due to held tracks counts as clutter.
    faded : (n,) ndarray
        Probability that the target has faded, see `fading`.
    strength_count, strength_total : (n,) ndarray
        Hits whose strength counts, and the sum of their exponents; see `path_strength`.
    strength_score : (n,) ndarray
        Part of the score that is due to strengths.
    """

    state: FloatArray
    covariance: FloatArray
    score: FloatArray
    score_given_held: FloatArray
    faded: FloatArray
    strength_count: IntArray
    strength_total: FloatArray
    strength_score: FloatArray

    def scored_given_held(self) -> Hypotheses:
        """The hypotheses with their scores given the held tracks."""
        return changed(self, score=self.score_given_held)

    def given_track(self, ids: IntArray, probability: FloatArray) -> Hypotheses:
        """The hypotheses given a new held track.

        Parameters
        ----------
        ids : (c,) ndarray of int
            Detections, ascending.
        probability : (c,) ndarray
            Association probability of each with the new track.

        Returns
        -------
        Hypotheses
            `score_given_held` is reduced by the share of hits that are due to the track, as if
            each hit had the same increment.
        """
        share = sums_over_hits(self.hits, ids, probability) / self.hit_count
        score = self.score_given_held
        return changed(self, score_given_held=score - share * np.maximum(score, 0.0))

    @classmethod
    def none(cls, window: int) -> Hypotheses:
        """No hypotheses."""
        count = np.zeros(0, np.int64)
        return cls(
            np.zeros((0, window), np.int64),
            count,
            count,
            np.zeros((0, 4)),
            np.zeros((0, 4, 4)),
            np.zeros(0),
            np.zeros(0),
            np.zeros(0),
            count,
            np.zeros(0),
            np.zeros(0),
        )


PRIOR_TARGET_ODDS = 0.001
"""Prior odds, for the clutter map, that a detection is of a target that began in a given scan."""


@dataclass(frozen=True)
class Grown:
    """The tree after a scan, not yet pruned.

    Attributes
    ----------
    ended : Hypotheses
        Those that end in a detection of the scan.
    missed : Hypotheses
        Those that leave the scan out.
    ids : (d,) ndarray of int
        Ids of the scan's detections, ascending.
    """

    ended: Hypotheses
    missed: Hypotheses
    ids: IntArray

    @cached_property
    def newest(self) -> IntArray:
        """Place in the scan of the last hit of each of `ended`, (n,)."""
        return self.ended.last_hit - (self.ids[0] if len(self.ids) else 0)

    @cached_property
    def evidence(self) -> FloatArray:
        """``ln sum_i exp(s_i)`` over the hypotheses that end in each detection, (d,)."""
        return grouped.summed(self.ended.score, self.newest, len(self.ids))

    @property
    def target_probability(self) -> FloatArray:
        """Probability that each detection is that of a target not confirmed yet, (d,)."""
        odds = self.evidence + math.log(PRIOR_TARGET_ODDS)
        probability: FloatArray = np.exp(-np.logaddexp(0.0, -odds))
        return probability

    @property
    def number(self) -> int:
        """Number of hypotheses."""
        return len(self.ended) + len(self.missed)

    def of_each(self, change: Callable[[Hypotheses], Hypotheses]) -> Grown:
        """The tree with both of its parts changed."""
        return replace(self, ended=change(self.ended), missed=change(self.missed))
