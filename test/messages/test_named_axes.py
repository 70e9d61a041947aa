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
"""Frames whose names state other axes (REP-103): odometry, mounting, and every type of detections.

Positions are worked out on the chart, in east and north; SciPy gives the rotations.
"""

import math

import numpy as np
import pytest
from nav_msgs.msg import Odometry
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import LaserScan
from support import foreign_messages as foreign
from support.raw_cloud import raw_cloud
from support.registered import places

from msg_adapters import MessageError, make_header, read_detections, read_own_ship
from tsepm_ros.own_ship.registration import Mounting, registration_axes, registration_frame
from tsepm_ros.session.session import Session
from tsepm_ros.settings.node_options import SessionOptions
from tsepm_ros.settings.settings import Settings

STAMP_NS = 1_700_000_000_123_456_789
AHEAD, PORT, UP = 900.0, 300.0, 40.0
VESSEL = np.array([300.0, -400.0])
NAMES = {
    "sonar": ("body", "sonar"),
    "sonar_frd": ("down", "sonar"),
    "map_ned": ("down", "map"),
    "world_NED": ("down", "world"),
    "boat/base_link_ned": ("down", "boat/base_link"),
    "boat/ned": ("down", "boat"),
    "sonar_optical": ("optical", "sonar"),
    "camera_depth_optical_frame": ("optical", "camera_depth_frame"),
    "ned": ("down", "level"),
    "planned": ("body", "planned"),
    "optical_bench": ("body", "optical_bench"),
    "nedframe": ("body", "nedframe"),
    "": ("body", "level"),
}
IN_AXES = {
    "sonar": (AHEAD, PORT, UP),
    "sonar_frd": (AHEAD, -PORT, -UP),
    "sonar_ned": (AHEAD, -PORT, -UP),
    "sonar_optical_frame": (-PORT, -UP, AHEAD),
}
"""x, y and z of one place by the frame's name."""


@pytest.mark.parametrize("name", NAMES)
def test_a_suffix_states_the_axes_and_belongs_to_a_frame_without(name):
    assert (registration_axes(name), registration_frame(name)) == NAMES[name]


def cloud(frame, x, y, z):
    return raw_cloud([("x", "f"), ("y", "f"), ("z", "f")], [(x, y, z)], frame_id=frame)


def boxes(frame, x, y, z):
    one = foreign.Detection3D(bbox=foreign.BoundingBox3D())
    at = one.bbox.center.position
    at.x, at.y, at.z = x, y, z
    return foreign.Detection3DArray(header=make_header(STAMP_NS, frame), detections=[one])


def laser_scan(frame, x, y, z):
    angle = math.atan2(y, x)
    scan = LaserScan(header=make_header(STAMP_NS, frame), angle_min=angle, angle_increment=0.1)
    scan.ranges, scan.range_max = [math.hypot(x, y)], 1e4
    return scan


def radar_scan(frame, x, y, z):
    echo = foreign.RadarReturn()
    echo.range, echo.azimuth = math.sqrt(x * x + y * y + z * z), math.atan2(y, x)
    echo.elevation = math.atan2(z, math.hypot(x, y))
    return foreign.RadarScan(header=make_header(STAMP_NS, frame), returns=[echo])


MAKERS = {make.__name__: make for make in (cloud, boxes, laser_scan, radar_scan)}


@pytest.mark.parametrize("frame", IN_AXES)
@pytest.mark.parametrize("make", MAKERS)
def test_a_place_is_ahead_and_to_port_in_whatever_axes_it_is_given(make, frame):
    message = MAKERS[make](frame, *IN_AXES[frame])
    if "optical" in frame and make in ("laser_scan", "radar_scan"):
        with pytest.raises(MessageError, match="z ahead by its name") as error:
            read_detections(message)
        assert error.value.reason == "frame_axes"
        return
    found = read_detections(message).sensor_scan
    np.testing.assert_allclose(found.scan.range, [math.hypot(AHEAD, PORT)], rtol=1e-6)
    np.testing.assert_allclose(found.scan.azimuth, [math.atan2(PORT, AHEAD)], rtol=1e-5)
    if make == "laser_scan":
        assert found.beams.middle == pytest.approx(math.atan2(PORT, AHEAD), rel=1e-5)
    else:
        np.testing.assert_allclose(found.height, [UP], rtol=1e-3)
    assert found.axes == registration_axes(frame)


