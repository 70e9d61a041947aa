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
"""What was learned survives a restart, if fresh and of the same sensor."""

from dataclasses import replace

import numpy as np
import pytest

from tsepm_ros import SensorModel
from tsepm_ros.tracker.clutter.amplitude_law import MIN_REFERENCES
from tsepm_ros.tracker.clutter.excess import ConfirmedTargets
from tsepm_ros.tracker.clutter.fixed_places import MIN_DENSITY_RATIO
from tsepm_ros.tracker.clutter.learned import (
    ClutterRangeRates,
    ClutterUse,
    ScanClutter,
    ScanInterval,
    Surroundings,
)
from tsepm_ros.tracker.measurement import DETECTION
from tsepm_ros.tracker.polar_grid import MEMORY_SCANS
from tsepm_ros.tracker.range_rates import clutter_density
from tsepm_ros.tracker.sensor import SensorView

SENSOR = SensorModel(clutter_density=1e-8)


def test_the_scan_interval_is_the_median_of_the_last_intervals():
    interval = ScanInterval()
    interval.update(0.0)
    assert interval.median == 0.0, "the first scan has none"
    for one in (4.0, 12.0, 4.0, 400.0, 5.0):
        interval.update(one)
    assert interval.median == 5.0
    for one in range(MEMORY_SCANS):
        interval.update(100.0 + one)
    assert interval.median == 100.0 + (MEMORY_SCANS - 1) / 2.0


def rated(rates) -> np.ndarray:
    """Detections ahead of a sensor that moves ahead at 3 m/s, by rates over ground."""
    made = np.zeros(len(rates), DETECTION)
    made["position"], made["sensor_velocity"] = (100.0, 0.0), (3.0, 0.0)
    made["range_rate"], made["range_rate_std"] = np.asarray(rates) - 3.0, 0.2
    return made


@pytest.mark.parametrize(
    ("rates", "width"),
    [
        (np.linspace(-1.0, 3.0, MIN_REFERENCES - 1), None),
        (np.linspace(-1.0, 3.0, MIN_REFERENCES), np.median(np.abs(np.linspace(-1.0, 3.0, 20)))),
        (np.full(30, 1e-3), 0.25),
        (np.zeros(30), 0.25),
        (np.resize([2e4, -2e4], 30), 1e4),
    ],
    ids=["too few", "median", "not below the error", "all are 0", "not above all rates"],
)
def test_the_width_of_clutter_s_range_rates_is_their_median_over_ground(rates, width):
    sensor = replace(SENSOR, range_rate_std=0.5, clutter_range_rate=7.0)
    learned = ClutterRangeRates()
    for part in np.array_split(rates, 3):
        made = np.append(rated(part), rated([50.0]))
        made["range_rate_std"][-1] = 0.0  # does not count
        last = learned.estimate(made, sensor)
    assert last.clutter_range_rate == pytest.approx(width or 7.0)


def test_clutter_drifts_where_that_explains_its_range_rates():
    rng, learned = np.random.default_rng(1), ClutterRangeRates()
    sensor = replace(SENSOR, range_rate_std=0.2)
    for _ in range(10):
        angle, made = rng.uniform(-np.pi, np.pi, 20), rated(np.zeros(20))
        made["position"] = 100.0 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        made["range_rate"] = 2.0 * np.cos(angle - 1.0) - 3.0 * np.cos(angle)
        made["range_rate"] += 0.3 * rng.standard_normal(20)
        last = learned.estimate(made, sensor)
    expected = 2.0 * np.cos(1.0), 2.0 * np.sin(1.0)
    np.testing.assert_allclose(made["clutter_velocity"], np.tile(expected, (20, 1)), atol=0.1)
    assert last.clutter_range_rate == pytest.approx(0.2, abs=0.04)  # 0.67 deviations
    density = clutter_density(made, last)
    assert np.mean(density > 0.7 / (2.0 * np.pi * 0.2)) > 0.6


@pytest.mark.parametrize("clutter_density", ["given", "estimated"])
def test_the_density_at_a_scan_is_as_given_or_of_the_map_and_raised_where_clutter_stays(
    clutter_density,
):
    use = ClutterUse(1e-8 if clutter_density == "given" else None, False)
    learned = Surroundings.initial(SENSOR)
    polar = np.array([1000.0, 5000.0, 8000.0]), np.array([0.0, 1.0, -2.0])
    clutter = learned.at(use, polar)
    density = clutter.density
    np.testing.assert_allclose(density, 1e-8)
    assert not clutter.is_fixed.any()
    clutter = replace(clutter, staying=density * MIN_DENSITY_RATIO * [0.0, 0.99, 1.01])
    assert clutter.is_fixed.tolist() == [False, False, True]
    nobody = ConfirmedTargets(np.zeros(0, np.int64), *np.zeros((3, 0)))
    before = learned.before(use, clutter, nobody)
    np.testing.assert_allclose(before, density * [1.0, 1.0, 1.01 * MIN_DENSITY_RATIO])


def learned_scan(
    learned: Surroundings, stamp: float, weight: list[float], given: float | None = None
) -> ScanClutter:
    """A scan of two detections of clutter, learned from."""
    use, polar = ClutterUse(given, not given), (np.array([1000.0, 5000.0]), np.array([0.0, 1.0]))
    nobody = ConfirmedTargets(np.zeros(0, np.int64), *np.zeros((3, 0)))
    view, none = SensorView(SENSOR, (0.0, 0.0, 0.0), None), np.zeros(0, np.int64)
    clutter = learned.at(use, polar)
    return learned.learn(use, clutter, stamp, view, np.array(weight), 0.0, nobody, none)


def test_what_counts_of_clutter_may_change_within_a_batch():
    learned = Surroundings.initial(SENSOR)
    for index in range(100):  # batches of many scans after the first
        learned.scan_interval.update(0.05)
        learned_scan(learned, 0.05 * index, [1.0, 0.5], given=1e-8 if index % 7 < 3 else None)
        assert len(learned.batch.densities) == len(learned.batch.weights)


@pytest.mark.parametrize("whole", [True, False])
def test_what_turns_out_to_be_a_target_s_is_taken_back_where_it_was_learned(whole):
    learned = Surroundings.initial(SENSOR)
    for index in range(40):  # until a batch of fast scans is more than one scan
        learned.scan_interval.update(12.0 if whole else 0.02)
        clutter = learned_scan(learned, index * (12.0 if whole else 0.02), [1.0, 0.5])
    assert learned.batch.is_new == whole
    counts = learned.clutter_map.memory[0][clutter.cells]
    learned.withdraw(clutter, np.array([0.25, 1.0]))
    left = learned.clutter_map.memory[0][clutter.cells]
    np.testing.assert_allclose(counts - left, [0.25, 0.5] if whole else 0.0)
    last = learned.overdispersion._last[1][-1] if whole else learned.batch.weights[-1]
    assert last.tolist() == [0.75, 0.0]
    assert clutter.weight.tolist() == [1.0, 0.5], "what was learned from the scan stays"
