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
"""The base of the nodes: parameters and their files, refusals, and callbacks that fail."""

from __future__ import annotations

import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import pytest
import yaml
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterType, ParameterValue
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    ListParameters,
    SetParameters,
    SetParametersAtomically,
)
from rclpy.executors import MultiThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_dict_from_yaml_file, parameter_value_to_python
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import PointCloud2
from std_srvs.srv import Trigger
from support import parameter_values
from support.boat import Boat
from support.expectation import assert_same, confirmed
from support.parameter_values import Caller
from support.ros_world import BEST_EFFORT, LATCHED, RELIABLE, as_messages, remapped
from support.sonar_driver import Driver, pings

from tsepm_ros import available_methods
from tsepm_ros.nodes.base_node import BaseNode, ParameterError
from tsepm_ros.nodes.sonar_detector import SonarDetector
from tsepm_ros.nodes.track_initiator import TrackInitiator
from tsepm_ros.session.drop_reasons import REPORT_IT
from tsepm_ros.settings.node_options import SessionOptions
from tsepm_ros.settings.settings import NODES, settings_table
from tsepm_ros.tools.bridge.track_bridge import TrackBridge
from tsepm_ros.tools.commands.given_parameters import given_parameters_as_yaml
from tsepm_ros.tools.players.scan_player import ScanPlayer
from tsepm_ros.tools.players.sonar_simulator import SonarSimulator
from tsepm_ros.tracker.options import CommonOptions

INITIATOR = "/track_initiator"

ROS_TYPES = {
    bool: ParameterType.PARAMETER_BOOL,
    int: ParameterType.PARAMETER_INTEGER,
    float: ParameterType.PARAMETER_DOUBLE,
    str: ParameterType.PARAMETER_STRING,
    tuple: ParameterType.PARAMETER_STRING_ARRAY,
}

READ_ONLY = {
    *("own_ship_source", "own_ship_delay", "fixed_frame", "sensor_frame"),
    *("bearing_reference", "sweep"),
    *("detections_type", "detections_reliability", "detections_depth"),
    *("learned_file", "learned_max_age", "sensors"),
}


def set_together(world: Any, **values: Any) -> str:
    """Set parameters in one step; returns the reason if they were refused."""
    request = SetParametersAtomically.Request(parameters=as_messages(values))
    service = f"{INITIATOR}/set_parameters_atomically"
    return world.call(SetParametersAtomically, service, request).result.reason


def get_parameter(world: Any, name: str) -> Any:
    request = GetParameters.Request(names=[name])
    [value] = world.call(GetParameters, f"{INITIATOR}/get_parameters", request).values
    return parameter_value_to_python(value)


def test_every_parameter_is_declared_as_in_its_table_and_none_as_a_name_inside_rclpy(
    world, recording
):
    for kind, given in (
        (TrackInitiator, {"method": SessionOptions().method}),
        (SonarSimulator, {}),
        (ScanPlayer, {"recording": recording}),
    ):
        assert_declared(world, world.make(kind, given))


def assert_declared(world: Any, node: Node) -> None:
    rows = list(settings_table(NODES[node.get_name()]))
    assert len(rows) > 5
    for row in rows:
        descriptor = node.describe_parameter(row.name)
        assert descriptor.type == ROS_TYPES[row.type], row.name
        assert descriptor.description.startswith(row.description), row.name
        assert row.unit in descriptor.description, row.name
        assert descriptor.read_only == row.read_only, row.name
        assert descriptor.additional_constraints == row.bounds, row.name
        if row.name != "recording":
            assert row.meant(node.get_parameter(row.name).value) == row.default, row.name
        ranges = [*descriptor.floating_point_range, *descriptor.integer_range]
        if row.type in (int, float) and row.bounds:
            [found] = ranges
            assert found.from_value >= row.minimum, row.name
            assert found.to_value <= row.maximum, row.name
            assert found.from_value <= row.default <= found.to_value, row.name
        else:
            assert not ranges, row.name
    plain = world.add(Node("other", context=world.context))
    assert not {
        name
        for name, value in vars(plain).items()
        if type(vars(node)[name]) is not type(value) and value is not None
    }


