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
"""From arriving messages to a session: what is read, dropped and counted, and said."""

import math

import numpy as np
import pytest
from nav_msgs.msg import OccupancyGrid
from support.foreign_messages import PingInfo, SonarDetections
from support.raw_cloud import raw_cloud
from support.sessions import moving, session

from msg_adapters import detections_cloud, make_header, odometry_message
from msg_adapters.message_input import MessageInput
from tsepm_ros.own_ship.pose_history import PoseSample
from tsepm_ros.settings.node_options import InitiatorNodeOptions

FIELDS = [("range", "d"), ("azimuth", "d")]


@pytest.fixture
def one():
    return session()


def test_detections_become_a_scan_and_bad_ones_are_counted(one):
    given = MessageInput(one, InitiatorNodeOptions())
    given.take_detections(raw_cloud(FIELDS, [(2000.0, 0.5), (-1.0, 0.0)]), 0.0)
    (result,) = one.process(last=True)
    assert result.scan.range.tolist() == [2000.0]
    assert one.dropped == {"range_not_positive": 1}


def test_options_may_be_replaced_between_messages(one):
    given = MessageInput(one, InitiatorNodeOptions())
    given.options = InitiatorNodeOptions(sound_speed=1000.0)
    header = make_header(10**9, "sonar")
    given.take_detections(detections_cloud(header, range=[2000.0], azimuth=[0.0]), 0.0)
    (result,) = one.process(last=True)
    assert result.scan.time_offset.tolist() == [2.0]


def test_an_assumption_about_a_message_is_said(one):
    said = []
    given = MessageInput(one, InitiatorNodeOptions(), said.append)
    header = make_header(10**9, "sonar")
    unknown = SonarDetections(
        header=header, ping_info=PingInfo(), two_way_travel_times=[2.0], rx_angles=[0.0]
    )
    given.take_detections(unknown, 0.0)
    assert any("no sound speed" in sentence for sentence in said)


def test_a_message_that_cannot_be_used_is_counted_under_the_reason_of_its_topic(one):
    given = MessageInput(one, InitiatorNodeOptions())
    cloud = raw_cloud([("x", "d")], [(1.0,)])
    given.take_detections(cloud, 0.0)
    given.take_tracked(cloud)
    lying = PoseSample(1.0, 0.0, 0.0, 0.0, frame_id="odom")
    odometry = odometry_message(lying)
    odometry.pose.pose.position.x = math.nan
    given.take_own_ship(odometry)
    given.take_land(OccupancyGrid(data=[100]))
    assert sum(one.dropped.values()) == 4
    assert one.dropped["missing_field"] == one.dropped["tracked_missing_field"] == 1
    assert one.dropped["own_ship_invalid"] == 1
    assert list(one.process(last=True)) == []


def test_odometry_places_the_scans_after_it():
    one = moving()
    given = MessageInput(one, InitiatorNodeOptions())
    for stamp in (0.0, 1.0, 2.0):
        given.take_own_ship(odometry_message(PoseSample(stamp, 50.0, 20.0, 0.0, frame_id="odom")))
    header = make_header(10**9, "base_link")
    given.take_detections(detections_cloud(header, range=[2000.0], azimuth=[0.0]), 0.0)
    (result,) = one.process(last=True)
    np.testing.assert_allclose(np.ravel(result.scan.sensor_pose)[:2], [50.0, 20.0])
