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
"""The commands `tsepm run` and `tsepm watch`: sources, tracks, pages, and causes of losses."""

import base64
import csv
import gzip
import io
import json
import math
import os
import re
import signal
import socket
import subprocess
import sys
import time
import urllib.request
from pathlib import Path

import numpy as np
import pynmea2
import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from support.bag_files import (
    ODOMETRY,
    PARAMETERS,
    POINTS,
    Entry,
    cloud,
    header,
    odometry,
    write_bag,
)
from support.patience import WAIT

from tsepm_ros import make_initiator
from tsepm_ros.settings.node_options import gate_lines
from tsepm_ros.tools.commands.cli import main
from tsepm_ros.tools.evaluation.simulated_run import SimulatedOperatingPoint, simulate_run
from tsepm_ros.tools.replay.bag import Bag
from tsepm_ros.tools.simulation import load_scenario
from tsepm_ros.tools.viewer.gates import HEAD, GateCounter
from tsepm_ros.tools.viewer.live_frames import TRACKS, LiveFrames


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_a_recording_gives_tracks_as_csv_and_a_terminal_a_table(capsys, recording, monkeypatch):
    assert main(["run", recording]) == 0
    captured = capsys.readouterr()
    (row,) = csv.DictReader(io.StringIO(captured.out))
    assert float(row["stamp"]) == 24.0
    assert float(row["state_vx"]) == pytest.approx(5.0, rel=1e-3)
    assert float(row["state_y"]) == pytest.approx(3000.0, rel=1e-3)
    assert "3 hits in 3 pings" in row["reason"] and "threshold" in row["reason"]
    assert captured.err == ""
    assert main(["run", recording]) == 0
    (row,) = csv.DictReader(io.StringIO(capsys.readouterr().out))
    terminal = Terminal()
    monkeypatch.setattr(sys, "stdout", terminal)
    assert main(["run", recording]) == 0
    heading, line = terminal.getvalue().splitlines()
    assert " ".join(heading.split()) == "time [s] id x [m] y [m] speed [m/s] direction [deg] reason"
    values = line.split()
    assert values[:2] == ["24.000", row["track_id"]]
    assert [float(value) for value in values[2:5]] == pytest.approx(
        [float(row["state_x"]), float(row["state_y"]), 5.0], abs=0.06
    )
    assert line.endswith(row["reason"])


@pytest.mark.parametrize(
    ("row", "said"),
    [
        ("90.0,-1.0,0.0", "dropped: 1 range_not_positive"),
        ("9000.0,3000.0,0.0", "note: long gap before 9000.000 s"),
    ],
)
def test_what_a_recording_loses_or_lacks_is_said(capsys, recording, tmp_path, row, said):
    path = tmp_path / "detections.csv"
    path.write_text(path.read_text() + f"\n{row}\n")
    assert main(["run", recording]) == 0
    assert said in capsys.readouterr().err


