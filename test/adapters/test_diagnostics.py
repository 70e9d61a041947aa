"""Health as diagnostic_msgs/DiagnosticArray."""

from __future__ import annotations

import pytest
from diagnostic_msgs.msg import DiagnosticStatus

from msg_adapters import diagnostics
from tsepm_ros.diagnostics.health_figures import Level, Status

LEVELS = {
    Level.OK: DiagnosticStatus.OK,
    Level.WARN: DiagnosticStatus.WARN,
    Level.ERROR: DiagnosticStatus.ERROR,
    Level.STALE: DiagnosticStatus.STALE,
}


@pytest.mark.parametrize("level", Level)
def test_levels_are_those_of_the_message(level, over_the_wire):
    [status] = over_the_wire(diagnostics(0, "node", [Status("task", level, "said", {})])).status
    assert status.level == LEVELS[level]
    assert (status.name, status.message) == ("node: task", "said")


def test_statuses_and_values_keep_their_order_and_floats_have_six_digits(over_the_wire):
    values = {"b": 1 / 3, "a": 7, "c": "text", "d": float("nan")}
    statuses = [Status("two", Level.OK, "", values), Status("one", Level.OK, "", {})]
    message = over_the_wire(diagnostics(1_700_000_000_123_456_789, "node", statuses))
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (1_700_000_000, 123_456_789)
    assert [status.name for status in message.status] == ["node: two", "node: one"]
    found = [(value.key, value.value) for value in message.status[0].values]
    assert found == [("b", "0.333333"), ("a", "7"), ("c", "text"), ("d", "nan")]
