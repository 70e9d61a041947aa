"""The likelihood ratio of strengths along a path."""

import math

import numpy as np
import pytest
from scipy import integrate

from tsepm_ros.tracker.clutter.amplitude_likelihood import (
    FIGURES_DB,
    LAW_KNOWN,
    PathRatio,
    log_ratio,
    ratio_db,
    ratio_prior,
)


def exponential_ratio(hits: int, total: float) -> float:
    """sum_k w_k (1 + r_k)^-n exp(S r_k / (1 + r_k)), term by term."""
    return sum(
        weight * (1.0 + ratio) ** -hits * math.exp(total * ratio / (1.0 + ratio))
        for ratio, weight in zip(*ratio_prior(), strict=True)
    )


@pytest.mark.parametrize(("hits", "total"), [(1, 0.1), (3, 9.0), (8, 40.0), (16, 12.0)])
def test_a_known_law_gives_the_ratio_of_exponentials(hits, total):
    found = log_ratio(np.array([float(hits)]), np.array([total]), 1e9)[0]
    assert found == pytest.approx(math.log(exponential_ratio(hits, total)), abs=1e-5)


@pytest.mark.parametrize("samples", [0.5, 10.0, 300.0])
def test_mean_in_clutter_is_1_over_the_unknown_scale_too(samples):
    """Of three hits: V is a sum of three, over a scale known from `samples`: beta prime."""

    def weighted(share: float) -> float:
        total = samples * share / (1.0 - share)  # share: beta(3, N)
        log_density = 2.0 * math.log(share) + (samples - 1.0) * math.log1p(-share)
        norm = math.gamma(3.0) / np.prod([samples, samples + 1.0, samples + 2.0])
        log_ratio_there = log_ratio(np.array(3.0), np.array(total), samples)
        return math.exp(log_density + log_ratio_there) / norm

    mean = integrate.quad(weighted, 0.0, 1.0, limit=500)[0]
    assert mean == pytest.approx(1.0, abs=1e-4)


def test_table_agrees_with_the_formula():
    table = PathRatio.of(200.0, 16)
    hits, total = np.arange(17), np.linspace(0.0, 150.0, 17)
    expected = log_ratio(hits.astype(float), total, table.count)
    np.testing.assert_allclose(table.at(hits, total), expected, atol=0.02)
    assert abs(table.count / 200.0 - 1.0) < 0.1


def test_ratio_of_many_hits_is_that_of_their_mean():
    for truth in (0.0, 10.0):
        hits = np.array([400.0])
        found = ratio_db(hits, hits * (1.0 + 10.0 ** (truth / 10.0)))[0]
        assert found == pytest.approx(truth, abs=0.6)
    assert np.isnan(ratio_db(np.zeros(2), np.zeros(2))).all()
    low = ratio_db(np.array([50.0]), np.array([50.0]))[0]
    assert FIGURES_DB[0] <= low < -3.0
    assert LAW_KNOWN > 1e4
