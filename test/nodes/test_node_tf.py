"""The node with poses from tf: in time, late or never."""

import math
from typing import Any

import numpy as np
import pytest
from support.boat import Boat
from support.expectation import assert_same, confirmed
from support.ros_world import WARN
from support.ship import SECOND, TARGET, TURNING, Ship, at, echo, seen_from
from support.sonar_driver import START_NS, Ping, pings, points, stamp_ns
from support.transforms import Transforms, level

SENT = pings(12)
SOON = 0.5
"""A wait for own-ship data that is over soon, but not before what is there has been read, s."""


@pytest.fixture
def boat(world, monkeypatch):
    """Makes a boat with what tf knows of a ship; returns both."""

    def make(ship: Ship, first: float = -math.inf, last: float = math.inf, **parameters: Any):
        known = Transforms(lambda time: level(*ship.pose(time)), first, last, ("map", "sonar"))
        known.install(monkeypatch)
        return known, Boat(world, own_ship_source="tf", fixed_frame="map", **parameters)

    return make


@pytest.mark.parametrize("with_offsets", [True, False], ids=["time_offset", "at_once"])
def test_tf_places_scans_with_the_frames_own_rotation(world, boat, with_offsets):
    _, boat = boat(TURNING)
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
    assert world.dropped() == {}
    assert not with_offsets or world.logged(WARN) == []


def test_a_scan_waits_for_tf_and_is_dropped_when_it_does_not_come(world, boat):
    known, boat = boat(Ship(), last=-1.0, own_ship_timeout=SOON)
    boat.driver.ping(Ping(START_NS - 12 * SECOND, [], []))
    boat.take(1, 0)
    boat.driver.ping(SENT[0])
    reasons = {"own_ship_missing", "own_ship_stale"}
    world.until(lambda: reasons & world.dropped().keys(), "the count")
    world.until_logged("tf has no transform from 'sonar' to 'map' at", level=WARN)
    known.last = math.inf
    assert_same(boat.send(SENT[1:]), confirmed(SENT[1:]))


def test_a_scan_is_processed_as_soon_as_tf_knows_its_last_echo(world, boat):
    known, boat = boat(Ship(), last=1.0, own_ship_timeout=3600.0)
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


@pytest.mark.parametrize(
    ("stamp_ns", "more"),
    [
        pytest.param(-5 * SECOND, {}, id="stamp_before_1970"),
        pytest.param(START_NS - 30 * SECOND, {"time_offset": [9e5]}, id="time_offset_far_ahead"),
        pytest.param(START_NS - 30 * SECOND, {}, id="before_what_tf_knows"),
    ],
)
def test_a_scan_that_tf_never_places_costs_itself_alone(world, boat, stamp_ns, more):
    _, boat = boat(Ship(), first=-1.0, last=1000.0, own_ship_timeout=SOON)
    boat.driver.ping(Ping(stamp_ns, [1000.0], [0.0]), **more)
    world.until(world.dropped, "the count")
    assert_same(boat.send(SENT), confirmed(SENT))
