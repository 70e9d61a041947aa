# Copyright 2026 tsepm_ros developers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.
"""Predicted performance of methods with a sonar, and the search for their parameters.

A first estimate follows from the plan of the threshold, without a simulated scene. The prediction
of P_DT, confirmation time and false tracks runs the method itself, on targets in scenes of
`prediction_scenes`, and on clutter alone over the coverage, in which false tracks are counted.

A scene has several targets, since most of a scan's cost does not depend on their number. They are
too far apart to disturb each other, and few beside the clutter, whose density is estimated. Each
target is drawn by itself and goes into the first scene where it fits: its place does not depend on
the others. Where the coverage has more clutter than is of use, each target has a patch of it that
holds all clutter within reach of its track.

The search is for the parameters at a target false-track rate. Remedies are changes of a sonar that
may raise P_DT.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from tsepm_ros.methods.registry import make_initiator
from tsepm_ros.methods.tsepm import TsepmOptions
from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.tools.design import expected_counts
from tsepm_ros.tools.evaluation.intervals import (
    IntervalEstimate,
    mean_count_interval,
    mean_interval,
    proportion_interval,
)
from tsepm_ros.tools.evaluation.measures import SECONDS_PER_HOUR
from tsepm_ros.tools.evaluation.result_files import mapped_results
from tsepm_ros.tools.evaluation.simulated_run import (
    Outcome,
    SimulatedOperatingPoint,
    simulate_run,
    simulated_measurement_sigma,
)
from tsepm_ros.tools.simulation import Scenario, Simulator
from tsepm_ros.tools.simulation.scenario import ClutterStrength, TargetStrength
from tsepm_ros.tools.terminal import Progress, silent_terminal
from tsepm_ros.tracker.maintenance.target_manoeuvre import TargetManoeuvre
from tsepm_ros.tracker.options import CommonOptions, ScoreOptions
from tsepm_ros.tracker.sensor import SensorModel
from tsepm_ros.tracker.threshold import ANY_RATIO, SIMULATED_TARGETS, PlanModel, score_simulation

PATCH_SIGMAS = 4.0
MAX_WHOLE_COVERAGE = 10_000.0
"""Maximum number of false detections per scan for a scene of the whole coverage."""
DETECTIONS_PER_TARGET = 36.0
"""Minimum number of false detections per scan for each target of a scene with several.

With 20, P_DT of the default case falls by 0.05, since the targets raise the estimated density.
"""
MAX_TARGETS_PER_SCENE = 50
MAX_PLACEMENT_TRIES = 1000
SEGMENTS = 8
"""Number of runs with clutter alone."""
MIN_TARGETS = 28
"""Minimum number of simulated targets before an early end."""
WINDOWS = (8, 12, 16, 24, 32, 48, 64)
RULE_WINDOWS = (3, 4, 5, 6, 8, 10, 12, 14, 16, 20, 24)
MIN_DETECTION_INCREASE = 0.01
"""Minimum increase of P_DT for the choice of a longer window."""
MAX_SIMULATED_RULES = 2
HALF_WIDTH = 0.04
"""Half the width of the interval of P_DT at which the simulation of a method's targets ends."""
MAX_CLUTTER_DETECTIONS = 80_000.0
"""Maximum number of false detections simulated without a target."""
MIN_DETECTIONS_PER_SCAN = 20.0
"""Minimum number of detections for the cost of a scan."""
EXPECTED_FALSE_TRACKS = 10.0
"""Expected false tracks in a simulation that estimates their rate."""
MIN_CLUTTER_SCANS = 40
REMEDY_HALF_WIDTH = 0.09
"""Half the width of the interval of P_DT at which the simulation of a change ends."""


