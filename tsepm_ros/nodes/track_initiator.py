"""The node that starts tracks: detections in, confirmed tracks out."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Odometry
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Header
from std_srvs.srv import Trigger
from visualization_msgs.msg import MarkerArray

from msg_adapters import (
    MessageError,
    clear_markers,
    diagnostics,
    make_header,
    pose_sample,
    read_detections,
    read_own_ship,
    sensor_scan,
    time_to_ns,
    track_cloud,
    track_markers,
    track_odometry,
)
from tsepm_ros.nodes.detections_subscription import DetectionsSubscription
from tsepm_ros.nodes.node_parameters import AUTO_DECLARE, NodeParameters, ParameterError
from tsepm_ros.nodes.offered_subscription import OfferedSubscription
from tsepm_ros.nodes.running import run
from tsepm_ros.nodes.tf_own_ship import TfOwnShip
from tsepm_ros.nodes.tracked_subscription import subscribe_tracked
from tsepm_ros.parameter_groups import TRACK_INITIATOR, InitiatorNodeOptions, settings_from
from tsepm_ros.session import ScanResult, Session, SessionOptions

WAIT_PERIOD = 0.05
"""Time between looks at the scans that wait for own-ship data, s."""
WARNING_PERIOD = 10.0
"""Least time between warnings of the same kind, s."""
OWN_SHIP_DEPTH = 1000


@dataclass(frozen=True)
class Latency:
    """Time that a scan took in the node, s, from its callback's entry.

    Attributes
    ----------
    to_tracks : float
        Until `tracks` was published.
    to_all : float
        Until everything was.
    core : float
        The initiator's part of both.
    """

    to_tracks: float = 0.0
    to_all: float = 0.0
    core: float = 0.0


class TrackInitiator(Node):
    """Subscribes to detections and publishes confirmed tracks."""

    def __init__(self, **node_options: Any) -> None:
        super().__init__("track_initiator", **AUTO_DECLARE, **node_options)
        self._given = NodeParameters(self, TRACK_INITIATOR, self._configure)
        options: InitiatorNodeOptions = self._given.made[InitiatorNodeOptions]
        session_options: SessionOptions = self._given.made[SessionOptions]
        source, frame = session_options.own_ship_source, session_options.fixed_frame
        self._session = Session(settings_from(self._given.made), self._report, live=True)
        if options.bearing_reference == "north" and source == "none" and not frame:
            raise ParameterError(
                "fixed_frame must be given where bearing_reference is north and own_ship_source "
                "none: the tracks are then in an east-north frame, not in the sensor's"
            )
        self._warned: dict[str, float] = {}
        self._assumed: set[str] = set()
        self._latency = Latency()

        self._tracks = self.create_publisher(PointCloud2, "tracks", 100)
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._current = self.create_publisher(PointCloud2, "tracks/current", latched)
        self._odometry = self.create_publisher(Odometry, "tracks/odometry", 100)
        self._markers = self.create_publisher(MarkerArray, "tracks/markers", 10)
        self._potential = self.create_publisher(PointCloud2, "potential_tracks", 10)
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)

        steady = Clock(clock_type=ClockType.STEADY_TIME)
        if source == "tf":
            self._session.look_up = TfOwnShip(self, self._session).look_up
        if source == "odometry":
            self._own_ship = OfferedSubscription(
                self, Odometry, "own_ship/odometry", OWN_SHIP_DEPTH, self._on_own_ship
            )
        if source != "none":
            self.create_timer(WAIT_PERIOD, self._process, clock=steady)
        self._tracked = subscribe_tracked(self, self._session)
        self._detections = DetectionsSubscription(
            self,
            options.detections_type,
            options.detections_reliability,
            options.detections_depth,
            self._on_detections,
        )
        self.create_service(Trigger, "~/reset", self._on_reset)
        self._diagnostics_timer = self.create_timer(
            options.diagnostics_period, self._publish_diagnostics, clock=steady
        )

    @property
    def latency(self) -> Latency:
        """Latency of the last scan."""
        return self._latency

    def _on_detections(self, message: Any) -> None:
        entered = time.perf_counter()
        options = self._given.made[InitiatorNodeOptions]
        try:
            detections = read_detections(
                message,
                bearing_reference=options.bearing_reference,
                sound_speed=options.sound_speed,
            )
        except MessageError as error:
            self._session.drop(error.reason, f"detections dropped: {error}")
            return
        for reason, number in detections.dropped.items():
            self._session.drop(reason, f"{number} detections dropped: {reason}", number)
        for assumption in detections.assumptions:
            if assumption not in self._assumed:
                self._assumed.add(assumption)
                self.get_logger().warning(assumption)
        self._session.add_scan(sensor_scan(detections), self._now())
        self._process(entered)

    def _on_own_ship(self, message: Odometry) -> None:
        try:
            sample = read_own_ship(message)
        except MessageError as error:
            self._session.drop("own_ship_invalid", f"own-ship data dropped: {error}")
            return
        self._session.add_own_ship(pose_sample(sample), sample.frame_id, sample.child_frame_id)
        self._process()

    def _process(self, entered: float | None = None) -> None:
        entered = time.perf_counter() if entered is None else entered
        try:
            for result in self._session.process(self._now()):
                header = make_header(result.stamp_ns, result.frame_id)
                self._tracks.publish(track_cloud(header, result.new))
                to_tracks = time.perf_counter() - entered
                self._publish_more(header, result)
                to_all = time.perf_counter() - entered
                self._latency = Latency(to_tracks, to_all, result.core_seconds)
        except (ArithmeticError, LookupError, MemoryError, ValueError) as error:
            # The node must outlive whatever a message brings; the scan is lost, not the watch.
            self._session.drop("internal_error", f"a scan could not be processed: {error!r}")
            self._session.initiator.reset()

    def _publish_more(self, header: Header, result: ScanResult) -> None:
        """Publish what is not as urgent as the new tracks."""
        self._current.publish(track_cloud(header, result.current))
        # Nested messages are slow to build in Python: only for those who listen.
        if self._odometry.get_subscription_count():
            for track in result.new:
                self._odometry.publish(track_odometry(header, track))
        if self._markers.get_subscription_count():
            self._markers.publish(track_markers(header, result.current, result.ended))
        if self._given.made[InitiatorNodeOptions].publish_potential_tracks:
            potential = self._session.initiator.potential_tracks()
            self._potential.publish(track_cloud(header, potential))

    def _on_reset(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        now = time_to_ns(self.get_clock().now().to_msg())
        header = make_header(now, self._session.fixed_frame)
        self._session.reset()
        self._markers.publish(clear_markers(header))
        self._current.publish(track_cloud(header, []))
        response.success = True
        response.message = "scans, tracks and counts are forgotten"
        return response

    def _configure(self, made: Mapping[type[Any], Any]) -> None:
        if not self._session.configure(settings_from(made)):
            self.get_logger().info("parameters changed: potential tracks start over")
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
        level, summary, values = self._session.health()
        if not self._detections.connected:
            level, summary = "warn", "no publisher of detections yet"
        values["latency_ms"] = 1e3 * self._latency.to_tracks
        values["latency_all_ms"] = 1e3 * self._latency.to_all
        values["core_ms"] = 1e3 * self._latency.core
        stamp = time_to_ns(self.get_clock().now().to_msg())
        name = f"{self.get_name()}: track initiation"
        self._diagnostics.publish(diagnostics(stamp, name, level, summary, values))

    def _now(self) -> tuple[float, float]:
        """Times by which waiting is judged: the wall's, and the node's, which may be simulated."""
        return time.monotonic(), self.get_clock().now().nanoseconds * 1e-9


def main(args: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run(TrackInitiator, args)
