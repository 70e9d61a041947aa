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
"""The clutter density on a grid that adapts, against loops; where clutter is seen."""

import itertools
import math
from unittest.mock import PropertyMock

import numpy as np
import pytest

from tsepm_ros import SensorModel
from tsepm_ros.tracker.clutter.density import (
    ARCS,
    EVERYWHERE,
    MAX_DETECTIONS,
    MIN_STEP,
    PER_SIDE,
    ClutterExtent,
    ClutterMap,
    SeenClutterExtent,
    WindowBounds,
    window_sizes,
    window_sums,
)
from tsepm_ros.tracker.clutter.excess import poisson_bound
from tsepm_ros.tracker.polar_grid import MAX_DEVIATIONS, PolarGrid

SONAR = SensorModel(max_range=9000.0)


def disc(rng: np.random.Generator, density: float) -> tuple[np.ndarray, np.ndarray]:
    n = rng.poisson(density * SONAR.coverage_area)
    return 9000.0 * np.sqrt(rng.uniform(0.0, 1.0, n)), rng.uniform(-math.pi, math.pi, n)


def take(made: ClutterMap, range_: np.ndarray, azimuth: np.ndarray, *more) -> None:
    made.update(made.grid.cells(range_, azimuth), np.ones(len(range_)), *more)


def learned(density: float, scans: int, given: float = 1e-6) -> ClutterMap:
    rng = np.random.default_rng(1)
    made = ClutterMap(SensorModel(clutter_density=given))
    for _ in range(scans):
        take(made, *disc(rng, density))
    return made


def poisson_low(count: float) -> float:
    """Mean m of which a count is c = 1.25 standard deviations above: (N - m)^2 = c^2 m."""
    middle = count + 1.25**2 / 2.0
    return middle - math.sqrt(middle**2 - count**2)


def everywhere(made: ClutterMap) -> np.ndarray:
    return made.at(made.grid.cells(*disc(np.random.default_rng(9), 3e-5)))


@pytest.mark.parametrize("factor", [0.1, 1.0, 10.0])
@pytest.mark.parametrize("density", [1e-7, 1e-6, 5e-6])
def test_after_ten_scans_it_does_not_matter_what_the_data_sheet_said(density, factor):
    found = everywhere(learned(density, 10, given=factor * density))
    assert np.median(found) == pytest.approx(density, rel=0.3)
    assert np.exp(np.log(found).std()) < 1.6


def test_it_becomes_accurate_where_clutter_is_even():
    found = everywhere(learned(1e-6, 200))
    assert np.sqrt(np.mean((found / 1e-6 - 1.0) ** 2)) < 0.15


def test_a_zone_of_clutter_is_found_where_it_is():
    # A quarter of the coverage ten times as dense, in range beyond 4.5 km, to port.
    rng = np.random.default_rng(2)
    made = ClutterMap(SONAR)
    for _ in range(60):
        range_, azimuth = disc(rng, 1e-6)
        zone = (range_ > 4500.0) & (azimuth > 0.0)
        kept = zone | (rng.random(len(range_)) < 0.1)
        take(made, range_[kept], azimuth[kept])
    inside = made.at(made.grid.cells(np.array([7000.0, 6000.0]), np.array([1.0, 2.5])))
    outside = made.at(made.grid.cells(np.array([7000.0, 2000.0]), np.array([-1.0, 1.0])))
    np.testing.assert_allclose(inside, 1e-6, rtol=0.4)
    # Beside the zone too high rather than too low.
    assert (outside > 0.5e-7).all() and (outside < 3e-7).all()


def test_a_new_target_in_an_empty_sea_is_not_taken_for_clutter():
    made = ClutterMap(SONAR)
    rng = np.random.default_rng(7)
    for index in range(12):
        range_, azimuth = disc(rng, 1e-7)
        if index >= 9:
            range_, azimuth = np.append(range_, 5000.0), np.append(azimuth, 0.3)
        take(made, range_, azimuth)
    assert made.at(made.grid.cells(np.array([5000.0]), np.array([0.3])))[0] < 2e-7


