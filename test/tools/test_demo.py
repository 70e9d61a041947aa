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
"""The demonstration: two processes, a table, a picture and an honest exit code."""

import signal
import subprocess
import sys

import pytest
from support.patience import WAIT, patient

from tsepm_ros.tools.demo import main

PNG = b"\x89PNG\r\n\x1a\n"


def run(*arguments):
    command = [sys.executable, *arguments]
    return subprocess.run(
        command, capture_output=True, text=True, timeout=patient(10.0), check=False
    )


def demo(*arguments):
    return run("-m", "tsepm_ros.tools.demo", *arguments)


@pytest.mark.long
def test_the_demo_starts_every_target_and_draws_it(tmp_path):
    picture = tmp_path / "demo.png"
    patience = ("--parameter", f"own_ship_timeout:={WAIT}")
    named = ("-p", "clutter_density:=estimated")
    done = demo("--rate", "300", "--picture", str(picture), *patience, *named)
    assert done.returncode == 0, done.stderr
    assert "4 of 4 targets in " in done.stdout
    assert "ping" not in done.stderr, "no progress in a pipe"
    assert "remap" not in done.stderr, "a parameter is no remapping of the demo's own node"
    assert picture.read_bytes().startswith(PNG)


@pytest.mark.long
def test_a_target_that_is_not_started_fails_the_demo(tmp_path):
    scenario = tmp_path / "deaf.yaml"
    scenario.write_text(
        "scans: 6\nperiod: 2.0\nsensor: {clutter_density: 1.0e-9, detection_probability: 1.0e-6}\n"
        "targets: [{state: [3000.0, 1.0, 3000.0, 0.0]}]\n"
    )
    arguments = ("--scenario", str(scenario), "--rate", "100")
    done = demo(*arguments, "--picture", str(tmp_path / "demo.png"))
    assert done.returncode == 1
    assert "1 of 1 targets were not truly started" in done.stderr


@pytest.mark.long
@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("-p", "max_sped:=4.0"), "max_sped is not a parameter; did you mean max_speed?\n"),
        (("--scenario", "radar_and_sonar"), "--scenario radar_and_sonar has several sensors: run "),
    ],
)
def test_a_refused_argument_fails_the_demo_at_once(tmp_path, arguments, said):
    done = demo(*arguments, "--picture", str(tmp_path / "demo.png"))
    assert done.returncode == 2
    assert done.stderr.startswith(f"refused: {said}")


@pytest.mark.long
def test_a_parameter_file_without_a_fitting_namespace_holds_for_the_demo(tmp_path):
    """The nodes of the demo have a namespace of their own."""
    file, picture = tmp_path / "own.yaml", tmp_path / "demo.png"
    file.write_text("track_initiator: {ros__parameters: {sensor: {max_range: 1000.0}}}\n")
    done = demo("--params-file", str(file), "--rate", "1000", "--picture", str(picture))
    assert "not used" not in done.stderr and "differ" not in done.stderr
    assert "0 of 4 targets" in done.stdout


INTERRUPTED = """
import os, signal, subprocess, sys
from tsepm_ros.tools.demo import main

class Popen(subprocess.Popen):
    started = []

    def __init__(self, *arguments):
        super().__init__(*arguments)
        self.started.append(self)
        if len(self.started) == {started}:
            os.kill(os.getpid(), signal.{signal})

subprocess.Popen = Popen
code = 0
try:
    code = main(["--picture", {picture!r}])
finally:
    print(*(process.poll() for process in Popen.started))
sys.exit(code)
"""


@pytest.mark.long
@pytest.mark.parametrize(
    ("number", "code", "said", "started"),
    [
        pytest.param(signal.SIGTERM, 143, "", 1, id="SIGTERM"),
        pytest.param(signal.SIGINT, 130, "interrupted\n", 2, id="SIGINT"),
    ],
)
def test_a_signal_ends_the_demo_and_its_nodes(tmp_path, number, code, said, started):
    """While its first or second node starts; nobody else tells the nodes to end."""
    script = INTERRUPTED.format(
        started=started, signal=number.name, picture=str(tmp_path / "a.png")
    )
    done = run("-c", script)
    assert (done.returncode, done.stderr) == (code, said)
    assert len(done.stdout.split()) == started and "None" not in done.stdout


def test_an_unknown_scenario_is_refused(capsys):
    assert main(["--scenario", "nowhere"]) == 2
    assert "refused: scenario" in capsys.readouterr().err


def test_a_picture_of_others_is_not_replaced(tmp_path, capsys):
    picture = tmp_path / "mine.png"
    picture.write_bytes(PNG + b" a photograph")
    assert main(["--picture", str(picture)]) == 2
    assert "mine.png is not known as a result of tsepm" in capsys.readouterr().err
