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
"""Tables of the benchmarks: printed row by row, and written as result files."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from tsepm_ros.tools.evaluation.result_files import Result, write_result

Table = tuple[list[str], list[list[str]]]  # header and rows


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
