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
"""Land on a chart changes nothing at sea, in whole scenes."""

import numpy as np
import pytest
from support.builders import assert_same_tracks

from tsepm_ros import LandMask, Scan, SensorModel, make_initiator
from tsepm_ros.methods.registry import available_methods

SENSOR = SensorModel(range_std=5.0, range_std_fraction=0.0, max_range=2000.0)


def scans(number: int, *, quay: bool, seed: int = 2):
    """A target that sails past, clutter, and a quay 500 m east that echoes."""
    rng, of_the_quay = np.random.default_rng(seed), np.random.default_rng(seed + 1)
    for k in range(number):
        places = [(1000.0 - 20.0 * k, 800.0 + 2.0 * rng.standard_normal())]
        places += rng.uniform(-400.0, 400.0, (3, 2)).tolist()
        if quay:
            places += [(500.0 + of_the_quay.uniform(0.0, 3.0), 7.0 * n) for n in range(-5, 6)]
        x, y = np.array(places).T
        yield Scan(4.0 * k, np.hypot(x, y), np.arctan2(y, x))


@pytest.mark.parametrize("method", available_methods())
def test_with_its_chart_a_quay_changes_nothing(method):
    """Every method gives, to the bit, what it gives without the echoes of the quay."""
    mask = LandMask(np.ones((100, 20)), 1.0, (490.0, -50.0, 0.0))
    one, other = (
        make_initiator(method, sensor=SENSOR, land=mask),
        make_initiator(method, sensor=SENSOR),
    )
    for with_quay, without in zip(scans(12, quay=True), scans(12, quay=False), strict=True):
        assert_same_tracks(one.process(with_quay), other.process(without))
        assert_same_tracks(one.current, other.current)
        statistics = one.statistics
        assert (statistics.detections, statistics.outside_coverage) == (4, 0)
        assert statistics.on_land == 11
    assert one.totals.on_land == 12 * 11


def test_a_hit_counts_the_scan_s_own_detections():
    """Left out or not, what is on land keeps its index."""
    mask = LandMask(np.ones((100, 20)), 1.0, (490.0, -50.0, 0.0))
    initiator = make_initiator("tsepm", sensor=SENSOR, land=mask, min_hits=3, window=4)
    tracks = []
    for scan in scans(6, quay=True):
        last = np.arange(len(scan))[::-1]
        turned = Scan(scan.stamp, scan.range[last], scan.azimuth[last])
        tracks += initiator.process(turned)
    assert {row for track in tracks for _, row in track.hits} == {14}


def test_land_beyond_the_coverage_is_outside():
    mask = LandMask(np.ones((1, 1)), 1e4, (0.0, 0.0, 0.0))
    initiator = make_initiator("score", sensor=SENSOR, land=mask)
    initiator.process(Scan(0.0, [100.0, 9000.0, 100.0], [0.5, 0.5, -0.5]))
    statistics = initiator.statistics
    assert (statistics.detections, statistics.on_land, statistics.outside_coverage) == (1, 1, 1)
