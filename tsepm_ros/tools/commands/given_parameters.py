"""Values of parameters that commands are given, in files and on the command line."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from tsepm_ros.parameters import Value, refuse_integer
from tsepm_ros.settings.parameter_files import (
    ANY_NODE,
    OF_ROS,
    content,
    fits,
    flattened,
    parse_values,
    section,
    sections,
    unused_files,
    yaml_text,
)
from tsepm_ros.settings.settings import TRACK_INITIATOR, Groups, full_table


def as_yaml(node: str, groups: Groups, key: str = ANY_NODE) -> str:
    """A ROS parameter file with the default of every parameter of a node.

    By default the key fits any node that gets the file, also under another name or in a namespace.
    """
    lines = [f"# Parameters of {node}", *section(key)]
    for row in full_table(groups):
        note = ", ".join(part for part in (row.unit, row.bounds) if part)
        lines.append(f"    # {row.description}{f' [{note}]' if note else ''}")
        lines.append(f"    {row.name}: {yaml_text(row.default)}")
    return "\n".join(lines) + "\n"


def add_values(
    parser: argparse.ArgumentParser,
    *names: str,
    help: str = "parameter of the node track_initiator; may be repeated",
) -> None:
    """Add a repeatable argument NAME:=VALUE, by default `-p` with `--params-file`."""
    given = names or ("-p", "--parameter")
    parser.add_argument(*given, action="append", default=[], metavar="NAME:=VALUE", help=help)
    if not names:
        parser.add_argument(
            "--params-file",
            dest="parameter",
            action="append",
            type=Path,
            metavar="FILE",
            help="parameter file of the node; may be repeated; of -p and files the last one holds",
        )


def given_values(given: Sequence[str | Path], node: str = "/track_initiator") -> dict[str, Value]:
    """Values by full name of parameter files and of assignments NAME:=VALUE.

    As in ROS the last value of a name holds. The parameters of ROS itself are left out.

    Raises
    ------
    ValueError
        If a file cannot be read or has nothing for the node, or an assignment is none.
    """
    values: dict[str, Value] = {}
    for one in given:
        values |= values_for(one, node) if isinstance(one, Path) else parse_values([one])
    return {name: value for name, value in values.items() if not name.startswith(OF_ROS)}


def values_for(path: Path, node: str) -> dict[str, Value]:
    """Values that a parameter file has for a node; refuses the types that ROS refuses."""
    try:
        path.read_bytes()
    except OSError as error:
        raise ValueError(f"parameter file {path} cannot be read: {error.strerror}") from None
    fitting = [values for key, values in sections(content(path)) if fits(key, node)]
    if not fitting:
        [*why] = unused_files(["--params-file", str(path)], node)
        raise ValueError("; ".join(why) or f"{path} is no parameter file for {node}")
    values = {name: value for one in fitting for name, value in flattened(one)}
    for row in full_table(TRACK_INITIATOR):
        refuse_integer(row, values.get(row.name), f"{path}: ")
    return values
