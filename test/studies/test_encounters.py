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
"""Clutter zones and encounters: what they change in the association, and features of echoes."""

import functools
import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from scipy.optimize import minimize_scalar
from support.builders import AS_GIVEN, assert_same_tracks, scan_at

from tsepm_ros import Scan, SensorModel, make_initiator
from tsepm_ros.methods.registry import make_method
from tsepm_ros.studies.assignment import AssignmentPairs
from tsepm_ros.studies.encounters import (
    DETECTION_COUNT,
    ZONE_FACTOR,
    EncounterEnvironment,
    EncounterHistories,
    FeatureTracker,
    encounter_features,
    encounter_pairs,
)
from tsepm_ros.tools.evaluation.measures import measured_closest_approach
from tsepm_ros.tools.simulation import Simulator, load_scenario
from tsepm_ros.tools.simulation.scenario import Scenario
from tsepm_ros.tracker.clutter.density import ClutterMap
from tsepm_ros.tracker.motion import position_after
from tsepm_ros.tracker.options import GATE_PROBABILITY
from tsepm_ros.tracker.scan import ECHO_FEATURES

BIG, SMALL = np.array([60.0, 50.0, 0.02]), np.array([20.0, 10.0, 0.01])


def echoes_like(features: np.ndarray, number: int, seed: int = 1) -> np.ndarray:
    return features * (1.0 + 0.1 * np.random.default_rng(seed).standard_normal((number, 3)))


TWO = EncounterHistories.of(np.stack([echoes_like(BIG, 10), echoes_like(SMALL, 10)]))
APART, TOGETHER = np.zeros((2, 2), bool), ~np.eye(2, dtype=bool)


def featured(sensor: SensorModel, **options) -> FeatureTracker:
    return FeatureTracker(make_method("score", sensor=sensor, **options))


def all_pairs(cost: list[list[float]]) -> AssignmentPairs:
    parent, row = np.indices(np.shape(cost)).reshape(2, -1)
    return AssignmentPairs(parent, row, np.ravel(cost).astype(float))


def test_in_a_zone_only_alike_detections_count_and_against_alike_clutter():
    # Of 9 detections of clutter 2 are like the first track's, 7 like the second's: (1 + k) / (1 +
    # 9).
    clutter = np.concatenate([np.tile(BIG, (2, 1)), np.tile(SMALL, (7, 1))])
    environment = EncounterEnvironment(np.stack([BIG, BIG]), np.array([True, False]), clutter)
    factors = environment.factors(TWO, APART, all_pairs([[1.0, 1.0], [1.0, 1.0]]))
    assert factors.tolist() == pytest.approx([10.0 / 3.0, 1.0, 0.0, 1.0])
    environment = EncounterEnvironment(SMALL[None], np.array([True]), clutter)
    factors = environment.factors(TWO, APART, all_pairs([[1.0], [1.0]]))
    assert factors.tolist() == pytest.approx([0.0, 10.0 / 8.0])


def test_detections_that_resemble_several_go_by_their_distance():
    same = EncounterHistories.of(np.stack([echoes_like(BIG, 10), echoes_like(BIG, 10)]))
    environment = EncounterEnvironment(np.stack([BIG, BIG]), np.zeros(2, bool), np.zeros((0, 3)))
    for cost, expected in (
        ([[0.0, 4.0], [4.0, 0.0]], [1.0, 0.0, 0.0, 1.0]),
        ([[4.0, 0.0], [0.0, 4.0]], [0.0, 1.0, 1.0, 0.0]),
        ([[4.0, np.inf], [3.0, np.inf]], [0.0, 1.0, 1.0, 1.0]),  # the second is in no gate
    ):
        factors = environment.factors(same, TOGETHER, all_pairs(cost))
        assert factors.tolist() == expected
        factors = environment.factors(same, APART, all_pairs(cost))
        assert factors.tolist() == [1.0, 1.0, 1.0, 1.0]


