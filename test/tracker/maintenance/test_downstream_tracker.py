"""What a downstream tracker lists replaces what is held, as long as it is heard."""

from dataclasses import replace

import numpy as np
import pytest
from support.builders import detections
from support.held import MAX_SPEED, P_D, holding, ids, step, tracks

from tsepm_ros.tracker.maintenance.external_tracker import ExternalTracker
from tsepm_ros.tracker.maintenance.track_maintenance import (
    MIN_EXISTENCE,
    TRACKED_EXISTENCE,
    TrackMaintenance,
)
from tsepm_ros.tracker.merging import SAME_SCANS
from tsepm_ros.tracker.motion import PROCESS_NOISE


def follow_tracker(hold: TrackMaintenance, stamp: float, *listed: int) -> None:
    """The downstream tracker lists tracks where `tracks` has them after the time."""
    hold.follow(stamp, tracks(*listed, stamp=stamp, x=2000.0 + 5.0 * stamp))


def test_the_tracker_s_state_replaces_the_held_and_what_it_alone_has_joins(straight):
    hold = holding(1, 2)
    step(hold, 12.0)
    told = tracks(3, 1, stamp=14.0)
    told.state[:, 0] = 7000.0
    hold.follow(14.0, told)
    step(hold, 24.0)
    assert list(hold.ended) == []
    one, two, three = hold.current
    assert [one.track_id, two.track_id, three.track_id] == [1, 2, 3]
    np.testing.assert_allclose(one.state, [7050.0, 5.0, 1000.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(two.state, [2120.0, 5.0, 2000.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(three.state, [7050.0, 5.0, 3000.0, 0.0])
    np.testing.assert_allclose(one.covariance[1, 1], 4.0 + PROCESS_NOISE * 10.0)
    assert {track.stamp for track in hold.current} == {24.0}
    assert (one.age, one.hits) == (24.0, ((0, 0),)), "its figures go on"
    np.testing.assert_allclose(
        hold.held.existence, [TRACKED_EXISTENCE, 0.9, TRACKED_EXISTENCE], rtol=1e-8
    )


def test_a_track_that_the_tracker_has_not_listed_ends_when_it_had_time_to():
    hold = holding(1)
    for stamp in (10.0, 20.0, 30.0, 60.0):
        follow_tracker(hold, stamp, 7)
        step(hold, stamp + 2.0)
        assert ids(hold) == [1, 7]
    hold.add(tracks(2, stamp=62.0), 0.9)
    follow_tracker(hold, 70.1, 7)
    step(hold, 72.0)
    assert (list(hold.ended), ids(hold)) == ([1], [7, 2]), "heard since 10 s, and not of 1"


def test_the_time_to_list_a_track_counts_only_while_the_tracker_is_heard():
    hold = holding(1)
    step(hold, 500.0)
    for stamp in (500.0, 550.0, 1000.0, 1060.0):  # silent between
        follow_tracker(hold, stamp, 7)
        step(hold, stamp)
        assert 1 in ids(hold)
    follow_tracker(hold, 1060.1, 7)
    step(hold, 1061.0)
    assert list(hold.ended) == [1]


def test_what_is_tracked_is_not_ended_by_misses(straight):
    hold = holding(hold_time=30.0)
    follow_tracker(hold, 0.0, 1)
    for stamp in (12.0, 24.0, 36.0, 48.0, 60.0):
        step(hold, stamp, detectable=P_D)
    assert ids(hold) == [1], "missed five times, and over the hold time"
    assert hold.held.existence[0] < MIN_EXISTENCE
    step(hold, 60.1)
    assert (list(hold.ended), hold.tracker) == ([1], ExternalTracker.SILENT)


def test_what_is_tracked_is_not_ended_as_a_repetition(straight):
    hold = holding(1)
    same = replace(tracks(1), track_id=np.array([7]))
    for stamp in range(2 * SAME_SCANS):
        hold.follow(stamp, same.predicted(stamp))
        # Nobody's, but of a sensor with such errors that the tracks are located.
        nobodys = detections([[2000.0, 9000.0]], stamp + 0.5, variance=2500.0)
        step(hold, stamp + 0.5, nobodys)
    assert ids(hold) == [1, 7]
    step(hold, 100.0)
    assert (hold.tracker, ids(hold)) == (ExternalTracker.SILENT, [1])


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
    assert (list(hold.ended), ids(hold)) == ([1], [2])


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
        assert np.isfinite(hold.held.existence).all()
    assert len(ids(hold)) == 8


def test_the_speed_of_what_a_tracker_lists_is_its_own_until_it_is_silent():
    hold, fast = holding(1), tracks(1)
    fast.state[:, 1] = 30.0
    fast.covariance[:] = np.diag([5.0, 0.5, 5.0, 0.5]) ** 2
    for stamp in (0.0, 12.0):
        hold.follow(stamp, fast.predicted(stamp))
        step(hold, stamp + 6.0)
        assert hold.current.state[0, 1] == pytest.approx(30.0, abs=0.1)
    step(hold, 100.0)
    assert hold.tracker is ExternalTracker.SILENT
    assert 9.0 < np.hypot(*hold.current.state[0, 1::2]) <= MAX_SPEED
