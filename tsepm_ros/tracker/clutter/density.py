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
"""Clutter density, and where clutter is seen, learned from scan to scan.

Detections are counted on a polar grid, as in Environment 2018's clutter zones; its rings widen with
range, as the errors of a sonar do. From coarse to fine, the density of a cell changes only as far
as the counts of the windows around it require (Lepski, "On a problem of adaptive estimation in
Gaussian white noise", Theory Probab. Appl. 35(3), 1991): it is moved into their bounds, see
`Excess`, the largest lower and the largest upper bound of a size. For each size, the densest window
that holds the cell counts, as in a greatest-of CFAR (Hansen, "Constant false alarm rate processing
in search radars", IEE Radar, 1973). At the edge of clutter, a window across the edge biases the
density low exactly at the detections, which raises the scores of false tracks.

Windows are squares, each size twice as wide as the next, which begin every eighth of their side or
every second cell. Reverberation of the sea floor, of a layer or of side lobes lies on rings that
are thinner than any square. Each dense ring of cells has such bounds too, of the whole ring and
then of ever shorter arcs of it, so that a zone of clutter raises no other part of its rings. The
density of a cell is the larger one of both.

A sensor may see less than its coverage as given: nobody set it, or the operator chose a shorter
range. Clutter that is uniform over an interval of unknown ends, seen n times, spans
``(n - 1) / (n + 1)`` of it on average. So does each dimension here, the squared range and the
azimuth, and the estimate makes up for it. The area is that of the convex hull of the n detections,
over ``1 - v / n`` with its v vertices (Efron, "The convex hull of a random set of points",
Biometrika 52, 1965), where that is smaller.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray
from tsepm_ros.tracker.clutter.excess import Excess, poisson_bound
from tsepm_ros.tracker.polar_grid import (
    MAX_DEVIATIONS,
    MEMORY_SCANS,
    RENEWAL_SHARE,
    BlockSums,
    Cells,
    PolarGrid,
)
from tsepm_ros.tracker.scan import MAX_MAGNITUDE, in_sensor_frame, wrap
from tsepm_ros.tracker.sensor import MIN_CLUTTER_DENSITY, SensorModel
from tsepm_ros.tracker.tracks import EVEN_PROBABILITY

MAX_DETECTIONS = 500
"""Detections of the last scans whose extent counts, and the rest of the oldest of these scans."""
DATA_SHEET_COUNT = 0.5
"""Weight of the data sheet's density, as a number of detections: it may be anybody's guess."""
MIN_SEEN_SHARE = 0.1
"""Share of a window that counts as seen at least."""
MAX_TARGET_COUNT = 8.0
"""Detections in a window attributed to new targets: at most this, or two and one a scan."""
MIN_WINDOW_CELLS = 4
"""Cells along a side of the smallest window; each larger window is twice as wide."""
PER_SIDE, MIN_STEP = 8, 2
"""Windows begin this often along the side of a window, but at least so many cells apart."""
ARCS = 2, 4, 8
"""Parts of a ring that its arcs are."""
MIN_RING_RATIO = 1.2
"""Factor, at least, by which a ring is denser than its thinnest cell: less is no harm."""


@dataclass(frozen=True)
class ClutterExtent:
    """Ranges and a sector.

    Attributes
    ----------
    min_range, max_range : float
        m.
    azimuth_min, azimuth_max : float
        rad, the second above the first by at most 2 pi.
    """

    min_range: float
    max_range: float
    azimuth_min: float
    azimuth_max: float

    @classmethod
    def of_sensor(cls, sensor: SensorModel) -> ClutterExtent:
        """A sensor's coverage as given."""
        begin, width = sensor.azimuth_min, sensor.sector_width
        return cls(sensor.min_range, sensor.max_range, begin, begin + width)

    @property
    def all_round(self) -> bool:
        """Whether it has every azimuth."""
        return self.azimuth_max - self.azimuth_min >= 2.0 * math.pi - 1e-9

    @property
    def area(self) -> float:
        """m^2."""
        width = self.azimuth_max - self.azimuth_min
        return 0.5 * width * (self.max_range**2 - self.min_range**2)


EVERYWHERE = ClutterExtent(0.0, MAX_MAGNITUDE["range"], -math.pi, math.pi)