def test_what_is_withdrawn_was_never_there():
    rng = np.random.default_rng(3)
    with_target, without = ClutterMap(SONAR), ClutterMap(SONAR)
    for _ in range(30):
        range_, azimuth = disc(rng, 2e-7)
        take(without, range_, azimuth)
        take(with_target, np.append(range_, 5000.0), np.append(azimuth, 0.3))
        target = with_target.grid.cells(np.array([5000.0]), np.array([0.3]))
        with_target.withdraw(target, np.ones(1))
    many = disc(rng, 1e-6)  # so many that the density is estimated anew
    for made in (with_target, without):
        take(made, *many)
    np.testing.assert_allclose(everywhere(with_target), everywhere(without))


def test_what_was_long_ago_fades():
    made = learned(1e-5, 100)
    rng = np.random.default_rng(4)
    for _ in range(400):
        take(made, *disc(rng, 1e-7))
    assert np.median(everywhere(made)) == pytest.approx(1e-7, rel=0.5)


def test_positions_outside_the_coverage_have_the_nearest_cell_s_density():
    sensor = SensorModel(
        min_range=1000.0, max_range=5000.0, azimuth_min=-0.5, azimuth_max=0.5, clutter_density=1e-6
    )
    made = ClutterMap(sensor)
    outside = np.array([10.0, 1e6, 3000.0]), np.array([0.0, 0.0, 3.0])
    np.testing.assert_allclose(made.at(made.grid.cells(*outside)), 1e-6)
    take(made, *outside)
    assert np.isfinite(made.at(made.grid.cells(np.array([3000.0]), np.array([0.0])))).all()


def test_a_scan_of_many_detections_raises_the_density_also_between_two_estimates():
    made, rng = learned(1e-6, 100), np.random.default_rng(11)
    take(made, *disc(rng, 1e-6))
    even = everywhere(made)
    # 1.3 times as many: a mean of 331 with a standard deviation of 18, against 254.
    number = round(1.3 * 1e-6 * SONAR.coverage_area)
    many = (part[:number] for part in disc(rng, 2e-6))
    asked = PropertyMock()
    take(made, *many, type("Seen", (), {"region": asked})())
    asked.assert_not_called()  # this is between two estimates
    made.take_level(number)
    np.testing.assert_allclose(
        everywhere(made) / even, poisson_low(number - 1.0) / 254.5, rtol=0.02
    )


def test_an_empty_scan_is_one_without_clutter():
    made = ClutterMap(SONAR)
    before = everywhere(made).mean()
    for _ in range(10):
        take(made, np.zeros(0), np.zeros(0))
    assert 0 < everywhere(made).mean() < before / 5


def test_a_few_detections_in_a_small_hull_may_be_targets_and_make_no_dense_clutter():
    range_, azimuth = np.array([170.0, 297.0, 474.0]), np.radians([22.0, -4.0, 22.0])
    sensor = SensorModel(max_range=500.0)
    made, seen = ClutterMap(sensor), SeenClutterExtent(ClutterExtent.of_sensor(sensor))
    for _ in range(3):
        seen.update(range_, azimuth, np.ones(3))
        take(made, range_, azimuth, seen, 5e5)
    # In the hull clutter would be ten times as dense as where one target may be.
    assert seen.region.area < 5e4
    assert made.at(made.grid.cells(range_, azimuth)).max() < 2.0 * 3.0 / 5e5


TARGET = 3.0

SECTOR = SensorModel(max_range=300.0, azimuth_min=-0.4, azimuth_max=0.6)

ROUND = SensorModel(max_range=80.0, min_range=60.0)


