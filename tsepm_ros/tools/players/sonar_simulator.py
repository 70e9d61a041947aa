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
"""The node that simulates a sonar: detections, own ship and truth of a scenario."""

from __future__ import annotations

import heapq
from collections.abc import Iterator, Sequence
from functools import partial
from typing import Any

import numpy as np
from rclpy.node import Node
from std_msgs.msg import Header

from msg_adapters import make_header, message_class, write_detections
from tsepm_ros.nodes.base_node import refusing_node_parameter, run_node
from tsepm_ros.own_ship.pose_history import PoseSample
from tsepm_ros.settings.node_options import SimulatorNodeOptions
from tsepm_ros.settings.settings import settings_help
from tsepm_ros.tools.players.scan_player import Event, PlayedTopics, ScanPlayingNode
from tsepm_ros.tools.simulation import Scenario, SimulatedScan, Simulator, load_scenario
from tsepm_ros.tracker.scan import Scan


class SimulatorScenario(PlayedTopics):
    """Publishes the scans, the own ship and the truth of a scenario.

    Parameters
    ----------
    node : rclpy.node.Node
    options : SimulatorNodeOptions

    Attributes
    ----------
    detections : dict of str to Publisher
    publishers : list of Publisher
        Publishers whose messages must be acknowledged.

    Raises
    ------
    ParameterError
        If the scenario or the type of the detections is unknown.
    """

    def __init__(self, node: Node, options: SimulatorNodeOptions) -> None:
        self._node = node
        self._options = options
        with refusing_node_parameter("scenario"):
            self._scenario = load_scenario(options.scenario)
            Simulator(self._scenario, options.seed)  # raises if targets cannot be drawn
        with refusing_node_parameter("detections_type"):
            self._message(make_header(0, ""), Scan(0.0, np.zeros(0), np.zeros(0)), self._scenario)
            kind = message_class(options.detections_type)
        self._start = (
            options.start_stamp
            if options.start_stamp >= 0
            else 1e-9 * node.get_clock().now().nanoseconds
        )
        super().__init__(
            node,
            kind,
            options.fixed_frame,
            options.sensor_frame,
            sensors=[*self._scenario.sensors],
        )

    def events(self) -> Iterator[Event]:
        """Own-ship poses at their rate; each scan after its last echo."""
        interval = 1.0 / self._options.own_ship_rate
        samples = 0
        simulator = Simulator(self._scenario, self._options.seed, self._start)
        number = self._options.messages_per_scan
        drawn = [
            enumerate(one if number == 1 else one.parts(number))
            for one in simulator.sensors.values() or [simulator]
        ]
        for index, scan in heapq.merge(*drawn, key=lambda item: item[1].complete):
            while self._start + (samples - 1) * interval < scan.complete:
                stamp = self._start + samples * interval
                yield stamp, partial(self._publish_pose, stamp)
                samples += 1
            # After the first pose beyond the last echo: the poses span the whole scan.
            due = max(scan.complete, self._start + (samples - 1) * interval)
            yield due, partial(self._publish_scan, scan, index + 1)

    def _publish_pose(self, stamp: float) -> None:
        time = stamp - self._start
        x, y, yaw = self._scenario.own_ship.pose(time)
        wrapped = float(np.remainder(yaw + np.pi, 2 * np.pi) - np.pi)
        rates = tuple(self._scenario.own_ship.rates(time).tolist())
        self.publish_own_ship(PoseSample(stamp, float(x), float(y), wrapped, rates=rates))

    def _publish_scan(self, simulated: SimulatedScan, index: int) -> None:
        scan, messages = simulated.scan, self._options.messages_per_scan
        name, scene = scan.sensor, self._scenario.of_each[scan.sensor]
        number, rest = divmod(index - 1, messages)
        if rest == 0:
            self.publish_truth(scan.stamp, simulated.truth)
        header = self.sensor_header(scan.stamp)
        self.detections[name].publish(self._message(header, scan, scene))
        if rest == 0:
            content = f"{messages} messages" if messages > 1 else f"{len(scan)} detections"
            said = f"{name} scan {number + 1} of {scene.total_scans}: {content}"
            self._node.get_logger().info(said.lstrip())

    def _message(self, header: Header, scan: Scan, scene: Scenario) -> Any:
        return write_detections(
            self._options.detections_type,
            header,
            scan,
            sound_speed=scene.sound_speed,
        )


class SonarSimulator(ScanPlayingNode):
    """Publishes the scans of a scenario as a sonar driver would."""

    def __init__(self, **node_options: Any) -> None:
        make = lambda node, options: SimulatorScenario(node, options[SimulatorNodeOptions])  # noqa: E731
        super().__init__("sonar_simulator", make, **node_options)


def main(args: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run_node(SonarSimulator, args, settings_help("sonar_simulator", __doc__))
