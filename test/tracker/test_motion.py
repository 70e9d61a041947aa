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
"""Prediction and update, and states given a speed of at most v_max: against sums and samples."""

import math
from dataclasses import replace

import numpy as np
import pytest
from support.builders import detections, scan_at
from support.plain_confirmed_tracks import in_disc as plain_in_disc
from support.score_scenes import score

from tsepm_ros import SensorModel
from tsepm_ros.numerics.gaussian import mixture
from tsepm_ros.tracker import motion
from tsepm_ros.tracker.motion import (
    MAX_OUTSIDE_PROBABILITY,
    limited,
    log_speed_probability,
    moments_in_disc,
    slowed,
)

V_MAX = 10.0


def turned(angle: float, major: float, minor: float) -> np.ndarray:
    axes = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    return axes @ np.diag([major**2, minor**2]) @ axes.T


def with_velocity(seed: int, mean, covariance) -> tuple[np.ndarray, np.ndarray]:
    """A state of a random position and covariance, whose velocity has the given ones."""
    rng = np.random.default_rng(seed)
    gain = rng.uniform(-20.0, 20.0, (2, 2))  # of the position by the velocity, s
    state, whole = np.zeros(4), np.zeros((4, 4))
    state[0::2], state[1::2] = rng.uniform(-1e3, 1e3, 2), mean
    place, speed = [0, 2], [1, 3]
    whole[np.ix_(speed, speed)] = covariance
    whole[np.ix_(place, speed)] = gain @ covariance
    whole[np.ix_(speed, place)] = covariance @ gain.T
    whole[np.ix_(place, place)] = gain @ covariance @ gain.T + np.diag([400.0, 900.0])
    return state[None], 0.5 * (whole + whole.T)[None]


@pytest.mark.parametrize("seed", range(12))
def test_probability_and_moments_are_those_of_the_sums(seed):
    rng = np.random.default_rng(seed)
    major = V_MAX * 10.0 ** rng.uniform(-1.0, 0.3)
    covariance = turned(rng.uniform(0.0, math.pi), major, major * rng.uniform(0.3, 1.0))
    towards = rng.uniform(-math.pi, math.pi)
    out = rng.uniform(0.0, V_MAX + 2.0 * major)
    mean = out * np.array([math.cos(towards), math.sin(towards)])
    inside, expected, spread = plain_in_disc(mean, covariance, V_MAX, 200, 600)
    found = moments_in_disc(mean[None], covariance[None], np.array([V_MAX]))
    assert found[0][0] == pytest.approx(math.log(inside), abs=1e-9)
    np.testing.assert_allclose(found[1][0], expected, atol=1e-9 * V_MAX)
    np.testing.assert_allclose(found[2][0], spread, atol=1e-8 * V_MAX**2)


def test_a_state_with_little_outside_stays_to_the_bit():
    # Far from the edge, and with a little less than the limit beyond it, in one dimension.
    for speed, sigma in ((3.0, 1.0), (8.9, 1.5)):
        state, covariance = with_velocity(2, [speed, 0.0], np.diag([sigma, 0.01]) ** 2)
        assert (
            1.0 - math.exp(log_speed_probability(state, covariance, V_MAX)[0])
            < MAX_OUTSIDE_PROBABILITY
        )
        found = limited(state, covariance, V_MAX)
        assert found[0].tobytes() == state.tobytes()
        assert found[1].tobytes() == covariance.tobytes()
    state, covariance = with_velocity(2, [9.1, 0.0], np.diag([1.5, 0.01]) ** 2)
    assert limited(state, covariance, V_MAX)[0][0, 1] < 9.1


def test_only_a_mean_that_is_faster_is_slowed_and_as_it_is_limited():
    slow = with_velocity(2, [9.9, 0.0], np.eye(2) * 9.0)
    fast = with_velocity(3, [10.1, 0.0], np.eye(2) * 9.0)
    state, covariance = (np.concatenate(parts) for parts in zip(slow, fast, strict=True))
    found, spread = slowed(state, covariance, V_MAX)
    assert found[0].tobytes() == state[0].tobytes()
    assert spread[0].tobytes() == covariance[0].tobytes()
    expected, of = limited(*fast, V_MAX)
    np.testing.assert_array_equal(found[1], expected[0])
    np.testing.assert_array_equal(spread[1], of[0])


