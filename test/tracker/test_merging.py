# Copyright 2026 tsepm_ros developers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.
"""Merging: which tracks are one target's, against a look at every pair."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from tsepm_ros import ConfirmedTrack
from tsepm_ros.numerics.arrays import replaced
from tsepm_ros.tracker import merging
from tsepm_ros.tracker.measurement import HIT_KEYS
from tsepm_ros.tracker.tracks import TrackArrays, TrackStatus


def agrees(*offsets: float, size: float = 0.0) -> list[bool]:
    """Of tracks in a row with a deviation of 10 m and 1 m/s, the first the oldest."""
    spread = np.diag([100.0, 1.0, 100.0, 1.0])
    made = [
        ConfirmedTrack(place, 7.0, np.array([x, 0.0, 0.0, 0.0]), spread, (), 0.0, age=60.0)
        for place, x in enumerate(offsets)
    ]
    return merging.on_older_extent(TrackArrays.from_tracks(made), np.full(len(made), size)).tolist()


def test_the_younger_of_two_tracks_agrees_within_the_gate():
    # d' (P_i + P_j)^-1 d = d^2 / 200 against 7.78: 39.4 m.
    assert agrees(0.0, 39.0) == [False, True]
    assert agrees(0.0, 40.0) == [False, False]
    assert agrees(5.0, 500.0, 0.0) == [False, False, True]
    assert agrees(0.0) == [False]


def test_within_the_extent_of_an_older_track_s_target_a_track_is_that_target_s():
    # d^2 / (200 + 2 size^2 / 12) against 7.78: 60.3 m for 40 m.
    assert agrees(0.0, 60.0, size=40.0) == [False, True]
    assert agrees(0.0, 61.0, size=40.0) == [False, False]


def starts_at(*rows: tuple[float, float], missed: float = 0.0) -> TrackArrays:
    """Starts at positions, at rest, with errors of 2 m and 1 m/s; tracks after a time missed."""
    covariance = np.diag([4.0, 1.0, 4.0, 1.0])
    return TrackArrays.from_tracks(
        [
            ConfirmedTrack(
                place,
                7.0,
                np.array([x, 0.0, y, 0.0]),
                covariance,
                ((5, 0), (6, 0), (7, 0)),
                0.0,
                time_since_hit=missed,
            )
            for place, (x, y) in enumerate(rows)
        ]
    )


def continued(starts, lost, existence, hits, births) -> list[int]:
    """Of starts by their hits, with hits of tracks by (scan, row); no speed but that of errors."""
    paths = [np.array([HIT_KEYS * scan + row for scan, row in one]) for one in starts.hits]
    keys = np.array([HIT_KEYS * scan + row for scan, row in hits], np.int64)
    owners, places = np.array(list(hits.values()), np.int64), lost.state[:, 0::2]
    found = merging.continued(starts, paths, lost, existence, places, (keys, owners), 1e-3, births)
    return found.tolist()


def two_lost(missed: float) -> TrackArrays:
    return starts_at((0.0, 0.0), (50.0, 0.0), missed=missed).numbered(np.array([4, 6]))


def test_a_track_that_has_another_detection_since_the_start_began_is_not_lost():
    starts, existence, lost = starts_at((1.0, 0.0), (0.0, 0.0)), np.array([0.9, 0.9]), two_lost(2.0)
    assert continued(starts, lost, existence, {(4, 3): 4}, 1e-9) == [4, -1], "each once"
    assert continued(starts, lost, existence, {(7, 3): 4}, 1e-9) == [-1, -1]
    assert continued(starts, lost, existence, {(7, 0): 4}, 1e-9) == [4, -1], "its own hit"
    assert continued(starts, lost, existence, {(7, 3): 6}, 1e-9) == [4, -1], "another track's"


def test_a_track_that_was_detected_in_this_scan_goes_on_only_by_a_start_of_its_hits():
    starts, existence, hit = starts_at((1.0, 0.0)), np.array([0.9, 0.9]), two_lost(0.0)
    assert continued(starts, hit, existence, {}, 1e-9) == [-1]
    assert continued(starts, hit, existence, {(4, 3): 4}, 1e-9) == [-1], "long ago"
    assert continued(starts, hit, existence, {(7, 0): 6}, 1e-9) == [-1], "another track's"
    assert continued(starts, hit, existence, {(6, 0): 4}, 1e-9) == [4]
    assert continued(starts, hit, existence, {(5, 0): 4, (7, 3): 4}, 1e-9) == [-1], "and others"
    fixed = replaced(hit, stationary_probability=np.ones(2))
    assert continued(starts, fixed, existence, {(6, 0): 4}, 1e-9) == [4], "it surely stands"


@pytest.mark.parametrize(("others", "goes_on", "may"), [(1, True, True), (2, False, False)])
def test_of_a_start_by_four_hits_one_may_be_beside_another_of_the_track(others, goes_on, may):
    """A track with few other hits since the start began goes on; half of them are many."""
    starts, paths, lost = starts_at((0.0, 0.0)), [HIT_KEYS * np.arange(4, 8)], two_lost(2.0)
    hits = HIT_KEYS * np.arange(5, 5 + others) + 3, np.full(others, 4)
    lost, places = lost[np.array([0])], np.zeros((1, 2))
    found = merging.continued(starts, paths, lost, np.array([0.9]), places, hits, 1e-3, 1e-9)
    assert found.tolist() == [4 if goes_on else -1]
    assert merging.may_have_track(starts, paths, lost, hits, 1.0).tolist() == [may]


@pytest.mark.parametrize(("metres", "found"), [(29.0, [4]), (31.0, [-1])])
def test_a_lost_track_may_be_anywhere_in_reach(metres, found):
    """10 m/s for 3 s, from where it was last detected, however well its place seems known."""
    starts, lost = starts_at((metres, 0.0)), two_lost(3.0)[np.array([0])]
    arguments = starts, [np.arange(3)], lost, np.array([0.9]), lost.state[:, 0::2]
    none = np.zeros(0, np.int64), np.zeros(0, np.int64)
    density = 1.0 / (np.pi * 30.0**2 * np.pi * 10.0**2)
    assert merging.continued(*arguments, none, 10.0, 0.89 * density).tolist() == found
    assert merging.continued(*arguments, none, 10.0, 0.91 * density).tolist() == [-1]


@pytest.mark.parametrize(("still", "found"), [(np.nan, [4]), (0.4, [4]), (0.6, [-1])])
def test_what_stands_still_is_not_anywhere_in_reach(still, found):
    starts, lost = starts_at((20.0, 0.0)), two_lost(3.0)[np.array([0])]
    lost = replaced(lost, stationary_probability=np.array([still]))
    none = np.zeros(0, np.int64), np.zeros(0, np.int64)
    births = 0.45 / (np.pi * 30.0**2 * np.pi * 10.0**2)  # 0.9 (1 - 0.5)
    arguments = starts, [np.arange(3)], lost, np.array([0.9]), lost.state[:, 0::2], none
    assert merging.continued(*arguments, 10.0, births).tolist() == found


def test_continuations_are_those_of_all_pairs():
    rng = np.random.default_rng(4)
    places = rng.uniform(-300.0, 300.0, (40, 2))
    lost = starts_at(*map(tuple, places), missed=2.0).numbered(np.arange(40))
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
    assert continued(starts, lost, existence, {}, births) == expected


@pytest.mark.parametrize(
    ("hits", "found"),
    [
        ({}, True),
        ({(6, 3): 4}, True),
        ({(5, 3): 4, (6, 3): 4}, False),
        ({(5, 0): 4, (6, 0): 4}, True),
        ({(5, 3): 6, (6, 3): 6}, True),
        ({(4, 3): 4, (8, 3): 4}, True),
    ],
    ids=["none", "one", "most", "its own", "another track's", "other scans"],
)
def test_a_start_may_be_of_a_track_without_hits_in_most_of_its_scans(hits, found):
    starts, paths = starts_at((1.0, 0.0)), [HIT_KEYS * np.array([5, 6, 7])]
    keys = np.array([HIT_KEYS * scan + row for scan, row in hits], np.int64)
    owned, track = (keys, np.array(list(hits.values()), np.int64)), two_lost(0.0)[np.array([0])]
    assert merging.may_have_track(starts, paths, track, owned, 1.0).tolist() == [found]


@pytest.mark.parametrize(
    ("metres", "factor", "found"), [(10.0, 1, 1), (12.0, 1, 0), (14.0, 2, 1), (15.0, 2, 0)]
)
def test_beside_a_track_a_start_is_within_the_errors_of_both(metres, factor, found):
    # 13.8 (4 + 4): 10.5 m, and 14.9 m at twice the variances.
    starts, none = starts_at((metres, 0.0)), (np.zeros(0, np.int64), np.zeros(0, np.int64))
    track = two_lost(0.0)[np.array([0])]
    assert merging.may_have_track(starts, [np.arange(3)], track, none, factor).tolist() == [found]
    near = merging.same_place(starts.state[0], factor * starts.covariance[0], track)
    assert factor > 1 or near.tolist() == [found]


def held_at(x: float, status: TrackStatus, evaluation: float = 0.0) -> TrackArrays:
    """A track with a deviation of 10 m and 1 m/s, 60 s old."""
    state, spread = np.array([x, 0.0, 0.0, 0.0]), np.diag([100.0, 1.0, 100.0, 1.0])
    made = ConfirmedTrack(0, 7.0, state, spread, (), evaluation, age=60.0, status=status)
    return TrackArrays.from_tracks([made])


def forty(positions: np.ndarray) -> np.ndarray:
    return np.full(len(positions), 40.0)


@pytest.mark.parametrize(
    ("metres", "margin", "status", "found"),
    [
        (59.0, 7.0, TrackStatus.CONFIRMED, True),
        (62.0, 7.0, TrackStatus.CONFIRMED, False),
        (62.0, 6.8, TrackStatus.CONFIRMED, True),
        (75.0, 6.8, TrackStatus.CONFIRMED, True),
        (76.0, 6.8, TrackStatus.CONFIRMED, False),
        (1.0, 6.8, TrackStatus.STANDS_STILL, False),
    ],
)
def test_a_start_without_the_margin_of_a_second_target_is_farther_on_an_older_one(
    metres, margin, status, found
):
    # d^2 / (200 + 2 size^2 / 12) against 7.78, with three times the size of the start squared.
    start = held_at(metres, TrackStatus.CONFIRMED, margin)
    older = merging.of_older_targets(held_at(0.0, status), start, forty)
    assert older.tolist() == [False, found]


@pytest.mark.parametrize("x", [1.0, 1000.0])
@pytest.mark.parametrize(
    ("status", "found"), [(TrackStatus.COASTING, False), (TrackStatus.CONFIRMED, True)]
)
def test_a_track_that_coasts_keeps_no_start_from_any_place(status, found, x):
    # Its deviation of 1 km has any of these places on its extent.
    lost = held_at(0.0, status)
    lost.covariance[:] *= 1e4
    older = merging.of_older_targets(lost, held_at(x, TrackStatus.CONFIRMED), forty)
    assert older.tolist() == [False, found]


@pytest.mark.parametrize("status", [TrackStatus.COASTING, TrackStatus.STANDS_STILL])
def test_a_track_that_coasts_or_stands_ends_no_other(status):
    tracks = TrackArrays.joined(held_at(0.0, status), held_at(1.0, TrackStatus.CONFIRMED))
    none = tracks[np.zeros(0, np.int64)]
    assert merging.of_older_targets(tracks, none, forty).tolist() == [False, False]
    tracks = TrackArrays.joined(*[held_at(x, TrackStatus.CONFIRMED) for x in (0.0, 1.0)])
    assert merging.of_older_targets(tracks, none, forty).tolist() == [False, True]


@pytest.mark.parametrize(("age", "found"), [(2.0, True), (60.0, False)])
def test_the_velocity_of_a_young_track_is_as_uncertain_as_a_walk_over_its_extent(age, found):
    # 5 m/s: 25 / (2 + 2 (40 / age)^2 / 12) against 7.78.
    tracks = TrackArrays.joined(*[held_at(0.0, TrackStatus.CONFIRMED) for _ in range(2)])
    tracks.state[1, 1] = 5.0
    tracks = replaced(tracks, age=np.full(2, age))
    assert merging.on_older_extent(tracks, np.full(2, 40.0)).tolist() == [False, found]
