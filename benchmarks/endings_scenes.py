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
from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.tracker.tracker import Tracker
from tsepm_ros.tracker.tracks import TrackArrays

SEEN, STAYS, AFTER = 100, 400, 150
"""Pings with a target that then goes, with one that stays, and watched after it has gone."""
EVERY, SILENT, SHADOW = 16, 4, 10
"""Pings from silence to silence, of a silence, and in a sector in which nothing is detected."""
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
    def max_speed(self) -> float:
        """Of targets, m/s."""
        return 10.0 if self.interval >= 4.0 else 2.5

    @property
    def sensor(self) -> SensorModel:
        """Errors and coverage."""
        if self.interval >= 4.0:
            return SensorModel(range_std_fraction=0.015, azimuth_std=math.radians(1.0))
        half = math.radians(65.0)
        return SensorModel(
            range_std_fraction=0.005,
            azimuth_std=math.radians(0.5),
            max_range=100.0,
            azimuth_min=-half,
            azimuth_max=half,
        )


@dataclass
class Watched:
    """What is published, ping by ping.

    Attributes
    ----------
    initiator : Tracker
    extent : float
        `target_extent`, m.
    on : list of int or None
        Id of the track on the target: the last one while it is within the gate, else the nearest.
    near, published : list of set of int
        Ids of all tracks on the target, and of all tracks.
    there : list of bool
        Whether the target was there.
    axes : list of (n, 2) ndarray
        Larger axis of the tracks' positions over the limit there, and over a quarter of the range.
    """

    initiator: Tracker
    extent: float = 0.0
    on: list[int | None] = field(default_factory=list)
    near: list[set[int]] = field(default_factory=list)
    published: list[set[int]] = field(default_factory=list)
    there: list[bool] = field(default_factory=list)
    axes: list[FloatArray] = field(default_factory=list)

    def take(
        self, scan: Scan, place: FloatArray | None, current: TrackArrays | None = None
    ) -> None:
        """Take a ping, with the target's place if it is there; with the tracks, only these."""
        if current is None:
            self.initiator.process(scan)
            current = self.initiator.current
        own = np.reshape(scan.sensor_pose, (-1, 3))[:1, :2]
        places, ids = current.state[:, 0::2], current.track_id.tolist()
        axis = np.sqrt(np.linalg.eigvalsh(current.covariance[:, 0::2, 0::2])[:, -1])
        limit = np.maximum(self._gate(places - own), self.extent)
        self.axes.append(np.stack([axis / limit, 4.0 * axis / self.initiator.sensor.max_range], 1))
        apart: dict[int, float] = {}
        if place is not None:
            away, gate = np.hypot(*(places - place).T), float(self._gate(place - own)[0])
            apart = {track: d for track, d in zip(ids, away, strict=True) if d < gate}
        last = next((track for track in reversed(self.on) if track is not None), None)
        nearest = min(apart, key=lambda track: apart[track], default=None)
        self.there.append(place is not None)
        self.on.append(last if last in apart else nearest)
        self.near.append(set(apart))
        self.published.append(set(ids))

    def _gate(self, place: FloatArray) -> FloatArray:
        """`GATE` times the error of a detection, its extent included, at (n, 2) from the sensor."""
        range_, sensor = np.hypot(*place.T), self.initiator.sensor
        error = np.maximum(np.sqrt(sensor.range_variance(range_)), range_ * sensor.azimuth_std)
        return GATE * np.hypot(error, self.extent / math.sqrt(12.0))

    def ids(self, first: int = 0) -> list[int]:
        """Ids of the tracks on the target since a ping, as they followed each other."""
        held = [track for track in self.on[first:] if track is not None]
        return [track for k, track in enumerate(held) if k == 0 or track != held[k - 1]]

    def held(self) -> float:
        """Share of the pings with a track on the target, of those with it since the first track."""
        near = [bool(ids) for ids, there in zip(self.near, self.there, strict=True) if there]
        return float(np.mean(near[near.index(True) :])) if True in near else 0.0

    def pings_until_out(self) -> float:
        """Pings after a target's last one until none of its tracks is published; nan: no track.

        Its tracks are those that were on it in its last five pings.
        """
        last = max(k for k, there in enumerate(self.there) if there)
        ids = set().union(*self.near[max(last - 4, 0) : last + 1])
        out = [k + 1 - last for k, those in enumerate(self.published) if those & ids]
        return float(max(*out, 1)) if out else math.nan

    def of_tracks(self) -> dict[str, float]:
        """Figures of all published tracks."""
        elsewhere = set().union(*self.published) - set().union(*self.near)
        axes = np.concatenate(self.axes)
        worst = dict(zip(("axis / limit", "axis / quarter"), axes.max(0, initial=0.0), strict=True))
        wide = float((axes > 1.0).any(axis=1).mean()) if len(axes) else 0.0
        return worst | {"too wide": wide, "elsewhere": len(elsewhere)}


