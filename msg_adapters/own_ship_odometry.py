"""The own ship's pose and motion in nav_msgs/Odometry."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from msg_adapters.errors import MessageError
from msg_adapters.odometry_covariance import (
    UNOBSERVED_VARIANCE,
    YAW,
    X,
    Y,
    limited,
    odometry_covariance,
)
from msg_adapters.stamps import make_header, time_to_ns
from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.own_ship.attitude import angles_of, rotation_of

if TYPE_CHECKING:
    from nav_msgs.msg import Odometry


@dataclass(frozen=True, eq=False)
class OwnShipSample:
    """Pose and motion of the own ship at one time.

    Attributes
    ----------
    stamp_ns : int
        ns.
    frame_id, child_frame_id : str
        The fixed frame and the vessel's.
    x, y : float
        Position in the fixed frame, m.
    yaw, roll, pitch : float
        Orientation, rad: the fixed axes turned by yaw about z, then pitch about y, then roll
        about x are the vessel's (REP-103: x ahead, y to port, z up).
    vx, vy : float
        Velocity in the axes of the fixed frame, m/s.
    yaw_rate : float
        Rate of the yaw, rad/s.
    pose_covariance : (3, 3) ndarray or None
        Covariance of (x, y, yaw), m and rad; None where it is not known.
    """

    stamp_ns: int
    frame_id: str
    child_frame_id: str
    x: float
    y: float
    yaw: float
    roll: float = 0.0
    pitch: float = 0.0
    vx: float = 0.0
    vy: float = 0.0
    yaw_rate: float = 0.0
    pose_covariance: FloatArray | None = None


def read_own_ship(message: Odometry) -> OwnShipSample:
    """Read the own ship's odometry.

    The message has its twist in the child frame: it is turned into the fixed frame by the full
    orientation. A quaternion need not be of unit length. A covariance that is all zero means, as
    usual in ROS, that it is not known. A variance beyond `LARGEST_VARIANCE`, of a source that
    writes a huge number for what it does not know, is read as `LARGEST_VARIANCE`.

    Parameters
    ----------
    message : nav_msgs.msg.Odometry

    Returns
    -------
    OwnShipSample

    Raises
    ------
    MessageError
        If a value that is used is not finite, the quaternion is zero, the vessel points straight
        up or down, or the covariance of x, y and yaw is not positive semi-definite.
    """
    pose, twist = message.pose.pose, message.twist.twist
    x, y = _finite("pose.position", pose.position, "xy")
    rotation = _rotation(_finite("pose.orientation", pose.orientation, "xyzw"))
    linear = _finite("twist.linear", twist.linear, "xyz")
    angular = _finite("twist.angular", twist.angular, "xyz")
    yaw, pitch, roll = _angles(rotation)
    vx, vy, _ = (float(value) for value in rotation @ linear)
    _, rate_y, rate_z = angular
    return OwnShipSample(
        stamp_ns=time_to_ns(message.header.stamp),
        frame_id=message.header.frame_id,
        child_frame_id=message.child_frame_id,
        x=x,
        y=y,
        yaw=yaw,
        roll=roll,
        pitch=pitch,
        vx=vx,
        vy=vy,
        yaw_rate=(rate_y * math.sin(roll) + rate_z * math.cos(roll)) / math.cos(pitch),
        pose_covariance=_pose_covariance(message.pose.covariance),
    )


def _finite(name: str, vector: Any, components: str) -> list[float]:
    """Return components of a vector message."""
    values = [float(getattr(vector, component)) for component in components]
    for component, value in zip(components, values, strict=True):
        if not math.isfinite(value):
            raise MessageError("not_finite", f"{name}.{component} must be finite; got {value}")
    return values


def _rotation(quaternion: list[float]) -> FloatArray:
    """Return the matrix that turns vectors of the child frame into the fixed frame."""
    try:
        return rotation_of(quaternion)
    except ValueError as error:
        raise MessageError("zero_quaternion", f"pose.orientation {error}") from None


def _angles(rotation: FloatArray) -> tuple[float, float, float]:
    """Return yaw, pitch and roll."""
    try:
        return angles_of(rotation)
    except ValueError as error:
        raise MessageError("undefined_heading", f"pose.orientation {error}") from None


def _pose_covariance(values: Any) -> FloatArray | None:
    axes = (X, Y, YAW)
    block = np.reshape(np.asarray(values, np.float64), (6, 6))[np.ix_(axes, axes)]
    if not block.any():
        return None
    if not np.isfinite(block).all():
        raise MessageError("not_finite", "pose.covariance of x, y and yaw must be finite")
    # Rounding in a filter leaves it a bit uneven; halves cannot overflow.
    symmetric = limited(0.5 * block + 0.5 * block.T)
    # That of x and y by itself as well: a heading that is not known must not hide what it is.
    if any(
        np.linalg.eigvalsh(part)[0] < -1e-9 * np.abs(part).max()
        for part in (symmetric, symmetric[:2, :2])
    ):
        raise MessageError(
            "bad_covariance", "pose.covariance of x, y and yaw must be positive semi-definite"
        )
    return symmetric


def odometry_message(sample: OwnShipSample, *, heading_known: bool = True) -> Odometry:
    """Build the own ship's odometry: the inverse of `read_own_ship`.

    The vessel has no vertical speed and constant roll and pitch, since a sample says nothing else.
    A covariance that is not known is written as zeros; where it is known, what a sample has none
    for (z, roll, pitch) has the variance `UNOBSERVED_VARIANCE`. The covariance of the twist is
    zeros: not known.

    Parameters
    ----------
    sample : OwnShipSample
    heading_known : bool, optional
        False for a source without a heading. The message must have some orientation: it is that of
        the sample (0, or the course over ground), and the variance of the yaw is
        `UNOBSERVED_VARIANCE` whatever the sample says. The velocity in the fixed frame, which a
        reader gets back, is right all the same.

    Returns
    -------
    nav_msgs.msg.Odometry

    Raises
    ------
    ValueError
        If the stamp does not fit a time message.
    """
    from nav_msgs.msg import Odometry

    message = Odometry(
        header=make_header(sample.stamp_ns, sample.frame_id), child_frame_id=sample.child_frame_id
    )
    pose, twist = message.pose.pose, message.twist.twist
    pose.position.x, pose.position.y = float(sample.x), float(sample.y)
    quaternion = _quaternion(sample)
    orientation = pose.orientation
    orientation.x, orientation.y, orientation.z, orientation.w = quaternion
    to_child = _rotation(quaternion).T
    linear = to_child @ [sample.vx, sample.vy, 0.0]
    twist.linear.x, twist.linear.y, twist.linear.z = (float(value) for value in linear)
    # A turn about the fixed z axis alone would change roll and pitch; the axis of the yaw does not.
    rate, roll, pitch = sample.yaw_rate, sample.roll, sample.pitch
    twist.angular.x = -rate * math.sin(pitch)
    twist.angular.y = rate * math.cos(pitch) * math.sin(roll)
    twist.angular.z = rate * math.cos(pitch) * math.cos(roll)
    covariance = _written_covariance(sample.pose_covariance, heading_known)
    if covariance is not None:
        message.pose.covariance = odometry_covariance(covariance, (X, Y, YAW))
    return message


def _quaternion(sample: OwnShipSample) -> list[float]:
    """Return the orientation as x, y, z, w."""
    halves = (0.5 * sample.roll, 0.5 * sample.pitch, 0.5 * sample.yaw)
    (cr, cp, cy), (sr, sp, sy) = map(math.cos, halves), map(math.sin, halves)
    return [
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        cr * cp * cy + sr * sp * sy,
    ]


def _written_covariance(covariance: FloatArray | None, heading_known: bool) -> FloatArray | None:
    if heading_known:
        return covariance
    written = np.zeros((3, 3)) if covariance is None else np.array(covariance, np.float64)
    written[2, :] = written[:, 2] = 0.0
    written[2, 2] = UNOBSERVED_VARIANCE
    return written
