"""Prediction and update of many states, against the textbook's matrices one by one."""

from __future__ import annotations

import numpy as np
import pytest
from support.builders import detections

from tsepm_ros import SensorModel
from tsepm_ros.numerics import gaussian
from tsepm_ros.tracker import motion
from tsepm_ros.tracker.measurement import covariance_at
from tsepm_ros.tracker.scan import MAX_MAGNITUDE

SENSOR = SensorModel()


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


def test_each_state_has_a_step_of_its_own():
    state, covariance = states(2, 3)
    together = motion.predict(state, covariance, np.array([1.0, -5.0, 9.0]), 0.1)
    for row, step in enumerate([1.0, -5.0, 9.0]):
        alone = motion.predict(state[row : row + 1], covariance[row : row + 1], step, 0.1)
        np.testing.assert_allclose(together[0][row], alone[0][0])
        np.testing.assert_allclose(together[1][row], alone[1][0])


def test_prediction_changes_nothing_in_place():
    state, covariance = states(3)
    before = state.copy(), covariance.copy()
    motion.predict(state, covariance, 5.0, 0.1)
    np.testing.assert_array_equal(state, before[0])
    np.testing.assert_array_equal(covariance, before[1])


def test_the_update_is_kalman_s_with_the_echo_at_its_own_time():
    state, covariance = states(4)
    rng = np.random.default_rng(5)
    lag = rng.uniform(0.0, 6.0, len(state))
    measured = state[:, 0::2] + rng.standard_normal((len(state), 2))
    error = np.array([[2.0, 0.5], [0.5, 1.0]])
    spread = motion.position_covariance_after(covariance, lag) + error
    innovation = measured - state[:, 0::2] - lag[:, None] * state[:, 1::2]
    found, updated = motion.update(state, covariance, lag, innovation, spread)
    for row in range(len(state)):
        H = np.array([[1.0, lag[row], 0.0, 0.0], [0.0, 0.0, 1.0, lag[row]]])
        P = covariance[row]
        S = H @ P @ H.T + error
        np.testing.assert_allclose(spread[row], S)
        K = P @ H.T @ np.linalg.inv(S)
        z = measured[row]
        np.testing.assert_allclose(found[row], state[row] + K @ (z - H @ state[row]))
        # Joseph's form, which holds for any gain
        A = np.eye(4) - K @ H
        np.testing.assert_allclose(
            updated[row], A @ P @ A.T + K @ error @ K.T, rtol=1e-7, atol=1e-7
        )


def test_the_update_with_the_largest_range_error_is_a_covariance():
    """An error of 100 km along the line of sight leaves that across it."""
    rng = np.random.default_rng(7)
    _, covariance = states(7, 500)
    angle, across = rng.uniform(-np.pi, np.pi, 500), 10.0 ** rng.uniform(-1.0, 2.0, 500)
    sight = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    normal = sight[:, ::-1] * [-1.0, 1.0]
    error = MAX_MAGNITUDE["range_std"] ** 2 * sight[:, :, None] * sight[:, None]
    error += across[:, None, None] ** 2 * normal[:, :, None] * normal[:, None]
    spread = motion.position_covariance_after(covariance, np.zeros(500)) + error
    _, updated = motion.update(
        np.zeros((500, 4)), covariance, np.zeros(500), np.zeros((500, 2)), spread
    )
    eigenvalues = np.linalg.eigvalsh(0.5 * (updated + np.swapaxes(updated, 1, 2)))
    assert (eigenvalues > 0.0).all()


def test_the_inverse_is_the_inverse():
    rng = np.random.default_rng(6)
    matrix = rng.standard_normal((20, 2, 2))
    np.testing.assert_allclose(gaussian.inverse(matrix), np.linalg.inv(matrix))


def test_innovations_are_against_the_position_at_the_detections_time():
    state = np.array([[1000.0, 5.0, 2000.0, -3.0]])
    found = detections([[1020.0, 1990.0]], [2.0])
    found["azimuth_std"] = SENSOR.azimuth_std
    covariance = np.diag([100.0, 4.0, 100.0, 4.0])[None]
    innovation, spread = motion.innovations(state, covariance, np.array([2.0]), found, SENSOR)
    np.testing.assert_allclose(innovation, [[10.0, -4.0]])
    error = covariance_at(found, np.array([[1010.0, 1994.0]]), SENSOR)
    np.testing.assert_allclose(spread, error + (100.0 + 4.0 * 4.0) * np.eye(2))
