"""Pings of a driver in, tracks out."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from nav_msgs.msg import Odometry
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import PointCloud2, PointField
from std_srvs.srv import Trigger
from support.boat import Boat, named
from support.expectation import (
    COVARIANCE,
    STATE,
    as_scan,
    assert_same,
    assert_same_track,
    assert_stamps,
    confirmed,
    initiator,
)
from support.ros_world import BEST_EFFORT, LATCHED, RELIABLE, WARN
from support.sonar_driver import START_NS, Driver, Ping, pings, points, stamp_ns
from visualization_msgs.msg import Marker, MarkerArray

from msg_adapters import read_placed_detections
from tsepm_ros import SensorModel
from tsepm_ros.nodes.track_initiator import TrackInitiator
from tsepm_ros.sensing.conversion import convert

SECOND = 10**9
PARTS = ["ellipse", "label", "position", "velocity"]
"""Namespaces of a track's markers."""
TASKS = [
    "track initiation",
    "detections",
    "own ship",
    "latency",
    "clutter",
    "quality of service",
    "downstream tracker",
]
"""Of the diagnostics, in their order."""
TWO_TARGETS = ((3000.0, 4.0, 1500.0, -2.0), (-2000.0, -3.0, 2500.0, 1.0))


def shown_markers(world):
    """The markers from now on: those that greet a viewer have come."""
    markers = world.listen(MarkerArray, "tracks/markers", LATCHED)
    world.until(lambda: markers, "what greets a viewer")
    markers.clear()
    world.until_connected()
    return markers


@pytest.mark.parametrize("driver_first", [True, False], ids=["driver_first", "node_first"])
@pytest.mark.parametrize("qos", [RELIABLE, BEST_EFFORT], ids=["reliable", "best_effort"])
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


def test_every_target_of_a_burst_is_tracked_and_ids_count_up(world):
    boat = Boat(world)
    sent = pings(30, targets=TWO_TARGETS, clutter=20)
    received = boat.send(sent)
    assert_same(received, confirmed(sent))
    ids = [point["track_id"] for message in received for point in points(message)]
    assert ids == list(range(len(ids)))
    assert len(ids) >= 2


def test_a_sonar_that_gives_no_times_gets_them_from_the_sound_speed(world):
    sent = pings()
    boat = Boat(world, sound_speed=1480.0)
    expected = initiator()
    scans = [as_scan(ping) for ping in sent]
    timed = [replace(scan, time_offset=scan.range / 1480.0) for scan in scans]
    assert_same(boat.send(sent), [expected.process(scan) for scan in timed])
    assert world.warned() == []


def test_a_sonar_that_gives_no_times_is_said_once(world):
    boat = Boat(world)
    boat.send(pings())
    world.until_logged("no time_offset", level=WARN)
    assert len(world.warned()) == 1


def test_every_scan_gives_one_message_even_without_tracks_or_detections(world):
    boat = Boat(world)
    sent = [Ping(START_NS + index * SECOND, [], []) for index in range(3)]
    sent += pings(2, start_ns=START_NS + 12 * SECOND)
    received = boat.send(sent)
    assert_stamps(received, sent)
    assert [message.width for message in received] == [0] * 5
    fields = [[field.name for field in message.fields] for message in received]
    assert all(names == fields[0] for names in fields)
    assert fields[0][:4] == ["x", "y", "z", "track_id"]


def test_tracks_have_the_documented_layout(world):
    boat = Boat(world)
    message = boat.send(pings())[-1]
    names = [field.name for field in message.fields]
    assert names == [
        *("x", "y", "z", "track_id", *STATE, *COVARIANCE),
        *("evaluation", "score", "hit_count", "scan_count", "age"),
    ]
    kinds = {field.name: field.datatype for field in message.fields}
    # RViz and PCL need these three as float32.
    assert {kinds.pop(name) for name in "xyz"} == {PointField.FLOAT32}
    assert kinds.pop("track_id") == PointField.UINT32
    assert {kinds.pop("hit_count"), kinds.pop("scan_count")} == {PointField.UINT16}
    assert set(kinds.values()) == {PointField.FLOAT64}
    doubles = [f.offset for f in message.fields if f.datatype == PointField.FLOAT64]
    assert not any(offset % 8 for offset in [*doubles, message.point_step])
    assert {field.count for field in message.fields} == {1}
    assert message.height == 1 and not message.is_bigendian
    assert message.row_step == message.width * message.point_step == len(message.data)


