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
"""The command `tsepm`: lists, refusals, interrupts, pipes and threads."""

import os
import re
import subprocess
import sys
import threading

import pytest
import yaml

from tsepm_ros.methods.registry import available_methods
from tsepm_ros.settings.settings import NODES
from tsepm_ros.tools.commands.cli import COMMANDS, main


def test_methods_are_listed_with_what_they_are(capsys):
    assert main(["methods"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split(":")[0] for line in lines] == list(available_methods())


def test_parameters_are_one_file_of_all_nodes(capsys):
    assert main(["parameters", "all"]) == 0
    assert list(yaml.safe_load(capsys.readouterr().out)) == [f"/**/{node}" for node in NODES]


def test_an_interrupt_ends_a_command_with_a_word(capsys, tmp_path, monkeypatch):
    def interrupted(prompt):
        raise KeyboardInterrupt

    monkeypatch.setattr("builtins.input", interrupted)
    for stream in (sys.stdin, sys.stdout):
        monkeypatch.setattr(stream, "isatty", lambda: True, raising=False)
    assert main(["init", str(tmp_path / "sonar.yaml")]) == 130
    assert capsys.readouterr().err == "interrupted\n"
    assert not list(tmp_path.iterdir())


def test_a_reader_that_closes_the_pipe_is_no_error(capsys, monkeypatch):
    reading, writing = os.pipe()
    os.close(reading)
    with open(writing, "w") as pipe:
        monkeypatch.setattr(sys, "stdout", pipe)
        assert main(["parameters", "all"]) == 0
    assert capsys.readouterr().err == ""


def test_a_command_runs_in_any_thread(capsys):
    codes = []
    thread = threading.Thread(target=lambda: codes.append(main(["methods"])))
    thread.start()
    thread.join()
    assert codes == [0]


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ("run /nowhere", "/nowhere is neither"),
        ("run four_target", "four_targets"),
        ("run nowhere.yaml", "nowhere.yaml"),
        ("run box -p own_ship_source:=tf", "own_ship_source tf"),
        (
            "run box -p bearing_reference:=north -p own_ship_source:=none",
            "fixed_frame must be given",
        ),
        ("evaluate nowhere", "nowhere"),
        ("evaluate -p min_hats:=4", "min_hats"),
        ("evaluate --method score -p min_hits:=4", "min_hits"),
        ("evaluate --method tsepm -p min_hits:=99", "min_hits"),
        ("evaluate --horizon 17", "horizon 17"),
        ("evaluate --scene sensor.colour:=1.0", "colour"),
        ("evaluate --scene sensor.azimuth_std:=wide", "sensor.azimuth_std"),
        ("evaluate box box", "box is given twice"),
        ("evaluate box -p min_hits=4", "min_hits=4"),
        ("run /nowhere -p sensor.range_std:=-1.0", "/nowhere is neither"),
        ("run box -p max_range:=300.0", "did you mean sensor.max_range?"),
        ("evaluate --scene name:=", "scenario.name must be a text"),
        ("run box -p max_speed:=" + "[" * 5000, "is not a value"),
        ("run box -p sound_speed:=3.0", "sound_speed must be 0 or at least"),
        ("health --timeout 0", "--timeout must be a positive number"),
    ],
)
def test_what_is_not_allowed_is_refused_with_a_sentence(
    capsys, tmp_path, monkeypatch, arguments, named
):
    monkeypatch.chdir(tmp_path)
    assert main(arguments.split()) == 2
    error = capsys.readouterr().err
    assert error.startswith("refused: ")
    assert named in error
    assert not list(tmp_path.iterdir())  # before anything was done


def test_a_number_that_must_be_positive_and_an_unknown_command_are_refused(capsys):
    with pytest.raises(SystemExit) as ended:
        main(["evaluate", "--runs", "0"])
    assert ended.value.code == 2
    assert "must be at least 1" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main(["foo"])
    said = capsys.readouterr().err
    assert re.findall(r"'(\w+)'", said.partition("choose from")[2]) == list(COMMANDS)


@pytest.mark.parametrize("command", ["run", "watch", "design", "evaluate", "reproduce"])
@pytest.mark.parametrize("given", ["-1", "1.5", "x"])
def test_a_seed_that_is_none_is_refused_by_its_option(capsys, command, given):
    with pytest.raises(SystemExit) as ended:
        main([command, "--seed", given])
    assert ended.value.code == 2
    assert "argument --seed: " in capsys.readouterr().err


