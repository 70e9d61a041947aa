"""Bounds of the density by windows, against loops over windows and cells."""

import itertools

import numpy as np
import pytest

from tsepm_ros import SensorModel
from tsepm_ros.tracker.clutter.density import ARCS, MIN_STEP, PER_SIDE, Bounds, squares
from tsepm_ros.tracker.clutter.excess import MAX_DEVIATIONS, PolarGrid, poisson_bound

TARGET = 3.0
"""Detections of an unknown target."""

SECTOR = SensorModel(max_range=300.0, azimuth_min=-0.4, azimuth_max=0.6)
ROUND = SensorModel(max_range=80.0, min_range=60.0)


def held(cells: int, length: int, wraps: bool) -> list[list[int]]:
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
        down, across = held(rows, height, False), held(columns, width, around)
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
    sizes = squares(*grid.shape)
    if kind == "arcs":
        sizes = [(1, grid.shape[1] // parts) for parts in ARCS]
    start = np.full(grid.shape, counts.sum() / whole.sum())
    bounds = Bounds(sizes, seen, whole, grid.wraps, 1.1)
    found = bounds.moved(start, counts, 1.0, TARGET)
    expected = looped(grid.shape, sizes, counts, (seen, whole, 1.1), grid.wraps, start)
    np.testing.assert_allclose(found, expected, rtol=1e-11)
    assert mean < 0.5 or np.ptp(found) > 0.0
