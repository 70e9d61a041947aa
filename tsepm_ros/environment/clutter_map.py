"""Clutter density, estimated from scan to scan in windows of several sizes.

Detections are counted on a polar grid, as in Environment 2018's clutter zones; its rings widen with
range, as the errors of a sonar do. From coarse to fine, the density of a cell changes only as far
as the counts of the windows around it require (Lepski, "On a problem of adaptive estimation in
Gaussian white noise", Theory Probab. Appl. 35(3), 1991). For each size, the densest
window that holds the cell counts, as in a greatest-of CFAR (Hansen, "Constant false alarm rate
processing in search radars", IEE Radar, 1973). At the edge of clutter, a window across the edge
biases the density low exactly at the detections, which raises the scores of false tracks.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d

from tsepm_ros.environment.seen_extent import Extent, Region
from tsepm_ros.numerics.arrays import FloatArray, IntArray
from tsepm_ros.sensing.sensor import MIN_CLUTTER_DENSITY, SensorModel

CELL = 1.0 / 24.0
"""Width of a cell, rad, and its depth as a fraction of its range."""
INNER_RANGE = 100.0
"""Range within which the cells keep their depth, m."""
MIN_WINDOW_CELLS = 4
"""Cells along a side of the smallest window; each larger window is twice as wide."""
MEMORY = 50
"""Time constant, in scans, with which older scans fade."""
DATA_SHEET_COUNT = 0.5
"""Weight of the data sheet's density, as a number of detections: it may be anybody's guess."""
MAX_DEVIATIONS = 1.25
"""Standard deviations of a window's count within which the density stays unchanged."""
MIN_SEEN_SHARE = 0.1
"""Share of a window that counts as seen at least."""
ZONE_FACTOR = 3.0
"""Ratio of the density in a clutter zone to its mean over the coverage."""
MAX_TARGET_COUNT = 8.0
"""Detections in a window attributed to new targets: at most this, or two and one a scan."""


