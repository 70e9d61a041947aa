"""Plots: groups as in plain loops, runs of rays, centroids; what tells of several detections."""

import math
from dataclasses import replace

import numpy as np
import pytest
from plots_scenes import Swimmers, box
from scipy.cluster.hierarchy import fcluster, linkage
from support.held import tracks

from tsepm_ros import Scan, SensorModel
from tsepm_ros.tracker.clusters.extended_targets import (
    LOG_RATIO,
    MARGIN,
    SUSPICION,
    Beside,
    ClusterDispersion,
    ExtendedTargets,
    MultiDetectionTest,
    extents_of,
    log_ratio,
)
from tsepm_ros.tracker.clusters.grouping import (
    ClusterErrors,
    ClusterExtent,
    clusters_of,
    grouped,
)
from tsepm_ros.tracker.options import CommonOptions
from tsepm_ros.tracker.scan import arc_of, chosen
from tsepm_ros.tracker.sensor import goes_on

SENSOR = SensorModel(range_std=0.5, range_std_fraction=0.0, azimuth_std=math.radians(1.0))


def groups_of(label) -> set[frozenset[int]]:
    return {frozenset(np.flatnonzero(label == one).tolist()) for one in np.unique(label)}


@pytest.mark.parametrize("seed", range(40))
def test_groups_are_those_of_complete_linkage(seed):
    rng = np.random.default_rng(seed)
    n, size = int(rng.integers(0, 50)), rng.uniform(5.0, 80.0)
    range_ = rng.uniform(100.0, 100.0 + size, n)
    azimuth = np.pi + rng.uniform(-size, size, n) / 200.0  # across the jump of the azimuth
    extent = ClusterExtent(rng.uniform(1.0, 10.0), rng.uniform(1.0, 10.0), rng.uniform(0.0, 0.05))
    scan = Scan(0.0, range_, azimuth)
    one, two = np.triu_indices(n, 1)
    turn = np.angle(np.exp(1j * (azimuth[one] - azimuth[two])))
    width = 0.5 * (range_[one] + range_[two]) * abs(turn)
    width /= extent.across + 0.5 * (range_[one] + range_[two]) * extent.beam
    distance = np.maximum(abs(range_[one] - range_[two]) / extent.along, width)
    expected = fcluster(linkage(distance, "complete"), 1.0, "distance") if n > 1 else np.zeros(n)
    assert groups_of(grouped(scan.range, scan.azimuth, extent)) == groups_of(expected)


def test_a_saturated_receiver_is_cut_in_cells_in_time():
    rng = np.random.default_rng(1)
    range_, azimuth = rng.uniform(100.0, 120.0, 30_000), rng.uniform(0.0, 0.2, 30_000)
    extent = ClusterExtent(4.0, 4.0)
    label = grouped(range_, azimuth, extent)
    assert 20 <= len(np.unique(label)) <= 100
    for one in np.unique(label):
        assert np.ptp(range_[label == one]) <= 4.0
        assert np.ptp(azimuth[label == one]) * 100.0 <= 4.0


def test_a_plot_has_its_strongest_members_figures():
    scan = Scan(
        5.0,
        [200.0, 50.0, 201.0],
        [math.pi - 0.001, 1.0, -math.pi + 0.003],
        time_offset=[0.1, 0.2, 0.3],
        features={"intensity": [1.0, 5.0, 3.0], "range_rate": [0.1, 0.2, 0.3]},
        sensor_pose=[[0.0, 0.0, 0.1], [0.0, 0.0, 0.2], [0.0, 0.0, 0.3]],
    )
    made = clusters_of(scan, np.array([0, 1, 0]), ClusterErrors(), SENSOR)
    assert made.strongest.tolist() == [2, 1]
    assert made.scan.range == pytest.approx([200.75, 50.0])
    assert math.remainder(made.scan.azimuth[0] - (math.pi + 0.002), 2 * math.pi) == pytest.approx(0)
    assert made.scan.time_offset.tolist() == [0.3, 0.2]
    assert made.scan.features["intensity"].tolist() == [3.0, 5.0]
    assert made.scan.features["range_rate"].tolist() == [0.3, 0.2]
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
    one = chosen(Scan(1.0, features={"intensity": [5.0, 6.0]}, **columns), np.array([1]))
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


TANK = SensorModel(max_range=100.0, range_std=0.2, range_std_fraction=0.0, azimuth_std=0.004)
DENSITY = 1e-4


def largest(sensor: SensorModel, scans, density: float) -> float:
    excess, found = MultiDetectionTest(sensor), -math.inf
    for scan in scans:
        excess.update(scan, density)
        found = max(found, excess.log_ratio)
    return found


