"""Predicted performance of a method with a sonar: P_D, confirmation time and false tracks.

The prediction runs the method itself, on targets in scenes of `target_scenes`, and on clutter alone
over the coverage, in which false tracks are counted.

A scene has several targets, since most of a scan's cost does not depend on their number. They are
too far apart to disturb each other, and few beside the clutter, whose density is estimated. Each
target is drawn by itself and goes into the first scene where it fits: its place does not depend on
the others. Where the coverage has more clutter than is of use, each target has a patch of it that
holds all clutter within reach of its track.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tsepm_ros.methods.registry import make_initiator
from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.tools.evaluation.intervals import Estimate, mean, mean_count, proportion
from tsepm_ros.tools.evaluation.measures import SECONDS_PER_HOUR
from tsepm_ros.tools.evaluation.simulated_run import OperatingPoint, Outcome, simulate
from tsepm_ros.tools.evaluation.workers import Workers
from tsepm_ros.tools.simulation import Scenario, Simulator
from tsepm_ros.tools.simulation.scenario import ClutterStrength, TargetStrength
from tsepm_ros.tools.terminal import Progress, silent
from tsepm_ros.tracker.measurement import major_sigma, position_covariance
from tsepm_ros.tracker.options import CommonOptions
from tsepm_ros.tracker.sensor import SensorModel


@dataclass(frozen=True, kw_only=True)
class Case:
    """A sonar, its clutter and the targets to be found.

    Attributes
    ----------
    sensor : SensorModel
    common : CommonOptions
        Common options, v_max among them.
    interval : float
        Time between pings, s.
    scans : int
        Number of pings within which a target should be found.
    target_speed : float
        m/s.
    target_range : float, optional
        Range of the targets in the middle of the run, m; anywhere in the coverage if not given.
    ratio_db : float, optional
        Signal-to-clutter ratio of the targets, dB, fluctuating in Rayleigh clutter; without it
        detections have no strength.

    Raises
    ------
    ValueError
        If a value is not allowed; the message names it.
    """

    sensor: SensorModel
    common: CommonOptions = field(default_factory=CommonOptions)
    interval: float = 12.0
    scans: int = 16
    target_speed: float = 5.0
    target_range: float | None = None
    ratio_db: float | None = None

    def __post_init__(self) -> None:
        sensor, speed = self.sensor, self.target_speed
        nearest, farthest, place = sensor.min_range, sensor.max_range, self.target_range
        for allowed, sentence in (
            (
                0.0 < self.interval < math.inf,
                f"interval must be finite and above 0; got {self.interval!r}",
            ),
            (
                0.0 <= speed <= self.max_speed,
                f"speed must be from 0 to max_speed = {self.max_speed:g}; got {speed!r}",
            ),
            (self.scans >= 3, f"scans must be at least 3; got {self.scans}"),
            (
                self.ratio_db is None or -100.0 <= self.ratio_db <= 100.0,
                f"ratio must be from -100 to 100 dB; got {self.ratio_db!r}",
            ),
            (
                place is None or (nearest <= place <= farthest and place > 0.0),
                f"range must be above 0 and within the coverage, {nearest:g} to {farthest:g} m; "
                f"got {place!r}",
            ),
        ):
            if not allowed:
                raise ValueError(sentence)

    @property
    def clutter_strength(self) -> ClutterStrength | None:
        """Law of the strength of clutter, where detections have one."""
        return None if self.ratio_db is None else ClutterStrength()

    @property
    def target_strength(self) -> TargetStrength | None:
        """Strength of the targets' echoes, where detections have one."""
        return None if self.ratio_db is None else TargetStrength(self.ratio_db)

    @property
    def max_speed(self) -> float:
        """v_max, m/s."""
        return self.common.max_speed

    @property
    def typical_range(self) -> float:
        """The targets' range, or the range beyond which half of the coverage lies, m."""
        squares = self.sensor.min_range**2 + self.sensor.max_range**2
        return self.target_range or math.sqrt(0.5 * squares)

    @property
    def scans_per_hour(self) -> float:
        """Pings per hour."""
        return SECONDS_PER_HOUR / self.interval

    @property
    def detections_per_scan(self) -> float:
        """Expected false detections per ping."""
        return self.sensor.clutter_density * self.sensor.coverage_area

    @property
    def starts_per_hour(self) -> float:
        """False detections per hour: the starts from clutter if every detection starts a track."""
        return self.detections_per_scan * self.scans_per_hour


PATCH_SIGMAS = 4.0
MAX_WHOLE_COVERAGE = 10_000.0
"""Maximum number of false detections per scan for a scene of the whole coverage."""
DETECTIONS_PER_TARGET = 36.0
"""Minimum number of false detections per scan for each target of a scene with several.

With 20, P_D of the default case falls by 0.05, since the targets raise the estimated density.
"""
MAX_TARGETS_PER_SCENE = 50
MAX_PLACEMENT_TRIES = 1000


