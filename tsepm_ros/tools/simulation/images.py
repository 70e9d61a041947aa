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
"""Simulated sonar images of a scenario, whole or one bearing at a time.

The field of a cell is the sum of the scatterers around it, weighed by the beam pattern and the
pulse, both Gaussian; the amplitude is its magnitude, so that clutter has speckle. A target is a
point or a patch of scatterers, with the mean power of its strength above the clutter's.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter
from scipy.special import gammaincinv, ndtr

from tsepm_ros.detector.image import SonarImage
from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.tools.simulation.scenario import ClutterStrength, Scenario, TargetStrength
from tsepm_ros.tools.simulation.simulator import Simulator

Field = NDArray[np.complex128]

STREAK_DB = 20.0
DEFAULT = TargetStrength(15.0)
WALL_POINTS = 200
SCATTERERS = 4
"""Per cell of a target."""
POINT = 0.4
"""Standard deviation of the response to a point where cells are independent, in cells."""
SCALES = {
    "amplitude": lambda a: a,
    "power": lambda a: a**2,
    "gamma": lambda a: np.clip(np.round(60.0 * np.sqrt(a)), 0, 255).astype(np.uint8),
    "log": lambda a: np.clip(np.round(110.0 + 60.0 * np.log10(np.maximum(a, 1e-9))), 0, 255).astype(
        np.uint8
    ),
}
"""Scales of an image by name: the last two of 8 bits."""


@dataclass(frozen=True, kw_only=True)
class ImageModel:
    """What a sonar makes of a scene.

    Attributes
    ----------
    cells : (int, int)
        Bearings and ranges, over the coverage of the scenario's sensor.
    blur : (float, float)
        Standard deviations of beam and pulse, in cells; 0: independent cells.
    texture : (float, float)
        Standard deviations, in cells, over which the texture of K clutter is common; it stays. 0:
        each cell of each image has its own.
    fall_db : float
        By which reverberation falls from the first to the last range.
    target_size : (float, float)
        Bearings and ranges of a target; (0, 0): a point.
    walls : tuple of (x, y, x, y, dB)
        Ends of straight walls in the fixed frame, m, and their strengths.
    streaks : float
        Mean number of bearings of an image with another sonar's pulse.
    scale : str
        One of `SCALES`.
    sweep_time : float
        Time from the first to the last bearing, s.
    """

    cells: tuple[int, int] = (128, 400)
    blur: tuple[float, float] = (0.0, 0.0)
    texture: tuple[float, float] = (0.0, 0.0)
    fall_db: float = 0.0
    target_size: tuple[float, float] = (0.0, 0.0)
    walls: tuple[tuple[float, float, float, float, float], ...] = ()
    streaks: float = 0.0
    scale: str = "amplitude"
    sweep_time: float = 0.0


class ImageSimulator:
    """Draws the images of a scenario, with the targets' states (k, 4) at their stamps.

    Parameters
    ----------
    scenario : Scenario
        Its clutter strength is the law of the clutter's power; targets have its strengths.
    model : ImageModel
    seed : int
    """

    def __init__(self, scenario: Scenario, model: ImageModel, seed: int) -> None:
        self.scenario, self.model = scenario, model
        self._simulator = Simulator(scenario, seed)
        self._rng = np.random.default_rng([seed, 1])
        sensor, (b, m) = scenario.sensor, model.cells
        self._steps = sensor.sector_width / b, (sensor.max_range - sensor.min_range) / m
        self.azimuth = np.asarray(sensor.azimuth_min + self._steps[0] * (np.arange(b) + 0.5), float)
        self.range = np.asarray(sensor.min_range + self._steps[1] * (np.arange(m) + 0.5), float)
        self._unit = float(np.std(gaussian_filter(self._white(b, m), model.blur)))
        normal = gaussian_filter(self._rng.standard_normal((b, m)), model.texture)
        self._share = ndtr(normal / normal.std())
        self._gain = 10.0 ** (-model.fall_db / 20.0 * np.linspace(0.0, 1.0, m))

    def __iter__(self) -> Iterator[tuple[SonarImage, FloatArray]]:
        """Draw the images one by one."""
        for time in self.scenario.period * np.arange(self.scenario.total_scans):
            yield self._image(float(time)), self._simulator.truth(time)

    def _image(self, time: float) -> SonarImage:
        model = self.model
        after = np.linspace(0.0, model.sweep_time, model.cells[0])
        poses = np.array([self.scenario.own_ship.pose(time + t) for t in after])
        white = self._white(*model.cells) * np.sqrt(self._clutter())
        field = gaussian_filter(white, model.blur) / self._unit
        strengths = self.scenario.target_strengths or (None,)
        for k, state in enumerate(self._simulator.truth(time)):
            middle, _ = self._cells(state[None, 0::2], poses[0])
            seen = int(np.clip(np.rint(middle[0]), 0, len(after) - 1))
            echo_cells = self._cells(state[None, 0::2] + after[seen] * state[1::2], poses[seen])
            number = 1 + math.ceil(SCATTERERS * math.prod(model.target_size))
            spread = self._rng.uniform(-0.5, 0.5, (2, number)).T * model.target_size
            field += self._echo(
                np.add(echo_cells, spread.T), strengths[k % len(strengths)] or DEFAULT
            )
        for x0, y0, x1, y1, strength in model.walls:
            points = np.linspace((x0, y0), (x1, y1), WALL_POINTS)
            field += self._echo(self._cells(points, poses[0]), TargetStrength(strength))
        field *= self._gain
        streaks = self._rng.integers(0, len(field), self._rng.poisson(model.streaks))
        field[streaks] += 10.0 ** (STREAK_DB / 20.0) * self._white(len(streaks), model.cells[1])
        return SonarImage(
            time, self.range, self.azimuth, SCALES[model.scale](np.abs(field)), after, poses
        )

    def _white(self, *shape: int) -> Field:
        parts = self._rng.standard_normal((*shape, 2)) * math.sqrt(0.5)
        return np.asarray(parts.view(np.complex128)[..., 0])

    def _clutter(self) -> Any:
        """Mean power of the clutter's cells, (b, m)."""
        law, shape = self.scenario.clutter_strength or ClutterStrength(), self.model.cells
        if law.law == "k":
            share = self._share if any(self.model.texture) else self._rng.random(shape)
            return gammaincinv(law.shape, share) / law.shape
        if law.law == "log_normal":
            return np.exp(law.shape * self._rng.standard_normal(shape) - 0.5 * law.shape**2)
        return np.ones(shape)

    def _cells(self, position: FloatArray, pose: FloatArray) -> FloatArray:
        """Fractional rows and columns (2, n) of positions (n, 2) in the fixed frame."""
        offset = position - pose[:2]
        azimuth = np.arctan2(offset[:, 1], offset[:, 0]) - pose[2] - self.azimuth[0]
        row = (np.mod(azimuth + 0.1, 2 * math.pi) - 0.1) / self._steps[0]
        return np.stack([row, (np.hypot(*offset.T) - self.range[0]) / self._steps[1]])

    def _echo(self, echo_cells: FloatArray, strength: TargetStrength) -> Any:
        """Field (b, m) of scatterers at rows and columns (2, n)."""
        response = [
            np.exp(-0.5 * ((np.arange(cells) - centre[:, None]) / math.hypot(sigma, POINT)) ** 2)
            for cells, centre, sigma in zip(
                self.model.cells, echo_cells, self.model.blur, strict=True
            )
        ]
        apart = (echo_cells - echo_cells[:, echo_cells.shape[1] // 2, None]) / np.hypot(
            self.model.blur, POINT
        )[:, None]
        power = np.exp(-(apart**2).sum(axis=0)).sum()  # mean, at the middle one
        scatterers = self._white(echo_cells.shape[1])
        if strength.fluctuation == "steady":
            scatterers /= np.abs(scatterers)
        scatterers *= 10.0 ** (strength.ratio_db / 20.0) / math.sqrt(power)
        return (response[0] * scatterers[:, None]).T @ response[1]