def test_the_parameter_services_answer_and_refuse_what_is_not_live(world):
    node = world.make(TrackInitiator)
    rows = list(settings_table(NODES["track_initiator"]))
    listed = world.call(ListParameters, f"{INITIATOR}/list_parameters", ListParameters.Request())
    assert {row.name for row in rows} < set(listed.result.names)
    request = DescribeParameters.Request(names=["tsepm.window"])
    answer = world.call(DescribeParameters, f"{INITIATOR}/describe_parameters", request)
    assert answer.descriptors[0].integer_range[0].from_value == 2
    assert get_parameter(world, "tsepm.window") == 8
    assert get_parameter(world, "max_speed") == 10.0
    assert get_parameter(world, "method") == "score"
    assert {row.name for row in rows if node.describe_parameter(row.name).read_only} == READ_ONLY
    for name in sorted(READ_ONLY):
        [reason] = world.set_parameters(**{name: node.get_parameter(name).value})
        assert "read-only" in reason
    [reason] = world.set_parameters(min_hits=3)
    assert "undeclared" in reason, "it is in no table"
    value = ParameterValue(type=ParameterType.PARAMETER_INTEGER)
    for atomically in (False, True):
        [result] = Caller(world, node).set([ParameterMessage(name="", value=value)], atomically)
        assert result.reason == "a parameter has no name"
    assert "" not in parameter_values.declared(node)


AT_THE_START = [
    (TrackInitiator, "max_speed", 4, "decimal point"),
    (TrackInitiator, "tsepm.min_hits", 9, "window"),
    (TrackInitiator, "detections_type", "foo", "PointCloud2"),
    (TrackInitiator, "min_hits", 4, "tsepm.min_hits"),
    (SonarSimulator, "seed", -1, "at least 0"),
    (SonarSimulator, "scenario", "nowhere", "four_targets"),
    (SonarSimulator, "scenario", "/no/such.yaml", "such.yaml"),
    (ScanPlayer, "recording", "", "folder"),
    (ScanPlayer, "recording", "/no/such", "detections.csv"),
    (SonarDetector, "false_detections_per_ping", 0.0, "from 0.1"),
    (SonarDetector, "image.rows", "columns", "must be one of"),
    (SonarDetector, "image_type", "sensor_msgs/msg/CompressedImage", "not supported"),
    (TrackBridge, "nmea_address", "10110", "such as 127.0.0.1:10110"),
    (TrackBridge, "nmea_address", "plotter:10110", "an IP address"),
    (TrackBridge, "nmea_address", "10.0.0.300:10110", "an IP address"),
    (TrackBridge, "signal_k_address", "127.0.0.1", "signal_k_address must be"),
    (TrackBridge, "nmea_talker", "sonar", "two capital letters"),
    (TrackBridge, "origin", "north", "such as 59.65,10.63"),
    (TrackBridge, "origin", "90.0,0.0", "near a pole"),
]


def test_a_bad_value_at_the_start_is_refused_with_a_sentence_that_names_it(world):
    for kind, name, value, expected in AT_THE_START:
        with pytest.raises(ParameterError) as error:
            world.make(kind, {name: value})
        sentence = str(error.value)
        assert name.rpartition(".")[2] in sentence and expected in sentence, (name, value)
        assert "\n" not in sentence


REFUSED = [
    ("max_speed", 4, "Wrong parameter type"),  # rclpy refuses it and does not say of what
    ("max_speed", 0.0, "max_speed must be above 0"),
    ("tsepm.window", 3, "tsepm.window must be at least min_hits"),
    ("sensor.range_rate_std", 1e-30, "sensor.range_rate_std"),
]


def test_neither_a_bad_value_nor_the_same_again_while_running_changes_anything(world):
    boat, sent = Boat(world), pings(16)
    received = boat.send(sent[:3])
    for name, value, expected in REFUSED:
        before = get_parameter(world, name)
        [reason] = world.set_parameters(**{name: value})
        assert expected in reason and "\n" not in reason, (name, value)
        assert get_parameter(world, name) == before
    assert world.set_parameters(max_speed=10.0, tsepm__min_hits=5) == ["", ""]
    assert_same([*received, *boat.send(sent[3:])], confirmed(sent))


