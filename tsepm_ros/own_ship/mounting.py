"""Mounting of the sensor on the vessel."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.own_ship.attitude import ahead_and_port
from tsepm_ros.parameters import check_group, parameter


@dataclass(frozen=True, kw_only=True)
class Mounting:
    """Position and yaw of the sensor in the vessel's frame (REP-103): used with odometry alone.

    Raises
    ------
    ValueError
        Naming the option whose value is not allowed.
    """

    x: float = parameter(
        0.0,
        "Position of the sensor ahead of the origin of the vessel's frame; only with odometry",
        unit="m",
        minimum=-1000.0,
        maximum=1000.0,
    )
    y: float = parameter(
        0.0,
        "Position of the sensor to port of the origin of the vessel's frame; only with odometry",
        unit="m",
        minimum=-1000.0,
        maximum=1000.0,
    )
    yaw: float = parameter(
        0.0,
        "Direction of the sensor's azimuth 0, counter-clockwise from the vessel's bow; "
        "only with odometry",
        unit="rad",
        minimum=-2 * math.pi,
        maximum=2 * math.pi,
    )
    roll: float = parameter(
        0.0,
        "Roll of the sensor about its azimuth 0: 3.1416 for a sensor that hangs upside down; "
        "only with odometry",
        unit="rad",
        minimum=-3.1416,
        maximum=3.1416,
    )

    def __post_init__(self) -> None:
        check_group(self)

    @property
    def offset(self) -> bool:
        """Whether the sensor is away from the vessel's origin and its heading moves the sensor."""
        return bool(self.x or self.y)

    @property
    def given(self) -> bool:
        """Whether the sensor's pose differs from the vessel's."""
        return self.offset or self.yaw != 0.0 or self.roll != 0.0

    def sensor_poses(self, vessel: FloatArray) -> FloatArray:
        """Poses of the sensor: ``p + Rz(yaw) Ry(pitch) Rx(roll) (x, y, 0)``, yaw + mounting yaw.

        Parameters
        ----------
        vessel : (n, 5) ndarray
            x, y, yaw, roll, pitch of the vessel, m and rad.

        Returns
        -------
        (n, 3) ndarray
            x, y, yaw of the sensor.
        """
        if not self.given:
            return vessel[:, :3]
        yaw, roll, pitch = vessel[:, 2:].T
        along, across, up = np.full((len(yaw), 3), (self.x, self.y, 0.0)).T
        ahead, port = ahead_and_port(along, across, up, roll, pitch)
        cosine, sine = np.cos(yaw), np.sin(yaw)
        east, north = cosine * ahead - sine * port, sine * ahead + cosine * port
        return vessel[:, :3] + np.stack([east, north, np.full(len(yaw), self.yaw)], axis=1)


def sensor_covariance(covariance: FloatArray, arm: FloatArray) -> FloatArray:
    """Covariance of the sensor's pose, from the vessel's.

    An error of the heading moves the sensor at the end of the lever arm ``a = (a_x, a_y)``::

        J C J',  J = [[1, 0, -a_y], [0, 1, a_x], [0, 0, 1]]

    Parameters
    ----------
    covariance : (3, 3) ndarray
        C, covariance of the vessel's x, y and yaw.
    arm : (2,) ndarray
        Vector from the vessel's origin to the sensor, in the axes of the fixed frame, m.

    Returns
    -------
    (3, 3) ndarray
        Covariance of the sensor's x, y and yaw.
    """
    jacobian = np.eye(3)
    jacobian[:2, 2] = -arm[1], arm[0]
    return jacobian @ covariance @ jacobian.T
