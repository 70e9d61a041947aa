"""YAML that would run code or grow without bound is refused by every reader of it."""

from __future__ import annotations

import pytest
import yaml

from tsepm_ros.settings import parameter_files
from tsepm_ros.settings.parameter_files import parse_values, values_for
from tsepm_ros.tools.commands.cli import main

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
