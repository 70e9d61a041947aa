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
"""The command `tsepm init`, and its questions: what a data sheet says, as parameters."""

import importlib.util
import math
import shlex
import sys
from collections.abc import Iterator

import numpy as np
import pytest
import yaml

from msg_adapters.image_messages import located_image
from tsepm_ros.settings.node_options import ImageLayout
from tsepm_ros.settings.settings import (
    SONAR_DETECTOR,
    TRACK_INITIATOR,
    make_groups,
    options_by_sensor,
)
from tsepm_ros.tools.commands import init_command
from tsepm_ros.tools.commands.cli import main
from tsepm_ros.tools.commands.given_parameters import given_parameters_for
from tsepm_ros.tools.commands.init_command import (
    OF_IMAGES,
    QUESTIONS,
    SHARED,
    init_completed,
    init_parameters,
)
from tsepm_ros.tracker.sensor import Coverage, SensorModel

GIVEN = ["--max-range", "200", "--sector", "120", "--beam-width", "1.5", "--max-speed", "3 m/s"]


@pytest.mark.long
def test_in_a_pipe_defaults_are_taken_and_said(capsys, tmp_path):
    file = tmp_path / "sonar.yaml"
    assert main(["init", str(file), *GIVEN]) == 0
    said = capsys.readouterr().out
    assert "--sound-speed 1500" in said and "--sector 120" not in said
    assert "not given (without a terminal nothing is asked), defaults taken:" in said
    assert "half found in pings" in said
    assert f"--params-file {file}" in said
    text = file.read_text()
    assert text.count("/**:") == 1, "ROS refuses a key that comes twice"
    content = yaml.safe_load(text)
    values = content["/**"]["ros__parameters"]
    make_groups(TRACK_INITIATOR, values)
    assert values["sensor.max_range"] == 200.0 and values["max_speed"] == 3.0


@pytest.fixture
def no_expectation(monkeypatch):
    """Without the simulation of what to expect, which takes seconds."""
    monkeypatch.setattr(init_command, "init_expectation_text", lambda answers, path: "")


@pytest.mark.usefixtures("no_expectation")
def test_the_line_in_the_file_writes_it_again(tmp_path):
    file = tmp_path / "sonar.yaml"
    assert main(["init", str(file), *GIVEN]) == 0
    text = file.read_text()
    program, *line = shlex.split(text.splitlines()[0].removeprefix("# "))
    assert program == "tsepm"
    assert main([*line, "--force"]) == 0
    assert file.read_text() == text


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        *(
            (f"{name}={text}", f"{name} must be ")
            for name, texts in {
                "--max-range": ("2 km", "far", "0", "-5", "1e999"),
                "--sector": ("400", "wide"),
                "--beam-width": ("1,5",),
                "--min-range": ("",),
                "--max-speed": ("nan",),
            }.items()
            for text in texts
        ),
        ("--min-range=9500", "sensor.min_range must be below max_range"),
        ("--range-error=0", "range_std and range_std_fraction"),
    ],
)
def test_what_is_not_allowed_is_refused_and_nothing_written(capsys, tmp_path, arguments, said):
    file = tmp_path / "sonar.yaml"
    assert main(["init", str(file), arguments]) == 2
    assert said in capsys.readouterr().err
    assert not file.exists()


def test_a_file_is_overwritten_only_by_force(capsys, tmp_path):
    file = tmp_path / "sonar.yaml"
    file.write_text("mine")
    assert main(["init", str(file)]) == 2
    assert "--force" in capsys.readouterr().err
    assert file.read_text() == "mine"
    assert main(["init", str(tmp_path / "none" / "sonar.yaml")]) == 2
    assert "no folder" in capsys.readouterr().err
    picture = tmp_path / "[a]_image.png"
    picture.write_text("mine")
    assert main(["init", str(tmp_path / "[a].yaml")]) == 2
    assert f"{picture} exists" in capsys.readouterr().err


