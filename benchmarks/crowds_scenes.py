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
"""Scenes of `crowds.py`: boats in a harbour, swimmers in a basin and at a quay, lost targets."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np
from clear_mot import Truth
from clusters_scenes import Swimmers
from fixed_echoes_scenes import Scene, Target, piles

from tsepm_ros import Scan, SensorModel
from tsepm_ros.numerics.arrays import FloatArray

Seen = Iterable[tuple[Scan, Truth]]
Paths = Callable[[np.random.Generator], list[FloatArray]]
"""Draws the states (n, 4) of each target by scans, nan where it is not there."""


def sonar(range_std: float, degrees: float, max_range: float, clutter: float) -> SensorModel:
    """A sensor all round, by its errors and its false detections a scan."""
    sensor = SensorModel(
        range_std=range_std,
        range_std_fraction=0.0,
        azimuth_std=math.radians(degrees),
        max_range=max_range,
    )
    return replace(sensor, clutter_density=clutter / sensor.coverage_area)


HARBOUR, PERIOD = sonar(3.0, 1.0, 400.0, 2.0), 3.0
"""Errors of 3 m, and across 3.5 m at 200 m; a scan in 3 s."""
ROUGH, COARSE = sonar(5.0, 1.4, 400.0, 2.0), sonar(12.0, 3.5, 400.0, 2.0)
BASIN = sonar(0.3, 3.0, 20.0, 3.0)
ENDS = {0.1: (sonar(0.3, 0.5, 100.0, 10.0), 1.0), PERIOD: (HARBOUR, 1.5)}
ENDS |= {12.0: (sonar(30.0, 1.0, 6000.0, 20.0), 5.0)}
"""Sensor, and speed of the target, m/s, by the period, s."""
VANISHES, LATE = 40, 20
"""Scan from which a target is gone; scan in which a second one comes."""
ENTERS = 70
"""Ping in which a swimmer comes to the quay."""


def drawn(
    sensor: SensorModel,
    period: float,
    paths: Sequence[FloatArray],
    rng: np.random.Generator,
    echoes: tuple[int, int] = (1, 1),
    spread: float = 0.0,
) -> Iterator[tuple[Scan, Truth]]:
    """Scans of targets on paths; the echoes of a target are spread over a square (m)."""
    false = sensor.clutter_density * sensor.coverage_area
    for index, states in enumerate(np.stack(paths, axis=1)):
        truth = {target: state for target, state in enumerate(states) if np.isfinite(state[0])}
        seen = [state for state in truth.values() if rng.random() < sensor.detection_probability]
        numbers = rng.integers(echoes[0], echoes[1] + 1, len(seen))
        places = np.repeat(np.reshape(seen, (-1, 4))[:, 0::2], numbers, axis=0)
        x, y = (places + spread * rng.uniform(-0.5, 0.5, places.shape)).T
        error, count = rng.standard_normal((2, len(places))), rng.poisson(false)
        range_ = np.maximum(np.hypot(x, y) + sensor.range_std * error[0], 0.1)
        azimuth = np.arctan2(y, x) + sensor.azimuth_std * error[1]
        far = sensor.max_range * np.sqrt(rng.uniform(1e-4, 1.0, count))
        every = np.append(azimuth, rng.uniform(-math.pi, math.pi, count))
        yield Scan(period * index, np.append(range_, far), every), truth


def boats(sensor: SensorModel, paths: Paths, rng: np.random.Generator) -> Seen:
    """Scans of boats in the harbour."""
    return drawn(sensor, PERIOD, paths(rng), rng)


def path(places: FloatArray, period: float = PERIOD) -> FloatArray:
    """States (n, 4) of a target from its places (n, 2)."""
    velocity = np.gradient(places, period, axis=0)
    return np.stack([places[:, 0], velocity[:, 0], places[:, 1], velocity[:, 1]], axis=1)


def course(
    rng: np.random.Generator, scans: int, speed: float, period: float = PERIOD, away: float = 200.0
) -> tuple[FloatArray, FloatArray]:
    """Places (n, 2) on a straight course, and the unit vector across it; its middle is `away`."""
    bearing, heading = rng.uniform(-math.pi, math.pi, 2)
    ahead = np.array([math.cos(heading), math.sin(heading)])
    middle = away * np.array([math.cos(bearing), math.sin(bearing)])
    passed = period * (np.arange(scans) - scans // 2)
    return middle + speed * passed[:, None] * ahead, np.array([-ahead[1], ahead[0]])


def alone(speed: float) -> Paths:
    """A single boat, by its speed."""
    return lambda rng: [path(course(rng, 60, speed)[0])]


def together(rng: np.random.Generator) -> list[FloatArray]:
    """Two boats: they converge, are 12 m apart for 30 scans, and part again."""
    places, across = course(rng, 60, 1.5)
    apart = np.interp(np.arange(60), [5, 15, 44, 54], [120.0, 12.0, 12.0, 120.0])
    half = 0.5 * apart[:, None] * across
    return [path(places + half), path(places - half)]


def joined(apart: float) -> Paths:
    """A boat, and from scan 20 on a second one beside it."""

    def paths(rng: np.random.Generator) -> list[FloatArray]:
        places, across = course(rng, 40, 1.5)
        late = path(places + apart * across)
        late[:LATE] = np.nan
        return [path(places), late]

    return paths


def abreast(rng: np.random.Generator) -> list[FloatArray]:
    """Three boats, each 15 to 30 m beside the next."""
    places, across = course(rng, 70, 1.5)
    beside = np.cumsum(rng.uniform(15.0, 30.0, 3))
    return [path(places + distance * across) for distance in beside - beside[1]]


def crossing(rng: np.random.Generator) -> list[FloatArray]:
    """Three boats that meet, within 5 m, on courses 36 to 84 degrees apart."""
    places, _ = course(rng, 70, 1.5)
    found = []
    for turn in np.radians(np.array([0.0, 60.0, 120.0]) + rng.uniform(-12.0, 12.0, 3)):
        c, s = math.cos(turn), math.sin(turn)
        way = (places - places[35]) @ np.array([[c, s], [-s, c]])
        found.append(path(places[35] + rng.uniform(-5.0, 5.0, 2) + way))
    return found


def vanishing(period: float, rng: np.random.Generator) -> Seen:
    """Scans of a target that is gone from scan `VANISHES` on."""
    sensor, speed = ENDS[period]
    gone = path(course(rng, VANISHES + 70, speed, period, 0.5 * sensor.max_range)[0], period)
    gone[VANISHES:] = np.nan
    return drawn(sensor, period, [gone], rng)


def basin(rng: np.random.Generator) -> Seen:
    """Five swimmers, of 2 to 4 echoes, in a basin of 12 m by 10 m, who turn at its walls."""
    time, size = PERIOD * np.arange(80)[:, None], np.array([12.0, 10.0])
    paths = []
    for _ in range(5):
        speed, heading = rng.uniform(0.2, 0.6), rng.uniform(-math.pi, math.pi)
        velocity = speed * np.array([math.cos(heading), math.sin(heading)])
        way = (size * rng.random(2) + time * velocity) % (2.0 * size)
        paths.append(path(size - np.abs(size - way) + [2.0, -5.0]))
    return drawn(BASIN, PERIOD, paths, rng, (2, 4), 0.8)


def swimmers(scene: Swimmers, rng: np.random.Generator) -> Seen:
    """Scans of swimmers or of a vessel, of several echoes."""
    pings = scene.draw(int(rng.integers(2**31)))
    return ((ping.scan, dict(enumerate(ping.truth))) for ping in pings)


def moored(rng: np.random.Generator) -> list[Target]:
    """Fifteen boats moored along the quay."""
    return [replace(pile, detection_probability=None) for pile in piles(rng, 15)]


def at_quay(scene: Scene, fixed: Callable[..., list[Target]], rng: np.random.Generator) -> Seen:
    """Scans of what is fixed at a quay, and of a swimmer 10 m off it."""
    swims = Target((150.0 - 0.3 * 60.0 - 10.5, -57.2), (0.3, 0.954), ENTERS)
    targets = [*fixed(rng), swims]
    for number, ping in enumerate(replace(scene, targets=targets).draw(rng)):
        if number >= ENTERS:
            (x, y), (vx, vy) = ping.truth[-1], swims.velocity
            yield ping.scan, {0: np.array([x, vx, y, vy])}
        else:
            rows = ping.origin != len(targets) - 1
            yield Scan(ping.scan.stamp, ping.scan.range[rows], ping.scan.azimuth[rows]), {}
