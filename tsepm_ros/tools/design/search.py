"""Search for a method's parameters at a target false-track rate, with predicted performance.

A first estimate follows from the plan of the threshold, without a simulated scene. Remedies are
changes of a sonar that may raise P_D.
"""

from __future__ import annotations

import dataclasses
import math
from bisect import bisect_left
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.methods.tsepm import TsepmOptions
from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.numerics.gaussian import gate_factor
from tsepm_ros.tools.design.expected_counts import (
    Gating,
    clutter_pass_share,
    confirmed_by,
    expected_counts,
    rule_detection_probability,
    target_pass_share,
)
from tsepm_ros.tools.design.prediction import (
    ONE_PROCESS,
    Case,
    TargetStatistics,
    false_tracks_per_hour,
    target_statistics,
)
from tsepm_ros.tools.evaluation.intervals import Estimate
from tsepm_ros.tools.evaluation.workers import Workers
from tsepm_ros.tools.terminal import Progress
from tsepm_ros.tracker import threshold as threshold_plan
from tsepm_ros.tracker.evaluation import MAX_DETECTION_PROBABILITY, miss_increment
from tsepm_ros.tracker.measurement import LEAST_ACROSS, position_covariance
from tsepm_ros.tracker.options import MIN_HITS, ScoreOptions
from tsepm_ros.tracker.threshold import ANY_RATIO

Labelled = Callable[[str], Progress]
"""Progress of a part of the simulation by its name."""

WINDOWS = (8, 12, 16, 24, 32, 48, 64)
RULE_WINDOWS = (3, 4, 5, 6, 8, 10, 12, 14, 16, 20, 24)
MIN_DETECTION_INCREASE = 0.01
"""Minimum increase of P_D for the choice of a longer window."""
MAX_SIMULATED_RULES = 2
SIMULATED_PINGS = 100_000
"""Simulated pings for the mean increment of a ping."""
HALF_WIDTH = 0.04
"""Half the width of the interval of P_D at which the simulation of a method's targets ends."""
MAX_CLUTTER_DETECTIONS = 80_000.0
"""Maximum number of false detections simulated without a target."""
MIN_DETECTIONS_PER_SCAN = 20.0
"""Minimum number of detections for the cost of a scan."""
EXPECTED_FALSE_TRACKS = 10.0
"""Expected false tracks in a simulation that estimates their rate."""
MIN_CLUTTER_SCANS = 40


@dataclass(frozen=True)
class Rule:
    """An M/N rule that keeps the target false-track rate.

    Attributes
    ----------
    min_hits, window : int
        M and N.
    one_start : float
        P_D of one start, as in TSEPM 2018, Table 1.
    in_time : float
        P_D within the case's scans, of all starts in them, with the evaluation; without clutter.
    false_per_hour : float
        Confirmations from clutter that pass the evaluation, before merging: an upper bound.
    """

    min_hits: int
    window: int
    one_start: float
    in_time: float
    false_per_hour: float


@dataclass(frozen=True)
class Candidate:
    """A method with its parameters and its simulated performance.

    Attributes
    ----------
    name : str
    method : str
    options : dict
        For `make_initiator`.
    false_bound : float
        Target false-track rate of the threshold, or upper bound of the rule, per hour over the
        coverage.
    targets : TargetStatistics
    false_simulated : Estimate
        Simulated false tracks per hour; unknown for a rule that finds fewer targets than a method
        that keeps the target false-track rate.
    """

    name: str
    method: str
    options: dict[str, Any]
    false_bound: float
    targets: TargetStatistics
    false_simulated: Estimate

    def keeps(self, false_per_hour: float) -> bool:
        """Whether the simulated rate's interval reaches down to the given rate, or the bound."""
        low = self.false_simulated.low
        return (self.false_bound if math.isnan(low) else low) <= false_per_hour


@dataclass(frozen=True)
class PingIncrements:
    """Mean increments of the log-likelihood ratio by a ping, the target's position known.

    Attributes
    ----------
    hit, miss : float
        Increment by the target's own detection, and without a detection.
    scan : float
        Increment by a ping, summed over all detections that may be the target's: at least 0.
    """

    hit: float
    miss: float
    scan: float


