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
from functools import cached_property

import numpy as np

from tsepm_ros.numerics.arrays import FloatArray, IntArray

PING_WINDOWS = (16, 4, 1)
"""Pings over which a level is judged, from long to short."""
PING_DEVIATIONS = 2.5
"""Standard deviations of the median's rank beyond which the level of pings changes."""
PLACE_DEVIATIONS = 1.25
"""Standard deviations of a window's mean within which the level of a place stays unchanged."""
RANGE_DEVIATIONS = 3.0
"""Standard deviations of a change with range beyond which it counts."""
RANGE_TARGET_COUNT = 4.0
"""Detections at some range that may be of a target that is not known as likely."""
MAX_RANGE_CHANGES = 4
"""Changes with range that are looked for."""
PLACE_MEMORY = 50
"""Time constant, in pings, with which the levels of places fade."""
CELLS_TOGETHER = 2
"""Cells of a clutter map along a side of a cell here."""
RINGS = 4
"""Rings in a cell of a clutter map; a step with range is placed between two rings."""
RINGS_TOGETHER = CELLS_TOGETHER * RINGS
"""Rings in a cell here."""
MIN_WINDOW_CELLS = 2
"""Cells along a side of the smallest window; each larger window is twice as wide."""
LEAST_UNIT = 1e-6
"""Unit of the learned sums below which they are rescaled to a unit of 1, before they overflow."""
MAX_TARGET_COUNT = 16.0
"""Detections in a window that may be of a target: at most this, or two and one a ping."""


def ping_level(
    level: float,
    values: FloatArray,
    sizes: Sequence[int],
    windows: Sequence[int] = PING_WINDOWS,
) -> float:
    """The level of the last ping.

    Parameters
    ----------
    level : float
        The level as a rule.
    values : (n,) ndarray
        Logarithms of strengths of the last pings, in order.
    sizes : sequence of int
        Number of values of each ping.
    windows : sequence of int
        Pings, from long to short; longer ones than there are pings do not count.

    Returns
    -------
    float
        The median of the shortest window that contradicts; `level` where none does.
    """
    for window in windows:
        if window <= len(sizes):
            level = window_level(level, values[len(values) - sum(sizes[-window:]) :], window)
    return level