def test_angles_keep_their_sense_in_other_axes_and_a_flat_cloud_in_an_optical_frame_is_refused():
    flat = raw_cloud([("x", "f"), ("y", "f")], [(1.0, 2.0)], frame_id="camera_optical_frame")
    with pytest.raises(MessageError, match="'z' is needed"):
        read_detections(flat)
    for angle, value in (("azimuth", 0.5), ("bearing", -0.5)):
        message = raw_cloud([("range", "d"), (angle, "d")], [(900.0, value)], frame_id="sonar_frd")
        found = read_detections(message, sound_speed=1500.0)
        assert found.scan.azimuth.tolist() == [0.5]
        assert "states other axes" in " ".join(found.assumptions)


TO_NED = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
TO_FRD = np.diag([1.0, -1.0, -1.0])


def odometry(attitude, *, ned, frd, frame=None, child=None, vessel=VESSEL, stamp=0.0):
    """Odometry of a vessel on the chart whose axes ahead, port and up are turned by `attitude`."""
    world, body = (TO_NED if ned else np.eye(3)), (TO_FRD if frd else np.eye(3))
    message = Odometry(child_frame_id=child or ("base_link_frd" if frd else "base_link"))
    frame = frame or ("odom_ned" if ned else "odom")
    message.header = make_header(STAMP_NS + round(stamp * 1e9), frame)
    place = world @ [*vessel, 5.0]
    at = message.pose.pose.position
    at.x, at.y, at.z = place.tolist()
    rotation = Rotation.from_matrix(world @ attitude.as_matrix() @ body)
    q = message.pose.pose.orientation
    q.x, q.y, q.z, q.w = rotation.as_quat().tolist()
    twist = message.twist.twist
    for vector, values in ((twist.linear, [4.0, 0.5, 0.1]), (twist.angular, [0.01, 0.02, 0.3])):
        vector.x, vector.y, vector.z = (body @ values).tolist()
    block, pose = np.zeros((6, 6)), np.array([[4, 1, 0.2], [1, 9, 0.3], [0.2, 0.3, 1]])
    block[np.ix_([0, 1, 5], [0, 1, 5])] = world @ pose @ world.T
    message.pose.covariance = block.ravel()
    return message


@pytest.mark.parametrize("angles", [(0.7, 0.0, 0.0), (2.0, 0.1, -0.2), (-1.0, -0.2, 0.3)])
@pytest.mark.parametrize(("ned", "frd"), [(True, True), (True, False), (False, True)])
def test_a_pose_is_the_same_in_whatever_axes_the_odometry_is(angles, ned, frd):
    attitude = Rotation.from_euler("ZYX", angles)
    expected = read_own_ship(odometry(attitude, ned=False, frd=False))
    found = read_own_ship(odometry(attitude, ned=ned, frd=frd))
    for name in ("x", "y", "yaw", "roll", "pitch", "rates", "covariance"):
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), atol=1e-12)
    assert (found.yaw, found.pitch, found.roll) == pytest.approx(angles)


@pytest.mark.parametrize("child", ["base_link", ""])
@pytest.mark.parametrize("frd", [True, False])
def test_a_vessel_in_a_ned_frame_is_upright_if_its_own_frame_states_no_axes(child, frd):
    attitude = Rotation.from_euler("ZYX", (0.7, 0.1, 0.2))
    message = odometry(attitude, ned=True, frd=frd, child="x")
    message.child_frame_id = child
    found = read_own_ship(message)
    assert (found.yaw, found.pitch, found.roll) == pytest.approx((0.7, 0.1, 0.2))


def test_odometry_without_a_frame_is_in_the_axes_of_the_fixed_frame():
    message = odometry(Rotation.identity(), ned=True, frd=True)
    message.header.frame_id = ""
    assert read_own_ship(message, "map_ned").x == pytest.approx(VESSEL[0])


def test_odometry_in_an_optical_frame_is_refused_with_the_remedy():
    message = odometry(Rotation.identity(), ned=False, frd=False, frame="map_optical")
    with pytest.raises(MessageError, match="use a frame such as 'map'"):
        read_own_ship(message)
    with pytest.raises(ValueError, match="use a frame such as 'map'"):
        SessionOptions(fixed_frame="map_optical")