@pytest.mark.parametrize("content", ["rosbag2: [\n", "a: 'b\n\nc\n" * 200], ids=["list", "long"])
def test_an_error_of_many_lines_is_said_in_one(capsys, tmp_path, content):
    pytest.importorskip("rosbags")
    (tmp_path / "metadata.yaml").write_text(content)
    assert main(["run", str(tmp_path)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("refused: ") and "metadata.yaml is no metadata of a bag" in line
    assert len(line) < 900


def test_stamps_beyond_ros_times_are_one_sentence_and_leave_no_file(capsys, recording, tmp_path):
    path = tmp_path / "detections.csv"
    rows = path.read_text().splitlines()
    shifted = [f"{1.7e12 + 12 * k},{row.partition(',')[2]}" for k, row in enumerate(rows[1:])]
    path.write_text("\n".join([rows[0], *shifted]))
    out = tmp_path / "out"
    assert main(["run", recording, "--out", str(out)]) == 2
    *notes, sentence = capsys.readouterr().err.splitlines()
    assert len(notes) <= 1 and all(line.startswith("no picture: it needs") for line in notes)
    assert "32-bit seconds" in sentence and "milliseconds" in sentence
    assert not out.exists()
    assert main(["run", recording]) == 2


@pytest.mark.long
def test_a_run_that_is_killed_leaves_no_half_file_and_the_next_cleans_up(scenario, tmp_path):
    pytest.importorskip("rosbags")
    out = tmp_path / "out"
    script = (
        "import os, signal, sys\n"
        "from tsepm_ros.tools.commands.cli import main\n"
        "from tsepm_ros.session.session import Session\n"
        "before = Session.process\n"
        "def process(self, *args, **options):\n"
        "    for number, result in enumerate(before(self, *args, **options)):\n"
        "        if result.scan.stamp > 50: os.kill(os.getpid(), signal.{0})\n"
        "        yield result\n"
        "Session.process = process\n"
        "sys.exit(main(sys.argv[1:]))\n"
    )
    arguments = ["run", scenario, "--out", str(out)]
    for number, code, left in ((signal.SIGKILL, -9, 3), (signal.SIGTERM, 143, 0)):
        command = [sys.executable, "-c", script.format(number.name), *arguments]
        assert subprocess.run(command, capture_output=True).returncode == code
        assert not [name for name in os.listdir(out) if not name.startswith(".")]
        assert len(os.listdir(out)) == left
    assert main(arguments) == 0
    names = sorted(os.listdir(out))
    assert [name for name in names if name != "picture.png"] == [
        "current.csv",
        "tracks.csv",
        "tracks.mcap",
        "truth.csv",
    ]


def test_a_scenario_is_simulated_with_its_own_sensor_and_a_seed(capsys, scenario):
    outs = []
    for seed in ("1", "1", "2"):
        assert main(["run", scenario, "--seed", seed]) == 0
        outs.append(capsys.readouterr().out)
    assert outs[0] == outs[1] != outs[2]
    row = next(csv.DictReader(io.StringIO(outs[0])))
    # With the default sensor (1.5 %, 1 degree) it would be 25 m and more.
    assert np.sqrt(float(row["cov_00"])) < 15.0
    time = float(row["stamp"])
    assert float(row["state_x"]) == pytest.approx(1500.0 + 4.0 * time, abs=40.0)


def test_a_folder_gets_tracks_and_without_rosbags_no_mcap_but_a_sentence(
    capsys, recording, tmp_path, monkeypatch
):
    assert main(["run", recording]) == 0
    expected = capsys.readouterr().out
    out = tmp_path / "out"
    assert main(["run", recording, "--out", str(out)]) == 0
    assert (out / "tracks.csv").read_text() == expected
    assert "8 scans, 1 confirmed tracks; 84.0 s in" in capsys.readouterr().out
    monkeypatch.setitem(sys.modules, "rosbags.rosbag2", None)
    assert main(["run", recording, "--out", str(tmp_path / "other")]) == 0
    assert "no tracks.mcap: it needs rosbags" in capsys.readouterr().err
    assert not (tmp_path / "other" / "tracks.mcap").exists()
    assert (tmp_path / "other" / "tracks.csv").exists()


@pytest.mark.parametrize("form", ["geojson", "nmea", "signalk"])
def test_a_run_replaces_its_own_results_and_no_file_of_others(capsys, recording, tmp_path, form):
    pytest.importorskip("matplotlib")
    out = tmp_path / "out"
    arguments = ["run", recording, "--as", form, "--origin", "59.65,10.63", "--out", str(out)]
    arguments += ["--html", str(tmp_path / "page.html"), "--picture", str(tmp_path / "plan.svg")]
    assert main(arguments) == 0
    assert main(arguments) == 0, "each is known as a result"
    results = [*out.iterdir(), tmp_path / "page.html", tmp_path / "plan.svg"]
    assert out / f"tracks.{form}" in results
    for path in results:
        content = path.read_bytes()
        path.write_text("an evening's work")
        capsys.readouterr()
        assert main(arguments) == 2
        assert f"{path} is not known as a result of tsepm" in capsys.readouterr().err
        assert path.read_text() == "an evening's work"
        path.write_bytes(content)


def test_a_suffix_that_is_no_picture_s_costs_no_other_output(capsys, recording, tmp_path):
    pytest.importorskip("matplotlib")
    page, picture = tmp_path / "page.html", tmp_path / "plan.xyz"
    assert main(["run", recording, "--html", str(page), "--picture", str(picture)]) == 2
    assert "'xyz' is not supported" in capsys.readouterr().err
    assert page.stat().st_size > 1000 and not picture.exists()


@pytest.mark.parametrize("option", ["--out", "--html", "--picture"])
def test_a_folder_that_does_not_exist_is_named_and_not_made(capsys, recording, tmp_path, option):
    path = tmp_path / "tracsk" / "run.gif"
    with pytest.raises(SystemExit):
        main(["run", recording, option, str(path)])
    assert f"argument {option}: the folder {path.parent} does not exist" in capsys.readouterr().err
    assert not path.parent.exists()


@pytest.mark.long
@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_a_full_disk_is_told_with_the_file(recording, tmp_path, unbuffered):
    """A limit on the size of files stands for the disk, as /dev/full does for an output."""
    script = (
        "import resource, signal, sys\n"
        "from tsepm_ros.tools.commands.cli import main\n"
        "signal.signal(signal.SIGXFSZ, signal.SIG_IGN)\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, ({0}, {0}))\n"
        "sys.exit(main(sys.argv[1:]))\n"
    )
    out = tmp_path / "out"
    # A measurement of coverage writes files of its own.
    environment = {name: one for name, one in os.environ.items() if not name.startswith("COV")}
    environment["PYTHONUNBUFFERED"] = unbuffered
    environment["PYTHONDONTWRITEBYTECODE"] = "1"  # a module would be cut off, and stay so
    for size, arguments, output, path in (
        (4096, ["--out", str(out)], os.devnull, out),
        (10**9, [], "/dev/full", "standard output"),
    ):
        command = [sys.executable, "-c", script.format(size), "run", recording, *arguments]
        with open(output, "w") as file:
            done = subprocess.run(command, stdout=file, stderr=-1, text=True, env=environment)
        assert done.returncode == 1
        last = done.stderr.splitlines()[-1]
        assert last.startswith(f"failed: {path}") and "Errno" not in last


def test_the_time_of_a_run_is_that_of_its_stamps_not_of_the_recorder(capsys, tmp_path):
    bag_files = pytest.importorskip("support.bag_files")
    entries = [
        entry._replace(time=5e5 + 1.5 * entry.time)  # recorded from a slow playback
        for entry in bag_files.simulated()
    ]
    path = str(bag_files.write_bag(tmp_path / "bag", entries))
    assert main(["run", path, "--out", str(tmp_path / "out")]) == 0
    assert "10 scans, " in (printed := capsys.readouterr().out) and "; 36.0 s in" in printed


def test_the_mcap_holds_every_scans_new_and_confirmed_tracks_and_is_the_same_to_the_bit(
    recording, tmp_path
):
    pytest.importorskip("rosbags")
    for folder in ("one", "other"):
        assert main(["run", recording, "--out", str(tmp_path / folder)]) == 0
    data = (tmp_path / "one" / "tracks.mcap").read_bytes()
    assert (tmp_path / "other" / "tracks.mcap").read_bytes() == data
    assert b"relative_file_paths" in data
    assert b".part" not in data
    assert not list((tmp_path / "one").glob(".*"))
    from msg_adapters import read_track_cloud, time_to_ns
    from tsepm_ros.tools.replay.bag import Bag

    with Bag(tmp_path / "one" / "tracks.mcap") as bag:
        heard = {
            topic: [bag.read(message) for message in bag.messages([topic])] for topic in bag.topics
        }
    assert set(heard) == {"/tracks", "/tracks/current", "/fixed_echoes"}
    for clouds in heard.values():
        stamps = [time_to_ns(cloud.header.stamp) for cloud in clouds]
        assert stamps == [12 * 10**9 * k for k in range(8)]
    assert [cloud.width for cloud in heard["/tracks"]] == [0, 0, 1, 0, 0, 0, 0, 0]
    assert [cloud.width for cloud in heard["/tracks/current"]] == [0, 0, 1, 1, 1, 1, 1, 1]
    assert [cloud.width for cloud in heard["/fixed_echoes"]] == [0] * 8
    with (tmp_path / "one" / "tracks.csv").open() as file:
        (row,) = csv.DictReader(file)
    (point,) = read_track_cloud(heard["/tracks"][2])
    for name in (
        *("state_x", "state_vy", "cov_01", "score", "age", "hit_count"),
        *("stationary_probability", "signal_to_clutter_db", "revision"),
    ):
        np.testing.assert_array_equal(float(row[name]), point[name])
    assert not list(tmp_path.glob("one/tmp*"))


def crossing_scene(folder: Path) -> None:
    """Twelve swimmers at 1 m/s: six cross northwards, four southwards, two turn back on the line.

    One of the six is not detected for 11 s, on both sides of the line.
    """
    rng = np.random.default_rng(5)
    rows = ["time_s,range_m,azimuth_rad"]
    for second in range(61):
        for lane in range(12):
            northward = second - 30.0 if lane < 6 else 30.0 - second
            north = northward if lane < 10 else -abs(northward)
            x, y = rng.normal((9.0 * lane - 54.0, 100.0 + north), 0.3)
            if rng.uniform() < 0.97 and not (lane == 5 and 25 <= second <= 35):
                rows.append(f"{second},{math.hypot(x, y):.4f},{math.atan2(y, x):.6f}")
    (folder / "detections.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")


@pytest.mark.parametrize(
    ("frame", "gate"), [("recording", "-70,100,70,100"), ("map_ned", "-70,-100,70,-100")]
)
def test_ten_cross_a_gate_once_offline_and_live(tmp_path, capsys, frame, gate):
    """In a frame `..._ned` the same line has y to starboard, and its left side is the same."""
    pytest.importorskip("rosbags")
    crossing_scene(tmp_path)
    out = tmp_path / "out"
    sensor = {"range_std": 0.3, "range_std_fraction": 0.0, "azimuth_std": 0.003, "max_range": 300.0}
    given = [f"sensor.{name}:={value}" for name, value in sensor.items()] + ["max_speed:=4.0"]
    given += [f"fixed_frame:={frame}", "mounting.x:=1e-6"]
    arguments = ["run", str(tmp_path), "--out", str(out), f"--gate={gate}"]
    assert main([*arguments, *(word for one in given for word in ("-p", one))]) == 0
    assert f"gate {gate}: 6 to the left, 4 to the right" in capsys.readouterr().err
    head, *offline = (out / "crossings.csv").read_text(encoding="utf-8").splitlines()
    assert head == HEAD and len({line.split(",")[1] for line in offline}) == 10
    with (out / "current.csv").open(encoding="utf-8") as file:
        places = {
            f"{float(row['stamp']):.3f},{row['track_id']}": [
                f"{float(row[f'state_{axis}']):.2f}" for axis in "xy"
            ]
            for row in csv.DictReader(file)
        }
    for line in offline:
        stamp, track_id, *_, x, y = line.split(",")
        assert places[f"{stamp},{track_id}"] == [x, y]
    frames, counter, live = LiveFrames(lambda topic, error: None), GateCounter(gate_lines(gate)), []
    with Bag(out / "tracks.mcap") as bag:
        for message in bag.messages(["/tracks/current"]):
            frames.take(TRACKS, bag.read(message))
            for shown, _, observed in frames.take_frames():
                live += counter.observe(observed.stamp, observed.tracks, shown["frame_id"])
    assert live == offline and counter.counts == [[6, 4]]


def test_another_run_leaves_no_truth_of_the_one_before_in_its_folder_but_what_was_exported(
    tmp_path,
):
    pytest.importorskip("pyproj")
    crossing_scene(tmp_path)
    out = tmp_path / "out"
    exported = ["--as", "geojson", "--origin=-33.9,151.2"]
    assert main(["run", "box", "--out", str(out), "--gate=0,0,1,0", *exported]) == 0
    assert {"truth.csv", "crossings.csv", "tracks.csv"} < {path.name for path in out.iterdir()}
    (out / "notes.txt").write_text("mine", encoding="utf-8")
    assert main(["run", str(tmp_path), "--out", str(out)]) == 0
    left = {path.name for path in out.iterdir()}
    assert not {"truth.csv", "crossings.csv"} & left
    assert {"tracks.csv", "current.csv", "notes.txt", "tracks.geojson"} <= left


def test_a_gate_without_two_ends_is_refused(recording, capsys):
    assert main(["run", recording, "--gate=1,2,3"]) != 0
    assert "gates must be x1,y1,x2,y2 with different ends" in capsys.readouterr().err


def test_a_bag_is_run_by_the_names_of_its_topics(capsys, tmp_path):
    bag_files = pytest.importorskip("support.bag_files")
    entries = bag_files.simulated(namespace="/a") + bag_files.simulated(namespace="/b", seed=9)
    path = str(bag_files.write_bag(tmp_path / "bag", sorted(entries, key=lambda e: e.time)))
    given = [part for one in bag_files.PARAMETERS for part in ("-p", one)]
    assert main(["run", path, *given]) == 2
    error = capsys.readouterr().err
    assert "several topics for detections: /a/detections, /b/detections" in error
    assert "--detections" in error
    outs = []
    for name in ("a", "b"):
        topics = ["--detections", f"/{name}/detections", "--odometry", f"{name}/own_ship/odometry"]
        assert main(["run", path, *topics, *given]) == 0
        outs.append(capsys.readouterr().out)
    assert outs[0] != outs[1]
    assert len(outs[0].splitlines()) > 2


def test_topics_of_several_sensors_in_a_bag_make_one_picture(capsys, tmp_path):
    bag_files = pytest.importorskip("support.bag_files")
    entries = bag_files.simulated(namespace="/port")
    later = [
        one
        for one in bag_files.simulated(seed=9, start=1004.0)
        if one.type_name == bag_files.POINTS
    ]
    given = [part for one in bag_files.PARAMETERS for part in ("-p", one)]
    given += ["--params-file", str(tmp_path / "picture.yaml")]
    (tmp_path / "picture.yaml").write_text("/**: {ros__parameters: {sensors: [port, starboard]}}\n")
    found = []
    for name, topics in (("starboard", []), ("right", ["--detections", "starboard=/right"])):
        topic = f"/{name}/detections" if name == "starboard" else "/right"
        both = [*entries, *(one._replace(topic=topic) for one in later)]
        path = bag_files.write_bag(tmp_path / name, sorted(both, key=lambda one: one.time))
        assert main(["run", str(path), *topics, *given, "--out", str(tmp_path)]) == 0
        assert "note: starboard: " not in capsys.readouterr().err
        found.append(list(csv.DictReader((tmp_path / "current.csv").read_text().splitlines())))
    assert found[0] == found[1]
    assert {row["sensor"] for row in found[0]} == {"port", "starboard"}
    stamps = [float(row["stamp"]) for row in found[0]]
    assert stamps == sorted(stamps), "scans are in the order of their stamps, as in the node"
    assert main(["run", str(path), *given]) == 2
    assert "no topic of detections in the namespace starboard" in capsys.readouterr().err
    assert main(["run", str(path), *given, "--html", str(tmp_path / "page.html")]) == 2


def test_a_bag_with_poses_in_tf_alone_is_refused_unless_the_sensor_stands_still(capsys, tmp_path):
    """Tracks of a moving sensor that counts as fixed would all be wrong, without a word."""
    bag_files = pytest.importorskip("support.bag_files")
    entries = [entry for entry in bag_files.simulated() if entry.type_name == bag_files.POINTS]
    tf = "tf2_msgs/msg/TFMessage"
    message = bag_files.STORE.types[tf](transforms=[])
    given = [part for one in bag_files.PARAMETERS for part in ("-p", one)]
    static = bag_files.Entry(1000.0, "/tf_static", tf, message)
    path = str(bag_files.write_bag(tmp_path / "fixed", [static, *entries]))
    assert main(["run", path, *given]) == 0
    moving = bag_files.Entry(1000.0, "/boat/tf", tf, message)
    path = str(bag_files.write_bag(tmp_path / "moving", [moving, static, *entries]))
    capsys.readouterr()
    assert main(["run", path, *given]) == 2
    [sentence] = capsys.readouterr().err.splitlines()
    assert "no odometry, but transforms on /boat/tf" in sentence
    assert "own_ship_source:=none" in sentence
    assert main(["run", path, *given, "-p", "own_ship_source:=none"]) == 0
    both = [moving, *bag_files.simulated()]
    path = str(bag_files.write_bag(tmp_path / "both", sorted(both, key=lambda e: e.time)))
    assert main(["run", path, *given]) == 0


@pytest.fixture
def parameter_file(tmp_path):
    path = tmp_path / "sonar.yaml"
    path.write_text("/**:\n  ros__parameters: {sensor.max_range: 1000.0, use_sim_time: true}\n")
    return str(path)


def starts(capsys) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(capsys.readouterr().out)))


