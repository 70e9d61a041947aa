"""The node with poses from tf: in time, late or never."""

import math
import sys
from dataclasses import dataclass, field
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
from support.boat import Boat
from support.expectation import assert_same, confirmed
from support.ros_world import WARN
from support.ship import MOVING, SECOND, TARGET, TURNING, Ship, at, echo, seen_from
from support.sonar_driver import START_NS, Ping, pings, points, stamp_ns

SENT = pings(12)
SOON = 0.5
"""A wait for own-ship data that is over soon, but not before what is there has been read, s."""


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


def test_a_scan_waits_for_tf_and_is_dropped_when_it_does_not_come(world, tf):
    known = Transforms(Ship(), last=-1.0)
    tf(known)
    boat = from_tf(world, own_ship_timeout=SOON)
    boat.driver.ping(Ping(START_NS - 12 * SECOND, [], []))
    boat.take(1, 0)
    boat.driver.ping(SENT[0])
    reasons = {"own_ship_missing", "own_ship_stale"}
    world.until(lambda: reasons & world.dropped().keys(), "the count")
    world.until_logged("tf has no transform from 'sonar' to 'map' at", level=WARN)
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
