"""What the server keeps, and what each browser gets of it."""

from __future__ import annotations

import json

import numpy as np
from support.pages import held, live_state, numbered

from tsepm_ros.tools.viewer.page_frames import track_facts
from tsepm_ros.tools.viewer.page_state import PageState


def since(state: PageState, version: int = 0):
    text, newest = state.since(version)
    return json.loads(text), newest


def numbers(message) -> list[int]:
    return [frame["number"] for frame in message.get("frames", [])]


def test_a_frame_with_the_same_number_replaces_the_last_one():
    state = live_state(3)
    _, version = since(state)
    state.put(numbered(3, held(1, 0.0, 0.0), held(2, 0.0, 0.0)))
    message, _ = since(state, version)
    assert numbers(message) == [3] and len(message["frames"][0]["tracks"]) == 2
    assert numbers(since(state)[0]) == [1, 2, 3]


def test_the_number_of_frames_is_bounded():
    assert numbers(since(live_state(50, kept=10))[0]) == list(range(41, 51))


def test_the_size_of_the_frames_is_bounded_and_the_newest_is_kept():
    state = PageState({}, 1000, max_bytes=20_000)
    many = np.arange(2000.0).reshape(-1, 2)
    for number in range(1, 30):
        state.put(numbered(number, detections=many))
        text, _ = state.since()
        assert len(text) < 40_000
    assert numbers(json.loads(text))[-1] == 29


def test_facts_of_tracks_that_are_shown_nowhere_are_forgotten():
    state = PageState({}, 10)
    for number in range(1, 500):
        track = held(number, 0.0, 0.0)
        state.put(numbered(number, track), track_facts([track], None))
        assert len(since(state)[0]["facts"]) <= 21
    facts = since(state)[0]["facts"]
    assert {str(number) for number in range(490, 500)} <= set(facts)


def test_every_change_is_announced():
    state, heard = live_state(), []
    state.changed = lambda: heard.append(state.version)
    state.put(numbered(1))
    state.put_health({"level": 0, "entries": []})
    state.put_info(title="")
    assert len(set(heard)) == 3
