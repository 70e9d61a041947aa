"""What a method will do with a sonar: how many targets it finds, how soon, and what it makes up.

Where no closed form reaches, the method itself is run. Targets are each simulated in a patch of
their own clutter, which is all of it that can meet them; what clutter alone confirms is counted
over the whole coverage.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.analysis.intervals import Estimate, mean, mean_count, proportion
from tsepm_ros.analysis.operating_points import OperatingPoint
from tsepm_ros.analysis.pool import mapped
from tsepm_ros.analysis.simulated_run import simulate
from tsepm_ros.analysis.truth import Outcome
from tsepm_ros.design.expected_counts import Gating, error_radius, gate_areas
from tsepm_ros.initiation.common_options import CommonOptions
from tsepm_ros.methods.registry import make_initiator
from tsepm_ros.methods.tsepm.tsepm_options import TsepmOptions
from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.sensing.conversion import convert, major_sigma, position_covariance
from tsepm_ros.sensing.scan import Scan
from tsepm_ros.sensing.sensor import SensorModel
from tsepm_ros.simulation import Scenario, Simulator
from tsepm_ros.stages import pruning
from tsepm_ros.stages.estimation import fit
from tsepm_ros.stages.evaluation import clutter_statistic, normalized_distance

PATCH_SIGMAS = 4.0
PATHS = 10_000
FEWEST_PASSES = 3.0
"""Passes of the simulated paths below which a share is not trusted."""
SEGMENTS = 16
"""Runs into which the time without a target is divided."""
PLACEMENT_TRIES = 1000
SECONDS_PER_HOUR = 3600.0

Progress = Callable[[Iterable[Any], int], Iterable[Any]]
"""Shows how many of a number are done, as they are taken."""


def silent(items: Iterable[Any], number: int) -> Iterable[Any]:
    """Show nothing."""
    return items


@dataclass(frozen=True, kw_only=True)
class Case:
    """A sonar, its clutter and the targets it is to find.

    Attributes
    ----------
    sensor : SensorModel
    common : CommonOptions
        With v_max.
    interval : float
        Time between pings, s.
    scans : int
        Pings within which a target should be found.
    target_speed : float
        m/s.
    target_range : float, optional
        Distance of the targets half-way, m; if not given they are spread over the coverage.

    Raises
    ------
    ValueError
        Naming what is not allowed.
    """

    sensor: SensorModel
    common: CommonOptions = field(default_factory=CommonOptions)
    interval: float = 12.0
    scans: int = 16
    target_speed: float = 5.0
    target_range: float | None = None

    def __post_init__(self) -> None:
        sensor, speed = self.sensor, self.target_speed
        if not (math.isfinite(self.interval) and self.interval > 0.0):
            raise ValueError(f"interval must be finite and above 0; got {self.interval!r}")
        if not 0.0 <= speed <= self.max_speed:
            raise ValueError(
                f"speed must be from 0 to max_speed = {self.max_speed:g}; got {speed!r}"
            )
        if self.scans < 3:
            raise ValueError(f"scans must be at least 3; got {self.scans}")
        nearest, farthest = sensor.min_range, sensor.max_range
        if self.target_range is not None and not (
            nearest <= self.target_range <= farthest and self.target_range > 0.0
        ):
            raise ValueError(
                f"range must be above 0 and within the coverage, {nearest:g} to {farthest:g} m; "
                f"got {self.target_range!r}"
            )

    @property
    def max_speed(self) -> float:
        """v_max, m/s."""
        return self.common.max_speed

    @property
    def typical_range(self) -> float:
        """The targets' distance, or the one beyond which half of the coverage lies, m."""
        if self.target_range is not None:
            return self.target_range
        return math.sqrt(0.5 * (self.sensor.min_range**2 + self.sensor.max_range**2))

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
        """False detections per hour: the starts from clutter, if each starts."""
        return self.detections_per_scan * self.scans_per_hour


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
    workers: int = 1,
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
    workers : int
        Processes.
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
    done = progress(mapped(_time_found, jobs, workers, max(1, runs // (8 * workers))), runs)
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
    workers: int = 1,
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
    workers : int
        Processes.
    progress : callable, optional
    """
    part = math.ceil(scans / SEGMENTS)
    scene = Scenario(
        name="clutter", scans=case.scans + part, period=case.interval, sensor=case.sensor
    )
    jobs = [(scene, [seed, index], method, options, case.scans) for index in range(SEGMENTS)]
    counts = list(progress(mapped(_count_false, jobs, workers), SEGMENTS))
    return mean_count(counts).mapped(lambda count: count * case.scans_per_hour / part)


def clutter_pass_share(gating: Gating, options: TsepmOptions) -> float:
    """Share of the raw confirmations from clutter that pass the method's evaluation (Step 6).

    Paths are drawn with their hits spread evenly over the gates, their scans with the weights
    ``prod a_k exp(-lambda a_j)`` of the gates hit and left empty on the way.

    Parameters
    ----------
    gating : Gating
    options : TsepmOptions

    Returns
    -------
    float
        Where next to none passes, what three that pass would make.
    """
    rng = np.random.default_rng(1)
    ranges, scans = _drawn_paths(rng, gating.sensor, options)
    gaps = np.diff(scans, axis=1)
    areas = gate_areas(gating, ranges, options.window)
    taken = np.take_along_axis(areas, gaps - 1, axis=1)
    before = np.cumsum(areas, axis=1) - areas
    empty = np.take_along_axis(before, gaps - 1, axis=1)
    weight = (np.log(taken) - gating.sensor.clutter_density * empty).sum(axis=1)
    weight = np.exp(weight - weight.max())
    radius = gating.max_speed * gating.interval * gaps + error_radius(gating, ranges)[:, None]
    step = radius * np.sqrt(rng.random(radius.shape))
    turn = rng.uniform(-math.pi, math.pi, radius.shape)
    x = np.cumsum(np.column_stack([ranges, step * np.cos(turn)]), axis=1)
    y = np.cumsum(np.column_stack([np.zeros(PATHS), step * np.sin(turn)]), axis=1)
    kept = _passing(gating, options, scans, np.hypot(x, y), np.arctan2(y, x))
    independent = weight.sum() ** 2 / np.square(weight).sum()
    return float(max(np.average(kept, weights=weight), FEWEST_PASSES / independent))


def target_pass_share(gating: Gating, options: TsepmOptions, speed: float) -> float:
    """Share of a target's tracks, all hits its own, that pass the method's evaluation (Step 6).

    Of targets that are detected with p_d in each scan, those whose detections fall into the gates
    of the ones before and that have M hits within N scans.

    Parameters
    ----------
    gating : Gating
    options : TsepmOptions
    speed : float
        The target's, m/s.
    """
    rng = np.random.default_rng(2)
    sensor, shape = gating.sensor, (PATHS, options.window)
    ranges = np.sqrt(rng.uniform(sensor.min_range**2, sensor.max_range**2, PATHS))
    heading = rng.uniform(-math.pi, math.pi, (PATHS, 1))
    way = speed * gating.interval * np.arange(options.window)
    x, y = ranges[:, None] + way * np.cos(heading), way * np.sin(heading)
    true_range = np.hypot(x, y)
    range_ = true_range + rng.standard_normal(shape) * np.sqrt(sensor.range_variance(true_range))
    range_ = np.abs(range_)
    azimuth = np.arctan2(y, x) + rng.standard_normal(shape) * sensor.azimuth_std
    hit = rng.random(shape) < sensor.detection_probability
    hit[:, 0] = True
    _gate(hit, range_, azimuth, gating)
    count = np.cumsum(hit, axis=1)
    hit &= count <= options.min_hits
    reached = count[:, -1] >= options.min_hits
    if not reached.any():
        return 0.0
    scans = np.nonzero(hit[reached])[1].reshape(-1, options.min_hits)
    taken = [np.take_along_axis(part[reached], scans, axis=1) for part in (range_, azimuth)]
    return float(_passing(gating, options, scans, *taken).mean())


def _gate(hit: NDArray[np.bool_], range_: FloatArray, azimuth: FloatArray, gating: Gating) -> None:
    """Leave out, in place, the hits (n, N) beyond the gate of the hit before (Eq. 4)."""
    x, y = range_ * np.cos(azimuth), range_ * np.sin(azimuth)
    rows = np.arange(len(hit))
    last = np.zeros(len(hit), np.int64)
    for scan in range(1, hit.shape[1]):
        distance = np.hypot(x[:, scan] - x[rows, last], y[:, scan] - y[rows, last])
        reach = gating.max_speed * gating.interval * (scan - last)
        hit[:, scan] &= distance <= reach + error_radius(gating, range_[rows, last])
        last[hit[:, scan]] = scan


def _drawn_paths(
    rng: np.random.Generator, sensor: SensorModel, options: TsepmOptions
) -> tuple[FloatArray, NDArray[np.int64]]:
    """First ranges (n,) over the coverage, and scans (n, M) of the hits, the first in scan 0."""
    ranges = np.sqrt(rng.uniform(sensor.min_range**2, sensor.max_range**2, PATHS))
    later = rng.permuted(np.tile(np.arange(1, options.window), (PATHS, 1)), axis=1)
    later = np.sort(later[:, : options.min_hits - 1], axis=1)
    return ranges, np.concatenate([np.zeros((PATHS, 1), np.int64), later], axis=1)


def _passing(
    gating: Gating,
    options: TsepmOptions,
    scans: NDArray[np.int64],
    range_: FloatArray,
    azimuth: FloatArray,
) -> NDArray[np.bool_]:
    """Which paths (n, M) of hits pass the evaluation, (n,)."""
    sensor = gating.sensor
    flat = Scan(stamp=0.0, range=range_.ravel(), azimuth=azimuth.ravel())
    hits = convert(flat, sensor, 0).reshape(scans.shape)
    hits["time"] = scans * gating.interval
    if options.evaluation == "clutter_statistic":
        figure = clutter_statistic(hits["position"], sensor.clutter_density)
        threshold = pruning.clutter_threshold(options.clutter_test_size, options.min_hits)
    else:
        stamp = options.window * gating.interval
        figure = normalized_distance(hits, fit(hits, stamp, sensor, options.estimator))
        threshold = pruning.distance_threshold(options.pruning_probability, options.pruning_reading)
    return pruning.keep(figure, threshold)


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
    for judged in simulate(*job).judged():
        if judged.outcome is Outcome.TRUE:
            return judged.track.stamp
    return None


def _count_false(job: tuple[Scenario, list[int], str, dict[str, Any], int]) -> int:
    """Tracks confirmed on clutter after the first scans."""
    scene, seed, method, options, first = job
    initiator = make_initiator(method, sensor=scene.sensor, **options)
    return sum(
        len(tracks)
        for index, simulated in enumerate(Simulator(scene, seed))
        if len(tracks := initiator.process(simulated.scan)) and index >= first
    )
