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
"""The base of the nodes: parameters, log, clocks, start and clean shutdown.

The parameters are those of the parameter table. Overrides of the quality of service are parameters
``qos_overrides.<topic>.publisher.<policy>``.
"""

from __future__ import annotations

import functools
import itertools
import math
import signal
import sys
import threading
import time
import traceback
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    ParameterType,
    SetParametersResult,
)
from rclpy.clock import Clock, ClockType
from rclpy.exceptions import NameValidationException
from rclpy.executors import SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter
from rclpy.qos import QoSPolicyKind, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.task import Future
from rclpy.timer import Timer
from rosgraph_msgs.msg import Clock as ClockMessage

from msg_adapters import diagnostics, time_to_ns
from tsepm_ros.diagnostics.health_figures import Connections, Status
from tsepm_ros.diagnostics.input_health import NodeHealth
from tsepm_ros.ending_signals import ENDING_SIGNALS
from tsepm_ros.parameters import (
    Parameter,
    Value,
    check_parameter,
    refuse_integer_parameter,
    shown_parameter,
)
from tsepm_ros.session.drop_reasons import (
    INTERNAL_ERROR,
    REPORT_IT,
    drop_reason_of,
    shortened_reason,
)
from tsepm_ros.settings.parameter_files import (
    OF_ROS,
    parameter_files_without_value,
    unused_parameter_files,
)
from tsepm_ros.settings.settings import (
    NODES,
    Groups,
    make_groups,
    settings_sensors,
    settings_table,
    settings_with_method,
    unknown_setting,
    why_settings_unused,
)

EXIT_BAD_PARAMETER = 2
MAX_STANDING = 5.0
"""Time of the wall clock after which the clock of a node stands still, s."""
WARNING_PERIOD = 10.0
"""Minimum time between warnings with the same reason, s."""
MORE_DETECTIONS = 10
"""Factor between the numbers of dropped detections of two warnings: many pings have some."""
FACTS = ("intensity", "plots", "land", "sweep", "tracker_back", "own_ship_restart", "alignment")
"""Reasons that are no fault."""
HEALTH_PERIOD = 1.0
"""Time between messages on /diagnostics, s."""
RANGES: dict[type, tuple[str, type[Any], float]] = {
    float: ("floating_point_range", FloatingPointRange, sys.float_info.max),
    int: ("integer_range", IntegerRange, 2**63 - 1),
}
"""Field and message of the bounds of a parameter's type, and their largest value."""
OVERRIDES = "qos_overrides."
OVERRIDABLE = QoSOverridingOptions(
    (
        QoSPolicyKind.HISTORY,
        QoSPolicyKind.DEPTH,
        QoSPolicyKind.RELIABILITY,
        QoSPolicyKind.DURABILITY,
    )
)
"""Policies of every publisher that may be overridden. Those of subscriptions may not: reliability
follows the publisher, and the depth has a parameter."""
_POLICIES = {
    "history": ("keep_last", "keep_all"),
    "reliability": ("reliable", "best_effort"),
    "durability": ("volatile", "transient_local"),
}

OptionsByType = Mapping[type[Any], Any]
"""Option objects by their class."""


class ParameterError(ValueError):
    """The value of a parameter is not allowed."""


@contextmanager
def refusing_node_parameter(name: str = "") -> Iterator[None]:
    """Turn a ValueError into a ParameterError whose message begins with a parameter's name."""
    try:
        yield
    except ValueError as error:
        raise ParameterError(f"{name}: {error}" if name else str(error)) from None


