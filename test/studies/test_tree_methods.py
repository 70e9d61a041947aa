"""Methods of the studies on scenes by hand: the clutter test, split and merge, multiple model."""

import numpy as np
import pytest
from scipy.stats import chi2, multivariate_normal
from support.builders import AS_GIVEN, FIXED_RANGE_ERROR, detections, scan_at
from support.scenes import random_scene

from tsepm_ros import Scan, SensorModel, make_initiator
from tsepm_ros.studies.multiple_model import MAX_FILTERS, cells
from tsepm_ros.studies.split_merge import combined, unscented
from tsepm_ros.tracker.initial_state import fit
from tsepm_ros.tracker.measurement import convert


@pytest.mark.parametrize(("size", "found"), [(0.0101, 1), (0.0099, 0)])
def test_a_track_is_put_out_where_its_statistic_is_below_the_quantile(size, found):
    # 4 steps: f_2 = 2 lambda pi 4 step^2, with 8 degrees of freedom.
    density = 8e-6
    step = np.sqrt(chi2.ppf(0.01, 8) / (8.0 * np.pi * density))
    sensor = SensorModel(
        range_std=1.0, range_std_fraction=0.0, azimuth_std=1e-5, clutter_density=density
    )
    made = make_initiator("clutter_test", sensor=sensor, clutter_test_size=size, **AS_GIVEN)
    tracks = []
    for k in range(5):
        tracks += made.process(scan_at(12.0 * k, [(3000.0 + step * k, 0.0)]))
    assert len(tracks) == found
    for track in tracks:
        assert track.evaluation == pytest.approx(chi2.ppf(0.01, 8), rel=1e-6)


def test_a_density_that_is_wrong_or_uneven_does_not_matter_where_it_is_estimated():
    def confirmed(density: float, **options: str) -> int:
        sensor = SensorModel(max_range=5000.0, clutter_density=density)
        rule = {"min_hits": 4, "window": 5, "clutter_test_size": 0.2}
        made = make_initiator("clutter_test", sensor=sensor, **rule, **options)
        rng = np.random.default_rng(2)
        total = 0
        for k in range(30):  # 1e-5 in a box, nothing around it
            x, y = rng.uniform(2000.0, 3500.0, (2, rng.poisson(22.5)))
            tracks = made.process(Scan(12.0 * k, np.hypot(x, y), np.arctan2(y, x)))
            total += len(tracks) if k >= 10 else 0
        return total

    known = confirmed(1e-5, **AS_GIVEN)
    assert confirmed(1e-6, **AS_GIVEN) > 10 * known
    # 39 known: a true ratio of 1.5 stays below 2.5 with 99 %.
    assert 0.5 * known < confirmed(1e-6) < 2.5 * known


@pytest.mark.parametrize("seed", [3, 13])
def test_its_tracks_are_those_of_tsepm_before_merging(seed):
    scene = random_scene(seed)
    rule = {"min_hits": 3, "window": 4, "gate_probability": 0.99, "clutter_test_size": 0.5}
    made = make_initiator("clutter_test", sensor=SensorModel(**scene.sensor), **rule)
    other = make_initiator(
        "tsepm", sensor=SensorModel(**scene.sensor), evaluation="clutter_statistic", **rule
    )
    for scan in scene.as_scans():
        tracks = made.process(scan)
        other.process(scan)
        assert made.statistics.merged == 0
        for count in ("potential_tracks", "raw_confirmations", "pruned", "started", "terminated"):
            assert getattr(made.statistics, count) == getattr(other.statistics, count)
        assert len(tracks) == other.statistics.confirmed + other.statistics.merged
    assert other.totals.merged > 0
    assert made.reason(made.current[0])


SENSOR = SensorModel(range_std=30.0, range_std_fraction=0.0)


