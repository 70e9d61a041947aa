# Copyright 2026 tsepm_ros developers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.
"""The threshold keeps the wanted false-track rate, by the scans as they come; its plan."""

import math
from dataclasses import replace

import numpy as np
import pytest
from support.builders import AS_GIVEN, observation_of, scan_at
from support.score_scenes import NEVER, SONAR, score, sea

from tsepm_ros import Scan, SensorModel
from tsepm_ros.tracker import threshold as threshold_plan
from tsepm_ros.tracker.options import ScoreOptions
from tsepm_ros.tracker.sensor import Picture
from tsepm_ros.tracker.threshold import PlanModel, Threshold, coarse_sensor, score_simulation
from tsepm_ros.tracker.tracker import Tracker


@pytest.mark.parametrize("rate", [0.0, 5e-324, 1e-31])
def test_a_rate_of_next_to_no_false_tracks_is_refused(rate):
    with pytest.raises(ValueError, match="false_tracks_per_hour must be from 1e-30"):
        score(false_tracks_per_hour=rate)


def test_the_smallest_rate_has_a_threshold():
    initiator = score(false_tracks_per_hour=NEVER)
    for k in range(4):
        initiator.process(scan_at(0.1 * k, np.full((500, 2), 3000.0)))
    assert 0.0 < initiator.method.threshold < math.inf


def observed(scans: list[Scan], **options) -> tuple[Threshold, Tracker]:
    """The threshold after scans, and the initiator that observed them."""
    initiator, threshold = score(**options), Threshold()
    for scan in scans:
        threshold.observe(observation_of(initiator, scan))
    return threshold, initiator


def test_the_share_of_false_starts_is_the_rate_over_the_detections_per_hour():
    spread = np.stack([np.linspace(-5e3, 5e3, 100), np.linspace(3e3, -3e3, 100)], axis=1)
    threshold, _ = observed([scan_at(12.0 * k, spread) for k in range(4)])
    assert threshold.false_share(3.0) == pytest.approx(3.0 / (100 * 300.0))
    assert threshold.false_share(1e6) == 1.0


def test_one_scan_has_no_threshold_yet():
    threshold, _ = observed([scan_at(0.0, [(3000.0, 0.0)])])
    assert threshold.false_share(1.0) is None
    assert threshold.value(1.0) == math.inf


@pytest.mark.parametrize(("interval", "pings"), [(0.1, 2), (0.5, 2), (1.0, 1), (12.0, 1)])
def test_a_plan_is_shared_among_fast_pings_and_villes_bound_holds_until_it_is_ready(
    interval, pings
):
    threshold, initiator = observed(sea(np.random.default_rng(2), 3, []), **AS_GIVEN)
    threshold.observe(replace(threshold._last, picture=Picture(own=interval)))
    models = SONAR, initiator.common, initiator.options
    share = threshold.false_share(1.0)
    ville, ends = -math.log(share), [0]
    threshold.prepare(*models, ville - 20.0)
    assert not threshold._simulated, "no evidence is near"
    while threshold.value(1.0) == ville and len(ends) < 9:
        threshold.prepare(*models, ville - 5.0)
        ends += threshold._simulated.values()
    (model,) = threshold._simulated
    simulated = [sum(range(model.scans - end)) for end in ends]
    assert len(ends) == 1 + pings and simulated[-1] == 0
    steps = -np.diff([simulated[0] + 1.5 * model.scans, *simulated[1:]])  # drawing counts
    assert max(steps) <= max(80, 160 * interval) + model.scans
    one_by_one = threshold_plan.ScoreSimulation(model)
    (plan,) = [one_by_one.run(1 + first) for first in range(model.scans)][-1].plans
    assert threshold.value(1.0) == plan.threshold(share) < ville
    np.testing.assert_allclose(threshold._plan.false_share, plan.false_share, rtol=1e-12)
    again = Threshold()
    again.observe(threshold._last)
    assert again.value(1.0) == ville, "a plan of another tracker makes no result another"


