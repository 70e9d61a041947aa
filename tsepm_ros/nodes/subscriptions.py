"""Subscriptions: types and reliability as offered, queues, and own ship from tf.

Topics on which the quality of service of publisher and subscriber is incompatible.

How long messages waited in the middleware's queue, and which of them are skipped.

A subscription with the reliability that the publishers offer.

Subscription to the detections with the message type and reliability of the driver.

Own-ship poses from tf, if tf2_ros is installed.
"""

from __future__ import annotations

import math
import time
from collections import Counter, deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import (
    DurabilityPolicy,
    QoSCompatibility,
    QoSPolicyKind,
    QoSProfile,
    ReliabilityPolicy,
    qos_check_compatible,
)
from rclpy.time import Time

from msg_adapters import MessageError, message_class, supported_types
from tsepm_ros.nodes.base_node import ParameterError, refusing
from tsepm_ros.own_ship.pose_history import PoseSample
from tsepm_ros.own_ship.registration import AXES, angles_of, east_north_up, rotation_of
from tsepm_ros.session.session import Session

MAX_BACKLOG = 2.0
"""Time in the queue from which on the newest message is taken, s."""
BACKLOG_INTERVALS = 5.0
"""The same in scan intervals: a burst of a slow sonar is processed whole."""
LAST_IMAGES = 9
"""Images of which the interval and the time are the medians."""
LONGEST = 600.0
"""Time in the queue above which the clocks of publisher and subscriber differ, s."""


def seconds_in_queue(information: Any) -> float:
    """Time that a message waited in the middleware, s, by the information that came with it.

    From its arrival here, where the middleware notes that, else from its publication. 0 where
    neither is known, or where the clocks of the two computers differ.

    Parameters
    ----------
    information : mapping or rmw_message_info_t
        `received_timestamp` and `source_timestamp`, ns of the system clock.
    """
    stamp = information["received_timestamp"] or information["source_timestamp"]
    if stamp <= 0:
        return 0.0
    waited = 1e-9 * (time.time_ns() - stamp)
    return waited if 0.0 <= waited <= LONGEST else 0.0


def newest(
    message: Any,
    information: Any,
    interval: float,
    take_waiting: Callable[[], list[tuple[Any, Any]]],
    is_behind: bool = False,
) -> tuple[Any, float, list[Any]]:
    """The message to be processed: the newest, where the oldest waited too long in the queue.

    Parameters
    ----------
    message, information
        The oldest in the queue.
    interval : float
        Between scans, s; 0 while it is unknown.
    take_waiting : callable
        Takes all others from the queue, oldest first.
    is_behind : bool, optional
        Whether messages come faster than they are processed: then the newest in any case.

    Returns
    -------
    message : Any
    waited : float
        s.
    skipped : list
        Older messages that are not processed, oldest first.
    """
    waited = seconds_in_queue(information)
    is_late = interval and waited > max(MAX_BACKLOG, BACKLOG_INTERVALS * interval)
    heard = [(message, information)]
    if is_late or is_behind:
        heard += take_waiting()
    *skipped, (message, information) = heard
    return message, seconds_in_queue(information), [one for one, _ in skipped]


class Pace:
    """How fast images come, and how fast they are processed.

    Attributes
    ----------
    interval, time : float
        Medians of the last `LAST_IMAGES`: between stamps, and that an image takes, s; 0: unknown.
    arrived : float
        When the message in work arrived, s of the monotonic clock.
    age : float
        Of the last image, from its arrival to the end of publishing, s.
    """

    def __init__(self) -> None:
        self._stamps = deque[float](maxlen=LAST_IMAGES)
        self._times = deque[float](maxlen=LAST_IMAGES)
        self._free = self.arrived = time.monotonic()
        self.age = self.interval = self.time = 0.0

    @property
    def is_behind(self) -> bool:
        """Whether images come faster than they are processed."""
        return 0.0 < self.interval < self.time

    def came(self, stamps: Sequence[float]) -> int:
        """Note images by their stamps, s, all but the last passed over; the number of these.

        By the interval it includes those that the middleware has overwritten.
        """
        last, passed = (self._stamps or stamps)[-1], len(stamps) - 1
        self._stamps.extend(stamps)
        steps = [step for step in np.diff(self._stamps).tolist() if step > 0.0]
        self.interval = float(np.median(steps or [0.0]))
        gap = round((stamps[-1] - last) / (self.interval or math.inf))
        return max(passed, gap - 1) if passed else 0

    def done(self) -> None:
        """Note the end of an image: it took what has passed since its arrival, or the last end."""
        now = time.monotonic()
        self._times.append(now - max(self._free, self.arrived))
        self._free, self.age, self.time = now, now - self.arrived, float(np.median(self._times))