def test_tracks_are_in_the_detections_frame_without_own_ship(world):
    boat = Boat(world)
    assert {message.header.frame_id for message in boat.send(pings(3))} == {"sonar"}


def test_fixed_frame_names_the_frame_of_the_tracks(world):
    boat = Boat(world, fixed_frame="map", own_ship_source="odometry")
    for index in range(5):
        boat.driver.pose(START_NS + index * 12 * SECOND, 0, 0, 0, frame_id="map")
    assert {message.header.frame_id for message in boat.send(pings(3))} == {"map"}


def test_topics_follow_remapping_and_namespace(world):
    driver = world.add(Driver(world.context, cli_args=["--ros-args", "-r", "__ns:=/sonar"]))
    arguments = ["--ros-args", "-r", "__ns:=/boat", "-r", "detections:=/sonar/detections"]
    world.make(TrackInitiator, named({}), cli_args=arguments)
    tracks = world.listen(PointCloud2, "/boat/tracks")
    world.until(driver.publisher.get_subscription_count, "the node to subscribe")
    world.until_connected()
    sent = pings()
    for ping in sent:
        driver.ping(ping)
    world.until(lambda: len(tracks) == len(sent), "tracks")
    assert_same(tracks, confirmed(sent))


def test_tracks_are_offered_reliably_and_current_tracks_latched(world):
    Boat(world)
    [tracks] = world.observer.get_publishers_info_by_topic("/tracks")
    [current] = world.observer.get_publishers_info_by_topic("/tracks/current")
    assert tracks.qos_profile.reliability == ReliabilityPolicy.RELIABLE
    assert current.qos_profile.reliability == ReliabilityPolicy.RELIABLE
    assert current.qos_profile.durability == LATCHED.durability


def test_each_new_track_is_an_odometry_message(world):
    boat = Boat(world)
    odometry = world.listen(Odometry, "tracks/odometry")
    world.until_connected()
    sent = pings(20, targets=TWO_TARGETS)
    received = boat.send(sent)
    tracks = [(message, point) for message in received for point in points(message)]
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
        assert [pose[0, 0], pose[0, 1], pose[1, 1]] == [
            point[name] for name in ("cov_00", "cov_02", "cov_22")
        ]
        assert [twist[0, 0], twist[0, 1], twist[1, 1]] == [
            point[name] for name in ("cov_11", "cov_13", "cov_33")
        ]
        assert min(*np.diag(pose)[2:], *np.diag(twist)[2:]) >= 1e5, "not observed"


def test_a_late_subscriber_gets_the_current_tracks_as_of_the_last_scan(world):
    boat = Boat(world)
    sent = pings(8)
    received = boat.send(sent)
    [(number, start)] = [(n, p) for n, m in enumerate(received) for p in points(m)]
    assert number < 7, "it must have been carried forward"
    current = world.listen(PointCloud2, "tracks/current", LATCHED)
    world.until(lambda: current, "the current tracks")
    [latched] = current
    assert stamp_ns(latched) == sent[-1].stamp_ns
    [held] = points(latched)
    assert held["track_id"] == start["track_id"]
    assert held["age"] - start["age"] == (sent[-1].stamp_ns - sent[number].stamp_ns) / SECOND
    same = initiator()
    for ping in sent:
        same.process(as_scan(ping))
    [expected] = same.hold.current
    assert_same_track(held, expected)


def test_markers_show_a_track_until_its_hold_time_is_over(world):
    boat = Boat(world, hold_time=30.0)
    markers = shown_markers(world)
    seen_by_sonar, gone = pings(12, clutter=0)[:5], pings(12, clutter=0)[5:]
    nothing = np.zeros(0, np.float32)
    sent = seen_by_sonar + [replace(ping, range=nothing, azimuth=nothing) for ping in gone]
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


