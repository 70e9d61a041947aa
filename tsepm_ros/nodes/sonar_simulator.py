"""The node that stands in for a sonar: simulated detections, own ship and truth."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from typing import Any

import numpy as np
from nav_msgs.msg import Odometry
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2
from visualization_msgs.msg import MarkerArray

from msg_adapters import (
    MessageError,
    OwnShipSample,
    make_header,
    message_class,
    odometry_message,
    seconds_to_ns,
    track_cloud,
    truth_markers,
    truth_tracks,
    write_detections,
)
from tsepm_ros.nodes.node_parameters import AUTO_DECLARE, NodeParameters, ParameterError
from tsepm_ros.nodes.playback import PUBLISHER_DEPTH, Event, Playback
from tsepm_ros.nodes.running import run
from tsepm_ros.sensing.scan import Scan
from tsepm_ros.settings.node_options import SimulatorNodeOptions
from tsepm_ros.settings.tables import SONAR_SIMULATOR
from tsepm_ros.simulation import SimulatedScan, Simulator, load_scenario


class SonarSimulator(Node):
    """Publishes the scans of a scenario as a sonar driver would."""

    def __init__(self, **node_options: Any) -> None:
        super().__init__("sonar_simulator", **AUTO_DECLARE, **node_options)
        options = NodeParameters(self, SONAR_SIMULATOR).made[SimulatorNodeOptions]
        self._options: SimulatorNodeOptions = options
        try:
            self._scenario = load_scenario(options.scenario)
            Simulator(self._scenario, options.seed)  # targets that cannot be drawn are found now
            self._detections_of(0, Scan(0.0, np.zeros(0), np.zeros(0)))
        except MessageError as error:
            raise ParameterError(f"detections_type: {error}") from None
        except ValueError as error:
            raise ParameterError(str(error)) from None
        self._start = options.start_stamp
        if self._start < 0:
            self._start = self.get_clock().now().nanoseconds * 1e-9

        self._detections = self.create_publisher(
            message_class(options.detections_type), "detections", PUBLISHER_DEPTH
        )
        self._own_ship = self.create_publisher(Odometry, "own_ship/odometry", PUBLISHER_DEPTH)
        self._truth = self.create_publisher(PointCloud2, "ground_truth", PUBLISHER_DEPTH)
        self._truth_markers = self.create_publisher(MarkerArray, "ground_truth/markers", 10)
        self._playback = Playback(
            self,
            self._events,
            [self._own_ship, self._detections, self._truth],
            wait_for=self._detections,
            wait_for_subscribers=options.wait_for_subscribers,
            settling_time=options.settling_time,
            rate_factor=options.rate_factor,
            publish_clock=options.publish_clock,
            loop=options.loop,
        )
        self.finished = self._playback.finished

    def _events(self) -> Iterator[Event]:
        """Own-ship poses at their rate; a scan when its last echo is in."""
        step = 1.0 / self._options.own_ship_rate
        samples = 0
        number = self._scenario.scans
        for index, scan in enumerate(Simulator(self._scenario, self._options.seed, self._start)):
            while self._start + (samples - 1) * step < scan.complete:
                stamp = self._start + samples * step
                yield stamp, partial(self._publish_own_ship, stamp)
                samples += 1
            # The pose beyond the last echo has gone out: the own ship is known for all of it.
            due = max(scan.complete, self._start + (samples - 1) * step)
            yield due, partial(self._publish_scan, scan, index + 1, number)

    def _publish_own_ship(self, stamp: float) -> None:
        time = stamp - self._start
        x, y, yaw = self._scenario.own_ship.pose(time)
        vx, vy, yaw_rate = self._scenario.own_ship.rates(time).tolist()
        sample = OwnShipSample(
            stamp_ns=seconds_to_ns(stamp),
            frame_id=self._options.fixed_frame,
            child_frame_id=self._options.sensor_frame,
            x=float(x),
            y=float(y),
            yaw=float(np.remainder(yaw + np.pi, 2 * np.pi) - np.pi),
            vx=vx,
            vy=vy,
            yaw_rate=yaw_rate,
        )
        self._own_ship.publish(odometry_message(sample))

    def _publish_scan(self, simulated: SimulatedScan, index: int, number: int) -> None:
        scan = simulated.scan
        stamp_ns = seconds_to_ns(scan.stamp)
        truth = truth_tracks(scan.stamp, simulated.truth)
        header = make_header(stamp_ns, self._options.fixed_frame)
        self._truth.publish(track_cloud(header, truth))
        self._truth_markers.publish(truth_markers(header, truth))
        self._detections.publish(self._detections_of(stamp_ns, scan))
        self.get_logger().info(f"scan {index} of {number}: {len(scan)} detections")

    def _detections_of(self, stamp_ns: int, scan: Scan) -> Any:
        return write_detections(
            self._options.detections_type,
            make_header(stamp_ns, self._options.sensor_frame),
            range=scan.range,
            azimuth=scan.azimuth,
            sound_speed=self._scenario.sound_speed,
            features=scan.features,
        )


def main(args: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run(SonarSimulator, args)


if __name__ == "__main__":
    raise SystemExit(main())
