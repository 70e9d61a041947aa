"""The two evaluations: by hand, and what clutter gives."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats
from support.builders import detections

from tsepm_ros import SensorModel
from tsepm_ros.numerics.gaussian import squared_distance
from tsepm_ros.tracker.evaluation import clutter_statistic, normalized_distance
from tsepm_ros.tracker.initial_state import fit

SENSOR = SensorModel()


def test_f1_by_hand():
    # x = 0, 1, 0 at times -2, -1, 0 and unit errors. The line is x = 1/3: misfits -1/3, 2/3, -1/3.
    # Its variance is 1/3 in the middle and 1/3 + 1/2 at the ends, plus 1 for the hit (Eq. 21):
    # f = (1/9) / (11/6) at the ends and (4/9) / (4/3) = 1/3 in the middle.
    hits = detections([[[0.0, 7.0], [1.0, 7.0], [0.0, 7.0]]], [[0.0, 1.0, 2.0]])
    fitted = fit(hits, 2.0, SENSOR, "unweighted")
    assert normalized_distance(hits, fitted) == pytest.approx([1 / 3])


def test_f1_is_the_largest_of_the_hits_distances():
    hits = detections([[[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [3.0, 9.0]]], [[0.0, 1.0, 2.0, 3.0]])
    fitted = fit(hits, 3.0, SENSOR, "unweighted")
    tau = np.array([-3.0, -2.0, -1.0, 0.0])
    H = np.stack([np.kron(np.eye(2), [1.0, t]) for t in tau])
    each = []
    for k in range(4):
        misfit = hits["position"][0, k] - H[k] @ fitted.state[0]
        spread = H[k] @ fitted.covariance[0] @ H[k].T + np.eye(2)
        each.append(misfit @ np.linalg.solve(spread, misfit))
    assert normalized_distance(hits, fitted) == pytest.approx([max(each)])
    assert max(each) > 2 * min(each)


def test_f1_of_hits_on_a_line_is_zero():
    positions = [[[1e4 + 5.0 * k, 2e4 - 3.0 * k] for k in range(5)]]
    hits = detections(positions, [[12.0 * k for k in range(5)]])
    fitted = fit(hits, 48.0, SENSOR, "unweighted")
    assert normalized_distance(hits, fitted) == pytest.approx([0.0], abs=1e-12)


def test_f2_by_hand():
    # Steps of 5 and 13 m: 2 lambda pi (25 + 169).
    hits = detections([[[0.0, 0.0], [3.0, 4.0], [8.0, 16.0]]], [[0.0, 1.0, 2.0]])
    assert clutter_statistic(hits["position"], 1e-3) == pytest.approx([2e-3 * math.pi * 194.0])


def test_f2_is_taken_from_hit_to_hit_of_each_track():
    hits = detections(
        [[[0.0, 0.0], [1.0, 0.0]], [[100.0, 0.0], [100.0, 2.0]]], [[0.0, 1.0], [0.0, 1.0]]
    )
    assert clutter_statistic(hits["position"], 0.5) == pytest.approx([math.pi, 4 * math.pi])


def test_f2_counts_each_area_with_the_density_at_its_hit():
    # Steps of 5 and 13 m, the first hit's density in no area.
    hits = detections([[[0.0, 0.0], [3.0, 4.0], [8.0, 16.0]]], [[0.0, 1.0, 2.0]])
    found = clutter_statistic(hits["position"], np.array([[9.0, 2e-3, 3e-3]]))
    assert found == pytest.approx([2 * math.pi * (2e-3 * 25.0 + 3e-3 * 169.0)])


@pytest.mark.parametrize("hit_count", [2, 3, 5])
def test_f2_of_nearest_clutter_points_is_chi_square(hit_count):
    # Kennedy's null hypothesis: from point to nearest point of each new scan. 1000 independent
    # tracks; a Kolmogorov-Smirnov test at 0.1 %, for which a density 12 % off is found.
    rng = np.random.default_rng([12, hit_count])
    density, half = 1e-6, 6000.0
    positions = np.zeros((1000, hit_count, 2))
    for track in positions:
        for k in range(1, hit_count):
            n = rng.poisson(density * (2 * half) ** 2)
            points = track[k - 1] + rng.uniform(-half, half, (n, 2))
            track[k] = points[np.argmin(np.square(points - track[k - 1]).sum(axis=1))]
    statistic = clutter_statistic(positions, density)
    assert stats.kstest(statistic, stats.chi2(2 * hit_count - 2).cdf).pvalue > 1e-3
    wrong = stats.kstest(1.12 * statistic, stats.chi2(2 * hit_count - 2).cdf).pvalue
    assert wrong < stats.kstest(statistic, stats.chi2(2 * hit_count - 2).cdf).pvalue


def test_a_target_makes_f2_small_and_clutter_does_not():
    step = np.array([60.0, 0.0])
    target = np.array([[k * step for k in range(5)]])
    clutter = np.array([[k * 10 * step for k in range(5)]])
    expected = stats.chi2(8).mean()
    assert clutter_statistic(target, 1e-6)[0] < 0.05 * expected
    assert clutter_statistic(clutter, 1e-6)[0] > expected


def test_the_squared_distance_is_that_of_a_general_solver():
    rng = np.random.default_rng(7)
    root = rng.standard_normal((20, 3, 2, 2))
    covariances, misfits = root @ np.swapaxes(root, -1, -2), rng.standard_normal((20, 3, 2))
    solved = np.linalg.solve(covariances, misfits[..., None])[..., 0]
    expected = (misfits * solved).sum(axis=-1)
    np.testing.assert_allclose(squared_distance(misfits, covariances), expected, rtol=1e-6)
