"""Scenes of `endings.py`: a quay with a swimmer, and boats that sail together, cross or glint."""

from __future__ import annotations

import math

import numpy as np
from clear_mot import ClearMot
from endings_scenes import Watched, pinged, polar, unit

from tsepm_ros import SensorModel, make_initiator
from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.settings.settings import TRACK_INITIATOR, make_groups, settings_from
from tsepm_ros.tools.commands.init_command import completed, parameters

PINGS, INTERVAL = 600, 0.2
"""Of the quay: two minutes at 5 Hz."""
EXTENT = 1.5
ANSWERS = dict(
    max_range=60.0, sector=130.0, bearing_accuracy=0.5, range_error=0.5, max_speed=2.5,
    extent=EXTENT,
)  # fmt: skip
"""Answers to `tsepm init`; the others are its defaults."""
RADAR = SensorModel(range_std=8.0, range_std_fraction=0.0, max_range=600.0)
REVOLUTION, SCANS = 1.7, 80
"""Of the boats' radar, as that of `identity.py scenes`: s, scans."""
GLINT = 10
"""Scans from glint to glint."""


def quay(seed: int) -> dict[str, float]:
    """Reflectors 25 m to port, a weaving vessel at 1 m/s, and a swimmer of several echoes ahead."""
    rng = np.random.default_rng([seed, 37])
    values = parameters(completed(ANSWERS)) | {"min_speed": 0.3}
    seen = Watched(settings_from(make_groups(TRACK_INITIATOR, values)).make_initiator(), EXTENT)
    sensor = seen.initiator.sensor
    posts = np.stack([4.0 * np.arange(-15.0, 65.0) + rng.uniform(0.0, 4.0), np.full(80, 25.0)], 1)
    start, along = np.array([45.0, rng.uniform(-10.0, 5.0)]), unit(rng.uniform(-0.1, 0.1))
    own, weave = np.zeros(2), rng.uniform(0.0, 2.0 * math.pi)
    for stamp in INTERVAL * np.arange(PINGS):
        yaw = 0.25 * math.sin(2.0 * math.pi * stamp / 20.0 + weave)
        own = own + INTERVAL * unit(yaw)
        swimmer = start + 0.7 * stamp * along
        echoes = int(rng.integers(2, 5)) if rng.random() < 0.9 else 0
        offsets = 0.5 * (np.arange(echoes) - 0.5 * (echoes - 1))[:, None]
        shown = np.concatenate([posts[rng.random(len(posts)) < 0.6], swimmer + offsets * along])
        range_, azimuth = polar(swimmer - own)
        scan = pinged(float(stamp), shown, 15.0, sensor, rng, pose=(*own, yaw))
        seen.take(scan, swimmer if sensor.covers(range_, azimuth - yaw) else None)
    on = set().union(*seen.near)
    in_sight = [bool(ids) for ids, there in zip(seen.near, seen.there, strict=True) if there]
    return seen.of_tracks() | {"on swimmer": len(on), "held": float(np.mean(in_sight))}


def boats(scene: str, rng: np.random.Generator) -> FloatArray:
    """Paths (boats, scans, 2) about a place 220 m ahead: together, crossing, or one alone."""
    turn, side = np.zeros((2, SCANS)), rng.choice([-1.0, 1.0])
    speed = rng.uniform(3.0, 6.0) * np.ones((2, 1))
    if scene == "together":  # 12 m apart, and from the middle on apart
        turn[0, SCANS // 2 :] = -0.35 * side
    elif scene == "crossing":  # at 9 m
        turn[1] = side * rng.uniform(0.5, 2.5)
        speed[1] *= 0.8
    course = rng.uniform(-math.pi, math.pi) + turn
    velocity = speed[..., None] * np.stack([np.cos(course), np.sin(course)], axis=-1)
    paths = REVOLUTION * np.cumsum(velocity, axis=1)
    paths -= paths[:, SCANS // 2 - 1, None]
    relative = velocity[0, 0] - (velocity[1, 0] if scene == "crossing" else 0.0)
    across = side * np.array([-relative[1], relative[0]]) / np.hypot(*relative)
    paths[1] += (9.0 if scene == "crossing" else 12.0) * across
    return paths[: 1 if scene == "glint" else 2] + np.array([220.0, 0.0])


def sailed(job: tuple[str, int]) -> tuple[int, int]:
    """Identity switches of the boats, and tracks of boats that ended while these sailed on.

    A glint, every ten scans, moves the echo of the one boat by three errors in range.
    """
    scene, seed = job
    rng = np.random.default_rng([seed, 38])
    paths = boats(scene, rng)
    made = make_initiator("score", sensor=RADAR, max_speed=15.0)
    clear = ClearMot(3.0 * RADAR.range_std)
    for index in range(SCANS):
        echoes = paths[:, index][rng.random(len(paths)) < 0.9]
        if scene == "glint" and index % GLINT == GLINT - 1:
            echoes = echoes * (
                1.0 + clear.gate * rng.choice([-1.0, 1.0]) / polar(echoes)[0][:, None]
            )
        made.process(pinged(REVOLUTION * index, echoes, 5.6, RADAR, rng))
        truth = {k: np.array([x, 0.0, y, 0.0]) for k, (x, y) in enumerate(paths[:, index])}
        clear.take(truth, made.current)
    of_boats = {
        track
        for tracks in clear.matches.values()
        for track in tracks
        if track is not None and tracks.count(track) >= 10
    }
    return clear.switches, len(of_boats - set(made.current.track_id.tolist()))
