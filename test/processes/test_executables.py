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
"""The executables as processes: together over DDS, their ends, and what they refuse."""

import signal
from typing import Any

import numpy as np
import pytest
from sensor_msgs.msg import PointCloud2
from support.expectation import assert_same, initiator
from support.ros_process import RosProcess
from support.sonar_driver import points, stamp_ns

from tsepm_ros.settings.settings import NODES, settings_table
from tsepm_ros.tools.simulation import Simulator, load_scenario

SECOND = 10**9
EXECUTABLES = ("track_initiator", "sonar_detector", "sonar_simulator", "scan_player")
SIGNALS = pytest.mark.parametrize(
    "number",
    [
        pytest.param(signal.SIGINT, id="SIGINT"),
        pytest.param(signal.SIGTERM, marks=pytest.mark.long, id="SIGTERM"),
    ],
)


@pytest.fixture
def given(recording) -> dict[str, dict[str, Any]]:
    """Parameters of each executable."""
    return {
        "track_initiator": {"diagnostics_period": 0.05},
        "sonar_detector": {},
        "sonar_simulator": {"settling_time": 0.1},
        "scan_player": {"settling_time": 0.1, "recording": recording},
    }


def assert_clean_end(process: RosProcess) -> None:
    code = process.exit_code()
    assert code == 0, f"{process.name} ended with {code}: {process.said}"
    for word in ("Traceback", "Error", "Exception", "terminate called"):
        assert word not in process.said


WHILE_IT_IS_MADE = """
import os, signal, sys, time
from rclpy.node import Node
from tsepm_ros.ending_signals import {name} as main

create_publisher = Node.create_publisher

def interrupted(self, *args, **options):
    os.kill(os.getpid(), signal.{signal})
    while self.context.ok():
        time.sleep(0.001)
    return create_publisher(self, *args, **options)

Node.create_publisher = interrupted
sys.exit(main())
"""


@pytest.mark.long
@SIGNALS
def test_a_signal_ends_an_executable_while_its_node_is_made(start, given, number):
    processes = [
        start(name, given[name], script=WHILE_IT_IS_MADE.format(name=name, signal=number.name))
        for name in EXECUTABLES
    ]
    for process in processes:
        assert_clean_end(process)


