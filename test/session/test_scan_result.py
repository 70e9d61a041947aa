"""The own ship's pose of a scan, as pictures and pages show it."""

from __future__ import annotations

import numpy as np
import pytest

from tsepm_ros import Scan
from tsepm_ros.session.result import vessel_pose

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