@pytest.mark.usefixtures("no_expectation")
def test_the_picture_of_another_sonar_refuses_nothing(tmp_path):
    for other in ("sonar2_image.png", "sonar_port_image.png"):
        (tmp_path / other).write_text("of sonar2.yaml, and of a sensor port")
    assert main(["init", str(tmp_path / "sonar.yaml"), "--yes"]) == 0
    two = [str(tmp_path / "sonar.yaml"), "--yes", "--sensor", "port", "--sensor", "starboard"]
    (tmp_path / "sonar.yaml").unlink()
    assert main(["init", *two]) == 2


def replies(*texts: str) -> Iterator[str]:
    yield from texts


def test_what_is_given_is_not_asked_and_enter_takes_the_default():
    prompts = []

    def ask(prompt: str) -> str:
        prompts.append(prompt)
        if prompt.startswith("Own ship"):
            return "odometry"
        return "500" if prompt.startswith("Range setting") else ""

    answers = init_completed({"sector": 90.0}, ask)
    assert answers == init_completed({"sector": 90.0, "max_range": 500.0, "own_ship": 1.0})
    asked = [one for one in QUESTIONS if one.name not in ("sector", *OF_IMAGES)]
    assert [prompt.partition(" (")[0] for prompt in prompts] == [one.text for one in asked]
    assert all(question.explanation in "".join(prompts) for question in asked)
    init_completed({"images": 1.0}, ask)
    assert sum(prompt.startswith("Image: ") for prompt in prompts) == len(OF_IMAGES)


def test_an_end_of_the_input_is_said():
    def ask(prompt: str) -> str:
        raise EOFError

    with pytest.raises(ValueError, match="no answer to --max-range"):
        init_completed({}, ask)


@pytest.mark.usefixtures("no_expectation")
def test_on_a_terminal_it_asks(tmp_path, monkeypatch):
    file = tmp_path / "sonar.yaml"
    texts = replies("", "300", *[""] * len(QUESTIONS))
    on_a_terminal(monkeypatch, lambda prompt: next(texts))
    assert main(["init", str(file)]) == 0
    assert "sensor.max_range: 300.0" in file.read_text()


def on_a_terminal(monkeypatch, answer):
    monkeypatch.setattr("builtins.input", answer)
    monkeypatch.setattr(sys.stdin, "isatty", lambda: True, raising=False)
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True, raising=False)


@pytest.mark.usefixtures("no_expectation")
def test_of_several_sonars_each_is_asked_about_and_one_file_has_all(capsys, tmp_path, monkeypatch):
    file, asked = tmp_path / "my_sonars.yaml", []
    names = replies("port 2nd", "port starboard")
    given = {
        "Range setting": ("40", ""),
        "Maximum speed": ("3",),
        "Mounting: the sonar turned": ("30", "-30"),
    }
    texts = {begin: replies(*answers) for begin, answers in given.items()}

    def answer(prompt: str) -> str:
        asked.append(prompt)
        if prompt.startswith("Names"):
            return next(names)
        return next((next(one) for begin, one in texts.items() if prompt.startswith(begin)), "")

    on_a_terminal(monkeypatch, answer)
    assert main(["init", str(file)]) == 0
    assert "sensors must be names of letters" in capsys.readouterr().out, "2nd is none"
    assert sum(prompt.startswith("Maximum speed") for prompt in asked) == 1, "it is of all"
    assert [prompt[-6:] for prompt in asked if prompt.startswith("Range setting")][1] == "[40]: "
    values = given_parameters_for(file, "/track_initiator")
    options = make_groups(TRACK_INITIATOR, values)
    models = {name: one[SensorModel] for name, one in options_by_sensor(options).items()}
    assert [one.max_range for one in models.values()] == [40.0, 40.0]
    yaws = [values[f"{name}.mounting.yaw"] for name in ("port", "starboard")]
    assert yaws == pytest.approx([math.radians(30.0), -math.radians(30.0)], abs=1e-5)
    assert values["max_speed"] == 3.0 and values["own_ship_source"] == "none"


