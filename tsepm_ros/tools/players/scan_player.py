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
"""The node that plays recorded scans on the topics of a sonar driver: a bag, or a CSV recording.

`ScanPlayingNode` publishes events at their times, for the simulator too. `PlayerTopicRecorder` is
the node of `tsepm record`, which writes a bag to be played.
"""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import replace
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Odometry
from numpy.typing import NDArray
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import serialize_message
from rclpy.task import Future
from rosgraph_msgs.msg import Clock as ClockMessage
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Header
from visualization_msgs.msg import MarkerArray

from msg_adapters import (
    MessageError,
    detections_cloud,
    make_header,
    ns_to_time,
    odometry_message,
    seconds_to_ns,
    track_cloud,
    truth_markers,
    truth_tracks,
)
from msg_adapters.detections import installed_class
from msg_adapters.image_messages import IMAGES
from tsepm_ros.diagnostics.input_health import PLAYBACK
from tsepm_ros.nodes.base_node import (
    OVERRIDABLE,
    BaseNode,
    ParameterError,
    refusing_node_parameter,
    run_node,
)
from tsepm_ros.nodes.subscriptions import OfferedSubscription, SubscriptionQos
from tsepm_ros.own_ship.pose_history import PoseSample
from tsepm_ros.settings.node_options import PlaybackOptions, PlayerNodeOptions
from tsepm_ros.settings.settings import settings_help
from tsepm_ros.tools.live_commands import DIAGNOSTICS, SOME
from tsepm_ros.tools.replay.bag import (
    DETECTIONS,
    LAND,
    OWN_SHIP,
    ROLES,
    TRACKED,
    TRUTH,
    Bag,
    BagMessage,
    BagWriter,
    find_bag_topics,
)
from tsepm_ros.tools.replay.recording import RecordedScan, read_recording, recording_source_of
from tsepm_ros.tools.viewer.page_content import page_topics_of_message

Event = tuple[float, Callable[[], None]]
"""Time in the recording (s) and the function that publishes the message."""

WAIT_PERIOD = 0.05
"""Time between checks for subscribers, s."""
NEVER = 1e6
"""Period of the timer at the end, s: one that is destroyed meanwhile ends some executors."""
LOG_PERIOD = 5.0
"""Minimum time between log entries of the playback's progress, s."""
PUBLISHER_DEPTH = 1000
"""Queue depth of a publisher: messages kept until they are acknowledged."""
EVENTS_PER_ACKNOWLEDGEMENT = 500
"""Events after which all messages must be acknowledged. It is below the depth, so that no
unacknowledged message is overwritten; an acknowledgement may take the heartbeat period of 3 s."""
MAX_ACKNOWLEDGE_TIME = 10.0
"""Maximum time for the acknowledgement, s; later a reliable subscriber is considered dead."""
MAX_SINGLE_WAIT = 0.2
"""Maximum time of a single wait for the acknowledgement, s."""
MAX_STAMP = 2.0**31 - 1
"""Maximum stamp of a ROS message, s."""
TF, TF_STATIC, TF_TYPE = "/tf", "/tf_static", "tf2_msgs/msg/TFMessage"
DURABILITY = DurabilityPolicy.VOLATILE, DurabilityPolicy.TRANSIENT_LOCAL
"""Durability of messages for present subscribers only, and for later ones too."""


class Played:
    """Source of the events: a scenario, a recording or a bag.

    Attributes
    ----------
    detections : dict of str to Publisher
        Of each sensor by name, empty for a single one. The playback waits for their subscribers.
    publishers : list of Publisher
        Publishers whose messages must be acknowledged, of depth PUBLISHER_DEPTH or more.
    """

    detections: dict[str, Publisher]
    publishers: list[Publisher]

    def events(self) -> Iterator[Event]:
        """Iterate over the events in order of time, from the first; once per loop."""
        raise NotImplementedError

    def close(self) -> None:
        """Close what is open."""


def check_player_start_offset(start_offset: float, duration: float, played: str) -> None:
    """Refuse a start offset beyond the duration, both s.

    Raises
    ------
    ParameterError
        If the start offset is beyond the duration.
    """
    if start_offset > duration:
        raise ParameterError(
            f"start_offset: {start_offset:g} s is beyond the end of the {played} of {duration:g} s"
        )


