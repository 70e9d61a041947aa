"""What a viewer shows: tracks, potential tracks, and detections where they were placed."""

import math
from dataclasses import replace

import numpy as np
import pytest
from sensor_msgs.msg import PointCloud2
from support.boat import Boat, named
from support.expectation import STATE, as_scan, assert_same_track, assert_stamps, initiator
from support.markers import drawn, shown_markers
from support.ros_world import LATCHED, RELIABLE
from support.sonar_driver import pings, points, stamp_ns
from visualization_msgs.msg import Marker, MarkerArray

from msg_adapters import read_placed_detections
from tsepm_ros import SensorModel, make_initiator
from tsepm_ros.nodes.track_initiator import TrackInitiator
from tsepm_ros.tracker.measurement import convert

PARTS = ["ellipse", "label", "position", "velocity"]
"""Namespaces of a track's markers."""


def test_markers_show_a_track_until_its_hold_time_is_over_also_to_who_was_away(world):
    boat = Boat(world, hold_time=30.0)
    markers = shown_markers(world)
    sent = pings(12, clutter=0)
    nothing = np.zeros(0, np.float32)
    sent[5:] = [replace(ping, range=nothing, azimuth=nothing) for ping in sent[5:]]
    tracks = boat.send(sent)
    world.until(lambda: len(markers) == len(sent), "markers")
    first = next(index for index, message in enumerate(tracks) if message.width)
    [track_id] = [point["track_id"] for point in points(tracks[first])]
    seen = [[one for one in array.markers if one.id == track_id] for array in markers]
    shown, deleted = seen[first : first + 3], seen[first + 3]  # 24 and 36 s later
    for ping, of_track in zip(sent[first:], shown, strict=False):
        assert sorted(marker.ns for marker in of_track) == PARTS
        assert {marker.action for marker in of_track} == {Marker.ADD}
        assert {(one.header.frame_id, stamp_ns(one)) for one in of_track} == {
            ("sonar", ping.stamp_ns)
        }
    assert sorted(marker.ns for marker in deleted) == PARTS
    assert {marker.action for marker in deleted} == {Marker.DELETE}
    assert not any(seen[first + 4 :])
    before = markers[: first + 1]
    assert drawn(before) == {track_id}
    again = world.listen(MarkerArray, "tracks/markers", LATCHED)
    world.until(lambda: not drawn([*before, *again]), "the greeting of a viewer that was away")


@pytest.mark.parametrize("qos", [RELIABLE, LATCHED], ids=["volatile", "latched"])
def test_a_viewer_that_joins_late_shows_the_tracks_that_are_held(world, qos):
    boat = Boat(world)
    sent = pings(10, clutter=0)
    received = boat.send(sent[:7])
    ids = {point["track_id"] for message in received for point in points(message)}
    markers = world.listen(MarkerArray, "tracks/markers", qos)
    if qos is LATCHED:
        world.until(lambda: markers, "markers before the next ping")
    else:  # may come before this side is ready, but no later than with the next ping
        world.until_connected()
        boat.send(sent[7:8])
        world.until(lambda: markers and stamp_ns(markers[-1].markers[-1]) == sent[7].stamp_ns, "it")
    assert drawn(markers) == ids != set()
    world.end(boat.node)
    world.make(TrackInitiator, named({}))
    world.until(lambda: not drawn(markers), "the new node to remove the markers of the old")


def test_detections_are_handed_over_where_they_were_placed_with_what_a_filter_needs(world):
    boat = Boat(world)
    placed = world.listen(PointCloud2, "detections/placed")
    world.until_connected()
    sent = pings(3)
    delay = np.linspace(0.5, 11.0, len(sent[0].range)).astype(np.float32)
    boat.send(sent, time_offset=delay, intensity=np.arange(len(delay)))
    world.until(lambda: len(placed) == len(sent), "detections")
    assert_stamps(placed, sent)
    for message, ping in zip(placed, sent, strict=True):
        assert message.header.frame_id == "sonar"
        found, expected = read_placed_detections(message), convert(as_scan(ping), SensorModel(), 0)
        np.testing.assert_allclose(found.position, expected["position"], rtol=1e-12)
        np.testing.assert_allclose(found.covariance, expected["covariance"], rtol=1e-9)
        np.testing.assert_array_equal(found.time_offset, delay)
        # The mean of an azimuth that errs by 1 degree is nearer by exp(-sigma^2 / 2): undone.
        reach = math.exp(math.radians(1.0) ** 2 / 2) * np.asarray(ping.range)
        shown = points(message)
        for axis, turn in (("x", np.cos), ("y", np.sin)):
            place = reach * turn(ping.azimuth)
            np.testing.assert_allclose([point[axis] for point in shown], place, atol=0.5)
        assert [point["intensity"] for point in shown] == list(range(len(delay)))


def test_potential_tracks_come_only_while_switched_on(world):
    """Those published last are removed at the end, for later viewers too."""
    boat = Boat(world)
    potential = world.listen(PointCloud2, "potential_tracks")
    markers = world.listen(MarkerArray, "potential_tracks/markers", LATCHED)
    world.until_connected()
    sent = pings(9, clutter=20)
    boat.send(sent[:3])
    assert world.set_parameters(publish_potential_tracks=True) == [""]
    boat.send(sent[3:6])
    world.until(lambda: len(potential) >= 3, "potential tracks")
    assert world.set_parameters(publish_potential_tracks=False) == [""]
    boat.send(sent[6:])
    world.statuses()  # after the last scan: whatever was published has come
    stamps = [ping.stamp_ns for ping in sent[3:6]]
    *potential, removed = potential
    assert [stamp_ns(message) for message in potential] == stamps
    assert (stamp_ns(removed), removed.width) == (stamps[-1], 0)
    world.until(lambda: len(markers) == 4, "markers")
    late = world.listen(MarkerArray, "potential_tracks/markers", LATCHED)
    world.until(lambda: late, "markers of a late viewer")
    for message in (markers[-1], late[-1]):
        assert [marker.action for marker in message.markers] == [Marker.DELETEALL]

    same = initiator()
    for ping in sent[:6]:
        same.process(as_scan(ping))
    found = {tuple(point[name] for name in STATE) for point in points(potential[-1])}
    assert found == {tuple(track.state) for track in same.potential_tracks()}
    assert {point["hit_count"] for point in points(potential[-1])} <= {2, 3, 4}
    assert found


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
