"""The nodes' parameter tables, as YAML, as text and as groups."""

from pathlib import Path

import pytest
import yaml

from tsepm_ros import SensorModel, available_methods
from tsepm_ros.methods.registry import METHODS, NODE_METHODS, method_class
from tsepm_ros.parameters import table
from tsepm_ros.settings.node_options import InitiatorNodeOptions, ViewerNodeOptions
from tsepm_ros.settings.parameter_files import as_yaml
from tsepm_ros.settings.settings import (
    NODES,
    TRACK_INITIATOR,
    full_table,
    make_groups,
    settings_from,
    with_method,
)
from tsepm_ros.tracker.options import CommonOptions

EVERY_NODE = pytest.mark.parametrize("node", sorted(NODES))
METHOD_NAMES = f"one of {', '.join(METHODS)}"
CONFIG = Path(__file__).parents[2] / "config"


@EVERY_NODE
def test_yaml_reads_back_as_the_defaults_with_their_types(node):
    content = yaml.safe_load(as_yaml(node, NODES[node]))
    assert list(content) == ["/**"], "it fits any name and namespace of the node"
    values = content["/**"]["ros__parameters"]
    expected = {row.name: row.default for row in full_table(NODES[node])}
    assert values == expected
    assert {name: type(value) for name, value in values.items()} == {
        name: type(value) for name, value in expected.items()
    }


@EVERY_NODE
def test_the_shipped_parameter_file_is_up_to_date(node):
    path = CONFIG / f"{node}.yaml"
    if not path.exists():
        pytest.skip("only in the source tree")
    assert path.read_text(encoding="utf-8") == as_yaml(node, NODES[node])


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


def test_groups_are_made_from_full_names():
    made = make_groups(
        TRACK_INITIATOR,
        {"sensor.azimuth_std": 0.02, "max_speed": 7, "tsepm.min_hits": 4, "hold_time": 9.0},
    )
    assert made[SensorModel].azimuth_std == 0.02
    assert made[CommonOptions].max_speed == 7.0
    assert made[method_class("tsepm").Options].min_hits == 4
    assert made[CommonOptions].hold_time == 9.0
    assert made[InitiatorNodeOptions] == InitiatorNodeOptions()


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
        (
            {"clutter_density": 2e-4},
            "clutter_density must be a text, one of estimated, given; got 0.0002; "
            "did you mean sensor.clutter_density?",
        ),
        (
            {"sensor.clutter_density": "given"},
            "sensor.clutter_density must be a number; got 'given'; did you mean clutter_density?",
        ),
        (
            {"clutter_density": -1.0},
            "clutter_density must be a text, one of estimated, given; got -1.0",
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
    assert str(refused.value).startswith(sentence)
    assert len(str(refused.value)) < 400, "a long value is cut short"
    assert ("did you mean" in str(refused.value)) == ("did you mean" in sentence) or (
        "is not a parameter" in sentence
    )


FROM_NORTH = {"bearing_reference": "north"}


def test_bearings_from_north_at_rest_need_a_fixed_frame():
    with pytest.raises(ValueError, match=r"fixed_frame must be given if bearing_reference is "):
        make_groups(TRACK_INITIATOR, FROM_NORTH)
    for more in ({"fixed_frame": "map"}, {"own_ship_source": "odometry"}):
        made = make_groups(TRACK_INITIATOR, {**FROM_NORTH, **more})
        assert made[InitiatorNodeOptions].bearing_reference == "north"


def test_bearings_from_north_at_rest_need_a_sensor_that_looks_all_round():
    sector = {**FROM_NORTH, "fixed_frame": "map", "sensor.azimuth_min": -1.0}
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