def test_the_mean_is_inside_and_the_covariance_positive_definite_however_far_outside():
    rng = np.random.default_rng(5)
    for seed in range(200):
        major = V_MAX * 10.0 ** rng.uniform(-3.0, 2.0)
        spread = turned(rng.uniform(0.0, 3.0), major, major * 10.0 ** rng.uniform(-2.0, 0.0))
        towards, out = rng.uniform(-math.pi, math.pi), V_MAX * 10.0 ** rng.uniform(-1.0, 1.5)
        mean = out * np.array([math.cos(towards), math.sin(towards)])
        state, covariance = limited(*with_velocity(seed, mean, spread), V_MAX)
        assert np.hypot(*state[0, 1::2]) <= V_MAX
        np.testing.assert_array_equal(covariance[0], covariance[0].T)
        deviation = np.sqrt(np.diag(covariance[0]))
        assert np.linalg.eigvalsh(covariance[0] / np.outer(deviation, deviation))[0] > 0.0


def test_a_limited_state_is_limited_once():
    # Otherwise the end of the prior would count again at every scan.
    rng = np.random.default_rng(6)
    for seed in range(200):
        major = V_MAX * 10.0 ** rng.uniform(-1.5, 0.3)
        spread = turned(rng.uniform(0.0, 3.0), major, major * rng.uniform(0.2, 1.0))
        towards = rng.uniform(-math.pi, math.pi)
        mean = (
            (V_MAX + 3.0 * major) * rng.random() * np.array([math.cos(towards), math.sin(towards)])
        )
        once = limited(*with_velocity(seed, mean, spread), V_MAX)
        again = limited(*once, V_MAX)
        np.testing.assert_array_equal(again[0], once[0])
        np.testing.assert_array_equal(again[1], once[1])


SENSOR = SensorModel(range_std=10.0, range_std_fraction=0.0, azimuth_std=0.005, max_range=6000.0)


def first_score(speed: float, **options) -> float:
    """Evidence of the first track on a target without clutter; 0 without a track."""
    initiator = score(SENSOR, **options)
    for k in range(8):
        for track in initiator.process(scan_at(12.0 * k, [(3000.0 + 12.0 * speed * k, 500.0)])):
            return float(track.score)
    return 0.0


def test_what_is_faster_than_the_maximum_does_not_start():
    # The filter's Gaussian prior, of 5 m/s, allows 13 m/s with 3 % of its mass.
    assert first_score(8.0, target_manoeuvre=0.01) > 0.0
    assert first_score(13.0, target_manoeuvre=0.01) == 0.0
    assert first_score(13.0, target_manoeuvre=0.01, max_speed=15.0) > 0.0


def states(seed: int, n: int = 7) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((n, 4, 6))
    return rng.uniform(-1e4, 1e4, (n, 4)), root @ np.swapaxes(root, 1, 2)


def transition(step: float) -> np.ndarray:
    return np.kron(np.eye(2), [[1.0, step], [0.0, 1.0]])


@pytest.mark.parametrize("noise", [0.0, 0.3])
@pytest.mark.parametrize("step", [0.0, 12.0, -12.0])
def test_prediction_is_that_of_nearly_constant_velocity(step, noise):
    state, covariance = states(1)
    found, spread = motion.predict(state, covariance, step, noise)
    # Backward as well, uncertainty grows with the time between; only its correlation turns over.
    time = abs(step)
    block = noise * np.array([[time**3 / 3, step * time / 2], [step * time / 2, time]])
    for row in range(len(state)):
        F = transition(step)
        np.testing.assert_allclose(found[row], F @ state[row])
        expected = F @ covariance[row] @ F.T + np.kron(np.eye(2), block)
        np.testing.assert_allclose(spread[row], expected, rtol=1e-9, atol=1e-9)