def test_markers_are_at_the_track_and_can_be_drawn(world):
    boat = Boat(world)
    markers = shown_markers(world)
    tracks = boat.send(pings(5, clutter=0))
    world.until(lambda: len(markers) == 5, "markers")
    [point] = points(tracks[-1])
    by_name = {marker.ns: marker for marker in markers[-1].markers}
    position = by_name["position"].pose.position
    assert (position.x, position.y) == (point["state_x"], point["state_y"])
    ellipse = by_name["ellipse"].scale
    largest = np.linalg.eigvalsh(
        [[point["cov_00"], point["cov_02"]], [point["cov_02"], point["cov_22"]]]
    )[-1]
    assert ellipse.x == pytest.approx(2 * math.sqrt(5.9915 * largest), rel=1e-4)
    for marker in markers[-1].markers:
        assert marker.color.a > 0
        assert marker.scale.z > 0


def drawn(messages):
    """Ids of the tracks that a viewer of these messages shows."""
    shown = set()
    for marker in [marker for message in messages for marker in message.markers]:
        key = (marker.ns, marker.id)
        if marker.action == Marker.DELETEALL:
            shown.clear()
        elif marker.action == Marker.DELETE:
            shown.discard(key)
        else:
            shown.add(key)
    return {track_id for _, track_id in shown}


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


def test_a_viewer_that_was_away_does_not_show_what_ended_meanwhile(world):
    boat = Boat(world, hold_time=30.0)
    first = shown_markers(world)
    sent = pings(12, clutter=0)
    boat.send(sent[:5])
    world.until(lambda: drawn(first), "a track")
    world.observer.destroy_subscription(first.subscription)
    world.until_connected()
    nothing = np.zeros(0, np.float32)
    boat.send([replace(ping, range=nothing, azimuth=nothing) for ping in sent[5:]])
    again = world.listen(MarkerArray, "tracks/markers", LATCHED)
    world.until(lambda: again and again[-1].markers[0].action == Marker.DELETEALL, "a greeting")
    assert drawn(again) == set()


def test_a_node_that_starts_again_removes_the_markers_of_the_one_before(world):
    boat = Boat(world)
    markers = shown_markers(world)
    boat.send(pings(6, clutter=0))
    world.until(lambda: drawn(markers), "a track")
    world.end(boat.node)
    world.make(TrackInitiator, named({}))
    world.until(lambda: not drawn(markers), "the old markers to go")


def test_detections_are_shown_where_they_were_placed(world):
    boat = Boat(world)
    placed = world.listen(PointCloud2, "detections/placed")
    world.until_connected()
    [ping] = pings(1)
    boat.send([ping], intensity=np.arange(len(ping.range), dtype=np.float32))
    world.until(lambda: placed, "detections")
    assert (placed[0].header.frame_id, stamp_ns(placed[0])) == ("sonar", ping.stamp_ns)
    found = points(placed[0])
    # The mean of an azimuth that errs by 1 degree is nearer by exp(-sigma^2 / 2): undone.
    unbiased = math.exp(math.radians(1.0) ** 2 / 2)
    x, y = (unbiased * ping.range * turn(ping.azimuth) for turn in (np.cos, np.sin))
    np.testing.assert_allclose([point["x"] for point in found], x, atol=0.5)
    np.testing.assert_allclose([point["y"] for point in found], y, atol=0.5)
    assert [point["intensity"] for point in found] == list(range(len(ping.range)))


def test_detections_are_handed_over_with_what_a_filter_needs(world):
    boat = Boat(world)
    tracks = world.listen(PointCloud2, "tracks")
    placed = world.listen(PointCloud2, "detections/placed")
    world.until_connected()
    sent = pings(3)
    delay = np.linspace(0.5, 11.0, len(sent[0].range))
    boat.send(sent, time_offset=delay.astype(np.float32))
    world.until(lambda: len(placed) == len(tracks) == len(sent), "detections")
    assert_stamps(placed, sent)
    for message, ping in zip(placed, sent, strict=True):
        found, expected = read_placed_detections(message), convert(as_scan(ping), SensorModel(), 0)
        np.testing.assert_allclose(found.position, expected["position"], rtol=1e-12)
        np.testing.assert_allclose(found.covariance, expected["covariance"], rtol=1e-9)
        np.testing.assert_array_equal(found.time_offset, delay.astype(np.float32))


