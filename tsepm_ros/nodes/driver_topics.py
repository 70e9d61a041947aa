"""Topics of a sonar driver and of the ground truth, published by simulator and player."""

from __future__ import annotations

import numpy as np
from nav_msgs.msg import Odometry
from numpy.typing import NDArray
from rclpy.node import Node
from rclpy.publisher import Publisher
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Header
from visualization_msgs.msg import MarkerArray

from msg_adapters import (
    make_header,
    odometry_message,
    seconds_to_ns,
    track_cloud,
    truth_markers,
    truth_tracks,
)
from tsepm_ros.nodes import qos_overrides
from tsepm_ros.nodes.playback import PUBLISHER_DEPTH
from tsepm_ros.own_ship.pose_sample import PoseSample


class DriverTopics:
    """Publishers of detections, own ship and truth.

    Parameters
    ----------
    node : rclpy.node.Node
    detections_type : type
        Message class of the detections.
    fixed_frame, sensor_frame : str
        Frame of own ship and truth; frame of the detections.
    own_ship : bool, optional
        Whether there is an own ship; without it there is no topic that a node might wait for.

    Attributes
    ----------
    detections : Publisher
    publishers : list of Publisher
        Publishers whose messages must be acknowledged.
    """

    def __init__(
        self,
        node: Node,
        detections_type: type,
        fixed_frame: str,
        sensor_frame: str,
        own_ship: bool = True,
    ) -> None:
        self._frames = fixed_frame, sensor_frame
        self._place, self._reach = np.zeros(2), 0.0  # of the own ship; largest range of a target

        def publisher(kind: type, topic: str, depth: int = PUBLISHER_DEPTH) -> Publisher:
            options = qos_overrides.PUBLISHER
            return node.create_publisher(kind, topic, depth, qos_overriding_options=options)

        self.detections = publisher(detections_type, "detections")
        self._own_ship = publisher(Odometry, "own_ship/odometry") if own_ship else None
        self._truth = publisher(PointCloud2, "ground_truth")
        self._truth_markers = publisher(MarkerArray, "ground_truth/markers", 10)
        self.publishers = [self.detections, self._truth]
        if self._own_ship is not None:
            self.publishers.append(self._own_ship)

    def sensor_header(self, stamp: float) -> Header:
        """Header of detections with a stamp, s."""
        return make_header(seconds_to_ns(stamp), self._frames[1])

    def publish_own_ship(
        self,
        stamp: float,
        pose: tuple[float, float, float | None],
        rates: tuple[float, float, float],
        roll: float = 0.0,
        pitch: float = 0.0,
    ) -> None:
        """Publish the own ship.

        Parameters
        ----------
        stamp : float
            s.
        pose : tuple of float
            x, y and yaw in the fixed frame, m and rad; None for an unknown yaw.
        rates : tuple of float
            vx, vy (fixed frame, m/s) and yaw rate (rad/s).
        roll, pitch : float, optional
            rad.

        Raises
        ------
        ValueError
            If there is no own ship.
        """
        if self._own_ship is None:
            raise ValueError("there is no own ship")
        x, y, yaw = pose
        self._place = np.array([x, y])
        frame_id, child_frame_id = self._frames
        sample = PoseSample(
            stamp,
            x,
            y,
            yaw or 0.0,
            rates=rates,
            roll=roll,
            pitch=pitch,
            frame_id=frame_id,
            child_frame_id=child_frame_id,
        )
        self._own_ship.publish(odometry_message(sample, heading_known=yaw is not None))

    def publish_truth(self, stamp: float, states: NDArray[np.float64]) -> None:
        """Publish the targets' true states (k, 4) at a stamp, s."""
        header = make_header(seconds_to_ns(stamp), self._frames[0])
        truth = truth_tracks(stamp, states)
        self._truth.publish(track_cloud(header, truth))
        ranges = np.hypot(*(np.reshape(states, (-1, 4))[:, 0::2] - self._place).T)
        self._reach = max(self._reach, float(ranges.max(initial=0.0)))
        self._truth_markers.publish(truth_markers(header, truth, self._reach))