@pytest.mark.usefixtures("no_expectation")
def test_an_answer_of_the_command_line_may_be_that_of_one_of_several_sonars(capsys, tmp_path):
    file = tmp_path / "my_sonars.yaml"
    given = ["--sensor", "port", "--sensor", "radar", "--images", "port=yes", "--max-range", "40"]
    given += ["--max-range", "radar=3000", "--sound-speed", "radar=0", "--mounting-yaw", "port=90"]
    given += ["--interval", "radar=2.5", "--own-ship", "odometry"]
    assert main(["init", str(file), "--yes", *given]) == 0
    lines = capsys.readouterr().out.splitlines()[-3:]
    assert lines[1:] == [
        f"  ros2 run tsepm_ros sonar_detector --ros-args -r __ns:=/port --params-file {file} "
        "-r image:=YOUR_TOPIC -r own_ship/odometry:=YOUR_ODOMETRY",
        f"  ros2 run tsepm_ros track_initiator --ros-args --params-file {file} "
        "-r radar/detections:=YOUR_TOPIC -r own_ship/odometry:=YOUR_ODOMETRY",
    ]
    detector = given_parameters_for(file, "/boat/port/sonar_detector")
    make_groups(SONAR_DETECTOR, detector)
    assert (detector["tracker_sensor"], detector["mounting.yaw"]) == ("port", 1.5708)
    values = given_parameters_for(file, "/track_initiator")
    by_sensor = options_by_sensor(make_groups(TRACK_INITIATOR, values))
    assert by_sensor["radar"][SensorModel].max_range == 3000.0
    assert by_sensor["port"][SensorModel].max_range == 40.0
    assert values["radar.sound_speed"] == 0.0
    assert "port.diagnostics.scan_period" not in values
    assert (values["radar.diagnostics.scan_period"], values["diagnostics.stale_time"]) == (
        2.5,
        12.5,
    )
    text = file.read_text()
    _, *line = shlex.split(text.splitlines()[0].removeprefix("# "))
    assert main([*line, "--force"]) == 0
    assert file.read_text() == text


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--max-range", "port=40"], "--max-range port=40: port is no --sensor"),
        (["--sensor", "a", "--max-speed", "a=4"], "it is of the picture as a whole; give it alone"),
        (["--sensor", "a", "--sensor", "a"], "sensors must be at most 32 different names"),
    ],
)
def test_names_that_do_not_fit_are_refused(capsys, tmp_path, arguments, said):
    assert main(["init", str(tmp_path / "a.yaml"), "--yes", *arguments]) == 2
    assert said in capsys.readouterr().err


def written_by(path, *arguments: str) -> dict[str, object]:
    assert main(["init", str(path), "--yes", "--max-range", "150", *arguments]) == 0
    return yaml.safe_load(path.read_text())["/**"]["ros__parameters"]


@pytest.mark.long
def test_with_an_extent_echoes_lie_apart_by_their_errors_too(tmp_path):
    given = ("--extent", "3", "--bearing-accuracy", "1", "--range-accuracy", "0.5")
    values = written_by(tmp_path / "a.yaml", *given)
    assert values["target_extent"] == 3.0
    assert values["sensor.azimuth_resolution"] == pytest.approx(np.radians(12**0.5))
    assert values["sensor.range_resolution"] == pytest.approx(0.5 * 12**0.5)
    stated = written_by(tmp_path / "c.yaml", *given, "--beam-width", "2", "--range-cell", "0.4")
    assert stated["sensor.azimuth_resolution"] == pytest.approx(np.radians(2.0))
    assert stated["sensor.range_resolution"] == pytest.approx(0.4)