def test_of_files_and_assignments_the_last_value_holds(capsys, recording, parameter_file):
    file, value = ["--params-file", parameter_file], ["-p", "sensor.max_range:=5000.0"]
    assert main(["run", recording, *value, *file]) == 0
    assert not starts(capsys)
    assert main(["run", recording, *file, *value]) == 0
    assert starts(capsys)


@pytest.mark.parametrize(
    ("command", "content", "said"),
    [
        ("run", None, "cannot be read: No such file"),
        ("run", "/boat/track_initiator: {ros__parameters: {a: 3.0}}", "only for /boat/track_init"),
        ("watch", "max_speed: 3.0", "it needs a section of this name, and ros__parameters in it"),
        ("design", "[", "is no parameter file"),
        ("run", "/**: {ros__parameters: {max_speed: 3}}", "max_speed must be a number with a deci"),
    ],
)
def test_a_parameter_file_that_the_node_does_not_take_is_refused(
    capsys, recording, tmp_path, command, content, said
):
    path = tmp_path / "own.yaml"
    if content is not None:
        path.write_text(content)
    source = [] if command == "design" else [recording]
    assert main([command, *source, "--params-file", str(path)]) == 2
    error = capsys.readouterr().err
    assert error.startswith("refused: ") and said in error


def test_a_recorded_own_ship_that_is_not_used_is_said(capsys, recording, tmp_path):
    (tmp_path / "own_ship.csv").write_text("time_s,east_m,north_m\n0.0,0.0,0.0\n99.0,0.0,0.0\n")
    assert main(["run", recording, "-p", "own_ship_source:=none"]) == 0
    assert "note: own_ship_source is none: the own ship" in capsys.readouterr().err


