"""What `tsepm design` predicts, against what the methods then do."""

import dataclasses
import math

import numpy as np
import pytest
import yaml

from tsepm_ros import SensorModel
from tsepm_ros.methods.tsepm import TsepmOptions
from tsepm_ros.settings.settings import TRACK_INITIATOR, make_groups, settings_from
from tsepm_ros.tools.commands.cli import main
from tsepm_ros.tools.design import search
from tsepm_ros.tools.design.expected_counts import (
    Gating,
    clutter_pass_share,
    expected_counts,
    target_pass_share,
)
from tsepm_ros.tools.design.prediction import (
    ONE_PROCESS,
    Case,
    false_tracks_per_hour,
    target_statistics,
)
from tsepm_ros.tools.evaluation.measures import measures_of
from tsepm_ros.tools.evaluation.performance import study
from tsepm_ros.tools.evaluation.simulated_run import OperatingPoint
from tsepm_ros.tools.simulation import Scenario
from tsepm_ros.tools.simulation.scenario import TargetArea
from tsepm_ros.tools.terminal import named_progress
from tsepm_ros.tracker.options import CommonOptions, ScoreOptions
from tsepm_ros.tracker.pruning import clutter_threshold

SECTOR = SensorModel(max_range=6000.0, azimuth_min=-0.5, azimuth_max=0.5)


@pytest.mark.long
@pytest.mark.parametrize(
    ("method", "options"),
    [("score", {"false_tracks_per_hour": 3.0}), ("tsepm", {"min_hits": 6, "window": 8})],
)
def test_p_d_of_targets_in_patches_is_that_in_the_whole_coverage(method, options):
    """Within 0.03, as promised, and the noise of 150 runs each (99 %)."""
    case = Case(sensor=SECTOR)
    predicted = target_statistics(case, method, options, runs=150, seed=11)
    area = TargetArea(1, (1000.0, 6000.0), (-0.4, 0.4), 5.0)
    scene = Scenario(name="sector", sensor=SECTOR, areas=(area,))
    point = OperatingPoint(method, options=options)
    measured = measures_of(scene, list(study(scene, point, range(150), 12))).detection
    noise = math.sqrt(2 * measured.value * (1 - measured.value) / 150)
    assert abs(predicted.detection.value - measured.value) < 0.03 + 2.6 * noise


@pytest.mark.long
def test_rules_confirm_no_more_clutter_than_they_are_said_to():
    case = Case(sensor=dataclasses.replace(SensorModel(), clutter_density=3e-7))
    rules = search.rules_within(case, TsepmOptions(), 60.0)
    assert [rule.window for rule in rules] == sorted({rule.window for rule in rules})
    rule = next(rule for rule in rules if rule.window == 8)
    options = {"min_hits": rule.min_hits, "window": rule.window}
    measured = false_tracks_per_hour(case, "tsepm", options, scans=400, seed=3)
    assert 0.3 * rule.false_per_hour < measured.high
    assert measured.low < rule.false_per_hour <= 60.0


@pytest.mark.parametrize("density", [1e-6, 5e-6])
def test_the_worth_of_a_ping_is_that_of_simulated_ones(density):
    sensor = dataclasses.replace(SensorModel(), clutter_density=density)
    increments = search.ping_increments(Case(sensor=sensor, target_range=5000.0), 0.99)
    rng = np.random.default_rng(1)
    sigma = np.array([0.015 * 5000.0, np.deg2rad(1.0) * 5000.0])
    peak = 1.0 / (2.0 * math.pi * sigma.prod())
    gate, area, gains, hits = -2.0 * math.log(0.01), (12.0 * sigma).prod(), [], []
    for _ in range(20_000):
        points = rng.uniform(-6.0, 6.0, (rng.poisson(density * area), 2))
        if rng.random() < 0.9:
            own = rng.standard_normal((1, 2))
            hits.append(math.log(0.9 * peak / density) - 0.5 * float((own**2).sum()))
            points = np.concatenate([points, own])
        square = (points**2).sum(axis=1)
        total = np.exp(-0.5 * square[square <= gate]).sum() * peak
        gains.append(math.log(1.0 - 0.9 * 0.99 + 0.9 / density * total))
    # Within five standard errors.
    assert increments.scan == pytest.approx(
        np.mean(gains), abs=5 * np.std(gains) / math.sqrt(20_000)
    )
    assert increments.hit == pytest.approx(np.mean(hits), abs=0.05)


def test_range_rates_add_their_information_to_the_worth_of_a_hit():
    # Of a target at 5 m/s in any direction: the mean of ln(N(e) / p(c)), by integration.
    blind = Case(sensor=SensorModel(clutter_range_rate=2.0), target_speed=5.0)
    case = dataclasses.replace(blind, sensor=dataclasses.replace(blind.sensor, range_rate_std=0.2))
    heading = np.linspace(0.0, 2.0 * math.pi, 2000, endpoint=False)
    error = np.linspace(-1.2, 1.2, 601)
    weight = np.exp(-0.5 * (error / 0.2) ** 2)
    rate = 5.0 * np.cos(heading)[:, None] + error
    clutter = np.log(2.0 / (math.pi * (4.0 + rate**2))).mean(axis=0)
    own = -0.5 * math.log(2.0 * math.pi * math.e * 0.2**2)
    expected = own - (weight * clutter).sum() / weight.sum()
    gain = search.ping_increments(case, 0.99).hit - search.ping_increments(blind, 0.99).hit
    assert gain == pytest.approx(expected, abs=0.02)  # 100 000 pings: 0.003
    assert search.ping_increments(case, 0.99).scan > search.ping_increments(blind, 0.99).scan + 0.5