@pytest.mark.usefixtures("no_expectation")
def test_for_images_one_file_has_both_nodes_with_one_coverage(capsys, tmp_path):
    path, out = tmp_path / "sonar.yaml", tmp_path / "recording.yaml"
    given = ["--images", "yes", "--max-range", "40", "--sector", "130", "--min-range", "0.5"]
    assert main(["init", str(path), "--yes", *given]) == 0
    said = capsys.readouterr().out
    assert f"sonar_detector --ros-args --params-file {path} -r image:=YOUR_TOPIC\n" in said
    assert f"track_initiator --ros-args --params-file {path}\n" in said
    detector = given_parameters_for(path, "/boat/sonar_detector")
    tracker = given_parameters_for(path, "/track_initiator")
    make_groups(SONAR_DETECTOR, detector)
    make_groups(TRACK_INITIATOR, tracker)
    shared, own = (
        {name: v for name, v in values.items() if name.startswith(SHARED)}
        for values in (tracker, detector)
    )
    assert shared == own and len(own) >= 4
    assert tracker["sensor.max_range"] == 40.0
    assert "sensor.max_range" not in detector, "images reach as far as the driver's range setting"
    assert detector["false_detections_per_ping"] == 5.0
    assert "start_standing" not in tracker
    assert tracker["sensor.clutter_density"] == pytest.approx(5.0 / (0.5 * 40.0**2 * 2.2689), 0.01)
    assert main(["init", str(out), "--yes", *given, "--false-detections", "1e5"]) == 2
    assert "false_detections_per_ping" in capsys.readouterr().err
    assert main(["init", str(out), "--yes", *given, "--standing", "yes"]) == 0
    assert given_parameters_for(out, "/track_initiator")["start_standing"] == "on"


@pytest.mark.usefixtures("no_expectation")
@pytest.mark.parametrize("near_row", ["last", "first"])
def test_an_image_has_the_ranges_of_its_own_rows_and_a_picture_to_compare(
    capsys, tmp_path, near_row
):
    path = tmp_path / "sonar.yaml"
    given = ["--images", "yes", "--max-range", "30", "--sector", "120", "--min-range", "0.5"]
    given += ["--near-range", "0.05", "--far-range", "29.95", "--near-row", near_row]
    given += ["--first-column", "starboard"]
    assert main(["init", str(path), "--yes", *given]) == 0
    groups = make_groups(SONAR_DETECTOR, given_parameters_for(path, "/sonar_detector"))
    layout, limits = groups[ImageLayout], groups[Coverage]
    assert (layout.near_range, layout.far_range, limits.min_range) == (0.05, 29.95, 0.5)
    sector = (limits.azimuth_min, limits.azimuth_max)
    shown = np.zeros((300, 60))
    shown[20 if near_row == "last" else 279, 50] = 1.0  # far, to port
    range_, azimuth, read = located_image(shown, layout, (0.05, 29.95), sector)
    beam, cell = np.argwhere(read)[0]
    assert range_[cell] == pytest.approx(27.95)
    assert azimuth[beam] == pytest.approx(math.radians(-60.0 + 2.0 * 50.5), abs=1e-5)
    if importlib.util.find_spec("matplotlib"):
        assert f"picture: {tmp_path / 'sonar_image.png'}; compare" in capsys.readouterr().out
        assert (tmp_path / "sonar_image.png").stat().st_size > 10_000
        path.unlink()
        assert main(["init", str(path), "--yes", *given]) == 2, "the picture may be another's"


@pytest.mark.usefixtures("no_expectation")
def test_ranges_of_rows_are_both_given_or_neither_and_are_never_guessed(capsys, tmp_path):
    for near, far in (("0.05", "-1"), ("-1", "30"), ("30", "0.05")):
        given = ["--images", "yes", "--near-range", near, "--far-range", far]
        assert main(["init", str(tmp_path / "a.yaml"), "--yes", *given]) == 2
        assert "--near-range and, above it, --far-range" in capsys.readouterr().err
    given = ["--images", "yes", "--near-range", "5", "--far-range", "3997", "--max-range", "40"]
    assert main(["init", str(tmp_path / "a.yaml"), "--yes", *given]) == 2
    assert "give all in metres" in capsys.readouterr().err
    assert main(["init", str(tmp_path / "a.yaml"), "--yes", "--images", "yes"]) == 0
    assert given_parameters_for(tmp_path / "a.yaml", "/sonar_detector")["image.far_range"] == -1.0
    assert not list(tmp_path.glob("*.png"))


