"""What is predicted of a threshold; that it comes true is tested with the method."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tsepm_ros import SensorModel, design

RULE = {
    "max_speed": 10.0,
    "interval": 12.0,
    "window": 16,
    "gate_probability": 0.99,
    "process_noise": 0.001,
    "deletion": math.log(0.005),
    "min_hits": 3,
}


def plan(**sensor: float) -> design.ScorePlan:
    return design.score_plan(replace(SensorModel(), **sensor), **RULE)


def test_fewer_false_tracks_need_a_higher_threshold():
    made = plan()
    thresholds = [made.threshold(10.0**-power) for power in range(1, 9)]
    assert thresholds == sorted(thresholds)
    assert np.diff(thresholds[-3:]) == pytest.approx([math.log(10.0)] * 2, abs=0.35)


@pytest.mark.parametrize("share", [1e-2, 1e-4, 1e-6, 1e-30, 1e-60])
def test_a_start_from_clutter_never_passes_more_often_than_ville_allows(share):
    threshold = plan().threshold(share)
    assert threshold <= -math.log(share) + 0.1


def test_the_same_question_is_answered_from_memory():
    assert plan() is plan()
    assert design.rounded(12.0349) == 12.0
    assert design.rounded(0.001234) == 0.0012


@pytest.mark.parametrize(
    "sensor",
    [
        {"azimuth_std": 1e-9},
        {"azimuth_std": 1.0, "max_range": 1e6},
        {"detection_probability": 1.0},
        {"detection_probability": 0.01},
        {"clutter_density": 1e-30},
        {"clutter_density": 1.0},
        {"range_std": 1e4},
    ],
    ids=str,
)
def test_every_sensor_has_a_threshold(sensor):
    assert 0.0 <= plan(**sensor).threshold(1e-6) < 60.0
