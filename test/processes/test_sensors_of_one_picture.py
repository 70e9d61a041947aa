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
"""Three sensors of a vessel in one node: order, losses, clocks, diagnostics, messages."""

import gc
import math
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import PointCloud2
from support.boat import named
from support.ros_world import LATCHED, World
from support.sonar_driver import points, stamp_ns
from support.transforms import Transforms
from support.vessel import PARAMETERS, SENSORS, START, TARGETS, Vessel

from msg_adapters import ns_to_time, track_cloud
from msg_adapters.message_input import MessageInput
from tsepm_ros.nodes.base_node import ParameterError
from tsepm_ros.nodes.track_initiator import TrackInitiator
from tsepm_ros.session.session import Session
from tsepm_ros.session.shared_picture import share_picture
from tsepm_ros.settings.node_options import InitiatorNodeOptions
from tsepm_ros.settings.settings import (
    TRACK_INITIATOR,
    make_groups,
    options_by_sensor,
    settings_from,
)


class Bridge:
    """The node, publishers of its sensors, and a clock that this test sets."""

    def __init__(self, world: World, **parameters: Any) -> None:
        self.world, observer = world, world.observer
        given = parameters if "sensors" in parameters else {**PARAMETERS, **parameters}
        self.given = {"max_scan_time": 3600.0, **given}
        self.clock = observer.create_publisher(Clock, "/clock", 10)
        self.detections = {
            name: observer.create_publisher(PointCloud2, f"{name}/detections", 1000)
            for name in SENSORS
        }
        self.odometry = observer.create_publisher(Odometry, "own_ship/odometry", 1000)
        given = {"use_sim_time": True, "diagnostics_period": 0.3, **self.given}
        self.node = world.make(TrackInitiator, named(given))
        self.placed = world.listen(PointCloud2, "detections/placed")
        self.current = world.listen(PointCloud2, "tracks/current", LATCHED)
        self.sent: list[tuple[float, str, Any]] = []
        world.until_connected()

    def session(self, name: str) -> Session:
        return self.node._picture.sessions[name]

    def play(self, vessel: Vessel, duration: float, begin: float = -1.0) -> None:
        """Messages in the order of their arrival, each taken before the next."""
        for now, name, message in vessel.messages(duration, begin):
            self.set_clock(now)
            self.send(now, name, message)

    def set_clock(self, now: float) -> None:
        at = START * 10**9 + round(now * 1e9)
        clock = Clock(clock=ns_to_time(at))
        node = self.node
        self.world.until(
            lambda: node.get_clock().now().nanoseconds == at,
            "the clock",
            lambda: self.clock.publish(clock),
        )

    def send(self, now: float, name: str, message: Any) -> None:
        self.sent.append((now, name, message))
        if name:
            before = self.session(name).arrivals
            self.detections[name].publish(message)
            self.world.until(lambda: self.session(name).arrivals > before, "the scan")
        else:
            poses = self.node._session.own_ship.poses
            stamp = 1e-9 * stamp_ns(message)
            self.odometry.publish(message)
            self.world.until(lambda: abs((poses.last_stamp or 0.0) - stamp) < 1e-6, "the pose")

    def processed(self) -> list[tuple[str, int]]:
        """Names of the sensors and stamps of the scans that were processed."""
        return [(SENSORS[points(one)[0]["sensor"]], stamp_ns(one)) for one in self.placed]


def offline(given: dict[str, Any], order: list[tuple[str, int]], sent: list) -> list[PointCloud2]:
    """`tracks/current` of sessions without a node, from the same messages in that order."""
    options = options_by_sensor(make_groups(TRACK_INITIATOR, given))
    sessions = {name: Session(settings_from(one)) for name, one in options.items()}
    picture = share_picture(sessions)
    inputs = {
        name: MessageInput(sessions[name], one[InitiatorNodeOptions])
        for name, one in options.items()
    }
    scans = {(name, stamp_ns(message)): message for _, name, message in sent if name}
    poses = [message for _, name, message in sent if not name]
    clouds = []
    for name, stamp in order:
        while poses and stamp_ns(poses[0]) <= stamp + 0.21e9:
            inputs["port"].take_own_ship(poses.pop(0))
        inputs[name].take_detections(scans[name, stamp], (1e-9 * stamp, math.nan))
        for one in sessions[name].process():
            result = one.in_frame()
            header = scans[name, stamp].header
            header.frame_id = result.frame_id
            seen_by = picture.tracker.seen_by(result.current)
            clouds.append(track_cloud(header, result.current, seen_by))
    return clouds