def test_a_zone_is_where_clutter_is_dense_against_the_coverage():
    sensor = SensorModel(max_range=6000.0, clutter_density=1e-7)
    clutter = ClutterMap(sensor)
    rng = np.random.default_rng(5)
    for _ in range(30):
        x, y = rng.uniform(2000.0, 3500.0, (2, 20))
        more = rng.uniform(-4000.0, 4000.0, (2, 6))
        x, y = np.concatenate([[x, y], more], axis=1)
        clutter.update(clutter.grid.cells(np.hypot(x, y), np.arctan2(y, x)), np.ones(len(x)))
    inside, outside = (2750.0, 2750.0), (-2750.0, 2750.0)
    x, y = np.array([inside, outside]).T
    density = clutter.at(clutter.grid.cells(np.hypot(x, y), np.arctan2(y, x)))
    assert (density > ZONE_FACTOR * clutter.mean).tolist() == [True, False]


def two_kinds(echoes: np.ndarray, others: np.ndarray, k: int, outside: int = 0) -> Scan:
    """A target of features `plots` at 3 km, beside one of `others`, behind echoes out of range."""
    features = np.concatenate([np.full((outside, 3), 1e4), echoes[k : k + 1], others[k : k + 1]])
    return scan_at(
        12.0 * k,
        [*[(20e3, 0.0)] * outside, (3000.0 + 60.0 * k, 0.0), (-5000.0, 30.0 * k)],
        features=dict(zip(ECHO_FEATURES, features.T, strict=True)),
    )


@pytest.mark.parametrize("outside", [0, 1, 5])
def test_a_track_has_the_features_of_its_own_detections_wherever_they_stand_in_the_scan(outside):
    sensor = SensorModel(range_std=10.0, range_std_fraction=0.0, azimuth_std=0.003, max_range=8e3)
    made = featured(sensor)
    own, others = echoes_like(BIG, 45, seed=4), echoes_like(SMALL, 45, seed=5)
    for k in range(45):
        made.process(two_kinds(own, others, k, outside))
    tracks = made.maintenance.confirmed.tracks
    ahead = tracks.state[:, 0].argsort()
    assert len(tracks) == 2
    found = made.maintenance.histories(tracks)
    # The detection of this scan is a track's own from the next scan on if the track began with it.
    latest = np.stack([others, own])[:, -DETECTION_COUNT:]
    np.testing.assert_allclose(found.mean[ahead], latest.mean(axis=1))
    np.testing.assert_allclose(found.square[ahead], latest.var(axis=1) * DETECTION_COUNT)


def test_only_detections_of_clutter_tell_of_clutter():
    # Every second ping another echo, somewhere else: none of the tracks' echoes is clutter.
    sensor = SensorModel(range_std=10.0, range_std_fraction=0.0, azimuth_std=0.003, max_range=8e3)
    made = featured(sensor)
    own, others = echoes_like(BIG, 30, seed=4), echoes_like(SMALL, 30, seed=5)
    for k in range(30):
        made.process(two_kinds(own, others, k))
        if k == 14:
            assert len(made.current) == 2
            first = len(made.maintenance.clutter)
    assert 0 < first == len(made.maintenance.clutter)


def overtaking() -> Scenario:
    """A ship overtakes another 20 m abeam, 100 m in bearing errors, after 99 s."""
    base = load_scenario("encounter")
    ships = [
        np.array([-2400.0 - 99.0 * speed, speed, y, 0.0]) for speed, y in ((5, -17300), (3, -17280))
    ]
    sector = replace(base.sensor, azimuth_min=-2.1, azimuth_max=-1.3)
    return replace(base, targets=tuple(ships), sensor=sector, clutter_patches=(), scans=70)


def held_through(features: bool, seed: int) -> bool:
    """Whether the tracks of both ships go on, each with its own."""
    scenario = overtaking()
    make = featured if features else functools.partial(make_initiator, "score")
    made = make(sensor=scenario.sensor, **AS_GIVEN)
    own = []
    for scan in Simulator(scenario, seed):
        made.process(scan.scan)
        tracks = made.current
        apart = tracks.state[:, None, 0::2] - scan.truth[None, :, 0::2]
        nearest = np.square(apart).sum(axis=2).argmin(axis=0) if len(tracks) else []
        own.append([int(tracks.track_id[row]) for row in nearest])
    return own[-1] == own[15] and len(set(own[-1])) == 2


