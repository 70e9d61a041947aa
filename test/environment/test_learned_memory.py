"""What was learned survives a restart, as far as it is fresh and of the same sensor."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from support.score_scenes import score, sea

from tsepm_ros import SensorModel
from tsepm_ros.environment.learned_memory import HALF_LIFE, read, written

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
    fresh.remember(found.learned)
    assert fresh.clutter_density == pytest.approx(run.clutter_density, rel=0.02)
    probability = run.detection_probability
    assert fresh.detection_probability == pytest.approx(probability, abs=1e-9)
    assert probability < 0.75
    region, before = found.learned.seen_extent.region, run.learned.seen_extent.region
    assert region.area == pytest.approx(before.area, rel=0.02)


def test_what_was_learned_fades_with_its_age(run):
    text = written(run.learned, SENSOR, "sonar", 0.0)
    scans = run.learned.clutter_map.memory[1]
    found = read(text, SENSOR, "", HALF_LIFE, DAY)
    assert found.learned.clutter_map.memory[1] == pytest.approx(0.5 * scans)


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
    ],
)
def test_what_does_not_fit_is_refused_with_the_reason(run, change, time, said):
    content = json.loads(written(run.learned, SENSOR, "sonar", 0.0)) | change
    with pytest.raises(ValueError, match=said):
        read(json.dumps(content), SENSOR, "sonar", time, DAY)


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
