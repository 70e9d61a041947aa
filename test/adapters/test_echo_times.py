"""Times of echoes in PointCloud2: offsets, two-way travel times, and from the sound speed."""

from __future__ import annotations

import math

import numpy as np
import pytest
from support.raw_cloud import raw_cloud

from msg_adapters import read_detections
from tsepm_ros.tracker.scan import MAX_MAGNITUDE

NAN, INF = math.nan, math.inf


def test_a_time_offset_counts_whatever_the_sound_speed_is():
    fields = [("range", "d"), ("azimuth", "d"), ("time_offset", "d")]
    cloud = raw_cloud(fields, [(1500.0, 0.1, 0.25), (3000.0, 0.2, 0.0)])
    found = read_detections(cloud, sound_speed=1000.0)
    np.testing.assert_array_equal(found.scan.time_offset, [0.25, 0.0])
    assert found.assumptions == read_detections(cloud).assumptions == ()


TRAVEL = [("range", "d"), ("azimuth", "d"), ("two_way_travel_time", "d")]


def test_without_a_time_offset_half_of_the_two_way_travel_counts():
    cloud = raw_cloud(TRAVEL, [(1500.0, 0.1, 2.5), (3000.0, 0.2, 0.0)])
    found = read_detections(cloud, sound_speed=1000.0)
    np.testing.assert_array_equal(found.scan.time_offset, [1.25, 0.0])
    assert found.assumptions == read_detections(cloud).assumptions == ()


def test_a_time_offset_comes_before_a_two_way_travel_time_even_where_it_is_nan():
    fields = [*TRAVEL, ("time_offset", "d")]
    cloud = raw_cloud(fields, [(1500.0, 0.1, 2.5, 0.25), (3000.0, 0.2, 4.0, NAN)])
    found = read_detections(cloud)
    np.testing.assert_array_equal(found.scan.time_offset, [0.25])
    assert found.dropped == {"time_offset_not_finite": 1}


def test_both_times_tell_when_a_bearing_was_sent():
    fields = [*TRAVEL, ("time_offset", "d")]
    cloud = raw_cloud(fields, [(1500.0, 0.1, 2.0, 4.0), (1500.0, 0.2, NAN, 5.0)])
    found = read_detections(cloud)
    np.testing.assert_array_equal(found.sensor_scan.transmit_offset, [3.0])
    assert found.dropped == {"transmit_offset_not_finite": 1}


@pytest.mark.parametrize(
    ("value", "reason"),
    [(NAN, "not_finite"), (INF, "not_finite"), (2.1 * MAX_MAGNITUDE["time_offset"], "too_large")],
)
def test_a_bad_two_way_travel_time_is_counted_as_a_time_offset(value, reason):
    found = read_detections(raw_cloud(TRAVEL, [(1500.0, 0.1, value), (3000.0, 0.2, 4.0)]))
    assert found.dropped == {f"time_offset_{reason}": 1}
    np.testing.assert_array_equal(found.scan.time_offset, [2.0])


@pytest.mark.parametrize("speed", [-1.0, math.nan, math.inf])
def test_a_sound_speed_that_is_none_is_refused(speed):
    with pytest.raises(ValueError, match="sound_speed must be"):
        read_detections(raw_cloud([("range", "f"), ("azimuth", "f")], []), sound_speed=speed)


def test_an_echo_time_from_the_sound_speed_is_checked_like_one_of_the_message():
    fields = [(name, "d") for name in ("x", "y", "z")]
    rows = [(3.0, 4.0, 0.0), (1e8, 0.0, 1e8)]
    found = read_detections(raw_cloud(fields, rows), sound_speed=100.0)
    assert found.dropped == {"time_offset_too_large": 1}
    np.testing.assert_array_equal(found.scan.time_offset, [0.05])
