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
"""Simulations of the sources: gates, merged groups, and hits predicted from others."""

import dataclasses
import itertools

import numpy as np
import pytest
from scipy.linalg import block_diag
from support.builders import detections

from tsepm_ros.methods.tsepm import TsepmOptions
from tsepm_ros.studies.reproduction import (
    monte_carlo,
    split_merge_2016,
    tsepm_2018,
)
from tsepm_ros.studies.reproduction.monte_carlo import MonteCarloStarts
from tsepm_ros.studies.split_merge import SplitMerge, SplitMergeOptions
from tsepm_ros.tools.evaluation.simulated_run import SimulatedScene
from tsepm_ros.tools.simulation import load_scenario
from tsepm_ros.tracker.options import CommonOptions
from tsepm_ros.tracker.sensor import SensorModel
from tsepm_ros.tracker.tracker import Tracker

ROWS = {row.name: row for row in monte_carlo.TABLE_1}


def test_the_fixed_margin_gates_as_errors_of_that_size_would():
    """Where all errors are the same, Eq. 4's margin is the fixed one, so that nothing differs."""
    same = list(monte_carlo.table_1_cases().values())[2]
    fixed = dataclasses.replace(same, method="fixed margin")
    scene = SimulatedScene.drawn(same.scenario, [1, 0])
    row = ROWS["3/4"]
    counts = [
        monte_carlo._table_1_counts(scene, row, "squared", case.method) for case in (same, fixed)
    ]
    assert counts[0][monte_carlo.Counted.WRONG] > 0
    assert counts[0][:6] == pytest.approx(counts[1][:6], rel=0.02)
    stated, with_margin = list(monte_carlo.table_1_cases().values())[:2]
    assert stated.scenario == with_margin.scenario and with_margin.method == "fixed margin"


def distances_by_hand(method, hits, used):
    """The distance of each hit from the line through the hits that may be used, by matrices."""
    largest = np.zeros(len(hits))
    for row, track in enumerate(hits):
        for place, hit in enumerate(track):
            others = used(track, place)
            if len(others) < 2:
                continue
            designs, weights = [], []
            for other in (*others, hit):
                one = np.zeros((2, 4))
                time = other["time"] - method.stamp
                one[0, :2] = one[1, 2:] = 1.0, time
                designs.append(one)
                weights.append(other["covariance"])
            design = np.concatenate(designs[:-1])
            inverse = np.linalg.pinv(design)
            state = inverse @ np.concatenate([other["position"] for other in others])
            errors = block_diag(*weights[:-1])
            covariance = designs[-1] @ inverse @ errors @ inverse.T @ designs[-1].T + weights[-1]
            misfit = hit["position"] - designs[-1] @ state
            value = misfit @ np.linalg.solve(covariance, misfit)
            largest[row] = max(largest[row], value)
    return largest


@pytest.mark.parametrize(
    ("kind", "used"),
    [
        (monte_carlo.MonteCarloPredicted, lambda track, place: np.delete(track, place)),
        (monte_carlo.MonteCarloPredictedByEarlier, lambda track, place: track[:place]),
    ],
)
def test_a_hit_is_predicted_from_hits_without_it(kind, used):
    options = TsepmOptions(min_hits=5, window=8)
    method = kind(SensorModel(), CommonOptions(), options)
    rng = np.random.default_rng(1)
    times = np.sort(rng.uniform(0.0, 90.0, (20, 5)), axis=1)
    places = np.array([4000.0, 3000.0]) + rng.normal(0.0, 300.0, (20, 5, 2))
    hits = detections(places, times, variance=1e4)
    ids = method.detections.append(hits.ravel()).reshape(20, 5)
    method.stamp = 90.0
    candidates = method.estimated(ids)
    expected = distances_by_hand(method, hits, used)
    np.testing.assert_allclose(candidates.evaluation, expected, rtol=1e-6)
    np.testing.assert_allclose(candidates.distance, expected, rtol=1e-6)


def test_a_merged_group_may_be_judged_by_any_of_its_members():
    """In clutter of 3e-6 merging hides true members behind a better fit of false ones."""
    runs = [monte_carlo.comparison(monte_carlo.DENSITIES[3e-6], [1, run]) for run in range(3)]
    for run in runs:
        found, _, _, by_any, reached, left = run["tsepm, f1 literal"]
        assert by_any >= found
        assert reached >= left > 0
        errors = np.reshape(run["weights"], (-1, len(monte_carlo.WEIGHTS)))
        assert np.isfinite(errors).all()
    assert sum(run["tsepm, f1 squared"][3] for run in runs) == 3


def test_the_gate_is_hit_as_often_as_by_simulation_and_falls_below_what_is_claimed():
    rng = np.random.default_rng(3)
    error, n = 120.0, 200_000
    sensor = tsepm_2018.monte_carlo_sensor(error)
    target = np.array([[5000.0, 5000.0], [5060.0, 5000.0]])
    range_ = np.hypot(*target.T) * (1 + sensor.range_std_fraction * rng.standard_normal((n, 2)))
    azimuth = np.arctan2(*target.T[::-1]) + sensor.azimuth_std * rng.standard_normal((n, 2))
    x, y = range_ * np.cos(azimuth), range_ * np.sin(azimuth)
    inside = np.hypot(*np.diff([x, y], axis=2)[..., 0]) <= 120.0 + 2.146 * error
    # Five standard errors, and what linearising the polar errors leaves.
    assert tsepm_2018.gate_hit_probability(error) == pytest.approx(inside.mean(), abs=4e-3)
    falling = [tsepm_2018.gate_hit_probability(error) for error in (15.0, 75.0, 120.0, 300.0)]
    assert all(one > other for one, other in itertools.pairwise(falling))
    assert falling[-1] < monte_carlo.GATE_PROBABILITY


def test_split_only_puts_out_every_raw_confirmation():
    scenario = load_scenario("four_targets", {"scans": 8})
    counts = split_merge_2016.run_four_targets(scenario, [1, 0])
    starter = Tracker(SplitMerge(scenario.sensor, CommonOptions(), SplitMergeOptions()))
    merged = MonteCarloStarts.on(SimulatedScene.drawn(scenario, [1, 0]), starter, 8)
    assert counts["merged"][0] == len(merged.tracks)
    assert counts["split"][0] == starter.totals.raw_confirmations > len(merged.tracks)
    assert sum(counts["split areas"]) < counts["split"][0]
    assert (np.array(counts["split near"]) <= counts["split areas"]).all()
