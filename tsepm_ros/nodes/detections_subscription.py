"""Subscribing to the detections in the type and with the reliability that the driver offers."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import ReliabilityPolicy
from rclpy.topic_endpoint_info import TopicEndpointInfo

from msg_adapters import MessageError, message_class, supported_types
from tsepm_ros.nodes.node_parameters import ParameterError
from tsepm_ros.nodes.offered_subscription import OfferedSubscription
from tsepm_ros.nodes.qos_watch import QosWatch

TOPIC = "detections"
LOOK_PERIOD = 0.1
"""Time between looks at the graph while no driver is known, s."""

_RELIABILITY = {
    "reliable": ReliabilityPolicy.RELIABLE,
    "best_effort": ReliabilityPolicy.BEST_EFFORT,
}


class DetectionsSubscription:
    """A subscription to `detections` that takes its type and reliability from the publisher.

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
        Told of publishers whose quality of service does not fit.

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
        callback: Callable[[Any], None],
        watch: QosWatch,
    ) -> None:
        self._node = node
        self._reliability = reliability
        self._depth = depth
        self._callback = callback
        self._watch = watch
        self._subscription: OfferedSubscription | None = None
        self._refused_types: set[str] = set()
        self._type_name = type_name
        self._look: Any = None
        if type_name != "auto":
            try:
                message_class(type_name)
            except MessageError as error:
                raise ParameterError(f"detections_type: {error}") from None
        if type_name != "auto" and reliability != "auto":
            self._subscribe(type_name, _RELIABILITY[reliability])
        else:
            node.get_logger().info(f"waiting for a publisher of {node.resolve_topic_name(TOPIC)}")
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._look = node.create_timer(LOOK_PERIOD, self._look_for_publisher, clock=steady)
        self._look_for_publisher()

    @property
    def connected(self) -> bool:
        """Whether the subscription exists."""
        return self._subscription is not None

    def _look_for_publisher(self) -> None:
        for publisher in self._node.get_publishers_info_by_topic(TOPIC):
            if self._is_wanted(publisher):
                self._node.destroy_timer(self._look)
                if self.connected:
                    return
                reliability = _RELIABILITY.get(self._reliability, publisher.qos_profile.reliability)
                self._subscribe(publisher.topic_type, reliability)
                return

    def _is_wanted(self, publisher: TopicEndpointInfo) -> bool:
        found = publisher.topic_type
        fault = self._fault(found)
        if fault and found not in self._refused_types:
            self._refused_types.add(found)
            topic = self._node.resolve_topic_name(TOPIC)
            self._node.get_logger().error(f"{topic} is published as {found}, {fault}")
        return not fault

    def _fault(self, found: str) -> str:
        """Why a type is not read; empty if it is."""
        wanted = supported_types() if self._type_name == "auto" else (self._type_name,)
        if found not in wanted:
            one_of = "one of " if len(wanted) > 1 else ""
            return f"which this node does not read; it reads {one_of}{', '.join(wanted)}"
        try:
            message_class(found)
        except MessageError as error:
            return f"but {error}"
        return ""

    def _subscribe(self, type_name: str, reliability: ReliabilityPolicy) -> None:
        if reliability != ReliabilityPolicy.BEST_EFFORT:
            reliability = ReliabilityPolicy.RELIABLE
        self._subscription = OfferedSubscription(
            self._node,
            message_class(type_name),
            TOPIC,
            self._depth,
            self._callback,
            self._watch,
            reliability=reliability,
            fixed=self._reliability != "auto",
        )
        self._node.get_logger().info(
            f"subscribed to {self._subscription.topic_name} as {type_name}, "
            f"{reliability.name.lower()}"
        )
