"""Declaration and validation of a node's parameters from the parameter table."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    ParameterType,
    SetParametersResult,
)
from rclpy.exceptions import InvalidParameterValueException
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

from tsepm_ros.nodes import quality_of_service
from tsepm_ros.parameters import Parameter, Value, meant_instead, shown, unknown_parameter
from tsepm_ros.settings.parameter_files import OF_ROS, unused_files, without_value
from tsepm_ros.settings.settings import (
    Groups,
    full_table,
    is_of_another_method,
    make_groups,
    with_method,
)

_INT64 = 2**63 - 1
_TYPE_HINTS = {
    float: "a number with a decimal point (4.0, not 4)",
    int: "an integer",
    bool: "true or false",
    str: "a text",
}

OptionsByType = Mapping[type[Any], Any]
"""Option objects by their class."""


class ParameterError(ValueError):
    """The value of a parameter is not allowed."""


@contextmanager
def refusing(name: str = "") -> Iterator[None]:
    """Turn a ValueError into a ParameterError whose message begins with a parameter's name."""
    try:
        yield
    except ValueError as error:
        raise ParameterError(f"{name}: {error}" if name else str(error)) from None


class ParameterisedNode(Node):
    """A node that uses `NodeParameters`.

    All given parameters are declared: rclpy reports undeclared names in no other way, and a
    misspelt parameter must not be ignored silently. A parameter file without a section for the
    node is named in a warning: ROS ignores it.

    Raises
    ------
    ParameterError
        If a parameter has no value, such as an empty list.
    """

    def __init__(self, name: str, **node_options: Any) -> None:
        arguments = [*(node_options.get("cli_args") or ()), *sys.argv[1:]]
        try:
            super().__init__(
                name, automatically_declare_parameters_from_overrides=True, **node_options
            )
        except ValueError as error:
            if not any(words in str(error) for words in ("NOT_SET", "do not agree")):
                raise
            names = without_value(arguments, self.get_fully_qualified_name())
            raise ParameterError(
                f"{', '.join(names) or 'a parameter'} has no value: an empty list or entry is none"
            ) from None
        for sentence in unused_files(arguments, self.get_fully_qualified_name()):
            self.get_logger().warning(sentence)

    def create_service(
        self, srv_type: Any, srv_name: str, callback: Callable[[Any, Any], Any], **options: Any
    ) -> Any:
        """Make a service; a parameter of no type that exists has no value, which is refused."""

        def answer(request: Any, response: Any) -> Any:
            for one in getattr(request, "parameters", ()):
                if one.value.type > ParameterType.PARAMETER_STRING_ARRAY:
                    one.value.type = ParameterType.PARAMETER_NOT_SET
            return callback(request, response)

        return super().create_service(srv_type, srv_name, answer, **options)

    def refuse_unused_overrides(self) -> None:
        """Refuse overrides of the quality of service that nothing uses; after the publishers.

        Raises
        ------
        ParameterError
        """
        for sentence in quality_of_service.faults(self):
            raise ParameterError(sentence)


