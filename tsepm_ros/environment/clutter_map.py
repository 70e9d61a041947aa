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

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.environment.adaptive_windows import MAX_DEVIATIONS, bounded_root, poisson_bound
from tsepm_ros.environment.polar_grid import Cells, PolarGrid
from tsepm_ros.environment.ring_windows import raise_rings
from tsepm_ros.environment.seen_extent import Extent, Region
from tsepm_ros.environment.window_areas import CountedArea, CountedWindows, Windows
from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.sensing.sensor import MIN_CLUTTER_DENSITY, SensorModel

MEMORY = 50
"""Time constant, in scans, with which older scans fade."""
DATA_SHEET_COUNT = 0.5
"""Weight of the data sheet's density, as a number of detections: it may be anybody's guess."""
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
    Each size of window then bounds it, see `adaptive_windows`; dense rings raise it, see
    `ring_windows`. A scan of so many detections that
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
    area : float
        Area in which clutter is seen, m^2.
    """

    def __init__(self, sensor: SensorModel) -> None:
        self._sensor = sensor
        self._scans = 0.0
        self.area = sensor.coverage_area
        self.grid = PolarGrid(sensor)
        self._windows = Windows(self.grid)
        self._counts = np.zeros(self.grid.shape)
        self._level = 1.0
        self._seen = Region.whole(Extent.of(sensor))
        self._density: FloatArray | None = None
        self._see(self._seen, self.area)

    def fits(self, sensor: SensorModel) -> bool:
        """Whether the map has a sensor's coverage and initial density."""
        names = ("min_range", "max_range", "azimuth_min", "azimuth_max", "clutter_density")
        return all(getattr(sensor, name) == getattr(self._sensor, name) for name in names)

    def at(self, cells: Cells) -> FloatArray:
        """Density in cells (n,), 1/m^2; see `PolarGrid.cells`."""
        return np.asarray(self._level * self._densities[cells])

    @property
    def mean(self) -> float:
        """Mean density where clutter is seen, 1/m^2."""
        area = self._seen_area
        total = float(area.sum())
        if not total:
            return float(self._level * self._densities.mean())
        return self._level * float((self._densities * area).sum()) / total

    @property
    def counted_area(self) -> FloatArray:
        """Area in each cell in which clutter is expected, (r, c), m^2."""
        return self._counted_area

    @property
    def expected(self) -> FloatArray:
        """Number of clutter detections expected in each cell in a scan, (r, c)."""
        density = self._densities if self._level == 1.0 else self._level * self._densities
        return np.asarray(density * self._counted_area)

    def in_zone(self, cells: Cells) -> NDArray[np.bool_]:
        """Whether cells (n,) are in a clutter zone (Environment 2018, Section 2.1).

        A reading: the source counts plots per cell; in a zone, the counts of a cell and its
        neighbours exceed thresholds. It gives no thresholds, cells or number of scans, and a count
        grows with the cell's area and with the scans. Here the density, which `at` smooths over the
        neighbours, is more than `ZONE_FACTOR` times its mean.
        """
        return np.asarray(self.at(cells) > ZONE_FACTOR * self.mean)

    def update(
        self,
        cells: Cells,
        weight: FloatArray,
        seen: Region | None = None,
        min_area: float = 0.0,
    ) -> None:
        """Update the map with a scan's detections.

        Parameters
        ----------
        cells : Cells
            Those of the detections (n,).
        weight : (n,) ndarray
            Probability that each detection is clutter.
        seen : Region, optional
            Where clutter is seen; by default in the whole coverage.
        min_area : float, optional
            Area in which one target may have been seen, m^2: clutter is assumed in no smaller one.
        """
        seen = seen or self._seen
        area = min(max(seen.area, min_area), self._sensor.coverage_area)
        if seen is not self._seen or area != self.area:
            self._see(seen, area)
        keep = 1.0 - 1.0 / MEMORY
        self._scans = keep * self._scans + 1.0
        self._counts *= keep
        np.add.at(self._counts, cells, weight)
        self._level = self._level_of(float(weight.sum()))
        self._density = None

    def _see(self, seen: Region, area: float) -> None:
        """Take over where clutter is seen, and the area that this is at least, m^2.

        Where that is smaller than the area of one target, its parts count as larger.
        """
        self._seen, self.area = seen, area
        cell_area = self.grid.area
        self._seen_area = cell_area * seen.contains(*self.grid.middles)
        widening = max(area / seen.area, 1.0) if seen.area else 0.0
        counted = CountedArea(widening, MIN_SEEN_SHARE)
        counted_area = counted.of(self._seen_area, cell_area)
        self._counted_area = np.broadcast_to(counted_area, self.grid.shape)
        self._counted = CountedWindows(self._windows, self._seen_area, counted)

    def _level_of(self, number: float) -> float:
        """Factor by which clutter is denser in a scan of N detections than on average, at least 1.

        The bound of the scan's own mean count, ``low(N - 1)``, over the mean count of all scans: a
        squall, or a gain that was raised, shows at once.
        """
        mean = (DATA_SHEET_COUNT + self._counts.sum()) / (DATA_SHEET_COUNT + self._scans)
        low = poisson_bound(np.array(max(number - 1.0, 0.0)), -MAX_DEVIATIONS)
        return max(float(low / mean), 1.0)

    @property
    def begun(self) -> bool:
        """Whether a scan was learned from."""
        return self._scans > 0.0

    @property
    def memory(self) -> tuple[FloatArray, float]:
        """Counts by ring and column, and the number of scans; both fading."""
        return self._counts.copy(), self._scans

    def remember(self, counts: FloatArray, scans: float, seen: Region) -> None:
        """Begin with the memory of another map of the same cells, and where clutter was seen."""
        self._counts, self._scans = counts.copy(), scans
        self._see(seen, min(seen.area, self._sensor.coverage_area))
        self._density = None

    def withdraw(self, cells: Cells, weight: FloatArray) -> None:
        """Remove weight of the last scan's detections, with effect from the next update."""
        np.subtract.at(self._counts, cells, weight)
        self._counts[cells] = np.maximum(self._counts[cells], 0.0)

    @property
    def _densities(self) -> FloatArray:
        """Density of each cell, 1/m^2, as of the last update."""
        if self._density is None:
            self._density = self._estimate()
        return self._density

    def _estimate(self) -> FloatArray:
        """Density of each cell, 1/m^2."""
        weight, scans = DATA_SHEET_COUNT, self._scans
        prior = max(self._sensor.clutter_density, MIN_CLUTTER_DENSITY)
        overall = (weight + self._counts.sum()) / (weight / prior + scans * self.area)
        if not scans:
            return np.full(self.grid.shape, overall)
        target = min(scans + 2.0, MAX_TARGET_COUNT)
        root = bounded_root(self._counts, scans * overall, target, self._counted)
        raise_rings(root, self._counts, target, self._counted)
        np.multiply(root, root, out=root)
        root /= scans
        return np.maximum(root, MIN_CLUTTER_DENSITY, out=root)
