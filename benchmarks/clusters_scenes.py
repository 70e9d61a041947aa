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
"""Scenes for clusters: swimmers of several echoes, and the paper's box with lumpy clutter."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tsepm_ros import Scan, SensorModel

HALF_SECTOR = math.radians(60.0)
MAX_RANGE = 300.0
AREA = HALF_SECTOR * MAX_RANGE**2
RANGE_STD, AZIMUTH_STD = 0.5, math.radians(1.0)
CLUTTER = -1
"""Origin of a false detection."""
BOX = 2000.0, 8000.0
GRID = 120
"""Cells along a side of the box on which the density of lumpy clutter is drawn: 50 m each."""
LUMP = 500.0
"""Scale of lumpy clutter, m."""
LOG_STD = math.sqrt(math.log(1.0 + 3.0**2))
"""Of a log-normal density whose standard deviation is three times its mean."""


@dataclass(frozen=True, eq=False)
class Ping:
    """A scan with its truth: the target of each detection, and the targets' states (k, 4)."""

    scan: Scan
    origin: NDArray[np.int64]
    truth: NDArray[np.float64]


@dataclass(frozen=True)
class Swimmers:
    """What the scene is like.

    Attributes
    ----------
    echoes : tuple of int
        Fewest and most echoes of a swimmer in a ping that detects it.
    spread : float
        Diameter of the disc over which they are spread, m; one echo comes from its middle.
    common : bool
        Whether the errors are common to the echoes of a ping, or each echo's own.
    apart : tuple of float, optional
        Where a second swimmer is, seen from the first, m.
    extent : float
        Length of the targets along their course, m: above 0, the echoes of a ping are anywhere
        along it, each with errors of its own.
    speed : float
        m/s.
    false : float
        False detections a ping.
    pings : int
    """

    echoes: tuple[int, int] = (3, 5)
    spread: float = 1.0
    common: bool = True
    apart: tuple[float, float] | None = None
    extent: float = 0.0
    speed: float = 1.0
    false: float = 20.0
    pings: int = 40

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
            clutter_density=self.false / AREA,
        )

    def draw(self, seed: int) -> Iterator[Ping]:
        """Draw the pings, 1 s apart; the swimmers begin 100 to 190 m away, at 1 m/s."""
        rng = np.random.default_rng([seed, 7])
        # With one echo or more, a seed sees the swimmers in the same pings, with the same common
        # errors.
        echo_rng = np.random.default_rng([seed, 8])
        distance, bearing = rng.uniform(100.0, 190.0), 0.6 * HALF_SECTOR * rng.uniform(-0.8, 0.8)
        heading = rng.uniform(0.0, 2.0 * np.pi)
        velocity = self.speed * np.array([math.cos(heading), math.sin(heading)])
        places = [distance * np.array([math.cos(bearing), math.sin(bearing)])]
        if self.apart is not None:
            places.append(places[0] + self.apart)
        for stamp in range(self.pings):
            count = rng.poisson(self.false)
            parts = [
                (
                    MAX_RANGE * np.sqrt(rng.random(count)),
                    rng.uniform(-HALF_SECTOR, HALF_SECTOR, count),
                    np.full(count, CLUTTER),
                )
            ]
            for target, place in enumerate(places):
                error = rng.standard_normal(2)
                if rng.random() < 0.9:
                    parts.append(
                        self._echoes(echo_rng, place + stamp * velocity, velocity, target, error)
                    )
            range_, azimuth, origin = map(np.concatenate, zip(*parts, strict=True))
            order = rng.permutation(len(range_))
            yield Ping(
                Scan(float(stamp), np.maximum(range_[order], 0.1), azimuth[order]),
                origin[order],
                np.array([[x, velocity[0], y, velocity[1]] for x, y in places])
                + stamp * np.array([velocity[0], 0.0, velocity[1], 0.0]),
            )

    def _echoes(
        self,
        rng: np.random.Generator,
        place: NDArray[np.float64],
        velocity: NDArray[np.float64],
        target: int,
        error: NDArray[np.float64],
    ) -> tuple[NDArray, NDArray, NDArray]:
        number = int(rng.integers(self.echoes[0], self.echoes[1] + 1))
        if self.extent:
            along = self.extent * (rng.random(number) - 0.5) / self.speed
            x, y = place[:, None] + along * velocity[:, None]
            return self._measured(x, y, rng.standard_normal((2, number)), target)
        away = 0.5 * self.spread * np.sqrt(rng.random(number)) * (number > 1)
        angle = rng.uniform(0.0, 2.0 * np.pi, number)
        x, y = place[:, None] + away * np.array([np.cos(angle), np.sin(angle)])
        errors = error[:, None] if self.common else rng.standard_normal((2, number))
        return self._measured(x, y, errors, target)

    def _measured(
        self, x: NDArray[np.float64], y: NDArray[np.float64], errors: NDArray, target: int
    ) -> tuple[NDArray, NDArray, NDArray]:
        return (
            np.hypot(x, y) + RANGE_STD * errors[0],
            np.arctan2(y, x) + AZIMUTH_STD * errors[1],
            np.full(len(x), target),
        )


