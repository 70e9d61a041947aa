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
"""Gates: who has crossed, to which side, and who has not."""

from dataclasses import replace

import numpy as np
import pytest
from support.pages import confirmed_track

from tsepm_ros.tools.viewer.gates import HEAD, MAX_TRACKS, GateCounter
from tsepm_ros.tracker.tracks import TrackArrays, TrackStatus

LINE = (0.0, 0.0, 1000.0, 0.0)
ERROR = 5.0
"""Standard deviation of the tracks' places, m: clear of the line is 10 m."""


def counted(paths, *, interval=1.0, line=LINE, coasting=(), seed=None):
    """Crossings of paths, arrays of x and y by id; `coasting`: pairs of id and step."""
    counter, found = GateCounter([line]), []
    rng = np.random.default_rng(seed)
    covariance = np.diag([ERROR**2, 1.0, ERROR**2, 1.0])
    for step in range(max(map(len, paths.values()))):
        stamp = 100.0 + interval * step
        tracks = [
            confirmed_track(
                track_id,
                *(path[step] + (rng.normal(0.0, 2.0, 2) if seed is not None else 0.0)),
                stamp=stamp,
                age=stamp - 90.0,
                covariance=covariance,
                status=TrackStatus((track_id, step) in coasting),
            )
            for track_id, path in paths.items()
            if step < len(path)
        ]
        found += [
            one.split(",") for one in counter.observe(stamp, TrackArrays.from_tracks(tracks), "map")
        ]
    return counter, found


def across(x, begin, end, steps=60):
    return np.stack([np.full(steps, x), np.linspace(begin, end, steps)], axis=1)


def test_ten_cross_two_turn_back_on_the_line_and_one_coasts_across():
    """The ten are counted once each, by direction, though every place is in error by 2 m."""
    paths = {k: across(80.0 * k, -100.0, 100.0) for k in range(1, 7)}
    paths |= {k: across(80.0 * k, 100.0, -100.0) for k in range(7, 11)}
    for k in (11, 12):  # to 4 m beyond the line, where they stay for a while, and back
        paths[k] = np.concatenate(
            [
                across(60.0 * k, -100.0, 4.0),
                across(60.0 * k, 4.0, 4.0),
                across(60.0 * k, 4.0, -90.0),
            ]
        )
    paths[13] = across(900.0, -100.0, 100.0)
    coasting = {(13, step) for step in range(20, 60)}  # and is never detected again
    for interval in (0.1, 12.0):
        counter, found = counted(paths, interval=interval, coasting=coasting, seed=3)
        assert counter.counts == [[6, 4]]
        crossed = sorted((int(one[1]), one[3]) for one in found)
        assert crossed == [
            *((k, "to_left") for k in range(1, 7)),
            *((k, "to_right") for k in range(7, 11)),
        ]


def test_one_that_coasts_across_is_counted_once_it_is_detected_beyond():
    coasting = {(13, step) for step in range(20, 45)}
    counter, [crossing] = counted({13: across(900.0, -100.0, 100.0)}, coasting=coasting)
    assert counter.counts == [[1, 0]] and crossing[0] == "146.000"


def test_there_and_back_are_two_and_past_the_end_is_none():
    there = across(500.0, -100.0, 100.0)
    assert counted({1: np.concatenate([there, there[::-1]])})[0].counts == [[1, 1]]
    assert counted({1: across(1010.0, -100.0, 100.0), 2: across(-10.0, 99.0, -99.0)})[1] == []
    slanted = np.stack([np.linspace(900.0, 1200.0, 60), np.linspace(-100.0, 100.0, 60)], axis=1)
    assert counted({1: slanted})[1] == [], "the line is met at 1050 m"


@pytest.mark.parametrize("angle", [0.0, 1.0, 2.5, 4.0])
def test_left_is_that_of_who_looks_from_the_first_end_to_the_second(angle):
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    path = (turn @ across(500.0, -100.0, 100.0).T).T
    line = (0.0, 0.0, *(turn @ (1000.0, 0.0)))
    assert counted({1: path}, line=line)[0].counts == [[1, 0]]
    assert counted({1: path}, line=(*line[2:], *line[:2]))[0].counts == [[0, 1]]


def test_an_id_of_another_run_is_another_track():
    counter = GateCounter([LINE])
    before = confirmed_track(5, 500.0, -200.0, 0.0, 0.0, stamp=100.0, age=10.0)
    other = replace(before, state=np.array([500.0, 0.0, 200.0, 0.0]), stamp=200.0, age=20.0)
    for track, stamp in ((before, 100.0), (other, 200.0)):
        counter.observe(stamp, TrackArrays.from_tracks([track]), "map")
    assert counter.counts == [[0, 0]]
    counter.observe(
        300.0, TrackArrays.from_tracks([replace(before, stamp=300.0, age=120.0)]), "map"
    )
    assert counter.counts == [[0, 1]]
    counter.observe(50.0, TrackArrays.from_tracks([replace(other, stamp=50.0, age=120.0)]), "map")
    assert counter.counts == [[0, 1]], "stamps that go back are of another run"


def test_what_is_remembered_is_bounded():
    counter = GateCounter([LINE])
    for begin in range(0, 3 * MAX_TRACKS, 500):
        tracks = [confirmed_track(begin + k, 500.0, -200.0) for k in range(500)]
        counter.observe(100.0 + begin, TrackArrays.from_tracks(tracks), "map")
    assert len(counter._places[0]) == MAX_TRACKS


def test_a_crossing_is_a_line_of_csv():
    _, [crossing] = counted({7: across(500.0, -100.0, 100.0)})
    assert crossing[1:5] == ["7", "1", "to_left", "500.00"]
    assert len(crossing) == len(HEAD.split(","))
