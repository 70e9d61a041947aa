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
"""The node that starts tracks, detections in, confirmed tracks out; and its learned file."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from nav_msgs.msg import OccupancyGrid, Odometry
from rclpy.qos import DurabilityPolicy
from sensor_msgs.msg import PointCloud2
from std_srvs.srv import Trigger

from msg_adapters.message_input import MessageInput
from tsepm_ros.diagnostics.health import Health, health_unused_own_ship
from tsepm_ros.diagnostics.health_figures import Status
from tsepm_ros.nodes.base_node import BaseNode, NodeClocks, run_node
from tsepm_ros.nodes.pace import newest_at_pace, pace_seconds_in_queue
from tsepm_ros.nodes.publishers import (
    AnnouncementPublisher,
    TrackPublishers,
)
from tsepm_ros.nodes.subscriptions import (
    DetectionsSubscription,
    OfferedSubscription,
    SubscriptionQos,
)
from tsepm_ros.nodes.tf_own_ship import tf_look_up
from tsepm_ros.own_ship.registration import Mounting
from tsepm_ros.session.consistency_checks import check_questions
from tsepm_ros.session.drop_reasons import DETECTIONS, INTERNAL_ERROR, OWN_SHIP, shortened_reason
from tsepm_ros.session.session import Session
from tsepm_ros.settings.node_options import DiagnosticsOptions, InitiatorNodeOptions, SessionOptions
from tsepm_ros.settings.settings import settings_from, settings_help
from tsepm_ros.tracker.clutter import learned
from tsepm_ros.tracker.sensor import SensorModel
from tsepm_ros.whole_files import OwnedFile, file_error_sentence

WAIT_PERIOD, IDLE_PERIOD = 0.05, 3600.0
"""Time between checks of the scans that wait for own-ship data, and while none waits, s."""
OWN_SHIP_TOPIC = "own_ship/odometry"
OWN_SHIP_DEPTH = 1000
TRACKED_DEPTH = 10
TOPICS = (
    *("detections", "own_ship/odometry", "tracks", "tracks/current"),
    *("detections/placed", "potential_tracks", "fixed_echoes", "land"),
)
"""Topics whose full names are published, for programs that show the node."""
MAX_SIZE = 2**24
"""Size of the largest learned file that is read, bytes: of most sensors it is a hundredth."""
SAVING_PERIOD = 60.0
"""Time between writings of that file, s."""


class InitiatorLearnedFile:
    """Reads what was learned at the start, and writes it while the node runs and at its end.

    The file is this node's alone, see `OwnedFile`. Ages count on the system's clock: a simulated
    clock starts again with each run.

    Parameters
    ----------
    session : Session
    path : str
        Empty: nothing is read or written.
    max_age : float
        s.
    logger : rclpy logger

    Attributes
    ----------
    fault : str
        Why the file is not written; empty where it is.
    """

    def __init__(
        self,
        session: Session,
        path: str,
        max_age: float,
        logger: Any,
    ) -> None:
        self._session, self._logger = session, logger
        self._file: OwnedFile | None = None
        self._name, self.fault = shortened_reason(f"learned_file {path}"), ""
        if path:
            with self._judging():
                self._read(Path(path), max_age)

    def _read(self, path: Path, max_age: float) -> None:
        if any(len(part.encode()) > 200 for part in path.parts):  # temporary names are longer
            raise OSError("a name in its path has more than 200 bytes")
        self._file = OwnedFile(path.expanduser(), learned.SIGNATURE, MAX_SIZE)
        text = self._file.read()
        if not text:
            return
        try:
            models, age = learned.read_learned(
                text,
                self._session.settings.sensor,
                self._session.settings.session.sensor_frame,
                time.time(),
                max_age,
            )
        except ValueError as error:
            self._logger.warning(f"{self._name} is not used, and is written anew: {error}")
            return
        self._session.tracker.sensor.learned = models
        self._logger.info(
            f"what was learned {age / 60.0:.0f} min ago is used from {path}: clutter density "
            f"{self._session.tracker.sensor.clutter_density:.2g} per m^2, detection probability "
            f"{self._session.tracker.sensor.estimated_detection_probability:.2f}"
        )

    def forget(self) -> None:
        """Remove the file."""
        if self._file is not None:
            with self._judging():
                self._file.remove()

    def write(self) -> None:
        """Write what was learned, if a scan was processed."""
        initiator = self._session.tracker
        if self._file is None or initiator.stamp is None:
            return
        with self._judging():
            self._file.write(
                learned.write_learned(
                    initiator.sensor.learned,
                    initiator.sensor.model,
                    self._session.settings.session.sensor_frame,
                    time.time(),
                )
            )

    def close(self) -> None:
        """Write for the last time; the file is free for another node then."""
        self.write()
        if self._file is not None:
            self._file.hold(None)

    @contextmanager
    def _judging(self) -> Iterator[None]:
        """Keep the error of a block as the fault, or that there is none; a new one is logged."""
        before, self.fault = self.fault, ""
        try:
            yield
        except (OSError, ValueError, RuntimeError) as error:  # the last: no such user
            self.fault = f"{self._name} is not used: {file_error_sentence(error)}"
        if self.fault not in ("", before):
            self._logger.warning(self.fault)


class TrackInitiator(BaseNode):
    """Subscribes to detections and publishes confirmed tracks.

    Attributes
    ----------
    health : Health
    """

    def __init__(self, **node_options: Any) -> None:
        super().__init__(
            "track_initiator",
            self._configure,
            lambda changed: self._session.validate(settings_from(changed)),
            **node_options,
        )
        options: InitiatorNodeOptions = self.options[InitiatorNodeOptions]
        self._clocks = NodeClocks(self)
        self._ask(self.options)
        self._session, self._ends = Session(settings_from(self.options), self._say, live=True), 0
        self.get_logger().info(
            f"method {self.options[SessionOptions].method}: splits, evaluates, prunes and merges "
            "tracks"
        )
        self._learned = InitiatorLearnedFile(
            self._session,
            options.learned_file,
            options.learned_max_age,
            self.get_logger(),
        )
        self._input = MessageInput(self._session, options, self.warn_once)
        self.health: Health = Health(self.options[DiagnosticsOptions])
        self._qos = SubscriptionQos(self)
        self._outputs = TrackPublishers(
            self, self._session, self._qos, options.publish_potential_tracks
        )
        self._announced = AnnouncementPublisher(self.get_logger().info)
        self._subscribe_own_ship()
        self._tracked = OfferedSubscription(
            self, PointCloud2, "tracked", TRACKED_DEPTH, self._input.take_tracked, self._qos
        )
        self._land = OfferedSubscription(
            self,
            OccupancyGrid,
            "land",
            1,
            self._input.take_land,
            self._qos,
            refusal="reliable, transient local delivery, so its chart is not received",
            durability=DurabilityPolicy.TRANSIENT_LOCAL,
        )
        self._detections = DetectionsSubscription(
            self,
            options.detections_type,
            options.detections_reliability,
            options.detections_depth,
            self._hear_detections,
            self._qos,
        )
        self.create_service(Trigger, "~/reset", self._on_reset)
        self.create_service(Trigger, "~/end_tracks", self._on_end_tracks)
        self._report_every(options.diagnostics_period)
        self.steady_timer(SAVING_PERIOD, self._learned.write)
        self.refuse_unused_overrides()

    def destroy_node(self) -> None:
        """Destroy the node; what was learned is written before."""
        self._learned.close()
        super().destroy_node()

    def drop(self, reason: str, sentence: str, number: int = 1) -> None:
        """Count what is not used among the drops of the session."""
        self._session.drop(reason, sentence, number)

    def _hear_detections(self, message: Any, information: Any) -> None:
        """Take a message from the middleware: under overload the newest, and the others count."""
        message, information, skipped = newest_at_pace(
            message,
            information,
            self._session.tracker.sensor.learned.scan_interval.median,
            self._detections.take_waiting,
        )
        if skipped:
            self._session.drop(
                "overload",
                f"{len(skipped)} messages of detections waited too long and were skipped; the "
                "newest is processed",
                len(skipped),
            )
        self.take_detections(message, pace_seconds_in_queue(information))

    def take_detections(self, message: Any, waited: float = 0.0) -> None:
        """Take a message of detections of any supported type that waited for a time, s."""
        entered = time.perf_counter() - waited
        now = self._clocks.now()
        self.health.heard(DETECTIONS, now)
        before = self._session.arrivals
        self._input.take_detections(message, now)
        if self._session.arrived_stamp is not None and self._session.arrivals > before:
            self.health.arrived(self._session.arrived_stamp, now)
        self._process(entered)

    def _take_own_ship(self, message: Odometry) -> None:
        self._note_own_ship(message)
        self._process(time.perf_counter())

    def _note_own_ship(self, message: Odometry) -> None:
        self.health.heard(OWN_SHIP, self._clocks.now())
        self._input.take_own_ship(message)

    def _read_own_ship(self) -> bool:
        """Take a message of odometry that waits in the middleware, if there is one."""
        entry = self._own_ship.take()
        if entry is None:
            return False
        self._note_own_ship(entry[0])
        return True

    def _subscribe_own_ship(self) -> None:
        if self._session.own_ship.source == "none":
            frame = self._session.settings.session.fixed_frame or "of the detections"
            self.get_logger().info(
                "own_ship_source is none: the sensor is assumed fixed, tracks are in the frame "
                f"{frame}"
            )
        elif self._session.own_ship.source == "tf":
            self._session.own_ship.look_up = tf_look_up(self, self._session)
        else:
            self._own_ship = OfferedSubscription(
                self, Odometry, OWN_SHIP_TOPIC, OWN_SHIP_DEPTH, self._take_own_ship, self._qos
            )
            self._session.own_ship.read_unread = self._read_own_ship
        self._waiting = self.steady_timer(WAIT_PERIOD, lambda: self._process(time.perf_counter()))

    def _process(self, entered: float) -> None:
        """Process the scans that need not wait; `entered` is the callback's `perf_counter`."""
        for processed in self._session.process(self._clocks.now()):
            self._publish_ends()
            result = processed.in_frame()
            try:
                latency = self._outputs.publish(result, entered)
            except Exception as error:  # such as a stamp beyond the range of a message
                self._session.drop(INTERNAL_ERROR, f"a scan was not published: {error!r}")
            else:
                self.health.processed(result.statistics.detections, latency, self._clocks.now())
            self._announced.announce(result, self._session.tracker.reason)
        self._publish_ends()
        # The timer stays: one that is cancelled meanwhile ends an executor of several threads.
        period = round(1e9 * (WAIT_PERIOD if self._session.unfinished else IDLE_PERIOD))
        if period != self._waiting.timer_period_ns:
            self._waiting.timer_period_ns = period
            self._waiting.reset()

    def _publish_ends(self) -> None:
        """Publish that there are no tracks, where all were ended since the last results."""
        if self._ends != self._session.ends_of_all:
            self._ends = self._session.ends_of_all
            self._outputs.clear(self.get_clock().now().nanoseconds)

    def _on_reset(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._session.reset()
        self.health.reset()
        self._qos.heard.clear()
        self._publish_ends()
        self._learned.forget()
        return Trigger.Response(
            success=True, message="scans, tracks, counts and what was learned were cleared"
        )

    def _on_end_tracks(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._session.end_tracks()
        self._publish_ends()
        response.success, response.message = True, "tracks and starts were ended"
        return response

    def _configure(self, parameters: Mapping[type[Any], Any]) -> None:
        if not self._session.configure(settings_from(parameters)):
            self.get_logger().info("parameters changed: potential tracks start over")
        self._ask(parameters)
        options: InitiatorNodeOptions = parameters[InitiatorNodeOptions]
        self._input.options = options
        self._outputs.show_potential_tracks(options.publish_potential_tracks)
        self.health.options = parameters[DiagnosticsOptions]
        self._report_every(options.diagnostics_period)

    def _report_every(self, period: float) -> None:
        """Publish the health so often, s."""
        self.health.period = period
        self.report_timer.timer_period_ns = int(period * 1e9)
        self.report_timer.reset()

    def _ask(self, parameters: Mapping[type[Any], Any]) -> None:
        """Log questions about parameters that look like degrees, each once."""
        for question in check_questions(parameters[SensorModel], parameters[Mounting]):
            self.warn_once(question)

    def statuses(self) -> list[Status]:
        """What is published on /diagnostics."""
        now = self._clocks.now()
        detections = self.connections(
            DETECTIONS,
            clock_fault=self._clocks.fault,
            file_fault=self._learned.fault,
            **self._detections.types,
            topics={name: self.resolve_topic_name(name) for name in TOPICS},
            mismatches_heard=dict(self._qos.heard),
            mismatches=self._qos.standing(),
            unused_own_ship=self._unused_own_ship(),
        )
        own_ship = self.connections(OWN_SHIP_TOPIC)
        return self.health.report(self._session.figures(), now, detections, own_ship)

    def _unused_own_ship(self) -> str:
        """Topic of odometry that is published but not used, with one warning; empty if none."""
        if self._session.own_ship.source != "none":
            return ""
        topic = self.resolve_topic_name(OWN_SHIP_TOPIC)
        endpoints = self.get_publishers_info_by_topic(topic)
        if "nav_msgs/msg/Odometry" not in {endpoint.topic_type for endpoint in endpoints}:
            return ""
        self.warn_once(health_unused_own_ship(topic))
        return topic

    def _say(self, reason: str, sentence: str) -> None:
        self.health.dropped(reason, self._clocks.now(), self._session.dropped[reason])
        self.warn(reason, sentence, self._session.dropped[reason])


def main(args: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run_node(TrackInitiator, args, settings_help("track_initiator", __doc__))


if __name__ == "__main__":
    raise SystemExit(main())
