"""Bounds of a density by the counts of windows of several sizes, from the largest to the smallest.

With N detections of clutter in n scans of the area A of a window, its bounds of the density are
``[low(N - t), high(N)] / (n A)``, with t detections of an unknown target and the score interval of
a Poisson mean, ``N + c^2 / 2 -+ c sqrt(N + c^2 / 4) = (sqrt(N + c^2 / 4) -+ c / 2)^2``. The density
of a cell is moved into the bounds of the windows that hold it, the largest low and the largest high
of a size: size by size.

All is done with roots: the root of the density, and ``(sqrt(N + c^2 / 4) -+ c / 2) / sqrt(A)``.
Rows of windows that cannot move any cell are left out:

- A low bound moves nothing where it is below every cell's density. The count of a window is at most
  that of all columns of its rows, and that of the larger window that holds it.
- A high bound moves nothing where it is above, as that of an empty window may be. While the density
  is the same in all cells, a few windows show that of most of them, see `spread_windows`.
"""

from __future__ import annotations

import math

import numpy as np

from tsepm_ros.environment.polar_grid import BlockSums
from tsepm_ros.environment.spread_windows import cells_within, spread_windows, step_of
from tsepm_ros.environment.window_areas import ROUNDING, CountedWindows, WindowSize, span
from tsepm_ros.numerics.arrays import FloatArray

MAX_DEVIATIONS = 1.25
"""Standard deviations of a window's count within which the density stays unchanged."""


def poisson_bound(count: FloatArray, deviations: float) -> FloatArray:
    """Bound of a Poisson mean at a distance of `deviations` standard deviations from the count.

    The root of ``(N - m)^2 = c^2 m`` (Wilson's interval, for counts).
    """
    half = deviations**2 / 2.0
    bound: FloatArray = count + half + deviations * np.sqrt(count + half / 2.0)
    return bound


def bounded_root(
    counts: FloatArray, overall: float, target: float, counted: CountedWindows
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
    counted : CountedWindows
    """
    bounded = _BoundedRoot(counts, math.sqrt(overall), target, counted)
    for size in counted.windows.sizes:
        bounded.raise_by(size)
        bounded.lower_by(size)
    return bounded.root


class _BoundedRoot:
    """The root of the density in each cell, as the windows move it size by size.

    Attributes
    ----------
    root : (r, c) ndarray
    """

    def __init__(
        self, counts: FloatArray, root: float, target: float, counted: CountedWindows
    ) -> None:
        windows, columns = counted.windows, counts.shape[1]
        wraps = windows.grid.wraps
        self._counted, self._target = counted, target
        self._sums = BlockSums(counts, wraps, columns - 1 if wraps else 0)
        self.root = np.full(counts.shape, root)
        self._least = self._largest = root
        self._has_moved = False
        rings = np.zeros(len(counts) + 1)
        np.cumsum(counts.sum(axis=1), out=rings[1:])
        self._margin = ROUNDING * float(rings[-1])
        # By rows of windows: what their rings count, and the larger windows that hold them.
        self._of_rings = rings[windows.end] - rings[windows.begin] + self._margin
        self._of_larger = rings[-1:] + self._margin
        self._enough = self._enough_to_raise()
        spread = spread_windows(windows, step_of(root / MAX_DEVIATIONS))
        high = root_bound(spread.counts(self._sums), 1.0)
        high *= spread.per_root_area
        self._spread, self._above = spread, spread.below(high, root)

    def _enough_to_raise(self) -> FloatArray:
        """Counts (k,) by rows of windows up to which their low bounds are below every cell.

        ``(sqrt(A lambda) + c / 2)^2 - c^2 / 4 + t``.
        """
        enough = self._least * self._counted.root_of_least_area
        enough += 0.5 * MAX_DEVIATIONS
        enough *= (1.0 - ROUNDING) * enough
        enough += self._target - 0.25 * MAX_DEVIATIONS**2
        return enough

    def raise_by(self, size: WindowSize) -> None:
        """Raise the cells that are below the largest low bound of the windows that hold them."""
        enough = self._enough[size.part]
        larger = self._of_larger.take(np.arange(size.rows), mode="clip")
        self._of_larger = most = np.minimum(self._of_rings[size.part], larger)
        rows = span(most > enough)
        if rows is None:
            return
        count = self._sums.windows(size.height, size.width, size.columns, rows)
        most[rows] = count.max(axis=1) + self._margin
        raising = span(most[rows] > enough[rows])
        if raising is None:
            return
        low = root_bound(np.maximum(count[raising] - self._target, 0.0), -1.0)
        first = rows.start + raising.start
        low *= self._counted.per_root_area(size, slice(first, first + len(low)))
        if low.max() > self._least:
            part = self.root[first : first + len(low) + size.height - 1]
            np.maximum(part, largest_around(low, size), out=part)
            self._moved()

    def lower_by(self, size: WindowSize) -> None:
        """Lower the cells that are above all high bounds of the windows that hold them."""
        if not self._has_moved:
            rows, cells = self._spread.rows.get(size), self._above.get(size)
        else:
            per_root = self._counted.windows.per_root_area[size.part]
            rows = span(MAX_DEVIATIONS * per_root < self._largest)
            cells = cells_within(size, rows) if rows else None
        if rows is None or cells is None or cells.start >= cells.stop:
            return
        first = max(rows.start, cells.start - size.height + 1)
        rows = slice(first, min(rows.stop, cells.stop))
        high = root_bound(self._sums.windows(size.height, size.width, size.columns, rows), 1.0)
        high *= self._counted.per_root_area(size, rows)
        if high.min() < self._largest:
            part = self.root[cells]
            bound = largest_around(high, size)[cells.start - first : cells.stop - first]
            np.minimum(part, bound, out=part)
            self._moved()

    def _moved(self) -> None:
        least, self._has_moved = self._least, True
        self._least, self._largest = float(self.root.min()), float(self.root.max())
        if self._least < least:
            self._enough = self._enough_to_raise()


def root_bound(count: FloatArray, sign: float) -> FloatArray:
    """Root of the low (-1) or high (1) bound of counts: ``sqrt(N + c^2 / 4) -+ c / 2``."""
    bound = count + 0.25 * MAX_DEVIATIONS**2
    np.sqrt(bound, out=bound)
    bound += sign * 0.5 * MAX_DEVIATIONS
    return bound


def largest_around(values: FloatArray, size: WindowSize) -> FloatArray:
    """The largest value of the windows (i, j) that hold each cell of their rows.

    Returns (i + height - 1, c); one column where it is the same in all.
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
