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
"""One target, one start: what is held starts no other, and what is beside it does."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.builders import AS_GIVEN
from support.score_scenes import score, sea

from tsepm_ros import ConfirmedTrack, Scan, SensorModel
from tsepm_ros.settings.node_options import SessionOptions
from tsepm_ros.settings.settings import Settings
from tsepm_ros.tools.evaluation.simulated_run import Outcome, SimulatedOperatingPoint, simulate_run
from tsepm_ros.tools.replay.offline import process_recording
from tsepm_ros.tools.replay.recording import read_recording
from tsepm_ros.tools.simulation import load_scenario
from tsepm_ros.tracker.options import CommonOptions
from tsepm_ros.tracker.tracks import TrackArrays

JOYRIDE = Path(__file__).parents[3].parent / "shared" / "data" / "joyride"
RADAR = SensorModel(range_std=15.0, range_std_fraction=0.0, max_range=3000.0)
"""A marine radar: a scan every 2.5 s."""


def test_a_confirmed_target_has_no_potential_tracks():
    initiator = score()
    for scan in sea(np.random.default_rng(1), 20, [(3000.0, 4.0, 2000.0, -3.0)], density=0.0):
        initiator.process(scan)
    assert len(initiator.current) == 1
    assert len(initiator.potential_tracks()) == 0


@pytest.mark.parametrize("run", [39, 85, 120])
def test_paths_of_a_target_that_end_in_two_detections_of_a_scan_start_it_once(run):
    # Each of the two has evidence enough; a share of confirmed hits of 0.6 would start the target
    # twice.
    scene = replace(load_scenario("box"), warm_up=16, scans=8)
    point = SimulatedOperatingPoint("score", options={"false_tracks_per_hour": 20.0})
    outcomes = [judged.outcome for judged in simulate_run(scene, [900, run], point).judged()]
    assert (outcomes.count(Outcome.TRUE), outcomes.count(Outcome.REDUNDANT)) == (1, 0)


@pytest.mark.parametrize(
    ("apart", "least"), [pytest.param(100.0, 1, marks=pytest.mark.long), (300.0, 5)]
)
def test_of_two_targets_abreast_both_are_held(apart, least):
    # Their errors are 55 m by 65 m: each may be the other's detection.
    lanes = [(3100.0, 5.0, 2000.0, 0.0), (3100.0, 5.0, 2000.0 + apart, 0.0)]
    most = []
    for seed in range(6):
        initiator = score(false_tracks_per_hour=10.0, **AS_GIVEN)
        held = []
        for scan in sea(np.random.default_rng([4, seed]), 30, lanes):
            initiator.process(scan)
            middle = 3100.0 + 5.0 * scan.stamp, 2000.0 + apart / 2.0
            apart_from = initiator.current.state[:, 0::2] - middle
            held.append(np.count_nonzero(np.hypot(*apart_from.T) < 500.0))
        most.append(max(held))
    assert most.count(2) >= least
    assert max(most) == 2


def radar_starts(seed: int, paths: list, faded: frozenset[int] = frozenset()) -> list[int]:
    """Scans of the starts on targets of given paths; the first fades in some scans."""
    rng = np.random.default_rng([5, seed])
    initiator, found = score(RADAR, max_speed=15.0), []
    for index in range(60):
        n = rng.poisson(RADAR.clutter_density * RADAR.coverage_area)
        range_ = list(RADAR.max_range * np.sqrt(rng.random(n)))
        azimuth = list(rng.uniform(-math.pi, math.pi, n))
        for number, path in enumerate(paths):
            if rng.random() < 0.8 and not (number == 0 and index in faded):
                x, y = path(2.5 * index)
                range_.append(math.hypot(x, y) + RADAR.range_std * rng.standard_normal())
                azimuth.append(math.atan2(y, x) + RADAR.azimuth_std * rng.standard_normal())
        for track in initiator.process(Scan(2.5 * index, range_, azimuth)):
            apart = [np.hypot(*(track.position - path(track.stamp))) for path in paths]
            found += [index] if min(apart) < 100.0 else []
    return found


def lane(x: float):
    return lambda time: (x, 6.0 * time - 300.0)


def zigzag(time: float) -> tuple[float, float]:
    """Turns by 80 degrees, at once, every 25 s."""
    legs, rest = divmod(time, 25.0)
    return 700.0 + (6.0 * rest if legs % 2 == 0 else 150.0 - 6.0 * rest), 7.0 * time - 400.0


@pytest.mark.parametrize(
    ("paths", "faded", "starts"),
    [
        pytest.param([zigzag], frozenset(), 5, marks=pytest.mark.long),
        pytest.param([lane(600.0)], frozenset(range(30, 37)), 5, marks=pytest.mark.long),
        ([lane(600.0), lane(500.0)], frozenset(range(30, 37)), 9),
    ],
    ids=["turning", "fading", "fading beside another"],
)
def test_a_target_seen_by_a_fast_radar_is_started_once(paths, faded, starts):
    runs = [radar_starts(seed, paths, faded) for seed in range(4)]
    assert min(map(len, runs)) >= len(paths)
    assert sum(map(len, runs)) <= starts


@pytest.mark.long
@pytest.mark.skipif(not JOYRIDE.exists(), reason="the joyride data is not here")
def test_the_vessel_of_the_joyride_is_started_at_most_three_times():
    recording = read_recording(JOYRIDE)
    sensor = SensorModel(range_std=15.0, range_std_fraction=0.0)
    settings = Settings(
        SessionOptions(method="score", own_ship_source="odometry"),
        sensor,
        CommonOptions(max_speed=15.0),
    )
    results, _ = process_recording(recording, settings, "north")
    truth = {motion.time: motion.state for motion in recording.targets[0]}
    on_vessel, elsewhere = [], []
    for index, result in enumerate(results):
        for track in result.new:
            apart = np.hypot(*(track.position - truth[track.stamp][0::2]))
            (on_vessel if apart < 100.0 else elsewhere).append((index, track.position.round()))
    assert len(on_vessel) <= 3 and on_vessel[0][0] <= 6, on_vessel
    # A second vessel, and echoes ashore.
    assert len(elsewhere) <= 4, elsewhere


def downstream(track_id: int, stamp: float, y: float) -> ConfirmedTrack:
    """A target at 4 m/s along x, as a downstream tracker knows it."""
    state = np.array([3000.0 + 4.0 * stamp, 4.0, y, 0.0])
    covariance = np.diag([40.0, 1.0, 40.0, 1.0]) ** 2
    return ConfirmedTrack(track_id, stamp, state, covariance, (), math.nan)


@pytest.mark.parametrize("listed", [True, False], ids=["listed", "declined"])
def test_a_target_that_is_tracked_downstream_is_not_started_but_one_beside_it_is(listed):
    first, second = (3000.0, 4.0, 2000.0, 0.0), (3000.0, 4.0, 1000.0, 0.0)
    initiator = score()
    starts = []
    for scan in sea(np.random.default_rng(3), 40, [first, second]):
        tracked = [(2**31, 2000.0), *((start.track_id, 1000.0) for start in starts)]
        told = [downstream(track_id, scan.stamp, y) for track_id, y in tracked if listed]
        initiator.maintenance.follow(scan.stamp, TrackArrays.from_tracks(told))
        starts += initiator.process(scan)
    lanes = [round(track.position[1] / 1000.0) for track in starts]
    if listed:
        assert lanes == [1]
    else:
        assert lanes.count(1) > 1 and lanes.count(2) > 1, "declined, so started again"


@pytest.mark.parametrize("wish", [1.0, 100.0, 1e5])
def test_a_start_is_held_as_firmly_as_it_is_probable(wish):
    initiator = score(false_tracks_per_hour=wish)
    for scan in sea(np.random.default_rng(1), 20, [(3000.0, 4.0, 2000.0, -3.0)]):
        tracks = initiator.process(scan)
        if len(tracks):
            odds = 500.0 * np.exp(tracks.evaluation) / wish
            expected = np.clip(odds / (1.0 + odds), 0.02, 0.99)
            held = initiator.maintenance.confirmed.existence[-len(tracks) :]
            assert held == pytest.approx(expected)
            return
    pytest.fail("nothing was confirmed")
