"""Poses for echoes that were received on the move."""

import math

import numpy as np
import pytest
from scipy.optimize import brentq

from tsepm_ros.own_ship.pose_history import echo_poses

# Echoes on the move: an independent simulation. The ship turns on a circle, the target runs
# straight; the ping is followed with root finding.
SOUND = 1500.0


def ship_pose(time: float, scale: float) -> np.ndarray:
    """8 m/s and 0.6 degrees per second at scale 1, starting off the origin."""
    speed, rate, start = 8.0 * scale, 0.01 * scale, 0.4
    yaw = start + rate * time
    radius = speed / rate
    return np.array(
        [
            200.0 + radius * (math.sin(yaw) - math.sin(start)),
            -50.0 - radius * (math.cos(yaw) - math.cos(start)),
            yaw,
        ]
    )


def target_position(time: float, scale: float, azimuth: float) -> np.ndarray:
    start = 7000.0 * np.array([math.cos(azimuth), math.sin(azimuth)])
    return start + scale * time * np.array([-5.0, 7.0])


def echo(stamp: float, scale: float, azimuth: float) -> tuple[float, float]:
    """Range (mean of the legs) and azimuth against the heading at arrival."""
    sent = ship_pose(stamp, scale)[:2]

    def outward(t):
        return math.dist(target_position(t, scale, azimuth), sent) - SOUND * (t - stamp)

    reflected = brentq(outward, stamp, stamp + 30.0, xtol=1e-13)
    there = target_position(reflected, scale, azimuth)

    def back(t):
        return math.dist(ship_pose(t, scale)[:2], there) - SOUND * (t - reflected)

    arrived = brentq(back, reflected, reflected + 30.0, xtol=1e-13)
    x, y, yaw = ship_pose(arrived, scale)
    return 0.5 * SOUND * (arrived - stamp), math.atan2(there[1] - y, there[0] - x) - yaw


def placing_error(scale: float, azimuth: float, *, naive: bool = False) -> float:
    """Distance of the placed echo from the target at the time for which it is valid."""
    stamp = 60.0
    range_, bearing = echo(stamp, scale, azimuth)
    offset = np.array([range_ / SOUND])
    if naive:
        pose = ship_pose(stamp, scale)
    else:
        (pose,) = echo_poses(
            lambda times: np.array([ship_pose(t, scale) for t in times]),
            stamp,
            offset,
            np.array([bearing]),
        )
    angle = bearing + pose[2]
    placed = pose[:2] + range_ * np.array([math.cos(angle), math.sin(angle)])
    return math.dist(placed, target_position(stamp + offset[0], scale, azimuth))


DIRECTIONS = pytest.mark.parametrize("azimuth", [0.0, 0.9, 1.8, 3.0, -1.2, -2.2])


@DIRECTIONS
def test_an_echo_is_placed_where_the_target_was(azimuth):
    # What is left is of second order in speed over sound speed: (8 / 1500)^2 * 7000 m = 0.2 m.
    assert placing_error(1.0, azimuth) < 0.5


@pytest.mark.parametrize("offset", [None, np.zeros(3), np.zeros(0)], ids=["none", "zero", "empty"])
def test_without_time_offsets_there_is_one_pose_for_the_scan(offset):
    asked = []

    def poses_at(times):
        asked.extend(times.tolist())
        return np.array([[1.0, 2.0, 0.3]])

    n = 0 if offset is None else len(offset)
    assert echo_poses(poses_at, 7.0, offset, np.zeros(n)).tolist() == [1.0, 2.0, 0.3]
    assert asked == [7.0]


def test_an_echo_may_be_sent_after_the_stamp():
    asked = []

    def poses_at(times):
        asked.append(times.tolist())
        return np.stack([times, np.zeros(len(times)), np.zeros(len(times))], axis=1)

    delay = np.array([0.5, 2.0])
    offset = np.array([1.5, 2.0])
    found = echo_poses(poses_at, 100.0, offset, np.zeros(2), transmit_offset=delay)
    assert asked == [[100.5, 102.0], [102.5, 102.0]]  # what is sent when it arrives is seen at once
    np.testing.assert_allclose(found, [[101.5, 0.0, 0.0], [102.0, 0.0, 0.0]])
