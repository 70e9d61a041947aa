"""By how much clutter is denser than its map: lumps, places that stay, strips behind echoes.

How uncertain the clutter density is where a path has its hits: a predictive density.

The density that is learned is an estimate, and clutter is lumpier than the map resolves. Let the
true density in the neighbourhood of a path be the estimate times a factor of gamma distribution
with mean 1 and shape a. With N detections of the last scans around the j-th hit, of M that the map
expects, and with the path's own hits at least, the predictive density of the hit is ::

    lambda_hat max((a + max(N, j - 1)) / (a + M), 1)

so that the mean of a path's likelihood ratio in clutter stays at most 1, over the randomness of the
density too (the product over a path is that of the negative binomial law,
``Gamma(a + k) / (Gamma(a) b^k)``). A place that looks empty for some scans is no evidence either:
the predictive density is at least the map's. The mean density needs no such factor: it is learned
from the hits of the path too.

The variance ``v = 1 / a`` of the factor is learned from N and M at the detections of clutter, where
the factor has the shape a + 1, so that its squared coefficient of variation is v / (1 + v)::

    v / (1 + v) = (sum (N - c M)^2 / M - rho sum N / M) / (c sum N),    c = sum N / sum M

less its standard error in even clutter, with rho M the variance of N there. In even clutter v is 0,
and a is infinite. The first `RECENT` scans are not learned from: the targets in them are not
recognised yet, and look like lumps.

Clutter that stays in place: its density in square cells of the fixed frame.

A quay, a row of piles or a field of kelp has echoes at random places, ping for ping, within the
same outline. It may be thinner than any window of the clutter map, which also moves and turns with
the sensor.

Detections are counted by periods, also those of held tracks that do not move: tracks that clutter
started would otherwise hide it. Clutter differs from a target that stands still in that it lies on
both sides, more than the errors of a detection away. Let N_0 be the count in a cell, and N_1 and
N_2 those in two cells that are `DIRECTIONS` away on opposite sides, in each the largest period
counted as the second largest (a target that passes is in a single one). With n scans that saw the
cell, about, in the periods since the first detection in it, the density in a cell of side s is ::

    min(low(N_0 + N_1 + N_2) / 3, 2 N_0, 2 N_1, 2 N_2) / (n s^2)

in the direction in which it is largest, with the low bound of `adaptive_windows`. The density is
used where it is more than `RISE` times that of the map: where clutter is even it rarely is.

Cells have sides of powers of two, about two and four standard deviations of a detection. The larger
of the two densities is used.

Targets that stand still in a row, a few errors apart, look the same.

Clutter behind echoes: multiple and indirect echoes, side lobes and spokes of interference.

A strong echo comes with others at its bearing, farther away: at multiples of its range, where the
sound or the radar pulse goes to and fro more than once, and at any range, over other reflectors
(Skolnik, "Introduction to Radar Systems", 3rd ed., 2001, Chap. 7). Interference fills a bearing in
one scan. These echoes move as the bearing does, which a map of the clutter in space does not
follow. Here the density that the map expects is multiplied by two factors, both 1 where nothing
shows that clutter is denser. Both count clutter in strips of several widths in bearing. Each makes
up for the whole excess: their product is cautious, since echoes of one cause are alike from scan to
scan, which a density does not describe.

In front of a detection, in its own scan: the level u of clutter in a strip has a gamma
distribution of mean 1 and variance ``1 / k = g - 1``, with the pair correlation g: pairs of
detections in all scans over those that the map expects (Moller, Waagepetersen, "Statistical
inference and simulation for spatial point processes", 2003). With N other detections where the map
expects E, the mean of u is ``(k + N) / (k + E)``. In even clutter g = 1, and so is the factor.

Behind a held target: the detections of the last scans there, with the bound of a Poisson mean
after t of an unknown target's, over those expected, ``low(N - t) / E``.
"""

from __future__ import annotations

import math
from collections import Counter, deque
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray, Rows
from tsepm_ros.tracker.clutter.density import (
    MAX_DEVIATIONS,
    MEMORY,
    BlockSums,
    Cells,
    ClutterMap,
    PolarGrid,
    poisson_bound,
    root_bound,
)
from tsepm_ros.tracker.sensor import SensorModel, View

