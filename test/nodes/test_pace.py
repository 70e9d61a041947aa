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
"""How long messages waited, and which are passed over where they come too fast."""

from typing import Any

import pytest

from tsepm_ros.nodes import pace as module
from tsepm_ros.nodes.pace import Pace, newest_at_pace, pace_seconds_in_queue

NOW = 1_700_000_000_000_000_000


def about(waited: float, received: bool = True) -> dict[str, int]:
    stamp = NOW - round(waited * 1e9)
    return {"received_timestamp": stamp * received, "source_timestamp": stamp - 7 * received}


@pytest.mark.parametrize("received", [True, False])
def test_the_time_in_the_queue_is_from_the_arrival_or_else_from_the_publication(
    monkeypatch, received
):
    monkeypatch.setattr(module.time, "time_ns", lambda: NOW)
    assert pace_seconds_in_queue(about(1.5, received)) == pytest.approx(1.5)


@pytest.mark.parametrize("waited", [-3.0, 1e4])
def test_clocks_that_differ_tell_nothing(monkeypatch, waited):
    monkeypatch.setattr(module.time, "time_ns", lambda: NOW)
    assert pace_seconds_in_queue(about(waited)) == 0.0
    assert pace_seconds_in_queue({"received_timestamp": 0, "source_timestamp": 0}) == 0.0


@pytest.mark.parametrize(
    ("waited", "interval", "taken"),
    [(1.0, 0.05, "oldest"), (3.0, 0.05, "newest"), (3.0, 12.0, "oldest"), (3.0, 0.0, "oldest")],
)
def test_the_newest_is_taken_where_the_oldest_waited_too_long(monkeypatch, waited, interval, taken):
    monkeypatch.setattr(module.time, "time_ns", lambda: NOW)
    others: list[tuple[Any, Any]] = [("middle", about(2.0)), ("newest", about(0.5))]
    message, information, skipped = newest_at_pace(
        "oldest", about(waited), interval, lambda: others
    )
    assert message == taken
    expected = (waited, []) if taken == "oldest" else (0.5, ["oldest", "middle"])
    assert (information, skipped) == (about(expected[0]), expected[1])


def test_alone_in_the_queue_it_is_taken_however_late(monkeypatch):
    monkeypatch.setattr(module.time, "time_ns", lambda: NOW)
    assert newest_at_pace("oldest", about(9.0), 0.05, list) == ("oldest", about(9.0), [])


def passed(pace: Pace, *batches: list[float], seconds: float) -> list[int]:
    """Images passed over, of batches that wait; each batch's last takes so long."""
    numbers = []
    for stamps in batches:
        numbers.append(pace.came(stamps))
        pace.arrived = pace._free
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(module.time, "monotonic", lambda: pace._free + seconds)
            pace.done()
    return numbers


def test_images_faster_than_they_are_processed_are_counted_with_those_overwritten():
    pace = Pace()
    assert passed(pace, [0.0], [0.1], seconds=0.3) == [0, 0]
    assert pace.is_behind and (pace.interval, pace.time) == pytest.approx((0.1, 0.3))
    assert passed(pace, [0.2, 0.3, 0.4], seconds=1.5) == [2]
    assert passed(pace, [1.9, 2.0, 2.1, 2.2], seconds=0.3) == [17], "14 never waited here"
    assert passed(pace, [9.0], seconds=0.25) == [0], "a sonar that paused has lost nothing"
    assert passed(pace, [600.0, 600.1], seconds=0.3)[0] <= 1 + 3, "nor before two that wait"
    assert pace.age == pytest.approx(0.3)


@pytest.mark.parametrize("step", [12.0, 0.0, -1.0])
def test_a_slow_sonar_and_one_without_stamps_are_never_behind(step):
    pace = Pace()
    assert sum(passed(pace, *[[step * k] for k in range(20)], seconds=1.0)) == 0
    assert not pace.is_behind


def test_a_sonar_that_becomes_slower_is_followed():
    pace = Pace()
    passed(pace, *[[0.1 * k] for k in range(20)], seconds=0.5)
    assert pace.is_behind
    passed(pace, *[[2.0 + 1.0 * k] for k in range(9)], seconds=0.5)
    assert not pace.is_behind


def test_images_that_the_publisher_numbers_add_up():
    pace, heard = Pace(), 0
    # While the first was processed, 30 came, of which a queue of 10 kept the last.
    for numbers, busy in (([5], 3.0), ([26], 3.0), ([*range(47, 57)], 0.05), ([60], 0.05)):
        heard += 1 + pace.came([0.1 * number for number in numbers], numbers[-1])
        pace._times.append(busy)
    assert (heard, pace.lost) == (54, 2), "of the last 3 the node was busy when one came"
    assert pace.came([0.7], 1) == 0 and pace.lost == 2, "a driver that began anew"


def test_who_is_behind_takes_the_newest_at_once(monkeypatch):
    monkeypatch.setattr(module.time, "time_ns", lambda: NOW)
    others = [("newest", about(0.0))]
    assert newest_at_pace("oldest", about(0.2), 0.1, lambda: others, True)[::2] == (
        "newest",
        ["oldest"],
    )
