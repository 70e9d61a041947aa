"""Figures of runs and their intervals, by hand, by SciPy and by every assignment that there is."""

import math

import numpy as np
import pytest
from scipy import stats
from support.builders import fit_matrix
from support.run_summaries import run_of, start

from tsepm_ros import SensorModel
from tsepm_ros.tools.evaluation.intervals import (
    Estimate,
    mean,
    mean_count,
    proportion,
    quantile,
    rms_ratio,
    root_mean_square,
)
from tsepm_ros.tools.evaluation.measures import cramer_rao, measures_of
from tsepm_ros.tools.evaluation.simulated_run import Outcome
from tsepm_ros.tools.simulation import Scenario

TRUE, REDUNDANT, MISPLACED = Outcome.TRUE, Outcome.REDUNDANT, Outcome.MISPLACED
SCENE = Scenario("hand", scans=4, period=12.0, clutter_box=(0.0, 1000.0, 0.0, 2000.0))
RUNS = [
    run_of(start(0), start(3), false=(3, 0, 0, 0), targets=2),
    run_of(start(1), start(2, MISPLACED), *[start(3, REDUNDANT)] * 4, targets=2),
]


def test_counts_by_hand_of_all_scans_and_of_a_horizon():
    figures = measures_of(SCENE, RUNS)
    assert (figures.runs, figures.scans) == (2, 4)
    assert figures.detection == proportion(3, 4)
    assert figures.false_per_run == mean_count([3, 1])
    assert figures.false_density.value == pytest.approx(2.0 / (4 * 2.0))
    assert figures.false_density.high == pytest.approx(figures.false_per_run.high / 8.0)
    assert figures.false_per_hour.value == pytest.approx(2.0 * 3600.0 / 48.0)
    assert figures.redundant_per_run.value == 2.0
    assert figures.confirmation_time.value == pytest.approx((0 + 36 + 12) / 3)
    assert figures.confirmation_median.value == 12.0
    figures = measures_of(SCENE, RUNS, 2)
    assert figures.scans == 2
    assert figures.detection == proportion(2, 4)
    assert figures.false_per_run == mean_count([3, 0])
    assert figures.false_density.value == pytest.approx(1.5 / (2 * 2.0))
    assert figures.false_per_hour.value == pytest.approx(1.5 * 3600.0 / 24.0)
    assert figures.redundant_per_run.value == 0.0


def test_errors_of_true_and_of_pure_starts():
    mixed = start(1, pure=False, position_error=90.0, velocity_error=9.0, nees=30.0)
    far = start(1, MISPLACED, position_error=50.0, nees=10.0)
    again = start(2, REDUNDANT, position_error=1.0, nees=0.0)
    figures = measures_of(SCENE, [run_of(start(0), mixed, far, again, targets=2)])
    assert figures.position_error.value == pytest.approx(math.sqrt((30**2 + 90**2) / 2))
    assert figures.velocity_error.value == pytest.approx(math.sqrt((2**2 + 9**2) / 2))
    assert figures.nees.value == 17.0
    assert figures.pure_position_error.value == pytest.approx(math.sqrt((30**2 + 50**2) / 2))
    assert figures.pure_nees.value == 7.0
    assert figures.position_to_bound.value == pytest.approx(math.sqrt((30**2 + 50**2) / 1800))


def test_what_is_not_known_has_no_figure():
    figures = measures_of(SCENE, [run_of(held=-1)] * 3)
    assert figures.detection.value == 0.0
    assert figures.text("detection").startswith("0.0000 (")
    for name in ("held", "nees", "pure_nees", "position_to_bound", "confirmation_median"):
        assert math.isnan(getattr(figures, name).value)
        assert figures.text(name) == "-"


@pytest.mark.parametrize(
    ("successes", "trials"), [(0, 10), (1, 10), (5, 10), (10, 10), (458, 500), (1999, 2000)]
)
def test_a_share_has_wilson_s_interval(successes, trials):
    found = proportion(successes, trials)
    expected = stats.binomtest(successes, trials).proportion_ci(0.95, method="wilson")
    assert found.value == successes / trials
    assert found.low == pytest.approx(expected.low, abs=1e-12)
    assert found.high == pytest.approx(expected.high, abs=1e-12)


def test_of_nothing_no_value_is_known_and_of_one_no_interval():
    found = proportion(0, 0)
    assert math.isnan(found.value)
    assert (found.low, found.high) == (0.0, 1.0)
    assert mean([3.0]).value == 3.0
    assert math.isnan(mean([3.0]).low)
    assert math.isnan(mean([3.0]).high)
    for figure in (mean, mean_count, root_mean_square):
        assert math.isnan(figure([]).value)
    assert math.isnan(quantile([], 0.5).value)
    assert math.isnan(rms_ratio([], []).value)


def test_a_mean_has_the_normal_interval():
    values = np.random.default_rng(1).exponential(3.0, 200)
    found = mean(values)
    expected = stats.norm.interval(0.95, values.mean(), stats.sem(values))
    assert (found.low, found.high) == pytest.approx(expected)
    assert found.value == values.mean()


