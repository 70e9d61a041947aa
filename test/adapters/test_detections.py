# Copyright 2026 tsepm_ros developers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.
"""Detections in messages of every type but clouds: read, refused and written."""

import math
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import Point, Pose, PoseWithCovariance, Vector3
from sensor_msgs.msg import LaserScan
from std_msgs.msg import Header
from support import foreign_messages
from support import foreign_messages as foreign
from support.driver_messages import MAKERS, echoes_of

from msg_adapters import (
    MessageError,
    make_header,
    message_class,
    read_detections,
    write_detections,
)
from msg_adapters.detections import NO_TIMES, RAYS_AT_ONCE
from tsepm_ros import Scan, SensorModel
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
    return foreign.RadarScan(
        header=header, returns=[foreign.RadarReturn(**{**GOOD, **one}) for one in returns]
    )


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


STAMP = 1_700_000_000_123_456_789


def pose(x, y, z=0.0):
    return Pose(position=Point(x=x, y=y, z=z))


def result(score=0.5, at=(0.0, 0.0), covariance=None):
    covariance = np.zeros((6, 6)) if covariance is None else covariance
    return foreign.ObjectHypothesisWithPose(
        hypothesis=foreign.ObjectHypothesis(class_id="boat", score=score),
        pose=PoseWithCovariance(pose=pose(*at), covariance=np.ravel(covariance)),
    )


def detection(center=(0.0, 0.0), *results, size=(0.0, 0.0, 0.0), header=None):
    x, y, z = size
    box = foreign.BoundingBox3D(center=pose(*center), size=Vector3(x=x, y=y, z=z))
    return foreign.Detection3D(header=header or Header(), bbox=box, results=list(results))


def array(*detections, frame_id="sonar"):
    return foreign.Detection3DArray(
        header=make_header(STAMP, frame_id), detections=list(detections)
    )


def test_the_box_counts_before_the_pose_of_a_result_and_without_a_box_the_best():
    found = read_detections(array(detection((3.0, 4.0), result(at=(6.0, 8.0)))))
    assert found.scan.range[0] == pytest.approx(5.0)
    results = (result(0.2, (1.0, 0.0)), result(0.9, (6.0, 8.0)), result(NAN, (2.0, 0.0)))
    found = read_detections(array(detection((0.0, 0.0), *results)))
    assert found.scan.range[0] == pytest.approx(10.0)
    np.testing.assert_array_equal(found.scan.features["intensity"], [0.9])


def test_a_result_without_a_hypothesis_as_in_older_definitions_has_its_own_score():
    fields = {"id": str, "score": float, "pose": PoseWithCovariance}
    older = foreign.message_type("vision_msgs", "ObjectHypothesisWithPose", fields)
    results = (
        older(score=score, pose=PoseWithCovariance(pose=pose(*at)))
        for score, at in ((0.2, (1.0, 0.0)), (0.9, (6.0, 8.0)))
    )
    found = read_detections(array(detection((0.0, 0.0), *results)))
    assert found.scan.range[0] == pytest.approx(10.0)
    np.testing.assert_array_equal(found.scan.features["intensity"], [0.9])


@pytest.mark.parametrize("optical", [False, True])
def test_the_covariance_is_turned_along_and_across_the_line_of_sight(optical):
    angle, along, across = 0.6, 9.0, 4.0
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    plane = turn @ np.diag([along, across]) @ turn.T
    x, y = 100.0 * turn[:, 0]
    covariance = np.zeros((6, 6))
    if optical:  # x to starboard, z ahead
        covariance[np.ix_([2, 0], [2, 0])] = plane * [[1, -1], [-1, 1]]
        message = array(
            detection((-y, 0.0, x), result(covariance=covariance)), frame_id="a_optical"
        )
    else:
        covariance[:2, :2] = plane
        message = array(detection((x, y), result(covariance=covariance)))
    found = read_detections(message)
    assert found.scan.azimuth[0] == pytest.approx(angle)
    assert found.scan.range_std[0] == pytest.approx(3.0)
    assert found.scan.azimuth_std[0] == pytest.approx(2.0 / 100.0)


def test_covariances_that_only_some_have_are_not_used():
    known = detection((3.0, 4.0), result(covariance=np.eye(6)))
    for other in (detection((3.0, 4.0), result()), detection((3.0, 4.0))):
        assert read_detections(array(known, other)).scan.range_std is None
    assert read_detections(array(known, known)).scan.range_std is not None


