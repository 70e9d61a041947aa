"""Least squares: against general solvers, far from the origin, and consistent."""

from __future__ import annotations

import math

import numpy as np
import pytest
from builders import detections, fit_matrix, whitened

from tsepm_ros import Scan, SensorModel
from tsepm_ros.conversion import DETECTION, convert, covariance_at
from tsepm_ros.estimation import (
    fit,
    position_covariances_at,
    positions_at,
    unweighted,
    weighted,
)

SENSOR = SensorModel(range_std=10.0, range_std_fraction=0.0, azimuth_std=math.radians(2.0))


def random_batch(m: int, seed: int = 0):
    rng = np.random.default_rng([8, m, seed])
    tau = -np.cumsum(rng.uniform(3, 20, (20, m)), axis=1)[:, ::-1]
    root = rng.uniform(-80, 80, (20, m, 2, 2))
    covariances = root @ np.swapaxes(root, -1, -2) + 25.0 * np.eye(2)
    return tau, rng.uniform(-5000, 5000, (20, m, 2)), covariances


def block_diagonal(blocks: np.ndarray) -> np.ndarray:
    full = np.zeros((2 * len(blocks), 2 * len(blocks)))
    for k, block in enumerate(blocks):
        full[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = block
    return full


@pytest.mark.parametrize("m", [2, 3, 5, 12])
def test_unweighted_is_lstsq_with_the_sandwich_covariance(m):
    tau, positions, covariances = random_batch(m)
    states, spreads = unweighted(tau, positions, covariances)
    for i in range(len(tau)):
        H, R = fit_matrix(tau[i]), block_diagonal(covariances[i])
        expected = np.linalg.lstsq(H, positions[i].ravel(), rcond=None)[0]
        bread = np.linalg.inv(H.T @ H)
        sandwich = bread @ H.T @ R @ H @ bread
        np.testing.assert_allclose(states[i], expected, rtol=1e-9, atol=1e-8)
        np.testing.assert_allclose(
            spreads[i], sandwich, rtol=0, atol=1e-10 * np.linalg.norm(sandwich)
        )


@pytest.mark.parametrize("m", [2, 3, 5, 12])
@pytest.mark.parametrize("start", ["zero", "near"])
def test_weighted_is_the_general_solution_of_the_stacked_problem(m, start):
    tau, positions, covariances = random_batch(m)
    begin = np.zeros((20, 4)) if start == "zero" else unweighted(tau, positions, covariances)[0]
    states, spreads = weighted(tau, positions, covariances, begin)
    for i in range(len(tau)):
        H, R = fit_matrix(tau[i]), block_diagonal(covariances[i])
        white = np.linalg.inv(np.linalg.cholesky(R))
        expected = np.linalg.lstsq(white @ H, white @ positions[i].ravel(), rcond=None)[0]
        spread = np.linalg.inv(H.T @ np.linalg.inv(R) @ H)
        np.testing.assert_allclose(states[i], expected, rtol=1e-7, atol=1e-6)
        np.testing.assert_allclose(spreads[i], spread, rtol=0, atol=1e-8 * np.linalg.norm(spread))
        np.testing.assert_array_equal(spreads[i], spreads[i].T)


def test_two_hits_are_met_exactly():
    hits = detections([[[0.0, 100.0], [50.0, 80.0]]], [[0.0, 10.0]])
    fitted = fit(hits, 10.0, SENSOR, "unweighted")
    np.testing.assert_allclose(fitted.state, [[50.0, 5.0, 80.0, -2.0]])


@pytest.mark.parametrize("estimator", ["unweighted", "weighted"])
def test_map_coordinates_and_epoch_stamps_cost_no_digits(estimator):
    # Stamps and offset are such that moving the scene is exact up to the rounding of positions,
    # 1e-9 m at 5e6 m.
    rng = np.random.default_rng(2)
    away, later = np.array([5e6, -5e6]), 1.7e9
    here, there = np.zeros((1, 5), DETECTION), np.zeros((1, 5), DETECTION)
    for k in range(5):
        measured = dict(range=[4000 + 40 * rng.standard_normal()], azimuth=[0.3 + 0.01 * k])
        here[:, k] = convert(Scan(12.25 * k, **measured), SENSOR, k)
        there[:, k] = convert(
            Scan(later + 12.25 * k, **measured, sensor_pose=(*away, 0.0)), SENSOR, k
        )
    near = fit(here, 49.0, SENSOR, estimator)
    far = fit(there, later + 49.0, SENSOR, estimator)
    np.testing.assert_allclose(far.state[:, 0::2], near.state[:, 0::2] + away, rtol=0, atol=1e-8)
    np.testing.assert_allclose(far.state[:, 1::2], near.state[:, 1::2], rtol=0, atol=1e-8)
    scale = np.linalg.norm(near.covariance)
    np.testing.assert_allclose(far.covariance, near.covariance, rtol=0, atol=1e-9 * scale)


def test_the_weighted_fit_takes_the_errors_at_the_fit_of_the_pass_before():
    hits = noisy_hits(np.random.default_rng(3), 50)
    tau = hits["time"] - 50.0
    state, _ = unweighted(tau, hits["position"], hits["covariance"])
    for _ in range(2):
        at_fit = covariance_at(hits, positions_at(state, tau), SENSOR)
        state, covariance = weighted(tau, hits["position"], at_fit, np.zeros((50, 4)))
    fitted = fit(hits, 50.0, SENSOR, "weighted")
    np.testing.assert_allclose(fitted.state, state, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(fitted.covariance, covariance, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(fitted.hit_covariance, at_fit, rtol=1e-6, atol=1e-6)


def test_the_published_fit_takes_the_errors_as_measured():
    hits = noisy_hits(np.random.default_rng(3), 5)
    fitted = fit(hits, 50.0, SENSOR, "unweighted")
    np.testing.assert_array_equal(fitted.hit_covariance, hits["covariance"])


def test_positions_and_their_covariances_follow_the_state():
    rng = np.random.default_rng(4)
    root = rng.standard_normal((3, 4, 4))
    covariance, state = root @ np.swapaxes(root, 1, 2), rng.standard_normal((3, 4))
    tau = rng.uniform(-50, 50, (3, 6))
    positions, spreads = positions_at(state, tau), position_covariances_at(covariance, tau)
    for i in range(3):
        for k in range(6):
            H = fit_matrix([tau[i, k]])
            np.testing.assert_allclose(positions[i, k], H @ state[i], rtol=1e-9, atol=1e-9)
            np.testing.assert_allclose(spreads[i, k], H @ covariance[i] @ H.T, rtol=1e-9, atol=1e-9)


# The estimation experiment of the design, section 6: 5 hits in 6 scans (the third one missed),
# T = 10 s, 5 km, sigma_r = 10 m, sigma_az = 2 degrees, 5 m/s.
TIMES = np.array([0.0, 10.0, 30.0, 40.0, 50.0])
STATE = np.array([5000.0, 5.0, 0.0, 0.0])
RUNS = 20_000


def noisy_hits(rng: np.random.Generator, runs: int) -> np.ndarray:
    hits = np.zeros((runs, len(TIMES)), DETECTION)
    for k, stamp in enumerate(TIMES):
        x, y = STATE[0::2] + STATE[1::2] * (stamp - 50.0)
        range_ = math.hypot(x, y) + SENSOR.range_std * rng.standard_normal(runs)
        azimuth = math.atan2(y, x) + SENSOR.azimuth_std * rng.standard_normal(runs)
        hits[:, k] = convert(Scan(stamp, range_, azimuth), SENSOR, k)
    return hits


@pytest.fixture(scope="module")
def experiment() -> np.ndarray:
    return noisy_hits(np.random.default_rng(6), RUNS)


def nees(states: np.ndarray, covariances: np.ndarray) -> np.ndarray:
    error = states - STATE
    return np.einsum("ni,nij,nj->n", error, np.linalg.inv(covariances), error)


def cramer_rao() -> np.ndarray:
    """Least covariance of any unbiased estimate, from the polar measurements."""
    information = np.zeros((4, 4))
    for stamp in TIMES:
        H = fit_matrix([stamp - 50.0])
        x, y = H @ STATE
        square = x * x + y * y
        jacobian = np.array([[x, y] / np.sqrt(square), [-y / square, x / square]])
        weight = np.diag([SENSOR.range_std**-2, SENSOR.azimuth_std**-2])
        information += H.T @ jacobian.T @ weight @ jacobian @ H
    return np.linalg.inv(information)


@pytest.mark.parametrize(("estimator", "published"), [("unweighted", 3.85), ("weighted", 4.14)])
def test_the_covariance_tells_the_truth_about_the_error(experiment, estimator, published):
    # NEES has mean 4 and variance 8 where state and covariance are right: the mean of 20 000 runs
    # has a standard error of 0.02, 0.08 at 99.99 %. The design's figures come from fewer runs,
    # whose errors were 2 % below the Cramer-Rao bound and so their NEES some 3 % low: 0.2 covers
    # both. A covariance that is a tenth too small would give 4.4 and 4.7.
    fitted = fit(experiment, 50.0, SENSOR, estimator)
    assert nees(fitted.state, fitted.covariance).mean() == pytest.approx(published, abs=0.2)


def test_errors_taken_as_measured_would_make_the_weighted_fit_over_confident(experiment):
    tau = experiment["time"] - 50.0
    start, _ = unweighted(tau, experiment["position"], experiment["covariance"])
    raw = weighted(tau, experiment["position"], experiment["covariance"], start)
    at_fit = fit(experiment, 50.0, SENSOR, "weighted")
    # The design: 5.37 against 4.14. A difference of 0.7 is 20 standard errors.
    assert nees(*raw).mean() - nees(at_fit.state, at_fit.covariance).mean() > 0.7


@pytest.mark.parametrize("estimator", ["unweighted", "weighted"])
def test_the_error_is_within_two_percent_of_the_cramer_rao_bound(experiment, estimator):
    # RMS errors of 20 000 runs have a standard error of 0.5 %: 2 % is 99.99 %.
    fitted = fit(experiment, 50.0, SENSOR, estimator)
    square = np.square(fitted.state - STATE).mean(axis=0)
    bound = np.diag(cramer_rao())
    assert math.sqrt(bound[0] + bound[2]) == pytest.approx(125.8, rel=0.01)  # the design's figures
    assert math.sqrt(bound[1] + bound[3]) == pytest.approx(4.10, rel=0.01)
    for axes in ([0, 2], [1, 3]):
        ratio = math.sqrt(square[axes].sum() / bound[axes].sum())
        assert ratio == pytest.approx(1.0, abs=0.02)


def test_the_sandwich_covariance_is_that_of_the_drawn_errors(experiment):
    # With the errors at the true positions; entries whitened, each within 5 standard errors,
    # sqrt(2 / n).
    tau = experiment["time"] - 50.0
    truth = positions_at(STATE[None], tau[:1])
    at_truth = covariance_at(experiment, np.broadcast_to(truth, (RUNS, 5, 2)), SENSOR)
    states, covariances = unweighted(tau, experiment["position"], at_truth)
    difference = np.abs(whitened(states, covariances[0]) - np.eye(4)).max()
    assert difference < 5 * math.sqrt(2 / RUNS)
