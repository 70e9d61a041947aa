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
"""Registration of scans in the fixed frame: axes, attitude, and the sensor's pose at each echo.

Measurements along the sensor's axes become range and azimuth in the horizontal plane. The mounting
turns the vessel's poses into the sensor's.

Axes are named as in REP-103: x ahead, y to port, z up. An attitude is yaw, pitch and roll: the
rotation of the fixed axes by yaw about z, then by pitch about y, then by roll about x gives the
vessel's axes, ``R = Rz(yaw) Ry(pitch) Rx(roll)``. Positive pitch is bow down, positive roll is
port up.

Inside, detections are ahead and to port of the sensor, and poses and tracks in east and north. A
fixed frame whose name ends in `_ned` or `_frd` (the suffixes of REP-103) has x north, y east and z
down: there, x and y are exchanged at the input and at the output.
"""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from tsepm_ros.numerics.arrays import BoolArray, FloatArray, replaced
from tsepm_ros.own_ship.pose_history import PoseHistory, echo_poses
from tsepm_ros.parameters import WHOLE_TURN, ParameterGroup, parameter
from tsepm_ros.tracker.scan import MAX_MAGNITUDE, MIN_MAGNITUDE, Scan, ScanArc, scan_of_rows, wrap
from tsepm_ros.tracker.tracks import TrackArrays

MIN_QUATERNION_NORM = 1e-6
"""Smallest norm of a quaternion; below, its direction is noise."""
MIN_PITCH_COSINE = 1e-6
"""Smallest cosine of the pitch; below, yaw and roll are the same rotation."""
MAX_SLANT_RATIO = 1.1
"""Largest ratio of slant to horizontal range at which range rates are used: 24.6 degrees."""

AXES: dict[str, FloatArray] = {
    "body": np.eye(3),
    "down": np.diag([1.0, -1.0, -1.0]),
    "sonar": np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]]),
    "optical": np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]]),
}
"""Ahead, port and up, as columns, in a frame's axes: `body` x ahead, y to port, z up; `down`
x ahead, y to starboard, z down; `sonar` z ahead, x up, y to starboard (marine_acoustic_msgs);
`optical` z ahead, x to starboard, y down."""
_SUFFIX = re.compile(r"(?:^|(?<=/)|_)(ned|frd|optical)(?=(?:_frame)?$)", re.IGNORECASE)
_AXES = {"ned": "down", "frd": "down", "optical": "optical"}
_EAST_NORTH_UP = {
    "body": np.eye(3),
    "down": np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]),
}
_EXCHANGED = [2, 3, 0, 1]
MAX_ECHO_TIME = 60.0
"""Time from a ping to the reflection of its echo, s, that no sonar reaches: 90 km of range."""
MAX_TRANSMIT_OFFSET = 3600.0
"""Time of a ping after the stamp of its scan, s, that no sweep reaches."""


