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
"""The nodes over the middleware: mutated messages, a subscriber that is stopped, overload.

A case has a node, a driver and an observer in a domain of their own, and is one of `KINDS`. No
callback raises; everything that came in is a scan or a counted drop. Viewer, bridge and detector
take the good message after those that no node means: absurd grids, tracks, levels, topics, times.
"""

import array
import copy
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from typing import Any

import campaign
import numpy as np
from campaign import Finding, Tried
from invariants import lost_scans, require
from mutation import mutate
from nav_msgs.msg import OccupancyGrid, Odometry
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import serialize_message
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Image, NavSatFix, PointCloud2
from streams import START, good_stream, land_message, stamp_of, tracker_message
from support.ros_domains import own_domain
from support.ros_world import World
from support.sonar_driver import Driver, Ping

from msg_adapters import (
    PlacedDetections,
    diagnostics,
    make_header,
    odometry_message,
    placed_detections_cloud,
    track_cloud,
)
from tsepm_ros.diagnostics.health_figures import Level, Status
from tsepm_ros.nodes.sonar_detector import SonarDetector
from tsepm_ros.nodes.track_initiator import TrackInitiator
from tsepm_ros.own_ship.pose_history import PoseSample
from tsepm_ros.session.drop_reasons import DROP_REASONS
from tsepm_ros.tools.bridge.track_bridge import TrackBridge
from tsepm_ros.tools.viewer.track_viewer import TrackViewer
from tsepm_ros.tracker.tracks import ConfirmedTrack

POINTS = "sensor_msgs/msg/PointCloud2"
DEEP = QoSProfile(depth=1000)
LATCHED = QoSProfile(depth=1000, durability=DurabilityPolicy.TRANSIENT_LOCAL)
MUTATED = 1500
"""Messages of a case of that kind."""
BURST = 100
TRACK_TOPICS = "tracks/current", "tracks", "potential_tracks", "fixed_echoes"
OFTEN = 0.1
"""Period of the diagnostics, s."""
WAIT = 30.0
STOPPED = """
import os, sys, rclpy
from rclpy.node import Node
from rclpy.qos import QoSProfile
from sensor_msgs.msg import PointCloud2
from nav_msgs.msg import Odometry
from visualization_msgs.msg import MarkerArray
rclpy.init(domain_id=int(sys.argv[1]))
node = Node("stopped")
topics = {"tracks/odometry": Odometry, "tracks/markers": MarkerArray}
topics |= dict.fromkeys(("tracks", "tracks/current", "detections/placed"), PointCloud2)
for name, kind in topics.items():
    node.create_subscription(kind, name, lambda message: None, QoSProfile(depth=5))
print("ready", flush=True)
rclpy.spin(node)
"""


class Scene:
    """A node, its driver and what it says."""

    def __init__(self, world: World, **parameters: Any) -> None:
        self.world = world
        self.driver = world.add(Node("driver", context=world.context))
        self.detections = self.driver.create_publisher(PointCloud2, "detections", DEEP)
        values = {"diagnostics_period": OFTEN, "max_speed": 10.0, **parameters}
        self.node = world.make(TrackInitiator, values)
        self.tracks = world.listen(PointCloud2, "tracks")
        world.until(self.detections.get_subscription_count, "the subscription")
        world.until_connected()
        self.sent = 0

    def counted(self) -> int:
        """Scans, drops of scans, and scans that wait for own-ship data, from diagnostics."""
        figures = self.world.figures()
        counts = {
            key.removeprefix("dropped."): int(value)
            for key, value in figures.items()
            if key.startswith("dropped.")
        }
        waiting = int(figures.get("waiting_for_own_ship", 0))
        return int(figures["scans"]) + lost_scans(counts) + waiting

    def settle(self) -> None:
        """Wait until everything sent is counted; fail if for long no more is.

        A scan far back or ahead waits for the next one, which tells a restart from a bad stamp.
        """
        end, before = time.monotonic() + WAIT, -1
        while not (self.sent - 1 <= (counted := self.counted()) <= self.sent):
            if counted != before:
                end, before = time.monotonic() + WAIT, counted
            if time.monotonic() > end:
                raise Finding(f"{self.sent} sent, {counted} counted: {self.world.dropped()}")
        dropped = self.world.dropped()
        require(not dropped.get("internal_error"), f"internal errors: {dropped}")
        require(set(dropped) <= set(DROP_REASONS), f"reasons without description: {dropped}")

    def send(self, message: Any) -> bool:
        """Publish detections; False if the message cannot be sent."""
        try:
            self.detections.publish(message)
        except (AssertionError, OverflowError, TypeError, ValueError, UnicodeError):
            return False
        self.sent += 1
        return True

    def stream(self, shift: float = 0.0) -> list[int]:
        """Send the good stream; returns the number of new tracks of each ping."""
        seen = len(self.tracks)
        pings = good_stream(POINTS).pings
        for ping in pings:
            message = copy.deepcopy(ping.detections)
            message.header.stamp = stamp_of(seconds_of(message) + shift)
            self.send(message)
        self.world.until(lambda: len(self.tracks) >= seen + len(pings), "an answer to every ping")
        return [cloud.width for cloud in self.tracks[seen:]]


