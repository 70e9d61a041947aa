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
"""Clutter in excess of the map: lumpy and even seas, and clutter behind echoes and targets."""

import math
from copy import deepcopy

import numpy as np
import pytest
from scipy import stats
from support.lumpy_seas import LumpySea

from tsepm_ros import SensorModel
from tsepm_ros.tracker.clutter.density import ClutterMap
from tsepm_ros.tracker.clutter.excess import (
    HALF_WIDTHS,
    PATH_SCANS,
    ConfirmedTargets,
    DensityDoubt,
    Overdispersion,
    SecondaryEchoes,
)
from tsepm_ros.tracker.polar_grid import Cells, ScanBatch

SONAR = SensorModel()


def taken(
    overdispersion: Overdispersion, made: ClutterMap, cells: Cells, weight: np.ndarray
) -> DensityDoubt:
    """Take a scan as a batch; what makes its density uncertain."""
    batch, density = ScanBatch(made.grid.shape[1]), made.at(cells)
    batch.take(cells, (weight, weight), weight, np.ones(made.grid.shape[1]))
    batch.densities.append(density)
    overdispersion.update(batch, made.seen.counted)
    return overdispersion.predictive(cells, density, made.seen.counted)


def along_path(predictive: DensityDoubt, row: int, hits: int) -> float:
    """What the hits of a path of detections at one place add to its score."""
    before = np.arange(1, hits)
    increment = predictive.increment(before, np.arange(hits - 1), np.full(hits - 1, row))
    return float(increment.sum())


@pytest.mark.parametrize("shape", [0.3, 2.0, 20.0])
def test_a_path_in_a_place_of_gamma_density_has_the_negative_binomial_law(shape):
    # With n of m expected seen before, and each hit seen by those after it.
    seen, expected, hits = 7.0, 4.0, 6
    found = [
        DensityDoubt(shape, np.array([seen + j]), np.array([expected])).increment(
            np.array([j]), np.zeros(1, int), np.zeros(1, int)
        )[0]
        for j in range(hits)
    ]
    posterior = stats.gamma(shape + seen, scale=1.0 / (shape + expected))
    assert -sum(found) == pytest.approx(math.log(posterior.moment(hits)), rel=1e-6)


@pytest.mark.parametrize("shape", [0.5, 2.0, 20.0])
@pytest.mark.parametrize("expected", [0.5, 6.0])
def test_the_mean_ratio_of_a_path_in_clutter_of_gamma_density_is_at_most_1(shape, expected):
    rng, hits = np.random.default_rng(8), 5
    factor = rng.gamma(shape, 1.0 / shape, 200_000)
    around = rng.poisson(factor * expected).astype(float)
    rows = np.arange(len(factor))
    lost = np.zeros(len(factor))
    for before in range(hits):
        seen = around + before
        predictive = DensityDoubt(shape, seen, np.full(len(seen), expected))
        lost += predictive.increment(np.full(len(seen), before), rows, rows)
    ratios = factor**hits * np.exp(lost)
    assert ratios.mean() < 1.0 + 3.0 * ratios.std() / math.sqrt(len(ratios))
    if shape < 10.0:
        assert (factor**hits).mean() > 5.0


def test_a_path_counts_its_own_hits_where_nothing_else_was_seen():
    empty = DensityDoubt(2.0, np.zeros(1), np.zeros(1))
    assert along_path(empty, 0, 4) == pytest.approx(-math.log(1.5 * 2.0 * 2.5))
    calm = DensityDoubt(2.0, np.zeros(1), np.array([50.0]))
    assert along_path(calm, 0, 4) == 0.0, "a place that looks empty is no evidence"
    many = DensityDoubt(2.0, np.array([9.0]), np.array([3.0]))
    assert along_path(many, 0, 4) == pytest.approx(-3.0 * math.log(11.0 / 5.0))


