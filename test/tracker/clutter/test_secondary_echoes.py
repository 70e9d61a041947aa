"""Clutter behind echoes: even clutter, spokes of interference, ghosts, and a second target."""

import math

import numpy as np
import pytest

from tsepm_ros import Scan, SensorModel, make_initiator
from tsepm_ros.tracker.clutter.density import ClutterMap
from tsepm_ros.tracker.clutter.excess import HALF_WIDTHS, Batch, Cells, HeldTargets, SecondaryEchoes

SONAR = SensorModel(max_range=9000.0)
RADAR = SensorModel(
    range_std=8.0, range_std_fraction=0.0, max_range=500.0, detection_probability=0.9
)
NO_TARGETS = HeldTargets(np.zeros(0, int), np.zeros(0), np.zeros(0), np.zeros(0))


def disc(rng: np.random.Generator, number: float, max_range: float = 9000.0) -> np.ndarray:
    n = rng.poisson(number)
    return np.array([max_range * np.sqrt(rng.random(n)), rng.uniform(-math.pi, math.pi, n)])


def held(range_: float, azimuth: float) -> HeldTargets:
    return HeldTargets(np.array([7]), np.array([range_]), np.array([azimuth]), np.ones(1))


class Sea:
    """A map and what it learns of secondary echoes, scan by scan."""

    def __init__(self, sensor: SensorModel = SONAR) -> None:
        self.map = ClutterMap(sensor)
        self.echoes = SecondaryEchoes(self.map.grid)

    def take(self, places: np.ndarray, targets: HeldTargets = NO_TARGETS) -> np.ndarray:
        range_, azimuth = places
        weight = np.ones(len(range_))
        cells = self.map.grid.cells(range_, azimuth)
        self.map.update(cells, weight)
        self.map.take_level(weight.sum())
        batch, expected = Batch(self.map.grid.shape[1]), self.map.expected
        batch.take(cells, (range_, azimuth), weight, np.ones(self.map.grid.shape[1]))
        self.echoes.update(targets, batch, expected)
        among = self.echoes.among(cells, weight, expected)
        return among * self.echoes.behind_targets(targets, cells)


def pair_correlation(sea: Sea) -> np.ndarray:
    return sea.echoes.pairs.counted / sea.echoes.pairs.expected


@pytest.mark.parametrize("number", [3.0, 30.0, 250.0])
def test_even_clutter_is_left_as_it_is(number):
    rng, sea = np.random.default_rng(4), Sea()
    factors = [sea.take(disc(rng, number), held(3000.0, 0.5)) for _ in range(50)]
    late = np.concatenate(factors[15:])
    assert np.log(late).mean() < 0.02
    assert np.log(late).std() < 0.15
    np.testing.assert_allclose(pair_correlation(sea), 1.0, atol=0.3)


def test_pairs_are_those_that_a_loop_counts():
    rng, sea = np.random.default_rng(5), Sea()
    places = disc(rng, 60.0)
    sea.take(places)
    row, column = sea.map.grid.cells(*places)
    columns = sea.map.grid.shape[1]
    every = Cells(*np.indices(sea.map.grid.shape).reshape(2, -1))
    expected = (sea.map.at(every)).reshape(sea.map.grid.shape) * sea.map.counted_area
    for width, found in zip(HALF_WIDTHS, pair_correlation(sea), strict=True):
        pairs = mean = 0.0
        for i in range(len(row)):
            strip = [(column[i] + k) % columns for k in range(-width, width + 1)]
            pairs += sum(row[j] < row[i] and column[j] in strip for j in range(len(row)))
            mean += expected[: row[i], strip].sum()
        assert found == pytest.approx(pairs / mean)


def test_a_spoke_of_interference_is_dense_clutter_in_its_scan_alone():
    rng, sea = np.random.default_rng(6), Sea()
    in_spokes, elsewhere = [], []
    for index in range(60):
        places = disc(rng, 30.0)
        number = 0
        if index % 5 == 0:
            number = 12
            spoke = np.array([rng.uniform(2000.0, 9000.0, number), np.full(number, index / 9.0)])
            places = np.append(spoke, places, axis=1)
        factor = sea.take(places)
        if index >= 20:
            in_spokes += factor[:number].tolist()
            elsewhere += factor[number:].tolist()
    assert np.median(in_spokes) > 5.0
    assert np.median(elsewhere) < 1.05


def test_ghosts_behind_a_held_target_are_dense_clutter_wherever_its_bearing_goes():
    rng, sea = np.random.default_rng(7), Sea()
    for index in range(12):
        bearing = math.radians(3.0 * index)
        ghosts = rng.uniform(5000.0, 9000.0, 5), bearing + rng.uniform(-0.05, 0.05, 5)
        places = np.append(disc(rng, 30.0), ghosts, axis=1)
        sea.take(places, held(2000.0, bearing))
    after = math.radians(36.0)
    behind, beside, before = sea.echoes.behind_targets(
        held(2000.0, after),
        sea.map.grid.cells(
            np.array([7000.0, 7000.0, 1500.0]), np.array([after, after + 1.5, after])
        ),
    )
    # Five ghosts in a strip where the map expects 0.7 at most.
    assert behind > 3.0
    assert beside == before == 1.0


def test_a_second_target_behind_a_held_one_is_not_taken_for_its_ghost():
    rng, sea = np.random.default_rng(8), Sea()
    for index in range(5):
        bearing = math.radians(index)
        places = np.append(disc(rng, 30.0), [[5000.0], [bearing]], axis=1)
        sea.take(places, held(2000.0, bearing))
        where = np.array([5000.0]), np.array([bearing])
        factor = sea.echoes.behind_targets(held(2000.0, bearing), sea.map.grid.cells(*where))
        assert factor[0] < 1.2


def ghost_scene(seed: int, ghosts: float) -> tuple[list[np.ndarray], int]:
    """Places of the starts in 45 scans: a vessel passes 60 m off, with ghosts behind it."""
    rng = np.random.default_rng(seed)
    initiator = make_initiator("score", sensor=RADAR, max_speed=15.0, false_tracks_per_hour=10.0)
    on_vessel, elsewhere = 0, []
    for index in range(45):
        vessel = np.array([60.0, -90.0 + 4.0 * index])
        bearing = math.atan2(vessel[1], vessel[0])
        own = np.hypot(*vessel) + 5.0 * rng.standard_normal()
        number = rng.poisson(ghosts)
        behind = rng.uniform(350.0, 490.0, number), bearing + 0.1 * rng.standard_normal(number)
        places = np.concatenate([[[own], [bearing]], behind, disc(rng, 2.0, 500.0)], axis=1)
        for track in initiator.process(Scan(1.7 * index, *places)):
            near = math.dist(track.position, vessel) < 40.0
            on_vessel += near
            elsewhere += [] if near else [track.position]
    return elsewhere, on_vessel


@pytest.mark.long
def test_few_tracks_start_on_ghosts_and_the_vessel_is_started_once():
    found = [ghost_scene(seed, 5.0) for seed in range(2)]
    assert [number for _, number in found] == [1, 1]
    # 9 where the density does not count what is behind targets.
    assert sum(len(elsewhere) for elsewhere, _ in found) <= 5