def test_a_detection_may_have_a_time_of_its_own():
    own = Header(frame_id="sonar", stamp=make_header(STAMP + 250_000_000, "").stamp)
    found = read_detections(array(detection((3.0, 4.0), header=own), detection((3.0, 4.0))))
    np.testing.assert_array_equal(found.scan.time_offset, [0.25, 0.0])
    np.testing.assert_array_equal(found.sensor_scan.transmit_offset, found.scan.time_offset)


@pytest.mark.parametrize(
    ("bad", "reason"),
    [
        (detection((NAN, 1.0)), "range_not_finite"),
        (detection((INF, 1.0)), "range_not_finite"),
        (detection((1.7e308, 1.7e308)), "range_not_finite"),
        (detection((1e9, 0.0)), "range_too_large"),
        (detection((0.0, 0.0, 5.0)), "range_not_positive"),
        (detection(), "no_position"),
        (detection((1.0, 1.0), header=Header(frame_id="other")), "other_frame"),
        (detection((1.0, 1.0), header=make_header(1, "sonar")), "time_offset_too_large"),
    ],
)
@pytest.mark.filterwarnings("error")
def test_a_bad_detection_is_dropped_and_the_rest_kept(bad, reason):
    found = read_detections(array(detection((3.0, 4.0)), bad, detection((6.0, 8.0))))
    assert found.dropped == {reason: 1}
    np.testing.assert_allclose(found.scan.range, [5.0, 10.0])


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("value", [-1.0, NAN, INF])
def test_a_bad_covariance_drops_its_detection(value):
    good = detection((3.0, 4.0), result(covariance=np.eye(6)))
    bad = detection((3.0, 4.0), result(covariance=np.full((6, 6), value)))
    found = read_detections(array(good, bad))
    assert found.dropped == {"range_std_not_positive": 1}


KNOWN = foreign.PingInfo(sound_speed=1500.0)


def travel_times(times, rx_angles, **more):
    return foreign.SonarDetections(
        header=make_header(STAMP, "sonar"),
        two_way_travel_times=times,
        rx_angles=rx_angles,
        **{"ping_info": KNOWN, **more},
    )


def ranges(distances, vectors, **more):
    return foreign.SonarRanges(
        header=make_header(STAMP, "sonar"),
        ranges=distances,
        beam_unit_vec=[Vector3(x=float(x), y=float(y), z=float(z)) for x, y, z in vectors],
        **{"ping_info": KNOWN, **more},
    )


def flags(*values):
    return [foreign.DetectionFlag(flag=value) for value in values]


def test_times_follow_from_ranges_also_of_a_beam_that_looks_abaft():
    found = read_detections(ranges([100.0, 100.0], [(0, 0, -1), (0, 1, 0)]))
    np.testing.assert_allclose(np.abs(found.scan.azimuth), [math.pi, math.pi / 2])
    assert found.scan.azimuth[1] < 0
    message = ranges([1500.0, 3000.0], [(0, 0, 1)], transmit_delays=[0.5, 0.25])
    found = read_detections(message)
    np.testing.assert_array_equal(found.scan.time_offset, [1.5, 2.25])
    np.testing.assert_array_equal(found.sensor_scan.transmit_offset, [0.5, 0.25])


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


def test_rays_on_one_extent_are_of_one_group_by_their_step_and_the_sensor_s_noise():
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


START = 1_700_000_000

EVERY_TYPE = pytest.mark.parametrize("type_name", list(MAKERS))


@pytest.fixture
def _installed(monkeypatch):
    foreign_messages.install(monkeypatch)


def header_at(seconds: float, frame_id: str = "sonar") -> Any:
    return make_header(round(seconds * 1e9), frame_id)


def scan_of(range_: Any, azimuth: Any, **more: Any) -> Scan:
    return Scan(START, range_, azimuth, **more)


