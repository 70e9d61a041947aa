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
"""A sonar on a moving ship: placed by odometry or tf, in time, late or never, on either clock."""

import math
from time import sleep
from typing import Any

import numpy as np
import pytest
from nav_msgs.msg import Odometry
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import PointCloud2
from support.boat import Boat
from support.expectation import STATE, assert_same, confirmed
from support.ros_world import BEST_EFFORT, LATCHED, RELIABLE, WARN
from support.ship import (
    MOVING,
    SECOND,
    TARGET,
    TURNING,
    Ship,
    at,
    echo,
    publish_poses,
    seen_from,
)
from support.sonar_driver import START_NS, Driver, Ping, pings, points, stamp_ns
from support.transforms import Transforms, level

from msg_adapters import make_header
from tsepm_ros.nodes import base_node

SENT = pings(12)
SOON = 0.5
"""A wait for own-ship data that is over soon, but not before what is there has been read, s."""


@pytest.fixture
def by_tf(world, monkeypatch):
    """Makes a boat with what tf knows of a ship; returns both."""

    def make(ship: Ship, first: float = -math.inf, last: float = math.inf, **parameters: Any):
        known = Transforms(lambda time: level(*ship.pose(time)), first, last, ("map", "sonar"))
        known.install(monkeypatch)
        return known, Boat(world, own_ship_source="tf", fixed_frame="map", **parameters)

    return make


def assert_started(boat: Boat, ship: Ship, frame_id: str, *, with_offsets: bool = False) -> None:
    """Check that the target is started where it is, in the fixed frame."""
    for time in np.arange(6) * 12.0:
        stamp = START_NS + round(time * SECOND)
        if with_offsets:
            distance, azimuth, offset = echo(ship, time, TARGET)
            boat.driver.ping(Ping(stamp, [distance], [azimuth]), time_offset=[offset])
        else:
            distance, azimuth = seen_from(ship, time, *at(TARGET, time))
            boat.driver.ping(Ping(stamp, [distance], [azimuth]))
    [(message, point)] = [(one, p) for one in boat.take(6, 0) for p in points(one)]
    assert message.header.frame_id == frame_id
    x, y = at(TARGET, (stamp_ns(message) - START_NS) / SECOND)
    assert math.hypot(point["x"] - x, point["y"] - y) < 2.0
    assert math.hypot(point["state_vx"] - TARGET[1], point["state_vy"] - TARGET[3]) < 0.1
    assert boat.world.dropped() == {}


@pytest.mark.parametrize(
    ("ship", "qos"),
    [(MOVING, RELIABLE), (TURNING, BEST_EFFORT)],
    ids=["moving", "turning, best effort"],
)
def test_tracks_are_in_the_odometrys_frame_wherever_the_ship_goes(world, ship, qos):
    boat = Boat(world, own_ship_source="odometry")
    world.end(boat.driver)
    boat.driver = world.add(Driver(world.context, odometry_qos=qos))
    boat.connect()
    world.until(boat.driver.odometry.get_subscription_count, "the node to read the odometry")
    publish_poses(boat, ship, 0, 61, step=0.25)
    assert_started(boat, ship, "odom")


@pytest.mark.parametrize("with_offsets", [True, False], ids=["time_offset", "at_once"])
def test_tf_places_scans_with_the_frames_own_rotation(world, by_tf, with_offsets):
    _, boat = by_tf(TURNING)
    assert_started(boat, TURNING, "map", with_offsets=with_offsets)
    assert not with_offsets or world.logged(WARN) == []


def test_tracks_of_odometry_in_a_ned_frame_are_in_its_axes(world):
    """A ship that heads east: yaw 90 degrees from north, x ahead and z down."""
    boat = Boat(world, own_ship_source="odometry", publish_potential_tracks=True)
    placed = world.listen(PointCloud2, "detections/placed")
    current = world.listen(PointCloud2, "tracks/current", LATCHED)
    world.until_connected()
    for second in range(0, 140, 4):
        pose = Odometry(child_frame_id="base_link_ned")
        pose.header = make_header(START_NS + second * SECOND, "world_ned")
        pose.pose.pose.position.x, pose.pose.pose.position.y = 50.0, 20.0
        turned = pose.pose.pose.orientation
        turned.z = turned.w = math.sqrt(0.5)
        boat.driver.odometry.publish(pose)
    received = boat.send(SENT)
    expected = [track for tracks in confirmed(SENT) for track in tracks]
    found = [point for message in received for point in points(message)]
    assert {message.header.frame_id for message in received} == {"world_ned"}
    assert len(found) == len(expected) > 0
    for point, track in zip(found, expected, strict=True):
        x, vx, y, vy = track.state
        north_east = [point[name] for name in STATE]
        np.testing.assert_allclose(north_east, [y + 50.0, vy, x + 20.0, vx], atol=1e-6)
        assert point["cov_00"] == pytest.approx(track.covariance[2, 2])
        assert point["cov_02"] == pytest.approx(track.covariance[2, 0])
    world.until(lambda: len(placed) == len(SENT) and current, "the other topics")
    range_, azimuth = np.array(SENT[-1].range), np.array(SENT[-1].azimuth)
    north = [row["position_x"] for row in points(placed[-1])]  # without the bias of azimuth errors
    np.testing.assert_allclose(north, 50.0 + range_ * np.sin(azimuth), rtol=3e-4)


