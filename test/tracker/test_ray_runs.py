"""Arcs of azimuths, and neighbouring rays: of one object up to a slope and the noise of ranges."""

import math

import numpy as np
import pytest

from tsepm_ros import SensorModel
from tsepm_ros.tracker.clusters.grouping import goes_on
from tsepm_ros.tracker.scan import arc_of

INCREMENT = math.radians(0.25)
SLOPE = math.sin(INCREMENT) / math.sin(math.radians(20.0) - INCREMENT)


@pytest.mark.parametrize(("constant", "fraction"), [(0.0, 1e-6), (0.03, 0.0), (0.03, 0.01)])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_jump_is_one_beyond_the_slope_and_three_deviations_of_a_difference(
    constant, fraction, sign
):
    sensor = SensorModel(range_std=constant, range_std_fraction=fraction)
    deviation = math.sqrt(2.0) * math.hypot(constant, 5.0 * fraction)
    limit = SLOPE * 5.0 + 3.0 * deviation
    for share, expected in ((0.999, True), (1.001, False)):
        rays = [np.array([5.0]), np.array([5.0 + share * limit])]
        before, after = rays[:: int(sign)]
        assert goes_on(before, after, sign * INCREMENT, sensor).tolist() == [expected]


def test_a_target_under_noise_is_one_run_in_nearly_all_scans():
    # 3 cm of noise, and 40 rays on a leg at 5 m: a difference is beyond 3 deviations in 0.3 %.
    rng = np.random.default_rng(1)
    sensor = SensorModel(range_std=0.03, range_std_fraction=0.0)
    ranges = 5.0 + 0.03 * rng.standard_normal((500, 40))
    joined = goes_on(ranges[:, :-1].ravel(), ranges[:, 1:].ravel(), INCREMENT, sensor)
    assert joined.reshape(500, 39).all(axis=1).mean() > 0.95
    exact = goes_on(ranges[:, :-1].ravel(), ranges[:, 1:].ravel(), INCREMENT)
    assert exact.reshape(500, 39).all(axis=1).mean() < 0.05


def test_what_is_no_range_and_a_coarse_fan_always_jump():
    rays = np.array([math.nan, math.inf, 0.0, -1.0]), np.full(4, 5.0)
    sensor = SensorModel(range_std=1e3)
    for before, after in (rays, rays[::-1]):
        assert not goes_on(before, after, INCREMENT, sensor).any()
    for increment in (math.radians(3.1), math.nan):
        assert not goes_on(np.full(1, 5.0), np.full(1, 5.0), increment, sensor).any()


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
