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
"""The published method equals its plain-loop version, track for track."""

import itertools
import math
from pathlib import Path

import numpy as np
import pytest
from scipy import stats
from support.batches import batches
from support.builders import AS_GIVEN, detections
from support.plain_tsepm import plain_tsepm_with_counts
from support.scenes import Scene, random_scene

from tsepm_ros import Scan, SensorModel, make_initiator
from tsepm_ros.methods import tsepm
from tsepm_ros.methods.tsepm import Gates, children_in_gates, clutter_statistic, split_paths
from tsepm_ros.numerics.gaussian import gate_factor
from tsepm_ros.settings.settings import TRACK_INITIATOR, make_groups, settings_from
from tsepm_ros.tools.commands.given_parameters import given_parameters_for
from tsepm_ros.tools.simulation import Simulator, load_scenario
from tsepm_ros.tracker.initial_state import fit_states
from tsepm_ros.tracker.tracker import Tracker

PAPER = Path(__file__).parents[2] / "config" / "paper.yaml"
SCENES = 300
BATCH = 15
ALWAYS = 15
"""Scenes without the marker; a fault of the method shows in nearly every scene."""
TOLERANCE = 1e-9


def run_plain(scene: Scene):
    options = dict(scene.options)
    options["reading"] = options.pop("pruning_reading")
    return plain_tsepm_with_counts(scene.scans, **scene.sensor, **options)


def compare(scene: Scene) -> int:
    """Compare one scene; returns the number of tracks compared."""
    expected, counts = run_plain(scene)
    initiator = make_initiator(
        "tsepm", sensor=SensorModel(**scene.sensor), limit_speed="off", **AS_GIVEN, **scene.options
    )
    return compare_scans(initiator, scene.as_scans(), expected, counts)


def compare_scans(initiator: Tracker, scans, expected, counts) -> int:
    """Compare the tracks and counts of each scan; returns the number of tracks compared."""
    compared = 0
    for scan, tracks, count in zip(scans, expected, counts, strict=True):
        found = {track.hits: track for track in initiator.process(scan)}
        statistics = initiator.statistics
        assert statistics.potential_tracks == count.potential
        assert statistics.raw_confirmations == count.confirmed
        assert statistics.raw_confirmations - statistics.pruned == count.retained
        assert set(found) == {track.hits for track in tracks}
        for track in tracks:
            same = found[track.hits]
            assert same.stamp == track.stamp
            np.testing.assert_allclose(
                same.state, track.state, rtol=0, atol=TOLERANCE * np.linalg.norm(track.state)
            )
            np.testing.assert_allclose(
                same.covariance,
                track.covariance,
                rtol=0,
                atol=TOLERANCE * np.linalg.norm(track.covariance),
            )
            assert same.evaluation == pytest.approx(track.evaluation, rel=1e-7, abs=1e-9)
        compared += len(tracks)
    return compared


@pytest.mark.parametrize("first", batches(SCENES, ALWAYS, BATCH))
def test_equals_the_plain_version(first: int) -> None:
    compared = sum(compare(random_scene(seed)) for seed in range(first, first + BATCH))
    assert compared > 0, "the scenes must confirm tracks, or nothing was compared"


def test_the_parameter_file_of_the_paper_runs_the_method_as_the_paper_has_it():
    values = given_parameters_for(PAPER, "/track_initiator")
    initiator = settings_from(make_groups(TRACK_INITIATOR, values)).make_tracker()
    scenario = load_scenario("box", {"scans": 10, "sensor.clutter_density": 5e-7})
    scans = [one.scan for one in Simulator(scenario, 1)]
    columns = ("range", "azimuth", "time_offset")
    plain = []
    for scan in scans:
        near = scan.range <= initiator.sensor.model.max_range
        values = {name: getattr(scan, name) for name in columns}
        given = {name: value[near] for name, value in values.items() if value is not None}
        plain.append({"stamp": scan.stamp, **given})
    expected, counts = plain_tsepm_with_counts(
        plain,
        range_std=0.0,
        range_std_fraction=0.015,
        azimuth_std=math.radians(1.0),
        clutter_density=1e-6,
        max_speed=10.0,
        min_hits=5,
        window=8,
    )
    assert compare_scans(initiator, [Scan(**one) for one in plain], expected, counts) > 1


@pytest.mark.parametrize("seed", range(5))
def test_residual_detections_are_those_in_no_gate(seed):
    rng = np.random.default_rng(seed)
    last = detections(rng.uniform(-1000, 1000, (30, 2)), 0.0, variance=1.0)
    last["major_sigma"] = rng.uniform(1.0, 60.0, 30)
    found = detections(rng.uniform(-1000, 1000, (200, 2)), 6.0)
    alpha = gate_factor(0.9)
    gated = tsepm.gate_within(last, found, 10.0, alpha * last["major_sigma"], alpha**2)
    radius = 60.0 + gate_factor(0.9) * last["major_sigma"]
    distance = np.linalg.norm(found["position"][:, None] - last["position"], axis=2)
    expected = np.flatnonzero((distance > radius).all(axis=1))
    assert 20 < len(expected) < 180
    assert np.delete(np.arange(200), gated.detection).tolist() == expected.tolist()


