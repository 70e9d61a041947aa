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
"""A vessel under way with two imaging sonars and a radar, as messages by the time of arrival."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from nav_msgs.msg import Odometry

from support.sonar_driver import cloud

SENSORS = ("port", "starboard", "radar")
RATES = {"port": 8.0, "starboard": 5.0, "radar": 0.5}
YAW = {"port": 1.0, "starboard": -1.0, "radar": 0.0}
PARAMETERS = {
    "sensors": list(SENSORS),
    "own_ship_source": "odometry",
    "max_speed": 3.0,
    "sweep": "off",
    "sensor.range_std": 0.2,
    "sensor.range_std_fraction": 0.0,
    "sensor.azimuth_std": 0.01,
    "sensor.max_range": 60.0,
    "sensor.azimuth_min": -1.1,
    "sensor.azimuth_max": 1.1,
    "port.mounting.yaw": YAW["port"],
    "starboard.mounting.yaw": YAW["starboard"],
    "radar.sensor.max_range": 200.0,
    "radar.sensor.azimuth_min": -3.1416,
    "radar.sensor.azimuth_max": 3.1416,
    "radar.sensor.range_std": 1.0,
}
TARGETS = ((40.0, 0.6, 12.0, -0.3), (35.0, 0.9, -14.0, 0.2), (30.0, 1.2, 1.0, 0.0))
"""x, vx, y, vy at time 0, m and m/s; the vessel goes along x at 1 m/s."""
START = 1_700_000_000
SECOND = 10**9


@dataclass
class Vessel:
    """Messages by the time of arrival, s after the start.

    Attributes
    ----------
    late : mapping of str to float
        Time from a stamp to the arrival of the scan of each sensor, s.
    silent : mapping of str to (float, float)
        When a sensor sends nothing, s.
    back : float
        Time by which the clock of all is set back, s, at half of the time.
    seed : int
    again : float
        Time after which the targets are where they were at the start, s.
    """

    late: Mapping[str, float] = field(default_factory=dict)
    silent: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    back: float = 0.0
    seed: int = 1
    again: float = math.inf

    def messages(self, duration: float, begin: float = -1.0) -> Iterator[tuple[float, str, Any]]:
        """Time on the clock of all, s, the sensor's name (empty: odometry), and the message.

        Only those that arrive from a time on, s.
        """
        rng = np.random.default_rng(self.seed)
        events = []
        for name, rate in RATES.items():
            first, end = self.silent.get(name, (math.inf, math.inf))
            for stamp in (np.arange(int(duration * rate)) / rate + 0.013).tolist():
                if not first <= stamp < end:
                    events.append((stamp + self.late.get(name, 0.02), stamp, name))
        events += [(stamp + 0.001, stamp, "") for stamp in np.arange(-0.5, duration, 0.2).tolist()]
        for arrival, stamp, name in sorted(events):
            shift = self.back if stamp >= 0.5 * duration else 0.0
            made = self._scan(name, stamp, shift, rng) if name else _pose(stamp, shift)
            if arrival >= begin:
                yield arrival - (self.back if arrival >= 0.5 * duration else 0.0), name, made

    def _scan(self, name: str, stamp: float, shift: float, rng: np.random.Generator) -> Any:
        reach, sector = (200.0, math.pi) if name == "radar" else (60.0, 1.1)
        number = rng.poisson(2.0)
        distance = np.append(reach * np.sqrt(rng.uniform(0.01, 1.0, number)), 0.4 * reach)
        azimuth = np.append(rng.uniform(-sector, sector, number), 0.9 * sector)
        for x, vx, y, vy in TARGETS:
            since = stamp % self.again
            ahead, port = x + (vx - 1.0) * since, y + vy * since
            away = math.hypot(ahead, port)
            angle = (math.atan2(port, ahead) - YAW[name] + math.pi) % (2 * math.pi) - math.pi
            if away < reach and abs(angle) < sector and rng.random() < 0.9:
                error = 1.0 if name == "radar" else 0.2
                distance = np.append(distance, away + error * rng.standard_normal())
                azimuth = np.append(azimuth, angle + 0.01 * rng.standard_normal())
        columns = {
            "range": distance,
            "azimuth": np.clip(azimuth, -sector, sector),
            "time_offset": np.zeros(len(distance)),
        }
        return cloud(_ns(stamp - shift), columns, frame_id=name)


def _ns(stamp: float) -> int:
    return START * SECOND + round(stamp * SECOND)


def _pose(stamp: float, shift: float) -> Odometry:
    message = Odometry(child_frame_id="vessel")
    message.header.frame_id = "odom"
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(_ns(stamp - shift), SECOND)
    message.pose.pose.position.x = stamp
    message.pose.pose.orientation.w = 1.0
    return message
