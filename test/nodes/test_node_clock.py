"""The node by a simulated clock."""

from __future__ import annotations

from rosgraph_msgs.msg import Clock
from support.boat import Boat
from support.expectation import (
    assert_same,
    confirmed,
)
from support.sonar_driver import pings, stamp_ns

SECOND = 10**9


def test_use_sim_time_takes_the_time_from_clock(world):
    boat = Boat(world, use_sim_time=True)
    clock = world.observer.create_publisher(Clock, "/clock", 10)
    world.until_connected()
    message = Clock()
    message.clock.sec, message.clock.nanosec = 1234, 567
    clock.publish(message)
    world.statuses()
    world.until(lambda: stamp_ns(world.diagnostics[-1]) == 1234 * SECOND + 567, "the time in use")
    sent = pings(start_ns=1000 * SECOND)
    assert_same(boat.send(sent), confirmed(sent))


def test_a_jump_of_the_clock_does_no_harm(world):
    boat = Boat(world, use_sim_time=True)
    clock = world.observer.create_publisher(Clock, "/clock", 10)
    world.until_connected()
    sent = pings(start_ns=1000 * SECOND)
    received = []
    for seconds, ping in zip([5000, 1000, 3, 3, 9000] * 3, sent, strict=False):
        message = Clock()
        message.clock.sec = seconds
        clock.publish(message)
        world.until(
            lambda seconds=seconds: boat.node.get_clock().now().nanoseconds == seconds * SECOND,
            "the time",
        )
        received += boat.send([ping])
    assert_same(received, confirmed(sent))
