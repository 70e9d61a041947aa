"""The two evaluations: by hand, and what clutter gives."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats
from support.builders import detections

from tsepm_ros.tracker.evaluation import clutter_statistic


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
