"""The command `tsepm evaluate`: its arguments, and what it writes."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from tsepm_ros.analysis.operating_points import OperatingPoint, operating_points
from tsepm_ros.analysis.performance import Evaluated, Plan, evaluate
from tsepm_ros.analysis.performance_report import markdown, short_text, write_csv
from tsepm_ros.analysis.workers import with_progress
from tsepm_ros.commands.arguments import (
    add_out,
    add_runs,
    add_values,
    positive,
    scenario_names,
    workers_of,
)
from tsepm_ros.methods.registry import available_methods
from tsepm_ros.settings.value_text import parse_values
from tsepm_ros.simulation import load_scenario


def add_evaluation_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of an evaluation."""
    parser.add_argument(
        "scenario", nargs="*", default=["box"], help=f"{scenario_names()}; default box"
    )
    parser.add_argument(
        "--method", action="append", choices=available_methods(), help="default: every method"
    )
    add_runs(parser, 500)
    parser.add_argument("--scans", type=positive, help="scans of a run, if not the scenario's")
    parser.add_argument("--scheduler", help="address of a dask.distributed scheduler to run on")
    parser.add_argument(
        "--horizon",
        type=positive,
        action="append",
        default=[],
        help="figures after the first so many scans as well as after all",
    )
    add_values(
        parser,
        "--scene",
        help="value in place of the scenario's, such as sensor.clutter_density:=2.0e-6",
    )
    add_values(
        parser, help="option for the methods that have it; it replaces a sweep that varies it"
    )
    add_out(parser, "build/evaluation")


def run_evaluation(options: argparse.Namespace, more: Sequence[OperatingPoint] = ()) -> None:
    """Evaluate, print a short table, and write tables and pictures.

    Parameters
    ----------
    options : argparse.Namespace
        From `add_evaluation_arguments`, and `line`, the command as it was given.
    more : sequence of OperatingPoint, optional
        What is evaluated beside the package's own methods.

    Raises
    ------
    ValueError
        If something given is not allowed.
    """
    changes = parse_values(options.scene)
    if options.scans:
        changes["scans"] = options.scans
    methods = dict.fromkeys(options.method or available_methods())
    plan = Plan(
        scenarios=[load_scenario(name, changes) for name in options.scenario],
        points=[*operating_points(methods, parse_values(options.parameter)), *more],
        runs=options.runs,
        seed=options.seed,
        horizons=options.horizon,
    )
    evaluated = evaluate(plan, options.out / "runs", workers_of(options), with_progress)
    for one in evaluated:
        print(short_text(plan, one) + "\n")
    _write(plan, evaluated, options.out, options.line)


def _write(plan: Plan, evaluated: Sequence[Evaluated], folder: Path, command: str) -> None:
    report, table = folder / "evaluation.md", folder / "evaluation.csv"
    report.write_text(markdown(plan, evaluated, command), encoding="utf-8")
    with table.open("w", encoding="utf-8", newline="") as file:
        write_csv(plan, evaluated, file)
    written = [report, table, *_pictures(plan, evaluated, folder)]
    print("written: " + ", ".join(map(str, written)))


def _pictures(plan: Plan, evaluated: Sequence[Evaluated], folder: Path) -> list[Path]:
    try:
        from tsepm_ros.pictures.operating_curve_picture import draw
    except ImportError:
        print("no pictures: they need matplotlib, which comes with the extra plot")
        return []
    caption = f"{plan.runs} runs, seed {plan.seed}; 95 % intervals"
    return [
        path
        for scenario in plan.scenarios
        for path in draw([one for one in evaluated if one.scenario is scenario], folder, caption)
    ]
