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
"""What a design predicts, against what methods do."""

import dataclasses
import math

import numpy as np
import pytest
from support.run_summaries import study

from tsepm_ros import SensorModel
from tsepm_ros.methods.tsepm import TsepmOptions
from tsepm_ros.tools.design import expected_counts, prediction
from tsepm_ros.tools.design.expected_counts import ExpectedGating
from tsepm_ros.tools.design.prediction import (
    MIN_TARGETS,
    PredictionCase,
    predicted_false_tracks_per_hour,
    prediction_known_within,
    prediction_remedies,
    prediction_scenes,
    prediction_statistics,
)
from tsepm_ros.tools.evaluation.measures import measures_of
from tsepm_ros.tools.evaluation.simulated_run import SimulatedOperatingPoint
from tsepm_ros.tools.simulation import Scenario
from tsepm_ros.tools.simulation.scenario import ScenarioTargetArea
from tsepm_ros.tools.terminal import named_terminal_progress
from tsepm_ros.tracker.options import CommonOptions, ScoreOptions

SECTOR = SensorModel(max_range=6000.0, azimuth_min=-0.5, azimuth_max=0.5)


@pytest.mark.long
@pytest.mark.parametrize(
    ("method", "options"),
    [("score", {"false_tracks_per_hour": 3.0}), ("tsepm", {"min_hits": 6, "window": 8})],
)
def test_p_d_of_targets_in_patches_is_that_in_the_whole_coverage(method, options):
    """Within 0.03, as promised, and the noise of 150 runs each (99 %)."""
    case = PredictionCase(sensor=SECTOR)
    predicted = prediction_statistics(case, method, options, runs=150, seed=11)
    area = ScenarioTargetArea(1, (1000.0, 6000.0), (-0.4, 0.4), 5.0)
    scene = Scenario(name="sector", sensor=SECTOR, areas=(area,))
    point = SimulatedOperatingPoint(method, options=options)
    measured = measures_of(scene, list(study(scene, point, range(150), 12))).found
    noise = math.sqrt(2 * measured.value * (1 - measured.value) / 150)
    assert abs(predicted.found.value - measured.value) < 0.03 + 2.6 * noise


@pytest.mark.long
def test_rules_confirm_no_more_clutter_than_they_are_said_to():
    case = PredictionCase(sensor=dataclasses.replace(SensorModel(), clutter_density=3e-7))
    rules = prediction.predicted_rules_within(case, TsepmOptions(), 60.0)
    assert [rule.window for rule in rules] == sorted({rule.window for rule in rules})
    rule = next(rule for rule in rules if rule.window == 8)
    options = {"min_hits": rule.min_hits, "window": rule.window}
    measured = predicted_false_tracks_per_hour(case, "tsepm", options, scans=400, seed=3)
    assert 0.3 * rule.false_per_hour < measured.high
    assert measured.low < rule.false_per_hour <= 60.0


@pytest.mark.parametrize(
    "values",
    [
        {"interval": 0.0},
        {"interval": math.nan},
        {"scans": 2},
        {"target_speed": -1.0},
        {"target_speed": 11.0},
    ],
    ids=str,
)
def test_a_case_that_makes_no_sense_is_refused(values):
    name = next(iter(values)).replace("target_", "")
    with pytest.raises(ValueError, match=name):
        PredictionCase(sensor=SensorModel(), **values)


@pytest.mark.long
@pytest.mark.usefixtures("little_clutter")
def test_false_tracks_of_a_rule_that_finds_fewer_targets_are_not_simulated():
    """12 of 12 pings at p_d = 0.9: a third of the targets at most, and `score` finds nearly all."""
    case = PredictionCase(sensor=dataclasses.replace(SECTOR, clutter_density=1e-8), scans=16)
    few = prediction.PredictedRule(
        min_hits=12, window=12, one_start=0.3, in_time=0.3, false_per_hour=1e-9
    )
    score, rule = prediction.predicted_candidates(
        case,
        ScoreOptions(),
        TsepmOptions(),
        [few],
        wanted=0.9,
        runs=12,
        seed=1,
        processes=1,
        progress=named_terminal_progress,
    )
    assert rule.targets.found.high < score.targets.found.low
    assert score.false_simulated.low >= 0.0 and math.isnan(rule.false_simulated.value)


@pytest.mark.long
def test_bisection_finds_the_first_rule_that_keeps_the_rate():
    case = PredictionCase(sensor=dataclasses.replace(SensorModel(), clutter_density=3e-7))
    for rule in prediction.predicted_rules_within(case, TsepmOptions(), 60.0):
        gating = ExpectedGating(
            sensor=case.sensor, max_speed=10.0, interval=case.interval, gate_probability=0.9
        )
        for min_hits in range(2, rule.min_hits):
            fewer = TsepmOptions(min_hits=min_hits, window=rule.window)
            raw = expected_counts.expected(gating, min_hits, rule.window, 3 * rule.window).raw
            rate = raw[rule.window :].mean() * case.scans_per_hour
            assert rate * expected_counts.clutter_pass_share(gating, fewer) > 60.0


