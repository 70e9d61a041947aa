"""Scenarios: what is simulated, from a YAML file."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.sensing.plot_features import NAMES
from tsepm_ros.sensing.sensor import SensorModel

PLACEMENT_TRIES = 10_000
LARGEST_SCANS = 10_000_000


@dataclass(frozen=True)
class OwnShipMotion:
    """A platform at constant speed and turn rate.

    Attributes
    ----------
    x, y : float
        Position at time 0, m.
    yaw : float
        Heading at time 0, rad, counter-clockwise from east.
    speed : float
        m/s, along the heading.
    turn_rate : float
        rad/s, counter-clockwise.
    """

    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0
    speed: float = 0.0
    turn_rate: float = 0.0

    def pose(self, time: float) -> FloatArray:
        """Pose (x, y, yaw) at a time after the start, s."""
        yaw = self.yaw + self.turn_rate * time
        if abs(self.turn_rate) < 1e-9:
            along = self.speed * time * np.array([math.cos(self.yaw), math.sin(self.yaw)])
        else:
            radius = self.speed / self.turn_rate
            along = radius * np.array(
                [math.sin(yaw) - math.sin(self.yaw), math.cos(self.yaw) - math.cos(yaw)]
            )
        return np.array([self.x + along[0], self.y + along[1], yaw])

    def rates(self, time: float) -> FloatArray:
        """Velocity (vx, vy), m/s, and rate of the yaw, rad/s, at a time after the start, s."""
        yaw = self.yaw + self.turn_rate * time
        return np.array([self.speed * math.cos(yaw), self.speed * math.sin(yaw), self.turn_rate])


@dataclass(frozen=True)
class WaypointMotion:
    """A platform that runs from waypoint to waypoint at constant speed.

    It starts at the first waypoint and cuts every corner on the arc that it turns on.

    Attributes
    ----------
    waypoints : tuple of (float, float)
        x, y of at least two places, m.
    speed : float
        m/s; 0: it stays at the first waypoint and looks at the second.
    turn_rate : float
        Of the turns, either way, rad/s.
    closed : bool
        After the last waypoint it goes to the first again, and so on; else straight on.

    Raises
    ------
    ValueError
        If a turn does not fit between its neighbours.
    """

    waypoints: tuple[tuple[float, float], ...]
    speed: float
    turn_rate: float
    closed: bool = False

    def __post_init__(self) -> None:
        if self.speed < 0 or self.turn_rate <= 0:
            raise ValueError("speed must be at least 0 and turn_rate above 0")
        if not isinstance(self.closed, bool):
            raise ValueError(f"closed must be true or false; got {self.closed!r}")
        if len(self.waypoints) < 2 or not np.diff(self._course, axis=0).any(axis=1).all():
            raise ValueError("waypoints must be at least two, each apart from the one before")
        if (self._legs[1] < 0).any():
            radius = self.speed / self.turn_rate
            raise ValueError(f"waypoints: turns of {radius:.0f} m radius do not fit between them")

    def pose(self, time: float) -> FloatArray:
        """Pose (x, y, yaw) at a time after the start, s."""
        leg, since = self._at(time)
        return leg.pose(since)

    def rates(self, time: float) -> FloatArray:
        """Velocity (vx, vy), m/s, and rate of the yaw, rad/s, at a time after the start, s."""
        leg, since = self._at(time)
        return leg.rates(since)

    def _at(self, time: float) -> tuple[OwnShipMotion, float]:
        """The leg under way at a time, and the time since its beginning, s."""
        legs, durations = self._legs
        ends = np.cumsum(durations)
        if self.closed and time > ends[-1]:
            time = ends[0] + (time - ends[0]) % (ends[-1] - ends[0])
        index = min(int(np.searchsorted(ends, time)), len(legs) - 1)
        return legs[index], time - float(ends[index - 1] if index else 0.0)

    @property
    def _course(self) -> FloatArray:
        """The corners of the way, (n, 2); if closed, the first straight is there again at the end.

        All after the first straight is then what repeats.
        """
        again = self.waypoints[:2] if self.closed else ()
        return np.array([*self.waypoints, *again], float)

    @cached_property
    def _legs(self) -> tuple[list[OwnShipMotion], FloatArray]:
        """Motion and duration (s) of each straight and each arc."""
        course = self._course
        along = np.diff(course, axis=0)
        lengths, yaws = np.hypot(*along.T), np.arctan2(along[:, 1], along[:, 0])
        turns = np.remainder(np.diff(yaws) + math.pi, 2 * math.pi) - math.pi
        # At each straight's end and begin: the arc touches it so far from the corner.
        radius = self.speed / self.turn_rate
        last = turns[:1] if self.closed else np.zeros(1)
        after = radius * np.tan(np.abs(np.append(turns, last)) / 2)
        before = np.append(0.0, after[:-1])
        legs, durations = [], []
        for k, yaw in enumerate(yaws.tolist()):
            x, y = course[k] + along[k] * before[k] / lengths[k]
            straight = float(lengths[k] - before[k] - after[k])
            legs.append(OwnShipMotion(float(x), float(y), yaw, self.speed))
            durations.append(straight / self.speed if self.speed else math.inf)
            if k < len(turns):
                x, y = course[k + 1] - along[k] * after[k] / lengths[k]
                rate = math.copysign(self.turn_rate, turns[k])
                legs.append(OwnShipMotion(float(x), float(y), yaw, self.speed, rate))
                durations.append(abs(float(turns[k])) / self.turn_rate)
        return legs, np.array(durations)


Motion = OwnShipMotion | WaypointMotion


Features = Mapping[str, tuple[float, float]]
"""Mean and standard deviation by the name of a feature of plots."""


@dataclass(frozen=True)
class ClutterPatch:
    """A patch of more clutter.

    Attributes
    ----------
    box : (4,) tuple of float
        x from, x to, y from, y to, m.
    density : float
        False detections per scan and m^2, beside those of the sensor's clutter density.
    """

    box: tuple[float, float, float, float]
    density: float


@dataclass(frozen=True)
class TargetArea:
    """Targets to draw: how many, from where, how fast.

    Each target starts anywhere in the area with equal probability per m^2, with any heading, and is
    drawn again until it stays within `ranges` for the whole run.

    Attributes
    ----------
    count : int
        Number of targets.
    ranges : (float, float)
        Nearest and farthest distance from the origin, m.
    azimuths : (float, float)
        Sector, rad.
    speed : float
        m/s.
    features : mapping, optional
        Of their plots.
    """

    count: int
    ranges: tuple[float, float]
    azimuths: tuple[float, float]
    speed: float
    features: Features = field(default_factory=dict)

    def draw(self, rng: np.random.Generator, duration: float) -> list[FloatArray]:
        """Draw the targets' states at time 0, (4,) each.

        Raises
        ------
        ValueError
            If no target could be found that stays within the ranges.
        """
        return [self._draw_one(rng, duration) for _ in range(self.count)]

    def _draw_one(self, rng: np.random.Generator, duration: float) -> FloatArray:
        near, far = self.ranges
        for _ in range(PLACEMENT_TRIES):
            distance = math.sqrt(rng.uniform(near**2, far**2))
            azimuth = rng.uniform(*self.azimuths)
            heading = rng.uniform(-math.pi, math.pi)
            position = distance * np.array([math.cos(azimuth), math.sin(azimuth)])
            velocity = self.speed * np.array([math.cos(heading), math.sin(heading)])
            if self._stays(position, velocity, duration):
                return np.array([position[0], velocity[0], position[1], velocity[1]])
        raise ValueError(f"targets: none found that stays within {self.ranges} m for {duration} s")

    def _stays(self, position: FloatArray, velocity: FloatArray, duration: float) -> bool:
        closest = 0.0
        if velocity.any():
            closest = float(np.clip(-position @ velocity / (velocity @ velocity), 0.0, duration))
        distances = [np.linalg.norm(position + velocity * t) for t in (0.0, closest, duration)]
        return bool(min(distances) >= self.ranges[0] and max(distances) <= self.ranges[1])


@dataclass(frozen=True)
class Scenario:
    """A scene to simulate.

    Attributes
    ----------
    name : str
    scans : int
        Number of scans.
    period : float
        Time between scans, s; scan k is sent at ``k * period``.
    sensor : SensorModel
        The true sensor; its clutter density and detection probability are what is simulated.
    sound_speed : float
        m/s; 0: echoes arrive at once.
    targets : tuple of (4,) ndarray
        States ``[x, vx, y, vy]`` at time 0.
    areas : tuple of TargetArea
        Targets to draw anew in every run.
    own_ship : OwnShipMotion or WaypointMotion
    clutter_box : (4,) tuple of float, optional
        Clutter fills x from, x to, y from, y to (m) instead of the sensor's whole coverage.
    clutter_patches : tuple of ClutterPatch
        More clutter, as far as the sensor covers it.
    target_features : tuple of mapping
        Features of the plots of each of `targets`; Gaussian, widths at least 0.
    clutter_features : mapping
        Features of false detections, likewise.
    """

    name: str
    scans: int = 16
    period: float = 12.0
    sensor: SensorModel = field(default_factory=SensorModel)
    sound_speed: float = 0.0
    targets: tuple[FloatArray, ...] = ()
    areas: tuple[TargetArea, ...] = ()
    own_ship: Motion = field(default_factory=OwnShipMotion)
    clutter_box: tuple[float, float, float, float] | None = None
    clutter_patches: tuple[ClutterPatch, ...] = ()
    target_features: tuple[Features, ...] = ()
    clutter_features: Features = field(default_factory=dict)

    @property
    def duration(self) -> float:
        """Time from the first to the last scan, s."""
        return (self.scans - 1) * self.period

    @property
    def area(self) -> float:
        """Area that clutter fills, m^2."""
        if self.clutter_box is None:
            return self.sensor.coverage_area
        x_min, x_max, y_min, y_max = self.clutter_box
        return (x_max - x_min) * (y_max - y_min)


def shipped_scenarios() -> list[str]:
    """Names of the scenarios that come with the package."""
    folder = resources.files("tsepm_ros.simulation") / "scenarios"
    return sorted(
        item.name.removesuffix(".yaml") for item in folder.iterdir() if item.name.endswith(".yaml")
    )


def load_scenario(name: str, changes: Mapping[str, Any] | None = None) -> Scenario:
    """Load a scenario by the name of a shipped one, or from a YAML file.

    Parameters
    ----------
    name : str
        A name from `shipped_scenarios` or a path ending in ``.yaml``.
    changes : mapping, optional
        Values to put in place of the file's, by key, such as ``scans`` or ``sensor.azimuth_std``.

    Raises
    ------
    ValueError
        If there is no such scenario, or a value in it is not allowed; the message names it.
    """
    if name.endswith((".yaml", ".yml")):
        try:
            text = Path(name).read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            raise ValueError(f"scenario file cannot be read: {error}") from None
    elif name in shipped_scenarios():
        source = resources.files("tsepm_ros.simulation") / "scenarios" / f"{name}.yaml"
        text = source.read_text(encoding="utf-8")
    else:
        known = ", ".join(shipped_scenarios())
        raise ValueError(f"scenario must be a .yaml file or one of {known}; got {name!r}")
    try:
        content = yaml.safe_load(text)
    except yaml.YAMLError as error:
        problem = " ".join(str(error).split())
        raise ValueError(f"scenario {name!r} is not valid YAML: {problem}") from None
    return scenario_from(_changed(content, changes or {}, name), name)


def _changed(content: Any, changes: Mapping[str, Any], name: str) -> dict[str, Any]:
    """The content of a file with some values changed."""
    content = dict(_mapping(content, f"scenario {name!r}"))
    for full_name, value in changes.items():
        section, separator, key = full_name.partition(".")
        if separator:
            values = _mapping(content.get(section, {}), section)
            content[section] = {**values, key: value}
        else:
            content[full_name] = value
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
    entries = values.pop("targets", [])
    if not isinstance(entries, list):
        raise ValueError(f"targets must be a list; got {entries!r}")
    targets, areas, features = [], [], []
    for index, entry in enumerate(entries):
        where = f"targets[{index}]"
        values_of = _radians(entry, where)
        if "state" in values_of:
            _known(values_of, ["state", "features"], where)
            features.append(_features(values_of.get("features", {}), f"{where}.features"))
            targets.append(_numbers(values_of["state"], 4, f"{where}.state"))
        else:
            areas.append(_area(values_of, where))
    if "clutter_box" in values:
        values["clutter_box"] = _intervals(values["clutter_box"], 2, "clutter_box")
    values["clutter_patches"] = _patches(values.get("clutter_patches", []))
    values["clutter_features"] = _features(values.get("clutter_features", {}), "clutter_features")
    values.setdefault("name", Path(name).stem)
    for key in ("areas", "target_features"):
        if key in values:
            raise ValueError(f"scenario: unknown key {key!r}; {key} are given under targets")
    scenario: Scenario = _section(Scenario, values, "scenario")
    if not 1 <= scenario.scans <= LARGEST_SCANS:
        raise ValueError(f"scenario.scans must be from 1 to {LARGEST_SCANS}; got {scenario.scans}")
    if scenario.period <= 0 or scenario.sound_speed < 0:
        raise ValueError("scenario.period must be above 0 and scenario.sound_speed at least 0")
    return dataclasses.replace(
        scenario,
        sensor=sensor,
        own_ship=own_ship,
        targets=tuple(targets),
        areas=tuple(areas),
        target_features=tuple(features),
    )


def _mapping(content: Any, where: str) -> dict[str, Any]:
    if not isinstance(content, dict):
        raise ValueError(f"{where} must be a mapping of keys to values; got {content!r}")
    return content


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
    raise ValueError(f"{where} must be {expected}; got {value!r}")


def _own_ship(values: dict[str, Any]) -> Motion:
    """A platform; one whose waypoints are given runs along them."""
    if "waypoints" not in values:
        made: Motion = _section(OwnShipMotion, values, "own_ship")
        return made
    points = values["waypoints"]
    if not isinstance(points, list):
        raise ValueError(f"own_ship.waypoints must be a list of places [x, y]; got {points!r}")
    values["waypoints"] = tuple(
        tuple(_numbers(point, 2, f"own_ship.waypoints[{index}]").tolist())
        for index, point in enumerate(points)
    )
    made = _section(WaypointMotion, values, "own_ship")
    return made


def _area(entry: dict[str, Any], where: str) -> TargetArea:
    entry = dict(entry)
    for key in ("ranges", "azimuths"):
        entry[key] = _intervals(entry.get(key), 1, f"{where}.{key}")
    entry["features"] = _features(entry.get("features", {}), f"{where}.features")
    entry.setdefault("count", 1)
    area: TargetArea = _section(TargetArea, entry, where)
    if area.count < 0 or area.ranges[0] < 0:
        raise ValueError(f"{where}: count and ranges must be at least 0")
    return area


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
    if not isinstance(entries, list):
        raise ValueError(f"clutter_patches must be a list; got {entries!r}")
    patches = []
    for index, entry in enumerate(entries):
        where = f"clutter_patches[{index}]"
        entry = dict(_mapping(entry, where))
        entry["box"] = _intervals(entry.get("box"), 2, f"{where}.box")
        patch: ClutterPatch = _section(ClutterPatch, entry, where)
        if patch.density < 0.0:
            raise ValueError(f"{where}.density must be at least 0; got {patch.density!r}")
        patches.append(patch)
    return tuple(patches)


def _radians(content: Any, where: str) -> dict[str, Any]:
    """Convert the values whose key ends in `_deg`."""
    turned = {}
    for key, value in _mapping(content, where).items():
        if isinstance(key, str) and key.endswith("_deg"):
            try:
                turned[key.removesuffix("_deg")] = np.deg2rad(np.asarray(value, float)).tolist()
            except (TypeError, ValueError):
                raise ValueError(f"{where}.{key} must be in degrees; got {value!r}") from None
        else:
            turned[key] = value
    return turned


def _intervals(value: Any, count: int, where: str) -> tuple[float, ...]:
    """Some intervals, from and to each."""
    numbers = _numbers(value, 2 * count, where).tolist()
    if any(low > high for low, high in zip(numbers[::2], numbers[1::2], strict=True)):
        raise ValueError(f"{where} must go from low to high; got {value!r}")
    return tuple(numbers)


def _numbers(value: Any, count: int, where: str) -> FloatArray:
    try:
        array = np.array(value, float)
    except (TypeError, ValueError):
        array = np.zeros(0)
    if array.shape != (count,) or not np.isfinite(array).all():
        raise ValueError(f"{where} must be a list of {count} finite numbers; got {value!r}")
    return array
