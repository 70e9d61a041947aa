"""Questions about parameters that look like degrees; no value is converted."""

from __future__ import annotations

import math

from tsepm_ros.own_ship.mounting import Mounting
from tsepm_ros.sensing.sensor import SensorModel

MAX_LIKELY_STD = 0.2
"""Standard deviation of an azimuth, rad (11 degrees), beyond which it looks like degrees."""
MAX_LIKELY_RESOLUTION = 0.8
"""Width of a beam, rad (46 degrees), beyond which it looks like degrees."""
MAX_LIKELY_YAW = 3.2
"""Yaw of a mounting, rad (half a turn), beyond which it looks like degrees."""


def questions(sensor: SensorModel, mounting: Mounting) -> list[str]:
    """Questions about parameters in radians that look like degrees, a sentence each."""
    return [
        f"{name} is {value:g} rad, which is {math.degrees(value):.0f} degrees: if {value:g} "
        f"degrees are meant, set {math.radians(value):.4g}"
        for name, value, limit in (
            ("sensor.azimuth_std", sensor.azimuth_std, MAX_LIKELY_STD),
            ("sensor.azimuth_resolution", sensor.azimuth_resolution, MAX_LIKELY_RESOLUTION),
            ("mounting.yaw", mounting.yaw, MAX_LIKELY_YAW),
        )
        if abs(value) > limit
    ]
