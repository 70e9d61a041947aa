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
"""A Bernoulli filter on thresholded cells: one target at most, begun anywhere at any time.

Ristic B., Vo B.-T., Vo B.-N., Farina A., "A tutorial on Bernoulli filters: theory, implementation
and applications", IEEE Trans. Signal Processing 61(13), 2013. The spatial density is a mixture of
Gaussians and of a uniform part: a target that has begun and was not detected yet. Cells above a
threshold are the detections, with their amplitudes; clutter's law and mean are given.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial import cKDTree

from tsepm_ros import SensorModel
from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.tracker.motion import predict

BIRTH, SURVIVAL = 1e-4, 0.999
"""Probabilities that a target begins and lives on, an image."""
RATIOS_DB = 6.0, 8.0, 10.0, 12.0, 14.0
"""Mean signal-to-clutter ratios, equally probable."""
COMPONENTS = 3000
GATE = 4.0
"""Standard deviations."""


class BernoulliFilter:
    """The filter, for clutter of exponential power with the mean 1, uniform over the cells.

    Parameters
    ----------
    sensor : SensorModel
        Coverage.
    spacing : (float, float)
        Between the cells, rad and m.
    threshold : float
        Power above which cells are detections.
    max_speed : float
        m/s; the velocity of a new target has the covariance of the uniform disc.
    noise : float
        Process noise, m^2/s^3.

    Attributes
    ----------
    log_odds : float
        Of the target's existence.
    """

    def __init__(
        self,
        sensor: SensorModel,
        spacing: tuple[float, float],
        threshold: float,
        max_speed: float,
        noise: float = 0.01,
    ) -> None:
        self.spacing, self.threshold, self.noise = spacing, threshold, noise
        self.velocity_variance = 0.25 * max_speed**2
        cells = sensor.sector_width * (sensor.max_range - sensor.min_range)
        self.clutter = math.exp(-threshold) / math.prod(spacing)  # detections, per rad and m
        self.number = self.clutter * cells
        signal = 1.0 + 10.0 ** (np.array(RATIOS_DB) / 10.0)
        self._signal, self._seen = signal, np.exp(-threshold / signal)
        self.detection_probability = float(self._seen.mean())
        self.log_odds, self._stamp = -math.inf, 0.0
        self.uniform = 1.0
        self.weight = np.zeros(0)
        self.state, self.covariance = np.zeros((0, 4)), np.zeros((0, 4, 4))

    def process(
        self, stamp: float, range_: FloatArray, azimuth: FloatArray, power: FloatArray
    ) -> None:
        """Take the cells above the threshold: their ranges, azimuths and powers, (n,) each."""
        self._predict(stamp)
        # Detected density over that of clutter, without the place.
        ratio = (
            self._seen
            / self._signal
            * np.exp((power - self.threshold)[:, None] * (1.0 - 1.0 / self._signal))
        ).mean(axis=1)
        unit = np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1)
        place = range_[:, None] * unit
        variances = np.square(self.spacing) / 12.0
        across = np.stack([-unit[:, 1], unit[:, 0]], axis=1)
        error = variances[1] * unit[:, :, None] * unit[:, None] + (
            (variances[0] * range_**2)[:, None, None] * across[:, :, None] * across[:, None]
        )
        born = np.zeros((len(place), 4)), np.zeros((len(place), 4, 4))
        born[0][:, 0::2] = place
        born[1][:, 0::2, 0::2] = error
        born[1][:, [1, 3], [1, 3]] = self.velocity_variance
        begun = self.uniform * ratio / self.number
        row, column = self._gated(place, error)
        innovation_covariance = self.covariance[row][:, 0::2, 0::2] + error[column]
        inverse = np.linalg.inv(innovation_covariance)
        offset = place[column] - self.state[row, 0::2]
        distance = np.einsum("ni,nij,nj->n", offset, inverse, offset)
        density = np.exp(-0.5 * distance) * np.sqrt(np.linalg.det(inverse)) / (2.0 * np.pi)
        # The density of clutter per m^2 is that per rad and m over the range.
        updated = self.weight[row] * density * ratio[column] * range_[column] / self.clutter
        gain = self.covariance[row][:, :, 0::2] @ inverse
        state = self.state[row] + (gain @ offset[..., None])[..., 0]
        covariance = self.covariance[row] - gain @ innovation_covariance @ np.swapaxes(gain, 1, 2)
        missed = 1.0 - self.detection_probability
        self.uniform *= missed
        self.weight = np.concatenate([missed * self.weight, begun, updated])
        self.state = np.concatenate([self.state, born[0], state])
        self.covariance = np.concatenate([self.covariance, born[1], covariance])
        total = float(self.weight.sum()) + self.uniform
        self.log_odds += math.log(total)
        self.uniform /= total
        self.weight /= total
        if len(self.weight) > COMPONENTS:
            best = np.argpartition(-self.weight, COMPONENTS)[:COMPONENTS]
            self.uniform += float(self.weight.sum() - self.weight[best].sum())
            self.weight, self.state = self.weight[best], self.state[best]
            self.covariance = self.covariance[best]

    def estimate(self) -> FloatArray:
        """State of the heaviest component, (4,)."""
        return self.state[np.argmax(self.weight)]

    def _predict(self, stamp: float) -> None:
        """Carry existence and density to a stamp; what begins is uniform."""
        elapsed, self._stamp = stamp - self._stamp, stamp
        exists = 1.0 / (1.0 + math.exp(-self.log_odds)) if self.log_odds > -700.0 else 0.0
        begins, lives = BIRTH * (1.0 - exists), SURVIVAL * exists
        now = begins + lives
        self.log_odds = math.log(now / (1.0 - now))
        self.uniform = (begins + lives * self.uniform) / now
        self.weight = self.weight * lives / now
        if len(self.weight):
            self.state, self.covariance = predict(
                self.state, self.covariance, np.full(len(self.weight), elapsed), self.noise
            )

    def _gated(self, place: FloatArray, error: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Rows of components and of detections within a gate."""
        if not (len(place) and len(self.weight)):
            return np.zeros(0, np.int64), np.zeros(0, np.int64)
        spread = np.trace(self.covariance[:, 0::2, 0::2], axis1=1, axis2=2)
        reach = GATE * np.sqrt(spread + np.trace(error, axis1=1, axis2=2).max())
        near = cKDTree(place).query_ball_point(self.state[:, 0::2], reach)
        row = np.repeat(np.arange(len(near)), [len(each) for each in near])
        return row, np.concatenate([np.asarray(each, np.int64) for each in near])
