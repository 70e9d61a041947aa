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
"""Which evidence starts a track, with which hits and state."""

import math
from dataclasses import replace
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
from scipy import stats
from support.builders import AS_GIVEN, scan_at
from support.plain_score import at_max_speed, plain_starts, strong_groups
from support.scenes import Scene, crowded_scene, random_scene
from support.score_scenes import given_confirmed, in_plain_loops, score

from tsepm_ros import ConfirmedTrack, Scan, SensorModel
from tsepm_ros.methods.score import Score
from tsepm_ros.tracker import confirmation, pruning
from tsepm_ros.tracker.confirmation import min_purity_probability
from tsepm_ros.tracker.hypotheses import Hypotheses, Tree
from tsepm_ros.tracker.initial_state import Fit, fit_states
from tsepm_ros.tracker.measurement import LEAST_ACROSS, convert_measurements
from tsepm_ros.tracker.observation import Observation
from tsepm_ros.tracker.options import CommonOptions, ScoreOptions
from tsepm_ros.tracker.tracker import Tracker
from tsepm_ros.tracker.tracks import NO_TRACKS, TrackArrays

EXACT = SensorModel(range_std=5.0, range_std_fraction=0.0, azimuth_std=0.002)


def rule_at(threshold: float, detected: TrackArrays = NO_TRACKS) -> Any:
    """The rule as built, at a threshold and beside tracks of its own; it keeps its starts."""
    rule, starts = confirmation.confirm, []

    def confirm(tree: Tree, observed: Observation, _: float, rate: float, **figures: Any) -> Any:
        observed = replace(observed, tracks=detected, detected=np.ones(len(detected), bool))
        found = rule(tree, observed, threshold, rate, **figures)
        starts.extend(found[0])
        return found

    confirm.starts = starts
    return patch.object(confirmation, "confirm", confirm)


def decided(scene: Scene, seed: int, threshold: float) -> tuple[int, int]:
    """Compare a scene's first starts with those of plain loops.

    Returns their number, and that of detections whose evidence was enough until then.
    """
    plain_scans, sensor, options = in_plain_loops(scene, seed)
    manoeuvre = options.pop("target_manoeuvre")
    common = CommonOptions(limit_speed="off", target_manoeuvre=manoeuvre, **AS_GIVEN)
    initiator = Tracker(Score(sensor, common, ScoreOptions(**options)))
    strong = 0
    for index, (scan, tree) in enumerate(zip(scene.as_scans(), plain_scans, strict=False)):
        grown = at_max_speed(tree, common.max_speed)
        with rule_at(threshold) as rule, given_confirmed(initiator, scene):
            tracks, expected = initiator.process(scan), plain_starts(grown, threshold)
        strong += len(strong_groups(grown, threshold))
        assert [set(track.hits) for track in tracks] == [one.hits for one in expected]
        paths = [initiator.window[start.path][["scan", "index"]].tolist() for start in rule.starts]
        assert paths == [list(one.path) for one in expected]
        for track, start in zip(tracks, expected, strict=True):
            assert track.score == pytest.approx(start.evidence, abs=1e-6)
            noise = manoeuvre**2 * initiator.sensor.interval
            state, covariance = mixed(start.mixed, scene.as_scans()[: index + 1], sensor, noise)
            np.testing.assert_allclose(track.state, state, rtol=1e-5, atol=1e-3)
            scale = np.linalg.norm(covariance)
            np.testing.assert_allclose(track.covariance, covariance, rtol=0, atol=1e-5 * scale)
        if expected:
            return len(expected), strong
    return 0, strong


