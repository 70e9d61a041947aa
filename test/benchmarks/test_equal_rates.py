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
"""Operating curves compared at equal rates, and the tables of benchmarks."""

import math

import numpy as np
import pytest
from equal_rates import compare, detection_at, false_at
from result_tables import printed, write_table
from support.run_summaries import run_of, start

from tsepm_ros.tools.evaluation.performance import PerformanceCurve
from tsepm_ros.tools.evaluation.result_files import Result, read_result

CURVE = PerformanceCurve.of(np.array([10.0, 1.0, 5.0, 0.1]), np.array([0.9, 0.7, 0.6, 0.3]))


def test_a_curve_has_its_best_points_is_linear_in_the_logarithm_and_says_nothing_beyond():
    np.testing.assert_allclose(np.exp(CURVE.log_false), [0.1, 1.0, 10.0])
    np.testing.assert_allclose(CURVE.found, [0.3, 0.7, 0.9])
    np.testing.assert_allclose(detection_at(CURVE, np.array([1.0, math.sqrt(10.0)])), [0.7, 0.8])
    np.testing.assert_allclose(false_at(CURVE, np.array([0.7, 0.8])), [1.0, math.sqrt(10.0)])
    assert np.isnan(detection_at(CURVE, np.array([0.09])))
    assert np.isnan(false_at(CURVE, np.array([0.91])))
    assert detection_at(CURVE, np.array([1000.0])) == 0.9
    assert false_at(CURVE, np.array([0.1])) == pytest.approx(0.1)


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
    assert (poor.false, poor.found) == (0.2, 0.6)
    assert poor.other_found.value == pytest.approx(0.7)
    assert poor.found_difference.value == pytest.approx(-0.1)
    assert poor.other_false.value == pytest.approx(0.1)
    assert poor.false_ratio.value == pytest.approx(0.5)
    assert few.false_ratio.value == pytest.approx(2.0)
    assert math.isnan(few.other_found.value)  # the poor method has no point with so few
    assert many.other_found.value == pytest.approx(0.6)
    assert math.isnan(many.other_false.value)


def test_the_same_scenes_are_drawn_for_all_and_no_false_start_counts_half_a_one():
    # With the same results in the same runs nothing differs, whichever runs are drawn.
    (one, _) = compare({("a", "x"): runs(60, 20), ("b", "x"): runs(60, 20)})
    assert (
        one.found_difference.value,
        one.found_difference.low,
        one.found_difference.high,
    ) == (0.0, 0.0, 0.0)
    assert (one.false_ratio.value, one.false_ratio.low, one.false_ratio.high) == pytest.approx(
        (1.0, 1.0, 1.0)
    )
    (one, _) = compare({("a", "x"): runs(60, 0), ("b", "x"): runs(60, 20)})
    assert one.false == 0.5 / 100
    assert one.false_ratio.value == pytest.approx(40.0)


def test_a_table_is_printed_row_by_row_and_written_only_where_a_file_is_named(
    tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    path, table = tmp_path / "a.json", (["a", "b"], [["1", "2"], ["3", "4"]])
    write_table(None, "python a.py", table, seed=3, runs=7)
    assert not list(tmp_path.iterdir())
    write_table(path, "python a.py", table, seed=3, runs=7)
    expected = Result(command="python a.py", seed=3, runs=7, header=table[0], rows=table[1])
    assert read_result(path) == expected
    assert printed(iter([["a", "b"], ["1", "2"]])) == (["a", "b"], [["1", "2"]])
    assert capsys.readouterr().out == "| a | b |\n|---|---|\n| 1 | 2 |\n"
