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
"""Groups of a node from its values: shared files, other methods, names, and combinations."""

from pathlib import Path

import pytest
import yaml

from tsepm_ros import available_methods
from tsepm_ros.methods.registry import METHODS, NODE_METHODS, registered_method
from tsepm_ros.parameters import parameter_table
from tsepm_ros.settings.node_options import (
    InitiatorNodeOptions,
)
from tsepm_ros.settings.settings import (
    NODES,
    OF_SENSOR,
    SONAR_DETECTOR,
    TRACK_INITIATOR,
    make_groups,
    options_by_sensor,
    settings_from,
    settings_table,
    settings_with_method,
)
from tsepm_ros.tracker.options import CommonOptions

METHOD_NAMES = f"one of {', '.join(METHODS)}"

DENSITY = "clutter_density must be a text, one of estimated, given"

CONFIG = Path(__file__).parents[2] / "config"


def test_the_parameters_of_a_study_exist_where_its_method_is_chosen():
    always = {row.name for row in settings_table(TRACK_INITIATOR)}
    assert len(always) <= 79  # with those of several sensors
    for method in available_methods():
        names = {row.name for row in settings_table(settings_with_method(TRACK_INITIATOR, method))}
        own = {name for name in names if name.startswith(f"{method}.")}
        assert own
        assert own <= always or method not in NODE_METHODS
        assert names - always == (set() if method in NODE_METHODS else own)


def test_parameters_of_a_method_that_is_not_chosen_are_not_used_and_misspelt_ones_refused():
    made = make_groups(TRACK_INITIATOR, {"hough.min_hits": 4})
    assert made == make_groups(TRACK_INITIATOR, {})
    assert registered_method("hough").Options not in made
    with pytest.raises(ValueError, match=r"hough.min_hit is not a parameter"):
        make_groups(TRACK_INITIATOR, {"hough.min_hit": 4})
    chosen = make_groups(TRACK_INITIATOR, {"method": "hough", "hough.min_hits": 4})
    assert settings_from(chosen).method_options.min_hits == 4


def test_a_former_parameter_is_read_and_not_used():
    assert make_groups(TRACK_INITIATOR, {"plots": "on"}) == make_groups(TRACK_INITIATOR, {})
    with pytest.raises(ValueError, match="plots is not a parameter"):
        make_groups(SONAR_DETECTOR, {"plots": "on"})


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
            {"score.process_noise": 0.01},
            "score.process_noise is not a parameter; it is replaced by target_manoeuvre, m/s^2: "
            "the square root of the process noise divided by the time between scans; 0: learned",
        ),
        (
            {"sensor.azimuth_max": 120.0},
            "sensor.azimuth_max must be from -6.2832 to 6.2832; got 120.0 (in rad; 120 degrees "
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
    own = {row.name for row in parameter_table(registered_method(method).Options)}
    common = {row.name for row in parameter_table(CommonOptions)}
    assert not common & own


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
    ("values", "said"),
    [
        ({"image.far_range": 3997.0, "image.near_range": 5.0}, "give all in metres"),
        ({"image.far_range": 397.0, "image.near_range": 50.0}, "give all in metres"),
        ({"image.far_range": 0.4, "image.near_range": 0.0}, "give all in metres"),
        ({"image.far_range": 9.0, "image.near_range": 9.0}, "near_range must be below"),
    ],
)
def test_ranges_of_images_that_contradict_the_coverage_are_refused(values, said):
    coverage = {"sensor.min_range": 0.5, "sensor.max_range": 40.0}
    with pytest.raises(ValueError, match=said):
        make_groups(SONAR_DETECTOR, {**coverage, **values})
    rest = {"image.near_range": 0.2, "image.far_range": 100.0}
    make_groups(SONAR_DETECTOR, {**coverage, **rest})


PORT_AND_STARBOARD = {"sensors": ["port", "starboard"], "own_ship_source": "odometry"}


