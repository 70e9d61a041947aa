"""Bounds of a density by the counts of windows of several sizes, from the largest to the smallest.

With N detections of clutter in n scans of the area A of a window, its bounds of the density are
``[low(N - t), high(N)] / (n A)``, with t detections of an unknown target and the score interval of
a Poisson mean, ``N + c^2 / 2 -+ c sqrt(N + c^2 / 4) = (sqrt(N + c^2 / 4) -+ c / 2)^2``. The density
of a cell is moved into the bounds of the windows that hold it, the largest low and the largest high
of a size: size by size.

All is done with roots: the root of the density, and ``(sqrt(N + c^2 / 4) -+ c / 2) / sqrt(A)``.
What cannot move any cell is left out: low bounds below every cell's density, and high bounds above,
of which those of an empty window are the least.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tsepm_ros.environment.polar_grid import BlockSums, PolarGrid
from tsepm_ros.numerics.arrays import FloatArray

MIN_WINDOW_CELLS = 4
"""Cells along a side of the smallest window; each larger window is twice as wide."""
MAX_DEVIATIONS = 1.25
"""Standard deviations of a window's count within which the density stays unchanged."""


def poisson_bound(count: FloatArray, deviations: float) -> FloatArray:
    """Bound of a Poisson mean at a distance of `deviations` standard deviations from the count.

    The root of ``(N - m)^2 = c^2 m`` (Wilson's interval, for counts).
    """
    half = deviations**2 / 2.0
    bound: FloatArray = count + half + deviations * np.sqrt(count + half / 2.0)
    return bound


