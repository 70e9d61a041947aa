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
"""Places of the fixed frame: land of a chart, and cells in which clutter stays.

No detection on land is a target's. A quay, a row of piles or a field of kelp has echoes at random
places, ping for ping, within the same outline. It may be thinner than any window of the clutter
map, which also moves and turns with the sensor. Detections are counted by periods, also those of
confirmed tracks that do not move: tracks that clutter started would otherwise hide it. Clutter
differs from a target that stands still in that it lies on both sides, more than the errors of a
detection away. Let N_0 be the count in a cell, and N_1 and N_2 those in two cells that are
`DIRECTIONS` away on opposite sides, in each the largest period counted as the second largest (a
target that passes is in a single one). With n scans that saw the cell, about, in the periods since
the first detection in it, the density in a cell of side s is ::

    min(low(N_0 + N_1 + N_2) / 3, 2 N_0, 2 N_1, 2 N_2) / (n s^2)

in the direction in which it is largest. The density is used where it is more than
`MIN_DENSITY_RATIO` times that of the map: where clutter is even it rarely is. Cells have sides of
powers of two, about two and four standard deviations of a detection. The larger of the two
densities is used. Targets that stand still in a row, a few errors apart, look the same.
"""

from __future__ import annotations

import math
from collections import Counter, deque
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray
from tsepm_ros.tracker.clutter.excess import Excess
from tsepm_ros.tracker.sensor import SensorModel, SensorView

MAX_CELLS = 100_000_000
"""Largest number of cells: 12.5 MB are kept of them."""
MIN_RESOLUTION, MAX_RESOLUTION = 1e-3, 1e6
"""Smallest and largest side of a cell, m."""
MAX_DISTANCE = 1e9
"""Largest coordinate of a chart, m."""
SIDE_DEVIATIONS, MIN_SIDE = 2.0, 0.25
"""Sides of the smaller cells in standard deviations of a detection, about, and in m, at least."""
DIRECTIONS = (2, 0), (2, 1), (2, 2), (1, 2), (0, 2), (-1, 2), (-2, 2), (-2, 1)
"""Cells from a cell to that on one side; to that on the other side they are the same, negative."""
PERIOD_SCANS, MIN_PERIOD_TIME = 8, 5.0
"""Scans of a period, and its duration, s, at least: fast sonars have many pings while a target
leaves a cell."""
PERIODS = 12
"""Periods that count."""
MOST_DETECTIONS = 1000
"""Detections of a period from which on no further scan is counted: bounds the time.

In dense clutter these are the first scans of the period alone.
"""
PERIOD_VIEWS = 16
"""Different views of a period, at most, that show which cells were seen: of more, random ones."""
MIN_DENSITY_RATIO = 2.0
"""Factor above the map's density from which on that of a cell is used."""
_BITS = 28
"""Of the number of a cell, for its place on each axis."""
_MASK = (1 << _BITS) - 1
_LEVELS = 32
"""Added to the power of two of a side, so that it is positive."""


class LandMask:
    """Land on a grid in the fixed frame.

    Parameters
    ----------
    occupied : (rows, columns) array_like of bool
        Which cells are land; columns go along the grid's x axis, rows along its y axis.
    resolution : float
        Side of a cell, m.
    origin : tuple of float, optional
        Corner of the first cell, x and y, m, and direction of the grid's x axis, rad, in the fixed
        frame.

    Attributes
    ----------
    cells : int
        Number of cells that are land.
    resolution : float
        m.
    origin : tuple of float
        m, m, rad.

    Raises
    ------
    ValueError
        If the array does not have two axes and at most `MAX_CELLS` cells, or a number is not finite
        or too large; the message names it.
    """

    def __init__(
        self,
        occupied: ArrayLike,
        resolution: float,
        origin: tuple[float, float, float] = (0.0, 0.0, 0.0),
    ) -> None:
        land = np.asarray(occupied)
        if land.ndim != 2 or land.size > MAX_CELLS:
            raise ValueError(
                f"occupied must have two axes and at most {MAX_CELLS} cells; got {land.shape}"
            )
        if not MIN_RESOLUTION <= resolution <= MAX_RESOLUTION:  # nan, too
            raise ValueError(
                f"resolution must be from {MIN_RESOLUTION:g} to {MAX_RESOLUTION:g} m; got "
                f"{resolution}"
            )
        size = resolution * max(land.shape, default=0)
        if not (len(origin) == 3 and all(math.isfinite(value) for value in origin)):
            raise ValueError(f"origin must be three finite numbers; got {origin}")
        if max(abs(origin[0]), abs(origin[1])) + size > MAX_DISTANCE:
            raise ValueError(f"origin and size must be at most {MAX_DISTANCE:g} m; got {origin}")
        self.resolution = float(resolution)
        self.origin = float(origin[0]), float(origin[1]), float(origin[2])
        self._rows, self._columns = land.shape
        land = land.astype(bool, copy=False)
        self.cells = int(np.count_nonzero(land))
        self._bits = np.packbits(land, axis=None)

    @property
    def area(self) -> float:
        """Area of the land, m^2."""
        return self.cells * self.resolution**2

    def covers(self, positions: FloatArray) -> BoolArray:
        """Whether positions (n, 2) in the fixed frame, m, are on land; beyond the grid none is."""
        x, y, yaw = self.origin
        cosine, sine = math.cos(yaw), math.sin(yaw)
        east, north = positions[:, 0] - x, positions[:, 1] - y
        column = np.floor((cosine * east + sine * north) / self.resolution)
        row = np.floor((cosine * north - sine * east) / self.resolution)
        inside = (column >= 0) & (column < self._columns) & (row >= 0) & (row < self._rows)
        index = row[inside].astype(np.int64) * self._columns + column[inside].astype(np.int64)
        on_land = np.zeros(len(positions), bool)
        on_land[inside] = (self._bits[index >> 3] >> (7 - (index & 7)).astype(np.uint8)) & 1
        return on_land


