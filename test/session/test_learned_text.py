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
"""What was learned, as a text."""

import copy
import json
from dataclasses import replace

import numpy as np
import pytest
from support.score_scenes import score, sea

from tsepm_ros import Scan, SensorModel
from tsepm_ros.session.learned_text import (
    HALF_LIFE,
    SIGNATURE,
    OtherCoverageError,
    joined_learned,
    learned_of,
    read_learned,
    write_learned,
)

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
    with pytest.raises(OtherCoverageError, match="max_range was 9000"):
        read_learned(text, replace(SENSOR, max_range=500.0), "sonar", 0.0, DAY)
    with pytest.raises(ValueError, match="frame was 'sonar'"):
        read_learned(text, SENSOR, "other", 0.0, DAY)
    assert read_learned(text, SENSOR, "", 0.0, DAY)


def test_clutter_at_the_edge_of_the_coverage_does_not_spoil_the_text():
    initiator = score(SENSOR)
    for k in range(20):
        initiator.process(Scan(12.0 * k, np.array([100.0, 9030.0]), np.array([0.0, 0.5])))
    assert initiator.sensor.learned.seen_extent.places[0].max() > SENSOR.max_range
    text = write_learned(initiator.sensor.learned, SENSOR, "sonar", 0.0)
    found = read_learned(text, SENSOR, "sonar", 0.0, DAY)[0].seen_extent
    assert found.places[0].max() == SENSOR.max_range


@pytest.mark.parametrize("text", ["", "[1]", "{", "[" * 100_000, '"x"'])
def test_other_texts_are_refused(text):
    with pytest.raises(ValueError, match="it is not"):
        read_learned(text, SENSOR, "", 0.0, DAY)
