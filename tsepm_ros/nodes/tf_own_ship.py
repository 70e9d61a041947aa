"""Own-ship poses from tf, if tf2_ros is installed."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.time import Time

from tsepm_ros.nodes.node_parameters import ParameterError
from tsepm_ros.own_ship.attitude import AXES, angles_of, east_north_up, rotation_of
from tsepm_ros.own_ship.pose_history import PoseSample
from tsepm_ros.session.session import Session

CACHE_TIME = 120.0
"""Time for which transforms are kept, s: a ping arrives many seconds after its stamp."""
SAMPLE_PERIOD = 0.2
"""Interval of the poses over a scan's echoes, s: short compared to a small boat's roll period."""


class TfOwnShip:
    """Looks up the sensor's poses for the scans that wait for them.

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

    def __init__(self, node: Node, session: Session, buffer: Any = None) -> None:
        self._session = session
        self._fixed_frame = session.fixed_frame
        if not self._fixed_frame:
            raise ParameterError("fixed_frame must be given where own_ship_source is tf")
        if buffer is None:
            try:
                import tf2_ros
            except ImportError:
                raise ParameterError(
                    "own_ship_source is tf, but the package tf2_ros is not installed"
                ) from None
            buffer = tf2_ros.Buffer(cache_time=Duration(seconds=CACHE_TIME), node=node)
            self._listener = tf2_ros.TransformListener(buffer, node)
        self._buffer = buffer

    def look_up(self, frame: str, first: float, last: float, axes: str) -> str:
        """Give the session the poses of a frame from `first` to `last` (s), as far as tf has them.

        Returns what tf does not have, in words; empty if it has all.

        `axes` names the frame's axes that point ahead, to port and up, as in
        `tsepm_ros.own_ship.attitude.AXES`.
        """
        intervals = max(1, math.ceil((last - first) / SAMPLE_PERIOD))
        for stamp in np.linspace(first, last, intervals + 1).tolist():
            newest = self._session.own_ship_stamp
            if stamp < 0 or (newest is not None and stamp <= newest):
                continue
            time = Time(nanoseconds=round(stamp * 1e9))
            if not self._buffer.can_transform(self._fixed_frame, frame, time):
                return (
                    f"tf has no transform from {frame!r} to {self._fixed_frame!r} at {stamp:.3f} s"
                )
            transform = self._buffer.lookup_transform(self._fixed_frame, frame, time).transform
            self._session.add_own_ship(_sample(stamp, transform, axes, self._fixed_frame))
        return ""


def _sample(stamp: float, transform: Any, axes: str, frame_id: str) -> PoseSample:
    q, world = transform.rotation, east_north_up(frame_id)
    x, y = (world[:2, :2] @ [transform.translation.x, transform.translation.y]).tolist()
    try:
        yaw, pitch, roll = angles_of(world @ rotation_of((q.x, q.y, q.z, q.w)) @ AXES[axes])
    except ValueError:  # no heading: the session refuses and counts nan
        yaw = pitch = roll = math.nan
    return PoseSample(stamp, x, y, yaw, roll=roll, pitch=pitch, frame_id=frame_id)
