"""The nodes' parameters: types and bounds, tables, YAML and text, on the command line, in files."""

import dataclasses
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import yaml

from tsepm_ros import SensorModel, available_methods
from tsepm_ros.methods.registry import METHODS, NODE_METHODS, method_class
from tsepm_ros.methods.tsepm import TsepmOptions
from tsepm_ros.parameters import ParameterGroup, parameter, table
from tsepm_ros.settings.node_options import (
    InitiatorNodeOptions,
    PlaybackOptions,
    PlayerNodeOptions,
    SessionOptions,
    SimulatorNodeOptions,
    ViewerNodeOptions,
)
from tsepm_ros.settings.parameter_files import (
    fits,
    load_yaml,
    parameter_files,
    parse_values,
    unused_files,
    without_value,
)
from tsepm_ros.settings.settings import (
    NODES,
    TRACK_INITIATOR,
    full_table,
    make_groups,
    settings_from,
    with_method,
)
from tsepm_ros.tracker.options import CommonOptions

GROUPS = [
    CommonOptions,
    TsepmOptions,
    SensorModel,
    SessionOptions,
    InitiatorNodeOptions,
    PlaybackOptions,
    SimulatorNodeOptions,
    PlayerNodeOptions,
]


@dataclass(frozen=True, kw_only=True)
class Example(ParameterGroup):
    """One of everything."""

    flag: bool = parameter(True, "A flag")
    count: int = parameter(3, "A count", minimum=1, maximum=9)
    length: float = parameter(2.5, "A length", unit="m", positive=True, maximum=10.0)
    depth: float = parameter(0.0, "A depth", unit="m", minimum=0.0)
    shift: float = parameter(0.0, "A shift", minimum=-2.0, maximum=2.0)
    any: float = parameter(0.0, "Any number")
    mode: str = parameter("slow", "A mode", choices=("slow", "fast"), read_only=True)
    name: str = parameter("", "A name")


ROWS = {row.name: row for row in table(Example)}


def test_the_table_has_every_field_in_order_with_its_default_and_type():
    assert list(ROWS) == ["flag", "count", "length", "depth", "shift", "any", "mode", "name"]
    assert [row.default for row in ROWS.values()] == [True, 3, 2.5, 0.0, 0.0, 0.0, "slow", ""]
    assert [row.type for row in ROWS.values()] == [bool, int, *[float] * 4, str, str]
    assert [row.name for row in ROWS.values() if row.read_only] == ["mode"]
    assert ROWS["length"].unit == "m"


@pytest.mark.parametrize(
    ("name", "bounds"),
    [
        ("flag", ""),
        ("count", "from 1 to 9"),
        ("length", "above 0 and at most 10"),
        ("depth", "at least 0"),
        ("shift", "from -2 to 2"),
        ("any", ""),
        ("mode", "one of slow, fast"),
        ("name", ""),
    ],
)
def test_bounds_are_said_in_words(name, bounds):
    assert ROWS[name].bounds == bounds


@pytest.mark.parametrize(
    ("name", "value", "taken"),
    [
        ("flag", False, False),
        ("flag", np.bool_(True), True),
        ("count", 1, 1),
        ("count", 9, 9),
        ("count", np.int32(4), 4),
        ("length", 10, 10.0),
        ("length", 5e-324, 5e-324),
        ("length", np.float32(0.5), 0.5),
        ("length", np.array(1.5), 1.5),
        ("depth", 0, 0.0),
        ("depth", math.inf, math.inf),
        ("shift", -2.0, -2.0),
        ("mode", "fast", "fast"),
        ("name", "anything at all", "anything at all"),
    ],
)
def test_allowed_values_are_taken_in_the_parameter_s_type(name, value, taken):
    found = getattr(Example(**{name: value}), name)
    assert found == taken
    assert type(found) is type(taken) is ROWS[name].type


@pytest.mark.parametrize(("value", "taken"), [(True, "on"), (False, "off")])
def test_a_choice_of_on_and_off_takes_what_yaml_reads_as_bool(value, taken):
    assert CommonOptions(plots=value).plots == taken
    with pytest.raises(ValueError, match="mode"):
        Example(mode=value)  # slow or fast


