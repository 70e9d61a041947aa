"""Clutter behind echoes: multiple and indirect echoes, side lobes and spokes of interference.

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

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray, Rows
from tsepm_ros.tracker.clutter.density import MEMORY, ClutterMap
from tsepm_ros.tracker.clutter.polar_grid import BlockSums, Cells, PolarGrid
from tsepm_ros.tracker.clutter.windows import MAX_DEVIATIONS, poisson_bound

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
