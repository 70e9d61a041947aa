"""From a sonar's data sheet and a wish to a method's parameters, and what to expect of them."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.analysis.intervals import Estimate
from tsepm_ros.design.design_case import Case
from tsepm_ros.design.expected_counts import Gating, expected_counts
from tsepm_ros.design.mn_rules import confirmed_by, rule_detection_probability
from tsepm_ros.design.pass_shares import clutter_pass_share, target_pass_share
from tsepm_ros.design.prediction import Found, false_tracks_per_hour, targets_found
from tsepm_ros.methods.score import threshold_plan
from tsepm_ros.methods.score.likelihood_ratio import MAX_DETECTION_PROBABILITY, miss_increment
from tsepm_ros.methods.score.score_options import MIN_HITS, ScoreOptions
from tsepm_ros.methods.tsepm.tsepm_options import TsepmOptions
from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.numerics.gaussian import gate_factor
from tsepm_ros.sensing.conversion import position_covariance

WINDOWS = (8, 12, 16, 24, 32, 48, 64)
RULE_WINDOWS = (3, 4, 5, 6, 8, 10, 12, 14, 16, 20, 24)
WORTH_A_LONGER_WINDOW = 0.01
"""Share of the targets that a longer window must find beyond the shorter."""
SIMULATED_RULES = 2
PINGS = 100_000
"""Simulated pings for the worth of one."""
CLUTTER_DETECTIONS = 200_000.0
"""False detections that are simulated without a target, at most."""
LEAST_DETECTIONS = 20.0
"""A scan costs as much as one with so many, at least."""
ENOUGH_FALSE = 10.0
"""False tracks that tell a rate."""
FEWEST_CLUTTER_SCANS = 40


@dataclass(frozen=True)
class Rule:
    """An M/N rule that keeps the wish.

    Attributes
    ----------
    min_hits, window : int
        M and N.
    one_start : float
        P_D of one start, as in TSEPM 2018, Table 1.
    in_time : float
        P_D within the case's scans, of as many starts as fit, with the evaluation; without clutter.
    false_per_hour : float
        Confirmations from clutter that pass the evaluation, before merging: an upper estimate.
    """

    min_hits: int
    window: int
    one_start: float
    in_time: float
    false_per_hour: float


@dataclass(frozen=True)
class Candidate:
    """A method with its parameters, and what it was simulated to do.

    Attributes
    ----------
    name : str
    method : str
    options : dict
        For `make_initiator`.
    false_bound : float
        Wish that the threshold keeps, or upper estimate of the rule, per hour over the coverage.
    found : Found
    false_simulated : Estimate
        Per hour.
    """

    name: str
    method: str
    options: dict[str, Any]
    false_bound: float
    found: Found
    false_simulated: Estimate

    def keeps(self, false_per_hour: float) -> bool:
        """Whether what was simulated does not speak against it."""
        return self.false_simulated.low <= false_per_hour


@dataclass(frozen=True)
class Worth:
    """What a ping tells about a target whose place is known, in log-likelihood.

    Attributes
    ----------
    hit, miss : float
        Mean gain of the target's own detection, and of none.
    scan : float
        Mean gain of a ping, over all that may be the target's detection: never below 0.
    """

    hit: float
    miss: float
    scan: float


def worth(case: Case, gate_probability: float) -> Worth:
    """The most that a ping can tell, on average, at the typical distance.

    For a ping ``E[ln(1 - p_d P_G + (p_d / lambda) sum_j N(z_j; x, R))]`` over the target's
    detection and the clutter in its gate, R the error at the target's place: the innovation's
    covariance is never smaller. For a hit alone ``ln(p_d / (lambda 2 pi sqrt|R|)) - 1``, d^2 / 2
    having the mean 1.
    """
    sensor, range_ = case.sensor, case.typical_range
    error = position_covariance(range_, 0.0, sensor.range_variance(range_), sensor.azimuth_std)
    size = 2.0 * math.pi * math.sqrt(float(np.linalg.det(error)))  # 1 / N(0)
    probability = min(sensor.detection_probability, MAX_DETECTION_PROBABILITY)
    missed = float(miss_increment(np.array([probability]), gate_probability)[0])
    rng = np.random.default_rng(1)
    edge = 0.5 * gate_factor(gate_probability) ** 2  # d^2 / 2 is uniform in a gate of clutter
    clutter = rng.poisson(edge * size * sensor.clutter_density, PINGS)
    owner = np.repeat(np.arange(PINGS), clutter)
    own_rate, clutter_rate = _range_rate_ratios(case, owner)
    likelihood = clutter_rate * np.exp(-edge * rng.random(len(owner)))
    likelihood = np.asarray(np.bincount(owner, likelihood, minlength=PINGS), float)
    own = rng.exponential(1.0, PINGS)
    seen = (rng.random(PINGS) < probability) & (own <= edge)
    likelihood += np.where(seen, own_rate * np.exp(-own), 0.0)
    scale = probability / (sensor.clutter_density * size)
    mean = float(np.log(math.exp(missed) + scale * likelihood).mean())
    hit = math.log(scale) - 1.0 + float(np.log(own_rate).mean())
    return Worth(hit=hit, miss=missed, scan=max(mean, 0.0))


def _range_rate_ratios(case: Case, owner: NDArray[np.int64]) -> tuple[FloatArray, FloatArray]:
    """``N(e; 0, s^2) / p(c)`` of a target's range rates, (PINGS,), and of clutter's in its gate.

    `owner` (n,) is the ping of each false detection. The target's speed is known, as its place is,
    its heading any; all 1 where range rates are not used.
    """
    sensor = case.sensor
    sigma, half = sensor.range_rate_std, sensor.clutter_range_rate
    if not sigma:
        return np.ones(PINGS), np.ones(len(owner))
    rng = np.random.default_rng(2)
    true = case.target_speed * np.cos(rng.uniform(-math.pi, math.pi, PINGS))

    def ratio(rate: FloatArray, expected: FloatArray) -> FloatArray:
        likely = np.exp(-0.5 * np.square((rate - expected) / sigma)) / math.sqrt(2.0 * math.pi)
        density = half / (math.pi * (half**2 + np.square(rate)))
        return np.asarray(likely / sigma / density)

    own = ratio(true + sigma * rng.standard_normal(PINGS), true)
    return own, ratio(half * rng.standard_cauchy(len(owner)), true[owner])


def score_thresholds(
    case: Case, options: ScoreOptions, windows: Sequence[int]
) -> list[tuple[float, float]]:
    """For each window the threshold of `score`, and the share of targets that passes it.

    The share is that within the case's scans, without clutter.
    """
    plans = threshold_plan.score_plans(
        case.sensor,
        max_speed=case.max_speed,
        interval=threshold_plan.rounded(case.interval),
        windows=windows,
        scans=max(case.scans, *windows),
        gate_probability=options.gate_probability,
        process_noise=options.process_noise,
        deletion=math.log(options.miss_probability),
        min_hits=MIN_HITS,
    )
    share = min(options.false_tracks_per_hour / case.starts_per_hour, 1.0)
    thresholds = [plan.threshold(share) for plan in plans]
    return [
        (threshold, float(plan.passed(threshold)[case.scans - 1]))
        for plan, threshold in zip(plans, thresholds, strict=True)
    ]


def score_window(case: Case, options: ScoreOptions) -> int:
    """The shortest window beyond which hardly more targets are found."""
    windows = [window for window in WINDOWS if window <= max(case.scans, WINDOWS[0])]
    shares = np.array([share for _, share in score_thresholds(case, options, windows)])
    return windows[int(np.argmax(shares >= shares.max() - WORTH_A_LONGER_WINDOW))]


def rules_within(case: Case, options: TsepmOptions, false_per_hour: float) -> list[Rule]:
    """For each window the rule of fewest hits that keeps the wish, if there is one."""
    windows = [window for window in RULE_WINDOWS if window <= case.scans]
    found = (_rule_within(case, options, false_per_hour, window) for window in windows)
    return [rule for rule in found if rule is not None]


def _rule_within(
    case: Case, options: TsepmOptions, false_per_hour: float, window: int
) -> Rule | None:
    sensor, gate = case.sensor, options.gate_probability
    gating = Gating(
        sensor=sensor, max_speed=case.max_speed, interval=case.interval, gate_probability=gate
    )
    for min_hits in range(2, window + 1):
        chosen = dataclasses.replace(options, min_hits=min_hits, window=window)
        raw = expected_counts(gating, min_hits, window, 3 * window).raw[window:].mean()
        predicted = raw * case.scans_per_hour
        if predicted > false_per_hour:
            predicted *= clutter_pass_share(gating, chosen)
        if predicted <= false_per_hour:
            probability = sensor.detection_probability
            passes = target_pass_share(gating, chosen, case.target_speed)
            by_scan = confirmed_by(min_hits, window, probability, gate, case.scans, passes)
            return Rule(
                min_hits,
                window,
                rule_detection_probability(min_hits, window, probability, gate),
                float(by_scan[-1]),
                float(predicted),
            )
    return None


def clutter_scans(case: Case, false_per_hour: float) -> int:
    """Scans of clutter alone to simulate: enough to tell the wish, as far as the work allows."""
    affordable = CLUTTER_DETECTIONS / max(case.detections_per_scan, LEAST_DETECTIONS)
    enough = ENOUGH_FALSE / false_per_hour * case.scans_per_hour
    return int(max(min(enough, affordable), FEWEST_CLUTTER_SCANS))


def candidates(
    case: Case,
    score: ScoreOptions,
    tsepm: TsepmOptions,
    rules: list[Rule],
    **simulation: Any,
) -> Iterator[Candidate]:
    """The method `score` and the most promising M/N rules, each run on targets and on clutter.

    Parameters
    ----------
    case : Case
    score : ScoreOptions
    tsepm : TsepmOptions
        But for the rule.
    rules : list of Rule
        That keep the wish.
    **simulation
        `runs`, `seed`, `workers` and `progress`, see `targets_found`.
    """
    common = dataclasses.asdict(case.common)
    wish = score.false_tracks_per_hour
    chosen = [("score", "score", dataclasses.asdict(score), wish)]
    for rule in sorted(rules, key=lambda rule: -rule.in_time)[:SIMULATED_RULES]:
        changes = {"min_hits": rule.min_hits, "window": rule.window}
        name = f"tsepm {rule.min_hits}/{rule.window}"
        chosen.append(
            (name, "tsepm", {**dataclasses.asdict(tsepm), **changes}, rule.false_per_hour)
        )
    alone = {name: value for name, value in simulation.items() if name != "runs"}
    scans = clutter_scans(case, wish)
    for name, method, own, bound in chosen:
        options = {**common, **own}
        found = targets_found(case, method, options, **simulation)
        false = false_tracks_per_hour(case, method, options, scans=scans, **alone)
        yield Candidate(name, method, options, bound, found, false)


def remedies(case: Case) -> list[tuple[str, Case]]:
    """Changes that may help where targets are not found, with the case as it would be."""
    sensor = case.sensor

    def changed(**values: float) -> Case:
        return dataclasses.replace(case, sensor=dataclasses.replace(sensor, **values))

    errors = {"range_std": 0.5 * sensor.range_std}
    errors["range_std_fraction"] = 0.5 * sensor.range_std_fraction
    farthest = max(0.7 * sensor.max_range, 0.5 * (sensor.min_range + sensor.max_range))
    changes = [
        ("twice as many pings", dataclasses.replace(case, scans=2 * case.scans)),
        ("half the sector", changed(azimuth_max=sensor.azimuth_min + 0.5 * sensor.sector_width)),
        ("half the bearing error", changed(azimuth_std=0.5 * sensor.azimuth_std)),
        ("half the range error", changed(**errors)),
        ("half the clutter", changed(clutter_density=0.5 * sensor.clutter_density)),
    ]
    if case.target_range is None:
        changes.append((f"a range of {farthest:.0f} m", changed(max_range=farthest)))
    return changes


def with_remedies(
    case: Case, score: ScoreOptions, *, given_window: bool, **simulation: Any
) -> Iterator[tuple[str, Estimate]]:
    """What the method `score` finds as it is, with each change, and with a larger wish.

    Parameters
    ----------
    case : Case
    score : ScoreOptions
    given_window : bool
        Whether its window stays.
    **simulation
        As in `candidates`.
    """
    more = dataclasses.replace(score, false_tracks_per_hour=10.0 * score.false_tracks_per_hour)
    cases = [("as it is", case, score)]
    cases += [(text, changed, score) for text, changed in remedies(case)]
    cases.append(("ten times as many false tracks", case, more))
    for text, changed, options in cases:
        window = score.window if given_window else score_window(changed, options)
        given = {**dataclasses.asdict(case.common), **dataclasses.asdict(options)}
        found = targets_found(changed, "score", {**given, "window": window}, **simulation)
        yield text, found.detection
