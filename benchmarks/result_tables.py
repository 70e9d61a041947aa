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
"""Tables of the benchmarks: printed row by row, written as result files, and compared.

A benchmark of parts prints a table for each part, whose rows have estimates with intervals, and
keeps them in a JSON file, so that those of two source trees can be compared.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import tsepm_ros
from tsepm_ros.tools.evaluation.intervals import IntervalEstimate
from tsepm_ros.tools.evaluation.result_files import Result, write_result
from tsepm_ros.whole_files import write_whole_text

Table = tuple[list[str], list[list[str]]]  # header and rows
PartRow = dict[str, IntervalEstimate]
"""A row of a part, by column."""


def printed(rows: Iterable[Sequence[str]]) -> Table:
    """Print rows as a Markdown table, each at once, and return the header and the others."""
    table = []
    for index, cells in enumerate(rows):
        print(f"| {' | '.join(cells)} |", flush=True)
        if not index:
            print("|---" * len(cells) + "|", flush=True)
        table.append(list(cells))
    return table[0], table[1:]


def write_table(path: Path | None, command: str, table: Table, *, seed: int, runs: int) -> None:
    """Write a printed table as a result file, if `add_result_file`'s option names the file.

    Parameters
    ----------
    path : Path or None
        None: nothing is written.
    command : str
        The command that repeats the table.
    table : header and rows
        As `printed` returns them.
    seed, runs : int
    """
    if path:
        header, rows = table
        write_result(path, Result(command=command, seed=seed, runs=runs, header=header, rows=rows))


def estimate_text(estimate: IntervalEstimate | None) -> str:
    """A value with its interval, if there is one; a dash without a value."""
    if estimate is None or math.isnan(estimate.value):
        return "-"
    return f"{estimate.value:.3g}" if math.isnan(estimate.low) else f"{estimate:.3g}"


def dashed(estimate: IntervalEstimate, spec: str) -> str:
    """An estimate above 0 with its interval as one word, or a dash."""
    return estimate.text(spec).replace(" to ", "-")


def print_part(name: str, rows: Mapping[str, PartRow], file: Path | None) -> Table:
    """Print the table of a part; keep it in a file (if any) beside the file's other parts."""
    columns = list(dict.fromkeys(column for row in rows.values() for column in row))
    table = [
        [title, *(estimate_text(row.get(column)) for column in columns)]
        for title, row in rows.items()
    ]
    result = printed([[name, *columns], *table])
    if file:
        kept = json.loads(file.read_text())["parts"] if file.exists() else {}
        kept[name] = {
            title: {column: [e.value, e.low, e.high] for column, e in row.items()}
            for title, row in rows.items()
        }
        content = {"tree": tsepm_ros.__path__[0], "parts": kept}
        write_whole_text(file, json.dumps(content, indent=1))
    return result


def add_compare(commands: Any) -> None:
    """Add the command `compare`, of two files of `print_part`, to subparsers."""
    command = commands.add_parser("compare")
    command.add_argument("files", type=Path, nargs=2)
    command.set_defaults(run=_print_compared)


def _print_compared(options: argparse.Namespace) -> None:
    """Print two files side by side; an asterisk marks intervals that do not overlap."""
    before, after = (json.loads(file.read_text())["parts"] for file in options.files)
    for part in [name for name in before if name in after]:
        lines = [[part, "", *(file.stem for file in options.files), ""]]
        for title, row in before[part].items():
            for column in [name for name in row if name in after[part].get(title, {})]:
                one, other = (
                    IntervalEstimate(*row[column]),
                    IntervalEstimate(*after[part][title][column]),
                )
                apart = "*" if one.high < other.low or other.high < one.low else ""
                lines.append([title, column, estimate_text(one), estimate_text(other), apart])
        printed(lines)
        print()
