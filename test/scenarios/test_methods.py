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
"""What every method keeps to, whatever it does, and what adding one takes."""

import dataclasses
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pytest
from support.builders import assert_same_tracks, reconfigured, scan_at
from support.patience import patient
from support.scenes import random_scene

from tsepm_ros import ConfirmedTrack, Scan, SensorModel, available_methods, make_initiator
from tsepm_ros.parameters import ParameterGroup, parameter
from tsepm_ros.tracker.method import Method, MethodResult, ScanStatistics
from tsepm_ros.tracker.observation import Observation
from tsepm_ros.tracker.options import CommonOptions
from tsepm_ros.tracker.tracker import Tracker
from tsepm_ros.tracker.tracks import TrackArrays

EVERY_METHOD = pytest.mark.parametrize("method", available_methods())
FEW_FALSE = SensorModel(range_std=5.0, range_std_fraction=0.0, azimuth_std=0.002)
"""Errors so small that every method starts the target."""


def straight(scans: int = 12, velocity=(3.0, 4.0)) -> list[Scan]:
    """A target and nothing else, with errors of a metre."""
    rng = np.random.default_rng(7)
    return [
        scan_at(
            12.0 * k,
            [np.array([2000.0, 500.0]) + 12.0 * k * np.array(velocity) + rng.normal(0, 1, 2)],
        )
        for k in range(scans)
    ]


def cluttered(scans: int, detections: int, size: float, seed: int = 3) -> list[Scan]:
    rng = np.random.default_rng(seed)
    return [
        scan_at(12.0 * k, rng.uniform(-size, size, (detections, 2)).tolist()) for k in range(scans)
    ]


def check_output(made: Tracker, tracks: TrackArrays) -> None:
    """Tracks are what the contract says."""
    for track in tracks:
        assert np.isfinite(track.state).all()
        assert (np.linalg.eigvalsh(track.covariance) > 0).all()
        assert track.stamp == made.stamp
        scans = [scan for scan, _ in track.hits]
        assert scans == sorted(set(scans))
        assert track.scan_count == made.scan_index + 1 - scans[0] <= made.options.window
        assert np.isfinite(track.evaluation)
        assert made.reason(track)


def fast(seed: int) -> list[Scan]:
    """A target at the maximum speed, with errors of 40 m: fits are often above it."""
    rng = np.random.default_rng(seed)
    return [
        scan_at(12.0 * k, [np.array([2000.0 + 10.0 * 12.0 * k, 500.0]) + rng.normal(0, 40.0, 2)])
        for k in range(14)
    ]


@pytest.mark.long
@EVERY_METHOD
def test_no_published_speed_is_above_the_maximum(method):
    sensor = SensorModel(range_std=40.0, range_std_fraction=0.0, azimuth_std=0.02)
    published, started = [], []
    for seed in range(12):
        made = make_initiator(method, sensor=sensor, max_speed=10.0, limit_speed="on")
        for scan in fast(seed):
            new = made.process(scan)
            check_output(made, new)
            started += [track.state for track in new]
            held = [] if method == "kalman" else made.current  # plain filters have no limit
            published += [np.hypot(*track.velocity) for track in (*new, *held)]
    assert len(started) > 3
    assert max(published) <= 10.0


@EVERY_METHOD
def test_only_the_speeds_of_score_are_limited_unless_the_user_gives_a_value(method):
    def limit(**given):
        return make_initiator(method, sensor=SensorModel(), **given).common.limit_speed

    assert limit() == limit(limit_speed="auto") == ("on" if method == "score" else "off")
    assert limit(limit_speed=True) == limit(limit_speed="on") == "on"
    assert limit(limit_speed=False) == limit(limit_speed="off") == "off"


@EVERY_METHOD
def test_a_target_alone_is_started_where_it_is(method):
    made = make_initiator(method, sensor=FEW_FALSE)
    scans, started = straight(13), []
    for scan in scans[:12]:
        started += made.process(scan)
        if made.scan_index == 1:
            (potential,) = made.potential_tracks()
            assert potential.hits == ((0, 0), (1, 0))
            assert potential.track_id == made.next_track_id == 0, "it takes no id"
            np.testing.assert_allclose(potential.velocity, [3.0, 4.0], atol=0.3)
    track = started[0]
    np.testing.assert_allclose(track.velocity, [3.0, 4.0], atol=0.2)
    truth = np.array([2000.0, 500.0]) + track.stamp * np.array([3.0, 4.0])
    np.testing.assert_allclose(track.position, truth, atol=5.0)
    check_output(made, made.process(scans[12]))
    assert len(made.current) > 0


