"""Windows of several sizes on a polar grid, and the area of each in which clutter is seen."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tsepm_ros.environment.polar_grid import BlockSums, PolarGrid
from tsepm_ros.numerics.arrays import BoolArray, FloatArray

MIN_WINDOW_CELLS = 4
"""Cells along a side of the smallest window; each larger window is twice as wide."""
ROUNDING = 1e-9
"""Part of a sum that its rounding errors do not reach, however it is summed."""


@dataclass(frozen=True, eq=False)
class WindowSize:
    """Windows of one size on a grid.

    Attributes
    ----------
    height, width : int
        Cells.
    wraps : bool
        Whether they wrap around in azimuth.
    rows, columns : int
        Number of rows and columns in which windows begin.
    part : slice
        Of the rows of all sizes, see `Windows`.
    """

    height: int
    width: int
    wraps: bool
    rows: int
    columns: int
    part: slice


@dataclass(frozen=True)
class CountedArea:
    """What of an area counts: where clutter is seen, `min_share` of it at least.

    Attributes
    ----------
    widening : float
        Factor on the area in which clutter is seen; 0: the whole area counts.
    min_share : float
    """

    widening: float
    min_share: float

    def of(self, seen: FloatArray, whole: FloatArray) -> FloatArray:
        """The area that counts, m^2: of parts with these areas, of which clutter is seen in some.

        Shapes that broadcast. It is at most the whole area, and grows with the area seen.
        """
        if not self.widening:
            return np.asarray(whole)
        return np.minimum(np.maximum(self.widening * seen, self.min_share * whole), whole)


def span(which: BoolArray) -> slice | None:
    """From the first to the last of those, (n,); None without any."""
    places = which.nonzero()[0]
    return slice(int(places[0]), int(places[-1]) + 1) if len(places) else None


def sides(grid: PolarGrid) -> list[tuple[int, int]]:
    """Height and width of the windows of each size, the largest first, cells."""
    rows, columns = grid.shape
    doublings = max(math.ceil(math.log2(max(rows, columns) / MIN_WINDOW_CELLS)), 0)
    all_sides = [MIN_WINDOW_CELLS * 2**doubling for doubling in reversed(range(doublings + 1))]
    return [(min(side, rows), min(side, columns)) for side in all_sides]


class Windows:
    """Windows of all sizes on a grid.

    The rows (k,) in which windows begin are those of all sizes, one size after the other.

    Parameters
    ----------
    grid : PolarGrid

    Attributes
    ----------
    grid : PolarGrid
    sizes : list of WindowSize
        The largest first.
    begin, end : (k,) ndarray of int
        First ring of the windows of each row, and the one behind their last.
    area : (k,) ndarray
        Whole area of each window, m^2.
    per_root_area : (k,) ndarray
        ``1 / sqrt(A)`` of that, 1/m.
    """

    def __init__(self, grid: PolarGrid) -> None:
        self.grid = grid
        self.sizes: list[WindowSize] = []
        begin, end, area = [], [], []
        rings, columns = grid.shape
        first = 0
        for height, width in sides(grid):
            wraps, rows = grid.wraps and width < columns, rings - height + 1
            starts = columns if wraps else columns - width + 1
            part = slice(first, first + rows)
            self.sizes.append(WindowSize(height, width, wraps, rows, starts, part))
            begin.append(np.arange(rows))
            end.append(begin[-1] + height)
            square = grid.edges[height:] ** 2 - grid.edges[:-height] ** 2
            area.append(width * (0.5 * grid.width * square))
            first += rows
        self.begin, self.end = np.concatenate(begin), np.concatenate(end)
        self.area = np.concatenate(area)
        self.per_root_area = 1.0 / np.sqrt(self.area)


class CountedWindows:
    """The windows of all sizes on a grid, and what of their areas counts.

    The area of a window is computed where it is asked for: most windows move no density.

    Parameters
    ----------
    windows : Windows
    seen : (r, c) ndarray
        Area of each cell in which clutter is seen, m^2.
    counted : CountedArea

    Attributes
    ----------
    windows : Windows
    seen : (r, c) ndarray
    """

    def __init__(self, windows: Windows, seen: FloatArray, counted: CountedArea) -> None:
        self.windows, self.seen = windows, seen
        self._counted = counted
        self._sums: BlockSums | None = None
        self._known: dict[WindowSize, tuple[slice, FloatArray]] = {}

    def per_root_area(self, size: WindowSize, rows: slice) -> FloatArray:
        """``1 / sqrt(A)`` of the windows of a size that begin in rows (i, j), 1/m."""
        known, values = self._known.get(size, (slice(0, 0), np.zeros((0, 0))))
        if rows.start < known.start or rows.stop > known.stop:
            # The rows of a few windows, and all at the second time.
            few = not len(values) and 2 * (rows.stop - rows.start) < size.rows
            known = rows if few else slice(0, size.rows)
            values = self._per_root_area(size, known)
            self._known[size] = known, values
        return values[rows.start - known.start : rows.stop - known.start]

    def _per_root_area(self, size: WindowSize, rows: slice) -> FloatArray:
        if self._sums is None:
            self._sums = BlockSums(self.seen, self.windows.grid.wraps, self.seen.shape[1] - 1)
        seen = self._sums.windows(size.height, size.width, size.columns, rows)
        whole = self.windows.area[size.part][rows, None]
        return self.per_root_of(seen, whole)

    def per_root_of(self, seen: FloatArray, whole: FloatArray) -> FloatArray:
        """``1 / sqrt(A)`` of parts with a seen and a whole area, m^2; shapes that broadcast."""
        return np.asarray(1.0 / np.sqrt(self._counted.of(seen, whole)))

    @cached_property
    def per_root_ring_area(self) -> FloatArray:
        """``1 / sqrt(A)`` of each ring of cells (r,), 1/m."""
        cell = self.windows.grid.area[:, 0]
        return self.per_root_of(self.seen.sum(axis=1), self.seen.shape[1] * cell)

    @cached_property
    def root_of_least_area(self) -> FloatArray:
        """Bound of ``sqrt(A)`` of the windows of each row (k,), m: no smaller one counts.

        Of a ring of cells, a window has all but those of the other columns.
        """
        windows, (rings, columns) = self.windows, self.seen.shape
        ring, cell = self.seen.sum(axis=1), windows.grid.area[:, 0]
        least = np.zeros((len(windows.sizes), rings + 1))
        others = np.array([[columns - size.width] for size in windows.sizes]) * cell
        np.cumsum(np.maximum(ring - others, 0.0), axis=1, out=least[:, 1:])
        of_size = np.repeat(np.arange(len(least)), [size.rows for size in windows.sizes])
        seen = least[of_size, windows.end] - least[of_size, windows.begin]
        return np.sqrt((1.0 - ROUNDING) * self._counted.of(seen, windows.area))
