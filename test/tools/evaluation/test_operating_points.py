"""The sweeps of the methods, and operating curves compared."""

import math

import numpy as np
import pytest
from support.run_summaries import run_of, start

from tsepm_ros.methods.registry import available_methods, method_class
from tsepm_ros.tools.evaluation.performance import Curve, compare
from tsepm_ros.tools.evaluation.result_files import code_key
from tsepm_ros.tools.evaluation.simulated_run import operating_points
from tsepm_ros.tools.simulation import load_scenario

BOX = load_scenario("box")


@pytest.mark.parametrize("method", available_methods())
def test_every_method_takes_the_options_of_its_points(method):
    points = operating_points([method])
    assert len(points) == len(method_class(method).operating_points) > 0
    for point in points:
        made = point.make(BOX).method
        assert type(made) is method_class(method)
        for name, value in point.options.items():
            assert getattr(made.options, name) == value


def test_an_option_goes_to_the_methods_that_have_it_and_replaces_what_their_sweep_varies():
    points = operating_points(["tsepm", "score"], {"miss_probability": 0.01, "max_speed": 5.0})
    for point in points:
        assert point.options["max_speed"] == 5.0
        assert ("miss_probability" in point.options) == (point.method == "score")
    assert len(points) == len(operating_points(["tsepm", "score"]))
    points = operating_points(["tsepm", "score"], {"min_hits": 4})
    given = [point for point in points if point.method == "tsepm"]
    assert [dict(point.options) for point in given] == [{"min_hits": 4}]
    assert len(points) == 1 + len(method_class("score").operating_points)


def test_the_key_of_stored_runs_is_of_every_module_and_of_further_files(tmp_path):
    (tmp_path / "peer.py").write_text("rule = 3\n")
    assert code_key(tmp_path / "peer.py") != code_key()


CURVE = Curve.of(np.array([10.0, 1.0, 5.0, 0.1]), np.array([0.9, 0.7, 0.6, 0.3]))


def test_a_curve_has_its_best_points_is_linear_in_the_logarithm_and_says_nothing_beyond():
    np.testing.assert_allclose(np.exp(CURVE.log_false), [0.1, 1.0, 10.0])
    np.testing.assert_allclose(CURVE.detection, [0.3, 0.7, 0.9])
    np.testing.assert_allclose(CURVE.detection_at(np.array([1.0, math.sqrt(10.0)])), [0.7, 0.8])
    np.testing.assert_allclose(CURVE.false_at(np.array([0.7, 0.8])), [1.0, math.sqrt(10.0)])
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


def test_the_same_scenes_are_drawn_for_all_and_no_false_start_counts_half_a_one():
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
    (one, _) = compare({("a", "x"): runs(60, 0), ("b", "x"): runs(60, 20)})
    assert one.false == 0.5 / 100
    assert one.false_ratio.value == pytest.approx(40.0)