@EVERY_METHOD
def test_an_empty_sea_starts_nothing_and_one_detection_is_forgotten_after_the_window(method):
    made = make_initiator(method, sensor=SensorModel())
    for k in range(20):
        assert not made.process(Scan(12.0 * k, [], []))
    assert made.totals == ScanStatistics(scans=20)
    assert not made.potential_tracks()
    assert not made.process(scan_at(240.0, [(3000.0, 0.0)]))
    assert made.statistics.potential_tracks == made.statistics.started == 1
    for k in range(21, 90):
        assert not made.process(Scan(12.0 * k, [], []))
    assert made.statistics.potential_tracks == 0
    assert made.totals.pruned + made.totals.terminated == 1


@EVERY_METHOD
def test_hits_at_one_time_make_no_track(method):
    # Offsets that undo the stamps: all echoes are of one moment.
    made = make_initiator(method, sensor=SensorModel())
    for k in range(12):
        scan = scan_at(float(k), [(3000.0, 0.0)], time_offset=[11.0 - k])
        for track in made.process(scan):
            assert np.isfinite(track.state).all()
            assert np.isfinite(track.covariance).all()


@EVERY_METHOD
def test_a_refused_scan_leaves_everything_as_it_was(method):
    scans = random_scene(13).as_scans()
    clean, disturbed = (
        make_initiator(method, sensor=SensorModel(), max_detections=300) for _ in range(2)
    )
    for scan in scans:
        expected, found = clean.process(scan), disturbed.process(scan)
        assert_same_tracks(found, expected)
        with pytest.raises(ValueError, match=r"^stamp must be later"):
            disturbed.process(scan)
        with pytest.raises(ValueError, match=r"^range has 301 detections"):
            disturbed.process(Scan(scan.stamp + 1, np.full(301, 50.0), np.zeros(301)))
    assert disturbed.totals == clean.totals


@EVERY_METHOD
def test_counts_add_up_and_a_run_is_the_same_again_and_after_a_reset(method):
    made, again = (make_initiator(method, sensor=SensorModel()) for _ in range(2))
    scans, expected, each = cluttered(12, 60, 3000.0), [], []
    for scan in scans:
        expected.append(made.process(scan))
        counts = made.statistics
        each.append(counts)
        assert (counts.scans, counts.detections, counts.confirmed) == (1, 60, len(expected[-1]))
        assert counts.split >= counts.started > 0
        ways = (counts.merged, counts.confirmed, counts.cut_confirmations)
        if method == "score":
            left = counts.evaluated - counts.pruned - counts.cut_potential_tracks
            assert left - counts.terminated == counts.potential_tracks
            assert counts.raw_confirmations == sum(ways)
        else:
            assert counts.raw_confirmations == sum(ways) + counts.pruned
            assert counts.raw_confirmations >= counts.evaluated
    for field in dataclasses.fields(ScanStatistics):
        values = [getattr(one, field.name) for one in each]
        total = max if field.name == "potential_tracks" else sum
        assert getattr(made.totals, field.name) == total(values), field.name
    assert made.totals.evaluated > 0 or method not in ("score", "tsepm")
    made.reset()
    assert made.totals == made.statistics == ScanStatistics()
    for scan, tracks in zip(scans, expected, strict=True):
        assert_same_tracks(made.process(scan), tracks)
        assert_same_tracks(again.process(scan), tracks)
        check_output(again, tracks)


@EVERY_METHOD
def test_a_moving_sensor_changes_nothing_but_the_places(method):
    still, moving = (make_initiator(method, sensor=FEW_FALSE) for _ in range(2))
    for scan in straight():
        shifted = dataclasses.replace(scan, sensor_pose=np.array([1e5, -2e5, 0.0]))
        one, other = still.process(scan), moving.process(shifted)
        assert [track.hits for track in one] == [track.hits for track in other]
        moved = other.state - one.state - [1e5, 0.0, -2e5, 0.0]
        np.testing.assert_allclose(moved, 0.0, atol=1e-4)


