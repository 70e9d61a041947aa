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
"""Parameters as text: YAML files of nodes, and values on the command line."""

import pytest
import yaml

from tsepm_ros.settings.parameter_files import (
    load_parameter_file_text,
    parameter_file_fits,
    parameter_files,
    parameter_files_without_value,
    parse_parameter_file_values,
    unused_parameter_files,
)


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
    assert parameter_file_fits(key, node) == expected


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
    assert unused_parameter_files(arguments, "/track_initiator") == []
    [sentence] = unused_parameter_files(arguments, "/boat/track_initiator")
    assert "mine.yaml is not used: it has no section for /boat/track_initiator" in sentence
    assert "only for track_initiator; the key /** fits any name" in sentence
    arguments = written("boat:\n  track_initiator:\n    ros__parameters: {max_speed: 4.0}\n")
    assert unused_parameter_files(arguments, "/boat/track_initiator") == []
    assert len(unused_parameter_files(arguments, "/track_initiator")) == 1


@pytest.mark.parametrize("text", ["", "5", "[", "a: 1", "[" * 5_000])
def test_what_is_no_parameter_file_is_left_to_ros(written, text):
    assert unused_parameter_files(written(text), "/track_initiator") == []


def test_parameters_without_a_value_are_named(written):
    arguments = written(
        "/**:\n  ros__parameters:\n    max_speed: []\n    sensor:\n      max_range:\n"
        "      min_range: 1.0\nother:\n  ros__parameters: {method: []}\n"
    )
    assert parameter_files_without_value(arguments, "/node") == ["max_speed", "sensor.max_range"]


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
    (found,) = parse_parameter_file_values([text]).values()
    assert found == value
    assert type(found) is type(value)


@pytest.mark.parametrize("text", ["a=5", "a", ":=5", "", "a:={"])
def test_what_is_no_assignment_is_refused(text):
    with pytest.raises(ValueError, match=r"NAME:=VALUE|is not a value"):
        parse_parameter_file_values([text])


def test_plain_values_are_those_of_safe_load():
    text = "a: [1, 2.5, text, true, null]\nb: {c: 2024-01-01}\n"
    assert load_parameter_file_text(text) == yaml.safe_load(text)