@pytest.fixture
def of_two_sensors(tmp_path):
    """A boat seen by a radar with own ship's poses, which moves east, and by a lidar without."""
    arguments = list[str]()
    for name, interval in (("radar", 2.0), ("lidar", 0.5)):
        (tmp_path / name).mkdir()
        rows = ["time_s,range_m,bearing_rad"]
        for stamp in np.arange(0.0, 30.0, interval):
            rows.append(f"{stamp},{200.0 - 3.0 * stamp},{0.5 * np.pi}")
        (tmp_path / name / "detections.csv").write_text("\n".join(rows))
        (tmp_path / f"{name}.yaml").write_text(
            "/**:\n  ros__parameters:\n    bearing_reference: north\n"
            "    sensor: {range_std: 2.0, range_std_fraction: 0.0, max_range: 500.0}\n"
        )
        arguments += ["--sensor", f"{name}={tmp_path / name}.yaml"]
    rows = ["time_s,east_m,north_m", *(f"{stamp},{3.0 * stamp},0.0" for stamp in range(-1, 32))]
    (tmp_path / "radar" / "own_ship.csv").write_text("\n".join(rows))
    return ["run", str(tmp_path / "radar"), str(tmp_path / "lidar"), *arguments]


def test_recordings_of_several_sensors_make_one_picture(capsys, of_two_sensors, tmp_path):
    assert main([*of_two_sensors, "--out", str(tmp_path / "out")]) == 0
    for file in ("tracks.csv", "current.csv"):
        rows = list(csv.DictReader((tmp_path / "out" / file).read_text().splitlines()))
        assert {row["track_id"] for row in rows} == {"0"}
        # The boat stands still, as only own ship's poses tell.
        assert float(rows[-1]["state_x"]) == pytest.approx(200.0, abs=2.0)
    assert {row["sensor"] for row in rows} == {"radar", "lidar"}
    assert "75 scans, 1 confirmed tracks" in capsys.readouterr().out


