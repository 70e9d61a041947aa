"""The chart on `land`, from its topic to what is left out."""

import itertools
from dataclasses import replace

import numpy as np
from nav_msgs.msg import OccupancyGrid
from rclpy.qos import QoSProfile
from support.boat import Boat
from support.ros_world import ERROR, LATCHED, WARN
from support.sonar_driver import pings

from tsepm_ros.nodes.track_initiator import TrackInitiator

SENT = pings(8, clutter=2)


def grid(width: int = 100, height: int = 100, **info) -> OccupancyGrid:
    """Land around the target of `pings`."""
    message = OccupancyGrid()
    message.header.frame_id = "sonar"
    message.info.width, message.info.height = width, height
    message.info.resolution = info.get("resolution", 10.0)
    message.info.origin.position.x, message.info.origin.position.y = info.get("x", 2700.0), 1000.0
    message.data = np.full(info.get("number", width * height), 100, np.int8).tolist()
    return message


def charts(world, qos: QoSProfile = LATCHED):
    """The publisher of charts."""
    return world.observer.create_publisher(OccupancyGrid, "land", qos)


def test_a_bad_chart_is_dropped_counted_and_said_and_one_from_before_the_start_is_used(world):
    chart = charts(world)
    chart.publish(grid())
    boat = Boat(world)
    boat.send(SENT[:1])
    # Different topics have no order: the chart may come after the first pings.
    world.until(lambda: float(world.figures()["land_area_m2"]) == 1e6, "the chart")
    chart.publish(grid(number=99))
    world.until_logged("land dropped", level=WARN)
    received = boat.send(SENT[1:])
    assert sum(one.width for one in received) == 0
    dropped = world.dropped()
    assert dropped["land_invalid"] == 1
    assert dropped["on_land"] >= len(SENT) - 1
    assert world.status("land").level == b"\x01"
    assert world.status("detections").level == b"\x00"


def test_a_chart_may_be_replaced_and_removed_and_a_reset_keeps_it(world):
    chart, boat = charts(world), Boat(world)
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
        world.until(
            lambda area=expected: ping_more(boat, next(sent)) == area, f"a chart of {expected} m^2"
        )
    world.reset()
    assert ping_more(boat, 1000) == 1e6
    assert world.figures()["on_land"] == "1"


def ping_more(boat: Boat, number: int) -> float:
    """Send another ping of the target; returns the area of the chart in use, m^2."""
    ping = SENT[0]
    boat.send([replace(ping, stamp_ns=ping.stamp_ns + number * 10**9)])
    return float(boat.world.figures()["land_area_m2"])


def test_a_publisher_that_does_not_keep_its_chart_is_named(world):
    charts(world, QoSProfile(depth=1))
    world.make(TrackInitiator)
    world.until_logged("does not offer reliable, transient local delivery", level=ERROR)
