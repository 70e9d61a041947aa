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
"""Recorded detections: what a path names, what is read and refused, and what a session gives."""

import bz2
import gzip
import math
import re
from pathlib import Path

import numpy as np
import pytest

from tsepm_ros.tools.replay import recording as recording_module
from tsepm_ros.tools.replay.recording import (
    RECORDED_COLUMNS,
    read_recording,
    recording_source_of,
    simulated_recording,
)
from tsepm_ros.tools.simulation import Simulator, load_scenario
from tsepm_ros.tracker.scan import ECHO_FEATURES

PAGE = Path(__file__).parents[3] / "docs" / "python_and_command_line.md"


@pytest.fixture
def write(tmp_path):
    """Write files by name and return the folder."""

    def write(**files: str) -> Path:
        for name, text in files.items():
            (tmp_path / f"{name}.csv").write_text(text, encoding="utf-8")
        return tmp_path

    return write


DETECTIONS = """scan,time_s,range_m,bearing_rad
0,0.0,100.0,0.1
0,0.0,200.0,0.2
2,24.0,300.0,0.3
"""


def test_rows_with_the_same_scan_number_or_without_one_of_the_same_time_are_one_scan(write):
    recording = read_recording(write(detections=DETECTIONS))
    assert [scan.time for scan in recording.scans] == [0.0, 24.0]
    assert [scan.fields["range"].tolist() for scan in recording.scans] == [[100, 200], [300]]
    assert [scan.fields["bearing"].tolist() for scan in recording.scans] == [[0.1, 0.2], [0.3]]
    assert (recording.own_ship, recording.targets) == ([], {})
    text = "time_s,range_m,azimuth_rad\n5,1,0\n0,2,0\n5,3,0\n"
    recording = read_recording(write(detections=text))
    assert [scan.time for scan in recording.scans] == [0.0, 5.0]
    assert [scan.fields["range"].tolist() for scan in recording.scans] == [[2], [1, 3]]


def test_every_column_becomes_its_field(write):
    columns = (
        "intensity,range_m,azimuth_rad,range_std_m,azimuth_std_rad,time_offset_s,range_width_m"
    )
    columns += ",azimuth_width_rad,range_rate_mps,elevation_rad,two_way_travel_time_s"
    names = [re.sub("_(m|s|mps|rad)$", "", column) for column in columns.split(",")]
    numbers = [float(number) for number in range(1, 12)]
    text = f"time_s,{columns}\n0,{','.join(map(str, numbers))}\n"
    (scan,) = read_recording(write(detections=text)).scans
    found = {name: values.tolist() for name, values in scan.fields.items()}
    assert found == {name: [number] for name, number in zip(names, numbers, strict=True)}


def test_the_page_and_the_docstring_name_every_file_and_column_that_is_read():
    names = {*RECORDED_COLUMNS}.union(*(known for _, _, known in RECORDED_COLUMNS.values()))
    texts = [recording_module.__doc__, *([PAGE.read_text("utf-8")] if PAGE.exists() else [])]
    for text in texts:
        assert names - {*re.findall(r"`([\w.]+)`", text)} == set()


