"""Plots: groups as in plain loops, runs of rays, and centroids whose errors are what is said."""

import math

import numpy as np
import pytest
from support.plain_plots import plain_groups

from tsepm_ros.tracker.clusters import grouping
from tsepm_ros.tracker.clusters.grouping import (
    ClusterErrors,
    ClusterExtent,
    clusters_of,
    goes_on,
    grouped,
)
from tsepm_ros.tracker.scan import Scan, arc_of
from tsepm_ros.tracker.sensor import SensorModel

SENSOR = SensorModel(range_std=0.5, range_std_fraction=0.0, azimuth_std=math.radians(1.0))


def groups_of(label) -> set[frozenset[int]]:
    return {frozenset(np.flatnonzero(label == one).tolist()) for one in np.unique(label)}


@pytest.mark.parametrize("seed", range(40))
def test_groups_are_those_of_plain_loops(seed):
    rng = np.random.default_rng(seed)
    n, size = int(rng.integers(0, 50)), rng.uniform(5.0, 80.0)
    range_ = rng.uniform(100.0, 100.0 + size, n)
    azimuth = np.pi + rng.uniform(-size, size, n) / 200.0  # across the jump of the azimuth
    extent = ClusterExtent(rng.uniform(1.0, 10.0), rng.uniform(1.0, 10.0), rng.uniform(0.0, 0.05))
    scan = Scan(0.0, range_, azimuth)
    plain = plain_groups(
        list(zip(scan.range, scan.azimuth, strict=True)), extent.along, extent.across, extent.beam
    )
    assert groups_of(grouped(scan.range, scan.azimuth, extent)) == plain


def test_a_saturated_receiver_is_cut_in_cells_in_time():
    rng = np.random.default_rng(1)
    range_, azimuth = rng.uniform(100.0, 120.0, 30_000), rng.uniform(0.0, 0.2, 30_000)
    extent = ClusterExtent(4.0, 4.0)
    label = grouped(range_, azimuth, extent)
    assert 20 <= len(np.unique(label)) <= 100
    for one in np.unique(label):
        assert np.ptp(range_[label == one]) <= 4.0
        assert np.ptp(azimuth[label == one]) * 100.0 <= 4.0


def test_a_plot_has_its_strongest_members_figures_and_the_width_of_all():
    scan = Scan(
        5.0,
        [200.0, 50.0, 201.0],
        [math.pi - 0.001, 1.0, -math.pi + 0.003],
        time_offset=[0.1, 0.2, 0.3],
        features={"intensity": [1.0, 5.0, 3.0], "range_width": [0.5, 0.5, 0.5]},
        sensor_pose=[[0.0, 0.0, 0.1], [0.0, 0.0, 0.2], [0.0, 0.0, 0.3]],
    )
    made = clusters_of(scan, np.array([0, 1, 0]), ClusterErrors(), SENSOR)
    assert made.strongest.tolist() == [2, 1]
    assert made.scan.range == pytest.approx([200.75, 50.0])
    assert math.remainder(made.scan.azimuth[0] - (math.pi + 0.002), 2 * math.pi) == pytest.approx(0)
    assert made.scan.time_offset.tolist() == [0.3, 0.2]
    assert made.scan.features["intensity"].tolist() == [3.0, 5.0]
    assert made.scan.features["range_width"] == pytest.approx([1.5, 0.5])
    assert made.scan.features["azimuth_width"] == pytest.approx([0.004, 0.0])
    assert made.scan.sensor_pose[:, 2].tolist() == [0.3, 0.2]


def test_without_intensities_the_member_nearest_to_the_centroid_counts():
    scan = Scan(0.0, [10.0, 11.0, 15.0], [0.0, 0.0, 0.0])
    made = clusters_of(scan, np.zeros(3, int), ClusterErrors(), SENSOR)
    assert made.strongest.tolist() == [1]
    assert made.scan.range == pytest.approx([12.0])


def test_a_plot_at_the_sensor_has_any_azimuth():
    scan = Scan(0.0, [0.01, 0.02], [0.0, 1.0])
    made = clusters_of(scan, np.zeros(2, int), ClusterErrors(1.0, 4.0), SENSOR)
    assert made.scan.azimuth_std.tolist() == [math.pi]


