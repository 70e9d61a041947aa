"""Places where detections lay close together ping after ping."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from tsepm_ros.numerics.arrays import FloatArray, IntArray
from tsepm_ros.sensing.plots import PlotExtent, crowded, pairs_within

NEAREST = 8
"""Places nearest to a detection at which it looks for streaks."""
MAX_DETECTIONS = 2000
"""Detections of a ping beyond which it ends every streak: bounds the time."""
MAX_PAIRS = 200_000
"""Pairs of detections within the extent beyond which it does so too."""


class CloseStreaks:
    """Counts, at each detection, the pings in a row that had detections close together there.

    Parameters
    ----------
    extent : PlotExtent
        Within which two detections are close.
    """

    def __init__(self, extent: PlotExtent) -> None:
        self._extent = extent
        self._position = np.zeros((0, 2))
        self._length = np.zeros(0, np.int64)

    def step(
        self, range: FloatArray, azimuth: FloatArray, position: FloatArray, reach: float
    ) -> IntArray:
        """Take a ping and return the length of the longest streak before it at each detection.

        Parameters
        ----------
        range, azimuth : (n,) ndarray
            m and rad.
        position : (n, 2) ndarray
            In the fixed frame, m.
        reach : float
            How far a target may move from ping to ping, m; an extent comes on top.

        Returns
        -------
        (n,) ndarray of int
            It depends on the pings before and on the detection's place alone.
        """
        n = len(range)
        length = np.zeros(n, np.int64)
        if n > MAX_DETECTIONS or crowded(range, azimuth, self._extent, MAX_PAIRS):
            self._position, self._length = np.zeros((0, 2)), length[:0]
            return length
        if n and len(self._position):
            limit = reach + self._extent.across_at(range)
            away, row = cKDTree(self._position).query(position, k=NEAREST)
            found = np.where(np.isfinite(away), row, 0)
            longest = np.where(away <= limit[:, None], self._length[found], 0)
            length = np.asarray(longest.max(axis=1), np.int64)
        first, second, _ = pairs_within(range, azimuth, self._extent)
        close = np.unique(np.concatenate([first, second]))
        self._position, self._length = position[close], length[close] + 1
        return length
