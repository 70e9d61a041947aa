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
"""The law of the amplitude of clutter, and the likelihood ratio of amplitudes along a path."""

import math

import numpy as np
import pytest
from scipy import integrate, stats
from support.amplitude_laws import QUANTILES

from tsepm_ros.tracker.clutter import amplitude_law
from tsepm_ros.tracker.clutter.amplitude import TAIL_SAMPLES
from tsepm_ros.tracker.clutter.amplitude_law import (
    CURVATURES,
    FIGURES_DB,
    KNOWN_LAW_COUNT,
    MIN_REFERENCES,
    NORMALISED_REACH,
    AmplitudeLaw,
    RatioTable,
)


def law_of(values, weights=None) -> AmplitudeLaw:
    values = np.asarray(values, float)
    return AmplitudeLaw.from_values(values, np.ones(len(values)) if weights is None else weights)


def normalised_of(law: AmplitudeLaw, values) -> np.ndarray:
    return law.normalised(values)[0]


def test_body_is_the_share_of_references_at_least_as_strong():
    rng = np.random.default_rng(1)
    reference, weights = rng.normal(size=300), rng.random(300)
    law = law_of(reference, weights)
    values = rng.normal(-1.0, 1.0, 50)
    values = values[values < law.begin]
    expected = [
        -math.log((1.0 + weights[reference >= value].sum()) / (1.0 + weights.sum()))
        for value in values
    ]
    np.testing.assert_allclose(normalised_of(law, values), expected, atol=1e-12)


def test_ties_count_as_at_least_as_strong():
    law = law_of([1.0] * 50 + [2.0] * 50 + [3.0] * 20)
    assert normalised_of(law, np.array([2.0]))[0] == pytest.approx(-math.log(71.0 / 121.0))


def test_tail_is_the_predictive_of_gompertz_law_with_both_parameters_unknown():
    rng = np.random.default_rng(2)
    reference = np.log(rng.exponential(size=400))
    law = law_of(reference)
    excess = np.sort(reference)[np.sort(reference) >= law.begin] - law.begin
    k, scale = len(excess), excess.mean()
    assert law.tail_count == k

    def tail(y: float) -> float:
        """P(Y > y): a integrated numerically, with the prior 1 / a, for each b of the grid."""
        of_each, beyond = [], []
        for b in CURVATURES / scale:
            hazard = (lambda x, b=b: np.expm1(b * x) / b) if b else (lambda x: x)
            total, peak = hazard(excess).sum(), k / hazard(excess).sum()

            def density(a: float, more: float, total=total, peak=peak) -> float:
                return math.exp((k - 1) * math.log(a / peak) - a * (total + more) + peak * total)

            ends = {"points": [peak], "limit": 200}
            one = integrate.quad(density, 1e-9, 4.0 * peak, (0.0,), **ends)[0]
            two = integrate.quad(density, 1e-9, 4.0 * peak, (hazard(np.array(y)),), **ends)[0]
            log_weight = b * excess.sum() + (k - 1) * math.log(peak) - peak * total
            of_each.append(log_weight + math.log(one))
            beyond.append(two / one)
        weight = np.exp(np.array(of_each) - max(of_each))
        return float(weight @ beyond / weight.sum())

    for y in (0.3, 1.0):
        expected = -math.log(tail(y) * (1.0 + k) / (1.0 + len(reference)))
        assert normalised_of(law, np.array([law.begin + y]))[0] == pytest.approx(expected, abs=1e-4)


@pytest.mark.parametrize("name", ["exponential", "k", "log-normal", "threshold"])
def test_few_hundred_references_tell_an_exceedance_of_e_to_the_minus_7(name):
    told = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        law = law_of(QUANTILES[name](rng.exponential(size=500)))
        told.append(normalised_of(law, QUANTILES[name](np.array([7.0])))[0])
    assert 6.0 < np.median(told) < 7.6


def test_normalised_amplitude_ends_where_nothing_can_be_said():
    law = law_of(np.log(np.random.default_rng(3).exponential(size=100)))
    assert (
        normalised_of(law, np.array([50.0]))[0] == law.reach == math.log(101.0) + NORMALISED_REACH
    )
    assert normalised_of(law, np.array([-50.0]))[0] == 0.0


