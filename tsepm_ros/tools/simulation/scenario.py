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
"""Scenarios: sonar, clutter, targets with the strengths of their echoes, and platform.

Strengths are powers; clutter's have the mean 1. The echo of a target of the mean power r (its
signal-to-clutter ratio) interferes with the clutter C in its cell::

    |sqrt(P) + sqrt(C) exp(i phi)|^2

In Rayleigh clutter a Swerling I target is exponential of mean 1 + r, a steady one Rician.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import MISSING, dataclass, field, fields, replace
from functools import cached_property, partial
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import gammaincinv, ndtr

from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.own_ship.registration import Mounting
from tsepm_ros.parameters import shown_parameter
from tsepm_ros.settings import parameter_files
from tsepm_ros.settings.settings import TRACK_INITIATOR, settings_sensors
from tsepm_ros.tracker.scan import ECHO_FEATURES
from tsepm_ros.tracker.sensor import SensorModel
from tsepm_ros.whole_files import read_whole_text

LAWS = ("rayleigh", "k", "log_normal")
FLUCTUATIONS = ("swerling_1", "swerling_3", "steady")
WAVES = 256
"""Waves of which a texture is the sum."""
PLACEMENT_TRIES = 10_000
MAX_SCANS, LEAST_SCANS = 10_000_000, {"scans": 1, "warm_up": 0}
FILE_NAME = re.compile(r"[^/\\\x00-\x1f]{1,100}")
"""Names of scenarios: a part of the names of files."""
TARGET = {"state": "", "features": "", "strength": ""}
"""Keys of a target whose state is given."""
OF_TARGETS = ("areas", "target_features", "target_strengths")
"""Fields of a scenario that are given by its targets."""
OF_PICTURE = ("name", "scans", "warm_up", "targets", "own_ship", "sensors")
"""Keys of a scenario that several sensors have in common."""
MAY_BE_NULL = ("strength", "clutter_strength")


@dataclass(frozen=True)
class ScenarioOwnShipMotion:
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
            displacement = self.speed * time * np.array([math.cos(self.yaw), math.sin(self.yaw)])
        else:
            radius = self.speed / self.turn_rate
            displacement = radius * np.array(
                [math.sin(yaw) - math.sin(self.yaw), math.cos(self.yaw) - math.cos(yaw)]
            )
        return np.array([self.x + displacement[0], self.y + displacement[1], yaw])

    def rates(self, time: float) -> FloatArray:
        """Velocity (vx, vy), m/s, and yaw rate, rad/s, at a time after the start, s."""
        yaw = self.yaw + self.turn_rate * time
        return np.array([self.speed * math.cos(yaw), self.speed * math.sin(yaw), self.turn_rate])


@dataclass(frozen=True)
class ScenarioWaypointMotion:
    """A platform that moves from waypoint to waypoint at constant speed.

    It starts at the first waypoint and cuts every corner on the arc of its turn.

    Attributes
    ----------
    waypoints : tuple of (float, float)
        x, y of at least two waypoints, m.
    speed : float
        m/s; 0: it stays at the first waypoint, with the heading to the second.
    turn_rate : float
        Rate of the turns, to either side, rad/s.
    closed : bool
        After the last waypoint it returns to the first and repeats the course; else it continues
        straight.

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
        """Velocity (vx, vy), m/s, and yaw rate, rad/s, at a time after the start, s."""
        leg, since = self._at(time)
        return leg.rates(since)

    def _at(self, time: float) -> tuple[ScenarioOwnShipMotion, float]:
        """The current leg at a time, and the time since its beginning, s."""
        legs, durations = self._legs
        ends = np.cumsum(durations)
        if self.closed and time > ends[-1]:
            time = ends[0] + (time - ends[0]) % (ends[-1] - ends[0])
        index = min(int(np.searchsorted(ends, time)), len(legs) - 1)
        return legs[index], time - float(ends[index - 1] if index else 0.0)

    @property
    def _course(self) -> FloatArray:
        """The corners of the course, (n, 2); a closed course ends with the first straight again.

        The part after the first straight then repeats.
        """
        first_straight = self.waypoints[:2] if self.closed else ()
        return np.array([*self.waypoints, *first_straight], float)

    @cached_property
    def _legs(self) -> tuple[list[ScenarioOwnShipMotion], FloatArray]:
        """Motion and duration (s) of each straight and each arc."""
        course = self._course
        straights = np.diff(course, axis=0)
        lengths, yaws = np.hypot(*straights.T), np.arctan2(straights[:, 1], straights[:, 0])
        turns = np.remainder(np.diff(yaws) + math.pi, 2 * math.pi) - math.pi
        # Distance from the corner at which the arc touches each straight, at its end and begin.
        radius = self.speed / self.turn_rate
        last_turn = turns[:1] if self.closed else np.zeros(1)
        at_end = radius * np.tan(np.abs(np.append(turns, last_turn)) / 2)
        at_begin = np.append(0.0, at_end[:-1])
        legs, durations = [], []
        for k, yaw in enumerate(yaws.tolist()):
            x, y = course[k] + straights[k] * at_begin[k] / lengths[k]
            length = float(lengths[k] - at_begin[k] - at_end[k])
            legs.append(ScenarioOwnShipMotion(float(x), float(y), yaw, self.speed))
            durations.append(length / self.speed if self.speed else math.inf)
            if k < len(turns):
                x, y = course[k + 1] - straights[k] * at_end[k] / lengths[k]
                rate = math.copysign(self.turn_rate, turns[k])
                legs.append(ScenarioOwnShipMotion(float(x), float(y), yaw, self.speed, rate))
                durations.append(abs(float(turns[k])) / self.turn_rate)
        return legs, np.array(durations)