def test_estimates_are_rounded_and_what_is_given_is_not():
    initiator = score()
    seen = observation_of(initiator, sea(np.random.default_rng(2), 1, [])[0])
    seen = replace(seen, detection_probability_in_use=0.77)
    seen.detections["clutter_density"] = 2.5e-6
    coarse = coarse_sensor(SONAR, seen, initiator.common)
    assert coarse.detection_probability == 0.8
    assert coarse.clutter_density == pytest.approx(10.0**-5.5)
    given = coarse_sensor(SONAR, seen, score(**AS_GIVEN).common)
    assert given == replace(SONAR, range_rate_std=0.0)


def test_errors_that_detections_state_count_in_steps_as_those_of_the_sensor():
    initiator, plain = score(), scan_at(0.0, [(3000.0, 0.0)])
    wide = plain.replaced(stamp=1.0, range_std=[4.1 * 45.0], azimuth_std=[3.9 * SONAR.azimuth_std])
    turned = plain.replaced(stamp=2.0, sensor_pose_covariance=np.diag([0.0, 0.0, 0.1**2]))
    none, stated, of_pose = (
        coarse_sensor(SONAR, observation_of(initiator, scan), initiator.common)
        for scan in (plain, wide, turned)
    )
    assert none.range_std_fraction == SONAR.range_std_fraction
    assert none.azimuth_std == SONAR.azimuth_std
    assert stated.azimuth_std == pytest.approx(4.0 * SONAR.azimuth_std)
    assert stated.range_std_fraction == pytest.approx(4.0 * SONAR.range_std_fraction)
    assert of_pose.azimuth_std > 1.9 * SONAR.azimuth_std


@pytest.mark.parametrize("extent", [0.0, 200.0])
def test_false_tracks_are_as_many_as_accepted_whatever_errors_the_detections_have(extent):
    rng, sonar = np.random.default_rng(11), SensorModel(range_std=6.0, max_range=3000.0)
    initiator = score(
        replace(sonar, range_std_fraction=0.0), false_tracks_per_hour=100.0, target_extent=extent
    )
    stated = {"range_std": np.full(20, 60.0), "azimuth_std": np.full(20, 0.087)}
    for ping in range(300):
        range_, azimuth = 3000.0 * np.sqrt(rng.random(20)), rng.uniform(-np.pi, np.pi, 20)
        initiator.process(Scan(2.0 * ping, range_, azimuth, **({} if extent else stated)))
    assert initiator.totals.confirmed <= 1.3 * 100.0 * 600.0 / 3600.0


def plan_of(
    sensor: SensorModel, window: int = 16, ratio: float | None = None
) -> threshold_plan.ScorePlan:
    deletion = ScoreOptions().deletion_threshold
    model = PlanModel(sensor, 10.0, 12.0, (window,), deletion, window, ratio=ratio)
    (made,) = score_simulation(model).run(window).plans
    return made


def plan(**sensor: float) -> threshold_plan.ScorePlan:
    return plan_of(replace(SensorModel(), **sensor))


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
    made = plan_of(replace(SensorModel(), **sensor), window)
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


def test_amplitudes_overshoot_more_so_that_the_threshold_is_lower():
    plain = plan()
    strong = plan_of(SensorModel(), ratio=threshold_plan.ANY_RATIO)
    for share in (1e-3, 1e-4):
        least = -math.log(share) - threshold_plan.MAX_BELOW_VILLE
        assert least <= strong.threshold(share) < plain.threshold(share)


def test_the_stronger_the_targets_the_sooner_they_pass():
    ratios = (None, 1.0, 4.0, 30.0)
    shares = [plan_of(SensorModel(), ratio=ratio).passed(8.0)[7] for ratio in ratios]
    assert shares[0] < shares[2] < shares[3]
    assert shares[1] == pytest.approx(shares[0], abs=0.15)  # 0 dB: nearly nothing
