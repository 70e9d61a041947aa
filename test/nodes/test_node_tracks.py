"""Pings of a driver in, tracks out."""

import time

import numpy as np
import pytest
from nav_msgs.msg import Odometry
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import ReliabilityPolicy
from sensor_msgs.msg import PointCloud2, PointField
from support.boat import Boat, named
from support.expectation import (
    COVARIANCE,
    STATE,
    as_scan,
    assert_same,
    assert_same_track,
    assert_stamps,
    confirmed,
    initiator,
)
from support.patience import WAIT
from support.ros_world import BEST_EFFORT, LATCHED, RELIABLE, WARN
from support.sonar_driver import START_NS, Driver, Ping, pings, points, stamp_ns

from tsepm_ros.nodes.track_initiator import TrackInitiator

SECOND = 10**9
TWO_TARGETS = ((3000.0, 4.0, 1500.0, -2.0), (-2000.0, -3.0, 2500.0, 1.0))


@pytest.mark.parametrize("driver_first", [True, False], ids=["driver_first", "node_first"])
@pytest.mark.parametrize("qos", [RELIABLE, BEST_EFFORT], ids=["reliable", "best_effort"])
def test_a_driver_that_publishes_range_and_azimuth_gets_tracks(world, qos, driver_first):
    if driver_first:
        driver = world.add(Driver(world.context, qos))
        node = world.make(TrackInitiator, named({}))
    else:
        node = world.make(TrackInitiator, named({}))
        world.until_logged("waiting for a publisher of /detections")
        driver = world.add(Driver(world.context, qos))
    tracks = world.listen(PointCloud2, "tracks")
    world.until(driver.publisher.get_subscription_count, "the node to subscribe")
    world.until_connected()
    sent = pings()
    for number, ping in enumerate(sent, 1):
        driver.ping(ping)
        world.until(lambda number=number: len(tracks) == number, "the tracks of this ping")
    assert_same(tracks, confirmed(sent))
    assert_stamps(tracks, sent)
    [subscription] = [one for one in node.subscriptions if one.topic_name == "/detections"]
    assert subscription.qos_profile.reliability == qos.reliability


def test_every_target_of_a_burst_is_tracked_and_ids_count_up(world):
    boat = Boat(world)
    sent = pings(30, targets=TWO_TARGETS, clutter=20)
    received = boat.send(sent)
    assert_same(received, confirmed(sent))
    ids = [point["track_id"] for message in received for point in points(message)]
    assert ids == list(range(len(ids)))
    assert len(ids) >= 2


def test_a_sonar_that_gives_no_times_is_said_once(world):
    boat = Boat(world)
    boat.send(pings())
    world.until_logged("no time_offset", level=WARN)
    assert len(world.warned()) == 1


def test_every_scan_gives_one_message_even_without_tracks_or_detections(world):
    boat = Boat(world)
    sent = [Ping(START_NS + index * SECOND, [], []) for index in range(3)]
    sent += pings(2, start_ns=START_NS + 12 * SECOND)
    received = boat.send(sent)
    assert_stamps(received, sent)
    assert [message.width for message in received] == [0] * 5
    fields = [[field.name for field in message.fields] for message in received]
    assert all(names == fields[0] for names in fields)
    assert fields[0][:4] == ["x", "y", "z", "track_id"]


def test_tracks_have_the_documented_layout(world):
    boat = Boat(world)
    message = boat.send(pings())[-1]
    names = [field.name for field in message.fields]
    assert names == [
        *("x", "y", "z", "track_id", *STATE, *COVARIANCE),
        *("evaluation", "score", "hit_count", "scan_count", "age", "stationary_probability"),
        *("signal_to_clutter_db", "revision", "existence_probability", "time_since_hit"),
    ]
    kinds = {field.name: field.datatype for field in message.fields}
    # RViz and PCL need these three as float32.
    assert {kinds.pop(name) for name in "xyz"} == {PointField.FLOAT32}
    assert kinds.pop("track_id") == PointField.UINT32
    counts = {kinds.pop(name) for name in ("hit_count", "scan_count", "revision")}
    assert counts == {PointField.UINT16}
    assert set(kinds.values()) == {PointField.FLOAT64}
    doubles = [f.offset for f in message.fields if f.datatype == PointField.FLOAT64]
    assert not any(offset % 8 for offset in [*doubles, message.point_step])
    assert {field.count for field in message.fields} == {1}
    assert message.height == 1 and not message.is_bigendian
    assert message.row_step == message.width * message.point_step == len(message.data)


