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
"""The track initiator: bad input, diagnostics, charts, learned values, tracker reports."""

import itertools
import json
import os
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from nav_msgs.msg import OccupancyGrid
from rclpy.qos import QoSProfile
from sensor_msgs.msg import PointCloud2, PointField
from std_srvs.srv import Trigger
from support.boat import Boat, named
from support.expectation import COVARIANCE, STATE, assert_same, assert_stamps, confirmed
from support.ros_world import BEST_EFFORT, ERROR, LATCHED, RELIABLE, WARN, World
from support.sonar_driver import START_NS, Ping, cloud, pings, points, stamp_ns
from visualization_msgs.msg import Marker, MarkerArray

from tsepm_ros.nodes import track_initiator
from tsepm_ros.nodes.track_initiator import InitiatorLearnedFile, TrackInitiator
from tsepm_ros.tracker.maintenance.confirmed_tracks import ConfirmedTracks
from tsepm_ros.tracker.tracks import TrackStatus

SECOND = 10**9

SENT = pings(14)

WHEN = 4

"""The bad message comes after so many good ones, while potential tracks wait for more hits."""


def message(ping: Ping) -> PointCloud2:
    return cloud(ping.stamp_ns, {"range": ping.range, "azimuth": ping.azimuth})


def setting(**values: Any) -> Callable[[PointCloud2], None]:
    def spoil(bad: PointCloud2) -> None:
        for name, value in values.items():
            setattr(bad, name, value)

    return spoil


def field(index: int, **values: Any) -> Callable[[PointCloud2], None]:
    """Change the description of a field: 0 is range, 1 azimuth."""
    return lambda bad: setting(**values)(bad.fields[index])


UNUSABLE = {
    "no_azimuth": (field(1, name="phi"), "missing_field"),
    "counted_field": (field(0, count=2), "wrong_count"),
    "short_data": (lambda bad: setting(data=bad.data[:-1])(bad), "short_data"),
    "other_frame": (lambda bad: setting(frame_id="elsewhere")(bad.header), "unknown_frame"),
    "no_frame": (lambda bad: setting(frame_id="")(bad.header), "empty_frame"),
}

"""How a good message is spoilt, and what it then counts as."""

SAID = {
    "missing_field": "azimuth",
    "short_data": "height * row_step",
    "unknown_frame": "'elsewhere'",
    "empty_frame": "frame_id",
}


def spoilt(name: str, stamp_ns: int) -> PointCloud2:
    bad = message(replace(SENT[WHEN], stamp_ns=stamp_ns))
    UNUSABLE[name][0](bad)
    return bad


def test_unusable_messages_are_dropped_counted_and_named_and_cost_nothing_else(world):
    boat = Boat(world)
    received = boat.send(SENT[:WHEN])
    between = (SENT[WHEN - 1].stamp_ns + SENT[WHEN].stamp_ns) // 2
    for name in UNUSABLE:
        for _ in range(2):
            boat.driver.publisher.publish(spoilt(name, between))
    received += boat.send(SENT[WHEN:])
    expected = Counter(2 * [reason for _, reason in UNUSABLE.values()])
    assert world.dropped() == expected
    for reason, said in SAID.items():
        assert "\n" not in world.until_logged(reason, said, level=WARN)
    for reason in ("wrong_count", "unknown_frame", "empty_frame"):
        assert sum(reason in line for line in world.logged(WARN)) == 1, "said once of two"
    status = world.status("detections")
    assert status.level == b"\x01" and "2 empty_frame" in status.message
    assert_same(received, confirmed(SENT))
    assert_stamps(received, SENT)


def test_an_unusable_first_message_does_no_harm(world):
    boat = Boat(world)
    for name in ("no_azimuth", "short_data"):
        bad = spoilt(name, START_NS - SECOND)
        bad.header.frame_id = "elsewhere"
        boat.driver.publisher.publish(bad)
    assert_same(boat.send(SENT), confirmed(SENT))
    assert world.dropped() == {"missing_field": 1, "short_data": 1}