def test_a_recording_may_be_named_from_the_home_folder(tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    (tmp_path / "dive").mkdir()
    (tmp_path / "dive" / "detections.csv").write_text("time_s,range_m,azimuth_rad\n0,1,2\n")
    source, is_bag = recording_source_of("~/dive")
    assert (source, is_bag) == (tmp_path / "dive" / "detections.csv", False)


def test_spaces_and_a_byte_order_mark_do_no_harm(tmp_path):
    text = "time_s, range_m , azimuth_rad\r\n 0, 1 , 2\r\n"
    (tmp_path / "detections.csv").write_bytes(b"\xef\xbb\xbf" + text.encode())
    (scan,) = read_recording(tmp_path).scans
    assert scan.fields["range"].tolist() == [1.0]


def test_scans_known_to_the_own_ship_only_were_empty(write):
    own_ship = "scan,time_s,east_m,north_m\n0,0,1,2\n1,12,3,4\n2,24,5,6\n3,36,7,8\n"
    recording = read_recording(write(detections=DETECTIONS, own_ship=own_ship))
    assert [scan.time for scan in recording.scans] == [0.0, 12.0, 24.0, 36.0]
    assert [len(scan.fields["range"]) for scan in recording.scans] == [2, 0, 1, 0]
    assert set(recording.scans[1].fields) == {"range", "bearing"}


def test_motion_is_east_north_with_yaw_and_targets_are_told_apart_by_their_number(write):
    own_ship = (
        "time_s,east_m,east_mps,north_m,north_mps,heading_rad\n"
        f"10,5,1,6,2,0.0\n0,3,1,4,2,{math.pi / 2}\n"
    )
    poses = read_recording(write(detections=DETECTIONS, own_ship=own_ship)).own_ship
    assert [pose.stamp for pose in poses] == [0.0, 10.0]
    assert [(pose.x, pose.y, *pose.rates[:2]) for pose in poses] == [(3, 4, 1, 2), (5, 6, 1, 2)]
    assert [pose.yaw for pose in poses] == pytest.approx([0.0, math.pi / 2])
    assert {pose.covariance for pose in poses} == {None}
    target = "target,time_s,east_m,north_m\n7,0,1,2\n9,0,3,4\n7,12,5,6\n"
    targets = read_recording(write(detections=DETECTIONS, target=target)).targets
    assert {name: len(path) for name, path in targets.items()} == {7: 2, 9: 1}
    assert targets[7][1].tolist() == [12, 5, 0, 6, 0]


def targets_at(times, target="target"):
    return (
        "\n".join([f"time_s,east_m,north_m,{target}", *(f"{t},1,2,{n}" for t, n in times)]) + "\n"
    )


@pytest.mark.parametrize(
    ("target", "said"),
    [
        (targets_at([(t, n) for n in (0, 1) for t in (0, 24)]), ""),  # target after target
        (targets_at([(0, 0), (24000, 0)]), "has times from 0 to 24000 s, the pings are from 0 to"),
        (targets_at([(1.7e9, 0), (1.7e9 + 24, 0)]), "has times from 1700000000 to 1700000024 s"),
        (targets_at([(12, 0)]), ""),  # one labelled instant
        (targets_at([(-99, 0), (2, 0), (3, 0), (999, 0)]), ""),  # of a longer survey
        (targets_at([(0, 0), (0, 1), (24, 0), (24, 1)], "fish"), "several rows of one target at"),
    ],
)
def test_a_truth_of_other_times_or_without_numbers_of_targets_is_said(write, target, said):
    notes = read_recording(write(detections=DETECTIONS, target=target)).notes
    about = [note for note in notes if note.startswith("target.csv has")]
    assert len(about) == bool(said) and said in "".join(about)
    assert read_recording(write(detections=DETECTIONS.split("\n")[0] + "\n", target=target)).targets


def test_the_index_of_a_table_is_passed_over(write):
    assert not read_recording(write(detections=",time_s,range_m,bearing_rad\n0,0,9,1\n")).notes


def test_angles_in_degrees_are_read_and_columns_without_use_are_named(write):
    table = "time_s,range_m,bearing_deg\n0,100,90\n"
    ship = "time_s,east_m,north_m,{}\n0,0,0,90\n9,0,0,90\n"
    read = read_recording(write(detections=table, own_ship=ship.format("heading_deg")))
    assert read.scans[0].fields["bearing"] == pytest.approx(math.pi / 2)
    assert [pose.yaw for pose in read.own_ship] == pytest.approx([0.0, 0.0])
    assert read.notes == []
    deg = "compass_deg"
    for name, said in (("heading_rad", "name the column heading_deg"), (deg, f"of {deg};")):
        [note] = read_recording(write(detections=table, own_ship=ship.format(name))).notes
        assert note.startswith("own_ship.csv: ") and said in note


def test_a_column_that_nobody_reads_may_hold_anything(write):
    read = read_recording(
        write(detections="time_s,label,range_m,bearing_deg\n0,fish,9,90\n1,,8,0\n")
    )
    fields = [(*scan.fields["range"], *scan.fields["bearing"]) for scan in read.scans]
    assert fields == [(9.0, math.pi / 2), (8.0, 0.0)]
    assert "no use is made of label;" in read.notes[0]


HEADER = "time_s,range_m,bearing_rad\n"

ONE_ANGLE = "must have one of the columns azimuth_rad and bearing_rad"

LINE_2, LINE_3 = "line 2", "line 3"


@pytest.mark.parametrize(
    ("name", "text", "sentence"),
    [
        ("detections", "", "is empty: its first line names the columns"),
        (
            "detections",
            "time_s;range_m;bearing_rad\n0;1,5;0\n",
            "has semicolons between its columns",
        ),
        ("detections", "time_s\trange_m\tbearing_rad\n0\t1\t0\n", "has tabs between its columns"),
        ("detections", "time_s,bearing_rad\n0,1\n", "has no column 'range_m'; it has"),
        ("detections", "time_s,range_m\n0,1\n", ONE_ANGLE),
        ("detections", "time_s,range_m,azimuth_rad,bearing_rad\n0,1,2,3\n", ONE_ANGLE),
        (
            "detections",
            HEADER + "0,1,2\n0,far,2\n",
            LINE_3 + ": expected 3 numbers, got ['0', 'far'",
        ),
        ("detections", HEADER + "0,1,2\n0,,2\n", LINE_3),
        ("detections", HEADER + "0,1,2\n7\n", LINE_3),
        ("detections", HEADER + "0,1\n", LINE_2),
        ("detections", HEADER + "0,1,2,3\n", LINE_2),
        ("detections", HEADER + "nan,1,2\n", LINE_2 + ": time_s must"),
        ("detections", "scan," + HEADER + "nan,0,1,2\n", LINE_2 + ": scan must"),
        ("own_ship", "time_s,east_m\n0,1\n", "has no column 'north_m'"),
        ("own_ship", "time_s,east_m,north_m\n0,nan,1\n", LINE_2 + ": east_m must"),
        ("own_ship", "time_s,east_m,north_m,roll_rad\n0,1,1,nan\n", LINE_2 + ": roll_rad must"),
        ("target", "time_s,east_m,north_m\n0,1,x\n", LINE_2),
        ("target", "target,time_s,east_m,north_m\nnan,0,1,1\n", LINE_2 + ": target must"),
    ],
)
def test_a_malformed_recording_is_refused_by_file_and_column_or_line(write, name, text, sentence):
    with pytest.raises(ValueError) as refused:
        read_recording(write(**{"detections": DETECTIONS, name: text}))
    assert re.sub(r"^(?:/.*/)?(\w+\.csv),? ", r"\1 ", str(refused.value)).startswith(
        f"{name}.csv {sentence}"
    )


def test_a_recording_without_rows_has_no_scans_and_says_so(write):
    recording = read_recording(write(detections=HEADER))
    assert recording.scans == []
    assert recording.notes == ["detections.csv has no detections"]


def test_a_file_is_read_by_its_name_and_no_other(write):
    folder = write(detections=DETECTIONS, run2=HEADER + "5,1,2\n", RUN3=HEADER + "7,1,2\n")
    (folder / "RUN3.csv").rename(folder / "RUN3.CSV")
    assert [scan.time for scan in read_recording(folder / "run2.csv").scans] == [5.0]
    assert [scan.time for scan in read_recording(folder / "RUN3.CSV").scans] == [7.0]
    assert len(read_recording(folder).scans) == 2
    with pytest.raises(ValueError, match=r"own_ship\.csv has no column 'range_m'"):
        read_recording(write(own_ship="time_s,east_m,north_m\n0,0,0\n") / "own_ship.csv")


def test_the_own_ship_beside_a_file_of_another_name_is_read_and_said(write):
    folder = write(run2=HEADER + "5,1,2\n", own_ship="time_s,east_m,north_m\n5,1,2\n")
    recording = read_recording(folder / "run2.csv")
    assert len(recording.own_ship) == 1
    assert recording.notes == ["the own ship of run2.csv is read from own_ship.csv beside it"]
    assert read_recording(write(detections=DETECTIONS)).notes == []


def pings(times, scans=None, rows=2):
    """detections.csv of some pings, with or without scan numbers."""
    lines = ["time_s,range_m,azimuth_rad" + ("" if scans is None else ",scan")]
    for index, time in enumerate(times):
        end = "" if scans is None else f",{scans[index]}"
        lines += [f"{time!r},{100.0 + index},{0.1 * row}{end}" for row in range(rows)]
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize("interval", [0.1, 12.0])
@pytest.mark.parametrize("start", [0, 65530], ids=["restart", "16 bits"])
def test_a_counter_that_starts_again_counts_new_pings(write, interval, start):
    times = [round(interval * k, 6) for k in range(12)] + [
        round(600 + interval * k, 6) for k in range(12)
    ]
    scans = (
        [*range(start, start + 12), *range(12)]
        if start == 0
        else [(start + k) % 65536 for k in range(24)]
    )
    recording = read_recording(write(detections=pings(times, scans)))
    assert [scan.time for scan in recording.scans] == times
    assert [len(scan.fields["range"]) for scan in recording.scans] == [2] * 24
    assert ["start again at 600 s" in note for note in recording.notes] == [True] * (start == 0)


def test_empty_scans_of_the_own_ship_are_found_after_a_counter_has_started_again(write):
    times = [*range(0, 40, 4), *range(600, 640, 4)]
    scans = [*range(10), *range(10)]
    own_ship = "scan,time_s,east_m,north_m\n" + "".join(
        f"{scan},{time},0,0\n" for scan, time in zip(scans, times, strict=True)
    )
    seen = [index for index in range(20) if index not in (3, 15)]
    detections = pings([times[k] for k in seen], [scans[k] for k in seen])
    recording = read_recording(write(detections=detections, own_ship=own_ship))
    assert [scan.time for scan in recording.scans] == times
    empty = [k for k, scan in enumerate(recording.scans) if not len(scan.fields["range"])]
    assert empty == [3, 15]


@pytest.mark.parametrize("interval", [0.1, 12.0])
def test_times_of_the_detections_within_a_ping_are_kept(write, interval):
    rows = [
        (k * interval + 0.02 * interval * row, k, 100 + row) for k in range(5) for row in range(9)
    ]
    text = "time_s,scan,range_m,azimuth_rad,two_way_travel_time_s\n" + "".join(
        f"{time!r},{scan},{distance},0.1,0.02\n" for time, scan, distance in reversed(rows[:9])
    )
    text += "".join(f"{time!r},{scan},{distance},0.1,0.02\n" for time, scan, distance in rows[9:])
    recording = read_recording(write(detections=text))
    assert [scan.time for scan in recording.scans] == [k * interval for k in range(5)]
    for scan in recording.scans:
        offset = 0.02 * interval * (scan.fields["range"] - 100) + 0.01
        assert scan.fields["time_offset"] == pytest.approx(offset)
        assert "two_way_travel_time" not in scan.fields
    assert [f"{0.16 * interval:g} s apart" in note for note in recording.notes] == [True]


@pytest.mark.parametrize(
    ("times", "scans", "sentence"),
    [
        ([0.0, 0.1, 0.2, 0.3], [0, 1, 0, 1], "scan 0 has rows at 0 and 0.2 s, with other scans"),
        ([0.0, 4.0, 8.0, 12.0, 16.0], [7, 7, 7, 7, 7], "from 0 to 16 s, and it is the only scan"),
        ([0.0, 600.0, 604.0, 608.0, 612.0, 616.0], [0, 0, 1, 2, 3, 4], "scan 0 have times from"),
    ],
    ids=["two heads", "constant", "restart after one ping"],
)
def test_scan_numbers_that_are_not_of_one_ping_each_are_refused(write, times, scans, sentence):
    with pytest.raises(ValueError, match=f"{sentence}.*column scan"):
        read_recording(write(detections=pings(times, scans)))


@pytest.mark.parametrize("interval", [0.1, 2.0, 12.0])
@pytest.mark.parametrize("numbered", [False, True])
@pytest.mark.parametrize("day", [86400, 24 * 60, 100], ids=["seconds", "minutes", "restart"])
def test_times_that_step_back_are_refused_with_the_line(write, interval, numbered, day):
    times = [round((day - 5 * interval + k * interval) % day, 6) for k in range(12)]
    text = pings(times, range(12) if numbered else None)
    with pytest.raises(ValueError, match=r"line 12: time_s steps back to 0 s from .*midnight"):
        read_recording(write(detections=text))


def test_pings_out_of_order_are_sorted_and_few_with_the_time_before_are_said(write):
    recording = read_recording(write(detections=pings([0.0, 0.2, 0.1, 0.3, 0.4])))
    assert [scan.time for scan in recording.scans] == [0.0, 0.1, 0.2, 0.3, 0.4]
    times = [0.0, 1.0, 2.0, 3.0, 4.0, 4.0, 5.0, 6.0]
    recording = read_recording(write(detections=pings(times, range(8))))
    assert [scan.time for scan in recording.scans] == times
    assert [note.startswith("1 of 8 pings have the same time") for note in recording.notes] == [
        True
    ]


@pytest.mark.parametrize("name", ["detections", "own_ship", "target"])
@pytest.mark.parametrize(
    ("factor", "unit"), [(1e3, "milliseconds"), (1e6, "microseconds"), (1e9, "nanoseconds")]
)
def test_times_in_parts_of_a_second_are_asked_about(write, name, factor, unit):
    files = {
        "detections": pings([1.7e9, 1.7e9 + 4]),
        "own_ship": "time_s,east_m,north_m\n1700000000.0,0,0\n",
        "target": "time_s,east_m,north_m\n1700000000.0,0,0\n",
    }
    files[name] = files[name].replace("1700000000.0", f"{1.7e9 * factor:.0f}")
    with pytest.raises(ValueError, match=rf"{name}\.csv, line 2: .* is it in {unit}\?"):
        read_recording(write(**files))


@pytest.mark.parametrize(("interval", "step"), [(0.5, 1.0), (0.05, 0.1)])
def test_pings_with_the_time_of_the_ping_before_are_refused_with_their_number(
    write, interval, step
):
    times = [round(int(k * interval / step) * step, 6) for k in range(40)]
    with pytest.raises(
        ValueError, match=r"20 of 40 pings have the same time .* a stamp of its own"
    ):
        read_recording(write(detections=pings(times, range(40))))


@pytest.mark.parametrize(
    ("interval", "step", "asked"),
    [(0.5, 1.0, True), (0.05, 0.1, True), (0.5, 0.1, False), (12.0, 1.0, False)],
)
def test_a_clock_as_coarse_as_the_interval_of_pings_is_asked_about(write, interval, step, asked):
    times = [round(int(k * interval / step + 1e-6) * step, 6) for k in range(40)]
    notes = read_recording(write(detections=pings(times))).notes
    assert [f"steps of {step:g} s" in note for note in notes] == [True] * asked


def test_a_row_that_is_refused_is_cut_short_and_a_file_that_is_no_text_is_named(tmp_path):
    (tmp_path / "detections.csv").write_text("time_s,range_m,azimuth_rad\n1,2," + "x" * 10**5)
    with pytest.raises(
        ValueError, match=r"line 2: expected 3 numbers, got \['1', '2', 'xxx"
    ) as error:
        read_recording(tmp_path)
    assert len(str(error.value)) < 200
    (tmp_path / "detections.csv").write_bytes(HEADER.encode() + b"0,1,\xff\xfe\n")
    with pytest.raises(ValueError, match=r"detections\.csv"):
        read_recording(tmp_path)


def test_milliseconds_since_the_start_are_asked_about(write):
    notes = read_recording(write(detections=pings([4000.0 * k for k in range(9)]))).notes
    assert notes == ["pings are 4000 s apart: is time_s in milliseconds or microseconds?"]
    assert read_recording(write(detections=pings([12.0 * k for k in range(9)]))).notes == []


MCAP, SQLITE, ROS_1 = b"\x89MCAP0\r\n", b"SQLite format 3\0", b"#ROSBAG V2.0\n"

TABLE = b"time_s,range_m,azimuth_rad\n"


@pytest.fixture
def holding(tmp_path):
    """Make a folder of files by name and content."""

    def make(**files: bytes):
        for name, content in files.items():
            (tmp_path / name.replace("__", ".")).write_bytes(content)
        return tmp_path

    return make


LFS = b"version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 123\n"


@pytest.mark.parametrize("name", ["detections.csv", "own_ship.csv", "target.csv"])
def test_a_pointer_in_place_of_a_table_is_told_from_a_table(holding, name):
    folder = holding(**{"detections.csv": TABLE, name: LFS})
    with pytest.raises(ValueError, match=f"{name} is a pointer of git LFS.*git lfs pull"):
        read_recording(folder)


@pytest.mark.parametrize("name", ["run2.csv", "RUN2.CSV", "detections.csv", "own_ship.csv"])
def test_a_csv_file_names_itself(holding, name):
    path = holding(**{name: TABLE, "other.csv": TABLE}) / name
    assert recording_source_of(path) == (path, False)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        *(("a.mcap", MCAP), ("a.db3", SQLITE), ("A.MCAP", MCAP), ("a.mcap.active", MCAP)),
        *(("a.sqlite3", SQLITE), ("a.mcap", SQLITE), ("a.db3", MCAP)),
    ],
)
def test_a_bag_s_file_names_itself_by_its_content_or_suffix(holding, name, content):
    path = holding(**{name: content}) / name
    assert recording_source_of(path) == (path, True)