@dataclass(frozen=True, kw_only=True)
class PredictionCase:
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
    ratio_db : float, optional
        Signal-to-clutter ratio of the targets, dB, fluctuating in Rayleigh clutter; without it
        detections have no amplitude.

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
    ratio_db: float | None = None

    def __post_init__(self) -> None:
        speed = self.target_speed
        for allowed, sentence in (
            (
                0.0 < self.interval < math.inf,
                f"interval must be finite and above 0; got {self.interval!r}",
            ),
            (
                0.0 <= speed <= self.common.max_speed,
                f"speed must be from 0 to max_speed = {self.common.max_speed:g}; got {speed!r}",
            ),
            (self.scans >= 3, f"scans must be at least 3; got {self.scans}"),
            (
                self.ratio_db is None or -100.0 <= self.ratio_db <= 100.0,
                f"ratio must be from -100 to 100 dB; got {self.ratio_db!r}",
            ),
        ):
            if not allowed:
                raise ValueError(sentence)

    @property
    def clutter_strength(self) -> ClutterStrength | None:
        """Law of the amplitude of clutter, where detections have one."""
        return None if self.ratio_db is None else ClutterStrength()

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


@dataclass(frozen=True, eq=False)
class _PredictionTarget:
    """A target: position (x, y) in the middle of the run, and velocity, in SI units."""

    centre: FloatArray
    velocity: FloatArray

    def at(self, times: FloatArray) -> FloatArray:
        """Positions at times from the middle of the run, (n, 2), m."""
        return self.centre + times[:, None] * self.velocity


def prediction_scenes(case: PredictionCase, number: int, seed: int) -> list[Scenario]:
    """Scenes with a number of targets altogether.

    Target i depends on (seed, i) only.

    Parameters
    ----------
    case : PredictionCase
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
    scenes: list[list[_PredictionTarget]] = []
    for target in drawn:
        fitting = (one for one in scenes if len(one) < most and _fits(case, target, one, times))
        scene = next(fitting, None)
        if scene is None:
            scenes.append(scene := [])
        scene.append(target)
    return [_scene(case, targets, times) for targets in scenes]


def _fits(
    case: PredictionCase,
    target: _PredictionTarget,
    others: list[_PredictionTarget],
    times: FloatArray,
) -> bool:
    """Whether a target's detections and gates end before those of the others."""
    return all(
        float(np.hypot(*(target.at(times) - other.at(times)).T).min())
        >= _clearance(case, target) + _clearance(case, other)
        for other in others
    )


def _drawn(case: PredictionCase, rng: np.random.Generator, times: FloatArray) -> _PredictionTarget:
    """A target that stays in the coverage, anywhere in it."""
    sensor = case.sensor
    for _ in range(MAX_PLACEMENT_TRIES):
        share, bearing, turn = rng.random(3)
        azimuth = sensor.azimuth_min + bearing * sensor.sector_width
        square = sensor.min_range**2 * (1.0 - share) + sensor.max_range**2 * share
        range_ = math.sqrt(square)
        heading = 2.0 * math.pi * turn
        target = _PredictionTarget(
            range_ * np.array([math.cos(azimuth), math.sin(azimuth)]),
            case.target_speed * np.array([math.cos(heading), math.sin(heading)]),
        )
        x, y = target.at(times).T
        if sensor.covers(np.hypot(x, y), np.arctan2(y, x)).all():
            return target
    raise ValueError(
        f"no target of {case.target_speed:g} m/s stays in the coverage for {case.scans} pings"
    )


def _scene(
    case: PredictionCase,
    targets: list[_PredictionTarget],
    times: FloatArray,
    clutter_box: tuple[float, float, float, float] | None = None,
) -> Scenario:
    strength = None if case.ratio_db is None else TargetStrength(case.ratio_db)
    return Scenario(
        name="targets",
        scans=case.scans,
        period=case.interval,
        sensor=case.sensor,
        targets=tuple(
            np.stack([target.at(times)[0], target.velocity], axis=1).ravel() for target in targets
        ),
        clutter_box=clutter_box,
        clutter_strength=case.clutter_strength,
        target_strengths=(strength,) * len(targets),
    )


def _clearance(case: PredictionCase, target: _PredictionTarget) -> float:
    """Distance at which a target's detections and gates end, m: two of these are between two."""
    sigma = simulated_measurement_sigma(case.sensor, target.centre)
    return PATCH_SIGMAS * sigma + case.common.max_speed * case.interval


def _patch(case: PredictionCase, target: _PredictionTarget) -> tuple[float, float, float, float]:
    """Box of a target's clutter: its path, its errors and the reach of clutter paths."""
    path = 0.5 * case.target_speed * (case.scans - 1) * case.interval
    reach = case.common.max_speed * case.interval * math.sqrt(case.scans)
    half = path + PATCH_SIGMAS * simulated_measurement_sigma(case.sensor, target.centre) + reach
    x, y = target.centre
    return x - half, x + half, y - half, y + half


