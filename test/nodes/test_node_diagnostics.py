"""Diagnostics of the node: what is missing, what was done, and what comes late or no more."""

import time

import pytest
from sensor_msgs.msg import PointCloud2
from support.boat import Boat, named
from support.ros_world import WARN as LOG_WARN
from support.sonar_driver import START_NS, pings, stamp_ns

from tsepm_ros.nodes.track_initiator import TrackInitiator

TASKS = (
    *("overall", "track initiation", "detections", "own ship", "latency", "clutter"),
    *("sensor parameters", "quality of service", "downstream tracker", "land"),
)
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
    latency = boat.node.health.scans[-1].latency
    assert latency.waiting == latency.total - latency.to_all


def test_odometry_that_is_not_listened_to_is_said_once(world):
    boat = Boat(world)
    world.until_logged("the sensor is assumed fixed, tracks are in the frame of the detections")
    world.until(lambda: world.status("own ship").level == WARN, "the warning")
    said = "odometry is published on /own_ship/odometry, but own_ship_source is none"
    assert said in world.status("own ship").message
    world.until_logged(said, level=LOG_WARN)
    assert len([one for one in world.logged() if said in one]) == 1

    boat.driver.destroy_publisher(boat.driver.odometry)
    world.until(lambda: world.status("own ship").level == OK, "that it is over")
    world.observer.create_publisher(PointCloud2, "own_ship/odometry", 1)
    look = boat.node.get_publishers_info_by_topic
    world.until(
        lambda: any(one.topic_type.endswith("PointCloud2") for one in look("own_ship/odometry")),
        "the topic to be known",
    )
    assert world.status("own ship").level == OK, "no odometry"


def test_diagnostics_say_what_is_missing_and_then_what_was_done(world):
    node = world.make(TrackInitiator, named({}))
    missing = world.status("detections")
    assert (missing.message, missing.level) == ("no publisher of detections yet", b"\x01")
    world.end(node)
    boat = Boat(world, clutter_density="given")
    boat.driver.destroy_publisher(boat.driver.odometry)  # else it is said that nobody listens to it
    assert world.status("detections").message == "no scan yet"
    before = boat.node.get_clock().now().nanoseconds
    sent = pings()
    tracks = boat.send(sent)
    found = world.statuses()
    assert before <= stamp_ns(world.diagnostics[-1]) <= before + 60 * SECOND
    assert {status.name for status in world.diagnostics[-1].status} == {
        f"/track_initiator: {task}" for task in TASKS
    }
    levels = {task: status.level for task, status in found.items()}
    # A tenth of the clutter of the data sheet: that is said.
    assert levels == {task: WARN if task in ("overall", "clutter") else OK for task in TASKS}
    figures = world.figures()
    assert int(figures["scans"]) == len(sent)
    assert int(figures["detections"]) == sum(len(ping.range) for ping in sent)
    assert int(figures["confirmed"]) == sum(message.width for message in tracks)
    assert float(figures["scan_interval_s"]) == pytest.approx(12.0)
    assert 0 < float(figures["core_ms"]) < float(figures["latency_ms"])
    assert float(figures["latency_ms"]) < float(figures["latency_all_ms"])
    assert 0 < float(figures["publishing_ms"]) < float(figures["latency_all_ms"])
    assert {"potential_tracks", "raw_confirmations", "merged", "started"} <= set(figures)
    assert int(figures["split"]) >= int(figures["started"]) > 0
    assert int(figures["evaluated"]) >= int(figures["pruned"])
    assert not [key for key in figures if key.startswith("dropped.")]