@pytest.mark.parametrize("kind", parameter_values.NODES)
def test_an_array_or_no_type_is_refused_for_every_parameter_and_the_node_goes_on(world, kind):
    node = parameter_values.make(world, kind)
    caller, names = Caller(world, node), parameter_values.declared(node)
    arrays = range(ParameterType.PARAMETER_BYTE_ARRAY, ParameterType.PARAMETER_STRING_ARRAY + 1)
    for type_ in (*arrays, ParameterType.PARAMETER_NOT_SET, *parameter_values.NO_TYPES):
        values = [ParameterMessage(name=one, value=ParameterValue(type=type_)) for one in names]
        results = [*caller.set(values), *caller.set(values, atomically=True)]
        assert not any(result.successful for result in results)
        assert all(result.reason for result in results)
    assert parameter_values.declared(node) == names


def test_radians_that_look_like_degrees_are_asked_about_once(world):
    world.make(TrackInitiator, {"sensor.azimuth_std": 1.0})
    world.until_logged("sensor.azimuth_std is 1 rad", "57 degrees", level=30)
    assert world.set_parameters(max_speed=20.0, sensor__azimuth_std=0.5) == ["", ""]
    world.until_logged("sensor.azimuth_std is 0.5 rad", level=30)
    assert sum("sensor.azimuth_std is 1 rad" in line for line in world.logged(30)) == 1


def test_the_method_may_change_and_values_that_fit_only_together_are_set_in_one_step(world):
    boat = Boat(world, max_scan_time=3600.0)
    sent = pings(40)
    boat.send(sent[:3])
    methods = [*reversed(available_methods()), "tsepm"]
    for method, ping in zip(methods, sent[3:], strict=False):
        assert world.set_parameters(method=method) == [""]
        assert get_parameter(world, "method") == method
        boat.send([ping])
    assert world.dropped() == {}
    assert set_together(world, tsepm__min_hits=10, tsepm__window=12) == ""
    sent = sent[3 + len(methods) :]
    assert_same(boat.send(sent), confirmed(sent, method="tsepm", min_hits=10, window=12))


def test_a_former_parameter_is_named_as_not_used(world):
    node = world.make(TrackInitiator, {"plots": "on"})
    world.until_logged("not used by this node: plots", "target_extent above 0")
    assert not node.has_parameter("plots")


def test_the_options_of_a_method_come_with_it(world):
    given = {"logic.min_hits": 3, "logic.window": 6}
    node = world.make(TrackInitiator, given)
    world.until_logged("not used by this node: logic.min_hits", "another method is chosen")
    assert world.set_parameters(logic__min_hits=4) != [""], "it is no parameter yet"
    [bad] = world.set_parameters(method="hough")
    assert bad == "" and node.has_parameter("hough.window")
    assert world.set_parameters(method="logic") == [""]
    assert {name: node.get_parameter(name).value for name in given} == given
    assert world.set_parameters(logic__min_hits=4) == [""]
    assert node._session.tracker.options.min_hits == 4
    assert "logic.window must be" in world.set_parameters(logic__window=3)[0]
    assert world.set_parameters(method="score") == [""]


def test_a_change_that_cannot_be_made_is_refused_with_its_reason(world):
    def refuse(made):
        assert made[CommonOptions].max_speed == 20.0
        raise ZeroDivisionError("no")

    given = "track_initiator", pytest.fail, refuse
    node = world.make(partial(BaseNode, *given))
    [result] = node.set_parameters([Parameter("max_speed", value=20.0)])
    assert result.reason == "max_speed cannot be used: ZeroDivisionError('no')"
    assert not result.successful
    assert node.get_parameter("max_speed").value == 10.0


FAULTY = """
import sys
from rclpy.executors import Executor
from rclpy.task import Future
from tsepm_ros.nodes.base_node import run_node
from {module} import {kind}

class Faulty({kind}):
    def __init__(self, **options):
        super().__init__(**options)
        self.left = 3
        self.steady_timer(0.02, self.planted_timer)

    def planted_timer(self):
        if self.left:
            self.left -= 1
            raise [KeyError, MemoryError, AssertionError][self.left]("planted in a timer")
        if self.left == 0:
            self.left = None
            future = self.executor.create_task(lambda: 1)
            future.add_done_callback(self.planted_callback)

    def planted_callback(self, future):
        raise TypeError("planted in a done callback")

    def {method}(self, *message):
        if getattr(message[0], "header", None) and message[0].header.frame_id == "planted":
            raise RuntimeError("planted in a subscription")
        super().{method}(*message)
        print("took a message", flush=True)

take, planted = Executor._take_subscription, ["planted in a take"]

def failing(executor, subscription):
    if planted and subscription.topic_name.endswith("{topic}"):
        raise RuntimeError(planted.pop())
    return take(executor, subscription)

Executor._take_subscription = failing
raise SystemExit(run_node(Faulty, sys.argv[1:]))
"""

