"""Windows that are spread over a grid, so that each cell is in a few of them.

A cell whose density is not above the high bound of one window that holds it stays as it is. A few
windows show that of most cells.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from tsepm_ros.environment.polar_grid import BlockSums
from tsepm_ros.environment.window_areas import ROUNDING, Windows, WindowSize, span
from tsepm_ros.numerics.arrays import FloatArray, IntArray

PER_SIDE = 2
"""Spread windows begin this often along the side of a window."""
STEPS = 4
"""Spread windows of areas that differ by less than a factor ``2^(2 / STEPS)`` are the same."""


class SpreadWindows:
    """Spread windows of all sizes, and the blocks of cells between their edges.

    Parameters
    ----------
    windows : Windows
    least_per_root : float
        Windows of which ``1 / sqrt(A)`` is larger are left out, and the cells in any of these, 1/m.

    Attributes
    ----------
    rows : dict of WindowSize and slice
        Rows in which windows of a size begin that are not left out.
    per_root_area : (w,) ndarray
        ``1 / sqrt(A)`` of the whole area of each, 1/m.
    """

    def __init__(self, windows: Windows, least_per_root: float) -> None:
        self.rows: dict[WindowSize, slice] = {}
        self._sizes: list[WindowSize] = []
        places, blocks, cells = [np.zeros((5, 0))], [np.zeros((0, PER_SIDE**2), int)], []
        number = 0
        for size in windows.sizes:
            per_root = windows.per_root_area[size.part]
            rows = span(per_root <= least_per_root)
            if rows is None:
                continue
            self.rows[size] = rows
            row, around_row, edges = _along(rows.start, rows.stop, size.height, False)
            column, around_column, _ = _along(0, size.columns, size.width, size.wraps)
            made = np.broadcast_arrays(
                row[:, None], column, size.height, size.width, per_root[row, None]
            )
            places.append(np.stack(made).reshape(5, -1))
            block = around_row[:, None, :, None] * len(column) + around_column[None, :, None, :]
            blocks.append(number + block.reshape(-1, PER_SIDE**2))
            within = cells_within(size, rows)
            top = np.maximum(edges[:-1], within.start)
            bottom = np.minimum(edges[1:], within.stop)
            of_size = np.full(len(top), len(self._sizes))
            cells.append(np.stack([top, bottom, of_size]).repeat(len(around_column), axis=1))
            self._sizes.append(size)
            number += made[0].size
        joined = np.concatenate(places, axis=1)
        self._row, self._column, self._height, self._width = joined[:4].astype(np.int64)
        self.per_root_area = joined[4]
        top, bottom, of_size = np.concatenate(cells, axis=1) if cells else np.zeros((3, 0), int)
        some = top < bottom
        self._blocks = np.concatenate(blocks)[some]
        self._cells = np.stack([of_size, top, bottom], axis=1)[some]

    def counts(self, sums: BlockSums) -> FloatArray:
        """Counts of the windows, (w,), from those of the cells."""
        return sums.windows_at(self._height, self._width, self._row, self._column)

    def below(self, values: FloatArray, least: float) -> dict[WindowSize, slice]:
        """Where cells are in no window with a value, (w,), of at least so much.

        Returns rows of cells by size: outside of them each cell is in such a window, or in one that
        is left out.
        """
        below = (values[self._blocks].max(axis=1) < least).nonzero()[0]
        found: dict[WindowSize, slice] = {}
        for index, top, bottom in self._cells[below].tolist():
            size = self._sizes[index]
            before = found.get(size, slice(top, bottom))
            found[size] = slice(min(before.start, top), max(before.stop, bottom))
        return found


def cells_within(size: WindowSize, rows: slice) -> slice:
    """Rows of cells that are in no window of a size that begins in other rows; perhaps empty."""
    begin = rows.start + size.height - 1 if rows.start else 0
    return slice(begin, rows.stop if rows.stop < size.rows else size.rows + size.height - 1)


@lru_cache(maxsize=8)
def spread_windows(windows: Windows, step: int) -> SpreadWindows:
    """Those whose ``1 / sqrt(A)`` is at most that of a step, 1/m; see `step_of`."""
    return SpreadWindows(windows, 2.0 ** (step / STEPS))


def step_of(per_root_area: float) -> int:
    """The first step that is not below a value, 1/m."""
    return math.ceil(STEPS * math.log2(per_root_area) + ROUNDING)


def _along(first: int, stop: int, length: int, wraps: bool) -> tuple[IntArray, IntArray, IntArray]:
    """Places of windows along one side, and the blocks of cells between their edges.

    Returns the places (m,) from the first to the one before the stop, both included; which of them
    hold each block (b, `PER_SIDE`); and the edges of the blocks (b + 1,), of those of windows that
    do not wrap.
    """
    parts = min(PER_SIDE, length)
    step, last = length // parts, stop - 1 - first
    gaps = max(-(-last // step), 1)
    places = first + np.unique(np.arange(gaps + 1) * last // gaps)
    before = np.minimum(np.arange(PER_SIDE), parts - 1)
    edges = np.concatenate([places, places[-1] + step * np.arange(1, parts), [stop - 1 + length]])
    if wraps:
        around = (np.arange(len(places))[:, None] - before) % len(places)
    else:
        around = np.arange(len(edges) - 1)[:, None] - before
        around = np.minimum(np.maximum(around, 0), len(places) - 1)
    return places, around, edges
