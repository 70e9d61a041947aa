"""Clutter density, estimated from scan to scan on a polar grid that adapts.

The grid is that of Environment 2018's clutter zones, in levels: the whole coverage is one cell, and
each cell is divided into four of equal area, by range and azimuth. A cell's density is estimated
from its own detections and from the density of the cell around it, which counts as much as a fixed
number of detections: where there is little clutter the cells are in effect large, where there is
much they are small.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.evidence import LEAST_DENSITY
from tsepm_ros.sensor import SensorModel

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

LEVELS = 5
"""Levels of the grid: 4^(LEVELS - 1) cells on the finest."""
MEMORY = 50
"""Scans that count: older ones fade."""
SURROUNDINGS_COUNT = 5.0
"""Detections that the density of the cell around counts for."""
DATA_SHEET_COUNT = 1.0
"""Detections that the density of the data sheet counts for, in the whole coverage."""


class ClutterMap:
    """Estimates the clutter density over the coverage.

    With N detections of clutter in n scans (both fading), area A and the density lambda_0 of the
    cell around, worth w detections: ``lambda = (w + N) / (w / lambda_0 + n A)``, the mean of a
    gamma distribution after Poisson counts.

    Parameters
    ----------
    sensor : SensorModel
        Its coverage, and the density to begin with.
    """

    def __init__(self, sensor: SensorModel) -> None:
        self._sensor = sensor
        self._scans = 0.0
        self._counts = [np.zeros((2**level, 2**level)) for level in range(LEVELS)]
        self._density = self._estimate()

    def at(self, range: FloatArray, azimuth: FloatArray) -> FloatArray:
        """Density at positions in the sensor's frame, (n,), 1/m^2.

        Parameters
        ----------
        range, azimuth : (n,) ndarray
            m, rad. Outside the coverage the nearest cell counts.
        """
        row, column = self._cells(range, azimuth)
        return self._density[row, column]

    def update(self, range: FloatArray, azimuth: FloatArray, weight: FloatArray) -> None:
        """Take a scan's detections.

        Parameters
        ----------
        range, azimuth : (n,) ndarray
            m, rad.
        weight : (n,) ndarray
            Probability that each is clutter.
        """
        keep = 1.0 - 1.0 / MEMORY
        self._scans = keep * self._scans + 1.0
        row, column = self._cells(range, azimuth)
        for level, counts in enumerate(self._counts):
            shift = LEVELS - 1 - level
            counts *= keep
            np.add.at(counts, (row >> shift, column >> shift), weight)
        self._density = self._estimate()

    def _cells(self, range: FloatArray, azimuth: FloatArray) -> tuple[IntArray, IntArray]:
        """Row (by range) and column (by azimuth) of the finest cells."""
        sensor, size = self._sensor, 2 ** (LEVELS - 1)
        nearest, farthest = sensor.min_range**2, sensor.max_range**2
        ring = (np.square(range) - nearest) / (farthest - nearest)
        turned = np.remainder(azimuth - sensor.azimuth_min, 2.0 * np.pi) / sensor.sector_width
        row, column = (
            np.clip(part * size, 0, size - 1).astype(np.int64) for part in (ring, turned)
        )
        return row, column

    def _estimate(self) -> FloatArray:
        """Density of each of the finest cells, 1/m^2."""
        density = np.full((1, 1), max(self._sensor.clutter_density, LEAST_DENSITY))
        worth = DATA_SHEET_COUNT
        for level, counts in enumerate(self._counts):
            area = self._sensor.coverage_area / 4**level
            around = density.repeat(2 if level else 1, axis=0).repeat(2 if level else 1, axis=1)
            density = (worth + counts) / (worth / around + self._scans * area)
            worth = SURROUNDINGS_COUNT
        return np.maximum(density, LEAST_DENSITY)
