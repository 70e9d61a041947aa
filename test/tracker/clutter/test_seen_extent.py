"""The ranges and the sector in which clutter is seen."""

import math

import numpy as np
import pytest

from tsepm_ros.tracker.clutter.seen import EVERYWHERE, Extent, SeenExtent

SONAR = Extent(20.0, 300.0, -1.0, 1.0)
GIVEN = Extent(0.0, 9000.0, -math.pi, math.pi)


def draw(rng: np.random.Generator, number: int, extent: Extent) -> tuple[np.ndarray, np.ndarray]:
    """Uniform places in an extent."""
    square = rng.uniform(extent.min_range**2, extent.max_range**2, number)
    return np.sqrt(square), rng.uniform(extent.azimuth_min, extent.azimuth_max, number)


def estimated(number: int, extent: Extent, limit: Extent = GIVEN, seed: int = 1) -> Extent:
    seen = SeenExtent(limit)
    seen.update(*draw(np.random.default_rng(seed), number, extent), np.ones(number))
    return seen.estimate


def test_nothing_is_known_before_the_third_detection():
    assert estimated(2, SONAR) == GIVEN
    assert not SeenExtent(GIVEN).certain


@pytest.mark.parametrize("number", [5, 20, 200])
def test_the_area_is_right_on_average(number):
    # The spans of two dimensions are independent, each made up for: unbiased. 400 seeds leave a
    # deviation of the mean of 3 % at most.
    areas = [estimated(number, SONAR, EVERYWHERE, seed).area for seed in range(400)]
    assert np.mean(areas) == pytest.approx(SONAR.area, rel=0.12 if number < 20 else 0.06)


@pytest.mark.parametrize("middle", [0.0, 1.5, math.pi, -3.0])
def test_a_sector_may_lie_across_the_back(middle):
    sector = Extent(20.0, 300.0, middle - 0.5, middle + 0.5)
    found = estimated(500, sector)
    assert found.azimuth_max - found.azimuth_min == pytest.approx(1.0, abs=0.02)
    turn = 0.5 * (found.azimuth_min + found.azimuth_max) - middle
    assert math.remainder(turn, 2.0 * math.pi) == pytest.approx(0.0, abs=0.02)


def test_the_limit_is_not_exceeded():
    limit = Extent(50.0, 250.0, -0.9, 0.7)
    found = estimated(3, limit, limit)
    assert limit.min_range <= found.min_range < found.max_range <= limit.max_range
    assert limit.azimuth_min <= found.azimuth_min < found.azimuth_max <= limit.azimuth_max


def test_held_tracks_detections_do_not_count_and_old_ones_go():
    seen = SeenExtent(GIVEN)
    rng = np.random.default_rng(3)
    seen.update(*draw(rng, 400, GIVEN), np.full(400, 0.2))
    assert seen.estimate == GIVEN
    assert seen.detections == 0
    seen.update(*draw(rng, 400, Extent(0.0, 5000.0, -1.0, 1.0)), np.ones(400))
    assert seen.certain
    for _ in range(40):  # the operator chose a shorter range
        seen.update(*draw(rng, 20, SONAR), np.ones(20))
    assert seen.estimate.max_range < 310.0


@pytest.mark.parametrize("turn", [0.0, 1.0, 2.5])
def test_a_sector_that_is_seen_across_the_seam_of_the_coverage_is_not_cut(turn):
    # Nearly all round, in rounded numbers; and three quarters of a turn, seen at both ends.
    rng = np.random.default_rng(1)
    azimuth = np.pi + rng.uniform(-0.5, 0.5, 400)
    range_ = np.sqrt(rng.uniform(100.0, 8100.0, 400))
    for low, high in ((-3.1415, 3.1415), (-2.9, 2.9)):
        extent = Extent(0.0, 100.0, low + turn, high + turn)
        seen = SeenExtent(extent)
        seen.update(range_, azimuth + turn, np.ones(400))
        region = seen.region
        assert region.contains(range_, azimuth + turn).mean() > 0.98
        assert region.extent.azimuth_max - region.extent.azimuth_min < 1.2
