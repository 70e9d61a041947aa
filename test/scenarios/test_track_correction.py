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
"""Starts whose hits turn out wrong, and targets that fall silent: one track, under its id."""

import math
from dataclasses import replace

import numpy as np
import pytest
from support.builders import AS_GIVEN, scan_at
from support.score_scenes import score

from tsepm_ros import Scan, SensorModel, make_initiator
from tsepm_ros.tracker.tracks import ConfirmedTrack, TrackArrays

SENSOR = SensorModel(range_std=30.0, range_std_fraction=0.0, azimuth_std=0.01, clutter_density=1e-5)

X = 3000.0


def target(k: int) -> tuple[float, float]:
    """A target at 7 m/s along y."""
    return X, 84.0 * k


@pytest.mark.parametrize("turn", [1, 5])
def test_a_target_that_turns_after_its_start_keeps_its_id(turn):
    # The straight path of the hits after the turn has none of those before.
    initiator = score(SENSOR, false_tracks_per_hour=100.0, **AS_GIVEN)
    for k in range(16):
        before, after = min(k, 2 + turn), max(k - 2 - turn, 0)
        seen = [(X - 84.0 * (3 + turn) + 84.0 * before, 84.0 * after)]
        initiator.process(scan_at(12.0 * k, seen))
    assert initiator.totals.confirmed == 1
    assert initiator.current.track_id.tolist() == [0]


@pytest.mark.parametrize("wish", [1.0, 300.0])
def test_hits_are_more_probable_than_not_at_any_rate(wish):
    # Beside each of the target's echoes lies one that fits as well.
    initiator = score(SENSOR, false_tracks_per_hour=wish, **AS_GIVEN)
    found = []
    for k in range(6):
        x, y = target(k)
        seen = [(x, y)] if k not in (1, 2) else [(x + 3.0, y), (x - 3.0, y)]
        found += initiator.process(scan_at(12.0 * k, seen))
    (track,) = found
    assert not {(1, 0), (1, 1)} <= set(track.hits)
    assert {(0, 0), (3, 0)} <= set(track.hits)


@pytest.mark.parametrize("listed", [1, 25])
def test_a_track_of_a_downstream_tracker_has_no_hits_to_doubt(listed):
    initiator = score(SENSOR, false_tracks_per_hour=100.0, **AS_GIVEN)
    rng, covariance = np.random.default_rng(1), np.diag([900.0, 1.0, 900.0, 1.0])
    for k in range(25):
        if k < listed:
            state = np.array([X, 0.0, 84.0 * k, 7.0])
            report = ConfirmedTrack(77, 12.0 * k, state, covariance, (), 0.0)
            initiator.maintenance.follow(12.0 * k, TrackArrays.from_tracks([report]))
        place = tuple(np.add(target(k), 3.0 * rng.standard_normal(2)))
        assert not len(initiator.process(scan_at(12.0 * k, [place])))
        assert not len(initiator.revised)
    assert initiator.current.track_id.tolist() == [77]


def test_a_track_is_not_corrected_once_its_hits_leave_the_window():
    # The hypotheses with its first hits are deleted then, right or not.
    sensor = replace(SENSOR, clutter_density=1e-6)
    rng = np.random.default_rng([2, 29])
    initiator, begun = score(sensor, false_tracks_per_hour=10.0, **AS_GIVEN), dict[int, int]()
    for k in range(30):
        seen = []
        if rng.random() < 0.9:
            seen.append(tuple(np.add(target(k), 60.0 * rng.standard_normal(2))))
        clutter = np.array(target(k)) + rng.uniform(-1200.0, 1200.0, (12, 2))
        new = initiator.process(scan_at(12.0 * k, seen + [tuple(place) for place in clutter]))
        begun |= {track.track_id: k for track in new}
        # A start that continues a lost track has later hits alone.
        assert all(track.hits[0][0] > begun[track.track_id] for track in initiator.revised)
    assert any(abs(track.position[0] - X) < 400.0 for track in initiator.current)


SONARS = {
    0.1: SensorModel(
        range_std_fraction=0.005,
        azimuth_std=math.radians(0.5),
        max_range=100.0,
        azimuth_min=-math.radians(65.0),
        azimuth_max=math.radians(65.0),
    ),
    12.0: SensorModel(),
}


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("interval", SONARS)
def test_the_track_of_a_silent_target_coasts_and_comes_back_under_its_id(interval, seed):
    """It is silent for 12 scans, or as many seconds where they are faster."""
    silent = range(30, 42) if interval > 1.0 else range(30, 150)
    rng, sensor = np.random.default_rng([seed, 37]), SONARS[interval]
    initiator = make_initiator("score", sensor=sensor, max_speed=10.0)
    reach, sure, published = sensor.max_range, [], []
    for scan in range(silent[-1] + 29):
        place = np.array([0.5 * reach, -0.1 * reach + interval * scan])
        number = rng.poisson(2.0)
        range_ = reach * np.sqrt(rng.random(number))
        azimuth = rng.uniform(sensor.azimuth_min, sensor.azimuth_max, number)
        error = rng.standard_normal(2) * [sensor.range_std_fraction, sensor.azimuth_std]
        if rng.random() < 0.9 and scan not in silent:
            range_ = np.append(range_, np.hypot(*place) * (1.0 + error[0]))
            azimuth = np.append(azimuth, math.atan2(place[1], place[0]) + error[1])
        initiator.process(Scan(interval * scan, range_, azimuth))
        apart = np.hypot(*(initiator.current.sure.state[:, 0::2] - place).T)
        sure.append(initiator.current.sure.track_id[apart < 0.1 * reach].tolist())
        published.append(initiator.current.track_id.tolist())
    (track,) = sure[silent[0] - 1]
    assert (sure[silent[-1]], sure[-1]) == ([], [track])
    assert track in published[silent[0]] and track not in published[silent[-1]]
    assert {number for ids in sure for number in ids} == {track}, "it comes back as itself"


@pytest.mark.parametrize("method", ["score", "tsepm"])
def test_a_start_that_is_recognised_revises_its_track_instead_of_a_new_one(method, monkeypatch):
    sensor = SensorModel(range_std=5.0, range_std_fraction=0.0, max_range=5000.0)
    initiator = make_initiator(method, sensor=sensor, max_speed=10.0)
    new, revised = [], []
    for scan in range(24):
        if scan == 12:
            monkeypatch.setattr(
                initiator.maintenance, "continued", lambda starts, *_: np.zeros(len(starts), int)
            )
        y = 2000.0 if scan < 12 else -2000.0
        place = np.array([1000.0 + 60.0 * scan, y])
        new += initiator.process(Scan(12.0 * scan, [np.hypot(*place)], [math.atan2(y, place[0])]))
        revised += initiator.revised
    assert new[0].track_id == 0
    if not initiator.method.learns_from_confirmed:
        assert [track.track_id for track in new] != [0], "its starts may well be false"
        return
    assert [track.track_id for track in new] == [0]
    again = [track for track in revised if track.position[1] < 0.0]
    assert [(track.track_id, track.revision) for track in again] == [(0, 1)]
    assert initiator.current.track_id.tolist() == [0]
    assert initiator.current.state[0, 2] < 0.0
    assert initiator.totals.confirmed == 1
