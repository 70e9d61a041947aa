"""The jump over the threshold that is planned without clutter, against targets in clutter."""

import math

import numpy as np
import pytest
from support.builders import AS_GIVEN
from support.score_scenes import SONAR, score, sea

from tsepm_ros.tracker import threshold as threshold_plan
from tsepm_ros.tracker.options import MIN_HITS, ScoreOptions

TARGETS = 8
SCENES = 8


def drawn(rng: np.random.Generator) -> list[tuple[float, float, float, float]]:
    """Targets far apart, with velocities of the method's prior."""
    angles = 2.0 * np.pi * (np.arange(TARGETS) + rng.random()) / TARGETS
    found = []
    for angle in angles:
        velocity = rng.normal(0.0, 5.0, 2)
        while math.hypot(*velocity) > 10.0:
            velocity = rng.normal(0.0, 5.0, 2)
        range_ = rng.uniform(5000.0, 7000.0)
        found.append((range_ * math.cos(angle), velocity[0], range_ * math.sin(angle), velocity[1]))
    return found


def jumps(rate: float) -> tuple[np.ndarray, float]:
    """Evidence above the threshold at each target's start, and the last threshold."""
    beyond = []
    for scene in range(SCENES):
        rng = np.random.default_rng([31, scene])
        targets = np.array(drawn(rng))
        initiator = score(false_tracks_per_hour=rate, **AS_GIVEN)
        started: set[int] = set()
        for index, scan in enumerate(sea(rng, 16, [tuple(target) for target in targets])):
            places = targets[:, 0::2] + 12.0 * index * targets[:, 1::2]
            for track in initiator.process(scan):
                apart = np.hypot(*(places - track.state[0::2]).T)
                nearest = int(np.argmin(apart))
                if apart[nearest] < 500.0 and nearest not in started:
                    started.add(nearest)
                    beyond.append(track.evaluation)
    return np.array(beyond), initiator.method.threshold


@pytest.mark.long
@pytest.mark.parametrize("rate", [1.0, 100.0])
def test_the_planned_jump_is_that_of_targets_in_clutter(rate):
    # 64 targets: a standard error of 0.04.
    beyond, threshold = jumps(rate)
    options = ScoreOptions()
    plan = threshold_plan.score_plan(
        SONAR,
        max_speed=10.0,
        interval=threshold_plan.rounded(12.0),
        window=options.window,
        gate_probability=options.gate_probability,
        process_noise=options.process_noise,
        deletion=options.deletion_threshold,
        min_hits=MIN_HITS,
    )
    row = int(np.searchsorted(threshold_plan.THRESHOLDS, threshold))
    planned = plan.false_share[row] * math.exp(threshold) / plan.passed_share[row, -1]
    assert len(beyond) > 0.6 * SCENES * TARGETS
    assert np.exp(-beyond).mean() == pytest.approx(planned, abs=0.12)
