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

import copy
import json
from dataclasses import replace

import numpy as np
import pytest
from support.score_scenes import score, sea

from tsepm_ros import SensorModel
from tsepm_ros.tracker.clutter.amplitude_law import MIN_REFERENCES
from tsepm_ros.tracker.clutter.excess import ConfirmedTargets
from tsepm_ros.tracker.clutter.fixed_places import MIN_DENSITY_RATIO
from tsepm_ros.tracker.clutter.learned import (
    HALF_LIFE,
    SIGNATURE,
    ClutterRangeRates,
    ClutterUse,
    ScanClutter,
    ScanInterval,
    Surroundings,
    joined_learned,
    learned_of,
    read_learned,
    write_learned,
)
from tsepm_ros.tracker.measurement import DETECTION
from tsepm_ros.tracker.polar_grid import MEMORY_SCANS
from tsepm_ros.tracker.sensor import SensorView

DAY = 86_400.0

SENSOR = SensorModel(clutter_density=1e-8)

TARGET = (3000.0, 3.0, 1000.0, 4.0)


@pytest.fixture(scope="module")
def run():
    initiator = score(SENSOR)
    for scan in sea(np.random.default_rng(2), 40, [TARGET], density=1e-8, detected=0.6):
        initiator.process(scan)
    return initiator


def test_a_restart_goes_on_with_what_was_learned(run):
    text = write_learned(run.sensor.learned, SENSOR, "sonar", 1000.0)
    found, age = read_learned(text, SENSOR, "sonar", 1000.0, DAY)
    assert age == 0.0
    fresh = score(SENSOR)
    fresh.sensor.learned = found
    assert fresh.sensor.clutter_density == pytest.approx(run.sensor.clutter_density, rel=0.02)
    probability = run.sensor.detection_probability
    assert fresh.sensor.detection_probability == pytest.approx(probability, abs=1e-9)
    assert probability < 0.75
    region, before = found.seen_extent.region, run.sensor.learned.seen_extent.region
    assert region.area == pytest.approx(before.area, rel=0.02)


def test_what_was_learned_of_an_unknown_sensor_refuses_no_other(run):
    text = write_learned(run.sensor.learned, SENSOR, "sonar", 1000.0)
    joined = joined_learned({"port": text, "removed": '{"format": "of later"}'}, 1000.0)
    _, age = read_learned(learned_of(joined, "port"), SENSOR, "sonar", 1600.0, DAY)
    assert age == 600.0
    with pytest.raises(ValueError, match="it has nothing of starboard"):
        learned_of(joined, "starboard")


@pytest.mark.parametrize(
    ("change", "time", "said"),
    [
        ({}, 2.0 * DAY, "stale"),
        ({}, -1.0, "time to come"),
        ({"format": 2}, 0.0, "format"),
        ({"time": None}, 0.0, "time"),
        ({"sensor": 3}, 0.0, "sensor"),
        ({"clutter_counts": [[1.0]]}, 0.0, "content"),
        ({"clutter_counts": "x"}, 0.0, "content"),
        ({"detected": float("nan")}, 0.0, "content"),
        ({"covered": -1.0}, 0.0, "content"),
        ({"seen_range": [1.0, 2.0]}, 0.0, "content"),
        *(
            ({name: value}, 0.0, f"content .* {name} must be")
            for name in ("time", "clutter_scans", "detected", "covered")
            for value in (10**400, 1e308, -1e308, float("inf"), float("nan"), "1", [1.0], None)
        ),
        *(
            ({"clutter_scans": value}, 0.0, "clutter_scans must be at least 1")
            for value in (0, 1e-320, 0.5)
        ),
        *(({"detected": value}, 0.0, "covered must be") for value in (0, 1e-320, 1e6)),
        ({"covered": 0}, 0.0, "covered must be"),
        ({"seen_range": [1e308], "seen_azimuth": [0.0]}, 0.0, "seen_range must be"),
        ({"seen_range": [1.0], "seen_azimuth": [1e200]}, 0.0, "seen_azimuth must be"),
    ],
)
def test_what_does_not_fit_is_refused_with_the_reason(run, change, time, said):
    content = json.loads(write_learned(run.sensor.learned, SENSOR, "sonar", 0.0)) | change
    with pytest.raises(ValueError, match=said):
        read_learned(json.dumps(content), SENSOR, "sonar", time, DAY)


