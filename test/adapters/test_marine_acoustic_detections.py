"""Detections in marine_acoustic_msgs, on stand-ins with the fields of its files."""

import math

import numpy as np
import pytest
from geometry_msgs.msg import Vector3
from support.foreign_messages import DetectionFlag, PingInfo, SonarDetections, SonarRanges

from msg_adapters import MessageError, make_header, read_detections

NAN, INF = math.nan, math.inf
STAMP = 1_700_000_000_123_456_789
KNOWN = PingInfo(sound_speed=1500.0)
ROUNDED = 1e-7
"""Relative error of a float32."""


def travel_times(times, rx_angles, **more):
    return SonarDetections(
        header=make_header(STAMP, "sonar"),
        two_way_travel_times=times,
        rx_angles=rx_angles,
        **{"ping_info": KNOWN, **more},
    )


def ranges(distances, vectors, **more):
    return SonarRanges(
        header=make_header(STAMP, "sonar"),
        ranges=distances,
        beam_unit_vec=[Vector3(x=float(x), y=float(y), z=float(z)) for x, y, z in vectors],
        **{"ping_info": KNOWN, **more},
    )


def flags(*values):
    return [DetectionFlag(flag=value) for value in values]


@pytest.mark.parametrize("elevation", [0.0, 0.3, -0.7])
@pytest.mark.parametrize("azimuth", [0.0, 0.4, -1.2])
def test_the_horizontal_place_is_found_of_any_direction(azimuth, elevation):
    x, y, z = (
        math.sin(elevation),
        -math.cos(elevation) * math.sin(azimuth),
        math.cos(elevation) * math.cos(azimuth),
    )
    angles = {"tx_angles": [math.asin(x)], "rx_angles": [math.asin(y)]}
    times = SonarDetections(ping_info=KNOWN, two_way_travel_times=[2.0], **angles)
    for message in (
        times,
        ranges([1500.0], [(x, y, z)]),
        ranges([1500.0], [(3 * x, 3 * y, 3 * z)]),
    ):
        found = read_detections(message)
        assert found.scan.range[0] == pytest.approx(1500.0 * math.cos(elevation), rel=3 * ROUNDED)
        assert found.scan.azimuth[0] == pytest.approx(azimuth, abs=10 * ROUNDED)
        assert found.sensor_scan.height[0] == pytest.approx(
            1500.0 * math.sin(elevation), rel=10 * ROUNDED
        )


def test_a_beam_may_look_abaft():
    found = read_detections(ranges([100.0, 100.0], [(0, 0, -1), (0, 1, 0)]))
    np.testing.assert_allclose(np.abs(found.scan.azimuth), [math.pi, math.pi / 2])
    assert found.scan.azimuth[1] < 0


def test_times_follow_from_ranges_and_the_sound_speed():
    message = ranges([1500.0, 3000.0], [(0, 0, 1)], transmit_delays=[0.5, 0.25])
    found = read_detections(message)
    np.testing.assert_array_equal(found.scan.time_offset, [1.5, 2.25])
    np.testing.assert_array_equal(found.sensor_scan.transmit_offset, [0.5, 0.25])


@pytest.mark.parametrize("unknown", [0.0, -1500.0, NAN, INF, 1e-38])
def test_an_unknown_sound_speed_is_the_parameter_s_and_said(unknown):
    info = PingInfo(sound_speed=unknown)
    found = read_detections(travel_times([2.0], [0.0], ping_info=info), sound_speed=1450.0)
    assert found.scan.range[0] == 1450.0
    [sentence] = found.assumptions
    assert "SonarDetections has no sound speed" in sentence
    assert "1450 m/s" in sentence
    found = read_detections(ranges([2900.0], [(0, 0, 1)], ping_info=info), sound_speed=1450.0)
    assert (found.scan.range[0], found.scan.time_offset[0]) == (2900.0, 2.0)
    assert len(found.assumptions) == 1
    found = read_detections(travel_times([2.0], [0.0], ping_info=info))
    assert found.scan.range[0] == 1500.0
    assert "1500 m/s is assumed; sound_speed is not set" in found.assumptions[0]


def test_one_value_holds_for_every_beam():
    found = read_detections(
        travel_times(
            [2.0, 4.0], [0.5], tx_angles=[0.0], tx_delays=[0.25], intensities=[7.0], flags=flags(0)
        )
    )
    np.testing.assert_array_equal(found.scan.azimuth, [-0.5, -0.5])
    np.testing.assert_array_equal(found.sensor_scan.transmit_offset, [0.25, 0.25])
    np.testing.assert_array_equal(found.scan.features["intensity"], [7.0, 7.0])
    found = read_detections(ranges([100.0], [(0, 0, 1), (0, 1, 0)]))
    np.testing.assert_array_equal(found.scan.range, [100.0, 100.0])


