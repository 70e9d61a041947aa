"""Clutter density, estimated in windows of several sizes and learned from scan to scan.

Detections are counted on a polar grid, as in Environment 2018's clutter zones; its rings widen with
range, as the errors of a sonar do. From coarse to fine, the density of a cell changes only as far
as the counts of the windows around it require (Lepski, "On a problem of adaptive estimation in
Gaussian white noise", Theory Probab. Appl. 35(3), 1991). For each size, the densest
window that holds the cell counts, as in a greatest-of CFAR (Hansen, "Constant false alarm rate
processing in search radars", IEE Radar, 1973). At the edge of clutter, a window across the edge
biases the density low exactly at the detections, which raises the scores of false tracks.

Cells of a polar grid whose rings widen with range, and sums over blocks of them.

Windows of cells over which a density is bounded: squares of several sizes, and rings.

Windows of several sizes on a polar grid, and the area of each in which clutter is seen.

Windows that are spread over a grid, so that each cell is in a few of them.

A cell whose density is not above the high bound of one window that holds it stays as it is. A few
windows show that of most cells.

Bounds of a density by the counts of windows of several sizes, from the largest to the smallest.

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

Raises the density on rings of cells, where no square window contains the clutter alone.

Reverberation of the sea floor, of a layer or of side lobes lies on rings that are thinner than any
window. Each ring of cells has bounds like those of `adaptive_windows`, of the whole ring and then
of ever shorter arcs of it, so that a zone of clutter raises no other part of its rings. The density
of a cell is the larger one of both.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray
from tsepm_ros.tracker.clutter.seen_extent import Extent, Region
from tsepm_ros.tracker.sensor import MIN_CLUTTER_DENSITY, SensorModel

CELL = 1.0 / 24.0
"""Width of a cell, rad, and its depth as a fraction of its range."""
INNER_RANGE = 100.0
"""Range within which all rings have one depth, m."""
INNER_RINGS = 12
"""Their number from the sensor on: twice the depth of the first ring beyond."""


class Cells(NamedTuple):
    """Cells of positions, (n,) each.

    Attributes
    ----------
    row, column : ndarray of int
        By range, and by azimuth.
    """

    row: IntArray
    column: IntArray


class PolarGrid:
    """Cells over the coverage of a sensor.

    Parameters
    ----------
    sensor : SensorModel

    Attributes
    ----------
    edges : (r + 1,) ndarray
        Ranges between the rings, m.
    width : float
        Of a cell, rad.
    shape : tuple of int
        Number of cells in range and in azimuth.
    wraps : bool
        Whether the last column is next to the first.
    """

    def __init__(self, sensor: SensorModel) -> None:
        columns = max(round(sensor.sector_width / CELL), 1)
        self.width = sensor.sector_width / columns
        self._start = -np.pi if sensor.all_round else sensor.azimuth_min
        inner = max(sensor.min_range, min(INNER_RANGE, sensor.max_range / 10.0))
        rings = math.ceil(math.log(sensor.max_range / inner) / CELL)
        edges = np.geomspace(inner, sensor.max_range, rings + 1)
        near = math.ceil(INNER_RINGS * (1.0 - sensor.min_range / inner))
        self.edges = np.append(np.linspace(sensor.min_range, inner, near, endpoint=False), edges)
        self.shape = len(self.edges) - 1, columns
        self.wraps = sensor.all_round

    def cells(self, range: FloatArray, azimuth: FloatArray) -> Cells:
        """Cells of positions (n,) in the sensor's frame: outside the coverage the nearest ones.

        Parameters
        ----------
        range, azimuth : (n,) ndarray
            m, rad.
        """
        rows, columns = self.shape
        row = np.searchsorted(self.edges, range, side="right") - 1
        row = np.minimum(np.maximum(row, 0), rows - 1)
        from_start = np.remainder(azimuth - self._start, 2.0 * np.pi)
        column = np.minimum((from_start / self.width).astype(np.int64), columns - 1)
        return Cells(row, column)

    def divided(self, cells: Cells, range: FloatArray, parts: int) -> Cells:
        """Cells of ranges (n,) where each row is divided into parts of equal depth."""
        near, far = self.edges[cells.row], self.edges[cells.row + 1]
        part = (parts * (range - near) / (far - near)).astype(np.int64)
        return Cells(parts * cells.row + np.minimum(np.maximum(part, 0), parts - 1), cells.column)

    @property
    def area(self) -> FloatArray:
        """Area of a cell of each ring, (r, 1), m^2."""
        return np.asarray(0.5 * self.width * np.diff(self.edges**2)[:, None])

    @property
    def middles(self) -> tuple[FloatArray, FloatArray]:
        """Range and azimuth of the middle of each cell, (r, 1) and (1, c)."""
        square = 0.5 * (self.edges[1:] ** 2 + self.edges[:-1] ** 2)
        azimuth = self._start + self.width * (np.arange(self.shape[1]) + 0.5)
        return np.asarray(np.sqrt(square), float)[:, None], np.asarray(azimuth, float)[None, :]

    def halfway(self, row: IntArray) -> IntArray:
        """Rows (n,) from which on half of the area is that from the given rows on."""
        square = 0.5 * (self.edges[row] ** 2 + self.edges[-1] ** 2)
        return np.asarray(np.searchsorted(self.edges, np.sqrt(square)))


class BlockSums:
    """Sums over blocks of cells: each costs four values, whatever its size.

    Parameters
    ----------
    values : (r, c) ndarray
        Not negative.
    wraps : bool
        Whether the last column is next to the first.
    margin : int
        Columns by which blocks may reach beyond the last column, and, `before`, the first; there
        the values wrap around, or are 0.
    """

    def __init__(self, values: FloatArray, wraps: bool, margin: int, before: int = 0) -> None:
        rows, columns = values.shape
        sums = np.zeros((rows + 1, before + columns + margin + 1))
        inner = sums[1:, before + 1 : before + 1 + columns]
        np.cumsum(values, axis=0, out=inner)
        if wraps:
            sums[1:, 1 : before + 1] = inner[:, columns - before :]
            sums[1:, before + 1 + columns :] = inner[:, :margin]
        self._sums = np.cumsum(sums, axis=1, out=sums)
        self._before = before

    @property
    def rows(self) -> int:
        """Rows of cells."""
        return len(self._sums) - 1

    def windows(self, height: int, width: int, number: int, rows: slice) -> FloatArray:
        """Sums of the windows of a size that begin in rows (i), and in the first columns.

        Parameters
        ----------
        height, width : int
            Cells.
        number : int
            Columns in which windows begin.
        rows : slice

        Returns
        -------
        (i, number) ndarray
        """
        begin = self._before
        rings = self._sums[rows.start : rows.stop + height]
        strips = rings[:, begin + width :][:, :number] - rings[:, begin:][:, :number]
        sums = strips[height:] - strips[:-height]
        return np.maximum(sums, 0.0, out=sums)  # rounding errors

    def windows_at(self, height: int, width: int, row: IntArray, column: IntArray) -> FloatArray:
        """Sums of the windows of a size that begin in given cells, (...).

        Parameters
        ----------
        height, width : int
            Cells.
        row, column : (...) ndarray of int
            Shapes that broadcast.
        """
        left = self._before + column
        right, end = left + width, row + height
        sums = self._sums[end, right] - self._sums[end, left]
        sums -= self._sums[row, right] - self._sums[row, left]
        return np.maximum(sums, 0.0, out=sums)  # rounding errors

    def nearer(self, row: IntArray, middle: IntArray, half_width: IntArray) -> FloatArray:
        """Sums of the cells in rows below `row`, in the columns around a middle.

        Parameters
        ----------
        row, middle, half_width : (...) ndarray of int
            Shapes that broadcast.
        """
        last = self._sums.shape[1] - 1
        right = np.minimum(self._before + middle + half_width + 1, last)
        left = np.maximum(self._before + middle - half_width, 0)
        return np.maximum(self._sums[row, right] - self._sums[row, left], 0.0)


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


ARCS = 2, 4, 8
"""Parts of a ring that its arcs are."""
LEAST_RISE = 1.1
"""Factor, at least, by which a ring's root is above that of its thinnest cell: less is no harm."""


