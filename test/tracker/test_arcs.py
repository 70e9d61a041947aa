"""Arcs of azimuths."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tsepm_ros.tracker.scan import arc_of


@pytest.mark.parametrize(
    ("azimuths", "start", "width"),
    [
        ([0.5], 0.5, 0.0),
        ([0.5, 0.5, 0.9], 0.5, 0.4),
        ([3.1, -3.1], 3.1, 2 * math.pi - 6.2),
        ([-0.2, 0.1, math.nan, math.inf], -0.2, 0.3),
        ([0.0, math.pi / 2, math.pi, -math.pi / 2], 0.0, 1.5 * math.pi),
        ([7.0, 6.0], 6.0, 1.0),
    ],
)
def test_the_smallest_arc_holds_all(azimuths, start, width):
    arc = arc_of(np.array(azimuths))
    assert arc.width == pytest.approx(width)
    if width < math.pi:
        assert math.remainder(arc.start - start, 2 * math.pi) == pytest.approx(0.0, abs=1e-12)
        middle = math.remainder(arc.middle - start - 0.5 * width, 2 * math.pi)
        assert middle == pytest.approx(0.0, abs=1e-12)
    assert not arc.whole


@pytest.mark.parametrize("azimuths", [[], [math.nan]])
def test_no_azimuth_has_no_arc(azimuths):
    assert arc_of(np.array(azimuths)) is None


def test_a_random_arc_is_as_narrow_as_any():
    rng = np.random.default_rng(2)
    for _ in range(200):
        azimuths = rng.uniform(-10.0, 10.0, rng.integers(1, 8))
        arc = arc_of(azimuths)
        widths = [np.mod(azimuths - first, 2 * np.pi).max() for first in azimuths]
        assert arc.width == pytest.approx(min(widths), abs=1e-9)
        assert (np.mod(azimuths - arc.start + 1e-9, 2 * np.pi) <= arc.width + 2e-9).all()
