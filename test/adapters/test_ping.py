"""TODO: one sentence on what is shown of ping."""

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
from msg_adapters.ping import good_detections
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
