"""What is predicted of a threshold; that it comes true is tested with the method."""

import math
from dataclasses import replace

import numpy as np
import pytest

from tsepm_ros import SensorModel
from tsepm_ros.tracker import threshold as threshold_plan
from tsepm_ros.tracker.options import ScoreOptions

RULE = {
    "max_speed": 10.0,
    "interval": 12.0,
    "window": 16,
    "gate_probability": 0.99,
    "process_noise": 0.001,
    "deletion": ScoreOptions().deletion_threshold,
    "min_hits": 3,
}


def plan(**sensor: float) -> threshold_plan.ScorePlan:
    return threshold_plan.score_plan(replace(SensorModel(), **sensor), **RULE)


def test_fewer_false_tracks_need_a_higher_threshold():
    made = plan()
    thresholds = [made.threshold(10.0**-power) for power in range(1, 9)]
    assert thresholds == sorted(thresholds)
    assert np.diff(thresholds[-3:]) == pytest.approx([math.log(10.0)] * 2, abs=0.4)


@pytest.mark.parametrize("share", [1e-2, 1e-4, 1e-6, 1e-30, 1e-60])
def test_no_threshold_is_above_the_one_that_holds_for_every_target(share):
    threshold = plan().threshold(share)
    assert -math.log(share) - threshold_plan.MAX_BELOW_VILLE <= threshold <= -math.log(share)


def test_no_target_is_predicted_beyond_the_simulated_thresholds():
    made = plan()
    assert made.passed(0.0)[-1] > 0.5
    assert not made.passed(1e6).any() and made.passed(1e6).shape == made.passed(0.0).shape


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
@pytest.mark.parametrize("window", [3, 8, 16])
def test_a_rarer_wish_has_a_higher_threshold_whatever_the_sensor(sensor, window):
    made = threshold_plan.score_plan(replace(SensorModel(), **sensor), **{**RULE, "window": window})
    thresholds = [made.threshold(10.0**-power) for power in (1, 3, 6, 12, 24)]
    assert np.diff(thresholds) == pytest.approx(np.log(10.0) * np.array([2, 3, 6, 12]), abs=2.5)
    assert thresholds[2] > 10.0


def test_an_azimuth_error_far_below_the_range_error_changes_no_threshold():
    # Detections have as large an error across as along then, in the plan as in the method.
    near = {"range_std": 8.0, "range_std_fraction": 0.0, "max_range": 300.0}
    thresholds = [plan(**near, azimuth_std=std).threshold(1e-4) for std in (1e-6, 1e-4, 1e-2)]
    assert thresholds[:2] == pytest.approx([thresholds[2]] * 2, abs=0.2)
    own = [plan(**near, azimuth_std=std).passed_share for std in (1e-6, 1e-4)]
    assert own[0].shape == own[1].shape
    np.testing.assert_allclose(*own, atol=0.01)


def test_strengths_overshoot_more_so_that_the_threshold_is_lower():
    plain = plan()
    strong = threshold_plan.score_plan(SensorModel(), **RULE, strengths=True)
    for share in (1e-3, 1e-4):
        least = -math.log(share) - threshold_plan.MAX_BELOW_VILLE
        assert least <= strong.threshold(share) < plain.threshold(share)


def test_the_stronger_the_targets_the_sooner_they_pass():
    rest = {name: value for name, value in RULE.items() if name != "window"}
    shares = []
    for ratio in (None, 1.0, 4.0, 30.0):
        made = threshold_plan.score_plans(
            SensorModel(), windows=(16,), scans=16, ratio=ratio, **rest
        )[0]
        shares.append(made.passed(8.0)[7])
    assert shares[0] < shares[2] < shares[3]
    assert shares[1] == pytest.approx(shares[0], abs=0.15)  # 0 dB: nearly nothing
