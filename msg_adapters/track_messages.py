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
"""Tracks in messages: clouds with state and full covariance, other trackers' types, and markers.

No standard message has the covariance between position and velocity; the layout of the
sensor_msgs/PointCloud2 has it:

============================== ======== =======================================================
field                          datatype meaning
============================== ======== =======================================================
``x``, ``y``, ``z``            FLOAT32  position, m; z is 0
``track_id``                   UINT32   unique for the life of the node
``state_x`` ... ``state_vy``   FLOAT64  ``[x, vx, y, vy]``, m and m/s, fixed frame, at the stamp
``cov_00`` ... ``cov_33``      FLOAT64  covariance of that state, row by row
``evaluation``, ``score``      FLOAT64  figures of the method; nan if it has none
``hit_count``, ``scan_count``  UINT16   hits, and scans since the first; at most 65535
``age``                        FLOAT64  time since the first hit, s
``stationary_probability``     FLOAT64  that the target stands still; nan where not known
``signal_to_clutter_db``       FLOAT64  amplitude over that of clutter, dB; nan where not known
``revision``                   UINT16   0 as first published, then how often a start continued it
``existence_probability``      FLOAT64  that the target exists; nan where not known
``time_since_hit``             FLOAT64  time since the target was last detected, s
``status``                     UINT8    0: confirmed; 1: coasting; 2: stands still (`TrackStatus`)
``seen_by``                    UINT32   of several sensors alone: a bit of each that hit it lately
============================== ======== =======================================================

What other messages cannot take is left out: radar_msgs/RadarTracks has no existence, age or hits
and no covariance between position and velocity; autoware_perception_msgs/TrackedObjects has these
neither, but the existence.

Markers are visualization_msgs/MarkerArray for RViz and Foxglove, of tracks, of fixed echoes, of
detections, and of the ground truth of the simulator and the player.
"""

from __future__ import annotations

import math
import uuid
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from msg_adapters import messages
from msg_adapters.nav_messages import (
    UNOBSERVED_VARIANCE,
    YAW,
    X,
    Y,
    odometry_covariance,
    turn_plane,
)
from msg_adapters.point_cloud import cloud_of, read_fields
from msg_adapters.stamps import MessageError, ns_to_seconds, time_to_ns
from tsepm_ros.numerics.arrays import FloatArray, log_sums
from tsepm_ros.own_ship.registration import exchanged_after_registration
from tsepm_ros.session.inputs import TrackerReport
from tsepm_ros.tracker.measurement import major_sigma
from tsepm_ros.tracker.scan import Scan
from tsepm_ros.tracker.tracks import ConfirmedTrack, TrackArrays, TrackStatus

STATE_FIELDS = ("state_x", "state_vx", "state_y", "state_vy")
COVARIANCE_FIELDS = tuple(f"cov_{row}{column}" for row in range(4) for column in range(4))

TRACK_DTYPE = np.dtype(
    [
        *((name, "<f4") for name in ("x", "y", "z")),
        ("track_id", "<u4"),
        *((name, "<f8") for name in (*STATE_FIELDS, *COVARIANCE_FIELDS, "evaluation", "score")),
        *((name, "<u2") for name in ("hit_count", "scan_count")),
        ("age", "<f8"),
        ("stationary_probability", "<f8"),
        ("signal_to_clutter_db", "<f8"),
        ("revision", "<u2"),
        ("existence_probability", "<f8"),
        ("time_since_hit", "<f8"),
        ("status", "u1"),
    ],
    align=True,  # each float64 at a multiple of 8; the item size too
)
"""One point of the cloud."""

OPTIONAL_FIELDS = {
    "stationary_probability": np.nan,
    "signal_to_clutter_db": np.nan,
    "revision": 0,
    "existence_probability": np.nan,
    "time_since_hit": 0.0,
    "status": TrackStatus.CONFIRMED,
}
"""Fields that clouds of earlier versions lack, and their values then."""

SEEN_DTYPE = np.dtype(
    [*((name, TRACK_DTYPE[name]) for name in TRACK_DTYPE.names or ()), ("seen_by", "<u4")],
    align=True,
)
"""One point of the cloud of several sensors; `seen_by` lies in the padding of the others."""

