"""Scenes of `endings.py`: one target that vanishes, leaves, stays, is silent or passes a shadow.

The coverage is 100 m and 130 degrees below 4 s a ping, 9 km all round from there on; the errors are
0.5 % and 0.5 degree, and 1.5 % and 1 degree. The density and P_D are learned. The target moves at a
tenth of `max_speed`, which is 2.5 m/s (a swimmer) and 10 m/s: so it stays in sight for 400 pings.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from tsepm_ros import Scan, SensorModel, make_initiator
from tsepm_ros.initiation.initiator import Initiator
from tsepm_ros.kinematics.track import TrackArrays
from tsepm_ros.numerics.arrays import BoolArray, FloatArray

SEEN, STAYS, AFTER = 100, 400, 150
"""Pings with a target that then vanishes, with one that stays, and watched after it has gone."""
EVERY, SILENT = 16, 4
"""Pings from silence to silence, and of a silence."""
SHADOW = 10
"""Pings in a sector in which nothing is detected."""
GATE = 5.0
"""A track is on a target within so many errors of a detection there (the larger axis)."""


@dataclass(frozen=True)
class Case:
    """A run: name of its scene, ping interval (s), false detections a ping, P_D and seed."""

    scene: str
    interval: float
    false: float
    probability: float
    seed: int

    @property
    def far(self) -> bool:
        """Whether the coverage is that of slow pings."""
        return self.interval >= 4.0

    @property
    def max_speed(self) -> float:
        """Of targets, m/s."""
        return 10.0 if self.far else 2.5

    @property
    def sensor(self) -> SensorModel:
        """Errors and coverage."""
        if self.far:
            return SensorModel(range_std_fraction=0.015, azimuth_std=math.radians(1.0))
        half = math.radians(65.0)
        return SensorModel(
            range_std_fraction=0.005,
            azimuth_std=math.radians(0.5),
            max_range=100.0,
            azimuth_min=-half,
            azimuth_max=half,
        )


def error_at(sensor: SensorModel, place: FloatArray, extent: float = 0.0) -> FloatArray:
    """The larger axis of a detection's error at places (..., 2) from the sensor, m."""
    range_ = np.hypot(place[..., 0], place[..., 1])
    across = range_ * sensor.azimuth_std
    return np.hypot(np.maximum(np.sqrt(sensor.range_variance(range_)), across), extent / 12**0.5)


@dataclass
class Watched:
    """What is published, ping by ping.

    Attributes
    ----------
    initiator : Initiator
    extent : float
        `target_extent`, m.
    on : list of int or None
        Id of the track on the target: the last one while it is within the gate, else the nearest.
    near : list of set of int
        Ids of all tracks on the target.
    published : list of set of int
        Ids of all tracks.
    there : list of bool
        Whether the target was there.
    worst, widest : float
        Largest axis of a track's position over the limit there, and over `max_range`.
    wide, rows : int
        Tracks over a limit, and all, ping by ping.
    """

    initiator: Initiator
    extent: float = 0.0
    on: list[int | None] = field(default_factory=list)
    near: list[set[int]] = field(default_factory=list)
    published: list[set[int]] = field(default_factory=list)
    there: list[bool] = field(default_factory=list)
    worst: float = 0.0
    widest: float = 0.0
    wide: int = 0
    rows: int = 0

    def take(
        self, scan: Scan, place: FloatArray | None, current: TrackArrays | None = None
    ) -> None:
        """Take a ping, with the target's place if it is there, or the tracks after it."""
        if current is None:
            self.initiator.process(scan)
            current = self.initiator.current
        sensor = self.initiator.sensor
        from_sensor = current.state[:, 0::2] - np.reshape(scan.sensor_pose, (-1, 3))[:1, :2]
        axis = np.sqrt(np.linalg.eigvalsh(current.covariance[:, 0::2, 0::2])[:, -1])
        limit = np.maximum(GATE * error_at(sensor, from_sensor, self.extent), self.extent)
        self.worst = max([self.worst, *(axis / limit)])
        self.widest = max([self.widest, *(axis / sensor.max_range)])
        self.wide += int(((axis > limit) | (axis > 0.25 * sensor.max_range)).sum())
        self.rows += len(current)
        apart: dict[int, float] = {}
        if place is not None:
            seen = place - np.reshape(scan.sensor_pose, (-1, 3))[0, :2]
            gate = GATE * float(error_at(sensor, seen, self.extent))
            away = np.hypot(*(current.state[:, 0::2] - place).T)
            apart = {i: d for i, d in zip(current.track_id.tolist(), away, strict=True) if d < gate}
        last = self.last
        nearest = min(apart, key=lambda track: apart[track], default=None)
        self.there.append(place is not None)
        self.on.append(last if last in apart else nearest)
        self.near.append(set(apart))
        self.published.append(set(current.track_id.tolist()))

    @property
    def last(self) -> int | None:
        """Id of the track that was last on the target."""
        return next((track for track in reversed(self.on) if track is not None), None)

    def ids(self, first: int = 0) -> list[int]:
        """Ids of the tracks on the target since a ping, as they followed each other."""
        held = [track for track in self.on[first:] if track is not None]
        return [track for k, track in enumerate(held) if k == 0 or track != held[k - 1]]

    def pings_until_out(self, last: int) -> float:
        """Pings after a target's last one until none of its tracks is published; nan: no track."""
        ids = self.near[last]
        if not ids:
            return math.nan
        return max(k for k, those in enumerate(self.published) if those & ids) + 1 - last


