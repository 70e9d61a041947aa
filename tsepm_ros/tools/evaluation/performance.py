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
"""Evaluation of methods: all operating points on all scenarios, with the runs kept in files.

Tables are in Markdown, in CSV, and short for the terminal.
"""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.tools.evaluation.intervals import IntervalEstimate
from tsepm_ros.tools.evaluation.measures import (
    HEADINGS,
    Measures,
    RunMeasures,
    measures_of,
    summarise_measures,
)
from tsepm_ros.tools.evaluation.result_files import ResultRunFile, complete_result_files
from tsepm_ros.tools.evaluation.simulated_run import SimulatedOperatingPoint, simulate_run
from tsepm_ros.tools.simulation import Scenario
from tsepm_ros.tools.terminal import Progress, silent_terminal, terminal_markdown_table

MIN_FALSE_STARTS = 0.5
"""Minimum of a point's false starts over all runs; it avoids the logarithm of 0."""
SHORT = {
    "found": "P_DT",
    "found_by_position": "by position",
    "false_per_run": "false/run",
    "false_per_hour": "false/h",
    "held": "held",
    "confirmation_median": "median s",
    "pure_nees": "NEES pure",
    "nees": "NEES true",
    "ospa": "OSPA m",
    "gospa": "GOSPA m",
    "mota": "MOTA",
    "switches_per_run": "switches/run",
}
"""Measures of the terminal's table, with their headings."""
NOTES = """\
Every method got the same scenes: run i is seeded with (seed, i). Intervals are 95 %.

- *P_DT*, targets found: share of (run, target) pairs with a true start by the end. \
More than half of a true \
start's hits are from the target, and it is within 3 sigma of the measurement error's larger axis.
- *P_DT by position*: share of pairs with a start within 3 sigma of the target, whatever its hits.
- *P_DT with corrections*: share of pairs with a true start, or a track that a later start made \
true. All other figures are of starts as first published (revision 0).
- *false + misplaced*: starts without a target that gave more than half of the hits, and starts \
farther from it. *redundant*: another true start of a target.
- *targets held at the end*: with a confirmed track within 3 sigma, whatever its hits.
- *pure starts*: all hits from one target, redundant starts excluded, misplaced starts included. \
Their errors are divided by the root mean square of the Cramer-Rao bounds for their own hits. The \
ratio may be below 1 for a method that selects hits by their fit or uses a speed limit.
- *NEES*: 4 is ideal; a larger value means an over-confident covariance.
- *OSPA*, *GOSPA*, *MOTA*, *MOTP* and *identity switches* are of the confirmed tracks after each \
scan, by their positions. Cutoff and gate: 3 sigma of the measurement error's larger axis. p is 2, \
alpha of GOSPA 2; the squares of its parts add up to its square.
"""


@dataclass(frozen=True)
class PerformanceCurve:
    """Best P_DT of a method's points against their false starts.

    Attributes
    ----------
    log_false : (n,) ndarray
        Logarithm of the false starts per run, ascending.
    found : (n,) ndarray
        P_DT, ascending. Points with more false starts and no higher P_DT are left out.
    """

    log_false: FloatArray
    found: FloatArray

    @classmethod
    def of(cls, false: FloatArray, found: FloatArray) -> PerformanceCurve:
        """The curve of points, (n,) false starts per run and (n,) P_DT."""
        order = np.lexsort((-found, false))
        best = np.maximum.accumulate(found[order])
        kept = np.diff(best, prepend=-np.inf) > 0.0
        return cls(np.log(false[order][kept]), best[kept])


Job = tuple[Scenario, list[int], SimulatedOperatingPoint]
"""A run: its scenario, its seed, and the operating point of the track starter."""


def _performance_record(job: Job) -> dict[str, Any]:
    """Simulate and summarise one run."""
    return summarise_measures(simulate_run(*job)).as_json()


