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
"""Scenes for fixed echoes: reflectors and swimmers before a forward-looking sonar."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from tsepm_ros import Scan, SensorModel

HALF_SECTOR = math.radians(60.0)
MAX_RANGE = 300.0
RANGE_STD, AZIMUTH_STD = 0.5, math.radians(1.0)
APART = 25.0
"""Least distance between reflectors, m."""


@dataclass(frozen=True)
class Target:
    """Something seen: where it is first, and how it moves from when on.

    Attributes
    ----------
    place : tuple of float
        m.
    velocity : tuple of float
        m/s.
    sets_off : float
        Stamp until which it stands still, s.
    detection_probability : float or None
        None for that of the scene.
    """

    place: tuple[float, float]
    velocity: tuple[float, float] = (0.0, 0.0)
    sets_off: float = 0.0
    detection_probability: float | None = None

    def at(self, stamp: float) -> NDArray[np.float64]:
        """Position at a stamp (s), (2,), m."""
        moving = max(stamp - self.sets_off, 0.0)
        return np.asarray(self.place) + moving * np.asarray(self.velocity)


@dataclass(frozen=True, eq=False)
class Ping:
    """A scan, the target of each detection (-1: clutter), and the targets' positions."""

    scan: Scan
    origin: NDArray[np.int64]
    truth: NDArray[np.float64]


@dataclass(frozen=True)
class Scene:
    """What the sonar sees.

    Attributes
    ----------
    targets : list of Target
    detection_probability : float
    false : float
        False detections a ping.
    pings : int
        1 s apart.
    heading_std : float
        Error of the own heading, common to a ping and known, rad.
    position_std : float
        Error of the own position, likewise, m.
    pose_memory : float
        Time for which these errors last, s; 0: each ping has its own.
    speed : float
        Of the sonar's vessel, m/s, along x.
    echo_std : tuple of float
        Range and azimuth errors that targets really have, in units of the stated.
    glints : float
        Echoes a ping at random places of the `quay`.
    """

    targets: list[Target] = field(default_factory=list)
    detection_probability: float = 0.9
    false: float = 20.0
    pings: int = 120
    heading_std: float = 0.0
    position_std: float = 0.0
    pose_memory: float = 0.0
    speed: float = 0.0
    echo_std: tuple[float, float] = (1.0, 1.0)
    glints: float = 0.0

    @property
    def sensor(self) -> SensorModel:
        """The forward-looking sonar: 120 degrees, 300 m, 0.5 m and 1 degree."""
        return SensorModel(
            range_std=RANGE_STD,
            range_std_fraction=0.0,
            azimuth_std=AZIMUTH_STD,
            max_range=MAX_RANGE,
            azimuth_min=-HALF_SECTOR,
            azimuth_max=HALF_SECTOR,
            detection_probability=self.detection_probability,
        )

    def draw(self, rng: np.random.Generator) -> Iterator[Ping]:
        """Draw the pings."""
        spread = np.array([self.position_std, self.position_std, self.heading_std])
        keep = math.exp(-1.0 / self.pose_memory) if self.pose_memory else 0.0
        error = spread * rng.standard_normal(3)
        for stamp in range(self.pings):
            pose = np.array([self.speed * stamp, 0.0, 0.0])
            fresh = spread * rng.standard_normal(3)
            error = keep * error + math.sqrt(1.0 - keep**2) * fresh
            count = rng.poisson(self.false)
            parts = [
                (
                    MAX_RANGE * np.sqrt(rng.random(count)),
                    rng.uniform(-HALF_SECTOR, HALF_SECTOR, count),
                    np.full(count, -1),
                )
            ]
            truth = np.array([target.at(stamp) for target in self.targets]).reshape(-1, 2)
            glints = rng.poisson(self.glints) if self.glints else 0
            places = np.concatenate([truth, quay(rng, glints)])
            for number, place in enumerate(places):
                x, y = place - pose[:2]
                seen = np.array([math.hypot(x, y), math.atan2(y, x)])
                seen += rng.standard_normal(2) * self.echo_std * np.array([RANGE_STD, AZIMUTH_STD])
                target = self.targets[number] if number < len(truth) else None
                if target is None:
                    shown = bool(self.sensor.covers(seen[:1], seen[1:])[0])
                else:
                    probability = target.detection_probability
                    shown = rng.random() < (
                        self.detection_probability if probability is None else probability
                    )
                if shown:
                    parts.append((seen[:1], seen[1:], np.array([-1 if target is None else number])))
            range_, azimuth, origin = map(np.concatenate, zip(*parts, strict=True))
            order = rng.permutation(len(range_))
            covariance = None
            if self.position_std or self.heading_std:
                covariance = np.diag([self.position_std] * 2 + [self.heading_std]) ** 2
            scan = Scan(
                float(stamp),
                np.maximum(range_[order], 0.1),
                azimuth[order],
                sensor_pose=pose + error,
                sensor_pose_covariance=covariance,
            )
            yield Ping(scan, origin[order], truth)


def quay(rng: np.random.Generator, number: int) -> NDArray[np.float64]:
    """Random places on a quay of 300 m, 150 m ahead and oblique, (n, 2), m."""
    along = rng.uniform(-150.0, 150.0, number)
    return np.stack([150.0 + 0.3 * along, math.sqrt(1.0 - 0.3**2) * along], axis=1)


def piles(rng: np.random.Generator, number: int = 45) -> list[Target]:
    """Piles of the quay, each seen in a share of the pings of its own, 0.05 to 0.5."""
    shares = rng.uniform(0.05, 0.5, number)
    places = quay(rng, number)
    return [
        Target((float(x), float(y)), detection_probability=float(share))
        for (x, y), share in zip(places, shares, strict=True)
    ]


def reflectors(rng: np.random.Generator, number: int = 5) -> list[Target]:
    """Fixed reflectors 50 to 290 m away, in the sector, none close to another."""
    places: list[tuple[float, float]] = []
    while len(places) < number:
        distance, bearing = rng.uniform(50.0, 290.0), 0.9 * HALF_SECTOR * rng.uniform(-1.0, 1.0)
        place = distance * math.cos(bearing), distance * math.sin(bearing)
        if all(math.dist(place, other) > APART for other in places):
            places.append(place)
    return [Target(place) for place in places]


def swimmer(rng: np.random.Generator, course: str, speed: float = 1.0) -> Target:
    """A swimmer that begins 100 to 190 m away.

    Parameters
    ----------
    rng : numpy.random.Generator
    course : {"radial", "tangential", "any"}
    speed : float, optional
        m/s.
    """
    distance, bearing = rng.uniform(100.0, 190.0), 0.6 * HALF_SECTOR * rng.uniform(-0.8, 0.8)
    turn = {
        "radial": math.pi * rng.integers(2),
        "tangential": math.pi * (rng.integers(2) + 0.5),
        "any": rng.uniform(0.0, 2.0 * math.pi),
    }[course]
    heading = bearing + turn
    return Target(
        (distance * math.cos(bearing), distance * math.sin(bearing)),
        (speed * math.cos(heading), speed * math.sin(heading)),
    )
