"""The command `tsepm design`: arguments and printed report."""

from __future__ import annotations

import argparse
import dataclasses
import math
import sys
from pathlib import Path

import yaml

from tsepm_ros.methods.tsepm import TsepmOptions
from tsepm_ros.own_ship.mounting import Mounting
from tsepm_ros.parameters import Value
from tsepm_ros.session.sensor_check import questions
from tsepm_ros.settings.node_options import DiagnosticsOptions
from tsepm_ros.settings.parameter_files import ANY_NODE, add_values, given_values, parse_values
from tsepm_ros.settings.settings import TRACK_INITIATOR, make_groups
from tsepm_ros.tools.commands.arguments import add_runs, positive, workers_of
from tsepm_ros.tools.design import search
from tsepm_ros.tools.design.design_case import Case, target_scenes
from tsepm_ros.tools.design.design_report import (
    candidate_table,
    case_lines,
    first_line,
    increments_line,
    remedied_detection,
    remedy_table,
    rule_table,
    verdict,
)
from tsepm_ros.tools.design.search import Candidate, first_estimate
from tsepm_ros.tools.terminal import named_progress
from tsepm_ros.tracker.options import CommonOptions, ScoreOptions
from tsepm_ros.tracker.sensor import SensorModel
from tsepm_ros.whole_files import write_text

MAX_REMEDY_RUNS = 100
"""Maximum number of targets simulated for each proposed change."""


def add_design_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of a design."""
    parser.add_argument(
        "--interval",
        type=float,
        help="time between pings, s; default diagnostics.scan_period of the file, else 12",
    )
    parser.add_argument(
        "--false-detections",
        type=float,
        metavar="NUMBER",
        help="false detections per ping, over the whole coverage",
    )
    parser.add_argument(
        "--scans", type=positive, default=16, help="pings within which a target is to be found"
    )
    parser.add_argument(
        "--speed", type=float, help="speed of the targets, m/s; default half max_speed"
    )
    parser.add_argument(
        "--range", type=float, help="range of the targets, m; default anywhere in the coverage"
    )
    parser.add_argument(
        "--ratio",
        type=float,
        metavar="DB",
        help="signal-to-clutter ratio of the targets, dB, where detections have an intensity",
    )
    parser.add_argument(
        "--wanted", type=float, default=0.9, help="required share of targets that are found"
    )
    add_runs(parser, 400, "simulated targets, at most")
    parser.add_argument("--write", metavar="FILE", help="write a parameter file for the node")
    add_values(parser)


def run_design(options: argparse.Namespace) -> None:
    """Design, print the predicted performance, and write parameters.

    Parameters
    ----------
    options : argparse.Namespace
        From `add_design_arguments`, and `line`, the command line.

    Raises
    ------
    ValueError
        If an argument is not allowed.
    """
    _check(options)
    values = given_values(options.parameter)
    values.pop("method", None)  # the design chooses it
    groups = make_groups(TRACK_INITIATOR, values)
    if options.false_detections is not None:
        density = options.false_detections / groups[SensorModel].coverage_area
        values["sensor.clutter_density"] = density
        groups = make_groups(TRACK_INITIATOR, values)
    if options.interval is None:
        options.interval = groups[DiagnosticsOptions].scan_period or Case.interval
    for question in questions(groups[SensorModel], groups[Mounting]):
        print(f"note: {question}", file=sys.stderr)
    case = _case(options, groups[SensorModel], groups[CommonOptions])
    target_scenes(case, options.runs, options.seed)  # refuses targets that leave the coverage
    score, tsepm = groups[ScoreOptions], groups[TsepmOptions]
    target_rate = score.false_tracks_per_hour
    print(case_lines(case, target_rate), flush=True)
    first = first_estimate(case, score, given_window="score.window" in values)
    score = dataclasses.replace(score, window=first.window)
    increments = search.ping_increments(case, score.gate_probability)
    print(increments_line(increments, first.threshold))
    print(first_line(first, case), flush=True)
    rules = search.rules_within(case, tsepm, target_rate, workers_of(options))
    print(
        "\nM/N rules of the method tsepm that keep the target false-track rate:"
        + ("" if rules else " none")
    )
    if rules:
        print(rule_table(rules), flush=True)
    simulation = {
        "runs": options.runs,
        "seed": options.seed,
        "workers": workers_of(options),
        "progress": named_progress,
    }
    candidates = list(
        search.candidates(case, score, tsepm, rules, wanted=options.wanted, **simulation)
    )
    hours = search.clutter_scans(case, target_rate) / case.scans_per_hour
    print(
        f"\nsimulated: up to {options.runs} targets, {hours:.1f} h of clutter alone, seed "
        f"{options.seed}; score with window {score.window}; 95 % intervals; a dash: not simulated, "
        "since fewer targets are found"
    )
    print(candidate_table(candidates, case.sensor.coverage_area))
    assumed = ""
    if "sensor.clutter_density" not in values:
        assumed = (
            f"the clutter is not given; with the default, {case.detections_per_scan:.3g} false "
            "detections per ping (yours: --false-detections NUMBER), "
        )
    print(f"\n{assumed}{verdict(candidates, options.wanted, target_rate)}", flush=True)
    if max(candidate.targets.detection.high for candidate in candidates) < options.wanted:
        simulation["runs"] = min(options.runs, MAX_REMEDY_RUNS)
        changes = remedied_detection(
            case, score, given_window="score.window" in values, **simulation
        )
        now = ("as it is", candidates[0].targets.detection)
        print(remedy_table([now, *changes]))
    if options.write:
        _write_parameters(options, values, candidates)


def _check(options: argparse.Namespace) -> None:
    """Refuse arguments early that would fail after the simulation."""
    values = parse_values(one for one in options.parameter if isinstance(one, str))
    if options.false_detections is not None and not 0.0 < options.false_detections < math.inf:
        raise ValueError(f"--false-detections must be above 0; got {options.false_detections:g}")
    if options.false_detections is not None and "sensor.clutter_density" in values:
        raise ValueError("give --false-detections or sensor.clutter_density, not both")
    if "method" in values:
        raise ValueError("method follows from the design; leave it out")
    if not 0.0 < options.wanted < 1.0:
        raise ValueError(f"wanted must be between 0 and 1; got {options.wanted!r}")
    if options.write and not Path(options.write).absolute().parent.is_dir():
        raise ValueError(f"write: there is no folder for {options.write}")


def _case(options: argparse.Namespace, sensor: SensorModel, common: CommonOptions) -> Case:
    return Case(
        sensor=sensor,
        common=common,
        interval=options.interval,
        scans=options.scans,
        target_speed=0.5 * common.max_speed if options.speed is None else options.speed,
        target_range=options.range,
        ratio_db=options.ratio,
    )


def _write_parameters(
    options: argparse.Namespace, values: dict[str, Value], candidates: list[Candidate]
) -> None:
    """Write the given values, the target false-track rate, and the best candidate's options."""
    best = max(candidates, key=lambda candidate: candidate.targets.detection.value)
    own = ("window", "false_tracks_per_hour") if best.method == "score" else ("min_hits", "window")
    chosen: dict[str, Value] = {"method": best.method, "max_speed": best.options["max_speed"]}
    chosen |= {f"{best.method}.{name}": best.options[name] for name in own}
    content = {ANY_NODE: {"ros__parameters": {**values, **chosen}}}
    text = f"# {options.line}\n{yaml.safe_dump(content, sort_keys=False)}"
    write_text(Path(options.write), text)
    print(f"written: {options.write}")