@pytest.mark.parametrize(
    ("name", "value", "sentence"),
    [
        ("flag", 1, "flag must be true or false; got 1"),
        ("flag", "true", "flag must be true or false; got 'true'"),
        ("count", 0, "count must be from 1 to 9; got 0"),
        ("count", 10, "count must be from 1 to 9; got 10"),
        ("count", 2.0, "count must be an integer; got 2.0"),
        ("count", True, "count must be an integer; got True"),
        ("count", "3", "count must be an integer; got '3'"),
        ("length", 0.0, "length must be above 0 and at most 10; got 0.0"),
        ("length", -1, "length must be above 0 and at most 10; got -1"),
        ("length", 10.1, "length must be above 0 and at most 10; got 10.1"),
        ("length", math.nan, "length must be above 0 and at most 10; got nan"),
        ("length", True, "length must be a number; got True"),
        ("length", "5", "length must be a number; got '5'"),
        ("length", None, "length must be a number; got None"),
        ("length", [1.0], "length must be a number; got [1.0]"),
        ("depth", -1e-9, "depth must be at least 0; got -1e-09"),
        ("depth", "-1e-09", "depth must be at least 0; got -1e-09"),
        ("length", "1e+99", "length must be above 0 and at most 10; got 1e+99"),
        ("shift", 2.1, "shift must be from -2 to 2; got 2.1"),
        ("any", math.nan, "any must be a number; got nan"),
        ("mode", "Fast", "mode must be one of slow, fast; got 'Fast'"),
        ("mode", 1, "mode must be a text, one of slow, fast; got 1"),
        ("name", None, "name must be a text; got None"),
    ],
)
def test_other_values_are_refused_with_a_sentence(name, value, sentence):
    with pytest.raises(ValueError) as refused:
        Example(**{name: value})
    assert str(refused.value) == sentence


@pytest.mark.parametrize("value", [np.array([1.0, 2.0]), 10**400], ids=["array", "beyond float64"])
def test_what_is_no_float64_is_refused_with_a_sentence(value):
    with pytest.raises(ValueError, match="length must be"):
        Example(length=value)


@pytest.mark.parametrize("group", GROUPS, ids=lambda group: group.__name__)
def test_every_field_of_every_group_is_in_its_table_with_a_description(group):
    rows = {row.name: row for row in table(group)}
    assert list(rows) == [field.name for field in dataclasses.fields(group)]
    for row in rows.values():
        assert row.description
        assert not row.description.endswith(".")
        assert row.check(row.default) == row.default


@pytest.mark.parametrize("group", GROUPS, ids=lambda group: group.__name__)
def test_every_group_checks_itself(group):
    for row in table(group):
        with pytest.raises(ValueError, match=f"^{row.name} must be"):
            group(**{row.name: object()})


METHOD_NAMES = f"one of {', '.join(METHODS)}"

DENSITY = "clutter_density must be a text, one of estimated, given"

CONFIG = Path(__file__).parents[2] / "config"


def test_the_parameters_of_a_study_exist_where_its_method_is_chosen():
    always = {row.name for row in full_table(TRACK_INITIATOR)}
    assert len(always) <= 77
    for method in available_methods():
        names = {row.name for row in full_table(with_method(TRACK_INITIATOR, method))}
        own = {name for name in names if name.startswith(f"{method}.")}
        assert own
        assert own <= always or method not in NODE_METHODS
        assert names - always == (set() if method in NODE_METHODS else own)