class NodeParameters:
    """A node's parameters, declared from their table.

    Parameters
    ----------
    node : ParameterisedNode
    groups : Groups
        The table, by groups.
    on_change : callable, optional
        Called with the options after parameters changed at run time.
    rehearse : callable, optional
        Called with the options before a change; an exception in `failures` refuses the change.
    failures : tuple of exception types, optional

    Raises
    ------
    ParameterError
        If a name given at the start is unknown or its value is not allowed; the message names
        the parameter.
    """

    def __init__(
        self,
        node: ParameterisedNode,
        groups: Groups,
        on_change: Callable[[OptionsByType], None] = lambda options: None,
        validate: Callable[[OptionsByType], None] = lambda options: None,
        failures: tuple[type[Exception], ...] = (),
    ) -> None:
        self._node = node
        chosen = node.get_parameters_by_prefix("").get("method")
        self._groups = with_method(groups, chosen and chosen.value)
        self._on_change = on_change
        self._rehearse = validate
        self._failures = failures
        self._rows = {row.name: row for row in full_table(self._groups)}
        self._refuse_unknown()
        for row in self._rows.values():
            self._declare(row)
        self.options = self._make_options({})
        node.add_pre_set_parameters_callback(self._typed)
        node.add_on_set_parameters_callback(self._check)
        node.add_post_set_parameters_callback(self._apply_changes)

    def _refuse_unknown(self) -> None:
        given = self._node.get_parameters_by_prefix("")
        for name, one in given.items():
            fault = name.startswith(quality_of_service.PREFIX) and quality_of_service.fault(
                name, one.value
            )
            if fault:
                raise ParameterError(fault)
            if name in self._rows or name.startswith(OF_ROS):
                continue
            if not is_of_another_method(name, self._rows):
                raise ParameterError(unknown_parameter(name, self._rows))
            self._node.undeclare_parameter(name)
            self._node.get_logger().warning(f"{name} is not used: another method is chosen")

    def _declare(self, row: Parameter) -> None:
        given: Any = row.default
        if self._node.has_parameter(row.name):
            given = row.meant(self._node.get_parameter(row.name).value)
            self._node.undeclare_parameter(row.name)
        if type(given) is not row.type:
            raise ParameterError(self._wrong_type(row, given))
        try:
            self._node.declare_parameter(row.name, given, _descriptor(row), ignore_override=True)
        except InvalidParameterValueException:
            raise ParameterError(row.out_of_bounds(given)) from None

    def _wrong_type(self, row: Parameter, value: Any) -> str:
        """The sentence that refuses a value of another type."""
        allowed = _TYPE_HINTS[row.type] + (f", {row.bounds}" if row.choices else "")
        meant = meant_instead(row.name, value, self._rows)
        return f"{row.name} must be {allowed}; got {shown(value)}{meant}"

    def _values(self) -> dict[str, Value]:
        return {name: self._node.get_parameter(name).value for name in self._rows}

    def _make_options(self, changes: Mapping[str, Value]) -> dict[type[Any], Any]:
        with refusing():
            return make_groups(self._groups, {**self._values(), **changes})

    def _typed(self, parameters: list[RosParameter]) -> list[RosParameter]:
        """The values as they are meant: `ros2 param load` sends 1.0e-06 as a text.

        All others stay as they are: rclpy cannot make a parameter of an empty array alone.
        """
        return [
            RosParameter(one.name, value=meant)
            if one.name in self._rows
            and (meant := self._rows[one.name].meant(one.value)) is not one.value
            else one
            for one in parameters
        ]

    def _check(self, parameters: list[RosParameter]) -> SetParametersResult:
        if not all(one.name for one in parameters):  # rclpy would declare it
            return SetParametersResult(successful=False, reason="a parameter has no name")
        # Types were checked by rclpy; another part of the node has declared what is in no row.
        changes = {one.name: one.value for one in parameters if one.name in self._rows}
        if not changes:
            return SetParametersResult(successful=True)
        try:
            self._rehearse(self._make_options(changes))
        except ParameterError as error:
            return SetParametersResult(successful=False, reason=str(error))
        except self._failures as error:
            reason = f"{', '.join(changes)} cannot be used: {error!r}"
            return SetParametersResult(successful=False, reason=reason)
        return SetParametersResult(successful=True)

    def _apply_changes(self, parameters: list[RosParameter]) -> None:
        if not any(parameter.name in self._rows for parameter in parameters):
            return
        self.options = self._make_options({})
        self._on_change(self.options)


def _descriptor(row: Parameter) -> ParameterDescriptor:
    unit = f" [{row.unit}]" if row.unit else ""
    descriptor = ParameterDescriptor(
        description=row.description + unit,
        additional_constraints=row.bounds,
        read_only=row.read_only,
    )
    if row.type is float and row.bounds:
        max_float = sys.float_info.max
        descriptor.floating_point_range = [
            FloatingPointRange(
                from_value=max(0.0 if row.positive else row.minimum, -max_float),
                to_value=min(row.maximum, max_float),
            )
        ]
    elif row.type is int and row.bounds:
        descriptor.integer_range = [
            IntegerRange(
                from_value=int(max(row.minimum, -_INT64)), to_value=int(min(row.maximum, _INT64))
            )
        ]
    return descriptor
