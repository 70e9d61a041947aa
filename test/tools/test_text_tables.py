"""Tables of text."""

from __future__ import annotations

from tsepm_ros.tools.terminal import text_table


def test_columns_of_a_table_line_up():
    lines = text_table(["name", "value"], [["a", "1.0"], ["long name", "10.0"]]).splitlines()
    assert lines == ["name       value", "----------------", "a            1.0", "long name   10.0"]