@dataclass(frozen=True, eq=False)
class _Target:
    """A target: position (x, y) in the middle of the run, velocity, and its range, in SI units."""

    centre: FloatArray
    velocity: FloatArray
    range: float

    def at(self, times: FloatArray) -> FloatArray:
        """Positions at times from the middle of the run, (n, 2), m."""
        return self.centre + times[:, None] * self.velocity


@dataclass
class _Group:
    """Targets of a scene, with their positions, (scans, 2), and their clearances, m."""

    targets: list[_Target] = field(default_factory=list)
    paths: list[FloatArray] = field(default_factory=list)
    clearances: list[float] = field(default_factory=list)

    def takes(self, path: FloatArray, clearance: float) -> bool:
        """Whether a target with this path is far enough from the others."""
        return all(
            float(np.hypot(*(path - other).T).min()) >= clearance + apart
            for other, apart in zip(self.paths, self.clearances, strict=True)
        )


def target_scenes(case: Case, number: int, seed: int) -> list[Scenario]:
    """Scenes with a number of targets altogether.

    Target i depends on (seed, i) only.

    Parameters
    ----------
    case : Case
    number, seed : int

    Raises
    ------
    ValueError
        If no target stays in the coverage during all scans.
    """
    middle = 0.5 * (case.scans - 1)
    times = np.array([case.interval * (scan - middle) for scan in range(case.scans)])
    drawn = [_drawn(case, np.random.default_rng([seed, i]), times) for i in range(number)]
    if case.detections_per_scan > MAX_WHOLE_COVERAGE:
        return [_scene(case, [target], times, _patch(case, target)) for target in drawn]
    most = int(np.clip(case.detections_per_scan / DETECTIONS_PER_TARGET, 1, MAX_TARGETS_PER_SCENE))
    groups: list[_Group] = []
    for target in drawn:
        path, clearance = target.at(times), _clearance(case, target.range)
        fitting = (g for g in groups if len(g.targets) < most and g.takes(path, clearance))
        group = next(fitting, None)
        if group is None:
            groups.append(group := _Group())
        group.targets.append(target)
        group.paths.append(path)
        group.clearances.append(clearance)
    return [_scene(case, group.targets, times) for group in groups]


def _drawn(case: Case, rng: np.random.Generator, times: FloatArray) -> _Target:
    """A target that stays in the coverage, anywhere in it or at the case's range."""
    sensor = case.sensor
    for _ in range(MAX_PLACEMENT_TRIES):
        share, bearing, turn = rng.random(3)
        azimuth = sensor.azimuth_min + bearing * sensor.sector_width
        square = sensor.min_range**2 * (1.0 - share) + sensor.max_range**2 * share
        range_ = case.target_range or math.sqrt(square)
        heading = 2.0 * math.pi * turn
        target = _Target(
            range_ * np.array([math.cos(azimuth), math.sin(azimuth)]),
            case.target_speed * np.array([math.cos(heading), math.sin(heading)]),
            range_,
        )
        x, y = target.at(times).T
        if sensor.covers(np.hypot(x, y), np.arctan2(y, x)).all():
            return target
    raise ValueError(
        f"no target of {case.target_speed:g} m/s stays in the coverage for {case.scans} pings"
    )


def _scene(
    case: Case,
    targets: list[_Target],
    times: FloatArray,
    clutter_box: tuple[float, float, float, float] | None = None,
) -> Scenario:
    states = []
    for target in targets:
        (x, y), (vx, vy) = target.at(times)[0], target.velocity
        states.append(np.array([x, vx, y, vy]))
    return Scenario(
        name="targets",
        scans=case.scans,
        period=case.interval,
        sensor=case.sensor,
        targets=tuple(states),
        clutter_box=clutter_box,
        clutter_strength=case.clutter_strength,
        target_strengths=(case.target_strength,) * len(targets),
    )


def _clearance(case: Case, range_: float) -> float:
    """Distance at which a target's detections and gates end, m: two of these are between two."""
    return PATCH_SIGMAS * _sigma(case, range_) + case.max_speed * case.interval


def _patch(case: Case, target: _Target) -> tuple[float, float, float, float]:
    """Box of a target's clutter: its path, its errors and the reach of clutter paths."""
    path = 0.5 * case.target_speed * (case.scans - 1) * case.interval
    reach = case.max_speed * case.interval * math.sqrt(case.scans)
    half = path + PATCH_SIGMAS * _sigma(case, target.range) + reach
    x, y = target.centre
    return x - half, x + half, y - half, y + half


def _sigma(case: Case, range_: float) -> float:
    """Larger axis of the measurement error, m."""
    covariance = position_covariance(
        range_, 0.0, case.sensor.range_variance(range_), case.sensor.azimuth_std
    )
    return float(major_sigma(covariance))


SEGMENTS = 8
"""Number of runs with clutter alone."""
MIN_TARGETS = 28
"""Minimum number of simulated targets before an early end."""
ONE_PROCESS = Workers()


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
    enough: Callable[[Estimate], bool] = lambda found: False,
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
