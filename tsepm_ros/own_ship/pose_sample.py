"""One sample of own-ship data: the pose of the vessel or its sensor at a time."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.sensing.scan import MAX_MAGNITUDE, checked_covariance


@dataclass(frozen=True)
class PoseSample:
    """Pose of the sensor, or of its vessel, at a time.

    Attributes
    ----------
    stamp : float
        s.
    x, y, yaw : float
        Fixed frame, m and rad.
    covariance : (3, 3) ndarray or None
        Covariance of x, y, yaw; None if unknown.
    rates : (float, float, float) or None
        Velocity vx, vy (fixed frame, m/s) and yaw rate (rad/s); None if all are unknown, nan for
        an unknown component: differences of poses replace them. `known_rates` treats zeros.
    roll, pitch : float
        Attitude, rad, as in `tsepm_ros.own_ship.attitude`; 0 if unknown.
    frame_id, child_frame_id : str
        The fixed frame, and the frame of the sensor or vessel; empty if unnamed.
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
        """Check that the sample is usable for registration.

        Raises
        ------
        ValueError
            If it is not; the message names the value.
        """
        rates = self.rates or ()
        pose = (self.x, self.y, self.yaw, self.roll, self.pitch)
        if not math.isfinite(self.stamp):
            raise ValueError(f"stamp must be finite; got {self.stamp}")
        if not all(abs(value) <= MAX_MAGNITUDE["sensor_pose"] for value in pose):
            raise ValueError(f"pose must be finite and on earth; got {pose}")
        if any(abs(rate) > MAX_MAGNITUDE["sensor_velocity"] for rate in rates):
            raise ValueError(
                f"rates must be at most {MAX_MAGNITUDE['sensor_velocity']:g}; got {rates}"
            )
        if self.covariance is not None:
            checked_covariance("covariance", self.covariance)
            position = self.covariance[:2, :2]  # a large heading variance must not hide its error
            if np.linalg.eigvalsh(position)[0] < -1e-9 * np.abs(position).max():
                raise ValueError("covariance of x and y must be positive semi-definite")


def known_rates(vx: float, vy: float, yaw_rate: float) -> tuple[float, float, float]:
    """Replace zero rates by nan: Odometry cannot mark a rate unknown.

    Velocity and yaw rate are treated separately, since a source may provide only one of them. For a
    ship at rest, or on a straight course, the differences of poses give the same rates.
    """
    if not (vx or vy):
        vx = vy = math.nan
    return vx, vy, yaw_rate or math.nan