@dataclass(frozen=True)
class PredictionStatistics:
    """Detection and confirmation time of simulated targets.

    Attributes
    ----------
    targets : int
        Number of simulated targets.
    found : IntervalEstimate
        P_DT within the case's scans.
    confirmation_time : IntervalEstimate
        Mean time from the first scan to the confirmation of the targets found, s.
    slow_confirmation_time : float
        Time by which 95 % of the targets found are confirmed, s; nan if none is found.
    """

    targets: int
    found: IntervalEstimate
    confirmation_time: IntervalEstimate
    slow_confirmation_time: float

    @classmethod
    def of(cls, times: list[float | None]) -> PredictionStatistics:
        """Statistics of each target's time of confirmation, s, None if it is not confirmed."""
        confirmed = [time for time in times if time is not None]
        return cls(
            targets=len(times),
            found=proportion_interval(len(confirmed), len(times)),
            confirmation_time=mean_interval(confirmed),
            slow_confirmation_time=float(np.quantile(confirmed, 0.95)) if confirmed else math.nan,
        )


def prediction_statistics(
    case: PredictionCase,
    method: str,
    options: dict[str, Any],
    *,
    runs: int,
    seed: int,
    processes: int = 1,
    progress: Progress = silent_terminal,
    enough: Callable[[IntervalEstimate], bool] = lambda detection: False,
) -> PredictionStatistics:
    """Simulate targets in their scenes and run the method on them.

    The scenes depend on the case, `runs` and `seed` only: all methods get the same.

    Parameters
    ----------
    case : PredictionCase
    method : str
    options : dict
        For `make_initiator`; a target false-track rate is that of the whole coverage.
    runs : int
        Number of targets.
    seed : int
    processes : int, optional
    progress : callable, optional
    enough : callable, optional
        Whether P_DT so far, of at least `MIN_TARGETS` targets, is known well enough.

    Raises
    ------
    ValueError
        If no target stays in the coverage during all scans.
    """
    jobs = [
        (
            scene,
            [seed, index],
            SimulatedOperatingPoint(method, options=_for_scene(case, scene, options)),
        )
        for index, scene in enumerate(prediction_scenes(case, runs, seed))
    ]
    times: list[float | None] = []
    done = mapped_results(_predicted_confirmation_times, jobs, processes)
    for of_scene in progress(done, len(jobs)):
        times += of_scene
        confirmed = sum(time is not None for time in times)
        if len(times) >= MIN_TARGETS and enough(proportion_interval(confirmed, len(times))):
            break
    done.close()
    return PredictionStatistics.of(times)


def predicted_false_tracks_per_hour(
    case: PredictionCase,
    method: str,
    options: dict[str, Any],
    *,
    scans: int,
    seed: int,
    processes: int = 1,
    progress: Progress = silent_terminal,
) -> IntervalEstimate:
    """Rate of tracks that the method confirms on clutter alone.

    Parameters
    ----------
    case : PredictionCase
    method : str
    options : dict
        For `make_initiator`.
    scans : int
        Number of scans that count, after the scans in which the potential tracks accumulate.
    seed : int
    processes : int, optional
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
    counts = list(progress(mapped_results(_predicted_count_false, jobs, processes), SEGMENTS))
    return mean_count_interval(counts).mapped(lambda count: count * case.scans_per_hour / part)


def _for_scene(case: PredictionCase, scene: Scenario, options: dict[str, Any]) -> dict[str, Any]:
    """The options with the scene's share of the target false-track rate."""
    rate = options.get("false_tracks_per_hour")
    if rate is None:
        return options
    return {**options, "false_tracks_per_hour": rate * scene.area / case.sensor.coverage_area}


def _predicted_confirmation_times(
    job: tuple[Scenario, list[int], SimulatedOperatingPoint],
) -> list[float | None]:
    """Time of each target's true start, s."""
    times: list[float | None] = [None] * len(job[0].targets)
    for start in simulate_run(*job).judged():
        if start.outcome is Outcome.TRUE:
            times[start.target] = start.track.stamp
    return times


