"""Evaluation of methods over scenarios, and its tables.

Monte-Carlo studies: summaries of many seeded runs of a scenario.

Evaluation of methods: all operating points on all scenarios, with the runs kept in files.

Tables of an evaluation: Markdown, CSV and a short table for the terminal.
"""

from __future__ import annotations

import csv
import dataclasses
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TextIO

from tsepm_ros.tools.evaluation.intervals import Estimate
from tsepm_ros.tools.evaluation.measures import (
    HEADINGS,
    Measures,
    RunSummary,
    measures_of,
    summarise,
)
from tsepm_ros.tools.evaluation.operating_curve import Comparison, compare
from tsepm_ros.tools.evaluation.result_files import RunFile, complete
from tsepm_ros.tools.evaluation.simulated_run import OperatingPoint, simulate
from tsepm_ros.tools.evaluation.workers import Workers
from tsepm_ros.tools.simulation import Scenario
from tsepm_ros.tools.terminal import Progress, markdown_table, silent, text_table

CHUNK = 4
"""Runs per message to a worker, to reduce the cost of messages."""

Job = tuple[Scenario, list[int], OperatingPoint]
"""A run: its scenario, its seed, and the operating point of the track starter."""


def run(job: Job) -> RunSummary:
    """Simulate and summarise one run."""
    return summarise(simulate(*job))


def runs_of(jobs: Sequence[Job], workers: Workers | None = None) -> Iterator[RunSummary]:
    """Do runs in their order, in this process if no workers are given."""
    return (workers or Workers()).mapped(run, jobs, CHUNK)


def study(
    scenario: Scenario,
    point: OperatingPoint,
    runs: Sequence[int],
    seed: int,
    workers: Workers | None = None,
) -> Iterator[RunSummary]:
    """Run a scenario many times.

    Run i is seeded with (seed, i), so the results do not depend on the worker, and all methods get
    the same scenes.

    Parameters
    ----------
    scenario : Scenario
    point : OperatingPoint
        The method and its options.
    runs : sequence of int
        Indices of the runs.
    seed : int
    workers : Workers, optional
        This process if not given.

    Yields
    ------
    RunSummary
        In the order of `runs`.
    """
    return runs_of([(scenario, [seed, index], point) for index in runs], workers)


@dataclass(frozen=True, kw_only=True)
class Plan:
    """Scenarios, operating points and runs of an evaluation.

    Attributes
    ----------
    scenarios : sequence of Scenario
    points : sequence of OperatingPoint
    runs, seed : int
    horizons : sequence of int
        Numbers of scans after which measures are given, besides all scans.

    Raises
    ------
    ValueError
        If a horizon is beyond a scenario's scans, or two scenarios or points have the same name.
    """

    scenarios: Sequence[Scenario]
    points: Sequence[OperatingPoint]
    runs: int
    seed: int = 1
    horizons: Sequence[int] = ()

    def __post_init__(self) -> None:
        names = [scenario.name for scenario in self.scenarios]
        labels = [f"{point.method} {point.label}" for point in self.points]
        for name in (*names, *labels):
            if (*names, *labels).count(name) > 1:
                raise ValueError(f"{name} is given twice: names in tables must be different")
        for scenario in self.scenarios:
            if max(self.horizons, default=1) > scenario.scans:
                raise ValueError(
                    f"horizon {max(self.horizons)} is beyond the {scenario.scans} scans of "
                    f"{scenario.name}"
                )

    def horizons_of(self, scenario: Scenario) -> list[int]:
        """Numbers of scans for which a scenario's measures are given, ascending."""
        return sorted({*self.horizons, scenario.scans})


@dataclass(frozen=True)
class Evaluated:
    """Measures and comparisons of a scenario's points after a number of scans.

    Attributes
    ----------
    scenario : Scenario
    scans : int
    points : list of OperatingPoint
    measures : list of Measures
        Of each point.
    comparisons : list of Comparison
        Of each point with the other methods' curves.
    """

    scenario: Scenario
    scans: int
    points: Sequence[OperatingPoint]
    measures: list[Measures]
    comparisons: list[Comparison]


