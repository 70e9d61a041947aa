"""The node that starts tracks: detections in, confirmed tracks out."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Odometry
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2
from std_srvs.srv import Trigger

from msg_adapters import diagnostics, make_header, time_to_ns
from tsepm_ros.diagnostics.health import Health
from tsepm_ros.diagnostics.health_figures import Connections, Latency
from tsepm_ros.diagnostics.rules import unused_own_ship_on
from tsepm_ros.nodes.detections_subscription import DetectionsSubscription
from tsepm_ros.nodes.node_parameters import AUTO_DECLARE, NodeParameters
from tsepm_ros.nodes.offered_subscription import OfferedSubscription
from tsepm_ros.nodes.qos_watch import QosWatch
from tsepm_ros.nodes.running import run
from tsepm_ros.nodes.tf_own_ship import TfOwnShip
from tsepm_ros.nodes.track_outputs import TrackOutputs
from tsepm_ros.replay.message_input import MessageInput
from tsepm_ros.session.drop_reasons import DETECTIONS, OWN_SHIP
from tsepm_ros.session.result import ScanResult
from tsepm_ros.session.session import FAILURES, Session
from tsepm_ros.settings.diagnostics_options import DiagnosticsOptions
from tsepm_ros.settings.node_options import InitiatorNodeOptions
from tsepm_ros.settings.session_options import SessionOptions
from tsepm_ros.settings.tables import TRACK_INITIATOR, settings_from

WAIT_PERIOD = 0.05
"""Time between looks at the scans that wait for own-ship data, s."""
WARNING_PERIOD = 10.0
"""Least time between warnings of the same kind, s."""
OWN_SHIP_TOPIC = "own_ship/odometry"
OWN_SHIP_DEPTH = 1000
TRACKED_DEPTH = 10


class TrackInitiator(Node):
    """Subscribes to detections and publishes confirmed tracks."""

    def __init__(self, **node_options: Any) -> None:
        super().__init__("track_initiator", **AUTO_DECLARE, **node_options)
        self._given = NodeParameters(
            self,
            TRACK_INITIATOR,
            self._configure,
            lambda made: self._session.rehearse(settings_from(made)),
            FAILURES,
        )
        options: InitiatorNodeOptions = self._given.made[InitiatorNodeOptions]
        source = self._given.made[SessionOptions].own_ship_source
        self._session = Session(settings_from(self._given.made), self._report, live=True)
        self._warned: dict[str, float] = {}
        self._said_unused = False
        self._input = MessageInput(self._session, options, self.get_logger().warning)
        self._health = Health(self._given.made[DiagnosticsOptions])
        self._qos = QosWatch(self)
        self._outputs = TrackOutputs(self, self._session, self._qos)
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)

        steady = Clock(clock_type=ClockType.STEADY_TIME)
        if source == "tf":
            self._session.look_up = TfOwnShip(self, self._session).look_up
        if source == "odometry":
            self._own_ship = OfferedSubscription(
                self, Odometry, OWN_SHIP_TOPIC, OWN_SHIP_DEPTH, self._on_own_ship, self._qos
            )
        if source == "none":
            frame = self._given.made[SessionOptions].fixed_frame or "of the detections"
            self.get_logger().info(
                "own_ship_source is none: the sensor is taken not to move, tracks are in the frame "
                + frame
            )
        else:
            self.create_timer(WAIT_PERIOD, self._process, clock=steady)
        self._tracked = OfferedSubscription(
            self, PointCloud2, "tracked", TRACKED_DEPTH, self._input.take_tracked, self._qos
        )
        self._detections = DetectionsSubscription(
            self,
            options.detections_type,
            options.detections_reliability,
            options.detections_depth,
            self._on_detections,
            self._qos,
        )
        self.create_service(Trigger, "~/reset", self._on_reset)
        self._diagnostics_timer = self.create_timer(
            options.diagnostics_period, self._publish_diagnostics, clock=steady
        )

    @property
    def latency(self) -> Latency:
        """Latency of the last scan."""
        return self._health.latency

    def _on_detections(self, message: Any) -> None:
        entered = time.perf_counter()
        now = self._now()
        self._health.heard(DETECTIONS, now)
        self._input.take_detections(message, now)
        if self._session.arrived_stamp is not None:
            self._health.arrived(self._session.arrived_stamp, now)
        self._process(entered)

    def _on_own_ship(self, message: Odometry) -> None:
        self._health.heard(OWN_SHIP, self._now())
        self._input.take_own_ship(message)
        self._process()

    def _process(self, entered: float | None = None) -> None:
        entered = time.perf_counter() if entered is None else entered
        for result in self._session.process(self._now()):
            try:
                self._publish(result, entered)
            except FAILURES as error:  # such as a stamp that no message can hold
                self._session.drop("internal_error", f"a scan was not published: {error!r}")

    def _publish(self, result: ScanResult, entered: float) -> None:
        begin = time.perf_counter()
        header = make_header(result.stamp_ns, result.frame_id)
        self._outputs.publish_new(header, result)
        published = time.perf_counter()
        potential = self._given.made[InitiatorNodeOptions].publish_potential_tracks
        self._outputs.publish_more(header, result, potential)
        end = time.perf_counter()
        latency = Latency(
            to_tracks=published - entered,
            to_all=end - entered,
            waiting=result.waiting,
            core=result.core_seconds,
            publishing=end - begin,
        )
        self._health.processed(result.statistics.detections, latency, self._now())

    def _on_reset(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        now = time_to_ns(self.get_clock().now().to_msg())
        header = make_header(now, self._session.fixed_frame)
        self._session.reset()
        self._health.reset()
        self._qos.heard.clear()
        self._outputs.clear(header)
        response.success = True
        response.message = "scans, tracks and counts are forgotten"
        return response

    def _configure(self, made: Mapping[type[Any], Any]) -> None:
        if not self._session.configure(settings_from(made)):
            self.get_logger().info("parameters changed: potential tracks start over")
        self._input.options = made[InitiatorNodeOptions]
        self._health.options = made[DiagnosticsOptions]
        self._diagnostics_timer.timer_period_ns = int(
            made[InitiatorNodeOptions].diagnostics_period * 1e9
        )
        self._diagnostics_timer.reset()

    def _report(self, reason: str, sentence: str) -> None:
        """Warn of a drop, of each kind not more often than WARNING_PERIOD."""
        now = time.monotonic()
        if now - self._warned.get(reason, -WARNING_PERIOD) < WARNING_PERIOD:
            return
        self._warned[reason] = now
        total = self._session.dropped[reason]
        self.get_logger().warning(f"{sentence} ({total} so far: {reason})" if total else sentence)

    def _publish_diagnostics(self) -> None:
        connections = Connections(
            self._detections.connected,
            self._detections.unread,
            dict(self._qos.heard),
            self._qos.standing(),
            self._unused_own_ship(),
        )
        statuses = self._health.report(self._session.figures(), self._now(), connections)
        stamp = time_to_ns(self.get_clock().now().to_msg())
        self._diagnostics.publish(diagnostics(stamp, self.get_name(), statuses))

    def _unused_own_ship(self) -> str:
        """The topic of odometry where it is published and not listened to; a warning says so."""
        if self._session.source != "none":
            return ""
        topic = self.resolve_topic_name(OWN_SHIP_TOPIC)
        types = {one.topic_type for one in self.get_publishers_info_by_topic(topic)}
        if "nav_msgs/msg/Odometry" not in types:
            return ""
        if not self._said_unused:
            self._said_unused = True
            self.get_logger().warning(unused_own_ship_on(topic))
        return topic

    def _now(self) -> tuple[float, float]:
        """Times by which waiting is judged: the wall's, and the node's, which may be simulated."""
        return time.monotonic(), self.get_clock().now().nanoseconds * 1e-9


def main(args: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run(TrackInitiator, args)


if __name__ == "__main__":
    raise SystemExit(main())