RECENT = 16.0
"""Time constant, in scans, of the detections that others follow: about the length of a path."""
MAX_VARIANCE = 1.0
"""v is at most this: what is more are rather targets that are not recognised yet."""
MIN_EXPECTED = 0.05
"""M with which a detection counts, at least."""
AROUND = (0, 0), (1, 0), (-1, 0), (0, 1), (0, -1)
"""Cells around a detection, its own and the four beside it, in rows and columns: a choice.

With its own alone the hits of a path hardly see each other, and a tenth of the wanted false tracks
is left in lumpy clutter; with all nine, lumps of the size of a cell remain evidence.
"""
_ROW_OFFSETS, _COLUMN_OFFSETS = np.array(AROUND).T


class PredictiveDensity(NamedTuple):
    """What makes the clutter density at a scan's detections uncertain.

    Attributes
    ----------
    shape : float
        a; inf where clutter is as even as its map.
    around : (d,) ndarray
        N, detections of clutter of the last scans around each detection.
    expected : (d,) ndarray
        M, those that the map expects.
    """

    shape: float
    around: FloatArray
    expected: FloatArray

    def increment(self, hits: IntArray, parent: IntArray, row: IntArray) -> FloatArray:
        """Score increment of each child (p,) of a path and a detection.

        Parameters
        ----------
        hits : (n,) ndarray of int
            Hits of the paths before, j - 1.
        parent, row : (p,) ndarray of int
            Path and detection of each child.
        """
        if not math.isfinite(self.shape):
            return np.zeros(len(parent))
        beyond = np.maximum(self.around[row], hits[parent]) - self.expected[row]
        return np.minimum(-np.log1p(beyond / (self.shape + self.expected[row])), 0.0)


class _Neighbours(NamedTuple):
    """Cells around detections, (n, 5) each, and whether they are cells of the map.

    Those that are not have the place of another that is.
    """

    row: IntArray
    column: IntArray
    inside: BoolArray

    def sums(self, values: FloatArray) -> FloatArray:
        """Sum of the values (r, c) of the cells around each detection, (n,)."""
        return np.asarray((values[self.row, self.column] * self.inside).sum(axis=1))


class ClutterClumps:
    """Learns by how much clutter is lumpier than its map.

    A scan counts when the next one comes: until then its detections may turn out to be targets'.

    Parameters
    ----------
    shape : tuple of int
        Cells of the map, in range and in azimuth.
    wraps : bool
        Whether the last column is next to the first.
    """

    def __init__(self, shape: tuple[int, int], wraps: bool) -> None:
        self._wraps = wraps and shape[1] > 2
        self._around = np.zeros(shape)
        # Number of scans in N, fading; the same with squared weights; none before the first scan.
        self._scans = self._squares = 0.0
        self._taken = 0
        none = np.zeros(0, np.int64)
        self._neighbours = self._neighbours_of(Cells(none, none))
        self._weight, self._near, self._expected = np.zeros((3, 0))
        # Of the detections: their number, N, M, N^2 / M, N / M, and the variance of N over M.
        self._sums = np.zeros(6)

    @property
    def variance(self) -> float:
        """Variance v of the true density over the estimate, at least 0."""
        number, around, expected, squares, ratios, noise = self._sums
        if not around or not expected:
            return 0.0
        explained = around**2 / expected
        mean = expected / number
        # Detections with the same neighbours count as one.
        error = math.sqrt(2.0 * (1.0 + 2.0 * mean) / number) * noise / expected
        share = (squares - explained - ratios) / explained - MAX_DEVIATIONS * error
        return float(min(max(share / max(1.0 - share, 1e-9), 0.0), MAX_VARIANCE))

    def update(
        self, clutter_map: ClutterMap, cells: Cells, weight: FloatArray, density: FloatArray
    ) -> PredictiveDensity:
        """Learn from the scan before, and take the next.

        Parameters
        ----------
        clutter_map : ClutterMap
            After this scan.
        cells : Cells
            Those of the detections (n,).
        weight : (n,) ndarray
            Probability that each detection is clutter.
        density : (n,) ndarray
            Clutter density at each, 1/m^2.
        """
        if self._taken:
            self._learn()
        self._taken += 1
        self._neighbours = self._neighbours_of(cells)
        self._weight, self._near = weight, self._around[cells]
        area = self._neighbours.sums(clutter_map.counted_area)
        self._expected = self._scans * density * area
        variance = self.variance
        shape = 1.0 / variance if variance else math.inf
        return PredictiveDensity(shape, self._near, self._expected)

    def withdraw(self, share: FloatArray) -> None:
        """Take back a share of each of the last scan's detections (n,): that of a target."""
        self._weight = self._weight * (1.0 - share)

    def _learn(self) -> None:
        """Learn from the last scan taken."""
        weight = self._weight
        if self._taken > RECENT:
            self._learn_scatter(weight)
        keep = 1.0 - 1.0 / RECENT
        self._scans = keep * self._scans + 1.0
        self._squares = keep**2 * self._squares + 1.0
        self._around *= keep
        row, column, inside = self._neighbours
        np.add.at(self._around, (row, column), weight[:, None] * inside)

    def _learn_scatter(self, weight: FloatArray) -> None:
        """Learn from N and M at the last scan's detections, of these weights (n,)."""
        around, expected = self._near, np.maximum(self._expected, MIN_EXPECTED)
        # Detections of clutter count in N by their age: their variance is less than their number.
        noise = self._squares / max(self._scans, 1e-9)
        self._sums *= 1.0 - 1.0 / MEMORY
        self._sums += np.array(
            [
                weight.sum(),
                around @ weight,
                expected @ weight,
                np.square(around) / expected @ weight,
                noise * (around / expected @ weight),
                noise * weight.sum(),
            ]
        )

    def _neighbours_of(self, cells: Cells) -> _Neighbours:
        rows, columns = self._around.shape
        row: IntArray = cells.row[:, None] + _ROW_OFFSETS
        column: IntArray = cells.column[:, None] + _COLUMN_OFFSETS
        if self._wraps:
            column %= columns
        place = (
            np.minimum(np.maximum(row, 0), rows - 1),
            np.minimum(np.maximum(column, 0), columns - 1),
        )
        return _Neighbours(*place, (row == place[0]) & (column == place[1]))