def test_an_output_is_no_input_whatever_it_is_called(folder, capsys):
    (folder / "link.csv").symlink_to(folder / "times.csv")
    for out in ("times.csv", "geometry.yaml", "images.npz", "link.csv"):
        before = (folder / out).read_bytes()
        assert main(["detect", str(folder), "--out", str(folder / out)]) == 2
        assert "is not overwritten" in capsys.readouterr().err
        assert (folder / out).read_bytes() == before
    assert main(["detect", str(folder), "--out", str(folder / "detections.csv")]) == 0
    recording = folder / "detections.csv"
    assert main(["run", str(folder), "--html", str(recording)]) == 2
    target = folder / "tracks.csv"
    target.write_bytes(recording.read_bytes())
    before = target.read_bytes()
    assert main(["run", str(target), "--out", str(folder)]) == 2
    assert target.read_bytes() == before


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (["four_targets", "--detections", "/sonar"], "--detections has no meaning for a scenario"),
        (["recording", "--odometry", "/odom"], "--odometry has no meaning for a recording"),
        (["recording", "--seed", "0"], "--seed has no meaning for a recording"),
        (["recording", "--origin", "1,2"], "--origin is for --as and --html"),
    ],
)
def test_an_option_without_a_meaning_for_the_source_is_refused(
    tmp_path, monkeypatch, capsys, given, words
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "recording").mkdir()
    (tmp_path / "recording" / "detections.csv").write_text("time_s,range_m,azimuth_rad\n0,1,0\n")
    assert main(["run", *given]) == 2
    assert words in capsys.readouterr().err


@pytest.mark.parametrize(
    "command",
    [
        "run {}.csv",
        "run {}.yaml",
        "run box --params-file {}.yaml",
        "detect {}",
        "evaluate {}.yaml --runs 1",
        "design --params-file {}.yaml",
        "score {}.csv truth.csv --cutoff 1",
    ],
)
@pytest.mark.parametrize("kind", ["missing", "empty", "folder", "binary"])
def test_a_file_that_cannot_be_used_is_named_in_a_sentence(
    capsys, tmp_path, monkeypatch, command, kind
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "truth.csv").write_text("time_s,x,y\n0,0,0\n")
    for suffix in ("", ".csv", ".yaml"):
        path = tmp_path / f"it{suffix}"
        if kind == "folder":
            path.mkdir()
        elif kind != "missing":
            path.write_bytes(b"" if kind == "empty" else b"\xff\xfe\x00")
    assert main(command.format("it").split()) in (1, 2)
    [sentence] = capsys.readouterr().err.splitlines()
    assert re.match(r"(refused|failed): .*\bit\b", sentence)
    assert not re.search(r"Errno|codec|Traceback", sentence)


def test_a_fault_is_a_sentence_with_its_remedy_and_on_request_a_traceback(capsys, monkeypatch):
    def fault(_: object) -> None:
        raise RecursionError("too deep")

    monkeypatch.setitem(COMMANDS, "methods", ("", lambda parser: None, fault))
    assert main(["methods"]) == 70
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("failed: too deep (RecursionError). This is a fault of tsepm")
    assert "TSEPM_DEBUG=1" in line and "report" in line
    monkeypatch.setenv("TSEPM_DEBUG", "1")
    with pytest.raises(RecursionError):
        main(["methods"])


TRACKS = "stamp,track_id,state_x,state_y,status\n1000,0,1,1,confirmed\n1001,0,2,1"


@pytest.mark.parametrize(
    ("content", "more", "code", "said"),
    [
        (TRACKS, [], 2, "t.csv, line 3: expected 5 values"),
        (f"{TRACKS},confirmed", ["--cutoff", "1e200"], 2, "below 1e+12"),
        (f"{TRACKS},confirmed".replace("1001,0,2", "1001,0,1e200"), [], 2, "below 1e+12"),
    ],
)
def test_cut_lines_and_numbers_beyond_bounds_are_named(capsys, tmp_path, content, more, code, said):
    (tmp_path / "t.csv").write_text(content)
    (tmp_path / "g.csv").write_text("stamp,state_x,state_y\n1000,1,1\n1001,2,1\n")
    files = [str(tmp_path / "t.csv"), str(tmp_path / "g.csv")]
    try:
        assert main(["score", *files, "--cutoff", "10", *more]) == code
    except SystemExit as error:
        assert error.code == code
    assert said in capsys.readouterr().err


@pytest.mark.long
def test_a_folder_whose_name_is_no_utf_8_is_read_written_and_drawn(tmp_path):
    pytest.importorskip("matplotlib")
    folder = tmp_path / os.fsdecode(b"M\xfcller")
    folder.mkdir()
    rows = [f"{1000 + k},{30 + k},0.3" for k in range(12)]
    (folder / "detections.csv").write_text("\n".join(["time_s,range_m,azimuth_rad", *rows]))
    run = [sys.executable, "-m", "tsepm_ros.tools.commands.cli", "run", folder]
    ended = subprocess.run(
        [*run, "--out", folder / "out", "--html", folder / "page.html"], capture_output=True
    )
    assert ended.returncode == 0 and b"Traceback" not in ended.stderr
    names = {path.name for path in (folder / "out").iterdir()}
    assert names >= {"tracks.csv", "current.csv", "picture.png"}
    assert (folder / "page.html").exists()
