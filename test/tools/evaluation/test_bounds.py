"""The Cramer-Rao bound: closed form, numerical differentiation, the design's figure."""

import math

import numpy as np
import pytest
from support.builders import fit_matrix

from tsepm_ros import SensorModel
from tsepm_ros.tools.evaluation.measures import cramer_rao

GROWING = SensorModel(range_std=20.0, range_std_fraction=0.1, azimuth_std=math.radians(3.0))
TIMES = np.array([0.0, 12.0, 24.0, 48.0, 60.0])


def line(state: np.ndarray, tau: np.ndarray) -> np.ndarray:
    return (fit_matrix(tau) @ state).reshape(-1, 2)


def test_a_target_at_rest_has_the_bound_of_two_straight_lines():
    # Range and azimuth separate: each is the bound of a line's value and slope.
    range_, tau = 6000.0, TIMES - 70.0
    bound = cramer_rao(np.tile([range_, 0.0], (5, 1)), TIMES, (0.0, 0.0), GROWING, 70.0)
    variance = 20.0**2 + 600.0**2
    of_range = 1.0 / variance + 0.5 * (2 * 0.1**2 * range_ / variance) ** 2
    of_azimuth = 1.0 / (range_ * GROWING.azimuth_std) ** 2
    sums = np.array([[5.0, tau.sum()], [tau.sum(), np.square(tau).sum()]])
    expected = np.kron(np.diag([1.0 / of_range, 1.0 / of_azimuth]), np.linalg.inv(sums))
    np.testing.assert_allclose(bound, expected, rtol=1e-10, atol=1e-10)


def divergence(state, truth, tau, poses, sensor) -> float:
    """Kullback-Leibler divergence of the measurements at a state from those at the true one."""
    total = 0.0
    for here, there in zip(line(state, tau) - poses, line(truth, tau) - poses, strict=True):
        r, r_true = math.hypot(*here), math.hypot(*there)
        v, v_true = float(sensor.range_variance(r)), float(sensor.range_variance(r_true))
        turn = math.atan2(here[1], here[0]) - math.atan2(there[1], there[0])
        total += 0.5 * ((v_true + (r - r_true) ** 2) / v - 1.0 - math.log(v_true / v))
        total += 0.5 * (turn / sensor.azimuth_std) ** 2
    return total


@pytest.mark.parametrize("seed", range(4))
def test_the_information_is_the_curvature_of_the_divergence(seed):
    # Its Hessian at the true state is the Fisher information, whatever the distribution: nothing
    # of the formula is used. From a moving sensor.
    rng = np.random.default_rng([17, seed])
    truth = np.array([3000.0, 4.0, 2000.0, -3.0])
    tau, poses = TIMES - 60.0, rng.uniform(-900, 900, (5, 2))
    step = np.array([3.0, 0.1, 3.0, 0.1])
    hessian = np.zeros((4, 4))
    for i in range(4):
        for j in range(4):
            a, b = np.eye(4)[i] * step, np.eye(4)[j] * step
            corners = [(a + b, 1), (a - b, -1), (b - a, -1), (-a - b, 1)]
            values = [
                sign * divergence(truth + offset, truth, tau, poses, GROWING)
                for offset, sign in corners
            ]
            hessian[i, j] = sum(values) / (4.0 * step[i] * step[j])
    root = np.linalg.cholesky(cramer_rao(line(truth, tau), TIMES, poses, GROWING, 60.0))
    np.testing.assert_allclose(root.T @ hessian @ root, np.eye(4), rtol=0, atol=2e-4)


@pytest.mark.parametrize("times", [[], [5.0], [5.0, 5.0]])
def test_hits_at_one_time_bound_no_velocity(times):
    with pytest.raises(ValueError, match="times"):
        cramer_rao(np.ones((len(times), 2)), times, (0.0, 0.0), GROWING, 5.0)