Motion = ScenarioOwnShipMotion | ScenarioWaypointMotion


@dataclass(frozen=True)
class TargetStrength:
    """Strength of a target's echoes.

    Attributes
    ----------
    ratio_db : float
        Mean signal-to-clutter ratio, dB.
    fluctuation : str
        From ping to ping: swerling_1 (exponential), swerling_3 (chi-square of four degrees of
        freedom) or steady.
    """

    ratio_db: float
    fluctuation: str = "swerling_1"

    def __post_init__(self) -> None:
        if not -100.0 <= self.ratio_db <= 100.0:
            raise ValueError(f"ratio_db must be from -100 to 100; got {self.ratio_db!r}")
        if self.fluctuation not in FLUCTUATIONS:
            raise ValueError(
                f"fluctuation must be one of {', '.join(FLUCTUATIONS)}; got {self.fluctuation!r}"
            )


@dataclass(frozen=True)
class ClutterStrength:
    """Law of the strength of clutter.

    Attributes
    ----------
    law : str
        rayleigh (exponential power), k or log_normal.
    shape : float
        Shape of the gamma texture of k; standard deviation of ln(strength) of log_normal.
    texture_length, texture_time : float
        Distance (m) and time (s) over which the texture of k, or the strength of log_normal, is
        common to detections; 0 m: each has its own. The correlation falls with the distance d and
        the time t by ``exp(-(d / length)^2 / 2 - t / time)``.
    """

    law: str = "rayleigh"
    shape: float = 1.0
    texture_length: float = 0.0
    texture_time: float = 600.0

    def __post_init__(self) -> None:
        if self.law not in LAWS:
            raise ValueError(f"law must be one of {', '.join(LAWS)}; got {self.law!r}")
        if not 0.01 <= self.shape <= 100.0:
            raise ValueError(f"shape must be from 0.01 to 100; got {self.shape!r}")
        if not 0.0 <= self.texture_length <= 1e6 or not 0.0 < self.texture_time <= 1e9:
            raise ValueError(
                "texture_length must be from 0 to 1e6 m and texture_time above 0 s, to 1e9; got "
                f"{self.texture_length!r} and {self.texture_time!r}"
            )