def test_a_scan_of_100_000_detections_is_processed_and_so_are_those_after_it(world):
    boat, rng = Boat(world), np.random.default_rng(5)
    distance = 9000 * np.sqrt(rng.uniform(0.01, 1, 100_000)).astype(np.float32)
    angle = rng.uniform(-np.pi, np.pi, 100_000).astype(np.float32)
    sent = [*SENT[:6], Ping(SENT[6].stamp_ns, distance, angle), *SENT[7:10]]
    assert_same(boat.send(sent), confirmed(sent))
    assert int(world.figures()["detections"]) == sum(len(ping.range) for ping in sent)
    assert world.dropped() == {}


ABSURD = [
    ("range", 4000.0, 1e300),
    ("azimuth", 0.5, 1e300),
    ("range_std", 45.0, 1e300),
    ("azimuth_std", 0.0175, 1e3),
    ("time_offset", 0.0, 1e300),
]


def test_finite_but_absurd_values_cost_no_track_of_others(world):
    # By the rule of 5 hits the target is started after the absurd ping, whatever the others hit.
    boat = Boat(world, method="tsepm")
    ping = SENT[WHEN]
    for name, usual, absurd in ABSURD:
        columns = {"range": ping.range, "azimuth": ping.azimuth}
        columns.setdefault(name, np.full(len(ping.range), usual))
        more = {"range": 4000.0, "azimuth": 0.5, name: absurd}
        columns = {key: np.append(values, more[key]) for key, values in columns.items()}
        boat.send(SENT[:WHEN])
        seen = len(boat.tracks)
        boat.driver.publisher.publish(cloud(ping.stamp_ns, columns, datatype=PointField.FLOAT64))
        boat.send(SENT[WHEN + 1 :])
        world.until(lambda: stamp_ns(boat.tracks[-1]) == SENT[-1].stamp_ns, "the last ping")
        x = [point["x"] for one in boat.tracks[seen:][:6] for point in points(one)]
        assert any(2900 < value < 3500 for value in x), "the target that was there all along"
        assert "internal_error" not in world.dropped()
        world.reset()


