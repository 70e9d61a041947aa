"""The parameter table behind options, ROS parameters, YAML and documentation.

A group of parameters is a frozen dataclass whose fields are made by :func:`parameter`. Declaration,
validation and documentation use the name, type and default of the field, and its description, unit
and bounds.
"""

from __future__ import annotations

import dataclasses
import difflib
import math
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import Any

Value = bool | int | float | str


@dataclass(frozen=True)
class Parameter:
    """One row of a parameter table.

    Attributes
    ----------
    name : str
        Name within its group.
    default : bool, int, float or str
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

    @property
    def type(self) -> type:
        """Type of the value: bool, int, float or str."""
        return type(self.default)

    @property
    def bounds(self) -> str:
        """The allowed values in words; empty if all values are allowed."""
        if self.choices:
            return "one of " + ", ".join(self.choices)
        low = f"{self.minimum:g}"
        if self.positive:
            return f"above 0 and at most {self.maximum:g}" if self.maximum < math.inf else "above 0"
        if self.minimum == -math.inf and self.maximum == math.inf:
            return ""
        if self.maximum == math.inf:
            return f"at least {low}"
        return f"from {low} to {self.maximum:g}"

    def check(self, value: Any, name: str = "") -> Value:
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
        value = self.spelled(value)
        typed: Value = self._typed(value, name)
        if self.choices and typed not in self.choices:
            raise ValueError(f"{name} must be {self.bounds}; got {value!r}")
        if isinstance(typed, int | float) and not isinstance(typed, bool):
            inside = self.minimum <= typed <= self.maximum and not (self.positive and typed <= 0)
            if not inside:
                raise ValueError(f"{name} must be {self.bounds or 'a number'}; got {value!r}")
        return typed

    def spelled(self, value: Any) -> Any:
        """Return a number or truth value as a text, if this parameter is `numeric`."""
        if not self.numeric or not isinstance(value, bool | int | float):
            return value
        return ("on" if value else "off") if isinstance(value, bool) else f"{value!r}"

    def _typed(self, value: Any, name: str) -> Any:
        if hasattr(value, "item") and getattr(value, "ndim", 0) == 0:
            value = value.item()  # a NumPy scalar
        if self.type is float and isinstance(value, int) and not isinstance(value, bool):
            value = _as_float(value)
        if type(value) is not self.type:
            expected = {float: "a number", int: "an integer", bool: "true or false", str: "a text"}
            raise ValueError(f"{name} must be {expected[self.type]}; got {value!r}")
        return value


def _as_float(value: int) -> float | int:
    """The integer as a float, or the integer itself if it is too large for a float."""
    try:
        return float(value)
    except OverflowError:
        return value


def parameter(default: Value, description: str, **details: Any) -> Any:
    """Make a dataclass field that is a row of the parameter table (see :class:`Parameter`)."""
    return dataclasses.field(
        default=default, metadata={"description": description, "details": details}
    )


def unknown_parameter(name: str, known: Collection[str]) -> str:
    """Return the error message for an unknown name, with the closest name of `known`."""
    near = difflib.get_close_matches(name, known, n=1)
    return f"{name} is not a parameter{f'; did you mean {near[0]}?' if near else ''}"


def table(group: type | object) -> Iterator[Parameter]:
    """Iterate over the parameters of a group, in their order of declaration."""
    for field in dataclasses.fields(group):  # type: ignore[arg-type]
        if "description" in field.metadata:
            yield Parameter(
                field.name,
                field.default,  # type: ignore[arg-type]
                field.metadata["description"],
                **field.metadata["details"],
            )


def check_group(group: object) -> None:
    """Check every parameter of a frozen group in its ``__post_init__``.

    Raises
    ------
    ValueError
        Naming the first parameter whose value is not allowed.
    """
    for row in table(group):
        object.__setattr__(group, row.name, row.check(getattr(group, row.name)))