SIDE = 2.0
"""Sides of the smaller cells in standard deviations of a detection, about."""
LEAST_SIDE = 0.25
"""The same in m, at least."""
DIRECTIONS = (2, 0), (2, 1), (2, 2), (1, 2), (0, 2), (-1, 2), (-2, 2), (-2, 1)
"""Cells from a cell to that on one side; to that on the other side they are the same, negative."""
SCANS = 8
"""Scans of a period, at least."""
LEAST_TIME = 5.0
"""Duration of a period, s, at least: fast sonars have many pings while a target leaves a cell."""
PERIODS = 12
"""Periods that count."""
MOST_DETECTIONS = 1000
"""Detections of a period from which on no further scan is counted: bounds the time.

In dense clutter these are the first scans of the period alone.
"""
VIEWS = 16
"""Different views of a period, at most, that show which cells were seen: of more, random ones."""
RISE = 2.0
"""Factor above the map's density from which on that of a cell is used."""
_BITS = 28
"""Of the number of a cell, for its place on each axis."""
_MASK = (1 << _BITS) - 1
_LEVELS = 32
"""Added to the power of two of a side, so that it is positive."""


class CellNumbers(NamedTuple):
    """Cells of detections.

    Attributes
    ----------
    all : (n, 3) ndarray of int
        Of three sizes, the smallest first: those that the detection is counted in.
    nearest : (n, 2) ndarray of int
        Of the two sizes that fit its errors best.
    """

    all: IntArray
    nearest: IntArray


