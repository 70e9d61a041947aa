"""Diagnostics of a node whose own-ship data comes late, or no more."""

from __future__ import annotations

import time

from sensor_msgs.msg import PointCloud2
from support.boat import Boat
from support.ros_world import WARN as LOG_WARN
from support.sonar_driver import START_NS, pings

SECOND = 10**9
OK, WARN, STALE = b"\x00", b"\x01", b"\x03"


def sail(boat: Boat, *seconds: float) -> None:
    """Poses of a ship that lies still, at times after the first ping."""
    for after in seconds:
        boat.driver.pose(START_NS + round(after * SECOND), 0.0, 0.0, 0.0)


def test_the_wait_for_own_ship_data_is_told_apart_from_the_work(world):
    boat = Boat(world, own_ship_source="odometry", own_ship_timeout=60.0)
    boat.driver.ping(pings(1)[0])
    world.until(lambda: world.figures()["waiting_for_own_ship"] == "1", "the scan to wait")
    began = time.monotonic()
    world.until(lambda: time.monotonic() - began > 0.3, "a while")
    sail(boat, -1.0, 1.0)
    boat.take(1, 0)
    world.until(lambda: float(world.figures()["waiting_ms"]) > 0.0, "the figures")
    figures = {name: float(world.figures()[name]) for name in ("waiting_ms", "latency_all_ms")}
    assert 300.0 < figures["waiting_ms"] < 1e3 * world.deadline
    assert figures["latency_all_ms"] < figures["waiting_ms"]
    assert boat.node.latency.waiting == boat.node.latency.total - boat.node.latency.to_all


def test_own_ship_data_that_stops_is_a_warning_and_then_stale(world):
    boat = Boat(
        world,
        own_ship_source="odometry",
        diagnostics__max_own_ship_age=0.3,
        diagnostics__stale_time=0.8,
    )
    missing = world.status("own ship")
    assert (missing.level, missing.message) == (WARN, "no own-ship data yet")
    sail(boat, 0.0)
    levels = []

    def is_stale() -> bool:
        levels.append(world.status("own ship").level)
        return levels[-1] == STALE

    world.until(is_stale, "that it is stale")
    seen = [level for level, before in zip(levels, [b"", *levels], strict=False) if level != before]
    assert seen[-3:] == [OK, WARN, STALE]


def test_own_ship_data_behind_the_newest_scan_is_a_warning(world):
    boat = Boat(world, own_ship_source="odometry", own_ship_timeout=60.0)
    sail(boat, -5.0)
    boat.driver.ping(pings(1)[0])
    said = "own-ship data is 5 s older than the newest scan"
    world.until(lambda: world.status("own ship").message == said, "the warning")


def test_odometry_that_is_not_listened_to_is_said_once(world):
    boat = Boat(world)
    world.until_logged("the sensor is taken not to move, tracks are in the frame of the detections")
    world.until(lambda: world.status("own ship").level == WARN, "the warning")
    said = "odometry is published on /own_ship/odometry, but own_ship_source is none"
    assert said in world.status("own ship").message
    world.until_logged(said, level=LOG_WARN)
    assert len([one for one in world.logged() if said in one]) == 1

    boat.driver.destroy_publisher(boat.driver.odometry)
    world.until(lambda: world.status("own ship").level == OK, "that it is over")
    world.observer.create_publisher(PointCloud2, "own_ship/odometry", 1)
    world.until(lambda: "sensor_msgs/msg/PointCloud2" in types(boat), "the topic to be known")
    assert world.status("own ship").level == OK, "no odometry"


def types(boat: Boat) -> set[str]:
    """Of what is published as odometry, as the node sees it."""
    found = boat.node.get_publishers_info_by_topic("own_ship/odometry")
    return {one.topic_type for one in found}
