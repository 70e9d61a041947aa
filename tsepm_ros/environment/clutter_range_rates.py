"""The width of the distribution of clutter's range rates, learned from the scans."""

from __future__ import annotations

from collections import deque
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.numerics.rows import taken
from tsepm_ros.sensing.range_rates import measured, over_ground
from tsepm_ros.sensing.sensor import SensorModel

MIN_RATE_COUNT = 20
"""Smallest number of range rates for an estimate: below, the given width is used."""
MAX_CLUTTER_RANGE_RATE = 1e4
"""Largest estimate of the median magnitude of clutter's range rates, m/s."""
MEMORY = 50
"""Number of latest scans in the estimate."""


class ClutterRangeRates:
    """Estimates the median magnitude of clutter's range rates: most detections are clutter."""

    def __init__(self) -> None:
        self._rates: deque[FloatArray] = deque(maxlen=MEMORY)

    def update(self, detections: NDArray[np.void]) -> None:
        """Update the estimate with the range rates of a scan's detections."""
        rated = taken(detections, measured(detections))
        if len(rated):
            self._rates.append(np.abs(over_ground(rated)))

    def estimate(self, sensor: SensorModel) -> SensorModel:
        """The sensor with the median magnitude over ground as `clutter_range_rate`.

        With fewer than `MIN_RATE_COUNT` range rates the sensor is returned unchanged.
        """
        rates = np.concatenate(self._rates) if self._rates else np.zeros(0)
        if len(rates) < MIN_RATE_COUNT:
            return sensor
        width = max(float(np.median(rates)), 0.5 * sensor.range_rate_std)
        return replace(sensor, clutter_range_rate=min(width, MAX_CLUTTER_RANGE_RATE))
