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
"""Processor time, memory and latency of the node beside a fast sonar.

The node is a process of its own. This process publishes pings of an imaging sonar with swimmers and
false detections at a fixed rate, and notes the time from a ping's publication to the arrival of its
message on `tracks`. The processor time of a message is the system's figure for all threads:
inside the tracker or the detector, and around. Beside it stands a plain rclpy node with the same
imports, topics and sizes of messages, which computes nothing: what the middleware costs. Options
are the defaults. With --images the detections are made by sonar_detector, another process, of
images of 500 ranges and 256 beams, with --moving of a sonar under way, by its odometry.

    python benchmarks/node_load.py [--rate 20] [--targets 10] [--detections 25] [--seconds 60]
    python benchmarks/node_load.py --images [--moving] [--rate 10] [--targets 4]

With `--bridge`, `track_bridge` beside a bare subscriber of the same messages, both at once:
confirmed tracks and own ship at the rate, with TTM once a second, as by default, and in each ping.

    python benchmarks/node_load.py --bridge [--rate 10] [--targets 50] [--seconds 60]

With `--under COMMAND` that command starts the nodes: `--under "taskset -c 1"` gives them one core,
`--under "systemd-run --scope -qp CPUQuota=30%"` a part of one, as a small computer has.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import re
import shlex
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")

import numpy as np
import rclpy
from nav_msgs.msg import Odometry
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import Image, PointCloud2

from msg_adapters import (
    detections_cloud,
    make_header,
    odometry_message,
    time_to_ns,
    track_cloud,
)
from tsepm_ros.own_ship.pose_history import PoseSample
from tsepm_ros.tracker.tracks import ConfirmedTrack

CELLS, BEAMS = 500, 256
SECTOR = {"sensor.azimuth_min": -1.1, "sensor.azimuth_max": 1.1, "sensor.max_range": 300.0}
"""Coverage of the images."""
MAX_RANGE, RANGE_STD, AZIMUTH_STD = 300.0, 0.3, 0.01
DETECTION_PROBABILITY, MAX_SPEED = 0.9, 5.0
SETTLING = 20.0
"""Time of pings until the tracks are held and the clutter is learned, s."""
TIMED = """
import json, time
from tsepm_ros.nodes.{node} import main
from {module} import {name}
inside, process = [], {name}.process
def timed(*arguments):
    begin = time.thread_time()
    try:
        return process(*arguments)
    finally:
        inside.append(time.thread_time() - begin)
{name}.process = timed
main()
print(json.dumps(inside))
"""
"""Program of a node that prints the time inside of each message at its end."""
PLAIN = """
import json, rclpy
from rclpy.node import Node
from sensor_msgs.msg import Image, PointCloud2
from msg_adapters import detections_cloud, make_header, track_cloud
from tsepm_ros.nodes.publishers import OUTPUTS
from tsepm_ros.tracker.tracks import ConfirmedTrack
import numpy as np, tsepm_ros.nodes.{node}
rclpy.init()
node = Node("{node}")
header = make_header(0, "sonar")
if "{node}" == "track_initiator":
    tracks = [ConfirmedTrack(n, 0.0, np.ones(4), np.eye(4), (), 0.0) for n in range(10)]
    publishers = {{name: node.create_publisher(kind, name, depth)
                  for name, (kind, depth, _) in OUTPUTS.items()}}
    results = {{"tracks": track_cloud(header, []), "tracks/current": track_cloud(header, tracks)}}
    heard, topic = PointCloud2, "detections"
else:
    publishers = {{"detections": node.create_publisher(PointCloud2, "detections", 10)}}
    ones = np.ones(25)
    results = {{"detections": detections_cloud(header, range=ones, azimuth=ones)}}
    heard, topic = Image, "image"
def answer(message):
    for name, result in results.items():
        result.header = message.header
        publishers[name].publish(result)
node.create_subscription(heard, topic, answer, 10)
try:
    rclpy.spin(node)
except BaseException:
    print(json.dumps([0.0]))
"""
"""Program of a plain rclpy node with the topics of a node."""
INSIDE = {
    "sonar_detector": ("tsepm_ros.detector.detector", "Detector"),
    "track_initiator": ("tsepm_ros.tracker.tracker", "Tracker"),
}
"""Module and class of what computes in each node."""
BRIDGE = "from tsepm_ros.tools.bridge.track_bridge import main; main()"
BRIDGES = {
    "bare subscriber": (
        """
