"""Own-ship data: waited for, late, far back, missing, and begun anew."""

import dataclasses
import math
from collections import Counter, deque

import numpy as np
import pytest
from support.sessions import arrived, moving, ping, play, sail, settings

from tsepm_ros import Scan
from tsepm_ros.own_ship.pose_history import PoseSample


def test_a_scan_whose_echoes_are_sent_later_waits_for_and_uses_the_poses_of_then():
    one = moving()
    needed = []
    one.own_ship.look_up = lambda *span: needed.append(span[1:3])
    scan = Scan(30.0, [100.0, 100.0], [-0.5, -0.5], time_offset=[4.0, 8.0])
    one.add_scan(arrived(scan, transmit_offset=np.array([4.0, 7.0])), 0.0)
    sail(one, 0.0, 100.0)
    (result,) = one.process(0.0)
    assert needed == [(30.0, 39.0)]
    expected = [[68.0, 10.0, 0.5], [76.0, 10.0, 0.5]]
    np.testing.assert_allclose(result.scan.sensor_pose, expected, atol=1e-9)


def test_a_look_up_that_fails_costs_one_scan():
    one = moving()
    sail(one, 0.0, 100.0)

    def fail(*span):
        raise LookupError("no transform")

    one.own_ship.look_up = fail
    assert play(one, [12], now=0.0) == []
    one.own_ship.look_up = None
    assert len(play(one, [24], now=0.0)) == 1
    assert one.dropped == {"internal_error": 1}


def test_a_scan_whose_own_ship_data_never_comes_is_dropped_after_the_timeout():
    one = moving(own_ship_timeout=2.0)
    one.add_scan(ping(0.0), 50.0)
    assert list(one.process(51.9)) == []
    assert one.dropped == Counter()
    assert list(one.process(52.0)) == []
    assert one.dropped == {"own_ship_missing": 1}
    assert one.heard == ["own_ship_missing"]
    assert one.waiting == 0


def reader(one, *stamps):
    """Reads poses one by one, as a node does messages of odometry that wait."""
    unread = deque(stamps)

    def read() -> bool:
        if unread:
            sail(one, unread.popleft())
            return True
        return False

    one.own_ship.read_unread = read
    return unread


def test_own_ship_data_is_not_read_out_of_turn_for_a_scan_that_may_wait_or_is_covered():
    one = moving(own_ship_timeout=2.0)
    unread = reader(one, 4.0, -900.0)
    sail(one, 0.0, 2.0)
    one.add_scan(ping(3.0), 50.0)
    assert list(one.process(51.0)) == []
    sail(one, 4.0)
    assert [result.stamp for result in one.process(53.0)] == [3.0]
    assert len(unread) == 2


def test_a_scan_before_a_restart_is_not_placed_by_unread_own_ship_data_after_it():
    one = moving(own_ship_timeout=2.0)
    sail(one, 0.0, 69.0)
    one.add_scan(ping(69.5), 50.0)
    unread = reader(one, *np.arange(0.0, 80.0))
    assert list(one.process(60.0)) == []
    assert one.dropped == {"own_ship_stale": 1}
    while unread:
        one.own_ship.read_unread()
    for stamp in (4.0, 16.0, 28.0):
        one.add_scan(ping(stamp), 61.0)
    assert [result.stamp for result in one.process(61.0)] == [4.0, 16.0, 28.0]


def test_stale_own_ship_data_drops_the_scan_and_the_next_good_one_is_processed():
    one = moving(own_ship_timeout=2.0, own_ship_max_extrapolation=0.5)
    sail(one, 0.0, 10.0)
    one.add_scan(ping(10.6), 0.0)
    assert list(one.process(2.0)) == []
    assert one.dropped == {"own_ship_stale": 1}
    sail(one, 30.0)
    one.add_scan(ping(22.0), 12.0)
    assert [result.stamp for result in one.process(12.0)] == [22.0]


def test_slightly_stale_own_ship_data_is_extrapolated_after_the_wait():
    one = moving(own_ship_timeout=2.0, own_ship_max_extrapolation=0.5)
    sail(one, 0.0, 10.0)
    one.add_scan(ping(10.5), 0.0)
    assert list(one.process(1.9)) == []
    (result,) = one.process(2.0)
    np.testing.assert_allclose(result.scan.sensor_pose, [21.0, 10.0, 0.5])


def test_a_scan_from_before_the_own_ship_data_is_dropped_at_once():
    one = moving(own_ship_max_extrapolation=0.5)
    sail(one, 10.0, 20.0)
    one.add_scan(ping(9.0), 0.0)
    one.add_scan(ping(12.0), 0.0)
    assert [result.stamp for result in one.process(0.0)] == [12.0]
    assert one.dropped == {"own_ship_stale": 1}


