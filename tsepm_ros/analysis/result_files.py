"""Result files: the tables of a command, with everything that is needed to repeat them."""

from __future__ import annotations

import argparse
import json
import platform
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

import tsepm_ros
from tsepm_ros.analysis.code_version import goldens_digest
from tsepm_ros.whole_files import write_text

Row = Mapping[str, Any]
Table = tuple[list[str], list[list[str]]]  # header and rows


@dataclass(frozen=True, kw_only=True)
class Result:
    """Figures of a command.

    Attributes
    ----------
    command : str
        The command that repeats them.
    version : str
        Release of the package.
    goldens : str
        Digest of the golden outputs, see `goldens_digest`.
    seed, runs : int
    parameters : mapping
        Parameters that differ from the defaults.
    header : list of str
    rows : list of list of str
        The table as printed.
    measures : list of mapping, optional
        The same figures as numbers, null for an unknown one.
    numpy, python : str
        Versions of what they were computed with.
    """

    command: str
    seed: int
    runs: int
    header: list[str]
    rows: list[list[str]]
    parameters: Mapping[str, Any] = field(default_factory=dict)
    measures: Sequence[Row] = field(default_factory=list)
    version: str = tsepm_ros.__version__
    goldens: str = field(default_factory=goldens_digest)
    numpy: str = np.__version__
    python: str = field(default_factory=platform.python_version)


def add_result(parser: argparse.ArgumentParser) -> None:
    """Add the path of the result file."""
    parser.add_argument(
        "--result",
        type=Path,
        help="also write the figures to a JSON file, see docs/contributing.md",
    )


def write_result(path: Path, result: Result) -> None:
    """Write a result file."""
    path.parent.mkdir(parents=True, exist_ok=True)
    write_text(path, json.dumps(asdict(result), indent=1, ensure_ascii=False) + "\n")


def read_result(path: Path) -> Result:
    """Read a result file.

    Raises
    ------
    ValueError
        If it is not a result file.
    """
    try:
        return Result(**json.loads(path.read_text(encoding="utf-8")))
    except (TypeError, ValueError) as error:
        raise ValueError(f"{path} is not a result file: {error}") from None


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
    """Write a printed table as a result file, if `add_result`'s option names the file.

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