@EVERY_METHOD
def test_limits_hold_and_what_they_cut_is_counted(method):
    made = make_initiator(method, sensor=SensorModel(), max_potential_tracks=50)
    for scan in cluttered(10, 300, 3000.0):
        check_output(made, made.process(scan))
        assert made.statistics.potential_tracks <= 50
        assert made.statistics.confirmed <= 50
    assert made.totals.cut_potential_tracks > 0


@EVERY_METHOD
def test_options_may_change_between_scans(method):
    made = make_initiator(method, sensor=FEW_FALSE)
    scans = straight(18)
    for k, scan in enumerate(scans):
        window = max(made.options.window + (3 if k % 6 < 3 else -3), 10)
        made.potential_tracks()
        options = dataclasses.replace(made.options, window=window)
        reconfigured(made, made.sensor.model, made.common, options)
        made.potential_tracks()
        made.process(scan)
    kept = reconfigured(made, made.sensor.model, CommonOptions(max_speed=8.0), made.options)
    assert kept


# --- a new method is one module and one row ------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class ToyOptions(ParameterGroup):
    """Options of the toy."""

    window: int = parameter(2, "Scans", minimum=2)


class Toy(Method):
    """Starts a track of every detection that is the only one of its scan."""

    Options = ToyOptions
    operating_points = MappingProxyType({"default": {}, "long": {"window": 4}})

    def forget(self) -> None:
        pass

    def step(self, observed: Observation) -> MethodResult:
        if len(observed.detections) != 1:
            return MethodResult()
        (x, y), covariance = observed.detections["position"][0], np.diag([25.0, 9.0, 25.0, 9.0])
        state = np.array([x, 0.0, y, 0.0])
        track = ConfirmedTrack(
            0, observed.stamp, state, covariance, ((observed.scan_index, 0),), 0.0
        )
        return MethodResult(TrackArrays.from_tracks([track]), ScanStatistics(scans=1, confirmed=1))


TOY = """
import test_methods
from tsepm_ros.methods.registry import METHODS
METHODS["toy"] = test_methods.Toy
from tsepm_ros import ConfirmedTrack, Scan, SensorModel, available_methods, make_initiator
from tsepm_ros.tools.evaluation.simulated_run import simulated_operating_points
from tsepm_ros.tools.commands.given_parameters import (given_parameters_as_yaml)
from tsepm_ros.settings.settings import NODES, make_groups, settings_from, settings_with_method
from tsepm_ros.own_ship.registration import UnregisteredScan
from tsepm_ros.session.session import Session

assert "toy" in available_methods()
made = make_initiator("toy", sensor=SensorModel(), window=3, max_speed=5.0)
assert [track.track_id for track in made.process(Scan(0.0, [3000.0], [0.0]))] == [0]
groups = settings_with_method(NODES["track_initiator"], "toy")
assert "toy.window: 2" in given_parameters_as_yaml("track_initiator", groups)
assert [point.label for point in simulated_operating_points(["toy"])] == ["default", "long"]
settings = settings_from(make_groups(groups, {"method": "toy", "toy.window": 5}))
assert settings.window == 5
session = Session(settings)
session.add_scan(UnregisteredScan(Scan(0.0, [3000.0], [0.0]), "sonar"), 0.0)
results = list(session.process(1.0))
assert [len(result.new) for result in results] == [1]
"""


def test_a_new_method_is_one_class_and_one_row():
    done = subprocess.run(
        [sys.executable, "-c", TOY],
        cwd=Path(__file__).parent,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        capture_output=True,
        text=True,
        check=False,
        timeout=patient(6.0),
    )
    assert done.returncode == 0, done.stderr


def test_published_hits_are_those_of_shuffled_detections_where_evaluations_tie():
    rng, mix = np.random.default_rng(4), np.random.default_rng(1_000_004)
    drawn = [
        (3000.0 * np.sqrt(rng.uniform(0.01, 1.0, 40)), rng.uniform(-0.6, 0.6, 40)) for _ in range(7)
    ]
    as_made = np.tile(np.arange(40), (7, 1))
    found = []
    for orders in (as_made, np.array([mix.permutation(40) for _ in drawn])):
        made = make_initiator("tsepm", sensor=SensorModel(max_range=3000.0), min_hits=5, window=5)
        tracks = [
            track
            for scan, (echoes, order) in enumerate(zip(drawn, orders, strict=True))
            for track in made.process(Scan(12.0 * scan, *(part[order] for part in echoes)))
        ]
        found.append({tuple((s, orders[s][d]) for s, d in track.hits) for track in tracks})
    assert found[0] == found[1] != set()
