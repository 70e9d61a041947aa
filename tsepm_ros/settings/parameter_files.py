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
"""Values of parameters as text: in YAML files, and as NAME:=VALUE on the command line.

Files are not trusted: they hold plain values only. Tags that make objects are refused, as by
`yaml.safe_load`, and so are aliases: a few lines of these stand for more values than any memory
holds. ROS refuses them in parameter files, too.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from tsepm_ros.parameters import EXPONENT, Value, shown_parameter

ANY_NODE = "/**"
"""Key of a parameter file that fits a node of any name in any namespace."""
OF_ROS = ("use_sim_time", "start_type_description_service", "qos_overrides.")
"""Beginnings of the parameters that ROS declares itself."""
_SECTION = "ros__parameters"


def parameter_file_text(value: Value) -> str:
    """Write a value as YAML 1.1, which ROS reads; YAML 1.1 reads 1e-06 as a text, not 1.0e-06.

    ROS has no list without an entry: an empty one has an empty text.
    """
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        mantissa, exponent, power = repr(value).partition("e")
        return f"{mantissa}{'' if '.' in mantissa else '.0'}{exponent}{power}"
    if isinstance(value, tuple):
        return f"[{', '.join(map(parameter_file_text, value or ('',)))}]"
    return f'"{value}"' if isinstance(value, str) else str(value)


def parse_parameter_file_values(assignments: Iterable[str]) -> dict[str, Value]:
    """Read assignments ``name:=value``, typed as in YAML, except that 1e-9 is a number.

    Raises
    ------
    ValueError
        If an assignment does not have this form.
    """
    values = {}
    for assignment in assignments:
        name, separator, text = assignment.partition(":=")
        if not separator or not name:
            raise ValueError(
                f"a parameter must have the form NAME:=VALUE; got {shown_parameter(assignment)}"
            )
        try:
            exponential = EXPONENT.fullmatch(text.strip())
            values[name] = float(text) if exponential else load_parameter_file_text(text)
        except ValueError:
            raise ValueError(f"{name}: {shown_parameter(text)} is not a value") from None
    return values


class _ParameterFileLoader(yaml.SafeLoader):
    """A loader without aliases."""

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        if self.check_event(yaml.AliasEvent):
            event = self.peek_event()  # type: ignore[no-untyped-call]
            raise yaml.composer.ComposerError(
                None, None, f"aliases such as *{event.anchor} are not supported", event.start_mark
            )
        node: yaml.Node | None = super().compose_node(parent, index)
        return node


def load_parameter_file_text(text: str) -> Any:
    """The content of a YAML text of a stranger.

    Raises
    ------
    ValueError
        If it is none; the message is one line.
    """
    try:
        return yaml.load(text, _ParameterFileLoader)
    except (yaml.YAMLError, ValueError, RecursionError) as error:  # a date such as 2026-13-01
        raise ValueError(f"not valid YAML: {' '.join(str(error).split())}") from None


def parameter_file_section(key: str = ANY_NODE) -> list[str]:
    """Lines that begin the section of a parameter file for the nodes of a key."""
    return [f"{key}:", "  ros__parameters:"]


def parameter_files(arguments: Sequence[str]) -> list[Path]:
    """Paths after ``--params-file`` among the arguments of a node."""
    return [Path(path) for flag, path in itertools.pairwise(arguments) if flag == "--params-file"]


def unused_parameter_files(arguments: Sequence[str], node: str) -> list[str]:
    """A sentence for each parameter file without a section that fits a node.

    Parameters
    ----------
    arguments : sequence of str
        Arguments of the node.
    node : str
        Its fully qualified name.
    """
    sentences = []
    for path in parameter_files(arguments):
        keys = [key for key, _ in parameter_file_sections(parameter_file_content(path))]
        if keys and not any(parameter_file_fits(key, node) for key in keys):
            sentences.append(
                f"parameter file {path} is not used: it has no section for {node}, only for "
                f"{', '.join(keys)}; the key {ANY_NODE} fits any name and namespace"
            )
    return sentences


def parameter_files_without_value(arguments: Sequence[str], node: str) -> list[str]:
    """Names of the parameters in the files of a node that have no value that ROS can hold."""
    return [
        name
        for path in parameter_files(arguments)
        for key, values in parameter_file_sections(parameter_file_content(path))
        if parameter_file_fits(key, node)
        for name, value in flattened_parameter_file(values)
        if value is None or value == []
    ]


def parameter_file_fits(key: str, node: str) -> bool:
    """Whether the key of a section fits a fully qualified name of a node, as in rcl.

    ``*`` stands for one part of the name, ``**`` for any number.
    """
    parts = (part for part in key.split("/") if part)
    pattern = "".join(
        {"**": "(/[^/]+)*", "*": "/[^/]+"}.get(part, f"/{re.escape(part)}") for part in parts
    )
    return re.fullmatch(pattern, node) is not None


def parameter_file_content(path: Path) -> Any:
    """Content of a file; None if it is no YAML, which ROS itself refuses."""
    try:
        return load_parameter_file_text(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None


def parameter_file_sections(content: Any, prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Keys of nodes, with the namespaces around them, and their parameters."""
    if not isinstance(content, Mapping):
        return
    for key, value in content.items():
        if key == _SECTION:
            yield prefix, value
        else:
            yield from parameter_file_sections(
                value, f"{prefix}/{key}".replace("//", "/") if prefix else str(key)
            )


def flattened_parameter_file(values: Any, prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Full names and values of parameters in nested mappings."""
    if not isinstance(values, Mapping):
        return
    for key, value in values.items():
        name = f"{prefix}{key}"
        if isinstance(value, Mapping):
            yield from flattened_parameter_file(value, f"{name}.")
        else:
            yield name, value
