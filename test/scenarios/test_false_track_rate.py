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
"""The wanted false-track rate is kept in whole scenes, by the scans as they come."""

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from support.builders import AS_GIVEN
from support.score_scenes import SONAR, clutter, score, sea

from tsepm_ros import Scan, SensorModel
from tsepm_ros.tracker.tracker import Tracker


def test_a_track_says_its_evidence_and_by_how_much_it_passed():
    initiator = score()
    for scan in sea(np.random.default_rng(1), 20, [(3000.0, 4.0, 2000.0, -3.0)]):
        for track in initiator.process(scan):
            assert track.score - track.evaluation == pytest.approx(initiator.method.threshold)
            assert track.evaluation >= 0
            return
    pytest.fail("nothing was confirmed")


def false_tracks(initiator: Tracker, scans: Iterable[Scan], learning: int = 0) -> int:
    """Tracks that clutter starts after the first scans."""
    return sum([len(initiator.process(scan)) for scan in scans][learning:])


def clutter_scans(number: int, seed: Any = 8, first: int = 0, density: float = 1e-6):
    rng = np.random.default_rng(seed)
    return (Scan(12.0 * k, *clutter(rng, density)) for k in range(first, first + number))


@pytest.mark.parametrize(
    ("before", "max_range", "scans"),
    [
        pytest.param(np.arange(50) * 12.0, 9000.0, 30, id="a quiet time before"),
        pytest.param([-3000.0], 9000.0, 30, id="one long interval before"),
        pytest.param([], 1e6, 60, id="a generous coverage"),
    ],
)
def test_clutter_is_held_against_the_wish_at_once(before, max_range, scans):
    initiator = score(SensorModel(max_range=max_range), false_tracks_per_hour=30.0)
    for stamp in before:
        initiator.process(Scan(stamp, [], []))
    found = false_tracks(initiator, clutter_scans(scans, first=50))
    assert found <= 0.3 * scans, "0.1 wished for in a scan"


@pytest.mark.long
@pytest.mark.parametrize("wish", [30.0, 300.0])
@pytest.mark.parametrize("density", [3e-7, 1e-6])
def test_the_wanted_false_track_rate_is_kept_within_a_factor_of_two(wish, density):
    # Enough scans for 60 false tracks: a true factor of 1.5 stays within 2 with 99 %.
    sensor = replace(SONAR, clutter_density=density)
    scans = round(60 / wish * 300)
    initiator = score(sensor, false_tracks_per_hour=wish, **AS_GIVEN)
    sea_scans = clutter_scans(scans + 10, [7, round(wish)], density=density)
    rate = false_tracks(initiator, sea_scans, 10) / (scans * 12.0 / 3600.0)
    assert wish / 2 < rate < 2 * wish


@pytest.mark.long
@pytest.mark.parametrize("factor", [0.1, 10.0])
def test_clutter_that_ends_inside_the_coverage_keeps_the_rate_of_a_known_density(factor):
    # The box of 6 by 6 km in 12 km; 58 false tracks are expected with the density known.
    def confirmed(given: float, clutter_is: str) -> int:
        rng = np.random.default_rng(13)
        total = 0
        for _ in range(6):
            initiator = score(
                SensorModel(max_range=12000.0, clutter_density=given),
                false_tracks_per_hour=100.0,
                clutter_density=clutter_is,
                detection_probability="given",
            )
            places = (rng.uniform(2000.0, 8000.0, (2, rng.poisson(36.0))) for _ in range(50))
            scans = (Scan.from_xy(12.0 * k, *place) for k, place in enumerate(places))
            total += false_tracks(initiator, scans, 10)
        return total

    # A true ratio of 1.4 stays below 2 with 97 %; cells that straddle the border gave 2.8.
    assert confirmed(factor * 1e-6, "estimated") < 2.0 * confirmed(1e-6, "given")