class QosWatch:
    """Counts the middleware's events of incompatibility, and checks which still exist.

    Parameters
    ----------
    node : rclpy.node.Node

    Attributes
    ----------
    heard : Counter
        Number of events by topic.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self.heard: Counter[str] = Counter()

    def publisher_events(
        self, topic: str, on_subscriber: Callable[[], None] | None = None
    ) -> PublisherEventCallbacks:
        """Event callbacks for a publisher; `on_subscriber` is called when a subscriber comes."""

        def incompatible(_: Any) -> None:
            name = self._node.resolve_topic_name(topic)
            self.heard[name] += 1
            self._node.get_logger().warning(
                f"a subscriber of {name} requests a reliability or durability that is not offered: "
                "it receives no messages"
            )

        def matched(event: Any) -> None:
            if on_subscriber is not None and event.current_count_change > 0:
                on_subscriber()

        return PublisherEventCallbacks(
            incompatible_qos=incompatible, matched=matched if on_subscriber else None
        )

    def standing(self) -> list[str]:
        """Topics with events on which an endpoint is incompatible with this node's now."""
        return [topic for topic in sorted(self.heard) if self._is_mismatched(topic)]

    def _is_mismatched(self, topic: str) -> bool:
        publishers = self._node.get_publishers_info_by_topic(topic)
        subscriptions = self._node.get_subscriptions_info_by_topic(topic)
        own = self._node.get_name(), self._node.get_namespace()
        return any(
            qos_check_compatible(offer.qos_profile, request.qos_profile)[0]
            == QoSCompatibility.ERROR
            for offer in publishers
            for request in subscriptions
            if own in [(one.node_name, one.node_namespace) for one in (offer, request)]
        )


class OfferedSubscription:
    """Subscribes reliably, and as best effort once a publisher offers best effort only.

    Parameters
    ----------
    node : rclpy.node.Node
    message_type : type
    topic : str
    depth : int
        Messages that may queue up.
    callback : callable
        Called with each message, and with its information if it has two parameters.
    watch : QosWatch
        Counts the mismatches.
    reliability : rclpy.qos.ReliabilityPolicy, optional
        Initial reliability.
    refusal : str, optional
        What a publisher does not offer, and the consequence: the subscription stays as it is, and
        a mismatch is only logged.
    durability : rclpy.qos.DurabilityPolicy, optional
        Initial durability; volatile once a publisher offers no other.

    Attributes
    ----------
    provisional : str
        Name of its type, if it was made before there is a publisher: a mismatch is left to its
        owner then, who looks at what is published. Else empty.
    """

    provisional = ""

    def __init__(
        self,
        node: Node,
        message_type: type[Any],
        topic: str,
        depth: int,
        callback: Callable[..., None],
        watch: QosWatch,
        *,
        reliability: ReliabilityPolicy = ReliabilityPolicy.RELIABLE,
        refusal: str = "",
        durability: DurabilityPolicy = DurabilityPolicy.VOLATILE,
    ) -> None:
        self._node = node
        self._create = partial(
            node.create_subscription,
            message_type,
            topic,
            callback,
            event_callbacks=SubscriptionEventCallbacks(incompatible_qos=self._incompatible),
        )
        self._depth = depth
        self._watch = watch
        self._refusal = refusal
        self._durability = durability
        self._subscribe(reliability)

    def take_waiting(self) -> list[tuple[Any, Any]]:
        """Take all messages that wait in the middleware, oldest first, with their information."""
        taken: list[tuple[Any, Any]] = []
        while len(taken) < self._depth and (entry := self.take()) is not None:
            taken.append(entry)
        return taken

    def take(self) -> tuple[Any, Any] | None:
        """Take the oldest message that waits in the middleware with its information, or None."""
        subscription = self._subscription
        with subscription.handle:
            entry: tuple[Any, Any] | None = subscription.handle.take_message(
                subscription.msg_type, subscription.raw
            )
        return entry

    def end(self) -> None:
        """End the subscription."""
        self._node.destroy_subscription(self._subscription)

    def _subscribe(self, reliability: ReliabilityPolicy) -> None:
        self._subscription = self._create(
            QoSProfile(depth=self._depth, reliability=reliability, durability=self._durability)
        )

    def _incompatible(self, event: Any) -> None:
        if self.provisional:
            return
        topic = self._subscription.topic_name
        self._watch.heard[topic] += 1
        if self._refusal:
            self._node.get_logger().error(f"a publisher of {topic} does not offer {self._refusal}")
            return
        reliability = ReliabilityPolicy.RELIABLE
        if event.last_policy_kind == QoSPolicyKind.DURABILITY:
            self._durability = DurabilityPolicy.VOLATILE
        else:
            reliability = ReliabilityPolicy.BEST_EFFORT
            self._node.get_logger().warning(
                f"a publisher of {topic} offers best effort only: subscribing as best effort"
            )
        self.end()
        self._subscribe(reliability)