MESSAGE_CALLBACKS = {
    "track_initiator": ("tsepm_ros.nodes.track_initiator", "take_detections", "detections"),
    "track_bridge": ("tsepm_ros.tools.bridge.track_bridge", "_take", "tracks/current"),
}


def errors(world: Any, node: str) -> DiagnosticStatus:
    """The newest entry of a node's internal errors."""
    found = [
        status
        for message in world.diagnostics
        for status in message.status
        if status.name == f"/{node}: overall" and status.level == DiagnosticStatus.ERROR
    ]
    return found[-1] if found else DiagnosticStatus()


def counted(world: Any) -> set[str]:
    """Counts of internal errors on /diagnostics."""
    return {
        value.value
        for message in world.diagnostics
        for status in message.status
        for value in status.values
        if value.key.removeprefix("dropped.") == "internal_error"
    }


@pytest.mark.parametrize("name", MESSAGE_CALLBACKS)
def test_exceptions_of_any_callback_are_counted_and_said_once_a_place_and_the_next_is_taken(
    world, start, name
):
    module, method, topic = MESSAGE_CALLBACKS[name]
    pytest.importorskip("pyproj" if name == "track_bridge" else "numpy")
    kind = name.title().replace("_", "")
    script = FAULTY.format(module=module, kind=kind, method=method, topic=topic)
    given = {"nmea_address": "127.0.0.1:9"} if name == "track_bridge" else {}
    publisher = world.observer.create_publisher(PointCloud2, topic, LATCHED)
    node = start(name, given, script=script)
    node.provokes = True
    world.until(publisher.get_subscription_count, "the node")
    bad = PointCloud2()
    bad.header.frame_id = "planted"
    for _ in range(3):
        publisher.publish(bad)
    node.until_said("planted in a subscription")
    publisher.publish(PointCloud2())
    node.until_said("took a message")
    world.until(lambda: "8" in counted(world), "the counts of all on /diagnostics")
    assert errors(world, name).level == DiagnosticStatus.ERROR
    if name == "track_bridge":
        assert errors(world, name).message == f"node: {REPORT_IT}"
    assert node.said.count("Traceback (most recent call last)") == 4, "one of each place"
    node.interrupt()
    assert node.exit_code() == 0


@pytest.mark.internal_error
def test_a_callback_that_raises_in_a_plain_executor_counts_and_the_next_message_is_taken(
    world, monkeypatch
):
    world.provokes = True
    boat, sent = Boat(world), pings(4)
    take = boat.node.take_detections

    def fail_once(*given):
        monkeypatch.setattr(boat.node, "take_detections", take)
        raise RuntimeError("planted")

    monkeypatch.setattr(boat.node, "take_detections", fail_once)
    boat.driver.ping(sent[0])
    world.until(lambda: world.dropped() == {"internal_error": 1}, "the count")
    assert len(boat.send(sent[1:])) == 3


def slow_node(context):
    """A node whose callbacks take long, and whose timer comes as often as it can."""
    node = Node("slow", context=context)
    node.create_subscription(PointCloud2, "detections", lambda _: time.sleep(0.002), RELIABLE)
    node.create_timer(0.001, lambda: time.sleep(0.001))
    return node


def test_nodes_share_an_executor_of_several_threads_with_odometry_that_comes_late(world):
    driver, sent = world.add(Driver(world.context)), pings(80, clutter=2, period=1.0)
    executor = MultiThreadedExecutor(4, context=world.context)
    given = {"own_ship_source": "odometry", "method": "tsepm"}
    nodes = [
        world.make(
            TrackInitiator,
            given,
            cli_args=remapped(f"__node:=tracker_{k}"),
            start_parameter_services=False,  # an executor waits for each
        )
        for k in range(3)
    ]
    for node in [*nodes, world.add(slow_node(world.context))]:
        world.executor.remove_node(node)
        executor.add_node(node)

    def spun(done, what):
        end = time.monotonic() + world.deadline
        while not done():
            assert time.monotonic() < end, what
            executor.spin_once(timeout_sec=0.001)

    spun(lambda: driver.publisher.get_subscription_count() == 4, "the subscriptions")
    spun(lambda: driver.odometry.get_subscription_count() == 3, "the subscriptions")
    driver.pose(sent[0].stamp_ns - 10**9, 0.0, 0.0, 0.0)
    for number, ping in enumerate(sent):
        driver.ping(ping)
        if number % 2:  # the scan before has waited for it
            driver.pose(ping.stamp_ns + 10**9, 0.0, 0.0, 0.0)
        if number % 20 == 19:
            spun(lambda k=number: all(node._session.arrivals > k for node in nodes), "a ping")
    spun(lambda: all(node._session.totals.scans == len(sent) for node in nodes), "every ping")
    for node in nodes:  # while callbacks may run
        world.end(node)
    executor.shutdown()
    assert [node.dropped for node in nodes] == [{}] * 3
    assert all(not node._session.dropped for node in nodes)