def registration_rotation(quaternion: Sequence[float]) -> FloatArray:
    """Rotation matrix (3, 3) from the child frame to the parent frame.

    Parameters
    ----------
    quaternion : sequence of 4 float
        x, y, z, w, of any length above `MIN_QUATERNION_NORM`.

    Raises
    ------
    ValueError
        If it is zero or not finite.
    """
    norm = math.hypot(*quaternion)
    if not MIN_QUATERNION_NORM < norm < math.inf:
        raise ValueError(f"must not be zero; its norm is {norm:g}")
    x, y, z, w = (component / norm for component in quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def registration_angles(rotation: FloatArray) -> tuple[float, float, float]:
    """Yaw, pitch and roll (rad) of a rotation matrix, whose columns are ahead, port and up.

    Raises
    ------
    ValueError
        If ahead is straight up or down.
    """
    ahead_x, ahead_y, ahead_z = (float(value) for value in rotation[:, 0])
    level = math.hypot(ahead_x, ahead_y)
    if level < MIN_PITCH_COSINE:
        raise ValueError("points straight up or down and has no heading")
    roll = math.atan2(rotation[2, 1], rotation[2, 2])
    return math.atan2(ahead_y, ahead_x), math.atan2(-ahead_z, level), roll


def registration_ahead_and_port(
    x: FloatArray, y: FloatArray, z: FloatArray, roll: FloatArray, pitch: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Horizontal components of vectors in a tilted vessel's axes.

    The first two of ``Ry(pitch) Rx(roll) (x, y, z)``, in level axes with the vessel's heading::

        ahead = x cos(pitch) + (y sin(roll) + z cos(roll)) sin(pitch)
        port  = y cos(roll) - z sin(roll)

    Parameters
    ----------
    x, y, z : (...) ndarray
        Any unit.
    roll, pitch : (...) ndarray
        rad.

    Returns
    -------
    ahead, port : (...) ndarray
    """
    unrolled_z = y * np.sin(roll) + z * np.cos(roll)
    return x * np.cos(pitch) + unrolled_z * np.sin(pitch), y * np.cos(roll) - z * np.sin(roll)


def levelled_for_registration(
    range: FloatArray,
    azimuth: FloatArray,
    height: FloatArray | None,
    roll: FloatArray,
    pitch: FloatArray,
    mounting_yaw: float = 0.0,
    mounting_roll: float = 0.0,
) -> tuple[FloatArray, FloatArray]:
    """Range and azimuth in the horizontal plane of a tilted sensor's detections.

    A detection at slant range s, azimuth a and elevation e is at ``s d``, with the direction
    ``d = (cos e cos a, cos e sin a, sin e)`` in the sensor's axes. It is given by the range
    ``r = s cos e`` in the sensor's x-y plane and the height ``h = s sin e`` above it, which are
    exact for a level sensor. With the mounting yaw m and roll q of the sensor on the vessel::

        w = Ry(pitch) Rx(roll) Rz(m) Rx(q) (r cos a, r sin a, h)
        range = hypot(w_x, w_y),  azimuth = atan2(w_y, w_x) - m

    The standard deviations of range and azimuth stay the same: a tilt of 10 degrees changes them
    by 1.5 %, less than their own uncertainty.

    Parameters
    ----------
    range, azimuth : (n,) ndarray
        m, rad.
    height : (n,) ndarray or None
        m; None: 0, in the sensor's x-y plane.
    roll, pitch : (n,) or (1,) ndarray
        Of the vessel, rad.
    mounting_yaw : float, optional
        m, rad, counter-clockwise from the vessel's bow to the sensor's x axis.
    mounting_roll : float, optional
        q, rad, about the sensor's x axis.

    Returns
    -------
    range : (n,) ndarray
        m; may be 0, or not finite for an excessive height.
    azimuth : (n,) ndarray
        From the sensor's heading, yaw + m, counter-clockwise about the vertical, rad. Where roll
        and pitch are 0, and q too, range and azimuth stay the same to the bit.
    """
    tilted = (roll != 0.0) | (pitch != 0.0) | (mounting_roll != 0.0)
    if not tilted.any():
        return range, azimuth
    z = np.zeros_like(range) if height is None else height
    with np.errstate(over="ignore", invalid="ignore"):  # results in a range that is not finite
        if mounting_roll:
            x, y = range * np.cos(azimuth), range * np.sin(azimuth)
            sine, cosine = math.sin(mounting_roll), math.cos(mounting_roll)
            y, z = cosine * y - sine * z, sine * y + cosine * z
            range, azimuth = np.hypot(x, y), np.arctan2(y, x)
        angle = azimuth + mounting_yaw
        ahead, port = registration_ahead_and_port(
            range * np.cos(angle), range * np.sin(angle), z, roll, pitch
        )
        horizontal = np.hypot(ahead, port)
    level_azimuth = np.arctan2(port, ahead) - mounting_yaw
    return np.where(tilted, horizontal, range), np.where(tilted, level_azimuth, azimuth)


def registration_range_rate(
    range_rate: FloatArray, slant_range: FloatArray, range: FloatArray
) -> FloatArray:
    """Rate of the horizontal range, from the rate along a slant line of sight.

    Slant range s, horizontal range r and height h satisfy ``s^2 = r^2 + h^2``. Target and sensor
    move horizontally, so h is constant and ``s ds/dt = r dr/dt``::

        dr/dt = s / r ds/dt

    A relative vertical velocity w, for example the sensor's heave, adds ``w h / r``, which is not
    corrected. The rate's standard deviation also grows by s / r; it is not scaled, since s / r is
    at most `MAX_SLANT_RATIO`.

    Parameters
    ----------
    range_rate : (n,) ndarray
        ds/dt, m/s.
    slant_range, range : (n,) ndarray
        s and r, m; r may be 0.

    Returns
    -------
    (n,) ndarray
        dr/dt, m/s; nan where s / r exceeds `MAX_SLANT_RATIO`. Where s equals r, the rates stay the
        same to the bit.
    """
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):  # results in nan
        ratio = slant_range / range
        return np.where(ratio <= MAX_SLANT_RATIO, ratio * range_rate, np.nan)


def registration_axes(frame_id: str) -> str:
    """Axes that a frame's name states, a key of `AXES`; `body` without a suffix."""
    suffix = _SUFFIX.search(frame_id)
    return _AXES[suffix[1].lower()] if suffix else "body"


def registration_frame(frame_id: str) -> str:
    """The frame to which a frame of other axes belongs, with x ahead or east, and z up."""
    return _SUFFIX.sub("", frame_id).rstrip("/") or "level"


def registration_east_north_up(frame_id: str) -> FloatArray:
    """Rotation (3, 3) from a fixed frame's axes, as its name states them, to east, north and up.

    Raises
    ------
    ValueError
        If x and y are not horizontal.
    """
    axes = registration_axes(frame_id)
    if axes not in _EAST_NORTH_UP:
        raise ValueError(
            f"fixed_frame {frame_id!r} has z ahead and y down by its name, but x and y of tracks "
            f"are horizontal (REP-103): use a frame such as {registration_frame(frame_id)!r}"
        )
    return _EAST_NORTH_UP[axes]


def exchanged_after_registration(tracks: TrackArrays, frame_id: str) -> TrackArrays:
    """Tracks of a fixed frame in east and north, or back: x and y are exchanged if x is north."""
    if registration_axes(frame_id) != "down":
        return tracks
    covariance = tracks.covariance[:, _EXCHANGED][:, :, _EXCHANGED]
    return replaced(tracks, state=tracks.state[:, _EXCHANGED], covariance=covariance)


@dataclass(frozen=True, kw_only=True)
class Mounting(ParameterGroup):
    """Position and yaw of the sensor in the vessel's frame (REP-103): with odometry, or at rest.

    Raises
    ------
    ValueError
        Naming the option whose value is not allowed.
    """

    x: float = parameter(
        0.0,
        "Position of the sensor ahead of the origin of the vessel's frame; not with tf",
        unit="m",
        minimum=-1000.0,
        maximum=1000.0,
    )
    y: float = parameter(
        0.0,
        "Position of the sensor to port of the origin of the vessel's frame; not with tf",
        unit="m",
        minimum=-1000.0,
        maximum=1000.0,
    )
    yaw: float = parameter(
        0.0,
        "Direction of the sensor's azimuth 0, counter-clockwise from the vessel's bow; not with tf",
        unit="rad",
        minimum=-WHOLE_TURN,
        maximum=WHOLE_TURN,
    )
    roll: float = parameter(
        0.0,
        "Roll of the sensor about its azimuth 0: 3.1416 for a sensor that hangs upside down; "
        "not with tf",
        unit="rad",
        minimum=-3.1416,
        maximum=3.1416,
    )

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
        ahead, port = registration_ahead_and_port(along, across, up, roll, pitch)
        cosine, sine = np.cos(yaw), np.sin(yaw)
        east, north = cosine * ahead - sine * port, sine * ahead + cosine * port
        return vessel[:, :3] + np.stack([east, north, np.full(len(yaw), self.yaw)], axis=1)

    def image_poses(self, vessel: FloatArray) -> FloatArray:
        """Poses of the sensor, as `sensor_poses`, for the ground that its images see.

        A sensor that hangs upside down, by its mounting or (of tf) by its pose, sees a mirrored
        ground: its azimuths are clockwise from above. Mirrored are y and yaw then.
        """
        return self.sensor_poses(vessel) * np.where(
            math.cos(self.roll) * np.cos(vessel[:, 3:]).prod(axis=1, keepdims=True) < 0.0,
            (1.0, -1.0, -1.0),
            1.0,
        )


def registration_covariance(covariance: FloatArray, arm: FloatArray) -> FloatArray:
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


class MessageFacts(NamedTuple):
    """Facts of a message that questions are asked about; they do not change its detections.

    Attributes
    ----------
    beyond_turn : int
        Number of detections whose angle was beyond a full turn as received.
    largest_angle : float
        Of these, without its sign, rad.
    rays : int
        Number of rays or beams, with and without a detection.
    no_return : mapping of str to int
        Rays left out by the value that stands for no return, by that value in words.
    states : mapping of str to float
        What the message states of the sonar, such as its largest range, by its name and unit.
    """

    beyond_turn: int = 0
    largest_angle: float = 0.0
    rays: int = 0
    no_return: Mapping[str, int] = MappingProxyType({})
    states: Mapping[str, float] = MappingProxyType({})


@dataclass(frozen=True)
class UnregisteredScan:
    """A scan as received, before its registration in the fixed frame.

    Attributes
    ----------
    scan : Scan
        Detections; its sensor pose is not used. Ranges are in the sensor's x-y plane, range rates
        along the slant line of sight.
    frame_id : str
        The sensor's frame.
    north_referenced : bool
        The azimuths count from the fixed frame's x axis (east), not from the sensor's, and lie in
        the horizontal plane: neither heading nor attitude is applied to them.
    stamp_ns : int
        The stamp as received, ns: a date in seconds does not fit a float64 to the last digit.
    transmit_offset : (n,) ndarray or None
        Time after the stamp at which each detection's ping left, s; None: at the stamp.
    height : (n,) ndarray or None
        Height of each detection above the sensor's x-y plane, m; None: 0.
    axes : str
        Convention of the sensor frame's axes, a key of `AXES`.
    beams : ScanArc or None
        The azimuths that the message looked at, as far as it shows; None where it has none.
    facts : MessageFacts
    """

    scan: Scan
    frame_id: str
    north_referenced: bool = False
    stamp_ns: int = 0
    transmit_offset: FloatArray | None = None
    height: FloatArray | None = None
    axes: str = "body"
    beams: ScanArc | None = None
    facts: MessageFacts = dataclasses.field(default_factory=MessageFacts)

    @property
    def sent(self) -> FloatArray:
        """Time after the stamp at which each ping left, s, (n,); (1,) for all."""
        return np.zeros(1) if self.transmit_offset is None else self.transmit_offset


class PosesJumpError(ValueError):
    """Poses so far apart, or with such rates, that none between them is a pose."""


def register_at_rest(sensor_scan: UnregisteredScan, mounting: Mounting, yaw: float = 0.0) -> Scan:
    """Register a scan of a sensor at rest, mounted on a level platform.

    This is at the origin of the fixed frame, with a yaw, rad; azimuths from north have none.
    """
    scan, level = sensor_scan.scan, np.zeros(1)
    range_, azimuth = levelled_for_registration(
        *(scan.range, scan.azimuth, sensor_scan.height, level, level),
        *(mounting.yaw, mounting.roll),
    )
    scan = _with_horizontal(sensor_scan, range_, azimuth).scan
    (pose,) = mounting.sensor_poses(np.array([[0.0, 0.0, yaw, 0.0, 0.0]]))
    if sensor_scan.north_referenced:
        pose = pose * (1.0, 1.0, 0.0)
    return scan.replaced(sensor_pose=pose) if pose.any() else scan


def register_in_fixed_frame(
    sensor_scan: UnregisteredScan, poses: PoseHistory, mounting: Mounting, *, sector: bool = False
) -> Scan:
    """Register a scan by the poses of its echoes.

    Parameters
    ----------
    sensor_scan : UnregisteredScan
    poses : PoseHistory
        Poses of the vessel; they must cover `registration_span`.
    mounting : Mounting
        Mounting of the sensor on the vessel.
    sector : bool, optional
        Whether azimuths from north are converted to the sensor's axes, by the heading at reception,
        for a sensor whose coverage is a sector. Positions and their covariances stay the same.

    Returns
    -------
    Scan
        Without the detections straight above or below the tilted sensor. Range rates are nan where
        the sensor's velocity is unknown, or exceeds `MAX_MAGNITUDE` (poses that jump).

    Raises
    ------
    ValueError
        If a time is beyond the coverage of the poses.
    PosesJumpError
        If an interpolated pose is beyond `MAX_MAGNITUDE`.
    """
    sensor_scan = _level(sensor_scan, poses, mounting)
    scan = sensor_scan.scan
    heading = not sensor_scan.north_referenced
    velocity, features = np.zeros(2), scan.features
    if "range_rate" in features:
        velocity = _velocity(sensor_scan, poses, mounting)
        known = np.asarray((np.abs(velocity) <= MAX_MAGNITUDE["sensor_velocity"]).all(axis=-1))
        velocity = np.where(known[..., None], velocity, 0.0)
        features = {**features, "range_rate": np.where(known, features["range_rate"], np.nan)}
    sensor_pose = echo_poses(
        lambda times: _poses(times, poses, mounting),
        scan.stamp,
        scan.time_offset,
        scan.azimuth,
        transmit_offset=sensor_scan.transmit_offset,
        heading=heading,
    )
    if not (np.abs(sensor_pose) <= MAX_MAGNITUDE["sensor_pose"]).all():
        raise PosesJumpError(
            f"the poses around {scan.stamp:.3f} s jump: none between them is on earth"
        )
    registered = scan.replaced(
        features=features,
        sensor_pose=sensor_pose,
        sensor_pose_covariance=_pose_covariance(scan.stamp, poses, mounting, heading),
        sensor_velocity=velocity,
    )
    if heading or not sector:
        return registered
    return _by_sensor(registered, registration_arrival_times(sensor_scan), poses, mounting)


def registration_span(sensor_scan: UnregisteredScan) -> tuple[float, float]:
    """Begin and end of the time for which poses are needed, s: transmit to last arrival."""
    scan = sensor_scan.scan
    if scan.time_offset is None or not len(scan):
        return scan.stamp, scan.stamp
    sent = sensor_scan.sent
    times = np.concatenate([[0.0], sent, 2.0 * scan.time_offset - sent])
    return scan.stamp + float(times.min()), scan.stamp + float(times.max())


def registration_echoes(sensor_scan: UnregisteredScan) -> BoolArray:
    """Which echoes' times are near enough to their ping's, and the ping's to the stamp, (n,).

    A scan waits for the poses at all of its times, so a wrong time must not stay in it.
    """
    scan, sent = sensor_scan.scan, sensor_scan.sent
    offset = np.zeros(len(scan)) if scan.time_offset is None else scan.time_offset
    return (np.abs(offset - sent) < MAX_ECHO_TIME) & (np.abs(sent) < MAX_TRANSMIT_OFFSET)


def selected_for_registration(sensor_scan: UnregisteredScan, kept: BoolArray) -> UnregisteredScan:
    """A scan before its registration with some of its detections."""
    offset, height = sensor_scan.transmit_offset, sensor_scan.height
    return dataclasses.replace(
        sensor_scan,
        scan=scan_of_rows(sensor_scan.scan, np.flatnonzero(kept)),
        transmit_offset=None if offset is None else offset[kept],
        height=None if height is None else height[kept],
    )


def registration_arrival_times(sensor_scan: UnregisteredScan) -> FloatArray:
    """Arrival times of the echoes, s, (n,), or (1,) without time offsets."""
    scan = sensor_scan.scan
    if scan.time_offset is None:
        return np.array([scan.stamp])
    return scan.stamp + 2.0 * scan.time_offset - sensor_scan.sent


def _with_horizontal(
    sensor_scan: UnregisteredScan, range: FloatArray, azimuth: FloatArray
) -> UnregisteredScan:
    """A scan's detections at new horizontal ranges and azimuths, without unusable ranges."""
    scan = sensor_scan.scan
    if range is scan.range and (sensor_scan.height is None or "range_rate" not in scan.features):
        return sensor_scan
    features = dict(scan.features)
    if "range_rate" in features:
        height = 0.0 if sensor_scan.height is None else sensor_scan.height
        slant = np.hypot(scan.range, height)
        features["range_rate"] = registration_range_rate(features["range_rate"], slant, range)
    usable = (range >= MIN_MAGNITUDE["range"]) & (range <= MAX_MAGNITUDE["range"])
    changes = {"range": range, "azimuth": wrap(azimuth), "features": features}
    moved = Scan.trusted(**vars(scan) | changes)
    return selected_for_registration(
        dataclasses.replace(sensor_scan, scan=moved, height=None), usable
    )


def _poses(times: FloatArray, poses: PoseHistory, mounting: Mounting) -> FloatArray:
    """Poses of the sensor at the given times (s), (n, 3)."""
    return mounting.sensor_poses(poses.poses(times))


def _by_sensor(
    scan: Scan, arrival_times: FloatArray, poses: PoseHistory, mounting: Mounting
) -> Scan:
    """Convert a registered scan's azimuths from north to the sensor's azimuths and yaws."""
    pose = np.array(scan.sensor_pose)
    common_pose = pose.ndim == 1
    times = np.array([scan.stamp]) if common_pose else arrival_times
    yaw = _poses(times, poses, mounting)[:, 2]
    pose[..., 2] = yaw[0] if common_pose else yaw
    # The arc that was looked at is known by north only.
    return scan.replaced(azimuth=scan.azimuth - yaw, sensor_pose=pose, swept=None)


def _arm(times: FloatArray, poses: PoseHistory, mounting: Mounting) -> FloatArray:
    """Lever arm from the vessel's origin to the sensor, in the fixed frame's axes, m, (n, 2)."""
    vessel = poses.poses(times)
    return mounting.sensor_poses(vessel)[:, :2] - vessel[:, :2]


def _velocity(sensor_scan: UnregisteredScan, poses: PoseHistory, mounting: Mounting) -> FloatArray:
    """Velocity of the sensor at each reflection, m/s, (n, 2), or (2,) for all detections."""
    scan = sensor_scan.scan
    times = scan.stamp + (np.zeros(1) if scan.time_offset is None else scan.time_offset)
    rates = poses.rates(times, registration_span(sensor_scan)[1])
    velocity = rates[:, :2]
    if mounting.offset:
        arm = _arm(times, poses, mounting)
        velocity = velocity + rates[:, 2:] * np.stack([-arm[:, 1], arm[:, 0]], axis=1)
    return velocity[0] if scan.time_offset is None else velocity


def _pose_covariance(
    stamp: float, poses: PoseHistory, mounting: Mounting, heading: bool
) -> FloatArray | None:
    """Covariance of the sensor's pose at a stamp (s), from the vessel's."""
    covariance = poses.covariance(stamp)
    if covariance is None:
        return None
    if mounting.offset:
        covariance = registration_covariance(
            covariance, _arm(np.array([stamp]), poses, mounting)[0]
        )
    return covariance if heading else covariance * np.outer([1, 1, 0], [1, 1, 0])


def _level(
    sensor_scan: UnregisteredScan, poses: PoseHistory, mounting: Mounting
) -> UnregisteredScan:
    """Convert a scan to the horizontal plane, by the attitude at reception."""
    scan = sensor_scan.scan
    range_, azimuth = scan.range, scan.azimuth
    if not sensor_scan.north_referenced:
        _, _, _, roll, pitch = poses.poses(registration_arrival_times(sensor_scan)).T
        range_, azimuth = levelled_for_registration(
            range_, azimuth, sensor_scan.height, roll, pitch, mounting.yaw, mounting.roll
        )
    return _with_horizontal(sensor_scan, range_, azimuth)
