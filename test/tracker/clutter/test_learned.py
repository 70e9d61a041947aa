"""What was learned survives a restart, if fresh and of the same sensor."""

import copy
import json
from dataclasses import replace

import numpy as np
import pytest
from support.score_scenes import score, sea

from tsepm_ros import SensorModel
from tsepm_ros.tracker.clutter.learned import HALF_LIFE, read_learned, write_learned

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
    text = write_learned(run.learned, SENSOR, "sonar", 1000.0)
    found, age = read_learned(text, SENSOR, "sonar", 1000.0, DAY)
    assert age == 0.0
    fresh = score(SENSOR)
    fresh.learned = found
    assert fresh.clutter_density == pytest.approx(run.clutter_density, rel=0.02)
    probability = run.detection_probability
    assert fresh.detection_probability == pytest.approx(probability, abs=1e-9)
    assert probability < 0.75
    region, before = found.seen_extent.region, run.learned.seen_extent.region
    assert region.area == pytest.approx(before.area, rel=0.02)


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
    content = json.loads(write_learned(run.learned, SENSOR, "sonar", 0.0)) | change
    with pytest.raises(ValueError, match=said):
        read_learned(json.dumps(content), SENSOR, "sonar", time, DAY)


def test_what_was_learned_fades_with_its_age_and_a_text_of_long_ago_is_as_good_as_none(run):
    text = write_learned(run.learned, SENSOR, "sonar", 0.0)
    found = read_learned(text, SENSOR, "", HALF_LIFE, DAY)[0].clutter_map.memory[1]
    assert found == pytest.approx(0.5 * run.learned.clutter_map.memory[1])
    for days in (30.0, 260.0, 267.0, 365.0):
        initiator = score(SENSOR)
        initiator.learned = read_learned(text, SENSOR, "sonar", days * DAY, 366.0 * DAY)[0]
        assert initiator.clutter_density == pytest.approx(SENSOR.clutter_density)
        assert initiator.detection_probability == pytest.approx(SENSOR.detection_probability)


def test_numbers_that_are_not_finite_are_not_written(run):
    learned = copy.deepcopy(run.learned)
    learned.detection_probability.remember(float("inf"), float("inf"))
    with pytest.raises(ValueError):
        write_learned(learned, SENSOR, "sonar", 0.0)


def test_another_sensor_is_refused(run):
    text = write_learned(run.learned, SENSOR, "sonar", 0.0)
    with pytest.raises(ValueError, match="max_range was 9000"):
        read_learned(text, replace(SENSOR, max_range=500.0), "sonar", 0.0, DAY)
    with pytest.raises(ValueError, match="frame was 'sonar'"):
        read_learned(text, SENSOR, "other", 0.0, DAY)
    assert read_learned(text, SENSOR, "", 0.0, DAY)


@pytest.mark.parametrize("text", ["", "[1]", "{", "[" * 100_000, '"x"'])
def test_other_texts_are_refused(text):
    with pytest.raises(ValueError, match="it is not"):
        read_learned(text, SENSOR, "", 0.0, DAY)