def test_the_unscented_transform_is_that_of_its_sigma_points():
    scan = Scan(
        0.0,
        [3000.0, 500.0],
        [0.3, 2.0],
        azimuth_std=[0.02, 0.4],
        sensor_pose=np.array([100.0, 50.0, 0.7]),
        sensor_pose_covariance=np.diag([4.0, 9.0, 1e-4]),
    )
    before = convert(scan, SENSOR, 0)
    found = unscented(before, SENSOR)
    for row, (r, a, s) in enumerate(zip(scan.range, scan.azimuth + 0.7, [0.02, 0.4], strict=True)):
        far, wide = np.sqrt(3.0) * 30.0, np.sqrt(3.0) * s
        polar = [(r, a), (r + far, a), (r - far, a), (r, a + wide), (r, a - wide)]
        points = np.array([[one * np.cos(angle), one * np.sin(angle)] for one, angle in polar])
        weights = np.array([1 / 3, 1 / 6, 1 / 6, 1 / 6, 1 / 6])
        apart = points - weights @ points
        expected = np.einsum("i,iu,iv->uv", weights, apart, apart)
        pose = np.array([[1.0, 0.0, -points[0, 1]], [0.0, 1.0, points[0, 0]]])
        expected += pose @ np.diag([4.0, 9.0, 1e-4]) @ pose.T
        np.testing.assert_allclose(found["covariance"][row], expected, rtol=1e-9)
        np.testing.assert_allclose(found["position"][row], [100.0, 50.0] + points[0], rtol=1e-12)
    sigma = np.sqrt(np.linalg.eigvalsh(found["covariance"])[:, -1])
    np.testing.assert_allclose(found["major_sigma"], sigma)


def test_measurements_are_combined_scan_by_scan():
    hits = detections([[0.0, 0.0], [10.0, 2.0], [14.0, 4.0], [20.0, 0.0]], [0.0, 12.0, 13.0, 24.0])
    hits["scan"] = [0, 1, 1, 2]
    made = combined(hits)
    np.testing.assert_array_equal(made["time"], [0.0, 12.5, 24.0])
    np.testing.assert_array_equal(made["position"], [[0.0, 0.0], [12.0, 3.0], [20.0, 0.0]])
    np.testing.assert_allclose(made["covariance"][[0, 2]], [np.eye(2)] * 2)
    np.testing.assert_allclose(made["covariance"][1], [[5.0, 2.0], [2.0, 2.0]])


def run(scans, **options):
    made = make_initiator("split_merge", sensor=SENSOR, **options)
    return [
        track for k, where in enumerate(scans) for track in made.process(scan_at(12.0 * k, where))
    ], made


def shared(seen):
    """Scans of a target, and beside it where `seen` says."""
    scans = [[(3000.0, 30.0 * k)] for k in range(5)]
    for k in seen:
        scans[k].append((3020.0, 30.0 * k + 10.0))
    return scans


@pytest.mark.parametrize("twice", [[2], [1, 3]])
def test_branches_of_one_target_are_merged_and_estimated_again(twice):
    scans = shared(twice)
    tracks, made = run(scans)
    assert len(tracks) == 1
    assert made.totals.merged == 2 ** len(twice) - 1
    found = [
        unscented(convert(scan_at(12.0 * k, where), SENSOR, k), SENSOR)
        for k, where in enumerate(scans)
    ]
    hits = combined(np.concatenate(found))
    expected = fit(hits[None], 48.0, SENSOR, "unweighted")
    np.testing.assert_allclose(tracks[0].state, expected.state[0], atol=1e-9)
    np.testing.assert_allclose(tracks[0].covariance, expected.covariance[0], rtol=1e-9)


def test_nothing_is_pruned():
    rng = np.random.default_rng(4)
    scans = [rng.uniform(2000, 3000, (12, 2)).tolist() for _ in range(8)]
    _, made = run(scans)
    assert made.totals.pruned == 0
    assert made.totals.raw_confirmations > made.totals.confirmed > 0
    assert made.totals.raw_confirmations == made.totals.merged + made.totals.confirmed


@pytest.mark.parametrize(("speeds", "headings"), [(1, 3), (2, 8), (5, 36)])
def test_all_cells_together_are_a_uniform_speed_and_heading(speeds, headings):
    mean, covariance = cells(10.0, speeds, headings)
    assert len(mean) == speeds * headings
    np.testing.assert_allclose(mean.mean(axis=0), 0.0, atol=1e-12)
    total = covariance.mean(axis=0) + mean.T @ mean / len(mean)
    np.testing.assert_allclose(total, np.eye(2) * 10.0**2 / 6.0, atol=1e-12)


def test_a_cell_has_the_moments_of_its_velocities():
    rng = np.random.default_rng(1)
    mean, covariance = cells(10.0, 2, 4)
    speed = rng.uniform(5.0, 10.0, 200_000)
    heading = np.pi / 2 + rng.uniform(-np.pi / 4, np.pi / 4, 200_000)
    sample = np.stack([speed * np.cos(heading), speed * np.sin(heading)])
    np.testing.assert_allclose(mean[5], sample.mean(axis=1), atol=0.03)
    np.testing.assert_allclose(covariance[5], np.cov(sample), atol=0.08)


