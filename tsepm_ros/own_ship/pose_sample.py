"""One sample of own-ship data: where the vessel or its sensor was at a time."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.sensing.scan import LARGEST, checked_covariance


@dataclass(frozen=True)
class PoseSample:
    """A pose of the sensor, or of the vessel that it is mounted on, at a time.

    Attributes
    ----------
    stamp : float
        s.
    x, y, yaw : float
        Fixed frame, m and rad.
    covariance : (3, 3) ndarray or None
        Covariance of x, y, yaw; None if unknown.
    rates : (float, float, float) or None
        Velocity vx, vy (fixed frame, m/s) and yaw rate (rad/s); None, or nan one by one, if
        unknown: the difference of poses counts. See `known_rates` for a source's zeros.
    roll, pitch : float
        Attitude, rad, as in `tsepm_ros.own_ship.attitude`; 0 where the source does not know it.
    frame_id, child_frame_id : str
        The fixed frame, and that of the sensor or vessel; empty where the source names none.
    """

    stamp: float
    x: float
    y: float
    yaw: float
    covariance: FloatArray | None = None
    rates: tuple[float, float, float] | None = None
    roll: float = 0.0
    pitch: float = 0.0
    frame_id: str = ""
    child_frame_id: str = ""

    def check(self) -> None:
        """Check that a scan can be placed by this sample.

        Raises
        ------
        ValueError
            If it cannot; the message says why.
        """
        rates = self.rates or ()
        pose = (self.x, self.y, self.yaw, self.roll, self.pitch)
        if not math.isfinite(self.stamp):
            raise ValueError(f"stamp must be finite; got {self.stamp}")
        if not all(abs(value) <= LARGEST["sensor_pose"] for value in pose):
            raise ValueError(f"pose must be finite and on earth; got {pose}")
        if any(abs(rate) > LARGEST["sensor_velocity"] for rate in rates):
            raise ValueError(f"rates must be at most {LARGEST['sensor_velocity']:g}; got {rates}")
        if self.covariance is not None:
            checked_covariance("covariance", self.covariance)
            of_position = self.covariance[:2, :2]  # an unknown heading must not hide what it is
            if np.linalg.eigvalsh(of_position)[0] < -1e-9 * np.abs(of_position).max():
                raise ValueError("covariance of x and y must be positive semi-definite")


def known_rates(vx: float, vy: float, yaw_rate: float) -> tuple[float, float, float]:
    """Rates of a source, nan where it leaves them at 0: a message has no other way to say nothing.

    Velocity and yaw rate count each by itself, since a source may know one of them alone. Of a ship
    that is at rest, or does not turn, the poses say the same.
    """
    if not (vx or vy):
        vx = vy = math.nan
    return vx, vy, yaw_rate or math.nan