def test_tracks_meet_by_their_covariances_at_the_scan(monkeypatch):
    """Not by those of the scan before: a coasting track is somewhere in a large area."""
    given = []

    def pairs(state, covariance, *others):
        given.append(covariance)
        return encounter_pairs(state, covariance, *others)

    monkeypatch.setattr("tsepm_ros.studies.encounters.encounter_pairs", pairs)
    scenario = replace(overtaking(), scans=16)
    made = featured(scenario.sensor, **AS_GIVEN)
    for scan in Simulator(scenario, 0):
        before = made.maintenance.confirmed.tracks.covariance
        made.process(scan.scan)
    assert len(before) and (given[-1][:, 0, 0] > 1.05 * before[:, 0, 0]).all()


@pytest.mark.long
def test_features_keep_two_tracks_apart_that_are_one_without():
    assert [held_through(True, seed) for seed in range(12)] == [True] * 12
    # 3 of 12: the tracks are exchanged, or one of the ships gets another.
    assert sum(held_through(False, seed) for seed in range(12)) <= 4


def test_without_features_and_encounters_the_study_changes_nothing():
    scenario = load_scenario("four_targets", {"sensor.clutter_density": 3e-7, "scans": 20})
    one = make_initiator("score", sensor=scenario.sensor)
    other = featured(scenario.sensor)
    started = 0
    for scan in Simulator(scenario, 4):
        assert_same_tracks(one.process(scan.scan), other.process(scan.scan))
        np.testing.assert_array_equal(one.current.state, other.current.state)
        started += one.statistics.confirmed
    assert started >= 2


def published(axis: str) -> tuple[np.ndarray, np.ndarray]:
    """Ships A and B of Section 2.2, angles clockwise from north or counter-clockwise from east."""

    def ship(distance: float, bearing: float, speed: float, heading: float) -> np.ndarray:
        bearing, heading = np.deg2rad([bearing, heading])
        first, second = (np.sin, np.cos) if axis == "north" else (np.cos, np.sin)
        return np.array(
            [
                distance * first(bearing),
                speed * first(heading),
                distance * second(bearing),
                speed * second(heading),
            ]
        )

    return ship(18e3, 187.0, 6.0, 330.0), ship(17e3, 189.0, 4.0, 190.0)


def moved(state: np.ndarray, time: float) -> np.ndarray:
    return state + time * np.array([state[1], 0.0, state[3], 0.0])


@pytest.mark.parametrize("axis", ["north", "east"])
def test_the_published_ships_meet_whatever_the_angles_are_measured_from(axis):
    one, two = published(axis)
    found = minimize_scalar(
        lambda t: math.dist(moved(one, t)[[0, 2]], moved(two, t)[[0, 2]]), bounds=(-1e3, 1e3)
    )
    time, distance = measured_closest_approach(two - one)
    assert time == pytest.approx(found.x, abs=0.01)
    assert distance == pytest.approx(found.fun, abs=1e-3)
    assert (time, distance) == (pytest.approx(122.7, abs=0.05), pytest.approx(188.5, abs=0.05))


def test_the_shipped_scenario_has_the_published_ships():
    targets = load_scenario("encounter").targets
    np.testing.assert_allclose(targets[:2], published("north"), atol=0.01)


def test_it_is_the_printed_equation_but_for_its_sign():
    rng = np.random.default_rng(3)
    for _ in range(100):
        one, two = rng.normal(0.0, [1e3, 5.0, 1e3, 5.0], (2, 4))
        (east, ve, north, vn) = two - one
        speeds = np.hypot(one[1], one[3]), np.hypot(two[1], two[3])
        headings = math.atan2(one[1], one[3]), math.atan2(two[1], two[3])
        relative = math.sqrt(  # Eq. 1
            speeds[1] ** 2
            + speeds[0] ** 2
            - 2.0 * speeds[1] * speeds[0] * math.cos(headings[0] - headings[1])
        )
        angle = math.hypot(east, north) * math.cos(math.atan2(ve, vn) - math.atan2(east, north))
        time, _ = measured_closest_approach(two - one)
        assert abs(time) == pytest.approx(abs(angle) / relative)  # Eq. 9
        assert np.sign(time) == -np.sign(east * ve + north * vn), "above 0 while they approach"


