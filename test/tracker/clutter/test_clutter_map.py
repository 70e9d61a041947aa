"""The clutter density, estimated on a grid that adapts."""

import math

import numpy as np
import pytest

from tsepm_ros import SensorModel
from tsepm_ros.tracker.clutter.density import ClutterMap
from tsepm_ros.tracker.clutter.seen import Extent, Region, SeenExtent

SONAR = SensorModel(max_range=9000.0)


def disc(rng: np.random.Generator, density: float) -> tuple[np.ndarray, np.ndarray]:
    n = rng.poisson(density * SONAR.coverage_area)
    return 9000.0 * np.sqrt(rng.uniform(0.0, 1.0, n)), rng.uniform(-math.pi, math.pi, n)


def take(made: ClutterMap, range_: np.ndarray, azimuth: np.ndarray, *more) -> None:
    made.update(made.grid.cells(range_, azimuth), np.ones(len(range_)), *more)


def learned(density: float, scans: int, given: float = 1e-6) -> ClutterMap:
    rng = np.random.default_rng(1)
    made = ClutterMap(SensorModel(clutter_density=given))
    for _ in range(scans):
        take(made, *disc(rng, density))
    return made


def poisson_low(count: float) -> float:
    """Mean m of which a count is c = 1.25 standard deviations above: (N - m)^2 = c^2 m."""
    middle = count + 1.25**2 / 2.0
    return middle - math.sqrt(middle**2 - count**2)


def everywhere(made: ClutterMap) -> np.ndarray:
    return made.at(made.grid.cells(*disc(np.random.default_rng(9), 3e-5)))


@pytest.mark.parametrize("factor", [0.1, 1.0, 10.0])
@pytest.mark.parametrize("density", [1e-7, 1e-6, 5e-6])
def test_after_ten_scans_it_does_not_matter_what_the_data_sheet_said(density, factor):
    found = everywhere(learned(density, 10, given=factor * density))
    assert np.median(found) == pytest.approx(density, rel=0.3)
    assert np.exp(np.log(found).std()) < 1.6


def test_it_becomes_accurate_where_clutter_is_even():
    found = everywhere(learned(1e-6, 200))
    assert np.sqrt(np.mean((found / 1e-6 - 1.0) ** 2)) < 0.15


def test_a_zone_of_clutter_is_found_where_it_is():
    # A quarter of the coverage ten times as dense, in range beyond 4.5 km, to port.
    rng = np.random.default_rng(2)
    made = ClutterMap(SONAR)
    for _ in range(60):
        range_, azimuth = disc(rng, 1e-6)
        zone = (range_ > 4500.0) & (azimuth > 0.0)
        kept = zone | (rng.random(len(range_)) < 0.1)
        take(made, range_[kept], azimuth[kept])
    inside = made.at(made.grid.cells(np.array([7000.0, 6000.0]), np.array([1.0, 2.5])))
    outside = made.at(made.grid.cells(np.array([7000.0, 2000.0]), np.array([-1.0, 1.0])))
    np.testing.assert_allclose(inside, 1e-6, rtol=0.4)
    # Beside the zone too high rather than too low.
    assert (outside > 0.5e-7).all() and (outside < 3e-7).all()


def test_a_new_target_in_an_empty_sea_is_not_taken_for_clutter():
    made = ClutterMap(SONAR)
    rng = np.random.default_rng(7)
    for index in range(12):
        range_, azimuth = disc(rng, 1e-7)
        if index >= 9:
            range_, azimuth = np.append(range_, 5000.0), np.append(azimuth, 0.3)
        take(made, range_, azimuth)
    assert made.at(made.grid.cells(np.array([5000.0]), np.array([0.3])))[0] < 2e-7


def test_what_is_withdrawn_was_never_there():
    rng = np.random.default_rng(3)
    with_target, without = ClutterMap(SONAR), ClutterMap(SONAR)
    for _ in range(30):
        range_, azimuth = disc(rng, 2e-7)
        take(without, range_, azimuth)
        take(with_target, np.append(range_, 5000.0), np.append(azimuth, 0.3))
        target = with_target.grid.cells(np.array([5000.0]), np.array([0.3]))
        with_target.withdraw(target, np.ones(1))
    many = disc(rng, 1e-6)  # so many that the density is estimated anew
    for made in (with_target, without):
        take(made, *many)
    np.testing.assert_allclose(everywhere(with_target), everywhere(without))


def test_what_was_long_ago_fades():
    made = learned(1e-5, 100)
    rng = np.random.default_rng(4)
    for _ in range(400):
        take(made, *disc(rng, 1e-7))
    assert np.median(everywhere(made)) == pytest.approx(1e-7, rel=0.5)


