"""The command `tsepm evaluate`: arguments and written files."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Sequence
from pathlib import Path

from tsepm_ros.methods.registry import available_methods
from tsepm_ros.settings.parameter_files import parse_values
from tsepm_ros.tools.commands.arguments import (
    Arguments,
    add_arguments,
    add_out,
    add_runs,
    positive,
    scenario_names,
)
from tsepm_ros.tools.commands.given_parameters import add_values
from tsepm_ros.tools.evaluation.performance import (
    Evaluated,
    Plan,
    evaluate,
    markdown,
    measures_rows,
    table_of,
    write_csv,
)
from tsepm_ros.tools.evaluation.result_files import Result, add_result, write_result
from tsepm_ros.tools.evaluation.simulated_run import OperatingPoint, operating_points
from tsepm_ros.tools.simulation import load_scenario
from tsepm_ros.tools.terminal import text_table, with_progress, write_line
from tsepm_ros.whole_files import opened_whole, spare, write_text

ARGUMENTS: Arguments = {
    "scenario": {"nargs": "*", "default": ["box"], "help": f"{scenario_names()}; default box"},
    "--method": {
        "action": "append",
        "choices": available_methods(),
        "help": "default: every method",
    },
    "--scans": {"type": positive, "help": "scans of a run; default as in the scenario"},
    "--horizon": {
        "type": positive,
        "action": "append",
        "default": [],
        "help": "evaluate also after this number of scans; may be repeated",
    },
}


def add_evaluation_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of an evaluation."""
    add_arguments(parser, ARGUMENTS)
    add_runs(parser, 500)
    add_values(
        parser,
        "--scene",
        help="change of the scenario, such as sensor.clutter_density:=2.0e-6; may be repeated",
    )
    add_values(
        parser,
        "-p",
        "--parameter",
        help="option of the methods that have it, in place of its sweep; may be repeated",
    )
    add_out(parser, "build/evaluation")
    add_result(parser)


def run_evaluation(options: argparse.Namespace, more: Sequence[OperatingPoint] = ()) -> None:
    """Evaluate, print a short table, and write tables and pictures.

    Parameters
    ----------
    options : argparse.Namespace
        From `add_evaluation_arguments`, and `line`, the command line.
    more : sequence of OperatingPoint, optional
        Points evaluated in addition to those of the package's methods.

    Raises
    ------
    ValueError
        If an argument is not allowed.
    """
    spare(map(Path, options.scenario), [options.result] if options.result else [])
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
    _announce(plan)
    evaluated = evaluate(plan, options.out / "runs", options.workers, with_progress, _say)
    print(f"{plan.runs} runs, seed {plan.seed}\n{text_table(*table_of(evaluated, interval=False))}")
    _write(plan, evaluated, options.out, options.line)
    if options.result:
        header, rows = table_of(evaluated)
        result = Result(
            command=_repeated(options.line),
            seed=plan.seed,
            runs=plan.runs,
            parameters=parse_values(options.parameter),
            header=header,
            rows=rows,
            measures=measures_rows(evaluated),
        )
        write_result(options.result, result)


def _announce(plan: Plan) -> None:
    """Say what will be done; the bar has the time that is left."""
    for point in plan.points:
        point.make(plan.scenarios[0])  # refused options are refused before anything is said
    methods = len({point.method for point in plan.points})
    names = ", ".join(scenario.name for scenario in plan.scenarios)
    total = plan.runs * len(plan.points) * len(plan.scenarios)
    print(
        f"{total} runs: {plan.runs} of each of {len(plan.points)} operating points of {methods} "
        f"methods on {names}; those done before are not repeated; fewer: --runs, --method",
        file=sys.stderr,
    )


def _say(finished: Evaluated) -> None:
    """Print the figures of a point as soon as its runs are done; the table of all follows."""
    header, [row] = table_of([finished], interval=False)
    write_line(", ".join(map(" ".join, zip(header, row, strict=True))), sys.stderr)


def _repeated(line: str) -> str:
    """A command line without what does not change its figures."""
    return re.sub(r" --(?:result|out|workers)[ =]\S+", "", line)


def _write(plan: Plan, evaluated: Sequence[Evaluated], folder: Path, command: str) -> None:
    report, table = folder / "evaluation.md", folder / "evaluation.csv"
    write_text(report, markdown(plan, evaluated, command))
    with opened_whole(table) as file:
        write_csv(plan, evaluated, file)
    written = [report, table, *_pictures(plan, evaluated, folder)]
    print("written: " + ", ".join(map(str, written)))


def _pictures(plan: Plan, evaluated: Sequence[Evaluated], folder: Path) -> list[Path]:
    try:
        from tsepm_ros.tools.pictures.operating_curve_picture import draw
    except ImportError:
        print("no pictures: they need matplotlib, see the extra plot")
        return []
    caption = f"{plan.runs} runs, seed {plan.seed}; 95 % intervals"
    return [
        draw([one for one in evaluated if one.scenario is scenario], folder, caption)
        for scenario in plan.scenarios
    ]
