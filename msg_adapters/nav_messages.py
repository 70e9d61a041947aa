# Copyright 2026 tsepm_ros developers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.
"""Messages of navigation: own ship, position fixes and land in, a track out.

Own ship is read from nav_msgs/Odometry, a position fix from sensor_msgs/NavSatFix, land from
nav_msgs/OccupancyGrid. A track is written as nav_msgs/Odometry for tools that read only standard
messages. The 6 x 6 covariances of nav_msgs/Odometry are of x, y, z, then of rotations about the x,
y, z axes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from msg_adapters import messages
from msg_adapters.stamps import (
    MessageError,
    make_header,
    ns_to_seconds,
    refusing,
    seconds_to_ns,
    time_to_ns,
)
from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.own_ship.pose_history import PoseSample, known_pose_rates
from tsepm_ros.own_ship.registration import (
    AXES,
    registration_angles,
    registration_axes,
    registration_east_north_up,
    registration_rotation,
)
from tsepm_ros.tracker.clutter.fixed_places import LandMask
from tsepm_ros.tracker.tracks import ConfirmedTrack

X, Y, YAW = 0, 1, 5

UNOBSERVED_VARIANCE = 1e6
"""Variance of an unobserved quantity, in its SI unit squared: 1 km, 1 km/s, 160 turns.

A variance of zero would mean an exactly known quantity.
"""

MAX_VARIANCE = 1e12
"""Maximum variance that is read, in the SI unit squared: 1000 km, which is no position at all.

