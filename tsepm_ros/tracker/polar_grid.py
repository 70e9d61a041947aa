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
"""Polar cells over the coverage of a sensor, sums over blocks of them, and scans put together.

The rings of cells widen with range, as the errors of a sonar do.
"""

from __future__ import annotations

import copy
import math
from functools import cached_property
from typing import NamedTuple

import numpy as np

from tsepm_ros.numerics.arrays import FloatArray, IntArray
from tsepm_ros.tracker.sensor import SensorModel

CELL_WIDTH = 1.0 / 24.0
"""Width of a polar cell, rad, and its depth as a fraction of its range."""
INNER_RANGE, INNER_RINGS = 100.0, 12
"""Range within which all rings have one depth, m, and their number from the sensor on: twice the
depth of the first ring beyond."""
MAX_DEVIATIONS = 1.25
"""Standard deviations c of a window's count, or of its mean amplitude, within which the density, or
the level, stays unchanged."""
CHANCE_DEVIATIONS = 2.0
"""Standard deviations of what pairs of clutter show within which they are independent."""
MEMORY_SCANS = 50
"""Scans over which what is learned of clutter fades, or for which it is remembered."""
RENEWAL_SHARE = 0.1
"""Share of what is new from which on an estimate is made anew."""
BATCH_TIME, BATCH_DETECTIONS = 0.5, 200
"""Time for which scans are learned from together, s; detections from which on some are sooner."""
BATCH_INTERVALS, LONGEST_BATCH = 4.0, 2.0
"""Scan intervals of a batch where these are longer, up to a time, s."""


class Cells(NamedTuple):
    """Polar cells of positions, (n,) each.

    Attributes
    ----------
    row, column : ndarray of int
        By range, and by azimuth.
    """

    row: IntArray
    column: IntArray


class PolarGrid:
    """Polar cells over the coverage of a sensor, on rings that widen with range.

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
    area : (r, 1) ndarray
        Of a cell of each ring, m^2.
    middles : tuple of ndarray
        Range and azimuth of the middle of each cell, (r, 1) and (1, c).
    """

    def __init__(self, sensor: SensorModel) -> None:
        columns = max(round(sensor.sector_width / CELL_WIDTH), 1)
        self.width = sensor.sector_width / columns
        self._opposite = np.pi + 0.5 * sensor.sector_width  # from the start, the middle's
        self._start = -np.pi if sensor.all_round else sensor.azimuth_min
        inner = max(sensor.min_range, min(INNER_RANGE, sensor.max_range / 10.0))
        rings = math.ceil(math.log(sensor.max_range / inner) / CELL_WIDTH)
        edges = np.geomspace(inner, sensor.max_range, rings + 1)
        near = math.ceil(INNER_RINGS * (1.0 - sensor.min_range / inner))
        self.edges = np.append(np.linspace(sensor.min_range, inner, near, endpoint=False), edges)
        self.shape = len(self.edges) - 1, columns
        self.wraps = sensor.all_round
        self.area: FloatArray = 0.5 * self.width * np.diff(self.edges**2)[:, None]
        range_: FloatArray = np.sqrt(0.5 * (self.edges[1:] ** 2 + self.edges[:-1] ** 2))
        azimuth = np.asarray(self._start + self.width * (np.arange(columns) + 0.5), float)
        self.middles = range_[:, None], azimuth[None, :]

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
        turn = np.remainder(azimuth - self._start, 2.0 * np.pi)
        column = np.where(turn > self._opposite, 0.0, turn) / self.width
        return Cells(row, np.minimum(column.astype(np.int64), columns - 1))

    def apart(self, column: IntArray, other: IntArray) -> IntArray:
        """Number of columns between columns (...) that broadcast."""
        away = np.abs(column - other)
        return np.minimum(away, self.shape[1] - away) if self.wraps else away

    def divided(self, cells: Cells, range: FloatArray, parts: int) -> Cells:
        """Cells of ranges (n,) where each row is divided into parts of equal depth."""
        near, far = self.edges[cells.row], self.edges[cells.row + 1]
        part = (parts * (range - near) / (far - near)).astype(np.int64)
        return Cells(parts * cells.row + np.minimum(np.maximum(part, 0), parts - 1), cells.column)

    def looked(self, swept: tuple[float, ...] | None) -> FloatArray:
        """Share of each column (c,) that is in an arc: its start and width, rad; None: all."""
        columns = self.shape[1]
        if swept is None:
            return np.ones(columns)
        start, width = swept
        begin = np.remainder(self._start + self.width * np.arange(columns) - start, 2.0 * np.pi)
        after = np.clip(width - begin, 0.0, self.width)
        before = np.clip(begin + self.width - 2.0 * np.pi, 0.0, min(width, self.width))
        return np.asarray(np.minimum((after + before) / self.width, 1.0))

    def halfway(self, row: IntArray) -> IntArray:
        """Rows (n,) from which on half of the area is that from the given rows on."""
        square = 0.5 * (self.edges[row] ** 2 + self.edges[-1] ** 2)
        return np.asarray(np.searchsorted(self.edges, np.sqrt(square)))


