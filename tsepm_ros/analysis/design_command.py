"""The command `tsepm design`: its arguments, and what it prints."""

from __future__ import annotations

import argparse
import dataclasses
import os
from pathlib import Path

import yaml

from tsepm_ros.analysis import designing
from tsepm_ros.analysis.design_report import (
    candidate_table,
    case_lines,
    remedy_table,
    rule_table,
    verdict,
    worth_line,
)
from tsepm_ros.analysis.designing import Candidate
from tsepm_ros.analysis.evaluate_command import positive
from tsepm_ros.analysis.prediction import Case
from tsepm_ros.analysis.report import with_progress
from tsepm_ros.initiator import CommonOptions
from tsepm_ros.methods.score import ScoreOptions
from tsepm_ros.methods.tsepm import TsepmOptions
from tsepm_ros.parameter_groups import TRACK_INITIATOR, make_groups, parse_values
from tsepm_ros.parameters import Value
from tsepm_ros.sensor import SensorModel

REMEDY_RUNS = 100
"""Targets simulated, at most, for each change that may help."""


def add_design_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of a design, but for the parameters."""
    parser.add_argument("--interval", type=float, default=12.0, help="time between pings, s")
    parser.add_argument("--scans", type=positive, default=16, help="pings to find a target in")
    parser.add_argument("--speed", type=float, help="of the targets, m/s; default half max_speed")
    parser.add_argument(
        "--range", type=float, help="of the targets, m; default all over the coverage"
    )
    parser.add_argument(
        "--wanted", type=float, default=0.9, help="share of the targets to be found"
    )
    parser.add_argument("--runs", type=positive, default=400, help="targets simulated")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=positive, default=os.cpu_count() or 1)
    parser.add_argument("--write", metavar="FILE", help="write a parameter file for the node")


def run_design(options: argparse.Namespace) -> None:
    """Design, print what to expect, and write parameters.

    Parameters
    ----------
    options : argparse.Namespace
        From `add_design_arguments`, and `parameter`.

    Raises
    ------
    ValueError
        If something given is not allowed.
    """
    values = parse_values(options.parameter)
    made = make_groups(TRACK_INITIATOR, values)
    case = _case(options, made[SensorModel], made[CommonOptions].max_speed)
    score = made[ScoreOptions]
    if "score.window" not in values:
        score = dataclasses.replace(score, window=designing.score_window(case, score))
    worth = designing.worth(case, score.gate_probability)
    print(case_lines(case, score.false_tracks_per_hour))
    print(worth_line(worth, designing.score_threshold(case, score)[0]))
    rules = designing.rules_within(case, made[TsepmOptions], score.false_tracks_per_hour)
    print("\nM/N rules of the method tsepm that keep the wish:", "" if rules else "none")
    if rules:
        print(rule_table(rules))
    amount = {"runs": options.runs, "seed": options.seed, "workers": options.workers}
    found = list(designing.candidates(case, score, made[TsepmOptions], rules, **amount))
    print(
        f"\nsimulated, {options.runs} targets, seed {options.seed}; score with window "
        f"{score.window}; 95 % intervals"
    )
    print(candidate_table(found, case.sensor.coverage_area))
    print(f"\n{verdict(found, options.wanted, worth)}", flush=True)
    if max(one.found.detection.high for one in found) < options.wanted:
        amount["runs"] = min(options.runs, REMEDY_RUNS)
        changes = designing.with_remedies(case, score, **amount)
        print(remedy_table(list(with_progress(changes, designing.REMEDIES))))
    if options.write:
        _write_parameters(options.write, values, found)


def _case(options: argparse.Namespace, sensor: SensorModel, max_speed: float) -> Case:
    return Case(
        sensor=sensor,
        max_speed=max_speed,
        interval=options.interval,
        scans=options.scans,
        target_speed=0.5 * max_speed if options.speed is None else options.speed,
        target_range=options.range,
    )


def _write_parameters(path: str, values: dict[str, Value], found: list[Candidate]) -> None:
    """Write what was given and what follows for the best candidate."""
    best = max(found, key=lambda one: one.found.detection.value)
    own = ("window",) if best.method == "score" else ("min_hits", "window")
    chosen = {"method": best.method}
    chosen |= {f"{best.method}.{name}": best.options[name] for name in own}
    content = {"track_initiator": {"ros__parameters": {**values, **chosen}}}
    try:
        Path(path).write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    except OSError as error:
        raise ValueError(f"{path} cannot be written: {error}") from None