def _predicted_count_false(job: tuple[Scenario, list[int], str, dict[str, Any], int]) -> int:
    """Tracks confirmed on clutter after the first scans."""
    scene, seed, method, options, first = job
    initiator = make_initiator(method, sensor=scene.sensor, **options)
    return sum(
        len(tracks)
        for index, simulated in enumerate(Simulator(scene, seed))
        if len(tracks := initiator.process(simulated.scan)) and index >= first
    )


Labelled = Callable[[str], Progress]
"""Progress of a part of the simulation by its name."""


@dataclass(frozen=True)
class PredictedRule:
    """An M/N rule that keeps the target false-track rate.

    Attributes
    ----------
    min_hits, window : int
        M and N.
    one_start : float
        P_DT of one start, as in TSEPM 2018, Table 1.
    in_time : float
        P_DT within the case's scans, of all starts in them, with the evaluation; without clutter.
    false_per_hour : float
        Confirmations from clutter that pass the evaluation, before merging: an upper bound.
    """

    min_hits: int
    window: int
    one_start: float
    in_time: float
    false_per_hour: float


@dataclass(frozen=True)
class PredictedCandidate:
    """A method with its parameters and its simulated performance.

    Attributes
    ----------
    name : str
    false_bound : float
        Target false-track rate of the threshold, or upper bound of the rule, per hour over the
        coverage.
    targets : PredictionStatistics
    false_simulated : IntervalEstimate
        Simulated false tracks per hour; unknown for a rule that finds fewer targets than a method
        that keeps the target false-track rate.
    """

    name: str
    false_bound: float
    targets: PredictionStatistics
    false_simulated: IntervalEstimate

    def keeps(self, false_per_hour: float) -> bool:
        """Whether the simulated rate's interval reaches down to the given rate, or the bound."""
        low = self.false_simulated.low
        return (self.false_bound if math.isnan(low) else low) <= false_per_hour


def predicted_passages(
    case: PredictionCase, options: ScoreOptions, windows: Sequence[int]
) -> list[tuple[float, FloatArray]]:
    """For each window the threshold of `score` and the share of targets that passed it by scan.

    The targets have the stated P_D and at least the case's scans, without clutter.
    """
    model = PlanModel(
        case.sensor,
        case.common.max_speed,
        case.interval,
        tuple(windows),
        math.log(options.miss_probability),
        max(case.scans, *windows),
        process_noise=TargetManoeuvre().process_noise(case.common, case.interval),
        number=SIMULATED_TARGETS,
    )
    ratio = None
    if case.ratio_db is not None and case.common.intensity != "off":
        # Nobody tells the method the ratio.
        model, ratio = replace(model, ratio=ANY_RATIO), 10.0 ** (case.ratio_db / 10.0)
    plans, of_targets = (
        score_simulation(drawn).run(drawn.scans).plans
        for drawn in (model, replace(model, ratio=ratio, fades=False))
    )
    share = min(options.false_tracks_per_hour / case.starts_per_hour, 1.0)
    thresholds = [plan.threshold(share) for plan in plans]
    return [
        (threshold, plan.passed(threshold))
        for plan, threshold in zip(of_targets, thresholds, strict=True)
    ]


def predicted_score_window(case: PredictionCase, options: ScoreOptions) -> int:
    """The shortest window beyond which P_DT hardly increases."""
    windows = [window for window in WINDOWS if window <= max(case.scans, WINDOWS[0])]
    shares = np.array(
        [passed[case.scans - 1] for _, passed in predicted_passages(case, options, windows)]
    )
    return windows[int(np.argmax(shares >= shares.max() - MIN_DETECTION_INCREASE))]


def predicted_rules_within(
    case: PredictionCase, options: TsepmOptions, false_per_hour: float, processes: int = 1
) -> list[PredictedRule]:
    """For each window the rule of fewest hits that keeps the target false-track rate, if any."""
    windows = [window for window in reversed(RULE_WINDOWS) if window <= case.scans]
    jobs = [(case, options, false_per_hour, window) for window in windows]  # the longest first
    rules = [
        rule for rule in mapped_results(_predicted_rule_within, jobs, processes) if rule is not None
    ]
    return rules[::-1]