def test_neighbours_are_those_that_a_loop_counts():
    rng = np.random.default_rng(3)
    made = ClutterMap(SONAR)
    overdispersion = Overdispersion(made.grid)
    columns = made.grid.shape[1]
    before: list[list[tuple[int, int, float]]] = []
    for _ in range(5):
        cells = Cells(rng.integers(0, 6, 80), rng.integers(-3, 3, 80) % columns)
        weight = rng.random(80)
        made.update(cells, weight)
        taken(overdispersion, made, cells, weight)
        found = overdispersion.around(cells, made.at(cells), made.seen.counted)
        around = np.zeros(80)
        for age, scan in enumerate(reversed(before)):
            for row, column, other in scan:
                for place in range(80):
                    apart = abs(column - cells.column[place])
                    near = min(apart, columns - apart) + abs(row - cells.row[place]) <= 1
                    around[place] += near * other * (1.0 - 1.0 / PATH_SCANS) ** age
        np.testing.assert_allclose(found.counted, around, atol=1e-12)
        share = 0.3 * rng.random(80)
        weight *= 1.0 - share  # they turn out to be targets'
        before.append(list(zip(*cells, weight, strict=True)))


class Learned:
    """What scans of a sea teach; `predictive` and `places` are of the last scan."""

    def __init__(self, sea: LumpySea, scans: int) -> None:
        self.sea, self.map = sea, ClutterMap(sea.sensor)
        self.overdispersion = Overdispersion(self.map.grid)
        for _ in range(scans):
            self.places = sea.scan()
            cells, weight = self.map.grid.cells(*self.places), np.ones(len(self.places[0]))
            self.map.update(cells, weight)
            self.predictive = taken(self.overdispersion, self.map, cells, weight)

    def at(self, places: tuple[np.ndarray, np.ndarray]) -> tuple[DensityDoubt, np.ndarray]:
        """Predictive density at further places, and the true density over the map's."""
        cells = self.map.grid.cells(*places)
        density = self.map.at(cells)
        nothing = np.zeros(len(density))
        predictive = taken(deepcopy(self.overdispersion), self.map, cells, nothing)
        return predictive, self.sea.density_at(*places) / density


@pytest.mark.parametrize("density", [1e-7, 1e-6])
@pytest.mark.parametrize("scans", [4, 8, 40])
def test_in_even_clutter_next_to_nothing_is_lost(density, scans):
    found = Learned(LumpySea(0.0, density, seed=2), scans)
    assert found.overdispersion.variance < 0.02
    lost = [along_path(found.predictive, row, 6) for row in range(len(found.places[0]))]
    assert np.mean(lost) > -15.0 / (scans * density * SONAR.coverage_area) - 0.05


@pytest.mark.parametrize(("kind", "most"), [("smooth", 1.2), ("blocks", 4.0)])
@pytest.mark.parametrize("seed", [1, 2])
def test_lumps_that_the_map_does_not_resolve_are_hardly_evidence(kind, most, seed):
    # The mean likelihood ratio in clutter is that of true over predictive densities at the hits of
    # targets' paths, each of which begins at a detection and is seen by the later ones.
    found = Learned(LumpySea(math.log(3.0), 1e-6, seed=seed, kind=kind), 24)
    assert 0.1 < found.overdispersion.variance < 0.8
    range_, azimuth = found.places
    first, draw = range_ * np.exp(1j * azimuth), np.random.default_rng(7)
    velocity = 5.0 * (draw.standard_normal(len(first)) + 1j * draw.standard_normal(len(first)))
    alone, lost = np.ones(len(first)), np.zeros(len(first))
    means = []
    rows = np.arange(len(first))
    for before in range(1, 6):
        error = 100.0 * (draw.standard_normal(len(first)) + 1j * draw.standard_normal(len(first)))
        hit = first + 12.0 * before * velocity + error
        predictive, ratio = found.at((np.minimum(np.abs(hit), 8999.0), np.angle(hit)))
        seen = predictive._replace(around=predictive.around + before)
        lost += seen.increment(np.full(len(first), before), rows, rows)
        alone *= ratio
        means.append((alone.mean(), (alone * np.exp(lost)).mean()))
    assert means[-1][0] > 5.0
    assert all(mean < most for _, mean in means)


def variance_of(scans, sensor: SensorModel = SONAR) -> float:
    """Variance of the lumps after scans of ranges, azimuths and weights."""
    made = ClutterMap(sensor)
    overdispersion = Overdispersion(made.grid)
    for range_, azimuth, weight in scans:
        cells = made.grid.cells(range_, azimuth)
        made.update(cells, weight)
        taken(overdispersion, made, cells, weight)
    return overdispersion.variance


