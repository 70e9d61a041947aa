"""Echoes on both sides of the seam, where one turn of a sweep ends and the next begins.

A target that lies across the seam is seen by the last beams of a turn and by the first of the next.
Its echoes follow each other without a pause: they all belong to the turn that ends.
"""

from __future__ import annotations

import math

import numpy as np

from tsepm_ros.numerics.arrays import BoolArray, FloatArray
from tsepm_ros.own_ship.registration import SensorScan
from tsepm_ros.sensing.sensor import SensorModel

LINKED_STEPS = 2.5
"""Steps of the beam within which echoes follow each other."""
WIDEST_BEAM = math.radians(5.0)
"""Azimuth after the seam up to which echoes belong before it, where no resolution is given, rad."""
DEVIATIONS = 3.0
"""Standard deviations of the difference of two ranges up to which they are of one target."""


class SeamEchoes:
    """Follows echoes from the end of a turn over the seam.

    Parameters
    ----------
    sensor : SensorModel
        Resolution and errors say how far apart the echoes of one target are.
    target_extent : float
        m.
    step : float
        Step of the beam, rad.
    """

    def __init__(self, sensor: SensorModel, target_extent: float, step: float) -> None:
        self._sensor = sensor
        self._extent = target_extent
        self._reach = max(LINKED_STEPS * step, sensor.azimuth_resolution)
        self._limit = max(WIDEST_BEAM, sensor.azimuth_resolution)
        self._beam: FloatArray = np.zeros(0)
        self._range: FloatArray = np.zeros(0)

    def add(self, beam: float, message: SensorScan) -> None:
        """Note the echoes of a message before the seam, at an azimuth after it (below 0), rad."""
        if -beam <= self._reach:
            self._note(beam, message.scan.range)

    def take(self, beam: float, message: SensorScan) -> BoolArray:
        """Which detections (n,) of a message after the seam, at an azimuth (rad), belong before."""
        if beam > self._limit:
            return np.zeros(len(message.scan), bool)
        chain = self._range[np.abs(beam - self._beam) <= self._reach]
        apart = np.abs(message.scan.range[:, None] - chain)
        before = np.asarray((apart <= self._reaches(message.scan.range)[:, None]).any(axis=1))
        self._note(beam, message.scan.range[before])
        return before

    def ends(self, beam: float) -> bool:
        """Whether no echo at an azimuth after the seam, rad, can belong before it any more."""
        return beam > self._limit or not (beam - self._beam <= self._reach).any()

    def _note(self, beam: float, range: FloatArray) -> None:
        self._beam = np.append(self._beam, np.full(len(range), beam))
        self._range = np.append(self._range, range)

    def _reaches(self, range: FloatArray) -> FloatArray:
        """How far apart ranges of one target are at the most, (n,), m."""
        deviation = math.sqrt(2.0) * np.sqrt(self._sensor.range_variance(range))
        resolved = self._sensor.range_resolution + self._extent
        return np.maximum(DEVIATIONS * deviation, resolved)
