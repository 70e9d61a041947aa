"""Features of plots: the decision function as printed, and as it is used."""

import numpy as np
import pytest
from scipy import stats

from tsepm_ros import Scan
from tsepm_ros.tracker.measurement import (
    GATE_PROBABILITY,
    MAX_PLOT_COUNT,
    Histories,
    decision,
    measured_features,
)

SPREAD = np.array([4.0, 8.0, 0.002])
MEAN = np.array([50.0, 60.0, 0.015])


def drawn(rng: np.random.Generator, *shape: int) -> np.ndarray:
    return MEAN + SPREAD * rng.standard_normal((*shape, 3))


def test_the_printed_decision_by_hand():
    # Mean (2, 4) of three plots; with (6, 8) it is (3, 5): 1 + 1.
    history = np.array([[1.0, 4.0], [2.0, 4.0], [3.0, 4.0]])
    assert decision(history, np.array([6.0, 8.0])) == pytest.approx(2.0)


def test_the_printed_decision_shrinks_with_the_history():
    # As printed no threshold fits a short and a long history: why it is not what is used.
    rng = np.random.default_rng(1)
    short, long = drawn(rng, 500, 3), drawn(rng, 500, 30)
    candidate = drawn(rng, 500)
    assert decision(short, candidate).mean() > 30 * decision(long, candidate).mean()


@pytest.mark.parametrize("plots", [3, 5, 20])
def test_own_plots_are_chi_square_distributed_whatever_their_number(plots):
    # Kolmogorov-Smirnov at 0.1 %; the share outside the gate within 3.3 standard errors of 1 %.
    rng = np.random.default_rng([2, plots])
    n = 4000
    histories, candidate = Histories.of(drawn(rng, n, plots)), drawn(rng, n)
    found = histories.dissimilarity(candidate)
    assert stats.kstest(found, stats.chi2(3).cdf).pvalue > 1e-3
    outside = 1.0 - histories.resembled_by(candidate).mean()
    assert outside == pytest.approx(1.0 - GATE_PROBABILITY, abs=3.3 * np.sqrt(0.0099 / n))


def test_another_target_s_plots_do_not_resemble():
    rng = np.random.default_rng(3)
    histories = Histories.of(drawn(rng, 500, 20))
    assert histories.resembled_by(drawn(rng, 500) - 4.0 * SPREAD).mean() < 0.01


def test_plots_one_by_one_give_the_mean_and_spread_of_all():
    rng = np.random.default_rng(4)
    plots = drawn(rng, 5, 12)
    plots[rng.random(plots.shape) < 0.2] = np.nan
    histories = Histories.of(plots[:, :3])
    for column in range(3, 12):
        histories = histories.with_plots(np.arange(5), plots[:, column])
    np.testing.assert_array_equal(histories.count, np.isfinite(plots).sum(axis=1))
    np.testing.assert_allclose(histories.mean, np.nanmean(plots, axis=1))
    expected = np.nanvar(plots, axis=1) * histories.count
    np.testing.assert_allclose(histories.square, expected, rtol=1e-9)


def test_only_the_given_rows_take_a_plot():
    before = Histories.of(np.ones((3, 2, 3)))
    after = before.with_plots(np.array([1]), np.full((1, 3), 4.0))
    assert after.count[:, 0].tolist() == [2.0, 3.0, 2.0]
    assert after.mean[:, 0].tolist() == [1.0, 2.0, 1.0]
    assert before.mean[1, 0] == 1.0, "the one before is as it was"


def test_old_plots_fade_so_that_a_changed_aspect_is_followed():
    histories = Histories.of(np.zeros((1, 1, 3)))
    for _ in range(100):
        histories = histories.with_plots(np.array([0]), np.full((1, 3), 0.0))
    for _ in range(100):
        histories = histories.with_plots(np.array([0]), np.full((1, 3), 7.0))
    assert histories.count[0, 0] == pytest.approx(MAX_PLOT_COUNT)
    assert histories.mean[0, 0] == pytest.approx(7.0, abs=0.5)


@pytest.mark.parametrize(
    ("history", "candidate", "resembles"),
    [
        (np.full((1, 0, 3), 0.0), [1e3, 1e3, 1e3], True),
        (np.full((1, 1, 3), 5.0), [1e3, 1e3, 1e3], True),
        (np.full((1, 9, 3), 5.0), [np.nan, np.nan, np.nan], True),
        (np.full((1, 9, 3), 5.0), [5.0, 5.0, 5.0], True),
        (np.full((1, 9, 3), 5.0), [9.0, np.nan, np.nan], False),
        (np.full((1, 9, 3), 0.0), [0.0, 0.0, 0.0], True),
        (np.full((1, 9, 3), 0.0), [0.0, 1e-3, 0.0], False),
    ],
    ids=["no plots", "one plot", "not measured", "same", "other", "always 0", "0 but once"],
)
def test_what_cannot_be_told_apart_resembles(history, candidate, resembles):
    with np.errstate(all="raise"):
        found = Histories.of(history).resembled_by(np.array([candidate]))
    assert found.tolist() == [resembles]


def test_features_of_a_scan_are_in_columns_and_nan_where_there_are_none():
    scan = Scan(
        0.0, [1e3, 2e3], [0.0, 0.1], features={"azimuth_width": [0.1, np.inf], "intensity": [5, 6]}
    )
    np.testing.assert_array_equal(
        measured_features(scan), [[5.0, np.nan, 0.1], [6.0, np.nan, np.nan]]
    )