PIER = """
sensors: [sonar, mast]
scans: 40
sensor: {range_std: 1.0, range_std_fraction: 0.0, azimuth_std: 0.01, clutter_density: 2.0e-6}
sonar:
  sound_speed: 1500.0
  period: 1.0
  sensor: {max_range: 400.0, azimuth_min: -1.0, azimuth_max: 1.0}
  mounting: {x: 5.0, y: -2.0, yaw_deg: 20.0}
mast: {period: 2.5, sensor: {max_range: 900.0}}
targets:
  - {state: [250.0, -1.0, 60.0, 1.0]}
  - {state: [-500.0, 2.0, 300.0, 0.0]}
"""


def test_a_scenario_with_a_warm_up_runs_and_its_recording_has_its_empty_scans(capsys, tmp_path):
    scenario = tmp_path / "warm.yaml"
    scenario.write_text(
        "scans: 8\nwarm_up: 3\nsensor: {clutter_density: 1.0e-12, range_std_fraction: 0.001}\n"
        "targets: [{state: [900.0, 1.0, 100.0, 0.0]}]\n"
    )
    assert main(["run", str(scenario)]) == 0
    tracks = capsys.readouterr().out
    assert len(tracks.splitlines()) == 2
    assert main(["simulate", str(scenario), str(tmp_path / "warm")]) == 0
    assert main([*capsys.readouterr().out.split()[1:], "--out", str(tmp_path / "out")]) == 0
    assert (tmp_path / "out" / "tracks.csv").read_text() == tracks
    assert "11 scans, 1 confirmed tracks" in capsys.readouterr().out


@pytest.mark.long
def test_a_scenario_of_several_sensors_runs_as_it_is_evaluated_to_the_bit(capsys, tmp_path):
    (tmp_path / "pier.yaml").write_text(PIER)
    scenario = str(tmp_path / "pier.yaml")
    page, out = tmp_path / "pier.html", tmp_path / "out"
    assert main(["run", scenario, "--seed", "3", "--out", str(out), "--html", str(page)]) == 0
    assert "56 scans, 2 confirmed tracks" in capsys.readouterr().out
    rows = list(csv.DictReader((out / "tracks.csv").read_text().splitlines()))
    scene = load_scenario(scenario)
    tracker = make_initiator(
        "score", sensor={name: one.sensor for name, one in scene.sensors.items()}
    )
    evaluated = simulate_run(scene, [3], SimulatedOperatingPoint("score"))
    found = [track for scan in evaluated.scans for track in tracker.process(scan)]
    for tracks in (found, [track for _, track in evaluated.starts]):
        assert len(rows) == len(tracks)
        for row, track in zip(rows, tracks, strict=True):
            state = [float(row[f"state_{name}"]) for name in ("x", "vx", "y", "vy")]
            assert state == track.state.tolist()
    assert [one.outcome.value for one in evaluated.judged()] == ["true"] * 2
    recorded = tmp_path / "recorded"
    assert main(["simulate", scenario, str(recorded), "--seed", "3"]) == 0
    printed = capsys.readouterr().out.split()
    assert printed[:2] == ["tsepm", "run"]
    assert main([*printed[1:], "--out", str(tmp_path / "again")]) == 0
    for file in ("tracks.csv", "current.csv"):
        assert (tmp_path / "again" / file).read_text() == (out / file).read_text(), file
    assert main(["simulate", scenario, str(recorded)]) == 1
    assert "recorded cannot be used: File exists" in capsys.readouterr().err
    (embedded,) = re.findall(r'id="recording"[^>]*>([^<]*)<', page.read_text())
    sensors = json.loads(gzip.decompress(base64.b64decode(embedded)))["info"]["sensors"]
    assert [one["name"] for one in sensors] == ["sonar", "mast"]
    truth = [line.split(",")[:2] for line in (out / "truth.csv").read_text().splitlines()]
    assert len({*map(tuple, truth)}) == len(truth) == 1 + 2 * len({stamp for stamp, _ in truth[1:]})
    assert sensors[0]["place"] == pytest.approx([5.0, -2.0, math.radians(20.0)])
    assert [one["sector"][1] for one in sensors] == [400.0, 900.0]
    assert main(["run", scenario, "-p", "method:=tsepm"]) == 2
    assert "takes one sensor; 'score' takes several" in capsys.readouterr().err