def test_an_estimate_is_written_with_its_interval():
    assert f"{Estimate(0.9157, 0.8881, 0.937):.3f}" == "0.916 (0.888 to 0.937)"


@pytest.mark.parametrize("counts", [[0] * 40, [1] + [0] * 9, [3, 4, 5, 4, 3, 5]])
def test_counts_that_spread_no_more_than_poisson_s_have_the_exact_interval(counts):
    found, total, runs = mean_count(counts), sum(counts), len(counts)
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
        (0.1, 0.05, [mean_count(values) for values in rng.poisson(0.1, (500, 50))]),
        (1.2, 0.03, [rms_ratio(*pair) for pair in zip(errors, bounds, strict=True)]),
        (math.log(2), 0.05, [quantile(rng.exponential(1.0, 100), 0.5) for _ in range(200)]),
    ]
    for truth, tolerance, estimates in cases:
        covered = np.mean([one.low <= truth <= one.high for one in estimates])
        assert covered == pytest.approx(0.95, abs=tolerance)


@pytest.mark.parametrize(
    ("errors", "bounds", "ratio"), [([2.0], [4.0], 0.5), ([0.0, 0.0], [1.0, 3.0], 0.0)]
)
def test_a_ratio_of_one_pair_or_of_0_has_no_interval(errors, bounds, ratio):
    found = rms_ratio(errors, bounds)
    assert found.value == ratio and math.isnan(found.low) and math.isnan(found.high)


GROWING = SensorModel(range_std=20.0, range_std_fraction=0.1, azimuth_std=math.radians(3.0))
TIMES = np.array([0.0, 12.0, 24.0, 48.0, 60.0])


def line(state: np.ndarray, tau: np.ndarray) -> np.ndarray:
    return (fit_matrix(tau) @ state).reshape(-1, 2)


def test_a_target_at_rest_has_the_bound_of_two_straight_lines():
    # Range and azimuth separate: each is the bound of a line's value and slope.
    range_, tau = 6000.0, TIMES - 70.0
    bound = cramer_rao(np.tile([range_, 0.0], (5, 1)), TIMES, (0.0, 0.0), GROWING, 70.0)
    variance = 20.0**2 + 600.0**2
    of_range = 1.0 / variance + 0.5 * (2 * 0.1**2 * range_ / variance) ** 2
    of_azimuth = 1.0 / (range_ * GROWING.azimuth_std) ** 2
    sums = np.array([[5.0, tau.sum()], [tau.sum(), np.square(tau).sum()]])
    expected = np.kron(np.diag([1.0 / of_range, 1.0 / of_azimuth]), np.linalg.inv(sums))
    np.testing.assert_allclose(bound, expected, rtol=1e-10, atol=1e-10)


def divergence(state, truth, tau, poses, sensor) -> float:
    """Kullback-Leibler divergence of the measurements at a state from those at the true one."""
    total = 0.0
    for here, there in zip(line(state, tau) - poses, line(truth, tau) - poses, strict=True):
        r, r_true = math.hypot(*here), math.hypot(*there)
        v, v_true = float(sensor.range_variance(r)), float(sensor.range_variance(r_true))
        turn = math.atan2(here[1], here[0]) - math.atan2(there[1], there[0])
        total += 0.5 * ((v_true + (r - r_true) ** 2) / v - 1.0 - math.log(v_true / v))
        total += 0.5 * (turn / sensor.azimuth_std) ** 2
    return total


@pytest.mark.parametrize("seed", range(4))
def test_the_information_is_the_curvature_of_the_divergence(seed):
    # Its Hessian at the true state is the Fisher information, whatever the distribution: nothing
    # of the formula is used. From a moving sensor.
    rng = np.random.default_rng([17, seed])
    truth = np.array([3000.0, 4.0, 2000.0, -3.0])
    tau, poses = TIMES - 60.0, rng.uniform(-900, 900, (5, 2))
    step = np.array([3.0, 0.1, 3.0, 0.1])
    hessian = np.zeros((4, 4))
    for i in range(4):
        for j in range(4):
            a, b = np.eye(4)[i] * step, np.eye(4)[j] * step
            corners = [(a + b, 1), (a - b, -1), (b - a, -1), (-a - b, 1)]
            values = [
                sign * divergence(truth + offset, truth, tau, poses, GROWING)
                for offset, sign in corners
            ]
            hessian[i, j] = sum(values) / (4.0 * step[i] * step[j])
    root = np.linalg.cholesky(cramer_rao(line(truth, tau), TIMES, poses, GROWING, 60.0))
    np.testing.assert_allclose(root.T @ hessian @ root, np.eye(4), rtol=0, atol=2e-4)


@pytest.mark.parametrize("times", [[], [5.0], [5.0, 5.0]])
def test_hits_at_one_time_bound_no_velocity(times):
    with pytest.raises(ValueError, match="times"):
        cramer_rao(np.ones((len(times), 2)), times, (0.0, 0.0), GROWING, 5.0)
