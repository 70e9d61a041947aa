"""Splitting and merging as in 2016."""

import numpy as np
import pytest
from support.builders import detections, scan_at

from tsepm_ros import Scan, SensorModel, make_initiator
from tsepm_ros.studies.split_merge import combined
from tsepm_ros.tracker.initial_state import fit
from tsepm_ros.tracker.measurement import convert, unscented

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