def test_a_page_of_several_sensors_tells_them_apart(capsys, of_two_sensors, tmp_path):
    assert main([*of_two_sensors, "--html", str(tmp_path / "page.html")]) == 0
    html = (tmp_path / "page.html").read_text()
    (embedded,) = re.findall(r'id="recording"[^>]*>([^<]*)<', html)
    page = json.loads(gzip.decompress(base64.b64decode(embedded)))
    radar, lidar = page["info"]["sensors"]
    assert (radar["name"], radar["place"], lidar["name"]) == ("radar", [0.0] * 3, "lidar")
    assert radar["sector"][:2] == [0.0, 500.0]
    assert page["frames"][-1]["own_ship"][:3] == [pytest.approx(8850.0, abs=10.0), 0, None]
    assert (radar["silent_from"], lidar["silent_from"]) == (28.0 + 6.0, 29.5 + 5.0)
    assert "sector" not in page["info"]
    of_each = [frame["sensors"] for frame in page["frames"]]
    assert [0] in of_each and of_each.count([1]) == 60
    assert page["frames"][-1]["seen"] == [3]
    assert {hit[3] for hit in page["facts"]["0"]["hits"]} == {0, 1}
    tasks = [entry["task"] for entry in page["health"][0]["entries"]]
    assert tasks[0] == "track initiation" and set(tasks[1:]) <= {
        f"{name}/detections" for name in ("radar", "lidar")
    }


def test_what_is_said_of_a_wrong_mounting_mends_it(capsys, tmp_path):
    rng, arguments = np.random.default_rng(3), ["run", str(tmp_path / "port")]
    starts, velocity = 300.0 * np.exp(1j * np.arange(5.0)), np.exp(1j * np.arange(5.0) ** 2)
    for name, turn, interval in (("port", 1.0, 1.0), ("starboard", 0.0, 1.3)):
        (tmp_path / name).mkdir()
        rows = ["time_s,range_m,azimuth_rad"]
        for stamp in np.arange(0.0, 60.0, interval):
            for place in starts + stamp * velocity:
                distance, noise = abs(place), rng.normal(0.0, [2.0, 0.01])
                azimuth = np.angle(place) + np.radians(turn) + noise[1]
                rows.append(f"{stamp},{distance + noise[0]},{azimuth}")
        (tmp_path / name / "detections.csv").write_text("\n".join(rows))
    arguments += [str(tmp_path / "starboard"), "-p", "max_speed:=5.0"]
    sensor = "{range_std: 2.0, range_std_fraction: 0.0, azimuth_std: 0.01, max_range: 500.0}"
    given, found = 0.2, list[str]()
    for _ in range(2):
        for name, yaw in (("port", given), ("starboard", 0.2)):
            file = tmp_path / f"{name}.yaml"
            file.write_text(
                f"/**:\n  ros__parameters:\n    mounting.yaw: {yaw}\n    sensor: {sensor}\n"
            )
            arguments += ["--sensor", f"{name}={file}"]
        assert main(arguments) == 0
        captured = capsys.readouterr()
        found.append(captured.err)
        sentence = (
            r"port sees targets (\S+) .* degrees left .* set port.mounting.yaw to (\S+) \(now"
        )
        if said := re.search(sentence, found[-1]):
            given = float(said[2])
            assert float(said[1]) == pytest.approx(1.0, abs=0.3)
    assert given == pytest.approx(0.2 - np.radians(1.0), abs=0.006)
    assert "starboard sees" not in found[0] and "sees targets" not in found[1]
    assert len(list(csv.DictReader(io.StringIO(captured.out)))) == 5, "none is doubled"


def test_the_file_of_a_node_s_picture_is_that_of_as_many_recordings(
    capsys, of_two_sensors, tmp_path
):
    assert main(of_two_sensors) == 0
    expected = capsys.readouterr().out
    (tmp_path / "picture.yaml").write_text(
        "/**:\n  ros__parameters:\n    sensors: [radar, lidar]\n    bearing_reference: north\n"
        "    sensor: {range_std: 2.0, range_std_fraction: 0.0}\n"
        "    radar.sensor.max_range: 500.0\n    lidar.sensor.max_range: 500.0\n"
    )
    file = ["--params-file", str(tmp_path / "picture.yaml")]
    assert main([*of_two_sensors[:3], *file]) == 0
    assert capsys.readouterr().out == expected
    assert main([*of_two_sensors[:2], *file]) == 2
    assert "sensors names radar, lidar, and this is one recording" in capsys.readouterr().err
    text = (tmp_path / "picture.yaml").read_text()
    text = text.replace("[radar, lidar]", "[radar]").replace(
        "    lidar.sensor.max_range: 500.0\n", ""
    )
    (tmp_path / "picture.yaml").write_text(text)
    assert main([*of_two_sensors[:2], *file]) in (0, 1), capsys.readouterr().err


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda given: given[:3], "2 recordings need as many --sensor NAME=FILE"),
        (lambda given: [*given[:-1], given[4]], "2 recordings need as many --sensor"),
        (lambda given: [*given, "-p", "sensor.range_std:=3.0"], "range_std is of one sensor"),
        (lambda given: [*given[:2], "box", *given[3:]], "box is no recording"),
        (lambda given: [*given, "-p", "method:=tsepm"], "'tsepm' takes one sensor"),
    ],
)
def test_several_sensors_are_refused_with_what_is_missing(capsys, of_two_sensors, change, said):
    assert main(change(of_two_sensors)) == 2
    assert said in capsys.readouterr().err


def test_a_sensor_of_several_without_a_scan_is_said(capsys, of_two_sensors, tmp_path):
    (tmp_path / "radar" / "own_ship.csv").write_text(
        "time_s,east_m,north_m\n90.0,0.0,0.0\n91.0,0.0,0.0\n"
    )
    assert main(of_two_sensors) == 1
    assert "radar: every scan was dropped, 15 as" in capsys.readouterr().err