class FixedPlaces:
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
        self._taken: list[tuple[FloatArray, FloatArray]] = []
        self._views: list[SensorView] = []

    @property
    def known(self) -> bool:
        """Whether clutter stays anywhere."""
        return len(self._cells) > 0

    def cells(self, position: FloatArray, deviation: FloatArray) -> tuple[IntArray, IntArray]:
        """Cells of detections.

        Parameters
        ----------
        position : (n, 2) ndarray
            In the fixed frame, m; within 3e7 m of its origin.
        deviation : (n,) ndarray
            Standard deviation of each along its major axis, m.

        Returns
        -------
        counted : (n, 3) ndarray of int
            Of three sizes, the smallest first: those that the detection is counted in.
        nearest : (n, 2) ndarray of int
            Of the two sizes that fit its errors best.
        """
        part, power = np.frexp(np.maximum(SIDE_DEVIATIONS * deviation, MIN_SIDE))
        levels = power[:, None] - np.array([1, 0, -1])
        numbers = _cell_numbers((position @ self._axes)[:, None], levels)
        nearer = (part > math.sqrt(0.5))[:, None]
        return numbers, np.where(nearer, numbers[:, 1:], numbers[:, :-1])

    def density(self, cells: tuple[IntArray, IntArray]) -> FloatArray:
        """Density where clutter stays, 0 elsewhere, at detections, (n,), 1/m^2."""
        row, known = _cell_rows(cells[1], self._cells)
        return np.asarray(np.where(known, self._densities[row], 0.0).max(axis=1))

    def update(
        self,
        stamp: float,
        view: SensorView,
        position: FloatArray,
        deviation: FloatArray,
        moving: IntArray,
    ) -> None:
        """Take a scan's detections; they count when the period ends.

        A scan that was taken before, and is observed again, is left out.

        Parameters
        ----------
        stamp : float
            s.
        view : SensorView
            What the scan looked at.
        position, deviation : (n, 2), (n,) ndarray
            As in `cells`.
        moving : (k,) ndarray of int
            Rows of detections that are left out, those of confirmed tracks that move.
        """
        if stamp <= self._last:
            return
        self._last = stamp
        if self._scans >= PERIOD_SCANS and stamp - self._begun >= MIN_PERIOD_TIME:
            self._end_period()
            self._begin()
        if not self._scans:
            self._begun = stamp
        self._scans += 1
        if self._number < MOST_DETECTIONS:
            self._number += len(position)
            stays = np.ones(len(position), bool)
            stays[moving] = False
            self._taken.append((position[stays], deviation[stays]))
            self._views.append(view)

    def _end_period(self) -> None:
        taken, _ = self.cells(
            *(np.concatenate(column) for column in zip(*self._taken, strict=True))
        )
        cells, counts = np.unique(taken, return_counts=True)
        views = self._views
        if len(set(views)) > PERIOD_VIEWS:
            rng = np.random.default_rng(len(views))
            views = [views[i] for i in rng.choice(len(views), PERIOD_VIEWS, replace=False)]
        self._periods.append(_Period(cells, counts, len(self._views), Counter(views)))
        if len(self._periods) > 1:
            self._cells, self._densities = _cell_densities(list(self._periods), self._axes)


class _Period(NamedTuple):
    """Detections in a period.

    Attributes
    ----------
    cells : (k,) ndarray of int
        With detections, ascending.
    counts : (k,) ndarray of int
    scans : int
    views : Counter of SensorView
        How many of the scans, or of some of them, had each view.
    """

    cells: IntArray
    counts: IntArray
    scans: int
    views: Counter[SensorView]


