"""Parameters: declared from their table, refused with a sentence, changed while running."""

from functools import partial
from typing import Any

import pytest
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterType, ParameterValue
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    ListParameters,
    SetParametersAtomically,
)
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python
from support import parameter_values
from support.boat import Boat
from support.expectation import assert_same, confirmed
from support.parameter_values import Caller
from support.ros_world import as_messages
from support.sonar_driver import pings

from tsepm_ros import available_methods
from tsepm_ros.nodes.base_node import ParameterError, ParameterisedNode
from tsepm_ros.nodes.sonar_detector import SonarDetector
from tsepm_ros.nodes.track_initiator import TrackInitiator
from tsepm_ros.settings.node_options import SessionOptions
from tsepm_ros.settings.settings import NODES, full_table
from tsepm_ros.tools.bridge.track_bridge import TrackBridge
from tsepm_ros.tools.players.scan_player import ScanPlayer
from tsepm_ros.tools.players.sonar_simulator import SonarSimulator
from tsepm_ros.tracker.options import CommonOptions

INITIATOR = "/track_initiator"
ROS_TYPES = {
    bool: ParameterType.PARAMETER_BOOL,
    int: ParameterType.PARAMETER_INTEGER,
    float: ParameterType.PARAMETER_DOUBLE,
    str: ParameterType.PARAMETER_STRING,
}
READ_ONLY = {
    *("own_ship_source", "fixed_frame", "sensor_frame", "bearing_reference", "sweep"),
    *("detections_type", "detections_reliability", "detections_depth"),
    *("learned_file", "learned_max_age"),
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
    rows = list(full_table(NODES[node.get_name()]))
    assert len(rows) > 5
    for row in rows:
        descriptor = node.describe_parameter(row.name)
        assert descriptor.type == ROS_TYPES[row.type], row.name
        assert descriptor.description.startswith(row.description), row.name
        assert row.unit in descriptor.description, row.name
        assert descriptor.read_only == row.read_only, row.name
        assert descriptor.additional_constraints == row.bounds, row.name
        if row.name != "recording":
            assert node.get_parameter(row.name).value == row.default, row.name
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
    rows = list(full_table(NODES["track_initiator"]))
    listed = world.call(ListParameters, f"{INITIATOR}/list_parameters", ListParameters.Request())
    assert {row.name for row in rows} < set(listed.result.names)
    request = DescribeParameters.Request(names=["tsepm.window"])
    answer = world.call(DescribeParameters, f"{INITIATOR}/describe_parameters", request)
    assert answer.descriptors[0].integer_range[0].from_value == 2
    assert get_parameter(world, "tsepm.window") == 8
    assert get_parameter(world, "max_speed") == 10.0
    assert get_parameter(world, "method") == "tsepm"
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
    (TrackInitiator, "tsepm.window", 8.0, "an integer"),
    (TrackInitiator, "method", 3, "a text"),
    (TrackInitiator, "publish_potential_tracks", "yes", "true or false"),
    (TrackInitiator, "max_speed", [1.0], "a number"),
    (TrackInitiator, "max_speed", float("nan"), "above 0"),
    (TrackInitiator, "sensor.max_range", float("inf"), "from 0.001"),
    (TrackInitiator, "tsepm.min_hits", 9, "window"),
    (TrackInitiator, "method", "best", "one of tsepm"),
    (TrackInitiator, "detections_type", "foo", "PointCloud2"),
    (TrackInitiator, "sensor.range_std_fraction", 0.0, "range_std"),
    (TrackInitiator, "sensor.min_range", 9000.0, "max_range"),
    (TrackInitiator, "maxspeed", 4.0, "did you mean max_speed"),
    (TrackInitiator, "min_hits", 4, "tsepm.min_hits"),
    (TrackInitiator, "clutter_density", 2e-4, "mean sensor.clutter_density"),
    (TrackInitiator, "sensor.azimuth_max", 120.0, "120 degrees are 2.094 rad"),
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
    ("max_speed", float("nan"), "max_speed"),
    ("tsepm.window", 3, "tsepm.window must be at least min_hits"),
    ("tsepm.min_hits", 10, "window"),
    ("tsepm.evaluation", "best", "tsepm.evaluation must be one of"),
    ("method", "best", "method must be one of"),
    ("diagnostics_period", 0.0, "diagnostics_period"),
    ("sensor.max_range", 5e-324, "sensor.max_range"),
    ("sensor.max_range", 1e-200, "sensor.max_range"),
    ("sensor.range_std", 1e155, "sensor.range_std"),
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
    assert_same(boat.send(sent), confirmed(sent, min_hits=10, window=12))


def test_a_change_that_cannot_be_made_is_refused_with_its_reason(world):
    def refuse(made):
        assert made[CommonOptions].max_speed == 20.0
        raise ZeroDivisionError("no")

    given = "track_initiator", pytest.fail, refuse
    node = world.make(partial(ParameterisedNode, *given))
    [result] = node.set_parameters([Parameter("max_speed", value=20.0)])
    assert result.reason == "max_speed cannot be used: ZeroDivisionError('no')"
    assert not result.successful
    assert node.get_parameter("max_speed").value == 10.0