@pytest.mark.parametrize("name", sorted(QUANTILES))
@pytest.mark.parametrize("references", [MIN_REFERENCES, 600])
def test_product_over_a_path_keeps_its_mean_with_a_learned_law(name, references):
    """E[L] <= 1 over the reference too, which the hits of a path share.

    By importance sampling: E_0[L] = E_1[L / L_1], with the hits drawn from targets of the prior's
    ratios and L_1 their likelihood ratio under the true law.
    """
    rng = np.random.default_rng(references)
    quantile, paths, repeats = QUANTILES[name], 60, 120
    ratios, prior = amplitude_law.prior()
    means = np.zeros((repeats, 4))
    for repeat in range(repeats):
        law = law_of(quantile(rng.exponential(size=references)))
        samples = TAIL_SAMPLES * law.tail_count
        ratio = rng.choice(ratios, paths, p=prior)
        true = (1.0 + ratio[:, None]) * rng.exponential(size=(paths, 16))
        normalised = normalised_of(law, quantile(true).ravel()).reshape(true.shape)
        told = amplitude_law.scaled_values(normalised, samples)
        for column, hits in enumerate((3, 5, 8, 16)):
            count = np.full(paths, float(hits))
            learned = amplitude_law.log_ratio(count, told[:, :hits].sum(axis=1), samples)
            exact = np.logaddexp.reduce(
                np.log(prior)[:, None]
                - hits * np.log1p(ratios)[:, None]
                + true[:, :hits].sum(axis=1) * (ratios / (1.0 + ratios))[:, None]
            )
            means[repeat, column] = np.exp(learned - exact).mean()
    mean, error = means.mean(axis=0), stats.sem(means, axis=0)
    assert (mean - 2.0 * error < 1.0).all()
    assert (mean < 1.3).all()


def test_figure_in_db_goes_on_where_evidence_ends():
    law = law_of(np.log(np.random.default_rng(5).exponential(size=600)))
    found = law.normalised(np.log(np.array([0.5, 20.0, 60.0])))[1]
    assert found[0] == normalised_of(law, np.log(np.array([0.5])))[0]
    np.testing.assert_allclose(10.0 * np.log10(found[1:] / [20.0, 60.0]), 0.0, atol=2.0)


def exponential_ratio(hits: int, total: float) -> float:
    """sum_k w_k (1 + r_k)^-n exp(S r_k / (1 + r_k)), term by term."""
    return sum(
        weight * (1.0 + ratio) ** -hits * math.exp(total * ratio / (1.0 + ratio))
        for ratio, weight in zip(*amplitude_law.prior(), strict=True)
    )


@pytest.mark.parametrize(("hits", "total"), [(1, 0.1), (3, 9.0), (8, 40.0), (16, 12.0)])
def test_a_known_law_gives_the_ratio_of_exponentials(hits, total):
    found = amplitude_law.log_ratio(np.array([float(hits)]), np.array([total]), 1e9)[0]
    assert found == pytest.approx(math.log(exponential_ratio(hits, total)), abs=1e-5)


@pytest.mark.parametrize("samples", [0.5, 10.0, 300.0])
def test_mean_in_clutter_is_1_over_the_unknown_scale_too(samples):
    """Of three hits: V is a sum of three, over a scale known from `samples`: beta prime."""

    def weighted(share: float) -> float:
        total = samples * share / (1.0 - share)  # share: beta(3, N)
        log_density = 2.0 * math.log(share) + (samples - 1.0) * math.log1p(-share)
        norm = math.gamma(3.0) / np.prod([samples, samples + 1.0, samples + 2.0])
        log_ratio_there = amplitude_law.log_ratio(np.array(3.0), np.array(total), samples)
        return math.exp(log_density + log_ratio_there) / norm

    mean = integrate.quad(weighted, 0.0, 1.0, limit=500)[0]
    assert mean == pytest.approx(1.0, abs=1e-4)


def test_table_agrees_with_the_formula():
    table = RatioTable.for_count(200.0, 16)
    hits, total = np.arange(17), np.linspace(0.0, 150.0, 17)
    expected = amplitude_law.log_ratio(hits.astype(float), total, table.count)
    np.testing.assert_allclose(table.at(hits, total), expected, atol=0.02)
    assert abs(table.count / 200.0 - 1.0) < 0.1


def test_ratio_of_many_hits_is_that_of_their_mean():
    for truth in (0.0, 10.0):
        hits = np.array([400.0])
        found = amplitude_law.ratio_db(hits, hits * (1.0 + 10.0 ** (truth / 10.0)))[0]
        assert found == pytest.approx(truth, abs=0.6)
    assert np.isnan(amplitude_law.ratio_db(np.zeros(2), np.zeros(2))).all()
    low = amplitude_law.ratio_db(np.array([50.0]), np.array([50.0]))[0]
    assert FIGURES_DB[0] <= low < -3.0
    assert KNOWN_LAW_COUNT > 1e4
