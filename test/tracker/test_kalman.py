"""Prediction and update of many states, against the textbook's matrices; modes of motion."""

import numpy as np
import pytest

from tsepm_ros.tracker import motion
from tsepm_ros.tracker.scan import MAX_MAGNITUDE


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
