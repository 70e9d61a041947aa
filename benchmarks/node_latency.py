"""Latency that the node adds to the algorithm, compared with one hop of the middleware.

The node's latency is the time from callback entry until the new tracks, and until all messages, are
published, less the core's time. The hop is the time from a driver's publish call in another process
to a callback in this process, for a message of the same size on a separate topic, sent before each
ping while the node is idle. Node and listener run single-threaded here, over local DDS.

    python benchmarks/node_latency.py [--detections 250] [--scans 300]
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time

os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")

import numpy as np
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from sensor_msgs.msg import PointCloud2

from msg_adapters import detections_cloud, make_header, time_to_ns
from tsepm_ros.diagnostics.health_figures import Latency
from tsepm_ros.nodes.track_initiator import TrackInitiator

PERIOD = 12.0
MAX_RANGE = 9000.0
SETTLING = 2.0
PAUSE = 0.02
"""Time for the node to become idle before each hop and each ping, s."""
PATIENCE = 20.0


def drive(domain: int, detections: int, scans: int) -> None:
    """Publish the pings, each after a message of the same size for the hop."""
    rng = np.random.default_rng(1)
    rclpy.init(domain_id=domain)
    node = Node("driver")
    pings = node.create_publisher(PointCloud2, "detections", 10)
    answers: list[PointCloud2] = []
    node.create_subscription(PointCloud2, "tracks", answers.append, 10)
    hops = node.create_publisher(PointCloud2, "hop", 10)
    while not pings.get_subscription_count() or not hops.get_subscription_count():
        rclpy.spin_once(node, timeout_sec=0.05)
    time.sleep(SETTLING)
    for index in range(scans):
        cloud = detections_cloud(
            make_header(round((index + 1) * PERIOD * 1e9), "sonar"),
            range=MAX_RANGE * np.sqrt(rng.uniform(1e-6, 1.0, detections)),
            azimuth=rng.uniform(-np.pi, np.pi, detections),
        )
        stamp = cloud.header.stamp
        cloud.header.stamp = make_header(time.monotonic_ns(), "").stamp
        hops.publish(cloud)
        time.sleep(PAUSE)
        cloud.header.stamp = stamp
        pings.publish(cloud)
        until = time.monotonic() + PATIENCE
        while len(answers) <= index and time.monotonic() < until:
            rclpy.spin_once(node, timeout_sec=0.1)
        time.sleep(PAUSE)
    time.sleep(SETTLING)
    node.destroy_node()
    rclpy.try_shutdown()


def measure(detections: int, scans: int) -> dict[str, np.ndarray]:
    """Latencies of node and core of each ping, and of the hops, s."""
    domain = os.getpid() % 100 + 1
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=domain)
    node = TrackInitiator(
        context=context,
        parameter_overrides=[
            Parameter("detections_type", value="sensor_msgs/msg/PointCloud2"),
            Parameter("detections_reliability", value="reliable"),
        ],
    )
    listener, hops = Node("listener", context=context), []

    def on_hop(message: PointCloud2) -> None:
        hops.append((time.monotonic_ns() - time_to_ns(message.header.stamp)) * 1e-9)

    listener.create_subscription(PointCloud2, "hop", on_hop, 10)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    executor.add_node(listener)
    arguments = [str(domain), str(detections), str(scans)]
    driver = subprocess.Popen([sys.executable, __file__, "--drive", *arguments])
    figures: list[Latency] = []
    while driver.poll() is None:
        executor.spin_once(timeout_sec=0.1)
        latency = node.latency
        if latency.to_all and (not figures or figures[-1] is not latency):
            figures.append(latency)
    executor.shutdown()
    node.destroy_node()
    listener.destroy_node()
    context.try_shutdown()
    parts = [(latency.core, latency.to_tracks, latency.to_all) for latency in figures]
    core, tracks, every = np.array(parts).T
    own = {"node adds, to tracks": tracks - core, "node adds, to all": every - core}
    return {**own, "core": core, "bare hop": np.array(hops)}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--detections", type=int, default=250)
    parser.add_argument("--scans", type=int, default=300)
    parser.add_argument("--drive", type=int, nargs=3, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.drive:
        drive(*options.drive)
        return
    figures = measure(options.detections, options.scans)
    print(f"{options.detections} detections a ping, {len(figures['core'])} pings, ms")
    for name, seconds in figures.items():
        median, high = 1e3 * np.percentile(seconds, [50, 99])
        print(
            f"{name:20s} median {median:7.3f}   p99 {high:7.3f}   worst {1e3 * seconds.max():7.3f}"
        )


if __name__ == "__main__":
    main()
