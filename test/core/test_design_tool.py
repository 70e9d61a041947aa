"""What `tsepm design` predicts, against what the methods then do."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from tsepm_ros import SensorModel
from tsepm_ros.analysis import designing
from tsepm_ros.analysis.figures import figures_of
from tsepm_ros.analysis.operating_points import OperatingPoint
from tsepm_ros.analysis.prediction import (
    Case,
    clutter_pass_share,
    false_tracks_per_hour,
    target_pass_share,
    targets_found,
)
from tsepm_ros.analysis.splitting_theory import Gating
from tsepm_ros.analysis.study import study
from tsepm_ros.cli import main
from tsepm_ros.methods.score import ScoreOptions
from tsepm_ros.methods.tsepm import TsepmOptions
from tsepm_ros.simulation import Scenario
from tsepm_ros.simulation.scenario import TargetArea

SECTOR = SensorModel(max_range=7000.0, azimuth_min=-0.6, azimuth_max=0.6)


@pytest.mark.parametrize(
    ("method", "options"),
    [("score", {"false_tracks_per_hour": 3.0}), ("tsepm", {"min_hits": 6, "window": 8})],
)
def test_p_d_of_targets_in_patches_is_that_in_the_whole_coverage(method, options):
    """Within 0.03, as promised, and the noise of 150 runs each (99 %)."""
    case = Case(sensor=SECTOR)
    predicted = targets_found(case, method, options, runs=150, seed=11)
    area = TargetArea(1, (0.0, 7000.0), (-0.5, 0.5), 5.0)
    scene = Scenario(name="sector", sensor=SECTOR, areas=(area,))
    point = OperatingPoint(method, options=options)
    measured = figures_of(scene, list(study(scene, point, range(150), 12))).detection
    noise = math.sqrt(2 * measured.value * (1 - measured.value) / 150)
    assert abs(predicted.detection.value - measured.value) < 0.03 + 2.6 * noise


def test_rules_confirm_no_more_clutter_than_they_are_said_to():
    case = Case(sensor=dataclasses.replace(SensorModel(), clutter_density=3e-7))
    rules = designing.rules_within(case, TsepmOptions(), 60.0)
    assert [rule.window for rule in rules] == sorted({rule.window for rule in rules})
    rule = next(rule for rule in rules if rule.window == 8)
    options = {"min_hits": rule.min_hits, "window": rule.window}
    measured = false_tracks_per_hour(case, "tsepm", options, scans=800, seed=3)
    assert 0.3 * rule.false_per_hour < measured.high
    assert measured.low < rule.false_per_hour <= 60.0


def test_one_hit_fewer_would_break_the_wish():
    case = Case(sensor=dataclasses.replace(SensorModel(), clutter_density=3e-7))
    rule = next(r for r in designing.rules_within(case, TsepmOptions(), 30.0) if r.window == 8)
    options = {"min_hits": rule.min_hits - 1, "window": rule.window}
    assert false_tracks_per_hour(case, "tsepm", options, scans=400, seed=3).low > 30.0


def test_nothing_is_promised_where_a_hit_is_worth_nothing():
    case = Case(sensor=dataclasses.replace(SensorModel(), clutter_density=5e-6))
    assert designing.worth(case, 0.99).scan < 0
    assert not designing.rules_within(case, TsepmOptions(), 1.0)
    _, share = designing.score_threshold(case, ScoreOptions())
    assert share < 0.3


def test_the_worth_of_a_hit_is_its_mean_gain():
    case = Case(sensor=SensorModel(), target_range=5000.0)
    rng = np.random.default_rng(1)
    sigma = np.array([0.015 * 5000.0, np.deg2rad(1.0) * 5000.0])
    errors = rng.normal(size=(100_000, 2)) * sigma
    log_density = (-0.5 * (errors / sigma) ** 2 - np.log(sigma * math.sqrt(2 * math.pi))).sum(1)
    gain = np.log(0.9 / 1e-6) + log_density
    assert designing.worth(case, 0.99).hit == pytest.approx(gain.mean(), abs=0.02)


def test_the_share_of_targets_that_pass_the_evaluation():
    gating = Gating(sensor=SensorModel(), max_speed=10.0, interval=12.0, gate_probability=0.9)
    shares = [
        target_pass_share(gating, TsepmOptions(pruning_reading=reading), 5.0)
        for reading in ("literal", "squared")
    ]
    assert 0.7 < shares[0] < 0.9 and 0.99 < shares[1] < 1.0
    assert clutter_pass_share(gating, TsepmOptions()) < shares[0]


def test_a_longer_window_is_chosen_where_it_pays():
    easy = Case(sensor=dataclasses.replace(SensorModel(), clutter_density=1e-8), scans=24)
    hard = Case(sensor=dataclasses.replace(SensorModel(), clutter_density=2e-6), scans=24)
    options = ScoreOptions()
    assert designing.score_window(easy, options) < designing.score_window(hard, options)


@pytest.mark.parametrize(
    "values",
    [
        {"interval": 0.0},
        {"interval": math.nan},
        {"scans": 2},
        {"target_speed": -1.0},
        {"target_range": 9001.0},
    ],
    ids=str,
)
def test_a_case_that_makes_no_sense_is_refused(values):
    name = next(iter(values)).replace("target_range", "range")
    with pytest.raises(ValueError, match=name):
        Case(sensor=SensorModel(), **values)


def test_the_command_says_what_to_expect_and_writes_parameters(capsys, tmp_path):
    file = tmp_path / "sonar.yaml"
    given = ["-p", "sensor.clutter_density:=1.0e-7", "-p", "sensor.max_range:=5000.0"]
    assert main(["design", "--runs", "60", "--workers", "1", "--write", str(file), *given]) == 0
    said = capsys.readouterr().out
    assert "78.5 km^2" in said and "the wish can be met" in said
    text = file.read_text()
    assert "method: score" in text and "sensor.clutter_density: 1.0e-07" in text
    assert "score.window:" in text


def test_a_wish_that_cannot_be_met_comes_with_what_would_help(capsys):
    given = ["-p", "sensor.clutter_density:=4.0e-6", "-p", "sensor.max_range:=1500.0"]
    given += ["-p", "sensor.range_std:=200.0", "-p", "max_speed:=4.0"]
    assert main(["design", "--runs", "10", "--workers", "1", "--scans", "6", *given]) == 0
    said = capsys.readouterr().out
    assert "the wish cannot be met" in said
    assert "what would help" in said and "twice as many pings" in said
