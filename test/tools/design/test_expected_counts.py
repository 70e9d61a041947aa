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
"""Expected counts of rules: closed forms, the published table, and a simulation start by start."""

import math

import numpy as np
import pytest

from tsepm_ros import SensorModel
from tsepm_ros.methods.tsepm import TsepmOptions, clutter_threshold
from tsepm_ros.studies.reproduction import monte_carlo as published
from tsepm_ros.tools.design import expected_counts
from tsepm_ros.tools.design.expected_counts import ExpectedGating


@pytest.mark.parametrize(("factor", "share"), [(0.99, 1.0), (1.01, 0.0)])
def test_targets_pass_the_clutter_statistic_up_to_its_critical_density(factor, share):
    """Exact hits in each ping: f_2 = 2 pi lambda (M - 1) (v T)^2 of all targets."""
    options = TsepmOptions(evaluation="clutter_statistic", min_hits=5, window=5)
    threshold = clutter_threshold(options.clutter_test_size, options.min_hits)
    critical = threshold / (2.0 * math.pi * 4 * (5.0 * 12.0) ** 2)
    sensor = SensorModel(
        range_std=1e-6,
        range_std_fraction=0.0,
        azimuth_std=1e-9,
        detection_probability=1.0,
        clutter_density=factor * critical,
    )
    gating = ExpectedGating(sensor=sensor, max_speed=10.0, interval=12.0, gate_probability=0.9)
    assert expected_counts.target_pass_share(gating, options, 5.0) == share


def test_no_target_passes_where_none_has_enough_hits():
    """P_DT of a rule 16/16 is 1e-16 at p_d = 0.1: none of 10 000 targets."""
    sensor = SensorModel(detection_probability=0.1)
    gating = ExpectedGating(sensor=sensor, max_speed=10.0, interval=12.0, gate_probability=0.9)
    assert (
        expected_counts.target_pass_share(gating, TsepmOptions(min_hits=16, window=16), 5.0) == 0.0
    )


TABLE_1 = {row.rule: (row.false_before, *row.detection) for row in published.TABLE_1}

LOW_IN_PRINT = {(4, 6), (4, 7)}

NO_GATE_FITS = {(4, 7), (5, 9), (7, 9)}

FITTED_MARGIN = 159.78

STATED_MARGIN = 2.146 * 0.015 * 5000.0


@pytest.mark.parametrize("rule", sorted(set(TABLE_1) - LOW_IN_PRINT))
def test_p_d_is_that_of_the_published_table(rule):
    published = TABLE_1[rule][1:]
    computed = [expected_counts.confirmation_probability(*rule, p, 0.9) for p in (1.0, 0.9, 0.8)]
    assert computed == pytest.approx(published, abs=1e-4)


@pytest.mark.parametrize("rule", sorted(set(TABLE_1) - NO_GATE_FITS))
@pytest.mark.parametrize(("margin", "within"), [(FITTED_MARGIN, 2e-4), (STATED_MARGIN, 3.5e-3)])
def test_false_starts_are_those_of_the_published_table(rule, margin, within):
    if rule == (5, 8):
        within = max(within, 1e-3)
    computed = expected_counts.false_start_probability(
        *rule, 1e-6, expected_counts.unbounded_gate_areas(10.0, 12.0, margin, rule[1])
    )
    assert computed == pytest.approx(TABLE_1[rule][0], abs=within)


def test_a_target_is_confirmed_as_often_as_its_start_by_start_simulation():
    passes, rng = 0.6, np.random.default_rng(5)
    min_hits, window, scans, runs = 4, 6, 14, 40_000
    by_scan = np.zeros(scans)
    for _ in range(runs):
        first, hits = None, 0
        for scan in range(scans):
            if first is None:
                if rng.random() < 0.8:
                    first, hits = scan, 1
                continue
            hits += rng.random() < 0.8 * 0.9
            if hits == min_hits:
                if rng.random() < passes:
                    by_scan[scan:] += 1
                    break
                first = None
            elif scan - first + 1 == window:
                first = None
    computed = expected_counts.confirmed_by(min_hits, window, 0.8, 0.9, scans, passes)
    # Five standard errors of the simulated shares.
    assert computed == pytest.approx(by_scan / runs, abs=5 * 0.5 / np.sqrt(runs))