def test_geojson_and_sentences_of_a_scene_are_read_by_other_readers(scenario, tmp_path, capsys):
    arguments = ["run", scenario, "--as", "geojson", "--origin", "59.65,10.63"]
    assert main([*arguments, "--out", str(tmp_path / "run")]) == 0
    found = json.loads((tmp_path / "run" / "tracks.geojson").read_text())["features"]
    assert found
    for one in found:
        line = one["geometry"]["coordinates"]
        for longitude, latitude in line if isinstance(line[0], list) else [line]:
            assert abs(latitude - 59.65) < 0.2
            assert abs(longitude - 10.63) < 0.4
    capsys.readouterr()
    assert main(["run", scenario, "--as", "nmea", "--origin=-33.9,151.2"]) == 0
    lines = capsys.readouterr().out.split("\r\n")[:-1]
    messages = [pynmea2.parse(line, check=True) for line in lines]
    assert len(messages) > 4
    assert {one.sentence_type for one in messages} == {"TLL"}
    assert main(["run", scenario, "--as", "signalk", "--origin=-33.9,151.2"]) == 0
    deltas = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert len(deltas) == len(messages), "the same tracks and ends"


@pytest.mark.parametrize("form", ["geojson", "nmea", "signalk"])
def test_places_on_earth_are_the_same_whatever_the_axes_of_the_fixed_frame(form, capsys):
    written = []
    for frame in ("map", "map_ned"):
        given = ["-p", f"fixed_frame:={frame}", "--as", form, "--origin", "1,1"]
        assert main(["run", "four_targets", *given]) == 0
        written.append(capsys.readouterr().out)
    assert written[0] == written[1] != ""


@pytest.mark.parametrize("origin", [[], ["--origin", "north"], ["--origin", "89.9,0"]])
def test_without_a_proper_origin_the_command_says_what_is_one(origin, capsys):
    assert main(["run", "four_targets", "--as", "nmea", *origin]) != 0
    assert "latitude" in capsys.readouterr().err


def test_the_truth_of_a_bag_is_drawn(tmp_path):
    pytest.importorskip("matplotlib")
    bag_files = pytest.importorskip("support.bag_files")
    from msg_adapters.track_messages import TRACK_DTYPE
    from tsepm_ros.tools.replay.bag import Bag, find_bag_topics
    from tsepm_ros.tools.replay.offline import offline_bag_truth

    entries = bag_files.simulated()
    for stamp in (1000.0, 1010.0):
        values = {name: [0.0] for name in TRACK_DTYPE.names}
        values |= {"track_id": [3.0], "state_x": [stamp], "state_y": [-stamp]}
        message = bag_files.cloud(stamp, "odom", **values)
        entries.append(bag_files.Entry(stamp, "/ground_truth", bag_files.POINTS, message))
    values["state_x"] = [np.nan]
    message = bag_files.cloud(1002.0, "odom", **values)
    entries.append(bag_files.Entry(1002.0, "/ground_truth", bag_files.POINTS, message))
    other = bag_files.cloud(1005.0, "odom", colour=[1.0])  # no truth, and left out
    entries.append(bag_files.Entry(1005.0, "/ground_truth", bag_files.POINTS, other))
    path = bag_files.write_bag(tmp_path / "bag", sorted(entries, key=lambda e: e.time))
    notes: dict[str, str] = {}
    with Bag(path) as bag:
        (truth,) = offline_bag_truth(bag, find_bag_topics(bag.topics, {}), notes)
    assert [*notes.values()] == ["1 positions of /ground_truth are left out: not finite"]
    assert truth == pytest.approx(np.array([[1000.0, 1000.0, -1000.0], [1010.0, 1010.0, -1010.0]]))
    assert main(["run", str(path), "--picture", str(tmp_path / "a.png")]) == 0
    assert (tmp_path / "a.png").stat().st_size > 10_000


START, PERIOD, TARGET = 1000.0, 2.0, (900.0, -1.5, 300.0, 2.0)


def entries(frame):
    """A target of 20 pings and clutter, beside odometry of a ship at rest."""
    rng = np.random.default_rng(1)
    for index in range(20):
        time = START + PERIOD * index
        x, vx, y, vy = TARGET
        x, y = x + vx * PERIOD * index, y + vy * PERIOD * index
        range_ = np.r_[np.hypot(x, y) + rng.normal(0, 5), rng.uniform(100, 2900, 3)]
        azimuth = np.r_[np.arctan2(y, x) + rng.normal(0, 0.005), rng.uniform(-3, 3, 3)]
        fields = {"range": range_, "azimuth": azimuth, "time_offset": range_ / 1500.0}
        message = cloud(time, "sonar", **fields)
        yield Entry(time + PERIOD, "/detections", POINTS, message)
    for second in np.arange(0.0, 45.0, 0.5):
        message = odometry(START + second, 0.0, 0.0, 0.0)
        message.header.frame_id = frame
        yield Entry(START + second + 0.01, "/own_ship/odometry", ODOMETRY, message)


def test_the_first_cause_is_named_with_its_sentence_and_remedy(capsys, tmp_path):
    bag = write_bag(tmp_path / "bag", sorted(entries("map"), key=lambda entry: entry.time))
    values = [part for one in (*PARAMETERS, "fixed_frame:=odom") for part in ("-p", one)]
    assert main(["run", str(bag), *values]) == 1
    error = capsys.readouterr().err
    sentence = "own-ship data is in frame 'map', the fixed frame is 'odom'"
    assert f"dropped: 90 own_ship_frame: {sentence}" in error
    last = error.splitlines()[-1]
    assert last.startswith("failed: every scan was dropped, 20 as own_ship_missing after 90 ")
    assert f"{sentence}. Remedy: Set `fixed_frame`" in last
    assert error.count("Remedy") == 1