def random_split(seed: int, ties: bool):
    rng = np.random.default_rng([4, seed])
    counts = rng.integers(0, 6, 30)
    start = np.concatenate([[0], np.cumsum(counts)])
    gated = Gates(start, rng.integers(0, 50, start[-1]))
    gates = rng.integers(0, 30, 80)
    prices = rng.integers(0, 8, (80, 50)) if ties else rng.random((80, 50))
    return gates, gated, lambda parent, detection: prices[parent, detection].astype(float)


@pytest.mark.parametrize("block", [1, 7, 64, 1_000_000])
@pytest.mark.parametrize("ties", [False, True], ids=["distinct", "ties"])
@pytest.mark.parametrize("limit", [1, 10, 100])
def test_split_within_keeps_exactly_the_best_children(monkeypatch, block, ties, limit):
    monkeypatch.setattr(tsepm, "SPLIT_BLOCK", block)
    gates, gated, cost = random_split(limit, ties)
    everyone = children_in_gates(gates, gated)
    best = np.sort(np.argsort(cost(*everyone), kind="stable")[:limit])
    parent, detection, cut = split_paths(gates, gated, limit, cost)
    assert parent.tolist() == everyone[0][best].tolist()
    assert detection.tolist() == everyone[1][best].tolist()
    assert cut == len(everyone[0]) - limit


def test_a_gate_grows_with_the_time_of_either_sign_and_the_margin():
    last = detections([[0.0, 0.0]] * 3, [0.0, 4.0, 20.0])
    found = detections([[30.0, 0.0], [0.0, 61.0], [0.0, -101.5]], [10.0, 10.0, 10.0])
    gated = tsepm.gate_within(last, found, 10.0, np.array([1.0, 1.5, 2.0]))
    assert [gated.detection[a:b].tolist() for a, b in itertools.pairwise(gated.start)] == [
        [0, 1],
        [0, 1],
        [0, 1, 2],
    ]
    assert gated.count.tolist() == [2, 2, 3]
    assert tsepm.gate_within(last, found[:0], 10.0, np.ones(3)).count.tolist() == [
        0,
        0,
        0,
    ]


def test_detections_of_several_times_are_each_gated_at_their_own():
    last = detections([[0.0, 0.0]], [0.0])
    found = detections([[25.0, 0.0], [0.0, 25.0], [45.0, 0.0]], [2.0, 3.0, 4.0])
    assert tsepm.gate_within(last, found, 10.0, np.zeros(1)).detection.tolist() == [1]
    assert tsepm.gate_within(last, found, 12.5, np.zeros(1)).detection.tolist() == [
        0,
        1,
        2,
    ]


@pytest.mark.parametrize("hit_count", [2, 3, 5])
def test_f2_of_nearest_clutter_points_is_chi_square(hit_count):
    # Kennedy's null hypothesis: from point to nearest point of each new scan. 1000 independent
    # tracks; a Kolmogorov-Smirnov test at 0.1 %, for which a density 12 % off is found.
    rng = np.random.default_rng([12, hit_count])
    density, half = 1e-6, 6000.0
    positions = np.zeros((1000, hit_count, 2))
    for track in positions:
        for k in range(1, hit_count):
            n = rng.poisson(density * (2 * half) ** 2)
            points = track[k - 1] + rng.uniform(-half, half, (n, 2))
            track[k] = points[np.argmin(np.square(points - track[k - 1]).sum(axis=1))]
    statistic = clutter_statistic(positions, density)
    assert stats.kstest(statistic, stats.chi2(2 * hit_count - 2).cdf).pvalue > 1e-3
    wrong = stats.kstest(1.12 * statistic, stats.chi2(2 * hit_count - 2).cdf).pvalue
    assert wrong < stats.kstest(statistic, stats.chi2(2 * hit_count - 2).cdf).pvalue


def test_the_distance_of_hits_from_a_fit_is_the_largest_of_each_alone():
    rng = np.random.default_rng(2)
    hits = detections(rng.normal(0.0, 30.0, (2, 4, 2)), [0.0, 1.0, 2.0, 3.0], variance=4.0)
    fitted = fit_states(hits, 3.0, SensorModel(), "unweighted")
    found = tsepm.normalized_distance(hits, fitted)
    for track in range(2):
        squares = []
        for hit in hits[track]:
            h = np.kron(np.eye(2), [1.0, hit["time"] - 3.0])
            apart = hit["position"] - h @ fitted.state[track]
            spread = h @ fitted.covariance[track] @ h.T + hit["covariance"]
            squares.append(apart @ np.linalg.solve(spread, apart))
        assert found[track] == pytest.approx(max(squares))


def test_the_clutter_statistic_is_twice_the_clutter_expected_in_the_circles():
    positions = np.array([[[0.0, 0.0], [3.0, 4.0], [3.0, 6.0]]])
    expected = 2.0 * np.pi * (0.01 * 25.0 + 0.02 * 4.0)
    density = np.array([[9.0, 0.01, 0.02]])
    np.testing.assert_allclose(tsepm.clutter_statistic(positions, density), expected)


def test_thresholds_are_the_quantiles_of_the_paper():
    assert tsepm.distance_threshold(0.99, "literal") == math.sqrt(-2.0 * math.log(0.01))
    assert tsepm.distance_threshold(0.99, "squared") == pytest.approx(-2.0 * math.log(0.01))
    # Chi-square of two degrees of freedom has its quantiles in closed form; of eight, in a table.
    assert tsepm.clutter_threshold(0.1, 2) == pytest.approx(-2.0 * math.log(0.9))
    assert tsepm.clutter_threshold(0.05, 5) == pytest.approx(2.733, abs=1e-3)
