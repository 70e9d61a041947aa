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
"""The node that holds the alarms of the boat, and shows the live topics on a page in a browser.

The alarms need no page. They, their limits and the counts of the gates are kept in a file, a JSON
object: ``given``, the limits as the node was started, ``limits``, ``gates`` (lines and counts), and
what `AlarmSupervisor.kept` returns. A limit of the file counts unless the node is started with
another one than the time before.
"""

from __future__ import annotations

import json
import os
import re
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import OccupancyGrid, Odometry
from rclpy.exceptions import InvalidTopicNameException
from rclpy.expand_topic_name import expand_topic_name
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import deserialize_message
from rclpy.validate_full_topic_name import validate_full_topic_name
from sensor_msgs.msg import PointCloud2
from std_srvs.srv import Trigger

from msg_adapters import MessageError, diagnostics, ns_to_seconds, time_to_ns
from tsepm_ros.diagnostics.health_figures import Level, Status
from tsepm_ros.diagnostics.input_health import TRACKS as HEALTH_OF_TRACKS
from tsepm_ros.nodes.base_node import OVERRIDABLE, BaseNode, refusing_node_parameter, run_node
from tsepm_ros.nodes.subscriptions import OfferedSubscription, SubscriptionQos
from tsepm_ros.parameters import parameter_table
from tsepm_ros.session.drop_reasons import OWN_SHIP as OWN_SHIP_TASK
from tsepm_ros.session.drop_reasons import shortened_reason
from tsepm_ros.settings.node_options import AlarmOptions, ViewerNodeOptions, gate_lines
from tsepm_ros.settings.settings import settings_help
from tsepm_ros.tools.live_commands import DIAGNOSTICS, NEWEST, SOME
from tsepm_ros.tools.viewer.alarms import MAX_AGE, AlarmState, AlarmSupervisor, ObservedScan
from tsepm_ros.tools.viewer.gates import HEAD, GateCounter
from tsepm_ros.tools.viewer.live_frames import (
    CLOUDS,
    FIXED,
    OWN_SHIP,
    TRACKS,
    TRACKS_WAIT,
    LiveFrames,
)
from tsepm_ros.tools.viewer.page_content import (
    Frame,
    encode_page_content,
    land_frame,
    page_geographic_terms,
    page_health_of_message,
    page_image_frame,
    page_topics_of_message,
)
from tsepm_ros.tools.viewer.page_state import PageState
from tsepm_ros.tracker.scan import MAX_MAGNITUDE
from tsepm_ros.whole_files import OwnedFile, file_error_sentence, read_json