import rclpy, tsepm_ros.tools.bridge.track_bridge
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2
rclpy.init()
node = Node("bare")
node.create_subscription(PointCloud2, "tracks/current", lambda message: None, 10)
rclpy.spin(node)
""",
        {},
    ),
    "track_bridge": (BRIDGE, {"nmea_address": "127.0.0.1:10110"}),
    "TTM each ping": (BRIDGE, {"nmea_address": "127.0.0.1:10111", "nmea_period": 0.0}),
}
"""Program and parameters of each process that receives confirmed tracks."""
PARAMETERS = {
    "max_speed": MAX_SPEED,
    "sensor.max_range": MAX_RANGE,
    "sensor.range_std": RANGE_STD,
    "sensor.range_std_fraction": 0.0,
    "sensor.azimuth_std": AZIMUTH_STD,
}


class Swimmers:
    """Pings of an imaging sonar: targets on straight lines among uniform false detections."""

    def __init__(self, targets: int, detections: int) -> None:
        self._rng = np.random.default_rng(3)
        self._detections = detections
        self._position = self._rng.uniform(-0.6 * MAX_RANGE, 0.6 * MAX_RANGE, (targets, 2))
        self._velocity = self._rng.uniform(-1.5, 1.5, (targets, 2))

    def ping(self, stamp_ns: int, seconds: float) -> PointCloud2:
        """The detections at a time after the start, s."""
        rng = self._rng
        x, y = (self._position + seconds * self._velocity).T
        seen = rng.random(len(x)) < DETECTION_PROBABILITY
        number, false = int(seen.sum()), max(self._detections - int(seen.sum()), 0)
        return detections_cloud(
            make_header(stamp_ns, "sonar"),
            range=np.append(
                np.abs(np.hypot(x, y)[seen] + rng.normal(0.0, RANGE_STD, number)) + 1e-3,
                MAX_RANGE * np.sqrt(rng.uniform(1e-6, 1.0, false)),
            ),
            azimuth=np.append(
                np.arctan2(y, x)[seen] + rng.normal(0.0, AZIMUTH_STD, number),
                rng.uniform(-np.pi, np.pi, false),
            ),
        )


class Pictures:
    """Images of an imaging sonar: targets that move outwards in Rayleigh speckle, mono8."""

    def __init__(self, targets: int) -> None:
        rng = np.random.default_rng(3)
        self._fields = rng.rayleigh(15.0, (64, CELLS, BEAMS)).astype(np.float32)
        self._beam = np.linspace(20.0, BEAMS - 20.0, targets)
        self._cell = np.linspace(0.3, 0.7, targets) * CELLS

    def ping(self, stamp_ns: int, seconds: float) -> Image:
        """The image at a time after the start, s, as displayed."""
        field = self._fields[int(10 * seconds) % len(self._fields)].copy()
        for beam, begin in zip(self._beam, self._cell, strict=True):
            # To and fro over a quarter of the range, at 1 m/s.
            far = abs((seconds / 60.0 + 0.5) % 2.0 - 1.0) * 60.0 / MAX_RANGE * CELLS
            rows, columns = np.ogrid[-12:13, -4:5]
            row, column = int(begin + far), int(beam)
            field[row - 12 : row + 13, column - 4 : column + 5] += 150.0 * np.exp(
                -0.5 * ((rows / 3.0) ** 2 + (columns / 1.0) ** 2)
            )
        shown = np.minimum(field, 255.0).astype(np.uint8)[::-1]
        return Image(
            header=make_header(stamp_ns, "sonar"),
            height=CELLS,
            width=BEAMS,
            step=BEAMS,
            encoding="mono8",
            data=np.ascontiguousarray(shown).tobytes(),
        )


TICKS = os.sysconf("SC_CLK_TCK")


def processor_seconds(pid: int) -> float:
    """Processor time of a process so far, s."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / TICKS


def resident_megabytes(pid: int) -> float:
    """Resident memory of a process, MB."""
    found = re.search(r"VmRSS:\s+(\d+)", Path(f"/proc/{pid}/status").read_text())
    return int(found[1]) / 1024 if found else float("nan")