def windows(cells: int, length: int, wraps: bool) -> list[list[int]]:
    """First cells of the windows that count for each cell: the last few that hold it."""
    step = min(max(length // PER_SIDE, MIN_STEP), length)
    begins = {*range(0, cells, step)} if wraps else {0, *range(cells - length, -1, -step)}
    found = []
    for cell in range(cells):
        away = {begin: (cell - begin) % cells for begin in begins}
        holding = sorted((one for one in begins if away[one] < length), key=away.__getitem__)
        found.append(holding[: length // step])
    return found


def looped(
    shape: tuple[int, int],
    sizes: list[tuple[int, int]],
    counts: np.ndarray,
    areas: tuple[np.ndarray, np.ndarray, float],
    wraps: bool,
    density: np.ndarray,
) -> np.ndarray:
    """Density of each cell in one scan, window by window."""
    rows, columns = shape
    seen, whole, widening = areas
    density = density.copy()
    for height, width in sizes:
        around = wraps and width < columns
        bounds: dict[tuple[int, int], tuple[float, float]] = {}
        down, across = windows(rows, height, False), windows(columns, width, around)
        for cell in np.ndindex(shape):
            for begin in itertools.product(down[cell[0]], across[cell[1]]):
                if begin in bounds:
                    continue
                part = np.ix_(
                    np.arange(begin[0], begin[0] + height),
                    np.arange(begin[1], begin[1] + width) % columns,
                )
                area = max(widening * seen[part].sum(), 0.1 * whole[part].sum())
                area, number = min(area, whole[part].sum()), counts[part].sum()
                low = poisson_bound(np.array(max(number - TARGET, 0.0)), -MAX_DEVIATIONS)
                high = poisson_bound(np.array(number), MAX_DEVIATIONS)
                bounds[begin] = float(low) / area, float(high) / area
            these = [bounds[one] for one in itertools.product(down[cell[0]], across[cell[1]])]
            low, high = (max(each) for each in zip(*these, strict=True))
            density[cell] = min(max(density[cell], low), high)
    return density


@pytest.mark.parametrize("mean", [0.02, 0.5, 5.0])
@pytest.mark.parametrize("kind", ["squares", "arcs"])
@pytest.mark.parametrize("sensor", [SECTOR, ROUND], ids=["sector", "round"])
def test_densities_are_those_of_a_loop_over_windows(sensor, kind, mean):
    grid, rng = PolarGrid(sensor), np.random.default_rng(3)
    counts = rng.poisson(mean, grid.shape) * rng.random(grid.shape)
    counts[:5, 3:8] += 4.0 * mean
    whole = np.broadcast_to(grid.area, grid.shape)
    seen = whole * (rng.random(grid.shape) < 0.8)
    sizes = window_sizes(*grid.shape)
    if kind == "arcs":
        sizes = [(1, grid.shape[1] // parts) for parts in ARCS]
    start = np.full(grid.shape, counts.sum() / whole.sum())
    bounds = WindowBounds(sizes, seen, window_sums(sizes, whole, grid.wraps), grid.wraps, 1.1)
    found = bounds.moved(start, counts, 1.0, TARGET)
    expected = looped(grid.shape, sizes, counts, (seen, whole, 1.1), grid.wraps, start)
    np.testing.assert_allclose(found, expected, rtol=1e-11)
    assert mean < 0.5 or np.ptp(found) > 0.0


SENSOR = SensorModel(clutter_density=1e-8)


def test_places_do_not_grow_with_restarts():
    extent, rng = SeenClutterExtent(ClutterExtent.of_sensor(SENSOR)), np.random.default_rng(1)
    for _ in range(5):
        before, extent = extent, SeenClutterExtent(ClutterExtent.of_sensor(SENSOR))
        extent.take(before.places)
        extent.update(rng.uniform(10.0, 9000.0, 490), rng.uniform(-3.0, 3.0, 490), np.ones(490))
        assert extent.detections < 2 * MAX_DETECTIONS


SEEN = ClutterExtent(20.0, 300.0, -1.0, 1.0)

GIVEN = ClutterExtent(0.0, 9000.0, -math.pi, math.pi)


def draw(
    rng: np.random.Generator, number: int, extent: ClutterExtent
) -> tuple[np.ndarray, np.ndarray]:
    """Uniform places in an extent."""
    square = rng.uniform(extent.min_range**2, extent.max_range**2, number)
    return np.sqrt(square), rng.uniform(extent.azimuth_min, extent.azimuth_max, number)


def estimated(
    number: int, extent: ClutterExtent, limit: ClutterExtent = GIVEN, seed: int = 1
) -> ClutterExtent:
    seen = SeenClutterExtent(limit)
    seen.update(*draw(np.random.default_rng(seed), number, extent), np.ones(number))
    return seen.region.extent


def test_nothing_is_known_before_the_third_detection():
    assert estimated(2, SEEN) == GIVEN


@pytest.mark.parametrize("number", [5, 20, 200])
def test_the_area_is_right_on_average(number):
    # The spans of two dimensions are independent, each made up for: unbiased. 400 seeds leave a
    # deviation of the mean of 3 % at most.
    areas = [estimated(number, SEEN, EVERYWHERE, seed).area for seed in range(400)]
    assert np.mean(areas) == pytest.approx(SEEN.area, rel=0.12 if number < 20 else 0.06)


@pytest.mark.parametrize("middle", [0.0, 1.5, math.pi, -3.0])
def test_a_sector_may_lie_across_the_back(middle):
    sector = ClutterExtent(20.0, 300.0, middle - 0.5, middle + 0.5)
    found = estimated(500, sector)
    assert found.azimuth_max - found.azimuth_min == pytest.approx(1.0, abs=0.02)
    turn = 0.5 * (found.azimuth_min + found.azimuth_max) - middle
    assert math.remainder(turn, 2.0 * math.pi) == pytest.approx(0.0, abs=0.02)


def test_the_limit_is_not_exceeded():
    limit = ClutterExtent(50.0, 250.0, -0.9, 0.7)
    found = estimated(3, limit, limit)
    assert limit.min_range <= found.min_range < found.max_range <= limit.max_range
    assert limit.azimuth_min <= found.azimuth_min < found.azimuth_max <= limit.azimuth_max


def test_confirmed_tracks_detections_do_not_count_and_old_ones_go():
    seen = SeenClutterExtent(GIVEN)
    rng = np.random.default_rng(3)
    seen.update(*draw(rng, 400, GIVEN), np.full(400, 0.2))
    assert seen.region.extent == GIVEN
    assert seen.detections == 0
    seen.update(*draw(rng, 400, ClutterExtent(0.0, 5000.0, -1.0, 1.0)), np.ones(400))
    assert seen.detections == 400
    for _ in range(40):  # the operator chose a shorter range
        seen.update(*draw(rng, 20, SEEN), np.ones(20))
    assert seen.region.extent.max_range < 310.0


@pytest.mark.parametrize("turn", [0.0, 1.0, 2.5])
def test_a_sector_that_is_seen_across_the_seam_of_the_coverage_is_not_cut(turn):
    # Nearly all round, in rounded numbers; and three quarters of a turn, seen at both ends.
    rng = np.random.default_rng(1)
    azimuth = np.pi + rng.uniform(-0.5, 0.5, 400)
    range_ = np.sqrt(rng.uniform(100.0, 8100.0, 400))
    for low, high in ((-3.1415, 3.1415), (-2.9, 2.9)):
        extent = ClutterExtent(0.0, 100.0, low + turn, high + turn)
        seen = SeenClutterExtent(extent)
        seen.update(range_, azimuth + turn, np.ones(400))
        region = seen.region
        assert region.contains(range_, azimuth + turn).mean() > 0.98
        assert region.extent.azimuth_max - region.extent.azimuth_min < 1.2


def test_an_extent_has_the_area_of_its_sector_and_knows_a_whole_turn():
    whole = ClutterExtent.of_sensor(SensorModel(min_range=10.0, max_range=50.0))
    assert whole.all_round
    assert whole.area == pytest.approx(math.pi * (50.0**2 - 10.0**2))
    half = ClutterExtent.of_sensor(SensorModel(max_range=50.0, azimuth_min=-1.0, azimuth_max=0.5))
    assert not half.all_round
    assert half.area == pytest.approx(0.75 * 50.0**2)
