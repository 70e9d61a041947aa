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
"""Scenes of the part `groups` of `crowds.py`: targets that hide each other, and hard cases."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from clear_mot import Truth

from tsepm_ros import Scan, SensorModel
from tsepm_ros.numerics.arrays import FloatArray

Seen = Iterator[tuple[Scan, Truth]]
GRAVITY = 9.81
"""m/s^2."""


@dataclass(frozen=True)
class Group:
    """A scene.

    Attributes
    ----------
    sensor : SensorModel
        As a tracker is told.
    max_speed : float
        m/s.
    gate : float
        Distance up to which a track is a target's, m.
    process_noise : float
        That fits the targets, m^2/s^3.
    draw : callable
        Draws the scans and their truth.
    """

    sensor: SensorModel
    max_speed: float
    gate: float
    process_noise: float
    draw: Callable[[SensorModel, np.random.Generator], Seen]


def sonar(range_std: float, degrees: float, max_range: float, half: float = 180.0) -> SensorModel:
    """A sensor by its errors and half of its sector, degrees."""
    return SensorModel(
        range_std=range_std,
        range_std_fraction=0.0,
        azimuth_std=math.radians(degrees),
        max_range=max_range,
        azimuth_min=-math.radians(half),
        azimuth_max=math.radians(half),
    )


def unit(angle: float) -> FloatArray:
    """A unit vector."""
    return np.array([math.cos(angle), math.sin(angle)])


def covered(sensor: SensorModel, places: FloatArray) -> FloatArray:
    """Which places (n, 2) are in the coverage."""
    bearing = np.abs(np.arctan2(places[:, 1], places[:, 0]))
    return (bearing < sensor.azimuth_max) & (np.hypot(*places.T) < sensor.max_range)


def ping(
    sensor: SensorModel,
    rng: np.random.Generator,
    stamp: float,
    places: Sequence[FloatArray],
    false: float,
    probability: float = 0.9,
    sector: tuple[float, float, float] | None = None,
) -> Scan:
    """A scan of targets, the echoes (n, 2) of each, and of false detections, as many in the mean.

    A sector has a middle and a width, rad, and so many false detections more.
    """
    seen = [target for target in places if rng.random() < probability]
    x, y = np.concatenate([np.zeros((0, 2)), *map(np.atleast_2d, seen)]).T
    error = rng.standard_normal((2, len(x)))
    range_ = np.hypot(x, y) + sensor.range_std * error[0]
    azimuth = np.arctan2(y, x) + sensor.azimuth_std * error[1]
    ends = [(sensor.azimuth_min, sensor.azimuth_max, false)]
    if sector is not None:
        middle, width, more = sector
        ends.append((middle - 0.5 * width, middle + 0.5 * width, more))
    for low, high, number in ends:
        count = rng.poisson(number)
        range_ = np.append(range_, sensor.max_range * np.sqrt(rng.random(count)))
        azimuth = np.append(azimuth, rng.uniform(low, high, count))
    if sensor.azimuth_max < 3.0:
        azimuth = np.clip(azimuth, sensor.azimuth_min, sensor.azimuth_max)
    kept = (range_ > 0.05) & (range_ <= sensor.max_range)
    return Scan(stamp, range_[kept], azimuth[kept])


def states(places: FloatArray, velocities: FloatArray) -> Truth:
    """The truth of targets, by their numbers."""
    both = np.stack(np.broadcast_arrays(places, velocities), axis=2)
    return dict(enumerate(both.reshape(-1, 4)))


def school(sensor: SensorModel, rng: np.random.Generator) -> Seen:
    """Thirty fish, 8 Hz: a common course, and velocities of their own that last 2 s."""
    period, number = 0.125, 30
    x = rng.uniform(3.0, 8.0, number)
    places = np.stack([x, x * np.tan(np.radians(rng.uniform(-9.0, 9.0, number)))], axis=1)
    course, own = 0.15 * unit(rng.uniform(0.0, 2.0 * math.pi)), np.zeros((number, 2))
    for k in range(120):
        own += -0.5 * period * own + 0.15 * math.sqrt(period) * rng.standard_normal((number, 2))
        places = places + period * (course + own)
        inside = covered(sensor, places)
        truth = {n: s for n, s in states(places, course + own).items() if inside[n]}
        yield ping(sensor, rng, period * k, list(places[inside]), 5.0), truth


def divers(sensor: SensorModel, rng: np.random.Generator) -> Seen:
    """Two divers 1.5 m apart, 5 Hz; one stops after 12 s."""
    y, velocity = rng.uniform(-8.0, 8.0), np.array([[0.5, 0.1], [0.5, 0.1]])
    places = np.array([[18.0, y], [18.0, y + 1.5]])
    for k in range(160):
        velocity[1] *= k != 60
        places = places + 0.2 * velocity
        yield ping(sensor, rng, 0.2 * k, list(places), 10.0), states(places, velocity)


def boat(sensor: SensorModel, rng: np.random.Generator) -> Seen:
    """A boat at 15 m/s that turns at 0.3 g for 16 of 36 s, to one side or the other."""
    place = np.array([rng.uniform(-500.0, 500.0), rng.uniform(400.0, 900.0)])
    heading, speed, side = rng.uniform(0.0, 2.0 * math.pi), 15.0, 1.0
    for k in range(100):
        phase = 2.0 * k % 36.0
        for _ in range(10):
            heading += 0.2 * side * (phase >= 20.0) * 0.3 * GRAVITY / speed
            place = place + 0.2 * speed * unit(heading)
        if phase + 2.0 >= 36.0 and rng.random() < 0.5:
            side = -side
        if np.hypot(*place) > 1700.0:
            heading = math.atan2(-place[1], -place[0])
        truth = states(place[None], speed * unit(heading)[None])
        yield ping(sensor, rng, 2.0 * k, [place], 35.0), truth


def convoy(sensor: SensorModel, rng: np.random.Generator) -> Seen:
    """Five boats in line, 60 m apart, at 6 m/s."""
    ahead = unit(rng.uniform(0.0, 2.0 * math.pi))
    across = rng.uniform(500.0, 900.0) * rng.choice([-1.0, 1.0]) * np.array([-ahead[1], ahead[0]])
    for k in range(80):
        way = 15.0 * k - 600.0 - 60.0 * np.arange(5)
        places = across + way[:, None] * ahead
        truth = states(places, 6.0 * ahead)
        yield ping(sensor, rng, 2.5 * k, list(places), 15.0), truth


def buoys(sensor: SensorModel, rng: np.random.Generator) -> Seen:
    """Twenty buoys (P_D 0.8) and a boat at 2 m/s between them."""
    fixed: list[FloatArray] = []
    while len(fixed) < 20:
        place = np.array([rng.uniform(80.0, 260.0), rng.uniform(-100.0, 100.0)])
        apart = [np.hypot(*(place - other)) for other in fixed]
        if min(apart, default=math.inf) > 25.0 and abs(math.atan2(*place[::-1])) < 1.0:
            fixed.append(place)
    place = np.array([rng.uniform(120.0, 220.0), -110.0])
    velocity = np.array([rng.uniform(-0.3, 0.3), 2.0])
    for k in range(110):
        place = place + velocity
        seen = [buoy for buoy in fixed if rng.random() < 0.8 / 0.9]
        truth = states(np.array([place, *fixed]), np.array([velocity, *np.zeros((20, 2))]))
        yield ping(sensor, rng, float(k), [place, *seen], 8.0), truth


def faint(sensor: SensorModel, rng: np.random.Generator) -> Seen:
    """A target at 1 m/s that is detected with 0.4."""
    place = np.array([rng.uniform(120.0, 200.0), rng.uniform(-60.0, 60.0)])
    velocity = unit(rng.uniform(0.0, 2.0 * math.pi))
    for k in range(150):
        place = place + velocity
        bearing = abs(math.atan2(place[1], place[0]))
        if not 60.0 <= np.hypot(*place) <= 270.0 or bearing > 0.95:
            velocity = -velocity
        truth = states(place[None], velocity[None])
        yield ping(sensor, rng, float(k), [place], 8.0, probability=0.4), truth


def turned_back(
    places: FloatArray, velocities: FloatArray, limit: float, bearing: float
) -> FloatArray:
    """Velocities (n, 2), those reversed of targets that leave a range (m) or a bearing (rad)."""
    beyond = np.hypot(*places.T) > limit
    beyond |= np.abs(np.arctan2(places[:, 1], places[:, 0])) > bearing
    leaves = beyond & ((places * velocities).sum(axis=1) > 0.0)
    return np.where(leaves[:, None], -velocities, velocities)


def sector(sensor: SensorModel, rng: np.random.Generator) -> Seen:
    """Three targets at 2 m/s, and a sector of 36 degrees of dense clutter that turns."""
    places, velocities = (
        np.array([scale * unit(angle) for scale, angle in zip(scales, angles, strict=True)])
        for scales, angles in (
            (rng.uniform(80.0, 200.0, 3), rng.uniform(0.0, 2.0 * math.pi, 3)),
            (np.full(3, 2.0), rng.uniform(0.0, 2.0 * math.pi, 3)),
        )
    )
    for k in range(150):
        places = places + velocities
        velocities = turned_back(places, velocities, 270.0, math.inf)
        dense = math.radians(2.0 * k), math.radians(36.0), 12.0
        scan = ping(sensor, rng, float(k), list(places), 12.0, sector=dense)
        yield scan, states(places, velocities)


def vessel(sensor: SensorModel, rng: np.random.Generator) -> Seen:
    """A vessel of 20 m at 1.5 m/s, of one to eight echoes along its hull."""
    place = np.array([rng.uniform(120.0, 200.0), rng.uniform(-80.0, -20.0)])
    ahead = unit(rng.uniform(0.6, 2.5))
    for k in range(110):
        place = place + 1.5 * ahead
        along = rng.uniform(-10.0, 10.0, rng.integers(1, 9))
        echoes = place + along[:, None] * ahead
        scan = ping(sensor, rng, float(k), [echoes], 10.0, probability=0.95)
        yield scan, states(place[None], 1.5 * ahead[None])


def jumps(sensor: SensorModel, rng: np.random.Generator) -> Seen:
    """Two slow targets; scans are 0.2 or 3 s apart."""
    stamp, low = 0.0, np.array([[80.0, -60.0], [80.0, 0.0]])
    places = rng.uniform(low, low + 60.0)
    velocities = rng.uniform(-0.4, 0.4, (2, 2))
    for _ in range(150):
        step = rng.choice([0.2, 3.0])
        stamp, places = stamp + step, places + step * velocities
        velocities = turned_back(places, velocities, 180.0, 0.95)
        yield ping(sensor, rng, stamp, list(places), 10.0), states(places, velocities)


GROUPS = {
    "school of 30 fish": Group(sonar(0.02, 0.3, 10.0, 14.0), 1.5, 0.25, 0.02, school),
    "two divers": Group(sonar(0.05, 0.5, 50.0, 60.0), 2.0, 0.75, 0.02, divers),
    "boat that turns": Group(sonar(8.0, 1.0, 2000.0), 20.0, 60.0, 1.5, boat),
    "convoy of five": Group(sonar(8.0, 1.0, 2000.0), 12.0, 30.0, 0.05, convoy),
    "boat among buoys": Group(sonar(1.0, 0.8, 300.0, 60.0), 8.0, 10.0, 0.05, buoys),
    "P_D 0.4": Group(sonar(1.0, 0.8, 300.0, 60.0), 6.0, 10.0, 0.02, faint),
    "dense sector": Group(sonar(1.0, 1.0, 300.0), 6.0, 12.0, 0.02, sector),
    "vessel of 20 m": Group(sonar(0.5, 0.5, 300.0, 60.0), 8.0, 14.0, 0.05, vessel),
    "jumping intervals": Group(sonar(0.5, 0.8, 200.0, 60.0), 5.0, 8.0, 0.02, jumps),
}
