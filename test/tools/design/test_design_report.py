"""Sentences and tables of a design: what is given, found, undecided and not simulated."""

import dataclasses
import math

import numpy as np
import pytest

from tsepm_ros import SensorModel
from tsepm_ros.tools.commands import design_command as design_report
from tsepm_ros.tools.design.prediction import Case, TargetStatistics
from tsepm_ros.tools.design.search import Candidate, FirstEstimate, PingIncrements, remedies
from tsepm_ros.tools.evaluation.intervals import Estimate

UNKNOWN = Estimate.unknown()
CASE = Case(sensor=SensorModel(max_range=1000.0))


def candidate(name: str, low: float, high: float, *, false: Estimate = UNKNOWN, bound=0.5):
    detection = Estimate(0.5 * (low + high), low, high)
    targets = TargetStatistics(100, detection, Estimate(90.0, 80.0, 100.0), 150.0)
    return Candidate(name, "score", {}, bound, targets, false)


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


def test_what_was_not_simulated_or_is_never_found_is_said():
    table = design_report.candidate_table([candidate("score", 0.7, 0.8)], 1e6)
    assert table.splitlines()[-1].split()[-3:] == ["-", "-", "-"]
    nothing = FirstEstimate(8, 7.0, np.zeros(8))
    assert "no target is found in time" in design_report.first_line(nothing, CASE)
    slow = PingIncrements(hit=1.0, miss=-1.0, scan=1e-3)
    assert "more pings than the longest window" in design_report.increments_line(slow, 7.0)


def test_the_case_says_where_and_how_strong_the_targets_are():
    given = dataclasses.replace(CASE, target_range=900.0, ratio_db=12.0)
    lines = design_report.case_lines(given, 1.0)
    assert "at 900 m in the middle of the run, 12 dB above the clutter" in lines
