"""A downstream tracker, as an example: starts from `tracks`, follows, says so on `tracked`.

    python examples/kalman_tracker.py --ros-args -p own_ship_source:=odometry

Every ping that `track_initiator` has processed comes as one message on `tracks`, even when it
brings no track. That is the beat here: when it and the detections with the same stamp are there,
all targets take their detections, new tracks become targets, and `tracked` tells them all.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from nav_msgs.msg import Odometry
from nearest_neighbour import NearestNeighbourTracker
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import PointCloud2

from msg_adapters import (
    MessageError,
    make_header,
    pose_sample,
    read_detections,
    read_own_ship,
    sensor_scan,
    time_to_ns,
    track_cloud,
    tracker_report,
)
from tsepm_ros import Scan, SensorModel
from tsepm_ros.conversion import convert
from tsepm_ros.nodes.detections_subscription import DetectionsSubscription
from tsepm_ros.nodes.node_parameters import AUTO_DECLARE, NodeParameters
from tsepm_ros.nodes.offered_subscription import OfferedSubscription
from tsepm_ros.nodes.running import run
from tsepm_ros.own_ship import PoseHistory, echo_poses
from tsepm_ros.parameters import check_group, parameter
from tsepm_ros.session import SensorScan

DEPTH = 1000  # messages of a kind that may queue up
RESTART_JUMP = 60.0  # own-ship data farther back than this begins a new history, s


@dataclass(frozen=True, kw_only=True)
class TrackerOptions:
    """Parameters besides `sensor.*`; the first two as in `track_initiator`."""

    own_ship_source: str = parameter(
        "none",
        "Where the sensor's pose comes from: none (it does not move) or odometry",
        choices=("none", "odometry"),
        read_only=True,
    )
    bearing_reference: str = parameter(
        "bow", "What a field named bearing is measured from, clockwise", choices=("bow", "north")
    )
    acceleration_density: float = parameter(
        0.01, "Spectral density of the targets' acceleration", unit="m^2/s^3", minimum=0.0
    )
    max_misses: int = parameter(4, "A target with more misses in a row ends", minimum=0)

    def __post_init__(self) -> None:
        check_group(self)


class KalmanTracker(Node):
    """Follows what `track_initiator` starts."""

    def __init__(self, **node_options: Any) -> None:
        super().__init__("kalman_tracker", **AUTO_DECLARE, **node_options)
        given = NodeParameters(self, (("", TrackerOptions), ("sensor.", SensorModel)))
        self._options: TrackerOptions = given.made[TrackerOptions]
        self._sensor: SensorModel = given.made[SensorModel]
        self._tracker = NearestNeighbourTracker(
            self._sensor, self._options.acceleration_density, self._options.max_misses
        )
        self._poses = PoseHistory()
        self._scans: deque[SensorScan] = deque(maxlen=DEPTH)
        self._waiting: deque[PointCloud2] = deque(maxlen=DEPTH)
        self._has_current = False

        self._tracked = self.create_publisher(PointCloud2, "tracked", 10)
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.create_subscription(PointCloud2, "tracks/current", self._on_current, latched)
        self.create_subscription(PointCloud2, "tracks", self._on_tracks, DEPTH)
        self._detections = DetectionsSubscription(self, "auto", "auto", DEPTH, self._on_detections)
        if self._options.own_ship_source == "odometry":
            self._own_ship = OfferedSubscription(
                self, Odometry, "own_ship/odometry", DEPTH, self._on_own_ship
            )

    def _on_current(self, message: PointCloud2) -> None:
        """Take over, once, what was started before this node; from then on `tracks` tells."""
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

    def _on_detections(self, message: Any) -> None:
        try:
            detections = read_detections(message, bearing_reference=self._options.bearing_reference)
        except MessageError as error:
            self.get_logger().warning(f"detections dropped: {error}", throttle_duration_sec=10.0)
            return
        self._scans.append(sensor_scan(detections))
        self._process()

    def _on_own_ship(self, message: Odometry) -> None:
        try:
            sample = pose_sample(read_own_ship(message))
            sample.check()
        except (MessageError, ValueError) as error:
            self.get_logger().warning(f"own ship dropped: {error}", throttle_duration_sec=10.0)
            return
        last = self._poses.last_stamp
        if last is not None and last - sample.stamp > RESTART_JUMP:
            self._poses.clear()
        self._poses.add(sample)
        self._process()

    def _process(self) -> None:
        """Process the pings for which everything is there.

        Each topic keeps its order: where a later ping is complete, what an earlier one lacks is
        lost, and the filters are simply carried over it.
        """
        if not self._has_current:
            return
        for message in list(self._waiting):
            scan = self._placed(stamp_ns(message))
            if scan is None:
                continue
            while self._waiting.popleft() is not message:
                self.get_logger().warning("a ping without detections or own ship passed over")
            self._follow(message, scan)

    def _follow(self, message: PointCloud2, scan: Scan) -> None:
        new = tracker_report(message)
        if new.stamp < self._tracker.stamp:
            self.get_logger().warning(f"time went back to {new.stamp:.3f} s: starting over")
            self._tracker.clear()
        before = set(self._tracker.targets)
        self._tracker.step(new.stamp, convert(scan, self._sensor, 0))
        self._tracker.start(new.tracks)
        if before != set(self._tracker.targets):
            self.get_logger().info(f"{new.stamp:.0f} s: follows {sorted(self._tracker.targets)}")
        header = make_header(stamp_ns(message), new.frame_id)
        self._tracked.publish(track_cloud(header, self._tracker.tracks()))

    def _placed(self, stamp: int) -> Scan | None:
        """The scan of a stamp (ns) in the fixed frame; None while it or its poses are missing."""
        arrived = next((one for one in reversed(self._scans) if one.stamp_ns == stamp), None)
        if arrived is None or self._options.own_ship_source == "none":
            return arrived.scan if arrived else None
        scan = arrived.scan
        try:
            poses = echo_poses(
                self._poses.poses,
                scan.stamp,
                scan.time_offset,
                scan.azimuth,
                transmit_offset=arrived.transmit_offset,
                heading=not arrived.north_referenced,
            )
        except ValueError:  # not known yet
            return None
        # Its errors, without the heading's where that was not used.
        errors = self._poses.covariance(scan.stamp)
        if errors is not None and arrived.north_referenced:
            errors = errors * np.outer([1, 1, 0], [1, 1, 0])
        return replace(scan, sensor_pose=poses, sensor_pose_covariance=errors)


def stamp_ns(message: PointCloud2) -> int:
    """Stamp of a message, ns."""
    return time_to_ns(message.header.stamp)


def main(args: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run(KalmanTracker, args)


if __name__ == "__main__":
    raise SystemExit(main())
