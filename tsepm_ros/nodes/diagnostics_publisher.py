"""The publisher of /diagnostics, and warnings at a limited rate.

Warnings that are logged at a limited rate.

Publisher of the health of session and connections on ``/diagnostics``.
"""

from __future__ import annotations

import time

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from msg_adapters import diagnostics
from tsepm_ros.diagnostics.health import Health, unused_own_ship_on
from tsepm_ros.diagnostics.health_figures import Connections
from tsepm_ros.nodes import quality_of_service
from tsepm_ros.nodes.quality_of_service import QosWatch
from tsepm_ros.nodes.running import NodeClocks
from tsepm_ros.nodes.subscriptions import DetectionsSubscription
from tsepm_ros.session.drop_reasons import reason_of
from tsepm_ros.session.session import Session

WARNING_PERIOD = 10.0
"""Minimum time between warnings with the same reason, s."""
MORE_DETECTIONS = 10
"""Factor between the numbers of dropped detections of two warnings: many pings have some."""
TOPICS = (
    *("detections", "own_ship/odometry", "tracks", "tracks/current"),
    *("detections/placed", "potential_tracks", "fixed_echoes"),
)
"""Topics whose full names are published, for programs that show the node."""
FACTS = ("intensity", "plots", "land", "sweep", "tracker_back", "own_ship_restart")
"""Reasons that are no fault."""


class ThrottledWarnings:
    """Logs warnings with the same reason at most once per `WARNING_PERIOD`, and facts as INFO.

    Drops of single detections are logged again once they are `MORE_DETECTIONS` times as many.

    Parameters
    ----------
    node : rclpy.node.Node
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._warned: dict[str, float] = {}
        self._said: dict[str, int] = {}

    def warn(self, reason: str, sentence: str, total: int) -> None:
        """Log a fault and the number of its occurrences, unless it was logged just before.

        Nothing is logged while the node ends.
        """
        if not self._node.context.ok():
            return
        now = time.monotonic()
        if now - self._warned.get(reason, -WARNING_PERIOD) < WARNING_PERIOD:
            return
        if total and reason_of(reason).lost == "detection":
            if total < MORE_DETECTIONS * self._said.get(reason, 0):
                return
            self._said[reason] = total
        self._warned[reason] = now
        counted = f"{sentence} ({total} so far: {reason})" if total else sentence
        logger = self._node.get_logger()
        if reason in FACTS:  # a line of its own: rclpy refuses two severities of one line
            logger.info(counted)
        else:
            logger.warning(counted)


class DiagnosticsPublisher:
    """Evaluates the health and publishes it periodically.

    Parameters
    ----------
    node : rclpy.node.Node
    session : Session
    health : Health
    detections : DetectionsSubscription
    qos : QosWatch
    own_ship_topic : str
        Topic that is checked for odometry that the session does not use.
    period : float
        Time between messages, s.
    clocks : NodeClocks
        The clocks of `health`.
    """

    def __init__(
        self,
        node: Node,
        session: Session,
        health: Health,
        detections: DetectionsSubscription,
        qos: QosWatch,
        own_ship_topic: str,
        period: float,
        clocks: NodeClocks,
    ) -> None:
        self._node = node
        self._session = session
        self._health = health
        self._detections = detections
        self._qos = qos
        self._own_ship_topic = node.resolve_topic_name(own_ship_topic)
        self._clocks = clocks
        self._warned_of_own_ship = False
        self._publisher = node.create_publisher(
            DiagnosticArray, "/diagnostics", 10, qos_overriding_options=quality_of_service.PUBLISHER
        )
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = node.create_timer(period, self._publish, clock=steady)

    def set_period(self, period: float) -> None:
        """Change the period of the messages, s, and restart it."""
        self._timer.timer_period_ns = int(period * 1e9)
        self._timer.reset()

    def reset(self) -> None:
        """Reset the counts."""
        self._health.reset()
        self._qos.heard.clear()

    def _publish(self) -> None:
        now = self._clocks.now()
        connections = Connections(
            clock_fault=self._clocks.fault,
            subscribed=bool(self._detections.subscribed),
            unread=self._detections.unread,
            subscribed_type=self._detections.subscribed,
            other_readable=self._detections.other_readable,
            topics={name: self._node.resolve_topic_name(name) for name in TOPICS},
            mismatches_heard=dict(self._qos.heard),
            mismatches=self._qos.standing(),
            unused_own_ship=self._unused_own_ship(),
        )
        statuses = self._health.report(self._session.figures(), now, connections)
        stamp_ns = self._node.get_clock().now().nanoseconds
        self._publisher.publish(
            diagnostics(stamp_ns, self._node.get_fully_qualified_name(), statuses)
        )

    def _unused_own_ship(self) -> str:
        """Topic of odometry that is published but not used, with one warning; empty if none."""
        if self._session.own_ship.source != "none":
            return ""
        endpoints = self._node.get_publishers_info_by_topic(self._own_ship_topic)
        if "nav_msgs/msg/Odometry" not in {endpoint.topic_type for endpoint in endpoints}:
            return ""
        if not self._warned_of_own_ship:
            self._warned_of_own_ship = True
            self._node.get_logger().warning(unused_own_ship_on(self._own_ship_topic))
        return self._own_ship_topic
