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
"""Summaries of runs for the tests, invented and of many runs of a scenario."""

import dataclasses
import math
from collections.abc import Iterable, Iterator, Sequence

from tsepm_ros.tools.evaluation.measures import (
    RunMeasures,
    ScanSummary,
    StartSummary,
    summarise_measures,
)
from tsepm_ros.tools.evaluation.performance import Job
from tsepm_ros.tools.evaluation.result_files import mapped_results
from tsepm_ros.tools.evaluation.simulated_run import (
    Outcome,
    SimulatedOperatingPoint,
    simulate_run,
)
from tsepm_ros.tools.simulation import Scenario

NOTHING = ScanSummary(false=0, held=0)


def start(scan: int, outcome: Outcome = Outcome.TRUE, **more) -> StartSummary:
    """A pure start with 12 s between scans and errors as large as their bounds."""
    summary = StartSummary(scan, 12.0 * scan, outcome, True, 30.0, 2.0, 4.0, 30.0, 2.0)
    if not more.get("pure", True):
        more = {"position_bound": math.nan, "velocity_bound": math.nan, **more}
    return dataclasses.replace(summary, **more)


def run_of(*starts: StartSummary, false=(0, 0, 0, 0), targets: int = 1, **more) -> RunMeasures:
    """A run with so many false starts per scan."""
    scans = tuple(dataclasses.replace(NOTHING, false=number, **more) for number in false)
    return RunMeasures(targets, starts, scans)


def as_json(summaries: Iterable[RunMeasures]) -> list[dict]:
    """The summaries as JSON for comparison, since nan is not equal to itself."""
    return [summary.as_json() for summary in summaries]


def performance_run(job: Job) -> RunMeasures:
    """Simulate and summarise one run."""
    return summarise_measures(simulate_run(*job))


def study(
    scenario: Scenario,
    point: SimulatedOperatingPoint,
    runs: Sequence[int],
    seed: int,
    processes: int = 1,
) -> Iterator[RunMeasures]:
    """Runs of a scenario, run i seeded with (seed, i)."""
    return mapped_results(
        performance_run, [(scenario, [seed, index], point) for index in runs], processes
    )
