"""Predicted performance of a method with a sonar: P_D, confirmation time and false tracks.

The prediction runs the method itself, on targets in scenes of `target_scenes`, and on clutter alone
over the coverage, in which false tracks are counted.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from tsepm_ros.methods.registry import make_initiator
from tsepm_ros.tools.design.design_case import Case, target_scenes
from tsepm_ros.tools.evaluation.intervals import Estimate, mean, mean_count, proportion
from tsepm_ros.tools.evaluation.simulated_run import OperatingPoint, Outcome, simulate
from tsepm_ros.tools.evaluation.workers import Workers
from tsepm_ros.tools.simulation import Scenario, Simulator
from tsepm_ros.tools.terminal import Progress, silent

SEGMENTS = 8
"""Number of runs with clutter alone."""
MIN_TARGETS = 28
"""Minimum number of simulated targets before an early end."""
ONE_PROCESS = Workers()


def never(detection: Estimate) -> bool:
    """Never end the simulation of targets early."""
    return False


@dataclass(frozen=True)
class TargetStatistics:
    """Detection and confirmation time of simulated targets.

    Attributes
    ----------
    targets : int
        Number of simulated targets.
    detection : Estimate
        P_D within the case's scans.
    confirmation_time : Estimate
        Mean time from the first scan to the confirmation of the targets found, s.
    slow_confirmation_time : float
        Time by which 95 % of the targets found are confirmed, s; nan if none is found.
    """

    targets: int
    detection: Estimate
    confirmation_time: Estimate
    slow_confirmation_time: float

    @classmethod
    def of(cls, times: list[float | None]) -> TargetStatistics:
        """Statistics of each target's time of confirmation, s, None if it is not confirmed."""
        found = [time for time in times if time is not None]
        return cls(
            targets=len(times),
            detection=proportion(len(found), len(times)),
            confirmation_time=mean(found),
            slow_confirmation_time=float(np.quantile(found, 0.95)) if found else math.nan,
        )


def target_statistics(
    case: Case,
    method: str,
    options: dict[str, Any],
    *,
    runs: int,
    seed: int,
    workers: Workers = ONE_PROCESS,
    progress: Progress = silent,
    enough: Callable[[Estimate], bool] = never,
) -> TargetStatistics:
    """Simulate targets in their scenes and run the method on them.

    The scenes depend on the case, `runs` and `seed` only: all methods get the same.

    Parameters
    ----------
    case : Case
    method : str
    options : dict
        For `make_initiator`; a target false-track rate is that of the whole coverage.
    runs : int
        Number of targets.
    seed : int
    workers : Workers, optional
    progress : callable, optional
    enough : callable, optional
        Whether P_D so far, of at least `MIN_TARGETS` targets, is known well enough.

    Raises
    ------
    ValueError
        If no target stays in the coverage during all scans.
    """
    jobs = []
    for index, scene in enumerate(target_scenes(case, runs, seed)):
        point = OperatingPoint(method, options=_for_scene(case, scene, options))
        jobs.append((scene, [seed, index], point))
    times: list[float | None] = []
    done = workers.mapped(_confirmation_times, jobs)
    for of_scene in progress(done, len(jobs)):
        times += of_scene
        found = sum(time is not None for time in times)
        if len(times) >= MIN_TARGETS and enough(proportion(found, len(times))):
            break
    done.close()
    return TargetStatistics.of(times)


def false_tracks_per_hour(
    case: Case,
    method: str,
    options: dict[str, Any],
    *,
    scans: int,
    seed: int,
    workers: Workers = ONE_PROCESS,
    progress: Progress = silent,
) -> Estimate:
    """Rate of tracks that the method confirms on clutter alone.

    Parameters
    ----------
    case : Case
    method : str
    options : dict
        For `make_initiator`.
    scans : int
        Number of scans that count, after the scans in which the potential tracks accumulate.
    seed : int
    workers : Workers, optional
    progress : callable, optional
    """
    part = math.ceil(scans / SEGMENTS)
    scene = Scenario(
        name="clutter",
        scans=case.scans + part,
        period=case.interval,
        sensor=case.sensor,
        clutter_strength=case.clutter_strength,
    )
    jobs = [(scene, [seed, index], method, options, case.scans) for index in range(SEGMENTS)]
    counts = list(progress(workers.mapped(_count_false, jobs), SEGMENTS))
    return mean_count(counts).mapped(lambda count: count * case.scans_per_hour / part)


def _for_scene(case: Case, scene: Scenario, options: dict[str, Any]) -> dict[str, Any]:
    """The options with the scene's share of the target false-track rate."""
    rate = options.get("false_tracks_per_hour")
    if rate is None:
        return options
    return {**options, "false_tracks_per_hour": rate * scene.area / case.sensor.coverage_area}


def _confirmation_times(job: tuple[Scenario, list[int], OperatingPoint]) -> list[float | None]:
    """Time of each target's true start, s."""
    times: list[float | None] = [None] * len(job[0].targets)
    for start in simulate(*job).judged():
        if start.outcome is Outcome.TRUE:
            times[start.target] = start.track.stamp
    return times


def _count_false(job: tuple[Scenario, list[int], str, dict[str, Any], int]) -> int:
    """Tracks confirmed on clutter after the first scans."""
    scene, seed, method, options, first = job
    initiator = make_initiator(method, sensor=scene.sensor, **options)
    return sum(
        len(tracks)
        for index, simulated in enumerate(Simulator(scene, seed))
        if len(tracks := initiator.process(simulated.scan)) and index >= first
    )
