"""Scans that wait for odometry: in time, late, stale, missing, and after a restart."""

from time import sleep

from rclpy.parameter import Parameter
from support.boat import Boat, SimulatedTime
from support.expectation import assert_same, assert_stamps, confirmed
from support.ship import SECOND, Ship, publish_poses
from support.sonar_driver import pings

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


def test_waiting_is_measured_in_real_time_when_simulated_time_runs_fast(world):
    boat = Boat(world, own_ship_source="odometry", use_sim_time=True)
    time = SimulatedTime(boat)
    sent = SENT[:6]
    for index, ping in enumerate(sent):
        # The scan overtakes its odometry by far less than a second, or five in simulated time.
        boat.driver.ping(ping)
        world.until(lambda: world.figures()["waiting_for_own_ship"] == "1", "the scan to wait")
        time.set(ping.stamp_ns + 5 * SECOND)
        world.statuses()
        publish_poses(boat, Ship(), 12 * index, 12 * index + 8)
        world.until(lambda: world.figures()["waiting_for_own_ship"] == "0", "the scan to be taken")
    assert_same(boat.tracks, confirmed(sent))
    assert world.dropped() == {}
