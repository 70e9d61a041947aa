"""Confidence intervals, against scipy."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from tsepm_ros.analysis.intervals import Z_95, Estimate, mean, proportion


@pytest.mark.parametrize(
    ("successes", "trials"), [(0, 10), (1, 10), (5, 10), (10, 10), (458, 500), (1999, 2000)]
)
def test_a_share_has_wilson_s_interval(successes, trials):
    found = proportion(successes, trials)
    expected = stats.binomtest(successes, trials).proportion_ci(0.95, method="wilson")
    assert found.value == successes / trials
    assert found.low == pytest.approx(expected.low, abs=1e-12)
    assert found.high == pytest.approx(expected.high, abs=1e-12)


def test_a_share_of_nothing_may_be_anything():
    found = proportion(0, 0)
    assert math.isnan(found.value)
    assert (found.low, found.high) == (0.0, 1.0)


def test_a_mean_has_the_normal_interval():
    values = np.random.default_rng(1).exponential(3.0, 200)
    found = mean(values)
    expected = stats.norm.interval(0.95, values.mean(), stats.sem(values))
    assert (found.low, found.high) == pytest.approx(expected)
    assert found.value == values.mean()


def test_a_mean_by_hand():
    found = mean([1.0, 2.0, 3.0, 4.0])
    half = 1.959964 * math.sqrt(5 / 3) / 2
    assert (found.value, found.low, found.high) == pytest.approx((2.5, 2.5 - half, 2.5 + half))


def test_a_mean_of_one_has_no_interval_and_of_none_no_value():
    assert mean([3.0]).value == 3.0
    assert math.isnan(mean([3.0]).low)
    assert math.isnan(mean([3.0]).high)
    assert math.isnan(mean([]).value)


def test_the_quantile_is_the_normal_s():
    assert pytest.approx(stats.norm.ppf(0.975)) == Z_95


def test_intervals_cover_the_truth_as_often_as_they_say():
    # 2000 intervals of 95 %: within 4 standard errors, 2 %, and 1 % for the approximations.
    rng = np.random.default_rng(2)
    shares = [proportion(int(k), 100) for k in rng.binomial(100, 0.9, 2000)]
    means = [mean(values) for values in rng.normal(5.0, 2.0, (2000, 100))]
    for truth, estimates in ((0.9, shares), (5.0, means)):
        covered = np.mean([one.low <= truth <= one.high for one in estimates])
        assert covered == pytest.approx(0.95, abs=0.03)


def test_an_estimate_is_written_with_its_interval():
    assert f"{Estimate(0.9157, 0.8881, 0.937):.3f}" == "0.916 (0.888 to 0.937)"
