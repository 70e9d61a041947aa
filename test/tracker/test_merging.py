"""Merging: which tracks are one target's, against a look at every pair."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components
from scipy.stats import multivariate_normal

from tsepm_ros import ConfirmedTrack
from tsepm_ros.tracker import merging
from tsepm_ros.tracker.merging import groups, merging_threshold
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
    return TrackArrays.from_tracks(
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
