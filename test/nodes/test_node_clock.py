"""The node by a simulated clock."""

import pytest
from support.boat import Boat, SimulatedTime
from support.expectation import assert_same, confirmed
from support.ros_world import WARN
from support.ship import Ship, publish_poses
from support.sonar_driver import pings, stamp_ns

from tsepm_ros.nodes import running

SECOND = 10**9
WARN_LEVEL = b"\x01"


def test_use_sim_time_takes_the_time_from_clock(world):
    boat = Boat(world, use_sim_time=True)
    SimulatedTime(boat).set(1234 * SECOND + 567)
    world.statuses()
    world.until(lambda: stamp_ns(world.diagnostics[-1]) == 1234 * SECOND + 567, "the time in use")
    sent = pings(start_ns=1000 * SECOND)
    assert_same(boat.send(sent), confirmed(sent))


def test_a_jump_of_the_clock_does_no_harm(world):
    boat = Boat(world, use_sim_time=True)
    time = SimulatedTime(boat)
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
    monkeypatch.setattr(running, "MAX_STANDING", 0.5)
    boat = Boat(world, own_ship_source="odometry", own_ship_timeout=0.2, use_sim_time=True)
    time, sent = SimulatedTime(boat), pings(12)
    if clock_begins:
        time.set(sent[0].stamp_ns)
    boat.driver.ping(sent[0])
    world.until(lambda: world.dropped() == {"own_ship_missing": 1}, "the scan's end")
    world.until_logged("stands still", "is /clock published?", level=WARN)
    status = world.status("detections")
    assert (status.level, "stands still" in status.message) == (WARN_LEVEL, True)
    time.set(sent[1].stamp_ns)
    publish_poses(boat, Ship(), 0, 140)
    assert_same(boat.send(sent[1:]), confirmed(sent[1:]))
