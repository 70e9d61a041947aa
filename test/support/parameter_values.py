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
"""Values of every type for calls of `set_parameters`, also empty ones and of no type."""

import math
import tempfile
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.node import Node

from support.ros_world import World
from tsepm_ros.nodes.track_initiator import TrackInitiator
from tsepm_ros.tools.players.scan_player import ScanPlayer
from tsepm_ros.tools.players.sonar_simulator import SonarSimulator
from tsepm_ros.tools.viewer.track_viewer import TrackViewer

NODES = (TrackInitiator, SonarSimulator, ScanPlayer, TrackViewer)
DOUBLES = (0.0, -0.0, 1.0, -1.0, 5e-324, 1e-320, 1e200, 1e308, math.inf, -math.inf, math.nan)
INTEGERS = (0, 1, 2, 8, -1, 2**31, 2**63 - 1, -(2**63))
TEXTS = ("", "x", "nan", "1e-06", "1e999", "on", "[1, 2]", "{a: 1}", "score", "é\n\t", "x" * 50_000)
LENGTHS = (0, 0, 0, 1, 2, 3, 1000)
NO_NAMES = ("", "nothing", "a.b", "max_speed.x", "é")
NO_TYPES = (ParameterType.PARAMETER_STRING_ARRAY + 1, 100, 255)
TYPES = (*range(ParameterType.PARAMETER_STRING_ARRAY + 1), *NO_TYPES)


def make(world: World, kind: type[Node], **parameters: Any) -> Node:
    """A node with what it needs at least."""
    if kind is ScanPlayer:
        with tempfile.TemporaryDirectory() as folder:
            (Path(folder) / "detections.csv").write_text("time_s,range_m,azimuth_rad\n0,1000,0.1\n")
            return world.make(kind, {"recording": folder, **parameters})
    return world.make(kind, {"port": 0, **parameters} if kind is TrackViewer else parameters)


def declared(node: Node) -> list[str]:
    return sorted(node.list_parameters([], 0).names)


def value(rng: np.random.Generator) -> ParameterValue:
    """A value of any type, whatever its parameter has."""

    def some(among: tuple[Any, ...]) -> Any:
        return among[rng.integers(len(among))]

    n = some(LENGTHS)
    return ParameterValue(
        type=some(TYPES),
        bool_value=bool(rng.integers(2)),
        integer_value=some(INTEGERS),
        double_value=some(DOUBLES),
        string_value=some(TEXTS),
        byte_array_value=[bytes([int(rng.integers(256))]) for _ in range(n)],
        bool_array_value=[bool(rng.integers(2)) for _ in range(n)],
        integer_array_value=[some(INTEGERS) for _ in range(n)],
        double_array_value=[some(DOUBLES) for _ in range(n)],
        string_array_value=[some(TEXTS[:-1]) for _ in range(n)],
    )


class Caller:
    """Sets parameters of a node through its services."""

    def __init__(self, world: World, node: Node) -> None:
        self._world, self._names = world, declared(node)
        kinds = {
            "set_parameters": SetParameters,
            "set_parameters_atomically": SetParametersAtomically,
        }
        self._clients = {
            kind: world.observer.create_client(kind, f"{node.get_name()}/{service}")
            for service, kind in kinds.items()
        }
        for client in self._clients.values():
            world.until(client.service_is_ready, "the service")

    def set(self, parameters: list[Parameter], atomically: bool = False) -> list[Any]:
        """Results of a call; what its callback raises is raised here."""
        kind = SetParametersAtomically if atomically else SetParameters
        answer = self._clients[kind].call_async(kind.Request(parameters=parameters))
        self._world.until(answer.done, "an answer")
        return [answer.result().result] if atomically else answer.result().results

    def call(self, rng: np.random.Generator) -> Counter[str]:
        """A random call; a refusal has a sentence."""
        names = self._names if rng.random() < 0.95 else NO_NAMES
        number = int(rng.choice([1, 1, 1, 1, 2, 3, 0]))
        chosen = [names[i] for i in rng.integers(0, len(names), number).tolist()]
        results = self.set(
            [Parameter(name=one, value=value(rng)) for one in chosen], rng.random() < 0.4
        )
        for result in results:
            assert result.successful or 0 < len(result.reason) < 1000, result.reason[:1000]
        set_ = sum(result.successful for result in results)
        return Counter({"calls": 1, "values set": set_, "values refused": len(results) - set_})