class ScanPlayingNode(BaseNode):
    """A node that publishes a sequence of events, paced by the wall clock.

    It waits for reliable subscribers: no message is overwritten before it is acknowledged, and all
    are acknowledged before the end. It waits for `settling_time` before the first event: discovery
    has two sides, and a message that is published after the publisher has discovered a subscription
    but before the opposite discovery is lost, even if reliable.

    Parameters
    ----------
    name : str
    make : callable
        Makes what is played of the node and its options.

    Attributes
    ----------
    finished : Future
        Done when the last event has been published and acknowledged.
    """

    def __init__(
        self,
        name: str,
        make: Callable[[BaseNode, Mapping[type, Any]], Played],
        **node_options: Any,
    ) -> None:
        super().__init__(name, **node_options)
        self.health.nouns[PLAYBACK] = "message"
        self.finished: Future = Future()
        self._played = make(self, self.options)
        self._pace: PlaybackOptions = self.options[PlaybackOptions]
        self._clock_topic: Any = self._pace.publish_clock and self.create_publisher(
            ClockMessage, "/clock", 10, qos_overriding_options=OVERRIDABLE
        )
        self._events = self._played.events()
        self._next = next(self._events, None)
        self._begin: float | None = None
        self._published = 0
        self._topics = ", ".join(one.topic_name for one in self._played.detections.values())
        self._timer = self.steady_timer(WAIT_PERIOD, self._step)
        if self._pace.wait_for_subscribers:
            self.get_logger().info(
                f"waiting for {self._pace.wait_for_subscribers} subscriber(s) of {self._topics}"
            )
        self.refuse_unused_overrides()

    def destroy_node(self) -> None:
        """Destroy the node and close what it plays."""
        super().destroy_node()
        self._played.close()

    def found(self) -> Mapping[str, Mapping[str, Any]]:
        """What the node finds of its playback."""
        awaited = self._pace.wait_for_subscribers
        waits = f"waits for {awaited} subscriber(s) of {self._topics}" * (self._begin is None)
        healthy = f"{self._published} messages published"
        return {PLAYBACK: {"findings": {"subscribers": waits}, "healthy": healthy}}

    def _step(self) -> None:
        if self.finished.done():
            return
        if self._begin is None:
            awaited = self._pace.wait_for_subscribers
            counts = (one.get_subscription_count() for one in self._played.detections.values())
            if min(counts) < awaited:
                return
            settling = self._pace.settling_time if awaited else 0.0
            self._begin = time.monotonic() + settling - self._wall_time()
        while self._next is not None:
            wait = self._begin + self._wall_time() - time.monotonic()
            if wait > 0:
                self._schedule(wait)
                return
            self._publish()
        self._end()

    def _wall_time(self) -> float:
        """Wall time at which the next event is due, s, from the origin of the events' times."""
        return self._next[0] / self._pace.rate_factor if self._next is not None else 0.0

    def _publish(self) -> None:
        assert self._next is not None
        stamp, publish = self._next
        if self._clock_topic:
            self._clock_topic.publish(ClockMessage(clock=ns_to_time(seconds_to_ns(stamp))))
        try:
            publish()
        finally:  # whatever happens, the next event follows
            self._published += 1
            self._next = next(self._events, None)
        if self._published % EVENTS_PER_ACKNOWLEDGEMENT == 0:
            self._wait_for_acknowledgement()

    def _wait_for_acknowledgement(self) -> None:
        for publisher in self._played.publishers:
            until = time.monotonic() + MAX_ACKNOWLEDGE_TIME
            while (
                publisher.get_subscription_count()
                and time.monotonic() < until
                and self.context.ok()  # a signal does not interrupt the wait
                and not publisher.wait_for_all_acked(Duration(seconds=MAX_SINGLE_WAIT))
            ):
                pass

    def _schedule(self, wait: float) -> None:
        self._timer.timer_period_ns = max(math.ceil(wait * 1e9), 1)
        self._timer.reset()

    def _end(self) -> None:
        if self._pace.loop:
            self._events = self._played.events()
            self._next = next(self._events, None)
            self._begin = time.monotonic() - self._wall_time()
            self._schedule(WAIT_PERIOD)
            return
        self._schedule(NEVER)
        self._wait_for_acknowledgement()
        self.get_logger().info("finished")
        self.finished.set_result(None)