@pytest.mark.internal_error
def test_a_service_whose_callback_fails_is_answered(world, monkeypatch):
    world.provokes = True
    boat = Boat(world)
    monkeypatch.setattr(boat.node, "_on_change", lambda options: [][1])
    values = as_messages({"max_speed": 7.0})
    request = SetParameters.Request(parameters=values)
    answer = world.call(SetParameters, "/track_initiator/set_parameters", request)
    assert len(answer.results) == 0
    assert world.dropped() == {"internal_error": 1}
    assert world.status("track initiation").level == DiagnosticStatus.ERROR
    world.until_logged("IndexError", "Traceback")
    monkeypatch.setattr(boat.node._session, "reset", lambda: {}["planted"])
    assert not world.call(Trigger, "/track_initiator/reset", Trigger.Request()).success
    monkeypatch.undo()
    assert len(boat.send(pings(3))) == 3


def test_a_change_that_a_check_fails_at_is_refused_with_the_exception(world, monkeypatch):
    node = world.make(TrackInitiator)
    monkeypatch.setattr(node, "_validate", lambda options: None + 1)
    (refused,) = world.set_parameters(max_speed=7.0)
    assert "max_speed cannot be used: TypeError" in refused


ABSURD_TIMES = [(-1, 0), (-(2**31), 0), (5, 10**9), (2**31 - 1, 2**32 - 1)]


def test_times_on_clock_that_no_clock_gives_are_counted_and_the_next_is_taken(world):
    clock = world.observer.create_publisher(Clock, "/clock", BEST_EFFORT)
    node = world.make(SonarSimulator, {"use_sim_time": True})
    world.until_connected()
    for sec, nanosec in ABSURD_TIMES:
        clock.publish(Clock(clock=Time(sec=sec, nanosec=nanosec)))
        world.until_logged("a time on /clock is not used")
    clock.publish(Clock(clock=Time(sec=77)))
    world.until(lambda: node.get_clock().now().nanoseconds == 77 * 10**9, "the time")
    assert node.dropped["clock_invalid"] >= 1


def test_an_event_of_a_playback_that_fails_costs_that_event(world, monkeypatch):
    world.provokes = True
    node = world.make(SonarSimulator, {"rate_factor": 1000.0, "wait_for_subscribers": 0})
    monkeypatch.setattr(node._played.detections[""], "publish", lambda message: [][1])
    world.until(node.finished.done, "the end of the playback")
    failed = node.dropped["internal_error"]
    assert failed >= 2, "each scan was tried once"
    assert node._published > failed, "and the poses between them were published"


def arguments_of(path: Path, remaps: Sequence[str] = ()) -> list[str]:
    return [*remapped(*remaps), "--params-file", str(path)]


@pytest.mark.parametrize(
    "remaps",
    [[], ["__ns:=/boat"], ["__node:=starter"], ["__ns:=/fleet/boat", "__node:=starter"]],
    ids=["as_it_is", "namespace", "name", "both"],
)
def test_a_generated_file_fits_any_name_and_namespace(world, tmp_path, remaps):
    path = tmp_path / "mine.yaml"
    generated = given_parameters_as_yaml("track_initiator", NODES["track_initiator"])
    path.write_text(generated.replace("max_speed: 10.0", "max_speed: 7.5"))
    node = world.make(TrackInitiator, cli_args=arguments_of(path, remaps))
    assert node.get_parameter("max_speed").value == 7.5
    for row in settings_table(NODES["track_initiator"]):
        if row.name not in ("max_speed", "method"):
            assert row.meant(node.get_parameter(row.name).value) == row.default
    assert not any("is not used" in line for line in world.logged())


