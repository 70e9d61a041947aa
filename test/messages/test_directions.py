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
"""Where a detection ends up in the fixed frame: from messages and odometry, through a session.

What is expected is worked out on the chart: ahead, starboard, astern and port of a vessel that
heads east, north, west and south; tilted ones by SciPy's rotations.
"""

import math

import numpy as np
import pytest
from nav_msgs.msg import Odometry
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import LaserScan
from support.driver_messages import MAKERS, Echo
from support.foreign_messages import PingInfo, SonarDetections
from support.raw_cloud import raw_cloud
from support.registered import places

from msg_adapters import make_header, read_detections, read_own_ship
from tsepm_ros.own_ship.registration import Mounting
from tsepm_ros.session.session import Session
from tsepm_ros.settings.node_options import SessionOptions
from tsepm_ros.settings.settings import Settings

STAMP_NS = 1_700_000_000_123_456_789
VESSEL = np.array([300.0, -400.0])
RANGE = 1000.0

HEADINGS = {"east": (1.0, 0.0), "north": (0.0, 1.0), "west": (-1.0, 0.0), "south": (0.0, -1.0)}
QUARTERS = {"ahead": 0.0, "starboard": 90.0, "astern": 180.0, "port": 270.0}
"""Degrees clockwise from the bow, as on board."""


def odometry(seconds: float, attitude: Rotation) -> Odometry:
    message = Odometry(child_frame_id="sonar")
    message.header = make_header(STAMP_NS + round(seconds * 1e9), "odom")
    message.pose.pose.position.x, message.pose.pose.position.y = VESSEL.tolist()
    for name, value in zip("xyzw", attitude.as_quat().tolist(), strict=True):
        setattr(message.pose.pose.orientation, name, value)
    return message


def heading_of(name: str) -> Rotation:
    east, north = HEADINGS[name]
    return Rotation.from_euler("z", math.atan2(north, east))


def place(message, attitude: Rotation, *, reference="bow", mounting=None) -> np.ndarray:
    """Positions of the message's detections in the fixed frame, (n, 2)."""
    settings = Settings(
        SessionOptions(own_ship_source="odometry", own_ship_max_gap=60.0),
        mounting=mounting or Mounting(),
    )
    session = Session(settings)
    for seconds in (-1.0, 20.0):
        session.add_own_ship(read_own_ship(odometry(seconds, attitude)))
    session.add_scan(read_detections(message, bearing_reference=reference).sensor_scan, 0.0)
    (result,) = session.process()
    assert session.dropped == {}
    return places(result.scan)


def azimuth_cloud(clockwise: float, _: float):
    return raw_cloud([("range", "d"), ("azimuth", "d")], [(RANGE, -math.radians(clockwise))])


def bow_cloud(clockwise: float, _: float):
    return raw_cloud([("range", "d"), ("bearing", "d")], [(RANGE, math.radians(clockwise))])


def north_cloud(clockwise: float, compass: float):
    bearing = math.radians(compass + clockwise)
    return raw_cloud([("range", "d"), ("bearing", "d")], [(RANGE, bearing)])


def xyz_cloud(clockwise: float, _: float):
    angle = math.radians(clockwise)
    row = (RANGE * math.cos(angle), -RANGE * math.sin(angle), -70.0)
    return raw_cloud([("x", "d"), ("y", "d"), ("z", "d")], [row])


def laser_scan(clockwise: float, _: float):
    rays = {180.0: 0, 90.0: 1, 0.0: 2, 270.0: 3}  # counter-clockwise from astern
    return LaserScan(
        header=make_header(STAMP_NS, "sonar"),
        angle_min=-math.pi,
        angle_max=math.pi / 2,
        angle_increment=math.pi / 2,
        range_max=1e4,
        ranges=[RANGE if ray == rays[clockwise] else math.inf for ray in range(4)],
    )


def sonar_detections(clockwise: float, _: float):
    starboard = math.remainder(clockwise, 360.0)
    return SonarDetections(
        header=make_header(STAMP_NS, "sonar"),
        ping_info=PingInfo(sound_speed=1500.0),
        two_way_travel_times=[2.0 * RANGE / 1500.0],
        rx_angles=[math.radians(starboard)],
    )


FORMS = {
    "PointCloud2 azimuth": (azimuth_cloud, "bow"),
    "PointCloud2 bearing from the bow": (bow_cloud, "bow"),
    "PointCloud2 bearing from north": (north_cloud, "north"),
    "PointCloud2 x y z": (xyz_cloud, "bow"),
    "LaserScan": (laser_scan, "bow"),
    "SonarDetections": (sonar_detections, "bow"),
}


