"""What the page on the hand-over says of messages."""

from __future__ import annotations

import numpy as np
from handover_page import run_page

from msg_adapters import make_header, track_cloud, track_odometry, tracker_report
from tsepm_ros.tracked import usable

STAMP = 1_700_000_000_123_456_789


def test_what_is_tracked_goes_back_as_it_came(make_track, over_the_wire):
    page = run_page()
    new = track_cloud(make_header(STAMP, "odom"), [make_track(track_id=7), make_track(track_id=9)])
    followed = page["starts"](over_the_wire(new))
    report = tracker_report(over_the_wire(page["tracked"](STAMP, "odom", followed)))
    taken, dropped = usable(report.tracks)
    assert dropped == {}
    assert report.frame_id == "odom"
    assert taken.track_id.tolist() == [7, 9]
    for one in taken:
        np.testing.assert_array_equal(one.state, make_track().state)
        np.testing.assert_array_equal(one.covariance, make_track().covariance)


def test_an_empty_message_is_a_message(over_the_wire):
    page = run_page()
    report = tracker_report(over_the_wire(page["tracked"](STAMP, "odom", [])))
    assert len(report.tracks) == 0


def test_odometry_gives_the_same_state_and_loses_what_is_between(make_track, over_the_wire):
    track = make_track()
    message = over_the_wire(track_odometry(make_header(STAMP, "odom"), track))
    state, covariance = run_page()["filter_start"](message)
    np.testing.assert_array_equal(state, track.state)
    between = np.add.outer(np.arange(4), np.arange(4)) % 2 == 1
    assert (track.covariance[between] != 0.0).all()
    np.testing.assert_array_equal(covariance, np.where(between, 0.0, track.covariance))


def test_twice_the_blocks_are_safe(make_track, over_the_wire):
    track = make_track()
    message = over_the_wire(track_odometry(make_header(STAMP, "odom"), track))
    _, covariance = run_page()["filter_start"](message)
    assert np.linalg.eigvalsh(2.0 * covariance - track.covariance).min() > 0.0
    assert np.linalg.eigvalsh(covariance - track.covariance).min() < 0.0
