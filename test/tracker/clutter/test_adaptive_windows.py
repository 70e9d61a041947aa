"""Bounds of the density by windows, against loops over windows and cells."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tsepm_ros import SensorModel
from tsepm_ros.tracker.clutter.density import (
    MAX_DEVIATIONS,
    BlockSums,
    CountedArea,
    CountedWindows,
    PolarGrid,
    Windows,
    bounded_root,
    poisson_bound,
    sides,
)

SECTOR = SensorModel(max_range=300.0, azimuth_min=-0.4, azimuth_max=0.6)
ROUND = SensorModel(max_range=80.0, min_range=60.0)


def looped(
    grid: PolarGrid, counts: np.ndarray, seen: np.ndarray, counted: CountedArea, target: float
) -> np.ndarray:
    """Density of each cell in one scan, window by window."""
    rows, columns = grid.shape
    density = np.full(grid.shape, counts.sum() / grid.area.sum() / columns)
    for height, width in sides(grid):
        wraps = grid.wraps and width < columns
        low, high = np.full((2, *grid.shape), -math.inf)
        for row in range(rows - height + 1):
            for column in range(columns if wraps else columns - width + 1):
                window = np.ix_(
                    np.arange(row, row + height), np.arange(column, column + width) % columns
                )
                whole = np.full((height, width), grid.area[row : row + height]).sum()
                area = float(counted.of(np.array(seen[window].sum()), np.array(whole)))
                number = counts[window].sum()
                bound = poisson_bound(np.array(max(number - target, 0.0)), -MAX_DEVIATIONS) / area
                low[window] = np.maximum(low[window], bound)
                bound = poisson_bound(np.array(number), MAX_DEVIATIONS) / area
                high[window] = np.maximum(high[window], bound)
        density = np.minimum(np.maximum(density, low), high)
    return density


@pytest.mark.parametrize("mean", [0.02, 0.5, 5.0])
@pytest.mark.parametrize("sensor", [SECTOR, ROUND], ids=["sector", "round"])
def test_densities_are_those_of_a_loop_over_windows(sensor, mean):
    grid, rng = PolarGrid(sensor), np.random.default_rng(3)
    counts = rng.poisson(mean, grid.shape) * rng.random(grid.shape)
    counts[:5, 3:8] += 4.0 * mean
    seen = grid.area * (rng.random(grid.shape) < 0.8)
    counted = CountedArea(1.1, 0.1)
    windows = CountedWindows(Windows(grid), seen, counted)
    overall = counts.sum() / grid.area.sum() / grid.shape[1]
    root = bounded_root(counts, overall, 3.0, windows)
    np.testing.assert_allclose(root**2, looped(grid, counts, seen, counted, 3.0), rtol=1e-11)
    assert mean < 0.5 or np.ptp(root) > 0.0


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("sensor", [SECTOR, ROUND], ids=["sector", "round"])
def test_windows_that_are_left_out_move_nothing(sensor, seed):
    # Even clutter, in which windows move hardly any cell; with a patch of more, or of less.
    grid, rng = PolarGrid(sensor), np.random.default_rng(seed)
    area = np.broadcast_to(grid.area, grid.shape)
    mean = 2.0 * area / area.mean()
    mean[10:16, 3:12] *= (1.0, 2.0, 0.2, 0.0)[seed % 4]
    counts = rng.poisson(mean).astype(float)
    counted = CountedArea(1.0, 0.1)
    overall = counts.sum() / area.sum()
    root = bounded_root(counts, overall, 2.0, CountedWindows(Windows(grid), area, counted))
    np.testing.assert_allclose(root**2, looped(grid, counts, area, counted, 2.0), rtol=1e-11)


@pytest.mark.parametrize("wraps", [False, True])
def test_sums_nearer_are_those_of_a_loop(wraps):
    rng = np.random.default_rng(4)
    values = rng.random((6, 20))
    sums = BlockSums(values, wraps, 5 if wraps else 0, 5 if wraps else 0)
    for row, middle, half in rng.integers([0, 0, 0], [7, 20, 6], (60, 3)):
        columns = np.arange(middle - half, middle + half + 1)
        columns = columns % 20 if wraps else columns[(columns >= 0) & (columns < 20)]
        assert sums.nearer(row, middle, half) == pytest.approx(values[:row, columns].sum())
