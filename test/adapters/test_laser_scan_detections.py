"""Detections in LaserScan, as its definition and REP-117 have them."""

import math

import numpy as np
import pytest
from sensor_msgs.msg import LaserScan

from msg_adapters import read_detections
from msg_adapters.detections import NO_TIMES, RAYS_AT_ONCE
from tsepm_ros import SensorModel

NAN, INF = math.nan, math.inf


def fan(ranges, **more):
    """A scan of 10 m to 100 m from -1 rad, 0.5 rad apart: exact in float32."""
    fields = {"angle_min": -1.0, "angle_increment": 0.5, "range_min": 10.0, "range_max": 100.0}
    scan = LaserScan(ranges=ranges, **{**fields, **more})
    scan.header.frame_id = "sonar"
    scan.header.stamp.sec, scan.header.stamp.nanosec = 1_700_000_000, 123_456_789
    return scan


def test_a_fan_may_turn_clockwise_and_its_angle_does_not_drift_along_the_rays():
    found = read_detections(fan([20.0, 30.0], angle_increment=-0.25))
    np.testing.assert_array_equal(found.scan.azimuth, [-1.0, -1.25])
    ranges = np.linspace(20.0, 90.0, 3600, dtype=np.float32)
    scan = fan(ranges, angle_min=-math.pi, angle_increment=math.pi / 1800)
    found = read_detections(scan)
    assert found.scan.azimuth[-1] == scan.angle_min + 3599 * scan.angle_increment


@pytest.mark.parametrize("nothing", [INF, 0.0, -0.0, -1.0, NAN, 100.0, 99.95, 655.35])
def test_a_ray_on_which_nothing_is_detected_is_no_drop(nothing):
    found = read_detections(fan([nothing, 20.0, nothing]), sound_speed=1500.0)
    assert found.dropped == {}
    np.testing.assert_array_equal(found.scan.range, [20.0])
    np.testing.assert_array_equal(found.scan.azimuth, [-0.5])
    np.testing.assert_array_equal(found.index, [1])


@pytest.mark.parametrize(
    ("value", "reason"),
    [
        pytest.param(-INF, "range_below_min", id="too_near"),
        pytest.param(9.5, "range_below_min", id="below"),
        pytest.param(1e-3, "range_below_min", id="next_to_zero"),
        pytest.param(100.5, "range_above_max", id="above"),
    ],
)
@pytest.mark.filterwarnings("error")
def test_a_bad_ray_is_dropped_and_counted_and_the_rest_kept(value, reason):
    found = read_detections(fan([20.0, value, 40.0, INF], intensities=[1.0, 2.0, 3.0, 4.0]))
    assert found.dropped == {reason: 1}
    np.testing.assert_array_equal(found.scan.range, [20.0, 40.0])
    np.testing.assert_array_equal(found.scan.features["intensity"], [1.0, 3.0])
    np.testing.assert_array_equal(found.index, [0, 2])


def test_the_least_range_itself_is_good_and_the_largest_is_no_return():
    found = read_detections(fan([10.0, 100.0, 99.95]))
    np.testing.assert_array_equal(found.index, [0, 2])
    assert found.sensor_scan.facts.no_return == {"at or just below range_max": 1}


def test_an_echo_is_of_its_ray_s_time_and_its_travel():
    # By hand: ray 2 leaves at 0.25 s, and 3000 m at 1500 m/s are 2 s on the way there.
    scan = fan([1500.0, INF, 3000.0], range_max=9e3, time_increment=0.125)
    for speed, times in ((0.0, [0.0, 0.25]), (1500.0, [1.0, 2.25])):
        found = read_detections(scan, sound_speed=speed)
        np.testing.assert_array_equal(found.sensor_scan.transmit_offset, [0.0, 0.25])
        np.testing.assert_array_equal(found.scan.time_offset, times)


@pytest.mark.parametrize(
    ("time_increment", "sound_speed", "said"),
    [
        (0.0, 0.0, (NO_TIMES,)),
        (0.125, 0.0, (RAYS_AT_ONCE,)),
        (0.0, 1500.0, ()),
        (0.125, 1500.0, ()),
    ],
)
def test_echoes_without_a_travel_time_are_said(time_increment, sound_speed, said):
    found = read_detections(fan([20.0], time_increment=time_increment), sound_speed=sound_speed)
    assert found.assumptions == said
    assert (found.sensor_scan.transmit_offset is None) == (time_increment == 0.0)


def test_intensities_of_another_number_are_not_used_and_said():
    found = read_detections(fan([20.0, 30.0, 40.0], intensities=[1.0, 2.0]))
    assert len(found) == 3
    assert found.scan.features == {}
    said = "the numbers of intensities and detections differ: intensities are not used"
    assert found.assumptions == (said, NO_TIMES)


@pytest.mark.parametrize(
    ("name", "value", "reason"),
    [
        ("angle_min", NAN, "azimuth_not_finite"),
        ("angle_increment", INF, "azimuth_not_finite"),
        ("time_increment", NAN, "time_offset_not_finite"),
        ("time_increment", 3e38, "time_offset_too_large"),
    ],
)
@pytest.mark.filterwarnings("error")
def test_a_bad_fan_is_counted_by_ray(name, value, reason):
    found = read_detections(fan([20.0, 30.0], **{name: value}))
    assert found.dropped[reason] >= 1
    assert len(found) + sum(found.dropped.values()) == 2


def test_limits_that_are_no_numbers_leave_nothing_out():
    assert len(read_detections(fan([20.0, 3000.0], range_min=NAN, range_max=NAN))) == 2


def test_rays_on_one_hull_are_of_one_group_by_their_step_and_the_sensor_s_noise():
    ranges = [20.0, 20.2, 20.4, 60.0, INF, 60.1, 60.2, -INF, 60.3]
    group = read_detections(fan(ranges, angle_increment=0.0125)).scan.group
    assert [int(np.flatnonzero(group == one)[0]) for one in group] == [0, 0, 0, 3, 4, 4, 6]
    coarse = read_detections(fan([20.0, 20.1, 20.2])).scan.group
    assert len(set(coarse.tolist())) == 3
    assert len(read_detections(fan([])).scan.group) == 0
    noisy = fan([20.0, 20.6, 19.7, 20.4], angle_increment=0.0125)
    sensor = SensorModel(range_std=0.2, range_std_fraction=0.0)
    assert len(set(read_detections(noisy).scan.group.tolist())) == 2
    assert len(set(read_detections(noisy, sensor=sensor).scan.group.tolist())) == 1