IMAGE, LAND, ALARMS = "image/plan", "land", "alarms"
CLOUD_DEPTH = 10
PAUSE = 0.008
"""Time for the messages of a scan to arrive, s."""
GATHERING_TIME = 0.015
"""The same in the server's thread, before the scan is drawn, s."""
MAX_WAITING = 500
"""Messages that wait for the server's thread."""
IMAGE_TIME, MAX_IMAGE = 3.0, 1 << 16
"""Time for which images are received after a browser asked for one, s; and their most bytes."""
CHECK_PERIOD = 1.0
"""Time between checks whether anything publishes confirmed tracks, and of the alarms, s."""
SIGNATURE = re.compile(rb'\{"format": "alarms of tsepm_ros 1"')
MAX_FILE = 1 << 22
"""Of the file of the alarms; its size is in bytes."""
MAX_CROSSINGS = 100_000
CALM = AlarmState.ACKNOWLEDGED, AlarmState.RECTIFIED
"""States of alarms that are warnings on the topic; the others are errors."""
NEWEST_HELD = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class TrackViewer(BaseNode):
    """Subscribes to what the track initiator publishes, and serves a page of it.

    Messages are read in the server's thread: the node's only takes them.

    Topics without a remapping of its own are those that the track initiator states on
    ``/diagnostics``: of the node that publishes the viewer's tracks; if none does, of the only node
    in the viewer's namespace, or in any namespace for a viewer without one.
    """

    def __init__(self, **node_options: Any) -> None:
        super().__init__(
            "track_viewer",
            lambda changed: self._set_limits(changed[AlarmOptions]),
            **node_options,
        )
        options: ViewerNodeOptions = self.options[ViewerNodeOptions]
        given = self.options[AlarmOptions]
        self._alarms, self._gates = AlarmSupervisor(given, time.time), GateCounter([])
        self._crossings, self._told = deque[str](maxlen=MAX_CROSSINGS), ""
        self._news = ""
        self._gathered = 0.0  # when the last pause ended
        self._waiting: deque[tuple[str, Any]] = deque(maxlen=MAX_WAITING)
        self._scheduled = False
        self._odometry: bytes | None = None
        self._frames = LiveFrames(self._refuse, is_north=bool(options.origin))
        self._given = {name: self.resolve_topic_name(name) for name in (*CLOUDS, OWN_SHIP, LAND)}
        own = self.get_name(), self.get_namespace()
        self._remapped = {
            name for name, topic in self._given.items() if topic != expand_topic_name(name, *own)
        }
        self._topics = self._given
        self._stated: dict[str, dict[str, str]] = {}  # topics by node
        self._shown, self._image = "", None  # type: tuple[str, Any]
        self._age = 0.0  # of the tracks, until the first frame is made, s
        self._asked: deque[Mapping[str, Any]] = deque(maxlen=MAX_WAITING)
        self._asking = self.create_guard_condition(self._set_alarm)
        self._qos = SubscriptionQos(self)
        self._subscribe_topics()
        self.create_subscription(DiagnosticArray, DIAGNOSTICS, self._hear, SOME)
        # A node without a timer might never notice that the context was shut down by a signal.
        self.steady_timer(CHECK_PERIOD, self._check_publisher)
        self._told_alarms = self.create_publisher(
            DiagnosticArray, ALARMS, NEWEST_HELD, qos_overriding_options=OVERRIDABLE
        )
        for name, act in (
            ("~/acknowledge", self._alarms.acknowledge),
            ("~/silence", lambda: self._alarms.silence(time.monotonic())),
        ):
            self.create_service(Trigger, name, partial(self._serve, act))
        self.refuse_unused_overrides()
        topic = self._given[TRACKS]
        info = {"kind": "live", "title": f"Tracks on {topic}", "topic": topic}
        with refusing_node_parameter():
            from tsepm_ros.tools.viewer.page_server import PageServer

            info |= page_geographic_terms(options.origin)
            self._state = PageState(info, options.kept_scans)
            self._state.asked = self._ask
            self._state.crossings = lambda: "\n".join([HEAD, *self._crossings, ""])
            self._server = PageServer(options, info["title"], self._state)
        self._server.loop.set_exception_handler(  # no executor sees those of the server's thread
            lambda _, context: self.fail(
                context.get("exception") or RuntimeError(context["message"])
            )
        )
        self._set_limits(given)
        self._fault = self._read_kept(options.alarms_file, _alarm_values(given))
        self._alarms.judge("limits", bool(self._fault), self._fault, time.monotonic())
        self._server.start()  # the last: nobody would end it
        self._server.call_later(0.0, self._tick)
        self.get_logger().info(f"open {self.url}")

    @property
    def url(self) -> str:
        """Address of the page."""
        return self._server.url

    def _subscribe_topics(self) -> None:
        self.watch(HEALTH_OF_TRACKS, "track message", self._topics[TRACKS])
        self._clouds = [
            OfferedSubscription(
                self,
                PointCloud2,
                self._topics[name],
                CLOUD_DEPTH,
                partial(self._take_held if name == TRACKS else self._take, name),
                self._qos,
                durability=DurabilityPolicy.TRANSIENT_LOCAL
                if name in (TRACKS, FIXED)
                else DurabilityPolicy.VOLATILE,
            )
            for name in CLOUDS
        ]
        self._land = OfferedSubscription(
            self,
            OccupancyGrid,
            self._topics[LAND],
            1,
            partial(self._take, LAND),
            self._qos,
            durability=DurabilityPolicy.TRANSIENT_LOCAL,
        )
        # Odometry may come much more often than scans: only the newest before a scan is read.
        self._own_ship = self.create_subscription(
            Odometry, self._topics[OWN_SHIP], partial(self._take, OWN_SHIP), NEWEST, raw=True
        )

    def destroy_node(self) -> None:
        """Destroy the node and end the server."""
        self._server.stop()
        if self._file is not None:
            self._keep()
            self._file.hold(None)
        super().destroy_node()

    def _check_publisher(self) -> None:
        nodes = self._candidates()
        if len(nodes) == 1:
            [self._shown] = nodes
        elif nodes and self._shown not in nodes:
            self.warn(
                "nodes",
                f"several nodes publish tracks: {', '.join(nodes)}; --ros-args -r __ns:=NAMESPACE "
                "or -r tracks/current:=TOPIC chooses",
            )
        asked = time.monotonic() - self._state.image_asked < IMAGE_TIME
        if asked and self._image is None:
            self._image = self.create_subscription(OccupancyGrid, IMAGE, self._take_image, NEWEST)
        elif self._image is not None and not asked:
            self.destroy_subscription(self._image)
            self._image = None
        self._follow(self._stated.get(self._shown, {}))
        self._state.put_info(published=self.count_publishers(self._topics[TRACKS]) > 0)

    def _candidates(self) -> list[str]:
        """Nodes whose topics may be those to be shown."""
        topic = self._given[TRACKS]
        by_node = {
            node: topics[TRACKS]
            for node, topics in self._stated.items()
            if self.count_publishers(topics[TRACKS])
        }
        nodes = [node for node, stated in by_node.items() if stated == topic]
        if nodes or TRACKS in self._remapped or self.count_publishers(topic):
            return nodes
        namespace = self.get_namespace().rstrip("/")
        near = [node for node in by_node if node.rpartition("/")[0] == namespace]
        return near or ([] if namespace else list(by_node))

    def _follow(self, stated: Mapping[str, str]) -> None:
        """Subscribe to the topics that the shown node states, where they are others."""
        topics = {
            name: given if name in self._remapped else stated.get(name, given)
            for name, given in self._given.items()
        }
        if topics == self._topics:
            return
        self._topics = topics
        for subscription in (*self._clouds, self._land):
            subscription.end()
        self.destroy_subscription(self._own_ship)
        self._subscribe_topics()
        self._state.put_info(title=f"Tracks on {topics[TRACKS]}", topic=topics[TRACKS])
        self.get_logger().info(f"shows {self._shown}, with tracks on {topics[TRACKS]}")

    def _hear(self, message: DiagnosticArray) -> None:
        """Take a message of diagnostics, unless it is of another node than the one shown."""
        stated = page_topics_of_message(message)
        for node, topics in stated.items():
            with suppress(KeyError, InvalidTopicNameException):
                all(map(validate_full_topic_name, (topics[TRACKS], *topics.values())))
                self._stated[node] = topics
        if not stated or self._shown in ("", *stated):
            self._take(DIAGNOSTICS, message)

    def _ask(self, content: Mapping[str, Any]) -> None:
        """Take what a browser asks for, in the server's thread.

        ``{"alarm": {NAME: VALUE}}`` sets limits, ``{"acknowledge": {KEY: COUNT}}`` acknowledges
        alarms as a page shows them, ``{"silence": true}`` takes the sound off all.
        """
        if limits := content.get("alarm"):
            self._asked.append(
                {
                    key: value if isinstance(value, bool | str) else float(value)
                    for key, value in limits.items()
                }
            )
            self._asking.trigger()
        if counts := content.get("acknowledge"):
            self._alarms.acknowledge({str(key): float(count) for key, count in counts.items()})
        if content.get("silence"):
            self._alarms.silence(time.monotonic())
        self._tell()

    def _serve(
        self, act: Callable[[], None], _: Trigger.Request, response: Trigger.Response
    ) -> Trigger.Response:
        """Acknowledge or silence all alarms, for a service; in the server's thread."""
        response.success, response.message = True, f"of {len(self._alarms.alarms)} alarms"
        for step in (act, self._tell):
            self._server.call_later(0.0, step)
        return response

    def _set_limits(self, limits: AlarmOptions) -> None:
        """Take the limits; gates that stay have their counts."""
        counts = dict(zip(self._gates.lines, self._gates.counts, strict=True))
        gates = GateCounter(gate_lines(limits.gates), counts)
        if gates.lines != self._gates.lines:
            self._gates = gates
        self._alarms.options = limits
        self._state.put_info(alarm=_alarm_values(limits))

    def _read_kept(self, name: str, given: dict[str, Any]) -> str:
        """Take what an earlier node of this name has kept; returns why that cannot be, if so."""
        file = f"tsepm_alarms{self.get_fully_qualified_name().replace('/', '_')}.json"
        self._start, self._file = given, None
        try:
            folder = Path(os.environ.get("ROS_HOME") or "~/.ros").expanduser()
            path = folder / file if name == "auto" else Path(name).expanduser()
            if name:
                self._file = OwnedFile(path, SIGNATURE, MAX_FILE)
            if self._file is None or not (text := self._file.read()):
                return ""
            kept = read_json(text)
            limits = [
                Parameter(f"alarm.{key}", value=kept["limits"][key])
                for key, value in given.items()
                if kept["given"].get(key, value) == value and key in kept["limits"]
            ]
            result = self.set_parameters_atomically(limits)
            if not result.successful:
                return f"set them again; {path}: {result.reason}"
            self._gates = GateCounter(
                self._gates.lines, {tuple(line): count for line, count in kept["gates"]}
            )
            self._alarms.restore(kept, time.monotonic())
        except (OSError, ValueError, KeyError, TypeError, AttributeError, RuntimeError) as error:
            said = file if name == "auto" else name
            return f"set them again; {said} cannot be used: {file_error_sentence(error)}"
        return ""

    def _keep(self) -> None:
        """Write the file of the alarms."""
        gates = self._gates  # another thread may change them
        content = {
            "format": "alarms of tsepm_ros 1",
            "given": self._start,
            "limits": _alarm_values(self.options[AlarmOptions]),
            "gates": list(zip(gates.lines, gates.counts, strict=True)),
            **self._alarms.kept(),
        }
        told = json.dumps(content)
        if self._file is None or told == self._told:
            return
        self._told = told
        try:
            self._file.write(told)
            self._fault = ""
        except OSError as error:
            self._fault = f"they are not kept: {file_error_sentence(error)}"

    def _tick(self) -> None:
        """Take that time passes, with or without data; in the server's thread."""
        self._server.call_later(CHECK_PERIOD, self._tick)
        now = time.monotonic()
        self._alarms.tick(now)
        self._alarms.judge("limits", bool(self._fault), self._fault, now)
        self._keep()
        self._tell()

    def _tell(self, only_news: bool = False) -> None:
        """Say the alarms to the pages and on the topic; `only_news`: if a state has changed."""
        now, gates = time.monotonic(), self._gates
        alarms = self._alarms.listed(now)
        states = [(one["key"], one["state"], one["count"]) for one in alarms], gates.counts
        if only_news and self._news == repr(states):
            return
        self._news = repr(states)
        watched = self._alarms.watched() or "data alone"
        self._state.put_part(
            "alarms",
            {
                "alarms": alarms,
                "watched": watched,
                "patience": self._alarms.patience,
                "run": self._alarms.run,
                "gates": list(zip(gates.lines, gates.counts, strict=True)),
            },
        )
        statuses = [Status("alarms", Level.OK, f"watched: {watched}", {"alarms": len(alarms)})]
        statuses += [
            Status(
                alarm["key"],
                Level.WARN if alarm["state"] in CALM else Level.ERROR,
                f"{alarm['title']}: {alarm['sentence']}",
                {name: alarm[name] for name in ("state", "onset", "time", "count")},
            )
            for alarm in alarms
        ]
        self._told_alarms.publish(
            diagnostics(time.time_ns(), self.get_fully_qualified_name(), statuses)
        )

    def _set_alarm(self) -> None:
        """Set the parameters of the alarms as the browsers asked; a refusal is said in the log."""
        while self._asked:
            asked = self._asked.popleft()
            known = asked.keys() & {row.name for row in parameter_table(AlarmOptions)}
            result = self.set_parameters_atomically(
                [Parameter(f"alarm.{name}", value=asked[name]) for name in known]
            )
            if not result.successful:
                self.warn("alarm", f"a browser asked for alarms that are refused: {result.reason}")
            self._state.put_info(refused=result.reason)

    def _take_held(self, topic: str, message: Any, information: Mapping[str, int]) -> None:
        """Take confirmed tracks, which may have been published long ago."""
        now = time.monotonic()
        self.health.heard(HEALTH_OF_TRACKS, now, now)
        self._age = max(1e-9 * (time.time_ns() - information["source_timestamp"]), 0.0)
        self._take(topic, message)

    def _take(self, topic: str, message: Any) -> None:
        """Take a message, and wait for the other messages of a scan.

        The executor then wakes up once for all.
        """
        if topic == OWN_SHIP:
            self._odometry = message  # waits for the next scan
        else:
            self._waiting.append((topic, message))
            if not self._scheduled:
                self._scheduled = True
                self._server.call_later(GATHERING_TIME, self._show)
        if time.monotonic() - self._gathered > 2.0 * PAUSE:
            time.sleep(PAUSE)
            self._gathered = time.monotonic()

    def _take_image(self, grid: OccupancyGrid) -> None:
        """Take a sonar image in the plane of the sensor."""
        info, cells = grid.info, len(grid.data)
        is_plan = info.width == info.height and info.width * info.height == cells <= MAX_IMAGE
        try:
            stamp = ns_to_seconds(time_to_ns(grid.header.stamp))
            if not (is_plan and 0.0 < info.resolution <= MAX_MAGNITUDE["range"]):
                raise MessageError(
                    "bad_geometry",
                    f"it must have equal sides and at most {MAX_IMAGE} cells of a positive "
                    f"resolution; got {info.width} x {info.height}, {cells} cells, "
                    f"{info.resolution} m",
                )
        except MessageError as error:
            self._refuse(IMAGE, error)
        else:
            self._state.image = encode_page_content(
                page_image_frame(stamp, info.resolution, bytes(grid.data))
            )

    def _show(self) -> None:
        """Read what has arrived, in the server's thread."""
        self._scheduled = False
        while self._waiting:
            topic, message = self._waiting.popleft()
            try:
                if topic == DIAGNOSTICS:
                    self._take_health(message)
                elif topic == LAND:
                    self._state.put_part("land", land_frame(message))
                else:
                    self._frames.take(topic, message)
            except MessageError as error:
                self._refuse(topic, error)
        odometry, self._odometry = self._odometry, None
        if odometry is not None:
            try:
                self._frames.take_own_ship(deserialize_message(odometry, Odometry))
            except RuntimeError as error:
                self._refuse(OWN_SHIP, error)
        for found in self._frames.take_frames():
            self._take_frame(*found)
        if self._frames.waits:
            self._server.call_later(TRACKS_WAIT, self._show)

    def _take_frame(
        self, frame: Frame, facts: Mapping[str, Frame], observed: ObservedScan | None
    ) -> None:
        """Take a scan for the pages and the alarms."""
        # Only the first tracks may have been published before the viewer heard.
        late = self._age if frame["number"] == 1 else 0.0
        age = 1e-9 * self.get_clock().now().nanoseconds - late - frame["stamp"]
        if abs(age) > MAX_AGE:
            self.warn_once("stamps are of another time: set use_sim_time for a replay")
        frame["age"] = round(1e3 * max(age, 0.0)) * (abs(age) <= MAX_AGE)
        self._state.put(frame, facts, late)
        if observed is not None:
            self._alarms.observe(observed, time.monotonic() - late, age)
            self._crossings += self._gates.observe(*observed[:2], frame["frame_id"])
            self._tell(only_news=True)

    def _take_health(self, message: DiagnosticArray) -> None:
        """Take the health of the nodes in the namespace of the track initiator shown.

        Also in those of its sensors, where it has several: each has a detector in its own.
        """
        namespace = self._shown.rpartition("/")[0]
        places = {namespace} | {
            f"{namespace}/{name.removesuffix('/detections')}"
            for name in self._stated.get(self._shown, {})
            if name.endswith("/detections")
        }
        health = {
            node: found
            for node, found in page_health_of_message(message).items()
            if not self._shown or node.rpartition("/")[0] in places
        }
        if health:
            self._state.put_health(health)
        empty = list[str]()
        for entry in (entry for found in health.values() for entry in found["entries"]):
            values, sensor = dict(entry["values"]), entry["task"].rpartition("/")[0]
            if entry["task"] == OWN_SHIP_TASK:
                self._frames.source = values.get("source", self._frames.source)
            if "scan_interval_s" in values:  # of the track initiator's detections
                words = values.get("no_detections", "")
                empty.append(f"{sensor}: {words}" if sensor and words else words)
        if empty:
            words = "; ".join(filter(None, empty))
            self._alarms.judge("detections", bool(words), words, time.monotonic())

    def _refuse(self, topic: str, error: Exception) -> None:
        """Count a message that cannot be read, and say why."""
        self.drop(topic, shortened_reason(f"a message on {topic} cannot be shown: {error}"))


def _alarm_values(options: AlarmOptions) -> dict[str, Any]:
    """The limits of the alarms, for the page."""
    return {row.name: getattr(options, row.name) for row in parameter_table(AlarmOptions)}


def main(args: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run_node(TrackViewer, args, settings_help("track_viewer", __doc__))
