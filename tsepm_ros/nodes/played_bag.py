"""Messages of a bag, published as they were recorded."""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from functools import partial
from itertools import chain

from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile

from msg_adapters import MessageError
from tsepm_ros.nodes import qos_overrides
from tsepm_ros.nodes.node_parameters import ParameterError, refusing
from tsepm_ros.nodes.playback import LOG_PERIOD, PUBLISHER_DEPTH, Event, check_start_offset
from tsepm_ros.replay.bag import (
    DETECTIONS,
    LAND,
    OWN_SHIP,
    TRACKED,
    TRUTH,
    Bag,
    BagMessage,
    find_topics,
)
from tsepm_ros.replay.recording_source import source_of
from tsepm_ros.settings.node_options import PlayerNodeOptions

LATCHED = "TRANSIENT_LOCAL"
TF, TF_STATIC, TF_TYPE = "/tf", "/tf_static", "tf2_msgs/msg/TFMessage"


class PlayedBag:
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
            self._class(topic), name, qos, qos_overriding_options=qos_overrides.PUBLISHER
        )

    def _class(self, topic: str) -> type:
        type_name = self._bag.topics[topic]
        package, _, name = type_name.split("/")
        try:
            message_class: type = getattr(importlib.import_module(f"{package}.msg"), name)
        except (ImportError, AttributeError):
            raise ParameterError(
                f"recording: {topic} is of type {type_name}, whose package is not installed"
            ) from None
        return message_class

    def _add_tf(self) -> None:
        for topic, durability in ((TF, "VOLATILE"), (TF_STATIC, LATCHED)):
            if self._bag.topics.get(topic) == TF_TYPE:
                try:
                    self._publishers[topic] = self._publisher(topic, topic, durability)
                except ParameterError as error:
                    self._node.get_logger().warning(f"not played: {error}")
