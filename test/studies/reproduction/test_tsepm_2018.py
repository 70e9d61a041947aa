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
"""TSEPM 2018: rows of Table 1 that no reading explains, and ratios with their intervals."""

import re
from pathlib import Path

import numpy as np
import pytest

from tsepm_ros.methods import tsepm
from tsepm_ros.methods.registry import make_initiator
from tsepm_ros.studies.reproduction import (
    monte_carlo,
    tsepm_2018,
)
from tsepm_ros.studies.reproduction.report import ReportSetting
from tsepm_ros.tools.evaluation.simulated_run import SimulatedScene

ROWS = {row.name: row for row in monte_carlo.TABLE_1}

LOW_IN_PRINT = {"4/6", "4/7"}

NO_GATE_FITS = {"4/7", "5/9", "7/9"}


@pytest.mark.parametrize("name", sorted(LOW_IN_PRINT))
def test_one_factor_too_many_explains_the_rows_that_the_closed_form_misses(name):
    assert tsepm_2018.detection_with_slip(ROWS[name]) == pytest.approx(
        ROWS[name].detection, abs=1e-4
    )


def test_rows_that_fit_no_reading_or_cannot_be_compared_are_named_and_print_is_rounded():
    assert set(tsepm_2018.unmatched_detection()) == LOW_IN_PRINT
    assert set(tsepm_2018.unmatched_false_before()) == NO_GATE_FITS


def runs_of_table_1(found, wrong, starts, errors):
    """Runs with the same counts in every row and by both thresholds."""
    counts = [20.0, 3.0, 2.0, starts, wrong, found, *errors]
    names = [f"{name} {threshold}" for name in ROWS for threshold in tsepm.READINGS]
    return dict.fromkeys(names, counts)


def test_a_reading_agrees_in_the_rows_whose_print_lies_in_its_intervals():
    rng = np.random.default_rng(1)
    runs = [
        runs_of_table_1(float(found), float(wrong), 400.0, (100.0, 5.0))
        for found, wrong in zip(np.arange(100) < 82, rng.poisson(40.0, 100), strict=True)
    ]
    one = tsepm_2018.Tsepm2018Reading.of("as stated, literal", runs, "per start")
    low, high = one.found[0].low, one.found[0].high
    near = [low <= row.detection[1] <= high for row in monte_carlo.TABLE_1]
    assert one.found[0].value == 0.82 and 0 < sum(near) < 15
    assert one.agreeing[0] == sum(near)
    assert one.false[0].value == pytest.approx(0.1, abs=0.005)
    assert one.agreeing[1] == 3, "3/4, 4/7 and 5/9 have 0.10"
    assert one.errors[0][0].value == 100.0 and one.errors[0][1].value == 5.0


def test_the_stages_of_the_picture_are_those_of_the_method():
    setting = ReportSetting(folder=Path("unused"), runs=1)
    [picture] = tsepm_2018.stage_parts(setting)
    scenario = monte_carlo.DENSITIES[1e-6]
    starter = make_initiator(
        "tsepm", sensor=scenario.sensor, max_speed=10.0, **monte_carlo.SHARED_OPTIONS
    )
    scene = SimulatedScene.drawn(scenario, [1, 0])
    tracks = monte_carlo.MonteCarloStarts.on(scene, starter, 8).tracks
    totals = starter.totals
    counts = totals.raw_confirmations, totals.raw_confirmations - totals.pruned, len(tracks)
    assert counts[0] > counts[1] > counts[2] > 0
    told = [int(re.search(r": (\d+)", panel.settings["title"])[1]) for panel in picture.panels[1:]]
    assert told == list(counts)
    ends = np.stack([picture.panels[3].lines[0].x, picture.panels[3].lines[0].y], axis=1)
    np.testing.assert_allclose(ends[1::3], tracks.state[:, 0::2])


def test_ratios_cover_the_truth_as_often_as_said():
    """400 trials: the share of 95 % intervals that cover, within 4 standard errors."""
    rng = np.random.default_rng(1)
    covered = 0
    for _ in range(400):
        starts = rng.poisson(20.0, 50)
        one = tsepm_2018.tsepm_2018_ratio(rng.poisson(0.3 * starts), starts)
        covered += one.low <= 0.3 <= one.high
    assert covered / 400 == pytest.approx(0.95, abs=4 * np.sqrt(0.95 * 0.05 / 400))


def test_a_ratio_without_an_event_has_a_bound_and_one_without_a_whole_is_unknown():
    none = tsepm_2018.tsepm_2018_ratio(np.zeros(2), np.array([10, 20]))
    assert (none.value, none.low) == (0.0, 0.0)
    assert none.high == pytest.approx(3.689 / 30, rel=1e-3)
    assert np.isnan(tsepm_2018.tsepm_2018_ratio(np.zeros(2), np.zeros(2)).value)