def test_a_sensor_has_its_own_values_else_those_of_all_and_those_of_the_picture_are_one():
    made = make_groups(
        TRACK_INITIATOR,
        {
            **PORT_AND_STARBOARD,
            "max_speed": 3.0,
            "sensor.max_range": 40.0,
            "sensor.range_std": 0.1,
            "port.sensor.max_range": 60.0,
            "port.mounting.yaw": 0.5,
            "starboard.sweep": "off",
        },
    )
    port, starboard = (settings_from(one) for one in options_by_sensor(made).values())
    assert [*options_by_sensor(made)] == ["port", "starboard"]
    assert (port.sensor.max_range, starboard.sensor.max_range) == (60.0, 40.0)
    assert port.sensor.range_std == starboard.sensor.range_std == 0.1
    assert (port.mounting.yaw, starboard.mounting.yaw) == (0.5, 0.0)
    assert (port.session.sweep, starboard.session.sweep) == ("auto", "off")
    assert port.common == starboard.common == settings_from(made).common


@pytest.mark.parametrize("empty", [[], [""], (), ("",)])
def test_without_names_there_is_one_sensor_as_ever(empty):
    made = make_groups(TRACK_INITIATOR, {"sensors": empty})
    assert made == make_groups(TRACK_INITIATOR, {})
    assert options_by_sensor(made) == {"": made}
    with pytest.raises(ValueError, match=r"port.sensor.max_range is not a parameter: port is no "):
        make_groups(TRACK_INITIATOR, {"sensors": empty, "port.sensor.max_range": 3.0})


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ({"port.method": "score"}, "port.method is not a parameter: method is of the picture"),
        ({"port.max_speed": 2.0}, "port.max_speed is not a parameter: max_speed is of the picture"),
        ({"port.sensors": ["x"]}, "port.sensors is not a parameter: sensors is of the picture"),
        (
            {"port.score.false_tracks_per_hour": 2.0},
            "port.score.false_tracks_per_hour is not a parameter: score.false_tracks_per_hour is",
        ),
        ({"prt.sensor.max_range": 2.0}, "prt.sensor.max_range is not a parameter: prt is no name"),
        (
            {"port.sensor.max_rnge": 2.0},
            "port.sensor.max_rnge is not a parameter; did you mean port.sensor.max_range?",
        ),
        ({"port.sensor.max_range": -2.0}, "port.sensor.max_range must be from 0.001"),
        ({"port.sensor.min_range": 1e4}, "port.sensor.min_range must be below max_range"),
        ({"port.port.sweep": "off"}, "port.port.sweep is not a parameter"),
        ({"sensors": "port"}, "sensors must be a list of texts; got 'port'"),
        ({"sensors": ["port", 1]}, "sensors must be a list of texts; got ('port', 1)"),
        ({"sensors": ["port", "port"]}, "sensors must be at most 32 different names; got"),
        ({"sensors": [f"s{k}" for k in range(33)]}, "sensors must be at most 32 different names"),
        *(
            ({"sensors": ["port", name]}, "sensors must be names of letters, digits and _ that")
            for name in ("", "2nd", "a b", "a/b", "a.b", "\u00e4", "s\n", "x" * 65)
        ),
        *(
            ({"sensors": [name]}, "sensors must be names of letters, digits and _ that")
            for name in ("sensor", "tracks", "score", "hough", "own_ship", "qos_overrides")
        ),
        (
            {"own_ship_source": "tf", "fixed_frame": "map", "port.mounting.x": 1.0},
            "port.mounting.x, mounting.y and mounting.yaw must be 0 if own_ship_source is tf",
        ),
    ],
)
def test_refusals_of_several_sensors_name_the_parameter(values, sentence):
    with pytest.raises(ValueError) as refused:
        make_groups(TRACK_INITIATOR, {**PORT_AND_STARBOARD, **values})
    said = str(refused.value)
    assert said.startswith(sentence)
    assert "\n" not in said and len(said) < 600


def test_only_the_node_of_tracks_takes_several_sensors():
    with pytest.raises(ValueError, match="sensors is not a parameter"):
        make_groups(SONAR_DETECTOR, {"sensors": ["port"]})


def test_every_parameter_of_a_sensor_exists_with_its_name_in_front():
    rows = {row.name: row for row in settings_table(TRACK_INITIATOR, ["port"])}
    plain = {row.name for row in rows.values() if not row.plain}
    assert {row.plain for row in rows.values() if row.plain} == {
        name for name in plain if name.startswith(OF_SENSOR)
    }
    assert all(name == f"port.{row.plain}" for name, row in rows.items() if row.plain)
    for name in OF_SENSOR:
        assert any(row.startswith(name) for row in plain), name