def test_a_gain_is_that_of_the_stacked_matrices_and_the_update_is_bayes():
    rng = np.random.default_rng(8)
    root = rng.normal(size=(3, 4, 4))
    covariance = root @ np.swapaxes(root, 1, 2)
    state, innovation = rng.normal(size=(3, 4)), rng.normal(size=(3, 2))
    elapsed, error = np.array([0.0, 2.0, -1.5]), np.diag([2.0, 3.0])
    h = np.stack([np.kron(np.eye(2), [1.0, t]) for t in elapsed])
    spread = h @ covariance @ np.swapaxes(h, 1, 2) + error
    np.testing.assert_allclose(
        motion.position_covariance_after(covariance, elapsed), spread - error, atol=1e-9
    )
    np.testing.assert_array_equal(
        motion.position_covariance_after(covariance, np.zeros(3)), covariance[:, 0::2, 0::2]
    )
    gain = covariance @ np.swapaxes(h, 1, 2) @ np.linalg.inv(spread)
    np.testing.assert_allclose(motion.kalman_gain(covariance, elapsed, spread), gain)
    found = motion.update(state, covariance, elapsed, innovation, spread)
    np.testing.assert_allclose(found[0], state + np.einsum("nij,nj->ni", gain, innovation))
    information = np.linalg.inv(covariance) + np.swapaxes(h, 1, 2) @ np.linalg.inv(error) @ h
    np.testing.assert_allclose(found[1], np.linalg.inv(information), atol=1e-6)
    np.testing.assert_allclose(
        motion.position_after(state, elapsed), np.einsum("nij,nj->ni", h, state)
    )


def test_thousands_of_updates_leave_a_covariance_symmetric_and_positive_definite():
    rng, elapsed = np.random.default_rng(1), np.full(1, 0.1)
    models = motion.InteractingModels.from_states(np.zeros((1, 4)), np.eye(4)[None])
    for k in range(2000):
        models = models.predicted(elapsed, 1.0, 1e-4)
        state, covariance = models.state.reshape(-1, 4), models.covariance.reshape(-1, 4, 4)
        cos, sin = np.cos(turn := rng.uniform(0.0, math.tau)), np.sin(turn)
        axes = np.array([[cos, -sin], [sin, cos]]) * np.sqrt([0.002, 0.06])
        errors, place = axes @ axes.T, np.array([0.03 * k, 0.0]) + axes @ rng.normal(size=2)
        innovations = place - state[:, 0::2], covariance[:, 0::2, 0::2] + errors
        state, covariance = motion.update(state, covariance, np.zeros(2), *innovations)
        models = replace(models, state=state[None], covariance=covariance[None])
    unsymmetric = np.abs(covariance - covariance.swapaxes(1, 2)).max()
    assert unsymmetric < 1e-9 * np.abs(covariance).max()
    assert np.linalg.eigvalsh(covariance).min() > 0.0


def test_innovations_are_against_the_place_and_with_the_errors_there():
    found = detections([[3000.0, 40.0]], 12.0)
    found["range_std"], found["azimuth_std"] = 20.0, 0.01
    state, covariance = np.array([[2990.0, 5.0, 10.0, 3.0]]), np.diag([9.0, 1.0, 4.0, 2.0])[None]
    innovation, spread = motion.innovations(
        state, covariance, np.array([2.0]), found, SensorModel()
    )
    np.testing.assert_allclose(innovation, [[0.0, 24.0]])
    along, across = 20.0**2 + 9.0 + 4.0, (3000.0 * 0.01) ** 2 + 4.0 + 8.0
    np.testing.assert_allclose(np.diagonal(spread[0]), [along, across], rtol=0.01)