class ScenarioStrengths:
    """Draws the strengths of a run.

    Parameters
    ----------
    clutter : ClutterStrength
    targets : sequence of TargetStrength or None
        Of each target; without it a target's strength is not measured.
    rng : numpy.random.Generator
    """

    def __init__(
        self,
        clutter: ClutterStrength,
        targets: list[TargetStrength | None],
        rng: np.random.Generator,
    ) -> None:
        self._clutter = clutter
        self._targets = targets
        self._rng = rng
        # A sum of many waves is a Gaussian field; its spectrum gives the correlation.
        length = clutter.texture_length or 1.0
        self._wave_numbers = rng.standard_normal((WAVES, 2)) / length
        self._rates = rng.standard_cauchy(WAVES) / clutter.texture_time
        self._phases = rng.uniform(0.0, 2.0 * math.pi, WAVES)

    def draw(self, position: FloatArray, origin: np.ndarray, time: float) -> FloatArray:
        """Strengths of a scan's detections, (n,); nan of targets without a strength.

        Parameters
        ----------
        position : (n, 2) ndarray
            In the fixed frame, m.
        origin : (n,) ndarray of int
            Target of each; negative for clutter.
        time : float
            After the start, s.
        """
        strength = self._clutter_strength(position, time)
        n = len(strength)
        exponential = self._rng.exponential(size=(2, n))
        phase = self._rng.uniform(0.0, 2.0 * math.pi, n)
        for row in np.flatnonzero(origin >= 0):
            target = self._targets[origin[row]]
            if target is None:
                strength[row] = math.nan
                continue
            power = 10.0 ** (target.ratio_db / 10.0)
            if target.fluctuation == "swerling_1":
                power *= exponential[0, row]
            elif target.fluctuation == "swerling_3":
                power *= 0.5 * exponential[:, row].sum()
            cross = 2.0 * math.sqrt(power * strength[row]) * math.cos(phase[row])
            strength[row] += power + cross
        return strength

    def _clutter_strength(self, position: FloatArray, time: float) -> FloatArray:
        """Strength of clutter at positions (n, 2), of mean 1, (n,)."""
        clutter, n = self._clutter, len(position)
        speckle = self._rng.exponential(size=n)
        normal = self._rng.standard_normal(n)
        if clutter.texture_length:
            normal = self._field(position, time)
        if clutter.law == "k":
            share = np.clip(ndtr(normal), 1e-300, 1.0 - 1e-16)
            return np.asarray(speckle * gammaincinv(clutter.shape, share) / clutter.shape)
        if clutter.law == "log_normal":
            return np.asarray(np.exp(clutter.shape * normal - 0.5 * clutter.shape**2))
        return speckle

    def _field(self, position: FloatArray, time: float) -> FloatArray:
        """The standard Gaussian field at positions (n, 2) and a time, (n,)."""
        phase = position @ self._wave_numbers.T + self._rates * time + self._phases
        return np.asarray(math.sqrt(2.0 / WAVES) * np.cos(phase).sum(axis=1))


Features = Mapping[str, tuple[float, float]]
"""Mean and standard deviation of detections' features, by name."""


@dataclass(frozen=True)
class ClutterPatch:
    """A patch of additional clutter.

    Attributes
    ----------
    box : (4,) tuple of float
        x from, x to, y from, y to, m.
    density : float
        False detections per scan and m^2, in addition to the sensor's clutter density.
    """

    box: tuple[float, float, float, float]
    density: float

    def __post_init__(self) -> None:
        if self.density < 0.0:
            raise ValueError(f"density must be at least 0; got {self.density!r}")


