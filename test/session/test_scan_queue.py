"""The order of scans: stamps that repeat, come late, go back or jump ahead, and too many."""

import dataclasses
from collections import Counter

import numpy as np
import pytest
from support.builders import assert_same_tracks
from support.sessions import (
    BOX,
    NotedSession,
    arrived,
    moving,
    moving_settings,
    ping,
    play,
    sail,
    session,
    simulated,
)

from tsepm_ros import Scan
from tsepm_ros.session.scan_queue import Arrival
from tsepm_ros.session.session import Session
from tsepm_ros.settings.node_options import SessionOptions
from tsepm_ros.settings.settings import Settings
from tsepm_ros.tracker.options import CommonOptions

QUEUE_LENGTH = 32

# Scans that must leave no trace: after the third of ten scans.
HARMLESS = {
    "scan_same_stamp": lambda scan: arrived(scan),
    "scan_late": lambda scan: arrived(dataclasses.replace(scan, stamp=scan.stamp - 5.0)),
    "unknown_frame": lambda scan: arrived(dataclasses.replace(scan, stamp=scan.stamp + 5.0), "x"),
    "too_many_detections": lambda scan: arrived(
        Scan(scan.stamp + 5.0, np.full(5001, 100.0), np.zeros(5001))
    ),
}


@pytest.mark.parametrize("reason", HARMLESS)
def test_a_bad_scan_in_between_leaves_the_others_as_they_were(reason):
    chosen = Settings(
        session=SessionOptions(method="tsepm"),
        sensor=BOX.sensor,
        common=CommonOptions(max_detections=5000),
    )
    clean, disturbed = Session(chosen), NotedSession(chosen)
    for index, scan in enumerate(simulated()):
        clean.add_scan(arrived(scan), 0.0)
        disturbed.add_scan(arrived(scan), 0.0)
        (expected,), (found,) = clean.process(), disturbed.process()
        assert_same_tracks(found.new, expected.new)
        assert_same_tracks(found.current, expected.current)
        assert found.statistics == expected.statistics
        assert found.arrival is Arrival.NEXT
        if index == 2:
            disturbed.add_scan(HARMLESS[reason](scan), 0.0)
            assert list(disturbed.process()) == []
            assert disturbed.dropped == {reason: 1}
            assert disturbed.heard == [reason]
    assert clean.tracker.totals.confirmed > 0


def test_the_queue_of_waiting_scans_is_bounded_and_drops_the_oldest():
    one = NotedSession(moving_settings(), queue_length=QUEUE_LENGTH)
    for k in range(QUEUE_LENGTH + 3):
        one.add_scan(ping(float(k)), 0.0)
    assert one.waiting == QUEUE_LENGTH
    assert one.dropped == {"queue_full": 3}
    sail(one, 0.0, 100.0)
    assert [result.stamp for result in one.process(0.0)] == [
        float(k) for k in range(3, QUEUE_LENGTH + 3)
    ]


def test_a_restart_whose_first_scan_gave_way_in_the_queue_is_still_a_restart():
    one = NotedSession(moving_settings(), queue_length=QUEUE_LENGTH)
    sail(one, 999.0, 1100.0)
    one.add_scan(ping(1000.0), 0.0)
    assert len(list(one.process(0.0))) == 1
    for k in range(QUEUE_LENGTH + 1):
        one.add_scan(ping(float(k)), 0.0)
    sail(one, 0.0, 100.0)
    assert len(list(one.process(0.0))) == QUEUE_LENGTH


def test_a_limit_lowered_while_a_scan_waits_drops_it():
    one = moving()
    one.add_scan(ping(5.0, n=4), 0.0)
    sail(one, 0.0, 20.0)
    one.configure(dataclasses.replace(one.settings, common=CommonOptions(max_detections=3)))
    one.add_scan(ping(12.0), 0.0)
    assert [result.stamp for result in one.process(0.0)] == [12.0]
    assert one.dropped == {"too_many_detections": 1}


def test_a_restart_resets_the_state_and_is_said_once():
    one = session()
    before = play(one, [1000, 1012, 1024])
    after = play(one, [0, 12, 24])
    assert [result.arrival for result in after] == [Arrival.RESTART, Arrival.NEXT, Arrival.NEXT]
    assert one.heard == ["restart"]
    assert after[0].ended == {before[2].new[0].track_id: "cleared"}
    assert len(after[0].current) == 0
    assert [len(result.new) for result in after] == [0, 0, 1]
    assert after[2].new[0].hits == ((0, 0), (1, 0), (2, 0)), "scans count from the restart"
    assert after[2].new[0].track_id == 1, "ids go on"


FAR_BACK = [
    pytest.param([0.0], "stamp_not_set", id="not set"),
    pytest.param([0.0, 0.0], "stamp_not_set", id="not set twice"),
    pytest.param([500.0], "scan_far_back", id="far back"),
    pytest.param([500.0, 400.0], "scan_far_back", id="not rising"),
]


@pytest.mark.parametrize(("stamps", "reason"), FAR_BACK)
@pytest.mark.parametrize("source", ["none", "odometry"])
def test_stamps_far_back_that_none_follows_cost_only_themselves(source, stamps, reason):
    one = session(own_ship_source=source, own_ship_max_gap=3600.0)
    if source == "odometry":
        sail(one, 900.0, 2000.0)
    results = play(one, [1000, 1012, *stamps, 1024, 1036], now=0.0)
    assert [result.arrival for result in results] == [Arrival.NEXT] * 4
    assert [len(result.new) for result in results] == [0, 0, 1, 0]
    assert one.dropped == {reason: len(stamps)}


def test_of_a_restart_that_is_confirmed_nothing_is_lost_and_the_wait_is_not_counted():
    one = session()
    play(one, [1000])
    one.add_scan(ping(0.0), 10.0)
    assert list(one.process(20.0)) == []
    one.add_scan(ping(12.0), 22.0)
    results = list(one.process(22.5))
    assert [(one.stamp, one.waiting) for one in results] == [(0.0, 0.5), (12.0, 0.5)]
    assert one.dropped == Counter()


def test_the_last_scan_of_all_if_far_back_is_dropped_and_counted():
    one = session()
    play(one, [1000, 5])
    assert (list(one.process(last=True)), one.waiting) == ([], 0)
    assert one.dropped == {"scan_far_back": 1}


def test_a_long_gap_drops_potential_tracks_and_keeps_the_held():
    one = session(CommonOptions(hold_time=1e6))
    stamps = [0, 12, 24, 36, 48, 1000, 1012, 1024]
    results = play(one, stamps)
    assert results[5].arrival is Arrival.GAP
    assert one.heard == ["gap"]
    assert [len(result.new) for result in results] == [0, 0, 1, 0, 0, 0, 0, 1]
    # Its place is not known well enough after the gap, and then it is again.
    published = [[track.track_id for track in result.current] for result in results]
    assert published[4:7] == [[0], [], [0]]
    assert results[7].new[0].scan_count == 3


def test_a_gap_before_a_dropped_scan_still_drops_potential_tracks():
    one = moving(max_gap=100.0)
    sail(one, 0.0, 30.0)
    play(one, [0, 12], now=0.0)
    one.add_scan(ping(500.0), 0.0)
    assert list(one.process()) == []
    sail(one, 505.0, 600.0)
    results = play(one, [512, 524, 536], now=0.0)
    assert [len(result.new) for result in results] == [0, 0, 1]
