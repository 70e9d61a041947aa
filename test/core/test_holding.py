"""Holding confirmed tracks for those who come late."""

from __future__ import annotations

import numpy as np

from tsepm_ros import ConfirmedTrack
from tsepm_ros.holding import TrackHold


def track(track_id: int, stamp: float) -> ConfirmedTrack:
    state = np.array([0.0, 1.0, 0.0, 0.0])
    return ConfirmedTrack(track_id, stamp, state, np.eye(4), ((0, 0),), 0.0)


def test_a_track_is_held_for_its_time_and_ends_at_the_first_scan_after():
    hold = TrackHold(30.0)
    assert hold.update(100.0, [track(1, 100.0)]) == []
    assert hold.update(130.0, []) == []
    assert [one.track_id for one in hold.current(130.0)] == [1]
    assert hold.update(130.1, []) == [1]
    assert len(hold.current(130.1)) == 0
    assert hold.update(140.0, []) == [], "a track ends once"


def test_tracks_are_carried_to_the_time_asked_for():
    hold = TrackHold(100.0)
    hold.update(10.0, [track(1, 10.0)])
    hold.update(20.0, [track(2, 20.0)])
    assert [one.state[0] for one in hold.current(25.0)] == [15.0, 5.0]
    assert [one.stamp for one in hold.current(25.0)] == [25.0, 25.0]
    assert [one.state[0] for one in hold.current(25.0)] == [15.0, 5.0], "from where it was"


def test_new_tracks_are_held_from_the_start():
    hold = TrackHold(0.0)
    hold.update(10.0, [track(1, 10.0), track(2, 10.0)])
    assert [one.track_id for one in hold.current(10.0)] == [1, 2]
    assert hold.update(11.0, []) == [1, 2]


def test_clearing_ends_every_track_and_names_it():
    hold = TrackHold(100.0)
    hold.update(10.0, [track(1, 10.0), track(5, 10.0)])
    assert hold.clear() == [1, 5]
    assert len(hold.current(11.0)) == 0
    assert hold.clear() == []


def test_a_changed_hold_time_counts_at_the_next_scan():
    hold = TrackHold(100.0)
    hold.update(0.0, [track(1, 0.0)])
    hold.hold_time = 5.0
    assert [one.track_id for one in hold.current(6.0)] == [1]
    assert hold.update(6.0, []) == [1]
