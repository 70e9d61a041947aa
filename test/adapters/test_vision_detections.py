"""Detections in vision_msgs/Detection3DArray, on stand-ins with the fields of its files."""

import math

import numpy as np
import pytest
from geometry_msgs.msg import Point, Pose, PoseWithCovariance, Vector3
from std_msgs.msg import Header
from support.foreign_messages import (
    BoundingBox3D,
    Detection3D,
    Detection3DArray,
    ObjectHypothesis,
    ObjectHypothesisWithPose,
)

from msg_adapters import make_header, read_detections

NAN, INF = math.nan, math.inf
STAMP = 1_700_000_000_123_456_789


def pose(x, y, z=0.0):
    return Pose(position=Point(x=x, y=y, z=z))


def result(score=0.5, at=(0.0, 0.0), covariance=None):
    covariance = np.zeros((6, 6)) if covariance is None else covariance
    return ObjectHypothesisWithPose(
        hypothesis=ObjectHypothesis(class_id="boat", score=score),
        pose=PoseWithCovariance(pose=pose(*at), covariance=np.ravel(covariance)),
    )


def detection(center=(0.0, 0.0), *results, size=(0.0, 0.0, 0.0), header=None):
    x, y, z = size
    box = BoundingBox3D(center=pose(*center), size=Vector3(x=x, y=y, z=z))
    return Detection3D(header=header or Header(), bbox=box, results=list(results))


def array(*detections, frame_id="sonar"):
    return Detection3DArray(header=make_header(STAMP, frame_id), detections=list(detections))


def test_the_centre_of_the_box_is_the_place_in_the_horizontal_plane():
    found = read_detections(array(detection((3.0, 4.0, 50.0)), detection((0.0, -2.0))))
    assert (found.sensor_scan.stamp_ns, found.sensor_scan.frame_id, found.sensor_scan.axes) == (
        STAMP,
        "sonar",
        "body",
    )
    np.testing.assert_allclose(found.scan.range, [5.0, 2.0])
    np.testing.assert_array_equal(found.sensor_scan.height, [50.0, 0.0])
    np.testing.assert_allclose(found.scan.azimuth, [math.atan2(4, 3), -math.pi / 2])
    assert found.scan.range_std is found.scan.azimuth_std is found.scan.time_offset is None
    assert found.dropped == {}


def test_the_box_counts_before_the_pose_of_a_result():
    found = read_detections(array(detection((3.0, 4.0), result(at=(6.0, 8.0)))))
    assert found.scan.range[0] == pytest.approx(5.0)


def test_without_a_box_the_best_result_counts():
    results = (result(0.2, (1.0, 0.0)), result(0.9, (6.0, 8.0)), result(NAN, (2.0, 0.0)))
    found = read_detections(array(detection((0.0, 0.0), *results)))
    assert found.scan.range[0] == pytest.approx(10.0)
    np.testing.assert_array_equal(found.scan.features["intensity"], [0.9])


def test_an_optical_frame_looks_along_z_with_x_to_starboard():
    for name in ("camera_optical", "camera_optical_frame"):
        found = read_detections(array(detection((4.0, 9.0, 3.0)), frame_id=name))
        assert (found.scan.range[0], found.sensor_scan.axes) == (pytest.approx(5.0), "optical")
        assert found.scan.azimuth[0] == pytest.approx(-math.atan2(4, 3))
        assert found.sensor_scan.height[0] == -9.0


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


@pytest.mark.filterwarnings("error")
def test_an_array_without_detections_is_good():
    assert len(read_detections(array())) == 0
