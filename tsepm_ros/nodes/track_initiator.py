"""The node that starts tracks: detections in, confirmed tracks out."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from typing import Any

from nav_msgs.msg import OccupancyGrid, Odometry
from rclpy.clock import Clock, ClockType
from rclpy.qos import DurabilityPolicy
from rclpy.timer import Timer
from sensor_msgs.msg import PointCloud2
from std_srvs.srv import Trigger

from msg_adapters import make_header
from msg_adapters.message_input import MessageInput
from tsepm_ros.diagnostics.health import Health
from tsepm_ros.diagnostics.health_figures import Latency
from tsepm_ros.nodes.diagnostics_publisher import DiagnosticsPublisher, ThrottledWarnings
from tsepm_ros.nodes.learned_file import SAVING_PERIOD, LearnedFile
from tsepm_ros.nodes.node_parameters import NodeParameters, ParameterisedNode
from tsepm_ros.nodes.publishers import TrackAnnouncements, TrackOutputs
from tsepm_ros.nodes.quality_of_service import QosWatch
from tsepm_ros.nodes.running import NodeClocks, run
from tsepm_ros.nodes.subscriptions import (
    DetectionsSubscription,
    OfferedSubscription,
    TfOwnShip,
    newest,
)
from tsepm_ros.own_ship.registration import Mounting
from tsepm_ros.session.consistency_checks import questions
from tsepm_ros.session.drop_reasons import DETECTIONS, FAILURES, OWN_SHIP
from tsepm_ros.session.session import Session
from tsepm_ros.settings.node_options import DiagnosticsOptions, InitiatorNodeOptions, SessionOptions
from tsepm_ros.settings.settings import TRACK_INITIATOR, help_text, settings_from
from tsepm_ros.tracker.sensor import SensorModel

WAIT_PERIOD = 0.05
"""Time between checks of the scans that wait for own-ship data, s."""
OWN_SHIP_TOPIC = "own_ship/odometry"
OWN_SHIP_DEPTH = 1000
TRACKED_DEPTH = 10


class TrackInitiator(ParameterisedNode):
    """Subscribes to detections and publishes confirmed tracks."""

    def __init__(self, **node_options: Any) -> None:
        super().__init__("track_initiator", **node_options)
        parameters = NodeParameters(
            self, TRACK_INITIATOR, self._configure, self._rehearse, FAILURES
        ).options
        options: InitiatorNodeOptions = parameters[InitiatorNodeOptions]
        self._warnings = ThrottledWarnings(self)
        self._clocks = NodeClocks(self, self._warnings.warn)
        self._asked: list[str] = []
        self._ask(parameters)
        self._session = Session(settings_from(parameters), self._report, live=True)
        method = parameters[SessionOptions].method
        self.get_logger().info(f"method {method}: splits, evaluates, prunes and merges tracks")
        self._learned = LearnedFile(
            self._session,
            options.learned_file,
            options.learned_max_age,
            self.get_logger().info,
            self.get_logger().warning,
        )
        self._input = MessageInput(self._session, options, self.get_logger().warning)
        self._health = Health(parameters[DiagnosticsOptions])
        qos = QosWatch(self)
        self._outputs = TrackOutputs(self, self._session, qos, options.publish_potential_tracks)

        self._announced = TrackAnnouncements(self.get_logger().info)

        self._subscribe_own_ship(qos)
        self._tracked = OfferedSubscription(
            self, PointCloud2, "tracked", TRACKED_DEPTH, self._input.take_tracked, qos
        )
        self._land = OfferedSubscription(
            self,
            OccupancyGrid,
            "land",
            1,
            self._input.take_land,
            qos,
            refusal="reliable, transient local delivery, so its chart is not received",
            durability=DurabilityPolicy.TRANSIENT_LOCAL,
        )
        self._detections = DetectionsSubscription(
            self,
            options.detections_type,
            options.detections_reliability,
            options.detections_depth,
            self._hear_detections,
            qos,
        )
        self.create_service(Trigger, "~/reset", self._on_reset)
        self._diagnostics = DiagnosticsPublisher(
            self,
            self._session,
            self._health,
            self._detections,
            qos,
            OWN_SHIP_TOPIC,
            options.diagnostics_period,
            self._clocks,
        )
        self.create_timer(
            SAVING_PERIOD, self._learned.write, clock=Clock(clock_type=ClockType.STEADY_TIME)
        )
        self.refuse_unused_overrides()

    @property
    def latency(self) -> Latency:
        """Latency of the last scan."""
        return self._health.latency

    def destroy_node(self) -> None:
        """Destroy the node; what was learned is written before."""
        self._learned.write()
        super().destroy_node()

    def _hear_detections(self, message: Any, information: Any) -> None:
        """Take a message from the middleware: under overload the newest, and the others count."""
        interval = self._session.tracker.learned.scan_interval.median
        message, waited, skipped = newest(
            message, information, interval, self._detections.take_waiting
        )
        if skipped:
            self._session.drop(
                "overload",
                f"{skipped} messages of detections waited too long and were skipped; the newest "
                "is processed",
                skipped,
            )
        self.take_detections(message, waited)

    def take_detections(self, message: Any, waited: float = 0.0) -> None:
        """Take a message of detections of any supported type that waited for a time, s."""
        entered = time.perf_counter() - waited
        now = self._clocks.now()
        self._health.heard(DETECTIONS, now)
        before = self._session.arrivals
        self._input.take_detections(message, now)
        if self._session.arrived_stamp is not None and self._session.arrivals > before:
            self._health.arrived(self._session.arrived_stamp, now)
        self._process(entered)

    def _take_own_ship(self, message: Odometry) -> None:
        self._note_own_ship(message)
        self._process(time.perf_counter())

    def _note_own_ship(self, message: Odometry) -> None:
        self._health.heard(OWN_SHIP, self._clocks.now())
        self._input.take_own_ship(message)

    def _read_own_ship(self) -> bool:
        """Take a message of odometry that waits in the middleware, if there is one."""
        entry = self._own_ship.take()
        if entry is None:
            return False
        self._note_own_ship(entry[0])
        return True

    def _subscribe_own_ship(self, qos: QosWatch) -> None:
        if self._session.own_ship.source == "none":
            frame = self._session.settings.session.fixed_frame or "of the detections"
            self.get_logger().info(
                "own_ship_source is none: the sensor is assumed fixed, tracks are in the frame "
                f"{frame}"
            )
        elif self._session.own_ship.source == "tf":
            self._session.own_ship.look_up = TfOwnShip(self, self._session).look_up
        else:
            self._own_ship = OfferedSubscription(
                self, Odometry, OWN_SHIP_TOPIC, OWN_SHIP_DEPTH, self._take_own_ship, qos
            )
            self._session.own_ship.read_unread = self._read_own_ship
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._waiting: Timer = self.create_timer(
            WAIT_PERIOD, lambda: self._process(time.perf_counter()), clock=steady
        )

    def _process(self, entered: float) -> None:
        """Process the scans that need not wait; `entered` is the callback's `perf_counter`."""
        for processed in self._session.process(self._clocks.now()):
            result = processed.in_frame()
            try:
                latency = self._outputs.publish(result, entered)
            except FAILURES as error:  # such as a stamp beyond the range of a message
                self._session.drop("internal_error", f"a scan was not published: {error!r}")
            else:
                self._health.processed(result.statistics.detections, latency, self._clocks.now())
            self._announced.announce(result, self._session.tracker.reason)
        if not self._session.unfinished:
            self._waiting.cancel()
        elif self._waiting.is_canceled():
            self._waiting.reset()

    def _on_reset(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        header = make_header(self.get_clock().now().nanoseconds, self._session.fixed_frame)
        self._session.reset()
        self._diagnostics.reset()
        self._outputs.clear(header)
        self._learned.forget()
        response.success = True
        response.message = "scans, tracks, counts and what was learned were cleared"
        return response

    def _rehearse(self, parameters: Mapping[type[Any], Any]) -> None:
        self._session.validate(settings_from(parameters))

    def _configure(self, parameters: Mapping[type[Any], Any]) -> None:
        if not self._session.configure(settings_from(parameters)):
            self.get_logger().info("parameters changed: potential tracks start over")
        self._ask(parameters)
        options: InitiatorNodeOptions = parameters[InitiatorNodeOptions]
        self._input.options = options
        self._outputs.show_potential_tracks(options.publish_potential_tracks)
        self._health.options = parameters[DiagnosticsOptions]
        self._diagnostics.set_period(options.diagnostics_period)

    def _ask(self, parameters: Mapping[type[Any], Any]) -> None:
        """Log questions about parameters that look like degrees, each once."""
        asked = questions(parameters[SensorModel], parameters[Mounting])
        for question in asked:
            if question not in self._asked:
                self.get_logger().warning(question)
        self._asked = asked

    def _report(self, reason: str, sentence: str) -> None:
        self._warnings.warn(reason, sentence, self._session.dropped[reason])


def main(args: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run(TrackInitiator, args, help_text("track_initiator", __doc__))


if __name__ == "__main__":
    raise SystemExit(main())
