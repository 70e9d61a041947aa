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
"""Poses from tf: the whole rotation of the sensor's frame, once; and mountings beside odometry."""

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from nav_msgs.msg import Odometry
from scipy.spatial.transform import Rotation
from support.boat import Boat
from support.driver_messages import MAKERS, Echo
from support.image_messages import projected, raw
from support.sonar_driver import START_NS, Ping, cloud, points
from support.transforms import Transforms, level

from msg_adapters import MessageError, detections_cloud, make_header, read_detections
from msg_adapters.image_messages import read_image
from msg_adapters.sonar_images import detection_fields
from tsepm_ros.nodes.tf_own_ship import tf_look_up, tf_own_ship
from tsepm_ros.own_ship.registration import AXES
from tsepm_ros.session.session import Session
from tsepm_ros.settings.node_options import ImageLayout, SessionOptions
from tsepm_ros.settings.settings import Settings
from tsepm_ros.tracker.scan import Scan
from tsepm_ros.tracker.sensor import Coverage

START = START_NS * 1e-9
SENSOR = np.array([10.0, 20.0])


def turning(begin: Rotation, rate: tuple[float, ...] = (0.0, 0.0, 0.0)) -> Transforms:
    """A frame that turns at a constant rate about some axis."""

    def pose(seconds: float) -> tuple[Any, list[float]]:
        return SENSOR, (begin * Rotation.from_rotvec(np.array(rate) * seconds)).as_quat().tolist()

    return Transforms(pose)


def session_with(buffer: Any) -> Session:
    session = Session(Settings(SessionOptions(own_ship_source="tf", fixed_frame="map")))
    session.own_ship.look_up = tf_look_up(None, session, buffer)
    return session


def placed(message: Any, buffer: Any) -> np.ndarray:
    session = session_with(buffer)
    session.add_scan(read_detections(message).sensor_scan, 0.0)
    (result,) = session.process()
    assert session.dropped == {}
    scan = result.scan
    pose = np.broadcast_to(scan.sensor_pose, (len(scan), 3))
    angle = scan.azimuth + pose[:, 2]
    return pose[:, :2] + scan.range[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)


BODY = np.array([[900.0, 300.0, -200.0], [-500.0, 700.0, 100.0], [40.0, -60.0, 5.0]])
"""Places: ahead, port, up of the sensor."""
HEADER = make_header(START_NS, "sonar")
ECHOES = [
    Echo(math.hypot(x, y), math.atan2(y, x), math.atan2(z, math.hypot(x, y))) for x, y, z in BODY
]


def vectors(axes: np.ndarray, frame_id: str) -> Any:
    columns = dict(zip("xyz", (BODY @ axes).T.tolist(), strict=True))
    return cloud(START_NS, columns, frame_id=frame_id), axes


LEVEL = np.eye(3)
OPTICAL = np.array([[0, 0, 1], [-1, 0, 0], [0, -1, 0]])
LOOKS_UP = np.array([[0, 0, 1], [0, -1, 0], [1, 0, 0]])
FRAMES = {
    "PointCloud2": vectors(LEVEL, "sonar"),
    "PointCloud2 of a camera": vectors(OPTICAL, "camera_optical"),
    "SonarRanges": (MAKERS["marine_acoustic_msgs/msg/SonarRanges"](HEADER, ECHOES)[0], LOOKS_UP),
    "Detection3DArray": (MAKERS["vision_msgs/msg/Detection3DArray"](HEADER, ECHOES)[0], LEVEL),
}
"""Messages, and axes: columns are the frame's x, y, z in ahead, port, up."""
TILTS = {
    "level": (0.7, 0.0, 0.0),
    "roll": (0.7, 0.0, 0.35),
    "pitch": (-2.0, -0.3, 0.0),
    "both": (2.5, 0.2, -0.5),
    "upside down": (1.0, 0.1, 3.1),
}


@pytest.mark.parametrize("tilt", TILTS)
@pytest.mark.parametrize("frame", FRAMES)
def test_vectors_are_turned_by_the_frame_s_whole_rotation_once(frame, tilt):
    message, axes = FRAMES[frame]
    board = Rotation.from_euler("ZYX", TILTS[tilt])
    found = placed(message, turning(board * Rotation.from_matrix(axes)))
    # The message has vectors in the frame's own axes, which tf turns into those of the map.
    expected = SENSOR + board.apply(BODY)[:, :2]
    np.testing.assert_allclose(found, expected, atol=1e-3)


