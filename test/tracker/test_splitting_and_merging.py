"""Splitting and merging: who may extend whom, which tracks are one target's, and thresholds."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components
from scipy.stats import multivariate_normal
from support.builders import detections

from tsepm_ros import ConfirmedTrack
from tsepm_ros.numerics.gaussian import gate_factor
from tsepm_ros.studies import assignment
from tsepm_ros.studies.assignment import disjoint
from tsepm_ros.tracker import merging, splitting
from tsepm_ros.tracker.hypotheses import Hypotheses, Start, given_starts
from tsepm_ros.tracker.initial_state import NO_HIT
from tsepm_ros.tracker.merging import groups, merging_threshold
from tsepm_ros.tracker.splitting import Gated, children, gate, split_paths
from tsepm_ros.tracker.tracks import TrackArrays

P_TM = 0.9


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


@pytest.mark.parametrize("spread", [0.5, 3.0, 8.0], ids=["close", "mixed", "apart"])
@pytest.mark.parametrize(
    ("m", "block"), [(3, 1), (4, 13), (5, 1), *((m, merging.PAIR_BLOCK) for m in (6, 8, 12))]
)
def test_groups_are_those_of_a_look_at_every_pair(monkeypatch, block, m, spread):
    monkeypatch.setattr(merging, "PAIR_BLOCK", block)
    scene = crowd(m, spread)
    assert partition(groups(*scene, P_TM)) == partition(every_pair(*scene))


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


def agrees(*offsets: float, explained: float = 0.0) -> list[bool]:
    """Of tracks in a row with a deviation of 10 m and 1 m/s, the first the oldest."""
    state = np.zeros((len(offsets), 4))
    state[:, 0] = offsets
    covariance = np.stack([np.diag([100.0, 1.0, 100.0, 1.0])] * len(offsets))
    every, each = np.ones(len(offsets), bool), np.full(len(offsets), explained)
    return merging.agrees_with_older(state, covariance, every, each).tolist()


def test_the_younger_of_two_tracks_agrees_within_the_gate():
    # d' (P_i + P_j)^-1 d = d^2 / 200 against 7.78: 39.4 m.
    assert agrees(0.0, 39.0) == [False, True]
    assert agrees(0.0, 40.0) == [False, False]
    assert agrees(5.0, 500.0, 0.0) == [False, False, True]
    assert agrees(0.0) == [False]


def test_tracks_that_explain_more_than_one_detection_and_a_half_are_two_targets():
    assert agrees(0.0, 10.0, explained=0.76) == [False, False]
    assert agrees(0.0, 10.0, explained=0.75) == [False, True]


def starts_at(*rows: tuple[float, float], hits=((5, 0), (6, 0), (7, 0))) -> TrackArrays:
    """Starts at positions, at rest, with errors of 2 m and 1 m/s."""
    covariance = np.diag([4.0, 1.0, 4.0, 1.0])
    return TrackArrays.of(
        [
            ConfirmedTrack(place, 7.0, np.array([x, 0.0, y, 0.0]), covariance, hits, 0.0)
            for place, (x, y) in enumerate(rows)
        ]
    )


def test_a_start_by_two_of_a_track_s_own_detections_is_that_track():
    starts = starts_at((0.0, 0.0))
    two, one = {(5, 0): 9, (6, 0): 9}, {(5, 0): 9}
    assert merging.own_starts(starts, two, frozenset()).tolist() == [9]
    assert merging.own_starts(starts, one, frozenset()).tolist() == [-1]
    assert merging.own_starts(starts, two, frozenset({9})).tolist() == [-1], "has another"
    twice = TrackArrays.joined(starts, starts)
    assert merging.own_starts(twice, two, frozenset()).tolist() == [9, -1]


def test_a_start_with_most_of_a_track_s_published_hits_is_that_track():
    starts = starts_at((0.0, 0.0))
    others = tuple((k, 9) for k in range(len(starts.hits[0]) - 1))
    of_most, of_few = (*starts.hits[0][:-1], (99, 0)), (starts.hits[0][0], *others)
    most, few = (
        replace(starts, hits=np.fromiter([hits], object), track_id=np.array([track_id]))
        for hits, track_id in ((of_most, 4), (of_few, 5))
    )
    assert merging.published_owners(starts, TrackArrays.joined(few, most)).tolist() == [4]
    assert merging.published_owners(starts, few).tolist() == [-1]


def test_given_a_start_the_score_falls_by_the_share_of_the_hits_that_are_its_own():
    of, none = Hypotheses.none(3), NO_HIT
    hypotheses = replace(
        of,
        hits=np.array([[1, 2, none], [1, 3, none], [2, none, none]]),
        hit_count=np.array([2, 2, 1]),
        score_given_held=np.array([6.0, 6.0, -1.0]),
    )
    start = Start(
        np.array([1]), np.array([1, 2]), np.array([1.0, 0.5]), np.zeros(4), np.eye(4), 8.0
    )
    given = given_starts(hypotheses, [start])
    np.testing.assert_allclose(given.score_given_held, [1.5, 3.0, -1.0])


def test_a_track_that_has_other_detections_since_is_not_lost_and_each_is_continued_once():
    starts = starts_at((1.0, 0.0), (0.0, 0.0))
    lost = starts_at((0.0, 0.0), (50.0, 0.0)).numbered(np.array([4, 6]))
    existence = np.array([0.9, 0.9])
    found = merging.continued(starts, lost, existence, {(4, 3): 4}, 1e-9)
    assert found.tolist() == [4, -1]
    found = merging.continued(starts, lost, existence, {(6, 3): 4}, 1e-9)
    assert found.tolist() == [-1, -1]
    found = merging.continued(starts, lost, existence, {(6, 0): 4}, 1e-9)
    assert found.tolist() == [4, -1], "its own hits do not count"


def test_continuations_by_a_bound_are_those_of_all_pairs():
    # And each pair that cannot be is left out before anything is solved: 0.7 s at 1000 x 1000.
    rng = np.random.default_rng(4)
    places = rng.uniform(-300.0, 300.0, (40, 2))
    lost = starts_at(*map(tuple, places)).numbered(np.arange(40))
    starts = starts_at(*map(tuple, places[:20] + rng.normal(0.0, 6.0, (20, 2))))
    existence, births = rng.uniform(0.05, 0.9, 40), 1e-5
    free, expected = set(range(40)), []
    for one in starts:
        ratios = {
            k: existence[k]
            * multivariate_normal(lost.state[k], one.covariance + lost.covariance[k]).pdf(one.state)
            for k in free
        }
        best = max(ratios, key=ratios.__getitem__)
        expected.append(best if ratios[best] > births else -1)
        free.discard(expected[-1])
    assert 3 < expected.count(-1) < 20
    assert merging.continued(starts, lost, existence, {}, births).tolist() == expected


@pytest.mark.parametrize("seed", range(5))
def test_residual_detections_are_those_in_no_gate(seed):
    rng = np.random.default_rng(seed)
    last = detections(rng.uniform(-1000, 1000, (30, 2)), 0.0, variance=1.0)
    last["major_sigma"] = rng.uniform(1.0, 60.0, 30)
    found = detections(rng.uniform(-1000, 1000, (200, 2)), 6.0)
    gated = gate(last, found, 10.0, 0.9)
    radius = 60.0 + gate_factor(0.9) * last["major_sigma"]
    distance = np.linalg.norm(found["position"][:, None] - last["position"], axis=2)
    expected = np.flatnonzero((distance > radius).all(axis=1))
    assert 20 < len(expected) < 180
    assert np.delete(np.arange(200), gated.detection).tolist() == expected.tolist()


def random_split(seed: int, ties: bool):
    rng = np.random.default_rng([4, seed])
    counts = rng.integers(0, 6, 30)
    start = np.concatenate([[0], np.cumsum(counts)])
    gated = Gated(start, rng.integers(0, 50, start[-1]))
    gates = rng.integers(0, 30, 80)
    prices = rng.integers(0, 8, (80, 50)) if ties else rng.random((80, 50))
    return gates, gated, lambda parent, detection: prices[parent, detection].astype(float)


@pytest.mark.parametrize("block", [1, 7, 64, 1_000_000])
@pytest.mark.parametrize("ties", [False, True], ids=["distinct", "ties"])
@pytest.mark.parametrize("limit", [1, 10, 100])
def test_split_within_keeps_exactly_the_best_children(monkeypatch, block, ties, limit):
    monkeypatch.setattr(splitting, "SPLIT_BLOCK", block)
    gates, gated, cost = random_split(limit, ties)
    everyone = children(gates, gated)
    best = np.sort(np.argsort(cost(*everyone), kind="stable")[:limit])
    parent, detection, cut = split_paths(gates, gated, limit, cost)
    assert parent.tolist() == everyone[0][best].tolist()
    assert detection.tolist() == everyone[1][best].tolist()
    assert cut == len(everyone[0]) - limit