@pytest.mark.parametrize("name", ["trial_0.mcap", "trial.db3", "TRIAL.MCAP"])
def test_a_folder_of_one_bag_file_without_metadata_names_it(holding, name):
    folder = holding(**{name: MCAP, "notes.txt": b"", ".hidden.mcap": MCAP})
    assert recording_source_of(folder) == (folder / name, True)


def test_metadata_and_detections_name_the_folder_s_recording(holding, tmp_path):
    folder = holding(metadata__yaml=b"", a__mcap=MCAP, b__mcap=MCAP)
    assert (
        recording_source_of(folder)
        == recording_source_of(folder / "metadata.yaml")
        == (folder, True)
    )
    (folder / "metadata.yaml").unlink()
    (folder / "detections.csv").write_bytes(TABLE)
    assert recording_source_of(folder) == (folder / "detections.csv", False)


@pytest.mark.parametrize(
    ("files", "words"),
    [
        ({}, ["holds nothing", "expected", "metadata.yaml"]),
        ({"notes__txt": b""}, ["holds notes.txt", "expected"]),
        ({"a__png": b"", "times__csv": b""}, ["a.png", "its images have no geometry.yaml"]),
        (
            {"a__png": b"", "times__csv": b"", "geometry__yaml": b""},
            ["tsepm detect writes their detections"],
        ),
        ({"run1__csv": TABLE, "run2__csv": TABLE}, ["run1.csv, run2.csv", "name one of its files"]),
        ({"run1__csv": TABLE}, ["holds run1.csv", "name one of its files"]),
        ({"a_0__mcap": MCAP, "a_1__mcap": MCAP}, ["a_0.mcap, a_1.mcap", "ros2 bag reindex"]),
        (
            {"metadata__yaml": b"", "detections__csv": TABLE},
            ["detections.csv, metadata.yaml", "name one of its files"],
        ),
        ({"trial__bag": ROS_1}, ["trial.bag is a ROS 1 bag", "rosbags-convert --src"]),
        ({"a__csv": TABLE, "a__csv__gz": gzip.compress(TABLE, mtime=0)}, ["holds a.csv, a.csv.gz"]),
        ({"tracks__csv": TABLE, "tracks__mcap": MCAP}, ["tracks.csv, tracks.mcap", "name one"]),
        ({"a__bag": ROS_1, "b__db3__zstd": b""}, ["holds a.bag, b.db3.zstd", "name one"]),
        ({f"f{k}": b"" for k in range(20)}, ["f0, f1", "..."]),
    ],
)
def test_a_folder_says_what_it_holds_and_what_is_expected(holding, files, words):
    with pytest.raises(ValueError) as refused:
        recording_source_of(holding(**files))
    for word in words:
        assert word in str(refused.value)
    assert len(str(refused.value)) < 500


