"""What stands still, on topics of its own."""

import numpy as np
import pytest
from sensor_msgs.msg import PointCloud2
from support.boat import Boat
from support.expectation import as_scan, assert_same_track
from support.ros_world import LATCHED
from support.sonar_driver import pings, points, stamp_ns
from visualization_msgs.msg import Marker, MarkerArray

from tsepm_ros import SensorModel, make_initiator

OPTIONS = {"min_speed": 1.0, "max_speed": 10.0}
TARGETS = ((3000.0, 0.0, 1500.0, 0.0), (-2000.0, -8.0, 2500.0, 4.0))
"""A reflector, and a vessel at 9 m/s."""


@pytest.mark.parametrize("method", ["score", "tsepm"])
def test_fixed_echoes_are_published_beside_the_tracks_and_shown_to_late_viewers(world, method):
    sent = pings(24, targets=TARGETS, clutter=5)
    boat = Boat(world, method=method, **OPTIONS)
    echoes = world.listen(PointCloud2, "fixed_echoes", LATCHED)
    markers = world.listen(MarkerArray, "fixed_echoes/markers", LATCHED)
    current = world.listen(PointCloud2, "tracks/current", LATCHED)
    world.until_connected()
    received = boat.send(sent)
    world.until(lambda: len(echoes) >= len(sent) and markers, "an answer to every ping")
    initiator = make_initiator(method, sensor=SensorModel(), **OPTIONS)
    for ping, message, new in zip(sent, echoes, received, strict=True):
        found = initiator.process(as_scan(ping))
        assert stamp_ns(message) == ping.stamp_ns
        assert message.width == len(initiator.fixed_echoes)
        for point, echo in zip(points(message), initiator.fixed_echoes, strict=True):
            assert_same_track(point, echo)
        for point, track in zip(points(new), found, strict=True):
            assert_same_track(point, track)
            assert point["stationary_probability"] == track.stationary_probability <= 0.5
    [echo] = points(echoes[-1])
    assert np.hypot(echo["x"] - 3000.0, echo["y"] - 1500.0) < 60.0
    assert echo["stationary_probability"] > 0.9
    assert 0.0 < echo["age"] < 24.0 * 12.0
    kinds = {marker.type for marker in markers[-1].markers if marker.action == Marker.ADD}
    assert kinds == {Marker.CUBE_LIST, Marker.TEXT_VIEW_FACING}
    assert world.figures()["fixed_echoes"] == "1"
    starts = [point["track_id"] for message in received for point in points(message)]
    assert len(starts) == len(set(starts)), "no echo is published as a second track"
    assert echo["track_id"] not in [point["track_id"] for point in points(current[-1])]
    late = world.listen(MarkerArray, "fixed_echoes/markers", LATCHED)
    world.until(lambda: late, "markers of a late viewer")
    assert len(late[-1].markers) == 3
    world.reset()
    after = world.listen(MarkerArray, "fixed_echoes/markers", LATCHED)
    world.until(lambda: after, "markers after the reset")
    assert [marker.action for marker in after[-1].markers] == [Marker.DELETEALL]


def test_without_min_speed_the_topic_is_there_and_empty_and_a_reset_clears_it(world):
    boat = Boat(world)
    echoes = world.listen(PointCloud2, "fixed_echoes", LATCHED)
    markers = world.listen(MarkerArray, "fixed_echoes/markers", LATCHED)
    world.until_connected()
    sent = pings(8, targets=TARGETS)
    received = boat.send(sent)
    world.until(lambda: len(echoes) == len(sent), "an answer to every ping")
    assert {message.width for message in echoes} == {0}
    probabilities = [p["stationary_probability"] for m in received for p in points(m)]
    assert probabilities
    assert all(0.0 <= probability <= 1.0 for probability in probabilities)
    world.reset()
    world.until(lambda: len(echoes) > len(sent), "the empty message")
    assert [marker.action for marker in markers[-1].markers] == [Marker.DELETEALL]
