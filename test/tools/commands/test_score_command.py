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
"""The command `tsepm score`: any two files of positions, and what is wrong with them."""

import pytest

from tsepm_ros.tools.commands.cli import main

TRUTH = "stamp,target_id,state_x,state_y\n"
TRACKS = "stamp,track_id,state_x,state_y\n"


@pytest.fixture
def scored(tmp_path, capsys):
    """Score texts of files; returns the code, the figures by name, and what is said."""

    def score(tracks: str, truth: str, *arguments: str) -> tuple[int, dict[str, float], str]:
        for name, text in (("tracks.csv", tracks), ("truth.csv", truth)):
            (tmp_path / name).write_text(text)
        paths = [str(tmp_path / name) for name in ("tracks.csv", "truth.csv")]
        code = main(["score", *paths, "--cutoff", "10", *arguments])
        out, err = capsys.readouterr()
        rows = (line.rsplit(None, 1) for line in out.splitlines()[2:])
        return code, {name.strip(): float(value) for name, value in rows}, err

    return score


def rows(*values: tuple[object, ...]) -> str:
    return "".join(",".join(map(str, row)) + "\n" for row in values)


def test_figures_by_hand(scored):
    truth = TRUTH + rows(*[(k, "ship", 0.0, 0.0) for k in range(4)])
    tracks = TRACKS + rows((1, 7, 3.0, 0.0), (2, 7, 0.0, 4.0), (2, 8, 90.0, 0.0), (3, 9, 0.0, 0.0))
    code, figures, _ = scored(tracks, truth)
    assert code == 0
    assert figures == pytest.approx(
        {
            "times": 4,
            "OSPA [m]": (10.0 + 3.0 + ((16 + 100) / 2) ** 0.5 + 0.0) / 4,
            "GOSPA, RMS [m]": ((50 + 9 + 16 + 50) / 4) ** 0.5,
            "localisation [m]": (25 / 4) ** 0.5,
            "missed [m]": (50 / 4) ** 0.5,
            "false [m]": (50 / 4) ** 0.5,
            "MOTA": 1.0 - (1 + 1 + 1) / 4,
            "MOTP [m]": 7.0 / 3,
            **{"targets": 4, "matches": 3, "misses": 1, "false": 1, "switches": 1},
        },
        abs=0.005,
    )


def test_a_run_of_a_scenario_writes_what_is_scored(scenario, tmp_path, capsys):
    out = tmp_path / "run"
    assert main(["run", scenario, "--out", str(out)]) == 0
    truth = str(out / "truth.csv")
    assert main(["score", str(out / "current.csv"), truth, "--cutoff", "300"]) == 0
    assert main(["score", truth, truth, "--cutoff", "300"]) == 0
    text = capsys.readouterr().out
    assert text.split("MOTA")[2].split()[0] == "1.0000", "the truth is where it is"
    assert main(["score", str(out / "tracks.csv"), truth, "--cutoff", "300"]) == 2
    assert "give current.csv" in capsys.readouterr().err


def test_positions_between_the_rows_of_another_rate_are_on_a_straight_line(scored):
    truth = TRUTH + rows(*[(0.5 * k, 1, 0.5 * k, 0.0) for k in range(9)])
    tracks = TRACKS + rows(*[(2.0 * k, 7, 2.0 * k, 0.0) for k in range(3)])
    code, figures, err = scored(tracks, truth)
    assert (code, figures["times"], figures["OSPA [m]"], figures["MOTA"]) == (0, 9, 0.0, 1.0)
    assert "a row every 2 s" in err and "a row every 0.5 s" in err


def test_in_a_gap_a_target_is_not_there_unless_the_user_says_so(scored):
    stamps = [0, 1, 2, 7, 8]
    truth = TRUTH + rows(*[(k, 1, 0.0, 0.0) for k in stamps])
    tracks = TRACKS + rows(*[(k, 7, 0.0, 0.0) for k in range(9)])
    _, figures, err = scored(tracks, truth)
    assert (figures["targets"], figures["false"]) == (5, 4)
    assert "not there in 1 gaps above 1.5 s" in err
    _, figures, _ = scored(tracks, truth, "--gap", "6")
    assert (figures["targets"], figures["false"]) == (9, 0)


def test_a_file_without_tracks_misses_all_and_a_truth_of_a_recording_needs_no_identity(scored):
    code, figures, said = scored(TRACKS, "time_s,east_m,north_m\n0,1,2\n1,1,2\n")
    assert "tracks.csv: it has no rows, so that every target is missed" in said
    assert (code, figures["misses"], figures["OSPA [m]"], figures["MOTA"]) == (0, 2, 10.0, 0.0)


