# Copyright 2026 tsepm_ros developers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.
"""By how much clutter is denser than expected: a counter, and places that it counts at.

`Excess` is a pair of numbers: detections of clutter that were counted, N, and those that were
expected, E. The bounds of the ratio are those of a Poisson mean, ``low(N - t) / E`` and ``high(N) /
E``, with the score interval ``N + c^2 / 2 -+ c sqrt(N + c^2 / 4)`` and t detections of an unknown
target. Its mean is ``(a + N) / (a + E)`` where the ratio has a gamma distribution of mean 1 and
variance 1 / a. The clutter map bounds its density so in windows of polar cells. Here are the other
places: around the hits of a path, and strips behind echoes; cells of the fixed frame are in
`fixed_places`.

Around the hits of a path: the density that is learned is an estimate, and clutter is lumpier than
the map resolves. Let the true density in the neighbourhood of a path be the estimate times a factor
of gamma distribution with mean 1 and shape a. With N detections of the last scans around the j-th
hit, of M that the map expects, and with the path's own hits at least, the predictive density of the
hit is ::

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
and a is infinite. The first `PATH_SCANS` scans are not learned from: the targets in them are not
recognised yet, and look like lumps.

Strips behind echoes: a strong echo comes with others at its bearing, farther away: at multiples of
its range, where the sound or the radar pulse goes to and fro more than once, and at any range, over
other reflectors (Skolnik, "Introduction to Radar Systems", 3rd ed., 2001, Chap. 7). Interference
fills a bearing in one scan. These echoes move as the bearing does, which a map of the clutter in
space does not follow. The density of the map is multiplied by two factors, both 1 where nothing
shows that clutter is denser. Both count clutter in strips of several widths in bearing. Each makes
up for the whole excess: their product is cautious, since echoes of one cause are alike from scan to
scan, which a density does not describe.

- In front of a detection, in its own scan: the level of clutter in a strip has a gamma distribution
  of mean 1 and variance ``g - 1``, with the pair correlation g: pairs of detections in all scans
  over those that the map expects (Moller, Waagepetersen, "Statistical inference and simulation for
  spatial point processes", 2003). The factor is the mean of the level by the other detections. In
  even clutter g = 1, and so is the factor.
- Behind a confirmed target: the lower bound by the detections of the last scans there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray
from tsepm_ros.tracker.polar_grid import (
    CHANCE_DEVIATIONS,
    MAX_DEVIATIONS,
    MEMORY_SCANS,
    BlockSums,
    Cells,
    PolarGrid,
    ScanBatch,
)

PATH_SCANS = 16
"""Scans whose detections others follow in a path: its length, about."""
MAX_VARIANCE = 1.0
"""v is at most this: what is more are rather targets that are not recognised yet."""
MIN_EXPECTED = 0.05
"""M with which a detection counts, at least."""
ROW_OFFSETS, COLUMN_OFFSETS = np.array([(0, 0), (1, 0), (-1, 0), (0, 1), (0, -1)]).T
"""Cells around a detection, its own and the four beside it, in rows and columns: a choice.