def test_parameters_of_a_method_that_is_not_chosen_are_not_used_and_misspelt_ones_refused():
    made = make_groups(TRACK_INITIATOR, {"hough.min_hits": 4})
    assert made == make_groups(TRACK_INITIATOR, {})
    assert method_class("hough").Options not in made
    with pytest.raises(ValueError, match=r"hough.min_hit is not a parameter"):
        make_groups(TRACK_INITIATOR, {"hough.min_hit": 4})
    chosen = make_groups(TRACK_INITIATOR, {"method": "hough", "hough.min_hits": 4})
    assert settings_from(chosen).method_options.min_hits == 4


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ({"sensor.clutter_density": -1.0}, "sensor.clutter_density must be above 0"),
        ({"tsepm.min_hits": 9}, "tsepm.window must be at least min_hits"),
        ({"tsepm.min_hits": 2.5}, "tsepm.min_hits must be an integer"),
        ({"max_speed": 0.0}, "max_speed must be above 0"),
        ({"bearing_reference": "stern"}, "bearing_reference must be one of bow, north"),
        ({"sensor.min_range": 1e4}, "sensor.min_range must be below max_range"),
        ({"min_hits": 5}, "min_hits is not a parameter"),
        ({"maxspeed": 5.0}, "maxspeed is not a parameter; did you mean max_speed?"),
        ({"sensor": 5}, "sensor is not a parameter"),
        ({"sensor.": 5}, "sensor. is not a parameter"),
        ({"clutter_density": 2e-4}, f"{DENSITY}; got 0.0002; did you mean sensor.clutter_density?"),
        ({"clutter_density": -1.0}, f"{DENSITY}; got -1.0"),
        (
            {"sensor.clutter_density": "given"},
            "sensor.clutter_density must be a number; got 'given'; did you mean clutter_density?",
        ),
        ({"max_range": 300.0}, "max_range is not a parameter; did you mean sensor.max_range?"),
        ({"max_rnge": 300.0}, "max_rnge is not a parameter; did you mean sensor.max_range?"),
        ({"sensor.max_speed": 3.0}, "sensor.max_speed is not a parameter; did you mean max_speed?"),
        (
            {"false_tracks_per_hour": 3.0},
            "false_tracks_per_hour is not a parameter; did you mean score.false_tracks_per_hour?",
        ),
        (
            {"sensor.azimuth_max": 120.0},
            "sensor.azimuth_max must be from -6.28319 to 6.28319; got 120.0 (in rad; 120 degrees "
            "are 2.094 rad)",
        ),
        ({"method": "x" * 9000}, f"method must be {METHOD_NAMES}; got 'xxx"),
    ],
)
def test_refusals_have_the_full_name(values, sentence):
    with pytest.raises(ValueError) as refused:
        make_groups(TRACK_INITIATOR, values)
    said = str(refused.value)
    assert said.startswith(sentence)
    assert len(said) < 400, "a long value is cut short"
    assert ("did you mean" in said) == ("did you mean" in sentence) or "not a parameter" in sentence


def test_bearings_from_north_at_rest_need_a_fixed_frame_and_a_sensor_that_looks_all_round():
    north = {"bearing_reference": "north"}
    with pytest.raises(ValueError, match=r"fixed_frame must be given if bearing_reference is "):
        make_groups(TRACK_INITIATOR, north)
    for more in ({"fixed_frame": "map"}, {"own_ship_source": "odometry"}):
        made = make_groups(TRACK_INITIATOR, {**north, **more})
        assert made[InitiatorNodeOptions].bearing_reference == "north"
    sector = {**north, "fixed_frame": "map", "sensor.azimuth_min": -1.0}
    with pytest.raises(ValueError, match=r"own_ship_source must not be none if bearing_reference"):
        make_groups(TRACK_INITIATOR, sector)
    make_groups(TRACK_INITIATOR, {**sector, "own_ship_source": "odometry"})


@pytest.mark.parametrize("method", METHODS)
def test_no_method_has_an_option_of_a_common_ones_name(method):
    own = {row.name for row in table(method_class(method).Options)}
    common = {row.name for row in table(CommonOptions)}
    assert not common & own


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"host": ""}, "host must not be empty"),
        ({"token": "short"}, "at least .* characters"),
        ({"token": "ä" * 40}, "ASCII"),
    ],
)
def test_an_address_or_token_that_the_page_cannot_use_is_refused(values, words):
    with pytest.raises(ValueError, match=words):
        ViewerNodeOptions(**values)