@EVERY_TYPE
@pytest.mark.usefixtures("_installed")
def test_a_written_message_is_read_back(type_name):
    echoes = echoes_of(3, clutter=200)
    range_, azimuth = np.array([(echo.range, echo.azimuth) for echo in echoes]).T
    message = write_detections(
        type_name, header_at(START), scan_of(range_, azimuth), sound_speed=1480.0
    )
    assert type(message) is message_class(type_name)
    found = read_detections(message)
    assert (found.sensor_scan.stamp_ns, found.sensor_scan.frame_id, found.dropped) == (
        START * 10**9,
        "sonar",
        {},
    )
    order, expected = np.argsort(found.scan.azimuth), np.argsort(azimuth)
    fineness = 2e-3 if type_name.endswith("LaserScan") else 1e-6  # rays are 0.01 degrees apart
    np.testing.assert_allclose(found.scan.azimuth[order], azimuth[expected], atol=fineness)
    np.testing.assert_allclose(np.sort(found.scan.range), np.sort(range_), rtol=1e-6)
    if found.scan.time_offset is not None:
        np.testing.assert_allclose(found.scan.time_offset, found.scan.range / 1480.0, rtol=1e-6)


@pytest.mark.usefixtures("_installed")
@EVERY_TYPE
def test_without_times_an_echo_is_of_range_over_sound_speed_where_that_is_given(type_name):
    message, numbers = MAKERS[type_name](header_at(START), echoes_of(0))
    unset, found = read_detections(message), read_detections(message, sound_speed=1450.0)
    np.testing.assert_array_equal(found.scan.range, unset.scan.range)
    given = "time_offset" in numbers
    height = 0.0 if found.sensor_scan.height is None else found.sensor_scan.height
    expected = numbers["time_offset"] if given else np.hypot(found.scan.range, height) / 1450.0
    np.testing.assert_allclose(found.scan.time_offset, expected, rtol=1e-6, atol=1e-9)
    assert (unset.scan.time_offset is None) == (not given)
    assert found.assumptions == ()


@pytest.mark.usefixtures("_installed")
@EVERY_TYPE
def test_features_are_written_where_the_type_has_a_place_for_them(type_name):
    features = {
        "intensity": np.array([7.0, 8.0]),
        "range_width": np.array([5.0, 6.0]),
        "azimuth_width": np.array([0.1, 0.2]),
        "range_rate": np.array([-2.5, 3.0]),
    }
    message = write_detections(
        type_name,
        header_at(START),
        scan_of(np.array([100.0, 200.0]), np.array([0.5, -0.5]), features=features),
        sound_speed=1500.0,
    )
    found = read_detections(message)
    assert len(found) == 2
    places = {"PointCloud2": set(features), "RadarScan": {"intensity", "range_rate"}}.get(
        type_name.rpartition("/")[2], set()
    )
    for name, values in features.items():
        if name in places:
            np.testing.assert_allclose(found.scan.features[name], values, rtol=1e-6)
        else:
            assert np.isnan(found.scan.features.get(name, np.nan)).all()


def written(name: str, range_: list[float], azimuth: list[float], sound_speed: float) -> Any:
    scan = scan_of(np.array(range_), np.array(azimuth))
    return write_detections(name, header_at(START), scan, sound_speed=sound_speed)


@pytest.mark.usefixtures("_installed")
@pytest.mark.parametrize("name", ["SonarDetections", "SonarRanges"])
def test_sonar_messages_cannot_be_written_without_a_sound_speed(name):
    with pytest.raises(ValueError, match="sound_speed"):
        written(f"marine_acoustic_msgs/msg/{name}", [1.0], [1.0], 0.0)


@pytest.mark.usefixtures("_installed")
def test_travel_times_are_written_for_what_is_ahead_only():
    azimuth = [0.5, 3.0, -0.5 + 2 * math.pi]
    name = "marine_acoustic_msgs/msg/SonarDetections"
    found = read_detections(written(name, [100.0, 200.0, 300.0], azimuth, 1500.0))
    np.testing.assert_allclose(found.scan.azimuth, [0.5, -0.5], atol=1e-6)


def test_detections_on_one_ray_are_written_beside_each_other():
    message = written("sensor_msgs/msg/LaserScan", [100.0, 200.0, 300.0], [0.5, 0.5, math.pi], 0.0)
    found = read_detections(message)
    np.testing.assert_array_equal(np.sort(found.scan.range), [100.0, 200.0, 300.0])


@pytest.mark.parametrize("unknown", [0.0, -1500.0, NAN, INF, 1e-38])
def test_an_unknown_sound_speed_is_the_parameter_s_and_said(unknown):
    info = foreign.PingInfo(sound_speed=unknown)
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
