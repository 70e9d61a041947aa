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
"""Subscriptions: the driver's type and reliability, queues, and own ship from tf."""

from typing import Any

import pytest
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Image, LaserScan, PointCloud2
from support import foreign_messages
from support.boat import Boat, named
from support.driver_messages import MAKERS, echoes_of
from support.expectation import assert_same, confirmed, initiator
from support.ros_world import BEST_EFFORT, ERROR, LATCHED, RELIABLE, WARN, World, remapped
from support.sonar_driver import START_NS, Driver, pings

from msg_adapters import MessageError, make_header
from tsepm_ros import Scan
from tsepm_ros.nodes import subscriptions
from tsepm_ros.nodes.base_node import ParameterError
from tsepm_ros.nodes.subscriptions import DetectionsSubscription, SubscriptionQos
from tsepm_ros.nodes.track_initiator import TrackInitiator
from tsepm_ros.tools.players.sonar_simulator import SonarSimulator

LASER_SCAN = "sensor_msgs/msg/LaserScan"

POINT_CLOUD = "sensor_msgs/msg/PointCloud2"

SENT = pings()


def reliability(node: Node) -> ReliabilityPolicy:
    [subscription] = [one for one in node.subscriptions if one.topic_name == "/detections"]
    return subscription.qos_profile.reliability


@pytest.mark.parametrize(
    "given",
    [{}, {"detections_type": POINT_CLOUD, "detections_reliability": "reliable"}],
    ids=["auto", "given"],
)
def test_an_unsupported_type_is_named_once_and_a_good_driver_beside_it_is_read(world, given):
    with World(world.domain) as elsewhere:  # one process cannot publish two types on one topic
        camera = elsewhere.add(Node("camera", context=elsewhere.context))
        camera.create_publisher(Image, "detections", 10)
        node = world.make(TrackInitiator, named(given))
        image = "sensor_msgs/msg/Image", POINT_CLOUD, "sonar_detector reads images"
        world.until_logged("/detections", *image, level=ERROR)
        world.until(lambda: len(world.diagnostics) > 5, "more looks at the graph")
        assert len(world.logged(ERROR)) == 1
        said = "/detections is published as sensor_msgs/msg/Image, which the node does not read"
        assert world.status("detections").message == said
        driver, tracks = world.add(Driver(world.context)), world.listen(PointCloud2, "tracks")
        world.until(driver.publisher.get_subscription_count, "the node to subscribe")
        world.until_connected()
        for ping in SENT:
            driver.ping(ping)
        world.until(lambda: len(tracks) == len(SENT), "tracks")
        assert_same(tracks, confirmed(SENT))
        assert reliability(node) == ReliabilityPolicy.RELIABLE


def subscribe(world, **arguments) -> DetectionsSubscription:
    """A subscription of a plain node, with the arguments that a test needs."""
    node = world.add(Node("reader", context=world.context))
    arguments = {"type_name": "auto", "reliability": "auto", "depth": 10, **arguments}
    return DetectionsSubscription(
        node, callback=lambda message: None, watch=SubscriptionQos(node), **arguments
    )


def test_a_driver_that_comes_back_as_another_type_is_named_once(world, monkeypatch):
    monkeypatch.setattr(subscriptions, "CONNECTED_POLL_PERIOD", 0.05)
    detections = subscribe(world)
    driver = world.add(Driver(world.context))
    world.until(lambda: detections.subscribed == POINT_CLOUD, "the driver")
    assert detections.unread == ()
    assert world.warned() == []
    world.end(driver)
    with World(world.domain) as elsewhere:  # one process cannot publish two types on one topic
        lidar = elsewhere.add(Node("lidar", context=elsewhere.context))
        publisher = lidar.create_publisher(LaserScan, "detections", 10)
        world.until_logged(f"as {LASER_SCAN}, but", f"as {POINT_CLOUD};", level=WARN)
        assert publisher.topic_name == "/detections"
        assert detections.unread == detections.types["other_readable"] == (LASER_SCAN,)
        for _ in range(20):
            world.spin_once(0.05)
        assert len(world.warned()) == 1
    assert detections.subscribed == POINT_CLOUD
    world.until(lambda: detections.unread == (), "the end of that driver")


