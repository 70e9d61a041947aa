"""Parameter files: which fit a node, what in them has no value, and those shipped."""

from pathlib import Path

import pytest
import yaml

from tsepm_ros.settings.parameter_files import (
    fits,
    parameter_files,
    unused_files,
    values_for,
    without_value,
)
from tsepm_ros.settings.settings import NODES, make_groups


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


def test_a_file_without_a_section_for_the_node_is_named(written):
    arguments = written("track_initiator:\n  ros__parameters: {max_speed: 4.0}\n")
    assert len(parameter_files(arguments)) == 1
    assert unused_files(arguments, "/track_initiator") == []
    [sentence] = unused_files(arguments, "/boat/track_initiator")
    assert "mine.yaml is not used: it has no section for /boat/track_initiator" in sentence
    assert "only for track_initiator; the key /** fits any name" in sentence


def test_namespaces_in_a_file_are_part_of_the_key(written):
    arguments = written("boat:\n  track_initiator:\n    ros__parameters: {max_speed: 4.0}\n")
    assert unused_files(arguments, "/boat/track_initiator") == []
    assert len(unused_files(arguments, "/track_initiator")) == 1


@pytest.mark.parametrize("text", ["", "5", "[", "a: 1", "[" * 50_000])
def test_what_is_no_parameter_file_is_left_to_ros(written, text):
    assert unused_files(written(text), "/track_initiator") == []


@pytest.mark.parametrize("section", ["5", "", "[max_speed]", "text"])
def test_a_section_that_is_no_mapping_has_no_parameters(written, tmp_path, section):
    arguments = written(f"/**:\n  ros__parameters: {section}\n")
    assert without_value(arguments, "/node") == []
    assert values_for(tmp_path / "mine.yaml", "/node") == {}


def test_parameters_without_a_value_are_named(written):
    arguments = written(
        "/**:\n  ros__parameters:\n    max_speed: []\n    sensor:\n      max_range:\n"
        "      min_range: 1.0\nother:\n  ros__parameters: {method: []}\n"
    )
    assert without_value(arguments, "/node") == ["max_speed", "sensor.max_range"]


CONFIG = Path(__file__).parents[2] / "config"


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
