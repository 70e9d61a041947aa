"""Recordings through a session, without ROS."""

import numpy as np
import pytest

from tsepm_ros.own_ship.pose_history import PoseSample
from tsepm_ros.own_ship.registration import SensorScan
from tsepm_ros.session.session import Session
from tsepm_ros.settings.node_options import SessionOptions
from tsepm_ros.settings.settings import Settings
from tsepm_ros.tools.replay.offline import process_recording
from tsepm_ros.tools.replay.recording import RecordedMotion, RecordedScan, Recording

MOVING = Settings(session=SessionOptions(own_ship_source="odometry"))


def scans(number: int, angle: str = "azimuth") -> list[RecordedScan]:
    """One target that stands still ahead of a sensor that does."""
    return [
        RecordedScan(12.0 * k, {"range": np.array([2000.0]), angle: np.array([0.0])})
        for k in range(number)
    ]


def own_ship(seconds: float, period: float = 1.0, yaw: float | None = 0.0):
    return [
        RecordedMotion(period * k, np.array([100.0, 0.0, 200.0, 0.0]), yaw)
        for k in range(int(seconds / period) + 1)
    ]


@pytest.mark.parametrize("angle", ["azimuth", "bearing"])
def test_scans_that_need_a_heading_are_dropped_where_none_was_recorded(angle):
    recording = Recording(scans(8, angle), own_ship(100.0, yaw=None))
    results, dropped = process_recording(recording, MOVING, "bow")
    assert results == []
    assert dropped == {"heading_unknown": 8}


def test_recorded_echoes_without_times_are_of_range_over_sound_speed():
    recording = Recording(scans(8), own_ship(100.0))
    (at_stamp, *_), _ = process_recording(recording, MOVING, "bow")
    (result, *_), dropped = process_recording(recording, MOVING, "bow", 1500.0)
    assert at_stamp.scan.time_offset is None
    np.testing.assert_allclose(result.scan.time_offset, [2000.0 / 1500.0])
    assert result.scan.sensor_pose.shape == (1, 3)
    assert not dropped


def rated(stamp: float) -> RecordedScan:
    values = {"range": [2000.0], "azimuth": [0.0], "range_rate": [1.0], "time_offset": [1.3]}
    return RecordedScan(stamp, {name: np.array(value) for name, value in values.items()})


def test_a_recorded_velocity_of_the_own_ship_is_the_sensor_s():
    noise = np.random.default_rng(1).normal(0.0, 1.0, 30)
    ship = [
        RecordedMotion(float(k), np.array([x, 3.0 + k, 0.0, -1.0]), 0.0)
        for k, x in enumerate(noise.tolist())
    ]
    (result,), _ = process_recording(Recording([rated(10.5)], ship), MOVING, "bow")
    np.testing.assert_allclose(result.scan.sensor_velocity, [[3.0 + 11.8, -1.0]])


@pytest.mark.parametrize("period", [0.001, 0.005, 0.1])
def test_a_scan_is_placed_as_by_a_session_that_has_all_of_the_odometry(period):
    noise = np.random.default_rng(2).normal(0.0, 1.0, round(20.0 / period)).tolist()
    ship = [
        RecordedMotion(period * k, np.array([x, 0.0, -x, 0.0]), 0.0) for k, x in enumerate(noise)
    ]
    (found,), _ = process_recording(Recording([rated(4.0004)], ship), MOVING, "bow")
    one = Session(MOVING)
    for k, x in enumerate(noise):
        one.add_own_ship(PoseSample(period * k, x, -x, 0.0, frame_id="odom"))
    one.add_scan(SensorScan(found.scan, "sonar"), 0.0)
    (expected,) = one.process()
    for name in ("sensor_pose", "sensor_velocity"):
        np.testing.assert_array_equal(getattr(found.scan, name), getattr(expected.scan, name))
