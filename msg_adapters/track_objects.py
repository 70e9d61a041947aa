"""Tracks in radar_msgs/RadarTracks and autoware_perception_msgs/TrackedObjects.

What each message cannot take is left out: RadarTracks has no existence, age or hits and no
covariance between position and velocity; TrackedObjects has these neither, but the existence.
"""

from __future__ import annotations

import math
import uuid
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from msg_adapters.nav_messages import UNOBSERVED_VARIANCE, X, Y, odometry_covariance
from tsepm_ros.tracker.tracks import TrackArrays

if TYPE_CHECKING:
    from autoware_perception_msgs.msg import TrackedObjects
    from radar_msgs.msg import RadarTracks
    from std_msgs.msg import Header

STANDS, MOVES = 0.9, 0.1
"""Probabilities to stand still from which on, and up to which, a track is classified."""


def track_uuid(instance: uuid.UUID, track_id: int) -> uuid.UUID:
    """The UUID of a track of one run of the node.

    Parameters
    ----------
    instance : uuid.UUID
        Drawn at the start: a later run's tracks have other UUIDs.
    track_id : int
    """
    return uuid.uuid5(instance, str(track_id))


def radar_tracks(header: Header, tracks: TrackArrays, instance: uuid.UUID) -> RadarTracks:
    """Make a message of tracks.

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
    from radar_msgs.msg import RadarTrack, RadarTracks

    message = RadarTracks(header=header)
    for row, track_id in enumerate(tracks.track_id.tolist()):
        track, stands = RadarTrack(), tracks.stationary_probability[row]
        _set_uuid(track.uuid, instance, track_id)
        track.position.x, track.velocity.x, track.position.y, track.velocity.y = _state(tracks, row)
        if not math.isnan(stands):
            # NO_CLASSIFICATION, STATIC and DYNAMIC are 0, 1 and 2.
            track.classification = 1 if stands >= STANDS else 2 if stands <= MOVES else 0
        position, velocity = _blocks(tracks, row)
        track.position_covariance = _upper(position)
        track.velocity_covariance = _upper(velocity)
        unknown = _upper(UNOBSERVED_VARIANCE * np.eye(2))
        track.acceleration_covariance = track.size_covariance = unknown
        message.tracks.append(track)
    return message


def tracked_objects(header: Header, tracks: TrackArrays, instance: uuid.UUID) -> TrackedObjects:
    """Make a message of tracks; see `radar_tracks`.

    The orientation is the course, which is said to be known up to its sign. The twist is in the
    object's axes: all speed is along x. The shape is a cylinder of no extent.

    Raises
    ------
    ImportError
        If autoware_perception_msgs is not installed.
    """
    from autoware_perception_msgs.msg import ObjectClassification, TrackedObject, TrackedObjects

    message = TrackedObjects(header=header)
    for row, track_id in enumerate(tracks.track_id.tolist()):
        made = TrackedObject()
        _set_uuid(made.object_id, instance, track_id)
        existence = float(tracks.existence_probability[row])
        made.existence_probability = 1.0 if math.isnan(existence) else existence
        made.classification = [ObjectClassification(label=0, probability=1.0)]  # UNKNOWN
        made.shape.type = 1  # CYLINDER
        _set_kinematics(made.kinematics, tracks, row)
        message.objects.append(made)
    return message


def _set_kinematics(kinematics: Any, tracks: TrackArrays, row: int) -> None:
    """Fill in geometry_msgs of a tracked object."""
    x, vx, y, vy = _state(tracks, row)
    course, speed = math.atan2(vy, vx), math.hypot(vx, vy)
    pose, twist = kinematics.pose_with_covariance, kinematics.twist_with_covariance
    pose.pose.position.x, pose.pose.position.y = x, y
    pose.pose.orientation.z = math.sin(0.5 * course)
    pose.pose.orientation.w = math.cos(0.5 * course)
    position, velocity = _blocks(tracks, row)
    axes = np.array([[math.cos(course), math.sin(course)], [-math.sin(course), math.cos(course)]])
    twist.twist.linear.x = speed
    pose.covariance = odometry_covariance(position, (X, Y))
    twist.covariance = odometry_covariance(axes @ velocity @ axes.T, (X, Y))
    kinematics.orientation_availability = 1  # SIGN_UNKNOWN
    kinematics.is_stationary = bool(tracks.stationary_probability[row] >= STANDS)


def _set_uuid(field: Any, instance: uuid.UUID, track_id: int) -> None:
    field.uuid = np.frombuffer(track_uuid(instance, track_id).bytes, np.uint8)


def _state(tracks: TrackArrays, row: int) -> Iterator[float]:
    """x, vx, y and vy of a track."""
    return (float(value) for value in tracks.state[row])


def _blocks(tracks: TrackArrays, row: int) -> tuple[np.ndarray, np.ndarray]:
    """Covariances of position and of velocity, (2, 2) each."""
    covariance = tracks.covariance[row]
    return covariance[0::2, 0::2], covariance[1::2, 1::2]


def _upper(block: np.ndarray) -> Sequence[float]:
    """The upper triangle of a covariance about x, y and z, of which z is not observed."""
    (xx, xy), (_, yy) = block.tolist()
    return [xx, xy, 0.0, yy, 0.0, UNOBSERVED_VARIANCE]