class BlockSums:
    """Sums over blocks of cells: each costs four values, whatever its size.

    Parameters
    ----------
    values : (r, c) ndarray
    wraps : bool
        Whether the last column is next to the first; else 0 is beyond the last.
    """

    def __init__(self, values: FloatArray, wraps: bool) -> None:
        self.rows, self._columns = values.shape
        self._wraps = wraps
        self._sums = np.zeros((self.rows + 1, (1 + wraps) * self._columns + 1))
        inner = self._sums[1:, 1 : self._columns + 1]
        np.cumsum(values, axis=0, out=inner)
        if wraps:
            self._sums[1:, self._columns + 1 :] = inner
        np.cumsum(self._sums, axis=1, out=self._sums)

    def over(self, row: IntArray, end: IntArray, column: IntArray, width: IntArray) -> FloatArray:
        """Sums of the blocks from a row to before an end, and from a column on, (...).

        Parameters
        ----------
        row, end, column, width : (...) ndarray of int
            Shapes that broadcast; columns may be negative.
        """
        if self._wraps:
            width = np.minimum(width, self._columns)
            left = column % self._columns
            right = left + width
        else:
            left = np.maximum(column, 0)
            right = np.minimum(column + width, self._columns)
        upper = self._sums[end, right] - self._sums[end, left]
        return np.asarray(upper - (self._sums[row, right] - self._sums[row, left]))

    def windows(self, row: IntArray, height: int, column: IntArray, width: int) -> FloatArray:
        """Sums of the windows of a size that begin in rows (i,) and columns (j,), (i, j)."""
        strips = self._sums[:, column + width] - self._sums[:, column]
        return np.maximum(strips[row + height] - strips[row], 0.0)

    def scaled(self, factor: float) -> BlockSums:
        """The sums of the values times a factor."""
        other = copy.copy(self)
        other._sums = factor * self._sums
        return other


class ScanBatch:
    """Detections of scans that are learned from together.

    Parameters
    ----------
    columns : int
        Of the polar grid.

    Attributes
    ----------
    weights : list of ndarray
        Probabilities that the detections are clutter, scan for scan.
    densities : list of ndarray
        Clutter densities there, 1/m^2.
    looks : (c,) ndarray
        Number of the scans that looked at each column.
    """

    def __init__(self, columns: int) -> None:
        self.looks = np.zeros(columns)
        self.end(-math.inf)

    def take(
        self,
        cells: Cells,
        polar: tuple[FloatArray, FloatArray],
        weight: FloatArray,
        looked: FloatArray,
    ) -> None:
        """Take the detections of a scan, and how much of each column (c,) it looked at."""
        self.places.append((*cells, *polar))
        self.weights.append(weight)
        self.looks += looked

    def withdraw(self, weight: FloatArray) -> None:
        """Take back weight (d,) of the last scan's detections: they turn out to be targets'."""
        self.weights[-1] = self.weights[-1] - weight

    def is_whole(self, stamp: float, interval: float) -> bool:
        """Whether the scan of a stamp, s, is the last of the batch, by the usual interval, s."""
        longest = max(BATCH_TIME, min(BATCH_INTERVALS * interval, LONGEST_BATCH))
        return stamp - self._begin >= longest - 0.5 * interval

    def end(self, stamp: float) -> None:
        """Begin anew after the scan of a stamp, s."""
        vars(self).pop("joined", None)
        self._begin = stamp
        self.places: list[tuple[IntArray, IntArray, FloatArray, FloatArray]] = []
        self.weights: list[FloatArray] = []
        self.densities: list[FloatArray] = []
        self.looks = np.zeros(len(self.looks))

    @property
    def is_new(self) -> bool:
        """Whether it has no scan yet: the one before was learned from in the last scan."""
        return not self.weights

    @cached_property
    def joined(self) -> tuple[Cells, tuple[FloatArray, FloatArray], FloatArray]:
        """Cells, range (m) and azimuth (rad), and weights of the detections, scan after scan.

        Read once the batch is whole: what it takes later does not count.
        """
        row, column, range_, azimuth = map(np.concatenate, zip(*self.places, strict=True))
        return Cells(row, column), (range_, azimuth), np.concatenate(self.weights)

    @property
    def scans(self) -> float:
        """Number of the scans, as looks at the whole coverage."""
        return float(self.looks.mean())
