"""Telling what a design came to, in a terminal."""

from __future__ import annotations

import math
from collections.abc import Sequence

from tsepm_ros.analysis.intervals import Estimate
from tsepm_ros.analysis.text_tables import text_table
from tsepm_ros.design.design_case import Case
from tsepm_ros.design.search import WINDOWS, Candidate, Rule, Worth
from tsepm_ros.methods.score.score_options import MIN_HITS


def case_lines(case: Case, false_per_hour: float) -> str:
    """What is designed for, in two lines."""
    sensor = case.sensor
    where = "anywhere in the coverage"
    if case.target_range is not None:
        where = f"{case.target_range:g} m away half-way"
    return (
        f"sonar: {sensor.coverage_area / 1e6:.4g} km^2, a ping every {case.interval:g} s, "
        f"{case.detections_per_scan:.3g} false detections in each: {case.starts_per_hour:.0f} "
        f"an hour, of which {false_per_hour:g} may become a track\n"
        f"targets: {case.target_speed:g} m/s (up to {case.max_speed:g} allowed), {where}, to be "
        f"found within {case.scans} pings ({(case.scans - 1) * case.interval:g} s) inside it"
    )


def worth_line(worth: Worth, threshold: float) -> str:
    """How far a ping's evidence goes towards the threshold."""
    text = (
        f"evidence: a hit adds {worth.hit:+.1f}, a miss {worth.miss:+.1f}, a ping "
        f"{worth.scan:+.2f} at most (on average, the target's place known); the threshold is "
        f"{threshold:.1f}: "
    )
    pings = max(math.ceil(threshold / max(worth.scan, 1e-9)), MIN_HITS)
    if pings > WINDOWS[-1]:
        return f"{text}more pings than the longest window, {WINDOWS[-1]}"
    return f"{text}{pings} pings, and those that tell the velocity"


def rule_table(rules: Sequence[Rule]) -> str:
    """The M/N rules that keep the wish."""
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
    """What the candidates do; `area` is the coverage's, m^2."""
    return text_table(
        [
            "method",
            "P_D",
            "95 %",
            "time [s]",
            "95 % by",
            "wish or bound/h",
            "false/h",
            "95 %",
            "per h and km^2",
        ],
        [
            [
                one.name,
                f"{one.found.detection.value:.3f}",
                _interval(one.found.detection, ".3f"),
                f"{one.found.confirmation_time.value:.0f}",
                f"{one.found.slow_confirmation_time:.0f}",
                f"{one.false_bound:.2g}",
                f"{one.false_simulated.value:.2g}",
                _interval(one.false_simulated, ".2g"),
                f"{one.false_simulated.value / (area / 1e6):.2g}",
            ]
            for one in candidates
        ],
    )


def _interval(estimate: Estimate, spec: str) -> str:
    return f"{estimate.low:{spec}} to {estimate.high:{spec}}"


def verdict(candidates: Sequence[Candidate], wanted: float, false_per_hour: float) -> str:
    """Whether the wish can be met, and with what."""
    keeping = [one for one in candidates if one.keeps(false_per_hour)]
    if not keeping:
        return f"the wish cannot be met: more than {false_per_hour:g} false tracks an hour"
    best = max(keeping, key=lambda one: one.found.detection.value)
    share = best.found.detection
    text = f"{best.name} finds {share.value:.2f} of the targets in time"
    if share.low >= wanted:
        return f"the wish can be met: {text}, at least {wanted:g}"
    if share.high >= wanted:
        return f"not decided by so many runs: {text} ({_interval(share, '.2f')}), wanted {wanted:g}"
    return f"the wish cannot be met: {text}, not {wanted:g}"


def remedy_table(remedies: Sequence[tuple[str, Estimate]]) -> str:
    """What changes would do, the present state first and then the most helpful."""
    now, *changes = remedies
    ordered = [now, *sorted(changes, key=lambda row: -row[1].value)]
    return text_table(
        ["with a change", "P_D", "95 %"],
        [[text, f"{found.value:.2f}", _interval(found, ".2f")] for text, found in ordered],
    )
