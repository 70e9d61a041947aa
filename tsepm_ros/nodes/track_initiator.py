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

import math
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from nav_msgs.msg import OccupancyGrid, Odometry
from rclpy.qos import DurabilityPolicy
from sensor_msgs.msg import PointCloud2
from std_srvs.srv import Trigger

from msg_adapters.message_input import MessageInput
from tsepm_ros.diagnostics.health import (
    ENTRIES,
    OF_EACH_SENSOR,
    Health,
    health_unused_own_ship,
)
from tsepm_ros.diagnostics.health_figures import Connections, Status, overall
from tsepm_ros.nodes.base_node import (
    BaseNode,
    NodeClocks,
    OptionsByType,
    ParameterError,
    refusing_node_parameter,
    run_node,
)
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
from tsepm_ros.nodes.tf_own_ship import tf_buffer, tf_look_up
from tsepm_ros.own_ship.registration import Mounting
from tsepm_ros.session import learned_text
from tsepm_ros.session.consistency_checks import check_questions
from tsepm_ros.session.drop_reasons import (
    DETECTIONS,
    INTERNAL_ERROR,
    OWN_SHIP,
    drop_reason_of,
    shortened_reason,
)
from tsepm_ros.session.session import Session
from tsepm_ros.session.shared_picture import sensor_sentence, share_picture
from tsepm_ros.settings.node_options import DiagnosticsOptions, InitiatorNodeOptions, SessionOptions
from tsepm_ros.settings.settings import options_by_sensor, settings_from, settings_help
from tsepm_ros.tracker.sensor import SensorModel
from tsepm_ros.whole_files import OwnedFile, file_error_sentence

WAIT_PERIOD, IDLE_PERIOD = 0.05, 3600.0
"""Time between checks of the scans that wait for own-ship data, and while none waits, s."""
OWN_SHIP_TOPIC = "own_ship/odometry"
OWN_SHIP_DEPTH = 1000
TRACKED_DEPTH = 10
TOPICS = (
    *("own_ship/odometry", "tracks", "tracks/current"),
    *("detections/placed", "potential_tracks", "fixed_echoes", "land"),
)
"""Topics beside detections whose full names are published, for programs that show the node."""
COMMON_INPUTS = ("pose", "target", "report", "chart")
COMMON_NOTICES = ("own_ship_frozen", "own_ship_restart", "fixed_frame")
"""What one drop of the inputs of all sensors loses, and notices that are said of one alone."""
MAX_SIZE = 2**24
"""Size of the largest learned file that is read, bytes: of most sensors it is a hundredth."""
SAVING_PERIOD = 60.0
"""Time between writings of that file, s."""


