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
"""The polar grid, sums over its blocks, and scans put together, against plain loops."""

import math

import numpy as np
import pytest

from tsepm_ros import SensorModel
from tsepm_ros.tracker.polar_grid import (
    BATCH_TIME,
    CELL_WIDTH,
    INNER_RINGS,
    BlockSums,
    Cells,
    PolarGrid,
    ScanBatch,
)

SECTOR = SensorModel(min_range=50.0, max_range=2000.0, azimuth_min=-0.5, azimuth_max=1.1)
ROUND = SensorModel(max_range=2000.0)


@pytest.mark.parametrize(("min_range", "rings"), [(0.0, INNER_RINGS), (50.0, 6), (100.0, 0)])
def test_rings_near_the_sensor_have_one_depth(min_range, rings):
    edges = PolarGrid(SensorModel(min_range=min_range, max_range=2000.0)).edges
    near = edges[edges <= 100.0 + 1e-9]
    assert len(near) == rings + 1
    assert near[0] == min_range
    np.testing.assert_allclose(np.diff(near), 100.0 / INNER_RINGS)


def test_rings_beyond_widen_with_range_and_are_no_deeper_than_a_cell():
    edges = PolarGrid(SECTOR).edges
    far = edges[edges >= 100.0 - 1e-9]
    factors = far[1:] / far[:-1]
    np.testing.assert_allclose(factors, factors[0])
    assert far[-1] == pytest.approx(2000.0)
    assert len(factors) == math.ceil(math.log(20.0) * 24.0)
    short = PolarGrid(SensorModel(max_range=300.0)).edges
    assert np.diff(short)[:INNER_RINGS] == pytest.approx(30.0 / INNER_RINGS), "a tenth of the range"


@pytest.mark.parametrize("sensor", [SECTOR, ROUND], ids=["sector", "round"])
def test_cells_have_the_coverage_and_each_its_middle_halves_it(sensor):
    grid = PolarGrid(sensor)
    rows, columns = grid.shape
    assert columns == round(sensor.sector_width / CELL_WIDTH)
    assert grid.area.sum() * columns == pytest.approx(sensor.coverage_area)
    assert grid.wraps == sensor.all_round
    range_, azimuth = (np.broadcast_to(one, grid.shape) for one in grid.middles)
    row, column = grid.cells(range_.ravel(), azimuth.ravel())
    assert row.tolist() == np.repeat(np.arange(rows), columns).tolist()
    assert column.tolist() == np.tile(np.arange(columns), rows).tolist()
    np.testing.assert_allclose(
        range_[:, 0] ** 2 - grid.edges[:-1] ** 2, grid.edges[1:] ** 2 - range_[:, 0] ** 2
    )
    start = -np.pi if sensor.all_round else -0.5
    assert azimuth[0, 0] == pytest.approx(start + grid.width / 2)


def test_positions_outside_have_the_nearest_ring_and_the_last_column_at_most():
    grid = PolarGrid(SECTOR)
    rows, columns = grid.shape
    cells = grid.cells(np.array([10.0, 50.0, 2000.0, 9e3]), np.array([-0.5, 0.0, 1.1, 2.0]))
    assert cells.row.tolist() == [0, 0, rows - 1, rows - 1]
    assert cells.column.tolist() == [0, int(0.5 / grid.width), columns - 1, columns - 1]


def test_a_direction_beyond_an_edge_of_a_sector_is_in_the_column_at_that_edge():
    grid = PolarGrid(SECTOR)
    azimuth = np.array([-0.51, 2.0 * np.pi - 0.51, -2.8, 1.11, 3.4])  # opposite: 0.3 + pi
    columns = grid.cells(np.full(5, 100.0), azimuth).column
    assert columns.tolist() == [0, 0, 0, grid.shape[1] - 1, grid.shape[1] - 1]


def test_columns_are_apart_the_shorter_way_round():
    around, sector = PolarGrid(ROUND), PolarGrid(SECTOR)
    last, end = around.shape[1] - 1, sector.shape[1] - 1
    one, other = np.array([0, 3, last]), np.array([last, 5, 1])
    assert around.apart(one, other).tolist() == [1, 2, 2]
    assert sector.apart(np.array([0, 3, end]), np.array([end, 5, 1])).tolist() == [end, 2, end - 1]


def test_rows_are_divided_into_parts_of_equal_depth():
    grid = PolarGrid(SECTOR)
    near, far = grid.edges[3:5]
    ranges = near + (far - near) * np.array([-0.1, 0.1, 0.3, 0.6, 0.99, 1.2])
    cells = Cells(np.full(6, 3), np.arange(6))
    parts = grid.divided(cells, ranges, 4)
    assert parts.row.tolist() == [12, 12, 13, 14, 15, 15]
    assert parts.column.tolist() == [0, 1, 2, 3, 4, 5]


