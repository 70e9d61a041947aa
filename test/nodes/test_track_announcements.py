"""Log lines of confirmed tracks, of their ends, of facts and of drops: never a flood."""

import re
from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest
from support.boat import Boat
from support.sonar_driver import pings, points

from tsepm_ros.nodes import base_node
from tsepm_ros.nodes.base_node import ParameterisedNode
from tsepm_ros.nodes.publishers import (
    MAX_LINES,
    PERIOD,
    TrackAnnouncements,
    announcement,
)
from tsepm_ros.tracker.maintenance.track_maintenance import ENDS
from tsepm_ros.tracker.tracks import ConfirmedTrack

STATE = np.array([100.0, 3.0, -50.0, 4.0])


def track(number: int) -> ConfirmedTrack:
    return ConfirmedTrack(number, 1.0, STATE, np.eye(4), ((0, 0), (1, 2)), 0.0)


def test_a_line_has_the_id_the_place_the_speed_the_hits_and_the_reason():
    assert announcement(track(7), "odom", "2 hits in 2 pings; because") == (
        "track 7 confirmed at x 100.0 m, y -50.0 m in odom, 5.0 m/s towards 53 deg from x: "
        "2 hits in 2 pings; because"
    )


class Spoken(list):
    """Lines of announcements at set times."""

    def __init__(self) -> None:
        super().__init__()
        self.time = 0.0
        self._announced = TrackAnnouncements(self.append, lambda: self.time)
        self.number = 0

    def confirm(self, number: int) -> None:
        new = [track(self.number + index) for index in range(number)]
        self.number += number
        self.take(new, {})

    def take(self, new: list[ConfirmedTrack], ended: dict[int, str]) -> None:
        result = SimpleNamespace(new=new, ended=ended, frame_id="odom")
        self._announced.announce(result, lambda _: "why")


@pytest.mark.parametrize("reason", ENDS)
def test_the_end_of_a_track_is_one_line_with_its_reason(reason):
    spoken = Spoken()
    spoken.take([], {7: reason})
    spoken.take([], {})
    assert spoken == [f"track 7 ended: {ENDS[reason]}"]


def test_a_flood_of_ends_is_summed_and_leaves_the_lines_of_starts():
    spoken = Spoken()
    spoken.take([], dict.fromkeys(range(50), "missed"))
    spoken.take([track(60)], {})
    assert len(spoken) == MAX_LINES + 2
    assert spoken[MAX_LINES].startswith("40 more ended tracks (ids 10 to 49)")
    assert spoken[-1].startswith("track 60 confirmed")


@pytest.mark.parametrize("each", [1, 3, 50])
def test_a_flood_over_many_pings_stays_readable_and_every_track_is_counted(each):
    spoken = Spoken()
    for _ in range(1000):
        spoken.confirm(each)
        spoken.time += 0.1
    spoken.time += PERIOD
    spoken.confirm(0)
    periods = 1000 * 0.1 / PERIOD
    assert len(spoken) <= (periods + 1) * (MAX_LINES + 2)
    singles = sum(line.startswith("track ") for line in spoken)
    left_out = sum(int(re.match(r"(\d+) more", line)[1]) for line in spoken if "more" in line)
    assert singles + left_out == 1000 * each


def test_the_node_logs_each_confirmed_track(world):
    boat = Boat(world)
    received = boat.send(pings(16))
    [point] = [point for message in received for point in points(message)][:1]
    line = world.until_logged(f"track {point['track_id']} confirmed at", level=20)
    assert f"x {point['state_x']:.1f} m, y {point['state_y']:.1f} m in sonar" in line
    assert f"{np.hypot(point['state_vx'], point['state_vy']):.1f} m/s" in line
    assert re.search(r"\d+ hits in \d+ pings", line)


@pytest.fixture
def node():
    return Mock(_last={}, _said={})


@pytest.mark.parametrize("reason", ["intensity", "plots"])
def test_a_fact_is_no_warning(node, reason):
    ParameterisedNode.warn(node, reason, "it is so")
    node.get_logger().info.assert_called_once_with("it is so")
    node.get_logger().warning.assert_not_called()


@pytest.mark.parametrize(
    ("reason", "expected"), [("outside_coverage", 2), ("range_not_positive", 2), ("scan_late", 99)]
)
def test_dropped_detections_are_said_again_once_they_are_ten_times_as_many(
    node, monkeypatch, reason, expected
):
    """One in each of 99 pings that are 12 s apart; a dropped scan is said each time."""
    for ping in range(1, 100):
        monkeypatch.setattr(base_node.time, "monotonic", lambda ping=ping: 12.0 * ping)
        ParameterisedNode.warn(node, reason, "dropped", ping if expected == 99 else ping * 2)
    assert node.get_logger().warning.call_count == expected