@dataclass(frozen=True, eq=False)
class WindowSize:
    """Windows of one size.

    Attributes
    ----------
    height, width : int
        Cells.
    wraps : bool
        Whether they wrap around in azimuth.
    per_root_area : (i, j) ndarray
        ``1 / sqrt(A)`` of the windows that begin in each row and column, 1/m; of one column where
        it is the same in all.
    least_per_row : (i,) ndarray
        The least of each row.
    """

    height: int
    width: int
    wraps: bool
    per_root_area: FloatArray
    least_per_row: FloatArray

    @property
    def starts(self) -> tuple[int, int]:
        """Rows in which windows begin, and columns of `per_root_area`."""
        rows, columns = self.per_root_area.shape
        return rows, columns


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

        Shapes that broadcast.
        """
        if not self.widening:
            return np.asarray(whole)
        return np.minimum(np.maximum(self.widening * seen, self.min_share * whole), whole)


def sides(grid: PolarGrid) -> list[tuple[int, int]]:
    """Height and width of the windows of each size, the largest first, cells."""
    rows, columns = grid.shape
    doublings = max(math.ceil(math.log2(max(rows, columns) / MIN_WINDOW_CELLS)), 0)
    all_sides = [MIN_WINDOW_CELLS * 2**doubling for doubling in reversed(range(doublings + 1))]
    return [(min(side, rows), min(side, columns)) for side in all_sides]


def window_sizes(grid: PolarGrid, seen: FloatArray, counted: CountedArea) -> list[WindowSize]:
    """The sizes of windows on a grid.

    Parameters
    ----------
    grid : PolarGrid
    seen : (r, c) ndarray
        Area of each cell in which clutter is seen, m^2.
    counted : CountedArea
    """
    columns = grid.shape[1]
    sums = BlockSums(seen, grid.wraps, columns - 1)
    sizes = []
    for height, width in sides(grid):
        wraps = grid.wraps and width < columns
        whole = 0.5 * grid.width * (grid.edges[height:] ** 2 - grid.edges[:-height] ** 2)
        starts = columns if wraps else columns - width + 1
        area = counted.of(sums.windows(height, width, starts), width * whole[:, None])
        if (area == area[:, :1]).all():
            area = area[:, :1]
        per_root = 1.0 / np.sqrt(area)
        sizes.append(WindowSize(height, width, wraps, per_root, per_root.min(axis=1)))
    return sizes


def bounded_root(
    counts: FloatArray, overall: float, target: float, sizes: list[WindowSize], wraps: bool
) -> FloatArray:
    """Root of the density times the number of scans in each cell, (r, c), 1/m.

    Parameters
    ----------
    counts : (r, c) ndarray
        Detections of clutter in each cell in all scans.
    overall : float
        The density times the number of scans where no window moves it, 1/m^2.
    target : float
        t.
    sizes : list of WindowSize
        The largest first.
    wraps : bool
        Whether the last column is next to the first.
    """
    columns = counts.shape[1]
    root = np.full(counts.shape, math.sqrt(overall))
    sums = BlockSums(counts, wraps, columns - 1 if wraps else 0)
    most = math.inf
    for size in sizes:
        least, largest = float(root.min()), float(root.max())
        # The high bound of an empty window is the least: where that is above, none is below.
        rows = np.flatnonzero(MAX_DEVIATIONS * size.least_per_row < largest)
        if not len(rows) and most <= target:
            continue
        starts = columns if size.wraps else columns - size.width + 1
        count = sums.windows(size.height, size.width, starts)
        most = float(count.max())
        if most > target:
            low = _root_bound(np.maximum(count - target, 0.0), -1.0) * size.per_root_area
            raised = np.flatnonzero(low.max(axis=1) > least)
            if len(raised):
                first, last = int(raised[0]), int(raised[-1])
                part = root[first : last + size.height]
                np.maximum(part, _largest_around(low[first : last + 1], size), out=part)
                largest = float(root.max())
                rows = np.flatnonzero(MAX_DEVIATIONS * size.least_per_row < largest)
        if len(rows):
            first, last = int(rows[0]), int(rows[-1])
            high = _root_bound(count[first : last + 1], 1.0)
            high *= size.per_root_area[first : last + 1]
            if high.min() < largest:
                _lower(root, high, first, size)
    return root


def _root_bound(count: FloatArray, sign: float) -> FloatArray:
    """Root of the low (-1) or high (1) bound of counts: ``sqrt(N + c^2 / 4) -+ c / 2``."""
    bound = count + 0.25 * MAX_DEVIATIONS**2
    np.sqrt(bound, out=bound)
    bound += sign * 0.5 * MAX_DEVIATIONS
    return bound


def _lower(root: FloatArray, high: FloatArray, first: int, size: WindowSize) -> None:
    """Lower the cells that are above all high bounds of the windows that hold them.

    `high` has the windows that begin from the row `first` on; those that are not in it are above.
    """
    last = first + len(high) - 1
    begin = first + size.height - 1 if first else 0
    end = last + 1 if last + 1 < size.starts[0] else len(root)
    if begin < end:
        part = root[begin:end]
        bound = _largest_around(high, size)[begin - first : end - first]
        np.minimum(part, bound, out=part)


def _largest_around(values: FloatArray, size: WindowSize) -> FloatArray:
    """The largest value of the windows (i, j) that hold each cell of their rows.

    Returns (i + height - 1, c); one row or column where it is the same in all.
    """
    across = values
    if size.wraps:
        across = np.concatenate([values[:, 1 - size.width :], values], axis=1)
        across = _running_maximum(across, size.width)
    elif values.shape[1] > 1:
        across = _running_maximum(_padded(values.T, size.width).T, size.width)
    if len(values) == 1:
        return across.repeat(size.height, axis=0)
    return _running_maximum(_padded(across, size.height).T, size.height).T


def _padded(values: FloatArray, length: int) -> FloatArray:
    """Values with rows before and after them that never are the largest."""
    number, columns = values.shape
    padded = np.full((number + 2 * (length - 1), columns), -np.inf)
    padded[length - 1 : length - 1 + number] = values
    return padded


def _running_maximum(values: FloatArray, length: int) -> FloatArray:
    """Largest of each run of `length` columns: runs twice as long from two runs."""
    rows, columns = values.shape
    if rows > 1 and values.flags.c_contiguous:
        # As a single row, which is faster; runs over the end of a row are left out.
        runs = _running_maximum(values.reshape(1, -1), length)[0]
        shape, item = (rows, columns - length + 1), runs.itemsize
        return np.ndarray(shape, runs.dtype, runs, strides=(columns * item, item))
    size = 1
    while size < length:
        step = min(size, length - size)
        values = np.maximum(values[:, :-step], values[:, step:])
        size += step
    return values
