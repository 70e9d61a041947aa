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
"""Confirmed tracks as in plain loops, and which of them are published."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from support.batches import batches
from support.builders import FIXED_RANGE_ERROR, detections
from support.confirmed import CLUTTER, P_D, published, step, tracks
from support.held_scenes import ALWAYS, BATCH, ENDS, OPTIONS, SCENES, STATES, compare

from tsepm_ros.tracker import motion
from tsepm_ros.tracker.maintenance import track_maintenance
from tsepm_ros.tracker.maintenance.track_maintenance import TrackMaintenance
from tsepm_ros.tracker.options import CommonOptions
from tsepm_ros.tracker.tracks import TrackArrays, TrackStatus


@pytest.fixture(autouse=True)
def exact_speed_limit(monkeypatch):
    """Integrals over narrow densities at v_max are as exact as the plain ones, not to 1e-7 only."""
    nodes, weights = np.polynomial.legendre.leggauss(80)
    monkeypatch.setattr(motion, "NODES", nodes)
    monkeypatch.setattr(motion, "WEIGHTS", weights)


@pytest.mark.parametrize("first", batches(SCENES, ALWAYS, BATCH))
def test_equals_the_plain_version(first: int) -> None:
    counts = sum((compare(seed) for seed in range(first, first + BATCH)), Counter())
    assert {"tracks", "branched", "own", "outside", *ENDS[:2], *STATES} <= set(+counts)


def test_the_scenes_have_every_option_and_state_and_end_tracks_by_every_rule() -> None:
    counts = sum((compare(seed) for seed in range(ALWAYS)), Counter())
    assert {"empty", "parts", *ENDS, *STATES, *OPTIONS} <= set(+counts)
    by_hand = {"tracker", "duplicate", "cleared", "forgotten"}
    assert {*ENDS, *by_hand} == set(track_maintenance.ENDS)


def follow(hold: TrackMaintenance, path, stamps, rng) -> None:
    """Detections of a target on a path, without clutter."""
    for stamp in stamps:
        seen = np.asarray(path(stamp)) + rng.normal(0.0, 3.0, 2)
        found = detections(seen[None], stamp, 9.0)
        found["range_std"], found["azimuth_std"] = 3.0, 0.001
        hold.step(
            stamp,
            found,
            np.full(1, CLUTTER),
            lambda at: np.full(len(at), P_D),
            FIXED_RANGE_ERROR,
            10.0,
        )


def test_a_track_that_stops_becomes_a_fixed_echo_and_comes_back_under_its_id():
    rng = np.random.default_rng(4)
    hold = TrackMaintenance(CommonOptions(hold_time=1e6, min_speed=0.5))
    state = np.array([[2000.0, 5.0, 1000.0, 0.0]])
    covariance = np.diag([3.0, 0.3, 3.0, 0.3])[None] ** 2
    hold.add(replace(tracks(1), state=state, covariance=covariance), 0.99)
    follow(hold, lambda t: (2000.0 + 5.0 * min(t, 60.0), 1000.0), np.arange(1.0, 60.0), rng)
    assert hold.current.track_id.tolist() == [1]
    assert hold.current.stationary_probability[0] < 0.01
    follow(hold, lambda t: (2300.0, 1000.0), np.arange(61.0, 200.0), rng)
    assert len(hold.current) == 0
    (echo,) = hold.fixed_echoes
    assert (echo.track_id, echo.since, echo.stamp) == (1, 0.0, 199.0)
    np.testing.assert_allclose(echo.position, [2300.0, 1000.0], atol=3.0)
    assert echo.velocity.tolist() == [0.0, 0.0]
    follow(hold, lambda t: (2300.0 + 3.0 * (t - 200.0), 1000.0), np.arange(200.0, 240.0), rng)
    assert (hold.current.track_id.tolist(), len(hold.fixed_echoes)) == ([1], 0)
    assert len(hold.released) == 0, "it is no new track"


def test_a_track_that_coasts_keeps_its_id_and_states_its_growing_errors_until_it_ends():
    hold = TrackMaintenance(CommonOptions(hold_time=1e6, min_existence=0.0))
    hold.add(tracks(1), 0.9)
    seen = []
    while len(hold.confirmed):
        step(hold, 12.0 * len(seen) + 12.0, detectable=0.5)
        seen += list(hold.current)
    assert hold.ended == {1: "missed"}
    assert {track.track_id for track in seen} == {1}
    status = [track.status for track in seen]
    assert status == sorted(status) and set(status) == {TrackStatus.CONFIRMED, TrackStatus.COASTING}
    assert [track.existence_probability >= 0.5 for track in seen] == [not one for one in status]
    sigma = [np.linalg.eigvalsh(track.position_covariance)[-1] ** 0.5 for track in seen]
    stamps = 12.0 * np.arange(1, len(seen) + 1)
    assert np.all(sigma >= np.hypot(50.0, 2.0 * stamps)), "what the error of its velocity adds"
    assert [track.age for track in seen] == stamps.tolist()


LONG = CommonOptions(hold_time=1e6)

SLOW = replace(LONG, min_speed=8.0)


def holding(*track_ids: int, options: CommonOptions = SLOW) -> TrackMaintenance:
    hold = TrackMaintenance(options)
    hold.add(tracks(*track_ids), 0.9)
    return hold


def echoes(hold: TrackMaintenance) -> list[int]:
    return [echo.track_id for echo in hold.fixed_echoes]


def test_the_end_of_what_was_never_published_is_not_told():
    hold = holding(1, 2, options=replace(SLOW, hold_time=30.0))
    for scan in range(1, 90):
        step(hold, 12.0 * scan, detectable=P_D)
        assert hold.ended == {}
    assert len(hold.confirmed) == 0
    hold = holding(1)
    hold.clear()
    step(hold, 1.0)
    assert hold.ended == {}


def test_min_speed_does_not_take_back_what_was_published():
    hold = holding(1, options=LONG)
    hold.options = SLOW
    step(hold, 12.0)
    assert (published(hold), echoes(hold)) == ([1], [])
    assert hold.current.stationary_probability[0] > 0.5


def test_a_downstream_tracker_does_not_decline_what_it_never_heard_of():
    hold = holding(1)
    for stamp in np.arange(10.0, 160.0, 10.0):
        step(hold, stamp, detections([[2000.0 + 5.0 * stamp, 1000.0]], stamp, 400.0), P_D)
        if stamp in (10.0, 80.0, 150.0):
            hold.follow(stamp, TrackArrays.from_tracks([]))
    assert len(hold.confirmed) == 1
    # Its time begins when the track is published.
    hold.options = LONG
    step(hold, 160.0, detections([[2800.0, 1000.0]], 160.0, 400.0), P_D)
    assert published(hold) == [1]
    hold.follow(200.0, TrackArrays.from_tracks([]))
    assert published(hold) == [1]
    hold.follow(230.0, TrackArrays.from_tracks([]))
    assert published(hold) == []


def test_a_fixed_echo_outside_the_coverage_is_remembered_as_it_is_and_never_published():
    hold = holding(1)
    for stamp in range(12, 61, 12):
        step(hold, stamp, detections([[2000.0, 1000.0]], stamp, 400.0), P_D)
    before = hold.fixed_echoes
    for stamp in range(72, 6000, 12):
        step(hold, stamp, detectable=0.0)
    after = hold.fixed_echoes
    assert after.track_id.tolist() == [1]
    np.testing.assert_allclose(after.state, before.state, rtol=1e-9)
    np.testing.assert_allclose(after.covariance, before.covariance, rtol=1e-6)
    hold.options = LONG
    step(hold, 6012.0, detectable=0.0)
    assert len(hold.released) == len(hold.current) == len(hold.confirmed) == 0


def test_an_existence_that_is_not_known_leaves_the_others_their_probability_to_stand_still():
    fits = holding(1, 2, 3).confirmed.fits
    alone = fits[np.array([0, 1])].stationary_probability(SLOW, np.array([0.9, 0.8]))
    found = fits.stationary_probability(SLOW, np.array([0.9, 0.8, np.nan]))
    np.testing.assert_allclose(found[:2], alone)


def test_what_is_held_back_claims_its_detections_as_every_confirmed_track_does():
    back, shown = holding(1), holding(1, options=LONG)
    assert (published(back), published(shown)) == ([], [1])
    scan = detections([[2060.0, 1000.0], [2000.0, 9000.0]], 12.0)
    np.testing.assert_array_equal(step(back, 12.0, scan, P_D), step(shown, 12.0, scan, P_D))
    for one, other in zip(back.probable_detections, shown.probable_detections, strict=True):
        assert (
            one.tolist() == other.tolist() == ([1] if one is back.probable_detections[0] else [0])
        )
    assert (published(back), echoes(back)) == ([], [1])


def test_what_exists_hardly_is_neither_published_nor_a_fixed_echo():
    hold = TrackMaintenance(SLOW)
    hold.add(tracks(1), 0.3)
    assert echoes(hold) == []
    hold.options = LONG
    step(hold, 1.0)
    assert (published(hold), len(hold.confirmed)) == ([], 1)


def test_what_a_downstream_tracker_lists_is_published():
    hold = holding(1)
    hold.follow(5.0, tracks(1, 7, stamp=5.0))
    assert published(hold) == [1, 7]
    step(hold, 6.0)
    assert len(hold.released) == 0
