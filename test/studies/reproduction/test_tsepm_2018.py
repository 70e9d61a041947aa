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
"""TSEPM 2018: rows of Table 1 that no reading explains, and ratios with their intervals."""

import numpy as np
import pytest

from tsepm_ros.studies.reproduction import (
    monte_carlo,
    tsepm_2018,
)
from tsepm_ros.tools.evaluation.intervals import IntervalEstimate

ROWS = {row.name: row for row in monte_carlo.TABLE_1}

LOW_IN_PRINT = {"4/6", "4/7"}

NO_GATE_FITS = {"4/7", "5/9", "7/9"}


@pytest.mark.parametrize("name", sorted(LOW_IN_PRINT))
def test_one_factor_too_many_explains_the_rows_that_the_closed_form_misses(name):
    assert tsepm_2018.tsepm_2018_detection_with_slip(ROWS[name]) == pytest.approx(
        ROWS[name].detection, abs=1e-4
    )


def test_rows_that_fit_no_reading_or_cannot_be_compared_are_named_and_print_is_rounded():
    assert set(tsepm_2018.tsepm_2018_unmatched_detection()) == LOW_IN_PRINT
    assert set(tsepm_2018.tsepm_2018_unmatched_false_before()) == NO_GATE_FITS
    assert tsepm_2018._tsepm_2018_log_distance(near_print(1.5)) == pytest.approx(np.log(1.5))
    values = near_print(1.5)
    values[0] = IntervalEstimate(0.0, 0.0, 0.1)
    values[1] = IntervalEstimate(3.0 * monte_carlo.TABLE_1[1].false_after, 0.0, 1.0)
    assert set(ROWS) - set(tsepm_2018._tsepm_2018_log_ratios(values)) == {"3/4", "7/9", "8/9"}
    nothing = near_print(0.0)
    assert tsepm_2018._tsepm_2018_log_distance(nothing) == np.inf


def near_print(factor, half_width=0.0):
    """P_F(2) a factor from print, with intervals of some half width."""
    values = [factor * row.false_after for row in monte_carlo.TABLE_1]
    return [IntervalEstimate(value, value - half_width, value + half_width) for value in values]


def test_ratios_cover_the_truth_as_often_as_said():
    """400 trials: the share of 95 % intervals that cover, within 4 standard errors."""
    rng = np.random.default_rng(1)
    covered = 0
    for _ in range(400):
        starts = rng.poisson(20.0, 50)
        one = tsepm_2018.tsepm_2018_ratio(rng.poisson(0.3 * starts), starts)
        covered += one.low <= 0.3 <= one.high
    assert covered / 400 == pytest.approx(0.95, abs=4 * np.sqrt(0.95 * 0.05 / 400))


def test_a_ratio_without_an_event_has_a_bound_and_one_without_a_whole_is_unknown():
    none = tsepm_2018.tsepm_2018_ratio([0, 0], [10, 20])
    assert (none.value, none.low) == (0.0, 0.0)
    assert none.high == pytest.approx(3.689 / 30, rel=1e-3)
    assert np.isnan(tsepm_2018.tsepm_2018_ratio([0, 0], [0, 0]).value)
