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
"""Readers by type, refused types, and conversions that all readers share."""

import math
import pickle
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import Point
from std_msgs.msg import String
from support import foreign_messages

from msg_adapters import (
    MessageError,
    detections,
    make_header,
    read_detections,
    supported_types,
)
from msg_adapters.ping import (
    ReadingOptions,
    azimuth_of_bearing,
    fitted_to_ping,
    good_detections,
    intensity_feature,
    ping_along_axes,
    ping_in_plane,
    stated_sound_speed,
    turn_about_z,
)
from msg_adapters.stamps import time_to_ns

START = 1_700_000_000


def header_at(seconds: float, frame_id: str = "sonar") -> Any:
    return make_header(round(seconds * 1e9), frame_id)


def test_a_type_that_has_changed_is_refused_by_the_name_of_its_field():
    radar = foreign_messages.RadarScan(header=header_at(START), returns=[Point()])
    with pytest.raises(MessageError, match=r"radar_msgs/msg/RadarScan .*at range;") as error:
        read_detections(radar)
    assert error.value.reason == "unknown_version"


def test_a_field_that_has_another_kind_of_value_is_of_another_version():
    radar = foreign_messages.RadarScan(header=header_at(START), returns=None)
    with pytest.raises(MessageError, match="another kind") as error:
        read_detections(radar)
    assert error.value.reason == "unknown_version"
    assert "object" not in str(error.value), "not the inside of the program"


def test_an_unknown_type_is_refused_with_the_known_ones_by_an_error_that_survives_pickling():
    with pytest.raises(MessageError) as error:
        read_detections(String())
    assert error.value.reason == "unknown_type"
    assert "'std_msgs/msg/String' is not supported" in str(error.value)
    assert "sensor_msgs/msg/PointCloud2" in str(error.value)
    error = pickle.loads(pickle.dumps(MessageError("short_data", "data is short")))
    assert (error.reason, str(error)) == ("short_data", "data is short")


def test_a_later_reader_needs_one_row_and_no_installed_package(monkeypatch):
    def read_ping(message, options):
        angle = np.array(message.bearings) * (-1.0 if options.bearing_reference == "bow" else 1.0)
        return good_detections(
            time_to_ns(message.header.stamp),
            message.header.frame_id,
            options,
            range=np.array(message.ranges),
            azimuth=angle,
        )

    class Ping(SimpleNamespace):
        __msgtype__ = "sonar_msgs/msg/Ping"

    monkeypatch.setitem(detections.READERS, "sonar_msgs/msg/Ping", read_ping)

    header = SimpleNamespace(stamp=SimpleNamespace(sec=3, nanosec=5), frame_id="sonar")
    message = Ping(header=header, ranges=[10.0, -1.0, 30.0], bearings=[1.0, 2.0, 3.0])
    assert "sonar_msgs/msg/Ping" in supported_types()
    found = read_detections(message)
    assert (found.sensor_scan.stamp_ns, found.sensor_scan.frame_id) == (3_000_000_005, "sonar")
    np.testing.assert_array_equal(found.scan.azimuth, [-1.0, -3.0])
    np.testing.assert_array_equal(found.index, [0, 2])
    np.testing.assert_array_equal(
        read_detections(message, bearing_reference="north").scan.azimuth, [1, 3]
    )


def test_one_value_holds_for_all_detections_and_another_number_is_refused():
    assert fitted_to_ping("flags", [], 3) is None
    assert fitted_to_ping("flags", [2.0], 3).tolist() == [2.0, 2.0, 2.0]
    assert fitted_to_ping("flags", [[1.0, 2.0]] * 3, 3).shape == (3, 2)
    with pytest.raises(MessageError, match="flags has 2 values for 3 detections") as error:
        fitted_to_ping("flags", [1.0, 2.0], 3)
    assert error.value.reason == "wrong_length"
    assert intensity_feature([1.0, 2.0], 3)[0] == {}


@pytest.mark.parametrize(("stated", "used"), [(1400.0, 1400.0), (0.0, 1450.0), (math.nan, 1450.0)])
def test_a_sound_speed_that_no_sea_has_is_replaced_and_that_is_said(stated, used):
    message = foreign_messages.SonarDetections(
        ping_info=foreign_messages.PingInfo(sound_speed=stated)
    )
    speed, said = stated_sound_speed(message, 1450.0)
    assert speed == used
    assert len(said) == (used != stated)


def test_bearings_are_clockwise_from_the_bow_or_from_north():
    bearing = np.array([0.0, math.pi / 2])
    np.testing.assert_allclose(azimuth_of_bearing(bearing, "bow"), [0.0, -math.pi / 2])
    np.testing.assert_allclose(azimuth_of_bearing(bearing, "north"), [math.pi / 2, 0.0])


def test_a_frame_states_its_axes_by_its_name():
    ahead, port, up = np.array([9.0]), np.array([3.0]), np.array([2.0])
    frames = {
        "sonar": (ahead, port, up),
        "sonar_frd": (ahead, -port, -up),
        "sonar_optical": (-port, -up, ahead),
    }
    for frame, position in frames.items():
        assert ping_along_axes(frame, *position) == (ahead, port, up)
    assert (turn_about_z("sonar"), turn_about_z("sonar_frd")) == (1.0, -1.0)
    with pytest.raises(MessageError, match="z ahead"):
        turn_about_z("sonar_optical")


def test_a_slant_range_has_a_part_in_the_plane_and_a_height():
    range_, height = ping_in_plane(np.array([100.0, 10.0]), np.array([math.pi / 6, 0.0]))
    np.testing.assert_allclose(range_, [100.0 * math.sqrt(0.75), 10.0])
    np.testing.assert_allclose(height, [50.0, 0.0])


def test_a_detection_is_left_out_under_its_first_fault():
    bad = {"flagged": np.array([False, True, False, False])}
    ping = good_detections(
        5,
        "/sonar",
        ReadingOptions(),
        range=np.array([10.0, math.nan, -1.0, 40.0]),
        azimuth=np.array([0.0, 0.0, math.nan, 2.0 * math.pi]),
        faults=bad,
    )
    assert ping.dropped == {"flagged": 1, "range_not_positive": 1}
    assert ping.index.tolist() == [0, 3]
    assert ping.scan.azimuth == pytest.approx([0.0, 0.0])
    assert (ping.sensor_scan.stamp_ns, ping.sensor_scan.frame_id) == (5, "sonar")