def test_a_scan_waits_for_tf_and_is_dropped_when_it_does_not_come(world, by_tf):
    # By tsepm, which does not count the ping before: its evaluations are those of the others alone.
    known, boat = by_tf(Ship(), last=-1.0, own_ship_timeout=SOON, method="tsepm")
    boat.driver.ping(Ping(START_NS - 12 * SECOND, [], []))
    boat.take(1, 0)
    boat.driver.ping(SENT[0])
    reasons = {"own_ship_missing", "own_ship_stale"}
    world.until(lambda: reasons & world.dropped().keys(), "the count")
    world.until_logged("tf has no transform from 'sonar' to 'map' at", level=WARN)
    known.last = math.inf
    assert_same(boat.send(SENT[1:]), confirmed(SENT[1:], method="tsepm"))


def test_a_scan_is_processed_as_soon_as_tf_knows_its_last_echo(world, by_tf):
    known, boat = by_tf(Ship(), last=1.0, own_ship_timeout=3600.0)
    boat.driver.ping(Ping(START_NS, [1000.0, 3000.0], [0.0, 0.1]), time_offset=[0.7, 2.0])
    world.until(lambda: world.figures()["waiting_for_own_ship"] == "1", "the scan to wait")
    assert len(boat.tracks) == 0
    known.last = 10.0
    boat.take(1, 0)
    # Nothing is known of tf between the times that were asked for: they must be close.
    times = sorted(set(known.asked))
    assert times[0] == pytest.approx(0.0, abs=1e-6)
    assert times[-1] == pytest.approx(4.0)
    assert np.diff(times).max() <= 0.5 + 1e-6


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


class SimulatedTime:
    """Publishes /clock."""

    def __init__(self, boat: Boat) -> None:
        self.boat, self.world = boat, boat.world
        self.clock = self.world.observer.create_publisher(Clock, "/clock", 10)
        self.world.until_connected()

    def set(self, nanoseconds: int) -> None:
        message = Clock()
        message.clock.sec, message.clock.nanosec = divmod(nanoseconds, SECOND)
        self.clock.publish(message)
        clock = self.boat.node.get_clock()
        self.world.until(lambda: clock.now().nanoseconds == nanoseconds, "the time")


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


def test_the_time_is_that_of_clock_and_its_jumps_do_no_harm(world):
    boat = Boat(world, use_sim_time=True)
    time = SimulatedTime(boat)
    time.set(1234 * SECOND + 567)
    world.statuses()
    world.until(lambda: stamp_ns(world.diagnostics[-1]) == 1234 * SECOND + 567, "the time in use")
    sent = pings(start_ns=1000 * SECOND)
    received = []
    for seconds, ping in zip([5000, 1000, 3, 3, 9000] * 3, sent, strict=False):
        time.set(seconds * SECOND)
        received += boat.send([ping])
    assert_same(received, confirmed(sent))


@pytest.mark.parametrize("clock_begins", [True, False], ids=["stops", "never begins"])
def test_a_clock_that_stands_still_is_said_and_scans_do_not_wait_for_it(
    world, monkeypatch, clock_begins
):
    """By the wall clock: in the entry, in the log, and in the wait for own-ship data."""
    monkeypatch.setattr(base_node, "MAX_STANDING", 0.5)
    boat = Boat(world, own_ship_source="odometry", own_ship_timeout=0.2, use_sim_time=True)
    time, sent = SimulatedTime(boat), pings(12)
    if clock_begins:
        time.set(sent[0].stamp_ns)
    boat.driver.ping(sent[0])
    world.until(lambda: world.dropped() == {"own_ship_missing": 1}, "the scan's end")
    world.until_logged("stands still", "is /clock published?", level=WARN)
    status = world.status("detections")
    assert (status.level, "stands still" in status.message) == (b"\x01", True)
    time.set(sent[1].stamp_ns)
    publish_poses(boat, Ship(), 0, 140)
    assert_same(boat.send(sent[1:]), confirmed(sent[1:]))
