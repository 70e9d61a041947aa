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
"""A ship that carries the sonar, and a target as it sees it."""

import math
from dataclasses import dataclass

import numpy as np

from support.boat import Boat
from support.sonar_driver import START_NS

SECOND = 10**9
SOUND_SPEED = 1500.0


@dataclass(frozen=True)
class Ship:
    """A ship that goes round in circles, or straight on; times are seconds after the start."""

    speed: float = 0.0
    turn_rate: float = 0.0
    start: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def pose(self, time: float) -> tuple[float, float, float]:
        x, y, yaw = self.start
        # Small steps in place of the circle's formula.
        steps = max(1, math.ceil(abs(time) * 20))
        angles = yaw + self.turn_rate * time * (np.arange(steps) + 0.5) / steps
        x += self.speed * time * float(np.cos(angles).mean())
        y += self.speed * time * float(np.sin(angles).mean())
        return x, y, yaw + self.turn_rate * time


MOVING = Ship(speed=8.0, start=(500.0, -200.0, 0.7))
TURNING = Ship(speed=6.0, turn_rate=math.radians(3.0), start=(-300.0, 400.0, 2.5))
TARGET = (2500.0, -3.0, 1800.0, 4.0)


def publish_poses(boat: Boat, ship: Ship, first: float, last: float, step: float = 4.0) -> None:
    """Publish odometry from `first` to `last`, s after the start."""
    for time in np.arange(first, last + step / 2, step).tolist():
        boat.driver.pose(START_NS + round(time * SECOND), *ship.pose(time))


def seen_from(ship: Ship, time: float, x: float, y: float) -> tuple[float, float]:
    """Range and azimuth of a place for a sensor whose echoes arrive at once."""
    ship_x, ship_y, yaw = ship.pose(time)
    return math.hypot(x - ship_x, y - ship_y), math.atan2(y - ship_y, x - ship_x) - yaw


def echo(
    ship: Ship, time: float, target: tuple[float, float, float, float]
) -> tuple[float, float, float]:
    """Range, azimuth and time of validity of a moving target's echo of a ping sent at `time`."""
    x0, vx, y0, vy = target
    out = back = 0.0
    for _ in range(30):
        hit_x, hit_y = x0 + vx * (time + out), y0 + vy * (time + out)
        sent_x, sent_y, _ = ship.pose(time)
        out = math.hypot(hit_x - sent_x, hit_y - sent_y) / SOUND_SPEED
        got_x, got_y, yaw = ship.pose(time + out + back)
        back = math.hypot(hit_x - got_x, hit_y - got_y) / SOUND_SPEED
    distance = SOUND_SPEED * (out + back) / 2
    return distance, math.atan2(hit_y - got_y, hit_x - got_x) - yaw, distance / SOUND_SPEED


def at(target: tuple[float, float, float, float], time: float) -> tuple[float, float]:
    x, vx, y, vy = target
    return x + vx * time, y + vy * time