class BaseNode(Node):
    """A node with the parameters of a table.

    All given parameters are declared: rclpy reports undeclared names in no other way, and a
    misspelt parameter must not be ignored silently. A parameter file without a section for the
    node is named in a warning: ROS ignores it.

    Parameters
    ----------
    name : str
        A key of `tsepm_ros.settings.settings.NODES`, which has the table.
    on_change : callable, optional
        Called with the options after parameters changed at run time.
    validate : callable, optional
        Called with the options before a change; an exception refuses the change.
    **node_options
        Arguments of `rclpy.node.Node`.

    Attributes
    ----------
    options : mapping of type to options
        The option objects by their class.
    dropped : Counter
        What is not used, by reason.
    health : NodeHealth

    Raises
    ------
    ParameterError
        If a name given at the start is unknown or its value is not allowed, and the message names
        the parameter; or if a parameter has no value, such as an empty list.
    """

    def __init__(
        self,
        name: str,
        on_change: Callable[[OptionsByType], None] = lambda options: None,
        validate: Callable[[OptionsByType], None] = lambda options: None,
        **node_options: Any,
    ) -> None:
        self._alone, self._is_destroyed = threading.RLock(), False
        self.health, self._watched = NodeHealth({}), dict[str, str]()
        arguments = [*(node_options.get("cli_args") or ()), *sys.argv[1:]]
        try:
            super().__init__(
                name, automatically_declare_parameters_from_overrides=True, **node_options
            )
        except ValueError as error:
            if not any(words in str(error) for words in ("NOT_SET", "do not agree")):
                raise
            names = parameter_files_without_value(arguments, self.get_fully_qualified_name())
            raise ParameterError(
                f"{', '.join(names) or 'a parameter'} has no value: an empty list or entry is none"
            ) from None
        for sentence in unused_parameter_files(arguments, self.get_fully_qualified_name()):
            self.get_logger().warning(sentence)
        self._groups, self._rows = self._with_method(NODES[name])
        self._unused: dict[str, Any] = {}  # of other methods, which may be chosen later
        self._following: dict[str, list[str]] = {}  # of sensors, by the one of all that they have
        self._on_change, self._validate = on_change, validate
        self.dropped, self._warned = Counter[str](), set[str]()
        self._said: dict[str, tuple[float, int]] = {}  # when, and how many then
        self._refuse_unknown()
        for row in self._rows.values():
            self._declare(row)
        self.options: OptionsByType = self._make_options({})
        self.add_pre_set_parameters_callback(self._typed)
        self.add_on_set_parameters_callback(self._check)
        self.add_post_set_parameters_callback(self._apply_changes)
        self._health = self.create_publisher(
            DiagnosticArray, "/diagnostics", 10, qos_overriding_options=OVERRIDABLE
        )
        self.report_timer = self.steady_timer(HEALTH_PERIOD, self._report)

    def guarded(self, callback: Callable[..., Any]) -> Callable[..., Any]:
        """A callback whose exceptions count, and which runs alone, whatever the executor does."""

        @functools.wraps(callback)  # rclpy looks at the signature
        def guard(*given: Any) -> Any:
            with self._alone:
                if self._is_destroyed:  # a thread of an executor was waiting
                    return None
                try:
                    return callback(*given)
                except Exception as error:
                    if self.context.ok():  # else a signal has ended it
                        with suppress(Exception):  # of a MemoryError, its report may be another
                            self.fail(error)
            return None

        return guard

    def destroy_node(self) -> None:
        """Destroy the node, once no callback runs."""
        with self._alone:
            self._is_destroyed = True
            super().destroy_node()

    def create_timer(
        self, period: float, callback: Callable[..., Any], *given: Any, **options: Any
    ) -> Timer:
        """Make a timer."""
        return super().create_timer(period, self.guarded(callback), *given, **options)

    def create_guard_condition(self, callback: Callable[..., Any], *given: Any) -> Any:
        """Make a guard condition."""
        return super().create_guard_condition(self.guarded(callback), *given)

    def add_waitable(self, waitable: Any) -> None:
        """Add an entity of another kind, such as a handler of the middleware's events."""
        if callback := getattr(waitable, "callback", None):
            waitable.callback = self.guarded(callback)
        super().add_waitable(waitable)

    def create_service(
        self, srv_type: Any, srv_name: str, callback: Callable[[Any, Any], Any], **options: Any
    ) -> Any:
        """Make a service, which answers whatever happens.

        A parameter of no type that exists has no value, which is refused.
        """

        def answer(request: Any, response: Any) -> Any:
            for given in getattr(request, "parameters", ()):
                if given.value.type > ParameterType.PARAMETER_STRING_ARRAY:
                    given.value.type = ParameterType.PARAMETER_NOT_SET
            answered = self.guarded(callback)(request, response)
            return response if answered is None else answered

        return super().create_service(srv_type, srv_name, answer, **options)

    def create_subscription(
        self, msg_type: Any, topic: str, callback: Callable[..., None], *given: Any, **options: Any
    ) -> Any:
        """Make a subscription; times on /clock that no clock gives do not reach rclpy."""

        def take_clock(message: ClockMessage) -> None:
            try:
                time_to_ns(message.clock)
                callback(message)
            except ValueError as error:
                self.drop("clock_invalid", f"a time on /clock is not used: {error}")

        take = self.guarded(take_clock if msg_type is ClockMessage else callback)
        return super().create_subscription(msg_type, topic, take, *given, **options)

    def drop(self, reason: str, sentence: str, number: int = 1) -> None:
        """Count what is not used, and say why."""
        self.dropped[reason] += number
        self.health.dropped(reason, time.monotonic(), self.dropped[reason])
        self.warn(reason, sentence, self.dropped[reason])

    def fail(self, error: Exception) -> None:
        """Count an exception of a callback as internal error: nothing else has caught it."""
        self.drop(INTERNAL_ERROR, shortened_reason(f"a callback failed: {error!r}"))

    def connections(self, topic: str, **others: Any) -> Connections:
        """The publishers of a topic, for the health of an input."""
        ends = self.get_publishers_info_by_topic(topic)
        return Connections(
            topic=self.resolve_topic_name(topic),
            publishers=sorted(f"{end.node_namespace.rstrip('/')}/{end.node_name}" for end in ends),
            best_effort={end.qos_profile.reliability for end in ends}
            == {ReliabilityPolicy.BEST_EFFORT},
            **others,
        )

    def watch(self, task: str, noun: str, topic: str) -> None:
        """Have an entry of an input on /diagnostics, see `NodeHealth`."""
        self.health.nouns[task], self._watched[task] = noun, topic

    def found(self) -> Mapping[str, Mapping[str, Any]]:
        """What the node finds of its inputs: arguments of `InputFigures` by task."""
        return {}

    def statuses(self) -> list[Status]:
        """What is published on /diagnostics."""
        ends = {task: self.connections(topic) for task, topic in self._watched.items()}
        return self.health.report_inputs(time.monotonic(), self.dropped, ends, self.found())

    def _report(self) -> None:
        self._health.publish(
            diagnostics(
                self.get_clock().now().nanoseconds,
                self.get_fully_qualified_name(),
                self.statuses(),
            )
        )

    def warn(self, reason: str, sentence: str, total: int = 0, source: str = "") -> None:
        """Log a fault and the number of its occurrences, or a fact of `FACTS` as INFO.

        At most once per `WARNING_PERIOD` and reason. Drops of single detections are logged again
        once they are `MORE_DETECTIONS` times as many. Nothing is logged while the node ends. The
        traceback of an internal error is logged once for each place. Sources, such as sensors, are
        named, and counted each for itself.
        """
        if not self.context.ok():
            return
        if (
            reason == INTERNAL_ERROR
            and (line := "".join(traceback.format_tb(sys.exc_info()[2])[-1:])) not in self._warned
        ):
            self._warned.add(line)
            self.get_logger().error(f"{REPORT_IT}:\n{traceback.format_exc()}")
        key, front = f"{source}/{reason}", f"{source}: " if source else ""
        now, (last, before) = time.monotonic(), self._said.get(key, (-WARNING_PERIOD, 0))
        is_little = total < MORE_DETECTIONS * before and drop_reason_of(reason).lost == "detection"
        if now - last < WARNING_PERIOD or (total and is_little):
            return
        self._said[key] = now, total
        counted = front + (f"{sentence} ({total} so far: {reason})" if total else sentence)
        if reason in FACTS:  # a line of its own: rclpy refuses two severities of one line
            self.get_logger().info(counted)
        else:
            self.get_logger().warning(counted)

    def warn_once(self, sentence: str) -> None:
        """Log a warning, unless it was logged before."""
        if sentence not in self._warned:
            self._warned.add(sentence)
            self.get_logger().warning(sentence)

    def steady_timer(self, period: float, callback: Callable[[], None]) -> Timer:
        """Make a timer of a period, s, which a simulated clock does not stop."""
        return self.create_timer(period, callback, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def refuse_unused_overrides(self) -> None:
        """Refuse overrides of the quality of service that nothing uses; after the publishers.

        Raises
        ------
        ParameterError
        """
        publishers = {publisher.topic_name for publisher in self.publishers}
        given = self.get_parameters_by_prefix(OVERRIDES.removesuffix("."))
        for name, override in sorted(given.items()):
            _refuse_override(f"{OVERRIDES}{name}", override.value, publishers)

    def _refuse_unknown(self) -> None:
        unused: dict[str, list[str]] = {}
        for name, given in self.get_parameters_by_prefix("").items():
            if name.startswith(OVERRIDES):
                _refuse_override(name, given.value)
            if name in self._rows or name.startswith(OF_ROS):
                continue
            if not (why := why_settings_unused(name, self._rows)):
                raise ParameterError(unknown_setting(name, self._rows))
            self._unused[name] = given.value
            self.undeclare_parameter(name)
            unused.setdefault(why, []).append(name)
        for why, names in unused.items():
            self.get_logger().warning(f"not used by this node: {', '.join(names)}; {why}")

    def _with_method(self, groups: Groups) -> tuple[Groups, dict[str, Parameter]]:
        """The groups with those of the chosen method, and their parameters by full name."""
        given = {name: one.value for name, one in self.get_parameters_by_prefix("").items()}
        groups = settings_with_method(groups, given.get("method"))
        with refusing_node_parameter():
            sensors = settings_sensors(groups, given)
        return groups, {row.name: row for row in settings_table(groups, sensors)}

    def _declare(self, row: Parameter) -> None:
        given: Any = self._unused.pop(row.name, row.default)
        if self.has_parameter(row.name):
            given = row.meant(self.get_parameter(row.name).value)
            self.undeclare_parameter(row.name)
        elif row.plain:
            given = self.get_parameter(row.plain).value
            self._following.setdefault(row.plain, []).append(row.name)
        with refusing_node_parameter():
            check_parameter(row.name, given, {row.name: row, **self._rows})
            refuse_integer_parameter(row, given)
        given = given or [""] if row.type is tuple else given
        self.declare_parameter(row.name, given, _parameter_descriptor(row), ignore_override=True)

    def _make_options(self, changes: Mapping[str, Value]) -> dict[type[Any], Any]:
        values = {name: self.get_parameter(name).value for name in self._rows}
        with refusing_node_parameter():
            return make_groups(self._groups, {**self._unused, **values, **changes})

    def _typed(self, parameters: list[RosParameter]) -> list[RosParameter]:
        """The values as they are meant: `ros2 param load` sends 1.0e-06 as a text.

        All others stay as they are: rclpy cannot make a parameter of an empty array alone. A value
        of all sensors is that of each that has none of its own.
        """
        parameters = parameters + [
            RosParameter(name, given.type_, given.value)
            for given in parameters
            for name in self._following.get(given.name, ())
            if name not in {other.name for other in parameters}
        ]
        return [
            RosParameter(given.name, value=meant)
            if given.name in self._rows
            and (meant := self._rows[given.name].meant(given.value)) is not given.value
            else given
            for given in parameters
        ]

    def _check(self, parameters: list[RosParameter]) -> SetParametersResult:
        # Types were checked by rclpy; another part of the node has declared what is in no row.
        changes = {given.name: given.value for given in parameters if given.name in self._rows}
        reason = ""
        try:
            if changes:
                self._validate(self._make_options(changes))
        except ParameterError as error:
            reason = str(error)
        except Exception as error:
            reason = f"{', '.join(changes)} cannot be used: {error!r}"
        if not all(given.name for given in parameters):  # rclpy would declare it
            reason = "a parameter has no name"
        return SetParametersResult(successful=not reason, reason=reason)

    def _apply_changes(self, parameters: list[RosParameter]) -> None:
        if not any(parameter.name in self._rows for parameter in parameters):
            return
        values = {name: self.get_parameter(name).value for name in self._rows}
        for plain, names in self._following.items():
            self._following[plain] = [name for name in names if values[name] == values[plain]]
        groups, rows = self._with_method(self._groups)
        for name in [name for name in rows if name not in self._rows]:  # the method has changed
            self._declare(rows[name])
        self._groups, self._rows = groups, rows
        self.options = self._make_options({})
        self._on_change(self.options)


def _refuse_override(name: str, value: Any, publishers: Collection[str] | None = None) -> None:
    """Refuse an override that cannot be used.

    Parameters
    ----------
    name : str
        Full name of the parameter.
    value : object
    publishers : collection of str, optional
        Full names of the topics that the node publishes; not known yet if not given.

    Raises
    ------
    ParameterError
    """
    topic, _, policy = name.removeprefix(OVERRIDES).rpartition(".publisher.")
    choices = _POLICIES.get(policy, ())
    is_allowed = value in choices if choices else type(value) is int and 1 <= value < 2**31
    words = " or ".join(choices) or "an integer of at least 1, below 2**31"
    unknown = publishers is not None and topic not in publishers
    for wrong, sentence in (
        (
            not topic,
            "cannot be used: only publishers take overrides; the reliability of a subscription "
            "follows its publisher (detections_reliability and detections_depth are parameters)",
        ),
        (unknown, f"cannot be used: the node publishes {', '.join(sorted(publishers or ()))}"),
        (
            policy not in ("depth", *_POLICIES),
            f"cannot be used: the policy must be depth, {', '.join(_POLICIES)}",
        ),
        (not is_allowed, f"must be {words}; got {shown_parameter(value)}"),
    ):
        if wrong:
            raise ParameterError(f"{name} {sentence}")


def _parameter_descriptor(row: Parameter) -> ParameterDescriptor:
    ranges: dict[str, list[Any]] = {}
    if row.bounds and row.type in RANGES:
        field, make, limit = RANGES[row.type]
        low, high = max(0.0 if row.positive else row.minimum, -limit), min(row.maximum, limit)
        ranges[field] = [make(from_value=row.type(low), to_value=row.type(high))]
    return ParameterDescriptor(
        description=row.description + (f" [{row.unit}]" if row.unit else ""),
        additional_constraints=row.bounds,
        read_only=row.read_only,
        **ranges,
    )


class NodeClocks:
    """The times that limit waiting: wall clock and node clock, which may be simulated.

    Parameters
    ----------
    node : BaseNode

    Attributes
    ----------
    fault : str
        A sentence while the node clock stands still, which limits nothing: its time is nan then.
    """

    def __init__(self, node: BaseNode) -> None:
        self._node, self.fault = node, ""
        self._time, self._since = math.nan, 0.0

    def now(self) -> tuple[float, float]:
        """Times of the wall clock and the node clock, s."""
        wall, simulated = time.monotonic(), self._node.get_clock().now().nanoseconds * 1e-9
        if simulated != self._time:
            self._time, self._since, self.fault = simulated, wall, ""
        if wall - self._since <= MAX_STANDING:
            return wall, simulated
        self.fault = (
            f"the node's clock (use_sim_time) stands still for {wall - self._since:.3g} s: is "
            "/clock published? Waiting is limited by the wall clock"
        )
        self._node.warn("clock", self.fault)
        return wall, math.nan


def run_node(
    make_node: Callable[[], Node], args: Sequence[str] | None = None, usage: str = ""
) -> int:
    """Run a node until it is interrupted, or until its future `finished`, if any, is done.

    Parameters
    ----------
    make_node : callable
        Returns the node.
    args : sequence of str, optional
        Command-line arguments; those of the process if not given.
    usage : str, optional
        Text for the argument ``--help`` or ``-h``, which prints it before ROS starts.

    Returns
    -------
    int
        Exit code: 0 after SIGINT, SIGTERM, the node's own end or ``--help``; 2 for a refused
        argument or parameter.
    """
    given = sys.argv[1:] if args is None else args
    if "--help" in given or "-h" in given:
        print(usage)
        return 0
    if stray := _stray_argument(given):
        print(
            f"refused: {stray!r} is not an argument of this program; parameters and remappings "
            "follow --ros-args, such as --ros-args -p max_speed:=5.0 (--help explains)",
            file=sys.stderr,
        )
        return EXIT_BAD_PARAMETER
    # No KeyboardInterrupt, which can be raised anywhere: a signal shuts rclpy's context down. The
    # list holds signals that arrive before the context exists.
    signals: list[int] = []
    for number in ENDING_SIGNALS:
        signal.signal(number, lambda number, _: signals.append(number))
    try:
        try:
            rclpy.init(args=args)
        except RuntimeError as error:
            print(f"refused: {error}", file=sys.stderr)
            return EXIT_BAD_PARAMETER
        return 0 if signals else _run_node(make_node)
    finally:
        rclpy.try_shutdown()
        for number in ENDING_SIGNALS:
            # The interpreter restores its own handlers before it ends, but keeps SIG_IGN.
            signal.signal(number, signal.SIG_IGN)


def _stray_argument(arguments: Sequence[str]) -> str:
    """The first option outside of ``--ros-args ... --``, which ROS would ignore; may be empty."""
    to_ros = False
    for argument in arguments:
        if argument in ("--ros-args", "--"):
            to_ros = argument == "--ros-args"
        elif not to_ros and (argument.startswith("-") or ":=" in argument):
            return argument
    return ""


def _run_node(make_node: Callable[[], Node]) -> int:
    try:
        # Before the node, which takes longer: a signal during its construction prints a traceback.
        with SingleThreadedExecutor() as executor:
            _spin_node(executor, _made_node(make_node))
    except ParameterError as error:
        print(f"refused: {error}", file=sys.stderr)
        return EXIT_BAD_PARAMETER
    except Exception:
        # A signal may invalidate the context at any point; that end is clean.
        if rclpy.ok():
            raise
    return 0


def _made_node(make_node: Callable[[], Node]) -> Node:
    """Make the node; what ROS refuses, such as security without keys or a bad name, is refused."""
    try:
        return make_node()
    except (rclpy_implementation.RCLError, NameValidationException) as error:
        if not rclpy.ok():
            raise
        raise ParameterError(" ".join(str(error).split())) from error


def _release_node(node: Node) -> None:
    """Let a node hear again: rclpy keeps what it could not take marked as being worked on."""
    entities = node.subscriptions, node.timers, node.services, node.clients, node.waitables
    for entity in itertools.chain(*entities):
        entity._executor_event = False
        group = entity.callback_group
        if (active := getattr(group, "_active_entity", None)) is not None:
            group.ending_execution(active)


def _spin_node(executor: SingleThreadedExecutor, node: Node) -> None:
    """Call a node's callbacks until its end; an exception of one counts, and the next follows."""
    executor.add_node(node)
    finished: Future = getattr(node, "finished", None) or Future()
    try:
        while rclpy.ok() and not finished.done():
            try:
                executor.spin_once()
            except Exception as error:
                if not (rclpy.ok() and isinstance(node, BaseNode)):
                    raise
                _release_node(node)
                with suppress(Exception):  # of a MemoryError, its report may be another
                    node.fail(error)
    finally:
        node.destroy_node()
