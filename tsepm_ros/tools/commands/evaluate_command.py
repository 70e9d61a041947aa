# Copyright 2026 tsepm_ros developers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.
"""The command `tsepm evaluate`: arguments and written files."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Sequence
from pathlib import Path

from tsepm_ros.methods.registry import available_methods
from tsepm_ros.settings.parameter_files import parse_parameter_file_values
from tsepm_ros.tools.commands.arguments import (
    Arguments,
    add_arguments,
    add_out_argument,
    add_runs_arguments,
    positive,
    scenario_argument_names,
)
from tsepm_ros.tools.commands.given_parameters import add_given_parameters
from tsepm_ros.tools.evaluation.performance import (
    PerformanceEvaluated,
    PerformancePlan,
    evaluate_performance,
    performance_markdown,
    performance_rows,
    performance_table,
    write_performance_csv,
)
from tsepm_ros.tools.evaluation.result_files import Result, add_result_file, write_result
from tsepm_ros.tools.evaluation.simulated_run import (
    SimulatedOperatingPoint,
    simulated_operating_points,
)
from tsepm_ros.tools.simulation import load_scenario
from tsepm_ros.tools.terminal import terminal_progress, terminal_table, write_terminal_line
from tsepm_ros.whole_files import opened_whole, refuse_overwriting_inputs, write_whole_text

ARGUMENTS: Arguments = {
    "scenario": {
        "nargs": "*",
        "default": ["box"],
        "help": f"{scenario_argument_names()}; default box",
    },
    "--method": {
        "action": "append",
        "help": f"{', '.join(available_methods())}, or module:Class from outside the package; "
        "may be repeated; default every method",
    },
    "--defaults": {
        "action": "store_true",
        "help": "each method with its default options alone, in place of its sweep of settings",
    },
    "--measure": {
        "action": "append",
        "default": [],
        "metavar": "MODULE:FUNCTION",
        "help": "a measure from outside the package: a number for the positions of the confirmed "
        "tracks (n, 2) and of the targets (m, 2) after a scan; may be repeated",
    },
    "--scans": {"type": positive, "help": "scans of a run; default as in the scenario"},
    "--horizon": {
        "type": positive,
        "action": "append",
        "default": [],
        "help": "evaluate also after this number of scans; may be repeated",
    },
}


def add_evaluate_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of an evaluation."""
    add_arguments(parser, ARGUMENTS)
    add_runs_arguments(parser, 500)
    add_given_parameters(
        parser,
        "--scene",
        help="change of the scenario, such as sensor.clutter_density:=2.0e-6; may be repeated",
    )
    add_given_parameters(
        parser,
        "-p",
        "--parameter",
        help="option of the methods that have it, in place of its sweep; may be repeated",
    )
    add_out_argument(parser, "build/evaluation")
    add_result_file(parser)


def run_evaluate(options: argparse.Namespace, more: Sequence[SimulatedOperatingPoint] = ()) -> None:
    """Evaluate, print a short table, and write tables and pictures.

    Parameters
    ----------
    options : argparse.Namespace
        From `add_evaluate_arguments`, and `line`, the command line.
    more : sequence of SimulatedOperatingPoint, optional
        Points evaluated in addition to those of the package's methods.

    Raises
    ------
    ValueError
        If an argument is not allowed.
    """
    changes = parse_parameter_file_values(options.scene)
    if options.scans:
        changes["scans"] = options.scans
    methods = dict.fromkeys(options.method or available_methods())
    plan = PerformancePlan(
        scenarios=[load_scenario(name, changes) for name in options.scenario],
        points=[
            *simulated_operating_points(
                methods,
                parse_parameter_file_values(options.parameter),
                defaults=options.defaults,
                measures=tuple(dict.fromkeys(options.measure)),
            ),
            *more,
        ],
        runs=options.runs,
        seed=options.seed,
        horizons=options.horizon,
    )
    names = [f"{scenario.name}_operating_curve.png" for scenario in plan.scenarios]
    results = [options.out / name for name in ("evaluation.md", "evaluation.csv", *names)]
    refuse_overwriting_inputs(map(Path, options.scenario), filter(None, [*results, options.result]))
    _announce(plan)
    evaluated = evaluate_performance(
        plan, options.out / "runs", options.workers, terminal_progress, _say
    )
    print(
        f"{plan.runs} runs, seed {plan.seed}\n"
        f"{terminal_table(*performance_table(evaluated, interval=False))}"
    )
    _write(plan, evaluated, options.out, options.line)
    if options.result:
        header, rows = performance_table(evaluated)
        result = Result(
            command=_repeated(options.line),
            seed=plan.seed,
            runs=plan.runs,
            parameters=parse_parameter_file_values(options.parameter),
            header=header,
            rows=rows,
            measures=performance_rows(evaluated),
        )
        write_result(options.result, result)


def _announce(plan: PerformancePlan) -> None:
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


def _say(finished: PerformanceEvaluated) -> None:
    """Print the figures of a point as soon as its runs are done; the table of all follows."""
    header, [row] = performance_table([finished], interval=False)
    write_terminal_line(", ".join(map(" ".join, zip(header, row, strict=True))), sys.stderr)


def _repeated(line: str) -> str:
    """A command line without what does not change its figures."""
    option = "--(?:result|out|workers)"
    word = r"""(?:'[^']*'|"[^"]*"|\S)+"""  # of a shell, which quotes blanks
    return re.sub(f" (?:{option} |(?='?{option}=)){word}", "", line)


def _write(
    plan: PerformancePlan, evaluated: Sequence[PerformanceEvaluated], folder: Path, command: str
) -> None:
    report, table = folder / "evaluation.md", folder / "evaluation.csv"
    write_whole_text(report, performance_markdown(plan, evaluated, command))
    with opened_whole(table) as file:
        write_performance_csv(plan, evaluated, file)
    pictures = _pictures(plan, evaluated, folder)
    print("written: " + ", ".join(map(str, [report, table, *pictures])))


def _pictures(
    plan: PerformancePlan, evaluated: Sequence[PerformanceEvaluated], folder: Path
) -> list[Path]:
    try:
        from tsepm_ros.tools.pictures.operating_curve_picture import draw_operating_curve
    except ImportError:
        print("no pictures: they need matplotlib, see the extra plot")
        return []
    caption = f"{plan.runs} runs, seed {plan.seed}; 95 % intervals"
    return [
        draw_operating_curve(
            [each for each in evaluated if each.scenario is scenario], folder, caption
        )
        for scenario in plan.scenarios
    ]