DEFAULT_TYPE = "sensor_msgs/msg/PointCloud2"
"""Type that is subscribed to while there is no publisher."""
POLL_PERIOD = 0.2
"""Period of the graph queries while no driver is known, s."""
CONNECTED_POLL_PERIOD = 2.0
"""Period of the graph queries once a driver is known, s."""

NOT_RELIABLE = (
    "reliable delivery, so its messages are not received; set detections_reliability to auto or "
    "best_effort"
)


class DetectionsSubscription:
    """A subscription to `detections` that takes its type and reliability from the publisher.

    While there is no publisher, it is a reliable subscription of the given type, else of
    `DEFAULT_TYPE`: the graph shows what the node waits for, and a driver that fits is heard from
    its first message on.

    Parameters
    ----------
    node : rclpy.node.Node
    type_name : str
        A message type as ROS names it, or ``auto``.
    reliability : {"auto", "reliable", "best_effort"}
    depth : int
        Messages that may queue up.
    callback : callable
        Called with each message.
    watch : QosWatch
        Counts publishers whose quality of service is incompatible.
    topic : str, optional
    readable : sequence of str, optional
        Types that are read; by default those of detections.
    least_depth : mapping of str to int, optional
        Least number of messages of a type that may queue up.

    Attributes
    ----------
    subscribed : str
        Type of the subscription; empty while there is no publisher of a readable type, or neither
        type nor reliability is given.

    Raises
    ------
    ParameterError
        If the type is unknown, or its package is not installed.
    """

    def __init__(
        self,
        node: Node,
        type_name: str,
        reliability: str,
        depth: int,
        callback: Callable[..., None],
        watch: QosWatch,
        *,
        topic: str = "detections",
        readable: Sequence[str] | None = None,
        least_depth: Mapping[str, int] | None = None,
    ) -> None:
        self._node = node
        self._topic = topic
        self._readable = supported_types() if readable is None else readable
        self._expected = DEFAULT_TYPE if readable is None else readable[-1]
        self._asked = None if reliability == "auto" else ReliabilityPolicy[reliability.upper()]
        self._make: Callable[..., OfferedSubscription] = lambda kind, asked: OfferedSubscription(
            node,
            message_class(kind, self._readable),
            topic,
            max(depth, (least_depth or {}).get(kind, 0)),
            callback,
            watch,
            reliability=asked,
            refusal="" if reliability == "auto" else NOT_RELIABLE,
        )
        self._subscription: OfferedSubscription | None = None
        self._refused_types: set[str] = set()
        self._published_types: tuple[str, ...] = ()
        self.subscribed = ""
        if type_name != "auto":
            with refusing(f"{topic}_type"):
                message_class(type_name, self._readable)
            self._readable, self._expected = (type_name,), type_name
        if type_name != "auto" and self._asked:
            self._subscribe(type_name, self._asked)
        else:
            node.get_logger().info(
                f"waiting for a publisher of {node.resolve_topic_name(self._topic)}"
            )
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._poll_timer = node.create_timer(POLL_PERIOD, self._query_publishers, clock=steady)
        self._query_publishers(at_start=True)

    def take_waiting(self) -> list[tuple[Any, Any]]:
        """Take all messages that wait in the middleware; see `OfferedSubscription`."""
        return [] if self._subscription is None else self._subscription.take_waiting()

    @property
    def unread(self) -> tuple[str, ...]:
        """Published types at the last graph query that are not read, sorted."""
        return tuple(name for name in self._published_types if name != self.subscribed)

    @property
    def other_readable(self) -> tuple[str, ...]:
        """Types of `unread` that a new start would read."""
        return tuple(name for name in self.unread if not self._fault(name))

    def _query_publishers(self, at_start: bool = False) -> None:
        publishers = self._node.get_publishers_info_by_topic(self._topic)
        self._published_types = tuple(sorted({publisher.topic_type for publisher in publishers}))
        readable = [publisher for publisher in publishers if not self._fault(publisher.topic_type)]
        if readable and not self.subscribed:
            kind = readable[0].topic_type
            offers = {one.qos_profile.reliability for one in readable if one.topic_type == kind}
            less = ReliabilityPolicy.BEST_EFFORT in offers
            if self._subscription is not None and (less or self._subscription.provisional != kind):
                self._subscription.end()
                self._subscription = None
            offered = ReliabilityPolicy.BEST_EFFORT if less else ReliabilityPolicy.RELIABLE
            self._subscribe(kind, self._asked or offered)
        elif not (at_start or publishers or self._subscription):
            # Not at the start: a process has one type of a topic, and may have a driver of its own.
            asked = self._asked or ReliabilityPolicy.RELIABLE
            self._subscription = self._make(self._expected, asked)
            self._subscription.provisional = self._expected
        for name in self._published_types:
            if name != self.subscribed and name not in self._refused_types:
                self._refused_types.add(name)
                self._log_unread(name)
        if readable:
            self._poll_timer.timer_period_ns = int(CONNECTED_POLL_PERIOD * 1e9)

    def _log_unread(self, type_name: str) -> None:
        """Log why messages of a published type are not read."""
        published = f"{self._node.resolve_topic_name(self._topic)} is published as {type_name}"
        fault = self._fault(type_name)
        if fault:
            self._node.get_logger().error(f"{published}, {fault}")
            return
        self._node.get_logger().warning(
            f"{published}, but this node has subscribed to it as {self.subscribed}; messages of "
            "the other type are not read; restart the node to use that type"
        )

    def _fault(self, type_name: str) -> str:
        """Why a type is not read; empty if it is."""
        if type_name not in self._readable:
            one_of = "one of " if len(self._readable) > 1 else ""
            images = "; sonar_detector reads images" if self._topic == "detections" else ""
            names = ", ".join(self._readable)
            return f"which this node does not read; it reads {one_of}{names}{images}"
        try:
            message_class(type_name, self._readable)
        except MessageError as error:
            return f"but {error}"
        return ""

    def _subscribe(self, type_name: str, reliability: ReliabilityPolicy) -> None:
        if self._subscription is None:
            self._subscription = self._make(type_name, reliability)
        self._subscription.provisional = ""
        self.subscribed = type_name
        self._node.get_logger().info(
            f"subscribed to {self._node.resolve_topic_name(self._topic)} as {type_name}, "
            f"{reliability.name.lower()}"
        )


