"""The chart on `land`, from its topic to what is left out."""

import itertools
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from nav_msgs.msg import OccupancyGrid
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_srvs.srv import Trigger
from support.boat import Boat
from support.ros_world import ERROR, WARN
from support.sonar_driver import pings

from tsepm_ros.nodes.track_initiator import TrackInitiator

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
SENT = pings(8, clutter=2)


def grid(frame_id: str = "sonar", width: int = 100, height: int = 100, **info) -> OccupancyGrid:
    """Land around the target of `pings`."""
    message = OccupancyGrid()
    message.header.frame_id = frame_id
    message.info.width, message.info.height = width, height
    message.info.resolution = info.get("resolution", 10.0)
    message.info.origin.position.x = info.get("x", 2700.0)
    message.info.origin.position.y = info.get("y", 1000.0)
    for name in "xyzw":
        if name in info.get("q", {}):
            setattr(message.info.origin.orientation, name, info["q"][name])
    message.data = np.full(info.get("number", width * height), 100, np.int8).tolist()
    return message


class Chart:
    """Publishes charts."""

    def __init__(self, world, qos: QoSProfile = LATCHED) -> None:
        self.publisher = world.observer.create_publisher(OccupancyGrid, "land", qos)
        self.publish = self.publisher.publish


def on_land(world) -> int:
    return int(world.figures()["on_land"])


def test_a_chart_that_was_published_before_the_node_started_is_used(world):
    Chart(world).publish(grid())
    boat = Boat(world)
    boat.send(SENT[:1])
    # Different topics have no order: the chart may come after the first pings.
    world.until(lambda: float(world.figures()["land_area_m2"]) == 1e6, "the chart")
    received = boat.send(SENT[1:])
    assert sum(one.width for one in received) == 0
    assert world.dropped()["on_land"] >= len(SENT) - 1
    status = world.status("land")
    assert status.level == b"\x00"
    assert world.status("detections").level == b"\x00"


def test_a_chart_may_be_replaced_and_removed_and_a_reset_keeps_it(world):
    chart, boat = Chart(world), Boat(world)

    sent = itertools.count()
    for message, expected in (
        (grid(), 1e6),
        (grid(width=50), 5e5),
        (grid(width=0, height=0), 0.0),
        (grid(x=-9000.0, resolution=1.0), 1e4),
        (grid(), 1e6),
    ):
        chart.publish(message)
        # Different topics have no order: until the chart has come, a scan may be before it.
        until_area(boat, sent, expected)
    world.call(Trigger, "/track_initiator/reset", Trigger.Request())
    assert ping_more(boat, 1000) == 1e6
    assert on_land(world) == 1


def until_area(boat: Boat, numbers: Iterator[int], expected: float) -> None:
    boat.world.until(
        lambda: ping_more(boat, next(numbers)) == expected, f"a chart of {expected} m^2"
    )


def ping_more(boat: Boat, number: int) -> float:
    """Send another ping of the target; returns the area of the chart in use, m^2."""
    ping = SENT[0]
    boat.send([replace(ping, stamp_ns=ping.stamp_ns + number * 10**9)])
    return float(boat.world.figures()["land_area_m2"])


BAD = {
    "width": grid(number=99),
    "origin_nan": grid(x=float("nan")),
    "orientation_tilted": grid(q={"x": 0.7, "w": 0.7}),
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_chart_is_dropped_counted_and_said(world, name):
    chart, boat = Chart(world), Boat(world)
    chart.publish(BAD[name])
    world.until_logged("land dropped", level=WARN)
    received = boat.send(SENT)
    assert sum(one.width for one in received) >= 1
    assert world.dropped() == {"land_invalid": 1}
    assert world.status("land").level == b"\x01"


def test_a_publisher_that_does_not_keep_its_chart_is_named(world):
    Chart(world, QoSProfile(depth=1))
    world.make(TrackInitiator)
    world.until_logged("does not offer reliable, transient local delivery", level=ERROR)
