"""Parameters: declared from their table, refused with a sentence, changed while running."""

from array import array
from typing import Any

import numpy as np
import pytest
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterType, ParameterValue
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    ListParameters,
    SetParameters,
    SetParametersAtomically,
)
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python
from support import parameter_values
from support.boat import Boat
from support.builders import reconfigured
from support.expectation import as_scan, assert_same, confirmed, initiator
from support.parameter_values import Caller
from support.sonar_driver import pings

from tsepm_ros import SensorModel, available_methods
from tsepm_ros.methods.tsepm import TsepmOptions
from tsepm_ros.nodes.node_parameters import NodeParameters, ParameterError, ParameterisedNode
from tsepm_ros.nodes.track_initiator import TrackInitiator
from tsepm_ros.settings.node_options import SessionOptions
from tsepm_ros.settings.settings import NODES, full_table
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
TYPE_WITHOUT_NAME = pytest.mark.xfail(
    strict=True,
    reason="rclpy refuses a wrong type before NodeParameters sees it, and does not say of what",
)
FAST_TARGET = ((3000.0, 16.0, 1500.0, -12.0),)


class Plain(ParameterisedNode):
    """A node of which `NodeParameters` can be made."""

    def __init__(self, **node_options: Any) -> None:
        super().__init__("plain", **node_options)


@pytest.fixture
def recording(tmp_path):
    folder = tmp_path / "recording"
    folder.mkdir()
    (folder / "detections.csv").write_text("time_s,range_m,azimuth_rad\n0,1000,0.1\n")
    return str(folder)


def as_messages(values: dict[str, Any]) -> list[Any]:
    return [
        Parameter(name.replace("__", "."), value=value).to_parameter_msg()
        for name, value in values.items()
    ]


def set_parameters(world: Any, **values: Any) -> list[str]:
    """Set parameters one by one through the service; returns the reasons, empty for accepted."""
    request = SetParameters.Request(parameters=as_messages(values))
    results = world.call(SetParameters, f"{INITIATOR}/set_parameters", request).results
    for result in results:
        assert result.successful == (not result.reason)
    return [result.reason for result in results]


def set_together(world: Any, **values: Any) -> str:
    """Set parameters in one step; returns the reason if they were refused."""
    request = SetParametersAtomically.Request(parameters=as_messages(values))
    service = f"{INITIATOR}/set_parameters_atomically"
    return world.call(SetParametersAtomically, service, request).result.reason


def get_parameter(world: Any, name: str) -> Any:
    request = GetParameters.Request(names=[name])
    [value] = world.call(GetParameters, f"{INITIATOR}/get_parameters", request).values
    return parameter_value_to_python(value)


@pytest.mark.parametrize("kind", [TrackInitiator, SonarSimulator, ScanPlayer])
def test_every_parameter_is_declared_with_type_default_description_and_range(
    world, kind, recording
):
    given = {"recording": recording} if kind is ScanPlayer else {}
    if kind is TrackInitiator:
        given = {"method": SessionOptions().method}
    node = world.make(kind, given)
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


def test_topics_frames_and_types_are_read_only_the_rest_is_live(world):
    node = world.make(TrackInitiator)
    read_only = {
        row.name
        for row in full_table(NODES["track_initiator"])
        if node.describe_parameter(row.name).read_only
    }
    assert read_only == {
        "own_ship_source",
        "fixed_frame",
        "sensor_frame",
        "detections_type",
        "detections_reliability",
        "detections_depth",
        "bearing_reference",
        "sweep",
        "learned_file",
        "learned_max_age",
    }
    for name in sorted(read_only):
        [reason] = set_parameters(world, **{name: node.get_parameter(name).value})
        assert "read-only" in reason


@pytest.mark.parametrize("kind", [TrackInitiator, SonarSimulator, ScanPlayer])
def test_no_node_takes_a_name_that_rclpy_uses_inside(world, kind, recording):
    node = world.make(kind, {"recording": recording} if kind is ScanPlayer else {})
    plain = world.add(Node("plain", context=world.context))
    taken = {
        name
        for name, value in vars(plain).items()
        if type(vars(node)[name]) is not type(value) and value is not None
    }
    assert not taken


def test_the_parameter_services_answer(world):
    world.make(TrackInitiator)
    names = {row.name for row in full_table(NODES["track_initiator"])}
    listed = world.call(ListParameters, f"{INITIATOR}/list_parameters", ListParameters.Request())
    assert names < set(listed.result.names)
    request = DescribeParameters.Request(names=["tsepm.window"])
    answer = world.call(DescribeParameters, f"{INITIATOR}/describe_parameters", request)
    assert answer.descriptors[0].integer_range[0].from_value == 2
    assert get_parameter(world, "tsepm.window") == 8
    assert get_parameter(world, "max_speed") == 10.0
    assert get_parameter(world, "method") == "tsepm"