@dataclass(frozen=True, kw_only=True)
class PerformancePlan:
    """Scenarios, operating points and runs of an evaluation.

    Attributes
    ----------
    scenarios : sequence of Scenario
    points : sequence of SimulatedOperatingPoint
    runs, seed : int
    horizons : sequence of int
        Numbers of scans after which measures are given, besides all scans.

    Raises
    ------
    ValueError
        If a horizon is beyond a scenario's scans, or two scenarios or points have the same name.
    """

    scenarios: Sequence[Scenario]
    points: Sequence[SimulatedOperatingPoint]
    runs: int
    seed: int = 1
    horizons: Sequence[int] = ()

    def __post_init__(self) -> None:
        names = [scenario.name for scenario in self.scenarios]
        labels = [f"{point.method} {point.label}" for point in self.points]
        for name in (*names, *labels):
            if (*names, *labels).count(name) > 1:
                raise ValueError(f"{name} is given twice: names in tables must be different")
        for scenario in self.scenarios:
            if max(self.horizons, default=1) > scenario.scans:
                raise ValueError(
                    f"horizon {max(self.horizons)} is beyond the {scenario.scans} scans of "
                    f"{scenario.name}"
                )


@dataclass(frozen=True)
class PerformanceEvaluated:
    """Runs and measures of a scenario's points after a number of scans.

    Attributes
    ----------
    scenario : Scenario
    scans : int
    points : list of SimulatedOperatingPoint
    runs : list of list of RunMeasures
        Of each point.
    measures : list of Measures
        Of each point.
    """

    scenario: Scenario
    scans: int
    points: Sequence[SimulatedOperatingPoint]
    runs: Sequence[Sequence[RunMeasures]]
    measures: list[Measures]

    @classmethod
    def of(
        cls,
        scenario: Scenario,
        scans: int,
        points: Sequence[SimulatedOperatingPoint],
        runs: Sequence[Sequence[RunMeasures]],
    ) -> PerformanceEvaluated:
        """Measures of each point's runs, as they are after a number of scans."""
        runs = [[summary.first(scans) for summary in summaries] for summaries in runs]
        measures = [
            measures_of(scenario, summaries, scans, point.measures)
            for point, summaries in zip(points, runs, strict=True)
        ]
        return cls(scenario, scans, points, runs, measures)


def evaluate_performance(
    plan: PerformancePlan,
    folder: Path,
    processes: int | Executor = 1,
    progress: Progress = silent_terminal,
    report: Callable[[PerformanceEvaluated], None] = lambda evaluated: None,
) -> list[PerformanceEvaluated]:
    """Do the runs missing in the folder's files, and compute measures.

    Parameters
    ----------
    plan : PerformancePlan
    folder : Path
        Folder of the files of runs.
    processes : int or Executor, optional
        See `mapped_results`.
    progress : callable, optional
        Shows the number of missing runs that are done.
    report : callable, optional
        Called with each point on each scenario, after all its scans, as soon as its runs are done.

    Returns
    -------
    list of PerformanceEvaluated
        Per scenario and horizon.

    Raises
    ------
    ValueError
        If a method refuses its options, or a file's header is not that of its name. No run is done
        then.
    """
    tasks = [(scenario, point) for scenario in plan.scenarios for point in plan.points]
    for scenario, point in tasks:
        point.make(scenario)
    files = [performance_run_file(folder, *task, plan.seed) for task in tasks]

    def job_of(task: int, index: int) -> Job:
        scenario, point = tasks[task]
        return scenario, [plan.seed, index], point

    runs: list[list[RunMeasures]] = []
    stored = complete_result_files(
        files, plan.runs, _performance_record, job_of, processes=processes, progress=progress
    )
    for (scenario, point), records in zip(tasks, stored, strict=True):
        runs.append([*map(RunMeasures.from_json, records)])
        report(PerformanceEvaluated.of(scenario, scenario.scans, [point], runs[-1:]))
    count = len(plan.points)
    return [
        PerformanceEvaluated.of(
            scenario, scans, plan.points, runs[place * count : (place + 1) * count]
        )
        for place, scenario in enumerate(plan.scenarios)
        for scans in sorted({*plan.horizons, scenario.scans})
    ]


