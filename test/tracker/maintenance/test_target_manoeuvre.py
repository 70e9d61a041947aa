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
"""The acceleration of targets is learned where detections show it, and else stays the prior."""

import numpy as np
import pytest

from tsepm_ros.tracker.maintenance.target_manoeuvre import MIN_NOISE_RATIO, TargetManoeuvre
from tsepm_ros.tracker.motion import SCANS_TO_TURN, TURN_TIME
from tsepm_ros.tracker.options import CommonOptions

OPTIONS = CommonOptions(max_speed=10.0)


def prior(interval: float) -> float:
    return 2.5**2 / max(SCANS_TO_TURN * interval, 30.0)


def learned(density: float, sigma: float, interval: float, scans: int = 400, seed: int = 1):
    """q after a few targets, each with a Kalman filter of the q that is learned: plain formulas."""
    rng, manoeuvre, t = np.random.default_rng(seed), TargetManoeuvre(), interval
    f = np.kron(np.eye(2), [[1.0, t], [0.0, 1.0]])
    noise = np.kron(np.eye(2), [[t**3 / 3.0, t**2 / 2.0], [t**2 / 2.0, t]])
    h, r = np.kron(np.eye(2), [1.0, 0.0]), sigma**2 * np.eye(2)
    root = np.linalg.cholesky(density * noise)
    truth, state = np.zeros((5, 4)), np.zeros((5, 4))
    p = np.kron(np.eye(2), np.diag([sigma**2, 1.0]))
    for _ in range(scans):
        truth = truth @ f.T + rng.standard_normal((5, 4)) @ root.T
        q = manoeuvre.process_noise(OPTIONS, t)
        state, p = state @ f.T, f @ p @ f.T + q * noise
        s = h @ p @ h.T + r
        innovation = truth[:, 0::2] + sigma * rng.standard_normal((5, 2)) - state[:, 0::2]
        gain = p @ h.T @ np.linalg.inv(s)
        state, p = state + innovation @ gain.T, p - gain @ s @ gain.T
        manoeuvre.update(innovation, np.broadcast_to(s, (5, 2, 2)), OPTIONS, t, t)
    return manoeuvre.process_noise(OPTIONS, t)


@pytest.mark.parametrize("factor", [0.7, 2.0, 5.0])
@pytest.mark.parametrize("interval", [1.0, 12.0])
def test_where_detections_show_it_the_density_is_that_of_the_targets(factor, interval):
    # The noise of a scan moves a target by twice the error of a detection.
    density = factor * prior(interval)
    sigma = 0.5 * np.sqrt(prior(interval) * interval**3 / 3.0)
    found = np.mean([learned(density, sigma, interval, seed=seed) for seed in range(3)])
    assert found == pytest.approx(density, rel=0.25)


@pytest.mark.parametrize("factor", [0.0, 3.0])
def test_where_detections_are_too_coarse_the_prior_stays(factor):
    density = max(factor * prior(1.0), 1e-12)
    assert learned(density, 100.0, 1.0, scans=100) == pytest.approx(prior(1.0), rel=0.1)


def test_the_density_stays_within_its_bounds():
    least, most = MIN_NOISE_RATIO * prior(12.0), 2.5**2 / max(12.0, TURN_TIME)
    for scale in (0.0, 1e3, 1e9):
        manoeuvre = TargetManoeuvre()
        for _ in range(50):
            innovation = np.full((9, 2), scale)
            manoeuvre.update(innovation, np.eye(2)[None].repeat(9, axis=0), OPTIONS, 12.0, 12.0)
            assert least <= manoeuvre.process_noise(OPTIONS, 12.0) <= most


def test_an_acceleration_that_is_given_is_not_learned():
    manoeuvre, given = TargetManoeuvre(), CommonOptions(max_speed=10.0, target_manoeuvre=0.2)
    manoeuvre.update(np.full((9, 2), 5.0), np.eye(2)[None].repeat(9, axis=0), given, 12.0, 12.0)
    assert manoeuvre.process_noise(given, 12.0) == pytest.approx(0.2**2 * 12.0)


@pytest.mark.parametrize("interval", [0.0, 1e-6, 0.1, 12.0, 1e5])
def test_any_interval_and_no_innovations_give_a_number_above_zero(interval):
    manoeuvre = TargetManoeuvre()
    manoeuvre.update(np.zeros((0, 2)), np.zeros((0, 2, 2)), OPTIONS, interval, interval)
    manoeuvre.update(np.zeros((1, 2)), 1e-6 * np.eye(2)[None], OPTIONS, interval, interval)
    for options in (OPTIONS, CommonOptions(target_manoeuvre=1e-3)):
        found = manoeuvre.process_noise(options, interval)
        assert np.isfinite(found) and found > 0.0
