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
"""The parameter table behind options, ROS parameters, YAML and documentation.

A group of parameters is a frozen dataclass whose fields are made by :func:`parameter`. Declaration,
validation and documentation use the name, type and default of the field, and its description, unit
and bounds.
"""

from __future__ import annotations

import dataclasses
import difflib
import math
import re
import sys
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

Value = bool | int | float | str | tuple[str, ...]

MIN_LIKENESS = 0.6
"""Smallest ratio, as in difflib, of an unknown name and a name that it may be meant for."""

EXPONENT = re.compile(r"[-+]?[0-9]+(\.[0-9]*)?[eE][-+]?[0-9]+")
"""A number with an exponent, with or without a decimal point."""

MAX_DEGREES = 360.0
"""Largest angle that is taken for degrees."""
WHOLE_TURN = 6.2832
"""A turn as a user rounds it up, rad."""

MAX_SHOWN = 80
"""Most characters of a refused value in a message."""

MAX_NAMES = 4
"""Most names in a question for the name that is meant."""

_MANOEUVRE = (
    "target_manoeuvre",
    "m/s^2: the square root of the process noise divided by the time between scans; 0: learned",
)
REPLACED = {"score.process_noise": _MANOEUVRE, "process_noise": _MANOEUVRE}
"""Names of earlier versions: the parameter that replaces each, and how its value follows."""


@dataclass(frozen=True)
class Parameter:
    """One row of a parameter table.

    Attributes
    ----------
    name : str
        Name within its group.
    default : bool, int, float, str or tuple of str
        Default value; its type is the parameter's type.
    description : str
        One sentence, without the unit.
    unit : str
        SI unit, or empty.
    minimum, maximum : float
        Inclusive bounds of a number.
    positive : bool
        The number must be larger than zero.
    choices : tuple of str
        Allowed values of a string; empty: any.
    numeric : bool
        The text may be given as a number, or as what YAML takes for a truth value (on, off).
    read_only : bool
        The value cannot change while a node runs.
    plain : str
        Of a parameter of one of several sensors: the one of all, whose value it has if not given.
    """

    name: str
    default: Value
    description: str
    unit: str = ""
    minimum: float = -math.inf
    maximum: float = math.inf
    positive: bool = False
    choices: tuple[str, ...] = ()
    numeric: bool = False
    read_only: bool = False
    plain: str = ""

    @property
    def type(self) -> type:
        """Type of the value: bool, int, float, str or tuple."""
        return type(self.default)

    @property
    def bounds(self) -> str:
        """The allowed values in words; empty if all values are allowed."""
        if self.choices:
            return "one of " + ", ".join(self.choices)
        high = f"{self.maximum:g}"
        if self.positive:
            return "above 0" if self.maximum == math.inf else f"above 0 and at most {high}"
        if self.maximum == math.inf:
            return "" if self.minimum == -math.inf else f"at least {self.minimum:g}"
        return f"from {self.minimum:g} to {high}"

    def check(self, value: Any, name: str = "") -> Any:
        """Return `value` in this parameter's type.

        Parameters
        ----------
        value : object
            Value from the user. An int is accepted for a float, other types are not converted.
        name : str, optional
            Name in the message, if it differs from the name in the group.

        Raises
        ------
        ValueError
            If the type or the value is not allowed; the message names the parameter.
        """
        name = name or self.name
        typed: Value = self._typed(value, name)
        if self.choices and typed not in self.choices:
            raise ValueError(f"{name} must be {self.bounds}; got {shown_parameter(value)}")
        if isinstance(typed, int | float) and not isinstance(typed, bool):
            inside = self.minimum <= typed <= self.maximum and not (self.positive and typed <= 0)
            if not inside:
                given = typed if isinstance(value, str) else value  # a text such as 1e-06
                raise ValueError(self.out_of_bounds(given, name))
        return typed

    def out_of_bounds(self, value: Any, name: str = "") -> str:
        """The sentence that refuses a number, with a question if it may be in degrees."""
        sentence = (
            f"{name or self.name} must be {self.bounds or 'a number'}; got {shown_parameter(value)}"
        )
        radians = math.radians(value) if abs(value) <= MAX_DEGREES else math.nan
        if self.unit != "rad" or not (self.minimum <= radians <= self.maximum):
            return sentence
        return f"{sentence} (in rad; {value:g} degrees are {radians:.4g} rad)"

    def meant(self, value: Any) -> Any:
        """The value that YAML has read as another type: "off" as false, 1e-06 as a text.

        A number is a text for a parameter that is `numeric`. A list of one empty text is none: ROS
        has no other empty list.
        """
        if self.type is tuple and isinstance(value, list | tuple):
            return tuple(value) if [*value] != [""] else ()
        if self.numeric and isinstance(value, bool | int | float):
            return ("on" if value else "off") if isinstance(value, bool) else f"{value!r}"
        if self.choices and isinstance(value, bool) and {"on", "off"} <= set(self.choices):
            return "on" if value else "off"
        if self.type is float and isinstance(value, str) and EXPONENT.fullmatch(value):
            return float(value)
        return value

    def allows(self, value: Any) -> bool:
        """Whether `check` accepts the value."""
        try:
            self.check(value)
        except ValueError:
            return False
        return True

    def _typed(self, value: Any, name: str) -> Any:
        value = self.meant(value)
        if hasattr(value, "item") and getattr(value, "ndim", 0) == 0:
            value = value.item()  # a NumPy scalar
        if self.type is float and isinstance(value, int) and not isinstance(value, bool):
            value = float(value) if abs(value) <= sys.float_info.max else value
        texts = all(isinstance(one, str) for one in value) if isinstance(value, tuple) else True
        if type(value) is not self.type or not texts:
            kinds = {float: "a number", int: "an integer", bool: "true or false", str: "a text"}
            kinds[tuple] = "a list of texts"
            expected = kinds[self.type] + (f", {self.bounds}" if self.choices else "")
            raise ValueError(f"{name} must be {expected}; got {shown_parameter(value)}")
        return value


