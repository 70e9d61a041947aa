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
"""Values of parameters that commands are given, in files and on the command line, and defaults."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from tsepm_ros.parameters import Value, refuse_integer_parameter
from tsepm_ros.settings.parameter_files import (
    ANY_NODE,
    OF_ROS,
    flattened_parameter_file,
    parameter_file_content,
    parameter_file_fits,
    parameter_file_section,
    parameter_file_sections,
    parameter_file_text,
    parse_parameter_file_values,
    unused_parameter_files,
)
from tsepm_ros.settings.settings import NODES, TRACK_INITIATOR, Groups, settings_table
from tsepm_ros.tools.commands.arguments import Arguments
from tsepm_ros.tracker.options import NO_LONGER
from tsepm_ros.whole_files import read_whole_text

ARGUMENTS: Arguments = {
    "node": {"nargs": "?", "choices": [*sorted(NODES), "all"], "default": "track_initiator"}
}
"""Of `tsepm parameters`."""


def given_parameters_as_yaml(node: str, groups: Groups, key: str = ANY_NODE) -> str:
    """A ROS parameter file with the default of every parameter of a node.

    By default the key fits any node that gets the file, also under another name or in a namespace.
    """
    lines = [f"# Parameters of {node}", *parameter_file_section(key)]
    for row in settings_table(groups):
        note = ", ".join(part for part in (row.unit, row.bounds) if part)
        lines.append(f"    # {row.description}{f' [{note}]' if note else ''}")
        lines.append(f"    {row.name}: {parameter_file_text(row.default)}")
    return "\n".join(lines) + "\n"


def print_parameters(options: argparse.Namespace) -> None:
    """Print the parameter file of a node, or of all, with the defaults."""
    nodes = NODES if options.node == "all" else {options.node: NODES[options.node]}
    keys = {node: ANY_NODE if len(nodes) == 1 else f"{ANY_NODE}/{node}" for node in nodes}
    print(
        "\n".join(given_parameters_as_yaml(node, nodes[node], key) for node, key in keys.items()),
        end="",
    )


def add_given_parameters(
    parser: argparse.ArgumentParser,
    *names: str,
    help: str = "parameter of the node track_initiator; may be repeated",
) -> None:
    """Add a repeatable argument NAME:=VALUE, by default `-p` with `--params-file`."""
    parser.add_argument(
        *(names or ("-p", "--parameter")),
        action="append",
        default=[],
        metavar="NAME:=VALUE",
        help=help,
    )
    if not names:
        parser.add_argument(
            "--params-file",
            dest="parameter",
            action="append",
            type=Path,
            metavar="FILE",
            help="parameter file of the node; may be repeated; of -p and files the last one holds",
        )


def given_parameter_values(
    given: Sequence[str | Path], node: str = "/track_initiator"
) -> dict[str, Value]:
    """Values by full name of parameter files and of assignments NAME:=VALUE.

    As in ROS the last value of a name holds. The parameters of ROS itself are left out.

    Raises
    ------
    ValueError
        If a file cannot be read or has nothing for the node, or an assignment is none.
    """
    values: dict[str, Value] = {}
    for source in given:
        values |= (
            given_parameters_for(source, node)
            if isinstance(source, Path)
            else parse_parameter_file_values([source])
        )
    for name in sorted(NO_LONGER.keys() & values.keys()):
        print(f"note: {name}: {NO_LONGER[name]}", file=sys.stderr)
    return {name: value for name, value in values.items() if not name.startswith(OF_ROS)}


def given_parameters_for(path: Path, node: str) -> dict[str, Value]:
    """Values that a parameter file has for a node; refuses the types that ROS refuses."""
    read_whole_text(path)
    fitting = [
        values
        for key, values in parameter_file_sections(parameter_file_content(path))
        if parameter_file_fits(key, node)
    ]
    if not fitting:
        why = "; ".join(unused_parameter_files(["--params-file", str(path)], node))
        raise ValueError(
            why
            or f"{path} is no parameter file for {node}: it needs a section of this name, and "
            "ros__parameters in it, as tsepm parameters prints them"
        )
    values = {
        name: value
        for values_of_section in fitting
        for name, value in flattened_parameter_file(values_of_section)
    }
    for row in settings_table(TRACK_INITIATOR):
        refuse_integer_parameter(row, values.get(row.name), f"{path}: ")
    return values
