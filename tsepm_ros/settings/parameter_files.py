"""Parameter files given to a node: their sections, and what in them cannot be used."""

from __future__ import annotations

import argparse
import itertools
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from tsepm_ros import plain_yaml
from tsepm_ros.parameters import Value
from tsepm_ros.settings.rendering import ANY_NODE
from tsepm_ros.settings.tables import TRACK_INITIATOR, full_table
from tsepm_ros.settings.value_text import parse_values

OF_ROS = ("use_sim_time", "start_type_description_service", "qos_overrides.")
"""Beginnings of the parameters that ROS declares itself."""
_SECTION = "ros__parameters"


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


def parameter_files(arguments: Sequence[str]) -> list[Path]:
    """Paths after ``--params-file`` among the arguments of a node."""
    return [Path(path) for flag, path in itertools.pairwise(arguments) if flag == "--params-file"]


def unused_files(arguments: Sequence[str], node: str) -> list[str]:
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
        keys = [key for key, _ in _sections(_content(path))]
        if keys and not any(fits(key, node) for key in keys):
            sentences.append(
                f"parameter file {path} is not used: it has no section for {node}, only for "
                f"{', '.join(keys)}; the key {ANY_NODE} fits any name and namespace"
            )
    return sentences


def without_value(arguments: Sequence[str], node: str) -> list[str]:
    """Names of the parameters in the files of a node that have no value that ROS can hold."""
    return [
        name
        for path in parameter_files(arguments)
        for key, values in _sections(_content(path))
        if fits(key, node)
        for name, value in _flattened(values)
        if value is None or value == []
    ]


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
    sections = [values for key, values in _sections(_content(path)) if fits(key, node)]
    if not sections:
        [*why] = unused_files(["--params-file", str(path)], node)
        raise ValueError("; ".join(why) or f"{path} is no parameter file for {node}")
    values = {name: value for one in sections for name, value in _flattened(one)}
    for row in full_table(TRACK_INITIATOR):
        if row.type is float and type(value := values.get(row.name)) is int:
            raise ValueError(
                f"{path}: {row.name} must be a number with a decimal point; got {value}"
            )
    return values


def fits(key: str, node: str) -> bool:
    """Whether the key of a section fits a fully qualified name of a node, as in rcl.

    ``*`` stands for one part of the name, ``**`` for any number.
    """
    parts = (part for part in key.split("/") if part)
    pattern = "".join(
        {"**": "(/[^/]+)*", "*": "/[^/]+"}.get(part, f"/{re.escape(part)}") for part in parts
    )
    return re.fullmatch(pattern, node) is not None


def _content(path: Path) -> Any:
    """Content of a file; None if it is no YAML, which ROS itself refuses."""
    try:
        return plain_yaml.load(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError, RecursionError, ValueError):
        return None


def _sections(content: Any, prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Keys of nodes, with the namespaces around them, and their parameters."""
    if not isinstance(content, Mapping):
        return
    for key, value in content.items():
        if key == _SECTION:
            yield prefix, value
        else:
            yield from _sections(
                value, f"{prefix}/{key}".replace("//", "/") if prefix else str(key)
            )


def _flattened(values: Any, prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Full names and values of parameters in nested mappings."""
    if not isinstance(values, Mapping):
        return
    for key, value in values.items():
        name = f"{prefix}{key}"
        if isinstance(value, Mapping):
            yield from _flattened(value, f"{name}.")
        else:
            yield name, value
