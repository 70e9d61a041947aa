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
"""The simulator and the track initiator as two processes, evaluated and drawn.

The track messages do not contain the hits. The recorded messages are therefore processed offline
by the same algorithm. The review checks that both give the same tracks, bit for bit.
"""

from __future__ import annotations

import argparse
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from nav_msgs.msg import Odometry
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import PointCloud2

from msg_adapters import read_track_cloud, time_to_ns, track_states
from msg_adapters.message_input import MessageInput
from tsepm_ros.ending_signals import INTERRUPTED, ending_on_termination, ending_signals_held
from tsepm_ros.parameters import Value
from tsepm_ros.session.session import ScanResult, Session
from tsepm_ros.settings.node_options import InitiatorNodeOptions
from tsepm_ros.settings.parameter_files import parameter_file_text
from tsepm_ros.settings.settings import TRACK_INITIATOR, make_groups, settings_from
from tsepm_ros.tools.commands.arguments import Arguments, add_arguments
from tsepm_ros.tools.commands.given_parameters import add_given_parameters, given_parameter_values
from tsepm_ros.tools.pictures import plan_position
from tsepm_ros.tools.pictures.run_scene import (
    RunScene,
    SceneScan,
    scene_headline,
    scene_target_name,
)
from tsepm_ros.tools.replay.recording import simulated_recording
from tsepm_ros.tools.simulation import Scenario, Simulator, load_scenario
from tsepm_ros.tools.terminal import terminal_progress_bar, terminal_table
from tsepm_ros.whole_files import refuse_overwriting_inputs

DEPTH = 1000
HEADER = [
    "target",
    "track",
    "found after [s]",
    "pings",
    "hits",
    "position error [m]",
    "1 sigma [m]",
    "velocity error [m/s]",
    "1 sigma [m/s]",
]
MAX_IDLE_TIME = 20.0
"""Time without a message after which a run has failed, s."""
PROCESS = "from tsepm_ros.ending_signals import {0}; raise SystemExit({0}())"
ARGUMENTS: Arguments = {
    "--scenario": {"default": "four_targets", "help": "shipped name or .yaml file"},
    "--seed": {"type": int, "default": 2, "help": "seed of the simulation"},
    "--rate": {"type": float, "default": 60.0, "help": "speed relative to real time"},
    "--picture": {
        "type": Path,
        "default": Path("build/demo.png"),
        "help": "default build/demo.png",
    },
}


class DemoCollector(Node):
    """Keeps the messages of one run.

    Attributes
    ----------
    detections, own_ship : list
        Messages in order of arrival.
    tracks : list of record
        Of each confirmed track.
    processed : int
        Scans that the initiator has processed.
    """

    def __init__(self, **node_options: Any) -> None:
        super().__init__("run_recorder", **node_options)
        self.detections: list[PointCloud2] = []
        self.own_ship: list[Odometry] = []
        self.tracks: list[Any] = []
        self.processed = 0
        self.create_subscription(PointCloud2, "tracks", self._on_tracks, DEPTH)
        self.create_subscription(Odometry, "own_ship/odometry", self.own_ship.append, DEPTH)
        self.create_subscription(PointCloud2, "detections", self.detections.append, DEPTH)

    @property
    def heard(self) -> int:
        """Number of all messages."""
        return self.processed + len(self.detections) + len(self.own_ship)

    def _on_tracks(self, message: PointCloud2) -> None:
        records = read_track_cloud(message)
        self.tracks.extend(records[records["revision"] == 0])
        self.processed += 1


def demo_target_rows(scene: RunScene) -> list[list[str]]:
    """The header and a row per target of a judged run."""
    return [HEADER, *(_row(target, scene) for target in range(len(scene.truth)))]


