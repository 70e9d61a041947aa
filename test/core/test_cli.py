"""The command `tsepm`."""

from __future__ import annotations

import csv
import io
import sys

import numpy as np
import pytest
import yaml

from tsepm_ros.analysis.report import text_table
from tsepm_ros.cli import main
from tsepm_ros.methods import available_methods
from tsepm_ros.parameter_groups import NODES, as_page


@pytest.fixture
def recording(tmp_path):
    """A target at 5 m/s along x, 3 km north, seen 8 times by a sensor at rest."""
    rows = ["time_s,range_m,azimuth_rad"]
    for k in range(8):
        x, y = 5.0 * 12.0 * k, 3000.0
        rows.append(f"{12.0 * k},{np.hypot(x, y)},{np.arctan2(y, x)}")
    (tmp_path / "detections.csv").write_text("\n".join(rows))
    return str(tmp_path)


def test_methods_are_listed_with_what_they_are(capsys):
    assert main(["methods"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split(":")[0] for line in lines] == list(available_methods())


@pytest.mark.parametrize("node", ["track_initiator", "sonar_simulator", "scan_player"])
def test_parameters_are_a_parameter_file(capsys, node):
    assert main(["parameters", node]) == 0
    assert list(yaml.safe_load(capsys.readouterr().out)) == [node]


def test_the_parameters_of_all_nodes_are_one_file_and_one_page(capsys):
    assert main(["parameters", "all"]) == 0
    assert list(yaml.safe_load(capsys.readouterr().out)) == list(NODES)
    assert main(["parameters", "all", "--markdown"]) == 0
    assert capsys.readouterr().out == as_page(NODES)


def test_a_recording_gives_tracks_as_csv(capsys, recording):
    assert main(["run", recording]) == 0
    captured = capsys.readouterr()
    (row,) = csv.DictReader(io.StringIO(captured.out))
    assert float(row["stamp"]) == 24.0
    assert float(row["state_vx"]) == pytest.approx(5.0, rel=1e-3)
    assert float(row["state_y"]) == pytest.approx(3000.0, rel=1e-3)
    assert "3 hits within 3 scans" in row["reason"] and "the threshold" in row["reason"]
    assert captured.err == ""


def test_what_a_recording_loses_is_said(capsys, recording, tmp_path):
    path = tmp_path / "detections.csv"
    path.write_text(path.read_text() + "\n90.0,-1.0,0.0\n")
    assert main(["run", recording]) == 0
    assert "dropped: 1 range_not_positive" in capsys.readouterr().err


def test_a_study_states_method_scenario_runs_seed_and_intervals(capsys):
    arguments = ["study", "box", "--runs", "6", "--scans", "8", "--seed", "3", "--workers", "1"]
    arguments += ["--method", "tsepm"]
    assert main([*arguments, "-p", "min_hits:=4"]) == 0
    out = capsys.readouterr().out
    for part in ("tsepm", "min_hits:=4", "box", "8 scans", "6 runs", "seed 3", "95 %"):
        assert part in out
    assert "P_D" in out
    assert "NEES" in out


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["run", "/nowhere"], "detections.csv"),
        (["study", "nowhere"], "nowhere"),
        (["study", "box", "--method", "tsepm", "-p", "min_hats:=4"], "min_hats"),
        (["evaluate", "nowhere"], "nowhere"),
        (["evaluate", "-p", "min_hats:=4"], "min_hats"),
        (["evaluate", "--method", "score", "-p", "min_hits:=4"], "min_hits"),
        (["evaluate", "--method", "tsepm", "-p", "min_hits:=99"], "min_hits"),
        (["evaluate", "--horizon", "17"], "horizon 17"),
        (["evaluate", "--scene", "sensor.colour:=1.0"], "colour"),
        (["evaluate", "--scene", "sensor.azimuth_std:=wide"], "sensor.azimuth_std"),
        (["evaluate", "box", "box"], "box is there twice"),
        (["study", "box", "-p", "min_hits=4"], "min_hits=4"),
        (["run", "/nowhere", "-p", "sensor.range_std:=-1.0"], "detections.csv"),
    ],
)
def test_what_is_not_allowed_is_refused_with_a_sentence(
    capsys, tmp_path, monkeypatch, arguments, named
):
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == 2
    error = capsys.readouterr().err
    assert error.startswith("refused: ")
    assert named in error
    assert not list(tmp_path.iterdir())  # before anything was done


def evaluated(tmp_path, *arguments):
    small = ["--method", "score", "--runs", "3", "--scans", "8", "--workers", "1"]
    assert main(["evaluate", *small, "--out", str(tmp_path), *arguments]) == 0


def test_an_evaluation_writes_tables_that_say_how_they_were_made(capsys, tmp_path):
    evaluated(tmp_path, "--horizon", "6", "--seed", "3", "-p", "false_tracks_per_hour:=300.0")
    out = capsys.readouterr().out
    assert "scenario box, 6 scans, 3 runs, seed 3" in out
    assert "scenario box, 8 scans, 3 runs, seed 3" in out
    text = (tmp_path / "evaluation.md").read_text()
    for part in ("tsepm evaluate --method score", "3 runs", "seed 3", "Scenario box", "95 %"):
        assert part in text
    assert "false_tracks_per_hour:=300.0" in text


def test_an_evaluation_draws_three_pictures_of_each_scene(tmp_path):
    pytest.importorskip("matplotlib")
    evaluated(tmp_path, "-p", "false_tracks_per_hour:=300.0")
    pictures = ["box_nees.png", "box_operating_curve.png", "box_time_to_confirm.png"]
    assert sorted(path.name for path in tmp_path.glob("*.png")) == pictures


def test_without_matplotlib_there_are_tables_and_a_sentence(capsys, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "tsepm_ros.analysis.evaluation_picture", None)
    evaluated(tmp_path, "-p", "false_tracks_per_hour:=300.0")
    assert "no pictures: they need matplotlib" in capsys.readouterr().out
    assert (tmp_path / "evaluation.csv").exists()
    assert not list(tmp_path.glob("*.png"))


def test_the_scene_of_an_evaluation_can_be_changed(tmp_path):
    evaluated(tmp_path, "--scene", "sensor.clutter_density:=2.0e-6")
    assert "clutter 2e-06 /m^2" in (tmp_path / "evaluation.md").read_text()


def test_columns_of_a_table_line_up():
    lines = text_table(["name", "value"], [["a", "1.0"], ["long name", "10.0"]]).splitlines()
    assert lines == ["name       value", "----------------", "a            1.0", "long name   10.0"]
