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
"""Intervals of shares, means, counts and ratios: by SciPy, and by how often they cover."""

import math

import numpy as np
import pytest
from scipy import stats

from tsepm_ros.tools.evaluation.intervals import (
    IntervalEstimate,
    mean_count_interval,
    mean_interval,
    proportion_interval,
    quantile_interval,
    rms_ratio_interval,
    root_mean_square_interval,
)


@pytest.mark.parametrize(
    ("successes", "trials"), [(0, 10), (1, 10), (5, 10), (10, 10), (458, 500), (1999, 2000)]
)
def test_a_share_has_wilson_s_interval(successes, trials):
    found = proportion_interval(successes, trials)
    expected = stats.binomtest(successes, trials).proportion_ci(0.95, method="wilson")
    assert found.value == successes / trials
    assert found.low == pytest.approx(expected.low, abs=1e-12)
    assert found.high == pytest.approx(expected.high, abs=1e-12)


def test_of_nothing_no_value_is_known_and_of_one_no_interval():
    found = proportion_interval(0, 0)
    assert math.isnan(found.value)
    assert (found.low, found.high) == (0.0, 1.0)
    assert mean_interval([3.0]).value == 3.0
    assert math.isnan(mean_interval([3.0]).low)
    assert math.isnan(mean_interval([3.0]).high)
    for figure in (mean_interval, mean_count_interval, root_mean_square_interval):
        assert math.isnan(figure([]).value)
    assert math.isnan(quantile_interval([], 0.5).value)
    assert math.isnan(rms_ratio_interval([], []).value)


def test_a_mean_has_the_normal_interval():
    values = np.random.default_rng(1).exponential(3.0, 200)
    found = mean_interval(values)
    expected = stats.norm.interval(0.95, values.mean(), stats.sem(values))
    assert (found.low, found.high) == pytest.approx(expected)
    assert found.value == values.mean()


def test_an_estimate_is_written_with_its_interval():
    assert f"{IntervalEstimate(0.9157, 0.8881, 0.937):.3f}" == "0.916 (0.888 to 0.937)"


def test_the_difference_of_two_shares_has_newcombe_s_interval():
    """Newcombe 1998, Table II: 56 of 70 less 48 of 80, method 10."""
    found = proportion_interval(56, 70) - proportion_interval(48, 80)
    assert (found.value, found.low, found.high) == pytest.approx((0.2, 0.0524, 0.3339), abs=1e-4)


@pytest.mark.parametrize("counts", [[0] * 40, [1] + [0] * 9, [3, 4, 5, 4, 3, 5]])
def test_counts_that_spread_no_more_than_poisson_s_have_the_exact_interval(counts):
    found, total, runs = mean_count_interval(counts), sum(counts), len(counts)
    low = stats.chi2.ppf(0.025, 2 * total) / 2 if total else 0.0
    assert found.value == total / runs
    assert found.low == pytest.approx(low / runs)
    assert found.high == pytest.approx(stats.chi2.ppf(0.975, 2 * total + 2) / 2 / runs)


def test_intervals_of_counts_ratios_and_quantiles_cover_the_truth_as_often_as_they_say():
    # Within 3 standard errors of the share covered; Poisson's is never too short.
    rng = np.random.default_rng(5)
    bounds = rng.uniform(1.0, 3.0, (500, 200))
    errors = 1.2 * bounds * np.sqrt(rng.exponential(1.0, bounds.shape))  # of a position in a plane
    cases = [
        (0.1, 0.05, [mean_count_interval(values) for values in rng.poisson(0.1, (500, 50))]),
        (1.2, 0.03, [rms_ratio_interval(*pair) for pair in zip(errors, bounds, strict=True)]),
        (
            math.log(2),
            0.05,
            [quantile_interval(rng.exponential(1.0, 100), 0.5) for _ in range(200)],
        ),
    ]
    for truth, tolerance, estimates in cases:
        covered = np.mean([one.low <= truth <= one.high for one in estimates])
        assert covered == pytest.approx(0.95, abs=tolerance)


@pytest.mark.parametrize(
    ("errors", "bounds", "ratio"), [([2.0], [4.0], 0.5), ([0.0, 0.0], [1.0, 3.0], 0.0)]
)
def test_a_ratio_of_one_pair_or_of_0_has_no_interval(errors, bounds, ratio):
    found = rms_ratio_interval(errors, bounds)
    assert found.value == ratio and math.isnan(found.low) and math.isnan(found.high)
