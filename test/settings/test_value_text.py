"""Values of parameters as text, in YAML and on the command line."""

import math

import pytest
import yaml

from tsepm_ros.settings import parameter_files
from tsepm_ros.settings.parameter_files import as_yaml, parse_values, values_for
from tsepm_ros.settings.settings import TRACK_INITIATOR
from tsepm_ros.tools.commands.cli import main


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


def test_the_last_of_two_values_on_the_command_line_counts():
    assert parse_values(["a:=1", "b:=2", "a:=3"]) == {"a": 3, "b": 2}


@pytest.mark.parametrize("text", ["a=5", "a", ":=5", "", "a:={"])
def test_what_is_no_assignment_is_refused(text):
    with pytest.raises(ValueError, match=r"NAME:=VALUE|is not a value"):
        parse_values([text])


def test_small_numbers_keep_their_point_in_yaml():
    # YAML 1.1, which ROS reads, takes 1e-06 for a text.
    line = next(
        line
        for line in as_yaml("track_initiator", TRACK_INITIATOR).splitlines()
        if "sensor.clutter_density:" in line
    )
    assert "1.0e-06" in line
    assert math.isclose(yaml.safe_load(line)["sensor.clutter_density"], 1e-6)


BOMB = "a: &a {x: 1, y: 2}\n" + "".join(
    f"{name}: &{name} {{{', '.join(f'{k}: *{before}' for k in range(10))}}}\n"
    for before, name in zip("abcdefghijkl", "bcdefghijklm", strict=True)
)
CODE = "x: !!python/object/apply:os.system ['touch pwned']"


def test_plain_values_are_those_of_safe_load():
    text = "a: [1, 2.5, text, true, null]\nb: {c: 2024-01-01}\n"
    assert parameter_files.load_yaml(text) == yaml.safe_load(text)


@pytest.mark.parametrize("text", [BOMB, CODE, "a: &a [*a]"], ids=["bomb", "code", "cycle"])
def test_no_reader_takes_it(tmp_path, monkeypatch, capsys, text):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "file.yaml"
    path.write_text(text)
    with pytest.raises(yaml.YAMLError):
        parameter_files.load_yaml(text)
    with pytest.raises(ValueError, match="parameter file"):
        values_for(path, "/track_initiator")
    assert main(["run", str(path)]) == 2
    assert capsys.readouterr().err.startswith("refused: ")
    with pytest.raises(ValueError):
        parse_values([f"max_speed:={text}"])
    assert list(tmp_path.iterdir()) == [path]