@pytest.mark.usefixtures("no_expectation")
def test_own_ship_and_mounting_are_written(capsys, tmp_path):
    given = ["--own-ship", "odometry", "--mounting-x", "2", "--mounting-yaw", "90 degrees"]
    values = written_by(tmp_path / "a.yaml", *given)
    assert (values["own_ship_source"], values["mounting.x"]) == ("odometry", 2.0)
    assert values["mounting.yaw"] == pytest.approx(1.5708, abs=1e-4)
    assert "-r own_ship/odometry:=YOUR_ODOMETRY" in capsys.readouterr().out
    assert main(["init", str(tmp_path / "b.yaml"), "--yes", "--own-ship", "gps"]) == 2
    assert "--own-ship must be one of none, odometry, tf; got 'gps'" in capsys.readouterr().err


def test_false_detections_and_the_time_between_pings_are_written(capsys, tmp_path, monkeypatch):
    values = written_by(tmp_path / "a.yaml", "--false-detections", "20")
    assert values["sensor.clutter_density"] == pytest.approx(20 / (np.pi * 150**2), rel=1e-5)
    assert values["clutter_density"] == "estimated"
    said = capsys.readouterr().out
    assert "\n20 " in said and "YOURS" not in said
    monkeypatch.setattr(init_command, "init_expectation_text", lambda answers, path: "")
    plain = written_by(tmp_path / "b.yaml")
    assert not {"sensor.clutter_density", "diagnostics.scan_period"} & plain.keys()
    values = written_by(tmp_path / "c.yaml", "--interval", "0.2")
    assert (values["diagnostics.scan_period"], values["diagnostics.stale_time"]) == (0.2, 5.0)
    assert written_by(tmp_path / "d.yaml", "--interval", "30")["diagnostics.stale_time"] == 150.0


BY_NAME = {question.name: question for question in QUESTIONS}


def sensor(**given: float) -> SensorModel:
    made: SensorModel = make_groups(TRACK_INITIATOR, init_parameters(init_completed(given)))[
        SensorModel
    ]
    return made


def test_what_moves_at_half_the_speed_of_the_slowest_targets_is_a_fixed_echo():
    values = init_parameters(init_completed({"slowest_speed": 0.6, "max_speed": 0.4}))
    assert values["min_speed"] == 0.3
    assert "min_speed" not in init_parameters(init_completed({}))
    with pytest.raises(ValueError, match=r"min_speed must be below max_speed; got 0\.3 and 0\.25"):
        init_parameters(init_completed({"slowest_speed": 0.6, "max_speed": 0.25}))


def test_widths_of_beam_and_cell_are_uniform_and_a_sector_lies_about_its_middle():
    made = sensor(beam_width=2.0, range_cell=0.5)
    assert made.azimuth_resolution == pytest.approx(math.radians(2.0), rel=1e-5)
    assert made.azimuth_std == pytest.approx(math.radians(2.0) / math.sqrt(12.0), rel=1e-2)
    assert made.range_resolution == 0.5
    assert made.range_std == pytest.approx(0.5 / math.sqrt(12.0), rel=1e-2)
    assert sensor(beam_width=2.0, bearing_accuracy=0.1).azimuth_std == pytest.approx(
        math.radians(0.1), rel=1e-5
    )
    made = sensor(sector=120.0, sector_centre=-30.0)
    assert math.degrees(made.azimuth_min) == pytest.approx(-90.0, abs=1e-3)
    assert math.degrees(made.azimuth_max) == pytest.approx(30.0, abs=1e-3)
    assert sensor(sector=360.0, sector_centre=90.0).all_round


@pytest.mark.parametrize(
    ("range_", "speed", "interval"),
    [(9000.0, 1500.0, 12.0), (200.0, 1500.0, 0.27), (750.0, 1500.0, 1.0), (100.0, 0.0, 12.0)],
)
def test_pings_follow_each_other_as_sound_allows(range_, speed, interval):
    answers = init_completed({"max_range": range_, "sound_speed": speed})
    assert answers["interval"] == pytest.approx(interval)


@pytest.mark.parametrize(
    ("name", "text", "value"),
    [
        ("max_range", " 200 m ", 200.0),
        ("sector", "90°", 90.0),
        ("beam_width", "1.5 deg", 1.5),
        ("range_error", ".5%", 0.5),
        ("sound_speed", "1.48e3", 1480.0),
    ],
)
def test_an_answer_may_have_its_unit(name, text, value):
    assert BY_NAME[name].read(text) == value