class InitiatorLearnedFile:
    """Reads what was learned at the start, and writes it while the node runs and at its end.

    Of several sensors it has what was learned of all. The file is this node's alone, see
    `OwnedFile`. Ages count on the system's clock: a simulated clock starts again with each run.

    Parameters
    ----------
    session : Session
        Of a sensor of the picture.
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
        self._sessions, self._logger = session.picture.sessions, logger
        self._file: OwnedFile | None = None
        self._max_age, self._first_write = max_age, math.inf
        self._unread = dict[str, str]()  # by sensor
        self._name, self.fault = shortened_reason(f"learned_file {path}"), ""
        if path:
            with self._judging():
                self._read(Path(path))
        self.use()

    def _read(self, path: Path) -> None:
        if any(len(part.encode()) > 200 for part in path.parts):  # temporary names are longer
            raise OSError("a name in its path has more than 200 bytes")
        self._file = OwnedFile(path.expanduser(), learned_text.SIGNATURE, MAX_SIZE)
        if text := self._file.read():
            self._unread = dict.fromkeys(self._sessions, text)

    def use(self, *, last: bool = False) -> None:
        """Use what the file has of each sensor, of the coverage that it has now.

        The rest waits, for the images' coverage is told after the start; unless this is the last
        time.
        """
        for name in [*self._unread]:
            text, session = self._unread.pop(name), self._sessions[name]
            front, settings, state = f"{name}: " if name else "", session.settings, session.state
            try:
                found, age = learned_text.read_learned(
                    learned_text.learned_of(text, name),
                    settings.sensor,
                    settings.session.sensor_frame,
                    time.time(),
                    self._max_age,
                )
            except ValueError as error:
                if isinstance(error, learned_text.OtherCoverageError) and not last:
                    self._unread[name] = text
                else:
                    self._logger.warning(
                        f"{front}{self._name} is not used, and is written anew: {error}"
                    )
            else:
                state.learned = replace(
                    state.learned,
                    clutter_map=found.clutter_map,
                    seen_extent=found.seen_extent,
                    detection_probability=found.detection_probability,
                )
                self._logger.info(
                    f"{front}what was learned {age / 60.0:.0f} min ago is used from {self._name}: "
                    f"clutter density {state.clutter_density:.2g} per m^2, detection probability "
                    f"{state.estimated_detection_probability:.2f}"
                )

    def forget(self) -> None:
        """Remove the file."""
        self._unread.clear()
        if self._file is not None:
            with self._judging():
                self._file.remove()

    def write(self) -> None:
        """Write what was learned, if a scan was processed.

        What waits for its coverage stays in the file for the first `SAVING_PERIOD`.
        """
        now, sessions = time.time(), self._sessions
        if self._file is None or all(one.tracker.stamp is None for one in sessions.values()):
            return
        self._first_write = min(self._first_write, time.monotonic())
        self.use(last=time.monotonic() - self._first_write > SAVING_PERIOD)
        with self._judging():
            texts = {
                name: learned_text.learned_of(self._unread[name], name)
                if name in self._unread
                else learned_text.write_learned(
                    one.state.learned, one.state.model, one.settings.session.sensor_frame, now
                )
                for name, one in sessions.items()
            }
            self._file.write(learned_text.joined_learned(texts, now))

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


class SensorInput(NamedTuple):
    """A sensor of the node, and its messages.

    Attributes
    ----------
    messages : MessageInput
    health : Health
        Of its input; of a single sensor that of the node.
    subscription : DetectionsSubscription
    """

    messages: MessageInput
    health: Health
    subscription: DetectionsSubscription


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
            self._validate_settings,
            **node_options,
        )
        options: InitiatorNodeOptions = self.options[InitiatorNodeOptions]
        self._clocks = NodeClocks(self)
        self._ask(self.options)
        each = options_by_sensor(self.options)
        sessions = {
            name: Session(settings_from(own), partial(self._say, name), live=True)
            for name, own in each.items()
        }
        self._session, self._ends = next(iter(sessions.values())), 0
        if options.sensors:
            with refusing_node_parameter():
                share_picture(sessions)
        self._picture = self._session.picture
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
        self.health: Health = Health(self.options[DiagnosticsOptions])
        self._sensors = dict[str, SensorInput]()
        self._input = MessageInput(self._session, options, self.warn_once)
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
        self._subscribe_detections(each)
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

    def _subscribe_detections(self, options: Mapping[str, OptionsByType]) -> None:
        """Subscribe to the detections of each sensor."""
        topics = dict[str, str]()
        for name, own in options.items():
            topic, given = _detections_topic(name), own[InitiatorNodeOptions]
            other = topics.setdefault(self.resolve_topic_name(topic), name)
            if other != name:
                raise ParameterError(
                    f"sensors: {_detections_topic(other)} and {topic} are one topic, "
                    f"{self.resolve_topic_name(topic)}; remap each to a topic of its own"
                )
            say = partial(self._say_once, name)
            health = Health(own[DiagnosticsOptions], f"{name} scan") if name else self.health
            subscription = DetectionsSubscription(
                self,
                given.detections_type,
                given.detections_reliability,
                given.detections_depth,
                partial(self._hear_detections, name),
                self._qos,
                topic=topic,
            )
            messages = MessageInput(self._picture.sessions[name], given, say)
            self._sensors[name] = SensorInput(messages, health, subscription)

    def _say_once(self, sensor: str, sentence: str) -> None:
        self.warn_once(f"{sensor}: {sentence}" if sensor else sentence)

    def _hear_detections(self, sensor: str, message: Any, information: Any) -> None:
        """Take a message from the middleware: under overload the newest, and the others count."""
        session = self._picture.sessions[sensor]
        message, information, skipped = newest_at_pace(
            message,
            information,
            session.state.interval,
            self._sensors[sensor].subscription.take_waiting,
        )
        if skipped:
            session.drop(
                "overload",
                f"{len(skipped)} messages of detections waited too long and were skipped; the "
                "newest is processed",
                len(skipped),
            )
        self.take_detections(message, pace_seconds_in_queue(information), sensor)

    def take_detections(self, message: Any, waited: float = 0.0, sensor: str = "") -> None:
        """Take a message of detections of any supported type that waited for a time, s."""
        entered = time.perf_counter() - waited
        now, session = self._clocks.now(), self._picture.sessions[sensor]
        before, deliveries, healths = session.arrivals, session.deliveries, self._healths(sensor)
        for health in healths:
            health.heard(DETECTIONS, now)
        self._sensors[sensor].messages.take_detections(message, now)
        if session.deliveries is not deliveries:  # the messages before were no scans
            for health in healths:
                health.forget_arrivals()
                health.scans.clear()
        if session.arrived_stamp is not None and session.arrivals > before:
            for health in healths:
                health.arrived(session.arrived_stamp, now)
        self._process(entered)

    def _healths(self, sensor: str) -> tuple[Health, ...]:
        """The health of the node, and of several sensors that of one."""
        return (self.health, self._sensors[sensor].health) if sensor else (self.health,)

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
            buffer = tf_buffer(self) if self._session.fixed_frame else None
            for session in self._picture.sessions.values():
                session.own_ship.look_up = tf_look_up(self, session, buffer)
        else:
            self._own_ship = OfferedSubscription(
                self, Odometry, OWN_SHIP_TOPIC, OWN_SHIP_DEPTH, self._take_own_ship, self._qos
            )
            for session in self._picture.sessions.values():
                session.own_ship.read_unread = self._read_own_ship
        self._waiting = self.steady_timer(WAIT_PERIOD, lambda: self._process(time.perf_counter()))

    def _process(self, entered: float) -> None:
        """Process the scans that need not wait; `entered` is the callback's `perf_counter`."""
        now, is_first = self._clocks.now(), self._picture.tracker.stamp is None
        for name, session in self._picture.sessions.items() if is_first else ():
            its, topic = session.deliveries, _detections_topic(name)
            if its.expected == -math.inf and self.get_publishers_info_by_topic(topic):
                its.expected = now
        for processed in self._picture.process(now):
            self._publish_ends()
            result, sensor = processed.in_frame(), processed.scan.sensor
            try:
                latency = self._outputs.publish(result, entered)
            except Exception as error:  # such as a stamp beyond the range of a message
                session = self._picture.sessions[sensor]
                session.drop(INTERNAL_ERROR, f"a scan was not published: {error!r}")
            else:
                for health in self._healths(sensor):
                    health.processed(result.statistics.detections, latency, self._clocks.now())
            self._announced.announce(result, self._session.tracker.reason)
        self._publish_ends()
        # The timer stays: one that is cancelled meanwhile ends an executor of several threads.
        waits = any(session.unfinished for session in self._picture.sessions.values())
        period = round(1e9 * (WAIT_PERIOD if waits else IDLE_PERIOD))
        if period != self._waiting.timer_period_ns:
            self._waiting.timer_period_ns = period
            self._waiting.reset()

    def _publish_ends(self) -> None:
        """Publish that there are no tracks, where all were ended since the last results."""
        if self._ends != self._picture.ends_of_all:
            self._ends = self._picture.ends_of_all
            self._outputs.clear(self.get_clock().now().nanoseconds)

    def _on_reset(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        for session in self._picture.sessions.values():
            session.reset()
        for health in (self.health, *(sensor.health for sensor in self._sensors.values())):
            health.reset()
        self._qos.heard.clear()
        self._publish_ends()
        self._learned.forget()
        return Trigger.Response(
            success=True, message="scans, tracks, counts and what was learned were cleared"
        )

    def _on_end_tracks(self, request: Trigger.Request, _: Trigger.Response) -> Trigger.Response:
        for session in self._picture.sessions.values():
            session.end_tracks()
        self._publish_ends()
        return Trigger.Response(success=True, message="tracks and starts were ended")

    def _validate_settings(self, parameters: OptionsByType) -> None:
        for name, own in options_by_sensor(parameters).items():
            self._picture.sessions[name].validate(settings_from(own))

    def _configure(self, parameters: OptionsByType) -> None:
        kept = True
        for name, own in options_by_sensor(parameters).items():
            kept &= self._picture.sessions[name].configure(settings_from(own))
            self._sensors[name].messages.options = own[InitiatorNodeOptions]
            self._sensors[name].health.options = own[DiagnosticsOptions]
        self.health.options = parameters[DiagnosticsOptions]
        if not kept:
            self.get_logger().info("parameters changed: potential tracks start over")
        self._learned.use()
        self._ask(parameters)
        options: InitiatorNodeOptions = parameters[InitiatorNodeOptions]
        self._outputs.show_potential_tracks(options.publish_potential_tracks)
        self._report_every(options.diagnostics_period)

    def _report_every(self, period: float) -> None:
        """Publish the health so often, s."""
        for health in (self.health, *(sensor.health for sensor in self._sensors.values())):
            health.period = period
        self.report_timer.timer_period_ns = int(period * 1e9)
        self.report_timer.reset()

    def _ask(self, parameters: OptionsByType) -> None:
        """Log questions about parameters that look like degrees, each once."""
        for name, own in options_by_sensor(parameters).items():
            for question in check_questions(own[SensorModel], own[Mounting]):
                self.warn_once(sensor_sentence(name, question))

    def statuses(self) -> list[Status]:
        """What is published on /diagnostics."""
        now, detections = self._clocks.now(), [_detections_topic(name) for name in self._sensors]
        of_picture: dict[str, Any] = {
            "file_fault": self._learned.fault,
            "topics": {name: self.resolve_topic_name(name) for name in (*detections, *TOPICS)},
            "mismatches_heard": dict(self._qos.heard),
            "mismatches": self._qos.standing(),
            "unused_own_ship": self._unused_own_ship(),
        }
        own_ship = self.connections(OWN_SHIP_TOPIC)
        if not self._session.sensor:
            heard = self._detections_connections("", **of_picture)
            return self.health.report(self._session.figures(), now, heard, own_ship)
        statuses = self.health.judge(
            self._picture.figures(),
            now,
            Connections(**of_picture),
            own_ship,
            [task for task in ENTRIES if task not in OF_EACH_SENSOR],
            every=1.0 / float(self._picture.rates.sum()),
            values={"sensors": " ".join(self._sensors), "latencies": self._picture.latencies},
        )
        for reason, sentence in self._picture.alignment_news():
            self.warn(reason, sentence)
        for name, sensor in self._sensors.items():
            snapshot, values = self._picture.figures_of(name, now)
            statuses += sensor.health.judge(
                snapshot,
                now,
                self._detections_connections(name),
                tasks=OF_EACH_SENSOR,
                sensor=name,
                values=values,
            )
        return [overall(statuses), *statuses]

    def _detections_connections(self, sensor: str, **others: Any) -> Connections:
        types, fault = self._sensors[sensor].subscription.types, self._clocks.fault
        return self.connections(_detections_topic(sensor), clock_fault=fault, **types, **others)

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

    def _say(self, sensor: str, reason: str, sentence: str) -> None:
        session, now = self._picture.sessions[sensor], self._clocks.now()
        row = drop_reason_of(reason)
        is_common = reason in COMMON_NOTICES or row.lost in COMMON_INPUTS
        if is_common and session is not self._session:
            return  # each sensor takes the same poses
        for health in self._healths(sensor):
            health.dropped(reason, now, session.dropped[reason])
        named, source = sensor_sentence(sensor, sentence), "" if is_common else sensor
        if row.task == DETECTIONS and row.lost != "detection":
            named += self.connections(_detections_topic(sensor)).of_several
        self.warn(reason, named, session.dropped[reason], source)


def _detections_topic(sensor: str) -> str:
    return f"{sensor}/{DETECTIONS}" if sensor else DETECTIONS


def main(args: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run_node(TrackInitiator, args, settings_help("track_initiator", __doc__))


if __name__ == "__main__":
    raise SystemExit(main())
