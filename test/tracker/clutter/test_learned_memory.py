"""What was learned survives a restart, if fresh and of the same sensor; where clutter is seen."""

import copy
import json
import math
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from support import learned_texts
from support.score_scenes import score, sea

from tsepm_ros import SensorModel
from tsepm_ros.tracker.clutter.density import EVERYWHERE, MAX_DETECTIONS, Extent, SeenExtent
from tsepm_ros.tracker.clutter.learned import HALF_LIFE, read, written

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
    found, age = read(text, SENSOR, "sonar", 1000.0, DAY)
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
    content = json.loads(written(run.learned, SENSOR, "sonar", 0.0)) | change
    with pytest.raises(ValueError, match=said):
        read(json.dumps(content), SENSOR, "sonar", time, DAY)


def test_replaced_numbers_are_refused_or_targets_confirm_as_without_the_text():
    cases, tried = range(24), Counter()
    for number in cases:
        tried += learned_texts.check_replaced(number, np.random.default_rng((1, number)))
    used = tried["learned values, used"]
    assert 0.05 < used / len(cases) < 0.5, "both outcomes are tried"


def test_what_was_learned_fades_with_its_age_and_a_text_of_long_ago_is_as_good_as_none(run):
    text = written(run.learned, SENSOR, "sonar", 0.0)
    found = read(text, SENSOR, "", HALF_LIFE, DAY)[0].clutter_map.memory[1]
    assert found == pytest.approx(0.5 * run.learned.clutter_map.memory[1])
    for days in (30.0, 260.0, 267.0, 365.0):
        initiator = score(SENSOR)
        initiator.learned = read(text, SENSOR, "sonar", days * DAY, 366.0 * DAY)[0]
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
        extent.take(before.places)
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


SONAR = Extent(20.0, 300.0, -1.0, 1.0)
GIVEN = Extent(0.0, 9000.0, -math.pi, math.pi)


def draw(rng: np.random.Generator, number: int, extent: Extent) -> tuple[np.ndarray, np.ndarray]:
    """Uniform places in an extent."""
    square = rng.uniform(extent.min_range**2, extent.max_range**2, number)
    return np.sqrt(square), rng.uniform(extent.azimuth_min, extent.azimuth_max, number)


def estimated(number: int, extent: Extent, limit: Extent = GIVEN, seed: int = 1) -> Extent:
    seen = SeenExtent(limit)
    seen.update(*draw(np.random.default_rng(seed), number, extent), np.ones(number))
    return seen.region.extent


def test_nothing_is_known_before_the_third_detection():
    assert estimated(2, SONAR) == GIVEN


@pytest.mark.parametrize("number", [5, 20, 200])
def test_the_area_is_right_on_average(number):
    # The spans of two dimensions are independent, each made up for: unbiased. 400 seeds leave a
    # deviation of the mean of 3 % at most.
    areas = [estimated(number, SONAR, EVERYWHERE, seed).area for seed in range(400)]
    assert np.mean(areas) == pytest.approx(SONAR.area, rel=0.12 if number < 20 else 0.06)


@pytest.mark.parametrize("middle", [0.0, 1.5, math.pi, -3.0])
def test_a_sector_may_lie_across_the_back(middle):
    sector = Extent(20.0, 300.0, middle - 0.5, middle + 0.5)
    found = estimated(500, sector)
    assert found.azimuth_max - found.azimuth_min == pytest.approx(1.0, abs=0.02)
    turn = 0.5 * (found.azimuth_min + found.azimuth_max) - middle
    assert math.remainder(turn, 2.0 * math.pi) == pytest.approx(0.0, abs=0.02)


def test_the_limit_is_not_exceeded():
    limit = Extent(50.0, 250.0, -0.9, 0.7)
    found = estimated(3, limit, limit)
    assert limit.min_range <= found.min_range < found.max_range <= limit.max_range
    assert limit.azimuth_min <= found.azimuth_min < found.azimuth_max <= limit.azimuth_max


def test_held_tracks_detections_do_not_count_and_old_ones_go():
    seen = SeenExtent(GIVEN)
    rng = np.random.default_rng(3)
    seen.update(*draw(rng, 400, GIVEN), np.full(400, 0.2))
    assert seen.region.extent == GIVEN
    assert seen.detections == 0
    seen.update(*draw(rng, 400, Extent(0.0, 5000.0, -1.0, 1.0)), np.ones(400))
    assert seen.detections == 400
    for _ in range(40):  # the operator chose a shorter range
        seen.update(*draw(rng, 20, SONAR), np.ones(20))
    assert seen.region.extent.max_range < 310.0


@pytest.mark.parametrize("turn", [0.0, 1.0, 2.5])
def test_a_sector_that_is_seen_across_the_seam_of_the_coverage_is_not_cut(turn):
    # Nearly all round, in rounded numbers; and three quarters of a turn, seen at both ends.
    rng = np.random.default_rng(1)
    azimuth = np.pi + rng.uniform(-0.5, 0.5, 400)
    range_ = np.sqrt(rng.uniform(100.0, 8100.0, 400))
    for low, high in ((-3.1415, 3.1415), (-2.9, 2.9)):
        extent = Extent(0.0, 100.0, low + turn, high + turn)
        seen = SeenExtent(extent)
        seen.update(range_, azimuth + turn, np.ones(400))
        region = seen.region
        assert region.contains(range_, azimuth + turn).mean() > 0.98
        assert region.extent.azimuth_max - region.extent.azimuth_min < 1.2
