"""Processor time of the track viewer's server beside a live source.

A process publishes what a track initiator publishes: new tracks, detections, held tracks, potential
tracks, odometry and diagnostics. The viewer is the node, in a process of its own; its processor
time, that of all its threads, is the system's figure. This process reads the websocket as a browser
does, and notes for each frame the time since the publication of its scan.

    python benchmarks/viewer.py [--rate 20] [--tracks 100] [--browsers 1] [--seconds 30]
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")

import numpy as np
import rclpy
from nav_msgs.msg import Odometry
from process_load import processor_seconds, resident_megabytes
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import PointCloud2
from tornado.websocket import websocket_connect

from msg_adapters import (
    PlacedDetections,
    diagnostics,
    make_header,
    odometry_message,
    placed_detections_cloud,
    track_cloud,
)
from tsepm_ros.diagnostics.health import ENTRIES
from tsepm_ros.diagnostics.health_figures import Level, Status
from tsepm_ros.own_ship.pose_history import PoseSample
from tsepm_ros.tracker.tracks import ConfirmedTrack

SETTLING = 5.0
PATIENCE = 60.0


def tracks_at(stamp: float, number: int) -> list[ConfirmedTrack]:
    """Tracks that move on straight lines."""
    rng = np.random.default_rng(number)
    position = rng.uniform(-8000.0, 8000.0, (number, 2))
    velocity = rng.uniform(-8.0, 8.0, (number, 2))
    state = np.empty((number, 4))
    state[:, 0::2], state[:, 1::2] = position + stamp % 600.0 * velocity, velocity
    covariance = np.diag([2500.0, 1.0, 3600.0, 1.0])
    return [
        ConfirmedTrack(
            track_id=track_id,
            stamp=stamp,
            state=row,
            covariance=covariance,
            hits=((0, 0), (1, 0), (3, 0), (4, 0)),
            evaluation=-1.0,
            score=9.0,
            scan_count=5,
            age=60.0,
        )
        for track_id, row in enumerate(state)
    ]


def publish(options: argparse.Namespace) -> None:
    """Publish scans at the rate until interrupted; the stamp is the time of publication."""
    rclpy.init(domain_id=options.domain)
    node = Node("source")
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    new, placed, potential = (
        node.create_publisher(PointCloud2, topic, 10)
        for topic in ("tracks", "detections/placed", "potential_tracks")
    )
    current = node.create_publisher(PointCloud2, "tracks/current", latched)
    odometry = node.create_publisher(Odometry, "own_ship/odometry", 10)
    health = node.create_publisher(type(diagnostics(0, "", [])), "/diagnostics", 10)
    rng = np.random.default_rng(1)
    entries = [
        Status(task, Level.OK, "all is well", {f"figure_{k}": float(k) for k in range(12)})
        for task in ENTRIES
    ]
    covariance = np.tile(np.diag([400.0, 900.0]), (options.detections, 1, 1))
    begin, scan = time.monotonic(), 0
    while rclpy.ok():
        ahead = begin + scan / options.rate - time.monotonic()
        time.sleep(max(ahead, 0.0))
        stamp = time.time()
        header = make_header(round(stamp * 1e9), "odom")
        if scan % max(round(options.rate), 1) == 0:
            health.publish(diagnostics(round(stamp * 1e9), "track_initiator", entries))
        pose = PoseSample(stamp, 0.1 * scan, 0.0, 0.3, None, frame_id="odom")
        odometry.publish(odometry_message(pose))
        new.publish(track_cloud(header, []))
        position = rng.uniform(-9000.0, 9000.0, (options.detections, 2))
        offset = np.zeros(options.detections)
        placed.publish(
            placed_detections_cloud(header, PlacedDetections(position, covariance, offset))
        )
        current.publish(track_cloud(header, tracks_at(stamp, options.tracks)))
        potential.publish(track_cloud(header, tracks_at(stamp, options.potential)))
        scan += 1


async def watch(url: str, browsers: int, seconds: float) -> list[tuple[int, float]]:
    """Numbers and delays (s) of the frames that the last browser receives."""
    sockets = [await websocket_connect(url, max_message_size=2**28) for _ in range(browsers)]
    received: list[tuple[int, float]] = []

    async def drain(socket, note: bool) -> None:
        while (message := await socket.read_message()) is not None:
            if not note:
                continue
            update, now = json.loads(message), time.time()
            if "all" not in update:
                received.extend((f["number"], now - f["stamp"]) for f in update.get("frames", []))

    tasks = [
        asyncio.create_task(drain(socket, place == browsers - 1))
        for place, socket in enumerate(sockets)
    ]
    await asyncio.sleep(seconds)
    for task in tasks:
        task.cancel()
    return received


def measure(options: argparse.Namespace, viewer: subprocess.Popen, log: Path) -> None:
    """Measure the running viewer and print the figures."""
    end = time.monotonic() + PATIENCE
    while not (found := re.search(r"open http://(\S+)", log.read_text())):
        if time.monotonic() > end or viewer.poll() is not None:
            raise SystemExit(f"the viewer does not start: {log.read_text()}")
        time.sleep(0.1)
    url = f"ws://{found[1]}updates"
    asyncio.run(watch(url, 1, SETTLING))
    before, begin = processor_seconds(viewer.pid), time.monotonic()
    received = asyncio.run(watch(url, options.browsers, options.seconds))
    elapsed = time.monotonic() - begin
    share = (processor_seconds(viewer.pid) - before) / elapsed
    numbers = [number for number, _ in received]
    scans = numbers[-1] - numbers[0] + 1
    last = dict(received)  # a frame may come again with what arrived later
    delays = 1e3 * np.array(list(last.values()))
    print(
        f"{options.rate:g} scans/s, {options.tracks} tracks, {options.detections} detections, "
        f"{options.potential} potential tracks, {options.browsers} browser(s), {elapsed:.0f} s"
    )
    print(f"server: {100 * share:.1f} % of a core, {resident_megabytes(viewer.pid):.0f} MB")
    print(
        f"browser: {len(last)} of {scans} scans; from publication to browser median "
        f"{np.median(delays):.0f} ms, 99 % {np.quantile(delays, 0.99):.0f} ms"
    )


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rate", type=float, default=20.0)
    parser.add_argument("--tracks", type=int, default=100)
    parser.add_argument("--detections", type=int, default=250)
    parser.add_argument("--potential", type=int, default=100)
    parser.add_argument("--browsers", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--domain", type=int, default=os.getpid() % 100 + 1)
    parser.add_argument("--publish", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.publish:
        publish(options)
        return
    environment = {**os.environ, "ROS_DOMAIN_ID": str(options.domain)}
    arguments = [sys.executable, __file__, "--publish", "--domain", str(options.domain)]
    for name in ("rate", "tracks", "detections", "potential"):
        arguments += [f"--{name}", str(getattr(options, name))]
    node = [
        sys.executable,
        "-m",
        "tsepm_ros.tools.viewer.track_viewer",
        "--ros-args",
        "-p",
        "port:=0",
    ]
    with tempfile.TemporaryDirectory() as folder:
        temporary_log = Path(folder) / "viewer.txt"
        with temporary_log.open("wb") as output:
            viewer = subprocess.Popen(node, env=environment, stdout=output, stderr=output)
        source = subprocess.Popen(arguments, stderr=subprocess.DEVNULL)
        try:
            measure(options, viewer, temporary_log)
        finally:
            for process in (source, viewer):
                process.send_signal(signal.SIGINT)
                try:
                    process.wait(10.0)
                except subprocess.TimeoutExpired:
                    process.kill()


if __name__ == "__main__":
    main()