def test_echoes_take_the_attitude_of_their_arrival():
    buffer = turning(Rotation.from_euler("ZYX", [0.3, 0.1, 0.2]), (0.4, -0.1, 0.02))
    slant = 1500.0 * np.array([0.5, 1.0, 2.0])
    azimuth, elevation = np.array([0.2, 1.4, -2.0]), np.array([0.1, -0.3, 0.2])
    columns = {"range": slant, "azimuth": azimuth, "elevation": elevation}
    message = cloud(START_NS, {**columns, "time_offset": slant / 1500.0})
    level = slant * np.cos(elevation)
    echoes = np.stack([level * np.cos(azimuth), level * np.sin(azimuth), slant * np.sin(elevation)])
    expected = [
        SENSOR + Rotation.from_quat(buffer.pose(2.0 * r / 1500.0)[1]).apply(echo)[:2]
        for r, echo in zip(slant, echoes.T, strict=True)
    ]
    # Angles are interpolated over 0.2 s, in which the frame turns by 5 degrees.
    np.testing.assert_allclose(placed(message, buffer), expected, atol=1.5)


@pytest.mark.parametrize(
    ("rotation", "axes"),
    [([0.0, 0.0, 0.0, 0.0], "body"), ([0.0, 0.0, 0.0, 1.0], "sonar")],
    ids=["nothing", "forward axis points up"],
)
def test_a_rotation_that_gives_no_heading_places_nothing(rotation, axes):
    session = session_with(Transforms(lambda _: ((0.0, 0.0), rotation)))
    session.own_ship.look_up("sonar", START, START + 0.1, axes)
    assert session.own_ship.poses.last_stamp is None
    assert set(session.dropped) == {"own_ship_invalid"}


def test_the_node_uses_roll_pitch_and_the_mounting(world):
    turned = math.pi / 2
    boat = Boat(
        world,
        own_ship_source="odometry",
        own_ship_max_gap=100.0,
        mounting__x=30.0,
        mounting__y=5.0,
        mounting__yaw=turned,
    )
    attitude = Rotation.from_euler("ZYX", [0.4, 0.1, -0.3])
    for seconds in (-1, 70):
        message = Odometry(child_frame_id="base_link")
        message.header = make_header(START_NS + seconds * 10**9, "odom")
        for name, value in zip("xyzw", attitude.as_quat().tolist(), strict=True):
            setattr(message.pose.pose.orientation, name, value)
        boat.driver.odometry.publish(message)
    sent = [Ping(START_NS + 12 * 10**9 * index, [3000.0], [0.2]) for index in range(6)]
    received = boat.send(sent, elevation=[0.15])
    [point] = [point for message in received for point in points(message)]
    direction = Rotation.from_euler("z", turned + 0.2).apply([math.cos(0.15), 0.0, math.sin(0.15)])
    x, y, _ = attitude.apply([30.0, 5.0, 0.0] + 3000.0 * direction)
    assert math.hypot(point["x"] - x, point["y"] - y) < 2.0
    assert world.dropped() == {}


@pytest.mark.parametrize("message", [raw(), projected()], ids=["raw", "projected"])
def test_an_echo_of_a_head_that_looks_down_lies_ahead_of_it(message):
    """The frame of these images has z ahead: their detections say so, and the background knows."""
    ping = read_image(message, ImageLayout(), Coverage())
    scan = Scan(1e-9 * ping.stamp_ns, range=[20.0], azimuth=[0.25])
    fields = detection_fields(ping, scan)
    head = Rotation.from_euler("ZYX", [0.3, 0.4, 0.0])
    turn = (head * Rotation.from_matrix(AXES["sonar"])).as_quat().tolist()
    buffer = Transforms(lambda _: (SENSOR, turn))
    found = placed(detections_cloud(make_header(ping.stamp_ns, "sonar"), **fields), buffer)
    place = SENSOR + head.apply([20.0 * math.cos(0.25), 20.0 * math.sin(0.25), 0.0])[:2]
    np.testing.assert_allclose(found, [place], atol=1e-6)
    sample = tf_own_ship(buffer, "map", "sonar", 1e-9 * ping.stamp_ns, ping.axes)
    assert (sample.yaw, sample.pitch, sample.roll) == pytest.approx((0.3, 0.4, 0.0))


def test_a_vessel_of_which_tf_has_no_later_pose_is_where_it_was_last():
    buffer = Transforms(lambda seconds: level(2.0 * seconds, 5.0, 0.5), first=0.0, last=10.0)
    for asked, known in ((12.0, 10.0), (4.0, 4.0)):
        sample = tf_own_ship(buffer, "map", "base_link", START + asked)
        assert sample.stamp == pytest.approx(START + known)
        assert (sample.x, sample.y, sample.yaw) == pytest.approx((2.0 * known, 5.0, 0.5))
    named = dataclasses.replace(buffer, frames=("map", "base_link"))
    assert tf_own_ship(named, "/map", "/base_link", START + 4.0).x == pytest.approx(8.0)
    with pytest.raises(MessageError, match="tf has no transform from 'buoy' to 'map'"):
        tf_own_ship(dataclasses.replace(buffer, frames=("map", "a")), "map", "buoy", START)