def plain_bank(hits, options, max_speed):
    """One bank over hits (scan by scan, 12 s apart), filter by filter."""
    mean, spread = cells(max_speed, options.speeds, options.headings)
    f = np.kron(np.eye(2), [[1.0, 12.0], [0.0, 1.0]])
    q = 12.0 * np.kron(np.eye(2), [[12.0**2 / 3, 6.0], [6.0, 1.0]]) * options.process_noise
    h = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]])
    states, covariances, weights = [], [], []
    for velocity, cell in zip(mean, spread, strict=True):
        x = h.T @ hits[0]["position"]
        x[1::2] = velocity
        p = h.T @ hits[0]["covariance"] @ h
        p[1::2, 1::2] = cell
        weight = 1.0
        for hit in hits[1:]:
            x, p = f @ x, f @ p @ f.T + q
            s = h @ p @ h.T + hit["covariance"]
            weight *= multivariate_normal.pdf(hit["position"], h @ x, s)
            gain = p @ h.T @ np.linalg.inv(s)
            x, p = x + gain @ (hit["position"] - h @ x), p - gain @ s @ gain.T
        states.append(x)
        covariances.append(p)
        weights.append(weight)
    weights = np.array(weights) / sum(weights)
    state = weights @ np.array(states)
    covariance = sum(
        w * (p + np.outer(x - state, x - state))
        for w, x, p in zip(weights, states, covariances, strict=True)
    )
    return state, covariance


@pytest.mark.parametrize("process_noise", [0.0, 0.01])
def test_the_output_is_that_of_plain_filters(process_noise):
    options = {"min_hits": 4, "window": 4, "process_noise": process_noise}
    made = make_initiator("multiple_model", sensor=FIXED_RANGE_ERROR, **options)
    rng = np.random.default_rng(2)
    places = [rng.normal((3000.0 + 60.0 * k, 40.0 * k), 20.0) for k in range(4)]
    scans = [scan_at(12.0 * k, [one]) for k, one in enumerate(places)]
    (track,) = [track for scan in scans for track in made.process(scan)]
    hits = [convert(scan, FIXED_RANGE_ERROR, 0)[0] for scan in scans]
    state, covariance = plain_bank(hits, made.options, 10.0)
    np.testing.assert_allclose(track.state, state, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(track.covariance, covariance, rtol=1e-7, atol=1e-9)


def test_time_offsets_change_the_times_and_nothing_else():
    # The same echoes, told as of their scans' stamps or as of an offset after earlier ones.
    def state(offset):
        made = make_initiator("multiple_model", sensor=FIXED_RANGE_ERROR, process_noise=0.0)
        tracks = []
        for k in range(5):
            where = [(3000.0 + 60.0 * k, 0.0)]
            tracks += made.process(scan_at(12.0 * k - offset, where, time_offset=[offset]))
        return tracks[0].predicted(60.0)

    np.testing.assert_allclose(state(4.0).state, state(0.0).state, atol=1e-6)
    np.testing.assert_allclose(state(4.0).covariance, state(0.0).covariance, atol=1e-6)


def test_a_scan_without_a_detection_is_waited_for():
    made = make_initiator("multiple_model", sensor=FIXED_RANGE_ERROR, min_hits=4, window=6)
    tracks = []
    for k, seen in enumerate("110101"):
        where = [(3000.0 + 60.0 * k, 0.0)] if seen == "1" else []
        tracks += made.process(scan_at(12.0 * k, where))
    assert [track.hits for track in tracks] == [((0, 0), (1, 0), (3, 0), (5, 0))]


def test_filters_are_bounded_and_the_tracks_beyond_are_counted():
    made = make_initiator(
        "multiple_model", sensor=FIXED_RANGE_ERROR, speeds=20, headings=72, plots="off"
    )
    most = MAX_FILTERS // (20 * 72)
    made.process(scan_at(0.0, [(2000.0 + 15.0 * k, 0.0) for k in range(most + 5)]))
    assert made.statistics.potential_tracks == made.statistics.started == most
    assert made.statistics.cut_potential_tracks == 5
