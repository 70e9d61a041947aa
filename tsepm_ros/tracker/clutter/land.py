"""A chart: cells of the fixed frame that are land, where no detection is a target's."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from tsepm_ros.numerics.arrays import BoolArray, FloatArray
from tsepm_ros.tracker.scan import Scan

MAX_CELLS = 100_000_000
"""Largest number of cells: 12.5 MB are kept of them."""
MIN_RESOLUTION, MAX_RESOLUTION = 1e-3, 1e6
"""Smallest and largest side of a cell, m."""
MAX_DISTANCE = 1e9
"""Largest coordinate of a chart, m."""


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
        place = row[inside].astype(np.int64) * self._columns + column[inside].astype(np.int64)
        on_land = np.zeros(len(positions), bool)
        on_land[inside] = (self._bits[place >> 3] >> (7 - (place & 7)).astype(np.uint8)) & 1
        return on_land


def afloat(scan: Scan, land: LandMask | None) -> BoolArray:
    """Which detections (n,) of a scan are not on land, as measured."""
    if land is None:
        return np.ones(len(scan), bool)
    pose = np.broadcast_to(scan.sensor_pose, (len(scan), 3))
    angle = scan.azimuth + pose[:, 2]
    offset = scan.range[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return ~land.covers(pose[:, :2] + offset)