REFUSED = [
    (TrackInitiator, "max_speed", 4, "decimal point"),
    (TrackInitiator, "tsepm.window", 8.0, "an integer"),
    (TrackInitiator, "method", 3, "a text"),
    (TrackInitiator, "publish_potential_tracks", "yes", "true or false"),
    (TrackInitiator, "max_speed", [1.0], "decimal point"),
    (TrackInitiator, "max_speed", -1.0, "above 0"),
    (TrackInitiator, "max_speed", 0.0, "above 0"),
    (TrackInitiator, "max_speed", float("nan"), "above 0"),
    (TrackInitiator, "sensor.max_range", float("inf"), "from 0.001"),
    (TrackInitiator, "tsepm.min_hits", 1, "from 2 to 32"),
    (TrackInitiator, "tsepm.min_hits", 9, "window"),
    (TrackInitiator, "method", "best", "one of tsepm"),
    (TrackInitiator, "own_ship_source", "gps", "one of none"),
    (TrackInitiator, "detections_type", "foo", "PointCloud2"),
    (TrackInitiator, "sensor.azimuth_std", 2.0, "to 1"),
    (TrackInitiator, "sensor.range_std_fraction", 0.0, "range_std"),
    (TrackInitiator, "sensor.min_range", 9000.0, "max_range"),
    (TrackInitiator, "maxspeed", 4.0, "did you mean max_speed"),
    (TrackInitiator, "min_hits", 4, "tsepm.min_hits"),
    (TrackInitiator, "clutter_density", 2e-4, "mean sensor.clutter_density"),
    (TrackInitiator, "sensor.max_rnge", 9.0, "mean sensor.max_range"),
    (TrackInitiator, "sensor.azimuth_max", 120.0, "120 degrees are 2.094 rad"),
    (SonarSimulator, "rate_factor", 0.0, "above 0"),
    (SonarSimulator, "seed", -1, "at least 0"),
    (SonarSimulator, "scenario", "nowhere", "four_targets"),
    (SonarSimulator, "scenario", "/no/such.yaml", "such.yaml"),
    (ScanPlayer, "recording", "", "folder"),
    (ScanPlayer, "recording", "/no/such", "detections.csv"),
]


@pytest.mark.parametrize(("kind", "name", "value", "expected"), REFUSED)
def test_a_bad_value_at_the_start_is_refused_with_a_sentence_that_names_it(
    world, kind, name, value, expected
):
    with pytest.raises(ParameterError) as error:
        world.make(kind, {name: value})
    sentence = str(error.value)
    assert name.rpartition(".")[2] in sentence
    assert expected in sentence
    assert "\n" not in sentence


@pytest.mark.parametrize(
    ("name", "value", "expected"),
    [
        ("max_speed", 4, "Wrong parameter type"),
        pytest.param("max_speed", 4, "max_speed", marks=TYPE_WITHOUT_NAME),
        ("max_speed", -1.0, "max_speed"),
        ("max_speed", 0.0, "max_speed must be above 0"),
        ("max_speed", float("nan"), "max_speed"),
        ("tsepm__window", 3, "tsepm.window must be at least min_hits"),
        ("publish_potential_tracks", "yes", "Wrong parameter type"),
        ("tsepm__min_hits", 1, "tsepm.min_hits"),
        ("tsepm__evaluation", "best", "tsepm.evaluation must be one of"),
        ("method", "best", "method must be one of"),
        ("sensor__max_range", 0.0, "sensor.max_range"),
        ("diagnostics_period", 0.0, "diagnostics_period"),
        ("sensor__max_range", 5e-324, "sensor.max_range"),
        ("sensor__max_range", 1e-200, "sensor.max_range"),
        ("sensor__range_std", 1e155, "sensor.range_std"),
        ("sensor__range_rate_std", 1e-30, "sensor.range_rate_std"),
    ],
)
def test_a_bad_value_while_running_is_refused_with_a_reason_and_changes_nothing(
    world, name, value, expected
):
    boat = Boat(world)
    sent = pings(16)
    received = boat.send(sent[:3])
    before = get_parameter(world, name.replace("__", "."))
    [reason] = set_parameters(world, **{name: value})
    assert expected in reason
    assert "\n" not in reason
    assert get_parameter(world, name.replace("__", ".")) == before
    assert_same([*received, *boat.send(sent[3:])], confirmed(sent))


