"""The part of the coverage in which clutter is seen: ranges and sector.

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

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from tsepm_ros.numerics.arrays import BoolArray, FloatArray
from tsepm_ros.tracker.scan import MAX_MAGNITUDE, wrap
from tsepm_ros.tracker.sensor import SensorModel

MAX_DETECTIONS = 500
"""Detections of the last scans whose extent counts, and the rest of the oldest of these scans."""
MIN_CLUTTER_PROBABILITY = 0.5
"""A detection less probably clutter does not count."""
MIN_DETECTIONS = 30
"""Detections from which on the extent is certain enough to be said."""


@dataclass(frozen=True)
class Extent:
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
    def of(cls, sensor: SensorModel) -> Extent:
        """A sensor's coverage as given."""
        end = sensor.azimuth_min + sensor.sector_width
        return cls(sensor.min_range, sensor.max_range, sensor.azimuth_min, end)

    @property
    def all_round(self) -> bool:
        """Whether it has every azimuth."""
        return self.azimuth_max - self.azimuth_min >= 2.0 * math.pi - 1e-9

    @property
    def area(self) -> float:
        """m^2."""
        width = self.azimuth_max - self.azimuth_min
        return 0.5 * width * (self.max_range**2 - self.min_range**2)


EVERYWHERE = Extent(0.0, MAX_MAGNITUDE["range"], -math.pi, math.pi)


@dataclass(frozen=True, eq=False)
class Region:
    """A convex part of an extent.

    Attributes
    ----------
    extent : Extent
    edges : (e, 3) ndarray
        ``edges @ (x, y, 1) <= 0`` inside, in the sensor's frame, m; without rows the whole extent.
    area : float
        m^2.
    """

    extent: Extent
    edges: FloatArray
    area: float

    @classmethod
    def whole(cls, extent: Extent) -> Region:
        """A whole extent."""
        return cls(extent, np.zeros((0, 3)), extent.area)

    def contains(self, range: FloatArray, azimuth: FloatArray) -> BoolArray:
        """Whether positions (...) in the sensor's frame are inside."""
        extent = self.extent
        turn = np.remainder(azimuth - extent.azimuth_min, 2.0 * np.pi)
        inside = turn <= extent.azimuth_max - extent.azimuth_min
        inside = inside & (range >= extent.min_range) & (range <= extent.max_range)
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


class SeenExtent:
    """Estimates the extent of what a sensor sees from the places of clutter.

    Parameters
    ----------
    limit : Extent
        The estimate does not exceed it.
    """

    def __init__(self, limit: Extent) -> None:
        self._limit = limit
        self._scans: deque[tuple[FloatArray, FloatArray]] = deque()
        self._number, self._renewed = 0, True
        self._region = Region.whole(limit)

    def update(self, range: FloatArray, azimuth: FloatArray, weight: FloatArray) -> None:
        """Update with a scan's detections; see `ClutterMap.update`."""
        clutter = np.flatnonzero(weight > MIN_CLUTTER_PROBABILITY)
        if not len(clutter):
            return
        # In an order of their own, and evenly from all of a large scan: the order in the message
        # does not matter.
        clutter = clutter[np.lexsort((range[clutter], azimuth[clutter]))]
        clutter = clutter[:: math.ceil(len(clutter) / MAX_DETECTIONS)]
        self._take(range[clutter], wrap(azimuth[clutter]))

    def remember(self, range: FloatArray, azimuth: FloatArray) -> None:
        """Begin with the `places` of another estimate: the newest, or each restart has more."""
        if len(range):
            self._take(range[-MAX_DETECTIONS:], azimuth[-MAX_DETECTIONS:])

    def _take(self, range: FloatArray, azimuth: FloatArray) -> None:
        self._scans.append((range, azimuth))
        self._number += len(range)
        while self._number - len(self._scans[0][0]) >= MAX_DETECTIONS:
            self._number -= len(self._scans.popleft()[0])
        self._renewed = self._number < 3

    @property
    def detections(self) -> int:
        """Number of detections that count."""
        return self._number

    @property
    def certain(self) -> bool:
        """Whether enough detections were seen to say the estimate."""
        return self.detections >= MIN_DETECTIONS

    @property
    def places(self) -> tuple[FloatArray, FloatArray]:
        """Range (m) and azimuth (rad) of the detections that count."""
        if not self._scans:
            return np.zeros(0), np.zeros(0)
        range_, azimuth = zip(*self._scans, strict=True)
        return np.concatenate(range_), np.concatenate(azimuth)

    @property
    def region(self) -> Region:
        """Where clutter is seen; the limit before the third detection. Estimated when asked for."""
        if not self._renewed:
            places = self.places
            self._region, self._renewed = self._convex(*places, self._estimated(*places)), True
        return self._region

    @property
    def estimate(self) -> Extent:
        """The extent of that region."""
        return self.region.extent

    def _estimated(self, range: FloatArray, azimuth: FloatArray) -> Extent:
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
        return Extent(
            math.sqrt(max(low, given.min_range**2)),
            math.sqrt(min(high, given.max_range**2)),
            start,
            end,
        )

    def _convex(self, range: FloatArray, azimuth: FloatArray, extent: Extent) -> Region:
        """The convex hull of the detections, as much larger as it is too small on average."""
        places = np.stack([range * np.cos(azimuth), range * np.sin(azimuth)], axis=1)
        try:
            hull = ConvexHull(places)
        except QhullError:  # too few, or in a line
            return Region.whole(extent)
        missing = len(hull.vertices) / len(range)
        area = hull.volume / (1.0 - missing) if missing < 1.0 else math.inf
        if area >= extent.area:
            return Region.whole(extent)
        edges = hull.equations.copy()
        # Every edge is moved away from the middle, by the same factor.
        middle = places[hull.vertices].mean(axis=0)
        at_middle = edges[:, :2] @ middle + edges[:, 2]
        edges[:, 2] += (math.sqrt(area / hull.volume) - 1.0) * at_middle
        return Region(extent, edges, float(area))


def _widened(low: float, high: float, number: int) -> tuple[float, float]:
    """Ends of an interval, from the least and the largest of uniform values in it."""
    beyond = (high - low) / (number - 1)
    return low - beyond, high + beyond
