"""Scenarios from YAML files: shipped scenarios and files of users."""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.parameters import shown
from tsepm_ros.settings import parameter_files
from tsepm_ros.tools.simulation.scenario import (
    ClutterPatch,
    ClutterStrength,
    Motion,
    OwnShipMotion,
    Scenario,
    TargetArea,
    TargetStrength,
    WaypointMotion,
)
from tsepm_ros.tracker.measurement import NAMES
from tsepm_ros.tracker.sensor import SensorModel

MAX_SCANS = 10_000_000

FILE_NAME = re.compile(r"[^/\\\x00-\x1f]{1,100}")
"""Names of scenarios: a part of the names of files."""


def shipped_scenarios() -> list[str]:
    """Names of the shipped scenarios."""
    folder = resources.files("tsepm_ros.tools.simulation") / "scenarios"
    return sorted(
        item.name.removesuffix(".yaml") for item in folder.iterdir() if item.name.endswith(".yaml")
    )


def load_scenario(name: str, changes: Mapping[str, Any] | None = None) -> Scenario:
    """Load a shipped scenario by its name, or a scenario from a YAML file.

    Parameters
    ----------
    name : str
        A name from `shipped_scenarios` or a path ending in ``.yaml``.
    changes : mapping, optional
        Values that replace those of the file, by key, for example ``sensor.azimuth_std``.

    Raises
    ------
    ValueError
        If the scenario does not exist, or a value in it is not allowed; the message names it.
    """
    if name.endswith((".yaml", ".yml")):
        try:
            text = Path(name).read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            raise ValueError(f"scenario file cannot be read: {error}") from None
    elif name in shipped_scenarios():
        source = resources.files("tsepm_ros.tools.simulation") / "scenarios" / f"{name}.yaml"
        text = source.read_text(encoding="utf-8")
    else:
        known = ", ".join(shipped_scenarios())
        raise ValueError(f"scenario must be a .yaml file or one of {known}; got {name!r}")
    try:
        content = parameter_files.load_yaml(text)
    except (yaml.YAMLError, RecursionError) as error:
        problem = " ".join(str(error).split())
        raise ValueError(f"scenario {name!r} is not valid YAML: {problem}") from None
    return scenario_from(_changed(content, changes or {}, name), name)


def _changed(content: Any, changes: Mapping[str, Any], name: str) -> dict[str, Any]:
    """The content of a file with some values changed."""
    content = dict(_mapping(content, f"scenario {name!r}"))
    for full_name, value in changes.items():
        section, separator, key = full_name.partition(".")
        if separator and key:
            value = {**_mapping(content.get(section, {}), section), key: value}
        content[section] = value
    return content


def scenario_from(content: Any, name: str = "scenario") -> Scenario:
    """Make a scenario from the content of a YAML file.

    Raises
    ------
    ValueError
        If a key is unknown or a value is not allowed; the message names it.
    """
    values = dict(_mapping(content, f"scenario {name!r}"))
    sensor = _section(SensorModel, values.pop("sensor", {}), "sensor")
    own_ship = _own_ship(_radians(values.pop("own_ship", {}), "own_ship"))
    targets, areas, features, strengths = [], [], [], []
    for where, entry in _entries(values.pop("targets", []), "targets"):
        values_of = _radians(entry, where)
        if "state" in values_of:
            _known(values_of, ["state", "features", "strength"], where)
            strengths.append(_strength(values_of.get("strength"), where))
            features.append(_features(values_of.get("features", {}), f"{where}.features"))
            targets.append(_numbers(values_of["state"], 4, f"{where}.state"))
        else:
            areas.append(_area(values_of, where))
    if "clutter_box" in values:
        values["clutter_box"] = _intervals(values["clutter_box"], 2, "clutter_box")
    values["clutter_patches"] = _patches(values.get("clutter_patches", []))
    values["clutter_features"] = _features(values.get("clutter_features", {}), "clutter_features")
    values.setdefault("name", Path(name).stem)
    of_targets = any([*strengths, *(area.strength for area in areas)])
    values["clutter_strength"] = _clutter_strength(values, of_targets)
    for key in ("areas", "target_features", "target_strengths"):
        if key in values:
            raise ValueError(f"scenario: unknown key {key!r}; {key} are given under targets")
    if not isinstance(values["name"], str) or not FILE_NAME.fullmatch(values["name"]):
        raise ValueError(
            "scenario.name must be a text without / and control characters, since files are named "
            f"after it; got {shown(values['name'])}"
        )
    scenario: Scenario = _section(Scenario, values, "scenario")
    if not 1 <= scenario.scans <= MAX_SCANS:
        raise ValueError(f"scenario.scans must be from 1 to {MAX_SCANS}; got {scenario.scans}")
    if not 0 <= scenario.warm_up <= MAX_SCANS:
        raise ValueError(f"scenario.warm_up must be from 0 to {MAX_SCANS}; got {scenario.warm_up}")
    if scenario.period <= 0 or scenario.sound_speed < 0:
        raise ValueError("scenario.period must be above 0 and scenario.sound_speed at least 0")
    return dataclasses.replace(
        scenario,
        sensor=sensor,
        own_ship=own_ship,
        targets=tuple(targets),
        areas=tuple(areas),
        target_features=tuple(features),
        target_strengths=tuple(strengths),
    )


def _mapping(content: Any, where: str) -> dict[str, Any]:
    if not isinstance(content, dict):
        raise ValueError(f"{where} must be a mapping of keys to values; got {shown(content)}")
    return content