def evaluate(
    plan: Plan,
    folder: Path,
    workers: Workers | None = None,
    progress: Progress = silent,
) -> list[Evaluated]:
    """Do the runs missing in the folder's files, and compute measures and comparisons.

    Parameters
    ----------
    plan : Plan
    folder : Path
        Folder of the files of runs.
    workers : Workers, optional
        This process if not given.
    progress : callable, optional
        Shows the number of missing runs that are done.

    Returns
    -------
    list of Evaluated
        Per scenario and horizon.

    Raises
    ------
    ValueError
        If a method refuses its options, or a file's header is not that of its name. No run is done
        then.
    """
    tasks = [(scenario, point) for scenario in plan.scenarios for point in plan.points]
    for scenario, point in tasks:
        point.make(scenario)
    files = [run_file(folder, *task, plan.seed) for task in tasks]

    def results_of(missing: list[tuple[int, int]]) -> Iterator[dict[str, Any]]:
        jobs = [(tasks[k][0], [plan.seed, index], tasks[k][1]) for k, index in missing]
        return (summary.as_json() for summary in runs_of(jobs, workers))

    complete(files, plan.runs, results_of, progress)
    runs = [
        [RunSummary.from_json(file.results[index]) for index in range(plan.runs)] for file in files
    ]
    count = len(plan.points)
    return [
        _evaluated(scenario, scans, plan.points, runs[place * count : (place + 1) * count])
        for place, scenario in enumerate(plan.scenarios)
        for scans in plan.horizons_of(scenario)
    ]


def run_file(folder: Path, scenario: Scenario, point: OperatingPoint, seed: int) -> RunFile:
    """The file of an operating point's runs on a scenario."""
    header = {
        "version": point.version,
        "method": point.method,
        "options": dict(point.options),
        "scenario": dataclasses.asdict(scenario),
        "seed": seed,
    }
    return RunFile(folder, (scenario.name, point.method, point.label), header)


def _evaluated(
    scenario: Scenario,
    scans: int,
    points: Sequence[OperatingPoint],
    runs: Sequence[Sequence[RunSummary]],
) -> Evaluated:
    runs = [[summary.first(scans) for summary in summaries] for summaries in runs]
    names = [(point.method, point.label) for point in points]
    return Evaluated(
        scenario,
        scans,
        points,
        [measures_of(scenario, summaries, scans) for summaries in runs],
        compare(dict(zip(names, runs, strict=True))),
    )


