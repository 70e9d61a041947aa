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
"""Subscriptions with the message type and the reliability that the publishers offer.

Publishers and subscribers whose qualities of service do not fit are counted.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from itertools import islice
from typing import Any

from rclpy.clock import Clock, ClockType
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

from msg_adapters import MessageError, message_class, supported_types
from tsepm_ros.nodes.base_node import refusing_node_parameter

DEFAULT_TYPE = "sensor_msgs/msg/PointCloud2"
"""Type that is subscribed to while there is no publisher."""
POLL_PERIOD = 0.2
"""Period of the graph queries while no driver is known, s."""
CONNECTED_POLL_PERIOD = 2.0
"""Period of the graph queries once a driver is known, s."""
NOT_RELIABLE = (
    "reliable delivery, so its messages are not received; set {}_reliability to auto or best_effort"
)


class SubscriptionQos:
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
            incompatible_qos=incompatible,
            matched=matched if on_subscriber else None,
            use_default_callbacks=False,
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
            if own in [(end.node_name, end.node_namespace) for end in (offer, request)]
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
    watch : SubscriptionQos
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
        watch: SubscriptionQos,
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
            event_callbacks=SubscriptionEventCallbacks(
                incompatible_qos=self._incompatible, use_default_callbacks=False
            ),
        )
        self._depth = depth
        self._watch = watch
        self._refusal = refusal
        self._durability = durability
        self._subscribe(reliability)

    def take_waiting(self) -> list[tuple[Any, Any]]:
        """Take all messages that wait in the middleware, oldest first, with their information."""
        return list(islice(iter(self.take, None), self._depth))

    def take(self) -> Any:
        """Take the oldest message that waits in the middleware with its information, or None."""
        subscription = self._subscription
        with subscription.handle:
            return subscription.handle.take_message(subscription.msg_type, subscription.raw)

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
    watch : SubscriptionQos
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
        watch: SubscriptionQos,
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
            refusal="" if reliability == "auto" else NOT_RELIABLE.format(topic.replace("/", ".")),
        )
        self._subscription: OfferedSubscription | None = None
        self._refused_types: set[str] = set()
        self._published_types: tuple[str, ...] = ()
        self.subscribed = ""
        if type_name != "auto":
            with refusing_node_parameter(f"{topic.replace('/', '.')}_type"):
                message_class(type_name, self._readable)
            self._readable, self._expected = (type_name,), type_name
        if type_name != "auto" and self._asked:
            self._subscribe(type_name, self._asked)
        else:
            node.get_logger().info(
                f"waiting for a publisher of {node.resolve_topic_name(self._topic)}"
            )
        self._poll_timer = node.create_timer(
            POLL_PERIOD, self._query_publishers, clock=Clock(clock_type=ClockType.STEADY_TIME)
        )
        self._query_publishers(at_start=True)

    def take_waiting(self) -> list[tuple[Any, Any]]:
        """Take all messages that wait in the middleware; see `OfferedSubscription`."""
        return [] if self._subscription is None else self._subscription.take_waiting()

    @property
    def unread(self) -> tuple[str, ...]:
        """Published types at the last graph query that are not read, sorted."""
        return tuple(name for name in self._published_types if name != self.subscribed)

    @property
    def types(self) -> dict[str, Any]:
        """The subscribed type and those that are not read: fields of `Connections`."""
        readable = tuple(name for name in self.unread if not self._fault(name))
        return {
            "unread": self.unread,
            "other_readable": readable,
            "subscribed_type": self.subscribed,
        }

    def _query_publishers(self, at_start: bool = False) -> None:
        publishers = self._node.get_publishers_info_by_topic(self._topic)
        self._published_types = tuple(sorted({publisher.topic_type for publisher in publishers}))
        readable = [publisher for publisher in publishers if not self._fault(publisher.topic_type)]
        if readable and not self.subscribed:
            kind = readable[0].topic_type
            less = (kind, ReliabilityPolicy.BEST_EFFORT) in [
                (publisher.topic_type, publisher.qos_profile.reliability) for publisher in readable
            ]
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
        for name in sorted({*self.unread} - self._refused_types):
            self._log_unread(name)
        self._refused_types.update(self.unread)
        if readable:
            self._poll_timer.timer_period_ns = int(CONNECTED_POLL_PERIOD * 1e9)

    def _log_unread(self, type_name: str) -> None:
        """Log why messages of a published type are not read."""
        published = f"{self._node.resolve_topic_name(self._topic)} is published as {type_name}"
        if fault := self._fault(type_name):
            self._node.get_logger().error(f"{published}, {fault}")
        else:
            self._node.get_logger().warning(
                f"{published}, but this node has subscribed to it as {self.subscribed}; messages "
                "of the other type are not read; restart the node to use that type"
            )

    def _fault(self, type_name: str) -> str:
        """Why a type is not read; empty if it is."""
        if type_name not in self._readable:
            one_of = "one of " if len(self._readable) > 1 else ""
            images = "; sonar_detector reads images" * self._topic.endswith("detections")
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