def _predicted_rule_within(
    job: tuple[PredictionCase, TsepmOptions, float, int],
) -> PredictedRule | None:
    case, options, false_per_hour, window = job
    sensor, gate = case.sensor, options.gate_probability
    gating = expected_counts.ExpectedGating(
        sensor=sensor,
        max_speed=case.common.max_speed,
        interval=case.interval,
        gate_probability=gate,
    )

    def chosen(min_hits: int) -> TsepmOptions:
        return replace(options, min_hits=min_hits, window=window)

    def predicted(min_hits: int) -> float:
        raw = expected_counts.expected(gating, min_hits, window, 3 * window).raw[window:].mean()
        rate = float(raw) * case.scans_per_hour
        if rate > false_per_hour:
            rate *= expected_counts.clutter_pass_share(gating, chosen(min_hits))
        return rate

    numbers = range(2, window + 1)  # the rate falls with each more hit
    index = bisect_left(numbers, True, key=lambda number: predicted(number) <= false_per_hour)
    if index == len(numbers):
        return None
    min_hits, probability = numbers[index], sensor.detection_probability
    passes = expected_counts.target_pass_share(gating, chosen(min_hits), case.target_speed)
    by_scan = expected_counts.confirmed_by(min_hits, window, probability, gate, case.scans, passes)
    return PredictedRule(
        min_hits,
        window,
        expected_counts.confirmation_probability(min_hits, window, probability, gate),
        float(by_scan[-1]),
        predicted(min_hits),
    )


def prediction_clutter_scans(case: PredictionCase, false_per_hour: float) -> int:
    """Number of scans with clutter alone: EXPECTED_FALSE_TRACKS at the rate, within the cost."""
    affordable = MAX_CLUTTER_DETECTIONS / max(case.detections_per_scan, MIN_DETECTIONS_PER_SCAN)
    needed = EXPECTED_FALSE_TRACKS / false_per_hour * case.scans_per_hour
    return int(max(min(needed, affordable), MIN_CLUTTER_SCANS))


def predicted_candidates(
    case: PredictionCase,
    score: ScoreOptions,
    tsepm: TsepmOptions,
    rules: list[PredictedRule],
    *,
    wanted: float,
    runs: int,
    seed: int,
    processes: int,
    progress: Labelled,
) -> Iterator[PredictedCandidate]:
    """The method `score` and the M/N rules of highest P_DT, each run on targets and on clutter.

    All get the same targets, until P_DT is known within `HALF_WIDTH` and is certainly above or
    below the required P_DT. A rule whose P_DT is below that
    of `score`, if `score` keeps the rate, is not run further.

    Parameters
    ----------
    case : PredictionCase
    score : ScoreOptions
    tsepm : TsepmOptions
        Options besides the rule.
    rules : list of PredictedRule
        Rules that keep the target false-track rate.
    wanted : float
        Required P_DT.
    runs : int
        Maximum number of targets.
    seed : int
    processes : int
    progress : callable
        Progress of a part by its name.
    """
    rate = score.false_tracks_per_hour
    scans = prediction_clutter_scans(case, rate)
    rival = -math.inf  # the P_DT that another method has at least

    def enough(found: IntervalEstimate) -> bool:
        decided = not found.low < wanted <= found.high
        return (decided and prediction_known_within(found, HALF_WIDTH)) or found.high < rival

    def candidate(name: str, method: str, own: dict[str, Any], bound: float) -> PredictedCandidate:
        options = {**asdict(case.common), **own}
        targets = prediction_statistics(
            case,
            method,
            options,
            runs=runs,
            seed=seed,
            processes=processes,
            progress=progress(f"{name}, targets"),
            enough=enough,
        )
        false = IntervalEstimate.unknown()
        if targets.found.high >= rival:
            shown = progress(f"{name}, clutter")
            false = predicted_false_tracks_per_hour(
                case, method, options, scans=scans, seed=seed, processes=processes, progress=shown
            )
        return PredictedCandidate(name, bound, targets, false)

    best = candidate("score", "score", asdict(score), rate)
    yield best
    if best.keeps(rate):
        rival = best.targets.found.low
    for rule in sorted(rules, key=lambda rule: -rule.in_time)[:MAX_SIMULATED_RULES]:
        changes = {"min_hits": rule.min_hits, "window": rule.window}
        own = {**asdict(tsepm), **changes}
        yield candidate(f"tsepm {rule.min_hits}/{rule.window}", "tsepm", own, rule.false_per_hour)