def performance_run_file(
    folder: Path, scenario: Scenario, point: SimulatedOperatingPoint, seed: int
) -> ResultRunFile:
    """The file of an operating point's runs on a scenario."""
    header = {
        "measures": list(point.measures),
        "version": point.version,
        "code": point.code,
        "method": point.method,
        "options": dict(point.options),
        "scenario": asdict(scenario),
        "seed": seed,
    }
    return ResultRunFile(folder, (scenario.name, point.method, point.label), header)


def performance_markdown(
    plan: PerformancePlan, evaluated: Sequence[PerformanceEvaluated], command: str
) -> str:
    """The whole report.

    Parameters
    ----------
    plan : PerformancePlan
    evaluated : sequence of PerformanceEvaluated
    command : str
        The command that repeats the evaluation.
    """
    parts = [
        "# Evaluation of track initiation\n",
        f"```\n{command}\n```\n",
        f"{plan.runs} runs of each point on each scenario, seed {plan.seed}. {NOTES}",
    ]
    headings = _performance_headings(evaluated, HEADINGS)
    for result in evaluated:
        rows = [
            [point.method, point.label, *_performance_texts(measures, headings)]
            for point, measures in zip(result.points, result.measures, strict=True)
        ]
        table = terminal_markdown_table(["method", "point", *headings.values()], rows)
        parts.append(f"## {result.scenario.name}, {result.scans} scans\n\n{table}\n")
    return "\n".join(parts)


def _performance_headings(
    evaluated: Sequence[PerformanceEvaluated], known: Mapping[str, str]
) -> dict[str, str]:
    """Headings of measures of the package, and of those from outside, which are their names."""
    outside = {
        n: n for result in evaluated for measures in result.measures for n in measures.outside
    }
    return {**known, **outside}


def _performance_texts(
    measures: Measures, names: Iterable[str], *, interval: bool = True
) -> list[str]:
    """Measures as texts; a dash for a measure from outside that a point does not have."""
    return [
        measures.text(name, interval=interval)
        if name in HEADINGS or name in measures.outside
        else "-"
        for name in names
    ]


def write_performance_csv(
    plan: PerformancePlan, evaluated: Sequence[PerformanceEvaluated], file: TextIO
) -> None:
    """Write a row per scenario, horizon and point, each measure with low and high."""
    writer = csv.writer(file, lineterminator="\n")
    known = _performance_headings(evaluated, HEADINGS)
    names = [f"{name}{end}" for name in known for end in ("", "_low", "_high")]
    writer.writerow(["scenario", "scans", "runs", "seed", "method", "point", "options", *names])
    for row in performance_rows(evaluated):
        which = [row["scenario"], row["scans"], plan.runs, plan.seed, row["method"], row["point"]]
        cells = [end for name in known for end in row.get(name, (None, None, None))]
        numbers = ["nan" if end is None else end for end in cells]
        writer.writerow([*which, json.dumps(row["options"]), *numbers])


def performance_rows(evaluated: Sequence[PerformanceEvaluated]) -> list[dict[str, Any]]:
    """A row per scenario, horizon and point: each measure as value, low and high; None for nan."""
    return [
        {
            "scenario": result.scenario.name,
            "scans": result.scans,
            "method": point.method,
            "point": point.label,
            "options": dict(point.options),
            **{
                name: _performance_values(measures.estimate(name))
                for name in (*HEADINGS, *measures.outside)
            },
        }
        for result in evaluated
        for point, measures in zip(result.points, result.measures, strict=True)
    ]


def _performance_values(estimate: IntervalEstimate) -> list[float | None]:
    """Value, low and high with six digits; None for nan."""
    values = (estimate.value, estimate.low, estimate.high)
    return [None if math.isnan(value) else float(f"{value:.6g}") for value in values]


def performance_table(
    evaluated: Sequence[PerformanceEvaluated], *, interval: bool = True
) -> tuple[list[str], list[list[str]]]:
    """Header and rows of one table with the measures of `SHORT`."""
    headings = _performance_headings(evaluated, SHORT)
    header = ["scenario", "pings", "method", *headings.values()]
    rows = [
        [
            result.scenario.name,
            str(result.scans),
            f"{point.method} {point.label}",
            *_performance_texts(measures, headings, interval=interval),
        ]
        for result in evaluated
        for point, measures in zip(result.points, result.measures, strict=True)
    ]
    return header, rows
