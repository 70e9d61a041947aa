"""Operating curves and methods compared."""

import math

import numpy as np
import pytest
from support.run_summaries import run_of, start

from tsepm_ros.tools.evaluation.performance import Curve, compare

CURVE = Curve.of(np.array([10.0, 1.0, 5.0, 0.1]), np.array([0.9, 0.7, 0.6, 0.3]))


def test_a_point_that_another_beats_in_both_is_not_on_the_curve():
    np.testing.assert_allclose(np.exp(CURVE.log_false), [0.1, 1.0, 10.0])
    np.testing.assert_allclose(CURVE.detection, [0.3, 0.7, 0.9])


def test_between_its_points_a_curve_is_linear_in_the_logarithm():
    np.testing.assert_allclose(CURVE.detection_at(np.array([1.0, math.sqrt(10.0)])), [0.7, 0.8])
    np.testing.assert_allclose(CURVE.false_at(np.array([0.7, 0.8])), [1.0, math.sqrt(10.0)])


def test_a_curve_says_nothing_of_what_it_does_not_reach():
    assert np.isnan(CURVE.detection_at(np.array([0.09])))
    assert np.isnan(CURVE.false_at(np.array([0.91])))
    assert CURVE.detection_at(np.array([1000.0])) == 0.9
    assert CURVE.false_at(np.array([0.1])) == pytest.approx(0.1)


def runs(found: int, false: int, total: int = 100):
    """Runs of which some find the target, with so many false starts in all, one in a run."""
    return [
        run_of(*([start(0)] if k < found else []), false=(int(k < false), 0)) for k in range(total)
    ]


POINTS = {
    ("good", "few"): runs(60, 10),
    ("good", "many"): runs(80, 40),
    ("poor", "one"): runs(60, 20),
}


def test_two_methods_are_compared_at_each_other_s_points():
    few, many, poor = compare(POINTS)
    assert [(one.method, one.label, one.other) for one in (few, many, poor)] == [
        ("good", "few", "poor"),
        ("good", "many", "poor"),
        ("poor", "one", "good"),
    ]
    # The poor method's rate of 0.2 is the middle of 0.1 to 0.4, in the logarithm.
    assert (poor.false, poor.detection) == (0.2, 0.6)
    assert poor.other_detection.value == pytest.approx(0.7)
    assert poor.detection_difference.value == pytest.approx(-0.1)
    assert poor.other_false.value == pytest.approx(0.1)
    assert poor.false_ratio.value == pytest.approx(0.5)
    assert few.false_ratio.value == pytest.approx(2.0)
    assert math.isnan(few.other_detection.value)  # the poor method has no point with so few
    assert many.other_detection.value == pytest.approx(0.6)
    assert math.isnan(many.other_false.value)


def test_the_same_scenes_are_drawn_for_all():
    # With the same results in the same runs nothing differs, whichever runs are drawn.
    (one, _) = compare({("a", "x"): runs(60, 20), ("b", "x"): runs(60, 20)})
    assert (
        one.detection_difference.value,
        one.detection_difference.low,
        one.detection_difference.high,
    ) == (0.0, 0.0, 0.0)
    assert (one.false_ratio.value, one.false_ratio.low, one.false_ratio.high) == pytest.approx(
        (1.0, 1.0, 1.0)
    )


def test_no_false_start_counts_half_a_one():
    (one, _) = compare({("a", "x"): runs(60, 0), ("b", "x"): runs(60, 20)})
    assert one.false == 0.5 / 100
    assert one.false_ratio.value == pytest.approx(40.0)
