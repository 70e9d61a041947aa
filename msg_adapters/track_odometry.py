"""A track as nav_msgs/Odometry, for tools that read only standard messages."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from msg_adapters.odometry_covariance import X, Y, odometry_covariance

if TYPE_CHECKING:
    from nav_msgs.msg import Odometry
    from std_msgs.msg import Header

    from tsepm_ros.kinematics.track import ConfirmedTrack


def track_odometry(header: Header, track: ConfirmedTrack) -> Odometry:
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
    from nav_msgs.msg import Odometry

    message = Odometry(header=header, child_frame_id=f"track_{track.track_id}")
    position, velocity = message.pose.pose.position, message.twist.twist.linear
    position.x, velocity.x, position.y, velocity.y = (float(value) for value in track.state)
    message.pose.pose.orientation.w = 1.0
    velocity_covariance = track.covariance[np.ix_([1, 3], [1, 3])]
    message.pose.covariance = odometry_covariance(track.position_covariance, (X, Y))
    message.twist.covariance = odometry_covariance(velocity_covariance, (X, Y))
    return message
