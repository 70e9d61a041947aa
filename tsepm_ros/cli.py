"""The offline command `tsepm`: methods, parameters, recordings and studies without ROS."""

from __future__ import annotations

import argparse
import csv
import dataclasses
import os
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, TextIO

import yaml

from tsepm_ros.analysis import design_report, designing
from tsepm_ros.analysis.designing import Candidate
from tsepm_ros.analysis.prediction import Case
from tsepm_ros.analysis.report import text_table
from tsepm_ros.analysis.study import StudyResult, study, summary
from tsepm_ros.initiator import CommonOptions
from tsepm_ros.methods import METHODS, available_methods
from tsepm_ros.methods.score import ScoreOptions
from tsepm_ros.methods.tsepm import TsepmOptions
from tsepm_ros.offline import process_recording
from tsepm_ros.parameter_groups import (
    NODES,
    TRACK_INITIATOR,
    InitiatorNodeOptions,
    as_markdown,
    as_yaml,
    make_groups,
    parse_values,
    settings_from,
)
from tsepm_ros.parameters import Value
from tsepm_ros.recording import read_recording
from tsepm_ros.sensor import SensorModel
from tsepm_ros.session import ScanResult
from tsepm_ros.simulation import load_scenario, shipped_scenarios


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command.

    Returns
    -------
    int
        0, or 2 with a sentence on stderr where something given is not allowed.
    """
    options = _parser().parse_args(arguments)
    try:
        options.command(options)
    except ValueError as error:
        print(f"refused: {error}", file=sys.stderr)
        return 2
    except BrokenPipeError:  # the reader, such as head, has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="tsepm", description="Track initiation without ROS.")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    one = commands.add_parser("methods", help="list the methods")
    one.set_defaults(command=_methods)

    one = commands.add_parser("parameters", help="print the parameters of a node, with defaults")
    one.add_argument("node", nargs="?", choices=sorted(NODES), default="track_initiator")
    one.add_argument("--markdown", action="store_true", help="a table instead of YAML")
    one.set_defaults(command=_parameters)

    one = commands.add_parser("run", help="start tracks on a recording; prints them as CSV")
    one.add_argument("recording", help="folder with detections.csv")
    _add_parameters(one)
    one.set_defaults(command=_run)

    one = commands.add_parser(
        "design", help="what a sonar and a wish lead to: thresholds, rules, what is found and when"
    )
    one.add_argument("--interval", type=float, default=12.0, help="time between pings, s")
    one.add_argument("--scans", type=int, default=16, help="pings to find a target in")
    one.add_argument("--speed", type=float, help="of the targets, m/s; default half max_speed")
    one.add_argument("--range", type=float, help="of the targets, m; default all over the coverage")
    one.add_argument("--wanted", type=float, default=0.9, help="share of the targets to be found")
    one.add_argument("--runs", type=_positive, default=400, help="targets simulated")
    one.add_argument("--seed", type=int, default=1)
    one.add_argument("--workers", type=_positive, default=os.cpu_count() or 1)
    one.add_argument("--write", metavar="FILE", help="write a parameter file for the node")
    _add_parameters(one)
    one.set_defaults(command=_design)

    one = commands.add_parser("study", help="simulate a scenario many times and sum up")
    scenarios = ", ".join(shipped_scenarios())
    one.add_argument("scenario", help=f"{scenarios}, or a .yaml file")
    one.add_argument("--method", default="tsepm", choices=available_methods())
    one.add_argument("--runs", type=_positive, default=200)
    one.add_argument("--scans", type=_positive, help="scans of a run, if not the scenario's")
    one.add_argument("--seed", type=int, default=1)
    one.add_argument("--workers", type=_positive, default=os.cpu_count() or 1)
    one.add_argument("--scheduler", help="address of a dask.distributed scheduler to run on")
    _add_parameters(one, "option of the method, such as min_hits:=4")
    one.set_defaults(command=_study)
    return parser


def _add_parameters(
    parser: argparse.ArgumentParser, text: str = "parameter as of the node track_initiator"
) -> None:
    parser.add_argument(
        "-p", "--parameter", action="append", default=[], metavar="NAME:=VALUE", help=text
    )


def _positive(text: str) -> int:
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError("must be at least 1")
    return value


def _methods(options: argparse.Namespace) -> None:
    rows = [[name, str(kind.__doc__).splitlines()[0].strip()] for name, kind in METHODS.items()]
    for name, text in rows:
        print(f"{name}: {text}")


def _parameters(options: argparse.Namespace) -> None:
    groups = NODES[options.node]
    print(as_markdown(groups) if options.markdown else as_yaml(options.node, groups), end="")


def _run(options: argparse.Namespace) -> None:
    recording = read_recording(options.recording)
    values = parse_values(options.parameter)
    if recording.own_ship:
        values.setdefault("own_ship_source", "odometry")
    made = make_groups(TRACK_INITIATOR, values)
    results, dropped = process_recording(
        recording, settings_from(made), made[InitiatorNodeOptions].bearing_reference
    )
    write_tracks(results, sys.stdout)
    for reason, number in sorted(dropped.items()):
        print(f"dropped: {number} {reason}", file=sys.stderr)


def write_tracks(results: Iterable[ScanResult], file: TextIO) -> None:
    """Write the confirmed tracks of a run as CSV, a row each."""
    writer = csv.writer(file, lineterminator="\n")
    covariance = [f"cov_{row}{column}" for row in range(4) for column in range(4)]
    state = ["state_x", "state_vx", "state_y", "state_vy"]
    last = ["evaluation", "score", "hit_count", "scan_count", "age"]
    writer.writerow(["stamp", "track_id", *state, *covariance, *last])
    for result in results:
        for track in result.new:
            writer.writerow(
                [
                    repr(track.stamp),
                    track.track_id,
                    *track.state.tolist(),
                    *track.covariance.ravel().tolist(),
                    track.evaluation,
                    track.score,
                    len(track.hits),
                    track.scan_count,
                    track.age,
                ]
            )


def _design(options: argparse.Namespace) -> None:
    values = parse_values(options.parameter)
    made = make_groups(TRACK_INITIATOR, values)
    score, max_speed = made[ScoreOptions], made[CommonOptions].max_speed
    case = Case(
        sensor=made[SensorModel],
        max_speed=max_speed,
        interval=options.interval,
        scans=options.scans,
        target_speed=0.5 * max_speed if options.speed is None else options.speed,
        target_range=options.range,
    )
    if "score.window" not in values:
        score = dataclasses.replace(score, window=designing.score_window(case, score))
    wish = score.false_tracks_per_hour
    worth = designing.worth(case, score.gate_probability)
    threshold, _ = designing.score_threshold(case, score)
    print(design_report.case_lines(case, wish))
    print(design_report.worth_line(worth, threshold))
    rules = designing.rules_within(case, made[TsepmOptions], wish)
    print("\nM/N rules of the method tsepm that keep the wish: ", end="")
    print(f"\n{design_report.rule_table(rules)}" if rules else "none")
    amount = {"runs": options.runs, "seed": options.seed, "workers": options.workers}
    found = list(designing.candidates(case, score, rules, **amount))
    print(f"\nsimulated, {options.runs} targets, seed {options.seed}; score with window", end=" ")
    print(f"{score.window}; 95 % intervals")
    print(design_report.candidate_table(found, case.sensor.coverage_area))
    print(f"\n{design_report.verdict(found, options.wanted, worth)}")
    if max(one.found.detection.high for one in found) < options.wanted:
        amount["runs"] = min(options.runs, 100)
        changes = designing.with_remedies(case, score, **amount)
        print(design_report.remedy_table(list(_with_progress(changes, designing.REMEDIES))))
    if options.write:
        _write_parameters(options.write, values, found)


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


def _study(options: argparse.Namespace) -> None:
    scenario = load_scenario(options.scenario)
    if options.scans:
        scenario = dataclasses.replace(scenario, scans=options.scans)
    results = study(
        scenario,
        options.method,
        parse_values(options.parameter),
        runs=options.runs,
        seed=options.seed,
        workers=options.workers,
        scheduler=options.scheduler,
    )
    figures = summary(scenario, _with_progress(results, options.runs))
    given = " ".join(options.parameter) or "defaults"
    print(
        f"method {options.method} ({given}), scenario {scenario.name}, {scenario.scans} scans, "
        f"{figures.runs} runs, seed {options.seed}; 95 % intervals"
    )
    print(study_table(figures))


def study_table(figures: StudyResult) -> str:
    """The figures of a study as a table."""
    rows = [
        ("P_D", figures.detection, ".4f"),
        ("false + misplaced per run", figures.false_per_run, ".2f"),
        ("false + misplaced per scan and km^2", figures.false_density, ".4f"),
        ("redundant per run", figures.redundant_per_run, ".2f"),
        ("NEES of true starts (ideal 4)", figures.nees, ".2f"),
        ("position error, RMS [m]", figures.position_error, ".1f"),
        ("velocity error, RMS [m/s]", figures.velocity_error, ".2f"),
        ("time to confirm, mean [s]", figures.confirmation_time, ".1f"),
    ]
    return text_table(
        ["figure", "value", "low", "high"],
        [
            [name, f"{e.value:{spec}}", f"{e.low:{spec}}", f"{e.high:{spec}}"]
            for name, e, spec in rows
        ],
    )


def _with_progress(results: Iterable[Any], total: int) -> Iterable[Any]:
    """Show a progress bar where tqdm is installed and somebody is looking."""
    try:
        from tqdm import tqdm
    except ImportError:
        return results
    return tqdm(results, total=total, unit="run", disable=None)


if __name__ == "__main__":
    raise SystemExit(main())