def ping_increments(case: Case, gate_probability: float) -> PingIncrements:
    """Upper bounds of the mean increments by a ping at the typical range.

    A ping adds ``E[ln(1 - p_d P_G + (p_d / lambda) sum_j N(z_j; x, R))]`` over the target's
    detection and the clutter in its gate. R is the error at the target's position, a lower bound of
    the innovation covariance. A hit alone adds ``ln(p_d / (lambda 2 pi sqrt|R|)) - 1``, since
    d^2 / 2 has the mean 1.
    """
    sensor, range_ = case.sensor, case.typical_range
    error = position_covariance(
        range_, 0.0, sensor.range_variance(range_), sensor.azimuth_std, LEAST_ACROSS
    )
    size = 2.0 * math.pi * math.sqrt(float(np.linalg.det(error)))  # 1 / N(0)
    probability = min(sensor.detection_probability, MAX_DETECTION_PROBABILITY)
    missed = float(miss_increment(np.array([probability]), gate_probability)[0])
    rng = np.random.default_rng(1)
    edge = 0.5 * gate_factor(gate_probability) ** 2  # d^2 / 2 is uniform in a gate of clutter
    clutter = rng.poisson(edge * size * sensor.clutter_density, SIMULATED_PINGS)
    owner = np.repeat(np.arange(SIMULATED_PINGS), clutter)
    own_rate, clutter_rate = _range_rate_ratios(case, owner)
    own_strength, clutter_strength = _strength_ratios(case, len(owner))
    own_rate, clutter_rate = own_rate * own_strength, clutter_rate * clutter_strength
    likelihood = clutter_rate * np.exp(-edge * rng.random(len(owner)))
    likelihood = np.asarray(np.bincount(owner, likelihood, minlength=SIMULATED_PINGS), float)
    own = rng.exponential(1.0, SIMULATED_PINGS)
    seen = (rng.random(SIMULATED_PINGS) < probability) & (own <= edge)
    likelihood += np.where(seen, own_rate * np.exp(-own), 0.0)
    scale = probability / (sensor.clutter_density * size)
    mean = float(np.log(math.exp(missed) + scale * likelihood).mean())
    hit = math.log(scale) - 1.0 + float(np.log(own_rate).mean())
    return PingIncrements(hit=hit, miss=missed, scan=max(mean, 0.0))


def _range_rate_ratios(case: Case, owner: NDArray[np.int64]) -> tuple[FloatArray, FloatArray]:
    """``N(e; 0, s^2) / p(c)`` of the range rates of targets and of clutter in their gates.

    `owner` (n,) is the ping of each false detection. The target of each ping has the case's speed
    and a random heading. All ratios are 1 if range rates are not used.
    """
    sensor = case.sensor
    sigma, half = sensor.range_rate_std, sensor.clutter_range_rate
    if not sigma:
        return np.ones(SIMULATED_PINGS), np.ones(len(owner))
    rng = np.random.default_rng(2)
    true = case.target_speed * np.cos(rng.uniform(-math.pi, math.pi, SIMULATED_PINGS))

    def ratio(rate: FloatArray, expected: FloatArray) -> FloatArray:
        likely = np.exp(-0.5 * np.square((rate - expected) / sigma)) / math.sqrt(2.0 * math.pi)
        density = half / (math.pi * (half**2 + np.square(rate)))
        return np.asarray(likely / sigma / density)

    own = ratio(true + sigma * rng.standard_normal(SIMULATED_PINGS), true)
    return own, ratio(half * rng.standard_cauchy(len(owner)), true[owner])


def _strength_ratios(case: Case, clutter: int) -> tuple[FloatArray, FloatArray]:
    """Likelihood ratios of the strengths of targets and of clutter, the ratio being known."""
    if case.ratio_db is None or case.common.intensity == "off":
        return np.ones(SIMULATED_PINGS), np.ones(clutter)
    rng, mean = np.random.default_rng(3), 1.0 + 10.0 ** (case.ratio_db / 10.0)

    def ratio(exponent: FloatArray) -> FloatArray:
        return np.asarray(np.exp(exponent * (1.0 - 1.0 / mean)) / mean)

    return ratio(mean * rng.exponential(size=SIMULATED_PINGS)), ratio(rng.exponential(size=clutter))


def passages(
    case: Case, options: ScoreOptions, windows: Sequence[int]
) -> list[tuple[float, FloatArray]]:
    """For each window the threshold of `score` and the share of targets that passed it by scan.

    The targets have the stated P_D and at least the case's scans, without clutter.
    """
    plans_of = partial(
        threshold_plan.score_plans,
        case.sensor,
        max_speed=case.max_speed,
        interval=threshold_plan.rounded(case.interval),
        windows=tuple(windows),
        scans=max(case.scans, *windows),
        gate_probability=options.gate_probability,
        process_noise=options.process_noise,
        deletion=math.log(options.miss_probability),
        min_hits=MIN_HITS,
    )
    if case.ratio_db is None or case.common.intensity == "off":
        plans, of_targets = plans_of(), plans_of(fades=False)
    else:  # nobody tells the method the ratio
        plans = plans_of(ratio=ANY_RATIO)
        of_targets = plans_of(ratio=10.0 ** (case.ratio_db / 10.0), fades=False)
    share = min(options.false_tracks_per_hour / case.starts_per_hour, 1.0)
    thresholds = [plan.threshold(share) for plan in plans]
    return [
        (threshold, plan.passed(threshold))
        for plan, threshold in zip(of_targets, thresholds, strict=True)
    ]