With its own alone the hits of a path hardly see each other, and a tenth of the wanted false tracks
is left in lumpy clutter; with all nine, lumps of the size of a cell remain evidence.
"""
HALF_WIDTHS = np.array([[1], [2], [4], [8]])
"""Cells on either side of the middle of a strip."""
MAX_COUNTED_SINGLY = 48
"""Detections up to which they are counted one by one, not on the grid: in a third of the time."""
CELLS_BEHIND_TARGET = 3
"""Cells in range between a target and a strip behind it."""
TARGET_MEMORY = 20.0
"""Time constant, in scans, with which what is behind a target fades: its bearing changes."""
MAX_TARGET_COUNT = 5.0
"""Detections in a strip behind a target attributed to another: at most this, or two and one a
scan."""


@dataclass(frozen=True, eq=False)
class Excess:
    """Detections of clutter that were counted, and those that were expected there.

    Attributes
    ----------
    counted, expected : ndarray
        N and E, shapes that broadcast. With E as an area times a number of scans, the ratio is a
        density.
    """

    counted: FloatArray
    expected: FloatArray

    def faded(self, keep: float, counted: FloatArray, expected: FloatArray) -> Excess:
        """The part `keep` of these numbers, and those of newer scans."""
        return Excess(keep * self.counted + counted, keep * self.expected + expected)

    def lower(
        self, target: FloatArray | float = 0.0, deviations: float = MAX_DEVIATIONS
    ) -> FloatArray:
        """Lower bound of the ratio, with t detections of an unknown target; 0 without E."""
        return self._ratio(poisson_bound(np.maximum(self.counted - target, 0.0), -deviations), 0.0)

    def upper(self) -> FloatArray:
        """Upper bound of the ratio; infinite without E."""
        return self._ratio(poisson_bound(self.counted, MAX_DEVIATIONS), math.inf)

    def _ratio(self, bound: FloatArray, unknown: float) -> FloatArray:
        result = np.full_like(bound, unknown)
        return np.divide(bound, self.expected, out=result, where=self.expected > 0.0)

    def mean(self, variance: FloatArray | float) -> FloatArray:
        """Mean of the ratio, which has a gamma distribution of mean 1 and this variance."""
        return np.asarray((1.0 + variance * self.counted) / (1.0 + variance * self.expected))


def poisson_bound(count: FloatArray, deviations: float) -> FloatArray:
    """Bound of a Poisson mean at a distance of `deviations` standard deviations from the count.

    The root of ``(N - m)^2 = c^2 m`` (Wilson's interval, for counts).
    """
    half = deviations**2 / 2.0
    return np.asarray(count + half + deviations * np.sqrt(count + half / 2.0))


class DensityDoubt(NamedTuple):
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
        if math.isinf(self.shape):
            return np.zeros(len(parent))
        excess = Excess(np.maximum(self.around[row], hits[parent]), self.expected[row])
        return np.minimum(-np.log(excess.mean(1.0 / self.shape)), 0.0)


class Overdispersion:
    """Learns by how much clutter is lumpier than its map.

    A batch of scans counts when the next one comes: until then its detections may turn out to be
    targets'.

    Parameters
    ----------
    grid : PolarGrid
    """

    def __init__(self, grid: PolarGrid) -> None:
        self._grid = grid
        self._around = np.zeros(grid.shape)
        # Number of scans in N, by columns, fading; the same with squared weights; and all.
        self._scans, self._squares, self._number = np.zeros(grid.shape[1]), 0.0, 0.0
        # Of the batch before: cells, weights, N and M there, and looks.
        self._last: tuple[Cells, list[FloatArray], Excess, FloatArray] | None = None
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

    def around(self, cells: Cells, density: FloatArray, area: FloatArray) -> Excess:
        """N and M at detections (n,) with these clutter densities, by the batches before.

        Parameters
        ----------
        cells : Cells
        density : (n,) ndarray
            1/m^2.
        area : (r, c) ndarray
            Area in each cell in which clutter is expected, m^2.
        """
        row, column, inside = self._neighbours(cells)
        expected = density * (area[row, column] * self._scans[column] * inside).sum(axis=1)
        return Excess(self._around[cells], expected)

    def predictive(self, cells: Cells, density: FloatArray, area: FloatArray) -> DensityDoubt:
        """What makes the density at detections (n,) uncertain; see `around`."""
        variance = self.variance
        if not variance:
            return DensityDoubt(math.inf, *np.zeros((2, len(density))))
        around = self.around(cells, density, area)
        return DensityDoubt(1.0 / variance, around.counted, around.expected)

    def update(self, batch: ScanBatch, area: FloatArray) -> None:
        """Learn from the batch before, and take the next; for the area see `around`."""
        if self._last is not None:
            self._learn(*self._last)
        cells, *_ = batch.joined
        around = self.around(cells, np.concatenate(batch.densities), area)
        self._last = cells, [*batch.weights], around, batch.looks

    def withdraw(self, weight: FloatArray) -> None:
        """Take back weight (d,) of the detections of the last batch's last scan."""
        if self._last is not None:
            weights = self._last[1]
            weights[-1] = weights[-1] - weight

    def _learn(
        self, cells: Cells, weights: list[FloatArray], around: Excess, looks: FloatArray
    ) -> None:
        weight, scans = np.concatenate(weights), float(looks.mean())
        if self._number >= PATH_SCANS:
            # Detections of clutter count in N by their age: their variance is less than their
            # number.
            counted, expected = around.counted, np.maximum(around.expected, MIN_EXPECTED)
            noise = self._squares / max(self._scans.mean(), 1e-9)
            ratio = counted / expected
            even = np.ones_like(ratio)
            of_each = even, counted, expected, counted * ratio, noise * ratio, noise * even
            self._sums *= (1.0 - 1.0 / MEMORY_SCANS) ** scans
            self._sums += np.array(of_each) @ weight
        self._number += scans
        keep = (1.0 - 1.0 / PATH_SCANS) ** scans
        self._scans = keep * self._scans + looks
        self._squares = keep**2 * self._squares + scans
        self._around *= keep
        row, column, inside = self._neighbours(cells)
        np.add.at(self._around, (row, column), weight[:, None] * inside)

    def _neighbours(self, cells: Cells) -> tuple[IntArray, IntArray, BoolArray]:
        """Cells around detections, (n, 5) each, and whether they are cells of the map.

        Those that are not have the place of another that is.
        """
        rows, columns = self._grid.shape
        row: IntArray = cells.row[:, None] + ROW_OFFSETS
        column: IntArray = cells.column[:, None] + COLUMN_OFFSETS
        if self._grid.wraps and columns > 2:
            column %= columns
        inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
        return row % rows, column % columns, inside


class ConfirmedTargets(NamedTuple):
    """Confirmed tracks in the sensor's frame, (n,) each.

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


class _Strips:
    """Strips behind targets (n, widths, 2): behind a target, and the farther half.

    Attributes
    ----------
    middle : (n, 1, 1) ndarray of int
        Column of each target.
    start : (n, 1, 2) ndarray of int
        Rows at which the strips begin: behind the target, and at half the area left.
    """

    def __init__(self, grid: PolarGrid, targets: ConfirmedTargets) -> None:
        row, middle = grid.cells(targets.range, targets.azimuth)
        start = np.minimum(row + CELLS_BEHIND_TARGET, grid.shape[0])
        self.middle = middle[:, None, None]
        self.start = np.stack([start, grid.halfway(start)], axis=1)[:, None, :]
        self._grid = grid

    def hold(self, cells: Cells) -> BoolArray:
        """Whether each strip holds each of the cells (d,): (n, widths, 2, d)."""
        near = self._grid.apart(cells.column, self.middle) <= HALF_WIDTHS
        return np.asarray(near[:, :, None] & (cells.row >= self.start[..., None]))

    def sums(self, values: BlockSums) -> FloatArray:
        """Sums of the cells in each strip, (n, widths, 2)."""
        end, left = np.array(values.rows), self.middle - HALF_WIDTHS
        return np.maximum(values.over(self.start, end, left, 2 * HALF_WIDTHS + 1), 0.0)


class SecondaryEchoes:
    """Learns how much denser clutter is behind echoes.

    Parameters
    ----------
    grid : PolarGrid

    Attributes
    ----------
    pairs : Excess
        Pairs of clutter detections of a scan, one behind the other, for each width (w,) of a strip.
    correlation : (w,) ndarray
        ``g - 1``, at least 0.
    rises : bool
        Whether clutter is denser behind any target.
    """

    def __init__(self, grid: PolarGrid) -> None:
        self._grid, width = grid, len(HALF_WIDTHS)
        self.pairs, self.correlation = Excess(*np.zeros((2, width))), np.zeros(width)
        self._track_id, self._scans = np.zeros(0, np.int64), np.zeros(0)
        self._behind = Excess(*np.zeros((2, 0, width, 2)))
        self._rise, self.rises = self._behind.counted, False

    def behind_targets(self, targets: ConfirmedTargets, cells: Cells) -> FloatArray:
        """Factor (n,) of the map's density in cells, by confirmed targets."""
        row, known = (targets.track_id[:, None] == self._track_id).nonzero()
        if not len(row) or not len(cells.row):
            return np.ones(len(cells.row))
        targets = ConfirmedTargets(*(column[row] for column in targets))
        factor = 1.0 + targets.existence[:, None, None] * self._rise[known]
        in_strips = _Strips(self._grid, targets).hold(cells)
        return np.asarray(np.where(in_strips, factor[..., None], 1.0).max(axis=(0, 1, 2)))

    def among(self, cells: Cells, weight: FloatArray, expected: BlockSums) -> FloatArray:
        """Factor (n,) of the map's density in cells, by the other detections of their scan.

        Parameters
        ----------
        cells : Cells
            Those of the detections (n,) of a scan.
        weight : (n,) ndarray
            Probability that each is clutter.
        expected : BlockSums
            Of the numbers that the map expects in a scan.
        """
        level = self._before(cells, weight, expected).mean(self.correlation[:, None])
        return np.maximum(level, 1.0).max(axis=0)

    def update(self, targets: ConfirmedTargets, batch: ScanBatch, expected: BlockSums) -> None:
        """Learn from a batch: pairs of each scan, and what is behind targets in all.

        Parameters
        ----------
        targets : ConfirmedTargets
        batch : ScanBatch
        expected : BlockSums
            Of the numbers that the map expects in a scan.
        """
        number, (counted, expected_there) = batch.scans, np.zeros((2, len(HALF_WIDTHS)))
        for (row, column, *_), weight in zip(batch.places, batch.weights, strict=True):
            before = self._before(Cells(row, column), weight, expected)
            counted = counted + before.counted @ weight
            expected_there = expected_there + before.expected @ weight
        keep = (1.0 - 1.0 / MEMORY_SCANS) ** number
        self.pairs = self.pairs.faded(keep, counted, expected_there)
        self.correlation = np.maximum(self.pairs.lower(1.0, CHANCE_DEVIATIONS) - 1.0, 0.0)
        ids, scans, behind = self._of_targets(targets.track_id)
        if len(ids):
            strips, keep = _Strips(self._grid, targets), (1.0 - 1.0 / TARGET_MEMORY) ** number
            cells, _, weight = batch.joined
            looks, count = batch.looks[strips.middle], strips.hold(cells) @ weight
            behind = behind.faded(keep, count, looks * strips.sums(expected))
            scans = keep * scans + looks[:, 0, 0]
        self._track_id, self._scans, self._behind = ids, scans, behind
        target = np.minimum(scans + 2.0, MAX_TARGET_COUNT)[:, None, None]
        self._rise = np.maximum(behind.lower(target), 1.0) - 1.0
        self.rises = bool(self._rise.any())

    def _before(self, cells: Cells, weight: FloatArray, expected: BlockSums) -> Excess:
        """Detections (w, n) in front of each of these, in the strips around its bearing."""
        strips = np.array(0), cells.row, cells.column - HALF_WIDTHS, 2 * HALF_WIDTHS + 1
        if len(weight) <= MAX_COUNTED_SINGLY:
            near = self._grid.apart(cells.column, cells.column[:, None]) <= HALF_WIDTHS[..., None]
            before = (near & (cells.row < cells.row[:, None])) @ weight
        else:
            counts = np.zeros(self._grid.shape)
            np.add.at(counts, cells, weight)
            before = BlockSums(counts, self._grid.wraps).over(*strips)
        return Excess(*np.maximum([before, expected.over(*strips)], 0.0))  # rounding errors

    def _of_targets(self, track_id: IntArray) -> tuple[IntArray, FloatArray, Excess]:
        """Ids of targets (n,), scans since they are known, and what is behind them."""
        number = len(track_id)
        scans, both = np.zeros(number), np.zeros((2, number, len(HALF_WIDTHS), 2))
        new, old = (track_id[:, None] == self._track_id).nonzero()
        scans[new] = self._scans[old]
        both[0, new], both[1, new] = self._behind.counted[old], self._behind.expected[old]
        return track_id, scans, Excess(*both)
