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
"""What measures the promises of the default method: its figures, on small scenes and by hand."""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
import promises
import pytest
from promises import closeness, difference, equal_rate_row
from support.run_summaries import run_of, start

from tsepm_ros.tools.evaluation.intervals import IntervalEstimate
from tsepm_ros.tools.evaluation.measures import measures_of
from tsepm_ros.tools.evaluation.performance import PerformanceEvaluated
from tsepm_ros.tools.evaluation.simulated_run import SimulatedOperatingPoint
from tsepm_ros.tools.simulation import load_scenario

SCENE = replace(load_scenario("box"), scans=4)
SWEEP = {"1/h": (2, 1), "10/h": (4, 4)}
"""Targets of four that `score` finds, and false starts per run, by its points."""


def options(folder: Path, runs: int) -> argparse.Namespace:
    return argparse.Namespace(runs=runs, seed=1, workers=1, out=folder, scene=None, warm_up=0)


def beside(found: int, false: int, sweep: dict[str, tuple[int, int]] = SWEEP) -> list[str]:
    """The row of a rule that finds so many of four targets, false starts per run, in equal runs."""
    points = {("tsepm", "5/8"): (found, false)}
    points |= {("score", label): point for label, point in sweep.items()}
    records = {
        name: [run_of(*[start(2)] * true, false=(0, 0, 0, wrong), targets=4)] * 3
        for name, (true, wrong) in points.items()
    }
    return equal_rate_row(
        PerformanceEvaluated(
            SCENE,
            4,
            [SimulatedOperatingPoint(*name) for name in records],
            list(records.values()),
            [measures_of(SCENE, runs, 4) for runs in records.values()],
        )
    )


@pytest.mark.parametrize(
    ("found", "false", "share", "cost", "verdict"),
    [
        # From 1 to 4 false starts 2 are half-way: so is the P_DT from 0.5 to 1.
        (3, 2, "0.75", "2.00", "cannot tell"),
        (2, 2, "0.75", "1.00", "holds"),
        (4, 2, "0.75", "4.00", "does not"),
        (1, 2, "0.75", "at most 1.00", "holds"),
        (4, 8, "at least 1.00", "4.00", "holds"),
        (4, 1, "0.50", "4.00", "does not"),
        (2, 0, "not reached: 1.00 or more", "1.00", "does not"),
    ],
)
def test_equal_false_rates_are_linear_in_the_logarithm_of_false_starts(
    found, false, share, cost, verdict
):
    row = beside(found, false)
    assert row[:2] == ["box", "4"]
    assert [cell.split(" (")[0] for cell in row[4:7]] == [share, cost, verdict]


@pytest.mark.parametrize(
    ("loss", "beyond", "found"),
    [
        ((-0.05, 0.01), False, "holds"),
        ((-0.05, 0.02), False, "cannot tell"),
        ((0.02, 0.05), False, "does not"),
        ((0.02, 0.05), True, "cannot tell"),
    ],
)
def test_loss_of_detection_is_decided_on_its_margin(loss, beyond, found):
    assert promises.within_margin(IntervalEstimate(0.0, *loss), beyond=beyond) == found


def test_more_targets_than_the_sweep_finds_are_not_compared_and_a_loss_has_its_interval():
    assert beside(4, 2, {**SWEEP, "10/h": (3, 4)})[5] == "not reached: P_DT up to 0.75"
    row = beside(3, 2)
    assert row[7].startswith("+0.000 (") and row[8] == "holds"


def test_a_difference_of_shares_is_close_far_or_open():
    same = difference(IntervalEstimate(0.8, 0.77, 0.83), IntervalEstimate(0.8, 0.76, 0.84))
    assert (same.value, same.low, same.high) == pytest.approx((0.0, -0.05, 0.05))
    assert closeness(same) == "cannot tell"
    assert closeness(IntervalEstimate(0.01, -0.01, 0.03)) == "holds"
    assert closeness(IntervalEstimate(-0.05, -0.07, -0.031)) == "does not"


@pytest.mark.long
def test_the_wish_is_kept_about():
    ratio = promises.rate_ratio(density=3e-7, rate=100.0, hours=0.1, seed=1, processes=1)
    assert 0.3 < ratio.value < 2.0
    assert ratio.low < ratio.value < ratio.high


@pytest.mark.long
def test_starts_are_about_as_good_as_their_bound_and_are_kept(tmp_path):
    header, *rows = promises.starts_table(options(tmp_path, runs=4), {1e-8: 2.5})
    one_degree = [dict(zip(header, row, strict=True)) for row in rows[:3]]
    assert [(row["azimuth error"], row["target"], row["runs"]) for row in one_degree] == [
        ("1 deg", "1/h", "10"),
        ("1 deg", "10/h", "10"),
        ("1 deg", "10/h, limit_speed off", "10"),
    ]
    _, limited, unlimited = (float(row["velocity error / bound"].split()[0]) for row in one_degree)
    assert limited < 0.8 < unlimited < 1.3
    assert len(list((tmp_path / "runs").iterdir())) == len(rows) == 6


def test_the_mean_over_all_speeds_has_the_interval_of_independent_estimates():
    mean = promises.mean_of([IntervalEstimate(3.0, 2.7, 3.4), IntervalEstimate(5.0, 4.6, 5.3)])
    assert (mean.value, mean.low, mean.high) == pytest.approx((4.0, 3.75, 4.25))


@pytest.mark.long
def test_speeds_stand_for_equal_parts_of_all_velocities(tmp_path):
    _, *rows, over_all = promises.speeds_table(options(tmp_path, runs=2), [1e-8])
    speeds = np.array([float(row[1]) for row in rows])
    assert np.square(speeds / 10.0) == pytest.approx([1 / 8, 3 / 8, 5 / 8, 7 / 8], abs=0.02)
    assert [row[3].split()[0] for row in rows] == ["1.0000"] * 4
    nees = [float(row[4].split()[0]) for row in rows]
    assert float(over_all[4].split()[0]) == pytest.approx(np.mean(nees), abs=0.02)


@pytest.mark.long
def test_equal_rates_are_measured_at_both_horizons(tmp_path):
    given = options(tmp_path, runs=2)
    given.scene = ["density 1e-7"]
    _, *rows = promises.equal_rate_table(given, (10, 1000))
    assert [row[:2] for row in rows] == [["density 1e-7", "8"], ["density 1e-7", "16"]]


@pytest.mark.long
def test_a_design_is_put_beside_whole_scenes(tmp_path):
    row = promises.designed(3e-8, 8, options(tmp_path, runs=15))
    planned, simulated, measured = (float(cell.split()[0]) for cell in row[2:5])
    assert min(planned, simulated, measured) > 0.6
    assert float(row[5].split()[0]) == pytest.approx(simulated - measured, abs=0.001)
