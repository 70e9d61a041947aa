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
"""Values of parameters that commands are given: files as they are written and read."""

from pathlib import Path

import pytest
import yaml

from tsepm_ros import SensorModel
from tsepm_ros.settings.parameter_files import (
    load_parameter_file_text,
    parameter_files_without_value,
    parse_parameter_file_values,
)
from tsepm_ros.settings.settings import (
    NODES,
    make_groups,
    settings_table,
)
from tsepm_ros.tools.commands.cli import main
from tsepm_ros.tools.commands.given_parameters import (
    given_parameter_values,
    given_parameters_as_yaml,
    given_parameters_for,
)
from tsepm_ros.tracker.sensor import Coverage

EVERY_NODE = pytest.mark.parametrize("node", sorted(NODES))

CONFIG = Path(__file__).parents[3] / "config"


@EVERY_NODE
def test_yaml_reads_back_as_the_defaults_with_their_types(node):
    content = yaml.safe_load(given_parameters_as_yaml(node, NODES[node]))
    assert list(content) == ["/**"], "it fits any name and namespace of the node"
    values = content["/**"]["ros__parameters"]
    rows = {row.name: row for row in settings_table(NODES[node])}
    values |= {name: rows[name].meant(one) for name, one in values.items() if type(one) is list}
    expected = {name: row.default for name, row in rows.items()}
    assert values == expected
    assert {name: type(value) for name, value in values.items()} == {
        name: type(value) for name, value in expected.items()
    }


def test_a_file_that_both_nodes_share_is_read_by_the_detector_without_the_sensor_s_errors():
    errors = {row.name: row.default for row in settings_table((("sensor.", SensorModel),))}
    made = make_groups(NODES["sonar_detector"], errors | {"sensor.max_range": 40.0})
    assert made[Coverage] == Coverage(max_range=40.0)
    with pytest.raises(ValueError, match=r"sensor.max_rang is not a parameter; did you mean"):
        make_groups(NODES["sonar_detector"], {"sensor.max_rang": 40.0})


@EVERY_NODE
def test_the_shipped_parameter_file_is_up_to_date(node):
    path = CONFIG / f"{node}.yaml"
    if not path.exists():
        pytest.skip("only in the source tree")
    assert path.read_text(encoding="utf-8") == given_parameters_as_yaml(node, NODES[node])


@pytest.fixture
def written(tmp_path):
    def write(text: str) -> list[str]:
        path = tmp_path / "mine.yaml"
        path.write_text(text)
        return ["--ros-args", "-p", "a:=1", "--params-file", str(path)]

    return write


@pytest.mark.parametrize("section", ["5", "", "[max_speed]", "text"])
def test_a_section_that_is_no_mapping_has_no_parameters(written, tmp_path, section):
    arguments = written(f"/**:\n  ros__parameters: {section}\n")
    assert parameter_files_without_value(arguments, "/node") == []
    assert given_parameters_for(tmp_path / "mine.yaml", "/node") == {}


def test_the_last_of_two_values_on_the_command_line_counts():
    assert parse_parameter_file_values(["a:=1", "b:=2", "a:=3"]) == {"a": 3, "b": 2}


def test_a_former_parameter_is_read_with_a_note(tmp_path, capsys):
    (tmp_path / "mine.yaml").write_text('/**: {ros__parameters: {plots: "on", target_extent: 2.0}}')
    values = given_parameter_values([tmp_path / "mine.yaml"])
    assert values["target_extent"] == 2.0
    assert "note: plots: no longer used: target_extent above 0" in capsys.readouterr().err


BOMB = "a: &a {x: 1, y: 2}\n" + "".join(
    f"{name}: &{name} {{{', '.join(f'{k}: *{before}' for k in range(10))}}}\n"
    for before, name in zip("abcdefghijkl", "bcdefghijklm", strict=True)
)

CODE = "x: !!python/object/apply:os.system ['touch pwned']"


@pytest.mark.parametrize("text", [BOMB, CODE, "a: &a [*a]"], ids=["bomb", "code", "cycle"])
def test_no_reader_takes_it(tmp_path, monkeypatch, capsys, text):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "file.yaml"
    path.write_text(text)
    with pytest.raises(ValueError, match="not valid YAML"):
        load_parameter_file_text(text)
    with pytest.raises(ValueError, match="parameter file"):
        given_parameters_for(path, "/track_initiator")
    assert main(["run", str(path)]) == 2
    assert capsys.readouterr().err.startswith("refused: ")
    with pytest.raises(ValueError):
        parse_parameter_file_values([f"max_speed:={text}"])
    assert list(tmp_path.iterdir()) == [path]
