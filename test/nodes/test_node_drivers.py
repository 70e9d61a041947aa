"""Drivers of other types than PointCloud2: found, read, or refused by name."""

from typing import Any

import pytest
from rclpy.node import Node
from sensor_msgs.msg import LaserScan, PointCloud2
from support import foreign_messages
from support.boat import named
from support.driver_messages import MAKERS, echoes_of
from support.expectation import assert_same, initiator
from support.ros_world import RELIABLE
from support.sonar_driver import START_NS

from msg_adapters import make_header
from tsepm_ros import Scan
from tsepm_ros.nodes.base_node import ParameterError
from tsepm_ros.nodes.track_initiator import TrackInitiator
from tsepm_ros.tools.players.sonar_simulator import SonarSimulator

LASER_SCAN = "sensor_msgs/msg/LaserScan"
SONAR_DETECTIONS = "marine_acoustic_msgs/msg/SonarDetections"
PERIOD_NS = 12 * 10**9
PINGS = 12


def header(index: int) -> Any:
    return make_header(START_NS + PERIOD_NS * index, "sonar")


def test_a_laser_scan_is_found_and_gives_the_tracks_of_the_core(world):
    driver = world.add(Node("lidar", context=world.context))
    publisher = driver.create_publisher(LaserScan, "detections", RELIABLE)
    world.make(TrackInitiator, named({}))
    tracks = world.listen(PointCloud2, "tracks")
    world.until_logged("subscribed to /detections as sensor_msgs/msg/LaserScan, reliable")
    world.until(publisher.get_subscription_count, "the node to subscribe")
    world.until_connected()
    core, expected = initiator(), []
    for index in range(PINGS):
        message, numbers = MAKERS[LASER_SCAN](header(index), echoes_of(index))
        publisher.publish(message)
        expected.append(core.process(Scan(stamp=START_NS / 1e9 + 12 * index, **numbers)))
    world.until(lambda: len(tracks) == PINGS, "tracks")
    assert_same(tracks, expected)
    assert world.dropped() == {}


def test_a_type_whose_package_is_missing_is_refused_with_its_name(world, monkeypatch):
    foreign_messages.remove(monkeypatch)
    for kind in (TrackInitiator, SonarSimulator):
        for name in (SONAR_DETECTIONS, "vision_msgs/msg/Detection3DArray"):
            package = name.partition("/")[0]
            with pytest.raises(ParameterError, match=f"needs the package '{package}'"):
                world.make(kind, {"detections_type": name})
        with pytest.raises(ParameterError) as error:
            world.make(kind, {"detections_type": "sensor_msgs/msg/Image"})
        assert all(name in str(error.value) for name in MAKERS), "an unknown type"


def test_the_simulator_as_a_laser_scan_gives_tracks(world):
    simulator = {"detections_type": LASER_SCAN, "scenario": "box"}
    world.make(TrackInitiator, named({"sensor.max_range": 12000.0}))
    tracks = world.listen(PointCloud2, "tracks")
    made = world.make(SonarSimulator, simulator | {"rate_factor": 1e5, "settling_time": 0.2})
    world.until(made.finished.done, "the end")
    world.until(lambda: len(tracks) >= 8, "tracks")
    assert sum(message.width for message in tracks) >= 1
    assert world.dropped() == {}
