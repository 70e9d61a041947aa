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
"""Scans beyond every limit: the tracker stays alive, cuts and counts."""

import math

import numpy as np
import pytest
from support.builders import scan_at

from tsepm_ros import Scan, SensorModel, available_methods, make_initiator


def test_a_hundred_thousand_detections_in_one_scan_do_not_end_anything():
    # The scan's 100 000 potential tracks gate everything until their window ends; a target that
    # appears after that is found as if the scan had not been, and nothing is left of it.
    rng = np.random.default_rng(1)
    n = 100_000
    initiator = make_initiator("tsepm", sensor=SensorModel())
    initiator.process(
        Scan(0.0, 9000 * np.sqrt(rng.uniform(1e-6, 1, n)), rng.uniform(-math.pi, math.pi, n))
    )
    assert initiator.statistics.potential_tracks == n
    for k in range(1, 9):
        initiator.process(
            scan_at(12.0 * k, [rng.uniform(-6000, 6000, 2), (1000.0 + 50.0 * k, 3000.0)])
        )
        assert initiator.statistics.potential_tracks <= 250_000
    late = [initiator.process(scan_at(12.0 * k, [(-4000.0, 60.0 * k)])) for k in range(9, 18)]
    assert sum(map(len, late)) >= 1
    track = next(new[0] for new in late if new)
    np.testing.assert_allclose(track.position, (-4000.0, 5.0 * track.stamp), rtol=1e-3)
    assert initiator.statistics.potential_tracks < 100


def cluster(scans: int, number: int, scan_time: float = math.inf):
    """So many detections in a cluster in each scan: number^5 raw confirmations in the fifth."""
    rng = np.random.default_rng(1)
    initiator = make_initiator("tsepm", sensor=SensorModel())
    initiator.max_scan_time = scan_time
    for k in range(scans):
        range_, azimuth = rng.uniform(-100, 100, number), rng.uniform(-0.02, 0.02, number)
        tracks = initiator.process(Scan(12.0 * k, 5000 + range_, azimuth))
    return initiator, tracks


@pytest.mark.timeout(60)
def test_a_small_cluster_of_detections_in_every_scan_is_processed_in_time():
    # A wreck or a jetty: 1e5 raw confirmations, all of which merge; every pair takes minutes.
    initiator, _ = cluster(6, 10)
    assert initiator.totals.confirmed >= 1


def test_a_time_limit_cuts_what_it_must_counts_it_and_the_output_is_valid():
    initiator, tracks = cluster(5, 12, 0.05)
    statistics = initiator.statistics
    assert tracks
    assert statistics.raw_confirmations == 0.25 * 0.05 * 100_000
    assert statistics.raw_confirmations + statistics.cut_confirmations == 12**5
    assert statistics.raw_confirmations == sum(
        (statistics.pruned, statistics.merged, statistics.confirmed)
    )
    for track in tracks:
        assert np.linalg.eigvalsh(track.covariance).min() > 0
        assert [scan for scan, _ in track.hits] == [0, 1, 2, 3, 4]


@pytest.mark.parametrize("method", [name for name in available_methods() if name != "hough"])
def test_where_the_time_is_over_only_part_of_the_pairs_in_one_gate_is_looked_at(method):
    # A thousand detections twice: a million pairs, of which none may be left out in silence.
    n, rng = 1000, np.random.default_rng(1)
    initiator = make_initiator(method, sensor=SensorModel())
    initiator.max_scan_time = 0.01  # of a thousand pairs
    for k in range(2):
        # Spread evenly, or they are one target's.
        places = rng.uniform(980.0, 1020.0, n), rng.uniform(-0.02, 0.02, n)
        initiator.process(Scan(12.0 * k, *places))
    assert initiator.statistics.cut_potential_tracks >= n * n - 500_000
    assert initiator.statistics.potential_tracks <= 500_000