@dataclass(frozen=True)
class ScenarioTargetArea:
    """Random targets in an area, with a given speed.

    Initial positions are uniform in area, headings uniform. Each target is drawn again until it
    stays within `ranges` for the whole run.

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
        Features of their detections.
    strength : TargetStrength, optional
        Of their echoes, where the clutter has a strength.
    """

    count: int
    ranges: tuple[float, float]
    azimuths: tuple[float, float]
    speed: float
    features: Features = field(default_factory=dict)
    strength: TargetStrength | None = None

    def __post_init__(self) -> None:
        if self.count < 0 or self.ranges[0] < 0:
            raise ValueError("count and ranges must be at least 0")

    def draw(self, rng: np.random.Generator, duration: float) -> list[FloatArray]:
        """Draw the targets' states at time 0, (4,) each.

        Raises
        ------
        ValueError
            If no drawn target stays within the ranges.
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
        raise ValueError(f"targets: no target stays within {self.ranges} m for {duration} s")

    def _stays(self, position: FloatArray, velocity: FloatArray, duration: float) -> bool:
        closest_time = 0.0
        if velocity.any():
            closest_time = float(
                np.clip(-position @ velocity / (velocity @ velocity), 0.0, duration)
            )
        distances = [np.linalg.norm(position + velocity * t) for t in (0.0, closest_time, duration)]
        return bool(min(distances) >= self.ranges[0] and max(distances) <= self.ranges[1])


@dataclass(frozen=True)
class Scenario:
    """A scene to simulate.

    Attributes
    ----------
    name : str
    scans : int
        Number of scans, from the first in which the targets are there; of all sensors.
    period : float
        Time between scans, s; scan k is sent at ``k * period``. Of several sensors the mean.
    sensor : SensorModel
        The true sensor, with the simulated clutter density and detection probability; of several
        the first.
    sound_speed : float
        m/s; 0: echoes arrive at once.
    targets : tuple of (4,) ndarray
        States ``[x, vx, y, vy]`` when they appear: at time 0, or after the warm-up.
    areas : tuple of ScenarioTargetArea
        Random targets, drawn for every run.
    own_ship : ScenarioOwnShipMotion or ScenarioWaypointMotion
    clutter_box : (4,) tuple of float, optional
        x from, x to, y from, y to (m) of the clutter, instead of the sensor's whole coverage.
    clutter_patches : tuple of ClutterPatch
        Additional clutter inside the coverage.
    target_features : tuple of mapping
        Features of the detections of each of `targets`; Gaussian, widths at least 0.
    clutter_features : mapping
        Features of false detections, likewise.
    clutter_strength : ClutterStrength, optional
        Law of the strength of clutter, which detections then carry as `intensity`.
    target_strengths : tuple of TargetStrength or None
        Strength of the echoes of each of `targets`; None: not measured.
    warm_up : int
        Number of scans of clutter alone before the others: from a cold start the first scans hold
        fewer false tracks than later ones.
    mounting : Mounting
        Of the sensor on the platform, without roll.
    sensors : mapping of str to Scenario
        The scene of each of several sensors by its name.
    """

    name: str
    scans: int = 16
    period: float = 12.0
    sensor: SensorModel = field(default_factory=SensorModel)
    sound_speed: float = 0.0
    targets: tuple[FloatArray, ...] = ()
    areas: tuple[ScenarioTargetArea, ...] = ()
    own_ship: Motion = field(default_factory=ScenarioOwnShipMotion)
    clutter_box: tuple[float, float, float, float] | None = None
    clutter_patches: tuple[ClutterPatch, ...] = ()
    target_features: tuple[Features, ...] = ()
    clutter_features: Features = field(default_factory=dict)
    clutter_strength: ClutterStrength | None = None
    target_strengths: tuple[TargetStrength | None, ...] = ()
    warm_up: int = 0
    mounting: Mounting = field(default_factory=Mounting)
    sensors: Mapping[str, Scenario] = field(default_factory=dict)

    @property
    def of_each(self) -> Mapping[str, Scenario]:
        """The scene of each sensor by its name; of a single sensor the name is empty."""
        return self.sensors or {"": self}

    def sensor_pose(self, time: float) -> FloatArray:
        """Pose (x, y, yaw) of the sensor at a time after the start, s."""
        vessel = self.own_ship.pose(time)
        return self.mounting.sensor_poses(np.array([[*vessel, 0.0, 0.0]]))[0]

    def sensor_velocity(self, time: float) -> FloatArray:
        """Velocity (vx, vy) of the sensor at a time after the start, m/s."""
        vx, vy, turn_rate = self.own_ship.rates(time)
        x, y = (self.sensor_pose(time) - self.own_ship.pose(time))[:2]
        return np.array([vx - turn_rate * y, vy + turn_rate * x])

    @property
    def total_scans(self) -> int:
        """Number of scans with those of the warm-up."""
        return self.warm_up + self.scans

    @property
    def duration(self) -> float:
        """Time from the first to the last scan, s."""
        return (self.total_scans - 1) * self.period

    @property
    def target_start(self) -> float:
        """Time at which the targets appear, s: that of the first scan after the warm-up."""
        first = next(iter(self.of_each.values()))
        return first.warm_up * first.period

    @property
    def area(self) -> float:
        """Area of the clutter, m^2; of several sensors the mean over the scans."""
        if self.sensors:
            return sum(one.area * one.scans for one in self.sensors.values()) / self.scans
        if self.clutter_box is None:
            return self.sensor.coverage_area
        x_min, x_max, y_min, y_max = self.clutter_box
        return (x_max - x_min) * (y_max - y_min)


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
        text = read_whole_text(Path(name))
    elif name in shipped_scenarios():
        source = resources.files("tsepm_ros.tools.simulation") / "scenarios" / f"{name}.yaml"
        text = source.read_text(encoding="utf-8")
    else:
        known = ", ".join(shipped_scenarios())
        raise ValueError(f"scenario must be a .yaml file or one of {known}; got {name!r}")
    try:
        content = parameter_files.load_parameter_file_text(text)
    except ValueError as error:
        raise ValueError(f"scenario {name!r} is {error}") from None
    return scenario_from(_changed(content, changes or {}, name), name)


def _changed(content: Any, changes: Mapping[str, Any], name: str) -> dict[str, Any]:
    """The content of a file with some values changed."""
    content = dict(_mapping(content, f"scenario {name!r}"))
    for full_name, value in changes.items():
        section, separator, key = full_name.partition(".")
        if separator and key:
            value = _changed(content.get(section, {}), {key: value}, section)
        content[section] = value
    return content


def scenario_from(content: Any, name: str = "scenario") -> Scenario:
    """Make a scenario from the content of a YAML file.

    With `sensors`, a list of names, the values below a name are that sensor's, and the others those
    of each that has none of its own. `scans` and `warm_up` are the first sensor's.

    Raises
    ------
    ValueError
        If a key is unknown or a value is not allowed; the message names it.
    """
    values = {"name": Path(name).stem, **_mapping(content, f"scenario {name!r}")}
    if "sensors" not in values:
        return _of_one_sensor(values)
    names = settings_sensors(TRACK_INITIATOR, {"sensors": values.pop("sensors")})
    if not names or not {*names}.isdisjoint(_kinds(Scenario)):
        raise ValueError(
            f"scenario.sensors must be names, none of them a key such as period; got {[*names]}"
        )
    own = {one: _mapping(values.pop(one, {}), f"scenario.{one}") for one in names}
    found = {one: _of_one_sensor(_with_own(values, given, one), one) for one, given in own.items()}
    first = found[names[0]]
    end, before = first.scans * first.period, first.warm_up * first.period
    for one, part in found.items():
        scans, warm_up = math.ceil(end / part.period - 1e-9), round(before / part.period)
        if not math.isclose(warm_up * part.period, before):
            raise ValueError(
                f"scenario.warm_up of {names[0]} takes {before:g} s, which are no whole scans of "
                f"{one} of {part.period:g} s: give a multiple"
            )
        found[one] = replace(part, scans=scans, warm_up=warm_up)
    total = {key: sum(getattr(part, key) for part in found.values()) for key in LEAST_SCANS}
    picture = replace(first, **total, period=end / total["scans"], sensors=found)
    _check_scans(picture, "scenario")
    return picture


def _with_own(plain: Mapping[str, Any], own: Mapping[str, Any], sensor: str) -> dict[str, Any]:
    """Values of a sensor: its own, else the plain ones, also within a section."""
    values = dict(plain)
    for key, value in own.items():
        if key in OF_PICTURE:
            raise ValueError(
                f"scenario.{sensor}.{key}: {key} is of the picture as a whole; give {key} alone"
            )
        if isinstance(value, dict) and isinstance(plain.get(key), dict):
            value = {**_radians(plain[key], key), **_radians(value, f"{sensor}.{key}")}
        values[key] = value
    return values


def _of_one_sensor(values: dict[str, Any], sensor: str = "") -> Scenario:
    """The scene of a sensor, of several that of a name."""
    values, where = dict(values), f"scenario.{sensor}".rstrip(".")
    targets, areas = [], []
    for place, entry in _entries(values.pop("targets", []), "targets"):
        if "state" in _mapping(entry, place):
            targets.append(_values(entry, place, TARGET))
        else:
            areas.append(_section(ScenarioTargetArea, {"count": 1, **entry}, place))
    strengths = tuple(target.get("strength") for target in targets)
    for key in sorted(set(values) & set(OF_TARGETS)):
        raise ValueError(f"{where}: unknown key {key!r}; {key} are given under targets")
    known = {key: kind for key, kind in _kinds(Scenario).items() if key not in OF_TARGETS}
    scenario = Scenario(
        **_values(values, where, known),
        targets=tuple(target["state"] for target in targets),
        areas=tuple(areas),
        target_features=tuple(target.get("features", {}) for target in targets),
        target_strengths=strengths,
    )
    if not scenario.clutter_strength and any([*strengths, *(area.strength for area in areas)]):
        raise ValueError("targets have a strength: clutter_strength must be given too")
    if not isinstance(scenario.name, str) or not FILE_NAME.fullmatch(scenario.name):
        raise ValueError(
            "scenario.name must be a text without / and control characters, since files are named "
            f"after it; got {shown_parameter(scenario.name)}"
        )
    _check_scans(scenario, where)
    if scenario.period <= 0 or scenario.sound_speed < 0:
        raise ValueError(f"{where}.period must be above 0 and {where}.sound_speed at least 0")
    return scenario


def _check_scans(scenario: Scenario, where: str) -> None:
    for key, least in LEAST_SCANS.items():
        if not least <= getattr(scenario, key) <= MAX_SCANS:
            raise ValueError(
                f"{where}.{key} must be from {least} to {MAX_SCANS}; got {getattr(scenario, key)}"
            )


def _mapping(content: Any, where: str) -> dict[str, Any]:
    if not isinstance(content, dict):
        raise ValueError(
            f"{where} must be a mapping of keys to values; got {shown_parameter(content)}"
        )
    return content


def _entries(content: Any, where: str) -> list[tuple[str, Any]]:
    """The entries of a list, each with its name."""
    if not isinstance(content, list):
        raise ValueError(f"{where} must be a list; got {shown_parameter(content)}")
    return [(f"{where}[{index}]", entry) for index, entry in enumerate(content)]


def _kinds(kind: type[Any]) -> dict[str, str]:
    """Types of a dataclass's fields, as written."""
    return {field.name: str(field.type) for field in fields(kind)}


