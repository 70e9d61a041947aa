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
"""The command `tsepm reproduce`: stored runs, and the report.

Seeded runs are stored in files, so that an interrupted reproduction goes on. Texts, tables and
pictures become Markdown, CSV and PNG files.

A new source is a module of this package with a function ``reproduce(setting)``, which returns the
parts of its chapter, and a row in `SOURCES`.
"""

from __future__ import annotations

import argparse
import csv
import dataclasses
import io
import math
import pkgutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

import tsepm_ros
from tsepm_ros.tools.commands.arguments import add_out_argument, add_runs_arguments
from tsepm_ros.tools.evaluation.intervals import IntervalEstimate, interval_error_bars
from tsepm_ros.tools.evaluation.result_files import (
    ResultRunFile,
    complete_result_files,
    result_code_key,
)
from tsepm_ros.tools.terminal import (
    Progress,
    silent_terminal,
    terminal_markdown_table,
    terminal_progress,
)
from tsepm_ros.whole_files import (
    refuse_overwriting_inputs,
    write_whole_picture,
    write_whole_text,
)

SOURCES = {
    "tsepm_2018": "TSEPM 2018",
    "split_merge_2016": "Split-merge 2016",
    "sequential_2014": "Sequential 2014",
    "environment_2018": "Environment 2018",
}
"""Title of each source, by the name of its module."""

Result = dict[str, list[float]]
"""Result of a run: numbers by name."""
RunFunction = Callable[[Any, list[int]], Result]
"""Performs one run of a case, a dataclass, with a seed; importable by its name."""


@dataclass(frozen=True, kw_only=True)
class ReportSetting:
    """Number, seeds, storage and workers of the runs.

    Attributes
    ----------
    folder : Path
        Folder of the stored runs.
    runs : int
        Of every study; 0: as many as each has on the page.
    seed : int
        Run i is seeded with (seed, i) on every worker.
    processes : int
    progress : callable
        Shows the progress of the missing runs.
    """

    folder: Path
    runs: int
    seed: int = 1
    processes: int = 1
    progress: Progress = silent_terminal

    def results(self, function: RunFunction, cases: Sequence[Any], runs: int) -> list[list[Result]]:
        """Perform the runs of some cases that are not stored yet.

        Parameters
        ----------
        function : callable
        cases : sequence
            Dataclasses whose values determine a run, with its seed.
        runs : int
            As many as this study has on the page.

        Returns
        -------
        list of list of dict
            Per case its runs, in order.
        """
        files = [self._file(function, case) for case in cases]

        def job_of(case: int, index: int) -> tuple[RunFunction, Any, list[int]]:
            return function, cases[case], [self.seed, index]

        return [
            *complete_result_files(
                files,
                self.runs or runs,
                _report_run,
                job_of,
                processes=self.processes,
                progress=self.progress,
            )
        ]

    def _file(self, function: RunFunction, case: Any) -> ResultRunFile:
        header = {
            "version": result_code_key(),
            "function": function.__name__,
            "case": dataclasses.asdict(case),
            "seed": self.seed,
        }
        return ResultRunFile(self.folder, [function.__name__], header)


def _report_run(job: tuple[RunFunction, Any, list[int]]) -> Result:
    function, case, seed = job
    return function(case, seed)


def report_text(estimate: IntervalEstimate, spec: str) -> str:
    """An estimate with its interval, a dash for nan."""
    return estimate.text(spec).replace(" to ", " to " if estimate.low < 0.0 or "+" in spec else "-")


def report_column(runs: Sequence[Result], name: str, place: int) -> np.ndarray:
    """One number of every run, (runs,)."""
    return np.array([run[name][place] for run in runs], float)


Cell = str | int | float | IntervalEstimate