def score_thresholds(
    case: Case, options: ScoreOptions, windows: Sequence[int]
) -> list[tuple[float, float]]:
    """For each window the threshold of `score`, and the share that passes it in the case's scans.

    See `passages`.
    """
    return [
        (threshold, float(passed[case.scans - 1]))
        for threshold, passed in passages(case, options, windows)
    ]


def score_window(case: Case, options: ScoreOptions) -> int:
    """The shortest window beyond which P_D hardly increases."""
    windows = [window for window in WINDOWS if window <= max(case.scans, WINDOWS[0])]
    shares = np.array([share for _, share in score_thresholds(case, options, windows)])
    return windows[int(np.argmax(shares >= shares.max() - MIN_DETECTION_INCREASE))]


def rules_within(
    case: Case, options: TsepmOptions, false_per_hour: float, workers: Workers = ONE_PROCESS
) -> list[Rule]:
    """For each window the rule of fewest hits that keeps the target false-track rate, if any."""
    windows = [window for window in reversed(RULE_WINDOWS) if window <= case.scans]
    jobs = [(case, options, false_per_hour, window) for window in windows]  # the longest first
    rules = [rule for rule in workers.mapped(_rule_within, jobs) if rule is not None]
    return rules[::-1]


def _rule_within(job: tuple[Case, TsepmOptions, float, int]) -> Rule | None:
    case, options, false_per_hour, window = job
    sensor, gate = case.sensor, options.gate_probability
    gating = Gating(
        sensor=sensor, max_speed=case.max_speed, interval=case.interval, gate_probability=gate
    )

    def chosen(min_hits: int) -> TsepmOptions:
        return dataclasses.replace(options, min_hits=min_hits, window=window)

    def predicted(min_hits: int) -> float:
        raw = expected_counts(gating, min_hits, window, 3 * window).raw[window:].mean()
        rate = float(raw) * case.scans_per_hour
        if rate > false_per_hour:
            rate *= clutter_pass_share(gating, chosen(min_hits))
        return rate

    numbers = range(2, window + 1)  # the rate falls with each more hit
    place = bisect_left(numbers, True, key=lambda number: predicted(number) <= false_per_hour)
    if place == len(numbers):
        return None
    min_hits, probability = numbers[place], sensor.detection_probability
    passes = target_pass_share(gating, chosen(min_hits), case.target_speed)
    by_scan = confirmed_by(min_hits, window, probability, gate, case.scans, passes)
    return Rule(
        min_hits,
        window,
        rule_detection_probability(min_hits, window, probability, gate),
        float(by_scan[-1]),
        predicted(min_hits),
    )


def clutter_scans(case: Case, false_per_hour: float) -> int:
    """Number of scans with clutter alone: EXPECTED_FALSE_TRACKS at the rate, within the cost."""
    affordable = MAX_CLUTTER_DETECTIONS / max(case.detections_per_scan, MIN_DETECTIONS_PER_SCAN)
    needed = EXPECTED_FALSE_TRACKS / false_per_hour * case.scans_per_hour
    return int(max(min(needed, affordable), MIN_CLUTTER_SCANS))


def candidates(
    case: Case,
    score: ScoreOptions,
    tsepm: TsepmOptions,
    rules: list[Rule],
    *,
    wanted: float,
    runs: int,
    seed: int,
    workers: Workers,
    progress: Labelled,
) -> Iterator[Candidate]:
    """The method `score` and the M/N rules of highest P_D, each run on targets and on clutter.

    All get the same targets, until P_D is known within `HALF_WIDTH` and is certainly above or below
    the required P_D. A rule whose P_D is below that
    of `score`, if `score` keeps the rate, is not run further.

    Parameters
    ----------
    case : Case
    score : ScoreOptions
    tsepm : TsepmOptions
        Options besides the rule.
    rules : list of Rule
        Rules that keep the target false-track rate.
    wanted : float
        Required P_D.
    runs : int
        Maximum number of targets.
    seed : int
    workers : Workers
    progress : callable
        Progress of a part by its name.
    """
    rate = score.false_tracks_per_hour
    scans = clutter_scans(case, rate)
    rival = -math.inf  # the P_D that another method has at least

    def enough(found: Estimate) -> bool:
        decided = not found.low < wanted <= found.high
        return (decided and known_within(found, HALF_WIDTH)) or found.high < rival

    def candidate(name: str, method: str, own: dict[str, Any], bound: float) -> Candidate:
        options = {**dataclasses.asdict(case.common), **own}
        targets = target_statistics(
            case,
            method,
            options,
            runs=runs,
            seed=seed,
            workers=workers,
            progress=progress(f"{name}, targets"),
            enough=enough,
        )
        false = Estimate.unknown()
        if targets.detection.high >= rival:
            shown = progress(f"{name}, clutter")
            false = false_tracks_per_hour(
                case, method, options, scans=scans, seed=seed, workers=workers, progress=shown
            )
        return Candidate(name, method, options, bound, targets, false)

    best = candidate("score", "score", dataclasses.asdict(score), rate)
    yield best
    if best.keeps(rate):
        rival = best.targets.detection.low
    for rule in sorted(rules, key=lambda rule: -rule.in_time)[:MAX_SIMULATED_RULES]:
        changes = {"min_hits": rule.min_hits, "window": rule.window}
        own = {**dataclasses.asdict(tsepm), **changes}
        yield candidate(f"tsepm {rule.min_hits}/{rule.window}", "tsepm", own, rule.false_per_hour)


