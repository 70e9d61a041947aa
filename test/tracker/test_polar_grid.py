"""The polar grid: its rings and cells."""

import numpy as np
import pytest

from tsepm_ros import SensorModel
from tsepm_ros.tracker.polar_grid import INNER_RINGS, PolarGrid


@pytest.mark.parametrize(("min_range", "rings"), [(0.0, INNER_RINGS), (50.0, 6), (100.0, 0)])
def test_rings_near_the_sensor_have_one_depth(min_range, rings):
    edges = PolarGrid(SensorModel(min_range=min_range, max_range=2000.0)).edges
    near = edges[edges <= 100.0 + 1e-9]
    assert len(near) == rings + 1
    assert near[0] == min_range
    np.testing.assert_allclose(np.diff(near), 100.0 / INNER_RINGS)