@pytest.mark.parametrize(("factor", "share"), [(0.99, 1.0), (1.01, 0.0)])
def test_targets_pass_the_clutter_statistic_up_to_its_critical_density(factor, share):
    """Exact hits in each ping: f_2 = 2 pi lambda (M - 1) (v T)^2 of all targets."""
    options = TsepmOptions(evaluation="clutter_statistic", min_hits=5, window=5)
    threshold = clutter_threshold(options.clutter_test_size, options.min_hits)
    critical = threshold / (2.0 * math.pi * 4 * (5.0 * 12.0) ** 2)
    sensor = SensorModel(
        range_std=1e-6,
        range_std_fraction=0.0,
        azimuth_std=1e-9,
        detection_probability=1.0,
        clutter_density=factor * critical,
    )
    gating = Gating(sensor=sensor, max_speed=10.0, interval=12.0, gate_probability=0.9)
    assert target_pass_share(gating, options, 5.0) == share


def test_no_target_passes_where_none_has_enough_hits():
    """P_D of a rule 16/16 is 1e-16 at p_d = 0.1: none of 10 000 targets."""
    sensor = SensorModel(detection_probability=0.1)
    gating = Gating(sensor=sensor, max_speed=10.0, interval=12.0, gate_probability=0.9)
    assert target_pass_share(gating, TsepmOptions(min_hits=16, window=16), 5.0) == 0.0


@pytest.mark.parametrize(
    "values",
    [
        {"interval": 0.0},
        {"interval": math.nan},
        {"scans": 2},
        {"target_speed": -1.0},
        {"target_speed": 11.0},
        {"target_range": 9001.0},
        {"target_range": 0.0},
    ],
    ids=str,
)
def test_a_case_that_makes_no_sense_is_refused(values):
    name = next(iter(values)).replace("target_", "")
    with pytest.raises(ValueError, match=name):
        Case(sensor=SensorModel(), **values)


@pytest.fixture
def _little_clutter(monkeypatch):
    """A bound on the work: rates of false tracks are told less exactly."""
    monkeypatch.setattr(search, "MAX_CLUTTER_DETECTIONS", 1_000.0)


@pytest.mark.long
@pytest.mark.usefixtures("_little_clutter")
def test_false_tracks_of_a_rule_that_finds_fewer_targets_are_not_simulated():
    """12 of 12 pings at p_d = 0.9: a third of the targets at most, and `score` finds nearly all."""
    case = Case(sensor=dataclasses.replace(SECTOR, clutter_density=1e-8), scans=16)
    few = search.Rule(min_hits=12, window=12, one_start=0.3, in_time=0.3, false_per_hour=1e-9)
    score, rule = search.candidates(
        case,
        ScoreOptions(),
        TsepmOptions(),
        [few],
        wanted=0.9,
        runs=12,
        seed=1,
        workers=ONE_PROCESS,
        progress=named_progress,
    )
    assert rule.targets.detection.high < score.targets.detection.low
    assert score.false_simulated.low >= 0.0 and math.isnan(rule.false_simulated.value)


@pytest.mark.long
@pytest.mark.usefixtures("_little_clutter")
def test_the_command_says_what_to_expect_and_writes_parameters(capsys, tmp_path):
    file = tmp_path / "sonar.yaml"
    given = ["-p", "sensor.clutter_density:=1.0e-7", "-p", "sensor.max_range:=5000.0"]
    given += ["--runs", "10", "--wanted", "0.5"]
    assert main(["design", "--workers", "1", "--write", str(file), *given]) == 0
    said = capsys.readouterr().out
    assert "78.54 km^2" in said and "\nfeasible: " in said
    text = file.read_text()
    assert "method: score" in text and "sensor.clutter_density: 1.0e-07" in text
    values = yaml.safe_load(text)["/**"]["ros__parameters"]
    assert settings_from(make_groups(TRACK_INITIATOR, values)).session.method == "score"
    assert {"score.window", "score.false_tracks_per_hour", "max_speed"} <= set(values)


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["-p", "method:=tsepm"], "method"),
        (["--wanted", "2"], "wanted"),
        (["--speed", "50"], "speed"),
        (["--write", "/nowhere/at/all.yaml"], "write"),
        (["--speed", "10", "-p", "sensor.max_range:=500.0"], "coverage"),
        (
            ["--speed", "10", "--scans", "21", "--interval", "10", "-p", "sensor.max_range:=1020."],
            "coverage",
        ),
    ],
)
def test_what_cannot_be_designed_is_refused_at_once(capsys, arguments, named):
    """Of the last, some targets stay in the coverage, the first included."""
    assert main(["design", *arguments]) == 2
    written = capsys.readouterr()
    assert named in written.err
    assert not written.out


