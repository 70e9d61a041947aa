"""Result files, and the tables that are printed while they are made."""

from __future__ import annotations

import pytest

from tsepm_ros.tools.evaluation.result_files import (
    Result,
    read_result,
    write_result,
    write_table,
)


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