@dataclass(frozen=True)
class ReportTable:
    """A table in the report, also written as a CSV file.

    Attributes
    ----------
    name : str
        Name of its file, without suffix.
    columns : mapping of str to str
        Number format of each column, by its heading.
    rows : sequence of sequence of Cell
    reported : sequence of sequence of Cell, optional
        The rows that the report shows; all if not given, and no table if there are none.
    hidden : sequence of str, optional
        Columns that the report leaves out.
    """

    name: str
    columns: Mapping[str, str]
    rows: Sequence[Sequence[Cell]]
    reported: Sequence[Sequence[Cell]] | None = None
    hidden: Sequence[str] = ()

    def written(self, folder: Path) -> str:
        """Write the file to a folder, and return the table in Markdown."""
        self.write_csv(folder / f"{self.name}.csv")
        return self.markdown()

    def markdown(self) -> str:
        """The table in Markdown; empty without rows."""
        rows = self.rows if self.reported is None else self.reported
        shown = [name for name in self.columns if name not in self.hidden]
        texts = [
            [
                self._text(cell, self.columns[name])
                for cell, name in zip(row, self.columns, strict=True)
                if name in shown
            ]
            for row in rows
        ]
        return terminal_markdown_table(shown, texts) if texts else ""

    def _text(self, cell: Cell, spec: str) -> str:
        """Text of a cell, an estimate with its interval; a dash for nan."""
        if isinstance(cell, str):
            return cell.replace("|", "\\|")
        if isinstance(cell, IntervalEstimate):
            return report_text(cell, spec)
        return "-" if math.isnan(cell) else format(cell, spec)

    def write_csv(self, path: Path) -> None:
        """Write the numbers; a number with an interval has three columns."""
        columns = zip(*self.rows, strict=True)
        widths = [
            3 if any(isinstance(c, IntervalEstimate) for c in column) else 1 for column in columns
        ]
        heading = [[name, f"{name}, low", f"{name}, high"] for name in self.columns]
        file = io.StringIO()
        writer = csv.writer(file, lineterminator="\n")
        for row in (heading, *(map(_report_values, row) for row in self.rows)):
            cells = zip(row, widths, strict=True)
            writer.writerow(value for values, width in cells for value in values[:width])
        text = file.getvalue()
        refuse_overwriting_inputs([], [path], own=text[: text.index("\n") + 1].encode())
        write_whole_text(path, text)


def _report_values(cell: Cell) -> list[Any]:
    """A number and its bounds, which are empty if it has none."""
    if isinstance(cell, IntervalEstimate):
        return [cell.value, cell.low, cell.high]
    return [cell, "", ""]


def report_claim(
    claim: str,
    estimate: IntervalEstimate,
    spec: str,
    published: float | None = None,
    error: float = 0.0,
) -> list[Any]:
    """A row of `report_claims`, whose verdict follows from an interval.

    Parameters
    ----------
    claim : str
    estimate : IntervalEstimate
    spec : str
        Format of its numbers.
    published : float, optional
        Agrees if it is in the interval. If not given, the claim holds if the interval is above 0,
        is reversed if below, else open.
    error : float, optional
        Standard error of the published value in that of the estimate: 1 of as many runs.
    """
    verdict = "holds" if estimate.low > 0.0 else "reversed" if estimate.high < 0.0 else "open"
    if published is not None:
        off = (estimate.value - published) / math.hypot(1.0, error)
        agrees = estimate.value - estimate.high <= off <= estimate.value - estimate.low
        verdict = "agrees" if agrees else "differs"
    return [claim, report_text(estimate, spec), verdict]


def report_count(claim: str, met: Sequence[bool]) -> list[Any]:
    """A row of `report_claims` for a claim on several places, which it meets or not."""
    number = sum(met)
    verdict = "in part" if 0 < number < len(met) else "holds" if number else "open"
    return [claim, f"in {number} of {len(met)}", verdict]


def report_claims(name: str, rows: Sequence[Sequence[Cell]]) -> ReportTable:
    """The table of some claims: each with its figure here and the verdict."""
    return ReportTable(f"{name}_claims", dict.fromkeys(("claim", "here", "verdict"), ""), rows)


@dataclass(frozen=True)
class ReportLine:
    """A line or points of a panel.

    Attributes
    ----------
    x, y : array_like
        The values y may be estimates, which are drawn with their intervals.
    label : str
    style : mapping
        Arguments of matplotlib.
    """

    x: Any
    y: Any
    label: str = ""
    style: Mapping[str, Any] = field(default_factory=dict)

    def draw(self, axis: Any) -> None:
        """Draw it on an axis of matplotlib."""
        if isinstance(self.y[0], IntervalEstimate):
            values = np.array([estimate.value for estimate in self.y])
            bars = interval_error_bars(values, self.y)
            axis.errorbar(self.x, values, yerr=bars, label=self.label, **self.style)
        else:
            axis.plot(self.x, self.y, label=self.label, **self.style)