def test_a_parameter_of_no_table_is_refused(world):
    world.make(TrackInitiator)
    [reason] = set_parameters(world, min_hits=3)
    assert "undeclared" in reason


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


def test_a_parameter_without_a_name_is_refused(world):
    node = world.make(TrackInitiator)
    value = ParameterValue(type=ParameterType.PARAMETER_INTEGER)
    for atomically in (False, True):
        [result] = Caller(world, node).set([ParameterMessage(name="", value=value)], atomically)
        assert result.reason == "a parameter has no name"
    assert "" not in parameter_values.declared(node)


def test_random_calls_are_answered_and_pings_go_on(world):
    boat = Boat(world)
    caller, rng = Caller(world, boat.node), np.random.default_rng(1)
    sent = pings(12)
    for ping in sent:
        for _ in range(25):
            caller.call(rng)
        boat.send([ping])
    assert not world.dropped().get("internal_error")


@pytest.mark.parametrize("kind", ["b", "q", "d"])
def test_an_empty_array_at_the_start_is_refused(world, kind):
    types = {"b": "BYTE_ARRAY", "q": "INTEGER_ARRAY", "d": "DOUBLE_ARRAY"}
    empty = [] if kind == "b" else array(kind)
    override = Parameter("max_speed", Parameter.Type[types[kind]], empty)
    with pytest.raises(ParameterError):
        world.make(
            lambda **options: TrackInitiator(**options | {"parameter_overrides": [override]})
        )


def test_another_maximum_speed_takes_effect_at_the_next_scan(world):
    boat = Boat(world)
    sent = pings(20, targets=FAST_TARGET, clutter=0)
    before = boat.send(sent[:8])
    assert not any(message.width for message in before), "it is too fast at first"
    assert set_parameters(world, max_speed=30.0) == [""]
    after = boat.send(sent[8:])
    same = initiator()
    for ping in sent[:8]:
        same.process(as_scan(ping))
    reconfigured(same, SensorModel(), CommonOptions(max_speed=30.0), TsepmOptions())
    assert_same(after, [same.process(as_scan(ping)) for ping in sent[8:]])


def test_values_that_fit_only_together_are_set_in_one_step(world):
    boat = Boat(world)
    sent = pings(24)
    [reason] = set_parameters(world, tsepm__min_hits=10)
    assert "window" in reason
    assert set_together(world, tsepm__min_hits=10, tsepm__window=12) == ""
    assert_same(boat.send(sent), confirmed(sent, min_hits=10, window=12))


def test_the_method_may_change_while_running(world):
    boat = Boat(world)
    sent = pings(16)
    boat.send(sent[:3])
    for method in [*reversed(available_methods()), "tsepm"]:
        assert set_parameters(world, method=method) == [""]
        assert get_parameter(world, "method") == method
    if len(available_methods()) > 1:
        assert_same(boat.send(sent[3:]), confirmed(sent[3:]))


def test_a_change_that_cannot_be_made_is_refused_with_its_reason(world):
    node, seen = world.make(Plain), []

    def refuse(made):
        seen.append(made[CommonOptions].max_speed)
        raise ZeroDivisionError("no")

    changed = []
    NodeParameters(node, (("", CommonOptions),), changed.append, refuse, (ArithmeticError,))
    result = node.set_parameters([Parameter("max_speed", value=20.0)])[0]
    assert (result.successful, seen, changed) == (False, [20.0], [])
    assert result.reason == "max_speed cannot be used: ZeroDivisionError('no')"
    assert node.get_parameter("max_speed").value == 10.0


def test_radians_that_look_like_degrees_are_asked_about_once(world):
    world.make(TrackInitiator, {"sensor.azimuth_std": 1.0})
    world.until_logged("sensor.azimuth_std is 1 rad", "57 degrees", level=30)
    assert set_parameters(world, max_speed=20.0, sensor__azimuth_std=0.5) == ["", ""]
    world.until_logged("sensor.azimuth_std is 0.5 rad", level=30)
    assert sum("sensor.azimuth_std is 1 rad" in line for line in world.logged(30)) == 1


def test_the_same_value_again_keeps_potential_tracks(world):
    boat = Boat(world)
    sent = pings(16)
    received = boat.send(sent[:3])
    assert set_parameters(world, max_speed=10.0, tsepm__min_hits=5) == ["", ""]
    assert_same([*received, *boat.send(sent[3:])], confirmed(sent))