@dataclass(frozen=True, eq=False)
class ClutterRegion:
    """A convex part of an extent.

    Attributes
    ----------
    extent : ClutterExtent
    edges : (e, 3) ndarray
        ``edges @ (x, y, 1) <= 0`` inside, in the sensor's frame, m; without rows the whole extent.
    area : float
        m^2.
    """

    extent: ClutterExtent
    edges: FloatArray
    area: float

    @classmethod
    def whole(cls, extent: ClutterExtent) -> ClutterRegion:
        """A whole extent."""
        return cls(extent, np.zeros((0, 3)), extent.area)

    def contains(self, range: FloatArray, azimuth: FloatArray) -> BoolArray:
        """Whether positions (...) in the sensor's frame are inside."""
        extent = self.extent
        turn = np.remainder(azimuth - extent.azimuth_min, 2.0 * np.pi)
        inside = (
            (turn <= extent.azimuth_max - extent.azimuth_min)
            & (range >= extent.min_range)
            & (range <= extent.max_range)
        )
        if len(self.edges):
            nearest, farthest = self._ranges(azimuth)
            inside &= (range >= nearest) & (range <= farthest)
        return np.asarray(inside)

    def _ranges(self, azimuth: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Nearest and farthest range between the edges along azimuths (...).

        Where nothing is, the nearest is infinite.
        """
        along_x, along_y, offset = self.edges.reshape(-1, 3, *([1] * azimuth.ndim)).swapaxes(0, 1)
        along = along_x * np.cos(azimuth) + along_y * np.sin(azimuth)
        with np.errstate(divide="ignore", invalid="ignore"):
            crossing = -offset / along
        farthest = np.where(along > 0.0, crossing, np.inf).min(axis=0)
        nearest = np.where(along < 0.0, crossing, -np.inf)
        nearest = np.where((along == 0.0) & (offset > 0.0), np.inf, nearest).max(axis=0)
        return nearest, farthest


class SeenClutterExtent:
    """Estimates the extent of what a sensor sees from the places of clutter.

    Parameters
    ----------
    limit : ClutterExtent
        The estimate does not exceed it.

    Attributes
    ----------
    detections : int
        Number of detections that count.
    """

    def __init__(self, limit: ClutterExtent) -> None:
        self._limit = limit
        self._scans: deque[FloatArray] = deque([np.zeros((2, 0))])
        self.detections = 0
        self._region: ClutterRegion | None = ClutterRegion.whole(limit)

    def update(self, range: FloatArray, azimuth: FloatArray, weight: FloatArray) -> None:
        """Update with a scan's detections; see `ClutterMap.update`."""
        clutter = np.flatnonzero(weight > EVEN_PROBABILITY)
        if not len(clutter):
            return
        # In an order of their own, and evenly from all of a large scan: the order in the message
        # does not matter.
        clutter = clutter[np.lexsort((range[clutter], azimuth[clutter]))]
        clutter = clutter[:: math.ceil(len(clutter) / MAX_DETECTIONS)]
        self.take(np.array([range[clutter], wrap(azimuth[clutter])]))

    def take(self, places: FloatArray) -> None:
        """Take the newest of places (2, n): of a scan, or the `places` of another estimate."""
        self._scans.append(places[:, -MAX_DETECTIONS:])  # else each restart had more
        self.detections += self._scans[-1].shape[1]
        while self.detections - self._scans[0].shape[1] >= MAX_DETECTIONS:
            self.detections -= self._scans.popleft().shape[1]
        if self.detections >= 3:
            self._region = None

    @property
    def places(self) -> FloatArray:
        """Range (m) and azimuth (rad) of the detections that count, (2, n)."""
        return np.concatenate(self._scans, axis=1)

    @property
    def region(self) -> ClutterRegion:
        """Where clutter is seen; the limit before the third detection. Estimated when asked for."""
        if self._region is None:
            self._region = self._convex(*self.places)
        return self._region

    def _estimated(self, range: FloatArray, azimuth: FloatArray) -> ClutterExtent:
        given, n = self._limit, len(range)
        low, high = _widened(float(range.min()) ** 2, float(range.max()) ** 2, n)
        ordered = np.sort(azimuth)
        gaps = np.append(np.diff(ordered), ordered[0] + 2.0 * np.pi - ordered[-1])
        widest = int(np.argmax(gaps))  # the sector begins behind it
        start = float(ordered[(widest + 1) % n])
        start, end = _widened(start, start + 2.0 * np.pi - float(gaps[widest]), n)
        width = given.azimuth_max - given.azimuth_min
        if end - start >= width:
            start, end = given.azimuth_min, given.azimuth_max
        elif not given.all_round:
            # From the beginning of the sector on; behind its end is what it leaves out, and then
            # its beginning again: an arc over all of that is not cut.
            first = (start - given.azimuth_min) % (2.0 * np.pi)
            last = first + end - start
            if first > width:
                first, last = 0.0, max(last - 2.0 * np.pi, 0.0)
            elif last < 2.0 * np.pi:
                last = min(last, width)
            start, end = given.azimuth_min + first, given.azimuth_min + last
        return ClutterExtent(
            math.sqrt(max(low, given.min_range**2)),
            math.sqrt(min(high, given.max_range**2)),
            start,
            end,
        )

    def _convex(self, range: FloatArray, azimuth: FloatArray) -> ClutterRegion:
        """The convex hull of the detections, as much larger as it is too small on average."""
        extent, places = self._estimated(range, azimuth), in_sensor_frame(range, azimuth)
        try:
            hull = ConvexHull(places)
        except QhullError:  # too few, or in a line
            return ClutterRegion.whole(extent)
        missing = len(hull.vertices) / len(range)
        area = hull.volume / (1.0 - missing) if missing < 1.0 else math.inf
        if area >= extent.area:
            return ClutterRegion.whole(extent)
        edges = hull.equations.copy()
        # Every edge is moved away from the middle, by the same factor.
        at_middle = edges @ np.append(places[hull.vertices].mean(axis=0), 1.0)
        edges[:, 2] += (math.sqrt(area / hull.volume) - 1.0) * at_middle
        return ClutterRegion(extent, edges, float(area))


def _widened(low: float, high: float, number: int) -> tuple[float, float]:
    """Ends of an interval, from the least and the largest of uniform values in it."""
    beyond = (high - low) / (number - 1)
    return low - beyond, high + beyond


def window_sizes(rows: int, columns: int) -> list[tuple[int, int]]:
    """Height and width of the windows of each size, the largest first, cells."""
    doublings = max(math.ceil(math.log2(max(rows, columns) / MIN_WINDOW_CELLS)), 0)
    sides = [MIN_WINDOW_CELLS * 2**doubling for doubling in reversed(range(doublings + 1))]
    return [(min(side, rows), min(side, columns)) for side in sides]


@lru_cache(maxsize=64)
def windows_along(cells: int, length: int, wraps: bool) -> tuple[IntArray, IntArray, IntArray]:
    """The windows of a length along an axis of so many cells, `PER_SIDE` to it, or fewer.

    Returns
    -------
    begin : (w,) ndarray of int
        Their first cells.
    windows : (p, b) ndarray of int
        Windows that hold each block of cells between such beginnings.
    block : (c,) ndarray of int
        Of each cell.
    """
    step = min(max(length // PER_SIDE, MIN_STEP), length)
    back = np.arange(length // step)[:, None]
    if wraps and length < cells:
        begin = np.arange(0, cells, step)
        windows, edges = (np.arange(len(begin)) - back) % len(begin), begin
    else:
        begin = np.unique(np.append(0, np.arange(cells - length, -1, -step)))
        edges = np.append(begin, np.arange(cells - length + step, cells, step))
        windows = np.clip(np.arange(len(edges)) - back, 0, len(begin) - 1)
    return begin, windows, np.searchsorted(edges, np.arange(cells), side="right") - 1


def window_sums(shapes: list[tuple[int, int]], values: FloatArray, wraps: bool) -> list[FloatArray]:
    """Sums of values (r, c) over the windows of each shape, (i, j) each; see `WindowBounds`."""
    sums, (rows, columns) = BlockSums(values, wraps), values.shape
    return [
        sums.windows(
            windows_along(rows, height, False)[0],
            height,
            windows_along(columns, width, wraps)[0],
            width,
        )
        for height, width in shapes
    ]


@lru_cache(maxsize=8)
def whole_windows(grid: PolarGrid, shares: bytes) -> list[FloatArray]:
    """The whole area of the windows of each size, times the shares of the columns (c,)."""
    return window_sums(window_sizes(*grid.shape), grid.area * np.frombuffer(shares), grid.wraps)


class WindowBounds:
    """Bounds of a density by the counts of windows.

    Parameters
    ----------
    shapes : list of tuple of int
        Heights and widths of the windows, the largest first, cells.
    seen : (r, c) ndarray
        Area of each cell in which clutter is seen, m^2.
    whole : list of (i, j) ndarray
        Whole area of the windows of each shape, m^2.
    wraps : bool
        Whether the last column is next to the first.
    widening : float
        Factor on the area in which clutter is seen.
    """

    def __init__(
        self,
        shapes: list[tuple[int, int]],
        seen: FloatArray,
        whole: list[FloatArray],
        wraps: bool,
        widening: float,
    ) -> None:
        self._shapes, self._wraps, self._cells = shapes, wraps, seen.shape
        of_seen = window_sums(shapes, seen, wraps)
        self._areas = [counted_area(widening, *areas) for areas in zip(of_seen, whole, strict=True)]

    def moved(
        self, density: FloatArray, counts: FloatArray, scans: float, target: float
    ) -> FloatArray:
        """The density, moved into the bounds of the windows that hold each cell.

        Parameters
        ----------
        density : (r, c) ndarray
            Or of a shape that broadcasts to it, 1/m^2.
        counts : (r, c) ndarray
            Detections of clutter in each cell in all scans.
        scans : float
            Their number.
        target : float
            Detections of an unknown target.
        """
        of_counts = window_sums(self._shapes, counts, self._wraps)
        for shape, number, area in zip(self._shapes, of_counts, self._areas, strict=True):
            excess = Excess(number, scans * area)
            low, high = excess.lower(target), excess.upper()
            if low.max() > density.min():  # a third of the time of a map in even clutter
                density = np.maximum(density, self._largest(low, *shape))
            if high.min() < density.max():
                density = np.minimum(density, self._largest(high, *shape))
        return density

    def _largest(self, values: FloatArray, height: int, width: int) -> FloatArray:
        """The largest value of the windows (i, j) of a shape that hold each cell, (r, c)."""
        _, windows, row = windows_along(self._cells[0], height, False)
        values = values.take(windows, axis=0).max(axis=0)
        _, windows, column = windows_along(self._cells[1], width, self._wraps)
        values = values.take(windows, axis=1).max(axis=1)
        return np.asarray(values[row][:, column])


def counted_area(widening: float, seen: FloatArray, whole: FloatArray) -> FloatArray:
    """The area that counts, m^2: of parts with these areas, of which clutter is seen in some.

    It is at most the whole area, at least a tenth of it, and grows with the area seen.
    """
    return np.minimum(np.maximum(widening * seen, MIN_SEEN_SHARE * whole), whole)


class SeenCells:
    """The area of each cell in which clutter is seen.

    Where clutter is seen in less than the area of one target, its parts count as larger.

    Parameters
    ----------
    grid : PolarGrid
    region : ClutterRegion
        Where clutter is seen.
    area : float
        Area of that region, or of one target if larger, m^2.
    shares : (c,) ndarray
        Shares of the scans that looked at each column.

    Attributes
    ----------
    region, area, shares
        As given.
    seen, whole : (r, c) ndarray
        Area in which clutter is seen, and all, times the shares, m^2.
    counted : (r, c) ndarray
        Area in which clutter is expected, m^2.
    bounds : WindowBounds
        Of squares.
    widening : float
    """

    def __init__(
        self, grid: PolarGrid, region: ClutterRegion, area: float, shares: FloatArray
    ) -> None:
        self.region, self.area, self.shares = region, area, shares
        seen = np.broadcast_to(grid.area, grid.shape)
        if region.area:
            seen = seen * region.contains(*grid.middles)
        self.widening = max(area / region.area, 1.0) if region.area else 1.0
        self.counted = counted_area(self.widening, seen, grid.area)
        self.seen, self.whole = seen * shares, grid.area * shares
        windows = whole_windows(grid, shares.tobytes())
        self.bounds = WindowBounds(
            window_sizes(*grid.shape), self.seen, windows, grid.wraps, self.widening
        )


class _MapEstimate:
    """The density by the counts of some scans, computed where it is asked for.

    Parameters
    ----------
    counts : (r, c) ndarray
    scans : float
    cells : SeenCells
    grid : PolarGrid
    prior : float
        Density of the data sheet, 1/m^2.

    Attributes
    ----------
    number : float
        Mean number of detections in a scan.
    """

    def __init__(
        self, counts: FloatArray, scans: float, cells: SeenCells, grid: PolarGrid, prior: float
    ) -> None:
        self._counts, self._scans, self._cells, self._prior = counts, scans, cells, prior
        self._grid = grid
        looks = scans * float(cells.shares.mean())
        self.number = (DATA_SHEET_COUNT + float(counts.sum())) / (DATA_SHEET_COUNT + looks)

    @cached_property
    def density(self) -> FloatArray:
        """Density of each cell, (r, c), 1/m^2."""
        weight, counts, scans, cells = DATA_SHEET_COUNT, self._counts, self._scans, self._cells
        looked = scans * cells.area * cells.shares.mean()
        overall = np.full(counts.shape, (weight + counts.sum()) / (weight / self._prior + looked))
        if not scans:
            return overall
        target = min(scans + 2.0, MAX_TARGET_COUNT)
        density = cells.bounds.moved(overall, counts, scans, target)
        self._raise_rings(density, target)
        return np.maximum(density, MIN_CLUTTER_DENSITY)

    def _raise_rings(self, density: FloatArray, target: float) -> None:
        """Raise the density (r, c) of the cells on dense rings, in place."""
        cells, columns = self._cells, self._counts.shape[1]
        area = counted_area(cells.widening, cells.seen.sum(axis=1), cells.whole.sum(axis=1))
        low = Excess(self._counts.sum(axis=1), self._scans * area).lower(target)
        rings = np.flatnonzero(low > MIN_RING_RATIO * density.min(axis=1))
        if not len(rings):
            return
        arcs = [(1, columns // parts) for parts in ARCS if columns >= parts]
        whole = window_sums(arcs, cells.whole[rings], self._grid.wraps)
        bounds = WindowBounds(arcs, cells.seen[rings], whole, self._grid.wraps, cells.widening)
        raised = bounds.moved(low[rings, None], self._counts[rings], self._scans, target)
        density[rings] = np.maximum(density[rings], raised)

    @cached_property
    def mean(self) -> float:
        """Mean density where clutter is seen, 1/m^2."""
        total = float(self._cells.seen.sum())
        if not total:
            return float(self.density.mean())
        return float((self.density * self._cells.seen).sum()) / total

    @cached_property
    def expected(self) -> BlockSums:
        """Sums of the numbers of clutter detections that are expected in each cell in a scan."""
        return BlockSums(self.density * self._cells.counted, self._grid.wraps)


class ClutterMap:
    """Estimates the clutter density over the coverage.

    The estimate begins with the mean density, ``(w + N) / (w / lambda_0 + n A)`` for N detections
    of clutter in n scans (both fading), the area A in which clutter is seen, and the data sheet's
    lambda_0 with the weight of w detections. Each size of window then bounds it; dense rings raise
    it. The density is estimated anew when a tenth of the remembered scans or of their detections is
    new; in between, all figures are those of the last estimate. A scan of so many detections that
    its own bound exceeds their mean number raises the density everywhere, as long as such scans
    last.

    Parameters
    ----------
    sensor : SensorModel
        Coverage, and initial density.

    Attributes
    ----------
    grid : PolarGrid
        Its cells.
    seen : SeenCells
        Where clutter is seen, as of the last estimate.
    """

    def __init__(self, sensor: SensorModel) -> None:
        self._sensor = sensor
        self.grid = PolarGrid(sensor)
        self._counts = np.zeros(self.grid.shape)
        self._scans = np.zeros(self.grid.shape[1])  # that looked at each column
        self._level = 1.0
        region, shares = (
            ClutterRegion.whole(ClutterExtent.of_sensor(sensor)),
            np.ones(len(self._scans)),
        )
        self.seen = SeenCells(self.grid, region, sensor.coverage_area, shares)
        self._renew(region)

    def at(self, cells: Cells) -> FloatArray:
        """Density in cells (n,), 1/m^2; see `PolarGrid.cells`."""
        return np.asarray(self._level * self._estimate.density[cells])

    @property
    def mean(self) -> float:
        """Mean density where clutter is seen, 1/m^2."""
        return self._level * self._estimate.mean

    @property
    def expected(self) -> BlockSums:
        """Numbers of clutter detections expected in the last scan."""
        sums = self._estimate.expected
        return sums if self._level == 1.0 else sums.scaled(self._level)

    def update(
        self,
        cells: Cells,
        weight: FloatArray,
        seen: SeenClutterExtent | None = None,
        min_area: float = 0.0,
        looks: FloatArray | float = 1.0,
    ) -> None:
        """Update the map with the detections of a scan, or of several.

        Parameters
        ----------
        cells : Cells
            Those of the detections (n,).
        weight : (n,) ndarray
            Probability that each detection is clutter.
        seen : SeenClutterExtent, optional
            Where clutter is seen, which counts when the density is estimated anew; by default where
            it was, at first in the whole coverage.
        min_area : float, optional
            Area in which one target may have been seen, m^2: clutter is assumed in no smaller one.
        looks : (c,) ndarray or float, optional
            Number of the scans that looked at each column.
        """
        scans = float(np.mean(looks))
        keep = (1.0 - 1.0 / MEMORY_SCANS) ** scans
        self._scans = keep * self._scans + looks
        self._counts *= keep
        np.add.at(self._counts, cells, weight)
        self._new += scans, weight.sum()
        enough = RENEWAL_SHARE * self._scans.mean(), RENEWAL_SHARE * self._counts.sum()
        before = self.seen
        if (self._new > enough).any() or self._area_of(before.region, min_area) != before.area:
            self._renew(seen.region if seen else before.region, min_area)

    def take_level(self, number: float, share: float = 1.0) -> None:
        """Take the level of a scan: by which factor clutter is denser than on average, at least 1.

        The bound of the scan's own mean count, ``low(N - 1)``, over the mean count of the scans
        that the density is estimated from: a squall, or a gain that was raised, shows at once.

        Parameters
        ----------
        number : float
            N, detections of clutter.
        share : float, optional
            Of the coverage, that the scan looked at.
        """
        low = poisson_bound(np.array(max(number - 1.0, 0.0)), -MAX_DEVIATIONS)
        self._level = max(float(low) / (share * self._estimate.number), 1.0)

    def _area_of(self, seen: ClutterRegion, min_area: float) -> float:
        """Area that counts as that in which clutter is seen, m^2."""
        return min(max(seen.area, min_area), self._sensor.coverage_area)

    def _renew(self, seen: ClutterRegion, min_area: float = 0.0) -> None:
        """Estimate the density anew."""
        area, scans = self._area_of(seen, min_area), float(self._scans.max())
        shares = self._scans / scans if scans else np.ones(len(self._scans))
        same = seen is self.seen.region and area == self.seen.area
        if not (same and np.array_equal(shares, self.seen.shares)):
            self.seen = SeenCells(self.grid, seen, area, shares)
        self._new = np.zeros(2)
        prior = max(self._sensor.clutter_density, MIN_CLUTTER_DENSITY)
        self._estimate = _MapEstimate(self._counts.copy(), scans, self.seen, self.grid, prior)

    @property
    def young(self) -> bool:
        """Whether the scans are so few that each is a tenth of them."""
        return bool(RENEWAL_SHARE * self._scans.mean() < 1.0)

    @property
    def memory(self) -> tuple[FloatArray, float]:
        """Counts by ring and column, and the number of scans; both fading."""
        return self._counts.copy(), float(self._scans.max())

    def remember(self, counts: FloatArray, scans: float, seen: ClutterRegion) -> None:
        """Begin with the memory of another map of the same cells, and where clutter was seen."""
        self._counts, self._scans = counts.copy(), np.full(len(self._scans), scans)
        self._renew(seen)

    def withdraw(self, cells: Cells, weight: FloatArray) -> None:
        """Remove weight of the last scan's detections, with effect from the next estimate on."""
        np.subtract.at(self._counts, cells, weight)
        self._counts[cells] = np.maximum(self._counts[cells], 0.0)
