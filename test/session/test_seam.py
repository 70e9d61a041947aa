"""Echoes across the seam."""

from __future__ import annotations

import math

import numpy as np
import pytest
from support.sweeps import RADAR

from tsepm_ros.session.sweep import SeamEchoes
from tsepm_ros.tracker.sensor import SensorModel

DEGREE = math.radians(1.0)


def followed(echoes, sensor=RADAR, extent: float = 0.0):
    """Whether each echo (degrees after the seam, range) after it belongs before."""
    seam, found = SeamEchoes(sensor, extent, DEGREE), []
    for degrees, range_ in echoes:
        if degrees < 0:
            seam.add(degrees * DEGREE, np.array([range_]))
        else:
            found += seam.take(degrees * DEGREE, np.array([range_])).tolist()
    return found


@pytest.mark.parametrize(
    ("echoes", "expected"),
    [
        ([(-1, 500), (0, 500), (1, 502), (2, 504), (3, 506)], [True, True, True, True]),
        ([(-1, 500), (2, 500)], [False]),
        ([(-2, 500), (0, 500), (2, 500), (4, 500), (6, 500)], [True, True, True, False]),
        ([(-3, 500), (0, 500)], [False]),
        ([(-1, 500), (0, 505)], [False]),
        ([(-1, 500), (-1, 510), (0, 508), (1, 501)], [True, True]),
        ([(0, 500), (1, 500)], [False, False]),
    ],
)
def test_echoes_that_follow_each_other_belong_together(echoes, expected):
    assert followed(echoes) == expected


def test_resolution_and_extent_widen_the_reach():
    wide = SensorModel(range_std=1.0, range_std_fraction=0.0, azimuth_resolution=8 * DEGREE)
    assert followed([(-4, 500), (3, 500), (7, 500), (9, 500)], wide) == [True, True, False]
    coarse = SensorModel(range_std=1.0, range_std_fraction=0.0, range_resolution=10.0)
    assert followed([(-1, 500), (0, 509)], coarse) == [True]
    assert followed([(-1, 500), (0, 509)], extent=12.0) == [True]


def test_it_ends_where_no_echo_can_follow():
    seam = SeamEchoes(RADAR, 0.0, DEGREE)
    assert seam.ends(0.0)
    seam.add(-DEGREE, np.array([500.0]))
    assert not seam.ends(DEGREE)
    assert seam.ends(2 * DEGREE)
