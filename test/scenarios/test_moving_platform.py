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
"""A sonar that runs round a square finds what one that stays finds, and as well."""

import dataclasses
import functools

import numpy as np
import pytest
from support.run_summaries import study

from tsepm_ros.tools.evaluation.simulated_run import Outcome, SimulatedOperatingPoint
from tsepm_ros.tools.simulation import load_scenario
from tsepm_ros.tools.simulation.scenario import ScenarioOwnShipMotion

RUNS = 40
Z = 3.3
"""Standard errors of a difference: 99.9 %, two-sided."""

SQUARE = load_scenario("square_path", {"sensor.clutter_density": 2e-7})
FIXED = dataclasses.replace(SQUARE, own_ship=ScenarioOwnShipMotion())


@functools.cache
def figures(moving, method):
    """Share of the targets found in each run; errors, NEES and time of true, pure starts."""
    found, starts = [], []
    for run in study(SQUARE if moving else FIXED, SimulatedOperatingPoint(method), range(RUNS), 1):
        true = [start for start in run.starts if start.outcome is Outcome.TRUE]
        found.append(len(true) / run.targets)
        starts += [
            (s.position_error**2, s.velocity_error**2, s.nees, s.time) for s in true if s.pure
        ]
    return np.array(found), np.array(starts)


def assert_equal(one, other, largest):
    """Equal means at 99.9 %, of samples large enough to see a difference of `largest`."""
    error = np.sqrt(one.var(ddof=1) / len(one) + other.var(ddof=1) / len(other))
    assert Z * error < largest
    assert abs(one.mean() - other.mean()) <= Z * error


@pytest.mark.long
@pytest.mark.parametrize("method", ["score", "tsepm"])
def test_detections_and_errors_are_those_of_a_sonar_that_stays(method):
    # 160 targets; the same scenes, 40 runs, seed 1. A difference of 0.08 in P_DT would be seen, or
    # of the whole of a mean square (1.4 times the error), of the NEES or of 15 s. Starts with a
    # wrong hit are left out: their errors are of any size, whether the sonar moves or not.
    (found_moving, moving), (found_fixed, fixed) = (
        figures(moving, method) for moving in (True, False)
    )
    assert found_fixed.mean() > 0.9
    assert_equal(found_moving, found_fixed, 0.08)
    for one, other, largest in zip(moving.T, fixed.T, [*fixed.mean(axis=0)[:3], 15.0], strict=True):
        assert_equal(one, other, largest)
