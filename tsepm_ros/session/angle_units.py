"""Questions about angles that look like degrees; no value is converted."""

from __future__ import annotations

import math

from tsepm_ros.own_ship.mounting import Mounting
from tsepm_ros.own_ship.registration import SensorScan
from tsepm_ros.sensing.sensor import SensorModel
from tsepm_ros.session.refusal import Notice

MAX_LIKELY_STD = 0.2
"""Standard deviation of an azimuth, rad (11 degrees), beyond which it looks like degrees."""
MAX_LIKELY_RESOLUTION = 0.8
"""Width of a beam, rad (46 degrees), beyond which it looks like degrees."""
MAX_LIKELY_YAW = 3.2
"""Yaw of a mounting, rad (half a turn), beyond which it looks like degrees."""
MIN_ANGLES = 20
"""Angles after which they are judged."""
LIKELY_SHARE = 0.5
"""Share of the angles beyond a turn above which they look like degrees."""


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


class AngleUnits:
    """Judges the unit of a driver's angles by those beyond a full turn."""

    def __init__(self) -> None:
        self._angles = 0
        self._beyond = 0
        self._asked = False

    def judge(self, arrived: SensorScan) -> Notice | None:
        """Count the angles of a scan; return the question, once, if most are beyond a turn."""
        if self._asked:
            return None
        self._angles += len(arrived.scan)
        self._beyond += arrived.beyond_turn
        if self._angles < MIN_ANGLES or self._beyond <= LIKELY_SHARE * self._angles:
            return None
        self._asked = True
        return Notice(
            "degrees",
            f"{self._beyond} of {self._angles} azimuths or bearings are beyond 2 pi: are they in "
            "degrees? They are read as radians; the driver must send radians (degrees * pi / 180)",
        )
