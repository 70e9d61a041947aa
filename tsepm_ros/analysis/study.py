"""Monte-Carlo studies: many seeded runs of one scenario, judged and summed up."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.analysis.intervals import Estimate, mean, proportion
from tsepm_ros.analysis.truth import Judged, Outcome, judge
from tsepm_ros.methods import make_initiator
from tsepm_ros.own_ship import echo_poses
from tsepm_ros.scan import Scan
from tsepm_ros.simulation import Scenario, Simulator
from tsepm_ros.simulation.scenario import OwnShipMotion
from tsepm_ros.track import ConfirmedTrack

FloatArray = NDArray[np.float64]

CONNECT_TIME = 10.0
"""Time in which a scheduler must answer, s."""
BATCH_RUNS = 4
"""Runs that are handed out together: enough to outweigh the handing out."""


@dataclass(frozen=True)
class RunResult:
    """Counts of one run.

    Attributes
    ----------
    targets : int
        Targets in the scene.
    outcomes : mapping of Outcome to int
        Confirmed tracks by what they are.
    nees, position_errors, velocity_errors : list of float
        Of the true tracks.
    confirmation_times : list of float
        Time from the first scan to confirmation, s, of the true tracks.
    """

    targets: int
    outcomes: Counter[Outcome]
    nees: list[float]
    position_errors: list[float]
    velocity_errors: list[float]
    confirmation_times: list[float]


@dataclass(frozen=True)
class StudyResult:
    """Figures of a study, each with its 95 % interval.

    Attributes
    ----------
    runs : int
    detection : Estimate
        P_D: share of (run, target) pairs with a true track by the end of the run.
    false_per_run : Estimate
        False and misplaced tracks per run.
    false_density : Estimate
        The same per scan and km^2 of coverage.
    redundant_per_run : Estimate
    nees : Estimate
        Mean over the true tracks; 4 is ideal.
    position_error, velocity_error : Estimate
        Root mean square over the true tracks, m and m/s.
    confirmation_time : Estimate
        Mean time from the first scan to the true start, s.
    """

    runs: int
    detection: Estimate
    false_per_run: Estimate
    false_density: Estimate
    redundant_per_run: Estimate
    nees: Estimate
    position_error: Estimate
    velocity_error: Estimate
    confirmation_time: Estimate


def placed(scan: Scan, own_ship: OwnShipMotion) -> Scan:
    """A simulated scan with the poses that place its echoes, from the exact own-ship motion."""

    def poses_at(times: FloatArray) -> FloatArray:
        return np.array([own_ship.pose(time) for time in times]).reshape(-1, 3)

    pose = echo_poses(poses_at, scan.stamp, scan.time_offset, scan.azimuth)
    return dataclasses.replace(scan, sensor_pose=pose)


def judge_run(
    scenario: Scenario, seed: list[int], method: str, options: dict[str, Any]
) -> list[Judged]:
    """Simulate one run, initiate tracks on it and judge them."""
    simulator = Simulator(scenario, seed)
    initiator = make_initiator(method, sensor=scenario.sensor, **options)
    tracks: list[ConfirmedTrack] = []
    origins = []
    for simulated in simulator:
        origins.append(simulated.origin)
        tracks.extend(initiator.process(placed(simulated.scan, scenario.own_ship)))
    return judge(
        tracks,
        origins,
        simulator.truth,
        scenario.sensor,
        lambda stamp: scenario.own_ship.pose(stamp)[:2],
    )


def run(scenario: Scenario, seed: list[int], method: str, options: dict[str, Any]) -> RunResult:
    """Simulate and count one run."""
    judged = judge_run(scenario, seed, method, options)
    true = [one for one in judged if one.outcome is Outcome.TRUE]
    return RunResult(
        targets=len(scenario.targets) + sum(area.count for area in scenario.areas),
        outcomes=Counter(one.outcome for one in judged),
        nees=[one.nees for one in true],
        position_errors=[one.position_error for one in true],
        velocity_errors=[one.velocity_error for one in true],
        confirmation_times=[one.track.stamp for one in true],
    )


def study(
    scenario: Scenario,
    method: str,
    options: dict[str, Any],
    *,
    runs: int,
    seed: int,
    workers: int = 1,
    scheduler: str | None = None,
) -> Iterator[RunResult]:
    """Run a scenario many times.

    Run i is seeded with (seed, i), so the results do not depend on who does it.

    Parameters
    ----------
    scenario : Scenario
    method : str
    options : dict
        The method's options for `make_initiator`.
    runs, seed : int
    workers : int
        Processes on this machine; 1: this one.
    scheduler : str, optional
        Address of a `dask.distributed` scheduler whose workers do the runs instead; needs the
        extra `distributed`.

    Yields
    ------
    RunResult
        In order of the runs.
    """
    batches = [
        _Batch(scenario, method, options, seed, range(first, min(first + BATCH_RUNS, runs)))
        for first in range(0, runs, BATCH_RUNS)
    ]
    if scheduler is not None:
        done = _distributed(batches, scheduler)
    elif workers > 1:
        done = _pooled(batches, workers)
    else:
        done = map(_run_batch, batches)
    for results in done:
        yield from results


@dataclass(frozen=True)
class _Batch:
    """Runs that one worker does in one go."""

    scenario: Scenario
    method: str
    options: dict[str, Any]
    seed: int
    indices: range


def _run_batch(batch: _Batch) -> list[RunResult]:
    return [
        run(batch.scenario, [batch.seed, index], batch.method, batch.options)
        for index in batch.indices
    ]


def _pooled(batches: list[_Batch], workers: int) -> Iterator[list[RunResult]]:
    with ProcessPoolExecutor(workers) as pool:
        yield from pool.map(_run_batch, batches)


def _distributed(batches: list[_Batch], scheduler: str) -> Iterator[list[RunResult]]:
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


def summary(scenario: Scenario, results: Iterable[RunResult]) -> StudyResult:
    """Sum up the runs of a study."""
    results = list(results)
    false = [
        result.outcomes[Outcome.FALSE] + result.outcomes[Outcome.MISPLACED] for result in results
    ]
    per_run = mean(false)
    unit = scenario.scans * scenario.area / 1e6
    return StudyResult(
        runs=len(results),
        detection=proportion(
            sum(result.outcomes[Outcome.TRUE] for result in results),
            sum(result.targets for result in results),
        ),
        false_per_run=per_run,
        false_density=Estimate(per_run.value / unit, per_run.low / unit, per_run.high / unit),
        redundant_per_run=mean([result.outcomes[Outcome.REDUNDANT] for result in results]),
        nees=mean(_all(result.nees for result in results)),
        position_error=_root_mean_square(result.position_errors for result in results),
        velocity_error=_root_mean_square(result.velocity_errors for result in results),
        confirmation_time=mean(_all(result.confirmation_times for result in results)),
    )


def _all(lists: Iterable[list[float]]) -> list[float]:
    return [value for values in lists for value in values]


def _root_mean_square(lists: Iterable[list[float]]) -> Estimate:
    square = mean(np.square(_all(lists)))
    return Estimate(*(float(np.sqrt(max(v, 0.0))) for v in dataclasses.astuple(square)))