class PersistentClutter:
    """Learns from scan to scan where clutter stays.

    Parameters
    ----------
    sensor : SensorModel
        Where its sector begins, the cells do: they turn with it.
    """

    def __init__(self, sensor: SensorModel) -> None:
        turn = 0.0 if sensor.all_round else sensor.azimuth_min
        cos, sin = math.cos(turn), math.sin(turn)
        self._axes = np.array([[cos, -sin], [sin, cos]])
        self._periods: deque[_Period] = deque(maxlen=PERIODS)
        self._cells = np.zeros(0, np.int64)
        self._densities = np.zeros(0)
        self._begun, self._last = 0.0, -math.inf
        self._begin()

    def _begin(self) -> None:
        self._scans = self._number = 0
        self._taken: list[IntArray] = []
        self._views: list[View] = []

    @property
    def found(self) -> bool:
        """Whether clutter stays anywhere."""
        return len(self._cells) > 0

    def cells(self, position: FloatArray, deviation: FloatArray) -> CellNumbers:
        """Cells of detections.

        Parameters
        ----------
        position : (n, 2) ndarray
            In the fixed frame, m; within 3e7 m of its origin.
        deviation : (n,) ndarray
            Standard deviation of each along its major axis, m.
        """
        part, power = np.frexp(np.maximum(SIDE * deviation, LEAST_SIDE))
        levels = power[:, None] - np.array([1, 0, -1])
        numbers = _numbers((position @ self._axes)[:, None], levels)
        nearer = (part > math.sqrt(0.5))[:, None]
        return CellNumbers(numbers, np.where(nearer, numbers[:, 1:], numbers[:, :-1]))

    def density(self, cells: CellNumbers) -> FloatArray:
        """Density where clutter stays, 0 elsewhere, at detections, (n,), 1/m^2."""
        row, known = _found(cells.nearest, self._cells)
        density: FloatArray = np.where(known, self._densities[row], 0.0).max(axis=1)
        return density

    def update(self, stamp: float, view: View, cells: CellNumbers, moving: IntArray) -> None:
        """Take a scan's detections; they count when the period ends.

        A scan that was taken before, and is observed again, is left out.

        Parameters
        ----------
        stamp : float
            s.
        view : View
            What the scan looked at.
        cells : CellNumbers
        moving : (k,) ndarray of int
            Rows of detections that are left out, those of held tracks that move.
        """
        if stamp <= self._last:
            return
        self._last = stamp
        if self._scans >= SCANS and stamp - self._begun >= LEAST_TIME:
            self._end_period()
            self._begin()
        if not self._scans:
            self._begun = stamp
        self._scans += 1
        if self._number < MOST_DETECTIONS:
            self._number += len(cells.all)
            self._taken.append(np.delete(cells.all, moving, axis=0).ravel())
            self._views.append(view)

    def _end_period(self) -> None:
        cells, counts = np.unique(np.concatenate(self._taken), return_counts=True)
        views = self._views
        if len(set(views)) > VIEWS:
            rng = np.random.default_rng(len(views))
            views = [views[i] for i in rng.choice(len(views), VIEWS, replace=False)]
        self._periods.append(_Period(cells, counts, len(self._views), Counter(views)))
        if len(self._periods) > 1:
            self._cells, self._densities = _densities(list(self._periods), self._axes)


class _Period(NamedTuple):
    """Detections in a period.

    Attributes
    ----------
    cells : (k,) ndarray of int
        With detections, ascending.
    counts : (k,) ndarray of int
    scans : int
    views : Counter of View
        How many of the scans, or of some of them, had each view.
    """

    cells: IntArray
    counts: IntArray
    scans: int
    views: Counter[View]


def _densities(periods: list[_Period], axes: FloatArray) -> tuple[IntArray, FloatArray]:
    """Cells in which clutter stays, (k,), ascending, and its density there, 1/m^2."""
    cells, counts, first = _counted(periods)
    number = _staying(cells, counts)
    stays = np.flatnonzero(number)
    cells, number, first = cells[stays], number[stays], first[stays]
    scans = _scans_since(first, _middles(cells) @ axes.T, periods)
    use = np.flatnonzero(scans)
    return cells[use], number[use] / (scans[use] * _sides(cells[use]) ** 2)


def _counted(periods: list[_Period]) -> tuple[IntArray, FloatArray, IntArray]:
    """Cells of two periods at least, (k,), ascending, their counts over all, and first periods.

    The largest count of a cell counts as the second largest.
    """
    cells = np.concatenate([one.cells for one in periods])
    counts = np.concatenate([one.counts for one in periods]).astype(float)
    period = np.repeat(np.arange(len(periods)), [len(one.cells) for one in periods])
    order = np.argsort(cells, kind="stable")
    cells, counts = cells[order], counts[order]
    begin = np.flatnonzero(np.diff(cells, prepend=-1))  # numbers of cells are not negative
    if not len(begin):
        return cells, counts, period
    size = np.diff(np.append(begin, len(cells)))
    largest = np.repeat(np.maximum.reduceat(counts, begin), size)
    rows = np.arange(len(cells))
    omitted = np.minimum.reduceat(np.where(counts == largest, rows, len(cells)), begin)
    counts[omitted] = 0.0
    second = np.maximum.reduceat(counts, begin)
    total = np.add.reduceat(counts, begin) + second
    several = size > 1
    return cells[begin[several]], total[several], period[order[begin[several]]]


