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
"""How much targets manoeuvre from scan to scan, learned from the innovations of confirmed tracks.

Between turns a target's acceleration is white, of a spectral density q. With an innovation d of
covariance S, to which the last interval t contributed q G, ``G = t^3 / 3``, the score of q and its
information are::

    g = (d' S^-1 G S^-1 d - tr S^-1 G) / 2,    i = tr (S^-1 G)^2 / 2

and after each scan, by natural gradients::

    q <- q + sum g / (1 / q_s^2 + sum i)

with the sum of i over all scans, fading. Where detections are too coarse to show a manoeuvre, i is
small, and q stays near its prior: a velocity that changes by v_max / 4 in the mean time between
turns, in a turn at most::

    q_0 = (v_max / 4)^2 / (SCANS_TO_TURN max(t, MIN_STEP))
    q_s = (v_max / 4)^2 / max(t, TURN_TIME)
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.numerics.gaussian import UNLIKELY_SQUARE, inverse_covariance
from tsepm_ros.tracker.clutter.sensor_performance import DETECTION_MEMORY
from tsepm_ros.tracker.motion import MIN_STEP, SCANS_TO_TURN, TURN_TIME
from tsepm_ros.tracker.options import CommonOptions

MIN_NOISE_RATIO = 0.5
"""Smallest q, in its prior: errors that are stated too large hide a manoeuvre."""


class TargetManoeuvre:
    """Learns the spectral density q of the acceleration of targets, m^2/s^3."""

    def __init__(self) -> None:
        self._change, self._information = 0.0, 0.0

    def process_noise(self, options: CommonOptions, interval: float) -> float:
        """The density q for scans of a median interval, s; by `target_manoeuvre` where it is given.

        An acceleration a that lasts from scan to scan has the density ``a^2 t``.
        """
        if options.target_manoeuvre:
            return options.target_manoeuvre**2 * max(interval, 1e-3)
        prior, most = _bounds(options.max_speed, interval)
        return min(max(prior + self._change, MIN_NOISE_RATIO * prior), most)

    def update(
        self,
        innovation: FloatArray,
        covariance: FloatArray,
        options: CommonOptions,
        elapsed: float,
        interval: float,
    ) -> None:
        """Learn from innovations (n, 2), m, of covariances (n, 2, 2), m^2.

        These come after a time `elapsed`, in scans of a median interval, s.

        Not while `target_manoeuvre` is given: the covariances are then of another q.
        """
        if options.target_manoeuvre or not len(innovation):
            return
        growth = elapsed**3 / 3.0
        inverted = inverse_covariance(covariance)
        pulling = (inverted @ innovation[..., None])[..., 0]
        # A turn is no noise: its square counts as an unlikely one.
        least = UNLIKELY_SQUARE / np.maximum((pulling * innovation).sum(axis=1), UNLIKELY_SQUARE)
        pulled = least * np.square(pulling).sum(axis=1) - inverted[:, 0, 0] - inverted[:, 1, 1]
        score = 0.5 * growth * float(pulled.sum())
        information = 0.5 * growth**2 * float(np.square(inverted).sum())
        keep = np.exp(-len(innovation) / DETECTION_MEMORY)
        self._information = keep * self._information + information
        prior, most = _bounds(options.max_speed, interval)
        step = score / (most**-2.0 + self._information)
        self._change = min(max(self._change + step, (MIN_NOISE_RATIO - 1.0) * prior), most - prior)


@lru_cache(maxsize=64)
def _bounds(max_speed: float, interval: float) -> tuple[float, float]:
    """Prior of q, and its deviation, which q does not exceed."""
    change = (0.25 * max_speed) ** 2
    return (
        change / (SCANS_TO_TURN * max(interval, MIN_STEP)),
        change / max(interval, TURN_TIME),
    )
