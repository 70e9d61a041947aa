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
"""Groups of detections against plain loops, and the figures of their clusters."""

import math

import numpy as np
import pytest
from scipy.cluster.hierarchy import fcluster, linkage

from tsepm_ros import Scan, SensorModel
from tsepm_ros.tracker.clusters.grouping import Extent, clusters_of_groups, group_detections

SENSOR = SensorModel(range_std=0.5, range_std_fraction=0.0, azimuth_std=math.radians(1.0))


def groups_of(label) -> set[frozenset[int]]:
    return {frozenset(np.flatnonzero(label == one).tolist()) for one in np.unique(label)}


@pytest.mark.parametrize("seed", range(40))
def test_groups_are_those_of_complete_linkage(seed):
    rng = np.random.default_rng(seed)
    n, size = int(rng.integers(0, 50)), rng.uniform(5.0, 80.0)
    range_ = rng.uniform(100.0, 100.0 + size, n)
    azimuth = np.pi + rng.uniform(-size, size, n) / 200.0  # across the jump of the azimuth
    extent = Extent(rng.uniform(1.0, 10.0), rng.uniform(1.0, 10.0), rng.uniform(0.0, 0.05))
    scan = Scan(0.0, range_, azimuth)
    one, two = np.triu_indices(n, 1)
    turn = np.angle(np.exp(1j * (azimuth[one] - azimuth[two])))
    width = 0.5 * (range_[one] + range_[two]) * abs(turn)
    width /= extent.across + 0.5 * (range_[one] + range_[two]) * extent.beam
    distance = np.maximum(abs(range_[one] - range_[two]) / extent.along, width)
    expected = fcluster(linkage(distance, "complete"), 1.0, "distance") if n > 1 else np.zeros(n)
    assert groups_of(group_detections(scan.range, scan.azimuth, extent)) == groups_of(expected)


def test_a_saturated_receiver_is_cut_in_cells_in_time():
    rng = np.random.default_rng(1)
    range_, azimuth = rng.uniform(100.0, 120.0, 30_000), rng.uniform(0.0, 0.2, 30_000)
    extent = Extent(4.0, 4.0)
    label = group_detections(range_, azimuth, extent)
    assert 20 <= len(np.unique(label)) <= 100
    for one in np.unique(label):
        assert np.ptp(range_[label == one]) <= 4.0
        assert np.ptp(azimuth[label == one]) * 100.0 <= 4.0


def test_a_cluster_has_its_strongest_members_figures():
    scan = Scan(
        5.0,
        [200.0, 50.0, 201.0],
        [math.pi - 0.001, 1.0, -math.pi + 0.003],
        time_offset=[0.1, 0.2, 0.3],
        features={"intensity": [1.0, 5.0, 3.0], "range_rate": [0.1, 0.2, 0.3]},
        sensor_pose=[[0.0, 0.0, 0.1], [0.0, 0.0, 0.2], [0.0, 0.0, 0.3]],
    )
    made = clusters_of_groups(scan, np.array([0, 1, 0]), 0.0, SENSOR)
    assert made.strongest.tolist() == [2, 1]
    assert made.scan.range == pytest.approx([200.75, 50.0])
    assert math.remainder(made.scan.azimuth[0] - (math.pi + 0.002), 2 * math.pi) == pytest.approx(0)
    assert made.scan.time_offset.tolist() == [0.3, 0.2]
    assert made.scan.features["intensity"].tolist() == [3.0, 5.0]
    assert made.scan.features["range_rate"].tolist() == [0.3, 0.2]
    assert made.scan.sensor_pose[:, 2].tolist() == [0.3, 0.2]


def test_without_intensities_the_member_nearest_to_the_centroid_counts():
    scan = Scan(0.0, [10.0, 11.0, 15.0], [0.0, 0.0, 0.0])
    made = clusters_of_groups(scan, np.zeros(3, int), 0.0, SENSOR)
    assert made.strongest.tolist() == [1]
    assert made.scan.range == pytest.approx([12.0])


def test_a_cluster_at_the_sensor_has_any_azimuth():
    scan = Scan(0.0, [0.01, 0.02], [0.0, 1.0])
    made = clusters_of_groups(scan, np.zeros(2, int), 4.0, SENSOR)
    assert made.scan.azimuth_std.tolist() == [math.pi]


def test_detections_alone_stay_as_they_are():
    rng = np.random.default_rng(2)
    scan = Scan(0.0, rng.uniform(10.0, 20.0, 9), rng.uniform(-3.0, 3.0, 9))
    made = clusters_of_groups(scan, np.arange(9), 0.0, SENSOR)
    assert made.scan.range.tobytes() == scan.range.tobytes()
    assert made.scan.azimuth.tobytes() == scan.azimuth.tobytes()
    assert not made.own_range_std.any()
    assert made.scan.azimuth_std == pytest.approx(np.full(9, SENSOR.azimuth_std))


@pytest.mark.parametrize("weighted", [False, True])
def test_a_cluster_errs_as_is_said(weighted):
    # 20 000 clusters of 4 echoes: variances within 4 standard deviations of the estimate.
    rng = np.random.default_rng(3)
    n, m, extent, place = 20_000, 4, 3.0, 150.0
    sigma = np.array([0.5, place * SENSOR.azimuth_std])
    offset = sigma * rng.standard_normal((n, 1, 2)) + rng.uniform(-0.5, 0.5, (n, m, 2)) * extent
    label = np.repeat(np.arange(n) * m, m)
    intensity = {"intensity": rng.uniform(0.5, 3.0, n * m)} if weighted else {}
    scan = Scan(
        0.0,
        place + offset[..., 0].ravel(),
        offset[..., 1].ravel() / place,
        **{"features": intensity},
    )
    made = clusters_of_groups(scan, label, extent**2 / 12.0, SENSOR)
    total = intensity.get("intensity", np.ones(n * m)).reshape(n, m)
    assert made.share == pytest.approx((total**2).sum(axis=1) / total.sum(axis=1) ** 2)
    tolerance = 4.0 * math.sqrt(2.0 / n)
    along = np.mean((made.scan.range - place) ** 2 / made.scan.range_std**2)
    across = np.mean(made.scan.azimuth**2 / made.scan.azimuth_std**2)
    assert along == pytest.approx(1.0, abs=tolerance)
    assert across == pytest.approx(1.0, abs=tolerance + 0.01)