def unit(angle: float) -> FloatArray:
    """The direction (2,) of an angle."""
    return np.array([math.cos(angle), math.sin(angle)])


def path_of(case: Case, rng: np.random.Generator) -> FloatArray:
    """The path of a target (pings, 2), m: within the coverage, or out of it after `SEEN` pings."""
    sensor, step = case.sensor, 0.1 * case.max_speed * case.interval
    far = sensor.max_range
    if case.scene == "leave":  # at the far edge, or at a side
        side = not sensor.all_round and case.seed % 2 == 1
        edge = rng.choice([sensor.azimuth_min, sensor.azimuth_max])
        bearing = edge if side else 0.7 * rng.uniform(sensor.azimuth_min, sensor.azimuth_max)
        outward = bearing + (math.copysign(0.5 * math.pi, edge) if side else 0.0)
        radius, course = rng.uniform(0.4, 0.8) if side else 1.0, outward + rng.uniform(-1.0, 1.0)
        along = np.arange(SEEN + AFTER) - SEEN + 0.5
    elif case.scene == "shadow":  # across the bearings, near the middle of the coverage
        radius, bearing = rng.uniform([0.3, -0.5], [0.7, 0.5])
        course = bearing + rng.choice([-0.5, 0.5]) * math.pi + rng.uniform(-0.5, 0.5)
        along = np.arange(SEEN + SHADOW + 60) - SEEN - 0.5 * SHADOW
    else:
        along = np.arange(STAYS if case.scene != "vanish" else SEEN + AFTER)
    while True:
        if case.scene not in ("leave", "shadow"):
            radius, bearing, course = rng.uniform([0.1, -3.2, -3.2], [0.95, 3.2, 3.2])
        path: FloatArray = radius * far * unit(bearing) + step * along[:, None] * unit(course)
        range_, azimuth = polar(path)
        inside = sensor.covers(range_, azimuth, -0.05 * far, -0.05) & (range_ > 0.1 * far)
        if case.scene in ("leave", "shadow") or inside.all():
            return path


def polar(place: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Range and azimuth of places (..., 2) from the sensor."""
    return np.hypot(place[..., 0], place[..., 1]), np.arctan2(place[..., 1], place[..., 0])


def pinged(
    stamp: float,
    places: FloatArray,
    false: float,
    sensor: SensorModel,
    rng: np.random.Generator,
    *,
    pose: tuple[float, float, float] = (0.0, 0.0, 0.0),
    dark: Sequence[float] = (),
) -> Scan:
    """A ping that detects places (n, 2), with a mean number of false detections.

    No detection is beyond the coverage, no false one at bearings from dark[0] on, dark[1] wide.
    """
    range_, azimuth = polar(places - np.array(pose[:2]))
    noise, number = rng.standard_normal((2, len(range_))), rng.poisson(false)
    range_ = range_ + noise[0] * np.sqrt(sensor.range_variance(range_))
    azimuth = azimuth + noise[1] * sensor.azimuth_std - pose[2]
    wrong = rng.uniform(sensor.azimuth_min, sensor.azimuth_max, number)
    if len(dark):
        wrong = wrong[np.remainder(wrong - dark[0], 2.0 * math.pi) > dark[1]]
    range_ = np.append(range_, sensor.max_range * np.sqrt(rng.random(len(wrong))))
    azimuth = np.append(azimuth, wrong)
    rows = rng.permutation(np.flatnonzero(sensor.covers(range_, azimuth) & (range_ > 0.01)))
    return Scan(stamp, range_[rows], azimuth[rows], sensor_pose=pose)


def watched(case: Case) -> Watched:
    """What becomes of the target of a case."""
    rng = np.random.default_rng([case.seed, int(10 * case.interval), int(case.false)])
    path, dark = path_of(case, rng), ()
    ping = np.arange(len(path))
    range_, azimuth = polar(path)
    match case.scene:
        case "vanish":
            there = ping < SEEN
        case "leave":
            there = case.sensor.covers(range_, azimuth)
        case "silent":
            there = ping % EVERY < EVERY - SILENT
        case "shadow":
            there = (ping < SEEN) | (ping >= SEEN + SHADOW)
            ends = np.unwrap(azimuth)[[SEEN - 1, SEEN, SEEN + SHADOW - 1, SEEN + SHADOW]]
            ends = 0.5 * (ends[0::2] + ends[1::2])
            dark = (float(ends.min()), float(np.ptp(ends)))
        case _:
            there = np.ones(len(path), bool)
    seen = Watched(make_initiator("score", sensor=case.sensor, max_speed=case.max_speed))
    for index, place in enumerate(path):
        heard = place[None][: int(there[index] and rng.random() < case.probability)]
        scan = pinged(case.interval * index, heard, case.false, case.sensor, rng, dark=dark)
        gone = case.scene in ("vanish", "leave") and not there[index]
        seen.take(scan, None if gone else place)
    return seen
