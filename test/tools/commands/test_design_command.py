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
"""The command `tsepm design`: what it says and refuses."""

import dataclasses

import numpy as np
import pytest

from tsepm_ros import SensorModel
from tsepm_ros.tools.commands import design_command as design_report
from tsepm_ros.tools.commands.cli import main
from tsepm_ros.tools.design.prediction import (
    FirstPrediction,
    PredictedCandidate,
    PredictionCase,
    PredictionStatistics,
)
from tsepm_ros.tools.evaluation.intervals import IntervalEstimate


@pytest.mark.long
@pytest.mark.usefixtures("little_clutter")
def test_the_command_says_what_to_expect(capsys):
    given = ["-p", "sensor.clutter_density:=1.0e-7", "-p", "sensor.max_range:=5000.0"]
    given += ["--runs", "10", "--wanted", "0.5"]
    assert main(["design", "--workers", "1", *given]) == 0
    said = capsys.readouterr().out
    assert "78.54 km^2" in said and "\nfeasible: " in said


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ("-p method:=tsepm", "method"),
        ("--wanted 2", "wanted"),
        ("--speed 50", "speed"),
        ("--speed 10 -p sensor.max_range:=500.0", "coverage"),
        ("--false-detections 0", "--false-detections"),
        ("--false-detections 5 -p sensor.clutter_density:=1e-6", "--false-detections"),
        # Some targets stay in the coverage, the first included.
        ("--speed 10 --scans 21 --interval 10 -p sensor.max_range:=1020.", "coverage"),
    ],
)
def test_what_cannot_be_designed_is_refused_at_once(capsys, arguments, named):
    assert main(["design", *arguments.split()]) == 2
    written = capsys.readouterr()
    assert named in written.err
    assert not written.out


def test_an_angle_that_looks_like_degrees_is_asked_about(capsys):
    given = ["-p", "sensor.azimuth_std:=1.0", "-p", "sensor.max_range:=500.0"]
    assert main(["design", "--speed", "10", *given]) == 2  # refused after the question
    said = capsys.readouterr().err
    assert said.startswith("note: sensor.azimuth_std") and "degrees" in said


QUICK = ["--runs", "20", "--workers", "1", "--scans", "8", "--wanted", "0.01"]


@pytest.mark.long
@pytest.mark.usefixtures("little_clutter")
def test_the_default_clutter_is_never_taken_in_silence(capsys):
    assert main(["design", *QUICK]) == 0
    said = capsys.readouterr().out
    assert "\nthe clutter is not given; with the default, 254 false detections per ping" in said
    assert "\nfeasible" not in said
    assert main(["design", *QUICK, "--false-detections", "20"]) == 0
    said = capsys.readouterr().out
    assert "20 false detections in each" in said
    assert "\nfeasible" in said and "not given" not in said


@pytest.mark.long
@pytest.mark.usefixtures("little_clutter")
def test_a_fast_sonar_gets_its_times_with_digits(capsys, tmp_path):
    """And the time between pings from the file."""
    file = str(tmp_path / "fast.yaml")
    given = ["--yes", "--max-range", "150", "--interval", "0.2", "--false-detections", "20"]
    assert main(["init", file, *given, "--max-speed", "5"]) == 0
    capsys.readouterr()
    assert main(["design", "--params-file", file, *QUICK]) == 0
    said = capsys.readouterr().out
    assert "a ping every 0.2 s" in said
    [score] = [line.split() for line in said.splitlines() if line.startswith("score ")]
    assert 0.2 < float(score[6]) < 1.6 and not float(score[6]).is_integer()


UNKNOWN = IntervalEstimate.unknown()

CASE = PredictionCase(sensor=SensorModel(max_range=1000.0))


def candidate(name: str, low: float, high: float, *, false: IntervalEstimate = UNKNOWN, bound=0.5):
    detection = IntervalEstimate(0.5 * (low + high), low, high)
    targets = PredictionStatistics(100, detection, IntervalEstimate(90.0, 80.0, 100.0), 150.0)
    return PredictedCandidate(name, bound, targets, false)


@pytest.mark.parametrize(
    ("low", "high", "false", "sentence"),
    [
        (0.91, 0.95, UNKNOWN, "feasible: score finds 0.93"),
        (0.85, 0.95, UNKNOWN, "undecided by the runs: score finds 0.90"),
        (0.70, 0.80, UNKNOWN, "infeasible: score finds 0.75"),
        (0.91, 0.95, IntervalEstimate(2.0, 0.9, 4.0), "feasible: score finds 0.93"),
        (
            0.91,
            0.95,
            IntervalEstimate(2.0, 1.1, 4.0),
            "infeasible: every method has more than 1 false",
        ),
    ],
)
def test_verdict_is_by_the_bounds_of_methods_that_keep_the_rate(low, high, false, sentence):
    found = [candidate("score", low, high, false=false)]
    assert design_report.design_verdict(found, 0.9, 1.0).startswith(sentence)


def test_verdict_is_of_the_best_that_keeps_the_rate_and_what_was_not_simulated_is_said():
    found = [candidate("score", 0.95, 0.97, bound=1.5), candidate("tsepm 5/8", 0.5, 0.6)]
    assert design_report.design_verdict(found, 0.9, 1.0).startswith(
        "infeasible: tsepm 5/8 finds 0.55"
    )
    table = design_report.design_candidate_table([candidate("score", 0.7, 0.8)])
    assert table.splitlines()[-1].split()[-1] == "-"
    nothing = FirstPrediction(8, 7.0, np.zeros(8))
    assert "no target is found in time" in design_report.design_first_line(nothing, CASE)


def test_the_case_says_how_strong_the_targets_are():
    given = dataclasses.replace(CASE, ratio_db=12.0)
    lines = design_report.design_case_lines(given, 1.0)
    assert "anywhere in the coverage, 12 dB above the clutter" in lines


def test_of_several_sensors_one_is_named(capsys, tmp_path, monkeypatch):
    def ends(*_: object, **__: object) -> None:
        raise KeyboardInterrupt  # before it simulates

    monkeypatch.setattr(design_report, "first_prediction", ends)
    file = tmp_path / "my_sonars.yaml"
    file.write_text(
        "/**:\n  ros__parameters:\n    sensors: [port, starboard]\n"
        "    port.sensor.max_range: 40.0\n"
    )
    line = ["design", "--params-file", str(file), "--false-detections", "50"]
    assert main(line) == 2
    assert "--sensor must be one of ['port', 'starboard']; got ''" in capsys.readouterr().err
    assert main([*line, "--sensor", "port", "--interval", "0.1"]) == 130
    assert "sonar: 0.005027 km^2" in capsys.readouterr().out
