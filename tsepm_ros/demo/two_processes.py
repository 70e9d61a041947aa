"""A source of scans and the track initiator as two processes, evaluated and drawn.

With a scenario the source is `sonar_simulator`, with a recording it is `scan_player`.
"""

from __future__ import annotations

import argparse
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"  # before rclpy.init

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions

from tsepm_ros.demo.review import Review, review_recording, review_simulation
from tsepm_ros.demo.topic_collector import TopicCollector
from tsepm_ros.ending_signals import INTERRUPTED, ending_on_termination, signals_held
from tsepm_ros.pictures.plan_position import save
from tsepm_ros.pictures.run_scene import headline
from tsepm_ros.progress import progress_bar
from tsepm_ros.replay.recording import Recording, read_recording
from tsepm_ros.settings.parameter_files import add_values, given_values
from tsepm_ros.settings.tables import TRACK_INITIATOR, make_groups
from tsepm_ros.settings.value_text import yaml_text
from tsepm_ros.simulation import Scenario, load_scenario

MAX_IDLE_TIME = 20.0
"""Time without a message after which a run has failed, s."""

NAMESPACE = f"/tsepm_demo_{os.getpid()}"
"""Separates the demonstration from other nodes on the machine."""
PROCESS = "from tsepm_ros.nodes.{0} import main; raise SystemExit(main())"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the demonstration.

    Returns
    -------
    int
        0 if both nodes ended without an error, every scan was processed, and every target has a
        true start; 130 if interrupted, 143 if terminated.
    """
    options = _parse(arguments)
    with ending_on_termination():
        try:
            return _demonstrate(options)
        except KeyboardInterrupt:
            print("interrupted", file=sys.stderr)
            return INTERRUPTED


def _demonstrate(options: argparse.Namespace) -> int:
    try:
        options.parameter = {"own_ship_source": "odometry", **given_values(options.parameter)}
        make_groups(TRACK_INITIATOR, options.parameter)
        scene = _scene(options)
    except ValueError as error:
        print(f"refused: {error}", file=sys.stderr)
        return 2
    scans = scene.scans if isinstance(scene, Scenario) else len(scene.scans)
    collector, codes = _run(options, scans)
    if any(codes) or collector.processed < scans:
        print(
            f"failed: {collector.processed} of {scans} pings were processed; exit codes of the "
            f"nodes: {' and '.join(map(str, codes))}",
            file=sys.stderr,
        )
        return 1
    if isinstance(scene, Scenario):
        review = review_simulation(collector, scene, options.seed, options.parameter)
    else:
        review = review_recording(collector, scene, options.parameter, options.tolerance)
    return _report(review, options.picture)


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="tsepm_demo", description=__doc__)
    parser.add_argument("--scenario", default="four_targets", help="shipped name or .yaml file")
    parser.add_argument("--seed", type=int, default=2, help="seed of the simulation")
    parser.add_argument("--recording", help="folder of a recording, in place of a scenario")
    parser.add_argument("--rate", type=float, default=60.0, help="speed relative to real time")
    add_values(parser)
    parser.add_argument(
        "--tolerance",
        type=float,
        default=60.0,
        help="maximum distance of a start from its recorded target, m",
    )
    parser.add_argument(
        "--picture", type=Path, default=Path("build/demo.png"), help="default build/demo.png"
    )
    return parser.parse_args(arguments)


def _scene(options: argparse.Namespace) -> Scenario | Recording:
    if options.recording:
        return read_recording(options.recording)
    return load_scenario(options.scenario)


def _run(options: argparse.Namespace, scans: int) -> tuple[TopicCollector, list[int]]:
    """Run both nodes; returns the collected messages and the exit codes of those started."""
    domain = int(os.environ.get("ROS_DOMAIN_ID") or random.randrange(1, 102))
    os.environ["ROS_DOMAIN_ID"] = str(domain)
    source = ["sonar_simulator", "-p", f"scenario:={options.scenario}", "-p"]
    source += [f"seed:={options.seed}"]
    if options.recording:
        source = ["scan_player", "-p", f"recording:={options.recording}"]
    source += ["-p", f"rate_factor:={options.rate}", "-p", "wait_for_subscribers:=2"]
    initiator = ["track_initiator"]
    for name, value in options.parameter.items():  # a file's section need not fit the namespace
        initiator += ["-p", f"{name}:={yaml_text(value)}"]
    # Without the arguments of this command, which rclpy would read as remappings, and without
    # its handlers: a signal is an exception, as in the other commands.
    rclpy.init(args=[], domain_id=domain, signal_handler_options=SignalHandlerOptions.NO)
    collector = TopicCollector(namespace=NAMESPACE)
    executor = SingleThreadedExecutor()
    executor.add_node(collector)
    try:
        with _process(*initiator) as tracker:
            _wait_for_initiator(executor, collector, tracker)
            if tracker.poll() is not None:
                return collector, [tracker.returncode]
            with _process(*source) as player:
                _watch(executor, collector, scans, tracker)
                unfinished = collector.processed < scans  # the source would go on, or wait
                codes = [_end(player, interrupt=unfinished), _end(tracker, interrupt=True)]
    finally:
        executor.shutdown()
        collector.destroy_node()
        rclpy.try_shutdown()
    return collector, codes


@contextmanager
def _process(name: str, *parameters: str) -> Iterator[subprocess.Popen[bytes]]:
    command = [sys.executable, "-c", PROCESS.format(name), "--ros-args", *parameters]
    command += ["--log-level", "warn", "-r", f"__ns:={NAMESPACE}"]
    process = None
    try:
        with signals_held():
            process = subprocess.Popen(command)
        yield process
    finally:
        if process is not None and process.poll() is None:
            process.kill()
            process.wait()


def _watch(
    executor: SingleThreadedExecutor,
    collector: TopicCollector,
    scans: int,
    tracker: subprocess.Popen[bytes],
) -> None:
    """Spin until every scan is processed, or no message arrives any more."""
    heard, last = -1, time.monotonic()
    with progress_bar(scans, "pings", "ping", keep=True) as bar:
        while collector.processed < scans:
            executor.spin_once(timeout_sec=0.1)
            if collector.heard != heard:
                heard, last = collector.heard, time.monotonic()
                bar.set_postfix_str(f"confirmed tracks: {len(collector.tracks)}", refresh=False)
                bar.update(collector.processed - bar.n)
            if time.monotonic() - last > MAX_IDLE_TIME or tracker.poll() is not None:
                return


def _wait_for_initiator(
    executor: SingleThreadedExecutor, collector: TopicCollector, tracker: subprocess.Popen[bytes]
) -> None:
    """Spin until the initiator publishes tracks, or has ended."""
    until = time.monotonic() + MAX_IDLE_TIME
    while not collector.count_publishers("tracks") and time.monotonic() < until:
        executor.spin_once(timeout_sec=0.1)
        if tracker.poll() is not None:
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


def _report(review: Review, picture: Path) -> int:
    save(review.scene, picture)
    print(f"\n{headline(review.scene)}\n\n{review.table}\n\npicture: {picture}")
    if review.failure:
        print(f"failed: {review.failure}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