@SIGNALS
def test_a_signal_ends_every_executable_as_soon_as_it_speaks_and_while_it_waits(
    start, given, number
):
    """All end by `run_node`: the short test has the first and the last."""
    names = EXECUTABLES[:: 3 if number is signal.SIGINT else 1]
    processes = [start(name, given[name]) for name in names]
    for process in processes[: len(names) // 2]:
        process.until_said("waiting for")
        process.interrupt(number)
    for process in processes:
        process.until(lambda one=process: "waiting for" in one.said or not one.running, "a word")
    processes[0].wait_for(0.3)  # nothing tells that the others wait
    for process in processes:
        if process.running:
            process.interrupt(number)
        assert_clean_end(process)


SUBSCRIBER_GONE = """
import sys, time
from rclpy.publisher import Publisher
from tsepm_ros.tools.players import scan_player
from tsepm_ros.tools.players.scan_player import main

def wait_for_all_acked(self, timeout):
    print("waiting for acknowledgement", flush=True)
    time.sleep(timeout.nanoseconds * 1e-9)
    return False

Publisher.get_subscription_count = lambda self: 1
Publisher.wait_for_all_acked = wait_for_all_acked
scan_player.MAX_ACKNOWLEDGE_TIME = 3600.0  # so that only the signal ends the wait
sys.exit(main())
"""


@pytest.mark.long
def test_a_signal_ends_a_source_whose_subscriber_is_gone(start, given):
    parameters = {**given["scan_player"], "rate_factor": 1e6}
    process = start("scan_player", parameters, script=SUBSCRIBER_GONE)
    process.until_said("waiting for acknowledgement")
    process.interrupt(signal.SIGTERM)
    assert_clean_end(process)


@pytest.mark.long
@SIGNALS
@pytest.mark.parametrize("name", ["sonar_simulator", "scan_player"])
def test_a_signal_ends_initiator_and_source_in_the_middle_of_traffic(
    world, start, given, number, name
):
    tracks = world.listen(PointCloud2, "tracks")
    node = start("track_initiator", given["track_initiator"])
    world.until(lambda: tracks.subscription.get_publisher_count(), "the initiator")
    source = start(name, {**given[name], "rate_factor": 1000.0, "loop": True})
    world.until(lambda: len(tracks) > 10, "traffic")
    for process in (node, source):
        process.interrupt(number)
        world.until(lambda process=process: not process.running, "the end")
        assert_clean_end(process)


@pytest.mark.long
@pytest.mark.parametrize("pause", [0.0, 0.02], ids=["at_once", "20_ms"])
def test_a_second_interrupt_does_no_harm(world, start, given, pause):
    """As from a terminal and its launcher both."""
    process = start("track_initiator", given["track_initiator"])
    world.until(lambda: world.diagnostics, "the initiator at work")
    process.interrupt()
    process.wait_for(pause)
    process.interrupt()
    assert_clean_end(process)


def test_simulator_and_initiator_find_the_targets_over_dds(world, start):
    tracks = world.listen(PointCloud2, "tracks")
    process = start("track_initiator", {"diagnostics_period": 0.05})
    world.until(lambda: tracks.subscription.get_publisher_count(), "the initiator")
    simulator = start("sonar_simulator", {"rate_factor": 1000.0, "seed": 3, "settling_time": 0.3})
    scans = list(Simulator(load_scenario("four_targets"), 3))
    world.until(lambda: len(tracks) == len(scans), "tracks of every scan")
    same = initiator()
    assert_same(tracks, [same.process(simulated.scan) for simulated in scans])
    assert [stamp_ns(message) for message in tracks] == [
        round(simulated.scan.stamp * SECOND) for simulated in scans
    ]
    for target in scans[-1].truth:
        near = [
            np.hypot(
                point["x"] - target[0] + target[1] * (scans[-1].scan.stamp - seconds),
                point["y"] - target[2] + target[3] * (scans[-1].scan.stamp - seconds),
            )
            for message in tracks
            for seconds in [stamp_ns(message) / SECOND]
            for point in points(message)
        ]
        assert min(near) < 500.0, "every target is started"
    assert world.dropped() == {}
    assert_clean_end(simulator)  # by itself
    assert "finished" in simulator.said
    process.interrupt()
    assert_clean_end(process)


def as_module(name: str) -> dict[str, Any]:
    """A node that runs as a module, with a parameter that it does not have."""
    script = f"import runpy; runpy.run_module('tsepm_ros.{name}', run_name='__main__')"
    return {"script": script, "parameters": {"nonsense": 1}}


OUTSIDE_OF_ROS_ARGS = """
import sys
sys.argv = ["track_initiator", "-p", "max_speed:=5.0"]
from tsepm_ros.nodes.track_initiator import main
sys.exit(main())
"""
"""ROS itself ignores it: a user who forgets --ros-args would get the defaults."""
REFUSED = {
    "no parameter file": (
        "track_initiator",
        {"arguments": ["--params-file", "/no/such.yaml"]},
        ["/no/such.yaml"],
    ),
    "flag": ("track_initiator", {"arguments": ["--no-such-flag"]}, ["--no-such-flag"]),
    "not of ROS": ("track_initiator", {"script": OUTSIDE_OF_ROS_ARGS}, ["'-p'", "--ros-args"]),
    "module": (
        "nodes.sonar_detector",
        as_module("nodes.sonar_detector"),
        ["nonsense is not a parameter"],
    ),
}


@pytest.mark.long
@pytest.mark.parametrize("case", REFUSED)
def test_a_bad_command_line_ends_an_executable_with_2_and_a_sentence(start, case):
    name, given, words = REFUSED[case]
    process = start(name, **given)
    assert process.exit_code() == 2, process.said
    assert "Traceback" not in process.said
    lines = process.said.splitlines()
    assert len(lines) == 1 or "arguments" in given, "rclpy itself may say more"
    assert all(word in lines[-1] for word in words)


HELP = """
import sys, rclpy
from tsepm_ros import ending_signals
rclpy.init = None  # none starts ROS
for name, flag in zip({names}, ["-h", "--help"] * 2):
    sys.argv = ["x", flag]
    assert getattr(ending_signals, name)() == 0
"""


def test_help_is_usage_with_the_parameters_before_ros_starts(start):
    process = start("help", script=HELP.format(names=EXECUTABLES))
    assert process.exit_code() == 0, process.said
    _, *texts = process.said.split("usage: ros2 run tsepm_ros ")
    for name, text in zip(EXECUTABLES, texts, strict=True):
        assert text.startswith(name)
        for part in (f"tsepm parameters {name}", "docs/parameters.md", "--ros-args"):
            assert part in text.replace("\n  ", " ")
        for row in settings_table(NODES[name]):
            assert row.name.rpartition(".")[2] in text