LEVEL = Rotation.identity()


def poses(attitude=LEVEL, *, ned=False, **frames):
    """Odometry of a vessel that stands still, with axes of its own and the frame's as told."""
    return [odometry(attitude, ned=ned, frd=ned, stamp=at, **frames) for at in (-1.0, 20.0)]


def placed(message, own_ship, *, reference="bow", mounting=None, **options):
    """The session's result for a message, its positions on the chart, and what was said."""
    said: dict[str, str] = {}
    source = {"own_ship_source": "odometry", "own_ship_max_gap": 60.0} if own_ship else {}
    settings = Settings(SessionOptions(**source, **options), mounting=mounting or Mounting())
    session = Session(settings, said.setdefault)
    for one in own_ship:
        session.add_own_ship(read_own_ship(one))
    session.add_scan(read_detections(message, bearing_reference=reference).sensor_scan, 0.0)
    (result,) = session.process()
    assert session.dropped == {}
    return result, places(result.scan), said


def test_bearings_from_north_and_tracks_of_a_ned_frame_count_from_its_x_axis():
    bearing = math.radians(30.0)
    message = raw_cloud([("range", "d"), ("bearing", "d")], [(1000.0, bearing)])
    result, (at,), said = placed(message, poses(ned=True), reference="north")
    np.testing.assert_allclose(at, VESSEL + np.array([500.0, 1000.0 * math.cos(bearing)]))
    assert result.frame_id == "odom_ned"
    assert "x north and y east" in said["fixed_frame"]


@pytest.mark.parametrize("fixed_frame", ["", "sonar", "sonar_frd"])
def test_a_sensor_at_rest_with_other_axes_has_its_tracks_in_a_frame_that_is_said(fixed_frame):
    result, (at,), said = placed(
        cloud("sonar_frd", *IN_AXES["sonar_frd"]), [], fixed_frame=fixed_frame
    )
    assert result.frame_id == (fixed_frame or "sonar")
    assert "fixed_frame" in said
    # In sonar_frd x is ahead: tracks are turned to east and north inside, and back at the output.
    expected = [-PORT, AHEAD] if fixed_frame == "sonar_frd" else [AHEAD, PORT]
    np.testing.assert_allclose(at, expected, rtol=1e-6)


def test_a_mounting_is_to_port_and_counter_clockwise_in_a_frame_with_z_down_and_that_is_said():
    given = poses(Rotation.from_euler("z", math.pi / 2), ned=True)  # heads north
    message = cloud("sonar", 900.0, 0.0, 0.0)
    _, (at,), said = placed(message, given, mounting=Mounting(y=5.0, yaw=math.pi / 2))
    np.testing.assert_allclose(at, VESSEL + np.array([-905.0, 0.0]), atol=1e-4)
    assert "to port" in said["mounting"] and "base_link_frd" in said["mounting"]


@pytest.mark.parametrize("angles", [(0.7, 0.0, 0.0), (2.0, 0.1, -0.2)])
@pytest.mark.parametrize("yaw", [0.0, 1.2])
def test_a_sonar_that_hangs_upside_down_has_a_mounting_roll(angles, yaw):
    attitude = Rotation.from_euler("ZYX", angles)
    mounting = Mounting(yaw=yaw, roll=math.pi)
    _, (at,), said = placed(cloud("sonar", AHEAD, PORT, UP), poses(attitude), mounting=mounting)
    mounted = attitude * Rotation.from_euler("ZYX", (yaw, 0.0, math.pi))
    np.testing.assert_allclose(at, VESSEL + mounted.apply([AHEAD, PORT, UP])[:2], rtol=1e-5)
    assert said == {} or "mounting" not in said


def test_frames_that_differ_by_axes_or_a_leading_slash_alone_coincide():
    _, _, said = placed(cloud("/sonar", 900.0, 0.0, 0.0), poses(ned=True, child="sonar_frd"))
    assert "mounting" not in said
    given = poses(frame="/odom", child="/sonar")
    for name, frames in (
        ("/sonar", {"fixed_frame": "odom", "sensor_frame": "/sonar"}),
        ("sonar", {"fixed_frame": "/odom"}),
    ):
        result, _, said = placed(cloud(name, 900.0, 0.0, 0.0), given, **frames)
        assert (result.frame_id, said) == ("odom", {})