def test_potential_tracks_are_drawn_by_their_evidence(world):
    boat = Boat(world, publish_potential_tracks=True, method="score")
    clouds = world.listen(PointCloud2, "potential_tracks")
    markers = world.listen(MarkerArray, "potential_tracks/markers")
    world.until_connected()
    boat.send(pings(3))
    world.until(lambda: len(clouds) == 3 and len(markers) == 3, "potential tracks")
    found = points(clouds[-1])
    assert all(math.isfinite(point["score"]) for point in found)
    first, positions, velocities = markers[-1].markers
    assert first.action == Marker.DELETEALL
    there = [(point["state_x"], point["state_y"]) for point in found]
    drawn_at = [(point.x, point.y) for point in positions.points]
    best = max(found, key=lambda point: point["score"])
    assert drawn_at[0] == (best["state_x"], best["state_y"])
    assert set(drawn_at) < set(there), "what is more likely clutter is not drawn"
    assert len(velocities.points) == 2 * len(drawn_at) > 2
    red = [color.r for color in positions.colors]
    assert red == sorted(red, reverse=True) and red[0] > red[-1]


def test_potential_tracks_come_only_while_switched_on(world):
    boat = Boat(world)
    potential = world.listen(PointCloud2, "potential_tracks")
    world.until_connected()
    sent = pings(9, clutter=20)

    def switch(on: bool) -> None:
        value = ParameterValue(type=ParameterType.PARAMETER_BOOL, bool_value=on)
        request = SetParameters.Request(
            parameters=[Parameter(name="publish_potential_tracks", value=value)]
        )
        response = world.call(SetParameters, "/track_initiator/set_parameters", request)
        assert response.results[0].successful, response.results[0].reason

    boat.send(sent[:3])
    switch(True)
    boat.send(sent[3:6])
    world.until(lambda: len(potential) >= 3, "potential tracks")
    switch(False)
    boat.send(sent[6:])
    world.statuses()  # after the last scan: whatever was published has come
    assert [stamp_ns(message) for message in potential] == [p.stamp_ns for p in sent[3:6]]

    same = initiator()
    for ping in sent[:6]:
        same.process(as_scan(ping))
    found = {tuple(point[name] for name in STATE) for point in points(potential[-1])}
    assert found == {tuple(track.state) for track in same.potential_tracks()}
    assert {point["hit_count"] for point in points(potential[-1])} <= {2, 3, 4}
    assert found


def test_results_are_published_in_the_callback_that_made_them(world):
    boat = Boat(world, diagnostics_period=3600.0)
    # From here the node runs only when it is told to, once per ping.
    world.executor.remove_node(boat.node)
    alone = SingleThreadedExecutor(context=world.context)
    alone.add_node(boat.node)
    received = []
    for number, ping in enumerate(sent := pings(6), 1):
        boat.driver.ping(ping)
        alone.spin_once(timeout_sec=10.0)
        world.until(lambda number=number: len(boat.tracks) == number, "tracks without a timer")
        received.append(boat.node.latency)
    alone.shutdown()
    assert_same(boat.tracks, confirmed(sent))
    for latency in received:
        assert 0 < latency.core < latency.to_tracks < latency.to_all < 5.0


