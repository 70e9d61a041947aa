"""Files of runs, found again only by what they belong to, and result files."""

import dataclasses
import json

import pytest
from support.run_summaries import run_of, start

from tsepm_ros.tools.evaluation.performance import run_file
from tsepm_ros.tools.evaluation.result_files import (
    Result,
    RunFile,
    printed,
    read_result,
    write_result,
    write_table,
)
from tsepm_ros.tools.evaluation.simulated_run import OperatingPoint
from tsepm_ros.tools.simulation import load_scenario

BOX = load_scenario("box")
POINT = OperatingPoint("score", "1/h", {"false_tracks_per_hour": 1.0}, version="1")
SUMMARIES = {0: run_of(), 1: run_of(start(2), false=(0, 1, 0, 2)), 4: run_of(start(1))}
RECORDS = {index: summary.as_json() for index, summary in SUMMARIES.items()}


@pytest.fixture
def file(tmp_path) -> RunFile:
    made = run_file(tmp_path, BOX, POINT, 1)
    for index, record in RECORDS.items():
        made.append(index, record)
    return made


def test_a_header_says_what_the_runs_depend_on(file):
    header = json.loads(file.path.read_text().splitlines()[0])
    assert header["method"] == "score"
    assert header["options"] == {"false_tracks_per_hour": 1.0}
    assert header["scenario"]["sensor"]["clutter_density"] == 1e-6
    assert (header["seed"], header["version"]) == (1, "1")


@pytest.mark.parametrize(
    "other",
    [
        {"seed": 2},
        {"point": dataclasses.replace(POINT, options={"false_tracks_per_hour": 2.0})},
        {"point": dataclasses.replace(POINT, version="2")},
        {"scenario": load_scenario("box", {"sensor.azimuth_std": 0.02})},
        {"scenario": load_scenario("box", {"scans": 8})},
    ],
    ids=["seed", "options", "version", "sensor", "scans"],
)
def test_anything_else_has_a_file_of_its_own(file, tmp_path, other):
    found = run_file(tmp_path, **{"scenario": BOX, "point": POINT, "seed": 1, **other})
    assert found.path != file.path
    assert found.results == {}
    assert run_file(tmp_path, BOX, POINT, 1).results == RECORDS


def test_a_file_under_another_s_name_is_refused(file, tmp_path):
    other = run_file(tmp_path, BOX, POINT, 2)
    file.path.replace(other.path)
    with pytest.raises(ValueError, match="was made by another version"):
        run_file(tmp_path, BOX, POINT, 2)


def test_a_header_that_was_cut_off_is_written_again(file, tmp_path):
    content = file.path.read_bytes()
    file.path.write_bytes(content[:20])
    assert run_file(tmp_path, BOX, POINT, 1).results == {}
    assert file.path.read_bytes() == content.splitlines(keepends=True)[0]


def test_a_line_damaged_in_the_middle_is_refused(file, tmp_path):
    lines = file.path.read_bytes().splitlines(keepends=True)
    file.path.write_bytes(b"".join([*lines[:2], b'[1, {"tar\n', *lines[3:]]))
    with pytest.raises(ValueError, match="is damaged"):
        run_file(tmp_path, BOX, POINT, 1)


@pytest.mark.parametrize(
    "line", ["5", "[1]", '["a", {}]', "null", '{"a": 1}', "[" * 100_000, "[true, 1]"]
)
def test_a_line_that_is_no_run_is_named(tmp_path, line):
    file = RunFile(tmp_path, ["box"], {"version": 1})
    file.append(0, {"a": 1})
    with file.path.open("a") as content:
        content.write(line + "\n")
    with pytest.raises(ValueError, match=r"is damaged: .* is not a run") as error:
        RunFile(tmp_path, ["box"], {"version": 1})
    assert len(str(error.value)) < 400


def test_a_result_is_read_as_it_was_written(tmp_path):
    path = tmp_path / "deep" / "a.json"
    result = Result(
        command="tsepm evaluate",
        seed=1,
        runs=2,
        parameters={"window": 8},
        header=["a"],
        rows=[["±"]],
    )
    write_result(path, result)
    assert read_result(path) == result
    path.write_text("[1]")
    with pytest.raises(ValueError, match="not a result file"):
        read_result(path)


def test_a_table_is_written_only_where_a_file_is_named(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path, table = tmp_path / "a.json", (["a", "b"], [["1", "2"], ["3", "4"]])
    write_table(None, "python a.py", table, seed=3, runs=7)
    assert not list(tmp_path.iterdir())
    write_table(path, "python a.py", table, seed=3, runs=7)
    expected = Result(command="python a.py", seed=3, runs=7, header=table[0], rows=table[1])
    assert read_result(path) == expected


def test_a_table_is_printed_row_by_row(capsys):
    assert printed(iter([["a", "b"], ["1", "2"]])) == (["a", "b"], [["1", "2"]])
    assert capsys.readouterr().out == "| a | b |\n|---|---|\n| 1 | 2 |\n"