def test_a_driver_whose_package_is_missing_is_named_and_another_still_found(world, monkeypatch):
    def missing(name: str, readable: Any) -> type:
        if name == LASER_SCAN:
            raise MessageError("package_not_installed", f"{name!r} needs the package 'lasers'")
        return PointCloud2

    with World(world.domain) as elsewhere:
        lidar = elsewhere.add(Node("lidar", context=elsewhere.context))
        lidar.create_publisher(LaserScan, "detections", 10)
        monkeypatch.setattr(subscriptions, "message_class", missing)
        detections = subscribe(world)
        world.until_logged(LASER_SCAN, "needs the package 'lasers'", level=ERROR)
        driver = world.add(Driver(world.context))
        world.until(driver.publisher.get_subscription_count, "the node to subscribe")
        assert detections.subscribed == POINT_CLOUD
    assert len(world.logged(ERROR)) == 1


@pytest.mark.parametrize(
    ("kind", "qos"),
    [(PointCloud2, BEST_EFFORT), (LaserScan, RELIABLE)],
    ids=["PointCloud2, best effort", "LaserScan, reliable"],
)
def test_the_graph_has_the_subscription_before_the_first_driver_and_then_its_type(world, kind, qos):
    detections = subscribe(world)
    look = world.observer.get_subscriptions_info_by_topic
    world.until(lambda: look("detections"), "a subscription")
    assert [end.topic_type for end in look("detections")] == [POINT_CLOUD]
    assert not detections.subscribed, "there is no driver yet"
    with World(world.domain) as elsewhere:  # one process cannot have two types on one topic
        driver = elsewhere.add(Node("driver", context=elsewhere.context))
        publisher = driver.create_publisher(kind, "detections", qos)
        world.until(lambda: detections.subscribed, "the driver")
        world.until(publisher.get_subscription_count, "the subscription that fits")
        [found] = look("detections")
        assert found.topic_type.endswith(kind.__name__)
        assert found.qos_profile.reliability == qos.reliability
        assert world.warned() == [], "nothing is wrong with such a driver"


def test_a_best_effort_driver_beside_a_reliable_one_is_read(world):
    detections = subscribe(world)
    reliable, less = (world.add(Driver(world.context, qos)) for qos in (RELIABLE, BEST_EFFORT))
    world.until(lambda: detections.subscribed, "the drivers")
    world.until(less.publisher.get_subscription_count, "a subscription to both")
    world.until(reliable.publisher.get_subscription_count, "a subscription to both")


def one_by_one(world, driver: Driver, tracks, sent) -> None:
    """Send pings that best effort must not lose."""
    for ping in sent:
        seen = len(tracks)
        driver.ping(ping)
        world.until(lambda seen=seen: len(tracks) > seen, "the tracks of this ping")


def test_best_effort_may_be_asked_of_a_reliable_driver_before_it_is_there(world):
    given = {"detections_type": POINT_CLOUD, "detections_reliability": "best_effort"}
    node = world.make(TrackInitiator, named(given))
    assert reliability(node) == ReliabilityPolicy.BEST_EFFORT
    assert world.status("detections").message == "no publisher of /detections yet"
    driver, tracks = world.add(Driver(world.context)), world.listen(PointCloud2, "tracks")
    world.until(driver.publisher.get_subscription_count, "the node to subscribe")
    world.until_connected()
    one_by_one(world, driver, tracks, SENT)
    assert_same(tracks, confirmed(SENT))


def test_reliable_asked_of_a_best_effort_driver_is_an_error_until_it_is_gone(world):
    node = world.make(TrackInitiator, named({"detections_reliability": "reliable"}))
    driver = world.add(Driver(world.context, BEST_EFFORT))
    world.until_logged(
        "does not offer reliable", "/detections", "detections_reliability", level=ERROR
    )
    assert reliability(node) == ReliabilityPolicy.RELIABLE
    quality = "quality of service"
    world.until(lambda: world.status(quality).level == b"\x02", "the error")
    assert "/detections" in world.status(quality).message
    assert world.figures()["mismatches./detections"] == "1"
    world.end(driver)
    world.until(lambda: world.status(quality).level == b"\x00", "its end")
    assert world.figures()["mismatches./detections"] == "1"
    world.reset()
    assert "mismatches./detections" not in world.figures()


