"""Telling what a design came to, in a terminal."""

from __future__ import annotations

from collections.abc import Sequence

from tsepm_ros.analysis.designing import Candidate, Rule, Worth
from tsepm_ros.analysis.intervals import Estimate
from tsepm_ros.analysis.prediction import Case
from tsepm_ros.analysis.report import text_table


def case_lines(case: Case, false_per_hour: float) -> str:
    """What is designed for, in two lines."""
    where = f"{case.target_range:g} m away" if case.target_range else "anywhere in the coverage"
    duration = (case.scans - 1) * case.interval
    return (
        f"sonar: {case.sensor.coverage_area / 1e6:.1f} km^2, a ping every {case.interval:g} s, "
        f"{case.detections_per_scan:.1f} false detections in each: {case.starts_per_hour:.0f} "
        f"an hour, of which {false_per_hour:g} may become a track\n"
        f"targets: {case.target_speed:g} m/s (up to {case.max_speed:g} allowed), {where}, to be "
        f"found within {case.scans} pings ({duration:g} s)"
    )


def worth_line(worth: Worth, threshold: float) -> str:
    """How far a ping's evidence goes towards the threshold."""
    text = (
        f"evidence: a hit is worth {worth.hit:+.1f}, a miss {worth.miss:+.1f}, a ping "
        f"{worth.scan:+.1f} on average at best; the threshold is {threshold:.1f}"
    )
    if worth.scan <= 0.0:
        return f"{text}: no number of pings reaches it but by luck"
    return f"{text}: about {threshold / worth.scan:.0f} pings and those that tell the velocity"


def rule_table(rules: Sequence[Rule]) -> str:
    """The M/N rules that keep the wish."""
    return text_table(
        ["M/N", "P_D of one start", "in time", "false/h at most"],
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
            "false/h",
            "simulated",
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
                f"{one.false_predicted:.2g}",
                f"{one.false_measured.value:.2g}",
                _interval(one.false_measured, ".2g"),
                f"{one.false_measured.value / (area / 1e6):.2g}",
            ]
            for one in candidates
        ],
    )


def _interval(estimate: Estimate, spec: str) -> str:
    return f"{estimate.low:{spec}} to {estimate.high:{spec}}"


def verdict(candidates: Sequence[Candidate], wanted: float, worth: Worth) -> str:
    """Whether the wish can be met, and with what."""
    best = max(candidates, key=lambda one: one.found.detection.value)
    share = best.found.detection
    if share.low >= wanted:
        return f"the wish can be met: {best.name} finds at least {wanted:g} of the targets in time"
    if share.high >= wanted:
        return f"the wish is just about met: {best.name} finds {share.value:.2f} in time"
    why = "a ping tells less about a target than it costs to miss it: " if worth.scan <= 0 else ""
    return (
        f"the wish cannot be met: {why}{best.name} finds {share.value:.2f} of the targets in time, "
        f"not {wanted:g}"
    )


def remedy_table(remedies: Sequence[tuple[str, Estimate]]) -> str:
    """What would help, the most helpful first."""
    ordered = sorted(remedies, key=lambda row: -row[1].value)
    return text_table(
        ["what would help", "P_D", "95 %"],
        [[text, f"{found.value:.2f}", _interval(found, ".2f")] for text, found in ordered],
    )
