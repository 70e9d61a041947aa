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
"""Own ship's poses from tf, if tf2_ros is installed."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.time import Time

from msg_adapters import MessageError
from tsepm_ros.nodes.base_node import ParameterError
from tsepm_ros.own_ship.pose_history import PoseSample
from tsepm_ros.own_ship.registration import (
    AXES,
    registration_angles,
    registration_axes,
    registration_east_north_up,
    registration_rotation,
)
from tsepm_ros.session.session import Session

CACHE_TIME = 120.0
"""Time for which transforms are kept, s: a ping arrives many seconds after its stamp."""
VELOCITY_SPAN = 1.0
"""Time between two poses of tf whose difference is a velocity, s."""
SAMPLE_PERIOD = 0.2
"""Interval of the poses over a scan's echoes, s: short compared to a small boat's roll period."""


def tf_look_up(
    node: Node, session: Session, buffer: Any = None
) -> Callable[[str, float, float, str], str]:
    """Return a function that gives a session the sensor's poses from tf.

    Its arguments are the sensor's frame, the first and the last stamp (s) for which poses are
    needed, and the frame's axes that point ahead, to port and up, by a name of
    `tsepm_ros.own_ship.registration.AXES`. It returns what tf does not have, in words; an empty
    text if tf has all.

    Parameters
    ----------
    node : rclpy.node.Node
    session : Session
        Takes the poses.
    buffer : tf2_ros.Buffer, optional
        By default a new buffer with a listener.

    Raises
    ------
    ParameterError
        If tf2_ros is not installed, or no fixed frame is given.
    """
    fixed_frame = session.fixed_frame
    if not fixed_frame:
        raise ParameterError("fixed_frame must be given where own_ship_source is tf")
    buffer = tf_buffer(node) if buffer is None else buffer

    def look_up(frame: str, first: float, last: float, axes: str) -> str:
        intervals = max(1, math.ceil((last - first) / SAMPLE_PERIOD))
        for stamp in np.linspace(first, last, intervals + 1).tolist():
            last_stamp = session.own_ship.poses.last_stamp
            if stamp < 0 or (last_stamp is not None and stamp <= last_stamp):
                continue
            late = stamp + session.settings.session.own_ship_delay
            at = Time(nanoseconds=max(0, round(late * 1e9)))
            if not buffer.can_transform(fixed_frame, frame, at):
                return f"tf has no transform from {frame!r} to {fixed_frame!r} at {late:.3f} s"
            transform = buffer.lookup_transform(fixed_frame, frame, at).transform
            session.add_own_ship(_pose_sample(late, transform, axes, fixed_frame))
        return ""

    return look_up


def tf_buffer(node: Node) -> Any:
    """Return a tf2_ros.Buffer with a listener.

    Raises
    ------
    ParameterError
        If tf2_ros is not installed.
    """
    try:
        import tf2_ros
    except ImportError:
        raise ParameterError(
            "own_ship_source is tf, but the package tf2_ros is not installed"
        ) from None
    buffer = tf2_ros.Buffer(cache_time=Duration(seconds=CACHE_TIME), node=node)
    tf2_ros.TransformListener(buffer, node)  # the node's subscriptions keep it
    return buffer


def tf_own_ship(
    buffer: Any, fixed_frame: str, frame: str, stamp: float, axes: str = ""
) -> PoseSample:
    """Pose and velocity of a vessel at a stamp, or the newest before, as tf has them.

    Parameters
    ----------
    buffer : tf2_ros.Buffer
    fixed_frame, frame : str
        Of the result, and of the vessel.
    stamp : float
        s.
    axes : str, optional
        Convention of the frame's axes, a key of `AXES`; empty: as its name states.

    Returns
    -------
    PoseSample
        Without a velocity if tf has no pose `VELOCITY_SPAN` before.

    Raises
    ------
    MessageError
        If tf has no pose: ``no_own_ship``.
    """
    at = Time(nanoseconds=max(0, round(stamp * 1e9)))
    fixed_frame, frame = fixed_frame.lstrip("/"), frame.lstrip("/")  # tf2 refuses a leading slash
    at = at if buffer.can_transform(fixed_frame, frame, at) else Time()  # the newest
    if not (fixed_frame and buffer.can_transform(fixed_frame, frame, at)):
        raise MessageError("no_own_ship", f"tf has no transform from {frame!r} to {fixed_frame!r}")
    stamped = buffer.lookup_transform(fixed_frame, frame, at)
    stamp = Time.from_msg(stamped.header.stamp).nanoseconds * 1e-9
    axes = axes or registration_axes(frame)
    sample = _pose_sample(stamp, stamped.transform, axes, fixed_frame)
    before = Time(nanoseconds=max(1, round((stamp - VELOCITY_SPAN) * 1e9)))
    if not buffer.can_transform(fixed_frame, frame, before):
        return sample
    earlier = buffer.lookup_transform(fixed_frame, frame, before).transform
    start = _pose_sample(stamp, earlier, axes, fixed_frame)
    vx, vy = (sample.x - start.x) / VELOCITY_SPAN, (sample.y - start.y) / VELOCITY_SPAN
    return replace(sample, rates=(vx, vy, math.nan))


def _pose_sample(stamp: float, transform: Any, axes: str, frame_id: str) -> PoseSample:
    q, world = transform.rotation, registration_east_north_up(frame_id)
    x, y = (world[:2, :2] @ [transform.translation.x, transform.translation.y]).tolist()
    try:
        yaw, pitch, roll = registration_angles(
            world @ registration_rotation((q.x, q.y, q.z, q.w)) @ AXES[axes]
        )
    except ValueError:  # no heading: the session refuses and counts nan
        yaw = pitch = roll = math.nan
    return PoseSample(stamp, x, y, yaw, roll=roll, pitch=pitch, frame_id=frame_id)