def seconds_of(message: Any) -> float:
    """Stamp of a message, s."""
    return message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec


def mutated_messages(world: World, rng: np.random.Generator, domain: int) -> Tried:
    """Mutated messages on every topic, then a good stream long after."""
    scene = Scene(world, own_ship_source=str(rng.choice(["none", "odometry"])))
    others = {
        "own_ship/odometry": (Odometry, good_stream(POINTS).pings[3].poses[0]),
        "tracked": (PointCloud2, tracker_message(START + 40.0)),
        "land": (OccupancyGrid, land_message()),
    }
    publishers = {
        topic: scene.driver.create_publisher(kind, topic, LATCHED if topic == "land" else DEEP)
        for topic, (kind, _) in others.items()
    }
    world.until_connected()
    tried: Tried = Counter()
    for index in range(MUTATED):
        if rng.random() < 0.7:
            ping = good_stream(POINTS).pings[rng.integers(14)]
            message = copy.deepcopy(ping.detections)
            message.header.stamp = stamp_of(START + 0.1 * index)
            mutate(message, rng)
            tried["detections"] += scene.send(message)
        else:
            topic = str(rng.choice(list(others)))
            message = copy.deepcopy(others[topic][1])
            mutate(message, rng)
            try:
                publishers[topic].publish(message)
                tried[topic] += 1
            except (AssertionError, OverflowError, TypeError, ValueError, UnicodeError):
                continue
        if index % BURST == BURST - 1:
            world.spin_once()
            scene.settle()
    scene.settle()
    tried["messages"] += sum(tried.values())
    return tried


def no_messages(world: World, rng: np.random.Generator, domain: int) -> Tried:
    """Bytes that are no message, between the pings of a good stream."""
    scene = Scene(world)
    alone = scene.stream()
    whole = serialize_message(good_stream(POINTS).pings[5].detections)
    pings = good_stream(POINTS).pings
    times = [seconds_of(ping.detections) for ping in pings]
    on = times[-1] - times[0] + times[1] - times[0]  # one ping that leaps would wait for the next
    seen, number = len(scene.tracks), 0
    for ping in pings:
        for _ in range(4):
            data = bytearray(whole[: int(rng.integers(len(whole)))])
            for place in rng.integers(0, max(1, len(data)), 3).tolist() if data else ():
                data[place] = int(rng.integers(256))
            scene.detections.publish(bytes(data))
            number += 1
        message = copy.deepcopy(ping.detections)
        message.header.stamp = stamp_of(seconds_of(message) + on)
        scene.send(message)
        seen += 1
        world.until(lambda expected=seen: len(scene.tracks) >= expected, "an answer")
    return Counter({"byte strings": number, "messages": number, "good tracks": sum(alone)})


def stopped_subscriber(world: World, rng: np.random.Generator, domain: int) -> Tried:
    """A reliable subscriber is stopped: the node does not wait for it."""
    with tempfile.TemporaryFile() as output:
        process = subprocess.Popen(
            [sys.executable, "-c", STOPPED, str(domain)], stdout=subprocess.PIPE, stderr=output
        )
        try:
            require(process.stdout.readline() == b"ready\n", "the subscriber does not start")
            scene = Scene(world)
            world.until(lambda: world.observer.count_subscribers("/tracks") > 1, "it to be seen")
            process.send_signal(signal.SIGSTOP)
            for turn in range(3):
                require(sum(scene.stream(shift=turn * 1000.0)) >= 1, "nothing is confirmed")
            scene.settle()
            return Counter({"stopped subscribers": 1, "messages": scene.sent})
        finally:
            process.kill()
            process.wait()
            process.stdout.close()


