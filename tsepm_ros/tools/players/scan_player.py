"""The node that plays recorded scans on the topics of a sonar driver: a bag, or a CSV recording."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from itertools import chain
from typing import Any

import numpy as np
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import PointCloud2

from msg_adapters import MessageError, detections_cloud
from tsepm_ros.nodes.base_node import OVERRIDABLE, ParameterError, refusing, run
from tsepm_ros.settings.node_options import PlayerNodeOptions
from tsepm_ros.settings.settings import help_text
from tsepm_ros.tools.players.playback import (
    LOG_PERIOD,
    PUBLISHER_DEPTH,
    DriverTopics,
    Event,
    Played,
    PlayingNode,
    check_start_offset,
)
from tsepm_ros.tools.replay.bag import (
    DETECTIONS,
    LAND,
    OWN_SHIP,
    TRACKED,
    TRUTH,
    Bag,
    BagMessage,
    find_topics,
    installed_class,
)
from tsepm_ros.tools.replay.recording import RecordedMotion, RecordedScan, read_recording, source_of

LATCHED = "TRANSIENT_LOCAL"
TF, TF_STATIC, TF_TYPE = "/tf", "/tf_static", "tf2_msgs/msg/TFMessage"


class PlayedBag(Played):
    """Publishes the topics of a bag that the track initiator reads.

    The messages are published byte for byte. Corrupt messages are skipped, counted and logged. If
    tf2_msgs is installed, /tf and /tf_static are published too; /tf_static and land from the bag's
    start, and latched.

    Parameters
    ----------
    node : rclpy.node.Node
    options : PlayerNodeOptions

    Attributes
    ----------
    detections : Publisher
    publishers : list of Publisher
        Publishers whose messages must be acknowledged.
    dropped : int
        Corrupt messages that were skipped.

    Raises
    ------
    ParameterError
        If the bag cannot be read, or the options do not fit it.
    """

    def __init__(self, node: Node, options: PlayerNodeOptions) -> None:
        self._node = node
        self.dropped = 0
        if options.start_stamp:
            raise ParameterError(
                "start_stamp: the messages of a bag are published with their recorded stamps"
            )
        with refusing("recording"):
            self._bag = Bag(source_of(options.recording)[0])
        for note in self._bag.notes:
            node.get_logger().warning(note)
        try:
            self._prepare(options)
        except ParameterError:
            self.close()
            raise

    def _prepare(self, options: PlayerNodeOptions) -> None:
        given = {
            DETECTIONS: options.detections_topic,
            OWN_SHIP: options.odometry_topic,
            TRACKED: options.tracked_topic,
            TRUTH: options.ground_truth_topic,
            LAND: options.land_topic,
        }
        with refusing("recording"):
            topics = find_topics(self._bag.topics, given)
        check_start_offset(options.start_offset, self._bag.duration, "bag")
        self._from_ns = self._bag.start_ns + round(1e9 * options.start_offset)
        self._publishers = {
            topic: self._publisher(topic, role, LATCHED if role == LAND else "VOLATILE")
            for role, topic in topics.items()
        }
        self._latched = {TF_STATIC, topics.get(LAND, TF_STATIC)}
        self.detections = self._publishers[topics[DETECTIONS]]
        self._add_tf()
        self.publishers = list(self._publishers.values())
        played = ", ".join(f"{topic} as {role}" for role, topic in topics.items())
        self._node.get_logger().info(f"{self._bag.duration:.1f} s of {played}")

    def close(self) -> None:
        """Close the bag."""
        self._bag.close()

    def events(self) -> Iterator[Event]:
        """Iterate over the messages in order of reception, up to a damaged place of the bag."""
        static = [topic for topic in self._publishers if topic in self._latched]
        before = (
            message for message in self._bag.messages(static) if message.log_ns < self._from_ns
        )
        try:
            for message in chain(before, self._bag.messages(self._publishers, self._from_ns)):
                yield 1e-9 * max(message.log_ns, self._from_ns), partial(self._publish, message)
        except ValueError as error:
            self._node.get_logger().error(f"the playback ends early: {error}")

    def _publish(self, message: BagMessage) -> None:
        try:
            self._bag.read(message)
        except MessageError as error:
            self.dropped += 1
            self._node.get_logger().warning(f"left out ({self.dropped} so far): {error}")
            return
        self._publishers[message.topic].publish(message.data)
        self._node.get_logger().info(
            f"{1e-9 * (message.log_ns - self._bag.start_ns):.1f} s",
            throttle_duration_sec=LOG_PERIOD,
        )

    def _publisher(self, topic: str, name: str, durability: str = "VOLATILE") -> Publisher:
        qos = QoSProfile(depth=PUBLISHER_DEPTH, durability=DurabilityPolicy[durability])
        return self._node.create_publisher(
            self._class(topic), name, qos, qos_overriding_options=OVERRIDABLE
        )

    def _class(self, topic: str) -> type:
        type_name = self._bag.topics[topic]
        try:
            return installed_class(type_name)
        except (ImportError, AttributeError):
            raise ParameterError(
                f"recording: {topic} is of type {type_name}, whose package is not installed"
            ) from None

    def _add_tf(self) -> None:
        for topic, durability in ((TF, "VOLATILE"), (TF_STATIC, LATCHED)):
            if self._bag.topics.get(topic) == TF_TYPE:
                try:
                    self._publishers[topic] = self._publisher(topic, topic, durability)
                except ParameterError as error:
                    self._node.get_logger().warning(f"not played: {error}")


MAX_STAMP = 2.0**31 - 1
"""Maximum stamp of a ROS message, s."""


class PlayedRecording(Played):
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
            self._shift = 1e-9 * node.get_clock().now().nanoseconds - self._from
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
        paths = self._recording.targets.values()
        states = [motion.state for path in paths for motion in path if motion.time == time]
        self._topics.publish_truth(time + self._shift, np.array(states))

    def _publish_scan(self, scan: RecordedScan) -> None:
        header = self._topics.sensor_header(scan.time + self._shift)
        self.detections.publish(detections_cloud(header, bearing_reference=None, **scan.fields))
        self._node.get_logger().info(
            f"scan at {scan.time:.1f} s: {len(scan.fields['range'])} detections",
            throttle_duration_sec=LOG_PERIOD,
        )


def _played(node: Node, options: Mapping[type, Any]) -> Played:
    player: PlayerNodeOptions = options[PlayerNodeOptions]
    if not player.recording:
        raise ParameterError("recording must be a folder of CSV files or a bag; got ''")
    with refusing("recording"):
        is_bag = source_of(player.recording)[1]
    return (PlayedBag if is_bag else PlayedRecording)(node, player)


class ScanPlayer(PlayingNode):
    """Publishes the scans, the own ship and the truth of a CSV recording or a bag."""

    def __init__(self, **node_options: Any) -> None:
        super().__init__("scan_player", _played, **node_options)


def main(args: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run(ScanPlayer, args, help_text("scan_player", __doc__))


if __name__ == "__main__":
    raise SystemExit(main())
