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
"""The node of `tsepm health`, which imports little: scripts call it often."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future

from tsepm_ros.diagnostics.health_figures import OVERALL, Level

MIN_TIME = 2.0
"""Time without a new node after which all are known, s: discovery is slow on a busy machine."""
POLL_PERIOD = 0.1
"""Time between looks at the graph, s."""
DIAGNOSTICS = "/diagnostics"
NEWEST, SOME = (
    QoSProfile(depth=depth, reliability=ReliabilityPolicy.BEST_EFFORT) for depth in (1, 100)
)
"""Of a topic's messages the newest, or some: best effort is compatible with every publisher."""


class LiveHealthReader(Node):
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
        self._begin = self._changed = time.monotonic()
        self._found: set[str] = set()
        self._heard: dict[str, Sequence[Any]] = {}
        self._silent: set[str] = set()
        self.create_subscription(DiagnosticArray, DIAGNOSTICS, self._hear, SOME)
        self.create_timer(POLL_PERIOD, self._look, clock=Clock(clock_type=ClockType.STEADY_TIME))

    @property
    def entries(self) -> list[tuple[Level, str]]:
        """Level and sentence of each entry, by node."""
        entries = [
            (Level(status.level[0]), f"{status.name}: {status.message}")
            for _, statuses in sorted(self._heard.items())
            for status in statuses
        ]
        silence = f"no message on {DIAGNOSTICS} within {self._timeout:g} s"
        return entries + [(Level.STALE, f"{name}: {silence}") for name in sorted(self._silent)]

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
        now, found = time.monotonic(), nodes | self._heard.keys()
        if found != self._found:
            self._found, self._changed = found, now
        settled = self._name or now - self._changed > MIN_TIME
        complete = self._heard and not self._silent and settled
        if (complete or now - self._begin > self._timeout) and not self.finished.done():
            self.finished.set_result(None)


def read_live_health(
    name: str, timeout: float, arguments: Sequence[str]
) -> list[tuple[Level, str]]:
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
    try:  # signals stay exceptions of the command
        rclpy.init(args=["--ros-args", *arguments], signal_handler_options=SignalHandlerOptions.NO)
        node = LiveHealthReader(name, timeout)
    except RuntimeError as error:
        raise ValueError(str(error)) from None
    try:
        rclpy.spin_until_future_complete(node, node.finished)
    finally:
        rclpy.try_shutdown()
    return node.entries