@dataclass(frozen=True)
class Pool:
    """Swimmers around a fast imaging sonar: 100 m all round, 20 pings a second.

    Attributes
    ----------
    swimmers : int
        Anywhere within 60 m on each axis, with up to 1 m/s on each.
    echoes : int
        Of a swimmer in a ping that detects it, over 1.2 m on each axis; 1: from its middle.
    false : float
        False detections a ping.
    pings : int
    enter : int
        Pings before the first in which a swimmer is detected.
    """

    swimmers: int = 5
    echoes: int = 3
    false: float = 16.0
    pings: int = 240
    enter: int = 0

    @property
    def sensor(self) -> SensorModel:
        """Errors of 0.2 m and 0.01 rad."""
        return SensorModel(max_range=100.0, range_std=0.2, range_std_fraction=0.0, azimuth_std=0.01)

    def draw(self, seed: int) -> Iterator[Ping]:
        """Draw the pings."""
        rng = np.random.default_rng([seed, 9])
        place = rng.uniform(-60.0, 60.0, (self.swimmers, 2))
        velocity = rng.uniform(-1.0, 1.0, (self.swimmers, 2))
        for number in range(self.pings):
            now = place + 0.05 * number * velocity
            detected = (rng.random(self.swimmers) < 0.9) & (number >= self.enter)
            seen = np.repeat(np.flatnonzero(detected), self.echoes)
            x, y = (now[seen] + rng.uniform(-0.6, 0.6, (len(seen), 2)) * (self.echoes > 1)).T
            count = rng.poisson(self.false)
            error = rng.standard_normal((2, len(seen)))
            range_ = np.append(
                np.hypot(x, y) + 0.2 * error[0], 100.0 * np.sqrt(rng.uniform(1e-4, 1.0, count))
            )
            azimuth = np.append(
                np.arctan2(y, x) + 0.01 * error[1], rng.uniform(-np.pi, np.pi, count)
            )
            origin = np.append(seen, np.full(count, CLUTTER))
            truth = np.stack([now[:, 0], velocity[:, 0], now[:, 1], velocity[:, 1]], axis=1)
            yield Ping(Scan(0.05 * number, np.maximum(range_, 0.1), azimuth), origin, truth)


def densities(kind: str, rng: np.random.Generator) -> NDArray[np.float64]:
    """Clutter of the box by cells of 50 m, of mean 1, (120, 120).

    Parameters
    ----------
    kind : str
        `uniform`; else log-normal of three times its mean in standard deviation, on 500 m:
        `smooth` (Gaussian covariance of the logarithm), `rough` (exponential), or `blocks` of
        500 m, each with a density of its own.
    rng : numpy.random.Generator
    """
    if kind == "uniform":
        return np.ones((GRID, GRID))
    cell = (BOX[1] - BOX[0]) / GRID
    if kind == "blocks":
        side = round(LUMP / cell)
        field = np.kron(rng.standard_normal((GRID // side, GRID // side)), np.ones((side, side)))
    else:
        wave = 2.0 * np.pi * np.fft.fftfreq(2 * GRID, cell)
        square = (wave[:, None] ** 2 + wave**2) * LUMP**2
        spectrum = np.exp(-square / 4.0) if kind == "smooth" else (1.0 + square) ** -0.75
        white = np.fft.fft2(rng.standard_normal((2 * GRID, 2 * GRID)))
        field = np.fft.ifft2(white * spectrum).real
        field = ((field - field.mean()) / field.std())[:GRID, :GRID]
    density = np.exp(LOG_STD * field)
    return density / density.mean()


def box(kind: str, pings: int, seed: int, redrawn: int = 1000) -> Iterator[Scan]:
    """Pings of the paper's box: 36 false detections and a target at 5 m/s, 12 s apart.

    The density is drawn again every `redrawn` pings; the target begins again every 16.
    """
    rng = np.random.default_rng([seed, 11])
    sensor = SensorModel()
    cell = (BOX[1] - BOX[0]) / GRID
    for ping in range(pings):
        if ping % redrawn == 0:
            chance = np.cumsum(densities(kind, rng).ravel())
        if ping % 16 == 0:
            target, heading = rng.uniform(*BOX, 2), rng.uniform(0.0, 2.0 * np.pi)
        count = rng.poisson(36)
        place = np.searchsorted(chance, chance[-1] * rng.random(count))
        place = np.minimum(place, GRID**2 - 1)
        corner = np.stack([place // GRID, place % GRID], axis=1)
        position = BOX[0] + cell * (corner + rng.random((count, 2)))
        range_, azimuth = np.hypot(*position.T), np.arctan2(position[:, 1], position[:, 0])
        target = target + 60.0 * np.array([math.cos(heading), math.sin(heading)])
        if rng.random() < 0.9:
            distance = math.hypot(*target)
            error = math.sqrt(float(sensor.range_variance(distance))) * rng.standard_normal()
            turn = sensor.azimuth_std * rng.standard_normal()
            range_ = np.append(range_, max(distance + error, 1.0))
            azimuth = np.append(azimuth, math.atan2(target[1], target[0]) + turn)
        yield Scan(12.0 * ping, range_, azimuth)