def test_a_folder_of_bags_asks_for_one_and_a_path_that_does_not_exist_is_named(tmp_path):
    for name in ("first", "second"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "metadata.yaml").touch()
    with pytest.raises(ValueError, match=r"holds first, second; .*name a folder or a file in it"):
        recording_source_of(tmp_path)
    with pytest.raises(ValueError, match=r"missing\.csv cannot be read: No such file"):
        recording_source_of(tmp_path / "missing.csv")


@pytest.mark.parametrize(
    ("name", "content", "remedy"),
    [
        ("a.bag", ROS_1, "ROS 1 bag: convert it by rosbags-convert"),
        ("a.bag", b"", "ROS 1 bag"),
        ("noted", ROS_1, "ROS 1 bag"),
        ("a.db3.zstd", b"\x28\xb5\x2f\xfd", "compressed: unpack it .unzstd .*name the folder"),
        ("a.mcap.zst", b"", "compressed: unpack it .unzstd"),
        ("a.csv.gz", gzip.compress(TABLE, mtime=0), "compressed: unpack it .gunzip"),
        ("a.csv", gzip.compress(TABLE, mtime=0), "compressed: unpack it .gunzip"),
        ("a.csv.bz2", bz2.compress(TABLE), "compressed: unpack it .bunzip2"),
        ("a.zip", b"PK\x03\x04", "compressed: unpack it .unzip"),
        ("a.json", b"{}", "is no recording; expected a .csv file"),
        ("a.pcap", b"", "is no recording; expected a .csv file"),
        ("a.mcap", b"", "is empty"),
        ("a.db3", b"time_s,range_m", "is no bag, whatever its name says"),
        ("a.csv", LFS, "pointer of git LFS"),
        ("a.mcap", LFS, "pointer of git LFS"),
    ],
)
def test_a_file_that_is_not_read_has_its_own_remedy(holding, name, content, remedy):
    path = holding(**{name: content, "detections.csv": TABLE}) / name
    with pytest.raises(ValueError, match=f"{name} .*{remedy}"):
        recording_source_of(path)


def test_a_simulated_recording_has_all_that_the_simulator_measures():
    scene = load_scenario("encounter")
    recording, _ = simulated_recording(Simulator(scene, 1))
    for recorded, simulated in zip(recording.scans, Simulator(scene, 1), strict=True):
        assert {*ECHO_FEATURES} <= {*simulated.scan.features} <= {*recorded.fields}
        for name, values in simulated.scan.features.items():
            np.testing.assert_array_equal(recorded.fields[name], values)
