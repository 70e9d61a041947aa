"""A simulated scenario as the messages that a sonar driver would publish."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
from rclpy.node import Node
from std_msgs.msg import Header

from msg_adapters import make_header, message_class, write_detections
from tsepm_ros.nodes.driver_topics import DriverTopics
from tsepm_ros.nodes.node_parameters import refusing
from tsepm_ros.nodes.playback import Event
from tsepm_ros.nodes.running import clock_time
from tsepm_ros.sensing.scan import Scan
from tsepm_ros.settings.node_options import SimulatorNodeOptions
from tsepm_ros.simulation import SimulatedScan, Simulator, load_scenario


class PlayedScenario:
    """Publishes the scans, the own ship and the truth of a scenario.

    Parameters
    ----------
    node : rclpy.node.Node
    options : SimulatorNodeOptions

    Attributes
    ----------
    detections : Publisher
    publishers : list of Publisher
        Those whose messages must arrive.

    Raises
    ------
    ParameterError
        If there is no such scenario or type of detections.
    """

    def __init__(self, node: Node, options: SimulatorNodeOptions) -> None:
        self._node = node
        self._options = options
        with refusing():
            self._scenario = load_scenario(options.scenario)
            Simulator(self._scenario, options.seed)  # targets that cannot be drawn are found now
        with refusing("detections_type"):
            self._message(make_header(0, ""), Scan(0.0, np.zeros(0), np.zeros(0)))
            kind = message_class(options.detections_type)
        self._start = options.start_stamp if options.start_stamp >= 0 else clock_time(node)
        self._topics = DriverTopics(node, kind, options.fixed_frame, options.sensor_frame)
        self.detections, self.publishers = self._topics.detections, self._topics.publishers

    def close(self) -> None:
        """Do nothing: nothing is open."""

    def events(self) -> Iterator[Event]:
        """Own-ship poses at their rate; a scan when its last echo is in."""
        step = 1.0 / self._options.own_ship_rate
        samples = 0
        for index, scan in enumerate(Simulator(self._scenario, self._options.seed, self._start)):
            while self._start + (samples - 1) * step < scan.complete:
                stamp = self._start + samples * step
                yield stamp, partial(self._publish_own_ship, stamp)
                samples += 1
            # The pose beyond the last echo has gone out: the own ship is known for all of it.
            due = max(scan.complete, self._start + (samples - 1) * step)
            yield due, partial(self._publish_scan, scan, index + 1)

    def _publish_own_ship(self, stamp: float) -> None:
        time = stamp - self._start
        x, y, yaw = self._scenario.own_ship.pose(time)
        wrapped = float(np.remainder(yaw + np.pi, 2 * np.pi) - np.pi)
        rates = self._scenario.own_ship.rates(time).tolist()
        self._topics.publish_own_ship(stamp, (float(x), float(y), wrapped), rates)

    def _publish_scan(self, simulated: SimulatedScan, index: int) -> None:
        scan = simulated.scan
        self._topics.publish_truth(scan.stamp, simulated.truth)
        self.detections.publish(self._message(self._topics.sensor_header(scan.stamp), scan))
        self._node.get_logger().info(
            f"scan {index} of {self._scenario.scans}: {len(scan)} detections"
        )

    def _message(self, header: Header, scan: Scan) -> Any:
        return write_detections(
            self._options.detections_type,
            header,
            scan,
            sound_speed=self._scenario.sound_speed,
        )