def _entries(content: Any, where: str, of: str = "") -> list[tuple[str, Any]]:
    """The entries of a list, each with its name."""
    if not isinstance(content, list):
        raise ValueError(f"{where} must be a list{of}; got {shown(content)}")
    return [(f"{where}[{index}]", entry) for index, entry in enumerate(content)]


def _known(content: dict[str, Any], known: list[str], where: str) -> None:
    unknown = sorted(str(key) for key in content if key not in known)
    if unknown:
        raise ValueError(f"{where}: unknown key {unknown[0]!r}; known are {', '.join(known)}")


def _section(kind: type[Any], content: Any, where: str) -> Any:
    """Make a dataclass from a mapping, its plain fields checked for their types."""
    content = dict(_mapping(content, where))
    fields = {field.name: field.type for field in dataclasses.fields(kind)}
    _known(content, list(fields), where)
    for key, value in content.items():
        if fields[key] in ("int", "float"):
            content[key] = _number(value, str(fields[key]), f"{where}.{key}")
    try:
        return kind(**content)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{where}: {error}") from None


def _number(value: Any, kind: str, where: str) -> float | int:
    if isinstance(value, int) and not isinstance(value, bool) and abs(value) < 1e300:
        return value if kind == "int" else float(value)
    if kind == "float" and isinstance(value, float) and math.isfinite(value):
        return value
    expected = "a finite number (YAML needs the point: 1.0e-6)" if kind == "float" else "an integer"
    raise ValueError(f"{where} must be {expected}; got {shown(value)}")


def _own_ship(values: dict[str, Any]) -> Motion:
    """A platform, along waypoints if they are given."""
    if "waypoints" in values:
        points = _entries(values["waypoints"], "own_ship.waypoints", " of waypoints [x, y]")
        values["waypoints"] = tuple(
            tuple(_numbers(point, 2, where).tolist()) for where, point in points
        )
    kind = WaypointMotion if "waypoints" in values else OwnShipMotion
    motion: Motion = _section(kind, values, "own_ship")
    return motion


def _area(entry: dict[str, Any], where: str) -> TargetArea:
    values = {"count": 1, **entry}
    for key in ("ranges", "azimuths"):
        values[key] = _intervals(entry.get(key), 1, f"{where}.{key}")
    values["features"] = _features(entry.get("features", {}), f"{where}.features")
    values["strength"] = _strength(entry.get("strength"), where)
    area: TargetArea = _section(TargetArea, values, where)
    if area.count < 0 or area.ranges[0] < 0:
        raise ValueError(f"{where}: count and ranges must be at least 0")
    return area


def _clutter_strength(values: dict[str, Any], of_targets: bool) -> ClutterStrength | None:
    """Law of the strength of clutter, if it is given."""
    if values.get("clutter_strength") is not None:
        strength: ClutterStrength = _section(
            ClutterStrength, values["clutter_strength"], "clutter_strength"
        )
        return strength
    if of_targets:
        raise ValueError("targets have a strength: clutter_strength must be given too")
    return None


def _strength(content: Any, where: str) -> TargetStrength | None:
    """Strength of a target's echoes, if it is given."""
    if content is None:
        return None
    strength: TargetStrength = _section(TargetStrength, content, f"{where}.strength")
    return strength


def _features(content: Any, where: str) -> dict[str, tuple[float, float]]:
    """Mean and standard deviation of each feature."""
    content = _radians(content, where)
    _known(content, list(NAMES), where)
    features = {}
    for name, value in content.items():
        mean, deviation = _numbers(value, 2, f"{where}.{name}").tolist()
        if deviation < 0.0:
            raise ValueError(f"{where}.{name}: standard deviation must be at least 0")
        features[name] = (mean, deviation)
    return features


def _patches(entries: Any) -> tuple[ClutterPatch, ...]:
    patches = []
    for where, entry in _entries(entries, "clutter_patches"):
        box = _intervals(_mapping(entry, where).get("box"), 2, f"{where}.box")
        patch: ClutterPatch = _section(ClutterPatch, {**entry, "box": box}, where)
        if patch.density < 0.0:
            raise ValueError(f"{where}.density must be at least 0; got {shown(patch.density)}")
        patches.append(patch)
    return tuple(patches)


def _radians(content: Any, where: str) -> dict[str, Any]:
    """Convert the values whose key ends in `_deg`."""
    converted = dict(_mapping(content, where))
    for key in [key for key in converted if isinstance(key, str) and key.endswith("_deg")]:
        value = converted.pop(key)
        try:
            converted[key.removesuffix("_deg")] = np.deg2rad(np.asarray(value, float)).tolist()
        except (TypeError, ValueError):
            raise ValueError(f"{where}.{key} must be in degrees; got {shown(value)}") from None
    return converted


def _intervals(value: Any, count: int, where: str) -> tuple[float, ...]:
    """Bounds of intervals, low and high of each."""
    numbers = _numbers(value, 2 * count, where).tolist()
    if any(low > high for low, high in zip(numbers[::2], numbers[1::2], strict=True)):
        raise ValueError(f"{where} must go from low to high; got {shown(value)}")
    return tuple(numbers)


def _numbers(value: Any, count: int, where: str) -> FloatArray:
    try:
        array = np.array(value, float)
    except (TypeError, ValueError, OverflowError):
        array = np.zeros(0)
    if array.shape != (count,) or not np.isfinite(array).all():
        raise ValueError(f"{where} must be a list of {count} finite numbers; got {shown(value)}")
    return array
