"""Merging: which tracks, and into what."""

import itertools
import math

import numpy as np
import pytest
from scipy import stats
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components
from support.builders import scan_at

from tsepm_ros import SensorModel, make_initiator
from tsepm_ros.numerics.grouped import members_of_groups
from tsepm_ros.tracker import merging
from tsepm_ros.tracker.merging import best_of_alike, groups, merging_threshold, moments

P_TM = 0.9


def together(hits, states=None, covariances=None) -> list[list[int]]:
    """Groups of more than one track; all states equal unless given."""
    hits = np.asarray(hits)
    states = np.zeros((len(hits), 4)) if states is None else np.asarray(states, float)
    if covariances is None:
        covariances = np.broadcast_to(np.eye(4), (len(hits), 4, 4)).copy()
    labels, _ = groups(hits, states, covariances, P_TM)
    return [rows.tolist() for rows in members_of_groups(labels) if len(rows) > 1]


@pytest.mark.parametrize(
    ("one", "other", "merge"),
    [
        pytest.param([1, 2], [1, 3], False, id="1 of 2"),
        pytest.param([1, 2, 3], [1, 8, 9], False, id="1 of 3"),
        pytest.param([1, 2, 3], [1, 2, 9], True, id="2 of 3"),
        pytest.param([1, 2, 3, 4], [1, 2, 8, 9], False, id="exactly half of 4"),
        pytest.param([1, 2, 3, 4], [1, 2, 3, 9], True, id="3 of 4"),
        pytest.param([1, 2, 3, 4, 5], [1, 2, 7, 8, 9], False, id="2 of 5"),
        pytest.param([1, 2, 3, 4, 5], [3, 4, 5, 8, 9], True, id="3 of 5, at other places"),
        pytest.param([1, 2, 3, 4, 5, 6], [1, 2, 3, 7, 8, 9], False, id="exactly half of 6"),
        pytest.param(range(20), range(10, 30), False, id="exactly half of 20"),
        pytest.param(range(20), range(9, 29), True, id="11 of 20"),
    ],
)
def test_tracks_merge_that_share_more_than_half_of_their_hits(one, other, merge):
    assert together([list(one), list(other)]) == ([[0, 1]] if merge else [])


@pytest.mark.parametrize(("factor", "merge"), [(0.999999, True), (1.000001, False)])
@pytest.mark.parametrize("axis", range(4), ids=["x", "vx", "y", "vy"])
def test_states_merge_up_to_the_threshold_of_eq_30(axis, factor, merge):
    covariances = np.array([np.diag([4.0, 1.0, 9.0, 2.0]), np.diag([5.0, 3.0, 7.0, 2.0])])
    total = covariances.sum(axis=0)
    states = np.zeros((2, 4))
    states[1, axis] = factor * math.sqrt(merging_threshold(P_TM) * total[axis, axis])
    assert together([[1, 2, 3], [1, 2, 4]], states, covariances) == ([[0, 1]] if merge else [])


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


def crowd(m: int, spread: float, seed: int = 0):
    """Tracks through the same few detections per scan, states more or less close."""
    rng = np.random.default_rng([5, m, seed])
    hits = np.unique(rng.integers(0, 3, (150, m)) + 3 * np.arange(m), axis=0)
    root = rng.standard_normal((len(hits), 4, 6))
    return hits, spread * rng.standard_normal((len(hits), 4)), root @ np.swapaxes(root, 1, 2)


def partition(labels: np.ndarray) -> set[frozenset[int]]:
    return {frozenset(np.flatnonzero(labels == label).tolist()) for label in np.unique(labels)}


@pytest.mark.parametrize("m", [3, 4, 5, 6, 8, 12])
@pytest.mark.parametrize("spread", [0.5, 3.0, 8.0], ids=["close", "mixed", "apart"])
def test_groups_are_those_of_a_look_at_every_pair(m, spread):
    scene = crowd(m, spread)
    assert partition(groups(*scene, P_TM)[0]) == partition(every_pair(*scene))


@pytest.mark.parametrize("block", [1, 13, 1000])
@pytest.mark.parametrize("spread", [0.5, 3.0], ids=["close", "mixed"])
def test_the_block_size_does_not_change_the_groups(monkeypatch, block, spread):
    scene = crowd(5, spread, seed=1)
    expected = partition(groups(*scene, P_TM)[0])
    monkeypatch.setattr(merging, "PAIR_BLOCK", block)
    assert partition(groups(*scene, P_TM)[0]) == expected
    assert 1 < len(expected) < len(scene[0]) or spread < 1


def test_moments_by_hand():
    # f_1 of 1 and 3: p = 1/4 and 3/4 (Eq. 31).
    states = np.array([[0.0, 4.0, 8.0, -4.0], [4.0, 8.0, 0.0, 0.0]])
    covariances = np.array([np.eye(4), 5.0 * np.eye(4)])
    state, covariance = moments(states, covariances, np.array([1.0, 3.0]))
    np.testing.assert_allclose(state, [3.0, 7.0, 2.0, -1.0])
    np.testing.assert_allclose(covariance, 4.0 * np.eye(4))


def test_moments_leave_out_the_spread_of_the_means_as_published():
    states = np.array([[-1000.0, 0, 0, 0], [1000.0, 0, 0, 0]])
    _, covariance = moments(states, np.array([np.eye(4)] * 2), np.array([1.0, 1.0]))
    np.testing.assert_allclose(covariance, np.eye(4))


@pytest.mark.parametrize(
    ("last_scans", "confirmed"),
    [
        pytest.param([[300.0, -300.0], []], [1, 0], id="same scan: merged"),
        pytest.param([[300.0], [-300.0]], [1, 1], id="one scan later: published again"),
    ],
)
def test_only_tracks_confirmed_in_the_same_scan_merge(last_scans, confirmed):
    # Condition a. Two tracks share three hits, part in the fourth scan, and have wide errors.
    initiator = make_initiator(
        "tsepm",
        sensor=SensorModel(range_std=300.0, range_std_fraction=0.0, azimuth_std=0.1),
        max_speed=20.0,
        gate_probability=1e-9,
    )
    scans = [[0.0], [0.0], [0.0], [150.0, -150.0], *last_scans]
    tracks = [
        initiator.process(scan_at(12.0 * k, [(3000.0, y) for y in ys]))
        for k, ys in enumerate(scans)
    ]
    assert [len(new) for new in tracks] == [0, 0, 0, 0, *confirmed]
    assert initiator.totals.raw_confirmations == 2


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
