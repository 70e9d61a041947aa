"""Tracks that repeat an older one end, and no others."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal
from support.held import P_D

from tsepm_ros import ConfirmedTrack, Scan, SensorModel, make_initiator
from tsepm_ros.tracker import merging
from tsepm_ros.tracker.hypotheses import Hypotheses, Start
from tsepm_ros.tracker.initial_state import NO_HIT
from tsepm_ros.tracker.tracks import TrackArrays


@pytest.mark.long
def test_a_target_that_is_started_again_and_again_is_held_once():
    initiator = make_initiator("tsepm", sensor=SensorModel(range_std=15.0, range_std_fraction=0.0))
    rng = np.random.default_rng(1)
    for scan in range(300):
        x, y = 3000.0 + 0.5 * scan, 2000.0
        seen = rng.random() < P_D
        polar = math.hypot(x, y), math.atan2(y, x)
        initiator.process(
            Scan(
                12.0 * scan,
                [polar[0] + 15.0 * rng.standard_normal()] * seen,
                [polar[1] + initiator.sensor.azimuth_std * rng.standard_normal()] * seen,
            )
        )
    assert initiator.totals.confirmed > 20
    assert 1 <= len(initiator.current) <= 3


def agrees(*offsets: float, plots: tuple[int, ...] | None = None) -> list[bool]:
    """Of tracks in a row with a deviation of 10 m and 1 m/s, the first the oldest."""
    state = np.zeros((len(offsets), 4))
    state[:, 0] = offsets
    covariance = np.stack([np.diag([100.0, 1.0, 100.0, 1.0])] * len(offsets))
    own = np.full(len(offsets), NO_HIT) if plots is None else np.array(plots)
    return merging.agrees_with_older(state, covariance, own).tolist()


def test_the_younger_of_two_tracks_agrees_within_the_gate():
    # d' (P_i + P_j)^-1 d = d^2 / 200 against 7.78: 39.4 m.
    assert agrees(0.0, 39.0) == [False, True]
    assert agrees(0.0, 40.0) == [False, False]
    assert agrees(5.0, 500.0, 0.0) == [False, False, True]
    assert agrees(0.0) == [False]


def test_tracks_with_plots_of_their_own_are_two_targets():
    assert agrees(0.0, 10.0, plots=(3, 4)) == [False, False]
    assert agrees(0.0, 10.0, plots=(3, 3)) == [False, True]
    assert agrees(0.0, 10.0, plots=(3, NO_HIT)) == [False, True]


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
    twice = starts.joined(starts)
    assert merging.own_starts(twice, two, frozenset()).tolist() == [9, -1]


def test_a_start_with_most_of_a_track_s_published_hits_is_that_track():
    starts = starts_at((0.0, 0.0))
    others = tuple((k, 9) for k in range(len(starts.hits[0]) - 1))
    most = replace(starts, hits=[(*starts.hits[0][:-1], (99, 0))], track_id=np.array([4]))
    few = replace(starts, hits=[(starts.hits[0][0], *others)], track_id=np.array([5]))
    assert merging.published_owners(starts, few.joined(most)).tolist() == [4]
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
    given = merging.given_starts(hypotheses, [start])
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