def raise_rings(
    root: FloatArray, counts: FloatArray, target: float, counted: CountedWindows
) -> None:
    """Raise the roots of the density of cells on dense rings.

    Parameters
    ----------
    root : (r, c) ndarray
        Root of the density times the number of scans in each cell, 1/m; changed in place.
    counts : (r, c) ndarray
        Detections of clutter in each cell in all scans.
    target : float
        Detections of an unknown target.
    counted : CountedWindows
    """
    low = root_bound(np.maximum(counts.sum(axis=1) - target, 0.0), -1.0)
    low *= counted.per_root_ring_area
    rings = np.flatnonzero(low > LEAST_RISE * root.min(axis=1))
    if not len(rings):
        return
    raised = np.repeat(low[rings, None], root.shape[1], axis=1)
    sums, areas = (BlockSums(part[rings], *_wrapping(counted)) for part in (counts, counted.seen))
    for size in _arcs(rings, counted):
        count = sums.windows(1, size.width, size.columns, slice(0, len(rings)))
        seen = areas.windows(1, size.width, size.columns, slice(0, len(rings)))
        per_root = counted.per_root_of(seen, size.width * counted.windows.grid.area[rings])
        bounds = root_bound(np.maximum(count - target, 0.0), -1.0), root_bound(count, 1.0)
        least, most = (largest_around(bound * per_root, size) for bound in bounds)
        raised = np.minimum(np.maximum(raised, least), most)
    root[rings] = np.maximum(root[rings], raised)


