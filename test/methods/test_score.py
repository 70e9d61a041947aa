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
"""The likelihood-ratio method: hypotheses, starts, reasons, and changed options."""

import dataclasses
import math

import numpy as np
import pytest
from support.builders import AS_GIVEN, scan_at
from support.score_scenes import NEVER, score, sea

from tsepm_ros import Scan

TARGET = (2000.0, 3.0, 1500.0, -2.0)


def scenes(seed: int = 3, scans: int = 14) -> list[Scan]:
    return sea(np.random.default_rng(seed), scans, [TARGET], density=1e-7)


def test_a_target_in_clutter_is_started_once_by_more_evidence_than_the_threshold():
    made = score(**AS_GIVEN)
    (track,) = [track for scan in scenes() for track in made.process(scan)]
    assert track.evaluation > 0.0
    assert track.score > track.evaluation
    place = np.array([2000.0 + 3.0 * track.stamp, 1500.0 - 2.0 * track.stamp])
    spread = track.covariance[np.ix_([0, 2], [0, 2])]
    off = track.state[[0, 2]] - place
    assert off @ np.linalg.solve(spread, off) < 16.0
    reason = made.reason(track)
    for part in (f"ratio {track.score:.1f}", "threshold", "1 false track per hour"):
        assert part in reason


def test_with_a_rate_of_next_to_none_nothing_is_started_but_the_evidence_grows():
    made, best = score(false_tracks_per_hour=NEVER, **AS_GIVEN), []
    for scan in scenes():
        assert len(made.process(scan)) == 0
        best.append(made.method.hypotheses.score.max())
    assert best[0] == 0.0
    assert best[-1] > 20.0


def test_every_detection_starts_a_hypothesis_and_two_hits_make_a_potential_track():
    made = score(**AS_GIVEN)
    made.process(scan_at(0.0, [(2000.0, 0.0), (-2000.0, 500.0)]))
    assert len(made.method.hypotheses) == 2
    assert len(made.potential_tracks()) == 0
    made.process(scan_at(12.0, [(2030.0, 0.0)]))
    (potential,) = made.potential_tracks()
    assert potential.hits == ((0, 0), (1, 0))
    assert potential.velocity == pytest.approx([2.5, 0.0], abs=0.2)
    assert potential.score - potential.evaluation == pytest.approx(made.method.threshold)


def test_hypotheses_end_after_the_window():
    made = score(window=3, **AS_GIVEN)
    made.process(scan_at(0.0, [(2000.0, 0.0)]))
    numbers = []
    for k in range(1, 4):
        made.process(Scan(12.0 * k, [], []))
        numbers.append(np.isfinite(made.method.hypotheses.score).sum())
    assert numbers == [1, 0, 0]
    assert made.statistics.terminated + made.totals.terminated >= 1


def test_counts_of_a_scan_add_up():
    made = score(**AS_GIVEN)
    for scan in scenes():
        made.process(scan)
        counts = made.statistics
        assert counts.evaluated >= counts.split >= counts.started == len(scan)
        left = counts.evaluated - counts.pruned - counts.cut_potential_tracks
        assert counts.potential_tracks <= left


def test_another_window_starts_over_and_another_rate_does_not():
    made = score(**AS_GIVEN)
    for scan in scenes(scans=4):
        made.process(scan)
    method, options = made.method, made.method.options
    number = len(method.hypotheses)
    strict = dataclasses.replace(options, false_tracks_per_hour=0.01)
    before = method.threshold
    assert method.configure(method.sensor, method.common, strict)
    assert len(method.hypotheses) == number
    assert method.threshold - before == pytest.approx(math.log(100.0), abs=1.0)
    shorter = dataclasses.replace(options, window=options.window - 1)
    assert not method.configure(method.sensor, method.common, shorter)
    assert len(method.hypotheses) == 0