def _staying(cells: IntArray, counts: FloatArray) -> FloatArray:
    """Number of detections of clutter that stays in cells (n,), of the counts there (n,).

    0 where no two cells on opposite sides have any.
    """
    staying = np.zeros(len(cells))
    for x, y in DIRECTIONS:
        between = np.arange(len(cells))
        least, total = counts, counts
        for sign in (1, -1):
            row, known = _found(_beside(cells[between], sign * x, sign * y), cells)
            between, count = between[known], counts[row[known]]
            least, total = np.minimum(least[known], count), total[known] + count
        low = root_bound(total, -1.0) ** 2
        number = np.minimum(low / 3.0, 2.0 * least)
        staying[between] = np.maximum(staying[between], number)
    return staying


def _scans_since(first: IntArray, places: FloatArray, periods: list[_Period]) -> FloatArray:
    """Number of scans, (n,), that saw each place (n, 2), from its first period (n,) on; about."""
    # Most sensors look at the same from scan to scan.
    views = {view for one in periods for view in one.views}
    covered = {view: view.covers(places) for view in views}
    scans = np.zeros(len(places))
    for number, one in enumerate(periods):
        seen = sum((share * covered[view] for view, share in one.views.items()), np.zeros(1))
        scans += np.where(first <= number, one.scans / one.views.total() * seen, 0.0)
    return scans


def _numbers(position: FloatArray, level: IntArray) -> IntArray:
    """Numbers (...) of the cells of positions (..., 2) with sides of powers of two (...)."""
    place = np.floor(np.ldexp(position, -level[..., None])).astype(np.int64) & _MASK
    of_level = (level + _LEVELS).astype(np.int64) << 2 * _BITS
    return np.asarray(of_level | (place[..., 0] << _BITS) | place[..., 1])


def _found(numbers: IntArray, cells: IntArray) -> tuple[IntArray, BoolArray]:
    """Rows of cells (k,), ascending, with given numbers (...), and whether there is such a cell.

    Where there is none, the row has no meaning.
    """
    if not len(cells):
        return np.zeros(numbers.shape, np.int64), np.zeros(numbers.shape, bool)
    row = np.searchsorted(cells, numbers)
    row[row == len(cells)] = 0
    return row, np.asarray(cells[row] == numbers)


def _beside(cells: IntArray, x: int, y: int) -> IntArray:
    """Numbers of the cells that are some places beside others (n,)."""
    level = cells >> 2 * _BITS << 2 * _BITS
    return np.asarray(level | (((cells >> _BITS) + x) & _MASK) << _BITS | ((cells + y) & _MASK))


def _sides(cells: IntArray) -> FloatArray:
    """Sides of cells (n,), m."""
    return np.asarray(np.exp2((cells >> 2 * _BITS) - _LEVELS))


def _middles(cells: IntArray) -> FloatArray:
    """Middles of cells, (n, 2), m."""
    place = np.stack([cells >> _BITS, cells], axis=1) & _MASK
    place -= (place >> (_BITS - 1)) << _BITS  # below zero
    return np.asarray((place + 0.5) * _sides(cells)[:, None])


HALF_WIDTHS = 1, 2, 4, 8
"""Cells on either side of the middle of a strip."""
_WIDTHS = np.array(HALF_WIDTHS)[:, None]
FEW = 48
"""Detections up to which they are counted one by one, not on the grid."""
BEHIND = 3
"""Cells in range between a target and a strip behind it."""
TARGET_MEMORY = 20
"""Time constant, in scans, with which what is behind a target fades: its bearing changes."""
MAX_TARGET_COUNT = 5.0
"""Detections in a strip behind a target attributed to another: at most this, or two and one a
scan."""
MAX_PAIR_DEVIATIONS = 2.0
"""Standard deviations of a number of pairs within which clutter counts as even."""


class HeldTargets(NamedTuple):
    """Held tracks in the sensor's frame, (n,) each.

    Attributes
    ----------
    track_id : ndarray of int
    range, azimuth : ndarray
        m, rad.
    existence : ndarray
        Probability that the target exists.
    """

    track_id: IntArray
    range: FloatArray
    azimuth: FloatArray
    existence: FloatArray


