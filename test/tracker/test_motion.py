"""Prediction and update, and states given a speed of at most v_max: against sums and samples."""

import math

import numpy as np
import pytest
from support.builders import scan_at
from support.plain_held_tracks import in_disc as plain_in_disc
from support.score_scenes import score

from tsepm_ros import SensorModel
from tsepm_ros.tracker import motion
from tsepm_ros.tracker.motion import MAX_OUTSIDE, in_disc, limited, log_speed_probability, slowed

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
    found = in_disc(mean[None], covariance[None], np.array([V_MAX]))
    assert found[0][0] == pytest.approx(math.log(inside), abs=1e-9)
    np.testing.assert_allclose(found[1][0], expected, atol=1e-9 * V_MAX)
    np.testing.assert_allclose(found[2][0], spread, atol=1e-8 * V_MAX**2)


def test_a_state_with_little_outside_stays_to_the_bit():
    # Far from the edge, and with a little less than MAX_OUTSIDE beyond it, in one dimension.
    for speed, sigma in ((3.0, 1.0), (8.9, 1.5)):
        state, covariance = with_velocity(2, [speed, 0.0], np.diag([sigma, 0.01]) ** 2)
        assert 1.0 - math.exp(log_speed_probability(state, covariance, V_MAX)[0]) < MAX_OUTSIDE
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
    assert first_score(8.0) > 0.0
    assert first_score(13.0) == 0.0
    assert first_score(13.0, max_speed=15.0) > 0.0


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
