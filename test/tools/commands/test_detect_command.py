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
"""The command `tsepm detect`: folders of images in, detections and a picture out."""

import argparse
from contextlib import ExitStack

import numpy as np
import pytest

from tsepm_ros.tools.commands.cli import main
from tsepm_ros.tools.commands.run_command import add_run_source_arguments, open_run
from tsepm_ros.tools.replay.recording import read_recording


def test_detections_and_a_picture_are_written(folder, capsys):
    pytest.importorskip("matplotlib")
    out, picture = folder / "out.csv", folder / "picture.png"
    assert main(["detect", str(folder), "--out", str(out), "--picture", str(picture)]) == 0
    recording = read_recording(out)
    assert len(recording.scans) == 12
    strongest = [
        scan.fields["range"][np.argmax(scan.fields["intensity"])] for scan in recording.scans
    ]
    assert strongest == pytest.approx(11.1 + 0.2 * np.arange(12), abs=0.15)
    assert picture.stat().st_size > 10_000
    said = capsys.readouterr().err
    assert "images 12, empty 0" in said and f"picture: {picture}, of the image at 11 s" in said


def test_run_takes_the_folder_with_the_coverage_of_its_images_unless_another_is_given(
    folder, capsys
):
    assert main(["run", str(folder), "-p", "max_speed:=2.0"]) == 0
    assert len(capsys.readouterr().out.splitlines()) > 1
    parser = argparse.ArgumentParser()
    add_run_source_arguments(parser)
    options = parser.parse_args([str(folder), "-p", "sensor.max_range:=15.0"])
    with ExitStack() as stack:
        sensor = open_run(options, stack).session.settings.sensor
    assert (sensor.min_range, sensor.max_range) == pytest.approx((0.95, 15.0))
    assert (sensor.azimuth_min, sensor.azimuth_max) == pytest.approx((-1.016, 1.016), abs=1e-3)


def test_detections_beside_the_images_are_read_in_their_place_and_this_is_said(folder, capsys):
    assert main(["run", str(folder), "-p", "max_speed:=2.0"]) == 0
    said = "detections.csv is read in place of the images"
    assert said not in capsys.readouterr().err
    assert main(["detect", str(folder), "--out", str(folder / "detections.csv")]) == 0
    assert main(["run", str(folder), "-p", "max_speed:=2.0"]) == 0
    assert said in capsys.readouterr().err


def test_one_file_has_the_parameters_of_both_nodes_for_a_folder(folder):
    file = folder / "sonar.yaml"
    file.write_text(
        "/**/sonar_detector:\n  ros__parameters: {sensor.max_range: 9.0, image.near_first: false}\n"
        "/**/track_initiator:\n  ros__parameters: {max_speed: 2.0}\n"
    )
    parser = argparse.ArgumentParser()
    add_run_source_arguments(parser)
    shared = ["-p", "false_detections_per_ping:=50.0"]  # is the detector's alone
    options = parser.parse_args([str(folder), "--params-file", str(file), *shared])
    with ExitStack() as stack:
        run = open_run(options, stack)
    assert (run.session.settings.sensor.max_range, run.session.settings.common.max_speed) == (9, 2)
    assert np.mean([len(scan.fields["range"]) for scan in run.streams[0][0].scans]) > 20.0
    assert any("no use is made of image.near_first" in note for note in run.notes)
