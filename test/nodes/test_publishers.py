# Copyright 2026 tsepm_ros developers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.
"""Topics and log lines of the track initiator: tracks, odometry, markers, and their ends."""

import math
import re
import time
from dataclasses import replace
from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest
from nav_msgs.msg import Odometry
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import ReliabilityPolicy
from sensor_msgs.msg import PointCloud2
from support.boat import Boat, named
from support.expectation import (
    STATE,
    as_scan,
    assert_same,
    assert_same_track,
    assert_stamps,
    confirmed,
    initiator,
)
from support.markers import drawn, shown_markers
from support.patience import WAIT
from support.ros_world import BEST_EFFORT, LATCHED, RELIABLE, WARN
from support.sonar_driver import Driver, pings, points, stamp_ns
from visualization_msgs.msg import Marker, MarkerArray

from msg_adapters import read_placed_detections
from tsepm_ros import SensorModel, make_initiator
from tsepm_ros.nodes import base_node
from tsepm_ros.nodes.base_node import BaseNode
from tsepm_ros.nodes.publishers import (
    MAX_LINES,
    PERIOD,
    AnnouncementPublisher,
    published_announcement,
)
from tsepm_ros.nodes.track_initiator import TrackInitiator
from tsepm_ros.tracker.maintenance.track_maintenance import ENDS
from tsepm_ros.tracker.measurement import convert_measurements
from tsepm_ros.tracker.tracks import ConfirmedTrack

MOVING = np.array([100.0, 3.0, -50.0, 4.0])


def track(number: int) -> ConfirmedTrack:
    return ConfirmedTrack(number, 1.0, MOVING, np.eye(4), ((0, 0), (1, 2)), 0.0)


def test_a_line_has_the_id_the_place_the_speed_the_hits_and_the_reason():
    assert published_announcement(track(7), "odom", "2 hits in 2 pings; because") == (
        "track 7 confirmed at x 100.0 m, y -50.0 m in odom, 5.0 m/s towards 53 deg from x: "
        "2 hits in 2 pings; because"
    )


class Spoken(list):
    """Lines of announcements at set times."""

    def __init__(self) -> None:
        super().__init__()
        self.time = 0.0
        self._announced = AnnouncementPublisher(self.append, lambda: self.time)
        self.number = 0

    def confirm(self, number: int) -> None:
        new = [track(self.number + index) for index in range(number)]
        self.number += number
        self.take(new, {})

    def take(self, new: list[ConfirmedTrack], ended: dict[int, str]) -> None:
        result = SimpleNamespace(new=new, ended=ended, frame_id="odom")
        self._announced.announce(result, lambda _: "why")


@pytest.mark.parametrize("reason", ENDS)
def test_the_end_of_a_track_is_one_line_with_its_reason(reason):
    spoken = Spoken()
    spoken.take([], {7: reason})
    spoken.take([], {})
    assert spoken == [f"track 7 ended: {ENDS[reason]}"]


def test_a_flood_of_ends_is_summed_and_leaves_the_lines_of_starts():
    spoken = Spoken()
    spoken.take([], dict.fromkeys(range(50), "missed"))
    spoken.take([track(60)], {})
    assert len(spoken) == MAX_LINES + 2
    assert spoken[MAX_LINES].startswith("40 more ended tracks (ids 10 to 49)")
    assert spoken[-1].startswith("track 60 confirmed")


@pytest.mark.parametrize("each", [1, 3, 50])
def test_a_flood_over_many_pings_stays_readable_and_every_track_is_counted(each):
    spoken = Spoken()
    for _ in range(1000):
        spoken.confirm(each)
        spoken.time += 0.1
    spoken.time += PERIOD
    spoken.confirm(0)
    periods = 1000 * 0.1 / PERIOD
    assert len(spoken) <= (periods + 1) * (MAX_LINES + 2)
    singles = sum(line.startswith("track ") for line in spoken)
    left_out = sum(int(re.match(r"(\d+) more", line)[1]) for line in spoken if "more" in line)
    assert singles + left_out == 1000 * each


def test_the_node_logs_each_confirmed_track(world):
    boat = Boat(world)
    received = boat.send(pings(16))
    [point] = [point for message in received for point in points(message)][:1]
    line = world.until_logged(f"track {point['track_id']} confirmed at", level=20)
    assert f"x {point['state_x']:.1f} m, y {point['state_y']:.1f} m in sonar" in line
    assert f"{np.hypot(point['state_vx'], point['state_vy']):.1f} m/s" in line
    assert re.search(r"\d+ hits in \d+ pings", line)


@pytest.fixture
def node():
    return Mock(_last={}, _said={})


@pytest.mark.parametrize("reason", ["intensity", "plots"])
def test_a_fact_is_no_warning(node, reason):
    BaseNode.warn(node, reason, "it is so")
    node.get_logger().info.assert_called_once_with("it is so")
    node.get_logger().warning.assert_not_called()


@pytest.mark.parametrize(
    ("reason", "expected"), [("outside_coverage", 2), ("range_not_positive", 2), ("scan_late", 99)]
)
def test_dropped_detections_are_said_again_once_they_are_ten_times_as_many(
    node, monkeypatch, reason, expected
):
    """One in each of 99 pings that are 12 s apart; a dropped scan is said each time."""
    for ping in range(1, 100):
        monkeypatch.setattr(base_node.time, "monotonic", lambda ping=ping: 12.0 * ping)
        BaseNode.warn(node, reason, "dropped", ping if expected == 99 else ping * 2)
    assert node.get_logger().warning.call_count == expected


SECOND = 10**9

