"""The GOSPA metric, against every assignment that there is."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from tsepm_ros.tools.evaluation.measures import gospa


def plain_gospa(tracks: np.ndarray, targets: np.ndarray, cutoff: float) -> float:
    """Equation (1) of the paper's Proposition 1, p = 2, by trying everything."""
    n, m = len(tracks), len(targets)
    least = math.inf
    for size in range(min(n, m) + 1):
        for chosen in itertools.combinations(range(n), size):
            for theirs in itertools.permutations(range(m), size):
                apart = sum(
                    float(((tracks[i] - targets[j]) ** 2).sum())
                    for i, j in zip(chosen, theirs, strict=True)
                )
                least = min(least, apart + cutoff**2 / 2 * (n + m - 2 * size))
    return math.sqrt(least)


@pytest.mark.parametrize("seed", range(30))
def test_the_metric_is_the_least_over_all_assignments(seed):
    rng = np.random.default_rng([5, seed])
    tracks = rng.uniform(0, 100, (rng.integers(0, 5), 2))
    targets = rng.uniform(0, 100, (rng.integers(0, 5), 2))
    cutoff = float(rng.uniform(10, 80))
    found = gospa(tracks, targets, cutoff)
    assert found.distance == pytest.approx(plain_gospa(tracks, targets, cutoff))
    assert gospa(targets, tracks, cutoff).distance == pytest.approx(found.distance)


def test_a_track_at_the_cut_off_is_false_and_its_target_missed():
    found = gospa(np.array([[10.0, 0.0]]), np.array([[0.0, 0.0]]), 10.0)
    assert (found.localisation, found.missed, found.false) == (0.0, 50.0, 50.0)