_BLOCKS_DTYPE = np.dtype(
    [
        ("xyz", "<f4", (3,)),
        ("track_id", "<u4"),
        ("numbers", "<f8", (22,)),
        ("counts", "<u2", (2,)),
        *((name, TRACK_DTYPE[name]) for name in ("age", *OPTIONAL_FIELDS)),
    ],
    align=True,
)
"""The bytes of `TRACK_DTYPE` with fields of equal type combined, for assignment of blocks."""

_PLAIN = ("age", *(name for name in OPTIONAL_FIELDS if name not in ("revision", "status")))
MAX_AGE = 1e9
"""Largest age that is read, s: the square of a larger one could overflow."""
_MAX_COUNT = int(np.iinfo(np.uint16).max)
_MAX_ID = int(np.iinfo(np.uint32).max)
MAX_COURSE_STD = 0.5
"""Largest standard deviation of a course that is an orientation, rad."""
STANDS, MOVES = 0.9, 0.1
"""Probabilities to stand still from which on, and up to which, a track is classified."""
NAMESPACES = ("position", "velocity", "ellipse", "label")
"""The namespaces of a track's markers; the id of each marker is the track's id."""
TRACK_COLOR: Color = (0.1, 0.9, 0.3)
POTENTIAL_COLORS: tuple[Color, Color] = (0.45, 0.5, 0.6), (1.0, 0.6, 0.0)
"""Colours of a potential track with zero score, and of one at the threshold."""
SIZE_SHARE = 0.01
"""Size of a marker in the reach of the sensor: a few pixels where all of it is in view."""
LEAD_SHARE = 0.1
"""Way that velocity markers show of the fastest target, in the reach of the sensor."""
ELLIPSE_SCALE = math.sqrt(-2.0 * math.log(0.05))
"""Semi-axes of the 95 % ellipse in standard deviations, sqrt(chi2(2, 0.95)) = 2.4477."""
_LABEL_HEIGHT = 3.0  # in sizes of the position marker: readable if that is a few pixels
_ELLIPSE_OPACITY = 0.25
_MISSED_OPACITY = 0.5  # of every marker of a track without a detection in the last scan
_COASTING_OPACITY = 0.25  # of every marker of a track that coasts
_DASHES, _DASH_WIDTH = 24, 0.1  # of the ellipses of both; the width in sizes
_MAX_POTENTIAL = 1000  # drawn; nested messages are slow to build in Python
_POTENTIAL_OPACITY = 0.3, 1.0  # as for the colours
_POTENTIAL_LINE = 0.25  # width, in sizes of the points
_THICKNESS = 0.01  # m; RViz refuses a scale of 0
TRUTH_COLOR = (0.17, 0.42, 0.69)
FIXED_ECHO_COLOR = 0.95, 0.75, 0.2
DETECTION_COLOR = 0.9, 0.9, 0.95
"""Red, green and blue: unlike tracks, potential tracks and truth."""
MAX_LABELS = 500
"""Labels shown, of the echoes seen for the longest; nested messages are slow to build."""


def track_cloud(
    header: messages.Header,
    tracks: Sequence[ConfirmedTrack],
    seen_by: NDArray[np.uint32] | None = None,
) -> messages.PointCloud2:
    """Build a cloud of tracks; without tracks it is empty and has all fields.

    Parameters
    ----------
    header : std_msgs.msg.Header
        The fixed frame, and the stamp of every state. Points have no stamps, so predict the tracks
        to this stamp with `ConfirmedTrack.predicted` first.
    tracks : sequence of ConfirmedTrack
    seen_by : (n,) ndarray of uint32, optional
        Of several sensors the bits of those that hit each track lately, see `Tracker.seen_by`.

    Returns
    -------
    sensor_msgs.msg.PointCloud2

    Raises
    ------
    ValueError
        If a track_id does not fit 32 bits without a sign.
    """
    points, is_dense = track_points(tracks)
    if seen_by is not None:
        points = points.view(SEEN_DTYPE)
        points["seen_by"] = seen_by
    return cloud_of(header, points, is_dense)


