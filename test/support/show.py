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
"""A simulator or player at work, and what it plays."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import PointCloud2
from visualization_msgs.msg import MarkerArray

from support.ros_world import World

SECOND = 10**9
FAST = 1e5

SCENARIO = """
scans: 5
period: 4.0
sound_speed: 1500.0
sensor: {range_std: 5.0, range_std_fraction: 0.0, azimuth_std: 0.005, max_range: 3000.0,
         detection_probability: 1.0, clutter_density: 1.0e-6}
own_ship: {x: 100.0, y: -50.0, yaw_deg: 40.0, speed: 5.0, turn_rate_deg: 2.0}
targets:
  - {state: [1500.0, 4.0, 700.0, -3.0]}
  - {state: [-900.0, 0.0, 1200.0, 5.0]}
"""

DETECTIONS = """time_s,range_m,azimuth_rad,intensity
10.0,1000.5,0.25,3
10.0,2000.25,-0.5,4
12.5,1010.125,0.2,5
15.000000001,1020.0,0.125,6
"""

OWN_SHIP = """time_s,east_m,north_m,east_mps,north_mps,heading_rad
10.0,5.0,6.0,1.0,2.0,0.5
12.5,7.5,11.0,1.0,2.0,0.6
20.0,15.0,26.0,1.0,2.0,0.7
"""

TARGET = """time_s,east_m,north_m,east_mps,north_mps,target
10.0,100.0,200.0,3.0,4.0,7
10.0,-100.0,-200.0,0.0,0.0,8
15.0,115.0,220.0,3.0,4.0,7
"""


def fields(message: PointCloud2) -> dict[str, int]:
    return {field.name: field.datatype for field in message.fields}


def heading(message: Odometry) -> float:
    return 2 * math.atan2(message.pose.pose.orientation.z, message.pose.pose.orientation.w)


def write_scenario(folder: Path) -> str:
    """Write the scenario and return its path."""
    path = folder / "scene.yaml"
    path.write_text(SCENARIO)
    return str(path)


def write_recording(folder: Path, **files: str | bytes) -> str:
    """Write a recording of files by name and return its folder."""
    recording = folder / "recording"
    recording.mkdir(exist_ok=True)
    for name, content in files.items():
        data = content if isinstance(content, bytes) else content.encode()
        (recording / f"{name}.csv").write_bytes(data)
    return str(recording)


class Show:
    """A simulator or player whose every message is seen: it begins when told to."""

    def __init__(self, world: World, kind: type, **parameters: Any) -> None:
        self.world = world
        self.detections = world.listen(PointCloud2, "detections")
        self.own_ship = world.listen(Odometry, "own_ship/odometry")
        self.truth = world.listen(PointCloud2, "ground_truth")
        self.markers = world.listen(MarkerArray, "ground_truth/markers")
        self.clock = world.listen(Clock, "/clock")
        given = {"rate_factor": FAST, "settling_time": 0.0, "wait_for_subscribers": 2}
        self.node = world.make(kind, {**given, **parameters})
        world.until_connected()

    @property
    def topics(self) -> list[list[Any]]:
        return [self.detections, self.own_ship, self.truth, self.markers, self.clock]

    def times(self) -> list[int]:
        """Of the clock, ns."""
        return [message.clock.sec * SECOND + message.clock.nanosec for message in self.clock]

    def begin(self) -> None:
        self.world.listen(PointCloud2, "detections")  # the second subscriber

    def play(self) -> Show:
        """Play to the end and take everything."""
        self.begin()
        self.world.until(self.node.finished.done, "the end")
        seen = -1
        while (now := sum(map(len, self.topics))) != seen:  # all is acknowledged, so it is here
            seen = now
            for _ in range(10):
                self.world.spin_once(0.01)
        return self

    @property
    def messages(self) -> list[Any]:
        return [message for topic in self.topics for message in topic]