def _section(kind: type[Any], content: Any, where: str) -> Any:
    """Make a dataclass from a mapping."""
    values = _values(content, where, _kinds(kind))
    for each in fields(kind):
        has_default = each.default_factory is not MISSING
        if each.default is MISSING and not has_default and each.name not in values:
            raise ValueError(f"{where}: {each.name} is missing")
    try:
        return kind(**values)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{where}: {error}") from None


def _values(content: Any, where: str, kinds: Mapping[str, str]) -> dict[str, Any]:
    """Values of a mapping with known keys: numbers checked, others read by `READERS`."""
    values = _radians(content, where)
    unknown = sorted(str(key) for key in values if key not in kinds)
    if unknown:
        raise ValueError(f"{where}: unknown key {unknown[0]!r}; known are {', '.join(kinds)}")
    for key, value in values.items():
        if key in MAY_BE_NULL and value is None:
            continue
        if key in READERS:
            values[key] = READERS[key](value, f"{where}.{key}")
        elif kinds[key] in ("int", "float"):
            values[key] = _number(value, kinds[key], f"{where}.{key}")
    return values


def _number(value: Any, kind: str, where: str) -> float | int:
    if isinstance(value, int) and not isinstance(value, bool) and abs(value) < 1e300:
        return value if kind == "int" else float(value)
    if kind == "float" and isinstance(value, float) and math.isfinite(value):
        return value
    expected = "a finite number (YAML needs the point: 1.0e-6)" if kind == "float" else "an integer"
    raise ValueError(f"{where} must be {expected}; got {shown_parameter(value)}")


