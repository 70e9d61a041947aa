"""Report of a design, and remedies.

Report of a design for the terminal.

Changes of a sonar that may raise P_D, and the P_D with each.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Sequence

from tsepm_ros.tools.design.design_case import Case
from tsepm_ros.tools.design.prediction import target_statistics
from tsepm_ros.tools.design.search import (
    WINDOWS,
    Candidate,
    FirstEstimate,
    Labelled,
    PingIncrements,
    Rule,
    known_within,
    score_window,
)
from tsepm_ros.tools.evaluation.intervals import Estimate
from tsepm_ros.tools.evaluation.workers import Workers
from tsepm_ros.tools.terminal import text_table
from tsepm_ros.tracker.options import MIN_HITS, ScoreOptions


def case_lines(case: Case, false_per_hour: float) -> str:
    """The case of a design in two lines."""
    sensor = case.sensor
    where = "anywhere in the coverage"
    if case.target_range is not None:
        where = f"at {case.target_range:g} m in the middle of the run"
    if case.ratio_db is not None:
        where += f", {case.ratio_db:g} dB above the clutter"
    return (
        f"sonar: {sensor.coverage_area / 1e6:.4g} km^2, a ping every {case.interval:g} s, "
        f"{case.detections_per_scan:.3g} false detections in each: {case.starts_per_hour:.0f} "
        f"an hour; target false-track rate {false_per_hour:g} per hour\n"
        f"targets: {case.target_speed:g} m/s (up to {case.max_speed:g} allowed), {where}, to be "
        f"found within {case.scans} pings ({(case.scans - 1) * case.interval:g} s) inside it"
    )


def increments_line(increments: PingIncrements, threshold: float) -> str:
    """Mean increments of a ping and the number of pings up to the threshold."""
    text = (
        f"mean increment of the log-likelihood ratio, the target's position known: hit "
        f"{increments.hit:+.1f}, miss {increments.miss:+.1f}, ping {increments.scan:+.2f} at most; "
        f"threshold {threshold:.1f}: "
    )
    pings = max(math.ceil(threshold / max(increments.scan, 1e-9)), MIN_HITS)
    if pings > WINDOWS[-1]:
        return f"{text}more pings than the longest window, {WINDOWS[-1]}"
    return f"{text}about {pings} pings, plus those needed to estimate the velocity"


def first_line(estimate: FirstEstimate, case: Case) -> str:
    """The first estimate in a line."""
    if not estimate.detection > 0.0:
        return "first estimate, without simulation: no target is found in time"
    text = (
        f"first estimate, without simulation: score finds about {estimate.detection:.2f} of the "
        f"targets in time"
    )
    half = estimate.scans_until(0.5)
    if half is None:
        return text
    return f"{text}, half of the targets within {half} pings ({(half - 1) * case.interval:g} s)"


def rule_table(rules: Sequence[Rule]) -> str:
    """Table of the M/N rules that keep the target false-track rate."""
    return text_table(
        ["M/N", "P_D of one start", "in time, evaluated", "false/h at most"],
        [
            [
                f"{rule.min_hits}/{rule.window}",
                f"{rule.one_start:.4f}",
                f"{rule.in_time:.3f}",
                f"{rule.false_per_hour:.2g}",
            ]
            for rule in rules
        ],
    )


def candidate_table(candidates: Sequence[Candidate], area: float) -> str:
    """Table of the candidates' simulated performance; `area` is that of the coverage, m^2."""
    return text_table(
        [
            "method",
            "targets",
            "P_D",
            "95 %",
            "time [s]",
            "95 % by",
            "bound/h",
            "false/h",
            "95 %",
            "per h and km^2",
        ],
        [
            [
                candidate.name,
                f"{candidate.targets.targets}",
                f"{candidate.targets.detection.value:.3f}",
                _interval(candidate.targets.detection, ".3f"),
                f"{candidate.targets.confirmation_time.value:.4g}",
                f"{candidate.targets.slow_confirmation_time:.4g}",
                f"{candidate.false_bound:.2g}",
                *_rate_cells(candidate.false_simulated, area),
            ]
            for candidate in candidates
        ],
    )


def _rate_cells(false: Estimate, area: float) -> list[str]:
    if math.isnan(false.value):
        return ["-", "-", "-"]
    per_area = false.value / (area / 1e6)
    return [f"{false.value:.2g}", _interval(false, ".2g"), f"{per_area:.2g}"]


def _interval(estimate: Estimate, spec: str) -> str:
    return f"{estimate.low:{spec}} to {estimate.high:{spec}}"


def verdict(candidates: Sequence[Candidate], wanted: float, false_per_hour: float) -> str:
    """Sentence on whether P_D is reached at the target false-track rate, and by which method."""
    keeping = [candidate for candidate in candidates if candidate.keeps(false_per_hour)]
    if not keeping:
        return f"infeasible: every method has more than {false_per_hour:g} false tracks per hour"
    best = max(keeping, key=lambda candidate: candidate.targets.detection.value)
    share = best.targets.detection
    text = f"{best.name} finds {share.value:.2f} of the targets in time"
    if share.low >= wanted:
        return f"feasible: {text}, at least {wanted:g}"
    if share.high >= wanted:
        return f"undecided by the runs: {text} ({_interval(share, '.2f')}), wanted {wanted:g}"
    return f"infeasible: {text}, less than {wanted:g}"


def remedy_table(remedies: Sequence[tuple[str, Estimate]]) -> str:
    """Table of P_D with each change, the present case first and then by P_D, descending."""
    now, *changes = remedies
    ordered = [now, *sorted(changes, key=lambda row: -row[1].value)]
    return text_table(
        ["with a change", "P_D", "95 %"],
        [[text, f"{share.value:.2f}", _interval(share, ".2f")] for text, share in ordered],
    )


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