def prediction_known_within(estimate: IntervalEstimate, half_width: float) -> bool:
    """Whether the interval of an estimate is narrow enough."""
    return estimate.high - estimate.low <= 2.0 * half_width


@dataclass(frozen=True, eq=False)
class FirstPrediction:
    """Threshold of `score` and P_DT, of targets without clutter about them.

    Attributes
    ----------
    window : int
        Window of `score`, scans.
    threshold : float
        Log-likelihood ratio.
    found : (scans,) ndarray
        P_DT by each scan.
    """

    window: int
    threshold: float
    found: FloatArray

    def scans_until(self, share: float) -> int | None:
        """Scans within which a share of the targets is found; None if it is not."""
        reached = self.found >= share
        return int(np.argmax(reached)) + 1 if reached[-1] else None


def first_prediction(
    case: PredictionCase, options: ScoreOptions, *, given_window: bool
) -> FirstPrediction:
    """The estimate of a case, at the design's window unless the given window is kept."""
    if not given_window:
        options = replace(options, window=predicted_score_window(case, options))
    [(threshold, shares)] = predicted_passages(case, options, [options.window])
    return FirstPrediction(options.window, threshold, shares[: case.scans])


def prediction_remedies(case: PredictionCase) -> list[tuple[str, PredictionCase]]:
    """Changes that may raise P_DT, each with the changed case."""
    sensor = case.sensor

    def changed(**values: float) -> PredictionCase:
        return replace(case, sensor=replace(sensor, **values))

    range_errors = {
        name: 0.5 * getattr(sensor, name) for name in ("range_std", "range_std_fraction")
    }
    farthest = max(0.7 * sensor.max_range, 0.5 * (sensor.min_range + sensor.max_range))
    return [
        ("twice as many pings", replace(case, scans=2 * case.scans)),
        ("half the sector", changed(azimuth_max=sensor.azimuth_min + 0.5 * sensor.sector_width)),
        ("half the bearing error", changed(azimuth_std=0.5 * sensor.azimuth_std)),
        ("half the range error", changed(**range_errors)),
        ("half the clutter", changed(clutter_density=0.5 * sensor.clutter_density)),
        (f"a range of {farthest:.0f} m", changed(max_range=farthest)),
    ]


def predicted_remedied_detection(
    case: PredictionCase,
    score: ScoreOptions,
    *,
    given_window: bool,
    runs: int,
    seed: int,
    processes: int,
    progress: Labelled,
) -> Iterator[tuple[str, IntervalEstimate]]:
    """P_DT of the method `score` with each change, and at a larger false-track rate.

    A change with which no target stays in the coverage during all scans is left out.

    Parameters
    ----------
    case : PredictionCase
    score : ScoreOptions
    given_window : bool
        Whether the window of `score` is kept.
    runs, seed, processes, progress
        As in `predicted_candidates`; P_DT is determined within `REMEDY_HALF_WIDTH`.
    """
    more = replace(score, false_tracks_per_hour=10.0 * score.false_tracks_per_hour)
    cases = [
        *((text, changed, score) for text, changed in prediction_remedies(case)),
        ("ten times as many false tracks", case, more),
    ]
    jobs = [(changed, options, given_window, runs, seed) for _, changed, options in cases]
    estimates = progress("possible changes")(
        mapped_results(_predicted_remedied, jobs, processes), len(jobs)
    )
    for (text, _, _), found in zip(cases, estimates, strict=True):
        if math.isfinite(found.value):
            yield text, found


def _predicted_remedied(
    job: tuple[PredictionCase, ScoreOptions, bool, int, int],
) -> IntervalEstimate:
    """P_DT of a changed case, by this process alone; unknown if no target stays in coverage."""
    case, score, given_window, runs, seed = job
    window = score.window if given_window else predicted_score_window(case, score)
    options = {**asdict(case.common), **asdict(score), "window": window}
    with suppress(ValueError):  # the case itself was allowed
        return prediction_statistics(
            case,
            "score",
            options,
            runs=runs,
            seed=seed,
            enough=lambda estimate: prediction_known_within(estimate, REMEDY_HALF_WIDTH),
        ).found
    return IntervalEstimate.unknown()
