"""The three estimators of 2014."""

import numpy as np
import pytest
from scipy.linalg import block_diag
from support.builders import detections, fit_matrix, whitened

from tsepm_ros import SensorModel
from tsepm_ros.studies.sequential import ESTIMATORS, estimate, kalman, line

TIMES = np.array([-60.0, -48.0, -24.0, -12.0, -5.0])
VELOCITY = np.array([3.0, -4.0])
COVARIANCES = np.array([np.array([[4.0, c], [c, 2.0]]) for c in (0.5, -1.0, 0.0, 1.0, 0.2)])


def truth(times=TIMES):
    return np.array([1000.0, 2000.0]) + times[:, None] * VELOCITY


@pytest.mark.parametrize("noise", [0.0, 0.1])
def test_the_filter_is_generalised_least_squares_with_the_process_noise(noise):
    """A position differs by the integral of (s - t_i) dW(s) from that of the last velocity."""
    tau, positions = TIMES[None], truth() + np.random.default_rng(1).normal(0, 2, (1, 5, 2))
    one, other = np.meshgrid(TIMES, TIMES)
    begin = np.maximum(one, other)
    integral = -(begin**3 / 3.0 - (one + other) * begin**2 / 2.0 + one * other * begin)
    weight = np.linalg.inv(block_diag(*COVARIANCES) + noise * np.kron(integral, np.eye(2)))
    design = fit_matrix(TIMES)
    expected = np.linalg.inv(design.T @ weight @ design)
    state, covariance = kalman(tau, positions, COVARIANCES[None], noise)
    np.testing.assert_allclose(
        state[0], expected @ design.T @ weight @ positions.ravel(), rtol=1e-8
    )
    np.testing.assert_allclose(covariance[0], expected, rtol=1e-8, atol=1e-10)


def test_the_covariance_of_a_line_is_that_of_the_errors():
    rng = np.random.default_rng(2)
    n = 20_000
    roots = np.linalg.cholesky(COVARIANCES)
    errors = (roots @ rng.standard_normal((n, 5, 2, 1)))[..., 0]
    states, _ = line(np.tile(TIMES, (n, 1)), truth() + errors, np.tile(COVARIANCES, (n, 1, 1, 1)))
    covariance = line(TIMES[None], truth()[None], COVARIANCES[None])[1][0]
    np.testing.assert_allclose(whitened(states, covariance), np.eye(4), atol=0.06)


def test_a_line_may_run_along_either_axis():
    for direction in ([1.0, 0.0], [0.0, 1.0], [0.0, -1.0], [-1.0, 1.0]):
        positions = 5.0 * TIMES[:, None] * np.array(direction)
        state, covariance = line(TIMES[None], positions[None], COVARIANCES[None])
        np.testing.assert_allclose(state[0, 1::2], 5.0 * np.array(direction), atol=1e-12)
        assert (np.linalg.eigvalsh(covariance[0]) > 0).all()


@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_hits_at_one_place_stand_still(estimator):
    found = estimate(detections(np.ones((1, 5, 2)), TIMES), 0.0, SensorModel(), estimator, 0.0)
    np.testing.assert_allclose(found.state, [[1.0, 0.0, 1.0, 0.0]], atol=1e-12)
    assert (np.linalg.eigvalsh(found.covariance) > 0).all()


@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_hits_at_one_time_have_no_fit(estimator):
    found = estimate(detections(truth()[None], 7.0), 0.0, SensorModel(), estimator, 0.0)
    assert not np.isfinite(found.state).all()


def test_as_in_table_1_least_squares_is_best_and_the_line_loses_speed():
    # The article's scene: 6 hits of 10, 6 km, 1.5 % and 1 degree, 5 m/s, 12 s.
    rng = np.random.default_rng(3)
    n, times = 4000, -12.0 * np.arange(6)[::-1]
    covariance = np.diag([90.0**2, 104.7**2])
    sent = np.array([6000.0, 0.0]) + times[:, None] * np.array([3.0, 4.0])
    hits = detections(sent + rng.normal(0, 1, (n, 6, 2)) * [90.0, 104.7], times)
    hits["covariance"] = covariance
    error = {}
    for estimator in ESTIMATORS:
        state = estimate(hits, 0.0, SensorModel(), estimator, 0.001).state
        error[estimator] = (
            np.median(np.hypot(*(state[:, 0::2] - sent[-1]).T)),
            np.median(np.abs(np.hypot(*state[:, 1::2].T) - 5.0)),
        )
    assert error["least_squares"][0] < error["linear_fitting"][0]
    assert error["least_squares"][0] < error["kalman_filter"][0] * 1.05