@pytest.mark.parametrize("bad", [1, 2, 4, 7])
def test_flagged_beams_are_dropped(bad):
    found = read_detections(
        travel_times([2.0, 4.0], [0.0, 0.0], flags=flags(0, bad), intensities=[1.0, 2.0])
    )
    assert found.dropped == {"flagged_bad": 1}
    np.testing.assert_array_equal(found.scan.range, [1500.0])
    np.testing.assert_array_equal(found.scan.features["intensity"], [1.0])
    assert read_detections(ranges([1.0, 2.0], [(0, 0, 1)], flags=flags(bad))).dropped == {
        "flagged_bad": 2
    }


@pytest.mark.parametrize(
    ("values", "reason"),
    [
        ({"time": NAN}, "range_not_finite"),
        ({"time": INF}, "range_not_finite"),
        ({"time": 0.0}, "range_not_positive"),
        ({"time": -1.0}, "range_not_positive"),
        ({"time": 3e38}, "range_too_large"),
        ({"rx": NAN}, "direction_undefined"),
        ({"rx": INF}, "direction_undefined"),
        ({"rx": 2.0}, "direction_undefined"),
        ({"tx": -2.0}, "direction_undefined"),
        ({"tx": 1.0, "rx": 1.0}, "direction_undefined"),
        ({"tx": math.pi / 2, "rx": 0.0}, "range_too_small"),
        ({"delay": NAN}, "time_offset_not_finite"),
        ({"delay": 1e7}, "time_offset_too_large"),
    ],
)
@pytest.mark.filterwarnings("error")
def test_a_bad_travel_time_is_dropped_and_the_rest_kept(values, reason):
    one = {"time": 2.0, "rx": 0.25, "tx": 0.0, "delay": 0.0, **values}
    found = read_detections(
        travel_times(
            [2.0, one["time"], 4.0],
            [0.0, one["rx"], 0.0],
            tx_angles=[0.0, one["tx"], 0.0],
            tx_delays=[0.0, one["delay"], 0.0],
        )
    )
    assert found.dropped == {reason: 1}
    np.testing.assert_array_equal(found.scan.range, [1500.0, 3000.0])
    np.testing.assert_array_equal(found.index, [0, 2])


@pytest.mark.parametrize("angle", [math.pi / 2, -math.pi / 2])
def test_abeam_is_a_direction(angle):
    assert read_detections(travel_times([2.0], [angle])).scan.azimuth[0] == pytest.approx(
        -angle, abs=1e-6
    )


@pytest.mark.parametrize(
    ("vector", "reason"),
    [
        ((0.0, 0.0, 0.0), "direction_undefined"),
        ((0.0, NAN, 1.0), "direction_undefined"),
        ((0.0, INF, 1.0), "direction_undefined"),
        ((1.0, 0.0, 0.0), "range_not_positive"),
    ],
    ids=["zero", "nan", "infinite", "up"],
)
@pytest.mark.filterwarnings("error")
def test_a_bad_vector_is_dropped_and_the_rest_kept(vector, reason):
    found = read_detections(ranges([100.0, 200.0, 300.0], [(0, 0, 1), vector, (0, 0, 1e200)]))
    assert found.dropped == {reason: 1}
    np.testing.assert_array_equal(found.scan.range, [100.0, 300.0])


@pytest.mark.parametrize(
    ("message", "reason", "name"),
    [
        (travel_times([2.0, 2.0], [0.0, 0.0, 0.0]), "wrong_length", "two_way_travel_times"),
        (travel_times([2.0, 2.0], [0.0], tx_angles=[0.0] * 3), "wrong_length", "tx_angles"),
        (travel_times([2.0, 2.0], [0.0], tx_delays=[0.0] * 3), "wrong_length", "tx_delays"),
        (travel_times([2.0] * 3, [0.0], flags=flags(0, 0)), "wrong_length", "flags"),
        (travel_times([2.0, 2.0], []), "missing_field", "rx_angles"),
        (travel_times([], [0.0, 0.0]), "missing_field", "two_way_travel_times"),
        (ranges([2.0, 2.0], []), "missing_field", "beam_unit_vec"),
        (ranges([2.0] * 3, [(0, 0, 1)] * 2), "wrong_length", "beam_unit_vec"),
    ],
)
def test_arrays_that_do_not_fit_drop_the_message_by_name(message, reason, name):
    with pytest.raises(MessageError, match=name) as error:
        read_detections(message)
    assert error.value.reason == reason


def test_intensities_that_do_not_fit_lose_no_detection():
    found = read_detections(travel_times([2.0, 2.0, 2.0], [0.0], intensities=[1.0, 2.0]))
    assert (len(found), found.scan.features) == (3, {})
    assert "intensities" in found.assumptions[0]


@pytest.mark.parametrize(
    "message",
    [
        travel_times([], [], tx_angles=[0.0], tx_delays=[0.0], flags=flags(0)),
        SonarDetections(),
        ranges([], [], transmit_delays=[0.0]),
        SonarRanges(),
    ],
    ids=["travel_times", "travel_times_default", "ranges", "ranges_default"],
)
@pytest.mark.filterwarnings("error")
def test_a_ping_without_detections_is_good(message):
    found = read_detections(message)
    assert (len(found), found.dropped) == (0, {})
