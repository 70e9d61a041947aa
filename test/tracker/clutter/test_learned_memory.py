"""What was learned survives a restart, as far as it is fresh and of the same sensor."""

import copy
import json
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from support import learned_texts
from support.score_scenes import score, sea

from tsepm_ros import SensorModel
from tsepm_ros.tracker.clutter.learned import HALF_LIFE, read, written
from tsepm_ros.tracker.clutter.seen import MAX_DETECTIONS, Extent, SeenExtent

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
    text = written(run.learned, SENSOR, "sonar", 1000.0)
    found = read(text, SENSOR, "sonar", 1000.0, DAY)
    assert found.age == 0.0
    fresh = score(SENSOR)
    fresh.learned = found.learned
    assert fresh.clutter_density == pytest.approx(run.clutter_density, rel=0.02)
    probability = run.detection_probability
    assert fresh.detection_probability == pytest.approx(probability, abs=1e-9)
    assert probability < 0.75
    region, before = found.learned.seen_extent.region, run.learned.seen_extent.region
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
            for name in ("time", "clutter_scans", "detected", "covered", "strengths_count")
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
        ({"strengths": [1.0]}, 0.0, "strengths must be"),
        ({"strengths": [0.0] * 255 + [-1.0]}, 0.0, "strengths must be"),
        ({"strengths_in_decibels": 1e308}, 0.0, "strengths_in_decibels must be"),
    ],
)
def test_what_does_not_fit_is_refused_with_the_reason(run, change, time, said):
    content = json.loads(written(run.learned, SENSOR, "sonar", 0.0)) | change
    with pytest.raises(ValueError, match=said):
        read(json.dumps(content), SENSOR, "sonar", time, DAY)


@pytest.mark.parametrize(
    "cases", [range(200), pytest.param(range(2000), marks=pytest.mark.long)], ids=len
)
def test_replaced_numbers_are_refused_or_targets_confirm_as_without_the_text(cases):
    tried = Counter()
    for number in cases:
        tried += learned_texts.check_replaced(number, np.random.default_rng((1, number)))
    used = tried["learned values, used"]
    assert 0.05 < used / len(cases) < 0.5, "both outcomes are tried"


def test_what_was_learned_fades_with_its_age_and_a_text_of_long_ago_is_as_good_as_none(run):
    text = written(run.learned, SENSOR, "sonar", 0.0)
    found = read(text, SENSOR, "", HALF_LIFE, DAY).learned.clutter_map.memory[1]
    assert found == pytest.approx(0.5 * run.learned.clutter_map.memory[1])
    for days in (30.0, 260.0, 267.0, 365.0):
        initiator = score(SENSOR)
        initiator.learned = read(text, SENSOR, "sonar", days * DAY, 366.0 * DAY).learned
        assert initiator.clutter_density == pytest.approx(SENSOR.clutter_density)
        assert initiator.detection_probability == pytest.approx(SENSOR.detection_probability)


def test_numbers_that_are_not_finite_are_not_written(run):
    learned = copy.deepcopy(run.learned)
    learned.detection_probability.remember(float("inf"), float("inf"))
    with pytest.raises(ValueError):
        written(learned, SENSOR, "sonar", 0.0)


def test_places_do_not_grow_with_restarts():
    extent, rng = SeenExtent(Extent.of(SENSOR)), np.random.default_rng(1)
    for _ in range(5):
        before, extent = extent, SeenExtent(Extent.of(SENSOR))
        extent.remember(*before.places)
        extent.update(rng.uniform(10.0, 9000.0, 490), rng.uniform(-3.0, 3.0, 490), np.ones(490))
        assert extent.detections < 2 * MAX_DETECTIONS


def test_another_sensor_is_refused(run):
    text = written(run.learned, SENSOR, "sonar", 0.0)
    with pytest.raises(ValueError, match="max_range was 9000"):
        read(text, replace(SENSOR, max_range=500.0), "sonar", 0.0, DAY)
    with pytest.raises(ValueError, match="frame was 'sonar'"):
        read(text, SENSOR, "other", 0.0, DAY)
    assert read(text, SENSOR, "", 0.0, DAY)


@pytest.mark.parametrize("text", ["", "[1]", "{", "[" * 100_000, '"x"'])
def test_other_texts_are_refused(text):
    with pytest.raises(ValueError, match="it is not"):
        read(text, SENSOR, "", 0.0, DAY)


def test_strengths_survive_and_texts_of_earlier_versions_have_none():
    initiator = score(SENSOR)
    rng = np.random.default_rng(3)
    for scan in sea(rng, 20, [TARGET], detected=0.9):
        initiator.process(replace(scan, features={"intensity": rng.exponential(size=len(scan))}))
    raw, weight, decibels = initiator.learned.strengths.memory
    assert weight > 20.0
    text = written(initiator.learned, SENSOR, "sonar", 0.0)
    found = read(text, SENSOR, "sonar", HALF_LIFE, DAY).learned.strengths.memory
    np.testing.assert_allclose(found[0], raw, atol=1e-6)
    assert found[1:] == (pytest.approx(0.5 * weight), decibels)
    content = json.loads(text)
    earlier = {key: content[key] for key in content if not key.startswith("strengths")}
    memory = read(json.dumps(earlier), SENSOR, "sonar", 0.0, DAY).learned.strengths.memory
    assert len(memory[0]) == 0 and memory[1] == 0.0
    with pytest.raises(ValueError, match="content"):
        read(json.dumps(content | {"strengths": ["x"]}), SENSOR, "sonar", 0.0, DAY)
