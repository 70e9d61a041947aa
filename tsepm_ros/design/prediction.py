"""What a method will do with a sonar: how many targets it finds, how soon, and what it makes up.

The method itself is run. Targets are each simulated in a patch of their own clutter, which is all
of it that can meet them; what clutter alone confirms is counted over the whole coverage.
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
"""Runs into which the time without a target is divided."""
PLACEMENT_TRIES = 1000
ONE_PROCESS = Workers()


@dataclass(frozen=True)
class Found:
    """What becomes of the targets.

    Attributes
    ----------
    detection : Estimate
        P_D within the case's scans.
    confirmation_time : Estimate
        Mean time from the first scan to confirmation of those found, s.
    slow_confirmation_time : float
        95 % of those found are confirmed by then, s; nan if none is.
    """

    detection: Estimate
    confirmation_time: Estimate
    slow_confirmation_time: float


def targets_found(
    case: Case,
    method: str,
    options: dict[str, Any],
    *,
    runs: int,
    seed: int,
    workers: Workers = ONE_PROCESS,
    progress: Progress = silent,
) -> Found:
    """Simulate targets, each in its patch of clutter, and run the method on them.

    Target i and its clutter depend on (seed, i) only.

    Parameters
    ----------
    case : Case
    method : str
    options : dict
        For `make_initiator`; a wanted number of false tracks is of the whole coverage.
    runs, seed : int
    workers : Workers, optional
    progress : callable, optional

    Raises
    ------
    ValueError
        If no target stays in the coverage so long.
    """
    jobs = []
    for index in range(runs):
        scene = _patch(case, np.random.default_rng([seed, index]))
        point = OperatingPoint(method, options=_for_patch(case, scene, options))
        jobs.append((scene, [seed, index], point))
    chunk = max(1, runs // (8 * workers.processes))
    done = progress(workers.mapped(_time_found, jobs, chunk), runs)
    times = [time for time in done if time is not None]
    return Found(
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
    """Run the method on clutter alone and count what it confirms.

    Parameters
    ----------
    case : Case
    method : str
    options : dict
        For `make_initiator`.
    scans : int
        Scans counted, after those in which the potential tracks gather.
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
    """A scene with a target that stays in the coverage, anywhere, and the clutter around its way.

    Raises
    ------
    ValueError
        If none was found.
    """
    sensor = case.sensor
    times = case.interval * (np.arange(case.scans) - 0.5 * (case.scans - 1))
    for _ in range(PLACEMENT_TRIES):
        share, bearing, turn = rng.random(3)
        azimuth = sensor.azimuth_min + bearing * sensor.sector_width
        range_ = math.sqrt(sensor.min_range**2 * (1.0 - share) + sensor.max_range**2 * share)
        if case.target_range is not None:
            range_ = case.target_range
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
        f"no target of {case.target_speed:g} m/s was found that stays in the coverage for "
        f"{case.scans} pings"
    )


def _patch_size(case: Case, range_: float) -> float:
    """Half the side of a patch, m: the target's way, its errors, and what clutter paths reach."""
    covariance = position_covariance(
        range_, 0.0, case.sensor.range_variance(range_), case.sensor.azimuth_std
    )
    way = 0.5 * case.target_speed * (case.scans - 1) * case.interval
    reach = case.max_speed * case.interval * math.sqrt(case.scans)
    return way + PATCH_SIGMAS * float(major_sigma(covariance)) + reach


def _for_patch(case: Case, scene: Scenario, options: dict[str, Any]) -> dict[str, Any]:
    """The options with the patch's share of the wanted false tracks."""
    wish = options.get("false_tracks_per_hour")
    if wish is None:
        return options
    return {**options, "false_tracks_per_hour": wish * scene.area / case.sensor.coverage_area}


def _time_found(job: tuple[Scenario, list[int], OperatingPoint]) -> float | None:
    """Time of the target's true start, s."""
    judged = simulate(*job).judged()
    return next((one.track.stamp for one in judged if one.outcome is Outcome.TRUE), None)


def _count_false(job: tuple[Scenario, list[int], str, dict[str, Any], int]) -> int:
    """Tracks confirmed on clutter after the first scans."""
    scene, seed, method, options, first = job
    initiator = make_initiator(method, sensor=scene.sensor, **options)
    return sum(
        len(tracks)
        for index, simulated in enumerate(Simulator(scene, seed))
        if len(tracks := initiator.process(simulated.scan)) and index >= first
    )