A source writes a larger variance only for an unknown quantity, and in sums and squares it would
cancel the known variances by rounding.
"""


MAX_FIX_STD = 100.0
"""Largest stated standard deviation of a position fix that is used, m."""
NULL_ISLAND = 1e-5
"""Latitude and longitude, degrees, up to which a receiver without a position may write 0."""
OCCUPIED = 50
"""Least occupancy of land, from 0 to 100; -1 is unknown, and not land."""
MAX_TILT = 0.01
"""Largest tilt of a chart, rad."""


def odometry_covariance(block: NDArray[np.float64], axes: Sequence[int]) -> NDArray[np.float64]:
    """Return a 6 x 6 covariance in which only some axes are observed.

    Parameters
    ----------
    block : (k, k) ndarray
        Covariance of the observed axes.
    axes : sequence of int
        Their k indices in the message.

    Returns
    -------
    (36,) ndarray
        Row by row; `UNOBSERVED_VARIANCE` on the rest of the diagonal.
    """
    full = UNOBSERVED_VARIANCE * np.eye(6)
    full[np.ix_(axes, axes)] = block
    return full.ravel()


def read_own_ship(message: messages.Odometry, fixed_frame: str = "") -> PoseSample:
    """Read the own ship's odometry.

    The twist of the message is in the child frame; the full orientation rotates it into the fixed
    frame. The quaternion need not have unit length. As usual in ROS, a covariance of zeros is
    unknown, and so are variances that are not finite or below 0, except that a heading of infinite
    variance beside a known position is no heading; a velocity or yaw rate of exactly 0 is unknown
    too, see `known_pose_rates`. A variance above `MAX_VARIANCE`, which sources write for unknown
    quantities, is read as `MAX_VARIANCE`.

    Both frames may have other axes by their names: see `own_ship.registration`. In a fixed
    frame with z down, a child frame without a suffix has z up or down such that the vessel is
    upright.

    Parameters
    ----------
    message : nav_msgs.msg.Odometry
    fixed_frame : str, optional
        Name of the fixed frame, if the message has none.

    Returns
    -------
    PoseSample
        In east and north. `PoseSample.check` tests whether it is usable for the registration of a
        scan.

    Raises
    ------
    MessageError
        If a value that is used is not finite, the quaternion is zero, or the vessel points
        vertically up or down.
    """
    pose, twist = message.pose.pose, message.twist.twist
    with refusing("frame_axes"):
        world = registration_east_north_up(message.header.frame_id or fixed_frame)
    x, y = (
        float(v) for v in world[:2, :2] @ _finite_components("pose.position", pose.position, "xy")
    )
    quaternion = _finite_components("pose.orientation", pose.orientation, "xyzw")
    with refusing("zero_quaternion", "pose.orientation"):
        rotation = world @ registration_rotation(quaternion)
    linear = _finite_components("twist.linear", twist.linear, "xyz")
    angular = _finite_components("twist.angular", twist.angular, "xyz")
    axes = registration_axes(message.child_frame_id)
    upside_down = world[2, 2] < 0.0 and rotation[2, 2] < 0.0
    body = AXES["down" if axes == "body" and upside_down else axes]
    with refusing("undefined_heading", "pose.orientation"):
        yaw, pitch, roll = registration_angles(rotation @ body)
    with np.errstate(over="ignore", invalid="ignore"):  # refused by `PoseSample.check`
        vx, vy, _ = (float(value) for value in rotation @ linear)
    _, rate_y, rate_z = (float(value) for value in body.T @ angular)
    yaw_rate = (rate_y * math.sin(roll) + rate_z * math.cos(roll)) / math.cos(pitch)
    return PoseSample(
        stamp=ns_to_seconds(time_to_ns(message.header.stamp)),
        x=x,
        y=y,
        yaw=yaw,
        covariance=_pose_covariance(message.pose.covariance, world),
        rates=known_pose_rates(vx, vy, yaw_rate),
        roll=roll,
        pitch=pitch,
        frame_id=message.header.frame_id.lstrip("/"),
        child_frame_id=message.child_frame_id.lstrip("/"),
    )


def _finite_components(name: str, vector: Any, components: str) -> list[float]:
    """Return components of a vector message."""
    values = [float(getattr(vector, component)) for component in components]
    for component, value in zip(components, values, strict=True):
        if not math.isfinite(value):
            raise MessageError("not_finite", f"{name}.{component} must be finite; got {value}")
    return values


def _pose_covariance(values: Any, world: FloatArray) -> FloatArray | None:
    axes = (X, Y, YAW)
    block = np.reshape(np.asarray(values, np.float64), (6, 6))[np.ix_(axes, axes)]
    variance = np.diagonal(block)
    unknown = ~np.isfinite(variance) | (variance < 0.0)
    no_heading = variance[2] == np.inf and not unknown.all()
    block = np.where(unknown | unknown[:, None] | ~np.isfinite(block), 0.0, block)
    block[2, 2] = MAX_VARIANCE if no_heading else block[2, 2]
    if not block.any():
        return None
    block = world @ block @ world.T
    # Rounding in a filter leaves it slightly asymmetric; the sum of halves cannot overflow.
    block = 0.5 * block + 0.5 * block.T
    # Scaled down with their correlations kept: ``D C D`` is positive semi-definite if C is.
    scale = np.sqrt(MAX_VARIANCE / np.maximum(np.diagonal(block), MAX_VARIANCE))
    return scale[:, None] * block * scale


def read_fix(message: messages.NavSatFix) -> tuple[float, float, float, float]:
    """Read a position fix.

    Returns
    -------
    stamp, latitude, longitude, std : float
        s, degrees, and the larger stated standard deviation of east and north, m; nan if unknown.

    Raises
    ------
    MessageError
        If it has no position (``no_fix``), no stamp (``fix_stamp``), or a stated standard deviation
        above `MAX_FIX_STD` (``fix_vague``).
    """
    stamp_ns = time_to_ns(message.header.stamp)
    stated = [float(message.position_covariance[entry]) for entry in (0, 4)]
    variances = [value for value in stated if value > 0.0]  # 0, -1 and nan are unknown
    std = math.sqrt(max(variances, default=math.nan))
    is_known = message.position_covariance_type and len(variances) == len(stated)
    faults = (
        (message.status.status < 0, "no_fix", "its status says that it has no position"),
        (not stamp_ns, "fix_stamp", "its stamp is 0: the driver must write the position's time"),
        (
            std > MAX_FIX_STD,
            "fix_vague",
            f"its covariance states a standard deviation of {std:.3g} m, more than {MAX_FIX_STD} m",
        ),
        (
            not is_known and max(abs(message.latitude), abs(message.longitude)) <= NULL_ISLAND,
            "no_fix",
            "latitude and longitude are 0 and the covariance is unknown: the receiver has no "
            "position",
        ),
    )
    for is_fault, reason, sentence in faults:
        if is_fault:
            raise MessageError(reason, sentence)
    return ns_to_seconds(stamp_ns), message.latitude, message.longitude, std


def odometry_message(sample: PoseSample) -> messages.Odometry:
    """Build the own ship's odometry: the inverse of `read_own_ship`.

    Vertical speed and the rates of roll and pitch are 0, because a sample does not contain them.
    Unknown rates and an unknown covariance are written as zeros. In a known covariance, the axes
    that a sample does not contain (z, roll, pitch) have the variance `UNOBSERVED_VARIANCE`. The
    covariance of the twist is zeros: unknown.

    Parameters
    ----------
    sample : PoseSample

    Returns
    -------
    nav_msgs.msg.Odometry

    Raises
    ------
    ValueError
        If the stamp does not fit a time message.
    """
    message = messages.Odometry(
        header=make_header(seconds_to_ns(sample.stamp), sample.frame_id),
        child_frame_id=sample.child_frame_id,
    )
    pose, twist = message.pose.pose, message.twist.twist
    pose.position.x, pose.position.y = float(sample.x), float(sample.y)
    orientation = pose.orientation
    rotation = Rotation.from_euler("ZYX", [sample.yaw, sample.pitch, sample.roll])
    orientation.x, orientation.y, orientation.z, orientation.w = rotation.as_quat().tolist()
    vx, vy, yaw_rate = (0.0 if math.isnan(rate) else rate for rate in sample.rates or (0.0,) * 3)
    # In the child frame, at constant roll and pitch.
    for vector, rates in ((twist.linear, [vx, vy, 0.0]), (twist.angular, [0.0, 0.0, yaw_rate])):
        vector.x, vector.y, vector.z = rotation.inv().apply(rates).tolist()
    if sample.covariance is not None:
        message.pose.covariance = odometry_covariance(sample.covariance, (X, Y, YAW))
    return message


def turn_plane(orientation: messages.Quaternion, frame_id: str, axes: str) -> FloatArray:
    """Turn x, y and z ahead, to port and up in a frame; returns the rotation, (3, 3).

    Its axes are a key of `AXES`; empty: as its name states.
    """
    o, turn = orientation, AXES[axes or registration_axes(frame_id)]
    o.x, o.y, o.z, o.w = Rotation.from_matrix(turn).as_quat().tolist()
    return turn


def track_odometry(header: messages.Header, track: ConfirmedTrack) -> messages.Odometry:
    """Build the odometry of one track.

    The child frame ``track_<id>`` is not in tf. The orientation is the identity, so the axes of the
    twist, which is in the child frame, are those of the fixed frame. Unobserved quantities (z,
    rotations, their rates) are 0 with the variance `UNOBSERVED_VARIANCE`. The message has no field
    for the covariance between position and velocity: prefer the track cloud.

    Parameters
    ----------
    header : std_msgs.msg.Header
        The fixed frame, and the stamp of the state.
    track : ConfirmedTrack

    Returns
    -------
    nav_msgs.msg.Odometry
    """
    message = messages.Odometry(header=header, child_frame_id=f"track_{track.track_id}")
    position, velocity = message.pose.pose.position, message.twist.twist.linear
    position.x, velocity.x, position.y, velocity.y = (float(value) for value in track.state)
    message.pose.pose.orientation.w = 1.0
    message.pose.covariance = odometry_covariance(track.position_covariance, (X, Y))
    message.twist.covariance = odometry_covariance(track.covariance[1::2, 1::2], (X, Y))
    return message


def read_land(message: messages.OccupancyGrid) -> LandMask | None:
    """Read a chart.

    Parameters
    ----------
    message : nav_msgs.msg.OccupancyGrid
        Its origin is the pose of the corner of the first cell; the rows of `data` go along x.

    Returns
    -------
    LandMask or None
        In east and north; None where the grid has no cells.

    Raises
    ------
    MessageError
        If the grid is malformed: ``land_invalid``.
    """
    info = message.info
    width, height, number = int(info.width), int(info.height), len(message.data)
    if width * height != number:
        raise MessageError("land_invalid", f"data has {number} cells, not {width} x {height}")
    if not number:
        return None
    position, q = info.origin.position, info.origin.orientation
    with refusing("land_invalid", "info.origin.orientation"):
        yaw, pitch, roll = registration_angles(registration_rotation((q.x, q.y, q.z, q.w)))
        if not max(abs(pitch), abs(roll)) <= MAX_TILT:
            raise ValueError("must be level")
    occupied = np.asarray(message.data, np.int8).reshape(height, width) >= OCCUPIED
    origin = position.x, position.y, yaw
    if registration_axes(message.header.frame_id) == "down":
        occupied, origin = occupied.T, (position.y, position.x, -yaw)
    with refusing("land_invalid", "info:"):
        return LandMask(occupied, float(info.resolution), origin)