def known_within(estimate: Estimate, half_width: float) -> bool:
    """Whether the interval of an estimate is narrow enough."""
    return estimate.high - estimate.low <= 2.0 * half_width


@dataclass(frozen=True, eq=False)
class FirstEstimate:
    """Threshold of `score` and P_D, of targets without clutter about them.

    Attributes
    ----------
    window : int
        Window of `score`, scans.
    threshold : float
        Log-likelihood ratio.
    found : (scans,) ndarray
        P_D by each scan.
    """

    window: int
    threshold: float
    found: FloatArray

    @property
    def detection(self) -> float:
        """P_D within all scans."""
        return float(self.found[-1])

    def scans_until(self, share: float) -> int | None:
        """Scans within which a share of the targets is found; None if it is not."""
        reached = self.found >= share
        return int(np.argmax(reached)) + 1 if reached[-1] else None


def first_estimate(case: Case, options: ScoreOptions, *, given_window: bool) -> FirstEstimate:
    """The estimate of a case, at the design's window unless the given window is kept."""
    if not given_window:
        options = dataclasses.replace(options, window=score_window(case, options))
    [(threshold, found)] = passages(case, options, [options.window])
    return FirstEstimate(options.window, threshold, found[: case.scans])


REMEDY_HALF_WIDTH = 0.09
"""Half the width of the interval of P_D at which the simulation of a change ends."""


def remedies(case: Case) -> list[tuple[str, Case]]:
    """Changes that may raise P_D, each with the changed case."""
    sensor = case.sensor

    def changed(**values: float) -> Case:
        return dataclasses.replace(case, sensor=dataclasses.replace(sensor, **values))

    range_errors = {
        name: 0.5 * getattr(sensor, name) for name in ("range_std", "range_std_fraction")
    }
    farthest = max(0.7 * sensor.max_range, 0.5 * (sensor.min_range + sensor.max_range))
    changes = [
        ("twice as many pings", dataclasses.replace(case, scans=2 * case.scans)),
        ("half the sector", changed(azimuth_max=sensor.azimuth_min + 0.5 * sensor.sector_width)),
        ("half the bearing error", changed(azimuth_std=0.5 * sensor.azimuth_std)),
        ("half the range error", changed(**range_errors)),
        ("half the clutter", changed(clutter_density=0.5 * sensor.clutter_density)),
    ]
    if case.target_range is None:
        changes.append((f"a range of {farthest:.0f} m", changed(max_range=farthest)))
    return changes


def remedied_detection(
    case: Case,
    score: ScoreOptions,
    *,
    given_window: bool,
    runs: int,
    seed: int,
    workers: Workers,
    progress: Labelled,
) -> Iterator[tuple[str, Estimate]]:
    """P_D of the method `score` with each change, and at a larger false-track rate.

    Parameters
    ----------
    case : Case
    score : ScoreOptions
    given_window : bool
        Whether the window of `score` is kept.
    runs, seed, workers, progress
        As in `candidates`; P_D is determined within `REMEDY_HALF_WIDTH`.
    """
    more = dataclasses.replace(score, false_tracks_per_hour=10.0 * score.false_tracks_per_hour)
    cases = [(text, changed, score) for text, changed in remedies(case)]
    cases.append(("ten times as many false tracks", case, more))
    jobs = [(changed, options, given_window, runs, seed) for _, changed, options in cases]
    found = progress("possible changes")(workers.mapped(_remedied, jobs), len(jobs))
    for (text, _, _), detection in zip(cases, found, strict=True):
        yield text, detection


def _remedied(job: tuple[Case, ScoreOptions, bool, int, int]) -> Estimate:
    """P_D of a changed case, by this process alone."""
    case, score, given_window, runs, seed = job
    window = score.window if given_window else score_window(case, score)
    options = {**dataclasses.asdict(case.common), **dataclasses.asdict(score), "window": window}
    return target_statistics(
        case,
        "score",
        options,
        runs=runs,
        seed=seed,
        enough=lambda found: known_within(found, REMEDY_HALF_WIDTH),
    ).detection