def test_positions_outside_the_coverage_have_the_nearest_cell_s_density():
    sensor = SensorModel(
        min_range=1000.0, max_range=5000.0, azimuth_min=-0.5, azimuth_max=0.5, clutter_density=1e-6
    )
    made = ClutterMap(sensor)
    outside = np.array([10.0, 1e6, 3000.0]), np.array([0.0, 0.0, 3.0])
    np.testing.assert_allclose(made.at(made.grid.cells(*outside)), 1e-6)
    take(made, *outside)
    assert np.isfinite(made.at(made.grid.cells(np.array([3000.0]), np.array([0.0])))).all()


def test_few_new_scans_or_detections_leave_the_density_until_a_tenth_is_new():
    # Of 100 scans, about 43 count: a tenth are five.
    made, rng = learned(1e-6, 100), np.random.default_rng(10)
    before, asked, changes = everywhere(made), [], []

    def seen() -> Region:
        asked.append(True)
        return made.seen

    for _ in range(12):
        # A scan of more detections than the mean raises all densities together.
        take(made, *(part[:254] for part in disc(rng, 1e-6)), seen)
        now = everywhere(made)
        changes.append(bool((now != before).any()))
        before = now
    assert 2 <= sum(changes) <= 3
    assert len(asked) == sum(changes)
    # Scans with as many detections as twelve others count at once.
    for _ in range(3):
        number = len(asked)
        take(made, *disc(rng, 12e-6), seen)
        assert len(asked) == number + 1


def test_the_least_area_counts_at_once():
    made, rng = learned(1e-6, 100), np.random.default_rng(13)
    hull, place = SeenExtent(Extent.of(SONAR)), np.array([5000.0, 5100.0, 5050.0])
    for index, area in enumerate([6e5] * 6 + [5e5, 8e5]):
        azimuth = rng.uniform(0.3, 0.31, 3)
        hull.update(place, azimuth, np.ones(3))
        take(made, place, azimuth, lambda: hull.region, area)
        assert hull.region.area < area
        assert index < 5 or made.area == area


def test_a_scan_of_many_detections_raises_the_density_also_between_two_estimates():
    made, rng = learned(1e-6, 100), np.random.default_rng(11)
    take(made, *disc(rng, 1e-6))
    even = everywhere(made)
    # 1.3 times as many: a mean of 331 with a standard deviation of 18, against 254.
    number = round(1.3 * 1e-6 * SONAR.coverage_area)
    many = (part[:number] for part in disc(rng, 2e-6))
    take(made, *many, lambda: pytest.fail("this is between two estimates"))
    made.take_level(number)
    np.testing.assert_allclose(
        everywhere(made) / even, poisson_low(number - 1.0) / 254.5, rtol=0.02
    )


def test_the_density_does_not_depend_on_when_it_was_asked_for():
    rng, asked, other = np.random.default_rng(12), ClutterMap(SONAR), ClutterMap(SONAR)
    for _ in range(40):
        places = disc(rng, 3e-7)
        for made in (asked, other):
            take(made, *places)
        assert asked.mean > 0.0
    np.testing.assert_array_equal(everywhere(asked), everywhere(other))


def test_an_empty_scan_is_one_without_clutter():
    made = ClutterMap(SONAR)
    before = everywhere(made).mean()
    for _ in range(10):
        take(made, np.zeros(0), np.zeros(0))
    assert 0 < everywhere(made).mean() < before / 5


def test_the_mean_is_over_the_area():
    rng = np.random.default_rng(5)
    made = ClutterMap(SONAR)
    for _ in range(30):
        range_, azimuth = disc(rng, 1e-5)
        near = range_ < 2000.0  # a twentieth of the area, but most of the rings
        take(made, range_[near], azimuth[near])
    # 25 000 places even over the area, 1250 of them near: 10 % is 3.5 standard errors.
    assert made.mean == pytest.approx(made.at(made.grid.cells(*disc(rng, 1e-4))).mean(), rel=0.1)


def test_a_few_detections_in_a_small_hull_may_be_targets_and_make_no_dense_clutter():
    range_, azimuth = np.array([170.0, 297.0, 474.0]), np.radians([22.0, -4.0, 22.0])
    sensor = SensorModel(max_range=500.0)
    made, seen = ClutterMap(sensor), SeenExtent(Extent.of(sensor))
    for _ in range(3):
        seen.update(range_, azimuth, np.ones(3))
        take(made, range_, azimuth, lambda: seen.region, 5e5)
    # In the hull clutter would be ten times as dense as where one target may be.
    assert seen.region.area < 5e4
    assert made.at(made.grid.cells(range_, azimuth)).max() < 2.0 * 3.0 / 5e5