def parameter(default: Value, description: str, **details: Any) -> Any:
    """Make a dataclass field that is a row of the parameter table (see :class:`Parameter`)."""
    return dataclasses.field(
        default=default, metadata={"description": description, "details": details}
    )


def meant_parameter(name: str, known: Collection[str]) -> str:
    """What has replaced an unknown name, or the question for known names; may be empty."""
    other, value = REPLACED.get(name, ("", ""))
    if other in known:
        return f"; it is replaced by {other}, {value}"
    return _question(
        [other for other in known if _leaf(other) == _leaf(name)] or _nearest(name, known)
    )


def check_parameter(name: str, value: Any, rows: Mapping[str, Parameter]) -> Any:
    """Return the value of a parameter in its type; see `Parameter.check`.

    Parameters
    ----------
    name : str
        Full name, a key of `rows`.
    value : object
    rows : mapping of str to Parameter
        The table by full name.

    Raises
    ------
    ValueError
        If the value is not allowed. Where a parameter of another group has the same name and
        another type, which the value fits, the message asks for that parameter: a user who sets
        ``clutter_density`` to 2e-4 means ``sensor.clutter_density``.
    """
    try:
        return rows[name].check(value, name)
    except ValueError as error:
        fitting = [
            other
            for other, row in rows.items()
            if other != name
            and _leaf(other) == _leaf(name)
            and row.type is not rows[name].type
            and row.allows(value)
        ]
        raise ValueError(f"{error}{_question(fitting)}") from None


def refuse_integer_parameter(row: Parameter, value: Any, where: str = "") -> None:
    """Refuse an integer for a number, as ROS does in parameter files and at the start of a node.

    Raises
    ------
    ValueError
        The message begins with `where`.
    """
    if row.type is float and type(value) is int:
        raise ValueError(
            f"{where}{row.name} must be a number with a decimal point ({value}.0); got {value}"
        )


def shown_parameter(value: object) -> str:
    """A refused value for a message, at most `MAX_SHOWN` characters of it."""
    text = repr(value)
    return text if len(text) <= MAX_SHOWN else f"{text[:MAX_SHOWN]}..."


def _leaf(name: str) -> str:
    return name.rpartition(".")[2]


def _nearest(name: str, known: Collection[str]) -> list[str]:
    """The names closest to an unknown name, compared with and without their groups."""
    texts = {text for other in known for text in (other, _leaf(other))}
    given = name.lower().replace("-", "_")
    close = difflib.get_close_matches(given, texts, len(texts), MIN_LIKENESS)
    likeness = [difflib.SequenceMatcher(None, text, given).ratio() for text in close]
    best = {text for text, ratio in zip(close, likeness, strict=True) if ratio == likeness[0]}
    return [other for other in known if {other, _leaf(other)} & best]


def _question(names: Sequence[str]) -> str:
    named = ", ".join([*names[:MAX_NAMES], *(["..."] if len(names) > MAX_NAMES else [])])
    return f"; did you mean {named}?" if names else ""


def parameter_table(group: type | object) -> Iterator[Parameter]:
    """Iterate over the parameters of a group, in their order of declaration."""
    for field in dataclasses.fields(group):  # type: ignore[arg-type]
        if "description" in field.metadata:
            yield Parameter(
                field.name,
                field.default,  # type: ignore[arg-type]
                field.metadata["description"],
                **field.metadata["details"],
            )


class ParameterGroup:
    """Base class of frozen dataclasses whose fields are parameters: each is checked.

    Raises
    ------
    ValueError
        Naming the first parameter whose value is not allowed.
    """

    def __post_init__(self) -> None:
        for row in parameter_table(self):
            object.__setattr__(self, row.name, row.check(getattr(self, row.name)))