def test_detections_alone_stay_as_they_are():
    rng = np.random.default_rng(2)
    scan = Scan(0.0, rng.uniform(10.0, 20.0, 9), rng.uniform(-3.0, 3.0, 9))
    made = clusters_of(scan, np.arange(9), ClusterErrors(0.7, 0.0), SENSOR)
    assert made.scan.range.tobytes() == scan.range.tobytes()
    assert made.scan.azimuth.tobytes() == scan.azimuth.tobytes()
    assert not made.own_range_std.any()
    assert made.scan.azimuth_std == pytest.approx(np.full(9, SENSOR.azimuth_std))


@pytest.mark.parametrize("independent", [0.0, 0.3, 1.0])
@pytest.mark.parametrize("weighted", [False, True])
def test_a_plot_errs_as_is_said(independent, weighted):
    # 20 000 plots of 4 echoes: variances within 4 standard deviations of the estimate.
    rng = np.random.default_rng(3)
    n, m, extent, place = 20_000, 4, 3.0, 150.0
    sigma = np.array([0.5, place * SENSOR.azimuth_std])
    common = math.sqrt(1.0 - independent) * rng.standard_normal((n, 1, 2))
    own = math.sqrt(independent) * rng.standard_normal((n, m, 2))
    offset = sigma * (common + own) + rng.uniform(-0.5, 0.5, (n, m, 2)) * extent
    label = np.repeat(np.arange(n) * m, m)
    intensity = {"intensity": rng.uniform(0.5, 3.0, n * m)} if weighted else {}
    scan = Scan(
        0.0,
        place + offset[..., 0].ravel(),
        offset[..., 1].ravel() / place,
        **{"features": intensity},
    )
    errors = ClusterErrors(independent, extent**2 / 12.0)
    made = clusters_of(scan, label, errors, SENSOR)
    tolerance = 4.0 * math.sqrt(2.0 / n)
    along = np.mean((made.scan.range - place) ** 2 / made.scan.range_std**2)
    across = np.mean(made.scan.azimuth**2 / made.scan.azimuth_std**2)
    assert along == pytest.approx(1.0, abs=tolerance)
    assert across == pytest.approx(1.0, abs=tolerance + 0.01)


def test_chosen_detections_keep_what_is_theirs():
    columns = {"range": [10.0, 20.0], "azimuth": [0.1, 0.2], "range_std": [1.0, 2.0]}
    columns |= {"azimuth_std": [0.01, 0.02], "time_offset": [0.3, 0.4]}
    columns |= {"sensor_pose": [[0.0, 1.0, 2.0], [3.0, 4.0, 5.0]]}
    columns |= {"sensor_velocity": [[1.0, 2.0], [3.0, 4.0]]}
    one = grouping.chosen(Scan(1.0, features={"intensity": [5.0, 6.0]}, **columns), np.array([1]))
    assert {name: getattr(one, name).tolist() for name in columns} == {
        name: [values[1]] for name, values in columns.items()
    }
    assert one.features["intensity"] == [6.0]


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


def test_what_is_no_range_and_a_coarse_fan_always_jump():
    rays = np.array([math.nan, math.inf, 0.0, -1.0]), np.full(4, 5.0)
    sensor = SensorModel(range_std=1e3)
    for before, after in (rays, rays[::-1]):
        assert not goes_on(before, after, INCREMENT, sensor).any()
    for increment in (math.radians(3.1), math.nan):
        assert not goes_on(np.full(1, 5.0), np.full(1, 5.0), increment, sensor).any()


@pytest.mark.parametrize("azimuths", [[], [math.nan]])
def test_no_azimuth_has_no_arc(azimuths):
    assert arc_of(np.array(azimuths)) is None


def test_the_smallest_arc_holds_all_and_is_as_narrow_as_any():
    rng = np.random.default_rng(2)
    for number in (1, 1, *rng.integers(1, 8, 200)):
        azimuths = rng.uniform(-10.0, 10.0, number)
        arc = arc_of(np.append(azimuths, [math.nan, math.inf]))
        widths = [np.mod(azimuths - first, 2 * np.pi).max() for first in azimuths]
        assert arc.width == pytest.approx(min(widths), abs=1e-9)
        assert (np.mod(azimuths - arc.start + 1e-9, 2 * np.pi) <= arc.width + 2e-9).all()
        middle = math.remainder(arc.middle - arc.start - 0.5 * arc.width, 2 * math.pi)
        assert middle == pytest.approx(0.0, abs=1e-9)
        assert not arc.whole
