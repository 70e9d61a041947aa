"""How uncertain the clutter density is where a path has its hits: a predictive density.

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
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray
from tsepm_ros.tracker.clutter.density import MEMORY, ClutterMap
from tsepm_ros.tracker.clutter.polar_grid import Cells
from tsepm_ros.tracker.clutter.windows import MAX_DEVIATIONS

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