class PlayedTopics(Played):
    """A source that publishes detections, own ship and truth on topics of its own.

    Parameters
    ----------
    node : rclpy.node.Node
    detections_type : type
        Message class of the detections.
    fixed_frame, sensor_frame : str
        Frame of own ship and truth; frame of the detections.
    own_ship : bool, optional
        Whether there is an own ship; without it there is no topic that a node might wait for.
    sensors : sequence of str, optional
        Names of several sensors, each with a topic of its own.

    Attributes
    ----------
    detections : dict of str to Publisher
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
        sensors: Sequence[str] = (),
    ) -> None:
        self._frames = fixed_frame, sensor_frame
        self._place, self._reach = np.zeros(2), 0.0  # of the own ship; largest range of a target
        publisher = partial(node.create_publisher, qos_overriding_options=OVERRIDABLE)
        self.detections = {
            name: publisher(detections_type, f"{name}/detections".lstrip("/"), PUBLISHER_DEPTH)
            for name in sensors or ("",)
        }
        self._truth = publisher(PointCloud2, "ground_truth", PUBLISHER_DEPTH)
        self._truth_markers = publisher(MarkerArray, "ground_truth/markers", 10)
        self.publishers = [*self.detections.values(), self._truth]
        self._own_ship: Publisher = None
        if own_ship:
            self._own_ship = publisher(Odometry, "own_ship/odometry", PUBLISHER_DEPTH)
            self.publishers.append(self._own_ship)

    def sensor_header(self, stamp: float) -> Header:
        """Header of detections with a stamp, s."""
        return make_header(seconds_to_ns(stamp), self._frames[1])

    def publish_own_ship(self, sample: PoseSample) -> None:
        """Publish a pose of the own ship, in the fixed frame."""
        self._place = np.array([sample.x, sample.y])
        frame_id, child_frame_id = self._frames
        named = replace(sample, frame_id=frame_id, child_frame_id=child_frame_id)
        self._own_ship.publish(odometry_message(named))

    def publish_truth(self, stamp: float, states: NDArray[np.float64]) -> None:
        """Publish the targets' true states (k, 4) at a stamp, s."""
        header = make_header(seconds_to_ns(stamp), self._frames[0])
        truth = truth_tracks(stamp, states)
        self._truth.publish(track_cloud(header, truth))
        ranges = np.hypot(*(np.reshape(states, (-1, 4))[:, 0::2] - self._place).T)
        self._reach = max(self._reach, float(ranges.max(initial=0.0)))
        self._truth_markers.publish(truth_markers(header, truth, self._reach))


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
    detections : dict of str to Publisher
    publishers : list of Publisher
        Publishers whose messages must be acknowledged.

    Raises
    ------
    ParameterError
        If the bag cannot be read, or the options do not fit it.
    """

    def __init__(self, node: BaseNode, options: PlayerNodeOptions) -> None:
        self._node = node
        if options.start_stamp:
            raise ParameterError(
                "start_stamp: the messages of a bag are published with their recorded stamps"
            )
        with refusing_node_parameter("recording"):
            self._bag = Bag(recording_source_of(options.recording)[0])
        for note in self._bag.notes:
            node.get_logger().warning(note)
        given = {
            DETECTIONS: options.detections_topic,
            OWN_SHIP: options.odometry_topic,
            TRACKED: options.tracked_topic,
            TRUTH: options.ground_truth_topic,
            LAND: options.land_topic,
        }
        with ExitStack() as refused:  # closes the bag
            refused.callback(self.close)
            with refusing_node_parameter("recording"):
                topics = find_bag_topics(self._bag.topics, given)
            check_player_start_offset(options.start_offset, self._bag.duration, "bag")
            self._latched = {TF_STATIC, topics.get(LAND, TF_STATIC)}
            self._publishers = {
                topic: self._publisher(
                    topic, "image" if self._bag.topics[topic] in IMAGES else role
                )
                for role, topic in topics.items()
            }
            refused.pop_all()
        self._from_ns = self._bag.start_ns + round(1e9 * options.start_offset)
        self.detections = {"": self._publishers[topics[DETECTIONS]]}
        played = ", ".join(f"{name} as {one.topic_name}" for name, one in self._publishers.items())
        self._add_tf()
        self.publishers = list(self._publishers.values())
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
            self._node.drop(error.reason, f"left out: {error}")
            return
        self._publishers[message.topic].publish(message.data)
        self._node.get_logger().info(
            f"{1e-9 * (message.log_ns - self._bag.start_ns):.1f} s",
            throttle_duration_sec=LOG_PERIOD,
        )

    def _publisher(self, topic: str, name: str) -> Publisher:
        type_name = self._bag.topics[topic]
        try:
            kind = installed_class(type_name)
        except (ImportError, AttributeError):
            raise ParameterError(
                f"recording: {topic} is of type {type_name}, whose package is not installed"
            ) from None
        qos = QoSProfile(depth=PUBLISHER_DEPTH, durability=DURABILITY[topic in self._latched])
        return self._node.create_publisher(kind, name, qos, qos_overriding_options=OVERRIDABLE)

    def _add_tf(self) -> None:
        for topic in (TF, TF_STATIC):
            if self._bag.topics.get(topic) == TF_TYPE:
                try:
                    self._publishers[topic] = self._publisher(topic, topic)
                except ParameterError as error:
                    self._node.get_logger().warning(f"not played: {error}")


class PlayedRecording(PlayedTopics):
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
        with refusing_node_parameter("recording"):
            self._recording = read_recording(options.recording)
        for note in self._recording.notes:
            node.get_logger().warning(note)
        first, last = self._recording.span
        check_player_start_offset(options.start_offset, last - first, "recording")
        self._from = first + options.start_offset
        self._shift = options.start_stamp
        if self._shift < 0:
            self._shift = 1e-9 * node.get_clock().now().nanoseconds - self._from
        if not 0 <= self._from + self._shift <= last + self._shift <= MAX_STAMP:
            raise ParameterError(
                f"recording: with start_stamp its stamps go from {self._from + self._shift:g} to "
                f"{last + self._shift:g} s; ROS takes 0 to {MAX_STAMP:g} s"
            )
        super().__init__(
            node,
            PointCloud2,
            options.fixed_frame,
            options.sensor_frame,
            own_ship=bool(self._recording.own_ship),
        )

    def events(self) -> Iterator[Event]:
        """Iterate over the events in order of time; at equal times own ship, truth, scan."""
        poses, paths = self._recording.own_ship, self._recording.targets.values()
        times = {time for path in paths for time in path[:, 0].tolist()}
        events: list[tuple[float, int, Any]] = [
            *((pose.stamp, 0, partial(self._publish_pose, pose)) for pose in poses),
            *((time, 1, partial(self._publish_states, time)) for time in times),
            *((scan.time, 2, partial(self._publish_scan, scan)) for scan in self._recording.scans),
        ]
        for due, _, publish in sorted(events, key=lambda event: event[:2]):
            if due >= self._from:
                yield due + self._shift, publish

    def _publish_pose(self, pose: PoseSample) -> None:
        self.publish_own_ship(replace(pose, stamp=pose.stamp + self._shift))

    def _publish_states(self, time: float) -> None:
        states = np.concatenate(
            [path[path[:, 0] == time, 1:] for path in self._recording.targets.values()]
        )
        self.publish_truth(time + self._shift, states)

    def _publish_scan(self, scan: RecordedScan) -> None:
        header = self.sensor_header(scan.time + self._shift)
        self.detections[""].publish(detections_cloud(header, bearing_reference=None, **scan.fields))
        self._node.get_logger().info(
            f"scan at {scan.time:.1f} s: {len(scan.fields['range'])} detections",
            throttle_duration_sec=LOG_PERIOD,
        )


def _source(node: BaseNode, options: Mapping[type, Any]) -> Played:
    player: PlayerNodeOptions = options[PlayerNodeOptions]
    if not player.recording:
        raise ParameterError("recording must be a folder of CSV files or a bag; got ''")
    with refusing_node_parameter("recording"):
        is_bag = recording_source_of(player.recording)[1]
    return (PlayedBag if is_bag else PlayedRecording)(node, player)


class ScanPlayer(ScanPlayingNode):
    """Publishes the scans, the own ship and the truth of a CSV recording or a bag."""

    def __init__(self, **node_options: Any) -> None:
        super().__init__("scan_player", _source, **node_options)


class PlayerTopicRecorder(Node):
    """Writes a bag of topics, each from the time on at which it is published.

    Parameters
    ----------
    path : Path
        Folder of the bag, which must not exist.
    topics : sequence of str
        Of messages that were sent before, their number is said.
    with_sensors : bool, optional
        Also the detections of several sensors, as their node states them, and the images from which
        they are made.

    Raises
    ------
    ParameterError
        If the bag cannot be written.
    """

    def __init__(
        self,
        path: Path,
        topics: Sequence[str],
        *,
        with_sensors: bool = False,
        **node_options: Any,
    ) -> None:
        super().__init__("tsepm_record", **node_options)
        self._missed: dict[str, str] = {}
        self._counts = Counter({self.resolve_topic_name(topic): 0 for topic in topics})
        with refusing_node_parameter():
            self._bag = BagWriter(path)
        self._qos = SubscriptionQos(self)
        self._waiting = set(self._counts)
        self._subscriptions_made: list[OfferedSubscription] = []
        if with_sensors:
            self.create_subscription(DiagnosticArray, DIAGNOSTICS, self._hear, SOME)
        self.create_timer(WAIT_PERIOD, self._look, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def destroy_node(self) -> None:
        """Destroy the node, close the bag, and print the number of messages of each topic."""
        super().destroy_node()
        self._bag.close()
        for topic, number in self._counts.items():
            print(f"{topic}: {number} messages{self._missed.get(topic, '')}")

    def _hear(self, message: DiagnosticArray) -> None:
        """Take the inputs of a node of several sensors, and of those who publish its detections."""
        topics = dict(chain(*map(dict.items, page_topics_of_message(message).values())))
        sensors = [topics[name] for name in topics if name.endswith(f"/{DETECTIONS}")]
        found = {topics[name] for name in ROLES if sensors and name in topics}.union(sensors)
        for topic in sensors:
            for end in self.get_publishers_info_by_topic(topic):
                with suppress(rclpy_implementation.RCLError):  # its name may come later
                    found |= {
                        name
                        for name, kinds in self.get_subscriber_names_and_types_by_node(
                            end.node_name, end.node_namespace
                        )
                        if not IMAGES.keys().isdisjoint(kinds)
                    }
        self._waiting |= found - self._counts.keys()
        self._counts.update(dict.fromkeys(found - self._counts.keys(), 0))

    def _look(self) -> None:
        for topic in sorted(self._waiting):
            if publishers := self.get_publishers_info_by_topic(topic):
                self._waiting.remove(topic)
                try:
                    self._record(topic, publishers)
                except (ValueError, ImportError, AttributeError) as error:
                    self.get_logger().error(f"{topic} is not recorded: {error}")

    def _record(self, topic: str, publishers: Sequence[Any]) -> None:
        kind = publishers[0].topic_type
        message_type = installed_class(kind)
        self._bag.add(topic, kind)
        is_latched = all(end.qos_profile.durability == DURABILITY[True] for end in publishers)
        self._subscriptions_made.append(
            OfferedSubscription(
                self,
                message_type,
                topic,
                PUBLISHER_DEPTH,
                partial(self._take, topic),
                self._qos,
                durability=DURABILITY[is_latched],
            )
        )
        self.get_logger().info(f"records {topic} ({kind})")

    def _take(self, topic: str, message: Any, info: Mapping[str, Any]) -> None:
        self._bag.write(topic, time.time_ns(), serialize_message(message))
        self._counts[topic] += 1
        number = info["publication_sequence_number"] or 1  # of its publisher
        if number > 1 and self._counts[topic] == 1:
            self._missed[topic] = (
                f"; {number - 1} messages were sent before the recording and are not in the bag: "
                "start the recording before the driver"
            )
            self.get_logger().warning(f"{topic}{self._missed[topic]}")


def main(args: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run_node(ScanPlayer, args, settings_help("scan_player", __doc__))
