"""Places where detections lay close together ping after ping."""

from __future__ import annotations

import numpy as np

from tsepm_ros.numerics import discs
from tsepm_ros.numerics.arrays import FloatArray, IntArray
from tsepm_ros.sensing.plots import PlotExtent, crowded, pairs_within

MAX_DETECTIONS = 2000
"""Detections of a ping beyond which it ends every streak: bounds the time."""
MAX_PAIRS = 200_000
"""Pairs of detections within the extent, or of detections and places of streaks within the reach,
beyond which it does so too."""


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

    @property
    def longest(self) -> int:
        """Length of the longest streak, the last ping included; 0 where there is none."""
        return int(self._length.max(initial=0))

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
        near = self._near(range, position, reach)
        if near is None or n > MAX_DETECTIONS or crowded(range, azimuth, self._extent, MAX_PAIRS):
            self._position, self._length = np.zeros((0, 2)), np.zeros(0, np.int64)
            return np.zeros(n, np.int64)
        length = np.zeros(n, np.int64)
        detection, place = near
        np.maximum.at(length, detection, self._length[place])
        first, second, _ = pairs_within(range, azimuth, self._extent)
        close = np.unique(np.concatenate([first, second]))
        self._position, self._length = position[close], length[close] + 1
        return length

    def _near(
        self, range: FloatArray, position: FloatArray, reach: float
    ) -> tuple[IntArray, IntArray] | None:
        """Pairs of detections and places of streaks within reach; None of more than `MAX_PAIRS`."""
        limit = reach + self._extent.across_at(range)
        return discs.pairs_within(self._position, position, limit, MAX_PAIRS)