TABLES = {
    "Detection and false starts": (
        "detection",
        "detection_by_position",
        "detection_corrected",
        "corrections_per_run",
        "false_per_run",
        "false_density",
        "false_per_hour",
        "redundant_per_run",
        "held",
    ),
    "Time to confirm": ("confirmation_time", "confirmation_median", "confirmation_95"),
    "Pure starts": (
        "pure_position_error",
        "position_to_bound",
        "pure_velocity_error",
        "velocity_to_bound",
        "pure_nees",
    ),
    "True starts": ("position_error", "velocity_error", "nees"),
    "Held tracks": ("gospa_mean", "gospa", "gospa_localisation", "gospa_missed", "gospa_false"),
}
"""Measures of each table."""
SHORT = {
    "detection": "P_D",
    "detection_by_position": "by position",
    "false_per_run": "false/run",
    "false_per_hour": "false/h",
    "held": "held",
    "confirmation_median": "median s",
    "pure_nees": "NEES pure",
    "nees": "NEES true",
    "gospa_mean": "GOSPA m",
}
"""Measures of the terminal's table, with their headings."""
NOTES = """\
Every method got the same scenes: run i is seeded with (seed, i). Intervals are 95 %.

- *P_D*: share of (run, target) pairs with a true start by the end. More than half of a true \
start's hits are from the target, and it is within 3 sigma of the measurement error's larger axis.
- *P_D by position*: share of pairs with a start within 3 sigma of the target, whatever its hits.
- *P_D with corrections*: share of pairs with a true start, or one that a correction made true. \
All other figures are of starts as first published (revision 0).
- *false + misplaced*: starts without a target that gave more than half of the hits, and starts \
farther from it. *redundant*: another true start of a target.
- *targets held at the end*: with a held track within 3 sigma, whatever its hits.
- *pure starts*: all hits from one target, redundant starts excluded, misplaced starts included. \
Their errors are divided by the root mean square of the Cramer-Rao bounds for their own hits. The \
ratio may be below 1 for a method that selects hits by their fit or uses a speed limit.
- *NEES*: 4 is ideal; a larger value means an over-confident covariance.
- *GOSPA* of the held tracks against the truth: p = 2, alpha = 2, c = 3 sigma of the measurement \
error's larger axis, the mean over the targets; mean and root mean square over the scans and runs. \
The squares of the three parts add up to that of the latter.
"""
EQUAL_RATE_NOTE = """\
The curve passes through a method's best points, P_D linear in the logarithm of the false + \
misplaced starts, and is constant beyond its right end. A dash marks a value that the curve does \
not reach. A point without false starts counts half a start in all runs. Intervals: bootstrap over \
the runs, common to all points.
"""


def markdown(plan: Plan, evaluated: Sequence[Evaluated], command: str) -> str:
    """The whole report.

    Parameters
    ----------
    plan : Plan
    evaluated : sequence of Evaluated
    command : str
        The command that repeats the evaluation.
    """
    parts = [
        "# Evaluation of track initiation\n",
        f"```\n{command}\n```\n",
        f"{plan.runs} runs of each point on each scenario, seed {plan.seed}. {NOTES}",
        _points_table(plan),
    ]
    for scenario in plan.scenarios:
        parts.append(f"## Scenario {scenario.name}\n\n```\n{_scene(scenario)}\n```\n")
        parts += [_section(result) for result in evaluated if result.scenario is scenario]
    return "\n".join(parts)


def _scene(scenario: Scenario) -> str:
    """Summary of a scenario, without the targets' states."""
    sensor = scenario.sensor
    drawn = sum(area.count for area in scenario.areas)
    clutter = f"clutter {sensor.clutter_density:g} /m^2 over {scenario.area / 1e6:.4g} km^2"
    range_error = f"range error {sensor.range_std:g} m and {100 * sensor.range_std_fraction:g} %"
    azimuth_error = f"azimuth error {math.degrees(sensor.azimuth_std):.3g} degrees"
    warm_up = f", after {scenario.warm_up} of clutter alone" if scenario.warm_up else ""
    return (
        f"{scenario.scans} scans{warm_up}, one in {scenario.period:g} s; {clutter}\n"
        f"{range_error}, {azimuth_error}, detection probability {sensor.detection_probability:g}\n"
        f"targets: {len(scenario.targets)} given, {drawn} drawn in every run; "
        f"own ship {scenario.own_ship.speed:g} m/s"
    )


def _points_table(plan: Plan) -> str:
    rows = [
        [point.method, point.label, _given(point.options), point.version] for point in plan.points
    ]
    return "## Points\n\n" + markdown_table(["method", "point", "options", "version"], rows) + "\n"


def _given(options: Mapping[str, Any]) -> str:
    return ", ".join(f"{name}:={value}" for name, value in options.items()) or "defaults"


