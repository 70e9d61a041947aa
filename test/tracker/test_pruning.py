"""The M/N rule at its borders, and the thresholds of the evaluations."""

import math

import pytest
from scipy import stats

from tsepm_ros.tracker.pruning import clutter_threshold, distance_threshold


@pytest.mark.parametrize("probability", [0.5, 0.9, 0.99, 0.999999])
def test_the_squared_threshold_is_the_chi_square_quantile_of_two_degrees(probability):
    expected = stats.chi2(2).ppf(probability)
    assert distance_threshold(probability, "squared") == pytest.approx(expected)
    assert distance_threshold(probability, "literal") == pytest.approx(math.sqrt(expected))


def test_the_literal_threshold_is_the_paper_s():
    assert distance_threshold(0.99, "literal") == pytest.approx(3.03, abs=0.005)


@pytest.mark.parametrize("size", [0.001, 0.05, 0.5, 0.999])
@pytest.mark.parametrize("min_hits", [2, 5, 16])
def test_the_clutter_threshold_is_the_chi_square_quantile(size, min_hits):
    expected = stats.chi2(2 * min_hits - 2).ppf(size)
    assert clutter_threshold(size, min_hits) == pytest.approx(expected)