def test_a_driver_may_start_again_and_then_offer_less(world):
    boat = Boat(world)
    boat.send(SENT[:4])
    assert reliability(boat.node) == ReliabilityPolicy.RELIABLE
    world.end(boat.driver)
    boat.driver = world.add(Driver(world.context))
    boat.connect()
    boat.send(SENT[4:8])
    world.end(boat.driver)
    boat.driver = world.add(Driver(world.context, BEST_EFFORT))
    world.until_logged("best effort only")
    boat.connect()
    assert reliability(boat.node) == ReliabilityPolicy.BEST_EFFORT
    one_by_one(world, boat.driver, boat.tracks, SENT[8:])
    assert_same(boat.tracks, confirmed(SENT))
    world.until(lambda: world.figures().get("mismatches./detections") == "1", "the event")
    world.until(lambda: world.status("quality of service").level == b"\x00", "that it fits")


def test_a_subscriber_that_asks_for_more_than_is_offered_is_named(world):
    world.make(TrackInitiator, named({}))
    world.listen(PointCloud2, "tracks", LATCHED)
    world.until_logged("a subscriber of /tracks", level=WARN)
    world.until(lambda: world.status("quality of service").level == b"\x02", "the error")
    assert "/tracks" in world.status("quality of service").message


def test_a_burst_longer_than_default_queues_survives(world):
    boat = Boat(world, QoSProfile(depth=600), method="tsepm")  # the quicker, for so many pings
    sent = pings(150, clutter=3)
    assert_same(boat.send(sent), confirmed(sent, method="tsepm"))


def test_the_queue_may_be_kept_short(world):
    boat = Boat(world, QoSProfile(depth=600), detections_depth=1)
    sent = pings(50)
    for ping in sent:
        boat.driver.ping(ping)
    world.until(
        lambda: boat.tracks and boat.tracks[-1].header.stamp.sec == sent[-1].stamp_ns // 10**9,
        "the newest scan",
    )
    assert len(boat.tracks) < 10


def test_two_sonars_are_tracked_apart_by_two_nodes_in_two_namespaces(world):
    """The second has its own topic of detections."""
    boats = []
    for name, topic in (("port", "detections"), ("starboard", "sonar/raw")):
        driver = world.add(
            Driver(world.context, cli_args=remapped(f"__ns:=/{name}", f"detections:={topic}"))
        )
        rules = f"__ns:=/{name}", f"detections:=/{name}/{topic}"
        world.make(TrackInitiator, named({}), cli_args=remapped(*rules))
        boats.append((driver, world.listen(PointCloud2, f"/{name}/tracks")))
    for driver, _ in boats:
        world.until(driver.publisher.get_subscription_count, "the node to subscribe")
    world.until_connected()
    sent = [pings(seed=1), pings(seed=2, targets=((-4000.0, 2.0, 3000.0, -3.0),))]
    for (driver, _), of_sonar in zip(boats, sent, strict=True):
        for ping in of_sonar:
            driver.ping(ping)
    for (_, tracks), of_sonar in zip(boats, sent, strict=True):
        world.until(lambda tracks=tracks: len(tracks) == len(SENT), "tracks")
        assert_same(tracks, confirmed(of_sonar))
    world.until(lambda: len({one.status[0].name for one in world.diagnostics}) == 2, "both")
    for message in world.diagnostics:
        boat = message.status[0].hardware_id
        assert boat in ("/port/track_initiator", "/starboard/track_initiator")
        assert {status.name.partition(": ")[0] for status in message.status} == {boat}
        assert {status.hardware_id for status in message.status} == {boat}


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
    world.until(lambda: any(message.width for message in tracks), "a track")
    assert world.dropped() == {}
