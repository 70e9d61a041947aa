"""Scans that wait for odometry: in time, late, stale, missing, and after a restart."""

from __future__ import annotations

import math
from time import sleep
from typing import Any

import numpy as np
import pytest
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock
from support.boat import Boat
from support.expectation import assert_same, assert_stamps, confirmed
from support.ros_world import WARN
from support.ship import (
    MOVING,
    SECOND,
    TARGET,
    Ship,
    at,
    publish_poses,
    seen_from,
)
from support.sonar_driver import START_NS, Ping, pings, points, stamp_ns

SENT = pings(12)
SOON = 0.5
"""A wait for own-ship data that is over soon, but not before what is there has been read, s."""


def until_poses_are_read(world, ahead: float) -> None:
    """Wait until the newest pose is a time, s, after the newest scan."""

    def ahead_now() -> float:
        values = {pair.key: pair.value for pair in world.status("own ship").values}
        return -float(values.get("behind_newest_scan_s", "inf"))

    world.until(lambda: ahead_now() >= ahead, "the poses to be read")


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


def test_a_scan_waits_until_its_last_echo_is_covered(world):
    boat = Boat(world, own_ship_source="odometry", own_ship_timeout=3600.0)
    publish_poses(boat, Ship(), 0, 5, step=1.0)
    boat.driver.ping(Ping(START_NS, [1000.0, 5000.0], [0.0, 0.1]), time_offset=[0.5, 4.0])
    world.until(lambda: world.figures()["waiting_for_own_ship"] == "1", "the scan to wait")
    assert len(boat.tracks) == 0
    publish_poses(boat, Ship(), 6, 8, step=1.0)
    boat.take(1, 0)


def test_a_scan_without_odometry_is_dropped_counted_and_named(world):
    boat = Boat(world, own_ship_source="odometry", own_ship_timeout=SOON)
    boat.driver.ping(Ping(START_NS - 60 * SECOND, [1000.0], [0.0]))
    world.until(lambda: world.dropped() == {"own_ship_missing": 1}, "the count")
    world.until_logged("own_ship_missing", "no own-ship data", level=WARN)
    assert len(boat.tracks) == 0
    publish_poses(boat, Ship(), 0, 140)
    assert_same(boat.send(SENT), confirmed(SENT))
    assert world.dropped() == {"own_ship_missing": 1}


def test_a_scan_with_stale_odometry_is_dropped_counted_and_named(world):
    boat = Boat(world, own_ship_source="odometry", own_ship_timeout=SOON)
    publish_poses(boat, Ship(), 0, 40)
    received = boat.send(SENT[:4])
    boat.driver.ping(SENT[4])  # at 48 s
    world.until(lambda: world.dropped() == {"own_ship_stale": 1}, "the count")
    world.until_logged("own_ship_stale", "no own-ship data", level=WARN)
    publish_poses(boat, Ship(), 55, 140)
    until_poses_are_read(world, 91.0)
    received += boat.send(SENT[5:])
    assert_same(received, confirmed([*SENT[:4], *SENT[5:]]))


def test_a_scan_in_a_hole_of_the_odometry_is_dropped(world):
    boat = Boat(world, own_ship_source="odometry", own_ship_max_gap=20.0)
    publish_poses(boat, Ship(), 0, 40)
    received = boat.send(SENT[:4])
    publish_poses(boat, Ship(), 70, 140)
    boat.driver.ping(SENT[4])  # at 48 s
    received += boat.send(SENT[6:])
    assert_same(received, confirmed([*SENT[:4], *SENT[6:]]))
    assert world.dropped() == {"own_ship_stale": 1}


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


def test_a_scan_older_than_all_odometry_is_dropped_at_once(world):
    boat = Boat(world, own_ship_source="odometry", own_ship_timeout=3600.0)
    boat.driver.ping(Ping(START_NS - 30 * SECOND, [1000.0], [0.0]))
    world.until(lambda: world.figures()["waiting_for_own_ship"] == "1", "the scan to wait")
    publish_poses(boat, Ship(), 0, 140)
    world.until(lambda: world.dropped() == {"own_ship_stale": 1}, "the count")
    assert_same(boat.send(SENT), confirmed(SENT))


def test_odometry_a_little_older_than_the_scan_still_places_it_after_the_wait(world):
    boat = Boat(world, own_ship_source="odometry", own_ship_timeout=SOON)
    publish_poses(boat, MOVING, 0, 11.75, step=0.25)
    distance, azimuth = seen_from(MOVING, 12.0, *at(TARGET, 12.0))
    boat.driver.ping(Ping(START_NS + 12 * SECOND, [distance], [azimuth]))
    boat.take(1, 0)
    assert world.dropped() == {}


