"""A session from arriving scans to results and counts."""

from __future__ import annotations

from collections import Counter

import pytest
from support.builders import FIXED_RANGE_ERROR, assert_same_tracks
from support.sessions import (
    BOX,
    arrived,
    moving,
    ping,
    play,
    play_empty,
    sail,
    session,
    simulated,
)

from tsepm_ros import make_initiator
from tsepm_ros.session.scan_queue import Arrival
from tsepm_ros.session.session import Session
from tsepm_ros.settings.node_options import SessionOptions
from tsepm_ros.settings.settings import Settings
from tsepm_ros.tracker.options import CommonOptions


def test_a_session_gives_what_the_initiator_gives():
    chosen = Settings(session=SessionOptions(method="tsepm"), sensor=BOX.sensor)
    one, initiator = Session(chosen), make_initiator("tsepm", sensor=BOX.sensor)
    confirmed = 0
    for scan in simulated():
        one.add_scan(arrived(scan, stamp_ns=17), 0.0)
        (result,) = one.process()
        assert_same_tracks(result.new, initiator.process(scan))
        assert result.statistics == initiator.statistics
        assert (result.stamp, result.stamp_ns) == (scan.stamp, 17)
        assert result.core_seconds > 0
        confirmed += len(result.new)
    assert confirmed > 5
    assert one.dropped == Counter()


def test_current_has_every_held_track_at_the_scan_s_stamp():
    one = session(CommonOptions(hold_time=20.0))
    results = play(one, [0, 12, 24]) + play_empty(one, [36, 48])
    (track,) = results[2].new
    assert [[one.track_id for one in result.current] for result in results[2:4]] == [[0], [0]]
    assert results[3].current[0].stamp == 36.0
    assert [result.ended for result in results] == [
        {},
        {},
        {},
        {},
        {track.track_id: "not_detected"},
    ]
    assert len(results[4].current) == 0


def test_reset_forgets_everything_but_ids():
    one = moving()
    sail(one, 1000.0, 1100.0)
    play(one, [1000, 1012, 1024, 1012], now=0.0)
    one.add_scan(ping(5000.0), 0.0)
    one.reset()
    assert one.dropped == Counter()
    assert (one.waiting, one.own_ship_stamp) == (0, None)
    assert one.tracker.totals.scans == 0
    sail(one, 0.0, 50.0)
    results = play(one, [0, 12, 24], now=0.0)
    assert [result.arrival for result in results] == [Arrival.NEXT] * 3
    assert results[2].new[0].track_id == 1
    assert results[2].ended == {}
    assert "restart" not in one.heard


def test_counts_of_several_are_added_up():
    one = session()
    one.drop("not_finite", "3 detections", 3)
    one.drop("not_finite", "2 detections", 2)
    assert one.dropped == {"not_finite": 5}
    assert one.heard == ["not_finite"] * 2


def test_figures_tell_the_state():
    one = session()
    assert (one.figures().totals.scans, one.figures().scan_stamp) == (0, None)
    play(one, [0, 12, 24])
    figures = one.figures()
    assert (figures.totals.scans, figures.totals.detections, figures.totals.confirmed) == (3, 3, 1)
    assert (figures.waiting, figures.tracks, figures.scan_stamp) == (0, 1, 24.0)
    assert figures.detection_probability == 0.9
    assert figures.detection_probability_estimated == pytest.approx(0.9)
    assert figures.clutter_density < FIXED_RANGE_ERROR.clutter_density, "a calm sea"
    assert figures.coverage_area < FIXED_RANGE_ERROR.coverage_area, "a target's neighbourhood"
    play(one, [24, 20])
    assert one.figures().dropped == {"scan_late": 1, "scan_same_stamp": 1}
