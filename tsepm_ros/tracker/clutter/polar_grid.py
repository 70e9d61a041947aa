"""Cells of a polar grid whose rings widen with range, and sums over blocks of them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from tsepm_ros.numerics.arrays import FloatArray, IntArray
from tsepm_ros.tracker.sensor import SensorModel

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
