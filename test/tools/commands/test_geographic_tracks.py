"""Tracks with latitude and longitude from `tsepm run`."""

from __future__ import annotations

import json

import pynmea2
import pytest

from tsepm_ros.tools.commands.cli import main


def test_geojson_has_the_tracks_of_a_scene_around_the_origin(tmp_path, capsys):
    arguments = ["run", "four_targets", "--as", "geojson", "--origin", "59.65,10.63"]
    assert main([*arguments, "--out", str(tmp_path / "run")]) == 0
    found = json.loads((tmp_path / "run" / "tracks.geojson").read_text())["features"]
    assert len(found) >= 4
    for one in found:
        line = one["geometry"]["coordinates"]
        for longitude, latitude in line if isinstance(line[0], list) else [line]:
            assert abs(latitude - 59.65) < 0.2
            assert abs(longitude - 10.63) < 0.4


def test_sentences_of_a_scene_are_read_by_another_reader(capsys):
    assert main(["run", "four_targets", "--as", "nmea", "--origin=-33.9,151.2"]) == 0
    lines = capsys.readouterr().out.split("\r\n")[:-1]
    messages = [pynmea2.parse(line, check=True) for line in lines]
    assert len(messages) > 10
    assert {one.sentence_type for one in messages} == {"TLL"}
    assert {one.data[0] for one in messages} >= {"00", "01", "02", "03"}


@pytest.mark.parametrize("origin", [[], ["--origin", "north"], ["--origin", "89.9,0"]])
def test_without_a_proper_origin_the_command_says_what_is_one(origin, capsys):
    assert main(["run", "four_targets", "--as", "nmea", *origin]) != 0
    assert "latitude" in capsys.readouterr().err