def _cell_densities(periods: list[_Period], axes: FloatArray) -> tuple[IntArray, FloatArray]:
    """Cells in which clutter stays, (k,), ascending, and its density there, 1/m^2."""
    cells, counts, first = _counts_of_periods(periods)
    number = _staying(cells, counts)
    stays = np.flatnonzero(number)
    cells, number, first = cells[stays], number[stays], first[stays]
    scans = _scans_seeing(first, _middles(cells) @ axes.T, periods)
    use = np.flatnonzero(scans)
    return cells[use], number[use] / (scans[use] * _sides(cells[use]) ** 2)


def _counts_of_periods(periods: list[_Period]) -> tuple[IntArray, FloatArray, IntArray]:
    """Cells of two periods at least, (k,), ascending, their counts over all, and first periods.

    The largest count of a cell counts as the second largest.
    """
    cells = np.concatenate([part.cells for part in periods])
    counts = np.concatenate([part.counts for part in periods]).astype(float)
    period = np.repeat(np.arange(len(periods)), [len(part.cells) for part in periods])
    order = np.lexsort((counts, cells))
    cells, counts, period = cells[order], counts[order], period[order]
    last = np.flatnonzero(np.diff(cells, append=-1))  # the largest; no cell is negative
    if not len(last):
        return cells, counts, period
    begin = np.append(0, last[:-1] + 1)
    first = np.minimum.reduceat(period, begin)
    counts[last] = np.where(last > begin, counts[last - 1], 0.0)
    several = last > begin
    return cells[last[several]], np.add.reduceat(counts, begin)[several], first[several]


def _staying(cells: IntArray, counts: FloatArray) -> FloatArray:
    """Number of detections of clutter that stays in cells (n,), of the counts there (n,).

    0 where no two cells on opposite sides have any.
    """
    staying = np.zeros(len(cells))
    for x, y in DIRECTIONS:
        between = np.arange(len(cells))
        least, total = counts, counts
        for sign in (1, -1):
            row, known = _cell_rows(_neighbour_cells(cells[between], sign * x, sign * y), cells)
            between, count = between[known], counts[row[known]]
            least, total = np.minimum(least[known], count), total[known] + count
        number = np.minimum(Excess(total, np.array(3.0)).lower(), 2.0 * least)
        staying[between] = np.maximum(staying[between], number)
    return staying


def _scans_seeing(first: IntArray, places: FloatArray, periods: list[_Period]) -> FloatArray:
    """Number of scans, (n,), that saw each place (n, 2), from its first period (n,) on; about."""
    # Most sensors look at the same from scan to scan.
    views = {view for part in periods for view in part.views}
    covered = {view: view.covers(places) for view in views}
    scans = np.zeros(len(places))
    for number, part in enumerate(periods):
        seen = sum((share * covered[view] for view, share in part.views.items()), np.zeros(1))
        scans += np.where(first <= number, part.scans / part.views.total() * seen, 0.0)
    return scans


def _cell_numbers(position: FloatArray, level: IntArray) -> IntArray:
    """Numbers (...) of the cells of positions (..., 2) with sides of powers of two (...)."""
    index = np.floor(np.ldexp(position, -level[..., None])).astype(np.int64) & _MASK
    of_level = (level + _LEVELS).astype(np.int64) << 2 * _BITS
    return np.asarray(of_level | (index[..., 0] << _BITS) | index[..., 1])


def _cell_rows(numbers: IntArray, cells: IntArray) -> tuple[IntArray, BoolArray]:
    """Rows of cells (k,), ascending, with given numbers (...), and whether there is such a cell.

    Where there is none, the row has no meaning.
    """
    if not len(cells):
        return np.zeros(numbers.shape, np.int64), np.zeros(numbers.shape, bool)
    row = np.searchsorted(cells, numbers)
    row[row == len(cells)] = 0
    return row, np.asarray(cells[row] == numbers)


def _neighbour_cells(cells: IntArray, x: int, y: int) -> IntArray:
    """Numbers of the cells that are some places beside others (n,)."""
    level = cells >> 2 * _BITS << 2 * _BITS
    return np.asarray(level | (((cells >> _BITS) + x) & _MASK) << _BITS | ((cells + y) & _MASK))


def _sides(cells: IntArray) -> FloatArray:
    """Sides of cells (n,), m."""
    return np.asarray(np.exp2((cells >> 2 * _BITS) - _LEVELS))


def _middles(cells: IntArray) -> FloatArray:
    """Middles of cells, (n, 2), m."""
    index = np.stack([cells >> _BITS, cells], axis=1) & _MASK
    index -= (index >> (_BITS - 1)) << _BITS  # below zero
    return np.asarray((index + 0.5) * _sides(cells)[:, None])
