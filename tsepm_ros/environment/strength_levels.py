"""Levels of the strength of clutter: from ping to ping, and from place to place.

A level is a shift of the logarithms of strengths. It changes only as far as the detections require,
from long windows to short ones (Lepski, as in `clutter_map`), so that a level that does not change
costs nothing, and ties stay ties. An unknown target may have a detection a ping: as many do not
count in a rise.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tsepm_ros.numerics.arrays import FloatArray, IntArray

PING_WINDOWS = (16, 4, 1)
"""Pings over which a level is judged, from long to short."""
PING_DEVIATIONS = 2.5
"""Standard deviations of the median's rank beyond which the level of pings changes."""
PLACE_DEVIATIONS = 1.25
"""Standard deviations of a window's mean within which the level of a place stays unchanged."""
PLACE_MEMORY = 50
"""Time constant, in pings, with which the levels of places fade."""
CELLS_TOGETHER = 2
"""Cells of a clutter map along a side of a cell here."""
MIN_WINDOW_CELLS = 2
"""Cells along a side of the smallest window; each larger window is twice as wide."""
MAX_TARGET_COUNT = 16.0
"""Detections in a window that may be of a target: at most this, or two and one a ping."""


def ping_level(
    level: float, pings: Sequence[FloatArray], windows: Sequence[int] = PING_WINDOWS
) -> float:
    """The level of the last ping.

    Parameters
    ----------
    level : float
        The level as a rule.
    pings : sequence of (n,) ndarray
        Logarithms of strengths of the last pings, in order.
    windows : sequence of int
        Pings, from long to short; longer ones than there are pings do not count.

    Returns
    -------
    float
        The median of the shortest window that contradicts; `level` where none does.
    """
    for window in windows:
        if window > len(pings):
            continue
        values = np.sort(np.concatenate(pings[-window:]))
        n = len(values)
        target = min(window + 2.0, MAX_TARGET_COUNT)
        deviation = 0.5 * PING_DEVIATIONS * math.sqrt(n)
        middle = 0.5 * (n - target)
        low, high = math.floor(middle - deviation), math.ceil(0.5 * n + deviation)
        if low >= 0 and values[low] > level:
            level = float(values[math.floor(middle)])
        elif high < n and values[high] < level:
            level = float(values[n // 2])
    return level


@dataclass
class PlaceLevels:
    """Levels over the cells of a clutter map.

    Parameters
    ----------
    shape : (int, int)
        Number of cells in range and in azimuth.
    wraps : bool
        Whether the last column is next to the first.
    """

    shape: tuple[int, int]
    wraps: bool

    def __post_init__(self) -> None:
        rows, columns = self.shape
        self.shape = -(-rows // CELLS_TOGETHER), max(columns // CELLS_TOGETHER, 1)
        self._weight = np.zeros(self.shape)
        self._sum = np.zeros(self.shape)
        self._pings = 0.0
        self._deviation = self._top = 0.0
        self._sums: tuple[FloatArray, FloatArray] | None = None

    def update(
        self,
        cells: tuple[IntArray, IntArray],
        values: FloatArray,
        weight: FloatArray,
        top: float,
        deviation: float,
    ) -> None:
        """Learn from a ping.

        Parameters
        ----------
        cells : tuple of (n,) ndarray of int
            Row and column of each detection.
        values, weight : (n,) ndarray
            Bounded deviation of each from the level of its ping, and its probability to be clutter.
        top, deviation : float
            The largest value, and the standard deviation of the values.
        """
        keep = 1.0 - 1.0 / PLACE_MEMORY
        self._weight *= keep
        self._sum *= keep
        self._pings = keep * self._pings + 1.0
        cells = self._coarse(cells)
        np.add.at(self._weight, cells, weight)
        np.add.at(self._sum, cells, weight * values)
        self._top, self._deviation = top, deviation
        self._sums = None

    def withdraw(
        self, cells: tuple[IntArray, IntArray], values: FloatArray, weight: FloatArray
    ) -> None:
        """Remove weight of detections of the last pings."""
        cells = self._coarse(cells)
        np.subtract.at(self._weight, cells, weight)
        np.subtract.at(self._sum, cells, weight * values)
        np.maximum(self._weight, 0.0, out=self._weight)
        self._sums = None

    def at(self, cells: tuple[IntArray, IntArray]) -> FloatArray:
        """Level at cells (n,), 0 where no window contradicts."""
        level = np.zeros(len(cells[0]))
        if not self._pings or not self._deviation or not len(level):
            return level
        if self._sums is None:
            self._sums = _summed(self._weight), _summed(self._sum)
        weights, sums = self._sums
        everything = max(float(weights[-1, -1]), 1e-9)
        centre = float(sums[-1, -1]) / everything
        target = min(self._pings + 2.0, MAX_TARGET_COUNT)
        cells = self._coarse(cells)
        side = max(self.shape)
        while side >= MIN_WINDOW_CELLS:
            count = self._around(weights, cells, side)
            total = self._around(sums, cells, side) - centre * count
            without = np.maximum(count - target, 0.0)
            spread = PLACE_DEVIATIONS * self._deviation
            some = np.maximum(without, 1e-9)
            low = (total - target * (self._top - centre)) / some - spread / np.sqrt(some)
            low = np.where(without > 0.0, low, -np.inf)
            some = np.maximum(count, 1e-9)
            high = np.where(count > 0.0, total / some + spread / np.sqrt(some), np.inf)
            level = np.clip(level, low, np.maximum(low, high))
            side //= 2
        return level

    def _coarse(self, cells: tuple[IntArray, IntArray]) -> tuple[IntArray, IntArray]:
        """Row and column here of cells of the clutter map."""
        column = np.minimum(cells[1] // CELLS_TOGETHER, self.shape[1] - 1)
        return cells[0] // CELLS_TOGETHER, column

    def _around(self, sums: FloatArray, cells: tuple[IntArray, IntArray], side: int) -> FloatArray:
        """Sum over the window of a side around each cell, (n,)."""
        rows, columns = self.shape
        bottom = np.clip(cells[0] - side // 2, 0, max(rows - side, 0))
        upper = np.minimum(bottom + side, rows)
        if side >= columns:
            left, right = np.zeros_like(bottom), np.full_like(bottom, columns)
        elif self.wraps:
            left = (cells[1] - side // 2) % columns
            right = left + side
        else:
            left = np.clip(cells[1] - side // 2, 0, columns - side)
            right = left + side
        inside = np.minimum(right, columns)
        total = _box(sums, bottom, upper, left, inside)
        return np.asarray(total + _box(sums, bottom, upper, 0 * left, right - inside))


def _summed(values: FloatArray) -> FloatArray:
    """Sums over all rows and columns before each, (r + 1, c + 1)."""
    sums = np.zeros((values.shape[0] + 1, values.shape[1] + 1))
    np.cumsum(np.cumsum(values, axis=0), axis=1, out=sums[1:, 1:])
    return sums


def _box(
    sums: FloatArray, bottom: IntArray, upper: IntArray, left: IntArray, right: IntArray
) -> FloatArray:
    """Sum over rows bottom <= row < upper and columns left <= column < right, (n,)."""
    box: FloatArray = (
        sums[upper, right] - sums[bottom, right] - sums[upper, left] + sums[bottom, left]
    )
    return box
