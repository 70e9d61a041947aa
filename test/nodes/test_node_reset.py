"""The service that makes the node start over."""

from sensor_msgs.msg import PointCloud2
from support.boat import Boat
from support.expectation import assert_same, confirmed
from support.markers import shown_markers
from support.ros_world import LATCHED
from support.sonar_driver import pings, points
from visualization_msgs.msg import Marker


def test_reset_forgets_scans_tracks_counts_and_the_frame_but_no_id_comes_twice(world):
    boat = Boat(world)
    current = world.listen(PointCloud2, "tracks/current", LATCHED)
    markers = shown_markers(world)
    world.until_connected()
    sent = pings()
    first = boat.send(sent)
    boat.driver.ping(sent[-2])  # late: dropped and counted
    world.until(lambda: world.dropped() == {"scan_late": 1}, "the count")
    response = world.reset()
    assert response.success and response.message
    world.until(lambda: len(current) > len(sent) and len(markers) > len(sent), "what it cleared")
    assert current[-1].width == 0
    assert current[-1].header.frame_id == "sonar", "RViz cannot place a message without a frame"
    assert [marker.action for marker in markers[-1].markers] == [Marker.DELETEALL]
    figures = world.figures()
    assert figures["scans"] == "0"
    assert not [key for key in figures if key.startswith("dropped.")]
    again = boat.send(
        sent, frame_id="head"
    )  # the same stamps once more are neither late nor a restart
    assert_same(again, confirmed(sent))
    assert {message.header.frame_id for message in again} == {"head"}
    ids = [point["track_id"] for message in [*first, *again] for point in points(message)]
    assert len(set(ids)) == len(ids)
