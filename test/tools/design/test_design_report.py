"""Sentences and tables of a design: what is given, found, undecided and not simulated."""

from __future__ import annotations

import math
import re

import pytest

from tsepm_ros import SensorModel
from tsepm_ros.tools.commands import design_command as design_report
from tsepm_ros.tools.design.prediction import Case, TargetStatistics
from tsepm_ros.tools.design.search import (
    WINDOWS,
    Candidate,
    PingIncrements,
    remedies,
)
from tsepm_ros.tools.evaluation.intervals import Estimate

UNKNOWN = Estimate.unknown()


def candidate(name: str, low: float, high: float, *, false: Estimate = UNKNOWN, bound=0.5):
    detection = Estimate(0.5 * (low + high), low, high)
    targets = TargetStatistics(100, detection, Estimate(90.0, 80.0, 100.0), 150.0)
    return Candidate(name, "score", {}, bound, targets, false)


@pytest.mark.parametrize(
    ("values", "where"),
    [
        ({}, "anywhere in the coverage"),
        ({"target_range": 4000.0}, "at 4000 m in the middle of the run"),
        ({"ratio_db": 6.0}, "anywhere in the coverage, 6 dB above the clutter"),
        (
            {"target_range": 4000.0, "ratio_db": -3.0},
            "at 4000 m in the middle of the run, -3 dB above the clutter",
        ),
    ],
    ids=str,
)
def test_a_case_names_the_place_and_the_strength_of_its_targets(values, where):
    lines = design_report.case_lines(Case(sensor=SensorModel(), **values), 1.0)
    assert f"allowed), {where}, to be found within 16 pings" in lines


@pytest.mark.parametrize(
    ("increment", "pings"),
    [
        (4.0, "about 3 pings"),  # the least number of hits
        (0.5, "about 20 pings"),
        (10.0 / WINDOWS[-1], f"about {WINDOWS[-1]} pings"),
        (9.9 / WINDOWS[-1], f"more pings than the longest window, {WINDOWS[-1]}"),
        (0.0, f"more pings than the longest window, {WINDOWS[-1]}"),
    ],
)
def test_pings_up_to_the_threshold_are_limited_by_the_longest_window(increment, pings):
    line = design_report.increments_line(PingIncrements(2.0, -1.0, increment), 10.0)
    assert line.partition("threshold 10.0: ")[2].startswith(pings)


def test_a_rate_that_is_not_simulated_is_a_dash():
    rows = [
        candidate("score", 0.8, 0.9, false=Estimate(2.0, 1.0, 4.0), bound=1.0),
        candidate("tsepm 5/8", 0.1, 0.2, bound=0.25),
    ]
    *_, first, second = design_report.candidate_table(rows, 4e6).splitlines()
    assert re.split(r"\s{2,}", first.strip())[-4:] == ["1", "2", "1 to 4", "0.5"]
    assert re.split(r"\s{2,}", second.strip())[-4:] == ["0.25", "-", "-", "-"]


@pytest.mark.parametrize(
    ("low", "high", "false", "sentence"),
    [
        (0.91, 0.95, UNKNOWN, "feasible: score finds 0.93"),
        (0.85, 0.95, UNKNOWN, "undecided by the runs: score finds 0.90"),
        (0.70, 0.80, UNKNOWN, "infeasible: score finds 0.75"),
        (0.91, 0.95, Estimate(2.0, 0.9, 4.0), "feasible: score finds 0.93"),
        (0.91, 0.95, Estimate(2.0, 1.1, 4.0), "infeasible: every method has more than 1 false"),
    ],
)
def test_verdict_is_by_the_bounds_of_methods_that_keep_the_rate(low, high, false, sentence):
    found = [candidate("score", low, high, false=false)]
    assert design_report.verdict(found, 0.9, 1.0).startswith(sentence)


def test_verdict_is_of_the_best_that_keeps_the_rate():
    found = [candidate("score", 0.95, 0.97, bound=1.5), candidate("tsepm 5/8", 0.5, 0.6)]
    assert design_report.verdict(found, 0.9, 1.0).startswith("infeasible: tsepm 5/8 finds 0.55")


def test_a_shorter_range_is_a_remedy_where_targets_are_anywhere():
    case = Case(sensor=SensorModel(max_range=1000.0))
    shorter = dict(remedies(case))["a range of 700 m"]
    assert shorter.sensor.max_range == 700.0 and math.isclose(
        shorter.sensor.coverage_area, 0.49 * case.sensor.coverage_area
    )
    at_a_range = Case(sensor=case.sensor, target_range=900.0)
    assert [text for text, _ in remedies(at_a_range)] == [text for text, _ in remedies(case)][:-1]
