"""Predicted performance of a method with a sonar: P_D, confirmation time and false tracks.

The prediction runs the method itself. Each target is simulated in a patch of clutter that holds all
clutter within reach of its track. False tracks are counted in clutter alone over the coverage.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from tsepm_ros.analysis.intervals import Estimate, mean, mean_count, proportion
from tsepm_ros.analysis.operating_points import OperatingPoint
from tsepm_ros.analysis.simulated_run import simulate
from tsepm_ros.analysis.truth import Outcome
from tsepm_ros.analysis.workers import Progress, Workers, silent
from tsepm_ros.design.design_case import Case
from tsepm_ros.methods.registry import make_initiator
from tsepm_ros.sensing.conversion import major_sigma, position_covariance
from tsepm_ros.simulation import Scenario, Simulator

PATCH_SIGMAS = 4.0
SEGMENTS = 16
"""Number of runs with clutter alone."""
MAX_PLACEMENT_TRIES = 1000
ONE_PROCESS = Workers()


@dataclass(frozen=True)
class TargetStatistics:
    """Detection and confirmation time of simulated targets.

    Attributes
    ----------
    detection : Estimate
        P_D within the case's scans.
    confirmation_time : Estimate
        Mean time from the first scan to the confirmation of the targets found, s.
    slow_confirmation_time : float
        Time by which 95 % of the targets found are confirmed, s; nan if none is found.
    """

    detection: Estimate
    confirmation_time: Estimate
    slow_confirmation_time: float


def target_statistics(
    case: Case,
    method: str,
    options: dict[str, Any],
    *,
    runs: int,
    seed: int,
    workers: Workers = ONE_PROCESS,
    progress: Progress = silent,
) -> TargetStatistics:
    """Simulate targets, each in its patch of clutter, and run the method on them.

    Target i and its clutter depend on (seed, i) only.

    Parameters
    ----------
    case : Case
    method : str
    options : dict
        For `make_initiator`; a target false-track rate is that of the whole coverage.
    runs, seed : int
    workers : Workers, optional
    progress : callable, optional

    Raises
    ------
    ValueError
        If no target stays in the coverage during all scans.
    """
    jobs = []
    for index in range(runs):
        scene = _patch(case, np.random.default_rng([seed, index]))
        point = OperatingPoint(method, options=_for_patch(case, scene, options))
        jobs.append((scene, [seed, index], point))
    chunk = max(1, runs // (8 * workers.processes))
    done = progress(workers.mapped(_confirmation_time, jobs, chunk), runs)
    times = [time for time in done if time is not None]
    return TargetStatistics(
        detection=proportion(len(times), runs),
        confirmation_time=mean(times),
        slow_confirmation_time=float(np.quantile(times, 0.95)) if times else math.nan,
    )


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
        name="clutter", scans=case.scans + part, period=case.interval, sensor=case.sensor
    )
    jobs = [(scene, [seed, index], method, options, case.scans) for index in range(SEGMENTS)]
    counts = list(progress(workers.mapped(_count_false, jobs), SEGMENTS))
    return mean_count(counts).mapped(lambda count: count * case.scans_per_hour / part)


def _patch(case: Case, rng: np.random.Generator) -> Scenario:
    """A scene with a target that stays in the coverage, and the clutter about its path.

    Raises
    ------
    ValueError
        If no target stays in the coverage.
    """
    sensor = case.sensor
    times = case.interval * (np.arange(case.scans) - 0.5 * (case.scans - 1))
    for _ in range(MAX_PLACEMENT_TRIES):
        share, bearing, turn = rng.random(3)
        azimuth = sensor.azimuth_min + bearing * sensor.sector_width
        square = sensor.min_range**2 * (1.0 - share) + sensor.max_range**2 * share
        range_ = case.target_range or math.sqrt(square)
        centre = range_ * np.array([math.cos(azimuth), math.sin(azimuth)])
        heading = 2.0 * math.pi * turn
        velocity = case.target_speed * np.array([math.cos(heading), math.sin(heading)])
        x, y = (centre + times[:, None] * velocity).T
        if sensor.covers(np.hypot(x, y), np.arctan2(y, x)).all():
            half = _patch_size(case, range_)
            return Scenario(
                name="patch",
                scans=case.scans,
                period=case.interval,
                sensor=sensor,
                targets=(np.array([x[0], velocity[0], y[0], velocity[1]]),),
                clutter_box=(
                    centre[0] - half,
                    centre[0] + half,
                    centre[1] - half,
                    centre[1] + half,
                ),
            )
    raise ValueError(
        f"no target of {case.target_speed:g} m/s stays in the coverage for {case.scans} pings"
    )


def _patch_size(case: Case, range_: float) -> float:
    """Half the side of a patch, m: the target's path, its errors and the reach of clutter paths."""
    covariance = position_covariance(
        range_, 0.0, case.sensor.range_variance(range_), case.sensor.azimuth_std
    )
    path = 0.5 * case.target_speed * (case.scans - 1) * case.interval
    reach = case.max_speed * case.interval * math.sqrt(case.scans)
    return path + PATCH_SIGMAS * float(major_sigma(covariance)) + reach


def _for_patch(case: Case, scene: Scenario, options: dict[str, Any]) -> dict[str, Any]:
    """The options with the patch's share of the target false-track rate."""
    rate = options.get("false_tracks_per_hour")
    if rate is None:
        return options
    return {**options, "false_tracks_per_hour": rate * scene.area / case.sensor.coverage_area}


def _confirmation_time(job: tuple[Scenario, list[int], OperatingPoint]) -> float | None:
    """Time of the target's true start, s."""
    starts = simulate(*job).judged()
    return next((start.track.stamp for start in starts if start.outcome is Outcome.TRUE), None)


def _count_false(job: tuple[Scenario, list[int], str, dict[str, Any], int]) -> int:
    """Tracks confirmed on clutter after the first scans."""
    scene, seed, method, options, first = job
    initiator = make_initiator(method, sensor=scene.sensor, **options)
    return sum(
        len(tracks)
        for index, simulated in enumerate(Simulator(scene, seed))
        if len(tracks := initiator.process(simulated.scan)) and index >= first
    )
