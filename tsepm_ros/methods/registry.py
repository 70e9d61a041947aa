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
"""The track initiation methods, by name."""

from __future__ import annotations

import dataclasses
import os
import pkgutil
import sys
import warnings
from collections.abc import Mapping
from typing import Any

from tsepm_ros.parameters import check_parameter, meant_parameter, parameter_table
from tsepm_ros.tracker.clutter.fixed_places import LandMask
from tsepm_ros.tracker.method import Method
from tsepm_ros.tracker.options import NO_LONGER, CommonOptions
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


def outside_object(name: str) -> Any:
    """A class or function from outside the package, by ``module:name``.

    Its module is installed, on Python's path, or in the working folder.

    Raises
    ------
    ValueError
        If it cannot be imported; the message names it.
    """
    if os.getcwd() not in sys.path:
        sys.path.append(os.getcwd())  # last: it hides no installed module
    try:
        if not all(name.partition(":")):
            raise ValueError("expected module:name")
        return pkgutil.resolve_name(name)
    except Exception as error:
        raise ValueError(f"{name} cannot be imported: {type(error).__name__}: {error}") from error


def registered_method(method: str) -> type[Method]:
    """The class of a method: its name in the table, or ``module:Class`` from outside.

    Raises
    ------
    ValueError
        If there is no such method.
    """
    if ":" in method:
        outside = outside_object(method)
        options = getattr(outside, "Options", None)
        if not (isinstance(outside, type) and issubclass(outside, Method)):
            raise ValueError(f"{method} is not a subclass of tsepm_ros.tracker.method.Method")
        if not dataclasses.is_dataclass(options):
            raise ValueError(f"{method} has no dataclass Options, the parameters of its own")
        return outside
    if method not in METHODS:
        raise ValueError(
            f"method must be one of {', '.join(METHODS)}, or module:Class; got {method!r}"
        )
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
    for name in NO_LONGER.keys() & options.keys():
        warnings.warn(f"{name}: {NO_LONGER[name]}", stacklevel=3)
        del options[name]
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
    groups = (
        CommonOptions(**{name: value for name, value in options.items() if name in common}),
        kind.Options(**{name: value for name, value in options.items() if name not in common}),
    )
    try:
        return kind(sensor, *groups)
    except Exception as error:
        if method in METHODS:
            raise
        raise ValueError(f"{method} cannot be made: {type(error).__name__}: {error}") from error


def make_initiator(
    method: str,
    *,
    sensor: SensorModel | Mapping[str, SensorModel],
    land: LandMask | None = None,
    **options: Any,
) -> Tracker:
    """Make a track initiator.

    Parameters
    ----------
    method : str
        One of `available_methods()`, or ``module:Class``, a subclass of `Method` from outside.
    sensor : SensorModel or mapping of str to SensorModel
        The sensor's errors and coverage; of several sensors in one picture by the names that their
        scans have as `Scan.sensor`.
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
        If the method is unknown, takes no several sensors, or has no such option, or a value is not
        allowed; the message names it.
    TypeError
        If `sensor` is not a SensorModel.
    """
    models = dict(sensor) if isinstance(sensor, Mapping) else {"": sensor}
    if not models:
        raise ValueError("sensor must name a sensor at least")
    made = [make_method(method, sensor=model, **options) for model in models.values()]
    if len(models) > 1 and not made[0].several_sensors:
        raise ValueError(f"method {method!r} takes one sensor; 'score' takes several")
    initiator = Tracker(made[0], models)
    initiator.land = land
    return initiator
