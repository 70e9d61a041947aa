"""Motion of a scenario's platform: at constant speed and turn rate, or along waypoints."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tsepm_ros.numerics.arrays import FloatArray


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
class WaypointMotion:
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

    def _at(self, time: float) -> tuple[OwnShipMotion, float]:
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
    def _legs(self) -> tuple[list[OwnShipMotion], FloatArray]:
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
            legs.append(OwnShipMotion(float(x), float(y), yaw, self.speed))
            durations.append(length / self.speed if self.speed else math.inf)
            if k < len(turns):
                x, y = course[k + 1] - straights[k] * at_end[k] / lengths[k]
                rate = math.copysign(self.turn_rate, turns[k])
                legs.append(OwnShipMotion(float(x), float(y), yaw, self.speed, rate))
                durations.append(abs(float(turns[k])) / self.turn_rate)
        return legs, np.array(durations)


Motion = OwnShipMotion | WaypointMotion