def assert_same_clouds(live: list[PointCloud2], other: list[PointCloud2]) -> None:
    assert len(live) == len(other)
    for one, expected in zip(live, other, strict=True):
        assert stamp_ns(one) == stamp_ns(expected)
        assert (bytes(one.data), one.fields) == (bytes(expected.data), expected.fields)


def test_live_as_offline_to_the_bit_where_a_sensor_dies_and_comes_back_and_one_is_late(world):
    bridge = Bridge(world)
    vessel = Vessel(late={"radar": 1.0}, silent={"starboard": (6.0, 11.0)})
    bridge.play(vessel, 17.0)
    world.until(lambda: len(bridge.current) == len(bridge.placed), "all messages")
    order = bridge.processed()
    stamps = [stamp for _, stamp in order]
    assert stamps == sorted(stamps)
    sent = sum(bool(name) for _, name, _ in bridge.sent)
    late = {name: bridge.session(name).dropped for name in SENSORS}
    assert late["port"] == late["radar"] == {}, "its first scan was waited for"
    waiting = sum(len(bridge.session(name).queue.scans) for name in SENSORS)
    lost = sum(sum(one.values()) for one in late.values())
    assert len(order) + lost + waiting == sent and lost <= 6 and waiting < 25
    assert_same_clouds(bridge.current, offline(bridge.given, order, bridge.sent))
    for cloud, (name, _) in zip(bridge.placed, order, strict=True):
        assert {point["sensor"] for point in points(cloud)} == {SENSORS.index(name)}
    assert [field.name for field in bridge.placed[0].fields][-1] == "sensor"
    assert [field.name for field in bridge.current[0].fields][-1] == "seen_by"
    seen = {}
    for track in points(bridge.current[-1]):
        for number, (x, vx, y, vy) in enumerate(TARGETS[:2]):
            if math.hypot(track["x"] - x - 17.0 * vx, track["y"] - y - 17.0 * vy) < 2.0:
                seen[number] = track["seen_by"]
    assert seen == {0: 0b101, 1: 0b110}, "the radar sees both, port and starboard their own sides"


def values_of(status: Any) -> dict[str, str]:
    return {value.key: value.value for value in status.values}


def settled(world: World, task: str, level: bytes, *words: str) -> Any:
    """An entry once it has a level and says so."""
    found: list[Any] = []

    def has() -> bool:
        found[:] = [world.status(task)]
        return found[0].level == level and all(word in found[0].message for word in words)

    world.until(has, f"{task} with {level!r} and {words}")
    return found[0]


def test_each_sensor_has_its_entries_and_the_picture_those_that_are_of_all(world):
    bridge = Bridge(world, **{"diagnostics.max_latency": 0.001})
    bridge.play(Vessel(late={"radar": 0.12}, silent={"starboard": (5.0, 99.0)}), 8.0)
    found = world.statuses()
    assert set(found) == {
        *("overall", "track initiation", "own ship", "latency", "clutter", "quality of service"),
        *("downstream tracker", "land"),
        *(f"{name}/{task}" for name in SENSORS for task in ("detections", "sensor parameters")),
    }
    assert values_of(found["track initiation"])["sensors"] == " ".join(SENSORS)
    each = "port 0.02 s, starboard 0.02 s, radar 0.12 s"
    assert values_of(found["track initiation"])["latencies"] == each
    slow = settled(world, "latency", b"\x01", "after its arrival; from stamp to arrival: " + each)
    assert slow.message.startswith("a scan was finished ")
    values = values_of(found["port/detections"])
    assert values["coverage"] == "0 60 -1.1 1.1"
    x, y, yaw = map(float, values["pose"].split())
    assert (x, y, yaw) == pytest.approx((7.9, 0.0, 1.0), abs=0.2)
    assert float(values["last_scan"]) < 5.0
    received = [int(values_of(found[f"{name}/detections"])["received"]) for name in SENSORS]
    assert sum(received) == int(values_of(found["track initiation"])["detections"])
    topics = values_of(found["quality of service"])
    assert topics["topics.port/detections"] == "/port/detections"
    assert "topics.detections" not in topics
    said = settled(world, "starboard/detections", b"\x01", "no starboard scan for")
    assert "expected is one every 0.2 s" in said.message
    bridge.play(Vessel(), 10.0, 8.0)
    assert settled(world, "starboard/detections", b"\x00").message.endswith("every 0.2 s")