TWO_TARGETS = ((3000.0, 4.0, 1500.0, -2.0), (-2000.0, -3.0, 2500.0, 1.0))


@pytest.mark.parametrize(
    ("qos", "driver_first"),
    [(RELIABLE, False), (BEST_EFFORT, True)],
    ids=["reliable, node first", "best effort, driver first"],
)
def test_a_driver_that_publishes_range_and_azimuth_gets_tracks(world, qos, driver_first):
    if driver_first:
        driver = world.add(Driver(world.context, qos))
        node = world.make(TrackInitiator, named({}))
    else:
        node = world.make(TrackInitiator, named({}))
        world.until_logged("waiting for a publisher of /detections")
        driver = world.add(Driver(world.context, qos))
    tracks = world.listen(PointCloud2, "tracks")
    world.until(driver.publisher.get_subscription_count, "the node to subscribe")
    world.until_connected()
    sent = pings()
    for number, ping in enumerate(sent, 1):
        driver.ping(ping)
        world.until(lambda number=number: len(tracks) == number, "the tracks of this ping")
    assert_same(tracks, confirmed(sent))
    assert_stamps(tracks, sent)
    [subscription] = [one for one in node.subscriptions if one.topic_name == "/detections"]
    assert subscription.qos_profile.reliability == qos.reliability


def test_every_target_of_a_burst_is_tracked_and_each_track_is_an_odometry_message(world):
    boat = Boat(world)
    odometry = world.listen(Odometry, "tracks/odometry")
    world.until_connected()
    sent = pings(30, targets=TWO_TARGETS, clutter=20)
    received = boat.send(sent)
    assert_same(received, confirmed(sent))
    tracks = [(message, point) for message in received for point in points(message)]
    assert [point["track_id"] for _, point in tracks] == list(range(len(tracks)))
    world.until(lambda: len(odometry) >= len(tracks), "odometry")
    assert len(odometry) == len(tracks) >= 2
    for (message, point), found in zip(tracks, odometry, strict=True):
        assert found.header == message.header
        assert found.child_frame_id == f"track_{point['track_id']}"
        position, orientation = found.pose.pose.position, found.pose.pose.orientation
        velocity = found.twist.twist.linear
        assert [position.x, velocity.x, position.y, velocity.y] == [point[n] for n in STATE]
        assert (orientation.x, orientation.y, orientation.z, orientation.w) == (0, 0, 0, 1)
        pose, twist = found.pose.covariance.reshape(6, 6), found.twist.covariance.reshape(6, 6)
        for matrix, names in ((pose, ("00", "02", "22")), (twist, ("11", "13", "33"))):
            known = [matrix[0, 0], matrix[0, 1], matrix[1, 1]]
            assert known == [point[f"cov_{name}"] for name in names]
            assert min(np.diag(matrix)[2:]) >= 1e5, "not observed"
    world.until_logged("no time_offset", level=WARN)
    assert len(world.warned()) == 1, "a sonar that gives no times is said once"


def test_a_late_subscriber_gets_the_current_tracks_as_of_the_last_scan(world):
    boat = Boat(world)
    sent = pings(8)
    received = boat.send(sent)
    [(number, start)] = [(n, p) for n, m in enumerate(received) for p in points(m)]
    assert number < 7, "it must have been carried forward"
    current = world.listen(PointCloud2, "tracks/current", LATCHED)
    world.until(lambda: current, "the current tracks")
    [latched] = current
    for topic in ("/tracks", "/tracks/current"):
        [offered] = world.observer.get_publishers_info_by_topic(topic)
        assert offered.qos_profile.reliability == ReliabilityPolicy.RELIABLE
    assert stamp_ns(latched) == sent[-1].stamp_ns
    [held] = points(latched)
    assert held["track_id"] == start["track_id"]
    assert held["age"] - start["age"] == (sent[-1].stamp_ns - sent[number].stamp_ns) / SECOND
    same = initiator()
    for ping in sent:
        same.process(as_scan(ping))
    [expected] = same.current
    assert_same_track(held, expected)


def test_results_are_published_in_the_callback_that_made_them(world):
    boat = Boat(world, diagnostics_period=3600.0)
    # From here the node runs only when it is told to, until the ping is processed.
    world.executor.remove_node(boat.node)
    alone = SingleThreadedExecutor(context=world.context)
    alone.add_node(boat.node)
    scans = boat.node.health.scans
    for number, ping in enumerate(sent := pings(6), 1):
        boat.driver.ping(ping)
        end = time.monotonic() + WAIT
        while len(scans) < number and time.monotonic() < end:
            alone.spin_once(timeout_sec=1.0)  # a timer may come first
        world.until(lambda number=number: len(boat.tracks) == number, "tracks without a timer")
    alone.shutdown()
    assert_same(boat.tracks, confirmed(sent))
    for _, _, latency in scans:
        assert 0 < latency.core < latency.to_tracks < latency.to_all < 5.0


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


PARTS = ["ellipse", "label", "position", "velocity"]


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
    shown, deleted = seen[first:7], seen[7]  # 24 and 36 s after the last detection
    for ping, of_track in zip(sent[first:], shown, strict=False):
        assert sorted(marker.ns for marker in of_track) == PARTS
        assert {marker.action for marker in of_track} == {Marker.ADD}
        assert {(one.header.frame_id, stamp_ns(one)) for one in of_track} == {
            ("sonar", ping.stamp_ns)
        }
    assert sorted(marker.ns for marker in deleted) == PARTS
    assert {marker.action for marker in deleted} == {Marker.DELETE}
    assert not any(seen[8:])
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
        found, expected = (
            read_placed_detections(message),
            convert_measurements(as_scan(ping), SensorModel(), 0),
        )
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