def test_a_stamp_that_no_clock_gives_is_dropped_and_counted(world):
    boat = Boat(world)
    received = boat.send(SENT[:WHEN])
    for sec in (SENT[WHEN].stamp_ns // SECOND, 2**31 - 1):
        for nanosec in (10**9, 2**32 - 1):
            bad = message(SENT[WHEN])
            bad.header.stamp.sec, bad.header.stamp.nanosec = sec, nanosec
            boat.driver.publisher.publish(bad)
    assert_same([*received, *boat.send(SENT[WHEN:])], confirmed(SENT))
    assert world.dropped() == {"stamp_invalid": 4}


TASKS = (
    *("overall", "track initiation", "detections", "own ship", "latency", "clutter"),
    *("sensor parameters", "quality of service", "downstream tracker", "land"),
)

OK, WARNING, STALE = b"\x00", b"\x01", b"\x03"


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
    world.until(lambda: world.status("own ship").level == WARNING, "the warning")
    said = "odometry is published on /own_ship/odometry, but own_ship_source is none"
    assert said in world.status("own ship").message
    world.until_logged(said, level=WARN)
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
    assert (missing.message, missing.level) == ("no publisher of /detections yet", b"\x01")
    world.end(node)
    boat = Boat(world, clutter_density="given")
    boat.driver.destroy_publisher(boat.driver.odometry)  # else it is said that nobody listens to it
    assert world.status("detections").message == "no scan yet, though /detections is published"
    before = boat.node.get_clock().now().nanoseconds
    sent = pings()
    tracks = boat.send(sent)
    found = world.statuses()
    assert before <= stamp_ns(world.diagnostics[-1]) <= before + 60 * SECOND
    assert {status.name for status in world.diagnostics[-1].status} == {
        f"/track_initiator: {task}" for task in TASKS
    }
    levels = {task: status.level for task, status in found.items()}
    levels["latency"] = OK  # of a busy machine it may be longer
    # A tenth of the clutter of the data sheet: that is said.
    assert levels == {task: WARNING if task in ("overall", "clutter") else OK for task in TASKS}
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


CLUTTERED = pings(8, clutter=2)


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
    boat.send(CLUTTERED[:1])
    # Different topics have no order: the chart may come after the first pings.
    world.until(lambda: float(world.figures()["land_area_m2"]) == 1e6, "the chart")
    chart.publish(grid(number=99))
    world.until_logged("land dropped", level=WARN)
    received = boat.send(CLUTTERED[1:])
    assert sum(one.width for one in received) == 0
    dropped = world.dropped()
    assert dropped["land_invalid"] == 1
    assert dropped["on_land"] >= len(CLUTTERED) - 1
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
    ping = CLUTTERED[0]
    boat.send([replace(ping, stamp_ns=ping.stamp_ns + number * 10**9)])
    return float(boat.world.figures()["land_area_m2"])


def test_a_publisher_that_does_not_keep_its_chart_is_named(world):
    charts(world, QoSProfile(depth=1))
    world.make(TrackInitiator)
    world.until_logged("does not offer reliable, transient local delivery", level=ERROR)


def test_what_was_learned_is_there_after_a_restart(world, tmp_path):
    path = tmp_path / "deeper" / "learned.json"
    boat = Boat(world, learned_file=str(path))
    sent = pings()
    boat.send(sent)
    world.until(lambda: world.figures()["scans"] == str(len(sent)), "the diagnostics")
    learned = float(world.figures()["clutter_density"])
    world.end(boat.node)
    assert json.loads(path.read_text())["clutter_scans"] > 0.0
    again = Boat(world, learned_file=str(path))
    world.until(lambda: world.figures()["scans"] == "0", "the diagnostics of the new node")
    assert float(world.figures()["clutter_density"]) == pytest.approx(learned, rel=0.1)
    assert learned != 1e-6
    world.until_logged("is used from")
    assert "what was learned" in world.reset().message
    world.end(again.node)
    assert not path.exists(), "a reset forgets the file"


def test_what_was_learned_of_a_coverage_that_is_told_is_used_as_soon_as_it_is(
    world, tmp_path, monkeypatch
):
    path, sent, told = tmp_path / "learned.json", pings(), {"sensor__max_range": 8500.0}

    def start() -> Boat:
        boat = Boat(world, learned_file=str(path))
        boat.send(sent[:2])  # detections of the first images come before their coverage
        return boat

    first = start()
    assert world.set_parameters(**told) == [""]
    first.send(sent[2:])
    world.end(first.node)
    written = path.read_text()
    untold = start()
    untold.node._learned.write()
    world.end(untold.node)
    assert json.loads(path.read_text()) == json.loads(written), "it may still be told"
    again = start()
    places = again.node._session.state.learned.fixed_places
    assert world.set_parameters(**told) == [""]
    learned, scans = again.node._session.state.learned, json.loads(written)["clutter_scans"]
    assert learned.clutter_map.memory[1] == pytest.approx(scans, rel=0.01) and scans > 5.0
    assert learned.fixed_places is places
    world.until_logged("is used from")
    world.end(again.node)
    never = start()
    monkeypatch.setattr(track_initiator, "SAVING_PERIOD", -1.0)
    never.node._learned.write()
    world.until_logged("is written anew", "sensor.max_range was 8500.0 and is 9000.0")
    assert json.loads(path.read_text())["sensor"]["max_range"] == 9000.0


def test_ended_tracks_leave_own_ship_counts_what_was_learned_and_its_file(world, tmp_path):
    path, sent = tmp_path / "learned.json", pings()
    odometry = {"own_ship_source": "odometry", "own_ship_max_gap": 200.0}
    held = world.listen(PointCloud2, "tracks/current", LATCHED)
    boat = Boat(world, learned_file=str(path), **odometry)
    boat.driver.pose(sent[0].stamp_ns - SECOND, 0.0, 0.0, 0.0)
    boat.driver.pose(sent[-1].stamp_ns + SECOND, 0.0, 0.0, 0.0)
    boat.send(sent[:-1])
    session = boat.node._session
    learned, poses = session.tracker.sensor.learned, len(session.own_ship.poses)
    assert len(session.tracker.current) and poses == 2
    assert world.call(Trigger, "/track_initiator/end_tracks", Trigger.Request()).success
    assert not len(session.tracker.current)
    world.until(lambda: held[-1].width == 0, "that they are gone, before another ping")
    assert held[-2].width > 0 and held[-1].header.frame_id == held[-2].header.frame_id
    boat.send(sent[-1:])
    assert session.tracker.sensor.learned.clutter_map is learned.clutter_map
    assert len(session.own_ship.poses) == poses
    world.until(lambda: world.figures()["scans"] == str(len(sent)), "the counts")
    world.end(boat.node)
    assert path.exists()


PATHS = [
    ("~nosuchuser/learned.json", "home directory"),
    ("x" * 5000, "more than 200 bytes"),
    ("deeper/" + "x" * 230, "more than 200 bytes"),
    ("", "Is a directory"),
    ("fifo", "a file of others"),
    ("/dev/zero", "a file of others"),
]


def test_a_file_with_a_number_out_of_bounds_is_refused_at_the_start_and_written_anew(
    world, tmp_path
):
    path = tmp_path / "learned.json"
    boat = Boat(world, learned_file=str(path))
    boat.send(pings())
    world.end(boat.node)
    path.write_text(json.dumps(json.loads(path.read_text()) | {"time": 10**400}))
    again, sent = Boat(world, learned_file=str(path)), pings()
    world.until_logged("is not used", "time must be")
    assert len(again.send(sent)) == len(sent)
    assert world.dropped() == {}
    world.end(again.node)
    assert json.loads(path.read_text(), parse_constant=pytest.fail)["clutter_scans"] <= 50.0


def test_a_path_that_cannot_be_a_file_is_refused_with_a_short_sentence(world, tmp_path):
    os.mkfifo(tmp_path / "fifo")
    for number, (path, said) in enumerate(PATHS, 1):
        given = path if path[:1] == "~" else str(tmp_path / path)
        node = world.make(TrackInitiator, {"learned_file": given})

        def refusals() -> list[str]:
            return [line for line in world.logged() if "is not used" in line]

        world.until(lambda number=number: len(refusals()) == number, "the refusal")
        assert said in refusals()[-1]
        world.end(node)
    assert all(len(line) < 800 for line in world.logged(30))


def fault_of_file(world) -> str:
    """What /diagnostics says of the learned file."""
    status = world.status("clutter")
    return status.message if status.level != DiagnosticStatus.OK else ""


OTHERS = {
    "boat.yaml": ("/**:\n  ros__parameters:\n    max_speed: 4.0\n", "it is a file of others"),
    "file/learned.json": (None, "Not a directory"),
}


@pytest.mark.parametrize("name", OTHERS)
def test_a_file_of_others_and_a_folder_that_is_none_stay_and_stand_on_the_diagnostics(
    world, tmp_path, name
):
    content, said = OTHERS[name]
    (tmp_path / "file").write_text("")
    path = tmp_path / name
    if content:
        path.write_text(content)
    boat = Boat(world, learned_file=str(path))
    boat.send(pings())
    for act in (boat.node._learned.write, boat.node._learned.forget, boat.node._learned.write):
        act()
        assert said in boat.node._learned.fault
    world.until(lambda: said in fault_of_file(world), "the diagnostics")
    assert (path.read_text() if content else None) == content
    if content:
        path.unlink()
        boat.node._learned.write()
        world.until(lambda: said not in fault_of_file(world), "the end of the fault")
        assert json.loads(path.read_text())["clutter_scans"] > 0.0
    world.end(boat.node)


def test_of_two_nodes_with_one_file_the_second_runs_without_it(world, tmp_path):
    path, sent = tmp_path / "learned.json", pings()
    boat = Boat(world, learned_file=str(path))
    boat.send(sent)
    boat.node._learned.write()
    before = path.read_bytes()
    other = InitiatorLearnedFile(boat.node._session, str(path), 1e9, boat.node.get_logger())
    assert "another node uses it" in other.fault
    other.write()
    other.forget()
    assert path.read_bytes() == before
    world.end(boat.node)
    other.write()
    assert not other.fault and path.read_bytes() != before
    other.close()


DATATYPES = {
    **dict.fromkeys(("x", "y", "z"), PointField.FLOAT32),
    "track_id": PointField.UINT32,
    **dict.fromkeys((*STATE, *COVARIANCE, "evaluation", "score"), PointField.FLOAT64),
    **dict.fromkeys(("hit_count", "scan_count"), PointField.UINT16),
    "age": PointField.FLOAT64,
}


class Tracker:
    """A downstream tracker, and what the node then holds."""

    def __init__(self, world: World, boat: Boat, qos=RELIABLE) -> None:
        self.world, self.boat = world, boat
        self.publisher = world.observer.create_publisher(PointCloud2, "tracked", qos)
        self.current = world.listen(PointCloud2, "tracks/current", LATCHED)
        self.markers = world.listen(MarkerArray, "tracks/markers")
        world.until(self.publisher.get_subscription_count, "the node to subscribe to tracked")
        world.until_connected()

    def say(self, after: float, *ids: int, frame_id: str = "sonar", sigma: float = 50.0) -> None:
        """Say at some time (s) what is tracked: targets at 2 m/s along y."""
        values = {name: np.zeros(len(ids)) for name in DATATYPES}
        values["track_id"] = np.array(ids)
        values["state_x"] = np.full(len(ids), 7000.0)
        values["state_y"] = 2.0 * after + 1000.0 * np.arange(len(ids))
        values["state_vy"] = np.full(len(ids), 2.0)
        for place in range(4):
            values[f"cov_{place}{place}"] = np.full(len(ids), (sigma if place % 2 == 0 else 1) ** 2)
        stamp = START_NS + round(after * SECOND)
        self.publish(cloud(stamp, values, frame_id=frame_id, datatypes=DATATYPES))

    def publish(self, message: PointCloud2) -> None:
        """Publish, and wait until the node has it."""
        [subscription] = [
            one for one in self.boat.node.subscriptions if one.topic_name == "/tracked"
        ]
        take, taken = subscription.callback, []

        def take_and_note(message: PointCloud2) -> None:
            take(message)
            taken.append(message)

        subscription.callback = take_and_note
        self.publisher.publish(message)
        self.world.until(lambda: taken, "the node to take it")
        subscription.callback = take

    def held_at(self, after: float) -> list[dict[str, float]]:
        """What is held at an empty ping at some time (s)."""
        stamp = START_NS + round(after * SECOND)
        self.boat.send([Ping(stamp, [], [])])
        self.world.until(
            lambda: self.current and stamp_ns(self.current[-1]) == stamp, "the current tracks"
        )
        return points(self.current[-1])

    def shown_at(self, after: float) -> tuple[set[int], set[int]]:
        """Ids that the markers of a ping show and delete."""
        stamp = START_NS + round(after * SECOND)

        def of_ping() -> list[Marker]:
            return [
                one for array in self.markers for one in array.markers if stamp_ns(one) == stamp
            ]

        self.world.until(of_ping, "markers")
        return tuple(
            {one.id for one in of_ping() if one.action == action}
            for action in (Marker.ADD, Marker.DELETE)
        )


def ids(held: list[dict[str, float]]) -> list[float]:
    return [point["track_id"] for point in held]


@pytest.mark.parametrize("qos", [RELIABLE, BEST_EFFORT], ids=["reliable", "best_effort"])
def test_what_is_tracked_is_held_carried_and_ended_as_the_tracker_says(world, qos):
    boat = Boat(world)
    tracker = Tracker(world, boat, qos)
    tracker.say(0.0, 2**31, 2**31 + 1)
    one, two = tracker.held_at(12.0)
    assert ids([one, two]) == [2**31, 2**31 + 1]
    np.testing.assert_allclose([one[name] for name in STATE], [7000.0, 0.0, 24.0, 2.0])
    assert one["cov_22"] > 50.0**2 + 12.0**2
    assert tracker.shown_at(12.0) == ({-(2**31), -(2**31) + 1}, set())
    tracker.say(13.0, 2**31 + 1)
    assert ids(tracker.held_at(24.0)) == [2**31 + 1]
    assert tracker.shown_at(24.0) == ({-(2**31) + 1}, {-(2**31)})
    tracker.say(25.0)
    assert tracker.held_at(36.0) == []
    assert world.dropped() == {}


def test_the_markers_of_a_track_that_is_not_published_any_more_are_deleted(world, monkeypatch):
    boat = Boat(world)
    tracker = Tracker(world, boat)
    tracker.say(0.0, 7, 8)
    assert ids(tracker.held_at(12.0)) == [7, 8]
    monkeypatch.setattr(
        ConfirmedTracks, "statuses", lambda held, *_: np.array([TrackStatus.STANDS_STILL, 0])
    )
    assert ids(tracker.held_at(24.0)) == [8]
    assert tracker.shown_at(24.0) == ({8}, {7})
    figures = world.figures()
    assert (figures["tracks.confirmed"], figures["tracks.stands_still"]) == ("1", "1")
    monkeypatch.undo()
    tracker.say(25.0, 8)
    assert ids(tracker.held_at(36.0)) == [8]
    world.until(lambda: world.figures().get("ended.tracker") == "1", "the end to be counted")
    assert tracker.held_at(48.0)
    assert world.figures()["ended.tracker"] == "1", "ends are counted since the start"
    world.until_logged("track 7 ended: the downstream tracker does not list it", level=20)


def test_a_tracker_that_falls_silent_and_comes_back_is_said(world):
    tracker = Tracker(world, Boat(world, tracked_timeout=20.0))
    tracker.say(20.0, 9)  # ahead of the ping: carried back
    [track] = tracker.held_at(12.0)
    np.testing.assert_allclose([track[name] for name in STATE], [7000.0, 0.0, 24.0, 2.0])
    assert world.figures()["tracker"] == "alive"
    assert ids(tracker.held_at(48.0)) == [9], "a pause of the sonar"
    assert world.figures()["tracker"] == "alive"
    assert ids(tracker.held_at(60.0)) == [9], "held here now"
    world.until_logged("downstream tracker was silent for 20 s", level=WARN)
    assert "silent" in world.status("downstream tracker").message
    assert world.figures()["tracker"] == "silent"
    tracker.say(61.0, 9)
    assert ids(tracker.held_at(72.0)) == [9]
    world.until_logged("downstream tracker reports again")
    assert world.figures()["tracker"] == "alive"


def test_messages_that_cannot_be_used_are_dropped_counted_and_said(world):
    tracker = Tracker(world, Boat(world))
    tracker.held_at(0.0)
    tracker.say(1.0, 9)
    tracker.publish(cloud(START_NS + 2 * SECOND, {"x": [1.0], "y": [2.0], "z": [0.0]}))
    tracker.publish(PointCloud2())
    tracker.say(3.0, 10, frame_id="map")
    assert ids(tracker.held_at(12.0)) == [9]
    tracker.say(13.0, 9, 9)
    assert ids(tracker.held_at(24.0)) == [9]
    tracker.say(25.0, 9, sigma=float("nan"))
    assert ids(tracker.held_at(36.0)) == [9], "it is listed"
    assert world.dropped() == {
        "tracked_missing_field": 2,
        "tracked_frame": 1,
        "tracked_duplicate_id": 1,
        "tracked_not_finite": 1,
    }
    world.until_logged("tracked targets dropped", "'track_id' is missing", level=WARN)
    world.until_logged("1 tracked targets dropped, with ids 9: the state or cov", level=WARN)
    world.until_logged("tracked targets are in frame 'map'", level=WARN)