class ClutterMap:
    """Estimates the clutter density over the coverage.

    The estimate begins with the mean density, ``(w + N) / (w / lambda_0 + n A)`` for N detections
    of clutter in n scans (both fading), the area A in which clutter is seen, and the data sheet's
    lambda_0 with the weight of w detections.
    Each size of window then bounds it by ``[low(N - t), high(N)] / (n A)``, with t detections of an
    unknown target, and the score interval of a Poisson mean,
    ``N + c^2 / 2 -+ c sqrt(N + c^2 / 4)``. A scan of so many detections that its own bound exceeds
    their mean number raises the density everywhere, as long as such scans last.

    Parameters
    ----------
    sensor : SensorModel
        Coverage, and initial density.

    Attributes
    ----------
    area : float
        Area in which clutter is seen, m^2.
    """

    def __init__(self, sensor: SensorModel) -> None:
        self._sensor = sensor
        self._scans = 0.0
        self.area = sensor.coverage_area
        columns = max(round(sensor.sector_width / CELL), 1)
        self._width = sensor.sector_width / columns
        inner = max(sensor.min_range, min(INNER_RANGE, sensor.max_range / 10.0))
        rings = math.ceil(math.log(sensor.max_range / inner) / CELL)
        edges = np.geomspace(inner, sensor.max_range, rings + 1)
        self._edges = edges if inner == sensor.min_range else np.append(sensor.min_range, edges)
        self._counts = np.zeros((len(self._edges) - 1, columns))
        self._level = 1.0
        self._seen = Region.whole(Extent.of(sensor))
        self._seen_sums = self._sums_of_seen(self._seen)
        self._density: FloatArray | None = None

    def fits(self, sensor: SensorModel) -> bool:
        """Whether the map has a sensor's coverage and initial density."""
        names = ("min_range", "max_range", "azimuth_min", "azimuth_max", "clutter_density")
        return all(getattr(sensor, name) == getattr(self._sensor, name) for name in names)

    def at(self, range: FloatArray, azimuth: FloatArray) -> FloatArray:
        """Density at positions in the sensor's frame, (n,), 1/m^2.

        Parameters
        ----------
        range, azimuth : (n,) ndarray
            m, rad. Positions outside the coverage use the nearest cell.
        """
        return np.asarray(self._level * self._densities[self.cells(range, azimuth)])

    @property
    def mean(self) -> float:
        """Mean density where clutter is seen, 1/m^2."""
        area = np.diff(self._seen_sums, axis=0)
        if not area.any():
            return float(self._level * self._densities.mean())
        return float(self._level * np.average(self._densities, weights=area))

    @property
    def shape(self) -> tuple[int, int]:
        """Number of cells in range and in azimuth."""
        rows, columns = self._counts.shape
        return rows, columns

    @property
    def wraps(self) -> bool:
        """Whether the last column is next to the first."""
        return self._sensor.sector_width >= 2.0 * np.pi

    @property
    def expected(self) -> FloatArray:
        """Number of clutter detections expected in each cell in a scan, (r, c)."""
        seen = np.diff(self._seen_sums, axis=0)
        area = 0.5 * self._width * np.diff(self._edges**2)[:, None]
        return np.asarray(self._level * self._densities * self._counted(seen, area))

    def halfway(self, row: int) -> int:
        """The row from which on half of the area is that from a row on."""
        square = 0.5 * (self._edges[row] ** 2 + self._edges[-1] ** 2)
        return int(np.searchsorted(self._edges, np.sqrt(square)))

    def in_zone(self, range: FloatArray, azimuth: FloatArray) -> NDArray[np.bool_]:
        """Whether positions (n,) are in a clutter zone (Environment 2018, Section 2.1); see `at`.

        A reading: the source counts plots per cell; in a zone, the counts of a cell and its
        neighbours exceed thresholds. It gives no thresholds, cells or number of scans, and a count
        grows with the cell's area and with the scans. Here the density, which `at` smooths over the
        neighbours, is more than `ZONE_FACTOR` times its mean.
        """
        return np.asarray(self.at(range, azimuth) > ZONE_FACTOR * self.mean)

    def update(
        self,
        range: FloatArray,
        azimuth: FloatArray,
        weight: FloatArray,
        seen: Region | None = None,
        min_area: float = 0.0,
    ) -> None:
        """Update the map with a scan's detections.

        Parameters
        ----------
        range, azimuth : (n,) ndarray
            m, rad.
        weight : (n,) ndarray
            Probability that each detection is clutter.
        seen : Region, optional
            Where clutter is seen; by default in the whole coverage.
        min_area : float, optional
            Area in which one target may have been seen, m^2: clutter is assumed in no smaller one.
        """
        seen = seen or self._seen
        if seen is not self._seen:
            self._seen, self._seen_sums = seen, self._sums_of_seen(seen)
        self.area = min(max(seen.area, min_area), self._sensor.coverage_area)
        keep = 1.0 - 1.0 / MEMORY
        self._scans = keep * self._scans + 1.0
        self._counts *= keep
        np.add.at(self._counts, self.cells(range, azimuth), weight)
        self._level = self._level_of(float(weight.sum()))
        self._density = None

    def _level_of(self, number: float) -> float:
        """Factor by which clutter is denser in a scan of N detections than on average, at least 1.

        The bound of the scan's own mean count, ``low(N - 1)``, over the mean count of all scans: a
        squall, or a gain that was raised, shows at once.
        """
        mean = (DATA_SHEET_COUNT + self._counts.sum()) / (DATA_SHEET_COUNT + self._scans)
        low = poisson_bound(np.maximum(number - 1.0, 0.0), -MAX_DEVIATIONS)
        return max(float(low / mean), 1.0)

    @property
    def memory(self) -> tuple[FloatArray, float]:
        """Counts by ring and column, and the number of scans; both fading."""
        return self._counts.copy(), self._scans

    def remember(self, counts: FloatArray, scans: float, seen: Region) -> None:
        """Begin with the memory of another map of the same cells, and where clutter was seen."""
        self._counts, self._scans = counts.copy(), scans
        self._seen, self._seen_sums = seen, self._sums_of_seen(seen)
        self.area = min(seen.area, self._sensor.coverage_area)
        self._density = None

    def withdraw(self, range: FloatArray, azimuth: FloatArray, weight: FloatArray) -> None:
        """Remove weight of the last scan's detections, with effect from the next update."""
        np.subtract.at(self._counts, self.cells(range, azimuth), weight)
        np.maximum(self._counts, 0.0, out=self._counts)

    def cells(self, range: FloatArray, azimuth: FloatArray) -> tuple[IntArray, IntArray]:
        """Row (by range) and column (by azimuth) of the cells of positions (n,); see `at`."""
        rows, columns = self._counts.shape
        from_start = np.remainder(azimuth - self._sensor.azimuth_min, 2.0 * np.pi)
        row = np.clip(np.searchsorted(self._edges, range, side="right") - 1, 0, rows - 1)
        column = np.clip(from_start / self._width, 0, columns - 1).astype(np.int64)
        return row, column

    @property
    def _densities(self) -> FloatArray:
        """Density of each cell, 1/m^2, as of the last update."""
        if self._density is None:
            self._density = self._estimate()
        return self._density

    def _estimate(self) -> FloatArray:
        """Density of each cell, 1/m^2."""
        shape, weight = self._counts.shape, DATA_SHEET_COUNT
        prior = max(self._sensor.clutter_density, MIN_CLUTTER_DENSITY)
        overall = (weight + self._counts.sum()) / (weight / prior + self._scans * self.area)
        density = np.full(shape, overall)
        if not self._scans:
            return density
        target = min(self._scans + 2.0, MAX_TARGET_COUNT)
        seen_sums = self._seen_sums
        # Cumulative sums: the cost of a window does not depend on its size.
        sums = np.zeros((shape[0] + 1, shape[1]))
        np.cumsum(self._counts, axis=0, out=sums[1:])
        doublings = max(math.ceil(math.log2(max(shape) / MIN_WINDOW_CELLS)), 0)
        for doubling in reversed(range(doublings + 1)):
            side = MIN_WINDOW_CELLS * 2**doubling
            height, width = min(side, shape[0]), min(side, shape[1])
            whole = 0.5 * self._width * (self._edges[height:] ** 2 - self._edges[:-height] ** 2)
            seen = self._along_azimuth(seen_sums[height:] - seen_sums[:-height], width)
            exposure = self._scans * self._counted(seen, width * whole[:, None])
            count = self._along_azimuth(sums[height:] - sums[:-height], width)
            low = poisson_bound(np.maximum(count - target, 0.0), -MAX_DEVIATIONS) / exposure
            high = poisson_bound(count, MAX_DEVIATIONS) / exposure
            density = np.clip(
                density,
                self._densest_around(low, height, width),
                self._densest_around(high, height, width),
            )
        return np.asarray(np.maximum(density, MIN_CLUTTER_DENSITY))

    def _sums_of_seen(self, seen: Region) -> FloatArray:
        """Area of the cells in which clutter is seen, m^2, summed over the rings up to each."""
        area = 0.5 * self._width * np.diff(self._edges**2)[:, None]
        inside = seen.contains(*self._middles)
        return np.concatenate([np.zeros((1, inside.shape[1])), np.cumsum(area * inside, axis=0)])

    def _counted(self, seen: FloatArray, whole: FloatArray) -> FloatArray:
        """Area of windows (m^2) that counts: where clutter is seen, of theirs in it and in all.

        Where that is smaller in sum than the area of one target, the parts count as larger.
        """
        if not self._seen.area:
            return whole
        widening = max(self.area / self._seen.area, 1.0)
        return np.clip(widening * seen, MIN_SEEN_SHARE * whole, whole)

    @property
    def _middles(self) -> tuple[FloatArray, FloatArray]:
        """Range and azimuth of the middle of each cell, (r, 1) and (1, c)."""
        columns = np.arange(self._counts.shape[1])
        square = 0.5 * (self._edges[1:] ** 2 + self._edges[:-1] ** 2)
        range_ = np.asarray(np.sqrt(square), np.float64)
        azimuth = np.asarray(self._sensor.azimuth_min + self._width * (columns + 0.5), np.float64)
        return range_[:, None], azimuth[None, :]

    def _wraps(self, width: int) -> bool:
        """Whether windows of a width wrap around in azimuth."""
        return self.wraps and width < self._counts.shape[1]

    def _along_azimuth(self, sums: FloatArray, width: int) -> FloatArray:
        """Sums over each run of `width` columns."""
        if self._wraps(width):
            sums = np.pad(sums, ((0, 0), (0, width - 1)), mode="wrap")
        total = np.pad(np.cumsum(sums, axis=1), ((0, 0), (1, 0)))
        return np.maximum(total[:, width:] - total[:, :-width], 0.0)  # rounding errors

    def _densest_around(self, values: FloatArray, height: int, width: int) -> FloatArray:
        """The largest value of the windows that hold each cell."""
        # Row by row first: a maximum over both axes is one over each, and most are fewer columns.
        around = np.pad(values, ((height - 1, height - 1), (0, 0)), constant_values=-np.inf)
        rows, columns = self._counts.shape
        around = maximum_filter1d(around, height, axis=0, mode="nearest")[height // 2 :][:rows]
        if self._wraps(width):
            around = np.pad(around, ((0, 0), (width - 1, 0)), mode="wrap")
        else:
            around = np.pad(around, ((0, 0), (width - 1, width - 1)), constant_values=-np.inf)
        largest: FloatArray = maximum_filter1d(around, width, axis=1, mode="nearest")
        return largest[:, width // 2 :][:, :columns]


def poisson_bound(count: FloatArray, deviations: float) -> FloatArray:
    """Bound of a Poisson mean at a distance of `deviations` standard deviations from the count.

    The root of ``(N - m)^2 = c^2 m`` (Wilson's interval, for counts).
    """
    half = deviations**2 / 2.0
    bound: FloatArray = count + half + deviations * np.sqrt(count + half / 2.0)
    return bound
