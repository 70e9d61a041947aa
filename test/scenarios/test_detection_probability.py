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
"""The detection probability in whole scenes: estimated from confirmed tracks."""

import math
from dataclasses import replace

import numpy as np
import pytest
from support.builders import reconfigured
from support.score_scenes import clutter, score

from tsepm_ros import Scan, SensorModel, make_initiator
from tsepm_ros.tracker.tracker import Tracker

SENSOR = SensorModel(clutter_density=3e-7)

TARGETS = np.array(
    [[3000.0, 3.0, 2000.0, -2.0], [-4000.0, 2.0, 1000.0, 3.0], [500.0, -3.0, -4500.0, 1.0]]
)


def seen(detected: float, seed: int, scans: int = 80) -> list[Scan]:
    """Scans of clutter and of the targets, which may be detected, and then vanish all at once."""
    rng, made = np.random.default_rng([9, seed]), []
    for index in range(scans):
        n = rng.poisson(SENSOR.clutter_density * SENSOR.coverage_area)
        range_ = 9000.0 * np.sqrt(rng.uniform(1e-6, 1.0, n))
        azimuth = rng.uniform(-math.pi, math.pi, n)
        found = TARGETS[rng.random(len(TARGETS)) < detected]
        x, y = (found[:, axis] + 12.0 * index * found[:, axis + 1] for axis in (0, 2))
        error = rng.standard_normal((2, len(found)))
        range_ = np.append(range_, np.hypot(x, y) * (1.0 + 0.015 * error[0]))
        azimuth = np.append(azimuth, np.arctan2(y, x) + SENSOR.azimuth_std * error[1])
        made.append(Scan(12.0 * index, range_, azimuth))
    return made


def run(scans: list[Scan], how: str, method: str = "score") -> Tracker:
    initiator = make_initiator(method, sensor=SENSOR, detection_probability=how)
    for scan in scans:
        initiator.process(scan)
    return initiator


@pytest.mark.parametrize(
    "true", [0.6, *(pytest.param(true, marks=pytest.mark.long) for true in (0.8, 0.95))]
)
def test_the_estimate_comes_near_the_truth(true):
    # 3 targets in 80 scans: 0.03 is the standard error of a share of 0.6 in 200 scans.
    found = [run(seen(true, seed), "estimated") for seed in range(4)]
    estimates = [one.sensor.estimated_detection_probability for one in found]
    assert max(abs(estimate - true) for estimate in estimates) < 0.1
    assert abs(np.mean(estimates) - true) < 0.04
    assert [one.sensor.detection_probability for one in found] == estimates


def test_targets_that_vanish_are_not_missed():
    initiator = run(seen(0.8, 1), "estimated")
    before = initiator.sensor.estimated_detection_probability
    for index in range(80, 110):
        initiator.process(Scan(12.0 * index, [], []))
    assert not len(initiator.current.sure)
    assert initiator.sensor.estimated_detection_probability == pytest.approx(before, abs=0.02)


def test_forgetting_all_forgets_it_and_another_data_sheet_counts_at_once():
    initiator = run(seen(0.6, 3), "given")
    before = initiator.sensor.estimated_detection_probability
    sheet = replace(SENSOR, detection_probability=0.5)
    reconfigured(initiator, sheet, initiator.common, initiator.options)
    assert initiator.sensor.estimated_detection_probability < before
    initiator.reset()
    assert initiator.sensor.estimated_detection_probability == pytest.approx(0.5)


@pytest.mark.long
def test_a_sea_without_targets_leaves_the_detection_probability_as_given():
    # Five false tracks a minute are allowed; each is missed most of the time.
    sensor = SensorModel(max_range=4000.0, clutter_density=2e-6, detection_probability=0.8)
    initiator = score(sensor, false_tracks_per_hour=300.0)
    rng = np.random.default_rng(4)
    for k in range(60):
        range_, azimuth = clutter(rng, 2e-6)
        near = range_ < 4000.0
        initiator.process(Scan(12.0 * k, range_[near], azimuth[near]))
    assert initiator.totals.confirmed > 15
    assert initiator.sensor.detection_probability > 0.65