def test_a_mounting_is_said_to_be_compared_once_it_is_and_a_wrong_one_is_logged_once(world):
    bridge = Bridge(world)
    bridge.play(Vessel(), 1.0)
    unknown = "nothing speaks against them; mounting not compared yet, 0 of 60 detections; shared"
    settled(world, "port/sensor parameters", b"\x00", unknown)
    learned = {name: bridge.session(name).state.alignment for name in SENSORS}
    for turn in (0.05, 0.0):
        for name, one in learned.items():
            some = turn * (name == "port") + 0.01 * np.random.default_rng(1).standard_normal(2000)
            one.update(np.array([0.0 * some, some]), np.ones((2, len(some))))
        if turn:
            line = world.until_logged("port sees targets 2.8")
            assert "set port.mounting.yaw to 0.95" in line and "(now 1.0000)" in line
    world.until_logged("port is in line again: ")
    assert [line for line in world.logged() if "sees targets" in line] == [line]
    settled(world, "port/sensor parameters", b"\x00", "mounting compared, ", " beside the others")


def test_a_sensor_without_a_publisher_is_named_with_its_topic(world):
    world.make(TrackInitiator, named(PARAMETERS))
    found = world.statuses()
    for name in SENSORS:
        said = found[f"{name}/detections"]
        assert (said.level, said.message) == (b"\x01", f"no publisher of /{name}/detections yet")


def test_a_message_in_the_frame_of_another_sensor_is_dropped_counted_and_said(world):
    bridge = Bridge(world)
    bridge.play(Vessel(), 2.0)
    message = [one for _, name, one in bridge.sent if name == "port"][-1]
    message.header.frame_id = "starboard"
    bridge.detections["port"].publish(message)
    said = world.until_logged("port: detections are in frame 'starboard', expected 'port'")
    assert "that of starboard: are topics exchanged? (1 so far: unknown_frame)" in said
    status = settled(world, "port/detections", b"\x01", "1 unknown_frame")
    assert values_of(status)["dropped.unknown_frame"] == "1"
    assert "published by" not in said + status.message
    second = world.make(Node, node_name="second_driver").create_publisher(
        PointCloud2, "port/detections", 9
    )
    world.until(lambda: second.get_subscription_count() == 1, "the subscription")
    second.publish(message)
    both = f"; /port/detections is published by /{world.observer.get_name()} and /second_driver"
    settled(world, "port/detections", b"\x01", "2 unknown_frame", both)
    bridge.node._said.clear()  # of what is logged each 10 s
    second.publish(message)
    assert both in world.until_logged("(3 so far: unknown_frame)")
    assert "dropped.unknown_frame" not in values_of(world.status("starboard/detections"))


def test_two_names_of_one_topic_are_refused_and_so_is_a_method_of_one_sensor(world):
    rules = ["--ros-args", "-r", "port/detections:=/s", "-r", "starboard/detections:=/s"]
    with pytest.raises(ParameterError, match="port/detections and starboard/detections are one"):
        world.make(TrackInitiator, PARAMETERS, cli_args=rules)
    with pytest.raises(ParameterError, match="'tsepm' takes one sensor; 'score' takes several"):
        world.make(TrackInitiator, {**PARAMETERS, "method": "tsepm"})
    with pytest.raises(ParameterError, match=r"port\.detections_type: "):
        world.make(TrackInitiator, {**PARAMETERS, "port.detections_type": "nothing/msg/Nothing"})