def _own_ship(content: Any, where: str) -> Motion:
    """A platform, along waypoints if they are given."""
    kind = (
        ScenarioWaypointMotion if "waypoints" in _mapping(content, where) else ScenarioOwnShipMotion
    )
    motion: Motion = _section(kind, content, where)
    return motion


def _mounting(content: Any, where: str) -> Any:
    """A mounting without roll, which no simulated sensor has."""
    level = _values(content, where, dict.fromkeys(("x", "y", "yaw"), "float"))
    return _section(Mounting, level, where)


def _waypoints(content: Any, where: str) -> tuple[tuple[float, ...], ...]:
    return tuple(
        tuple(_numbers(2, waypoint, entry_name).tolist())
        for entry_name, waypoint in _entries(content, where)
    )


def _features(content: Any, where: str) -> dict[str, tuple[float, float]]:
    """Mean and standard deviation of each feature."""
    values: dict[str, Any] = _values(content, where, dict.fromkeys(ECHO_FEATURES, ""))
    features = {}
    for name, value in values.items():
        mean, deviation = _numbers(2, value, f"{where}.{name}").tolist()
        if deviation < 0.0:
            raise ValueError(f"{where}.{name}: standard deviation must be at least 0")
        features[name] = (mean, deviation)
    return features


def _patches(content: Any, where: str) -> tuple[ClutterPatch, ...]:
    return tuple(
        _section(ClutterPatch, patch, entry_name) for entry_name, patch in _entries(content, where)
    )