def _wrapping(counted: CountedWindows) -> tuple[bool, int]:
    """Whether rings are closed, and the columns by which arcs may reach beyond the last."""
    grid = counted.windows.grid
    return grid.wraps, grid.shape[1] - 1 if grid.wraps else 0


def _arcs(rings: IntArray, counted: CountedWindows) -> list[WindowSize]:
    """Arcs of the rings, the longest first."""
    grid, rows = counted.windows.grid, len(rings)
    columns = grid.shape[1]
    arcs = []
    for parts in ARCS:
        width = columns // parts
        if width >= 1:
            starts = columns if grid.wraps else columns - width + 1
            arcs.append(WindowSize(1, width, grid.wraps, rows, starts, slice(0, rows)))
    return arcs


MEMORY = 50
"""Time constant, in scans, with which older scans fade."""
DATA_SHEET_COUNT = 0.5
"""Weight of the data sheet's density, as a number of detections: it may be anybody's guess."""
MIN_SEEN_SHARE = 0.1
"""Share of a window that counts as seen at least."""
ZONE_FACTOR = 3.0
"""Ratio of the density in a clutter zone to its mean over the coverage."""
MAX_TARGET_COUNT = 8.0
"""Detections in a window attributed to new targets: at most this, or two and one a scan."""
RENEWAL = 0.1
"""Share of new scans, or of new detections, from which on the density is estimated anew."""


class _SeenCells:
    """The area of each cell in which clutter is seen.

    Where clutter is seen in less than the area of one target, its parts count as larger.

    Parameters
    ----------
    windows : Windows
    region : Region
        Where clutter is seen.
    area : float
        Area of that region, or of one target if larger, m^2.

    Attributes
    ----------
    region, area
        As given.
    seen : (r, c) ndarray
        m^2.
    counted : (r, c) ndarray
        Area in which clutter is expected, m^2.
    windows : CountedWindows
    """

    def __init__(self, windows: Windows, region: Region, area: float) -> None:
        self.region, self.area = region, area
        grid = windows.grid
        self.seen = grid.area * region.contains(*grid.middles)
        widening = max(area / region.area, 1.0) if region.area else 0.0
        counted = CountedArea(widening, MIN_SEEN_SHARE)
        self.counted = np.broadcast_to(counted.of(self.seen, grid.area), grid.shape)
        self.windows = CountedWindows(windows, self.seen, counted)