def test_an_angle_that_looks_like_degrees_is_asked_about(capsys):
    given = ["-p", "sensor.azimuth_std:=1.0", "-p", "sensor.max_range:=500.0"]
    assert main(["design", "--speed", "10", *given]) == 2  # refused after the question
    said = capsys.readouterr().err
    assert said.startswith("note: sensor.azimuth_std") and "degrees" in said


@pytest.mark.long
@pytest.mark.usefixtures("_little_clutter")
def test_a_first_set_up_is_designed_further(capsys, tmp_path):
    file, further = tmp_path / "sonar.yaml", tmp_path / "further.yaml"
    assert main(["init", str(file), "--max-range", "3000", "--max-speed", "4"]) == 0
    given = ["design", "--params-file", str(file), "--runs", "3", "--workers", "1"]
    given += ["--wanted", "0.1", "-p", "sensor.clutter_density:=1.0e-7"]
    assert main([*given, "--write", str(further)]) == 0
    assert "28.27 km^2" in capsys.readouterr().out
    values = yaml.safe_load(further.read_text())["/**"]["ros__parameters"]
    assert values["sensor.max_range"] == 3000.0 and values["max_speed"] == 4.0
    assert values["sensor.clutter_density"] == 1.0e-7
    assert main(["design", "--params-file", str(tmp_path / "none.yaml")]) == 2
    assert "none.yaml cannot be read" in capsys.readouterr().err


@pytest.mark.long
def test_bisection_finds_the_first_rule_that_keeps_the_rate():
    case = Case(sensor=dataclasses.replace(SensorModel(), clutter_density=3e-7))
    for rule in search.rules_within(case, TsepmOptions(), 60.0):
        gating = Gating(
            sensor=case.sensor, max_speed=10.0, interval=case.interval, gate_probability=0.9
        )
        for min_hits in range(2, rule.min_hits):
            fewer = TsepmOptions(min_hits=min_hits, window=rule.window)
            raw = expected_counts(gating, min_hits, rule.window, 3 * rule.window).raw
            rate = raw[rule.window :].mean() * case.scans_per_hour
            assert rate * clutter_pass_share(gating, fewer) > 60.0


@pytest.mark.long
def test_a_design_knows_the_strength_of_its_targets():
    plain = Case(sensor=SensorModel())
    strong = dataclasses.replace(plain, ratio_db=6.0)
    [(threshold, share)] = search.score_thresholds(plain, ScoreOptions(), [16])
    [(lower, more)] = search.score_thresholds(strong, ScoreOptions(), [16])
    assert lower < threshold and more > share + 0.2
    # The mean of ln L of an exponential of mean 1 + r against 1 is r - ln(1 + r).
    ratio = 10.0**0.6
    gain = search.ping_increments(strong, 0.99).hit - search.ping_increments(plain, 0.99).hit
    assert gain == pytest.approx(ratio - math.log1p(ratio), rel=0.02)
    off = dataclasses.replace(strong, common=CommonOptions(intensity="off"))
    assert search.score_thresholds(off, ScoreOptions(), [16]) == [(threshold, share)]
    with pytest.raises(ValueError, match="ratio must be"):
        Case(sensor=SensorModel(), ratio_db=1e3)


QUICK = ["--runs", "20", "--workers", "1", "--scans", "8", "--wanted", "0.01"]


@pytest.mark.usefixtures("_little_clutter")
def test_the_default_clutter_is_never_taken_in_silence(capsys):
    assert main(["design", *QUICK]) == 0
    said = capsys.readouterr().out
    assert "\nthe clutter is not given; with the default, 254 false detections per ping" in said
    assert "\nfeasible" not in said
    assert main(["design", *QUICK, "--false-detections", "20"]) == 0
    said = capsys.readouterr().out
    assert "20 false detections in each" in said
    assert "\nfeasible" in said and "not given" not in said


@pytest.mark.parametrize(
    "arguments",
    [
        ["--false-detections", "0"],
        ["--false-detections", "5", "-p", "sensor.clutter_density:=1e-6"],
    ],
)
def test_false_detections_that_say_nothing_are_refused(capsys, arguments):
    assert main(["design", *arguments]) == 2
    assert "--false-detections" in capsys.readouterr().err


@pytest.mark.usefixtures("_little_clutter")
def test_a_fast_sonar_gets_its_times_with_digits(capsys, tmp_path):
    """And the time between pings from the file."""
    file = str(tmp_path / "fast.yaml")
    given = ["--yes", "--max-range", "150", "--interval", "0.2", "--false-detections", "20"]
    assert main(["init", file, *given, "--max-speed", "5"]) == 0
    capsys.readouterr()
    assert main(["design", "--params-file", file, *QUICK]) == 0
    said = capsys.readouterr().out
    assert "a ping every 0.2 s" in said
    [score] = [line.split() for line in said.splitlines() if line.startswith("score ")]
    assert 0.2 < float(score[6]) < 1.6 and not float(score[6]).is_integer()
