"""Monte-Carlo studies: summaries of many seeded runs of a scenario."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from tsepm_ros.analysis.operating_points import OperatingPoint
from tsepm_ros.analysis.run_summary import RunSummary, summarise
from tsepm_ros.analysis.simulated_run import simulate
from tsepm_ros.analysis.workers import Workers
from tsepm_ros.simulation import Scenario

CHUNK = 4
"""Runs per message to a worker, to reduce the cost of messages."""

Job = tuple[Scenario, list[int], OperatingPoint]
"""A run: its scenario, its seed, and the operating point of the track starter."""


def run(job: Job) -> RunSummary:
    """Simulate and summarise one run."""
    return summarise(simulate(*job))


def runs_of(jobs: Sequence[Job], workers: Workers | None = None) -> Iterator[RunSummary]:
    """Do runs in their order, in this process if no workers are given."""
    return (workers or Workers()).mapped(run, jobs, CHUNK)


def study(
    scenario: Scenario,
    point: OperatingPoint,
    runs: Sequence[int],
    seed: int,
    workers: Workers | None = None,
) -> Iterator[RunSummary]:
    """Run a scenario many times.

    Run i is seeded with (seed, i), so the results do not depend on the worker, and all methods get
    the same scenes.

    Parameters
    ----------
    scenario : Scenario
    point : OperatingPoint
        The method and its options.
    runs : sequence of int
        Indices of the runs.
    seed : int
    workers : Workers, optional
        This process if not given.

    Yields
    ------
    RunSummary
        In the order of `runs`.
    """
    return runs_of([(scenario, [seed, index], point) for index in runs], workers)
