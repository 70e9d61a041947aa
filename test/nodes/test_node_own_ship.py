"""A sonar on a moving ship: poses from odometry or tf, in time, late, stale or missing."""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass, field
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import PointCloud2
from support.boat import Boat
from support.expectation import as_scan, assert_same, assert_stamps, confirmed, initiator
from support.ros_world import BEST_EFFORT, WARN
from support.sonar_driver import START_NS, Driver, Ping, cloud, pings, points, stamp_ns

SECOND = 10**9
LARGEST_FLOAT = sys.float_info.max
SOUND_SPEED = 1500.0
SENT = pings(12)
SOON = 0.5
"""A wait for own-ship data that is over soon, but not before what is there has been read, s."""


@dataclass(frozen=True)
class Ship:
    """A ship that goes round in circles, or straight on; times are seconds after the start."""

    speed: float = 0.0
    turn_rate: float = 0.0
    start: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def pose(self, time: float) -> tuple[float, float, float]:
        x, y, yaw = self.start
        # Small steps in place of the circle's formula.
        steps = max(1, math.ceil(abs(time) * 20))
        angles = yaw + self.turn_rate * time * (np.arange(steps) + 0.5) / steps
        x += self.speed * time * float(np.cos(angles).mean())
        y += self.speed * time * float(np.sin(angles).mean())
        return x, y, yaw + self.turn_rate * time


MOVING = Ship(speed=8.0, start=(500.0, -200.0, 0.7))
TURNING = Ship(speed=6.0, turn_rate=math.radians(3.0), start=(-300.0, 400.0, 2.5))


def publish_poses(boat: Boat, ship: Ship, first: float, last: float, step: float = 4.0) -> None:
    """Publish odometry from `first` to `last`, s after the start."""
    for time in np.arange(first, last + step / 2, step).tolist():
        boat.driver.pose(START_NS + round(time * SECOND), *ship.pose(time))


def seen_from(ship: Ship, time: float, x: float, y: float) -> tuple[float, float]:
    """Range and azimuth of a place for a sensor whose echoes arrive at once."""
    ship_x, ship_y, yaw = ship.pose(time)
    return math.hypot(x - ship_x, y - ship_y), math.atan2(y - ship_y, x - ship_x) - yaw


def echo(
    ship: Ship, time: float, target: tuple[float, float, float, float]
) -> tuple[float, float, float]:
    """Range, azimuth and time of validity of a moving target's echo of a ping sent at `time`."""
    x0, vx, y0, vy = target
    out = back = 0.0
    for _ in range(30):
        hit_x, hit_y = x0 + vx * (time + out), y0 + vy * (time + out)
        sent_x, sent_y, _ = ship.pose(time)
        out = math.hypot(hit_x - sent_x, hit_y - sent_y) / SOUND_SPEED
        got_x, got_y, yaw = ship.pose(time + out + back)
        back = math.hypot(hit_x - got_x, hit_y - got_y) / SOUND_SPEED
    distance = SOUND_SPEED * (out + back) / 2
    return distance, math.atan2(hit_y - got_y, hit_x - got_x) - yaw, distance / SOUND_SPEED


TARGET = (2500.0, -3.0, 1800.0, 4.0)


@pytest.mark.parametrize("ship", [MOVING, TURNING], ids=["moving", "turning"])
def test_tracks_are_in_the_odometrys_frame_wherever_the_ship_goes(world, ship):
    boat = Boat(world, own_ship_source="odometry")
    publish_poses(boat, ship, 0, 61, step=0.25)
    for index in range(6):
        time = 12.0 * index
        distance, azimuth = seen_from(ship, time, *at(TARGET, time))
        boat.driver.ping(Ping(START_NS + round(time * SECOND), [distance], [azimuth]))
    received = boat.take(6, 0)
    [(message, point)] = [(one, p) for one in received for p in points(one)]
    assert message.header.frame_id == "odom"
    time = (stamp_ns(message) - START_NS) / SECOND
    x, y = at(TARGET, time)
    assert math.hypot(point["x"] - x, point["y"] - y) < 2.0
    assert math.hypot(point["state_vx"] - TARGET[1], point["state_vy"] - TARGET[3]) < 0.1