def track_points(tracks: Sequence[ConfirmedTrack]) -> tuple[NDArray[Any], bool]:
    """Return the points of tracks as `track_cloud` packs them.

    Parameters
    ----------
    tracks : sequence of ConfirmedTrack

    Returns
    -------
    points : (n,) ndarray of TRACK_DTYPE
        With zero padding.
    is_dense : bool
        Whether every number but those of `OPTIONAL_FIELDS` is finite.

    Raises
    ------
    ValueError
        If a track_id does not fit 32 bits without a sign.
    """
    arrays = TrackArrays.from_tracks(tracks)
    bad_ids = arrays.track_id[(arrays.track_id < 0) | (arrays.track_id > _MAX_ID)]
    if len(bad_ids):
        raise ValueError(f"track_id must be from 0 to {_MAX_ID}; got {bad_ids[0]}")
    records = np.zeros(len(arrays), _BLOCKS_DTYPE)
    records["xyz"][:, :2] = arrays.state[:, 0::2]
    records["track_id"] = arrays.track_id
    numbers = records["numbers"]
    numbers[:, :4] = arrays.state
    numbers[:, 4:20] = arrays.covariance.reshape(-1, 16)
    numbers[:, 20] = arrays.evaluation
    numbers[:, 21] = arrays.score
    records["counts"][:, 0] = np.minimum(arrays.hit_count, _MAX_COUNT)
    records["counts"][:, 1] = np.minimum(arrays.scan_count, _MAX_COUNT)
    for name in _PLAIN:
        records[name] = getattr(arrays, name)
    records["revision"] = np.minimum(arrays.revision, _MAX_COUNT)
    records["status"] = arrays.status
    is_dense = bool(np.isfinite(numbers).all() and np.isfinite(arrays.age).all())
    return records.view(TRACK_DTYPE), is_dense


def read_track_cloud(cloud: messages.PointCloud2) -> NDArray[Any]:
    """Read a cloud of tracks: the inverse of `track_cloud`.

    Parameters
    ----------
    cloud : sensor_msgs.msg.PointCloud2
        With the fields of this layout, in any order, and perhaps others; `OPTIONAL_FIELDS` may be
        missing.

    Returns
    -------
    (n,) ndarray of TRACK_DTYPE
        `track_states` and `track_covariances` give its states and covariances as arrays.

    Raises
    ------
    MessageError
        If a field is missing or malformed, or a track_id is invalid.
    """
    given = {field.name for field in cloud.fields}
    absent = [name for name in OPTIONAL_FIELDS if name not in given]
    names = [name for name in TRACK_DTYPE.names or () if name not in absent]
    integers = [name for name in names if TRACK_DTYPE[name].kind == "u"]
    values = read_fields(cloud, names, integers=integers)
    ids = values["track_id"]
    if not ((ids >= 0) & (ids <= _MAX_ID) & (ids == np.floor(ids))).all():
        raise MessageError("bad_id", f"track_id must be an integer from 0 to {_MAX_ID}")
    records = np.zeros(len(ids), TRACK_DTYPE)
    with np.errstate(invalid="ignore", over="ignore"):  # counts may be nan
        for name in names:
            records[name] = values[name]
    for name in absent:
        records[name] = OPTIONAL_FIELDS[name]
    return records


def tracker_report(cloud: messages.PointCloud2) -> TrackerReport:
    """Read a cloud of tracks as a downstream tracker's report, in east and north.

    Raises
    ------
    MessageError
        If it does not have the layout of `read_track_cloud`.
    """
    stamp = ns_to_seconds(time_to_ns(cloud.header.stamp))
    records = read_track_cloud(cloud)
    records["age"] = np.clip(records["age"], 0.0, MAX_AGE)
    tracks = track_arrays(records, stamp)
    frame_id = cloud.header.frame_id.lstrip("/")
    return TrackerReport(
        stamp=stamp, frame_id=frame_id, tracks=exchanged_after_registration(tracks, frame_id)
    )


def track_arrays(records: NDArray[Any], stamp: float) -> TrackArrays:
    """Return tracks that were read as `TrackArrays`, without hits.

    Parameters
    ----------
    records : (n,) ndarray of TRACK_DTYPE
    stamp : float
        Stamp of the message, s.
    """
    return TrackArrays(
        track_id=records["track_id"].astype(np.int64),
        stamp=np.full(len(records), stamp),
        state=track_states(records),
        covariance=track_covariances(records),
        hits=np.fromiter(((),) * len(records), object),
        hit_count=records["hit_count"].astype(np.int64),
        scan_count=records["scan_count"].astype(np.int64),
        revision=records["revision"].astype(np.int64),
        status=records["status"].astype(np.int64),
        **{name: records[name].copy() for name in ("evaluation", "score", *_PLAIN)},
    )


