"""Subscribing to the detections in the type and with the reliability that the driver offers."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import ReliabilityPolicy

from msg_adapters import MessageError, message_class, supported_types
from tsepm_ros.nodes.node_parameters import refusing
from tsepm_ros.nodes.offered_subscription import OfferedSubscription
from tsepm_ros.nodes.qos_watch import QosWatch

TOPIC = "detections"
LOOK_PERIOD = 0.1
"""Time between looks at the graph while no driver is known, s."""
WATCH_PERIOD = 2.0
"""Time between looks once one is, s."""

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
    watch_period : float, optional
        Time between looks at the graph once a driver is known, s: it may come back as another type.
    find_class : callable, optional
        Returns the message class of a type, or raises MessageError.

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
        *,
        watch_period: float = WATCH_PERIOD,
        find_class: Callable[[str], type] = message_class,
    ) -> None:
        self._node = node
        self._watch_period = watch_period
        self._find_class = find_class
        self._reliability = reliability
        self._depth = depth
        self._callback = callback
        self._watch = watch
        self._subscription: OfferedSubscription | None = None
        self._refused_types: set[str] = set()
        self._type_name = type_name
        self._found: tuple[str, ...] = ()
        self._subscribed = ""
        if type_name != "auto":
            with refusing("detections_type"):
                find_class(type_name)
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

    @property
    def unread(self) -> tuple[str, ...]:
        """Types as which the topic was published at the last look but is not read, sorted."""
        return tuple(name for name in self._found if name != self._subscribed)

    @property
    def subscribed(self) -> str:
        """Type of the subscription; empty where there is none yet."""
        return self._subscribed

    def _look_for_publisher(self) -> None:
        publishers = self._node.get_publishers_info_by_topic(TOPIC)
        self._found = tuple(sorted({publisher.topic_type for publisher in publishers}))
        readable = [publisher for publisher in publishers if not self._fault(publisher.topic_type)]
        if readable and not self.connected:
            offered = readable[0].qos_profile.reliability
            reliability = _RELIABILITY.get(self._reliability, offered)
            self._subscribe(readable[0].topic_type, reliability)
        for name in self._found:
            if name != self._subscribed and name not in self._refused_types:
                self._refused_types.add(name)
                self._say_unread(name)
        if readable:
            self._look.timer_period_ns = int(self._watch_period * 1e9)

    def _say_unread(self, found: str) -> None:
        """Say why nothing that is published as this type is read."""
        published = f"{self._node.resolve_topic_name(TOPIC)} is published as {found}"
        fault = self._fault(found)
        if fault:
            self._node.get_logger().error(f"{published}, {fault}")
            return
        self._node.get_logger().warning(
            f"{published}, but this node has subscribed to it as {self._subscribed}: what comes as "
            "the other type is not read; start the node again to read it"
        )

    def _fault(self, found: str) -> str:
        """Why a type is not read; empty if it is."""
        wanted = supported_types() if self._type_name == "auto" else (self._type_name,)
        if found not in wanted:
            one_of = "one of " if len(wanted) > 1 else ""
            return f"which this node does not read; it reads {one_of}{', '.join(wanted)}"
        try:
            self._find_class(found)
        except MessageError as error:
            return f"but {error}"
        return ""

    def _subscribe(self, type_name: str, reliability: ReliabilityPolicy) -> None:
        if reliability != ReliabilityPolicy.BEST_EFFORT:
            reliability = ReliabilityPolicy.RELIABLE
        self._subscribed = type_name
        self._subscription = OfferedSubscription(
            self._node,
            self._find_class(type_name),
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
