"""Cells of a polar grid."""

from __future__ import annotations

import numpy as np

from tsepm_ros import SensorModel
from tsepm_ros.tracker.clutter.density import PolarGrid


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