def spin(node: Node) -> None:
    """Spin until the context ends."""
    with contextlib.suppress(ExternalShutdownException):
        rclpy.spin(node)


def odometry_at(stamp_ns: int, seconds: float) -> Odometry:
    """Own ship's, ahead at 1 m/s and turning by 0.02 rad/s, at a time after the start, s."""
    yaw = 0.02 * seconds
    place = 50.0 * np.sin(yaw), 50.0 * (1.0 - np.cos(yaw))
    rates = np.cos(yaw), np.sin(yaw), 0.02
    pose = PoseSample(1e-9 * stamp_ns, *place, yaw, rates=rates, frame_id="odom")
    return odometry_message(pose)


DOMAIN = os.getpid() % 100 + 1


def started(
    program: str, parameters: dict[str, Any], under: Sequence[str] = (), **options: Any
) -> subprocess.Popen[bytes]:
    """A node as a process of its own, begun by a command that replaces itself by it."""
    words = [word for name, value in parameters.items() for word in ("-p", f"{name}:={value}")]
    return subprocess.Popen(
        [*under, sys.executable, "-c", program, "--ros-args", *words],
        # One thread, as the executables have.
        env={**os.environ, "ROS_DOMAIN_ID": str(DOMAIN), "OPENBLAS_NUM_THREADS": "1"},
        stderr=subprocess.DEVNULL,
        **options,
    )


Sources = list[tuple[Publisher, Callable[[int, float], Any]]]


def sources(driver: Node, sonar: Swimmers | Pictures, moving: bool) -> Sources:
    """Publishers of a node, and what each publishes at a stamp and time; pings come last."""
    kind, topic = (Image, "image") if isinstance(sonar, Pictures) else (PointCloud2, "detections")
    poses = [(driver.create_publisher(Odometry, "own_ship/odometry", 10), odometry_at)] * moving
    return [*poses, (driver.create_publisher(kind, topic, 10), sonar.ping)]


def publish(published: Sources, stamp_ns: int, seconds: float) -> float:
    """Publish of each source, when all are made; the time of it, s."""
    messages = [make(stamp_ns, seconds) for _, make in published]
    begin = time.monotonic()
    for (publisher, _), message in zip(published, messages, strict=True):
        publisher.publish(message)
    return begin


def measure(
    plain: bool,
    sonar: Swimmers | Pictures,
    moving: bool,
    rate: float,
    seconds: float,
    under: Sequence[str],
) -> tuple[dict[str, dict[str, float]], dict[str, float]]:
    """Drive the node, with images both: figures of each, and latencies, after the settling time."""
    of_images = isinstance(sonar, Pictures)
    nodes = ["track_initiator", *["sonar_detector"] * of_images]
    processes = {}
    for node in nodes:
        module, name = INSIDE[node]
        program = (PLAIN if plain else TIMED).format(node=node, module=module, name=name)
        given: dict[str, Any] = dict(SECTOR if of_images else {})
        given["own_ship_source"] = "odometry" if moving else "none"
        if node == "track_initiator":
            given |= PARAMETERS
        processes[node] = started(program, given, under, stdout=subprocess.PIPE)
    rclpy.init(domain_id=DOMAIN)
    driver = Node("driver")
    sent: dict[int, float] = {}
    latency: dict[int, float] = {}

    def on_tracks(message: PointCloud2) -> None:
        stamp = time_to_ns(message.header.stamp)
        latency[stamp] = time.monotonic() - sent[stamp]

    published = sources(driver, sonar, moving)
    driver.create_subscription(PointCloud2, "tracks", on_tracks, 10)
    spinning = threading.Thread(target=spin, args=(driver,))
    spinning.start()
    try:
        while not published[-1][0].get_subscription_count():
            time.sleep(0.05)
        time.sleep(3.0 if of_images else 1.0)
        begin, settled = time.monotonic(), round(rate * SETTLING)
        used = dict.fromkeys(processes, 0.0)
        for index in range(settled + round(rate * seconds)):
            time.sleep(max(begin + index / rate - time.monotonic(), 0.0))
            if index == settled:
                used = {name: processor_seconds(one.pid) for name, one in processes.items()}
            stamp = time.time_ns()
            sent[stamp] = publish(published, stamp, index / rate)
        time.sleep(1.0)
        figures = {}
        for name, one in processes.items():
            whole = 1e3 * (processor_seconds(one.pid) - used[name]) / (rate * seconds)
            figures[name] = {"whole ms": whole, "memory MB": resident_megabytes(one.pid)}
    finally:
        for one in processes.values():
            one.terminate()
        inside = {name: one.communicate()[0] for name, one in processes.items()}
        rclpy.try_shutdown()
        spinning.join()
    arrived = [1e3 * latency[stamp] for stamp in list(sent)[settled:] if stamp in latency]
    median, high = np.percentile(arrived, [50, 99])
    for name, row in figures.items():
        times = json.loads(inside[name].splitlines()[-1])[-round(rate * seconds) :]
        row["inside ms"] = 1e3 * float(np.sum(times)) / (rate * seconds)
        row["around ms"] = row["whole ms"] - row["inside ms"]
    latencies = {"latency ms": float(median), "p99 ms": float(high)}
    return figures, latencies | {"lost": len(sent) - len(latency)}


