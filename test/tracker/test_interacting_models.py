"""Modes of motion of the tracks held."""

from __future__ import annotations

import numpy as np

from tsepm_ros.tracker.motion import (
    PROCESS_NOISE,
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


def test_what_is_not_known_of_a_turn_grows_while_nothing_is_seen():
    motion = InteractingModels.of(STATE, COVARIANCE)
    for _ in range(6):
        motion = motion.predicted(np.full(2, 2.5), MAX_SPEED)
    _, covariance = motion.combined()
    _, straight = predict(STATE, COVARIANCE, 15.0, PROCESS_NOISE)
    speed = np.sqrt(covariance[0, 1, 1] - straight[0, 1, 1])
    assert 0.15 * MAX_SPEED < speed < 0.5 * MAX_SPEED