class _Estimate:
    """The density by the counts of some scans, computed where it is asked for.

    Parameters
    ----------
    counts : (r, c) ndarray
    scans : float
    cells : _SeenCells
    prior : float
        Density of the data sheet, 1/m^2.

    Attributes
    ----------
    number : float
        Mean number of detections in a scan.
    """

    def __init__(self, counts: FloatArray, scans: float, cells: _SeenCells, prior: float) -> None:
        self._counts, self._scans, self._cells, self._prior = counts, scans, cells, prior
        self.number = (DATA_SHEET_COUNT + float(counts.sum())) / (DATA_SHEET_COUNT + scans)

    @cached_property
    def density(self) -> FloatArray:
        """Density of each cell, (r, c), 1/m^2."""
        weight, counts, scans = DATA_SHEET_COUNT, self._counts, self._scans
        overall = (weight + counts.sum()) / (weight / self._prior + scans * self._cells.area)
        if not scans:
            return np.full(counts.shape, overall)
        target, windows = min(scans + 2.0, MAX_TARGET_COUNT), self._cells.windows
        root = bounded_root(counts, scans * overall, target, windows)
        raise_rings(root, counts, target, windows)
        np.multiply(root, root, out=root)
        root /= scans
        return np.maximum(root, MIN_CLUTTER_DENSITY, out=root)

    @cached_property
    def mean(self) -> float:
        """Mean density where clutter is seen, 1/m^2."""
        total = float(self._cells.seen.sum())
        if not total:
            return float(self.density.mean())
        return float((self.density * self._cells.seen).sum()) / total

    @cached_property
    def expected(self) -> FloatArray:
        """Number of clutter detections expected in each cell in a scan, (r, c)."""
        return np.asarray(self.density * self._cells.counted)