def test_what_was_learned_fades_with_its_age_and_a_text_of_long_ago_is_as_good_as_none(run):
    text = write_learned(run.sensor.learned, SENSOR, "sonar", 0.0)
    found = read_learned(text, SENSOR, "", HALF_LIFE, DAY)[0].clutter_map.memory[1]
    assert found == pytest.approx(0.5 * run.sensor.learned.clutter_map.memory[1])
    for days in (30.0, 260.0, 267.0, 365.0):
        initiator = score(SENSOR)
        initiator.sensor.learned = read_learned(text, SENSOR, "sonar", days * DAY, 366.0 * DAY)[0]
        assert initiator.sensor.clutter_density == pytest.approx(SENSOR.clutter_density)
        assert initiator.sensor.detection_probability == pytest.approx(SENSOR.detection_probability)


def test_texts_of_several_sensors_are_one_and_that_of_a_single_one_stays_as_it_is(run):
    text = write_learned(run.sensor.learned, SENSOR, "sonar", 1000.0)
    assert joined_learned({"": text}, 1000.0) == learned_of(text, "") == text
    joined = joined_learned({"port": text, "starboard": text}, 1000.0)
    assert SIGNATURE.match(joined.encode()) and SIGNATURE.match(text.encode())
    assert learned_of(joined, "port") == learned_of(joined, "starboard") == text
    for other, sensor, said in (
        (joined, "radar", "nothing of radar"),
        (text, "port", "not a learned state of several sensors"),
        ("[]", "port", "not a learned state of several sensors"),
        ('{"format": 2, "sensors": []}', "port", "not a learned state of several sensors"),
        ("{", "port", "."),
    ):
        with pytest.raises(ValueError, match=said):
            learned_of(other, sensor)
    with pytest.raises(ValueError, match="not a learned state of format 1"):
        read_learned(joined, SENSOR, "sonar", 1000.0, DAY)
    with pytest.raises(ValueError, match="not a learned state of format 1"):
        text = learned_of('{"format": 2, "sensors": {"port": 3}}', "port")
        read_learned(text, SENSOR, "", 1.0, 9.0)


def test_numbers_that_are_not_finite_are_not_written(run):
    learned = copy.deepcopy(run.sensor.learned)
    learned.detection_probability.remember(float("inf"), float("inf"))
    with pytest.raises(ValueError):
        write_learned(learned, SENSOR, "sonar", 0.0)


def test_another_sensor_is_refused(run):
    text = write_learned(run.sensor.learned, SENSOR, "sonar", 0.0)
    with pytest.raises(ValueError, match="max_range was 9000"):
        read_learned(text, replace(SENSOR, max_range=500.0), "sonar", 0.0, DAY)
    with pytest.raises(ValueError, match="frame was 'sonar'"):
        read_learned(text, SENSOR, "other", 0.0, DAY)
    assert read_learned(text, SENSOR, "", 0.0, DAY)


@pytest.mark.parametrize("text", ["", "[1]", "{", "[" * 100_000, '"x"'])
def test_other_texts_are_refused(text):
    with pytest.raises(ValueError, match="it is not"):
        read_learned(text, SENSOR, "", 0.0, DAY)


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
        (np.full(30, 2e4), 1e4),
    ],
    ids=["too few", "median", "not below the error", "not above all rates"],
)
def test_the_width_of_clutter_s_range_rates_is_their_median_over_ground(rates, width):
    sensor = replace(SENSOR, range_rate_std=0.5, clutter_range_rate=7.0)
    learned = ClutterRangeRates()
    for part in np.array_split(rates, 3):
        made = np.append(rated(part), rated([50.0]))
        made["range_rate_std"][-1] = 0.0  # does not count
        learned.update(made)
    assert learned.estimate(sensor).clutter_range_rate == pytest.approx(width or 7.0)


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


def learned_scan(learned: Surroundings, stamp: float, weight: list[float]) -> ScanClutter:
    """A scan of two detections of clutter, learned from."""
    use, polar = ClutterUse(None, True), (np.array([1000.0, 5000.0]), np.array([0.0, 1.0]))
    nobody = ConfirmedTargets(np.zeros(0, np.int64), *np.zeros((3, 0)))
    view, none = SensorView(SENSOR, (0.0, 0.0, 0.0), None), np.zeros(0, np.int64)
    clutter = learned.at(use, polar)
    return learned.learn(use, clutter, stamp, view, np.array(weight), 0.0, nobody, none)


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
