"""Recorded detections: what is read, what is refused, and the joyride."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from tsepm_ros.replay.recording import read_recording

JOYRIDE = Path(__file__).parents[2].parent / "shared" / "data" / "joyride"


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


def test_rows_with_the_same_scan_number_are_one_scan(write):
    recording = read_recording(write(detections=DETECTIONS))
    assert [scan.time for scan in recording.scans] == [0.0, 24.0]
    assert [scan.fields["range"].tolist() for scan in recording.scans] == [[100, 200], [300]]
    assert [scan.fields["bearing"].tolist() for scan in recording.scans] == [[0.1, 0.2], [0.3]]
    assert (recording.own_ship, recording.targets) == ([], {})


def test_without_scan_numbers_rows_of_the_same_time_are_one_scan(write):
    text = "time_s,range_m,azimuth_rad\n5,1,0\n0,2,0\n5,3,0\n"
    recording = read_recording(write(detections=text))
    assert [scan.time for scan in recording.scans] == [0.0, 5.0]
    assert [scan.fields["range"].tolist() for scan in recording.scans] == [[2], [1, 3]]


def test_every_column_becomes_its_field(write):
    text = (
        "intensity,time_s,range_m,azimuth_rad,range_std_m,azimuth_std_rad,time_offset_s,"
        "range_width_m,azimuth_width_rad,range_rate_mps,elevation_rad,two_way_travel_time_s\n"
        "1,2,3,4,5,6,7,8,9,10,11,12\n"
    )
    (scan,) = read_recording(write(detections=text)).scans
    assert {name: value.tolist() for name, value in scan.fields.items()} == {
        "intensity": [1],
        "range": [3],
        "azimuth": [4],
        "range_std": [5],
        "azimuth_std": [6],
        "time_offset": [7],
        "range_width": [8],
        "azimuth_width": [9],
        "range_rate": [10],
        "elevation": [11],
        "two_way_travel_time": [12],
    }


def test_other_columns_are_left_out(write):
    text = "time_s,range_m,azimuth_rad,colour\n0,1,2,3\n"
    (scan,) = read_recording(write(detections=text)).scans
    assert set(scan.fields) == {"range", "azimuth"}


def test_spaces_and_a_byte_order_mark_do_no_harm(tmp_path):
    text = "time_s, range_m , azimuth_rad\r\n 0, 1 , 2\r\n"
    (tmp_path / "detections.csv").write_bytes(b"\xef\xbb\xbf" + text.encode())
    (scan,) = read_recording(tmp_path).scans
    assert scan.fields["range"].tolist() == [1.0]


def test_the_file_of_detections_names_the_recording_too(write):
    folder = write(detections=DETECTIONS)
    assert len(read_recording(folder / "detections.csv").scans) == 2
    assert len(read_recording(str(folder)).scans) == 2


def test_scans_known_to_the_own_ship_only_were_empty(write):
    own_ship = "scan,time_s,east_m,north_m\n0,0,1,2\n1,12,3,4\n2,24,5,6\n3,36,7,8\n"
    recording = read_recording(write(detections=DETECTIONS, own_ship=own_ship))
    assert [scan.time for scan in recording.scans] == [0.0, 12.0, 24.0, 36.0]
    assert [len(scan.fields["range"]) for scan in recording.scans] == [2, 0, 1, 0]
    assert set(recording.scans[1].fields) == {"range", "bearing"}


@pytest.mark.parametrize("without", ["detections", "own_ship"])
def test_without_scan_numbers_on_both_sides_no_scan_is_known_to_be_empty(write, without):
    files = {
        "detections": DETECTIONS,
        "own_ship": "scan,time_s,east_m,north_m\n0,0,1,2\n1,12,3,4\n2,24,5,6\n",
    }
    files[without] = files[without].replace("scan,", "number,")
    assert len(read_recording(write(**files)).scans) == 2


def test_motion_is_east_north_with_the_heading_turned_to_yaw(write):
    own_ship = (
        "time_s,east_m,east_mps,north_m,north_mps,heading_rad\n"
        f"10,5,1,6,2,0.0\n0,3,1,4,2,{math.pi / 2}\n"
    )
    motions = read_recording(write(detections=DETECTIONS, own_ship=own_ship)).own_ship
    assert [motion.time for motion in motions] == [0.0, 10.0]
    assert [motion.state.tolist() for motion in motions] == [[3, 1, 4, 2], [5, 1, 6, 2]]
    assert [motion.yaw for motion in motions] == pytest.approx([0.0, math.pi / 2])


def test_roll_and_pitch_are_taken_as_they_are(write):
    own_ship = "time_s,east_m,north_m,pitch_rad,roll_rad\n0,3,4,0.1,-0.2\n"
    (motion,) = read_recording(write(detections=DETECTIONS, own_ship=own_ship)).own_ship
    assert (motion.roll, motion.pitch) == (-0.2, 0.1)


def test_what_was_not_recorded_is_zero_speed_level_and_no_yaw(write):
    own_ship = "time_s,east_m,north_m\n0,3,4\n"
    (motion,) = read_recording(write(detections=DETECTIONS, own_ship=own_ship)).own_ship
    assert (motion.roll, motion.pitch) == (0.0, 0.0)
    assert motion.state.tolist() == [3, 0, 4, 0]
    assert motion.yaw is None


def test_targets_are_told_apart_by_their_number(write):
    target = "target,time_s,east_m,north_m\n7,0,1,2\n9,0,3,4\n7,12,5,6\n"
    targets = read_recording(write(detections=DETECTIONS, target=target)).targets
    assert {name: len(motions) for name, motions in targets.items()} == {7: 2, 9: 1}
    assert targets[7][1].state.tolist() == [5, 0, 6, 0]


def test_a_single_target_is_number_zero(write):
    target = "time_s,east_m,north_m\n0,1,2\n"
    assert list(read_recording(write(detections=DETECTIONS, target=target)).targets) == [0]


HEADER = "time_s,range_m,bearing_rad\n"


@pytest.mark.parametrize(
    ("files", "sentence"),
    [
        pytest.param({}, "detections.csv cannot be read", id="no file"),
        pytest.param({"detections": ""}, "detections.csv has no column 'time_s'", id="empty file"),
        pytest.param(
            {"detections": "time_s,bearing_rad\n0,1\n"},
            "detections.csv has no column 'range_m'; it has",
            id="no range",
        ),
        pytest.param(
            {"detections": "time_s,range_m\n0,1\n"},
            "detections.csv must have one of the columns azimuth_rad and bearing_rad",
            id="no angle",
        ),
        pytest.param(
            {"detections": "time_s,range_m,azimuth_rad,bearing_rad\n0,1,2,3\n"},
            "detections.csv must have one of the columns azimuth_rad and bearing_rad",
            id="two angles",
        ),
        pytest.param(
            {"detections": HEADER + "0,1,2\n0,far,2\n"},
            "detections.csv, line 3: expected 3 numbers, got ['0', 'far', '2']",
            id="a word",
        ),
        pytest.param(
            {"detections": HEADER + "0,1,2\n0,,2\n"}, "detections.csv, line 3", id="an empty cell"
        ),
        pytest.param(
            {"detections": HEADER + "0,1\n"}, "detections.csv, line 2", id="a cell too few"
        ),
        pytest.param(
            {"detections": HEADER + "0,1,2,3\n"}, "detections.csv, line 2", id="a cell too many"
        ),
        pytest.param({"detections": HEADER + "nan,1,2\n"}, "detections.csv: time_s", id="no time"),
        pytest.param(
            {"detections": DETECTIONS, "own_ship": "time_s,east_m\n0,1\n"},
            "own_ship.csv has no column 'north_m'",
            id="own ship without north",
        ),
        pytest.param(
            {"detections": DETECTIONS, "target": "time_s,east_m,north_m\n0,1,x\n"},
            "target.csv, line 2",
            id="a word in the truth",
        ),
        pytest.param(
            {"detections": HEADER + "0,1,2\n7\n"},
            "detections.csv, line 3",
            id="a single cell",
        ),
        pytest.param(
            {"detections": "scan," + HEADER + "nan,0,1,2\n"},
            "detections.csv: scan",
            id="no scan number",
        ),
        pytest.param(
            {"detections": DETECTIONS, "own_ship": "time_s,east_m,north_m\n0,nan,1\n"},
            "own_ship.csv: east_m",
            id="own ship nowhere",
        ),
        pytest.param(
            {"detections": DETECTIONS, "own_ship": "time_s,east_m,north_m,roll_rad\n0,1,1,nan\n"},
            "own_ship.csv: roll_rad",
            id="roll not known",
        ),
        pytest.param(
            {"detections": DETECTIONS, "target": "target,time_s,east_m,north_m\nnan,0,1,1\n"},
            "target.csv: target",
            id="no target number",
        ),
    ],
)
def test_a_malformed_recording_is_refused_by_file_and_column_or_line(write, files, sentence):
    with pytest.raises(ValueError) as refused:
        read_recording(write(**files))
    assert str(refused.value).startswith(sentence)


def test_a_file_that_is_no_text_is_refused_by_name(tmp_path):
    (tmp_path / "detections.csv").write_bytes(HEADER.encode() + b"0,1,\xff\xfe\n")
    with pytest.raises(ValueError, match=r"detections\.csv"):
        read_recording(tmp_path)


def test_blank_lines_at_the_end_do_no_harm(write):
    assert len(read_recording(write(detections=DETECTIONS + "\n\n")).scans) == 2


def test_a_recording_without_rows_has_no_scans(write):
    assert read_recording(write(detections=HEADER)).scans == []


@pytest.fixture(scope="module")
def joyride():
    return read_recording(JOYRIDE)


@pytest.mark.skipif(not JOYRIDE.exists(), reason="the joyride data is not here")
class TestJoyride:
    def test_it_has_all_scans_and_detections(self, joyride):
        assert len(joyride.scans) == 238
        assert sum(len(scan.fields["range"]) for scan in joyride.scans) == 432
        assert all(set(scan.fields) == {"range", "bearing"} for scan in joyride.scans)

    def test_own_ship_and_target_are_known_at_every_scan_without_a_heading(self, joyride):
        times = [scan.time for scan in joyride.scans]
        assert [motion.time for motion in joyride.own_ship] == times
        assert [motion.time for motion in joyride.targets[0]] == times
        assert {motion.yaw for motion in joyride.own_ship} == {None}
        assert min(np.diff(times)) > 0

    def test_true_bearings_from_the_own_ship_meet_the_target(self, joyride):
        # So the sign, the zero and the axes of bearing, east and north are read right. The data's
        # error is about 15 m.
        near = 0
        for scan, ship, target in zip(
            joyride.scans, joyride.own_ship, joyride.targets[0], strict=True
        ):
            range_, bearing = scan.fields["range"], scan.fields["bearing"]
            x = ship.state[0] + range_ * np.sin(bearing)
            y = ship.state[2] + range_ * np.cos(bearing)
            distance = np.hypot(x - target.state[0], y - target.state[2])
            near += bool((distance < 60.0).any())
        assert near / 238 == pytest.approx(0.80, abs=0.05)


def test_a_refused_row_is_cut_short(tmp_path):
    (tmp_path / "detections.csv").write_text("time_s,range_m,azimuth_rad\n1,2," + "x" * 10**5)
    with pytest.raises(
        ValueError, match=r"line 2: expected 3 numbers, got \['1', '2', 'xxx"
    ) as error:
        read_recording(tmp_path)
    assert len(str(error.value)) < 200
