"""Values of parameters as text: in YAML, and as NAME:=VALUE on the command line."""

from __future__ import annotations

from collections.abc import Iterable

import yaml

from tsepm_ros import plain_yaml
from tsepm_ros.parameters import EXPONENT, Value, shown


def yaml_text(value: Value) -> str:
    """Write a value as YAML 1.1, which ROS reads; YAML 1.1 reads 1e-06 as a text, not 1.0e-06."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        mantissa, exponent, power = repr(value).partition("e")
        return f"{mantissa}{'' if '.' in mantissa else '.0'}{exponent}{power}"
    return f'"{value}"' if isinstance(value, str) else str(value)


def parse_values(assignments: Iterable[str]) -> dict[str, Value]:
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
            raise ValueError(f"a parameter must have the form NAME:=VALUE; got {shown(assignment)}")
        try:
            exponential = EXPONENT.fullmatch(text.strip())
            values[name] = float(text) if exponential else plain_yaml.load(text)
        except (yaml.YAMLError, RecursionError, ValueError):  # a date such as 2026-13-01
            raise ValueError(f"{name}: {shown(text)} is not a value") from None
    return values
