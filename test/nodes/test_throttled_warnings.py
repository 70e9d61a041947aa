"""What the node logs of facts and of repeated drops."""

from __future__ import annotations

from unittest.mock import Mock

import pytest

from tsepm_ros.nodes import diagnostics_publisher
from tsepm_ros.nodes.diagnostics_publisher import ThrottledWarnings


@pytest.fixture
def node():
    return Mock()


@pytest.mark.parametrize("reason", ["intensity", "plots"])
def test_a_fact_is_no_warning(node, reason):
    ThrottledWarnings(node).warn(reason, "it is so", 0)
    node.get_logger().info.assert_called_once_with("it is so")
    node.get_logger().warning.assert_not_called()


@pytest.mark.parametrize(
    ("reason", "expected"), [("outside_coverage", 2), ("range_not_positive", 2), ("scan_late", 99)]
)
def test_dropped_detections_are_said_again_once_they_are_ten_times_as_many(
    node, monkeypatch, reason, expected
):
    """One in each of 99 pings that are 12 s apart; a dropped scan is said each time."""
    warnings = ThrottledWarnings(node)
    for ping in range(1, 100):
        monkeypatch.setattr(diagnostics_publisher.time, "monotonic", lambda ping=ping: 12.0 * ping)
        warnings.warn(reason, "dropped", ping if expected == 99 else ping * 2)
    assert node.get_logger().warning.call_count == expected