def test_a_burst_of_scans_and_odometry_loses_none(world):
    boat = Boat(world, own_ship_source="odometry", own_ship_timeout=3600.0)
    sent = pings(100)
    publish_poses(boat, Ship(), 0, 1200)
    received = boat.send(sent)
    assert_same(received, confirmed(sent))
    assert world.dropped() == {}


def test_after_a_restart_scans_are_placed_by_the_new_odometry(world):
    boat = Boat(world, own_ship_source="odometry")
    publish_poses(boat, Ship(), 0, 132)
    assert_same(boat.send(SENT), confirmed(SENT))
    back = 5000 * SECOND
    again = pings(start_ns=START_NS - back, seed=3)
    seen = len(boat.tracks)
    boat.driver.ping(again[0])  # the first scan may well be faster than the odometry
    world.until(lambda: world.figures()["waiting_for_own_ship"] == "1", "the scan to wait")
    for seconds in range(0, 140, 4):
        boat.driver.pose(START_NS - back + seconds * SECOND, 0, 0, 0)
    for ping in again[1:]:
        boat.driver.ping(ping)
    received = boat.take(len(again), seen)
    assert_same(received, confirmed(again))
    assert_stamps(received, again)
    assert world.dropped() == {}


def set_time(world, boat: Boat, clock: Any, nanoseconds: int) -> None:
    message = Clock()
    message.clock.sec, message.clock.nanosec = divmod(nanoseconds, SECOND)
    clock.publish(message)
    world.until(lambda: boat.node.get_clock().now().nanoseconds == nanoseconds, "the time")


@pytest.mark.parametrize("simulated_time", [False, True], ids=["real time", "looping bag"])
def test_after_a_short_restart_scans_are_not_placed_by_the_poses_before_it(world, simulated_time):
    boat = Boat(
        world, own_ship_source="odometry", own_ship_timeout=SOON, use_sim_time=simulated_time
    )
    clock = world.observer.create_publisher(Clock, "/clock", 10)
    world.until_connected()
    target = (1000.0, 2.0, 2000.0, 1.0)
    for ship in (MOVING, Ship(start=(5000.0, 4000.0, 0.3))):
        if simulated_time:
            set_time(world, boat, clock, START_NS)  # back, the second time
        publish_poses(boat, ship, 0, 40, step=1.0)
        for time in range(0, 40, 4):
            distance, azimuth = seen_from(ship, time, *at(target, time))
            boat.driver.ping(Ping(START_NS + time * SECOND, [distance], [azimuth]))
        world.until(
            lambda: boat.tracks and stamp_ns(boat.tracks[-1]) == START_NS + 36 * SECOND,
            "the last scan",
        )
        tracks = list(boat.tracks)
        boat.tracks.clear()
        if simulated_time:
            set_time(world, boat, clock, START_NS + 41 * SECOND)
    world.until_logged("state reset")
    found = [(message, point) for message in tracks for point in points(message)]
    assert found, "eight scans or so see the target"
    for message, point in found:
        x, y = at(target, (stamp_ns(message) - START_NS) / SECOND)
        assert math.hypot(point["x"] - x, point["y"] - y) < 20.0


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


def test_a_gap_that_begins_with_a_dropped_scan_is_still_a_gap(world):
    boat = Boat(world, own_ship_source="odometry", own_ship_timeout=SOON)
    publish_poses(boat, Ship(), 0, 48)
    received = boat.send(SENT[:4])
    later = pings(12, seed=3, start_ns=SENT[3].stamp_ns + 4000 * SECOND)
    boat.driver.ping(later[0])
    world.until(lambda: world.dropped() == {"own_ship_stale": 1}, "the count")
    publish_poses(boat, Ship(), 36 + 4010, 36 + 4140)
    until_poses_are_read(world, 139.0)
    received += boat.send(later[1:])
    assert_same(received, [[]] * 4 + confirmed(later[1:]))


def test_a_time_offset_before_all_odometry_costs_one_scan_at_most(world):
    boat = Boat(world, own_ship_source="odometry")
    publish_poses(boat, Ship(), 0, 140)
    received = boat.send(SENT[:4])
    odd = SENT[4]
    offsets = np.zeros(len(odd.range))
    offsets[-1] = -1e4
    boat.driver.ping(odd, time_offset=offsets)
    for ping in SENT[5:]:
        boat.driver.ping(ping)
    last = SENT[-1].stamp_ns
    world.until(lambda: stamp_ns(boat.tracks[-1]) == last, "the last scan's tracks")
    assert len(boat.tracks) >= len(received) + len(SENT[5:])
    assert sum(world.dropped().values()) <= 1
    x = [point["x"] for message in boat.tracks for point in points(message)]
    assert any(2900 < value < 3500 for value in x), "the target that was there all along"


def test_an_empty_scan_needs_no_odometry_of_the_future(world):
    boat = Boat(world, own_ship_source="odometry", own_ship_timeout=3600.0)
    publish_poses(boat, Ship(), 0, 2)
    boat.send([Ping(START_NS, [], [])])
