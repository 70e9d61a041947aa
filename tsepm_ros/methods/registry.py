"""The track initiation methods, by name."""

from __future__ import annotations

import dataclasses
from typing import Any

from tsepm_ros.environment.land import LandMask
from tsepm_ros.initiation.common_options import CommonOptions
from tsepm_ros.initiation.initiator import Initiator
from tsepm_ros.initiation.method import Method
from tsepm_ros.methods.clutter_test import ClutterTest
from tsepm_ros.methods.heuristic import Heuristic
from tsepm_ros.methods.hough import Hough
from tsepm_ros.methods.logic import Logic
from tsepm_ros.methods.modified_hough import ModifiedHough
from tsepm_ros.methods.multiple_model import MultipleModel
from tsepm_ros.methods.score.score_method import Score
from tsepm_ros.methods.sequential import Sequential
from tsepm_ros.methods.split_merge import SplitMerge
from tsepm_ros.methods.tsepm.tsepm_method import Tsepm
from tsepm_ros.parameters import check_value, meant_name, table
from tsepm_ros.sensing.sensor import SensorModel

METHODS: dict[str, type[Method]] = {
    "tsepm": Tsepm,
    "score": Score,
    "sequential": Sequential,
    "heuristic": Heuristic,
    "logic": Logic,
    "hough": Hough,
    "modified_hough": ModifiedHough,
    "clutter_test": ClutterTest,
    "split_merge": SplitMerge,
    "multiple_model": MultipleModel,
}
"""Every method. A new one is a module here and a row in this table."""


def available_methods() -> tuple[str, ...]:
    """Names that `make_initiator` accepts."""
    return tuple(METHODS)


def option_names(method: str) -> frozenset[str]:
    """Names of the options that a method takes, its own and those common to all."""
    groups = (CommonOptions, METHODS[method].Options)
    return frozenset(field.name for group in groups for field in dataclasses.fields(group))


def make_method(method: str, *, sensor: SensorModel, **options: Any) -> Method:
    """Make a method; see `make_initiator`."""
    if method not in METHODS:
        raise ValueError(f"method must be one of {', '.join(METHODS)}; got {method!r}")
    if not isinstance(sensor, SensorModel):
        raise TypeError(f"sensor must be a SensorModel; got {type(sensor).__name__}")
    kind = METHODS[method]
    known = option_names(method)
    unknown = sorted(set(options) - known)
    rows = {row.name: row for group in (CommonOptions, kind.Options) for row in table(group)}
    rows |= {f"sensor.{row.name}": row for row in table(SensorModel)}
    if unknown:
        raise ValueError(
            f"{unknown[0]} is not an option of method {method!r}; it has "
            f"{', '.join(sorted(known))}{meant_name(unknown[0], rows)}"
        )
    for name in options.keys() & rows.keys():
        check_value(name, options[name], rows)
    common = {field.name for field in dataclasses.fields(CommonOptions)}
    return kind(
        sensor,
        CommonOptions(**{name: value for name, value in options.items() if name in common}),
        kind.Options(**{name: value for name, value in options.items() if name not in common}),
    )


def make_initiator(
    method: str, *, sensor: SensorModel, land: LandMask | None = None, **options: Any
) -> Initiator:
    """Make a track initiator.

    Parameters
    ----------
    method : str
        One of `available_methods()`.
    sensor : SensorModel
        The sensor's errors and coverage.
    land : LandMask, optional
        Land of the fixed frame: detections on it are left out.
    **options
        Options common to all methods (`max_speed` and the limits, see
        `common_options.CommonOptions`) and the method's own (its class's `Options`).

    Returns
    -------
    Initiator

    Raises
    ------
    ValueError
        If the method is unknown, the method has no such option, or a value is not allowed; the
        message names it.
    TypeError
        If `sensor` is not a SensorModel.
    """
    initiator = Initiator(make_method(method, sensor=sensor, **options))
    initiator.land = land
    return initiator
