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
"""Every sentence of the inputs of every node goes on while its cause lasts, and off again."""

import math
from collections import Counter

import pytest

from tsepm_ros.diagnostics.health_figures import Connections, Level
from tsepm_ros.diagnostics.input_health import INPUTS, LOST_AFTER, NODE, NodeHealth

THERE = Connections(topic="/input")


class Node:
    """A node with one input of an entry, on one clock: healthy, but for what is set."""

    def __init__(self, task, interval):
        self.health, self.task = NodeHealth({task: "message"}), task
        self.time, self.interval = 1000.0, interval
        self.arrives, self.is_usable, self.connections, self.found = True, True, THERE, {}
        self.reason, self.dropped = "", Counter()

    def step(self):
        """One interval; the status after it."""
        self.time += self.interval
        if self.arrives:
            self.health.heard(self.task, self.time, self.time if self.is_usable else None)
        if self.reason:
            self.dropped[self.reason] += 1
            self.health.dropped(self.reason, self.time, self.dropped[self.reason])
        given = {self.task: self.connections}, {self.task: self.found}
        _, status, *_ = self.health.report_inputs(self.time, self.dropped, *given)
        return status

    def steps(self, seconds):
        number = max(math.ceil(seconds / self.interval), 4)
        return [self.step() for _ in range(number)][-1]


def findings(subject):
    return {"found": {"findings": {subject: "as found"}}}


GONE = Connections(topic="/input", publishers=())
LOSES = {"reason": "short_data"}
CAUSES = {
    "type that is not read": {"connections": Connections(unread=["x/Y"], topic="/input")},
    "Nothing has arrived": {"arrives": False, "connections": GONE},
    "for a minute": {"arrives": False},
    "overdue": {"arrives": False},
    "Own ship is older": {"found": {"behind": 3.5}},
    "Input of this entry is dropped": LOSES,
    "No image could be used": {"reason": "short_data", "is_usable": False},
    "Images come too fast": findings("slow"),
    "Bearings make no turn": findings("turns"),
    "An image has one value": findings("content"),
    "Fixed echoes lie": findings("range"),
    "The ranges or bearings of images": findings("anew"),
    "Playback waits": findings("subscribers"),
    "A callback failed": {"reason": "internal_error"},
}
"""What causes each condition, by a part of it."""
FIRST = ("type that is not read", "Nothing has arrived", "No image could be used")
"""Conditions of an input that has not been heard yet."""
RULES = [(task, rule) for task, entry in INPUTS.items() for rules in entry.rules for rule in rules]


@pytest.mark.parametrize("interval", [0.1, 1.0, 12.0])
@pytest.mark.parametrize(("task", "rule"), RULES, ids=lambda part: getattr(part, "condition", part))
def test_a_sentence_is_there_while_its_cause_lasts_and_gone_within_twice_the_interval(
    task, rule, interval
):
    (part,) = [part for part in CAUSES if part in rule.condition]
    node, healthy = Node(task, interval), {}
    if part not in FIRST:
        assert node.steps(10.0).level == Level.OK
    for name, value in CAUSES[part].items():
        healthy[name] = getattr(node, name)
        setattr(node, name, value)
    status = node.steps(70.0 if part == "for a minute" else 5.0)
    assert status.level == rule.level, status.message
    assert all(node.step().level > Level.OK for _ in range(5)), "without a break"
    for name, value in healthy.items():
        setattr(node, name, value)
    node.step()
    at_most = max(2.0 * interval, 1.5)
    status = [node.step() for _ in range(math.ceil(at_most / interval))][-1]
    assert status.level == Level.OK, status.message
    total = node.dropped.total()
    assert sum(int(n) for name, n in status.values.items() if "dropped." in name) == total, "stays"


@pytest.mark.parametrize("part", sorted(CAUSES))
def test_the_table_has_no_cause_of_a_condition_that_is_no_more(part):
    assert any(part in rule.condition for _, rule in RULES)


def test_a_publisher_of_which_nothing_arrives_is_said_with_what_may_lose_it():
    node = Node("images", 1.0)
    node.arrives, node.connections = False, GONE
    assert node.steps(30.0).message == "no publisher of /input yet"
    node.connections = Connections(topic="/input", best_effort=True)
    assert node.steps(8.0).message == "no message yet, though /input is published"
    said = node.steps(LOST_AFTER).message
    assert "published for 18 s: its publisher sends nothing, or all is lost" in said
    assert "best effort" in said and "net.core.rmem_max" in said
    node.connections = THERE
    assert "best effort" not in node.step().message


def test_own_ship_of_another_epoch_is_said_with_how_far_it_is_off():
    node = Node("own ship", 1.0)
    node.found = {"behind": -59.0}  # images may wait
    assert node.steps(5.0).level == Level.OK
    node.found = {"behind": -1.8e9, "user": "image"}
    assert node.step().message == "message is 1.8e+09 s newer than the newest image"


def test_what_stops_is_told_from_what_is_gone():
    node = Node("images", 1.0)
    node.steps(10.0)
    node.arrives = False
    assert node.steps(5.0).message == "no message for 5 s, expected is one every 1 s"
    node.connections = GONE
    assert node.step().message.endswith("; its publisher is gone")


def test_unused_images_are_said_also_when_no_more_come():
    node = Node("images", 1.0)
    node.is_usable, node.reason = False, "short_data"
    assert "none of the messages so far could be used" in node.steps(5.0).message
    node.arrives, node.reason = False, ""
    assert node.steps(20.0).message == "none of the messages so far could be used"


def test_a_dropped_bearing_of_the_first_turn_is_not_said_of_all_images():
    node = Node("images", 1.0)
    node.is_usable, node.reason = False, "short_data"
    node.found = {"findings": {"turns": "no turn yet"}}
    assert "so far could be used" not in node.steps(5.0).message


def test_drops_stand_in_the_entry_of_their_input():
    health = NodeHealth({"tracks": "message", "own ship": "pose", "fix": "fix"})
    reasons = {"bad_tracks": "tracks", "frames": "own ship", "own_ship_stale": "own ship"}
    reasons |= {"fix_jump": "fix", "internal_error": NODE, "not_sent": "tracks"}
    statuses = health.report_inputs(0.0, dict.fromkeys(reasons, 1), {}, {})
    found = {
        name.removeprefix("dropped."): status.task
        for status in statuses[1:]
        for name in status.values
        if name.startswith("dropped.")
    }
    assert found == reasons