@pytest.mark.parametrize("kind", ["uniform", "smooth", "rough", "blocks"])
def test_clutter_of_the_box_looks_like_clutter(kind):
    scans = box(kind, 600, seed=1, redrawn=100)
    assert largest(SensorModel(), scans, 1e-6) < LOG_RATIO


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("kind", ["arc", "ring", "spoke", "near"])
def test_clutter_on_arcs_and_rays_and_near_the_sensor_is_no_target(kind, seed):
    """Side lobes, a sea floor, interference and reverberation, for 300 pings, in even clutter."""
    rng, scans = np.random.default_rng(seed), []
    for _ in range(300):
        number, even = rng.poisson(12), rng.poisson(5)
        range_, azimuth = {
            "arc": (100.0 + rng.standard_normal(number), rng.uniform(-1.0, 1.0, number)),
            "ring": (40.0 + 3.0 * rng.standard_normal(number), rng.uniform(-3.1, 3.1, number)),
            "spoke": (300.0 * rng.random(number), 0.5 + 0.01 * rng.standard_normal(number)),
            "near": (1.0 + rng.exponential(15.0, number), rng.uniform(-3.1, 3.1, number)),
        }[kind]
        range_ = np.append(range_, 300.0 * np.sqrt(rng.random(even)))
        azimuth = np.append(azimuth, rng.uniform(-np.pi, np.pi, even))
        scans.append(Scan(0.0, np.maximum(range_, 0.1), azimuth))
    assert largest(SensorModel(max_range=300.0), scans, 6e-5) < LOG_RATIO


def test_pairs_of_detections_may_be_two_targets():
    scans = [Scan(float(k), [50.0, 51.0], [0.0, 0.0]) for k in range(200)]
    assert largest(TANK, scans, DENSITY) == 0.0


def beside_a_track(offset) -> float:
    """Largest L after 40 pings of a track with another detection at an offset, m."""
    excess, own = MultiDetectionTest(TANK), np.array([0])
    for ping in range(40):
        scan = Scan(float(ping), [50.0, 50.0 + offset(ping)], [0.0, 0.0])
        excess.update(scan, DENSITY)
        excess.update_tracks(scan, DENSITY, np.array([7]), own, np.array([7]))
    return excess.log_ratio


def test_what_lies_now_on_one_side_of_a_track_and_now_on_the_other_is_its_own():
    assert beside_a_track(lambda ping: 3.0 * (-1.0) ** ping) > LOG_RATIO


def test_what_lies_on_one_side_of_a_track_is_a_second_targets():
    assert beside_a_track(lambda ping: 3.0) == 0.0


def test_tracks_in_any_order_and_with_gaps_count_as_each_alone():
    """Nine tracks far apart; each is in some pings only, in an order that changes."""
    rng, number = np.random.default_rng(5), 9
    together, alone = MultiDetectionTest(TANK), [MultiDetectionTest(TANK) for _ in range(9)]
    ids, azimuth = 40 + rng.permutation(number), np.linspace(-2.5, 2.5, number)
    for ping in range(30):
        side = rng.choice([-1.0, 1.0], number) * (rng.random(number) < 0.7)
        seen = rng.permutation(number)[: rng.integers(0, number + 1)]
        for test, rows in ((together, seen), *((alone[row], seen[seen == row]) for row in seen)):
            range_ = np.append(np.full(len(rows), 50.0), 50.0 + 3.0 * side[rows])
            scan = Scan(float(ping), range_, np.tile(azimuth[rows], 2))
            test.update_tracks(scan, DENSITY, ids[rows], np.arange(len(rows)), ids)
    assert together.waits(ids).tolist() == [
        bool(one.waits(track_id) or together.log_ratio >= SUSPICION)
        for one, track_id in zip(alone, ids, strict=True)
    ]
    assert together._tracks["looks"].sum() > 100
    for row, track_id in enumerate(ids):
        (mine,), (its,) = (
            test._tracks[test._tracks["track_id"] == track_id] for test in (together, alone[row])
        )
        assert mine["offset"] == pytest.approx(its["offset"])
        assert mine["pings"].tolist() == its["pings"].tolist()


def test_a_seam_of_a_sweep_parts_no_neighbours():
    azimuth = [math.pi - 0.004, 0.004 - math.pi, 0.008 - math.pi]
    pose = [[0.0, 0.0, 0.3], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]]
    scan = Scan(0.0, [1000.0] * 3, azimuth, sensor_pose=pose, time_offset=[12.0, 0.0, 0.01])
    beside = Beside(scan, np.arange(3), extents_of(SensorModel(max_range=2000.0)))
    assert beside.number[-1].tolist() == [2.0, 2.0, 2.0]


def test_starts_beside_a_track_wait_while_what_lies_beside_it_is_open():
    excess, own = MultiDetectionTest(TANK), np.array([0])
    assert excess.waits(7), "nothing is known of it"
    alone = Scan(0.0, [50.0], [0.0])
    excess.update_tracks(alone, DENSITY, np.array([7]), own, np.array([7]))
    assert not excess.waits(7)
    excess.update_tracks(alone, DENSITY, np.array([8]), own, np.array([8]))
    assert excess.waits(7), "it ended"