CACHE_TIME = 120.0
"""Time for which transforms are kept, s: a ping arrives many seconds after its stamp."""
VELOCITY_SPAN = 1.0
"""Time between two poses of tf whose difference is a velocity, s."""
SAMPLE_PERIOD = 0.2
"""Interval of the poses over a scan's echoes, s: short compared to a small boat's roll period."""


def tf_look_up(
    node: Node, session: Session, buffer: Any = None
) -> Callable[[str, float, float, str], str]:
    """Return a function that gives a session the sensor's poses from tf.

    Its arguments are the sensor's frame, the first and the last stamp (s) for which poses are
    needed, and the frame's axes that point ahead, to port and up, by a name of
    `tsepm_ros.own_ship.registration.AXES`. It returns what tf does not have, in words; an empty
    text if tf has all.

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
    fixed_frame = session.fixed_frame
    if not fixed_frame:
        raise ParameterError("fixed_frame must be given where own_ship_source is tf")
    buffer = tf_buffer(node) if buffer is None else buffer

    def look_up(frame: str, first: float, last: float, axes: str) -> str:
        intervals = max(1, math.ceil((last - first) / SAMPLE_PERIOD))
        for stamp in np.linspace(first, last, intervals + 1).tolist():
            newest = session.own_ship.poses.last_stamp
            if stamp < 0 or (newest is not None and stamp <= newest):
                continue
            at = Time(nanoseconds=round(stamp * 1e9))
            if not buffer.can_transform(fixed_frame, frame, at):
                return f"tf has no transform from {frame!r} to {fixed_frame!r} at {stamp:.3f} s"
            transform = buffer.lookup_transform(fixed_frame, frame, at).transform
            session.add_own_ship(_sample(stamp, transform, axes, fixed_frame))
        return ""

    return look_up


def tf_buffer(node: Node) -> Any:
    """Return a tf2_ros.Buffer with a listener.

    Raises
    ------
    ParameterError
        If tf2_ros is not installed.
    """
    try:
        import tf2_ros
    except ImportError:
        raise ParameterError(
            "own_ship_source is tf, but the package tf2_ros is not installed"
        ) from None
    buffer = tf2_ros.Buffer(cache_time=Duration(seconds=CACHE_TIME), node=node)
    tf2_ros.TransformListener(buffer, node)  # the node's subscriptions keep it
    return buffer


def tf_own_ship(buffer: Any, fixed_frame: str, frame: str, stamp: float) -> PoseSample:
    """Pose and velocity of a vessel at a stamp, or the newest before, as tf has them.

    Parameters
    ----------
    buffer : tf2_ros.Buffer
    fixed_frame, frame : str
        Of the result, and of the vessel.
    stamp : float
        s.

    Returns
    -------
    PoseSample
        Without a velocity if tf has no pose `VELOCITY_SPAN` before.

    Raises
    ------
    MessageError
        If tf has no pose: ``no_own_ship``.
    """
    at = Time(nanoseconds=max(0, round(stamp * 1e9)))
    at = at if buffer.can_transform(fixed_frame, frame, at) else Time()  # the newest
    if not (fixed_frame and buffer.can_transform(fixed_frame, frame, at)):
        raise MessageError("no_own_ship", f"tf has no transform from {frame!r} to {fixed_frame!r}")
    found = buffer.lookup_transform(fixed_frame, frame, at)
    stamp = Time.from_msg(found.header.stamp).nanoseconds * 1e-9
    sample = _sample(stamp, found.transform, "body", fixed_frame)
    before = Time(nanoseconds=max(1, round((stamp - VELOCITY_SPAN) * 1e9)))
    if not buffer.can_transform(fixed_frame, frame, before):
        return sample
    earlier = buffer.lookup_transform(fixed_frame, frame, before).transform
    start = _sample(stamp, earlier, "body", fixed_frame)
    vx, vy = (sample.x - start.x) / VELOCITY_SPAN, (sample.y - start.y) / VELOCITY_SPAN
    return replace(sample, rates=(vx, vy, math.nan))


def _sample(stamp: float, transform: Any, axes: str, frame_id: str) -> PoseSample:
    q, world = transform.rotation, east_north_up(frame_id)
    x, y = (world[:2, :2] @ [transform.translation.x, transform.translation.y]).tolist()
    try:
        yaw, pitch, roll = angles_of(world @ rotation_of((q.x, q.y, q.z, q.w)) @ AXES[axes])
    except ValueError:  # no heading: the session refuses and counts nan
        yaw = pitch = roll = math.nan
    return PoseSample(stamp, x, y, yaw, roll=roll, pitch=pitch, frame_id=frame_id)
