"""Merging: which tracks, disjoint ones the best first; and the thresholds of the evaluations."""

import itertools
import math

import numpy as np
import pytest
from scipy import stats
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from tsepm_ros.tracker import assignment, merging
from tsepm_ros.tracker.assignment import disjoint
from tsepm_ros.tracker.initial_state import NO_HIT
from tsepm_ros.tracker.merging import best_of_alike, groups, merging_threshold
from tsepm_ros.tracker.pruning import clutter_threshold, distance_threshold

P_TM = 0.9


def test_the_threshold_is_that_of_two_degrees_of_freedom_as_published():
    assert merging_threshold(0.9) == pytest.approx(stats.chi2(2).ppf(0.9))
    assert merging_threshold(0.9) == pytest.approx(4.61, abs=0.005)


def every_pair(hits, states, covariances) -> np.ndarray:
    """Labels from a look at every pair."""
    n, m = hits.shape
    edges = []
    for i, j in itertools.combinations(range(n), 2):
        if 2 * len(set(hits[i]) & set(hits[j])) <= m:
            continue
        d = states[i] - states[j]
        if d @ np.linalg.solve(covariances[i] + covariances[j], d) <= merging_threshold(P_TM):
            edges.append((i, j))
    one, other = np.array(edges).reshape(-1, 2).T
    graph = csr_array((np.ones(len(edges)), (one, other)), shape=(n, n))
    return connected_components(graph, directed=False)[1]


def crowd(m: int, spread: float):
    """Tracks through the same few detections per scan, states more or less close."""
    rng = np.random.default_rng([5, m])
    hits = np.unique(rng.integers(0, 3, (150, m)) + 3 * np.arange(m), axis=0)
    root = rng.standard_normal((len(hits), 4, 6))
    return hits, spread * rng.standard_normal((len(hits), 4)), root @ np.swapaxes(root, 1, 2)


def partition(labels: np.ndarray) -> set[frozenset[int]]:
    return {frozenset(np.flatnonzero(labels == label).tolist()) for label in np.unique(labels)}


@pytest.mark.parametrize("m", [3, 4, 5, 6, 8, 12])
@pytest.mark.parametrize("spread", [0.5, 3.0, 8.0], ids=["close", "mixed", "apart"])
@pytest.mark.parametrize("block", [1, 13, merging.PAIR_BLOCK])
def test_groups_are_those_of_a_look_at_every_pair(monkeypatch, block, m, spread):
    monkeypatch.setattr(merging, "PAIR_BLOCK", block)
    scene = crowd(m, spread)
    assert partition(groups(*scene, P_TM)[0]) == partition(every_pair(*scene))


def test_where_the_time_is_over_the_groups_not_compared_are_told_by_their_label():
    # The first and the second agree, and so do the second and the fourth; which is not compared.
    hits = np.array([[1, 2, 3, 4], [1, 2, 3, 5], [1, 2, 3, 6], [1, 2, 3, 7], [8, 9, 10, 11]])
    states = np.zeros((5, 4))
    states[:, 0] = [0.0, 1.0, 1e4, 0.5, 0.0]
    covariances = np.broadcast_to(np.eye(4), (5, 4, 4))
    every, same = groups(hits, states, covariances, P_TM)
    assert partition(every) == partition(np.array([0, 0, 1, 0, 2]))
    assert same is every
    some, alike = groups(hits, states, covariances, P_TM, lambda: True)
    assert partition(some) == partition(np.array([0, 0, 1, 2, 3]))
    assert partition(alike) == partition(np.array([0, 0, 0, 0, 1]))
    evaluation = np.array([3.0, 1.0, 2.0, 4.0, 9.0])
    best = best_of_alike(some, alike, evaluation)
    assert [rows.tolist() for rows in best] == [[0, 1], [4]]
    assert len(best_of_alike(every, same, evaluation)) == 3


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


def plain_disjoint(members, cost):
    taken, chosen = set(), []
    for row in sorted(range(len(cost)), key=lambda one: (cost[one], one)):
        mine = set(members[row].tolist()) - {NO_HIT}
        if not mine & taken:
            taken |= mine
            chosen.append(row)
    return sorted(chosen)


@pytest.mark.parametrize("block", [1, 7, 50_000])
@pytest.mark.parametrize("seed", range(5))
def test_disjoint_rows_are_those_of_a_plain_loop(seed, block, monkeypatch):
    monkeypatch.setattr(assignment, "BLOCK", block)
    rng = np.random.default_rng(seed)
    members = rng.integers(-1, 40, (100, 3))
    cost = rng.integers(0, 10, 100).astype(float)
    assert disjoint(members, cost).tolist() == plain_disjoint(members, cost)
