"""Studies: the same scene gives the design's figures."""

from __future__ import annotations

import dataclasses
import math
from collections import Counter

import numpy as np
import pytest

from tsepm_ros.analysis.intervals import Z_95
from tsepm_ros.analysis.study import RunResult, judge_run, placed, run, study, summary
from tsepm_ros.analysis.truth import Outcome
from tsepm_ros.simulation import Scenario, Simulator, load_scenario
from tsepm_ros.simulation.scenario import OwnShipMotion

BOX = dataclasses.replace(load_scenario("box"), scans=8)
RUNS = 150


@pytest.fixture(scope="module")
def box() -> list[RunResult]:
    """The published method, 5/8, literal, over 8 scans of the box scene."""
    return list(study(BOX, "tsepm", {}, runs=RUNS, seed=2018))


def test_p_d_in_the_box_scene_is_the_design_s(box):
    # Design, section 6: 0.916 in 500 runs. The two shares differ by chance with a standard error
    # of sqrt(0.916 * 0.084 * (1 / 150 + 1 / 500)) = 0.026; 3.3 of them are 99.9 %.
    share = summary(BOX, box).detection.value
    error = math.sqrt(0.916 * 0.084 * (1 / RUNS + 1 / 500))
    assert abs(share - 0.916) < 3.3 * error


def test_false_tracks_in_the_box_scene_are_the_design_s(box):
    # Design: 21.6 per run in 500 runs, false and misplaced; one run has a standard deviation of
    # about 6.4. 3.3 standard errors of the difference, 2.0, are 99.9 %.
    false = [one.outcomes[Outcome.FALSE] + one.outcomes[Outcome.MISPLACED] for one in box]
    error = np.std(false, ddof=1) * math.sqrt(1 / RUNS + 1 / 500)
    assert error < 0.8
    assert abs(np.mean(false) - 21.6) < 3.3 * error


def test_run_i_has_its_own_seed_and_does_not_depend_on_the_others(box):
    assert box[3] == run(BOX, [2018, 3], "tsepm", {})
    assert box[3] != box[4]
    assert list(study(BOX, "tsepm", {}, runs=3, seed=2018)) == box[:3]
    assert list(study(BOX, "tsepm", {}, runs=3, seed=2019)) != box[:3]


def test_two_workers_give_the_same_numbers_as_one(box):
    assert list(study(BOX, "tsepm", {}, runs=6, seed=2018, workers=2)) == box[:6]


def test_options_reach_the_method(box):
    squared = run(BOX, [2018, 0], "tsepm", {"pruning_reading": "squared"})
    assert sum(squared.outcomes.values()) > sum(box[0].outcomes.values())
    with pytest.raises(ValueError, match="colour is not an option"):
        run(BOX, [1, 1], "tsepm", {"colour": "red"})


def test_a_run_counts_what_is_judged():
    judged = judge_run(BOX, [2018, 0], "tsepm", {})
    result = run(BOX, [2018, 0], "tsepm", {})
    assert result.targets == 1
    assert result.outcomes == Counter(one.outcome for one in judged)
    true = [one for one in judged if one.outcome is Outcome.TRUE]
    assert result.nees == [one.nees for one in true]
    assert result.confirmation_times == [one.track.stamp for one in true]


def test_a_summary_by_hand():
    scenario = Scenario("hand", scans=4, clutter_box=(0.0, 1000.0, 0.0, 2000.0))
    results = [
        RunResult(
            2,
            Counter({Outcome.TRUE: 2, Outcome.FALSE: 3}),
            [3.0, 5.0],
            [30.0, 40.0],
            [1.0, 7.0],
            [36.0, 48.0],
        ),
        RunResult(
            2,
            Counter({Outcome.TRUE: 1, Outcome.MISPLACED: 1, Outcome.REDUNDANT: 4}),
            [7.0],
            [0.0],
            [1.0],
            [60.0],
        ),
    ]
    figures = summary(scenario, results)
    assert figures.runs == 2
    assert figures.detection.value == 3 / 4
    assert figures.false_per_run.value == 2.0
    assert figures.false_per_run.high == pytest.approx(2.0 + Z_95 * 1.0)
    assert figures.false_density.value == pytest.approx(2.0 / (4 * 2.0))
    assert figures.false_density.low == pytest.approx(figures.false_per_run.low / 8.0)
    assert figures.redundant_per_run.value == 2.0
    assert figures.nees.value == 5.0
    assert figures.position_error.value == pytest.approx(math.sqrt(2500 / 3))
    assert figures.velocity_error.value == pytest.approx(math.sqrt(51 / 3))
    assert figures.confirmation_time.value == 48.0


def test_a_study_without_any_true_track_has_no_errors_to_report():
    figures = summary(BOX, [RunResult(1, Counter(), [], [], [], [])] * 3)
    assert figures.detection.value == 0.0
    assert math.isnan(figures.nees.value)


def test_simulated_echoes_are_placed_on_their_targets_whatever_the_ship_does():
    scenario = dataclasses.replace(
        load_scenario("four_targets"),
        sensor=dataclasses.replace(
            BOX.sensor,
            range_std=1e-3,
            range_std_fraction=0.0,
            azimuth_std=1e-7,
            detection_probability=1.0,
            clutter_density=1e-20,
        ),
        own_ship=OwnShipMotion(100.0, -50.0, 1.0, speed=8.0, turn_rate=0.01),
    )
    simulator = Simulator(scenario, 3)
    worst = 0.0
    for simulated in simulator:
        scan = placed(simulated.scan, scenario.own_ship)
        angle = scan.azimuth + scan.sensor_pose[:, 2]
        x = scan.sensor_pose[:, 0] + scan.range * np.cos(angle)
        y = scan.sensor_pose[:, 1] + scan.range * np.sin(angle)
        for k, target in enumerate(simulated.origin):
            truth = simulator.truth(scan.stamp + scan.time_offset[k])[target]
            worst = max(worst, math.hypot(x[k] - truth[0], y[k] - truth[2]))
    assert 0.0 < worst < 1.0