def _row(target: int, scene: RunScene) -> list[str]:
    start = scene.true_starts.get(target)
    if start is None:
        return [scene_target_name(target), "none", *[""] * (len(HEADER) - 2)]
    track = start.track
    sigma = np.sqrt(np.diag(track.covariance))
    return [
        scene_target_name(target),
        str(track.track_id),
        f"{track.stamp - scene.scans[0].stamp:.0f}",
        str(scene.start_scans[track.track_id]),
        str(len(track.hits)),
        f"{start.position_error:.0f}",
        f"{np.hypot(sigma[0], sigma[2]):.0f}",
        f"{start.velocity_error:.1f}",
        f"{np.hypot(sigma[1], sigma[3]):.1f}",
    ]


def demo_review(
    collector: DemoCollector, scenario: Scenario, seed: int, parameters: Mapping[str, Value]
) -> tuple[str, RunScene, str]:
    """Process the recorded messages offline, and judge the tracks by the truth.

    Returns
    -------
    table : str
        A row per target.
    scene : RunScene
        Content of the picture.
    failure : str
        A sentence if the node's tracks are others.

    Raises
    ------
    ValueError
        If a parameter is unknown or its value is not allowed.
    """
    groups = make_groups(TRACK_INITIATOR, parameters)
    session = Session(settings_from(groups))
    message_input = MessageInput(session, groups[InitiatorNodeOptions])
    for message in collector.own_ship:
        message_input.take_own_ship(message)
    results: list[ScanResult] = []
    for message in sorted(collector.detections, key=lambda m: time_to_ns(m.header.stamp)):
        message_input.take_detections(message, now=0.0)
        results.extend(session.process())
    settings = session.settings
    views = [SceneScan.of(result, settings.sensor, settings.mounting.yaw) for result in results]
    simulator = Simulator(scenario, seed)
    recording, origins = simulated_recording(simulator)
    title = f"{scenario.name}, seed {seed}, method {settings.session.method}"
    scene = RunScene(title, views, recording.truth)
    scene.judge(simulator, recording, origins)
    header, *rows = demo_target_rows(scene)
    states = [track_states(np.array([record]))[0].tolist() for record in collector.tracks]
    missing = len(simulator.targets) - len(scene.true_starts)
    failure = ""
    if missing:
        failure = f"{missing} of {len(simulator.targets)} targets were not truly started"
    if states != [track.state.tolist() for track in scene.starts]:
        failure = "the node's tracks differ from the same messages processed offline"
    return terminal_table(header, rows), scene, failure


os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"  # before rclpy.init


NAMESPACE = f"/tsepm_demo_{os.getpid()}"
"""Separates the demonstration from other nodes on the machine."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the demonstration.

    Returns
    -------
    int
        0 if both nodes ended without an error, every scan was processed, and every target has a
        true start; 130 if interrupted, 143 if terminated.
    """
    options = _parse_arguments(arguments)
    with ending_on_termination():
        try:
            return _run_demonstration(options)
        except KeyboardInterrupt:
            print("interrupted", file=sys.stderr)
            return INTERRUPTED


def _run_demonstration(options: argparse.Namespace) -> int:
    try:
        refuse_overwriting_inputs(
            map(Path, [options.scenario, *options.parameter]), [options.picture]
        )
        options.parameter = {
            "own_ship_source": "odometry",
            **given_parameter_values(options.parameter),
        }
        make_groups(TRACK_INITIATOR, options.parameter)
        scenario = load_scenario(options.scenario)
        if scenario.sensors:
            raise ValueError(
                f"--scenario {options.scenario} has several sensors: run sonar_simulator with it, "
                "and track_initiator with the same sensors, in two terminals"
            )
    except ValueError as error:
        print(f"refused: {error}", file=sys.stderr)
        return 2
    scans = scenario.scans
    collector, codes = _run_nodes(options, scans)
    if any(codes) or collector.processed < scans:
        print(
            f"failed: {collector.processed} of {scans} pings were processed; exit codes of the "
            f"nodes: {' and '.join(map(str, codes))}",
            file=sys.stderr,
        )
        return 1
    table, drawn, failure = demo_review(collector, scenario, options.seed, options.parameter)
    plan_position.save(drawn, options.picture)
    print(f"\n{scene_headline(drawn)}\n\n{table}\n\npicture: {options.picture}")
    if failure:
        print(f"failed: {failure}", file=sys.stderr)
    return 1 if failure else 0