def on_the_chart(heading: str, quarter: str) -> np.ndarray:
    """Unit vector east and north of a quarter of the vessel."""
    ahead = np.array(HEADINGS[heading])
    starboard = np.array([ahead[1], -ahead[0]])
    return {"ahead": ahead, "starboard": starboard, "astern": -ahead, "port": -starboard}[quarter]


COMPASS = {"north": 0.0, "east": 90.0, "south": 180.0, "west": 270.0}


CASES = [
    (form, quarter)
    for form in FORMS
    for quarter in QUARTERS
    if (form, quarter) != ("SonarDetections", "astern")  # its angles reach from abeam to abeam
]


@pytest.mark.parametrize("heading", HEADINGS)
@pytest.mark.parametrize(("form", "quarter"), CASES)
def test_a_quarter_of_the_vessel_is_a_direction_on_the_chart(form, quarter, heading):
    make, reference = FORMS[form]
    message = make(QUARTERS[quarter], COMPASS[heading])
    (found,) = place(message, heading_of(heading), reference=reference)
    expected = VESSEL + RANGE * on_the_chart(heading, quarter)
    np.testing.assert_allclose(found, expected, atol=1e-3)  # angles are float32 in two types


TURNS = {"ahead": 0.0, "port": math.pi / 2, "astern": math.pi, "starboard": -math.pi / 2}


@pytest.mark.parametrize("heading", HEADINGS)
@pytest.mark.parametrize("looks", TURNS)
@pytest.mark.parametrize("form", FORMS)
def test_a_mounted_sensor_looks_where_its_mounting_says(form, looks, heading):
    make, reference = FORMS[form]
    mounting = Mounting(x=10.0, y=-4.0, yaw=TURNS[looks])
    message = make(0.0, COMPASS[heading])
    (found,) = place(message, heading_of(heading), reference=reference, mounting=mounting)
    ahead, port = on_the_chart(heading, "ahead"), on_the_chart(heading, "port")
    direction = ahead if reference == "north" else on_the_chart(heading, looks)
    expected = VESSEL + 10.0 * ahead - 4.0 * port + RANGE * direction
    np.testing.assert_allclose(found, expected, atol=1e-3)


ECHOES = [
    Echo(900.0, 0.7, -0.3),
    Echo(2500.0, -1.2, 0.1),
    Echo(400.0, 0.1, 0.4),
    Echo(3000.0, 1.3, 0.0),
]
ATTITUDES = {
    "level": (0.6, 0.0, 0.0),
    "roll": (0.6, 0.0, 0.3),
    "pitch": (-2.0, -0.2, 0.0),
    "both": (2.9, 0.15, -0.4),
}
WITH_ELEVATION = [name for name in MAKERS if not name.endswith("LaserScan")]


@pytest.mark.parametrize("attitude", ATTITUDES)
@pytest.mark.parametrize("type_name", WITH_ELEVATION)
def test_every_type_with_elevation_is_placed_by_the_full_attitude(type_name, attitude):
    rotation = Rotation.from_euler("ZYX", ATTITUDES[attitude])
    message, _ = MAKERS[type_name](make_header(STAMP_NS, "sonar"), ECHOES)
    found = place(message, rotation)
    range_, azimuth, elevation = np.array(ECHOES).T
    level = [range_ * np.cos(azimuth), range_ * np.sin(azimuth), range_ * np.tan(elevation)]
    expected = VESSEL + rotation.apply(np.stack(level, axis=1))[:, :2]
    np.testing.assert_allclose(found, expected, atol=2e-3)


def test_a_laser_scan_is_in_its_frame_s_plane_and_bearings_from_north_are_level():
    rotation = Rotation.from_euler("ZYX", ATTITUDES["both"])
    for quarter, (x, y) in {"ahead": (1, 0), "port": (0, 1), "starboard": (0, -1)}.items():
        (found,) = place(laser_scan(QUARTERS[quarter], 0.0), rotation)
        expected = VESSEL + RANGE * rotation.apply([x, y, 0.0])[:2]
        np.testing.assert_allclose(found, expected, atol=1e-3)
    rotation = Rotation.from_euler("ZYX", ATTITUDES["both"])
    (found,) = place(north_cloud(0.0, 90.0), rotation, reference="north")
    np.testing.assert_allclose(found, VESSEL + np.array([RANGE, 0.0]), atol=1e-9)
