"""Evaluating methods: every operating point on every scenario, kept in files, then summed up."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tsepm_ros.analysis.measures import Measures, measures_of
from tsepm_ros.analysis.operating_curve import Comparison, compare
from tsepm_ros.analysis.operating_points import OperatingPoint
from tsepm_ros.analysis.run_summary import RunSummary
from tsepm_ros.analysis.study import Workers, study
from tsepm_ros.analysis.summary_files import SummaryFile
from tsepm_ros.simulation import Scenario

Progress = Callable[[Iterable[None], int], Iterable[Any]]
"""Passes an iterable through, given its length, and shows how far it is."""


@dataclass(frozen=True, kw_only=True)
class Plan:
    """What is evaluated.

    Attributes
    ----------
    scenarios : sequence of Scenario
    points : sequence of OperatingPoint
    runs, seed : int
    horizons : sequence of int
        Scans after which figures are given, as well as after all.

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
                raise ValueError(f"{name} is there twice: tables could not tell them apart")
        for scenario in self.scenarios:
            if max(self.horizons, default=1) > scenario.scans:
                raise ValueError(
                    f"horizon {max(self.horizons)} is beyond the {scenario.scans} scans of "
                    f"{scenario.name}"
                )

    def horizons_of(self, scenario: Scenario) -> list[int]:
        """Numbers of scans for which a scenario's figures are given, ascending."""
        return sorted({*self.horizons, scenario.scans})


@dataclass(frozen=True)
class Evaluated:
    """A scenario's runs, after some of its scans.

    Attributes
    ----------
    scenario : Scenario
    scans : int
    points : list of OperatingPoint
    figures : list of Figures
        A point's each.
    comparisons : list of Comparison
        Of each point with the other methods.
    """

    scenario: Scenario
    scans: int
    points: Sequence[OperatingPoint]
    figures: list[Measures]
    comparisons: list[Comparison]


def evaluate(
    plan: Plan,
    folder: Path,
    workers: Workers | None = None,
    progress: Progress = lambda runs, total: runs,
) -> list[Evaluated]:
    """Do the runs that are not in the folder's files yet, and sum up.

    Parameters
    ----------
    plan : Plan
    folder : Path
        Where the runs are kept.
    workers : Workers, optional
        Who does them; this process, if not given.
    progress : callable, optional
        Shows how many of the missing runs are done.

    Returns
    -------
    list of Evaluated
        Per scenario and horizon.

    Raises
    ------
    ValueError
        If a method refuses its options, or a file does not belong to what it is named after; no
        run has been done then.
    """
    for scenario in plan.scenarios:
        for point in plan.points:
            point.make(scenario)
    tasks = [
        _Task(scenario, point, SummaryFile(folder, scenario, point, plan.seed), plan)
        for scenario in plan.scenarios
        for point in plan.points
    ]
    missing = sum(len(task.missing) for task in tasks)
    for _ in progress(_do(tasks, workers), missing):
        pass
    return [
        _evaluated(scenario, scans, [task for task in tasks if task.scenario is scenario])
        for scenario in plan.scenarios
        for scans in plan.horizons_of(scenario)
    ]


@dataclass(frozen=True)
class _Task:
    """A point on a scenario."""

    scenario: Scenario
    point: OperatingPoint
    file: SummaryFile
    plan: Plan

    @property
    def missing(self) -> list[int]:
        """Runs that the file does not have."""
        return [index for index in range(self.plan.runs) if index not in self.file.records]

    def after(self, scans: int) -> list[RunSummary]:
        """The runs, had they ended after so many scans."""
        return [self.file.records[index].first(scans) for index in range(self.plan.runs)]


def _do(tasks: Iterable[_Task], workers: Workers | None) -> Iterator[None]:
    for task in tasks:
        missing = task.missing
        records = study(task.scenario, task.point, missing, task.plan.seed, workers)
        with task.file:
            for index, record in zip(missing, records, strict=True):
                task.file.append(index, record)
                yield


def _evaluated(scenario: Scenario, scans: int, tasks: Sequence[_Task]) -> Evaluated:
    records = [task.after(scans) for task in tasks]
    points = [task.point for task in tasks]
    names = [(point.method, point.label) for point in points]
    return Evaluated(
        scenario,
        scans,
        points,
        [measures_of(scenario, runs, scans) for runs in records],
        compare(dict(zip(names, records, strict=True))),
    )