@dataclass(frozen=True, eq=False)
class _Behind(Rows):
    """Clutter behind targets in each strip (n, widths, 2): behind a target, and the farther half.

    Attributes
    ----------
    scans : (n,) ndarray
    count, expected : (n, widths, 2) ndarray
    """

    scans: FloatArray
    count: FloatArray
    expected: FloatArray

    @classmethod
    def nothing(cls, number: int) -> _Behind:
        """Of targets of which nothing is known."""
        return cls(np.zeros(number), *np.zeros((2, number, len(HALF_WIDTHS), 2)))

    @cached_property
    def factor(self) -> FloatArray:
        """Factor of each strip, at least 1."""
        target = np.minimum(self.scans + 2.0, MAX_TARGET_COUNT)[:, None, None]
        low = poisson_bound(np.maximum(self.count - target, 0.0), -MAX_DEVIATIONS)
        seen = self.expected > 0.0
        return np.maximum(np.divide(low, self.expected, out=np.ones_like(low), where=seen), 1.0)


class _Strips(NamedTuple):
    """Strips behind targets (n, widths, 2).

    Attributes
    ----------
    middle : (n, 1, 1) ndarray of int
        Column of each target.
    start : (n, 1, 2) ndarray of int
        Rows at which the strips begin: behind the target, and at half the area left.
    """

    middle: IntArray
    start: IntArray

    @classmethod
    def of(cls, grid: PolarGrid, targets: HeldTargets) -> _Strips:
        """The strips behind targets."""
        row, middle = grid.cells(targets.range, targets.azimuth)
        start = np.minimum(row + BEHIND, grid.shape[0])
        starts = np.stack([start, grid.halfway(start)], axis=1)
        return cls(middle[:, None, None], starts[:, None, :])

    def hold(self, grid: PolarGrid, cells: Cells) -> BoolArray:
        """Whether each strip holds each of the cells (d,): (n, widths, 2, d)."""
        away = np.abs(cells.column - self.middle)
        if grid.wraps:
            away = np.minimum(away, grid.shape[1] - away)
        near = away <= _WIDTHS
        return np.asarray(near[:, :, None] & (cells.row >= self.start[..., None]))

    def sums(self, values: BlockSums, rows: int) -> FloatArray:
        """Sums in each strip, (n, widths, 2)."""
        to_end = values.nearer(np.array(rows), self.middle, _WIDTHS)
        return np.maximum(to_end - values.nearer(self.start, self.middle, _WIDTHS), 0.0)


def _strip_sums(values: FloatArray, grid: PolarGrid) -> BlockSums:
    """Sums over the strips of values (r, c) in the cells of a grid."""
    reach = min(max(HALF_WIDTHS), grid.shape[1]) if grid.wraps else 0
    return BlockSums(values, grid.wraps, reach, reach)


def _counted_before(grid: PolarGrid, cells: Cells, weight: FloatArray) -> FloatArray:
    """Weight (w, n) in front of each cell, in the strips of each width around its bearing."""
    away = np.abs(cells.column[:, None] - cells.column)
    if grid.wraps:
        away = np.minimum(away, grid.shape[1] - away)
    in_front = np.where(cells.row < cells.row[:, None], weight, 0.0)
    near = away <= _WIDTHS[..., None]
    return np.asarray((near * in_front).sum(axis=-1))