def test_ships_on_one_course_are_closest_now():
    state = np.array([[0.0, 3.0, 0.0, 4.0], [30.0, 3.0, 40.0, 4.0]])
    assert measured_closest_approach(state[1] - state[0]) == (0.0, 50.0)


@pytest.mark.parametrize(
    ("within", "width", "met"),
    [(125.0, 188.6, True), (125.0, 188.4, False), (120.0, 190.3, True), (120.0, 190.2, False)],
)
def test_targets_meet_where_their_gates_overlap_in_time(within, width, met):
    # Two gates of half the width each, 3 standard deviations of the state's and the detection's
    # error.
    states = np.stack(published("north"))
    spread = np.zeros((2, 4, 4))
    spread[:, [0, 2], [0, 2]] = 3.0**2
    error = math.sqrt((width / 6.0) ** 2 - 9.0)
    one, two = encounter_pairs(states, spread, np.full(2, error), 3.0, within)
    times = np.linspace(-within, within, 10_001)
    closest = np.hypot(*position_after(states[1] - states[0], times).T).min()
    assert (closest <= width) == met, "what the numbers above mean"
    assert (one.tolist(), two.tolist()) == (([0], [1]) if met else ([], []))


SPREAD = np.array([4.0, 8.0, 0.002])
MEAN = np.array([50.0, 60.0, 0.015])


def drawn(rng: np.random.Generator, *shape: int) -> np.ndarray:
    return MEAN + SPREAD * rng.standard_normal((*shape, 3))


@pytest.mark.parametrize("echoes", [3, 5, 20])
def test_own_detections_are_chi_square_distributed_whatever_their_number(echoes):
    # Kolmogorov-Smirnov at 0.1 %; the share outside the gate within 3.3 standard errors of 1 %.
    rng = np.random.default_rng([2, echoes])
    n = 4000
    histories, candidate = EncounterHistories.of(drawn(rng, n, echoes)), drawn(rng, n)
    found = histories.dissimilarity(candidate)
    assert stats.kstest(found, stats.chi2(3).cdf).pvalue > 1e-3
    outside = 1.0 - histories.resembled_by(candidate).mean()
    assert outside == pytest.approx(1.0 - GATE_PROBABILITY, abs=3.3 * np.sqrt(0.0099 / n))


@pytest.mark.parametrize(
    ("history", "candidate", "resembles"),
    [
        (np.full((1, 0, 3), 0.0), [1e3, 1e3, 1e3], True),
        (np.full((1, 1, 3), 5.0), [1e3, 1e3, 1e3], True),
        (np.full((1, 9, 3), 5.0), [np.nan, np.nan, np.nan], True),
        (np.full((1, 9, 3), 5.0), [5.0, 5.0, 5.0], True),
        (np.full((1, 9, 3), 5.0), [9.0, np.nan, np.nan], False),
        (np.full((1, 9, 3), 0.0), [0.0, 0.0, 0.0], True),
        (np.full((1, 9, 3), 0.0), [0.0, 1e-3, 0.0], False),
    ],
    ids=["no echoes", "one detection", "not measured", "same", "other", "always 0", "0 but once"],
)
def test_what_cannot_be_told_apart_resembles(history, candidate, resembles):
    with np.errstate(all="raise"):
        found = EncounterHistories.of(history).resembled_by(np.array([candidate]))
    assert found.tolist() == [resembles]


def test_features_of_a_scan_are_in_columns_and_nan_where_there_are_none():
    scan = Scan(
        0.0, [1e3, 2e3], [0.0, 0.1], features={"azimuth_width": [0.1, np.inf], "intensity": [5, 6]}
    )
    np.testing.assert_array_equal(
        encounter_features(scan), [[5.0, np.nan, 0.1], [6.0, np.nan, np.nan]]
    )
