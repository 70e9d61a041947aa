"""The registry of input types."""

import pickle
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from std_msgs.msg import String

from msg_adapters import MessageError, message_class, ping, read_detections, supported_types
from msg_adapters.ping import good_detections
from msg_adapters.stamps import time_to_ns


@pytest.fixture
def _other_registry():
    before = dict(ping.adapters)
    yield
    ping.adapters.clear()
    ping.adapters.update(before)


def test_a_message_of_an_unknown_type_is_refused_with_the_known_ones():
    with pytest.raises(MessageError) as error:
        read_detections(String())
    assert error.value.reason == "unknown_type"
    assert "'std_msgs/msg/String' is not supported" in str(error.value)
    assert "sensor_msgs/msg/PointCloud2" in str(error.value)


@pytest.mark.parametrize("name", ["sensor_msgs/msg/Image", "PointCloud2", "os/system", ""])
def test_the_class_of_an_unknown_type_is_refused_with_the_known_ones(name):
    with pytest.raises(
        MessageError, match=r"supported types are .*sensor_msgs/msg/PointCloud2"
    ) as error:
        message_class(name)
    assert error.value.reason == "unknown_type"


@pytest.mark.usefixtures("_other_registry")
def test_a_later_adapter_needs_one_registration_and_no_installed_package():
    @ping.register("sonar_msgs/msg/Ping")
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


def test_an_error_survives_pickling():
    error = pickle.loads(pickle.dumps(MessageError("short_data", "data is short")))
    assert (error.reason, str(error)) == ("short_data", "data is short")


def test_importing_the_adapters_imports_no_ros():
    code = (
        "import sys, msg_adapters; "
        "print({'rclpy', 'sensor_msgs', 'nav_msgs', 'visualization_msgs'} & set(sys.modules))"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "set()"