def mixed(
    members: list, scans: list[Scan], sensor: SensorModel, noise: float
) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance over hypotheses, each fitted to its hits; negligible ones left out."""
    converted = [
        convert_measurements(scan, sensor, index, LEAST_ACROSS * (scan.azimuth_std is None))
        for index, scan in enumerate(scans)
    ]
    most = max(one.score for one in members)
    counted = [one for one in members if one.score >= most + math.log(0.01)]
    weights = np.exp([one.score - most for one in counted])
    weights /= weights.sum()
    fits = []
    for one in counted:
        hits = np.concatenate([converted[scan][[row]] for scan, row in one.keys])[None]
        found = fit_states(hits, scans[-1].stamp, sensor, "weighted")
        covariance = found.covariance[0] + moved_by_acceleration(found, noise)
        fits.append((found.state[0], covariance))
    mean = sum(weight * state for weight, (state, _) in zip(weights, fits, strict=True))
    spread = sum(
        weight * (covariance + np.outer(state - mean, state - mean))
        for weight, (state, covariance) in zip(weights, fits, strict=True)
    )
    return mean, spread


def moved_by_acceleration(found: Fit, noise: float) -> np.ndarray:
    """What an acceleration adds: of each piece of the time before the state, by its middle."""
    ages, pieces = -found.time_after_state[0], np.linspace(0.0, -found.time_after_state.min(), 4001)
    middle, length = 0.5 * (pieces[1:] + pieces[:-1]), pieces[1]
    moved = np.zeros((4, 2, len(middle)))
    for age, error in zip(ages, found.hit_covariance[0], strict=True):
        h = np.array([[1.0, -age, 0.0, 0.0], [0.0, 0.0, 1.0, -age]])
        gain = found.covariance[0] @ h.T @ np.linalg.inv(error)
        moved += gain[:, :, None] * np.maximum(age - middle, 0.0)
    return noise * length * np.einsum("apk,bpk->ab", moved, moved)


@pytest.mark.parametrize(
    ("make", "threshold"),
    [(random_scene, 4.0), pytest.param(crowded_scene, 3.0, marks=pytest.mark.long)],
)
def test_what_is_confirmed_is_what_plain_loops_confirm(make, threshold, monkeypatch):
    monkeypatch.setattr(pruning, "MAX_OF_ONE_HIT", 10**6)  # the plain loops have no such limit
    counts = [decided(make(seed), seed, threshold) for seed in range(12)]
    started, strong = np.sum(counts, axis=0)
    assert started >= 6
    if make is crowded_scene:
        assert strong > 2 * started, "some wait, or are a track's already"


@pytest.mark.parametrize(("rate", "waits"), [(30.0, True), (1000.0, False)])
def test_where_false_tracks_are_many_by_choice_a_start_need_not_be_as_pure(rate, waits):
    # Of two ways, one is three times as likely: its second difference is 22 m less, of sigma 15 m.
    initiator = score(EXACT, false_tracks_per_hour=rate)
    initiator.process(scan_at(0.0, [(3000.0, 0.0)]))
    initiator.process(scan_at(12.0, [(3000.0, 84.0), (3000.0, -84.0)]))
    started = initiator.process(scan_at(24.0, [(3000.0, 168.0), (3000.0, -190.0)]))
    if waits:  # with evidence enough
        assert initiator.potential_tracks().score.max() > initiator.method.threshold + 5.0
    found = [set(track.hits) for track in started[:1]]
    assert found == ([] if waits else [{(0, 0), (1, 0), (2, 0)}])


def test_the_purity_of_a_start_falls_from_30_to_1000_false_tracks_per_hour():
    rates = (0.1, 30.0, np.sqrt(30.0 * 1000.0), 1000.0, 1e5)
    expected = [0.9, 0.9, 0.7, 0.5, 0.5]
    np.testing.assert_allclose([min_purity_probability(rate) for rate in rates], expected)


@pytest.mark.parametrize("wish", [1.0, 30.0])
def test_a_target_of_several_detections_a_ping_is_started_by_hits_of_one_path(wish):
    # Which of them are its own is never clear: it waits for eight hits, not for ever.
    initiator = score(EXACT, false_tracks_per_hour=wish)
    started = []
    for index in range(12):
        y = 41.0 * index
        found = [(3000.0, y), (3001.0, y + 2.0), (2999.0, y + 3.0)]
        started += initiator.process(scan_at(12.0 * index, found))
    assert started
    assert started[0].stamp == 12.0 * 7
    for track in started:
        scans = [scan for scan, _ in track.hits]
        assert len(set(scans)) == len(scans) >= 3
        assert track.velocity[1] == pytest.approx(41.0 / 12.0, abs=0.5)


def test_no_track_on_two_hits_however_strong():
    sensor = SensorModel(range_std=1.0, range_std_fraction=0.0, azimuth_std=1e-4)
    initiator = score(sensor, false_tracks_per_hour=1e6)
    scans = [scan_at(12.0 * k, [(3000.0 + 10.0 * k, 0.0)]) for k in range(3)]
    assert [len(initiator.process(scan)) for scan in scans] == [0, 0, 1]


@pytest.mark.parametrize(("apart", "first"), [(None, 2), (900.0, 2), (40.0, 3)])
def test_beside_a_detected_track_a_start_waits_in_the_tree_for_more_evidence(apart, first):
    initiator = Tracker(Score(EXACT, CommonOptions(**AS_GIVEN), ScoreOptions()))
    spread, detected, starts = np.diag([900.0, 1.0, 900.0, 1.0]), NO_TRACKS, []
    for k in range(first + 1):
        if apart is not None:
            state = np.array([3000.0, 0.0, 30.0 * k + apart, 2.5])
            one = ConfirmedTrack(7, 12.0 * k, state, spread, (), 0.0)
            detected = TrackArrays.from_tracks([one])
        with rule_at(9.0, detected):
            starts += [
                (k, track) for track in initiator.process(scan_at(12.0 * k, [(3000.0, 30.0 * k)]))
            ]
    ((when, track),) = starts
    assert when == first
    assert track.hits == tuple((k, 0) for k in range(first + 1))
    assert (track.score > 9.0 + math.log(1e3)) == (apart == 40.0)


def test_scores_are_decided_by_speed_where_evidence_may_be_enough_and_of_rivals_in_those_hits():
    paths = replace(
        Hypotheses.none(3),
        hits=np.array([[1, 2, -1], [3, 4, -1], [1, 2, -1], [1, 2, 7], [5, 6, 8]]),
        hit_count=np.array([2, 2, 2, 3, 3]),
        state=np.tile([0.0, 12.0, 0.0, 0.0], (5, 1)),
        covariance=np.tile(np.eye(4), (5, 1, 1)),
        score=np.array([9.0, 9.0, -12.0, 10.0, 3.0]),
    )
    tree = Tree(paths, 3, np.array([7, 8]))
    decided = confirmation.decided_by_speed(tree, 8.0, 10.0).hypotheses
    lost = paths.score - decided.score
    assert lost[[0, 3]] == pytest.approx(-math.log(stats.norm.sf(2.0)), abs=0.5)
    assert lost[[1, 2, 4]].tolist() == [0.0, 0.0, 0.0]
