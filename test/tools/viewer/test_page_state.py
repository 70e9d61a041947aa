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
"""What a page shows: bounded, announced when it changes, and what browsers say."""

import json
import math

import numpy as np
import pytest
from support.pages import confirmed_track, live_state, numbered

from tsepm_ros.tools.viewer import page_state
from tsepm_ros.tools.viewer.page_content import page_track_facts
from tsepm_ros.tools.viewer.page_state import PageState


def since(state: PageState, version: int = 0):
    text, newest = state.since(version)
    return json.loads(text), newest


def numbers(message) -> list[int]:
    return [frame["number"] for frame in message.get("frames", [])]


def test_a_frame_with_the_same_number_replaces_the_last_one():
    state = live_state(3)
    _, version = since(state)
    state.put(numbered(3, confirmed_track(1, 0.0, 0.0), confirmed_track(2, 0.0, 0.0)))
    message, _ = since(state, version)
    assert numbers(message) == [3] and len(message["frames"][0]["tracks"]) == 2
    assert numbers(since(state)[0]) == [1, 2, 3]


def test_the_number_and_the_size_of_the_frames_are_bounded_and_the_newest_is_kept():
    assert numbers(since(live_state(50, kept=10))[0]) == list(range(41, 51))
    state = PageState({}, 1000, max_bytes=20_000)
    many = np.arange(2000.0).reshape(-1, 2)
    for number in range(1, 30):
        state.put(numbered(number, detections=many))
        text, _ = state.since()
        assert len(text) < 40_000
    assert numbers(json.loads(text))[-1] == 29


def test_facts_of_tracks_that_are_shown_nowhere_are_forgotten():
    state = PageState({}, 10)
    state.put_health({})
    for number in range(1, 500):
        track = confirmed_track(number, 0.0, 0.0)
        state.put(numbered(number, track), page_track_facts([track], None))
        state.put_health({})  # another change with each frame
        assert len(since(state)[0]["facts"]) <= 21
    facts = since(state)[0]["facts"]
    assert {str(number) for number in range(490, 500)} <= set(facts)


def test_every_change_is_announced():
    state, heard = live_state(), []
    state.changed = lambda: heard.append(state.since()[1])
    state.put(numbered(1))
    state.put_health({"/n": {"level": 0, "entries": []}})
    state.put_info(title="")
    assert len(set(heard)) == 3
    state.put_info(title="")
    assert len(heard) == 3, "what is known already changes nothing"


@pytest.mark.parametrize(
    "words",
    [
        "[" * 4000,
        f'{{"alarm": {{"alarm.cpa": {"1" * 400}}}}}',
        f'{{"acknowledge": {{"cpa 7": {"1" * 400}}}}}',
        f'{{"acknowledge": {{"cpa 7": {"1" * 5000}}}}}',
        '{"acknowledge": [1]}',
        "null",
        b"\xff",
    ],
)
def test_words_of_a_browser_that_are_not_understood_are_nothing(words):
    state, asked = PageState({}, 10), []
    state.asked = lambda content: asked.append(float(content.get("acknowledge").get("cpa 7")))
    state.hear(words)
    state.hear('{"acknowledge": {"cpa 7": 1}}')
    assert asked in ([1.0], [math.inf, 1.0])


def test_of_each_node_the_newest_health_is_kept_with_when_it_was_heard(monkeypatch):
    state = live_state()
    for seconds, node in ((10.0, "/a"), (11.0, "/b"), (12.5, "/a")):
        monkeypatch.setattr(page_state.time, "monotonic", lambda seconds=seconds: seconds)
        state.put_health({node: {"node": node, "level": 0, "entries": []}})
    assert [[one["node"], one["heard"], one["period"]] for one in since(state)[0]["health"]] == [
        *(["/a", 12_500, 2500], ["/b", 11_000, 0])
    ]