@dataclass(frozen=True)
class ReportPanel:
    """An axis of a picture.

    Attributes
    ----------
    lines : sequence of ReportLine
    settings : mapping
        Title, labels and limits, as `Axes.set` takes them.
    marks : sequence of float
        Values of x with a vertical line.
    """

    lines: Sequence[ReportLine]
    settings: Mapping[str, Any] = field(default_factory=dict)
    marks: Sequence[float] = ()

    def draw(self, axis: Any) -> None:
        """Draw it on an axis of matplotlib."""
        for line in self.lines:
            line.draw(axis)
        for mark in self.marks:
            axis.axvline(mark, color="grey", lw=0.8, ls="--")
        axis.set(**self.settings)
        axis.grid(alpha=0.3)
        if any(line.label for line in self.lines):
            axis.legend(fontsize=7)


@dataclass(frozen=True)
class ReportPicture:
    """A picture of panels side by side.

    Attributes
    ----------
    name : str
        Name of its file, without suffix.
    caption : str
    panels : sequence of ReportPanel
    size : (float, float)
        Width and height, inches.
    """

    name: str
    caption: str
    panels: Sequence[ReportPanel]
    size: tuple[float, float] = (9.0, 4.5)

    def written(self, folder: Path) -> str:
        """Draw it to a file in a folder, and return its line in Markdown, or a note instead."""
        try:
            from matplotlib.backends.backend_agg import FigureCanvasAgg
            from matplotlib.figure import Figure
        except ImportError:
            return f"*{self.caption}: not drawn, since it needs matplotlib (the extra plot)*"
        figure = Figure(figsize=self.size, layout="constrained")
        FigureCanvasAgg(figure)
        axes = figure.subplots(1, len(self.panels), squeeze=False)[0]
        for panel, axis in zip(self.panels, axes, strict=True):
            panel.draw(axis)
        path = folder / f"{self.name}.png"
        refuse_overwriting_inputs([], [path])
        write_whole_picture(path, figure)
        return f"![{self.caption}]({self.name}.png)"


Part = str | ReportTable | ReportPicture
"""A part of a chapter; a text is a paragraph in Markdown."""


def write_report(parts: Sequence[Part], report: Path) -> None:
    """Write a report, and its tables and pictures beside it.

    Parameters
    ----------
    parts : sequence of Part
    report : Path
        The report's file.
    """
    report.parent.mkdir(parents=True, exist_ok=True)
    texts = [part if isinstance(part, str) else part.written(report.parent) for part in parts]
    write_whole_text(report, "\n\n".join(filter(None, texts)) + "\n")


def add_report_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of a reproduction."""
    parser.add_argument(
        "source", nargs="*", metavar="SOURCE", help=f"{', '.join(SOURCES)}; default all"
    )
    add_runs_arguments(parser, 0, "runs of each study, 0 as many as on the page")
    add_out_argument(parser, "build/reproduction")


def run_report(options: argparse.Namespace) -> None:
    """Regenerate the published results and write the report.

    Parameters
    ----------
    options : argparse.Namespace
        From `add_report_arguments`, and `line`, the command line.

    Raises
    ------
    ValueError
        If a source is unknown.
    """
    refuse_overwriting_inputs([], [options.out / "report.md"])
    names = list(dict.fromkeys(options.source or SOURCES))
    for name in names:
        if name not in SOURCES:
            raise ValueError(f"source must be one of {', '.join(SOURCES)}; got {name!r}")
    setting = ReportSetting(
        folder=options.out / "runs",
        runs=options.runs,
        seed=options.seed,
        processes=options.workers,
        progress=terminal_progress,
    )
    parts: list[Part] = [
        "# Reproduction of the published results",
        f"`{options.line}`",
    ]
    for name in names:
        print(f"{name}: {SOURCES[name]}", flush=True)
        chapter = pkgutil.resolve_name(f"{__package__}.{name}:reproduce")
        told = f"Measured with version {tsepm_ros.__version__}, seed {options.seed}."
        parts += [f"## {SOURCES[name]}", told, *chapter(setting)]
    write_report(parts, options.out / "report.md")
    print(f"written: {options.out / 'report.md'}, its tables and pictures beside it")