def _section(result: Evaluated) -> str:
    after = f"after {result.scans} scans"
    parts = []
    for title, names in TABLES.items():
        header = ["method", "point", *(HEADINGS[name] for name in names)]
        rows = [
            [point.method, point.label, *(measures.text(name) for name in names)]
            for point, measures in zip(result.points, result.measures, strict=True)
        ]
        parts.append(f"### {title}, {after}\n\n{markdown_table(header, rows)}\n")
    if result.comparisons:
        table = _equal_rate_table(result)
        parts.append(f"### At equal false-track rate or P_D, {after}\n\n{EQUAL_RATE_NOTE}\n{table}")
    return "\n".join(parts)


def _equal_rate_table(result: Evaluated) -> str:
    """The comparisons, rates per scan and km^2."""
    unit = result.scans * result.scenario.area / 1e6
    header = [
        "method",
        "point",
        HEADINGS["false_density"],
        "P_D",
        "against",
        "its P_D at that rate",
        "difference in P_D",
        "its rate at that P_D",
        "ratio of rates",
    ]
    return markdown_table(header, [_equal_rate_row(row, unit) for row in result.comparisons]) + "\n"


def _equal_rate_row(row: Comparison, unit: float) -> list[str]:
    return [
        row.method,
        row.label,
        f"{row.false / unit:.3g}",
        f"{row.detection:.4f}",
        row.other,
        row.other_detection.text(".4f"),
        row.detection_difference.text("+.4f"),
        (row.other_false / unit).text(".3g"),
        row.false_ratio.text(".3g"),
    ]


def write_csv(plan: Plan, evaluated: Sequence[Evaluated], file: TextIO) -> None:
    """Write a row per scenario, horizon and point, each measure with low and high."""
    writer = csv.writer(file, lineterminator="\n")
    names = [f"{name}{end}" for name in HEADINGS for end in ("", "_low", "_high")]
    writer.writerow(["scenario", "scans", "runs", "seed", "method", "point", "options", *names])
    for result in evaluated:
        for point, measures in zip(result.points, result.measures, strict=True):
            options = json.dumps(dict(point.options))
            which = [result.scenario.name, result.scans, plan.runs, plan.seed]
            writer.writerow([*which, point.method, point.label, options, *_numbers(measures)])


def _numbers(measures: Measures) -> list[float]:
    estimates: list[Estimate] = [getattr(measures, name) for name in HEADINGS]
    return [end for part in estimates for end in (part.value, part.low, part.high)]


def measures_rows(evaluated: Sequence[Evaluated]) -> list[dict[str, Any]]:
    """A row per scenario, horizon and point: each measure as value, low and high; None for nan."""
    return [
        {
            "scenario": result.scenario.name,
            "scans": result.scans,
            "method": point.method,
            "point": point.label,
            "options": dict(point.options),
            **{name: _values(getattr(measures, name)) for name in HEADINGS},
        }
        for result in evaluated
        for point, measures in zip(result.points, result.measures, strict=True)
    ]


def _values(estimate: Estimate) -> list[float | None]:
    """Value, low and high with six digits; None for nan."""
    values = (estimate.value, estimate.low, estimate.high)
    return [None if math.isnan(value) else float(f"{value:.6g}") for value in values]


def table_of(evaluated: Sequence[Evaluated]) -> tuple[list[str], list[list[str]]]:
    """Header and rows of one table with the measures of the terminal's."""
    header = ["scenario", "pings", "method", *SHORT.values()]
    rows = [
        [
            result.scenario.name,
            str(result.scans),
            f"{point.method} {point.label}",
            *(measures.text(name) for name in SHORT),
        ]
        for result in evaluated
        for point, measures in zip(result.points, result.measures, strict=True)
    ]
    return header, rows


def short_text(plan: Plan, result: Evaluated) -> str:
    """A short table for the terminal."""
    rows = [
        [f"{point.method} {point.label}", *(measures.text(name, interval=False) for name in SHORT)]
        for point, measures in zip(result.points, result.measures, strict=True)
    ]
    return (
        f"scenario {result.scenario.name}, {result.scans} scans, {plan.runs} runs, "
        f"seed {plan.seed}\n" + text_table(["method", *SHORT.values()], rows)
    )