@pytest.mark.long
def test_a_design_knows_the_strength_of_its_targets():
    plain = PredictionCase(sensor=SensorModel())
    strong = dataclasses.replace(plain, ratio_db=6.0)
    [(threshold, passed)] = prediction.predicted_passages(plain, ScoreOptions(), [16])
    [(lower, more)] = prediction.predicted_passages(strong, ScoreOptions(), [16])
    assert lower < threshold and more[-1] > passed[-1] + 0.2
    off = dataclasses.replace(strong, common=CommonOptions(intensity="off"))
    [(same, as_many)] = prediction.predicted_passages(off, ScoreOptions(), [16])
    assert same == threshold and as_many.tolist() == passed.tolist()
    with pytest.raises(ValueError, match="ratio must be"):
        PredictionCase(sensor=SensorModel(), ratio_db=1e3)


def test_a_shorter_range_is_a_remedy():
    case = PredictionCase(sensor=SensorModel(max_range=1000.0))
    shorter = dict(prediction_remedies(case))["a range of 700 m"]
    assert shorter.sensor.max_range == 700.0 and math.isclose(
        shorter.sensor.coverage_area, 0.49 * case.sensor.coverage_area
    )


def test_a_change_with_which_no_target_stays_in_the_coverage_is_left_out():
    """Of 1 m/s in 40 m and 6 pings of 12 s; not within twice as many pings."""
    sensor = SensorModel(max_range=40.0, clutter_density=1e-3)
    case = PredictionCase(sensor=sensor, scans=6, target_speed=1.0)
    found = prediction.predicted_remedied_detection(
        case,
        ScoreOptions(),
        given_window=True,
        runs=2,
        seed=1,
        processes=1,
        progress=named_terminal_progress,
    )
    changes = [text for text, _ in found]
    assert "twice as many pings" in dict(prediction_remedies(case))
    assert "twice as many pings" not in changes and "ten times as many false tracks" in changes


DEFAULT = PredictionCase(sensor=SensorModel())

MAX_STEP = DEFAULT.common.max_speed * DEFAULT.interval


def states(case: PredictionCase, number: int) -> np.ndarray:
    return np.array([t for scene in prediction_scenes(case, number, 3) for t in scene.targets])


def test_targets_of_a_scene_stay_apart_in_the_coverage_and_uniform_over_it():
    times = DEFAULT.interval * np.arange(DEFAULT.scans)
    for scene in prediction_scenes(DEFAULT, 100, 3):
        paths = [s[0::2] + times[:, None] * s[1::2] for s in scene.targets]
        assert all((np.hypot(*path.T) <= DEFAULT.sensor.max_range).all() for path in paths)
        for row, one in enumerate(paths):
            for other in paths[:row]:  # two gates and four standard deviations at least
                assert np.hypot(*(one - other).T).min() > 2 * MAX_STEP
    case = dataclasses.replace(DEFAULT, target_speed=0.0)
    square = (states(case, 2000)[:, 0::2] ** 2).sum(axis=1) / 9000.0**2
    assert np.quantile(square, [0.25, 0.5, 0.75]) == pytest.approx([0.25, 0.5, 0.75], abs=0.04)


def test_a_target_depends_neither_on_the_others_nor_on_the_clutter():
    few, many = states(DEFAULT, 20), states(DEFAULT, 100)
    assert {tuple(state) for state in few} <= {tuple(state) for state in many}
    sparse = dataclasses.replace(DEFAULT, sensor=SensorModel(clutter_density=1e-8))
    assert {tuple(state) for state in states(sparse, 20)} == {tuple(state) for state in few}
    assert all(len(scene.targets) == 1 for scene in prediction_scenes(sparse, 20, 3))


def test_where_the_coverage_is_too_large_each_target_has_its_patch(monkeypatch):
    monkeypatch.setattr(prediction, "MAX_WHOLE_COVERAGE", 100.0)
    for scene in prediction_scenes(DEFAULT, 5, 3):
        [state] = scene.targets
        x_min, x_max, y_min, y_max = scene.clutter_box
        end = state[0::2] + state[1::2] * scene.duration
        for x, y in (state[0::2], end):
            assert x_min < x < x_max and y_min < y < y_max
        assert scene.area < DEFAULT.sensor.coverage_area


@pytest.mark.long
@pytest.mark.parametrize("processes", [1, 2])
def test_the_simulation_ends_when_enough_is_known(processes):
    case = PredictionCase(sensor=SensorModel(max_range=4000.0, clutter_density=1e-7), scans=6)
    found = prediction_statistics(
        case,
        "score",
        {"false_tracks_per_hour": 10.0},
        runs=60,
        seed=1,
        processes=processes,
        enough=lambda detection: prediction_known_within(detection, 1.0),
    )
    assert MIN_TARGETS <= found.targets < 60
