"""The track initiation methods, by name."""

from __future__ import annotations

import dataclasses
import pkgutil
from typing import Any

from tsepm_ros.parameters import check_parameter, meant_parameter, parameter_table
from tsepm_ros.tracker.clutter.fixed_places import LandMask
from tsepm_ros.tracker.method import Method
from tsepm_ros.tracker.options import CommonOptions
from tsepm_ros.tracker.sensor import SensorModel
from tsepm_ros.tracker.tracker import Tracker

METHODS: dict[str, type[Method] | str] = {
    "tsepm": "tsepm_ros.methods.tsepm:Tsepm",
    "score": "tsepm_ros.methods.score:Score",
    "sequential": "tsepm_ros.studies.sequential:Sequential",
    "heuristic": "tsepm_ros.studies.path_following:HeuristicPathFollower",
    "logic": "tsepm_ros.studies.logic:Logic",
    "hough": "tsepm_ros.studies.hough:Hough",
    "modified_hough": "tsepm_ros.studies.hough:ModifiedHough",
    "clutter_test": "tsepm_ros.studies.split_merge:SplitMergeClutterTest",
    "split_merge": "tsepm_ros.studies.split_merge:SplitMerge",
    "multiple_model": "tsepm_ros.studies.multiple_model:MultipleModel",
    "kalman": "tsepm_ros.studies.kalman:Kalman",
}
"""Every method: its class, or the place of its class, which is imported when it is chosen.

A new method is a module and a row in this table.
"""
NODE_METHODS = ("tsepm", "score")
"""Methods whose parameters the node always has; those of another exist where it is chosen."""


def registered_method(method: str) -> type[Method]:
    """The class of a method.

    Raises
    ------
    ValueError
        If there is no such method.
    """
    if method not in METHODS:
        raise ValueError(f"method must be one of {', '.join(METHODS)}; got {method!r}")
    kind = METHODS[method]
    resolved: type[Method] = pkgutil.resolve_name(kind) if isinstance(kind, str) else kind
    return resolved


def available_methods() -> tuple[str, ...]:
    """Names that `make_initiator` accepts."""
    return tuple(METHODS)


def registered_option_names(method: str) -> frozenset[str]:
    """Names of the options that a method takes, its own and those common to all."""
    groups = (CommonOptions, registered_method(method).Options)
    return frozenset(field.name for group in groups for field in dataclasses.fields(group))


def make_method(method: str, *, sensor: SensorModel, **options: Any) -> Method:
    """Make a method; see `make_initiator`."""
    kind = registered_method(method)
    if not isinstance(sensor, SensorModel):
        raise TypeError(f"sensor must be a SensorModel; got {type(sensor).__name__}")
    known = registered_option_names(method)
    unknown = sorted(set(options) - known)
    rows = {
        row.name: row for group in (CommonOptions, kind.Options) for row in parameter_table(group)
    }
    rows |= {f"sensor.{row.name}": row for row in parameter_table(SensorModel)}
    if unknown:
        raise ValueError(
            f"{unknown[0]} is not an option of method {method!r}; it has "
            f"{', '.join(sorted(known))}{meant_parameter(unknown[0], rows)}"
        )
    for name in options.keys() & rows.keys():
        check_parameter(name, options[name], rows)
    common = {field.name for field in dataclasses.fields(CommonOptions)}
    return kind(
        sensor,
        CommonOptions(**{name: value for name, value in options.items() if name in common}),
        kind.Options(**{name: value for name, value in options.items() if name not in common}),
    )


def make_initiator(
    method: str, *, sensor: SensorModel, land: LandMask | None = None, **options: Any
) -> Tracker:
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
        `tracker.options.CommonOptions`) and the method's own (its class's `Options`).

    Returns
    -------
    Tracker

    Raises
    ------
    ValueError
        If the method is unknown, the method has no such option, or a value is not allowed; the
        message names it.
    TypeError
        If `sensor` is not a SensorModel.
    """
    initiator = Tracker(make_method(method, sensor=sensor, **options))
    initiator.land = land
    return initiator
