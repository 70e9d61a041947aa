"""How much closer than by chance clutter lies along, or across, the line of sight."""

from __future__ import annotations

import numpy as np

from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray

MEMORY = 100.0
"""Pings that count: older ones fade."""
PRIOR = 0.5
"""Detections for which an even distribution counts."""


class StripCounts:
    """Counts of detections in strips through smaller boxes, inside larger ones, but beside them.

    Of two detections in a larger box that are not as near as a smaller one across the line of
    sight, a share a is as near along it; evenly distributed, that is the ratio of the depths. Along
    and across independent, detections fall into the smaller box more often than by the areas by the
    factor of both shares to those ratios.

    Parameters
    ----------
    shape : tuple of int
        Tests and extents.
    """

    def __init__(self, shape: tuple[int, int]) -> None:
        self._found = np.zeros((2, *shape))
        self._expected = np.zeros((2, *shape))

    def count(
        self,
        test: IntArray,
        near: tuple[BoolArray, BoolArray],
        shares: tuple[FloatArray, FloatArray],
    ) -> None:
        """Count the detections of a ping that fall into larger boxes.

        Parameters
        ----------
        test : (f,) ndarray of int
            Of each, ascending.
        near : tuple of (f, e) ndarray of bool
            Whether it is as near as the smaller box along the line of sight, and across.
        shares : tuple of (f, e) ndarray
            Probabilities of it by the area.
        """
        self._found *= 1.0 - 1.0 / MEMORY
        self._expected *= 1.0 - 1.0 / MEMORY
        first = np.flatnonzero(np.diff(test, prepend=-1))
        for axis in (0, 1):
            beside = ~near[1 - axis]
            self._found[axis, test[first]] += np.add.reduceat(
                near[axis] & beside, first, dtype=float
            )
            expected = np.where(beside, shares[axis], 0.0)
            self._expected[axis, test[first]] += np.add.reduceat(expected, first)

    @property
    def concentration(self) -> FloatArray:
        """Factor on the odds of each test and extent, at least 1."""
        ratio = (self._found + PRIOR) / (self._expected + PRIOR)
        return np.asarray(np.maximum(ratio, 1.0).prod(axis=0))
