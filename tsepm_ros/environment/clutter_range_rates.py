"""The spread of clutter's range rates, learned from the scans."""

from __future__ import annotations

from collections import deque
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.sensing.range_rates import measured, over_ground
from tsepm_ros.sensing.sensor import SensorModel

MIN_RATE_COUNT = 20
"""Detections whose range rates tell clutter's: below, the given figure counts."""


MAX_CLUTTER_RANGE_RATE = 1e4
"""Median range rate of clutter that is taken, m/s."""


MEMORY = 50
"""Scans over which that is taken."""


class ClutterRangeRates:
    """The spread of clutter's range rates, learned from the last scans: nearly all is clutter."""

    def __init__(self) -> None:
        self._rates: deque[FloatArray] = deque(maxlen=MEMORY)

    def update(self, detections: NDArray[np.void]) -> None:
        """Take the range rates of a scan's detections, as far as they have any."""
        rated = detections[measured(detections)]
        if len(rated):
            self._rates.append(np.abs(over_ground(rated)))

    def estimate(self, sensor: SensorModel) -> SensorModel:
        """The sensor with the median of the range rates over ground as `clutter_range_rate`.

        With what is given, while there are fewer than `MIN_RATE_COUNT`.
        """
        found = np.concatenate(self._rates) if self._rates else np.zeros(0)
        if len(found) < MIN_RATE_COUNT:
            return sensor
        half = max(float(np.median(found)), 0.5 * sensor.range_rate_std)
        return replace(sensor, clutter_range_rate=min(half, MAX_CLUTTER_RANGE_RATE))