def window_level(level: float, values: FloatArray, pings: int) -> float:
    """The level of a window of pings with values (n,): `level` if they do not contradict."""
    n = len(values)
    target = min(pings + 2.0, MAX_TARGET_COUNT)
    deviation = 0.5 * PING_DEVIATIONS * math.sqrt(n)
    middle = 0.5 * (n - target)
    low, high = math.floor(middle - deviation), math.ceil(0.5 * n + deviation)
    # Of n values in order, that at `low` is above the level if at most `low` are not.
    if low >= 0 and np.count_nonzero(values <= level) <= low:
        return float(np.sort(values)[math.floor(middle)])
    if high < n and np.count_nonzero(values < level) > high:
        return float(np.sort(values)[n // 2])
    return level


def level_by_range(
    count: FloatArray, total: FloatArray, top: float, deviation: float
) -> FloatArray:
    """Level of each ring, (r,): changes with range, each beyond doubt, the clearest first.

    A change is a power of the range or a step at some range; rings are nearly even in the range's
    logarithm. Of all changes, that which explains the most of the squares is taken, and then of
    what it leaves; none where none is beyond doubt.

    Parameters
    ----------
    count, total : (r,) ndarray
        Weight of the detections of each ring, and the sum of their deviations from their mean.
    top : float
        Most that a detection deviates.
    deviation : float
        Standard deviation of a detection.
    """
    level, everything = np.zeros(len(count)), float(count.sum())
    if everything <= 0.0:
        return level
    rings = np.arange(len(count))
    slope = rings - count @ rings / everything
    square, farthest = max(float(count @ slope**2), 1e-9), float(np.abs(slope[count > 0.0]).max())
    below = np.cumsum(count)[:-1]
    above = np.maximum(everything - below, 0.0)
    squares = np.append(below * above / everything, square)
    reach = np.append(np.ones(len(below)), farthest)
    doubt = RANGE_TARGET_COUNT * top * reach
    doubt += RANGE_DEVIATIONS * deviation * np.sqrt(squares)
    for _ in range(MAX_RANGE_CHANGES):
        # Of a step, the sum below it; of the power, the sum over its rings.
        sums = np.append(np.cumsum(total)[:-1], total @ slope)
        clear = np.abs(sums) > doubt
        if not clear.any():
            break
        best = int(np.argmax(np.where(clear, sums**2 / np.maximum(squares, 1e-9), 0.0)))
        change = sums[best] / squares[best] * slope
        if best < len(below):
            change = np.where(rings <= best, 1.0 / below[best], -1.0 / above[best]) * sums[best]
        level += change
        total = total - count * change
    return level


@dataclass
class PlaceLevels:
    """Levels over the cells of a clutter map, and by range over the rings of these.

    Parameters
    ----------
    shape : (int, int)
        Number of cells of the clutter map in range and in azimuth.
    wraps : bool
        Whether the last column is next to the first.
    """

    shape: tuple[int, int]
    wraps: bool

    def __post_init__(self) -> None:
        rows, columns = self.shape
        self.shape = -(-rows // CELLS_TOGETHER), max(columns // CELLS_TOGETHER, 1)
        rings = self.shape[0] * RINGS_TOGETHER
        # Weights, and sums of the weighted values, by ring and column, in units that fade: a ping
        # costs what its detections cost, not what all places would.
        self._learned = np.zeros((2, rings * self.shape[1]))
        self._unit = 1.0
        self._pings = 0.0
        self._deviation = self._top = self._centre = 0.0
        self._by_range = np.zeros(rings)
        # Of weights, and of what the levels by range leave, before each row and column.
        self._sums = np.zeros((2, (self.shape[0] + 1) * (self.shape[1] + 1)))

    def places_of(self, ring: IntArray, column: IntArray) -> IntArray:
        """Places (n,) in rings and columns of the clutter map, as numbers."""
        columns = self.shape[1]
        return np.asarray(ring * columns + np.minimum(column // CELLS_TOGETHER, columns - 1))

    def update(
        self,
        places: IntArray,
        values: FloatArray,
        weight: FloatArray,
        top: float,
        deviation: float,
    ) -> None:
        """Learn from a ping.

        Parameters
        ----------
        places : (n,) ndarray of int
            Of each detection, see `places_of`.
        values, weight : (n,) ndarray
            Deviation of each from the level of its ping, bounded around the level of its place, and
            its probability to be clutter.
        top, deviation : float
            The bound above the level of the place, and the standard deviation around that.
        """
        keep = 1.0 - 1.0 / PLACE_MEMORY
        self._unit *= keep
        if self._unit < LEAST_UNIT:
            self._learned *= self._unit
            self._unit = 1.0
        weight = weight / self._unit
        self._pings = keep * self._pings + 1.0
        np.add.at(self._learned[0], places, weight)
        np.add.at(self._learned[1], places, weight * values)
        self._top, self._deviation = top, deviation

    def withdraw(
        self, places: IntArray, values: FloatArray, weight: FloatArray, age: IntArray
    ) -> None:
        """Remove weight (n,) of detections of the last pings, learned so many pings ago.

        What has faded since is gone already: without it, a place would keep a sum without a weight,
        and a level without bounds.
        """
        weight = weight * (1.0 - 1.0 / PLACE_MEMORY) ** age / self._unit
        np.subtract.at(self._learned[0], places, weight)
        np.subtract.at(self._learned[1], places, weight * values)
        self._learned[0, places] = np.maximum(self._learned[0, places], 0.0)

    def at(self, places: IntArray) -> FloatArray:
        """Level at places (n,), 0 where no window contradicts: by range, and then by cell."""
        if not self._pings or not self._deviation or not len(places):
            return np.zeros(len(places))
        columns = self.shape[1]
        cells = places // (RINGS_TOGETHER * columns) * columns + places % columns
        # Of weights and sums, for each cell and each side of a window, (2, n, s).
        around = self._sums.take(self._corners[cells], axis=1)
        right, left = around[:, :, 0] - around[:, :, 1], around[:, :, 2] - around[:, :, 3]
        behind = around[:, :, 4] - around[:, :, 5]
        count, total = right - left + behind
        return self.by_range(places) + self._level(count.T, total.T)

    def renew(self) -> None:
        """Take the levels from what was learned so far; those by range first."""
        left = self._unit * self._learned.reshape(2, -1, self.shape[1])
        count, total = left.sum(axis=2)
        self._centre = float(total.sum() / max(count.sum(), 1e-9))
        total -= self._centre * count
        self._by_range = level_by_range(count, total, self._top, self._deviation)
        left[1] -= (self._centre + self._by_range)[:, None] * left[0]
        left = left.reshape(2, -1, RINGS_TOGETHER, self.shape[1]).sum(axis=2)
        sums = np.zeros((2, self.shape[0] + 1, self.shape[1] + 1))
        np.cumsum(np.cumsum(left, axis=1), axis=2, out=sums[:, 1:, 1:])
        self._sums = sums.reshape(2, -1)

    def by_range(self, places: IntArray) -> FloatArray:
        """Level by range at places (n,), as of the last `renew`."""
        return np.asarray(self._by_range[places // self.shape[1]])

    def _level(self, count: FloatArray, total: FloatArray) -> FloatArray:
        """Level (n,) that windows do not contradict, by their counts and sums (s, n).

        They go from wide to narrow. As many detections as a target may have do not count in a rise.
        """
        target = min(self._pings + 2.0, MAX_TARGET_COUNT)
        spread = PLACE_DEVIATIONS * self._deviation
        some, without = np.maximum(count, 1e-9), np.maximum(count - target, 1e-9)
        mean = total / some
        high = mean + spread / np.sqrt(some)
        low = mean - target * self._top / without - spread / np.sqrt(without)
        np.maximum(high, low, out=high)
        level = np.zeros(count.shape[1])
        for least, most in zip(low, high, strict=True):
            level = np.minimum(np.maximum(level, least), most)
        return level

    @cached_property
    def _corners(self) -> IntArray:
        """Corners of the windows around each cell, (c, 6, s), from the widest window on.

        They are places in the sums over all rows and columns before each: the upper and the bottom
        end of the right side, of the left side, and of the last column where the window goes on
        behind the first.
        """
        rows, columns = self.shape
        row, column = np.divmod(np.arange(rows * columns), columns)
        corners = []
        side = max(self.shape)
        while side >= MIN_WINDOW_CELLS:
            bottom = np.clip(row - side // 2, 0, max(rows - side, 0))
            upper = np.minimum(bottom + side, rows)
            if side >= columns:
                left, right = np.zeros_like(bottom), np.full_like(bottom, columns)
            elif self.wraps:
                left = (column - side // 2) % columns
                right = left + side
            else:
                left = np.clip(column - side // 2, 0, columns - side)
                right = left + side
            inside = np.minimum(right, columns)
            ends = [
                end * (columns + 1) + edge
                for edge in (inside, left, right - inside)
                for end in (upper, bottom)
            ]
            corners.append(ends)
            side //= 2
        by_side = np.array(corners, np.int64).reshape(-1, 6, rows * columns)
        # By cell: the corners of a cell's windows are beside each other.
        return np.ascontiguousarray(by_side.transpose(2, 1, 0))
