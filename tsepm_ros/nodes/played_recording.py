"""A CSV recording, published as a sonar driver's messages."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2

from msg_adapters import detections_cloud
from tsepm_ros.nodes.driver_topics import DriverTopics
from tsepm_ros.nodes.node_parameters import ParameterError, refusing
from tsepm_ros.nodes.playback import LOG_PERIOD, Event, check_start_offset
from tsepm_ros.nodes.running import clock_time
from tsepm_ros.replay.recording import RecordedMotion, RecordedScan, read_recording
from tsepm_ros.settings.node_options import PlayerNodeOptions

MAX_STAMP = 2.0**31 - 1
"""Maximum stamp of a ROS message, s."""


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
        Publishers whose messages must be acknowledged.

    Raises
    ------
    ParameterError
        If the recording cannot be read, or the options do not fit it.
    """

    def __init__(self, node: Node, options: PlayerNodeOptions) -> None:
        self._node = node
        with refusing("recording"):
            self._recording = read_recording(options.recording)
        for note in self._recording.notes:
            node.get_logger().warning(note)
        first, last = self._recording.span
        check_start_offset(options.start_offset, last - first, "recording")
        self._from = first + options.start_offset
        self._shift = options.start_stamp
        if self._shift < 0:
            self._shift = clock_time(node) - self._from
        if not 0 <= self._from + self._shift <= last + self._shift <= MAX_STAMP:
            raise ParameterError(
                f"recording: with start_stamp its stamps go from {self._from + self._shift:g} to "
                f"{last + self._shift:g} s; ROS takes 0 to {MAX_STAMP:g} s"
            )
        self._topics = DriverTopics(
            node,
            PointCloud2,
            options.fixed_frame,
            options.sensor_frame,
            own_ship=bool(self._recording.own_ship),
        )
        self.detections, self.publishers = self._topics.detections, self._topics.publishers

    def close(self) -> None:
        """Do nothing: no file is open."""

    def events(self) -> Iterator[Event]:
        """Iterate over the events in order of time; at equal times own ship, truth, scan."""
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

    def _publish_own_ship(self, motion: RecordedMotion) -> None:
        x, vx, y, vy = motion.state.tolist()
        self._topics.publish_own_ship(
            motion.time + self._shift,
            (x, y, motion.yaw),
            (vx, vy, 0.0),
            roll=motion.roll,
            pitch=motion.pitch,
        )

    def _publish_truth(self, time: float) -> None:
        states = [
            motion.state
            for path in self._recording.targets.values()
            for motion in path
            if motion.time == time
        ]
        self._topics.publish_truth(time + self._shift, np.array(states))

    def _publish_scan(self, scan: RecordedScan) -> None:
        header = self._topics.sensor_header(scan.time + self._shift)
        self.detections.publish(detections_cloud(header, bearing_reference=None, **scan.fields))
        self._node.get_logger().info(
            f"scan at {scan.time:.1f} s: {len(scan.fields['range'])} detections",
            throttle_duration_sec=LOG_PERIOD,
        )
