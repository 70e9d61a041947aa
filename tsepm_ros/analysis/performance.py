"""Evaluation of methods: all operating points on all scenarios, with the runs kept in files."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tsepm_ros.analysis.measures import Measures, measures_of
from tsepm_ros.analysis.operating_curve import Comparison, compare
from tsepm_ros.analysis.operating_points import OperatingPoint
from tsepm_ros.analysis.run_files import RunFile, complete
from tsepm_ros.analysis.run_summary import RunSummary
from tsepm_ros.analysis.study import runs_of
from tsepm_ros.analysis.workers import Workers
from tsepm_ros.progress import Progress, silent
from tsepm_ros.simulation import Scenario


@dataclass(frozen=True, kw_only=True)
class Plan:
    """Scenarios, operating points and runs of an evaluation.

    Attributes
    ----------
    scenarios : sequence of Scenario
    points : sequence of OperatingPoint
    runs, seed : int
    horizons : sequence of int
        Numbers of scans after which measures are given, besides all scans.

    Raises
    ------
    ValueError
        If a horizon is beyond a scenario's scans, or two scenarios or points have the same name.
    """

    scenarios: Sequence[Scenario]
    points: Sequence[OperatingPoint]
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

    def horizons_of(self, scenario: Scenario) -> list[int]:
        """Numbers of scans for which a scenario's measures are given, ascending."""
        return sorted({*self.horizons, scenario.scans})


@dataclass(frozen=True)
class Evaluated:
    """Measures and comparisons of a scenario's points after a number of scans.

    Attributes
    ----------
    scenario : Scenario
    scans : int
    points : list of OperatingPoint
    measures : list of Measures
        Of each point.
    comparisons : list of Comparison
        Of each point with the other methods' curves.
    """

    scenario: Scenario
    scans: int
    points: Sequence[OperatingPoint]
    measures: list[Measures]
    comparisons: list[Comparison]


def evaluate(
    plan: Plan,
    folder: Path,
    workers: Workers | None = None,
    progress: Progress = silent,
) -> list[Evaluated]:
    """Do the runs missing in the folder's files, and compute measures and comparisons.

    Parameters
    ----------
    plan : Plan
    folder : Path
        Folder of the files of runs.
    workers : Workers, optional
        This process if not given.
    progress : callable, optional
        Shows the number of missing runs that are done.

    Returns
    -------
    list of Evaluated
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
    files = [run_file(folder, *task, plan.seed) for task in tasks]

    def results_of(missing: list[tuple[int, int]]) -> Iterator[dict[str, Any]]:
        jobs = [(tasks[k][0], [plan.seed, index], tasks[k][1]) for k, index in missing]
        return (summary.as_json() for summary in runs_of(jobs, workers))

    complete(files, plan.runs, results_of, progress)
    runs = [
        [RunSummary.from_json(file.results[index]) for index in range(plan.runs)] for file in files
    ]
    count = len(plan.points)
    return [
        _evaluated(scenario, scans, plan.points, runs[place * count : (place + 1) * count])
        for place, scenario in enumerate(plan.scenarios)
        for scans in plan.horizons_of(scenario)
    ]


def run_file(folder: Path, scenario: Scenario, point: OperatingPoint, seed: int) -> RunFile:
    """The file of an operating point's runs on a scenario."""
    header = {
        "version": point.version,
        "method": point.method,
        "options": dict(point.options),
        "scenario": dataclasses.asdict(scenario),
        "seed": seed,
    }
    return RunFile(folder, (scenario.name, point.method, point.label), header)


def _evaluated(
    scenario: Scenario,
    scans: int,
    points: Sequence[OperatingPoint],
    runs: Sequence[Sequence[RunSummary]],
) -> Evaluated:
    runs = [[summary.first(scans) for summary in summaries] for summaries in runs]
    names = [(point.method, point.label) for point in points]
    return Evaluated(
        scenario,
        scans,
        points,
        [measures_of(scenario, summaries, scans) for summaries in runs],
        compare(dict(zip(names, runs, strict=True))),
    )
