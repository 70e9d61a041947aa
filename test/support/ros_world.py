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
"""Nodes in this process, in a context and a domain of their own, spun until something happens."""

from __future__ import annotations

import gc
import math
import time
from collections.abc import Callable
from typing import Any, TypeVar

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rcl_interfaces.msg import Log
from rcl_interfaces.srv import SetParameters
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_srvs.srv import Trigger

from support.patience import WAIT

WARN, ERROR = 30, 40
"""Levels of rcl_interfaces/Log."""

RELIABLE = QoSProfile(depth=1000)
BEST_EFFORT = QoSProfile(depth=1000, reliability=ReliabilityPolicy.BEST_EFFORT)
LATCHED = QoSProfile(depth=1000, durability=DurabilityPolicy.TRANSIENT_LOCAL)

NodeType = TypeVar("NodeType", bound=Node)


def remapped(*rules: str) -> list[str]:
    """Arguments of ROS that give a node other names."""
    return ["--ros-args", *(part for rule in rules for part in ("-r", rule))]


def as_messages(values: dict[str, Any]) -> list[Any]:
    """Parameters from keywords: ``tsepm__window`` is ``tsepm.window``."""
    return [
        Parameter(name.replace("__", "."), value=value).to_parameter_msg()
        for name, value in values.items()
    ]


class Messages(list):
    """The messages of a topic, in order of arrival."""

    def __init__(self, node: Node, kind: type, topic: str, qos: QoSProfile) -> None:
        super().__init__()
        self.subscription = node.create_subscription(kind, topic, self.append, qos)


class World:
    """One context with some nodes of the package, a node that looks at them, and an executor."""

    def __init__(self, domain: int, deadline: float = WAIT) -> None:
        self.domain = domain
        self.deadline = deadline
        self.context = Context()
        self._nodes: list[Node] = []
        self._refused = False
        self.provokes = False
        """Whether internal errors are provoked; else one is a failure."""

    def __enter__(self) -> World:
        rclpy.init(context=self.context, domain_id=self.domain)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.observer = self.add(Node("observer", context=self.context))
        self.log = self.listen(Log, "/rosout", LATCHED)
        self.diagnostics = self.listen(DiagnosticArray, "/diagnostics")
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        errors = self.internal_errors()
        self.executor.shutdown()
        for node in self._nodes:
            node.destroy_node()
        rclpy.try_shutdown(context=self.context)
        if self._refused:
            gc.collect()  # a refused node keeps the next one with its name from /rosout
        assert kind or self.provokes or not errors, f"internal errors: {errors}"

    def internal_errors(self) -> int:
        """Internal errors that the nodes have counted."""
        counts = [
            getattr(getattr(node, "_session", None), "dropped", None)
            or getattr(node, "dropped", {})
            for node in self._nodes
        ]
        return sum(dropped.get("internal_error", 0) for dropped in counts)

    def add(self, node: NodeType) -> NodeType:
        self._nodes.append(node)
        self.executor.add_node(node)
        return node

    def make(
        self,
        kind: Callable[..., NodeType],
        parameters: dict[str, Any] | None = None,
        **node_options: Any,
    ) -> NodeType:
        """Make a node and spin it."""
        overrides = [Parameter(name, value=value) for name, value in (parameters or {}).items()]
        try:
            node = kind(context=self.context, parameter_overrides=overrides, **node_options)
        except Exception:
            self._refused = True
            raise
        return self.add(node)

    def end(self, node: Node) -> None:
        """End one node before the others."""
        self._nodes.remove(node)
        self.executor.remove_node(node)
        node.destroy_node()

    def listen(self, kind: type, topic: str, qos: QoSProfile = RELIABLE) -> Messages:
        return Messages(self.observer, kind, topic, qos)

    def spin_once(self, timeout: float = 0.005) -> None:
        self.executor.spin_once(timeout_sec=timeout)

    def until(
        self, condition: Callable[[], object], what: str, send: Callable[[], object] | None = None
    ) -> None:
        """Spin until the condition holds; with `send`, that is called every 50 ms meanwhile."""
        end, sent = time.monotonic() + self.deadline, -math.inf
        while not condition():
            if time.monotonic() > end:
                pytest.fail(f"waited {self.deadline} s for {what}; logged: {self.logged()}")
            if send and time.monotonic() - sent > 0.05:
                send()
                sent = time.monotonic()
            self.spin_once()

    def until_connected(self) -> None:
        """Spin until every publisher here knows every compatible subscription here."""
        self.until(self._is_connected, "connections between publishers and subscriptions")

    def _is_connected(self) -> bool:
        wanted: dict[str, int] = {}
        for node in self._nodes:
            for subscription in node.subscriptions:
                wanted[subscription.topic_name] = wanted.get(subscription.topic_name, 0) + 1
        return all(
            publisher.get_subscription_count() >= wanted.get(publisher.topic_name, 0)
            for node in self._nodes
            for publisher in node.publishers
        )

    def call(self, kind: type, service: str, request: Any) -> Any:
        """Call a service and return its response."""
        client = self.observer.create_client(kind, service)
        self.until(client.service_is_ready, f"the service {service}")
        answer = client.call_async(request)
        self.until(answer.done, f"an answer of {service}")
        self.observer.destroy_client(client)
        return answer.result()

    def reset(self) -> Trigger.Response:
        """Make the track initiator start over."""
        return self.call(Trigger, "/track_initiator/reset", Trigger.Request())

    def set_parameters(self, **values: Any) -> list[str]:
        """Set the track initiator's parameters one by one; the reasons, empty for accepted."""
        request = SetParameters.Request(parameters=as_messages(values))
        results = self.call(SetParameters, "/track_initiator/set_parameters", request).results
        for result in results:
            assert result.successful == (not result.reason)
        return [result.reason for result in results]

    def logged(self, level: int = 0) -> list[str]:
        """What the nodes have said, from a level of rcl_interfaces/Log on."""
        return [entry.msg for entry in self.log if entry.level >= level]

    def warned(self) -> list[str]:
        """Warnings and worse, but of odometry that is not used: every driver here advertises it."""
        return [line for line in self.logged(WARN) if "odometry is published" not in line]

    def until_logged(self, *parts: str, level: int = 0) -> str:
        """Spin until a sentence with all these parts is logged; returns it."""

        def matches() -> list[str]:
            return [line for line in self.logged(level) if all(part in line for part in parts)]

        self.until(matches, f"a log entry with {parts}")
        return matches()[0]

    def statuses(self) -> dict[str, DiagnosticStatus]:
        """The track initiator's diagnostics by task, as published after this call."""
        return self.statuses_of("/track_initiator")

    def statuses_of(self, node: str) -> dict[str, DiagnosticStatus]:
        """A node's diagnostics by task, as published after this call."""
        seen = len(self.diagnostics)

        def found() -> list[Any]:
            new = [message.status for message in self.diagnostics[seen:]]
            return [statuses for statuses in new if statuses[0].hardware_id.endswith(node)]

        self.until(found, f"diagnostics of {node}")
        return {status.name.partition(": ")[2]: status for status in found()[-1]}

    def status(self, task: str) -> DiagnosticStatus:
        """One of them."""
        return self.statuses()[task]

    def figures(self) -> dict[str, str]:
        """The figures of all tasks, as published after this call."""
        return {
            value.key: value.value for status in self.statuses().values() for value in status.values
        }

    def dropped(self) -> dict[str, int]:
        """Drops by reason, from diagnostics."""
        return {
            key.removeprefix("dropped."): int(value)
            for key, value in self.figures().items()
            if key.startswith("dropped.")
        }