def test_before_and_after_the_labels_a_track_is_false_or_left_out(scored):
    truth = TRUTH + rows((2, "fish", 0.0, 0.0), (3, "fish", 0.0, 0.0))
    tracks = TRACKS + rows(*[(k, 7, 0.0, 0.0) for k in range(6)])
    _, figures, said = scored(tracks, truth)
    assert (figures["false"], figures["matches"]) == (4, 2)
    assert "4 of 6 times are before or after the truth" in said and "--labelled" in said
    _, figures, said = scored(tracks, truth, "--labelled")
    assert (figures["false"], figures["matches"], figures["times"]) == (0, 2, 2)
    assert "before or after" not in said


def test_tracks_that_no_target_is_beside_at_any_time_are_said(scored):
    _, figures, said = scored(TRACKS + "1,7,0,0\n", TRUTH + "0,1,0,0\n2,2,0,0\n")
    assert figures["matches"] == 0 and "at no time is there a track and a target" in said


def test_a_measure_from_outside_is_the_mean_over_the_times(scored, tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(tmp_path))
    (tmp_path / "own_measures.py").write_text("def number(tracks, targets): return len(tracks)\n")
    tracks = TRACKS + rows((0, 7, 0.0, 0.0), (0, 8, 0.0, 0.0))
    truth = TRUTH + rows((0, 1, 0.0, 0.0), (1, 1, 0.0, 0.0))
    _, figures, _ = scored(tracks, truth, "--measure", "own_measures:number")
    assert figures["own_measures:number"] == 1.0


GOOD = TRUTH + "0,1,0,0\n1,1,0,0\n"


@pytest.mark.parametrize(
    ("tracks", "truth", "said"),
    [
        ("", GOOD, "tracks.csv is empty"),
        ("stamp,track_id,state_x\n", GOOD, "no column of the y (state_y or y or north_m)"),
        ("stamp,state_x,state_y\n", GOOD, "no column of the identity"),
        (TRACKS + "0,1,0\n", GOOD, "tracks.csv, line 2: expected 4 values"),
        (TRACKS + "0,1,0,north\n", GOOD, "tracks.csv, line 2: expected 3 numbers"),
        (TRACKS + "0,1\n", GOOD, "tracks.csv, line 2: expected"),
        (TRACKS, TRUTH + "0,1,0,nan\n", "truth.csv, line 2: time and position must be finite"),
        (TRACKS + "0,1,inf,0\n", GOOD, "tracks.csv, line 2: time and position must be finite"),
        (TRACKS, TRUTH, "truth.csv has no target to compare with: it has no rows"),
        (TRACKS, "status," + TRUTH + "lost,0,1,0,0\n", "no row has the status confirmed"),
        (TRACKS + "1,7,0,0\n0,7,0,0\n", GOOD, "line 3: 7 is at 0 s after 1 s"),
        (TRACKS + "1,7,0,0\n1,7,0,0\n", GOOD, "line 3: 7 is at 1 s after 1 s"),
        (TRACKS + "9,7,0,0\n", GOOD, "tracks.csv 9 to 9 s"),
        (TRACKS + "1700000009,7,0,0\n", GOOD, "tracks.csv 1700000009 to 1700000009 s, "),
        (TRACKS, "stamp,x,z\n", "column of the y"),
    ],
)
def test_a_bad_file_is_refused_with_its_line_or_column(scored, tracks, truth, said):
    code, _, err = scored(tracks, truth)
    assert code == 2
    assert said in err


def test_rows_of_tracks_that_coast_do_not_count(scored):
    truth = TRUTH + rows(*[(k, "ship", 0.0, 0.0) for k in range(3)])
    states = ("confirmed", "coasting", "stands_still")
    tracks = "stamp,track_id,state_x,state_y,status\n" + rows(
        *[(k, 7, 0.0, 0.0, state) for k, state in enumerate(states)]
    )
    _, figures, _ = scored(tracks, truth)
    assert figures["MOTA"] == pytest.approx(1 / 3, abs=1e-4)


def test_of_several_sensors_the_last_row_of_a_track_at_a_time_counts(scored):
    truth = TRUTH + rows((0, 1, 0.0, 0.0), (1, 1, 0.0, 0.0))
    tracks = "stamp,track_id,state_x,state_y,sensor\n" + rows(
        (0, 7, 5.0, 0.0, "port"), (0, 7, 3.0, 0.0, "starboard"), (1, 7, 3.0, 0.0, "port")
    )
    code, figures, _ = scored(tracks, truth)
    assert code == 0 and figures["MOTP [m]"] == 3.0 and figures["matches"] == 2
