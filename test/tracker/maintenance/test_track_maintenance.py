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
"""Confirmed tracks are carried and updated; each end has its reason; found again they keep ids."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal
from support.builders import FIXED_RANGE_ERROR, detections
from support.confirmed import MAX_SPEED, NOTHING, P_D, UNSEEN, holding, ids, published, step, tracks

from tsepm_ros import ConfirmedTrack, SensorModel
from tsepm_ros.tracker import motion
from tsepm_ros.tracker.evaluation import FADED_AT_START, FADED_FACTOR, SCANS_FADED, SCANS_SEEN
from tsepm_ros.tracker.maintenance import track_maintenance
from tsepm_ros.tracker.maintenance.confirmed_tracks import (
    NEW_EXISTENCE_BY_SCANS,
    SCANS_TO_VANISH,
    ConfirmedTracks,
)
from tsepm_ros.tracker.maintenance.track_maintenance import (
    ExternalTracker,
    TrackMaintenance,
    best_confirmed,
)
from tsepm_ros.tracker.measurement import HIT_KEYS
from tsepm_ros.tracker.options import GATE_PROBABILITY, CommonOptions
from tsepm_ros.tracker.tracks import MIN_EXISTENCE, TrackArrays, TrackStatus


@pytest.mark.parametrize(("interval", "scans"), [(0.125, 400), (12.0, 50)])
def test_without_a_hold_time_the_longest_coast_is_fifty_scans_or_seconds(interval, scans):
    hold = TrackMaintenance()
    hold.add(tracks(1), 0.9)
    for scan in range(1, scans + 2):
        hold.step(
            interval * scan,
            NOTHING,
            np.zeros(0),
            lambda positions: np.full(len(positions), UNSEEN),
            FIXED_RANGE_ERROR,
            MAX_SPEED,
            interval,
        )
        assert hold.ended == ({} if scan <= scans else {1: "not_detected"})


@pytest.mark.parametrize(("hold_time", "held"), [(0.0, [1]), (50.0, [])])
def test_a_track_outlives_a_longer_interval_in_which_no_scan_missed_it(hold_time, held):
    """The usual interval is still that of the scans before."""
    hold = holding(1, hold_time=hold_time)
    step(hold, 0.0, detections([[2000.0, 1000.0]], 0.0, 30.0**2), detectable=P_D, interval=0.5)
    step(hold, 60.0, interval=0.5)
    assert ids(hold) == held
    step(hold, 120.0, interval=0.5)
    assert (ids(hold), hold.ended) == ([], {1: "not_detected"} if held else {})


@pytest.mark.parametrize("interval", [0.1, 12.0])
def test_a_target_may_fade_and_is_given_up_after_the_same_scans_at_any_rate(monkeypatch, interval):
    # A target is seen, faded or gone: a hidden Markov chain, followed in plain matrices.
    monkeypatch.setattr(motion, "SCANS_TO_TURN", math.inf)
    fade, appear, vanish = 1.0 / SCANS_SEEN, 1.0 / SCANS_FADED, 1.0 / SCANS_TO_VANISH
    fading = np.array([[1.0 - fade, fade, 0.0], [appear, 1.0 - appear, 0.0], [0.0, 0.0, 1.0]])
    leaving = np.array([[1.0 - vanish, 0.0, vanish], [0.0, 1.0 - vanish, vanish], [0.0, 0.0, 1.0]])
    hold, seen = holding(1), 1.0 - FADED_AT_START
    hold.options = replace(hold.options, min_existence=0.0)
    chain, missed = np.array([0.9 * seen, 0.9 * FADED_AT_START, 0.1]), 1.0 - P_D * GATE_PROBABILITY
    for scan in itertools.count(1):
        step(hold, interval * scan, detectable=P_D)
        faded = 1.0 - FADED_FACTOR * P_D * GATE_PROBABILITY
        chain = chain @ fading @ leaving * [missed, faded, 1.0]
        chain /= chain.sum()
        if chain[:2].sum() < MIN_EXISTENCE:
            break
        np.testing.assert_allclose(hold.confirmed.existence, [chain[:2].sum()], rtol=1e-9)
        faded_share = chain[1] / chain[:2].sum()
        np.testing.assert_allclose(hold.confirmed.branches.faded[0, 0], faded_share, rtol=1e-9)
    assert hold.ended == {1: "missed"}
    assert 30 < scan < 120, "independent misses would end it after 6"


@pytest.mark.parametrize("interval", [0.1, 12.0])
def test_a_lost_track_is_held_silently_and_comes_back_under_its_id(interval):
    hold, published, ended = holding(1), [], {}
    for scan in range(1, 16):
        step(hold, interval * scan, detectable=P_D)
        published += hold.current.existence_probability.tolist()
        ended |= {scan: dict(hold.ended)} if hold.ended else {}
    assert min(published) >= 0.3 > hold.confirmed.existence[0]
    assert ended == {len(published) + 1: {1: "missed"}}
    for scan in range(16, 24):
        at = hold.confirmed.tracks.state[:, 0::2]
        assert not len(hold.released)
        step(hold, interval * scan, detections(at, interval * scan, 900.0), P_D)
        if len(hold.current):
            break
    assert hold.released.track_id.tolist() == hold.current.track_id.tolist() == [1]
    assert hold.released.revision.tolist() == [1] and hold.ended == {}


def test_a_track_outside_a_coverage_that_was_looked_at_whole_is_no_longer_published():
    for whole, left in ((True, {1: "left"}), (False, {})):
        hold = holding(1)
        step(hold, 1.0, detections(hold.confirmed.tracks.state[:, 0::2], 1.0, 9.0), P_D)
        assert ids(hold) == [1] and hold.ended == {}
        step(hold, 2.0, detectable=0.0, whole=whole)
        assert (hold.ended, len(hold.current)) == (left, not left)
        assert len(hold.confirmed) == 1
        hold.end(np.zeros(1, bool), "duplicate")
        assert hold.ended == (left or {1: "duplicate"}), "an end is told once"


def test_without_a_least_existence_every_track_that_is_held_is_published():
    hold = holding(1)
    hold.options = replace(hold.options, min_existence=0.0)
    for scan in range(1, 20):
        step(hold, 1.0 * scan, detectable=0.0)
        assert (len(hold.current), hold.ended) == (1, {})


def test_clearing_ends_tracks_with_the_reason_and_once():
    hold = holding(1)
    hold.clear()
    step(hold, 1.0)
    assert (hold.ended, ids(hold)) == ({1: "cleared"}, [])
    step(hold, 2.0)
    assert hold.ended == {}


def test_of_fixed_echoes_outside_the_coverage_the_last_are_remembered(monkeypatch):
    monkeypatch.setattr(track_maintenance, "MAX_REMEMBERED_PLACES", 2)
    hold = TrackMaintenance()
    hold.add(tracks(1, 2, 3, 4), 0.9)  # published, before anything stands still
    hold.options = CommonOptions(min_speed=8.0)
    for scan in range(1, 6):
        seen = [[2000.0, 1000.0 * row] for row in (1, 2, 3, 4)]
        step(hold, 12.0 * scan, detections(seen, 12.0 * scan, 400.0), P_D)
    assert [echo.track_id for echo in hold.fixed_echoes] == [1, 2, 3, 4]
    step(hold, 72.0, detectable=0.0)
    assert hold.ended == {1: "forgotten", 2: "forgotten"}
    assert [echo.track_id for echo in hold.fixed_echoes] == [3, 4]


def start(hold: TrackMaintenance, aside: float, *hits: tuple[int, int]) -> TrackArrays:
    """A start beside the first confirmed track, m, with these hits."""
    state = hold.confirmed.tracks.state[:1] + np.array([0.0, 0.0, aside, 0.0])
    new = tracks(90, stamp=hold.confirmed.tracks.stamp[0])
    return replace(new, state=state, hits=np.fromiter([hits], object))


def continued(hold: TrackMaintenance, new: TrackArrays, area: float) -> list[int]:
    paths = [np.array([HIT_KEYS * scan + row for scan, row in hits]) for hits in new.hits]
    return hold.continued(new, paths, area).tolist()


def silent(min_speed: float = 0.0) -> TrackMaintenance:
    """A track that was detected in scans 1 to 3, and missed in 4 to 8."""
    hold = TrackMaintenance(CommonOptions(hold_time=1e6, min_speed=min_speed))
    hold.add(tracks(1), 0.99)
    for scan in range(1, 9):
        seen = detections(
            np.array([[2000.0 + 60.0 * scan, 1000.0]])[: int(scan <= 3)], 12.0 * scan, 400.0
        )
        seen["scan"] = scan
        step(hold, 12.0 * scan, seen, P_D)
    return hold


@pytest.mark.parametrize(("larger", "found"), [(1.01, 1), (0.99, -1)])
def test_a_lost_track_is_continued_while_its_density_is_above_that_of_births(larger, found):
    hold = silent()
    new = start(hold, 90.0, (6, 1), (7, 1), (8, 1))
    covariance = hold.confirmed.tracks.covariance[0] + new.covariance[0]
    density = hold.confirmed.existence[0] * multivariate_normal([0, 0, 90.0, 0], covariance).pdf(
        0.0
    )
    # Targets are born as often as the two expected here vanish, for the length of fading.
    born = 2.0 * SCANS_FADED / SCANS_TO_VANISH
    area = born / (density * math.pi * 10.0**2)
    assert continued(hold, new, larger * area) == [found]


def test_fixed_echoes_and_what_a_downstream_tracker_lists_are_not_continued():
    hold = silent()
    assert continued(hold, start(hold, 0.0, (2, 0), (3, 0), (8, 1)), 1e8) == [1]
    hold.follow(96.0, hold.confirmed.tracks)
    assert continued(hold, start(hold, 0.0, (2, 0), (3, 0), (8, 1)), 1e8) == [-1]
    hold = silent(8.0)
    assert hold.confirmed.status.tolist() == [TrackStatus.STANDS_STILL]
    assert continued(hold, start(hold, 0.0, (2, 0), (3, 0), (8, 1)), 1e8) == [-1]


def test_a_track_that_is_found_again_is_published_at_once_as_its_next_revision():
    hold = silent()
    assert hold.confirmed.status.tolist() == [TrackStatus.COASTING]
    again = start(hold, 30.0, (6, 1), (7, 1), (8, 1)).numbered(np.array([1]))
    again = replace(again, age=np.array([24.0]), scan_count=np.array([3]))
    hold.confirmed = replace(hold.confirmed, proven=np.array([1e-4]))
    found = hold.find_again(again, np.array([0.95]), [])
    assert published(hold) == [1] == found.track_id.tolist()
    assert hold.confirmed.existence[0] == 0.95
    assert hold.confirmed.branches.faded[0, 0] == FADED_AT_START
    assert (hold.confirmed.last_detected[0], hold.confirmed.covered_scans[0, 0]) == (96.0, 0.0)
    np.testing.assert_array_equal(hold.confirmed.tracks.state, again.state)
    assert found.revision.tolist() == [1]
    assert (found.existence_probability[0], found.time_since_hit[0]) == (0.95, 0.0)
    assert hold.confirmed.hit_sigma[0, 0] == pytest.approx(50.0), (
        "the start's, not the lost track's"
    )
    assert hold.confirmed.proven[0] >= NEW_EXISTENCE_BY_SCANS
    assert found.age[0] == 96.0, "since its first hit of all"
    assert found.hits.tolist() == [((6, 1), (7, 1), (8, 1))], "those by which the start is judged"
    assert hold.ended == {}


@pytest.mark.parametrize(
    ("probability", "announced", "still"),
    [(0.49, False, False), (0.51, False, True), (0.89, True, False), (0.91, True, True)],
)
def test_a_start_is_published_unless_it_more_probably_stands_still_and_fixed_only_when_sure(
    probability, announced, still
):
    one = replace(tracks(1), stationary_probability=np.array([probability]))
    confirmed = replace(ConfirmedTracks.from_tracks(one, 0.9), announced=np.array([announced]))
    assert confirmed.stands_still(CommonOptions(min_speed=0.5)).tolist() == [still]
    assert confirmed.stands_still(CommonOptions()).tolist() == [False]
    expected = TrackStatus.STANDS_STILL if still else TrackStatus.CONFIRMED
    assert confirmed.statuses(CommonOptions(min_speed=0.5), 400.0).tolist() == [expected]


def follow_tracker(hold: TrackMaintenance, stamp: float, *listed: int) -> None:
    """The downstream tracker lists tracks where `tracks` has them after the time."""
    hold.follow(stamp, tracks(*listed, stamp=stamp, x=2000.0 + 5.0 * stamp))


def test_a_tracker_that_comes_back_empty_gets_time_to_list_what_is_held():
    hold = holding()
    follow_tracker(hold, 0.0, 1, 2)
    step(hold, 100.0)
    follow_tracker(hold, 100.0)
    step(hold, 112.0)
    assert (hold.tracker, ids(hold)) == (ExternalTracker.ALIVE, [1, 2])
    follow_tracker(hold, 112.0, 2)
    follow_tracker(hold, 160.1, 2)
    step(hold, 161.0)
    assert (hold.ended, ids(hold)) == ({1: "tracker"}, [2])


def test_what_a_tracker_lists_exists_as_it_says_and_ends_by_no_rule_while_it_is_heard():
    hold, ended = holding(1, 2), {}
    follow_tracker(hold, 0.0, 1)
    assert (hold.confirmed.existence[0], hold.confirmed.proven[0]) == (0.99, 0.99)
    for stamp in range(1, 120):
        step(hold, 0.5 * stamp, detectable=P_D)
        ended |= hold.ended
    assert (ended, published(hold)) == ({2: "missed"}, [1])
    assert hold.confirmed.existence[0] < MIN_EXISTENCE
    step(hold, 61.0, detectable=P_D)
    assert ids(hold) == [1], "it may still answer the scan before"
    step(hold, 62.0, detectable=P_D)
    assert (hold.ended, ids(hold)) == ({1: "missed"}, [])


def test_a_tracker_that_reports_while_the_sonar_pauses_is_not_silent():
    hold = holding(1)
    for stamp in (0.0, 70.0, 140.0):  # each scan comes 70 s after the last one
        follow_tracker(hold, stamp - 0.2, 1)
        step(hold, stamp)
        assert (hold.tracker, ids(hold)) == (ExternalTracker.ALIVE, [1])


def test_a_report_is_no_detection():
    hold = holding(1)
    for stamp in (0.0, 10.0):
        follow_tracker(hold, stamp, 1)
    step(hold, 12.0, detectable=P_D)
    assert hold.current.time_since_hit.tolist() == [12.0]


def test_clearing_forgets_the_tracker():
    hold = holding()
    follow_tracker(hold, 0.0, 1)
    hold.clear()
    step(hold, 1.0)
    assert (list(hold.ended), hold.tracker) == ([1], ExternalTracker.NONE)
    step(hold, 100.0)
    assert hold.tracker is ExternalTracker.NONE, "it cannot fall silent"
    hold.add(tracks(2, stamp=100.0), 0.9)
    follow_tracker(hold, 101.0)
    step(hold, 112.0)
    assert ids(hold) == [2]


def test_tracked_targets_known_as_exactly_as_is_taken_do_no_harm():
    hold, rng = holding(), np.random.default_rng(4)
    axis = np.array([[1.0, 1.0 - 1e-11], [1.0 - 1e-11, 1.0]])
    for scan in range(200):
        told = tracks(*range(8), stamp=12.0 * scan)
        told.covariance[:] = np.kron(np.eye(2), axis) * 10.0 ** rng.uniform(-12, 18, (8, 1, 1))
        hold.follow(12.0 * scan + rng.uniform(-20, 20), told)
        found = detections(told.state[:, 0::2] + rng.standard_normal((8, 2)), 12.0 * scan, 1e-12)
        assert np.isfinite(step(hold, 12.0 * scan + 1e-3, found, P_D)).all()
        assert np.isfinite(hold.current.covariance).all()
        assert np.isfinite(hold.confirmed.existence).all()
    assert len(ids(hold)) == 8


def test_the_speed_of_what_a_tracker_lists_is_its_own_until_it_is_silent():
    hold, fast = holding(1), tracks(1)
    fast.state[:, 1] = 30.0
    fast.covariance[:] = np.diag([5.0, 0.5, 5.0, 0.5]) ** 2
    for stamp in (0.0, 12.0):
        hold.follow(stamp, fast.predicted(stamp))
        step(hold, stamp + 6.0, interval=12.0)
        assert hold.current.state[0, 1] == pytest.approx(30.0, abs=0.1)
    for stamp in (100.0, 112.0):
        step(hold, stamp, interval=12.0)
    assert hold.tracker is ExternalTracker.SILENT
    assert 9.0 < np.hypot(*hold.current.state[0, 1::2]) <= MAX_SPEED


def test_the_new_tracks_kept_are_the_most_probable_and_then_the_best():
    existence = np.array([0.5, 0.9, 0.9, 0.9])
    assert best_confirmed(existence, np.array([0.0, 3.0, 1.0, 2.0]), 2).tolist() == [2, 3]


def test_of_targets_that_move_the_detections_are_told():
    hold = TrackMaintenance(CommonOptions())
    moving = ConfirmedTrack(3, 0.0, np.array([0.0, 8.0, 3e3, 0.0]), 4.0 * np.eye(4), (), 0.0)
    still = ConfirmedTrack(5, 0.0, np.array([3e3, 0.0, 0.0, 0.0]), 4.0 * np.eye(4), (), 0.0)
    hold.add(TrackArrays.from_tracks([moving, still]), 0.99)
    found = detections([[3e3, 0.0], [80.0, 3e3], [5e3, 5e3]], 10.0, 25.0)
    found["range_std"], found["azimuth_std"] = 5.0, 0.002
    probability = hold.step(
        10.0, found, np.full(3, 1e-7), lambda at: np.full(len(at), 0.9), SensorModel(), 10.0
    )
    assert sorted(zip(*hold.probable_detections, strict=True)) == [(3, 1), (5, 0)]
    assert sorted(zip(*hold.own_detections, strict=True)) == [(3, 1), (5, 0)]
    assert hold.detections_of(hold.confirmed.fits.moves).tolist() == [1]
    assert (probability[:2] > 0.999).all()
    assert probability[2] == 0.0
    assert (hold.confirmed.existence > 0.99).all()
    assert hold.confirmed.hit_sigma.tolist() == [[5.0], [5.0]]