def test_a_value_of_a_sensor_changes_alone_and_one_of_all_where_a_sensor_has_none(world):
    bridge = Bridge(world)
    ranges = lambda: [bridge.session(name).state.model.max_range for name in SENSORS]  # noqa: E731
    assert ranges() == [60.0, 60.0, 200.0]
    assert world.set_parameters(port__sensor__max_range=50.0) == [""]
    assert ranges() == [50.0, 60.0, 200.0]
    assert world.set_parameters(sensor__max_range=70.0) == [""]
    assert ranges() == [50.0, 70.0, 200.0]
    assert bridge.node.get_parameter("starboard.sensor.max_range").value == 70.0
    [said] = world.set_parameters(starboard__sensor__max_range=-1.0)
    assert "starboard.sensor.max_range" in said
    assert "read-only" in world.set_parameters(port__sweep="auto")[0]
    assert world.set_parameters(max_speed=4.0) == [""]
    assert {bridge.session(name).settings.common.max_speed for name in SENSORS} == {4.0}
    assert ranges() == [50.0, 70.0, 200.0]


def test_what_was_learned_of_every_sensor_outlives_the_node(world, tmp_path):
    path = tmp_path / "learned"
    bridge = Bridge(world, learned_file=str(path))
    bridge.play(Vessel(), 4.0)
    before = {name: bridge.session(name).state.clutter_density for name in SENSORS}
    world.end(bridge.node)
    node = world.make(TrackInitiator, named({**bridge.given, "learned_file": str(path)}))
    for name, one in node._picture.sessions.items():
        assert one.state.clutter_density == pytest.approx(before[name], rel=0.2), name
        world.until_logged(f"{name}: what was learned 0 min ago is used from")


def test_a_reset_and_an_end_of_tracks_are_of_the_picture(world):
    bridge = Bridge(world)
    bridge.play(Vessel(), 8.0)
    assert points(bridge.current[-1])
    world.reset()
    assert bridge.node._picture.tracker.stamp is None
    for one in bridge.node._picture.sessions.values():
        assert not one.dropped and not one.queue.scans
    bridge.play(Vessel(), 8.0)
    assert points(bridge.current[-1])


@pytest.mark.long
@pytest.mark.timeout(3600)
@pytest.mark.filterwarnings("default::RuntimeWarning")  # as of a user, whose log has it
def test_over_20_000_pings_memory_grows_by_less_than_a_kilobyte_each_and_nothing_is_lost(world):
    node = world.make(TrackInitiator, named({**PARAMETERS, "diagnostics_period": 1.0}))
    vessel = Vessel(late={"radar": 1.0}, silent={"starboard": (300.0, 500.0)}, again=40.0)
    memory, pings = {}, 0
    for now, name, message in vessel.messages(1600.0):
        node._clocks.now = lambda now=now: (now, now)
        if name:
            node.take_detections(message, 0.0, name)
            pings += 1
            if pings % 50 == 0:
                world.spin_once(0.0)
            if pings % 1000 == 0:
                world.diagnostics.clear()  # what this process has heard is not the node's
                world.log.clear()
                memory[pings] = resident()
        else:
            node._take_own_ship(message)
    sessions = node._picture.sessions
    assert pings > 20_000
    assert memory[20_000] - memory[5_000] < 15.0, memory  # MB; the vessel is 1.6 km further on
    assert sum(sum(one.dropped.values()) for one in sessions.values()) < 20
    assert node._picture.figures().totals.confirmed > 50
    print(f"resident memory by pings, MB: {memory}")


def resident() -> float:
    """Resident memory of this process, MB."""
    gc.collect()
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 2**20


def test_with_tf_the_frames_of_the_messages_tell_where_each_sensor_is(world, monkeypatch):
    places = {"port": (1.0, 2.0), "starboard": (1.0, -2.0), "radar": (-3.0, 0.0)}

    class Frames(Transforms):
        def lookup_transform(self, target: str, source: str, time: Any, *more: Any) -> Any:
            self.pose = lambda _: (places[source], [0.0, 0.0, 0.0, 1.0])
            return super().lookup_transform(target, source, time, *more)

    Frames(lambda _: ((0.0, 0.0), [0.0, 0.0, 0.0, 1.0])).install(monkeypatch)
    given = {name: value for name, value in PARAMETERS.items() if "mounting" not in name}
    bridge = Bridge(world, **given | {"own_ship_source": "tf", "fixed_frame": "map"})
    for now, name, message in Vessel().messages(3.0):
        if name:
            bridge.set_clock(now)
            bridge.send(now, name, message)
    found = world.statuses()
    for name, (x, y) in places.items():
        assert values_of(found[f"{name}/detections"])["pose"] == f"{x:g} {y:g} 0"
    assert not any(one.dropped for one in bridge.node._picture.sessions.values())