def at(target: tuple[float, float, float, float], time: float) -> tuple[float, float]:
    x, vx, y, vy = target
    return x + vx * time, y + vy * time


@pytest.mark.parametrize("ship", [MOVING, TURNING], ids=["moving", "turning"])
def test_echoes_are_placed_at_the_times_when_they_came_back(world, ship):
    boat = Boat(world, own_ship_source="odometry")
    publish_poses(boat, ship, 0, 70, step=0.25)
    for index in range(6):
        time = 12.0 * index
        distance, azimuth, offset = echo(ship, time, TARGET)
        ping = Ping(START_NS + round(time * SECOND), [distance], [azimuth])
        boat.driver.ping(ping, time_offset=[offset])
    [(message, point)] = [(one, p) for one in boat.take(6, 0) for p in points(one)]
    time = (stamp_ns(message) - START_NS) / SECOND
    x, y = at(TARGET, time)
    assert math.hypot(point["x"] - x, point["y"] - y) < 2.0
    assert math.hypot(point["state_vx"] - TARGET[1], point["state_vy"] - TARGET[3]) < 0.1


def test_poses_between_odometry_are_interpolated_across_the_turn_of_the_angle(world):
    ship = Ship(turn_rate=math.radians(5.0), start=(0.0, 0.0, math.pi - 0.2))
    boat = Boat(world, own_ship_source="odometry")
    for index in range(0, 70, 7):
        x, y, yaw = ship.pose(index)
        boat.driver.pose(START_NS + index * SECOND, x, y, math.remainder(yaw, 2 * math.pi))
    for index in range(6):
        time = 10.0 * index
        distance, azimuth = seen_from(ship, time, *at(TARGET, time))
        boat.driver.ping(Ping(START_NS + round(time * SECOND), [distance], [azimuth]))
    [(message, point)] = [(one, p) for one in boat.take(6, 0) for p in points(one)]
    x, y = at(TARGET, (stamp_ns(message) - START_NS) / SECOND)
    assert math.hypot(point["x"] - x, point["y"] - y) < 2.0


def test_the_covariance_of_the_odometry_widens_that_of_the_track(world):
    boat = Boat(world, own_ship_source="odometry")
    pose = np.zeros((6, 6))
    pose[0, 0], pose[1, 1], pose[5, 5] = 400.0, 900.0, 1e-4
    for index in range(150):
        message = Odometry(child_frame_id="sonar")
        message.header.frame_id = "odom"
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(
            START_NS + index * SECOND, SECOND
        )
        message.pose.pose.orientation.w = 1.0
        message.pose.covariance = pose.ravel()
        boat.driver.odometry.publish(message)
    same = initiator()
    covariance = np.diag([400.0, 900.0, 1e-4])
    expected = [same.process(as_scan(p, sensor_pose_covariance=covariance)) for p in SENT]
    received = boat.send(SENT)
    assert_same(received, expected)
    plain = [track for tracks in confirmed(SENT) for track in tracks]
    wide = [point for message in received for point in points(message)]
    assert wide[0]["cov_00"] > plain[0].covariance[0, 0] + 100


def test_bearings_from_north_need_no_heading(world):
    ship = Ship(speed=6.0, turn_rate=math.radians(3.0))
    boat = Boat(world, own_ship_source="odometry", bearing_reference="north")
    publish_poses(boat, ship, 0, 61)
    for index in range(6):
        time = 12.0 * index
        x, y = at(TARGET, time)
        ship_x, ship_y, _ = ship.pose(time)
        bearing = math.atan2(x - ship_x, y - ship_y)  # clockwise from the y axis, which is north
        columns = {"range": [math.hypot(x - ship_x, y - ship_y)], "bearing": [bearing]}
        boat.driver.publisher.publish(cloud(START_NS + round(time * SECOND), columns))
    [(message, point)] = [(one, p) for one in boat.take(6, 0) for p in points(one)]
    x, y = at(TARGET, (stamp_ns(message) - START_NS) / SECOND)
    assert math.hypot(point["x"] - x, point["y"] - y) < 2.0


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


