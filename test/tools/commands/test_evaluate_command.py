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
"""The command `tsepm evaluate`: tables, pictures, and the work that it announces."""

import sys

import pytest

from tsepm_ros.tools.commands import evaluate_command
from tsepm_ros.tools.commands.cli import main
from tsepm_ros.tools.evaluation.result_files import read_result


def evaluated(tmp_path, *arguments):
    small = ["--method", "score", "--runs", "3", "--scans", "8", "--workers", "1"]
    assert main(["evaluate", *small, "--out", str(tmp_path), *arguments]) == 0


@pytest.mark.long
def test_an_evaluation_writes_tables_that_say_how_they_were_made(capsys, tmp_path):
    path = tmp_path / "a deep folder" / "figures.json"
    changed = ("--seed", "3", "-p", "false_tracks_per_hour:=300.0")
    evaluated(tmp_path, "--horizon", "6", *changed, "--result", str(path))
    out = capsys.readouterr().out
    assert out.startswith("3 runs, seed 3\n")
    assert [line.split()[:2] for line in out.splitlines()[3:5]] == [["box", "6"], ["box", "8"]]
    text = (tmp_path / "evaluation.md").read_text()
    for part in ("tsepm evaluate --method score", "3 runs", "seed 3", "## box, 8 scans", "95 %"):
        assert part in text
    assert "false_tracks_per_hour:=300.0" in text
    result = read_result(path)
    assert (result.seed, result.runs) == (3, 3)
    assert result.parameters == {"false_tracks_per_hour": 300.0}
    assert result.command.startswith("tsepm evaluate --method score --runs 3 --scans 8 --horizon 6")
    assert not any(name in result.command for name in ("result", "out", "workers", "folder"))
    assert [row[:2] for row in result.rows] == [["box", "6"], ["box", "8"]]
    assert {len(row) for row in result.rows} == {len(result.header)}
    assert [row["scans"] for row in result.measures] == [6, 8]
    assert all(row["options"] == result.parameters for row in result.measures)
    path.write_text('{"seed": 1}')
    with pytest.raises(ValueError, match="not a result file"):
        read_result(path)


@pytest.mark.long
def test_an_evaluation_draws_the_operating_curves_of_each_scene(tmp_path):
    pytest.importorskip("matplotlib")
    evaluated(tmp_path, "-p", "false_tracks_per_hour:=300.0")
    assert [path.name for path in tmp_path.glob("*.png")] == ["box_operating_curve.png"]


@pytest.mark.usefixtures("tests_installed")
def test_a_measure_from_outside_is_a_column_of_every_table(capsys, tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(tmp_path))
    (tmp_path / "column_measures.py").write_text("def seven(tracks, targets): return 7.0\n")
    name = "column_measures:seven"
    evaluated(tmp_path / "out", "--defaults", "--measure", name)
    header, _, row = capsys.readouterr().out.splitlines()[1:4]
    assert header.split()[-1] == name and float(row.split()[-1]) == 7.0
    assert name in (tmp_path / "out" / "evaluation.md").read_text()
    titles, values = (tmp_path / "out" / "evaluation.csv").read_text().splitlines()
    assert titles.endswith(f"{name},{name}_low,{name}_high")
    assert values.endswith(",7.0,7.0,7.0")


def test_without_matplotlib_there_are_tables_and_a_sentence(capsys, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "tsepm_ros.tools.pictures.operating_curve_picture", None)
    evaluated(tmp_path, "-p", "false_tracks_per_hour:=300.0")
    assert "no pictures: they need matplotlib" in capsys.readouterr().out
    assert (tmp_path / "evaluation.csv").exists()
    assert not list(tmp_path.glob("*.png"))


def test_what_will_be_done_is_said_before_the_first_run(capsys, monkeypatch, scenario, tmp_path):
    def ends(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(evaluate_command, "evaluate_performance", ends)
    arguments = ["evaluate", scenario, "--method", "score", "--runs", "50"]
    assert main([*arguments, "--out", str(tmp_path), "--workers", "3"]) == 130
    done, *_ = capsys.readouterr().err.splitlines()
    assert "runs: 50 of each of " in done and "operating points of 1 methods on small" in done