class SecondaryEchoes:
    """Learns how much denser clutter is behind echoes.

    Attributes
    ----------
    pair_correlation : (w,) ndarray
        Pairs of clutter detections, one behind the other, over those expected, for each width of a
        strip; 1 before the first.
    """

    def __init__(self) -> None:
        self._pairs = np.zeros(len(HALF_WIDTHS))
        self._expected_pairs = np.zeros(len(HALF_WIDTHS))
        self._track_id = np.zeros(0, np.int64)
        self._behind = _Behind.nothing(0)
        self._expected: tuple[FloatArray, BlockSums] | None = None

    @property
    def pair_correlation(self) -> FloatArray:
        """See the class."""
        known = self._expected_pairs > 0.0
        ones = np.ones(len(HALF_WIDTHS))
        return np.divide(self._pairs, self._expected_pairs, out=ones, where=known)

    def behind_targets(self, grid: PolarGrid, targets: HeldTargets, cells: Cells) -> FloatArray:
        """Factor (n,) of the map's density in cells of its grid, by held targets."""
        if not len(targets.track_id) or not len(cells.row):
            return np.ones(len(cells.row))
        behind = self._of_targets(targets)
        factor = 1.0 + targets.existence[:, None, None] * (behind.factor - 1.0)
        crowded = (factor > 1.0).any(axis=(1, 2))
        if not crowded.any():
            return np.ones(len(cells.row))
        every = _Strips.of(grid, targets)
        strips = _Strips(every.middle[crowded], every.start[crowded])
        factors = np.where(strips.hold(grid, cells), factor[crowded][..., None], 1.0)
        return np.asarray(factors.max(axis=(0, 1, 2)))

    def update(
        self, clutter_map: ClutterMap, targets: HeldTargets, cells: Cells, weight: FloatArray
    ) -> FloatArray:
        """Learn from a scan, with the map after it.

        Parameters
        ----------
        clutter_map : ClutterMap
        targets : HeldTargets
        cells : Cells
            Of the detections (n,); see `ClutterMap.update`.
        weight : (n,) ndarray

        Returns
        -------
        (n,) ndarray
            Factor of the map's density at each detection.
        """
        keep = 1.0 - 1.0 / MEMORY
        self._pairs = keep * self._pairs
        self._expected_pairs = keep * self._expected_pairs
        if not len(weight) and not len(targets.track_id):
            self._behind, self._track_id = _Behind.nothing(0), targets.track_id
            return np.ones(0)
        grid, expected = clutter_map.grid, self._expected_by(clutter_map)
        expected_before = expected.nearer(cells.row, cells.column, _WIDTHS)
        if len(weight) <= FEW:
            strips = _Strips.of(grid, targets)
            self._learn_behind(targets, strips, strips.hold(grid, cells) @ weight, expected)
            before = _counted_before(grid, cells, weight)
        else:
            counts = np.zeros(grid.shape)
            np.add.at(counts, cells, weight)
            count = _strip_sums(counts, grid)
            strips = _Strips.of(grid, targets)
            self._learn_behind(targets, strips, strips.sums(count, grid.shape[0]), expected)
            before = count.nearer(cells.row, cells.column, _WIDTHS)
        self._pairs += before @ weight
        self._expected_pairs += expected_before @ weight
        factor = self._of_pairs(before, expected_before).max(axis=0)
        return factor * self.behind_targets(grid, targets, cells)

    def _expected_by(self, clutter_map: ClutterMap) -> BlockSums:
        """Sums of the numbers that the map expects."""
        values = clutter_map.expected
        if self._expected is None or self._expected[0] is not values:
            self._expected = values, _strip_sums(values, clutter_map.grid)
        return self._expected[1]

    def _of_pairs(self, count: FloatArray, expected: FloatArray) -> FloatArray:
        """Factors (w, n), at least 1, by the detections (w, n) in front of others."""
        low = poisson_bound(np.maximum(self._pairs - 1.0, 0.0), -MAX_PAIR_DEVIATIONS)
        known = self._expected_pairs > 0.0
        correlation = np.divide(low, self._expected_pairs, out=np.ones_like(low), where=known)
        variance = np.maximum(correlation - 1.0, 0.0)[:, None]
        return np.maximum((1.0 + variance * count) / (1.0 + variance * expected), 1.0)

    def _of_targets(self, targets: HeldTargets) -> _Behind:
        """What was learned of targets."""
        track_id = targets.track_id
        if np.array_equal(track_id, self._track_id):
            return self._behind
        found = _Behind.nothing(len(track_id))
        _, new, old = np.intersect1d(track_id, self._track_id, return_indices=True)
        for name in ("scans", "count", "expected"):
            getattr(found, name)[new] = getattr(self._behind, name)[old]
        return found

    def _learn_behind(
        self, targets: HeldTargets, strips: _Strips, count: FloatArray, expected: BlockSums
    ) -> None:
        """Learn how many detections are behind each target: `count` in each strip."""
        old = self._of_targets(targets)
        self._track_id = targets.track_id
        if not len(targets.track_id):
            self._behind = old
            return
        keep = 1.0 - 1.0 / TARGET_MEMORY
        self._behind = _Behind(
            keep * old.scans + 1.0,
            keep * old.count + count,
            keep * old.expected + strips.sums(expected, expected.rows),
        )
