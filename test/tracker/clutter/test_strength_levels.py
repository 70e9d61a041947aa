"""Levels of strength: of pings, and of places."""

import math

import numpy as np
import pytest

from tsepm_ros.tracker.clutter import amplitude
from tsepm_ros.tracker.clutter.amplitude import RINGS, PlaceLevels, level_by_range, ping_level

GAIN = math.log(100.0)


def pings_of(rng, number: int, size: int):
    return [np.log(rng.exponential(size=size)) for _ in range(number)]


MEDIAN = math.log(math.log(2.0))


def level_of(level: float, pings) -> float:
    return ping_level(level, np.concatenate(pings), [len(ping) for ping in pings])


def test_a_level_that_does_not_change_stays_to_the_bit():
    pings = pings_of(np.random.default_rng(1), 64, 36)
    levels = [level_of(MEDIAN, pings[: last + 1]) for last in range(16, 64)]
    assert np.mean(np.array(levels) == MEDIAN) > 0.9


def test_targets_alone_in_a_calm_sea_do_not_raise_the_level():
    """Two of three detections a ping are 20 dB above the clutter."""
    pings = [
        ping + np.array([GAIN, GAIN, 0.0]) for ping in pings_of(np.random.default_rng(3), 1, 3)
    ]
    assert level_of(MEDIAN, [*pings_of(np.random.default_rng(4), 16, 3), *pings]) == MEDIAN


def test_a_step_is_found_within_a_cell():
    """Its ring has the level of either side, and no other has a mixture of both."""
    rng, side, step = np.random.default_rng(2), 40, 20 * RINGS + 3
    places = PlaceLevels((side, side), True)
    for _ in range(40):
        ring, column = rng.integers(side * RINGS, size=200), rng.integers(side, size=200)
        values = np.clip(rng.normal(size=200) + np.where(ring < step, -1.15, 1.15), -4.0, 4.0)
        places.update(places.places_of(ring, column), values, np.ones(200), 4.0, 1.5)
    places.renew()
    near = step + np.arange(-4, 4)
    found = places.by_range(places.places_of(near, np.full(8, 7)))
    np.testing.assert_allclose(found[1:] - found[:-1], 2.3 * (np.arange(7) == 3), atol=0.35)


def beside_a_target(value: float) -> PlaceLevels:
    """Levels of even clutter, with a detection of this value in a single cell in each ping."""
    rng = np.random.default_rng(7)
    places = PlaceLevels((40, 40), False)
    for _ in range(12):
        cells = rng.integers(40, size=31), rng.integers(40, size=31)
        cells[0][-1] = cells[1][-1] = 20
        values = rng.normal(size=31)
        values[-1] = value
        places.update(places.places_of(RINGS * cells[0], cells[1]), values, np.ones(31), 4.0, 1.0)
    places.renew()
    return places


def test_a_target_of_one_detection_a_ping_does_not_raise_its_place():
    places = beside_a_target(4.0)
    assert places.at(places.places_of(np.array([20 * RINGS]), np.array([20])))[0] < 0.3


def test_what_is_withdrawn_of_a_cell_leaves_neither_weight_nor_level():
    """The weight of a target's detections has faded since they were learned."""
    places = beside_a_target(-4.0)
    cell = places.places_of(np.full(12, 20 * RINGS), np.full(12, 20))
    assert places.at(cell[:1])[0] < -0.5
    places.withdraw(cell, np.full(12, -4.0), np.ones(12), np.arange(12)[::-1])
    places.renew()
    assert abs(places.at(cell[:1])[0]) < 0.3


@pytest.mark.parametrize("shape", [(7, 5), (1, 1), (5, 1), (2, 3)])
def test_units_that_fade_change_nothing(monkeypatch, shape):
    """With an update a unit, and with a unit for all."""
    found = []
    for least in (0.99, 0.0):
        monkeypatch.setattr(amplitude, "LEAST_UNIT", least)
        rng, places = np.random.default_rng(4), PlaceLevels(shape, True)
        for _ in range(120):
            ring = rng.integers(shape[0] * RINGS, size=30)
            at = places.places_of(ring, rng.integers(shape[1], size=30))
            values = rng.normal(size=30) + 2.0 * (ring < 2 * shape[0])
            places.update(at, values, np.ones(30), 4.0, 1.0)
            places.withdraw(at[:5], values[:5], np.full(5, 0.5), np.zeros(5, np.int64))
        places.renew()
        ring = np.arange(shape[0] * RINGS)
        found.append(places.at(places.places_of(ring, ring % shape[1])))
    assert found[0].any()
    np.testing.assert_allclose(found[0], found[1], atol=1e-9)


ROWS = 20
COUNT = np.full(ROWS, 30.0)
"""Detections of each row."""


def test_an_unknown_target_is_no_change_with_range():
    count, total = COUNT / 10.0, np.zeros(ROWS)
    count[3] += 6.0
    total[3] += 6.0 * 2.0
    assert not level_by_range(count, total - count * total.sum() / count.sum(), 2.0, 1.0).any()
