"""The nodes of `tsepm health` and `tsepm record`: health in one shot, and bags of live topics."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import serialize_message
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future

from tsepm_ros.diagnostics.health_figures import OVERALL, Level
from tsepm_ros.ending_signals import ending_at_once

if TYPE_CHECKING:
    from tsepm_ros.nodes.subscriptions import OfferedSubscription

MIN_TIME = 2.0
"""Time in which running nodes are discovered, and detectors report, s."""
POLL_PERIOD = 0.1
"""Time between looks at the graph, s."""
DEPTH = 1000
DIAGNOSTICS = "/diagnostics"
SOME = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
"""Best effort is compatible with every publisher."""


class HealthReader(Node):
    """Reads one message of ``/diagnostics`` of each initiator and detector, or of one node.

    Parameters
    ----------
    name : str
        Full name of a node; all of them if empty.
    timeout : float
        Longest time for all messages, s.

    Attributes
    ----------
    entries : list of (Level, str)
        Level and sentence of each entry; a node that runs and states nothing is stale.
    """

    def __init__(self, name: str, timeout: float) -> None:
        super().__init__(  # without services, which nobody calls: they take half of the imports
            "tsepm_health",
            start_parameter_services=False,
            enable_rosout=False,
            parameter_overrides=[Parameter("start_type_description_service", value=False)],
        )
        self.finished = Future()
        self._name = name and f"/{name.lstrip('/')}"
        self._timeout = timeout
        self._begin = time.monotonic()
        self._heard: dict[str, Sequence[Any]] = {}
        self._silent: set[str] = set()
        self.create_subscription(DiagnosticArray, DIAGNOSTICS, self._hear, SOME)
        self.create_timer(POLL_PERIOD, self._look, clock=Clock(clock_type=ClockType.STEADY_TIME))

    @property
    def entries(self) -> list[tuple[Level, str]]:
        """Level and sentence of each entry, by node."""
        found = [
            (Level(status.level[0]), f"{status.name}: {status.message}")
            for _, statuses in sorted(self._heard.items())
            for status in statuses
        ]
        silence = f"no message on {DIAGNOSTICS} within {self._timeout:g} s"
        return found + [(Level.STALE, f"{name}: {silence}") for name in sorted(self._silent)]

    def _hear(self, message: DiagnosticArray) -> None:
        for status in message.status[:1]:  # nodes of this package begin with this entry
            if status.name == f"{status.hardware_id}: {OVERALL}":
                self._heard[status.hardware_id] = message.status

    def _look(self) -> None:
        services = {name for name, _ in self.get_service_names_and_types()}
        nodes = {
            f"{end.node_namespace.rstrip('/')}/{end.node_name}"
            for end in self.get_publishers_info_by_topic(DIAGNOSTICS)
        }
        running = {name for name in nodes if f"{name}/reset" in services}
        if self._name:
            running = {self._name}
            self._heard = {name: self._heard[name] for name in running & self._heard.keys()}
        self._silent = running - self._heard.keys()
        elapsed = time.monotonic() - self._begin
        complete = self._heard and not self._silent and (self._name or elapsed > MIN_TIME)
        if (complete or elapsed > self._timeout) and not self.finished.done():
            self.finished.set_result(None)


def read_health(name: str, timeout: float, arguments: Sequence[str]) -> list[tuple[Level, str]]:
    """Level and sentence of each entry of the running nodes, or of one node.

    Parameters
    ----------
    name : str
        Full name of a node; all of them if empty.
    timeout : float
        Longest time, s.
    arguments : sequence of str
        Of ROS.

    Raises
    ------
    ValueError
        If ROS refuses an argument.
    """
    try:  # signals stay exceptions of the command: it is called by scripts, often, and has no state
        rclpy.init(args=["--ros-args", *arguments], signal_handler_options=SignalHandlerOptions.NO)
        node = HealthReader(name, timeout)
    except RuntimeError as error:
        raise ValueError(str(error)) from None
    try:
        rclpy.spin_until_future_complete(node, node.finished)
    finally:
        rclpy.try_shutdown()
    return node.entries


class TopicRecorder(Node):
    """Writes a bag of topics, each from the time on at which it is published.

    Parameters
    ----------
    path : Path
        Folder of the bag, which must not exist.
    topics : sequence of str

    Raises
    ------
    ParameterError
        If the bag cannot be written.

    Attributes
    ----------
    counts : Counter
        Messages in the bag by topic.
    missed : dict of str to int
        Messages that a topic's first publisher had sent before, and that it keeps for nobody.
    """

    def __init__(self, path: Path, topics: Sequence[str]) -> None:
        from tsepm_ros.nodes.base_node import refusing
        from tsepm_ros.nodes.subscriptions import QosWatch
        from tsepm_ros.tools.replay.bag import BagWriter

        super().__init__("tsepm_record")
        self.missed: dict[str, int] = {}
        self.counts = Counter({self.resolve_topic_name(topic): 0 for topic in topics})
        with refusing():
            self._bag = BagWriter(path)
        self._qos = QosWatch(self)
        self._waiting = set(self.counts)
        self._subscriptions_made: list[OfferedSubscription] = []
        self.create_timer(POLL_PERIOD, self._look, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def destroy_node(self) -> None:
        """Destroy the node and close the bag."""
        super().destroy_node()
        self._bag.close()

    def _look(self) -> None:
        for topic in sorted(self._waiting):
            publishers = self.get_publishers_info_by_topic(topic)
            if publishers:
                self._waiting.remove(topic)
                try:
                    self._record(topic, publishers)
                except (ValueError, ImportError, AttributeError) as error:
                    self.get_logger().error(f"{topic} is not recorded: {error}")

    def _record(self, topic: str, publishers: Sequence[Any]) -> None:
        from msg_adapters.detections import installed_class
        from tsepm_ros.nodes.subscriptions import OfferedSubscription

        kind = publishers[0].topic_type
        message_type = installed_class(kind)
        self._bag.add(topic, kind)
        latched = all(
            end.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL for end in publishers
        )
        durability = DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE
        take = partial(self._take, topic)
        self._subscriptions_made.append(
            OfferedSubscription(
                self, message_type, topic, DEPTH, take, self._qos, durability=durability
            )
        )
        self.get_logger().info(f"records {topic} ({kind})")

    def _take(self, topic: str, message: Any, info: Mapping[str, Any]) -> None:
        self._bag.write(topic, time.time_ns(), serialize_message(message))
        self.counts[topic] += 1
        number = info["publication_sequence_number"] or 1
        if self.missed.setdefault(topic, number - 1) and self.counts[topic] == 1:
            self.get_logger().warning(f"{topic}: {_without(number - 1)}")


def _without(number: int) -> str:
    return (
        f"{number} messages were sent before the recording and are not in the bag: start the "
        "recording before the driver"
    )


def record(path: Path, topics: Sequence[str], arguments: Sequence[str]) -> list[str]:
    """Record until interrupted; a sentence for each topic.

    Parameters
    ----------
    path : Path
    topics : sequence of str
    arguments : sequence of str
        Of ROS.
    """
    with ending_at_once():
        from tsepm_ros.nodes.base_node import run
    made: list[TopicRecorder] = []

    def make_node() -> Node:
        made.append(TopicRecorder(path, topics))
        return made[0]

    if code := run(make_node, ["--ros-args", *arguments]):
        raise SystemExit(code)
    recorder = made[0]
    return [
        f"{topic}: {number} messages"
        + (f"; {_without(recorder.missed[topic])}" if recorder.missed.get(topic) else "")
        for topic, number in recorder.counts.items()
    ]
