"""A CSV recording as the messages that a sonar driver would publish."""

from __future__ import annotations

from collections.abc import Iterator
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
from tsepm_ros.nodes.node_parameters import ParameterError
from tsepm_ros.nodes.playback import PUBLISHER_DEPTH, Event
from tsepm_ros.replay.recording import RecordedMotion, RecordedScan, read_recording
from tsepm_ros.settings.node_options import PlayerNodeOptions

LOG_PERIOD = 5.0
LARGEST_STAMP = 2.0**31 - 1


class PlayedRecording:
    """Publishes the scans, the own ship and the truth of a recording.

    Parameters
    ----------
    node : rclpy.node.Node
    options : PlayerNodeOptions

    Attributes
    ----------
    detections : Publisher
    publishers : list of Publisher
        Those whose messages must arrive.

    Raises
    ------
    ParameterError
        If the recording cannot be read or played so.
    """

    def __init__(self, node: Node, options: PlayerNodeOptions) -> None:
        self._node = node
        self._options = options
        try:
            self._recording = read_recording(options.recording)
        except ValueError as error:
            raise ParameterError(f"recording: {error}") from None
        first, last = self._recording.span
        self._from = first + options.start_offset
        if self._from > last:
            raise ParameterError(
                f"start_offset: {options.start_offset:g} s is beyond the end of the recording of "
                f"{last - first:g} s"
            )
        self._shift = options.start_stamp
        if self._shift < 0:
            self._shift = node.get_clock().now().nanoseconds * 1e-9 - self._from
        if not 0 <= self._from + self._shift <= last + self._shift <= LARGEST_STAMP:
            raise ParameterError(
                f"recording: with start_stamp its stamps go from {self._from + self._shift:g} to "
                f"{last + self._shift:g} s; ROS takes 0 to {LARGEST_STAMP:g} s"
            )
        self.detections = node.create_publisher(PointCloud2, "detections", PUBLISHER_DEPTH)
        self._own_ship = node.create_publisher(Odometry, "own_ship/odometry", PUBLISHER_DEPTH)
        self._truth = node.create_publisher(PointCloud2, "ground_truth", PUBLISHER_DEPTH)
        self._truth_markers = node.create_publisher(MarkerArray, "ground_truth/markers", 10)
        self.publishers = [self._own_ship, self.detections, self._truth]

    def close(self) -> None:
        """Do nothing: the files are read."""

    def events(self) -> Iterator[Event]:
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
            if time >= self._from:
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
            roll=motion.roll,
            pitch=motion.pitch,
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
        self.detections.publish(detections_cloud(header, bearing_reference=None, **scan.fields))
        self._node.get_logger().info(
            f"scan at {scan.time:.1f} s: {len(scan.fields['range'])} detections",
            throttle_duration_sec=LOG_PERIOD,
        )