def test_a_hole_of_an_hour_in_the_own_ship_data_is_not_interpolated_across():
    one = moving(own_ship_max_gap=60.0)
    for span in ((0.0, 1.0), (3601.0, 3602.0)):
        sail(one, *span)
    one.add_scan(ping(1800.0), 0.0)
    assert list(one.process()) == []
    assert one.dropped == {"own_ship_stale": 1}


BAD_SAMPLES = {
    "x": {"x": math.nan},
    "y": {"y": math.inf},
    "far": {"x": 1e12},
    "yaw": {"yaw": math.nan},
    "stamp": {"stamp": math.nan},
    "covariance": {"covariance": -np.eye(3)},
    "nan covariance": {"covariance": np.full((3, 3), math.nan)},
}


@pytest.mark.parametrize("fault", BAD_SAMPLES)
def test_a_bad_own_ship_sample_is_dropped_and_the_others_are_used(fault):
    one = moving()
    sail(one, 0.0)
    bad = dataclasses.replace(
        PoseSample(4.0, 8.0, 10.0, 0.5, frame_id="odom"), **BAD_SAMPLES[fault]
    )
    one.add_own_ship(bad)
    sail(one, 10.0)
    one.add_scan(ping(4.5), 0.0)
    (result,) = one.process(0.0)
    np.testing.assert_allclose(result.scan.sensor_pose, [9.0, 10.0, 0.5])
    assert one.dropped == {"own_ship_invalid": 1}


def test_a_pose_carried_off_the_earth_costs_its_ping_under_a_name():
    one = moving(own_ship_max_extrapolation=0.5)
    at_the_end = PoseSample(0.0, 1e9 - 1000.0, 0.0, 0.0, rates=(1e6, 0.0, 0.0), frame_id="odom")
    one.add_own_ship(at_the_end)
    assert play(one, [0.4]) == []
    sail(one, 40.0, 60.0)
    assert [result.stamp for result in play(one, [50])] == [50.0]
    assert one.dropped == {"own_ship_jump": 1}


def test_a_restart_before_the_own_ship_follows_is_still_a_restart():
    one = moving()
    sail(one, 1000.0, 1100.0)
    play(one, [1000, 1012], now=0.0)
    one.add_scan(ping(0.0), 0.0)
    assert list(one.process()) == [], "dropped: no own-ship data of the new run"
    sail(one, 1.0, 50.0)
    results = play(one, [12, 24, 36], now=0.0)
    assert [len(result.new) for result in results] == [0, 0, 1]
    assert one.heard.count("restart") == 1


def test_poses_of_the_run_before_a_restart_do_not_place_scans():
    one = moving()
    for stamp in range(0, 1100, 20):
        one.add_own_ship(PoseSample(float(stamp), 5e5, 5e5, 0.0, frame_id="odom"))
    play(one, [1000], now=0.0)
    one.add_scan(ping(50.0), 0.0)
    one.add_scan(ping(62.0), 0.0)
    assert list(one.process(0.0)) == []
    sail(one, 0.0, 100.0)
    result, _ = one.process(0.1)
    np.testing.assert_allclose(result.scan.sensor_pose, [100.0, 10.0, 0.5])


def test_the_own_ship_source_stays_as_it_is_when_settings_change():
    one = moving()
    sail(one, 0.0, 10.0)
    one.configure(settings())
    one.add_scan(ping(5.0), 0.0)
    (result,) = one.process(0.0)
    np.testing.assert_allclose(result.scan.sensor_pose, [10.0, 10.0, 0.5])


def test_the_newest_scan_is_not_one_of_before_the_poses_restarted():
    one = moving()
    sail(one, 900.0, 1020.0)
    play(one, [1000, 1012], now=0.0)
    sail(one, 0.0, 12.0)
    assert (one.figures().scan_stamp, one.figures().own_ship_stamp) == (None, 12.0)
    play(one, [5], now=0.0)
    assert one.figures().scan_stamp == 5.0


def test_figures_tell_how_far_own_ship_data_is_behind_the_newest_scan():
    one = moving()
    sail(one, 0.0, 20.0)
    one.add_scan(ping(30.0), 0.0)
    one.add_scan(ping(42.0), 0.0)
    figures = one.figures()
    assert (figures.waiting, figures.scan_stamp, figures.own_ship_stamp) == (2, 42.0, 20.0)