def _parse_arguments(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="tsepm_demo", description=__doc__)
    add_arguments(parser, ARGUMENTS)
    add_given_parameters(parser)
    return parser.parse_args(arguments)


def _run_nodes(options: argparse.Namespace, scans: int) -> tuple[DemoCollector, list[int]]:
    """Run both nodes; returns the collected messages and the exit codes of those started."""
    domain = int(os.environ.get("ROS_DOMAIN_ID") or random.randrange(1, 102))
    os.environ["ROS_DOMAIN_ID"] = str(domain)
    source: dict[str, Value] = {
        "scenario": options.scenario,
        "seed": options.seed,
        "rate_factor": options.rate,
        "wait_for_subscribers": 2,
    }
    # Without the arguments of this command, which rclpy would read as remappings, and without
    # its handlers: a signal is an exception, as in the other commands.
    rclpy.init(args=[], domain_id=domain, signal_handler_options=SignalHandlerOptions.NO)
    collector = DemoCollector(namespace=NAMESPACE)
    executor = SingleThreadedExecutor()
    executor.add_node(collector)
    try:
        with _process("track_initiator", options.parameter) as tracker:
            until = time.monotonic() + MAX_IDLE_TIME
            while not (collector.count_publishers("tracks") or tracker.poll() is not None):
                executor.spin_once(timeout_sec=0.1)
                if time.monotonic() > until:
                    break
            if tracker.poll() is not None:
                return collector, [tracker.returncode]
            with _process("sonar_simulator", source) as player:
                _watch(executor, collector, scans, tracker)
                unfinished = collector.processed < scans  # the source would go on, or wait
                codes = [
                    _end(player, interrupt=unfinished),
                    _end(tracker, interrupt=True),
                ]
    finally:
        executor.shutdown()
        collector.destroy_node()
        rclpy.try_shutdown()
    return collector, codes


@contextmanager
def _process(name: str, values: Mapping[str, Value]) -> Iterator[subprocess.Popen[bytes]]:
    """A node with parameters; not with their file, whose section need not fit the namespace."""
    command = [sys.executable, "-c", PROCESS.format(name), "--ros-args"]
    command += [
        part for key in values for part in ("-p", f"{key}:={parameter_file_text(values[key])}")
    ]
    command += ["--log-level", "warn", "-r", f"__ns:={NAMESPACE}"]
    process = None
    try:
        with ending_signals_held():
            process = subprocess.Popen(command)
        yield process
    finally:
        if process is not None and process.poll() is None:
            process.kill()
            process.wait()


def _watch(
    executor: SingleThreadedExecutor,
    collector: DemoCollector,
    scans: int,
    tracker: subprocess.Popen[bytes],
) -> None:
    """Spin until every scan is processed, or no message arrives any more."""
    heard, last = 0, time.monotonic()
    with terminal_progress_bar(scans, "pings", "ping", keep=True) as bar:
        while collector.processed < scans:
            executor.spin_once(timeout_sec=0.1)
            if collector.heard != heard:
                heard, last = collector.heard, time.monotonic()
                bar.set_postfix_str(f"confirmed tracks: {len(collector.tracks)}", refresh=False)
                bar.update(collector.processed - bar.n)
            if time.monotonic() - last > MAX_IDLE_TIME or tracker.poll() is not None:
                return


def _end(process: subprocess.Popen[bytes], interrupt: bool = False) -> int:
    """Wait for the end of a process, interrupted or not; returns its exit code."""
    if interrupt:
        process.send_signal(signal.SIGINT)
    try:
        return process.wait(timeout=MAX_IDLE_TIME)
    except subprocess.TimeoutExpired:
        process.kill()
        return process.wait()


if __name__ == "__main__":
    raise SystemExit(main())