def straight(case: Case, rng: np.random.Generator, pings: int) -> FloatArray:
    """A path (pings, 2) that lies within the coverage, m."""
    sensor, step = case.sensor, 0.1 * case.max_speed * case.interval
    while True:
        radius, bearing, course = rng.uniform([0.1, -3.2, -3.2], [0.95, 3.2, 3.2])
        start = radius * sensor.max_range * np.array([math.cos(bearing), math.sin(bearing)])
        along = step * np.arange(pings)[:, None]
        path: FloatArray = start + along * np.array([math.cos(course), math.sin(course)])
        range_, azimuth = np.hypot(*path.T), np.arctan2(path[:, 1], path[:, 0])
        margin = -0.05 * sensor.max_range
        clear = range_.min() > 0.1 * sensor.max_range
        if clear and sensor.covers(range_, azimuth, margin, -0.05).all():
            return path


def leaving(case: Case, rng: np.random.Generator) -> FloatArray:
    """A path that leaves the coverage after `SEEN` pings: at its far edge, or its side."""
    sensor, step = case.sensor, 0.1 * case.max_speed * case.interval
    side = 0 if sensor.all_round else case.seed % 2
    edge = rng.choice([sensor.azimuth_min, sensor.azimuth_max])
    bearing = edge if side else rng.uniform(0.7 * sensor.azimuth_min, 0.7 * sensor.azimuth_max)
    outward = bearing + (math.copysign(0.5 * math.pi, edge) if side else 0.0)
    course = outward + rng.uniform(-1.0, 1.0)
    radius = sensor.max_range * (rng.uniform(0.4, 0.8) if side else 1.0)
    along = step * (np.arange(SEEN + AFTER) - SEEN + 0.5)[:, None]
    through = radius * np.array([math.cos(bearing), math.sin(bearing)])
    return through + along * np.array([math.cos(course), math.sin(course)])


def across(case: Case, rng: np.random.Generator, pings: int) -> FloatArray:
    """A path that crosses the bearings, about the middle of the coverage."""
    sensor, step = case.sensor, 0.1 * case.max_speed * case.interval
    radius, bearing = rng.uniform([0.3, -0.5], [0.7, 0.5])
    course = bearing + rng.choice([-0.5, 0.5]) * math.pi + rng.uniform(-0.5, 0.5)
    along = step * (np.arange(pings) - SEEN - 0.5 * SHADOW)[:, None]
    through = radius * sensor.max_range * np.array([math.cos(bearing), math.sin(bearing)])
    return through + along * np.array([math.cos(course), math.sin(course)])


def drawn(
    case: Case,
    rng: np.random.Generator,
    stamp: float,
    place: FloatArray | None,
    dark: Sequence[float] = (),
) -> Scan:
    """A ping: a target with a chance of P_D, false detections; none at bearings from dark[0] on."""
    sensor = case.sensor
    number = rng.poisson(case.false)
    range_ = sensor.max_range * np.sqrt(rng.random(number))
    azimuth = rng.uniform(sensor.azimuth_min, sensor.azimuth_max, number)
    heard = rng.random() < case.probability
    noise = rng.standard_normal(2)
    true = np.zeros(number, bool)
    if place is not None and heard:
        distance = np.hypot(*place)
        shown = distance + noise[0] * math.sqrt(float(sensor.range_variance(distance)))
        range_ = np.append(range_, max(shown, 0.01))
        azimuth = np.append(azimuth, math.atan2(place[1], place[0]) + noise[1] * sensor.azimuth_std)
        true = np.append(true, True)
    kept: BoolArray = sensor.covers(range_, azimuth)
    if len(dark):
        kept &= true | (np.remainder(azimuth - dark[0], 2 * math.pi) > dark[1])
    order = rng.permutation(np.flatnonzero(kept))
    return Scan(stamp, range_[order], azimuth[order])


def watched(case: Case) -> Watched:
    """What becomes of the target of a case."""
    rng = np.random.default_rng([case.seed, int(10 * case.interval), int(case.false)])
    pings = np.arange(STAYS)
    dark: tuple[float, ...] = ()
    match case.scene:
        case "vanish":
            pings = np.arange(SEEN + AFTER)
            path, there = straight(case, rng, len(pings)), pings < SEEN
        case "leave":
            pings = np.arange(SEEN + AFTER)
            path = leaving(case, rng)
            there = case.sensor.covers(np.hypot(*path.T), np.arctan2(path[:, 1], path[:, 0]))
        case "silent":
            path, there = straight(case, rng, STAYS), pings % EVERY < EVERY - SILENT
        case "shadow":
            pings = np.arange(SEEN + SHADOW + 60)
            path = across(case, rng, len(pings))
            there = (pings < SEEN) | (pings >= SEEN + SHADOW)
            azimuth = np.unwrap(np.arctan2(path[:, 1], path[:, 0]))[SEEN - 1 : SEEN + SHADOW + 1]
            ends = 0.5 * (azimuth[:-1] + azimuth[1:])
            dark = float(ends.min()), float(np.ptp(ends))
        case _:
            path, there = straight(case, rng, STAYS), np.ones(STAYS, bool)
    made = make_initiator("score", sensor=case.sensor, max_speed=case.max_speed)
    seen = Watched(made)
    gone = case.scene in ("vanish", "leave")
    for ping, place, shown in zip(pings.tolist(), path, there, strict=True):
        scan = drawn(case, rng, case.interval * ping, place if shown else None, dark)
        seen.take(scan, place if shown or not gone else None)
    return seen