def test_topics_follow_remapping_and_namespace(world):
    driver = world.add(Driver(world.context, cli_args=["--ros-args", "-r", "__ns:=/sonar"]))
    arguments = ["--ros-args", "-r", "__ns:=/boat", "-r", "detections:=/sonar/detections"]
    world.make(TrackInitiator, named({}), cli_args=arguments)
    tracks = world.listen(PointCloud2, "/boat/tracks")
    world.until(driver.publisher.get_subscription_count, "the node to subscribe")
    world.until_connected()
    sent = pings()
    for ping in sent:
        driver.ping(ping)
    world.until(lambda: len(tracks) == len(sent), "tracks")
    assert_same(tracks, confirmed(sent))


def test_tracks_are_offered_reliably_and_current_tracks_latched(world):
    Boat(world)
    [tracks] = world.observer.get_publishers_info_by_topic("/tracks")
    [current] = world.observer.get_publishers_info_by_topic("/tracks/current")
    assert tracks.qos_profile.reliability == ReliabilityPolicy.RELIABLE
    assert current.qos_profile.reliability == ReliabilityPolicy.RELIABLE
    assert current.qos_profile.durability == LATCHED.durability


def test_each_new_track_is_an_odometry_message(world):
    boat = Boat(world)
    odometry = world.listen(Odometry, "tracks/odometry")
    world.until_connected()
    sent = pings(20, targets=TWO_TARGETS)
    received = boat.send(sent)
    tracks = [(message, point) for message in received for point in points(message)]
    world.until(lambda: len(odometry) >= len(tracks), "odometry")
    assert len(odometry) == len(tracks) >= 2
    for (message, point), found in zip(tracks, odometry, strict=True):
        assert found.header == message.header
        assert found.child_frame_id == f"track_{point['track_id']}"
        position, orientation = found.pose.pose.position, found.pose.pose.orientation
        velocity = found.twist.twist.linear
        assert [position.x, velocity.x, position.y, velocity.y] == [point[n] for n in STATE]
        assert (orientation.x, orientation.y, orientation.z, orientation.w) == (0, 0, 0, 1)
        pose, twist = found.pose.covariance.reshape(6, 6), found.twist.covariance.reshape(6, 6)
        assert [pose[0, 0], pose[0, 1], pose[1, 1]] == [
            point[name] for name in ("cov_00", "cov_02", "cov_22")
        ]
        assert [twist[0, 0], twist[0, 1], twist[1, 1]] == [
            point[name] for name in ("cov_11", "cov_13", "cov_33")
        ]
        assert min(*np.diag(pose)[2:], *np.diag(twist)[2:]) >= 1e5, "not observed"


def test_a_late_subscriber_gets_the_current_tracks_as_of_the_last_scan(world):
    boat = Boat(world)
    sent = pings(8)
    received = boat.send(sent)
    [(number, start)] = [(n, p) for n, m in enumerate(received) for p in points(m)]
    assert number < 7, "it must have been carried forward"
    current = world.listen(PointCloud2, "tracks/current", LATCHED)
    world.until(lambda: current, "the current tracks")
    [latched] = current
    assert stamp_ns(latched) == sent[-1].stamp_ns
    [held] = points(latched)
    assert held["track_id"] == start["track_id"]
    assert held["age"] - start["age"] == (sent[-1].stamp_ns - sent[number].stamp_ns) / SECOND
    same = initiator()
    for ping in sent:
        same.process(as_scan(ping))
    [expected] = same.current
    assert_same_track(held, expected)


def test_results_are_published_in_the_callback_that_made_them(world):
    boat = Boat(world, diagnostics_period=3600.0)
    # From here the node runs only when it is told to, until the ping is processed.
    world.executor.remove_node(boat.node)
    alone = SingleThreadedExecutor(context=world.context)
    alone.add_node(boat.node)
    received = []
    for number, ping in enumerate(sent := pings(6), 1):
        boat.driver.ping(ping)
        before, end = boat.node.latency, time.monotonic() + WAIT
        while boat.node.latency is before and time.monotonic() < end:
            alone.spin_once(timeout_sec=1.0)  # a timer may come first
        world.until(lambda number=number: len(boat.tracks) == number, "tracks without a timer")
        received.append(boat.node.latency)
    alone.shutdown()
    assert_same(boat.tracks, confirmed(sent))
    for latency in received:
        assert 0 < latency.core < latency.to_tracks < latency.to_all < 5.0