def overload(world: World, rng: np.random.Generator, domain: int) -> Tried:
    """Big pings in bursts, faster than the node; each is answered, or counted as skipped."""
    scene = Scene(world, method=str(rng.choice(["score", "tsepm"])), max_scan_time=0.05)
    before = len(scene.tracks)
    number = 60
    for index in range(number):
        count = int(rng.integers(1, 400))
        columns = np.zeros((count, 2), "<f4")
        columns[:, 0] = 9000 * np.sqrt(rng.uniform(0.01, 1, count))
        columns[:, 1] = rng.uniform(-np.pi, np.pi, count)
        message = copy.deepcopy(good_stream(POINTS).pings[0].detections)
        message.header.stamp = stamp_of(START + 2.0 * index)
        message.fields = message.fields[:2]
        message.fields[0].name, message.fields[1].name = "range", "azimuth"
        message.fields[1].offset, message.point_step = 4, 8
        message.width, message.row_step = count, 8 * count
        message.data = columns.tobytes()
        scene.send(message)
    scene.settle()
    processed = number - world.dropped().get("overload", 0)
    world.until(lambda: len(scene.tracks) >= before + processed, "an answer to every other ping")
    return Counter({"overloading pings": number, "messages": number})


def lights(world: World, rng: np.random.Generator, domain: int) -> Tried:
    """A driver that dies and comes back, poses out of order, empty scans: each entry says its own.

    The entry goes on while the cause lasts, and off again; nothing else is dropped.
    """
    interval, number = float(rng.uniform(0.05, 0.2)), 0
    given = {"own_ship_source": "odometry", "diagnostics_period": OFTEN, "sensor.max_range": 500.0}
    world.make(TrackInitiator, {"own_ship_timeout": 1.0, **given})

    def driver() -> Driver:
        made = world.add(Driver(world.context))
        world.until(made.publisher.get_subscription_count, "the subscription")
        world.until(made.odometry.get_subscription_count, "the subscription")
        return made

    def until(task: str, said: str, what: str, *, swaps: bool = False, echoes: int = 12) -> None:
        nonlocal number
        end = time.monotonic() + WAIT
        while not any(
            (said in status.message) if said else status.level == b"\x00"
            for message in world.diagnostics[-1:]
            for status in message.status
            if status.name.endswith(f": {task}")
        ):
            require(time.monotonic() < end, f"{what}: {world.statuses()[task].message}")
            if not sonar:
                world.spin_once()
                continue
            number += 1
            stamp = START * 10**9 + round(1e9 * interval * number)
            poses = [stamp - 1000, stamp + 1000]
            for at in poses[::-1] if swaps else poses:
                sonar[-1].pose(at, 0.0, 0.0, 0.0)
            places = 500.0 * np.sqrt(rng.uniform(0.01, 1.0, echoes))
            sonar[-1].ping(Ping(stamp, places, rng.uniform(-3.1, 3.1, echoes)))
            due = time.monotonic() + interval
            while time.monotonic() < due:
                world.spin_once()

    sonar = [driver()]
    for _ in range(30):
        until("detections", "a scan every", "good pings")
        world.diagnostics.clear()
    until("own ship", "", "good poses")
    until("own ship", "own_ship_late", "poses out of order", swaps=True)
    until("own ship", "", "good poses again")
    world.end(sonar.pop())
    until("detections", "its publisher is gone", "a driver that died")
    sonar.append(driver())
    until("detections", "", "a driver that came back")
    until("detections", "where clutter gave", "empty scans", echoes=0)
    until("detections", "", "echoes again")
    dropped = set(world.dropped())
    require(dropped <= {"own_ship_late"}, f"dropped: {dropped}")
    return Counter({"drivers that died": 1, "poses out of order": 1, "messages": number})


