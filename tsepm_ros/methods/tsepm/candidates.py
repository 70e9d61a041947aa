"""Tracks that reached confirmation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from tsepm_ros.numerics.arrays import FloatArray, IntArray
from tsepm_ros.numerics.rows import Rows


@dataclass(frozen=True)
class Candidates(Rows):
    """Tracks that reached confirmation, fitted and evaluated.

    Attributes
    ----------
    hits : (n, M) ndarray of int
        Detection ids.
    state, covariance : (n, 4), (n, 4, 4) ndarray
        The fit.
    distance : (n,) ndarray
        f_1, also the weight in merging.
    evaluation : (n,) ndarray
        The evaluation that pruning uses.
    """

    hits: IntArray
    state: FloatArray
    covariance: FloatArray
    distance: FloatArray
    evaluation: FloatArray

    @classmethod
    def none(cls, hits: int) -> Self:
        """No tracks, of a number of hits."""
        figures = np.zeros(0)
        return cls(
            np.zeros((0, hits), np.int64), np.zeros((0, 4)), np.zeros((0, 4, 4)), figures, figures
        )
