"""Pings of a driver in, tracks out."""

import time

import numpy as np
import pytest
from nav_msgs.msg import Odometry
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import ReliabilityPolicy
from sensor_msgs.msg import PointCloud2
from support.boat import Boat, named
from support.expectation import (
    STATE,
    as_scan,
    assert_same,
    assert_same_track,
    assert_stamps,
    confirmed,
    initiator,
)
from support.markers import shown_markers
from support.patience import WAIT
from support.ros_world import BEST_EFFORT, LATCHED, RELIABLE, WARN
from support.sonar_driver import Driver, pings, points, stamp_ns
from visualization_msgs.msg import Marker

from tsepm_ros.nodes.track_initiator import TrackInitiator

SECOND = 10**9
TWO_TARGETS = ((3000.0, 4.0, 1500.0, -2.0), (-2000.0, -3.0, 2500.0, 1.0))


@pytest.mark.parametrize(
    ("qos", "driver_first"),
    [(RELIABLE, False), (BEST_EFFORT, True)],
    ids=["reliable, node first", "best effort, driver first"],
)
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


def test_every_target_of_a_burst_is_tracked_and_each_track_is_an_odometry_message(world):
    boat = Boat(world)
    odometry = world.listen(Odometry, "tracks/odometry")
    world.until_connected()
    sent = pings(30, targets=TWO_TARGETS, clutter=20)
    received = boat.send(sent)
    assert_same(received, confirmed(sent))
    tracks = [(message, point) for message in received for point in points(message)]
    assert [point["track_id"] for _, point in tracks] == list(range(len(tracks)))
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
        for matrix, names in ((pose, ("00", "02", "22")), (twist, ("11", "13", "33"))):
            known = [matrix[0, 0], matrix[0, 1], matrix[1, 1]]
            assert known == [point[f"cov_{name}"] for name in names]
            assert min(np.diag(matrix)[2:]) >= 1e5, "not observed"
    world.until_logged("no time_offset", level=WARN)
    assert len(world.warned()) == 1, "a sonar that gives no times is said once"


def test_a_late_subscriber_gets_the_current_tracks_as_of_the_last_scan(world):
    boat = Boat(world)
    sent = pings(8)
    received = boat.send(sent)
    [(number, start)] = [(n, p) for n, m in enumerate(received) for p in points(m)]
    assert number < 7, "it must have been carried forward"
    current = world.listen(PointCloud2, "tracks/current", LATCHED)
    world.until(lambda: current, "the current tracks")
    [latched] = current
    for topic in ("/tracks", "/tracks/current"):
        [offered] = world.observer.get_publishers_info_by_topic(topic)
        assert offered.qos_profile.reliability == ReliabilityPolicy.RELIABLE
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
    scans = boat.node.health.scans
    for number, ping in enumerate(sent := pings(6), 1):
        boat.driver.ping(ping)
        end = time.monotonic() + WAIT
        while len(scans) < number and time.monotonic() < end:
            alone.spin_once(timeout_sec=1.0)  # a timer may come first
        world.until(lambda number=number: len(boat.tracks) == number, "tracks without a timer")
    alone.shutdown()
    assert_same(boat.tracks, confirmed(sent))
    for _, _, latency in scans:
        assert 0 < latency.core < latency.to_tracks < latency.to_all < 5.0


def test_reset_forgets_scans_tracks_counts_and_the_frame_but_no_id_comes_twice(world):
    boat = Boat(world)
    current = world.listen(PointCloud2, "tracks/current", LATCHED)
    markers = shown_markers(world)
    world.until_connected()
    sent = pings()
    first = boat.send(sent)
    boat.driver.ping(sent[-2])  # late: dropped and counted
    world.until(lambda: world.dropped() == {"scan_late": 1}, "the count")
    response = world.reset()
    assert response.success and response.message
    world.until(lambda: len(current) > len(sent) and len(markers) > len(sent), "what it cleared")
    assert current[-1].width == 0
    assert current[-1].header.frame_id == "sonar", "RViz cannot place a message without a frame"
    assert [marker.action for marker in markers[-1].markers] == [Marker.DELETEALL]
    figures = world.figures()
    assert figures["scans"] == "0"
    assert not [key for key in figures if key.startswith("dropped.")]
    again = boat.send(
        sent, frame_id="head"
    )  # the same stamps once more are neither late nor a restart
    assert_same(again, confirmed(sent))
    assert {message.header.frame_id for message in again} == {"head"}
    ids = [point["track_id"] for message in [*first, *again] for point in points(message)]
    assert len(set(ids)) == len(ids)
