"""Scans put in the fixed frame, or lost alone."""

from __future__ import annotations

import numpy as np
from support.sessions import (
    arrived,
    held,
    moving,
    play,
    sail,
)

from tsepm_ros import Scan
from tsepm_ros.own_ship.pose_history import PoseSample
from tsepm_ros.tracker.options import CommonOptions


def test_echoes_are_placed_with_the_poses_of_their_sending_and_arrival():
    one = moving()
    sail(one, 0.0, 100.0)
    scan = Scan(30.0, [1500.0, 7500.0], [-0.5, -0.5], time_offset=[1.0, 5.0])
    one.add_scan(arrived(scan), 0.0)
    (result,) = one.process(0.0)
    # Looking along x: half of the way between sending and arrival.
    expected = [[62.0, 10.0, 0.5], [70.0, 10.0, 0.5]]
    np.testing.assert_allclose(result.scan.sensor_pose, expected, atol=1e-9)


def test_a_scan_that_cannot_be_placed_costs_itself_and_no_track():
    one = moving(common=CommonOptions(hold_time=1e6), own_ship_max_extrapolation=12.0)
    sail(one, 0.0, 30.0)
    confirmed = play(one, [0, 12, 24])[2].new
    # At the edge of what is taken, and beyond it where the newest velocity carries it.
    for stamp in (31.0, 32.0):
        one.add_own_ship(PoseSample(stamp, 1e9, 0.0, 0.0, rates=(10.0, 0.0, 0.0), frame_id="odom"))
    assert play(one, [36]) == []
    assert (one.dropped, one.waiting) == ({"own_ship_jump": 1}, 0)
    sail(one, 40.0, 60.0)
    (result,) = play(one, [48])
    assert held(result) == [track.track_id for track in confirmed]


def test_a_negative_time_offset_is_placed_where_poses_are_known():
    one = moving()
    sail(one, 0.0, 30.0)
    scan = Scan(20.0, [1000.0], [-0.5], time_offset=[-3.0])
    one.add_scan(arrived(scan), 0.0)
    (result,) = one.process(0.0)
    np.testing.assert_allclose(result.scan.sensor_pose, [[34.0, 10.0, 0.5]], atol=1e-9)
