"""Clutter that lies on rings, and the cells of the polar grid."""

import math

import numpy as np
import pytest

from tsepm_ros import Scan, SensorModel, make_initiator
from tsepm_ros.tracker.clutter.density import ClutterMap
from tsepm_ros.tracker.clutter.excess import INNER_RINGS, Cells, PolarGrid

ROUND = SensorModel(max_range=300.0)


def test_a_dense_ring_is_found_and_half_of_one_raises_not_the_other_half():
    rng, made = np.random.default_rng(2), ClutterMap(ROUND)
    rows, columns = made.grid.shape
    mean = np.full((rows, columns), 0.03)
    mean[20] = 0.4
    mean[30, : columns // 2] = 0.6
    for _ in range(8):
        row, column = np.nonzero(rng.poisson(mean))
        made.update(Cells(row, column), np.ones(len(row)))
    every = np.arange(columns)
    whole, half, beside = (made.at(Cells(np.full(columns, row), every)) for row in (20, 30, 25))
    area = made.grid.area[:, 0]
    assert (whole * area[20] > 0.2).all()
    quarter = columns // 8
    other = slice(columns // 2 + quarter, columns - quarter)  # an arc across the end holds both
    assert np.median(half[: columns // 2]) > 4.0 * np.median(half[other])
    assert np.median(beside * area[25]) < 0.1


def false_tracks(sensor: SensorModel, period: float, scans: int, ranges, seed: int) -> int:
    """Tracks that clutter at drawn ranges starts, all round, with the default density: learned."""
    rng = np.random.default_rng(seed)
    initiator = make_initiator("score", sensor=sensor, plots="off")
    for k in range(scans):
        range_ = ranges(rng)
        azimuth = rng.uniform(-np.pi, np.pi, len(range_))
        initiator.process(Scan(stamp=period * k, range=range_, azimuth=azimuth))
    return initiator.totals.confirmed


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("spread", [20.0, 60.0])
def test_a_ring_of_clutter_starts_hardly_any_track(spread, seed):
    # 17 to 21 tracks without the rings' own bounds, at a spread of 20 m; 0.3 by the target rate.
    sensor = SensorModel(range_std=10.0, range_std_fraction=0.0, azimuth_std=math.radians(1.0))

    def ranges(rng: np.random.Generator) -> np.ndarray:
        ring = 3000.0 + spread * rng.standard_normal(rng.poisson(20))
        even = 9000.0 * np.sqrt(rng.uniform(1e-4, 1.0, rng.poisson(76)))
        return np.append(ring, even)

    assert false_tracks(sensor, 12.0, 100, ranges, seed) <= 2


@pytest.mark.parametrize("seed", [0, 1])
def test_reverberation_near_the_sensor_starts_hardly_any_track(seed):
    # 17 to 20 tracks where all ranges up to 100 m are one ring. In 48 runs 24, of which 11 would be
    # with an error across that may be below that along; most while the density is being learned.
    sensor = SensorModel(
        range_std=1.0,
        range_std_fraction=0.0,
        azimuth_std=math.radians(1.0),
        max_range=1000.0,
        clutter_density=2e-5,
    )

    def ranges(rng: np.random.Generator) -> np.ndarray:
        near = rng.exponential(40.0, rng.poisson(20)) + 0.5
        even = 1000.0 * np.sqrt(rng.uniform(1e-4, 1.0, rng.poisson(10)))
        return np.append(near, even)

    assert false_tracks(sensor, 1.5, 240, ranges, seed) <= 4


@pytest.mark.parametrize(("min_range", "rings"), [(0.0, INNER_RINGS), (50.0, 6), (100.0, 0)])
def test_rings_near_the_sensor_have_one_depth(min_range, rings):
    edges = PolarGrid(SensorModel(min_range=min_range, max_range=2000.0)).edges
    near = edges[edges <= 100.0 + 1e-9]
    assert len(near) == rings + 1
    assert near[0] == min_range
    np.testing.assert_allclose(np.diff(near), 100.0 / INNER_RINGS)


def test_divided_rows_are_in_order_and_of_equal_depth():
    grid = PolarGrid(SensorModel(min_range=50.0, max_range=5000.0))
    near, far = grid.edges[:-1], grid.edges[1:]
    share = np.array([0.0, 0.2, 0.3, 0.6, 0.7, 0.9, 0.99])
    range_ = (near[:, None] + share * (far - near)[:, None]).ravel() + 1e-6
    cells = grid.cells(range_, np.linspace(-3.0, 3.0, len(range_)))
    found = grid.divided(cells, range_, 5)
    np.testing.assert_array_equal(found.column, cells.column)
    np.testing.assert_array_equal(found.row // 5, cells.row)
    np.testing.assert_array_equal(found.row.reshape(-1, 7) % 5, [[0, 1, 1, 3, 3, 4, 4]] * len(near))


def test_beyond_the_coverage_it_is_the_nearest_part():
    grid = PolarGrid(SensorModel(min_range=50.0, max_range=5000.0))
    range_ = np.array([1.0, 9000.0])
    found = grid.divided(grid.cells(range_, np.zeros(2)), range_, 4)
    np.testing.assert_array_equal(found.row, [0, 4 * grid.shape[0] - 1])
