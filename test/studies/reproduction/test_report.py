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
"""Reports of reproductions: sources, tables, pictures, and runs that go on where they stopped."""

import csv
import dataclasses
import sys
from types import ModuleType

import pytest

from tsepm_ros.studies.reproduction import (
    monte_carlo,
    split_merge_2016,
    tsepm_2018,
)
from tsepm_ros.studies.reproduction.report import (
    SOURCES,
    ReportLine,
    ReportPanel,
    ReportPicture,
    ReportSetting,
    ReportTable,
    write_report,
)
from tsepm_ros.tools.commands.cli import main
from tsepm_ros.tools.evaluation.intervals import IntervalEstimate


@dataclasses.dataclass(frozen=True)
class ToyCase:
    scale: float


def toy_run(case, seed):
    return {"value": [case.scale * seed[1], float(seed[0])]}


def toy_source(setting):
    [runs] = setting.results(toy_run, [ToyCase(2.0)], 5)
    rows = [["mean", IntervalEstimate(1.0, 0.5, 1.5)], ["runs", len(runs)]]
    return [
        "A text.",
        ReportTable("toy", {"what": "", "figure": ".2f"}, rows),
        ReportPicture("toy", "A picture", [ReportPanel([ReportLine([0, 1], [1, 2], "a line")])]),
    ]


def test_a_source_is_one_line_of_the_registry(tmp_path, monkeypatch, capsys):
    pytest.importorskip("matplotlib")
    monkeypatch.setitem(SOURCES, "toy", "Toy 1999")
    module = ModuleType("tsepm_ros.studies.reproduction.toy")
    monkeypatch.setattr(module, "reproduce", toy_source, raising=False)
    monkeypatch.setitem(sys.modules, module.__name__, module)
    arguments = ["reproduce", "toy", "--runs", "3", "--seed", "4", "--workers", "1"]
    assert main([*arguments, "--out", str(tmp_path)]) == 0
    text = (tmp_path / "report.md").read_text()
    assert "## Toy 1999" in text
    assert "tsepm reproduce toy --runs 3 --seed 4" in text
    assert "seed 4." in text
    assert "| mean | 1.00 (0.50-1.50) |" in text
    assert list(csv.reader((tmp_path / "toy.csv").open())) == [
        ["what", "figure", "figure, low", "figure, high"],
        ["mean", "1.0", "0.5", "1.5"],
        ["runs", "3", "", ""],
    ]
    assert (tmp_path / "toy.png").read_bytes().startswith(b"\x89PNG")
    assert "report.md" in capsys.readouterr().out


def test_without_matplotlib_the_report_says_that_there_are_no_pictures(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    picture = ReportPicture("toy", "A picture", [])
    write_report([picture], tmp_path / "report.md")
    assert not list(tmp_path.glob("*.png"))
    assert "needs matplotlib" in (tmp_path / "report.md").read_text()


@pytest.mark.long
def test_tables_and_pictures_are_written(tmp_path):
    pytest.importorskip("matplotlib")
    setting = ReportSetting(folder=tmp_path / "runs", runs=1)
    errors = {error: monte_carlo.ERRORS[error] for error in (15.0, 75.0, 120.0)}
    densities = dict(list(monte_carlo.DENSITIES.items())[:2])
    parts = [
        *tsepm_2018.reproduce(setting, densities, errors),
        *split_merge_2016.reproduce(setting),
    ]
    write_report(parts, tmp_path / "report.md")
    text = (tmp_path / "report.md").read_text()
    for name in ("figures_5_6", "figures_7_8"):
        assert f"(tsepm_2018_{name}.png)" in text
        assert (tmp_path / f"tsepm_2018_{name}.png").exists()
    with (tmp_path / "tsepm_2018_table_1_before.csv").open() as file:
        rows = list(csv.reader(file))
    assert [row[0] for row in rows[1:]] == [row.name for row in monte_carlo.TABLE_1]
    assert "The rows 4/6 and 4/7 are lower in print" in text
    assert "no g fits the rows 4/7, 5/9, 7/9" in text
    with (tmp_path / "tsepm_2018_figures_5_6.csv").open() as file:
        heading, *rows = csv.reader(file)
    assert [float(row[0]) for row in rows] == list(densities)
    assert {f"{curve}: {what}" for curve in monte_carlo.CURVES for what in ("P_D", "P_F")} <= {
        *heading
    }


def test_an_interrupted_reproduction_goes_on_where_it_stopped(tmp_path):
    done = []

    def count(runs, total):
        for one in runs:
            done.append(total)
            yield one

    cases = [ToyCase(1.0), ToyCase(10.0)]
    first = ReportSetting(folder=tmp_path, runs=2, seed=7, progress=count)
    first.results(toy_run, cases, 9)
    assert done == [4] * 4
    for path in tmp_path.iterdir():  # as a killed process leaves it
        path.write_bytes(path.read_bytes()[:-3])
    done.clear()
    results = dataclasses.replace(first, runs=3).results(toy_run, cases, 9)
    assert done == [4] * 4  # the cut line and the new run of each case
    assert [[run["value"] for run in runs] for runs in results] == [
        [[0.0, 7.0], [1.0, 7.0], [2.0, 7.0]],
        [[0.0, 7.0], [10.0, 7.0], [20.0, 7.0]],
    ]
    done.clear()
    dataclasses.replace(first, seed=8).results(toy_run, cases, 9)
    assert done == [4] * 4
