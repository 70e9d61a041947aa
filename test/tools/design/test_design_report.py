"""Sentences and tables of a design: what is given, found, undecided and not simulated."""

import math

import pytest

from tsepm_ros import SensorModel
from tsepm_ros.tools.commands import design_command as design_report
from tsepm_ros.tools.design.prediction import Case, TargetStatistics
from tsepm_ros.tools.design.search import Candidate, remedies
from tsepm_ros.tools.evaluation.intervals import Estimate

UNKNOWN = Estimate.unknown()


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
