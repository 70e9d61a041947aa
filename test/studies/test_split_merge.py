# Copyright 2026 tsepm_ros developers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.
"""Split and merge, and the clutter test, on scenes by hand."""

import numpy as np
import pytest
from scipy.stats import chi2
from support.builders import AS_GIVEN, detections, scan_at
from support.scenes import random_scene

from tsepm_ros import Scan, SensorModel, make_initiator
from tsepm_ros.studies.split_merge import split_merge_combined, split_merge_unscented
from tsepm_ros.tracker.initial_state import fit_states
from tsepm_ros.tracker.measurement import convert_measurements


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
    before = convert_measurements(scan, SENSOR, 0)
    found = split_merge_unscented(before, SENSOR)
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
    made = split_merge_combined(hits)
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
        split_merge_unscented(convert_measurements(scan_at(12.0 * k, where), SENSOR, k), SENSOR)
        for k, where in enumerate(scans)
    ]
    hits = split_merge_combined(np.concatenate(found))
    expected = fit_states(hits[None], 48.0, SENSOR, "unweighted")
    np.testing.assert_allclose(tracks[0].state, expected.state[0], atol=1e-9)
    np.testing.assert_allclose(tracks[0].covariance, expected.covariance[0], rtol=1e-9)


def test_nothing_is_pruned():
    rng = np.random.default_rng(4)
    scans = [rng.uniform(2000, 3000, (12, 2)).tolist() for _ in range(8)]
    _, made = run(scans)
    assert made.totals.pruned == 0
    assert made.totals.raw_confirmations > made.totals.confirmed > 0
    assert made.totals.raw_confirmations == made.totals.merged + made.totals.confirmed