@pytest.mark.parametrize(("density", "waits"), [(1e-4, True), (1e-2, False)])
def test_starts_do_not_wait_for_what_clutter_explains_beside_a_track(density, waits):
    excess, own = MultiDetectionTest(TANK), np.array([0])
    for ping, side in enumerate((3.0, -3.0)):
        scan = Scan(float(ping), [50.0, 50.0 + side], [0.0, 0.0])
        excess.update_tracks(scan, density, np.array([7]), own, np.array([7]))
    assert excess.waits(7) == waits


def suspicious_of(echoes: int) -> ExtendedTargets:
    """After two pings of some echoes beside each other: three make a group suspicious."""
    targets = ExtendedTargets(TANK, CommonOptions())
    for ping in range(2):
        scan = Scan(float(ping), np.full(echoes, 50.0), 0.01 * np.arange(echoes))
        targets.clusters_of(scan, DENSITY, np.zeros(echoes, bool))
    assert not targets.seen
    return targets


@pytest.mark.parametrize("echoes", [1, 3])
def test_of_starts_in_one_ping_the_second_waits_only_beside_groups(echoes):
    starts = tracks(0, 1, x=50.0)
    starts.state[:, 2] *= 0.01
    waits = suspicious_of(echoes).waits(starts, tracks(), np.zeros(2))
    assert waits.tolist() == [False, echoes == 3]


@pytest.mark.parametrize(
    ("hits", "speed", "waits"), [(3, 5.0, True), (8, 5.0, False), (8, 0.5, True)]
)
def test_a_start_beside_echoes_that_stand_still_waits_until_it_moves(hits, speed, waits):
    targets = suspicious_of(3)
    alone = Scan(1.0, [50.0], [0.0])
    targets.test.update_tracks(alone, DENSITY, np.array([0]), np.array([0]), np.array([0]))
    start, held = tracks(1, x=50.0), tracks(0, x=50.0)
    start.state[:, 1:3] = speed, 10.0
    start.covariance[:] = np.eye(4)
    start.hit_count[:], held.stationary_probability[:] = hits, 1.0
    assert targets.waits(start, held, np.zeros(2)).tolist() == [waits]


def test_counts_are_those_of_a_loop():
    rng, extents = np.random.default_rng(3), extents_of(TANK)
    scan = Scan(0.0, rng.uniform(40.0, 60.0, 30), rng.uniform(-0.2, 0.2, 30))
    centre = np.array([4, 9, 20])
    beside = Beside(scan, centre, extents)
    for size, extent in enumerate(ClusterExtent(*one) for one in extents[..., 0].T):
        for place, one in enumerate(centre):
            across = extent.across_at(scan.range[one])
            counts = np.zeros(3)
            for other in set(range(30)) - {one}:
                depth = abs(scan.range[other] - scan.range[one]) / extent.along
                turn = abs(scan.azimuth[other] - scan.azimuth[one])
                width = scan.range[one] * turn / across
                counts += [
                    depth <= 1.0 and width <= 1.0,
                    depth <= 1.0 and 2.0 < width <= 3.0,
                    2.0 < depth <= 3.0 and width <= 1.0,
                ]
            found = [beside.number[size, place], *beside.strips[:, size, place]]
            np.testing.assert_array_equal(found, counts)


def test_the_log_ratio_is_that_of_poisson_counts():
    found, expected = np.array([6.0, 1.0]), np.array([1.0, 1.0])
    log_of = 6.0 * math.log(6.0 / MARGIN) - (6.0 - MARGIN)
    np.testing.assert_allclose(log_ratio(found, expected), [log_of, 0.0])


@pytest.mark.parametrize("share", [0.1, 0.02])
def test_in_a_shorter_range_every_length_is_as_much_shorter(share):
    sea, tank = (extents_of(SensorModel(max_range=100.0 * one)) for one in (1.0, share))
    np.testing.assert_allclose(tank[0], share * sea[0])


def test_boxes_have_the_resolution_of_the_sensor():
    sensor = SensorModel(range_resolution=0.5, azimuth_resolution=0.02)
    assert extents_of(sensor)[:, 0, 0].tolist() == [1.5, 1.0, 0.02, math.inf]


@pytest.mark.parametrize("common", [True, False])
@pytest.mark.parametrize("spread", [1.0, 3.0])
def test_the_scatter_tells_errors_from_extent(common, spread):
    scene = Swimmers(common=common, spread=spread, false=0.0, pings=150)
    # Clutter of no density is no sensor's.
    sensor, scatter = replace(scene, false=1.0).sensor, ClusterDispersion()
    extent = ClusterExtent(8.0, 8.0, 0.1)
    for ping in scene.draw(3):
        label = grouped(ping.scan.range, ping.scan.azimuth, extent)
        scatter = scatter.after(ping.scan, label, sensor)
    errors = scatter.errors(extent)
    assert errors.independent == pytest.approx(0.0 if common else 1.0, abs=0.25)
    assert errors.extent_variance == pytest.approx(
        spread**2 / 16.0, abs=0.15 + 0.3 * spread**2 / 16
    )
    assert scatter.mean_size == pytest.approx(4.0, abs=0.4)
