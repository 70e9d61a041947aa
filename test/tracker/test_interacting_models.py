"""Modes of motion of the tracks held."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tsepm_ros.tracker import motion as motion_module
from tsepm_ros.tracker.motion import (
    GOES_ON,
    PROCESS_NOISE,
    SCANS_TO_TURN,
    TURN_TIME,
    InteractingModels,
    predict,
)

MAX_SPEED = 15.0
STATE = np.array([[100.0, 5.0, -200.0, 3.0], [0.0, -8.0, 900.0, 0.0]])
COVARIANCE = np.stack([np.diag([20.0, 2.0, 20.0, 2.0]) ** 2] * 2)


def test_the_modes_begin_as_a_target_is_in_the_long_run():
    motion = InteractingModels.of(STATE, COVARIANCE)
    next_scan = motion.predicted(np.full(2, 1.0), MAX_SPEED)
    np.testing.assert_allclose(next_scan.probability, motion.probability)


def test_what_never_begins_does_not_change_anything(monkeypatch):
    monkeypatch.setattr(motion_module, "SCANS_TO_TURN", math.inf)
    motion = InteractingModels.of(STATE, COVARIANCE)
    for _ in range(100):
        motion = motion.predicted(np.full(2, 2.0), MAX_SPEED)
    expected, spread = STATE, COVARIANCE
    for _ in range(100):
        expected, spread = predict(expected, spread, 2.0, PROCESS_NOISE)
    state, covariance = motion.combined()
    np.testing.assert_allclose(state, expected)
    np.testing.assert_allclose(covariance, spread)


@pytest.mark.parametrize("step", [2.5, -2.5, 12.0])
def test_modes_are_mixed_and_carried_as_in_plain_loops(step):
    rng = np.random.default_rng(1)
    root = rng.standard_normal((2, 2, 4, 4))
    motion = InteractingModels(
        np.array([[0.7, 0.3], [0.2, 0.8]]),
        rng.standard_normal((2, 2, 4)),
        root @ np.swapaxes(root, 2, 3) + np.eye(4),
    )
    found = motion.predicted(np.full(2, step), MAX_SPEED)
    turning = 1.0 / SCANS_TO_TURN
    change = np.array([[1.0 - turning, turning], [1.0 - GOES_ON, GOES_ON]])
    turn = (MAX_SPEED / 2.0) ** 2 / max(abs(step), TURN_TIME)
    for track in range(2):
        for mode in range(2):
            weight = [change[i, mode] * motion.probability[track, i] for i in range(2)]
            assert found.probability[track, mode] == pytest.approx(sum(weight))
            share = np.array(weight) / sum(weight)
            mean = sum(share[i] * motion.state[track, i] for i in range(2))
            spread = np.zeros((4, 4))
            for i in range(2):
                apart = motion.state[track, i] - mean
                spread += share[i] * (motion.covariance[track, i] + np.outer(apart, apart))
            noise = PROCESS_NOISE + (turn if mode else 0.0)
            state, covariance = predict(mean[None], spread[None], step, noise)
            np.testing.assert_allclose(found.state[track, mode], state[0])
            np.testing.assert_allclose(found.covariance[track, mode], covariance[0])


def test_what_is_not_known_of_a_turn_grows_while_nothing_is_seen():
    motion = InteractingModels.of(STATE, COVARIANCE)
    for _ in range(6):
        motion = motion.predicted(np.full(2, 2.5), MAX_SPEED)
    _, covariance = motion.combined()
    _, straight = predict(STATE, COVARIANCE, 15.0, PROCESS_NOISE)
    speed = np.sqrt(covariance[0, 1, 1] - straight[0, 1, 1])
    assert 0.15 * MAX_SPEED < speed < 0.5 * MAX_SPEED