def test_a_file_that_does_not_fit_is_named(world, tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text("track_initiator:\n  ros__parameters: {max_speed: 7.5}\n")
    node = world.make(
        TrackInitiator, {"limit_speed": False}, cli_args=arguments_of(path, ["__ns:=/boat"])
    )
    assert node.get_parameter("max_speed").value == 10.0
    assert node.get_parameter("limit_speed").value == "off", "off without quotes is the text"
    world.until_logged("mine.yaml is not used", "/boat/track_initiator", "/**", level=30)


def test_an_empty_list_ends_an_executable_with_a_sentence(start, tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text("/**:\n  ros__parameters:\n    max_speed: []\n")
    process = start("track_initiator", arguments=["--params-file", str(path)])
    assert process.exit_code() == 2
    assert "Traceback" not in process.said
    assert "max_speed has no value" in process.said.splitlines()[-1]


def test_a_name_that_ros_refuses_ends_an_executable_with_a_sentence(start):
    process = start("sonar_detector", {"tracker": "/t/"})
    assert process.exit_code() == 2
    assert "refused: Invalid service name" in process.said.splitlines()[-1]


def test_dumped_parameters_load_again(world, tmp_path):
    """As `ros2 param dump` writes them, and as `ros2 param load` sends them."""
    node = world.make(TrackInitiator, {"sensor.clutter_density": 1e-6, "method": "score"})
    rows = [row for row in settings_table(NODES["track_initiator"]) if not row.read_only]
    values = {row.name: node.get_parameter(row.name).value for row in rows}
    path = tmp_path / "dumped.yaml"
    path.write_text(yaml.dump({"/track_initiator": {"ros__parameters": values}}))
    sent = parameter_dict_from_yaml_file(str(path))
    request = SetParameters.Request(parameters=list(sent.values()))
    results = world.call(SetParameters, "/track_initiator/set_parameters", request).results
    assert [result.reason for result in results if not result.successful] == []
    assert {row.name: node.get_parameter(row.name).value for row in rows} == values
    again = world.make(TrackInitiator, cli_args=arguments_of(path), enable_rosout=False)
    assert again.get_parameter("sensor.clutter_density").value == 1e-6


def test_the_quality_of_service_of_publishers_may_be_overridden(world):
    prefix = "qos_overrides./tracks.publisher"
    node = world.make(
        TrackInitiator,
        {
            f"{prefix}.reliability": "best_effort",
            f"{prefix}.depth": 7,
            "qos_overrides./tracks/current.publisher.durability": "volatile",
        },
    )
    [tracks] = world.observer.get_publishers_info_by_topic("/tracks")
    assert tracks.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT
    [current] = world.observer.get_publishers_info_by_topic("/tracks/current")
    assert current.qos_profile.durability == DurabilityPolicy.VOLATILE
    assert node.get_parameter(f"{prefix}.depth").value == 7


@pytest.mark.parametrize("kind", [SonarDetector, SonarSimulator, TrackBridge, TrackInitiator])
def test_every_publisher_of_a_node_takes_overrides(world, kind):
    named = {one.topic_name for one in world.make(kind).publishers} - {"/parameter_events"}
    given = {f"qos_overrides.{topic}.publisher.depth": 7 for topic in named}
    made = world.make(kind, given, cli_args=remapped("__node:=another"))
    depths = {one.topic_name: one.qos_profile.depth for one in made.publishers}
    assert {topic: depths[topic] for topic in named} == dict.fromkeys(named, 7)


OTHER = [
    ("/detections.subscription.reliability", "best_effort", "only publishers take overrides"),
    ("/nowhere.publisher.depth", 5, "the node publishes"),
    ("/diagnostics.publisher.depth", 0, "at least 1"),
    ("/diagnostics.publisher.depth", 2**31, "below 2"),
    ("/diagnostics.publisher.reliability", "sometimes", "reliable or best_effort"),
    ("/diagnostics.publisher.deadline", 5, "the policy must be"),
]


def test_other_overrides_are_refused_with_a_sentence(world):
    for name, value, part in OTHER:
        for kind, topic in ((TrackInitiator, "/diagnostics"), (SonarSimulator, "/detections")):
            with pytest.raises(ParameterError, match="qos_overrides") as error:
                world.make(kind, {f"qos_overrides.{name.replace('/diagnostics', topic)}": value})
            assert part in str(error.value)
