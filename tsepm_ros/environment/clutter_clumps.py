"""How uncertain the clutter density is where a path has its hits: a predictive density.

The density that is learned is an estimate, and clutter is lumpier than the map resolves. Let the
true density in the neighbourhood of a path be the estimate times a factor of gamma distribution
with mean 1 and shape a. With N detections of the last scans around the j-th hit, of M that the map
expects, and with the path's own hits at least, the predictive density of the hit is ::

    lambda_hat (a + max(N, j - 1)) / (a + M),    at least lambda_hat

so that the mean of a path's likelihood ratio in clutter stays at most 1, over the randomness of the
density too (the product over a path is that of the negative binomial law,
``Gamma(a + k) / (Gamma(a) b^k)``). The mean density itself is known from L detections: hits count
``1 + (j - 1) / L`` times as dense.

The variance ``v = 1 / a`` of the factor is learned. Detections of clutter follow others of the last
scans in the same place more often than the map expects, ``m (1 + v)`` times as often (the pair
correlation: Moller, Waagepetersen, "Statistical inference and simulation for spatial point
processes", 2003), with m times as many detections in all as the map expects. Only what the pairs
show beyond their bound counts; in even clutter v is 0, and a is infinite.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from tsepm_ros.environment.adaptive_windows import MAX_DEVIATIONS, poisson_bound
from tsepm_ros.environment.clutter_map import MEMORY, ClutterMap
from tsepm_ros.environment.polar_grid import Cells
from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray

RECENT = 16.0
"""Time constant, in scans, of the detections that others follow: about the length of a path."""
TARGET_PAIRS = 10.0
"""Pairs attributed to targets that are not recognised yet: those of five hits."""
REACH = 1
"""Cells on each side of a detection in which others are its neighbours."""
_ROW_OFFSETS, _COLUMN_OFFSETS = np.indices((2 * REACH + 1, 2 * REACH + 1)).reshape(2, -1) - REACH


class PredictiveDensity(NamedTuple):
    """What makes the clutter density at a scan's detections uncertain.

    Attributes
    ----------
    detections : float
        L, the number behind the mean density.
    shape : float
        a; inf where clutter is as even as its map.
    around : (d,) ndarray
        N, detections of clutter of the last scans around each detection.
    expected : (d,) ndarray
        M, those that the map expects.
    """

    detections: float
    shape: float
    around: FloatArray
    expected: FloatArray

    def increment(self, hits: IntArray, parent: IntArray, row: IntArray) -> FloatArray:
        """Score increment, at most 0, of each child (p,) of a path and a detection.

        Parameters
        ----------
        hits : (n,) ndarray of int
            Hits of the paths before, j - 1.
        parent, row : (p,) ndarray of int
            Path and detection of each child.
        """
        increment: FloatArray = -np.log1p(hits / self.detections)[parent]
        if math.isfinite(self.shape):
            beyond = np.maximum(self.around[row], hits[parent]) - self.expected[row]
            share = np.maximum(beyond, 0.0) / (self.shape + self.expected[row])
            increment -= np.log1p(share)
        return increment


class _Neighbours(NamedTuple):
    """Cells around detections, (n, 9) each, and whether they are cells of the map."""

    row: IntArray
    column: IntArray
    inside: BoolArray

    def sums(self, values: FloatArray) -> FloatArray:
        """Sum of the values (r, c) of the cells around each detection, (n,)."""
        of_cells = values[np.where(self.inside, self.row, 0), np.where(self.inside, self.column, 0)]
        return np.asarray(np.where(self.inside, of_cells, 0.0).sum(axis=1))


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
        self._wraps = wraps and shape[1] > 2 * REACH
        self._around = np.zeros(shape)
        self._scans = 0.0
        none = np.zeros(0, np.int64)
        self._neighbours = self._neighbours_of(Cells(none, none))
        self._weight, self._near, self._inverse = np.zeros((3, 0))
        self._area, self._number = 0.0, 0.0
        # Pairs, the same over the density, the sum of squares of these, and of both the expected.
        self._sums = np.zeros(6)

    @property
    def variance(self) -> float:
        """Variance v of the true density over the estimate, at least 0."""
        pairs, followed, squares, area, detections, expected = self._sums
        if pairs <= TARGET_PAIRS or not followed or not expected:
            return 0.0
        followed *= 1.0 - TARGET_PAIRS / pairs
        # Pairs that share a detection are not independent: fewer, of a larger weight.
        weight = squares / followed
        low = weight * float(poisson_bound(np.array(followed / weight), -MAX_DEVIATIONS))
        mean = min(detections / expected, 1.0)
        return max(low / (area * mean) - 1.0, 0.0)

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
        self._learn()
        area = clutter_map.counted_area
        self._neighbours = self._neighbours_of(cells)
        self._weight, self._near = weight, self._around[cells]
        self._inverse = 1.0 / density
        self._area = float((self._around * area).sum())
        self._number = float(clutter_map.expected.sum())
        variance = self.variance
        expected = self._scans * density * self._neighbours.sums(area)
        return PredictiveDensity(
            clutter_map.count, 1.0 / variance if variance else math.inf, self._near, expected
        )

    def withdraw(self, share: FloatArray) -> None:
        """Take back a share of each of the last scan's detections (n,): that of a target."""
        self._weight = self._weight * (1.0 - share)

    def _learn(self) -> None:
        """Learn from the last scan taken."""
        weight = self._weight
        followed = self._near * self._inverse
        self._sums *= 1.0 - 1.0 / MEMORY
        self._sums += np.array(
            [
                self._near @ weight,
                followed @ weight,
                np.square(followed) @ weight,
                self._area,
                weight.sum(),
                self._number,
            ]
        )
        keep = 1.0 - 1.0 / RECENT
        self._scans = keep * self._scans + 1.0
        self._around *= keep
        row, column, inside = self._neighbours
        weights = np.broadcast_to(weight[:, None], inside.shape)
        np.add.at(self._around, (row[inside], column[inside]), weights[inside])

    def _neighbours_of(self, cells: Cells) -> _Neighbours:
        rows, columns = self._around.shape
        row: IntArray = cells.row[:, None] + _ROW_OFFSETS
        column: IntArray = cells.column[:, None] + _COLUMN_OFFSETS
        if self._wraps:
            column %= columns
        inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
        return _Neighbours(row, column, inside)