ECHO = "ping360_sonar_msgs/msg/SonarEcho"
ECHO_DEFINITION = (
    "std_msgs/Header header\nfloat32 angle\nuint8 gain\nuint16 number_of_samples\n"
    "uint16 transmit_frequency\nuint16 speed_of_sound\nuint8 range\nuint8[] intensities\n"
)


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # tornado's socket
@pytest.mark.parametrize("command", ["run", "watch"])
def test_messages_that_make_no_scan_end_with_a_code_and_why(capsys, tmp_path, command):
    store = get_typestore(Stores.ROS2_JAZZY)
    store.register(get_types_from_msg(ECHO_DEFINITION, ECHO))
    values = {"gain": 1, "number_of_samples": 9, "transmit_frequency": 740, "speed_of_sound": 1500}
    values |= {"range": 50, "intensities": np.arange(9, dtype=np.uint8)}
    entries = [
        Entry(
            time,
            "/image",
            ECHO,
            store.serialize_cdr(
                store.types[ECHO](header=header(time, "sonar"), angle=2.0 * (k % 200), **values),
                ECHO,
            ),
        )
        for k, time in enumerate(np.arange(1000.0, 1040.0, 0.1).tolist())
    ]
    entries = [entry._replace(message=bytes(entry.message)) for entry in entries]
    bag = write_bag(tmp_path / "bag", entries, store=store)
    assert main([command, str(bag)]) == 1
    error = capsys.readouterr().err
    assert "are they in degrees (360 a turn) or gradians (400)?" in error
    assert error.splitlines()[-1].startswith("failed: no scan was made: bearings, but no turn")


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # tornado's socket
@pytest.mark.parametrize("command", ["run", "watch"])
def test_a_recording_without_a_scan_ends_with_a_code(capsys, tmp_path, command):
    (tmp_path / "detections.csv").write_text("time_s,range_m,azimuth_rad\n")
    assert main([command, str(tmp_path)]) == 1
    error = capsys.readouterr().err
    assert "detections.csv has no detections" in error
    assert error.splitlines()[-1] == "failed: no scan was made: there are no detections"


@pytest.fixture
def titled(recording, tmp_path):
    """The recording in a folder with a name, which is the page's title."""
    folder = tmp_path / "trial"
    folder.mkdir()
    (tmp_path / "detections.csv").rename(folder / "detections.csv")
    return str(folder)


def held_by(page: str) -> dict:
    """The recording in a self-contained page."""
    data = re.search(r'id="recording">([^<]*)</script>', page)[1]
    return json.loads(gzip.decompress(base64.b64decode(data)))


def test_run_writes_a_page_beside_the_tracks(capsys, titled, tmp_path):
    assert main(["run", titled]) == 0
    plain = capsys.readouterr().out
    path = tmp_path / "run.html"
    assert main(["run", titled, "--html", str(path)]) == 0
    captured = capsys.readouterr()
    assert captured.out == plain
    assert captured.err == f"page: {path}\n"
    page = held_by(path.read_text())
    info = page["info"]
    assert info.pop("sector") == [0.0, 9000.0, -math.pi, math.pi]
    assert info.pop("mounting_yaw") == 0.0
    assert info == {"kind": "recording", "title": "trial, method score", "north": False}
    assert len(page["frames"]) == 8
    ((track_id, facts),) = page["facts"].items()
    assert facts["confirmed"] == 24.0 and len(facts["hits"]) == 3
    assert [str(row[0]) for row in page["frames"][-1]["tracks"]] == [track_id]


def test_the_page_of_a_run_says_what_was_dropped_and_has_the_places_of_its_origin(
    capsys, titled, tmp_path
):
    path = tmp_path / "run.html"
    assert main(["run", titled, "--html", str(path), "--origin", "59.65,10.63"]) == 0
    info = held_by(path.read_text())["info"]
    assert info["geographic"]["origin"] == [59.65, 10.63] and info["north"]
    with open(f"{titled}/detections.csv", "a") as file:
        file.write("\n90.0,-1.0,0.0\n")
    assert main(["run", titled, "--html", str(path)]) == 0
    (health,) = held_by(path.read_text())["health"]
    assert health["level"] == 1
    assert any(entry["message"].startswith("1 detection dropped") for entry in health["entries"])


@pytest.mark.long
def test_watch_serves_a_recording_until_interrupted(titled):
    command = [
        sys.executable,
        "-m",
        "tsepm_ros.tools.commands.cli",
        "watch",
        titled,
        "--port",
        "0",
    ]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        try:
            line = process.stdout.readline()
            url = re.fullmatch(r"8 scans; open (http://127\.0\.0\.1:\d+/) \(Ctrl-C ends\)\n", line)[
                1
            ]
            with urllib.request.urlopen(f"{url}recording", timeout=WAIT) as answer:
                assert len(json.load(answer)["frames"]) == 8
            time.sleep(0.1)
            process.send_signal(signal.SIGINT)
            assert process.wait(WAIT) == 0
            assert process.stderr.read() == "", "silent where it is not a terminal"
        finally:
            process.kill()


def refused(capsys, *arguments: str) -> str:
    assert main(["watch", *arguments]) == 2
    error = capsys.readouterr().err
    assert error.startswith("refused: ")
    return error


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # tornado's socket
def test_a_port_in_use_is_refused_before_the_work(capsys, titled):
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        assert "choose another port" in refused(capsys, titled, "--port", str(port))


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["no_such_thing"], "no_such_thing is neither an existing path nor a shipped scenario"),
        (["four_targets", "--origin", "89.5,0"], "near a pole"),
        (["four_targets", "--origin", "Oslo"], "latitude,longitude in degrees, such as 59.65"),
        (["-p", "max_speed:=5.0"], "-p sets parameters of the processing of a recording"),
        (["four_targets", "--ros-args", "-r", "a:=b"], "--ros-args is for live topics"),
    ],
)
def test_arguments_that_do_not_fit_are_refused(capsys, arguments, sentence):
    assert sentence in refused(capsys, *arguments)