def test_the_likelihood_of_a_detection_is_gaussian_within_the_gate_and_nothing_beyond():
    found = detections([[0.0, 0.0]] * 3, 0.0)
    spread = np.diag([4.0, 9.0])
    innovation = np.array([[2.0, 3.0], [4.0, 6.6], [4.0, 6.9]])  # squares 2, 8.84 and 9.29
    density = motion.log_likelihood(
        np.zeros((1, 4)),
        np.eye(4)[None],
        np.zeros(3, np.int64),
        0.0,
        innovation,
        np.broadcast_to(spread, (3, 2, 2)),
        found,
        np.arange(3),
        0.99,
    )
    at_zero = -np.log(2.0 * np.pi * 6.0)
    np.testing.assert_allclose(density[:2], at_zero - 0.5 * np.array([2.0, 8.84]))
    assert density[2] == -np.inf
    assert motion.gate_reach(0.99, False) == pytest.approx(np.sqrt(-2.0 * np.log(0.01)))
    assert motion.gate_reach(0.99, True) == pytest.approx(np.sqrt(11.345), rel=1e-4)


def test_a_range_rate_counts_after_the_position_in_likelihood_and_gate():
    found = detections([[1000.0, 0.0]] * 3, 2.0)
    found["range_rate"], found["range_rate_std"] = [3.0, 4.0, 15.0], 0.5
    state, covariance = np.array([[994.0, 3.0, 0.0, 0.0]]), np.diag([9.0, 4.0, 9.0, 4.0])[None]
    owner, row = np.zeros(3, np.int64), np.arange(3)
    spread = np.broadcast_to(np.diag([26.0, 26.0]), (3, 2, 2))
    density = motion.log_likelihood(
        state, covariance, owner, 0.0, np.zeros((3, 2)), spread, found, row, 0.99
    )
    # The velocity along the line of sight after the position: variance 4 - 8^2 / 26.
    along = 4.0 - 8.0**2 / 26.0 + 0.25
    expected = -np.log(2 * np.pi * 26.0) - 0.5 * np.log(2 * np.pi * along)
    assert density[0] == pytest.approx(expected, abs=1e-3)
    assert density[1] == pytest.approx(expected - 0.5 / along, abs=1e-3)
    assert density[2] == -np.inf


def test_modes_change_by_their_chain_and_are_mixed_before_they_are_predicted():
    state, covariance = np.array([[100.0, 3.0, 50.0, -2.0]]), np.diag([9.0, 1.0, 9.0, 1.0])[None]
    begun = motion.InteractingModels.from_states(state, covariance)
    goes_on, begins = motion.TURN_PERSISTENCE, 1.0 / motion.SCANS_TO_TURN
    chain = np.array([[1.0 - begins, begins], [1.0 - goes_on, goes_on]])
    np.testing.assert_allclose(begun.probability @ chain, begun.probability, err_msg="stationary")
    models = motion.InteractingModels(
        np.array([[0.7, 0.3]]), np.stack([state, state + 1.0], axis=1), begun.covariance
    )
    for elapsed, longest in [(2.0, motion.TURN_TIME), (-8.0, 8.0)]:
        found = models.predicted(np.array([elapsed]), 10.0, 0.02)
        np.testing.assert_allclose(found.probability, models.probability @ chain)
        step = np.kron(np.eye(2), [[1.0, elapsed], [0.0, 1.0]])
        for mode in range(2):
            weight = models.probability[0] * chain[:, mode] / found.probability[0, mode]
            mean = weight @ models.state[0]
            apart = models.state[0] - mean
            spread = covariance[0] + sum(
                w * np.outer(d, d) for w, d in zip(weight, apart, strict=True)
            )
            np.testing.assert_allclose(found.state[0, mode], step @ mean)
            noise = 0.02 + (25.0 / longest if mode else 0.0)
            t = elapsed
            each = abs(t) * noise * np.array([[t * t / 3.0, t / 2.0], [t / 2.0, 1.0]])
            np.testing.assert_allclose(
                found.covariance[0, mode], step @ spread @ step.T + np.kron(np.eye(2), each)
            )
    mean, spread = mixture(
        models.probability.T, models.state.swapaxes(0, 1), models.covariance.swapaxes(0, 1)
    )
    np.testing.assert_allclose(mean, state + 0.3)
    np.testing.assert_allclose(spread[0], covariance[0] + 0.21)
