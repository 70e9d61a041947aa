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
"""Seas whose clutter is denser in some places than in others, for as long as they last."""

from dataclasses import replace

import numpy as np

from tsepm_ros import SensorModel

CELL = 50.0
"""Of the density, m."""
LUMP = 500.0
"""Scale of the lumps, m."""


class LumpySea:
    """Clutter of a log-normal density (mean, 1/m^2, and std of its ln), smooth or in blocks."""

    def __init__(self, log_std: float, density: float, seed: int, kind: str = "smooth") -> None:
        self.sensor = replace(SensorModel(), clutter_density=density)
        self._rng = np.random.default_rng([seed, 21])
        self._half = self.sensor.max_range
        n = round(2.0 * self._half / CELL)
        if kind == "blocks":
            side = round(LUMP / CELL)
            level = np.kron(self._rng.standard_normal((n // side, n // side)), np.ones((side,) * 2))
        else:
            wave = 2.0 * np.pi * np.fft.fftfreq(2 * n, CELL)
            spectrum = np.exp(-(wave[:, None] ** 2 + wave**2) * LUMP**2 / 4.0)
            white = np.fft.fft2(self._rng.standard_normal((2 * n, 2 * n)))
            level = np.fft.ifft2(white * spectrum).real[:n, :n]
        level = np.exp(log_std * (level - level.mean()) / level.std())
        self._density = density * level / level.mean()
        self._chance = np.cumsum(self._density.ravel())

    def scan(self) -> tuple[np.ndarray, np.ndarray]:
        """Range and azimuth of a scan's clutter."""
        number = self._rng.poisson(self._chance[-1] * CELL**2)
        place = np.searchsorted(self._chance, self._chance[-1] * self._rng.random(number))
        corner = np.stack(np.unravel_index(place, self._density.shape), axis=1)
        x, y = (CELL * (corner + self._rng.random((number, 2))) - self._half).T
        range_, azimuth = np.hypot(x, y), np.arctan2(y, x)
        covered = (range_ > self.sensor.min_range) & (range_ < self.sensor.max_range)
        return range_[covered], azimuth[covered]

    def density_at(self, range_: np.ndarray, azimuth: np.ndarray) -> np.ndarray:
        """True density, 1/m^2."""
        x, y = range_ * np.cos(azimuth), range_ * np.sin(azimuth)
        row, column = ((np.stack([x, y]) + self._half) / CELL).astype(int)
        return self._density[row, column]
