"""Messages that waited in the middleware's queue: how long, and which is taken."""

from typing import Any

import pytest

pytest.importorskip("rclpy")

from tsepm_ros.nodes import subscriptions
from tsepm_ros.nodes.subscriptions import newest, seconds_in_queue

NOW = 1_700_000_000_000_000_000


def about(waited: float, received: bool = True) -> dict[str, int]:
    stamp = NOW - round(waited * 1e9)
    return {"received_timestamp": stamp * received, "source_timestamp": stamp - 7 * received}


@pytest.mark.parametrize("received", [True, False])
def test_the_time_in_the_queue_is_from_the_arrival_or_else_from_the_publication(received):
    assert seconds_in_queue(about(1.5, received), NOW) == pytest.approx(1.5)


@pytest.mark.parametrize("waited", [-3.0, 1e4])
def test_clocks_that_differ_tell_nothing(waited):
    assert seconds_in_queue(about(waited), NOW) == 0.0
    assert seconds_in_queue({"received_timestamp": 0, "source_timestamp": 0}, NOW) == 0.0


@pytest.mark.parametrize(
    ("waited", "interval", "taken"),
    [(1.0, 0.05, "oldest"), (3.0, 0.05, "newest"), (3.0, 12.0, "oldest"), (3.0, 0.0, "oldest")],
)
def test_the_newest_is_taken_where_the_oldest_waited_too_long(monkeypatch, waited, interval, taken):
    monkeypatch.setattr(subscriptions.time, "time_ns", lambda: NOW)
    others: list[tuple[Any, Any]] = [("middle", about(2.0)), ("newest", about(0.5))]
    message, late, skipped = newest("oldest", about(waited), interval, lambda: others)
    assert message == taken
    assert (late, skipped) == (pytest.approx(waited), 0) if taken == "oldest" else (0.5, 2)


def test_alone_in_the_queue_it_is_taken_however_late(monkeypatch):
    monkeypatch.setattr(subscriptions.time, "time_ns", lambda: NOW)
    assert newest("oldest", about(9.0), 0.05, list) == ("oldest", pytest.approx(9.0), 0)