@pytest.mark.parametrize("sensor", [SECTOR, ROUND], ids=["sector", "round"])
def test_the_share_of_a_column_that_was_looked_at_is_that_of_its_directions(sensor):
    grid = PolarGrid(sensor)
    assert grid.looked(None).tolist() == [1.0] * grid.shape[1]
    fine = (np.arange(200) + 0.5) / 200
    for start, width in [(-0.2, 0.5), (0.9, 4.0), (3.0, 6.2), (-0.5, 0.01), (1.09, 5.0)]:
        begin = grid.middles[1][0] - grid.width / 2
        directions = begin[:, None] + grid.width * fine
        share = (np.mod(directions - start, 2 * np.pi) <= width).mean(axis=1)
        np.testing.assert_allclose(grid.looked((start, width)), share, atol=0.011)


def test_half_of_the_area_beyond_a_row_is_beyond_its_halfway_row():
    grid = PolarGrid(ROUND)
    rows = np.arange(grid.shape[0])
    half = grid.halfway(rows)
    area = grid.area[:, 0]
    for row, at in zip(rows, half, strict=True):
        assert area[at:].sum() <= 0.5 * area[row:].sum() + 1e-6
        assert area[max(at - 1, 0) :].sum() >= 0.5 * area[row:].sum() - 1e-6


@pytest.mark.parametrize("wraps", [False, True])
def test_sums_over_blocks_and_windows_are_those_of_loops(wraps):
    rng = np.random.default_rng(3)
    values = rng.random((7, 9))
    sums = BlockSums(values, wraps)
    for _ in range(60):
        row, column = int(rng.integers(0, 7)), int(rng.integers(-8, 12))
        end, width = int(rng.integers(row, 8)), int(rng.integers(0, 12))
        columns = range(column, column + width)
        if wraps:
            inside = [at % 9 for at in list(columns)[:9]]
        else:
            inside = [at for at in columns if 0 <= at < 9]
            if column >= 9 or column + width < 0:
                continue
        expected = values[row:end][:, inside].sum()
        found = sums.over(*map(np.array, (row, end, column, width)))
        assert float(found) == pytest.approx(expected, abs=1e-12)
        assert float(sums.scaled(3.0).over(*map(np.array, (row, end, column, width)))) == (
            pytest.approx(3.0 * expected, abs=1e-12)
        )
    windows = sums.windows(np.array([0, 2, 4]), 3, np.array([0, 5]), 4)
    expected = [[values[r : r + 3, c : c + 4].sum() for c in (0, 5)] for r in (0, 2, 4)]
    np.testing.assert_allclose(windows, expected)


def batch_of(number: int, detections: int) -> ScanBatch:
    """A batch begun at 10 s, of scans of as many detections."""
    batch, place = ScanBatch(4), np.zeros(detections, np.int64)
    batch.end(10.0)
    for _ in range(number):
        batch.take(Cells(place, place), (1.0 * place, 1.0 * place), 1.0 * place, np.ones(4))
    return batch


def test_a_batch_is_whole_by_time():
    few, many = batch_of(0, 3), batch_of(1, 3)
    assert few.is_new and not many.is_new
    assert not few.is_whole(10.0 + 0.8 * BATCH_TIME, 0.05)
    assert not many.is_whole(10.0 + 0.8 * BATCH_TIME, 0.05), "fast pings wait for the time"
    assert many.is_whole(10.0 + BATCH_TIME, 0.05)
    assert batch_of(1, 200).is_whole(10.0 + BATCH_TIME, 0.05)
    assert many.is_whole(1000.0, 12.0), "slow pings are learned from one by one"


@pytest.mark.parametrize(
    ("interval", "number"), [(0.05, 10), (0.1, 5), (0.125, 4), (0.5, 4), (1.0, 2), (1.7, 1), (3, 1)]
)
def test_a_batch_has_four_pings_over_half_a_second_to_two(interval, number):
    batch = batch_of(1, 3)
    ends = [batch.is_whole(10.0 + k * interval * 0.99, interval) for k in range(1, number + 1)]
    assert ends == [False] * (number - 1) + [True]


def test_a_batch_has_what_it_took_and_begins_anew():
    batch = ScanBatch(4)
    for k in range(2):
        cells = Cells(np.array([k]), np.array([k + 1]))
        polar = np.array([100.0 + k]), np.array([0.1 * k])
        batch.take(cells, polar, np.array([0.5 + k]), np.array([1.0, 1.0, 0.0, k]))
    cells, polar, weight = batch.joined
    assert (cells.row.tolist(), cells.column.tolist()) == ([0, 1], [1, 2])
    assert polar[0].tolist() == [100.0, 101.0]
    assert polar[1].tolist() == [0.0, 0.1]
    assert weight.tolist() == [0.5, 1.5]
    assert batch.looks.tolist() == [2.0, 2.0, 0.0, 1.0]
    assert batch.scans == 1.25
    batch.end(11.0)
    assert batch.scans == 0.0