def _radians(content: Any, where: str) -> dict[str, Any]:
    """Convert the values whose key ends in `_deg`."""
    converted = dict(_mapping(content, where))
    for key in [key for key in converted if isinstance(key, str) and key.endswith("_deg")]:
        value = converted.pop(key)
        try:
            converted[key.removesuffix("_deg")] = np.deg2rad(np.asarray(value, float)).tolist()
        except (TypeError, ValueError):
            raise ValueError(
                f"{where}.{key} must be in degrees; got {shown_parameter(value)}"
            ) from None
    return converted


def _intervals(count: int, value: Any, where: str) -> tuple[float, ...]:
    """Bounds of intervals, low and high of each."""
    numbers = _numbers(2 * count, value, where).tolist()
    if any(low > high for low, high in zip(numbers[::2], numbers[1::2], strict=True)):
        raise ValueError(f"{where} must go from low to high; got {shown_parameter(value)}")
    return tuple(numbers)


def _numbers(count: int, value: Any, where: str) -> FloatArray:
    try:
        array = np.array(value, float)
    except (TypeError, ValueError, OverflowError):
        array = np.zeros(0)
    if array.shape != (count,) or not np.isfinite(array).all():
        raise ValueError(
            f"{where} must be a list of {count} finite numbers; got {shown_parameter(value)}"
        )
    return array


READERS: dict[str, Callable[[Any, str], Any]] = {
    "sensor": partial(_section, SensorModel),
    "mounting": _mounting,
    "own_ship": _own_ship,
    "waypoints": _waypoints,
    "state": partial(_numbers, 4),
    "ranges": partial(_intervals, 1),
    "azimuths": partial(_intervals, 1),
    "box": partial(_intervals, 2),
    "clutter_box": partial(_intervals, 2),
    "features": _features,
    "clutter_features": _features,
    "strength": partial(_section, TargetStrength),
    "clutter_strength": partial(_section, ClutterStrength),
    "clutter_patches": _patches,
}
"""Readers of values that are no plain numbers, by key."""