class ClutterMap:
    """Estimates the clutter density over the coverage.

    The estimate begins with the mean density, ``(w + N) / (w / lambda_0 + n A)`` for N detections
    of clutter in n scans (both fading), the area A in which clutter is seen, and the data sheet's
    lambda_0 with the weight of w detections.
    Each size of window then bounds it, see `adaptive_windows`; dense rings raise it, see
    `ring_windows`. The density is estimated anew when a tenth of the remembered scans or of their
    detections is new; in between, all figures are those of the last estimate. A scan of so many
    detections that its own bound exceeds their mean number raises the density everywhere, as long
    as such scans last.

    Parameters
    ----------
    sensor : SensorModel
        Coverage, and initial density.

    Attributes
    ----------
    grid : PolarGrid
        Its cells.
    """

    def __init__(self, sensor: SensorModel) -> None:
        self._sensor = sensor
        self.grid = PolarGrid(sensor)
        self._windows = Windows(self.grid)
        self._cells = _SeenCells(
            self._windows, Region.whole(Extent.of(sensor)), sensor.coverage_area
        )
        self._counts = np.zeros(self.grid.shape)
        self._scans = 0.0
        self._new_scans, self._new = 0, 0.0
        self._level = 1.0
        self._estimate = self._estimated()

    def fits(self, sensor: SensorModel) -> bool:
        """Whether the map has a sensor's coverage and initial density."""
        names = ("min_range", "max_range", "azimuth_min", "azimuth_max", "clutter_density")
        return all(getattr(sensor, name) == getattr(self._sensor, name) for name in names)

    def at(self, cells: Cells) -> FloatArray:
        """Density in cells (n,), 1/m^2; see `PolarGrid.cells`."""
        return np.asarray(self._level * self._estimate.density[cells])

    @property
    def mean(self) -> float:
        """Mean density where clutter is seen, 1/m^2."""
        return self._level * self._estimate.mean

    @property
    def seen(self) -> Region:
        """Where clutter is seen, as of the last estimate."""
        return self._cells.region

    @property
    def area(self) -> float:
        """Area in which clutter is seen, m^2."""
        return self._cells.area

    @property
    def counted_area(self) -> FloatArray:
        """Area in each cell in which clutter is expected, (r, c), m^2."""
        return self._cells.counted

    @property
    def expected(self) -> FloatArray:
        """Number of clutter detections expected in each cell in a scan, (r, c)."""
        expected = self._estimate.expected
        return expected if self._level == 1.0 else self._level * expected

    def in_zone(self, cells: Cells) -> NDArray[np.bool_]:
        """Whether cells (n,) are in a clutter zone (Environment 2018, Section 2.1).

        A reading: the source counts plots per cell; in a zone, the counts of a cell and its
        neighbours exceed thresholds. It gives no thresholds, cells or number of scans, and a count
        grows with the cell's area and with the scans. Here the density, which `at` smooths over the
        neighbours, is more than `ZONE_FACTOR` times its mean.
        """
        return np.asarray(self.at(cells) > ZONE_FACTOR * self.mean)

    def update(
        self,
        cells: Cells,
        weight: FloatArray,
        seen: Callable[[], Region] | None = None,
        min_area: float = 0.0,
    ) -> None:
        """Update the map with a scan's detections.

        Parameters
        ----------
        cells : Cells
            Those of the detections (n,).
        weight : (n,) ndarray
            Probability that each detection is clutter.
        seen : callable, optional
            Where clutter is seen, asked for when the density is estimated anew; by default where
            it was, at first in the whole coverage.
        min_area : float, optional
            Area in which one target may have been seen, m^2: clutter is assumed in no smaller one.
        """
        keep, number = 1.0 - 1.0 / MEMORY, float(weight.sum())
        self._scans = keep * self._scans + 1.0
        self._counts *= keep
        np.add.at(self._counts, cells, weight)
        self._new_scans, self._new = self._new_scans + 1, self._new + number
        enough = RENEWAL * self._scans, RENEWAL * float(self._counts.sum())
        has_enough = self._new_scans > enough[0] or self._new > enough[1]
        if has_enough or self._area_of(self.seen, min_area) != self.area:
            self._renew(seen() if seen else self.seen, min_area)
        self._level = self._level_of(number)

    def _area_of(self, seen: Region, min_area: float) -> float:
        """Area that counts as that in which clutter is seen, m^2."""
        return min(max(seen.area, min_area), self._sensor.coverage_area)

    def _renew(self, seen: Region, min_area: float = 0.0) -> None:
        """Estimate the density anew."""
        area = self._area_of(seen, min_area)
        if seen is not self.seen or area != self.area:
            self._cells = _SeenCells(self._windows, seen, area)
        self._new_scans, self._new = 0, 0.0
        self._estimate = self._estimated()

    def _estimated(self) -> _Estimate:
        """The estimate by the present counts."""
        prior = max(self._sensor.clutter_density, MIN_CLUTTER_DENSITY)
        return _Estimate(self._counts.copy(), self._scans, self._cells, prior)

    def _level_of(self, number: float) -> float:
        """Factor by which clutter is denser in a scan of N detections than on average, at least 1.

        The bound of the scan's own mean count, ``low(N - 1)``, over the mean count of the scans
        that the density is estimated from: a squall, or a gain that was raised, shows at once.
        """
        low = poisson_bound(np.array(max(number - 1.0, 0.0)), -MAX_DEVIATIONS)
        return max(float(low) / self._estimate.number, 1.0)

    @property
    def begun(self) -> bool:
        """Whether a scan was learned from."""
        return self._scans > 0.0

    @property
    def memory(self) -> tuple[FloatArray, float]:
        """Counts by ring and column, and the number of scans; both fading."""
        return self._counts.copy(), self._scans

    def remember(self, counts: FloatArray, scans: float, seen: Region) -> None:
        """Begin with the memory of another map of the same cells, and where clutter was seen."""
        self._counts, self._scans = counts.copy(), scans
        self._renew(seen)

    def withdraw(self, cells: Cells, weight: FloatArray) -> None:
        """Remove weight of the last scan's detections, with effect from the next estimate on."""
        np.subtract.at(self._counts, cells, weight)
        self._counts[cells] = np.maximum(self._counts[cells], 0.0)