def track_states(records: NDArray[Any]) -> NDArray[np.float64]:
    """Return the states of tracks that were read, (n, 4): ``[x, vx, y, vy]``, m and m/s."""
    return np.stack([records[name] for name in STATE_FIELDS], axis=-1)


def track_covariances(records: NDArray[Any]) -> NDArray[np.float64]:
    """Return the covariances of tracks that were read, (n, 4, 4), in the order of the state."""
    rows = np.stack([records[name] for name in COVARIANCE_FIELDS], axis=-1)
    return rows.reshape(-1, 4, 4)


def track_uuid(instance: uuid.UUID, track_id: int) -> NDArray[np.uint8]:
    """The UUID of a track of one run of the node, (16,).

    Parameters
    ----------
    instance : uuid.UUID
        Drawn at the start: a later run's tracks have other UUIDs.
    track_id : int
    """
    return np.frombuffer(uuid.uuid5(instance, str(track_id)).bytes, np.uint8)


def radar_tracks(
    header: messages.Header, tracks: TrackArrays, instance: uuid.UUID
) -> messages.RadarTracks:
    """Make a message of tracks but those that coast: it has no existence.

    Parameters
    ----------
    header : std_msgs.msg.Header
        Fixed frame, and stamp of the tracks.
    tracks : TrackArrays
    instance : uuid.UUID
        See `track_uuid`.

    Raises
    ------
    ImportError
        If radar_msgs is not installed.
    """
    message = messages.RadarTracks(header=header)
    unknown = _upper_covariance(UNOBSERVED_VARIANCE * np.eye(2))
    for track in tracks.where(tracks.status != TrackStatus.COASTING):
        made, stands = messages.RadarTrack(), track.stationary_probability
        made.uuid.uuid = track_uuid(instance, track.track_id)
        position, velocity = made.position, made.velocity
        position.x, velocity.x, position.y, velocity.y = track.state.tolist()
        if not math.isnan(stands):
            # NO_CLASSIFICATION, STATIC and DYNAMIC are 0, 1 and 2.
            made.classification = 1 if stands >= STANDS else 2 if stands <= MOVES else 0
        made.position_covariance = _upper_covariance(track.position_covariance)
        made.velocity_covariance = _upper_covariance(track.covariance[1::2, 1::2])
        made.acceleration_covariance = made.size_covariance = unknown
        message.tracks.append(made)
    return message


def tracked_objects(
    header: messages.Header, tracks: TrackArrays, instance: uuid.UUID
) -> messages.TrackedObjects:
    """Make a message of tracks; see `radar_tracks`.

    The orientation is the course. It is said to be known up to its sign, or to be unavailable where
    its standard deviation is above `MAX_COURSE_STD`: its variance is `UNOBSERVED_VARIANCE` then, as
    that of all that is not observed. The twist is in the object's axes: all speed is along x. The
    shape is a cylinder of no extent.

    Raises
    ------
    ImportError
        If autoware_perception_msgs is not installed.
    """
    message = messages.TrackedObjects(header=header)
    for track in tracks:
        made, existence = messages.TrackedObject(), track.existence_probability
        made.object_id.uuid = track_uuid(instance, track.track_id)
        made.existence_probability = (
            1.0 if math.isnan(existence) else float(np.clip(existence, 0.0, 1.0))
        )
        made.classification = [messages.ObjectClassification(label=0, probability=1.0)]  # UNKNOWN
        made.shape.type = 1  # CYLINDER
        _set_kinematics(made.kinematics, track)
        message.objects.append(made)
    return message


