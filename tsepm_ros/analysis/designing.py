"""From a sonar's data sheet and a wish to a method's parameters, and what to expect of them."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from tsepm_ros import design
from tsepm_ros.analysis.intervals import Estimate
from tsepm_ros.analysis.prediction import (
    Case,
    Found,
    clutter_pass_share,
    false_tracks_per_hour,
    target_pass_share,
    targets_found,
)
from tsepm_ros.analysis.rules import confirmed_by, rule_detection_probability
from tsepm_ros.analysis.splitting_theory import Gating, expected_counts
from tsepm_ros.conversion import position_covariance
from tsepm_ros.evidence import miss_gain
from tsepm_ros.methods.score import MIN_HITS, ScoreOptions
from tsepm_ros.methods.tsepm import TsepmOptions

WINDOWS = (8, 12, 16, 24, 32, 48, 64)
RULE_WINDOWS = (3, 4, 5, 6, 8, 10, 12, 14, 16, 20, 24)
WORTH_A_LONGER_WINDOW = 0.01
"""Share of the targets that a longer window must find beyond the shorter."""
REMEDIES = 7
"""Changes that `with_remedies` tries."""
CLUTTER_SCANS = 400
"""Scans of clutter alone that are simulated, at the usual number of detections."""
USUAL_DETECTIONS = 250.0


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
    """A method with its parameters, and what it was measured to do.

    Attributes
    ----------
    name : str
    method : str
    options : dict
        For `make_initiator`.
    false_predicted : float
        Per hour, over the whole coverage.
    found : Found
    false_measured : Estimate
        Per hour.
    """

    name: str
    method: str
    options: dict[str, Any]
    false_predicted: float
    found: Found
    false_measured: Estimate


@dataclass(frozen=True)
class Worth:
    """What a ping tells about a target that is well known, in log-likelihood.

    Attributes
    ----------
    hit, miss : float
        Mean gain of a detection, and of none.
    scan : float
        Mean gain of a ping.
    """

    hit: float
    miss: float
    scan: float


def worth(case: Case, gate_probability: float) -> Worth:
    """The most that a ping can tell, on average, at the median distance.

    ``ln(p_d / (lambda 2 pi sqrt|R|)) - 1`` for a hit, R the error at the target's place: the
    innovation's covariance is never smaller, and d^2 / 2 has the mean 1.
    """
    sensor = case.sensor
    range_ = case.target_range or math.sqrt(0.5 * (sensor.min_range**2 + sensor.max_range**2))
    error = position_covariance(range_, 0.0, sensor.range_variance(range_), sensor.azimuth_std)
    density = 1.0 / (2.0 * math.pi * math.sqrt(float(np.linalg.det(error))))
    probability = sensor.detection_probability
    hit = math.log(probability * density / sensor.clutter_density) - 1.0
    miss = float(miss_gain(np.array([probability]), gate_probability)[0])
    return Worth(hit, miss, probability * hit + (1.0 - probability) * miss)


def score_threshold(case: Case, options: ScoreOptions) -> tuple[float, float]:
    """Threshold of the method `score` in this clutter, and the share of targets that passes it.

    The share is that within the case's scans, without clutter.
    """
    window = min(options.window, case.scans)
    plan = design.score_plan(
        case.sensor,
        max_speed=case.max_speed,
        interval=design.rounded(case.interval),
        window=window,
        gate_probability=options.gate_probability,
        process_noise=options.process_noise,
        deletion=math.log(options.miss_probability),
        min_hits=MIN_HITS,
        scans=case.scans,
    )
    threshold = plan.threshold(min(options.false_tracks_per_hour / case.starts_per_hour, 1.0))
    return threshold, float(plan.passed(threshold)[-1])


def score_window(case: Case, options: ScoreOptions) -> int:
    """The shortest window beyond which hardly more targets are found."""
    windows = [window for window in WINDOWS if window <= max(case.scans, WINDOWS[0])]
    shares = [
        score_threshold(case, dataclasses.replace(options, window=window))[1] for window in windows
    ]
    enough = np.array(shares) >= max(shares) - WORTH_A_LONGER_WINDOW
    return windows[int(np.argmax(enough))]


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


def candidates(
    case: Case,
    score: ScoreOptions,
    tsepm: TsepmOptions,
    rules: list[Rule],
    *,
    runs: int,
    seed: int,
    workers: int,
) -> Iterator[Candidate]:
    """The method `score` and the best M/N rule, each run on targets and on clutter.

    Parameters
    ----------
    case : Case
    score : ScoreOptions
    tsepm : TsepmOptions
        But for the rule.
    rules : list of Rule
        That keep the wish; the one that finds most is run.
    runs : int
        Targets.
    seed, workers : int
    """
    common = {"max_speed": case.max_speed}
    wanted = score.false_tracks_per_hour
    chosen: list[tuple[str, str, dict[str, Any], float]] = [
        ("score", "score", {**common, **dataclasses.asdict(score)}, wanted)
    ]
    if rules:
        best = max(rules, key=lambda rule: rule.in_time)
        rule = {"min_hits": best.min_hits, "window": best.window}
        options = {**common, **dataclasses.asdict(tsepm), **rule}
        name = f"tsepm {best.min_hits}/{best.window}"
        chosen.append((name, "tsepm", options, best.false_per_hour))
    scans = max(int(CLUTTER_SCANS * min(USUAL_DETECTIONS / case.detections_per_scan, 4.0)), 40)
    for name, method, options, predicted in chosen:
        yield Candidate(
            name,
            method,
            options,
            predicted,
            targets_found(case, method, options, runs=runs, seed=seed, workers=workers),
            false_tracks_per_hour(case, method, options, scans=scans, seed=seed, workers=workers),
        )


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
    case: Case, score: ScoreOptions, *, runs: int, seed: int, workers: int
) -> Iterator[tuple[str, Estimate]]:
    """What the method `score` would find with each change, and with a larger wish."""
    more = dataclasses.replace(score, false_tracks_per_hour=10.0 * score.false_tracks_per_hour)
    for text, changed in (*remedies(case), ("ten times as many false tracks", case)):
        options = more if changed is case else score
        window = score_window(changed, options)
        given = {**dataclasses.asdict(options), "window": window, "max_speed": case.max_speed}
        found = targets_found(changed, "score", given, runs=runs, seed=seed, workers=workers)
        yield text, found.detection
