"""Drivers of other types than PointCloud2: found, read, or refused by name."""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from rclpy.node import Node
from sensor_msgs.msg import LaserScan, PointCloud2
from support import foreign_messages
from support.boat import named
from support.driver_messages import MAKERS, echoes_of
from support.expectation import assert_same, initiator
from support.foreign_messages import PingInfo, SonarDetections
from support.ros_world import RELIABLE, WARN
from support.sonar_driver import START_NS

from msg_adapters import make_header
from tsepm_ros import Scan
from tsepm_ros.nodes.node_parameters import ParameterError
from tsepm_ros.nodes.subscriptions import TfOwnShip
from tsepm_ros.nodes.track_initiator import TrackInitiator
from tsepm_ros.session.session import Session
from tsepm_ros.settings.node_options import SessionOptions
from tsepm_ros.settings.settings import Settings
from tsepm_ros.tools.players.sonar_simulator import SonarSimulator

LASER_SCAN = "sensor_msgs/msg/LaserScan"
SONAR_DETECTIONS = "marine_acoustic_msgs/msg/SonarDetections"
PERIOD_NS = 12 * 10**9
PINGS = 12


def header(index: int) -> Any:
    return make_header(START_NS + PERIOD_NS * index, "sonar")


@pytest.mark.parametrize("given", ["auto", LASER_SCAN])
def test_a_laser_scan_is_found_and_gives_the_tracks_of_the_core(world, given):
    driver = world.add(Node("lidar", context=world.context))
    publisher = driver.create_publisher(LaserScan, "detections", RELIABLE)
    world.make(TrackInitiator, named({"detections_type": given}))
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


@pytest.mark.parametrize("name", [SONAR_DETECTIONS, "vision_msgs/msg/Detection3DArray"])
@pytest.mark.parametrize("kind", [TrackInitiator, SonarSimulator])
def test_a_type_whose_package_is_missing_is_refused_with_its_name(world, monkeypatch, kind, name):
    foreign_messages.remove(monkeypatch)
    with pytest.raises(ParameterError, match=f"needs the package '{name.partition('/')[0]}'"):
        world.make(kind, {"detections_type": name})


@pytest.mark.parametrize("kind", [TrackInitiator, SonarSimulator])
def test_an_unknown_type_is_refused_with_those_that_are_known(world, kind):
    with pytest.raises(ParameterError) as error:
        world.make(kind, {"detections_type": "sensor_msgs/msg/Image"})
    assert all(name in str(error.value) for name in MAKERS)


def test_a_sound_speed_that_is_not_given_is_the_parameter_s_and_said_once(world):
    node = world.make(TrackInitiator, named({"sound_speed": 1450.0}))
    tracks = world.listen(PointCloud2, "tracks")
    world.until_connected()
    core, expected = initiator(), []
    for index in range(PINGS):
        message, numbers = MAKERS[SONAR_DETECTIONS](header(index), echoes_of(index))
        message.ping_info = PingInfo()
        node.take_detections(message)  # its package is not there to publish with
        numbers["range"] = (np.array(numbers["range"]) * 1450.0 / 1500.0).tolist()
        expected.append(core.process(Scan(stamp=START_NS / 1e9 + 12 * index, **numbers)))
    world.until(lambda: len(tracks) == PINGS, "tracks")
    assert_same(tracks, expected)
    world.until_logged("has no sound speed", "1450 m/s", level=WARN)
    assert sum("sound speed" in line for line in world.warned()) == 1
    assert world.dropped() == {}


def test_an_unusable_message_is_counted_and_the_next_is_read(world):
    node = world.make(TrackInitiator, named({}))
    tracks = world.listen(PointCloud2, "tracks")
    world.until_connected()
    bad = SonarDetections(header=header(0), two_way_travel_times=[1.0] * 3, rx_angles=[0.0] * 2)
    node.take_detections(bad)
    world.until_logged("rx_angles has 2 values for 3 detections", level=WARN)
    message, _ = MAKERS[SONAR_DETECTIONS](header(1), echoes_of(1))
    message.rx_angles[0] = math.nan
    node.take_detections(message)
    world.until(lambda: len(tracks) == 1, "the good message's scan")
    assert world.dropped() == {"wrong_length": 1, "direction_undefined": 1}


def test_a_forward_axis_that_points_up_places_nothing():
    session = Session(
        Settings(SessionOptions(method="tsepm", own_ship_source="tf", fixed_frame="map"))
    )
    level = SimpleNamespace(x=0.0, y=0.0, z=0.0, w=1.0)
    TfOwnShip(None, session, Standing(level)).look_up("sonar", 10.0, 11.0, "sonar")
    assert session.own_ship_stamp is None
    assert set(session.dropped) == {"own_ship_invalid"}


class Standing:
    """A stand-in for tf2_ros.Buffer: a frame that does not move."""

    def __init__(self, rotation: SimpleNamespace) -> None:
        self.rotation = rotation

    def can_transform(self, *_: Any) -> bool:
        return True

    def lookup_transform(self, *_: Any) -> Any:
        translation = SimpleNamespace(x=10.0, y=20.0, z=0.0)
        return SimpleNamespace(
            transform=SimpleNamespace(translation=translation, rotation=self.rotation)
        )


def test_the_simulator_as_a_laser_scan_gives_tracks(world):
    simulator = {
        "detections_type": LASER_SCAN,
        "scenario": "box",
        "rate_factor": 1e5,
        "settling_time": 0.2,
    }
    world.make(TrackInitiator, named({"sensor.max_range": 12000.0}))
    tracks = world.listen(PointCloud2, "tracks")
    made = world.make(SonarSimulator, simulator)
    world.until(made.finished.done, "the end")
    world.until(lambda: len(tracks) >= 8, "tracks")
    assert sum(message.width for message in tracks) >= 1
    assert world.dropped() == {}
