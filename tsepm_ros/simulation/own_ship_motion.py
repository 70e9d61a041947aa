"""How the platform of a scenario moves: at constant speed and turn rate, or along waypoints."""

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