@pytest.mark.parametrize(
    ("key", "node", "expected"),
    [
        ("/**", "/track_initiator", True),
        ("/**", "/boat/port/other", True),
        ("track_initiator", "/track_initiator", True),
        ("/track_initiator", "/track_initiator", True),
        ("track_initiator", "/boat/track_initiator", False),
        ("track_initiator", "/starter", False),
        ("boat/track_initiator", "/boat/track_initiator", True),
        ("/*/track_initiator", "/boat/track_initiator", True),
        ("/*/track_initiator", "/track_initiator", False),
        ("/**/track_initiator", "/track_initiator", True),
        ("/**/track_initiator", "/fleet/boat/track_initiator", True),
        ("/boat/*", "/boat/track_initiator", True),
        ("/boat/**", "/port/track_initiator", False),
    ],
)
def test_keys_fit_the_names_of_nodes(key, node, expected):
    assert fits(key, node) == expected


@pytest.fixture
def written(tmp_path):
    def write(text: str) -> list[str]:
        path = tmp_path / "mine.yaml"
        path.write_text(text)
        return ["--ros-args", "-p", "a:=1", "--params-file", str(path)]

    return write


def test_a_file_without_a_section_for_the_node_in_its_namespace_is_named(written):
    arguments = written("track_initiator:\n  ros__parameters: {max_speed: 4.0}\n")
    assert len(parameter_files(arguments)) == 1
    assert unused_files(arguments, "/track_initiator") == []
    [sentence] = unused_files(arguments, "/boat/track_initiator")
    assert "mine.yaml is not used: it has no section for /boat/track_initiator" in sentence
    assert "only for track_initiator; the key /** fits any name" in sentence
    arguments = written("boat:\n  track_initiator:\n    ros__parameters: {max_speed: 4.0}\n")
    assert unused_files(arguments, "/boat/track_initiator") == []
    assert len(unused_files(arguments, "/track_initiator")) == 1


@pytest.mark.parametrize("text", ["", "5", "[", "a: 1", "[" * 5_000])
def test_what_is_no_parameter_file_is_left_to_ros(written, text):
    assert unused_files(written(text), "/track_initiator") == []


def test_parameters_without_a_value_are_named(written):
    arguments = written(
        "/**:\n  ros__parameters:\n    max_speed: []\n    sensor:\n      max_range:\n"
        "      min_range: 1.0\nother:\n  ros__parameters: {method: []}\n"
    )
    assert without_value(arguments, "/node") == ["max_speed", "sensor.max_range"]


@pytest.mark.parametrize("name", ["ping360", "marine_radar", "imaging_sonar"])
def test_both_nodes_accept_their_section_and_agree_on_the_coverage(name):
    sections = yaml.safe_load((CONFIG / f"{name}.yaml").read_text("utf-8"))
    given = {}
    for section, content in sections.items():
        node, values = section.rpartition("/")[2], content["ros__parameters"]
        flat = {
            f"{key}.{inner}" if isinstance(value, dict) else key: one
            for key, value in values.items()
            for inner, one in (value.items() if isinstance(value, dict) else [("", value)])
        }
        make_groups(NODES[node], flat)
        given[node] = {key: one for key, one in flat.items() if key.startswith("sensor.")}
    assert set(given) == {"sonar_detector", "track_initiator"}
    for key, one in given["sonar_detector"].items():
        assert given["track_initiator"][key] == one


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("a:=5", 5),
        ("a:=5.0", 5.0),
        ("a:=1.0e-6", 1e-6),
        ("a:=true", True),
        ("a:=north", "north"),
        ("a:='5'", "5"),
        ("a:=b:=c", "b:=c"),
    ],
)
def test_values_on_the_command_line_are_typed_as_in_yaml(text, value):
    (found,) = parse_values([text]).values()
    assert found == value
    assert type(found) is type(value)


@pytest.mark.parametrize("text", ["a=5", "a", ":=5", "", "a:={"])
def test_what_is_no_assignment_is_refused(text):
    with pytest.raises(ValueError, match=r"NAME:=VALUE|is not a value"):
        parse_values([text])


def test_plain_values_are_those_of_safe_load():
    text = "a: [1, 2.5, text, true, null]\nb: {c: 2024-01-01}\n"
    assert load_yaml(text) == yaml.safe_load(text)
