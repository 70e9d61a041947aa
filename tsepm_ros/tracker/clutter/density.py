"""Clutter density, estimated in windows of several sizes and learned from scan to scan.

Detections are counted on a polar grid, as in Environment 2018's clutter zones; its rings widen with
range, as the errors of a sonar do. From coarse to fine, the density of a cell changes only as far
as the counts of the windows around it require (Lepski, "On a problem of adaptive estimation in
Gaussian white noise", Theory Probab. Appl. 35(3), 1991). For each size, the densest
window that holds the cell counts, as in a greatest-of CFAR (Hansen, "Constant false alarm rate
processing in search radars", IEE Radar, 1973). At the edge of clutter, a window across the edge
biases the density low exactly at the detections, which raises the scores of false tracks.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.tracker.clutter.polar_grid import Cells, PolarGrid
from tsepm_ros.tracker.clutter.seen_extent import Extent, Region
from tsepm_ros.tracker.clutter.windows import (
    MAX_DEVIATIONS,
    CountedArea,
    CountedWindows,
    Windows,
    bounded_root,
    poisson_bound,
    raise_rings,
)
from tsepm_ros.tracker.sensor import MIN_CLUTTER_DENSITY, SensorModel

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
RENEWAL = 0.1
"""Share of new scans, or of new detections, from which on the density is estimated anew."""


class _SeenCells:
    """The area of each cell in which clutter is seen.

    Where clutter is seen in less than the area of one target, its parts count as larger.

    Parameters
    ----------
    windows : Windows
    region : Region
        Where clutter is seen.
    area : float
        Area of that region, or of one target if larger, m^2.

    Attributes
    ----------
    region, area
        As given.
    seen : (r, c) ndarray
        m^2.
    counted : (r, c) ndarray
        Area in which clutter is expected, m^2.
    windows : CountedWindows
    """

    def __init__(self, windows: Windows, region: Region, area: float) -> None:
        self.region, self.area = region, area
        grid = windows.grid
        self.seen = grid.area * region.contains(*grid.middles)
        widening = max(area / region.area, 1.0) if region.area else 0.0
        counted = CountedArea(widening, MIN_SEEN_SHARE)
        self.counted = np.broadcast_to(counted.of(self.seen, grid.area), grid.shape)
        self.windows = CountedWindows(windows, self.seen, counted)


class _Estimate:
    """The density by the counts of some scans, computed where it is asked for.

    Parameters
    ----------
    counts : (r, c) ndarray
    scans : float
    cells : _SeenCells
    prior : float
        Density of the data sheet, 1/m^2.

    Attributes
    ----------
    number : float
        Mean number of detections in a scan.
    """

    def __init__(self, counts: FloatArray, scans: float, cells: _SeenCells, prior: float) -> None:
        self._counts, self._scans, self._cells, self._prior = counts, scans, cells, prior
        self.number = (DATA_SHEET_COUNT + float(counts.sum())) / (DATA_SHEET_COUNT + scans)

    @cached_property
    def density(self) -> FloatArray:
        """Density of each cell, (r, c), 1/m^2."""
        weight, counts, scans = DATA_SHEET_COUNT, self._counts, self._scans
        overall = (weight + counts.sum()) / (weight / self._prior + scans * self._cells.area)
        if not scans:
            return np.full(counts.shape, overall)
        target, windows = min(scans + 2.0, MAX_TARGET_COUNT), self._cells.windows
        root = bounded_root(counts, scans * overall, target, windows)
        raise_rings(root, counts, target, windows)
        np.multiply(root, root, out=root)
        root /= scans
        return np.maximum(root, MIN_CLUTTER_DENSITY, out=root)

    @cached_property
    def mean(self) -> float:
        """Mean density where clutter is seen, 1/m^2."""
        total = float(self._cells.seen.sum())
        if not total:
            return float(self.density.mean())
        return float((self.density * self._cells.seen).sum()) / total

    @cached_property
    def expected(self) -> FloatArray:
        """Number of clutter detections expected in each cell in a scan, (r, c)."""
        return np.asarray(self.density * self._cells.counted)


class ClutterMap:
    """Estimates the clutter density over the coverage.

    The estimate begins with the mean density, ``(w + N) / (w / lambda_0 + n A)`` for N detections
    of clutter in n scans (both fading), the area A in which clutter is seen, and the data sheet's
    lambda_0 with the weight of w detections.
    Each size of window then bounds it, see `adaptive_windows`; dense rings raise it, see
    `ring_windows`. The density is estimated anew when a tenth of the remembered scans or of their
    detections is new; in between, all figures are those of the last estimate. A scan of so many
    detections that its own bound exceeds their mean number raises the density everywhere, as long
    as such scans last.

    Parameters
    ----------
    sensor : SensorModel
        Coverage, and initial density.

    Attributes
    ----------
    grid : PolarGrid
        Its cells.
    """

    def __init__(self, sensor: SensorModel) -> None:
        self._sensor = sensor
        self.grid = PolarGrid(sensor)
        self._windows = Windows(self.grid)
        self._cells = _SeenCells(
            self._windows, Region.whole(Extent.of(sensor)), sensor.coverage_area
        )
        self._counts = np.zeros(self.grid.shape)
        self._scans = 0.0
        self._new_scans, self._new = 0, 0.0
        self._level = 1.0
        self._estimate = self._estimated()

    def fits(self, sensor: SensorModel) -> bool:
        """Whether the map has a sensor's coverage and initial density."""
        names = ("min_range", "max_range", "azimuth_min", "azimuth_max", "clutter_density")
        return all(getattr(sensor, name) == getattr(self._sensor, name) for name in names)

    def at(self, cells: Cells) -> FloatArray:
        """Density in cells (n,), 1/m^2; see `PolarGrid.cells`."""
        return np.asarray(self._level * self._estimate.density[cells])

    @property
    def mean(self) -> float:
        """Mean density where clutter is seen, 1/m^2."""
        return self._level * self._estimate.mean

    @property
    def seen(self) -> Region:
        """Where clutter is seen, as of the last estimate."""
        return self._cells.region

    @property
    def area(self) -> float:
        """Area in which clutter is seen, m^2."""
        return self._cells.area

    @property
    def counted_area(self) -> FloatArray:
        """Area in each cell in which clutter is expected, (r, c), m^2."""
        return self._cells.counted

    @property
    def expected(self) -> FloatArray:
        """Number of clutter detections expected in each cell in a scan, (r, c)."""
        expected = self._estimate.expected
        return expected if self._level == 1.0 else self._level * expected

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
        seen: Callable[[], Region] | None = None,
        min_area: float = 0.0,
    ) -> None:
        """Update the map with a scan's detections.

        Parameters
        ----------
        cells : Cells
            Those of the detections (n,).
        weight : (n,) ndarray
            Probability that each detection is clutter.
        seen : callable, optional
            Where clutter is seen, asked for when the density is estimated anew; by default where
            it was, at first in the whole coverage.
        min_area : float, optional
            Area in which one target may have been seen, m^2: clutter is assumed in no smaller one.
        """
        keep, number = 1.0 - 1.0 / MEMORY, float(weight.sum())
        self._scans = keep * self._scans + 1.0
        self._counts *= keep
        np.add.at(self._counts, cells, weight)
        self._new_scans, self._new = self._new_scans + 1, self._new + number
        enough = RENEWAL * self._scans, RENEWAL * float(self._counts.sum())
        has_enough = self._new_scans > enough[0] or self._new > enough[1]
        if has_enough or self._area_of(self.seen, min_area) != self.area:
            self._renew(seen() if seen else self.seen, min_area)
        self._level = self._level_of(number)

    def _area_of(self, seen: Region, min_area: float) -> float:
        """Area that counts as that in which clutter is seen, m^2."""
        return min(max(seen.area, min_area), self._sensor.coverage_area)

    def _renew(self, seen: Region, min_area: float = 0.0) -> None:
        """Estimate the density anew."""
        area = self._area_of(seen, min_area)
        if seen is not self.seen or area != self.area:
            self._cells = _SeenCells(self._windows, seen, area)
        self._new_scans, self._new = 0, 0.0
        self._estimate = self._estimated()

    def _estimated(self) -> _Estimate:
        """The estimate by the present counts."""
        prior = max(self._sensor.clutter_density, MIN_CLUTTER_DENSITY)
        return _Estimate(self._counts.copy(), self._scans, self._cells, prior)

    def _level_of(self, number: float) -> float:
        """Factor by which clutter is denser in a scan of N detections than on average, at least 1.

        The bound of the scan's own mean count, ``low(N - 1)``, over the mean count of the scans
        that the density is estimated from: a squall, or a gain that was raised, shows at once.
        """
        low = poisson_bound(np.array(max(number - 1.0, 0.0)), -MAX_DEVIATIONS)
        return max(float(low) / self._estimate.number, 1.0)

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
        self._renew(seen)

    def withdraw(self, cells: Cells, weight: FloatArray) -> None:
        """Remove weight of the last scan's detections, with effect from the next estimate on."""
        np.subtract.at(self._counts, cells, weight)
        self._counts[cells] = np.maximum(self._counts[cells], 0.0)
