"""The node that plays recorded scans on the topics of a sonar driver."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from typing import Any

import numpy as np
from nav_msgs.msg import Odometry
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2
from visualization_msgs.msg import MarkerArray

from msg_adapters import (
    OwnShipSample,
    detections_cloud,
    make_header,
    odometry_message,
    seconds_to_ns,
    track_cloud,
    truth_markers,
    truth_tracks,
)
from tsepm_ros.nodes.node_parameters import AUTO_DECLARE, NodeParameters, ParameterError
from tsepm_ros.nodes.playback import PUBLISHER_DEPTH, Event, Playback
from tsepm_ros.nodes.running import run
from tsepm_ros.parameter_groups import SCAN_PLAYER, PlayerNodeOptions
from tsepm_ros.recording import RecordedMotion, RecordedScan, read_recording

LOG_PERIOD = 5.0
LARGEST_STAMP = 2.0**31 - 1


class ScanPlayer(Node):
    """Publishes the scans, the own ship and the truth of a recording."""

    def __init__(self, **node_options: Any) -> None:
        super().__init__("scan_player", **AUTO_DECLARE, **node_options)
        options = NodeParameters(self, SCAN_PLAYER).made[PlayerNodeOptions]
        self._options: PlayerNodeOptions = options
        if not options.recording:
            raise ParameterError("recording must be the folder of a recording; got ''")
        try:
            self._recording = read_recording(options.recording)
        except ValueError as error:
            raise ParameterError(f"recording: {error}") from None
        self._shift = options.start_stamp
        first, last = self._recording.span
        if self._shift < 0:
            self._shift = self.get_clock().now().nanoseconds * 1e-9 - first
        if not 0 <= first + self._shift <= last + self._shift <= LARGEST_STAMP:
            raise ParameterError(
                f"recording: with start_stamp its stamps go from {first + self._shift:g} to "
                f"{last + self._shift:g} s; ROS takes 0 to {LARGEST_STAMP:g} s"
            )

        self._detections = self.create_publisher(PointCloud2, "detections", PUBLISHER_DEPTH)
        self._own_ship = self.create_publisher(Odometry, "own_ship/odometry", PUBLISHER_DEPTH)
        self._truth = self.create_publisher(PointCloud2, "ground_truth", PUBLISHER_DEPTH)
        self._truth_markers = self.create_publisher(MarkerArray, "ground_truth/markers", 10)
        self._playback = Playback(
            self,
            self._events,
            [self._own_ship, self._detections, self._truth],
            wait_for=self._detections,
            wait_for_subscribers=options.wait_for_subscribers,
            settling_time=options.settling_time,
            rate_factor=options.rate_factor,
            publish_clock=options.publish_clock,
            loop=options.loop,
        )
        self.finished = self._playback.finished

    def _events(self) -> Iterator[Event]:
        """What was recorded, in order of time; at equal times own ship, truth, scan."""
        events: list[tuple[float, int, Any]] = [
            (motion.time, 0, partial(self._publish_own_ship, motion))
            for motion in self._recording.own_ship
        ]
        times = sorted(
            {motion.time for path in self._recording.targets.values() for motion in path}
        )
        events += [(time, 1, partial(self._publish_truth, time)) for time in times]
        events += [
            (scan.time, 2, partial(self._publish_scan, scan)) for scan in self._recording.scans
        ]
        for time, _, publish in sorted(events, key=lambda event: event[:2]):
            yield time + self._shift, publish

    def _stamp_ns(self, time: float) -> int:
        return seconds_to_ns(time + self._shift)

    def _publish_own_ship(self, motion: RecordedMotion) -> None:
        x, vx, y, vy = motion.state.tolist()
        sample = OwnShipSample(
            stamp_ns=self._stamp_ns(motion.time),
            frame_id=self._options.fixed_frame,
            child_frame_id=self._options.sensor_frame,
            x=x,
            y=y,
            yaw=motion.yaw or 0.0,
            vx=vx,
            vy=vy,
        )
        self._own_ship.publish(odometry_message(sample, heading_known=motion.yaw is not None))

    def _publish_truth(self, time: float) -> None:
        states = [
            motion.state
            for path in self._recording.targets.values()
            for motion in path
            if motion.time == time
        ]
        header = make_header(self._stamp_ns(time), self._options.fixed_frame)
        truth = truth_tracks(time + self._shift, np.array(states))
        self._truth.publish(track_cloud(header, truth))
        self._truth_markers.publish(truth_markers(header, truth))

    def _publish_scan(self, scan: RecordedScan) -> None:
        header = make_header(self._stamp_ns(scan.time), self._options.sensor_frame)
        # Whether a recorded bearing counts from bow or north is the reader's to know.
        self._detections.publish(detections_cloud(header, bearing_reference="north", **scan.fields))
        self.get_logger().info(
            f"scan at {scan.time:.1f} s: {len(scan.fields['range'])} detections",
            throttle_duration_sec=LOG_PERIOD,
        )


def main(args: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run(ScanPlayer, args)
