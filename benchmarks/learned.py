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
"""The learned starter beside `score` and `tsepm`: false tracks an hour at equal P_DT, box scene.

Each point of the learned starter is compared with the curve of each other method; the intervals are
of resampled runs, which are the same scenes for all. Stored runs continue.

    python benchmarks/learned.py [--runs 60]
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path

import fixed_threads  # noqa: F401  # before numpy
from equal_rates import compare
from result_tables import dashed as text
from result_tables import printed, write_table

from tsepm_ros.studies.reproduction.report import ReportLine, ReportPanel, ReportPicture
from tsepm_ros.tools.evaluation.performance import PerformancePlan, evaluate_performance
from tsepm_ros.tools.evaluation.result_files import add_result_file
from tsepm_ros.tools.evaluation.simulated_run import simulated_operating_points
from tsepm_ros.tools.simulation import load_scenario
from tsepm_ros.tools.terminal import terminal_progress

LEARNED = "contenders.learned_starter:LearnedStarter"
OTHERS = "score", "tsepm"


def table(options: argparse.Namespace, panels: list[ReportPanel]) -> Iterator[Sequence[str]]:
    """A row per horizon and point of the learned starter, and a panel with the curves."""
    yield ["pings, point", "P_DT", "false/h", *(f"`{name}`: false/h over its" for name in OTHERS)]
    points = simulated_operating_points([LEARNED, *OTHERS])
    plan = PerformancePlan(
        scenarios=[load_scenario("box")], points=points, runs=options.runs, horizons=(8,)
    )
    for result in evaluate_performance(
        plan, options.out / "runs", options.workers, terminal_progress
    ):
        lines = []
        for name, mark in zip((LEARNED, *OTHERS), ("s--", "o-", "^:"), strict=True):
            own = [m for p, m in zip(points, result.measures, strict=True) if p.method == name]
            own.sort(key=lambda measure: measure.estimate("false_per_hour").value)
            rates = [measure.estimate("false_per_hour").value for measure in own]
            found = [measure.estimate("found") for measure in own]
            lines.append(ReportLine(rates, found, name.rpartition(":")[2], {"fmt": mark}))
        labels = {"title": f"{result.scans} pings", "xscale": "log", "ylim": (0.0, 1.05)}
        labels |= {"xlabel": "false and misplaced tracks an hour", "ylabel": "P_DT"}
        panels.append(ReportPanel(lines, labels))
        runs = {(p.method, p.label): r for p, r in zip(points, result.runs, strict=True)}
        compared = {(c.label, c.other): c for c in compare(runs) if c.method == LEARNED}
        measures = {p.label: m for p, m in zip(points, result.measures, strict=True)
                    if p.method == LEARNED}  # fmt: skip
        for label, measure in measures.items():
            both = [compared[label, name] for name in OTHERS]
            yield [f"{result.scans}, {label}",
                   text(measure.estimate("found"), ".2f"),
                   text(measure.estimate("false_per_hour"), ".3g"),
                   *(text(one.false_ratio, ".2g") for one in both)]  # fmt: skip


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=60)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("build/learned"))
    parser.add_argument("--picture", type=Path, help="also draw the curves")
    add_result_file(parser)
    options = parser.parse_args(arguments)
    line = f"python benchmarks/learned.py --runs {options.runs}"
    panels: list[ReportPanel] = []
    done = printed(table(options, panels))
    if options.picture:
        caption = "The learned starter beside score and tsepm"
        ReportPicture(options.picture.stem, caption, panels, (10.0, 4.0)).written(
            options.picture.parent
        )
    write_table(options.result, line, done, seed=1, runs=options.runs)


if __name__ == "__main__":
    main()
