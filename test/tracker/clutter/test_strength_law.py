"""The law of the strength of clutter: ranks in its body, a tail with both parameters integrated."""

import math

import numpy as np
import pytest
from scipy import integrate, stats
from support.strength_laws import QUANTILES

from tsepm_ros.tracker.clutter import amplitude_likelihood
from tsepm_ros.tracker.clutter.amplitude import TAIL_SAMPLES
from tsepm_ros.tracker.clutter.amplitude_law import CURVATURES, MIN_REFERENCES, REACH, AmplitudeLaw


def law_of(values, weights=None) -> AmplitudeLaw:
    values = np.asarray(values, float)
    return AmplitudeLaw.of(values, np.ones(len(values)) if weights is None else weights)


def exponents_of(law: AmplitudeLaw, values) -> np.ndarray:
    return law.exponents(values).told


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
    np.testing.assert_allclose(exponents_of(law, values), expected, atol=1e-12)


def test_ties_count_as_at_least_as_strong():
    law = law_of([1.0] * 50 + [2.0] * 50 + [3.0] * 20)
    assert exponents_of(law, np.array([2.0]))[0] == pytest.approx(-math.log(71.0 / 121.0))


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
        assert exponents_of(law, np.array([law.begin + y]))[0] == pytest.approx(expected, abs=1e-4)


@pytest.mark.parametrize("name", ["exponential", "k", "log-normal", "threshold"])
def test_few_hundred_references_tell_an_exceedance_of_e_to_the_minus_7(name):
    told = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        law = law_of(QUANTILES[name](rng.exponential(size=500)))
        told.append(exponents_of(law, QUANTILES[name](np.array([7.0])))[0])
    assert 6.0 < np.median(told) < 7.6


def test_exponent_ends_where_nothing_can_be_said():
    law = law_of(np.log(np.random.default_rng(3).exponential(size=100)))
    assert exponents_of(law, np.array([50.0]))[0] == law.reach == math.log(101.0) + REACH
    assert exponents_of(law, np.array([-50.0]))[0] == 0.0


@pytest.mark.parametrize("name", sorted(QUANTILES))
@pytest.mark.parametrize("references", [MIN_REFERENCES, 100, 600, 2000])
def test_product_over_a_path_keeps_its_mean_with_a_learned_law(name, references):
    """E[L] <= 1 over the reference too, which the hits of a path share.

    By importance sampling: E_0[L] = E_1[L / L_1], with the hits drawn from targets of the prior's
    ratios and L_1 their likelihood ratio under the true law.
    """
    rng = np.random.default_rng(references)
    quantile, paths, repeats = QUANTILES[name], 60, 120
    ratios, prior = amplitude_likelihood.ratio_prior()
    means = np.zeros((repeats, 4))
    for repeat in range(repeats):
        law = law_of(quantile(rng.exponential(size=references)))
        samples = TAIL_SAMPLES * law.tail_count
        ratio = rng.choice(ratios, paths, p=prior)
        true = (1.0 + ratio[:, None]) * rng.exponential(size=(paths, 16))
        exponent = exponents_of(law, quantile(true).ravel()).reshape(true.shape)
        told = amplitude_likelihood.scaled(exponent, samples)
        for column, hits in enumerate((3, 5, 8, 16)):
            count = np.full(paths, float(hits))
            learned = amplitude_likelihood.log_ratio(count, told[:, :hits].sum(axis=1), samples)
            exact = np.logaddexp.reduce(
                np.log(prior)[:, None]
                - hits * np.log1p(ratios)[:, None]
                + true[:, :hits].sum(axis=1) * (ratios / (1.0 + ratios))[:, None]
            )
            means[repeat, column] = np.exp(learned - exact).mean()
    mean, error = means.mean(axis=0), stats.sem(means, axis=0)
    assert (mean - 2.0 * error < 1.0).all()
    assert (mean < 1.3).all()


def test_strong_references_of_nearly_no_weight_leave_the_law_as_it_is():
    """They are of targets, 100 dB above the clutter."""
    rng = np.random.default_rng(6)
    clutter = np.log(rng.exponential(size=300))
    values = np.append(clutter, clutter[:20] + 10.0 * np.log(10.0))
    law = law_of(values, np.append(np.ones(300), np.full(20, 1e-9)))
    there = np.array([0.5, 1.5])
    found = exponents_of(law, there)
    np.testing.assert_allclose(found, exponents_of(law_of(clutter), there), rtol=0.02)
    far = law.exponents(clutter[:20] + 1e3)
    assert np.isfinite(far.told).all() and np.isfinite(far.extrapolated).all()


def test_figure_in_db_goes_on_where_evidence_ends():
    law = law_of(np.log(np.random.default_rng(5).exponential(size=600)))
    found = law.exponents(np.log(np.array([0.5, 20.0, 60.0]))).extrapolated
    assert found[0] == exponents_of(law, np.log(np.array([0.5])))[0]
    np.testing.assert_allclose(10.0 * np.log10(found[1:] / [20.0, 60.0]), 0.0, atol=2.0)
