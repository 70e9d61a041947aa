"""Monte-Carlo studies: many seeded runs of one scenario, judged and recorded."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from tsepm_ros.analysis.operating_points import OperatingPoint
from tsepm_ros.analysis.pool import mapped
from tsepm_ros.analysis.run_summary import RunSummary, record
from tsepm_ros.analysis.simulated_run import simulate
from tsepm_ros.simulation import Scenario

CONNECT_TIME = 10.0
"""Time in which a scheduler must answer, s."""
BATCH_RUNS = 4
"""Runs that are handed out together: enough to outweigh the handing out."""


@dataclass(frozen=True, kw_only=True)
class Workers:
    """Who does the runs.

    Attributes
    ----------
    processes : int
        Processes on this machine; 1: this one.
    scheduler : str, optional
        Address of a `dask.distributed` scheduler whose workers do the runs instead; needs the
        extra `distributed`.
    """

    processes: int = 1
    scheduler: str | None = None


def run(scenario: Scenario, seed: list[int], point: OperatingPoint) -> RunSummary:
    """Simulate, judge and record one run."""
    return record(simulate(scenario, seed, point))


def study(
    scenario: Scenario,
    point: OperatingPoint,
    runs: Sequence[int],
    seed: int,
    workers: Workers | None = None,
) -> Iterator[RunSummary]:
    """Run a scenario many times.

    Run i is seeded with (seed, i), so the results do not depend on who does it, and all methods get
    the same scenes.

    Parameters
    ----------
    scenario : Scenario
    point : OperatingPoint
        The method and its options.
    runs : sequence of int
        Indices of the runs to do.
    seed : int
    workers : Workers, optional
        This process, if not given.

    Yields
    ------
    RunRecord
        In the order of `runs`.
    """
    workers = workers or Workers()
    batches = [
        _Batch(scenario, point, seed, runs[first : first + BATCH_RUNS])
        for first in range(0, len(runs), BATCH_RUNS)
    ]
    if workers.scheduler is not None:
        done = _distributed(batches, workers.scheduler)
    else:
        done = mapped(_run_batch, batches, workers.processes)
    for records in done:
        yield from records


@dataclass(frozen=True)
class _Batch:
    """Runs that one worker does in one go."""

    scenario: Scenario
    point: OperatingPoint
    seed: int
    runs: Sequence[int]


def _run_batch(batch: _Batch) -> list[RunSummary]:
    return [run(batch.scenario, [batch.seed, index], batch.point) for index in batch.runs]


def _distributed(batches: list[_Batch], scheduler: str) -> Iterator[list[RunSummary]]:
    """Let the workers of a scheduler do the batches; those of a lost worker are done again."""
    try:
        from distributed import Client
    except ImportError:
        raise ValueError("a scheduler needs the package distributed, which is missing") from None
    try:
        client = Client(scheduler, timeout=CONNECT_TIME)
    except OSError as error:
        raise ValueError(f"scheduler {scheduler} cannot be reached: {error}") from None
    with client:
        for future in client.map(_run_batch, batches, pure=False):
            yield future.result()