def _set_kinematics(kinematics: Any, track: ConfirmedTrack) -> None:
    """Fill in geometry_msgs of a tracked object."""
    x, vx, y, vy = track.state.tolist()
    course = math.atan2(vy, vx)
    pose, twist = kinematics.pose_with_covariance, kinematics.twist_with_covariance
    pose.pose.position.x, pose.pose.position.y = x, y
    pose.pose.orientation.z = math.sin(0.5 * course)
    pose.pose.orientation.w = math.cos(0.5 * course)
    axes = np.array([[math.cos(course), math.sin(course)], [-math.sin(course), math.cos(course)]])
    velocity = axes @ track.covariance[1::2, 1::2] @ axes.T
    twist.covariance = odometry_covariance(velocity, (X, Y))
    twist.twist.linear.x = speed = math.hypot(vx, vy)
    course_std = math.sqrt(max(float(velocity[1, 1]), 0.0)) / speed if speed else math.inf
    is_course = course_std <= MAX_COURSE_STD
    position = np.pad(track.position_covariance, (0, 1))
    position[2, 2] = course_std**2 if is_course else UNOBSERVED_VARIANCE
    pose.covariance = odometry_covariance(position, (X, Y, YAW))
    kinematics.acceleration_with_covariance.covariance = odometry_covariance(np.zeros((0, 0)), ())
    kinematics.orientation_availability = int(is_course)  # SIGN_UNKNOWN, or UNAVAILABLE
    kinematics.is_stationary = track.stationary_probability >= STANDS


def _upper_covariance(block: np.ndarray) -> Sequence[float]:
    """The upper triangle of a covariance about x, y and z, of which z is not observed."""
    (xx, xy), (_, yy) = block.tolist()
    return [xx, xy, 0.0, yy, 0.0, UNOBSERVED_VARIANCE]


Color = tuple[float, float, float]


def marker_sizes(reach: float, max_speed: float) -> dict[str, Any]:
    """Sizes of the markers of a sensor, as arguments of the functions that build them.

    Parameters
    ----------
    reach : float
        Largest range of targets, m.
    max_speed : float
        Of targets, m/s.

    Returns
    -------
    dict of str to float
        `minimum_size`, m, and `lead_time`, s.
    """
    return {"minimum_size": SIZE_SHARE * reach, "lead_time": LEAD_SHARE * reach / max_speed}


def track_markers(
    header: messages.Header,
    tracks: Iterable[ConfirmedTrack],
    ended_ids: Iterable[int] = (),
    *,
    afresh: bool = False,
    minimum_size: float = 0.0,
    lead_time: float = 1.0,
    color: Color = TRACK_COLOR,
) -> messages.MarkerArray:
    """Build the markers that show the current tracks and remove those of others.

    Each track has a sphere at its position, an arrow to its predicted position, its 95 % ellipse,
    and a label with id, speed, the largest standard deviation of the position, and the revision of
    a track that was continued. Those of a track without a detection in the last scan are fainter,
    and its ellipse is dashed; those of a track that coasts are faint, and its label says so.

    Parameters
    ----------
    header : std_msgs.msg.Header
        The fixed frame, and the stamp of the states.
    tracks : iterable of ConfirmedTrack
        Every current track.
    ended_ids : iterable of int, optional
        Ids of the tracks of the last message that are not current any more.
    afresh : bool, optional
        Remove every marker of the topic first, those of other publishers included.
    minimum_size : float, optional
        Minimum size of sphere, arrow and label, m, which otherwise have the largest standard
        deviation of the position; see `marker_sizes`. The ellipse is always to scale.
    lead_time : float, optional
        Prediction time of the arrow, s; see `marker_sizes`.
    color : (float, float, float), optional
        Red, green and blue, 0 to 1.

    Returns
    -------
    visualization_msgs.msg.MarkerArray
        Deletions first.
    """
    shapes = [
        marker
        for track in tracks
        for marker in _shapes(header, track, minimum_size, lead_time, color)
    ]
    if afresh:
        return _markers_afresh(header, shapes)
    ended = [
        _marker(header, namespace, track_id, "DELETE")
        for track_id in ended_ids
        for namespace in NAMESPACES
    ]
    return messages.MarkerArray(markers=[*ended, *shapes])