def good_others(stamp: float) -> dict[str, Any]:
    """A message of each topic of viewer, bridge and detector, and of /clock."""
    header = make_header(round(stamp * 1e9), "odom")
    track = ConfirmedTrack(7, stamp, np.array([50.0, 1.0, 90.0, 2.0]), np.eye(4), (), 0.5)
    covariance = np.eye(2)[None] * np.ones((3, 1, 1))
    placed = PlacedDetections(np.ones((3, 2)), covariance, np.zeros(3), {})
    plan = OccupancyGrid(header=header, data=array.array("b", range(16)))
    plan.info.resolution, plan.info.width, plan.info.height = 2.0, 4, 4
    topics = {"topics.tracks/current": "/tracks/current", "topics.tracks": "/tracks"}
    health = [
        Status("overall", Level.OK, "well", {"received": 7}),
        Status("detections", Level.WARN, "late", {"received": 7}),
        Status("quality of service", Level.OK, "all", topics),
    ]
    rows = np.random.default_rng(5).integers(1, 200, (40, 16), np.uint8)
    fix = NavSatFix(header=header, latitude=59.65, longitude=10.63)
    pose = PoseSample(stamp, 1.0, 2.0, 0.3, rates=(1.0, 0.5, 0.0), frame_id="odom")
    return {
        **dict.fromkeys(TRACK_TOPICS, track_cloud(header, [track])),
        "detections/placed": placed_detections_cloud(header, placed),
        "own_ship/odometry": odometry_message(pose),
        "fix": fix,
        "image/plan": plan,
        "image": Image(
            header=header, height=40, width=16, step=16, encoding="mono8", data=rows.tobytes()
        ),
        "/diagnostics": diagnostics(round(stamp * 1e9), "/boat/track_initiator", health),
        "/clock": Clock(clock=header.stamp),
    }


def other_nodes(world: World, rng: np.random.Generator, domain: int) -> Tried:
    """Mutated messages, and bytes that are none, for viewer, bridge and detector."""
    near = float(rng.choice([0.0, 5e3, 9e7]))
    window = {"sensor.min_range": near, "sensor.max_range": near + float(rng.choice([0.3, 40.0]))}
    sector = {"sensor.azimuth_min": -0.6, "sensor.azimuth_max": 0.6, "use_sim_time": True}
    detector = world.make(SonarDetector, window | sector)
    viewer = world.make(TrackViewer, {"port": 0, "use_sim_time": True})
    to = {"nmea_address": "127.0.0.1:9", "nmea_sentences": "both", "nmea_period": 0.0}
    bridge = world.make(TrackBridge, to)
    driver = world.add(Node("driver", context=world.context))
    publishers = {
        topic: driver.create_publisher(type(message), topic, DEEP)
        for topic, message in good_others(START).items()
    }
    viewer._state.asked_image()
    world.until(publishers["image/plan"].get_subscription_count, "the page's wish for images")
    world.until_connected()
    tried: Tried = Counter()
    for index in range(MUTATED):
        topic = str(rng.choice(list(publishers)))
        message = copy.deepcopy(good_others(START + 0.1 * index)[topic])  # fields are shared
        mutate(message, rng)
        try:
            if rng.random() < 0.05:
                data = bytearray(serialize_message(message))
                publishers[topic].publish(bytes(data[: int(rng.integers(len(data)))]))
            else:
                publishers[topic].publish(message)
        except (AssertionError, OverflowError, TypeError, ValueError, UnicodeError):
            continue
        tried[topic] += 1
        viewer._state.asked_image()
        for _ in range(3):
            world.spin_once(0.0)
    before = detector._input.detector.measured["images"]
    last = START + 0.1 * MUTATED + 1000.0
    viewer._state.image = ""

    def send() -> None:
        for topic, message in good_others(last).items():
            publishers[topic].publish(message)

    def is_taken() -> bool:
        shown = f'"stamp":{last}' in viewer._state.since()[0] and viewer._state.image
        found = detector._input.detector.measured["images"] > before
        return bool(shown) and found and bridge._reported == last

    world.until(is_taken, "the good messages to be shown, processed and reported", send)
    tried["messages"] += sum(tried.values())
    return tried


KINDS = (
    *(mutated_messages, mutated_messages, no_messages, stopped_subscriber, overload),
    *(other_nodes, other_nodes, lights),
)


def case(number: int, rng: np.random.Generator) -> Tried:
    """A case of a kind, in a domain of its own."""
    with own_domain() as domain, World(domain, WAIT) as world:
        kind = KINDS[number % len(KINDS)]
        return Counter({f"cases {kind.__name__}": 1}) + kind(world, rng, domain)


if __name__ == "__main__":
    sys.exit(campaign.main("middleware", __doc__, case))