def measure_bridges(number: int, rate: float, seconds: float) -> dict[str, float]:
    """Share of a core, %, of each of `BRIDGES` while all receive the same confirmed tracks."""
    processes = {name: started(*given) for name, given in BRIDGES.items()}
    rclpy.init(domain_id=DOMAIN)
    driver, rng = Node("driver"), np.random.default_rng(1)
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    held = driver.create_publisher(PointCloud2, "tracks/current", latched)
    odometry = driver.create_publisher(Odometry, "own_ship/odometry", 10)
    states = rng.uniform(-1000.0, 1000.0, (number, 4)) * (1.0, 0.005, 1.0, 0.005)
    try:
        while held.get_subscription_count() < len(processes):
            time.sleep(0.05)
        time.sleep(3.0)
        used = {name: processor_seconds(process.pid) for name, process in processes.items()}
        begin = time.monotonic()
        for index in range(round(rate * seconds)):
            time.sleep(max(begin + index / rate - time.monotonic(), 0.0))
            stamp = time.time_ns()
            pose = PoseSample(1e-9 * stamp, 0.0, 0.0, 0.3, rates=(1.0, 0.0, 0.0), frame_id="odom")
            odometry.publish(odometry_message(pose))
            tracks = [
                ConfirmedTrack(track_id, 1e-9 * stamp, state, np.eye(4), (), 0.0)
                for track_id, state in enumerate(states)
            ]
            held.publish(track_cloud(make_header(stamp, "odom"), tracks))
        time.sleep(0.5)
        return {
            name: 100.0 * (processor_seconds(process.pid) - used[name]) / seconds
            for name, process in processes.items()
        }
    finally:
        for process in processes.values():
            process.terminate()
            process.wait()
        rclpy.try_shutdown()


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--images", action="store_true", help="images, and both nodes")
    parser.add_argument("--moving", action="store_true", help="a sonar under way")
    parser.add_argument("--bridge", action="store_true", help="track_bridge, by confirmed tracks")
    parser.add_argument("--rate", type=float, help="pings per second; 20, of the bridge 10")
    parser.add_argument("--targets", type=int, help="10, of the bridge 50")
    parser.add_argument("--detections", type=int, default=25, help="detections a ping")
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--under", default="", help="command that starts the nodes")
    options = parser.parse_args()
    rate = options.rate or (10.0 if options.bridge else 20.0)
    targets = options.targets or (50 if options.bridge else 10)
    if options.bridge:
        loads = measure_bridges(targets, rate, options.seconds)
        bare = loads["bare subscriber"]
        for name, load in loads.items():
            print(f"{name:16s} processor % {load:5.2f}, above the bare one {load - bare:5.2f}")
        return
    for plain in (False, True):
        swimmers = Swimmers(targets, options.detections)
        sonar = Pictures(targets) if options.images else swimmers
        under = shlex.split(options.under)
        rows, latencies = measure(plain, sonar, options.moving, rate, options.seconds, under)
        for name, row in rows.items():
            title = f"plain {name}" if plain else name
            print(f"{title:22s}", *(f"{label} {value:7.2f}" for label, value in row.items()))
        print(f"{'':22s}", *(f"{label} {value:7.2f}" for label, value in latencies.items()))


if __name__ == "__main__":
    main()