def potential_track_markers(
    header: messages.Header,
    tracks: Sequence[ConfirmedTrack],
    *,
    minimum_size: float = 0.0,
    lead_time: float = 1.0,
) -> messages.MarkerArray:
    """Build the markers of candidate tracks, which replace those of the last message.

    For speed there are only two markers: points at the positions, and lines to the predicted
    positions. The scores of tracks with the same newest hit are summed, as in the test for
    confirmation. The best of these tracks is drawn if the sum is above 0, which means that a target
    is more likely than clutter. Its colour changes from grey to orange as the sum approaches the
    threshold, ``score - evaluation``. If the method has no score, all tracks are drawn in grey. At
    most 1000 tracks are drawn, those nearest to the threshold.

    Parameters
    ----------
    header : std_msgs.msg.Header
        The fixed frame, and the stamp of the states.
    tracks : sequence of ConfirmedTrack
    minimum_size, lead_time : float, optional
        Size of the points, m, and prediction time of the lines, s; see `marker_sizes`.

    Returns
    -------
    visualization_msgs.msg.MarkerArray
    """
    arrays = TrackArrays.from_tracks(tracks)
    drawn, nearness = drawn_candidates(arrays)
    if not len(drawn):
        return clear_markers(header)  # RViz rejects a marker without points
    first = np.argsort(-nearness, kind="stable")[:_MAX_POTENTIAL]
    arrays, share = arrays.where(drawn[first]), nearness[first, None]
    (grey, orange), (faint, opaque) = np.array(POTENTIAL_COLORS), _POTENTIAL_OPACITY
    rgba = np.hstack([grey + share * (orange - grey), faint + share * (opaque - faint)])
    colors = [messages.ColorRGBA(r=r, g=g, b=b, a=a) for r, g, b, a in rgba.tolist()]
    begin = arrays.state[:, 0::2]
    ends = np.stack([begin, begin + lead_time * arrays.state[:, 1::2]], axis=1)
    size = max(minimum_size, _THICKNESS)
    positions = _marker(header, "position", kind="POINTS", scale=(size, size, 0.0), opacity=1.0)
    positions.points, positions.colors = _marker_points(begin), colors
    width = _POTENTIAL_LINE * size
    velocities = _marker(header, "velocity", kind="LINE_LIST", scale=(width, 0.0, 0.0), opacity=1.0)
    velocities.points = _marker_points(ends.reshape(-1, 2))
    velocities.colors = [color for color in colors for _ in range(2)]
    return _markers_afresh(header, [positions, velocities])


