"""Scenario of a simulation: the sonar, its clutter, the targets and the platform."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.sensing.sensor import SensorModel
from tsepm_ros.simulation.own_ship_motion import Motion, OwnShipMotion
from tsepm_ros.simulation.strengths import ClutterStrength, TargetStrength

PLACEMENT_TRIES = 10_000

Features = Mapping[str, tuple[float, float]]
"""Mean and standard deviation of plots' features, by name."""


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


@dataclass(frozen=True)
class TargetArea:
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
        Features of their plots.
    strength : TargetStrength, optional
        Of their echoes, where the clutter has a strength.
    """

    count: int
    ranges: tuple[float, float]
    azimuths: tuple[float, float]
    speed: float
    features: Features = field(default_factory=dict)
    strength: TargetStrength | None = None

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
        Number of scans, from the first in which the targets are there.
    period : float
        Time between scans, s; scan k is sent at ``k * period``.
    sensor : SensorModel
        The true sensor, with the simulated clutter density and detection probability.
    sound_speed : float
        m/s; 0: echoes arrive at once.
    targets : tuple of (4,) ndarray
        States ``[x, vx, y, vy]`` when they appear: at time 0, or after the warm-up.
    areas : tuple of TargetArea
        Random targets, drawn for every run.
    own_ship : OwnShipMotion or WaypointMotion
    clutter_box : (4,) tuple of float, optional
        x from, x to, y from, y to (m) of the clutter, instead of the sensor's whole coverage.
    clutter_patches : tuple of ClutterPatch
        Additional clutter inside the coverage.
    target_features : tuple of mapping
        Features of the plots of each of `targets`; Gaussian, widths at least 0.
    clutter_features : mapping
        Features of false detections, likewise.
    clutter_strength : ClutterStrength, optional
        Law of the strength of clutter, which detections then carry as `intensity`.
    target_strengths : tuple of TargetStrength or None
        Strength of the echoes of each of `targets`; None: not measured.
    warm_up : int
        Number of scans of clutter alone before the others: from a cold start the first scans hold
        fewer false tracks than later ones.
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
    clutter_strength: ClutterStrength | None = None
    target_strengths: tuple[TargetStrength | None, ...] = ()
    warm_up: int = 0

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
        return self.warm_up * self.period

    @property
    def area(self) -> float:
        """Area of the clutter, m^2."""
        if self.clutter_box is None:
            return self.sensor.coverage_area
        x_min, x_max, y_min, y_max = self.clutter_box
        return (x_max - x_min) * (y_max - y_min)