def test_clutter_that_ends_within_the_coverage_makes_no_lumps():
    rng = np.random.default_rng(4)
    places = (rng.uniform(2000.0, 8000.0, (2, rng.poisson(36.0))) for _ in range(16))
    scans = ((np.hypot(x, y), np.arctan2(y, x), np.ones(len(x))) for x, y in places)
    assert variance_of(scans, SensorModel(max_range=12000.0)) < 0.05


def test_new_targets_in_a_calm_sea_make_no_lumps():
    # Ten targets appear together; from the fourth scan on they are recognised.
    rng = np.random.default_rng(5)
    places = rng.uniform(2000.0, 8000.0, 10), rng.uniform(-3.0, 3.0, 10)
    assert variance_of((*places, np.full(10, float(scan < 3))) for scan in range(8)) < 0.2


NO_TARGETS = ConfirmedTargets(np.zeros(0, int), np.zeros(0), np.zeros(0), np.zeros(0))


def disc(rng: np.random.Generator, number: float, max_range: float = 9000.0) -> np.ndarray:
    n = rng.poisson(number)
    return np.array([max_range * np.sqrt(rng.random(n)), rng.uniform(-math.pi, math.pi, n)])


def confirmed(range_: float, azimuth: float) -> ConfirmedTargets:
    return ConfirmedTargets(np.array([7]), np.array([range_]), np.array([azimuth]), np.ones(1))


class Sea:
    """A map and what it learns of secondary echoes, scan by scan."""

    def __init__(self, sensor: SensorModel = SONAR) -> None:
        self.map = ClutterMap(sensor)
        self.echoes = SecondaryEchoes(self.map.grid)

    def take(self, places: np.ndarray, targets: ConfirmedTargets = NO_TARGETS) -> np.ndarray:
        range_, azimuth = places
        weight = np.ones(len(range_))
        cells = self.map.grid.cells(range_, azimuth)
        self.map.update(cells, weight)
        self.map.take_level(weight.sum())
        batch, expected = ScanBatch(self.map.grid.shape[1]), self.map.expected
        batch.take(cells, (range_, azimuth), weight, np.ones(self.map.grid.shape[1]))
        self.echoes.update(targets, batch, expected)
        among = self.echoes.among(cells, weight, expected)
        return among * self.echoes.behind_targets(targets, cells)


def pair_correlation(sea: Sea) -> np.ndarray:
    return sea.echoes.pairs.counted / sea.echoes.pairs.expected


@pytest.mark.parametrize("number", [3.0, 30.0, 250.0])
def test_even_clutter_is_left_as_it_is(number):
    rng, sea = np.random.default_rng(4), Sea()
    factors = [sea.take(disc(rng, number), confirmed(3000.0, 0.5)) for _ in range(50)]
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
    expected = (sea.map.at(every)).reshape(sea.map.grid.shape) * sea.map.seen.counted
    for width, found in zip(HALF_WIDTHS[:, 0].tolist(), pair_correlation(sea), strict=True):
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


@pytest.mark.parametrize(("beside", "is_dense"), [(8, True), (9, False)])
def test_the_widest_strip_behind_a_target_holds_eight_cells_on_either_side(beside, is_dense):
    rng, sea = np.random.default_rng(9), Sea()
    step = 2.0 * math.pi / sea.map.grid.shape[1]
    for index in range(20):
        target = confirmed(2000.0, (20 + 3 * index) * step)
        ghosts = np.array([rng.uniform(4000.0, 8000.0, 6), np.full(6, target.azimuth)])
        ghosts[1] += beside * step
        sea.take(np.append(disc(rng, 30.0), ghosts, axis=1), target)
    factor = sea.echoes.behind_targets(target, sea.map.grid.cells(*ghosts))
    assert bool(factor.max() > 1.1) is is_dense


def test_a_second_target_behind_a_confirmed_one_is_not_taken_for_its_ghost():
    rng, sea = np.random.default_rng(8), Sea()
    for index in range(5):
        bearing = math.radians(index)
        places = np.append(disc(rng, 30.0), [[5000.0], [bearing]], axis=1)
        sea.take(places, confirmed(2000.0, bearing))
        where = np.array([5000.0]), np.array([bearing])
        factor = sea.echoes.behind_targets(confirmed(2000.0, bearing), sea.map.grid.cells(*where))
        assert factor[0] < 1.2