@pytest.mark.parametrize(
    ("spoil", "reason"),
    [
        pytest.param(
            lambda m: setattr(m.pose.pose.position, "x", math.nan),
            "own_ship_invalid",
            id="position_nan",
        ),
        pytest.param(
            lambda m: setattr(m.pose.pose.position, "y", 1e300),
            "own_ship_invalid",
            id="position_absurd",
        ),
        pytest.param(
            lambda m: setattr(m.pose.pose.orientation, "w", 0.0),
            "own_ship_invalid",
            id="no_orientation",
        ),
        pytest.param(
            lambda m: setattr(m.twist.twist.linear, "x", math.inf),
            "own_ship_invalid",
            id="speed_infinite",
        ),
        pytest.param(
            lambda m: m.pose.covariance.__setitem__(0, -1.0),
            "own_ship_invalid",
            id="covariance_negative",
        ),
        pytest.param(
            lambda m: setattr(m.pose, "covariance", np.tile([0.0, LARGEST_FLOAT], 18)),
            "own_ship_invalid",
            id="covariance_overflows",
        ),
        pytest.param(
            lambda m: setattr(m.header, "frame_id", "elsewhere"), "own_ship_frame", id="other_frame"
        ),
        pytest.param(
            lambda m: setattr(m.header.stamp, "sec", START_NS // SECOND - 20),
            "own_ship_late",
            id="late",
        ),
    ],
)
def test_bad_odometry_is_dropped_counted_and_named(world, spoil, reason):
    boat = Boat(world, own_ship_source="odometry")
    publish_poses(boat, Ship(), 0, 30)
    bad = Odometry(child_frame_id="sonar")
    bad.header.frame_id = "odom"
    bad.header.stamp.sec = START_NS // SECOND + 31
    bad.pose.pose.orientation.w = 1.0
    spoil(bad)
    boat.driver.odometry.publish(bad)
    publish_poses(boat, Ship(), 32, 140)
    assert_same(boat.send(SENT), confirmed(SENT))
    assert world.dropped() == {reason: 1}
    world.until_logged(reason, "own-ship", level=WARN)


def test_the_largest_float_says_that_a_position_is_not_known(world):
    boat = Boat(world, own_ship_source="odometry", own_ship_timeout=3600.0)
    covariance = np.zeros((6, 6))
    covariance[:2, :2] = LARGEST_FLOAT
    for index in range(150):
        message = Odometry(child_frame_id="sonar")
        message.header.frame_id = "odom"
        message.header.stamp.sec = START_NS // SECOND + index
        message.pose.pose.orientation.w = 1.0
        message.pose.covariance = covariance.ravel()
        boat.driver.odometry.publish(message)
    assert len(boat.send(SENT)) == len(SENT)
    assert world.dropped() == {}


def test_a_burst_of_scans_and_odometry_loses_none(world):
    boat = Boat(world, own_ship_source="odometry")
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


def test_best_effort_odometry_is_read(world):
    boat = Boat(world, own_ship_source="odometry")
    world.end(boat.driver)
    boat.driver = world.add(Driver(world.context, odometry_qos=BEST_EFFORT))
    boat.connect()
    world.until(boat.driver.odometry.get_subscription_count, "the node to read the odometry")
    publish_poses(boat, Ship(), 0, 132)
    assert_same(boat.send(SENT), confirmed(SENT))


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
    world.until_logged("starting over")
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


@dataclass
class Transforms:
    """A stand-in for tf2_ros.Buffer: what tf knows, and what it was asked."""

    ship: Ship
    first: float = -math.inf
    last: float = math.inf
    asked: list[tuple[str, str, float]] = field(default_factory=list)

    def can_transform(self, target: str, source: str, time: Any, *_: Any) -> bool:
        seconds = (time.nanoseconds - START_NS) / SECOND
        return target == "map" and source == "sonar" and self.first <= seconds <= self.last

    def lookup_transform(self, target: str, source: str, time: Any, *_: Any) -> Any:
        assert self.can_transform(target, source, time), "tf2 would raise an exception"
        seconds = (time.nanoseconds - START_NS) / SECOND
        self.asked.append((target, source, seconds))
        x, y, yaw = self.ship.pose(seconds)
        rotation = SimpleNamespace(x=0.0, y=0.0, z=math.sin(yaw / 2), w=math.cos(yaw / 2))
        translation = SimpleNamespace(x=x, y=y, z=0.0)
        return SimpleNamespace(
            transform=SimpleNamespace(translation=translation, rotation=rotation)
        )


@pytest.fixture
def tf(monkeypatch):
    """Puts a stand-in for tf2_ros in place; returns a function that says what tf knows."""

    def know(transforms: Transforms) -> None:
        module = ModuleType("tf2_ros")
        module.Buffer = lambda **_: transforms  # type: ignore[attr-defined]
        module.TransformListener = lambda *_: None  # type: ignore[attr-defined]
        monkeypatch.setitem(sys.modules, "tf2_ros", module)

    return know


def from_tf(world: Any, **parameters: Any) -> Boat:
    return Boat(world, own_ship_source="tf", fixed_frame="map", **parameters)


@pytest.mark.parametrize("with_offsets", [True, False], ids=["time_offset", "at_once"])
def test_tf_places_scans_with_the_frames_own_rotation(world, tf, with_offsets):
    tf(Transforms(TURNING))
    boat = from_tf(world)
    for index in range(6):
        time = 12.0 * index
        stamp = START_NS + round(time * SECOND)
        if with_offsets:
            distance, azimuth, offset = echo(TURNING, time, TARGET)
            boat.driver.ping(Ping(stamp, [distance], [azimuth]), time_offset=[offset])
        else:
            distance, azimuth = seen_from(TURNING, time, *at(TARGET, time))
            boat.driver.ping(Ping(stamp, [distance], [azimuth]))
    [(message, point)] = [(one, p) for one in boat.take(6, 0) for p in points(one)]
    assert message.header.frame_id == "map"
    x, y = at(TARGET, (stamp_ns(message) - START_NS) / SECOND)
    assert math.hypot(point["x"] - x, point["y"] - y) < 2.0
    assert math.hypot(point["state_vx"] - TARGET[1], point["state_vy"] - TARGET[3]) < 0.1


def test_tf_gives_no_false_warnings(world, tf):
    tf(Transforms(MOVING))
    boat = from_tf(world, sound_speed=1500.0)
    boat.send(SENT)
    assert world.dropped() == {}
    assert world.logged(WARN) == []


def test_tf_places_pings_that_are_far_apart(world, tf):
    tf(Transforms(Ship()))
    boat = from_tf(world, max_speed=1.0)
    sent = pings(6, period=100.0, targets=((3000.0, 0.3, 1500.0, -0.2),), clutter=3)
    assert_same(boat.send(sent), confirmed(sent, max_speed=1.0))


def test_a_scan_waits_for_tf_and_is_dropped_when_it_does_not_come(world, tf):
    known = Transforms(Ship(), last=-1.0)
    tf(known)
    boat = from_tf(world, own_ship_timeout=SOON)
    boat.driver.ping(Ping(START_NS - 12 * SECOND, [], []))
    boat.take(1, 0)
    boat.driver.ping(SENT[0])
    reasons = {"own_ship_missing", "own_ship_stale"}
    world.until(lambda: reasons & world.dropped().keys(), "the count")
    known.last = math.inf
    assert_same(boat.send(SENT[1:]), confirmed(SENT[1:]))


def test_a_scan_is_processed_as_soon_as_tf_knows_its_last_echo(world, tf):
    known = Transforms(Ship(), last=1.0)
    tf(known)
    boat = from_tf(world, own_ship_timeout=3600.0)
    boat.driver.ping(Ping(START_NS, [1000.0, 3000.0], [0.0, 0.1]), time_offset=[0.7, 2.0])
    world.until(lambda: world.figures()["waiting_for_own_ship"] == "1", "the scan to wait")
    assert len(boat.tracks) == 0
    known.last = 10.0
    boat.take(1, 0)
    # Nothing is known of tf between the times that were asked for: they must be close.
    times = sorted({seconds for _, _, seconds in known.asked})
    assert times[0] == pytest.approx(0.0, abs=1e-6)
    assert times[-1] == pytest.approx(4.0)
    assert np.diff(times).max() <= 0.5 + 1e-6


def test_tf_places_scans_after_a_restart(world, tf):
    tf(Transforms(Ship()))
    boat = from_tf(world)
    assert_same(boat.send(SENT), confirmed(SENT))
    again = pings(start_ns=START_NS - 5000 * SECOND, seed=3)
    assert_same(boat.send(again), confirmed(again))
    assert world.dropped().keys() <= {"own_ship_late"}


@pytest.mark.parametrize("name", ["stamp_before_1970", "time_offset_far_ahead"])
def test_no_stamp_or_time_offset_ends_the_node_that_reads_tf(world, tf, name):
    tf(Transforms(Ship(), last=1000.0))
    boat = from_tf(world, own_ship_timeout=SOON)
    if name == "stamp_before_1970":
        boat.driver.ping(Ping(-5 * SECOND, [1000.0], [0.0]))
    else:
        ping = Ping(START_NS - 30 * SECOND, [1000.0], [0.0])
        boat.driver.ping(ping, time_offset=[9e5])
    world.until(lambda: sum(world.dropped().values()) == 1, "the count")
    assert_same(boat.send(SENT), confirmed(SENT))


def test_a_scan_that_tf_never_places_does_not_cost_those_behind_it(world, tf):
    tf(Transforms(Ship(), first=-1.0))
    boat = from_tf(world, own_ship_timeout=SOON)
    boat.driver.ping(Ping(START_NS - 30 * SECOND, [1000.0], [0.0]))
    assert_same(boat.send(SENT), confirmed(SENT))
    assert sum(world.dropped().values()) == 1


def test_the_frame_of_the_sensor_may_be_given(world):
    boat = Boat(world, sensor_frame="sonar")
    boat.driver.ping(Ping(START_NS - SECOND, [1000.0], [0.0]), frame_id="radar")
    received = boat.send(SENT)
    assert_same(received, confirmed(SENT))
    assert world.dropped() == {"unknown_frame": 1}
    assert {message.header.frame_id for message in received} == {"sonar"}


def test_current_tracks_are_carried_in_the_fixed_frame(world):
    boat = Boat(world, own_ship_source="odometry")
    current = world.listen(PointCloud2, "tracks/current")
    world.until_connected()
    publish_poses(boat, MOVING, 0, 121)
    for index in range(10):
        time = 12.0 * index
        distance, azimuth = seen_from(MOVING, time, *at(TARGET, time))
        boat.driver.ping(Ping(START_NS + round(time * SECOND), [distance], [azimuth]))
    world.until(lambda: len(current) == 10, "the current tracks")
    assert current[-1].header.frame_id == "odom"
    x, y = at(TARGET, 108.0)
    places = [(point["x"], point["y"]) for point in points(current[-1])]
    assert all(math.hypot(px - x, py - y) < 5.0 for px, py in places) and places
