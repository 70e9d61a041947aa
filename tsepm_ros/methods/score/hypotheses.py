"""Hypotheses of the likelihood-ratio method: which detections are one target's, and where it is."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tsepm_ros.numerics.arrays import FloatArray, IntArray
from tsepm_ros.numerics.grouped import sums_over_hits
from tsepm_ros.stages.paths import Paths


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
    beside : (n,) ndarray
        The same for one more target, where what held ones explain counts as clutter does.
    """

    state: FloatArray
    covariance: FloatArray
    score: FloatArray
    beside: FloatArray

    def as_beside(self) -> Hypotheses:
        """The hypotheses scored as one more target beside those that are held."""
        return replace(self, score=self.beside)

    def beside_claims(self, ids: IntArray, probability: FloatArray) -> Hypotheses:
        """The hypotheses as seen beside a new track that claims detections.

        Parameters
        ----------
        ids : (c,) ndarray of int
            Detections, ascending.
        probability : (c,) ndarray
            How probably each is the new track's.

        Returns
        -------
        Hypotheses
            `beside` is less by the share of the hits claimed: on average each gave the same.
        """
        share = sums_over_hits(self.hits, ids, probability) / self.hit_count
        return replace(self, beside=self.beside - share * np.maximum(self.beside, 0.0))

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
        )
