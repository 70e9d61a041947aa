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
"""An example of a downstream tracker: starts from `tracks`, follows, publishes `tracked`.

    python examples/kalman_tracker.py

For every processed ping `track_initiator` publishes one message on `tracks`, also without new
tracks, and one on `detections/placed` with the same stamp. When both have arrived, all targets
are updated with their detections, new tracks become targets, and `tracked` has all targets.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import Any

import rclpy
from nearest_neighbour import NearestNeighbourTracker
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import PointCloud2

from msg_adapters import (
    make_header,
    read_placed_detections,
    time_to_ns,
    track_cloud,
    tracker_report,
)

DEPTH = 1000  # queue depth of each topic


class KalmanTracker(Node):
    """Follows the tracks that `track_initiator` starts."""

    def __init__(self, **node_options: Any) -> None:
        super().__init__("kalman_tracker", **node_options)
        noise = self.declare_parameter(
            "acceleration_density",
            0.01,
            ParameterDescriptor(
                description="Spectral density of the targets' acceleration [m^2/s^3]",
                floating_point_range=[FloatingPointRange(from_value=0.0, to_value=1e6)],
                read_only=True,
            ),
        )
        max_misses = self.declare_parameter(
            "max_misses",
            4,
            ParameterDescriptor(
                description="A target with more misses in a row ends",
                integer_range=[IntegerRange(from_value=0, to_value=10**6)],
                read_only=True,
            ),
        )
        self._tracker = NearestNeighbourTracker(noise.value, max_misses.value)
        self._waiting: deque[PointCloud2] = deque(maxlen=DEPTH)
        self._placed: deque[PointCloud2] = deque(maxlen=DEPTH)
        self._has_current = False

        self._tracked = self.create_publisher(PointCloud2, "tracked", 10)
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.create_subscription(PointCloud2, "tracks/current", self._on_current, latched)
        self.create_subscription(PointCloud2, "tracks", self._on_tracks, DEPTH)
        self.create_subscription(PointCloud2, "detections/placed", self._on_placed, DEPTH)
        self.get_logger().info("waiting for tracks/current")

    def _on_current(self, message: PointCloud2) -> None:
        """Take over, once, the tracks of before this node's start; later ones are on `tracks`."""
        if self._has_current:
            return
        self._has_current = True
        report = tracker_report(message)
        self._tracker.stamp = report.stamp
        self._tracker.start(report.tracks)
        while self._waiting and stamp_ns(self._waiting[0]) <= stamp_ns(message):
            self._waiting.popleft()
        self._process()

    def _on_tracks(self, message: PointCloud2) -> None:
        self._waiting.append(message)
        self._process()

    def _on_placed(self, message: PointCloud2) -> None:
        self._placed.append(message)
        self._process()

    def _process(self) -> None:
        """Process the pings of which both messages have arrived.

        Each topic keeps its order: once a later ping is complete, the missing message of an earlier
        ping is lost, and the filters predict over that ping.
        """
        if not self._has_current:
            return
        for message in list(self._waiting):
            stamps = [stamp_ns(placed) for placed in self._placed]
            if stamp_ns(message) not in stamps:
                continue
            for _ in range(stamps.index(stamp_ns(message))):
                self._placed.popleft()
            while self._waiting.popleft() is not message:
                self.get_logger().warning("a ping without detections passed over")
            self._follow(message, self._placed.popleft())

    def _follow(self, message: PointCloud2, placed: PointCloud2) -> None:
        report, detections = tracker_report(message), read_placed_detections(placed)
        if report.stamp < self._tracker.stamp:
            self.get_logger().warning(f"time went back to {report.stamp:.3f} s: starting over")
            self._tracker.clear()
        before = set(self._tracker.targets)
        self._tracker.step(
            report.stamp, detections.position, detections.covariance, detections.time_offset
        )
        self._tracker.start(report.tracks)
        if continued := [track.track_id for track in report.tracks if track.revision]:
            self.get_logger().info(f"{report.stamp:.0f} s: starts {continued} again")
        if before != set(self._tracker.targets):
            self.get_logger().info(f"{report.stamp:.0f} s: follows {sorted(self._tracker.targets)}")
        header = make_header(stamp_ns(message), report.frame_id)
        self._tracked.publish(track_cloud(header, self._tracker.tracks()))


def stamp_ns(message: PointCloud2) -> int:
    """Stamp of a message, ns."""
    return time_to_ns(message.header.stamp)


def main(args: Sequence[str] | None = None) -> None:
    """Run the node until it is interrupted."""
    rclpy.init(args=args)
    executor = SingleThreadedExecutor()
    try:
        node = KalmanTracker()
        try:
            executor.add_node(node)
            executor.spin()
        finally:
            node.destroy_node()
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        executor.shutdown()  # executor and node end before the context
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
