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
"""The benchmark of the whole chain: its parts run, and its rows count what they say."""

import argparse
import math
from dataclasses import replace
from types import SimpleNamespace

import chain
import numpy as np
import pytest
from chain import Ping, Watch
from chain_scenes import MOVES, RESTS, Target, data_sheet, nowhere, on_bottom_structure

from tsepm_ros.detector.image import DetectorOptions
from tsepm_ros.tracker.options import CommonOptions
from tsepm_ros.tracker.sensor import SensorModel
from tsepm_ros.tracker.tracks import ConfirmedTrack, TrackArrays, TrackStatus


def options(**given) -> argparse.Namespace:
    told = {"images": 4, "seeds": 1, "seed": 1, "workers": 1, "kalman": ["3/5"], "poses": ["white"]}
    return argparse.Namespace(**{**told, **given})


@pytest.mark.long
@pytest.mark.parametrize("part", [part for part in chain.PARTS if part not in chain.RECORDED])
def test_a_few_images_of_a_part_give_its_rows(part, monkeypatch):
    monkeypatch.setattr(chain, "SIZES", chain.SIZES[1:])
    rows = chain.part_rows(part, options())
    kinds = {title.split(": ")[1] for title in rows}
    disturbed = {"as they are", *chain.DISTURBED}
    assert kinds == {"detections"} | (
        disturbed if part == "chance" else {"score 10/h", "score 1/h", "kalman 3/5"}
    )
    assert all(
        "false a scan" in rows[t] for t in rows if t.endswith("s: detections") and "," not in t
    )


def test_nothing_but_the_data_sheet_is_set():
    detector, tracker = chain.initialised(data_sheet(max_range=30, sector=90, beam_width=1), 10.0)
    assert detector[DetectorOptions] == DetectorOptions()
    learned = replace(CommonOptions(), detection_probability="estimated")
    assert tracker[CommonOptions] == learned  # as `tsepm init` asks for it
    assert tracker[SensorModel].max_range == 30.0
    assert tracker[SensorModel].sector_width == pytest.approx(math.pi / 2, abs=1e-4)


def track(number: int, x: float, status: TrackStatus = TrackStatus.CONFIRMED) -> ConfirmedTrack:
    state = np.array([x, 0.0, 0.0, 0.0])
    covariance = np.diag([0.01, 1.0, 0.01, 1.0])
    return ConfirmedTrack(number, 0.0, state, covariance, (), 0.0, status=status)


def watched(*scans: tuple[list[ConfirmedTrack], list[tuple[float, str]]]) -> Watch:
    """A watch of tracks and targets on the x axis, a scan in ten seconds, gate 1 m."""
    watch, none = Watch(1.0, nowhere, 360.0), TrackArrays.from_tracks([])
    for number, (tracks, targets) in enumerate(scans):
        truth = {}
        for name, (x, state) in enumerate(targets):
            truth[name] = Target(np.array([x, 0.0]), state, np.array([x, 0.0]))
        ping = Ping(10.0 * number, {}, None, truth, True)
        watch.take(
            ping, SimpleNamespace(current=TrackArrays.from_tracks(tracks), fixed_echoes=none)
        )
    return watch


def test_tracks_are_counted_by_what_they_are_near():
    stands = track(1, 0.0, TrackStatus.STANDS_STILL)
    watch = watched(
        ([], [(0.0, RESTS)]),
        ([stands, track(7, 5.0)], [(0.0, RESTS)]),
        ([track(1, 0.2), track(7, 5.0)], [(0.0, MOVES)]),
        ([track(2, 0.4)], [(0.0, MOVES)]),
    )
    row = {name: estimate.value for name, estimate in Watch.row([watch]).items()}
    assert (row["found"], row["delay, s"], row["ids"]) == (1.0, 20.0, 2.0)
    assert (row["held"], row["held by any"]) == (0.5, 0.75)
    assert row["within 3 sigma"] == 0.5  # 0.2 and 0.4 m at an error of 0.1 m
    assert (row["tracks"], row["open water"], row["on structure"]) == (3.0, 1.0, 0.0)
    # 4 targets; 2 missed, 2 rows of track 7, 1 change; accepted: 360/h for 30 s.
    assert row["MOTA"] == pytest.approx(1.0 - 5.0 / 4.0)
    assert row["false rows a target"] == 0.5
    assert row["over accepted"] == pytest.approx(1.0 / 3.0)
    rests = chain.Held.row([watch.states[RESTS]])
    assert (rests["held"].value, rests["held by any"].value) == (0.0, 0.5)


def test_what_is_built_is_at_the_wall_and_the_piles():
    places = np.array([[12.0, 14.0], [16.5, -5.0], [51.0, 19.0], [51.0, 16.0], [5.0, 0.0]])
    assert on_bottom_structure(places).tolist() == [True, True, True, False, False]