def drawn_candidates(tracks: TrackArrays) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return rows to draw, (k,), and their summed score relative to the threshold, 0 to 1, (k,).

    The scores of tracks with the same newest hit are summed, and the best of them is drawn.
    """
    scored = np.isfinite(tracks.score)
    if not scored.any():
        return np.arange(len(tracks)), np.zeros(len(tracks))
    best_first = np.flatnonzero(scored)[np.argsort(-tracks.score[scored], kind="stable")]
    newest = [tracks.hits[row][-1] for row in best_first]
    # As complex numbers, which are sorted as pairs are, and much faster.
    keys = np.array(newest) @ np.array([1.0, 1.0j])
    _, best, group = np.unique(keys, return_index=True, return_inverse=True)
    total = log_sums(tracks.score[best_first], group, len(best))
    rows = best_first[best]
    threshold = tracks.score[rows] - tracks.evaluation[rows]
    likely = total > 0.0
    return rows[likely], np.clip(total / threshold, 0.0, 1.0)[likely]


def clear_markers(header: messages.Header) -> messages.MarkerArray:
    """Build the message that removes every marker of the topic."""
    return _markers_afresh(header, [])


def _markers_afresh(
    header: messages.Header, markers: list[messages.Marker]
) -> messages.MarkerArray:
    """Markers that replace all of the topic."""
    return messages.MarkerArray(markers=[_marker(header, action="DELETEALL"), *markers])


def _marker_points(places: FloatArray) -> list[messages.Point]:
    """Points at places, (n, 2), m."""
    return [messages.Point(x=x, y=y) for x, y in places.tolist()]


def track_ellipses(covariance: FloatArray) -> FloatArray:
    """Return the 95 % ellipses of Gaussian positions.

    Parameters
    ----------
    covariance : (n, 2, 2) ndarray
        m^2.

    Returns
    -------
    (n, 3) ndarray
        Semi-axes, m, the major one first, and its angle from x, rad; 0 where the covariance is not
        finite.
    """
    bad = ~np.isfinite(covariance).all(axis=(1, 2))
    xx, xy, yy = (np.where(bad, 0.0, covariance[:, i, j]) for i, j in ((0, 0), (0, 1), (1, 1)))
    mean, half_difference = 0.5 * (xx + yy), 0.5 * (xx - yy)
    radius = np.hypot(half_difference, xy)
    # Rounding can make a zero eigenvalue negative.
    variances = np.maximum(np.stack([mean + radius, mean - radius], axis=1), 0.0)
    angle = 0.5 * np.arctan2(xy, half_difference)
    return np.column_stack([ELLIPSE_SCALE * np.sqrt(variances), angle])


def _marker(
    header: messages.Header,
    namespace: str = "",
    number: int = 0,
    action: str = "ADD",
    *,
    kind: str = "ARROW",
    scale: tuple[float, float, float] = (0.0, 0.0, 0.0),
    color: Color = (0.0, 0.0, 0.0),
    opacity: float = 0.0,
    place: Sequence[float] | FloatArray = (0.0, 0.0),
) -> messages.Marker:
    # Ids of markers are signed and those of tracks unsigned: the upper half becomes negative.
    signed_id = (number + 2**31) % 2**32 - 2**31
    marker = messages.Marker(
        header=header, ns=namespace, id=signed_id, action=getattr(messages.Marker, action)
    )
    marker.type = getattr(messages.Marker, kind)
    marker.scale.x, marker.scale.y, marker.scale.z = scale
    marker.color.r, marker.color.g, marker.color.b = color
    marker.color.a = opacity
    marker.pose.position.x, marker.pose.position.y = (float(value) for value in place)
    return marker


def _shapes(
    header: messages.Header,
    track: ConfirmedTrack,
    minimum_size: float,
    lead_time: float,
    color: Color,
) -> list[messages.Marker]:
    """Position, velocity, ellipse and label of a track."""
    major, minor, angle = track_ellipses(track.position_covariance[None])[0].tolist()
    sigma, coasts = major / ELLIPSE_SCALE, track.status == TrackStatus.COASTING
    size = max(minimum_size, sigma, _THICKNESS)
    height, dash = _LABEL_HEIGHT * size, _DASH_WIDTH * size
    missed = coasts or track.time_since_hit > 0.0
    opacity = _COASTING_OPACITY if coasts else _MISSED_OPACITY if missed else 1.0
    own: dict[str, Any] = {"number": track.track_id, "color": color, "opacity": opacity}
    position, (x, y) = track.position, track.position.tolist()
    sphere = _marker(header, "position", kind="SPHERE", scale=(size,) * 3, place=position, **own)
    # Scale of an arrow between two points: diameters of shaft and head, length of the head.
    arrow = _marker(header, "velocity", scale=(0.3 * size, 0.8 * size, size), **own)
    arrow.points = _marker_points(np.array([position, position + lead_time * track.velocity]))
    if missed:  # every second segment, along the ellipse
        scale = (dash, 0.0, 0.0)
        ellipse = _marker(header, "ellipse", kind="LINE_LIST", scale=scale, place=position, **own)
        turn = np.linspace(0.0, math.tau, 2 * _DASHES, endpoint=False)
        ellipse.points = _marker_points(
            np.column_stack([major * np.cos(turn), minor * np.sin(turn)])
        )
    else:
        own["opacity"] = _ELLIPSE_OPACITY
        scale = (max(2 * major, _THICKNESS), max(2 * minor, _THICKNESS), _THICKNESS)
        ellipse = _marker(header, "ellipse", kind="CYLINDER", scale=scale, place=position, **own)
    turned = ellipse.pose.orientation
    turned.z, turned.w = math.sin(angle / 2), math.cos(angle / 2)
    own |= {"opacity": opacity, "scale": (0.0, 0.0, height), "place": (x, y + height)}
    label = _marker(header, "label", kind="TEXT_VIEW_FACING", **own)
    # ASCII only: RViz's font has no Greek letters.
    speed = math.hypot(*track.velocity)
    label.text = f"{track.track_id}: {_digits(speed, 1)} m/s, sigma {_digits(sigma, 0)} m"
    if track.revision:
        label.text += f", revision {track.revision}"
    if coasts:
        label.text += f", coasting, exists {track.existence_probability:.0%}"
    return [sphere, arrow, ellipse, label]


def _digits(value: float, decimals: int) -> str:
    """A length or speed with some decimals, and with more where it has not two digits."""
    return f"{value:.{max(decimals, 1 - math.floor(math.log10(max(value, 0.01))))}f}"


def truth_tracks(stamp: float, states: NDArray[np.float64]) -> list[ConfirmedTrack]:
    """True states as tracks without error.

    Parameters
    ----------
    stamp : float
        s.
    states : (k, 4) ndarray
        ``[x, vx, y, vy]`` of each target, m and m/s.

    Returns
    -------
    list of ConfirmedTrack
        `track_id` is the target's index, the covariance 0, the evaluation nan.
    """
    return [
        ConfirmedTrack(index, stamp, state, np.zeros((4, 4)), (), math.nan)
        for index, state in enumerate(np.reshape(states, (-1, 4)))
    ]


def truth_markers(
    header: messages.Header, truth: list[ConfirmedTrack], reach: float = 0.0
) -> messages.MarkerArray:
    """Markers of the truth: position, velocity and label in `TRUTH_COLOR`.

    Their sizes are those of targets up to a distance `reach` (m), and of the fastest of these.
    """
    fastest = max((math.hypot(*track.velocity) for track in truth), default=0.0)
    return track_markers(header, truth, color=TRUTH_COLOR, **marker_sizes(reach, fastest or 1.0))


def fixed_echo_markers(
    header: messages.Header, echoes: Sequence[ConfirmedTrack], *, minimum_size: float = 0.0
) -> messages.MarkerArray:
    """Build the markers of fixed echoes, which replace those of the last message.

    A cube at each place, and a label with the id and the minutes since the first hit.

    Parameters
    ----------
    header : std_msgs.msg.Header
        The fixed frame, and the stamp of the states.
    echoes : sequence of ConfirmedTrack
    minimum_size : float, optional
        Length of the edges and height of the labels, m; see `marker_sizes`. At least
        the median standard deviation of the places.

    Returns
    -------
    visualization_msgs.msg.MarkerArray
    """
    arrays = TrackArrays.from_tracks(echoes)
    if not len(arrays):
        return clear_markers(header)  # RViz rejects a marker without points
    own: dict[str, Any] = {"color": FIXED_ECHO_COLOR, "opacity": 1.0}
    sigma = major_sigma(arrays.covariance[:, 0::2, 0::2])
    size = max(minimum_size, float(np.median(sigma)), _THICKNESS)
    cubes = _marker(header, "position", kind="CUBE_LIST", scale=(size,) * 3, **own)
    cubes.points = _marker_points(arrays.state[:, 0::2])
    markers = [cubes]
    own |= {"kind": "TEXT_VIEW_FACING", "scale": (0.0, 0.0, size)}
    for number, row in enumerate(np.argsort(-arrays.age, kind="stable")[:MAX_LABELS].tolist()):
        echo = arrays[row]
        x, y = echo.position.tolist()
        label = _marker(header, "label", number, place=(x, y + size), **own)
        label.text = f"{echo.track_id}: {echo.age / 60.0:.1f} min"
        markers.append(label)
    return _markers_afresh(header, markers)


def detection_markers(
    header: messages.Header, scan: Scan, size: float, axes: str = ""
) -> messages.MarkerArray:
    """Build the marker of a scan's detections, which replaces that of the last message.

    Parameters
    ----------
    header : std_msgs.msg.Header
        The sensor's frame.
    scan : Scan
    size : float
        Diameter of the points, m.
    axes : str, optional
        Of the frame, as in `ImagePing`.
    """
    if not len(scan):
        return clear_markers(header)
    points = _marker(
        header,
        "detection",
        kind="SPHERE_LIST",
        scale=(size,) * 3,
        color=DETECTION_COLOR,
        opacity=1.0,
    )
    turn_plane(points.pose.orientation, header.frame_id, axes)
    ahead, port = np.cos(scan.azimuth), np.sin(scan.azimuth)
    points.points = _marker_points(scan.range[:, None] * np.column_stack([ahead, port]))
    return _markers_afresh(header, [points])
