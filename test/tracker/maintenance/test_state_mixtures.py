"""States of held tracks after a scan: mixtures over the detections that may be theirs."""

from __future__ import annotations

import math

import numpy as np
import pytest
from support.builders import FIXED_RANGE_ERROR, detections
from support.held import CLUTTER, MAX_SPEED, P_D, holding, ids, step, tracks

from tsepm_ros.tracker.maintenance.data_association import GATE_PROBABILITY
from tsepm_ros.tracker.measurement import covariance_at
from tsepm_ros.tracker.motion import PROCESS_NOISE


def kalman(
    stamp: float, position: np.ndarray, lag: float = 0.0
) -> tuple[np.ndarray, np.ndarray, float]:
    """Kalman update of `tracks(1)` with one detection; also its density N(z; H x, S)."""
    F = np.eye(4)
    F[0, 1] = F[2, 3] = stamp
    G = np.array([[stamp**3 / 3, stamp**2 / 2], [stamp**2 / 2, stamp]])
    Q = PROCESS_NOISE * np.kron(np.eye(2), G)
    track = tracks(1)[0]
    x, P = F @ track.state, F @ track.covariance @ F.T + Q
    H = np.zeros((2, 4))
    H[0, 0] = H[1, 2] = 1.0
    H[0, 1] = H[1, 3] = lag
    R = covariance_at(detections([position], stamp), (H @ x)[None], FIXED_RANGE_ERROR)[0]
    S = H @ P @ H.T + R
    K = P @ H.T @ np.linalg.inv(S)
    v = position - H @ x
    density = math.exp(-0.5 * v @ np.linalg.solve(S, v)) / (
        2 * math.pi * math.sqrt(np.linalg.det(S))
    )
    return x + K @ v, P - K @ S @ K.T, density


def test_two_detections_are_weighed_as_probabilistic_data_association_does(straight):
    stamp, found = 12.0, np.array([[2080.0, 1030.0], [2010.0, 920.0]])
    hold = holding(1, existence=0.8)
    explained = step(hold, stamp, detections(found, stamp), P_D)
    updates = [kalman(stamp, position) for position in found]
    ratios = np.array([P_D * density / CLUTTER for *_, density in updates])
    miss = 1.0 - P_D * GATE_PROBABILITY
    # How much less likely the scan is where a detection is not there for the target.
    whole = 0.2 + 0.8 * (miss + ratios.sum())
    without = 0.2 + 0.8 * (miss + ratios[::-1])
    np.testing.assert_allclose(explained, CLUTTER * (whole / without - 1.0))
    weights = np.array([miss, *ratios]) / (miss + ratios.sum())
    row, claimed = hold.held_association
    odds = 0.8 * (miss + ratios.sum())
    np.testing.assert_allclose(claimed[np.argsort(row)], weights[1:] * odds / (odds + 0.2))
    # The mixture: not updated, updated with the first, updated with the second.
    predicted = holding(1)
    step(predicted, stamp)
    parts = [(predicted.current.state[0], predicted.current.covariance[0])]
    parts += [(state, covariance) for state, covariance, _ in updates]
    mean = sum(w * state for w, (state, _) in zip(weights, parts, strict=True))
    spread = sum(
        w * (covariance + np.outer(state - mean, state - mean))
        for w, (state, covariance) in zip(weights, parts, strict=True)
    )
    (track,) = hold.held.tracks
    np.testing.assert_allclose(track.state, mean, rtol=1e-9)
    np.testing.assert_allclose(track.covariance, spread, rtol=1e-7, atol=1e-7)
    np.testing.assert_allclose(hold.held.existence, [odds / (odds + 0.2)])


def test_a_late_echo_is_taken_at_its_own_time_against_the_clutter_where_it_is(straight):
    stamp, lag, clutter = 12.0, 4.0, np.array([1e-4, 3e-6])
    found = detections([[9000.0, 9000.0], [2075.0, 1020.0]], [stamp, stamp + lag])
    hold = holding(1, existence=0.8)
    explained = hold.step(
        stamp,
        found,
        clutter,
        lambda positions: np.full(len(positions), P_D),
        FIXED_RANGE_ERROR,
        MAX_SPEED,
    )
    state, _, density = kalman(stamp, found["position"][1], lag)
    miss, ratio = 1.0 - P_D * GATE_PROBABILITY, P_D * density / clutter[1]
    np.testing.assert_allclose(
        explained, [0.0, clutter[1] * 0.8 * ratio / (0.2 + 0.8 * miss)], atol=1e-20
    )
    np.testing.assert_allclose(
        hold.held.existence, [0.8 * (miss + ratio) / (0.8 * (miss + ratio) + 0.2)]
    )
    weight = ratio / (miss + ratio)
    coasted = holding(1)
    step(coasted, stamp)
    mean = (1 - weight) * coasted.current.state[0] + weight * state
    np.testing.assert_allclose(hold.held.tracks.state[0], mean, rtol=1e-9)


@pytest.mark.long
def test_covariances_stay_positive_definite_and_numbers_finite():
    hold = holding(1, 2, 3)
    rng = np.random.default_rng(2)
    for scan in range(1, 1000):
        time = 0.1 * scan
        points = [*rng.uniform([0, 0], [8000, 4000], (rng.integers(0, 20), 2))]
        points += [[2000.0 + 5.0 * time, 1000.0 * k] for k in (1, 2, 3)]
        explained = step(hold, time, detections(points, time), P_D)
        assert np.isfinite(explained).all()
        assert np.linalg.eigvalsh(hold.held.tracks.covariance).min() > 0
        np.testing.assert_array_equal(
            hold.held.tracks.covariance, np.swapaxes(hold.held.tracks.covariance, 1, 2)
        )
    assert ids(hold) == [1, 2, 3]
    assert np.isfinite(hold.held.existence).all()