def test_diagnostics_say_what_is_missing_and_then_what_was_done(world):
    node = world.make(TrackInitiator, named({}))
    missing = world.status("detections")
    assert (missing.message, missing.level) == ("no publisher of detections yet", b"\x01")
    world.end(node)
    boat = Boat(world)
    boat.driver.destroy_publisher(boat.driver.odometry)  # else it is said that nobody listens to it
    assert world.status("detections").message == "no scan yet"
    before = boat.node.get_clock().now().nanoseconds
    sent = pings()
    tracks = boat.send(sent)
    found = world.statuses()
    assert before <= stamp_ns(world.diagnostics[-1]) <= before + 60 * SECOND
    assert {status.name for status in world.diagnostics[-1].status} == {
        f"track_initiator: {task}" for task in TASKS
    }
    levels = {task: status.level for task, status in found.items()}
    # A tenth of the clutter of the data sheet: that is said.
    assert levels == {task: b"\x01" if task == "clutter" else b"\x00" for task in TASKS}
    figures = world.figures()
    assert int(figures["scans"]) == len(sent)
    assert int(figures["detections"]) == sum(len(ping.range) for ping in sent)
    assert int(figures["confirmed"]) == sum(message.width for message in tracks)
    assert float(figures["scan_interval_s"]) == pytest.approx(12.0)
    assert 0 < float(figures["core_ms"]) < float(figures["latency_ms"])
    assert float(figures["latency_ms"]) < float(figures["latency_all_ms"])
    assert 0 < float(figures["publishing_ms"]) < float(figures["latency_all_ms"])
    assert {"potential_tracks", "raw_confirmations", "pruned", "merged", "started"} <= set(figures)
    assert not [key for key in figures if key.startswith("dropped.")]


def test_a_drop_is_a_warning_for_the_window_only_and_counted_for_good(world):
    boat = Boat(world, diagnostics__window=0.5)
    sent = pings()
    boat.send(sent)
    boat.driver.ping(sent[-2])
    world.until(lambda: world.status("detections").level == b"\x01", "the warning")
    world.until(lambda: world.status("detections").level == b"\x00", "its end")
    assert world.dropped() == {"scan_late": 1}


def test_thresholds_may_change_while_running(world):
    boat = Boat(world)
    boat.send(pings())
    value = ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=0.01)
    request = SetParameters.Request(
        parameters=[Parameter(name="diagnostics.stale_time", value=value)]
    )
    assert world.status("detections").level == b"\x00"
    response = world.call(SetParameters, "/track_initiator/set_parameters", request)
    assert response.results[0].successful, response.results[0].reason
    world.until(lambda: world.status("detections").level == b"\x03", "that it is stale")


def test_reset_forgets_scans_tracks_and_counts_but_no_id_comes_twice(world):
    boat = Boat(world)
    current = world.listen(PointCloud2, "tracks/current", LATCHED)
    markers = shown_markers(world)
    world.until_connected()
    sent = pings()
    first = boat.send(sent)
    boat.driver.ping(sent[-2])  # late: dropped and counted
    world.until(lambda: world.dropped() == {"scan_late": 1}, "the count")
    response = world.call(Trigger, "/track_initiator/reset", Trigger.Request())
    assert response.success and response.message
    world.until(lambda: len(current) > len(sent) and len(markers) > len(sent), "what it cleared")
    assert current[-1].width == 0
    assert [marker.action for marker in markers[-1].markers] == [Marker.DELETEALL]
    figures = world.figures()
    assert figures["scans"] == "0"
    assert not [key for key in figures if key.startswith("dropped.")]
    again = boat.send(sent)  # the same stamps once more are neither late nor a restart
    assert_same(again, confirmed(sent))
    ids = [point["track_id"] for message in [*first, *again] for point in points(message)]
    assert len(set(ids)) == len(ids)


def test_reset_forgets_the_frame_of_the_detections(world):
    boat = Boat(world)
    sent = pings()
    boat.send(sent)
    world.call(Trigger, "/track_initiator/reset", Trigger.Request())
    received = boat.send(sent, frame_id="head")
    assert_same(received, confirmed(sent))
    assert {message.header.frame_id for message in received} == {"head"}


def test_reset_clears_the_current_tracks_in_their_frame(world):
    boat = Boat(world)
    current = world.listen(PointCloud2, "tracks/current", LATCHED)
    world.until_connected()
    sent = pings()
    boat.send(sent)
    world.call(Trigger, "/track_initiator/reset", Trigger.Request())
    world.until(lambda: len(current) > len(sent), "the empty message")
    assert current[-1].header.frame_id == "sonar", "RViz cannot place a message without a frame"


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
