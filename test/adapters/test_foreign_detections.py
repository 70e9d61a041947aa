"""Detections of packages beside ROS, on stand-ins with the fields of their files."""

import math

import numpy as np
import pytest
from geometry_msgs.msg import Point, Pose, PoseWithCovariance, Vector3
from std_msgs.msg import Header
from support import foreign_messages as foreign

from msg_adapters import MessageError, make_header, read_detections
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
