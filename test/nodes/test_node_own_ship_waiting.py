"""Scans that wait for odometry: in time, late, stale, missing, and after a restart."""

from time import sleep
from typing import Any

from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock
from support.boat import Boat
from support.expectation import assert_same, assert_stamps, confirmed
from support.ship import SECOND, Ship, publish_poses
from support.sonar_driver import START_NS, pings, stamp_ns

SENT = pings(12)
SOON = 0.5
"""A wait for own-ship data that is over soon, but not before what is there has been read, s."""


def test_scans_wait_for_odometry_that_comes_after_them_and_keep_their_order(world):
    boat = Boat(world, own_ship_source="odometry", own_ship_timeout=3600.0)
    for ping in SENT[:4]:
        boat.driver.ping(ping)
    world.until(lambda: world.figures()["waiting_for_own_ship"] == "4", "scans that wait")
    assert len(boat.tracks) == 0
    publish_poses(boat, Ship(), 0, 13)
    boat.take(2, 0)
    world.until(lambda: world.figures()["waiting_for_own_ship"] == "2", "scans that still wait")
    assert len(boat.tracks) == 2
    publish_poses(boat, Ship(), 14, 140)
    for ping in SENT[4:]:
        boat.driver.ping(ping)
    received = boat.take(12, 0)
    assert_same(received, confirmed(SENT))
    assert_stamps(received, SENT)
    assert world.dropped() == {}


def test_odometry_that_waits_unread_while_the_machine_is_busy_is_used(world):
    boat = Boat(world, own_ship_source="odometry", own_ship_timeout=3600.0)
    boat.driver.ping(SENT[0])
    world.until(lambda: world.figures()["waiting_for_own_ship"] == "1", "the scan to wait")
    publish_poses(boat, Ship(), 0, 140)
    boat.node.set_parameters([Parameter("own_ship_timeout", value=SOON)])
    sleep(2 * SOON)  # nobody reads; the timer is due first
    received = boat.take(1, 0) + boat.send(SENT[1:])
    assert_same(received, confirmed(SENT))
    assert world.dropped() == {}


def test_a_burst_of_scans_and_odometry_loses_none(world):
    boat = Boat(world, own_ship_source="odometry", own_ship_timeout=3600.0)
    sent = pings(100)
    publish_poses(boat, Ship(), 0, 1200)
    received = boat.send(sent)
    assert_same(received, confirmed(sent))
    assert world.dropped() == {}


def set_time(world, boat: Boat, clock: Any, nanoseconds: int) -> None:
    message = Clock()
    message.clock.sec, message.clock.nanosec = divmod(nanoseconds, SECOND)
    clock.publish(message)
    world.until(lambda: boat.node.get_clock().now().nanoseconds == nanoseconds, "the time")


def test_scans_that_wait_do_not_outlive_a_restart_in_simulated_time(world):
    boat = Boat(world, own_ship_source="odometry", own_ship_timeout=SOON, use_sim_time=True)
    clock = world.observer.create_publisher(Clock, "/clock", 10)
    world.until_connected()
    set_time(world, boat, clock, START_NS + 132 * SECOND)
    publish_poses(boat, Ship(), 0, 130)
    for ping in SENT:
        boat.driver.ping(ping)
    boat.take(11, 0)
    world.until(lambda: world.figures()["waiting_for_own_ship"] == "1", "the last scan to wait")
    back = 5000 * SECOND
    set_time(world, boat, clock, START_NS - back)
    again = pings(start_ns=START_NS - back, seed=3)
    for seconds in range(0, 140, 4):
        boat.driver.pose(START_NS - back + seconds * SECOND, 0, 0, 0)
    for ping in again:
        boat.driver.ping(ping)
    last = again[-1].stamp_ns
    world.until(lambda: stamp_ns(boat.tracks[-1]) == last, "the last scan's tracks")
    assert_same(boat.tracks[-len(again) :], confirmed(again))


def test_waiting_is_measured_in_real_time_when_simulated_time_runs_fast(world):
    boat = Boat(world, own_ship_source="odometry", use_sim_time=True)
    clock = world.observer.create_publisher(Clock, "/clock", 10)
    world.until_connected()
    sent = SENT[:6]
    for index, ping in enumerate(sent):
        message = Clock()
        message.clock.sec, message.clock.nanosec = divmod(ping.stamp_ns + 5 * SECOND, SECOND)
        # The scan overtakes its odometry by far less than a second, or five in simulated time.
        boat.driver.ping(ping)
        world.until(lambda: world.figures()["waiting_for_own_ship"] == "1", "the scan to wait")
        clock.publish(message)
        expected = ping.stamp_ns + 5 * SECOND
        world.until(
            lambda expected=expected: boat.node.get_clock().now().nanoseconds == expected, "time"
        )
        world.statuses()
        publish_poses(boat, Ship(), 12 * index, 12 * index + 8)
        world.until(lambda: world.figures()["waiting_for_own_ship"] == "0", "the scan to be taken")
    assert_same(boat.tracks, confirmed(sent))
    assert world.dropped() == {}
