"""Detections in radar_msgs/RadarScan, on stand-ins with the fields of its files."""

import math

import numpy as np
import pytest
from support.foreign_messages import RadarReturn, RadarScan

from msg_adapters import make_header, read_detections
from tsepm_ros.session.session import Session
from tsepm_ros.settings.settings import Settings

NAN, INF = math.nan, math.inf
GOOD = {
    "range": 1000.0,
    "azimuth": 0.5,
    "elevation": 0.0,
    "doppler_velocity": -3.0,
    "amplitude": 12.0,
}


def scan(*returns):
    header = make_header(1_700_000_000_123_456_789, "radar")
    return RadarScan(header=header, returns=[RadarReturn(**{**GOOD, **one}) for one in returns])


def test_returns_are_read_into_their_places():
    found = read_detections(scan({}, {"azimuth": -2.0, "doppler_velocity": 4.0}))
    assert (found.sensor_scan.stamp_ns, found.sensor_scan.frame_id) == (
        1_700_000_000_123_456_789,
        "radar",
    )
    np.testing.assert_array_equal(found.scan.range, [1000.0, 1000.0])
    np.testing.assert_array_equal(found.scan.azimuth, [0.5, -2.0])
    np.testing.assert_array_equal(
        found.scan.features["range_rate"], [-3.0, 4.0]
    )  # above 0: going away
    np.testing.assert_array_equal(found.scan.features["intensity"], [12.0, 12.0])
    assert found.scan.time_offset is None
    assert found.dropped == {}


@pytest.mark.parametrize("elevation", [0.5, -0.5])
def test_the_range_is_that_in_the_horizontal_plane(elevation):
    found = read_detections(scan({"elevation": elevation}))
    assert found.scan.range[0] == pytest.approx(1000.0 * math.cos(0.5), rel=1e-15)
    assert found.sensor_scan.height[0] == pytest.approx(1000.0 * math.sin(elevation), rel=1e-15)


def test_the_doppler_velocity_along_the_line_of_sight_becomes_that_of_the_horizontal_range():
    session = Session(Settings())
    message = scan({"elevation": 0.4, "doppler_velocity": -3.0}, {"elevation": 0.5})
    session.add_scan(read_detections(message).sensor_scan, 0.0)
    (result,) = session.process()
    expected = [-3.0 / math.cos(0.4), NAN]  # beyond 24.6 degrees it says too little
    np.testing.assert_allclose(result.scan.features["range_rate"], expected, rtol=1e-15)


@pytest.mark.parametrize(
    ("name", "value", "reason"),
    [
        ("range", NAN, "range_not_finite"),
        ("range", 0.0, "range_not_positive"),
        ("range", 3e38, "range_too_large"),
        ("azimuth", INF, "azimuth_not_finite"),
        ("elevation", NAN, "elevation_not_finite"),
        ("elevation", -INF, "elevation_not_finite"),
        ("elevation", 2.0, "range_not_positive"),
    ],
)
@pytest.mark.filterwarnings("error")
def test_a_bad_return_is_dropped_and_the_rest_kept(name, value, reason):
    found = read_detections(scan({"range": 10.0}, {name: value}, {"range": 30.0}))
    assert found.dropped == {reason: 1}
    np.testing.assert_array_equal(found.scan.range, [10.0, 30.0])


@pytest.mark.parametrize("name", ["doppler_velocity", "amplitude"])
def test_a_feature_that_is_not_finite_drops_nothing(name):
    assert read_detections(scan({name: NAN})).dropped == {}


def test_a_scan_without_returns_is_good():
    assert len(read_detections(scan())) == 0
