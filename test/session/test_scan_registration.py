"""Scans put in the fixed frame, or lost alone, and the own ship's pose that pictures show."""

import numpy as np
import pytest
from support.sessions import arrived, held, moving, play, sail

from tsepm_ros import Scan
from tsepm_ros.own_ship.pose_history import PoseSample
from tsepm_ros.session.result import vessel_pose
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


POSES = np.array([[10.0, 20.0, 0.5], [30.0, 40.0, 0.7]])


@pytest.mark.parametrize(("offsets", "row"), [([2.0, 1.0], 1), ([1.0, 2.0], 0), (None, 0)])
def test_the_pose_is_that_of_the_nearest_echo(offsets, row):
    scan = Scan(0.0, [100.0, 200.0], [0.0, 0.1], time_offset=offsets, sensor_pose=POSES)
    np.testing.assert_allclose(vessel_pose(scan, 0.2), POSES[row] - [0.0, 0.0, 0.2])


def test_a_heading_that_nothing_gives_is_unknown():
    pose = vessel_pose(Scan(0.0, [100.0], [0.0], sensor_pose=POSES[0]), None)
    assert pose[:2].tolist() == [10.0, 20.0] and np.isnan(pose[2])


def test_a_scan_without_detections_has_the_poses_of_none():
    empty = Scan(0.0, [], [], sensor_pose=np.zeros((0, 3)))
    assert vessel_pose(empty, 0.0) is None
