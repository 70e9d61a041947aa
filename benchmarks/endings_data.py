"""Recordings of `endings.py`.

- lidar: a laser scanner indoors and one person who walks in and out of sight: share of the scans in
  sight with exactly one track, from 1 s after each appearance on; tracks, scan by scan, from 2 s
  after the person has gone; ids in an appearance;
- pool: swimmers before a scanning sonar, with and without the seam at pi in the sector: share of
  the labels held, in all and by state, tracks elsewhere a minute (not near a label, nor where more
  than half of the scans echo), the mean over all turns of the data, and the largest difference from
  it over all of these; with a part of the circle turned with the data, the tracks' differences;
- recordings: those in a harbour at 10 false tracks an hour, by published and by all held tracks,
  and tracks of one vessel on a ride. Changes are those of `identity.py`, switches CLEAR-MOT's.
"""

from __future__ import annotations

import argparse
import importlib.util
import math
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import identity
import numpy as np
from endings_scenes import Watched, unit

from tsepm_ros import Scan, SensorModel, make_initiator
from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.tools.commands.run_command import Run, add_recording_arguments, open_run
from tsepm_ros.tools.replay.bag import Bag, find_topics
from tsepm_ros.tools.replay.recording import read_recording

Rows = Iterator[tuple[str, list[tuple[str, float, str]]]]
LIDAR = (
    "sensor.range_std:=0.03 sensor.azimuth_std:=0.006 sensor.max_range:=11.0 "
    "sensor.azimuth_min:=-2.36 sensor.azimuth_max:=2.36 max_speed:=2.5 min_speed:=0.2"
)
NOTED = [(0.0, 12.7), (17.0, 35.0), (38.0, 56.0), (58.0, math.inf)]
"""Appearances of the person as noted with the bag, s after its first stamp."""
JOYRIDE = (
    "bearing_reference:=north max_speed:=15.0 sensor.range_std:=15.0 sensor.range_std_fraction:=0.0"
)
GATE = 40.0  # m, of the vessels
SECTORS = (-math.pi, math.pi), (-3.1415, 3.1415), (1.5, 4.8)
TURNS = 2.0 * math.pi / 12 * np.arange(12)


def opened(path: Path, values: str, stack: ExitStack) -> Run:
    """The run of `tsepm run` with the given parameters."""
    parser = argparse.ArgumentParser()
    add_recording_arguments(parser)
    given = [f"--parameter={value}" for value in values.split()]
    return open_run(parser.parse_args([str(path), *given]), stack)


def appearances(path: Path) -> tuple[float, list[tuple[float, float]]]:
    """First stamp of the bag, and appearances of the person by the returns themselves, s.

    The person walks within 1.2 m of the scanner's axis. A return is not the room's if it is nearer
    than the median of its ray by 0.3 m, no return being the farthest. The person is in sight from
    the first of scans with two such returns to the last, with gaps of at most 2 s.
    """
    with Bag(path) as bag:
        topic = find_topics(bag.topics, {})["detections"]
        scans = [bag.read(message) for message in bag.messages([topic])]
    stamps = np.array([scan.header.stamp.sec + 1e-9 * scan.header.stamp.nanosec for scan in scans])
    range_ = np.array([scan.ranges for scan in scans], float)
    range_[~((range_ > 0.05) & (range_ < 11.0))] = 99.0
    azimuth = scans[0].angle_min + scans[0].angle_increment * np.arange(range_.shape[1])
    ahead = (range_ * np.cos(azimuth) > 0.2) & (np.abs(range_ * np.sin(azimuth)) < 1.2)
    person = ahead & (range_ < np.median(range_, axis=0) - 0.3)
    seen = stamps[person.sum(axis=1) >= 2] - stamps[0]
    parts = np.split(seen, np.flatnonzero(np.diff(seen) > 2.0) + 1)
    return float(stamps[0]), [(float(part[0]), float(part[-1])) for part in parts]


def lidar(data: Path) -> Rows:
    """Rows by the appearances noted, and by those of the returns."""
    path = data / DATA["lidar"][0]
    begin, returned = appearances(path)
    with ExitStack() as stack:
        run = opened(path, LIDAR, stack)
        seen, stamps = Watched(run.session.tracker), []
        for result in run.results:
            seen.take(result.scan, None, result.current)
            stamps.append(result.stamp - begin)
    time, number = np.array(stamps), np.array([len(ids) for ids in seen.published])
    for name, parts in {"appearances as noted": NOTED, "by returns": returned}.items():
        inside = np.any([(time >= first + 1.0) & (time <= last) for first, last in parts], axis=0)
        near = [np.flatnonzero((time >= a) & (time <= b + 2.0)) for a, b in parts]
        after = np.delete(number, np.concatenate(near)).sum()
        ids = max(len(set().union(*(seen.published[k] for k in part))) for part in near)
        tracks = seen.of_tracks()
        yield (
            name,
            [
                ("one track", float((number[inside] == 1).mean()), ">= 0.95"),
                ("tracks after", float(after), "<= 0"),
                ("ids", float(ids), "<= 1"),
                ("axis / limit", tracks["axis / limit"], "<= 1"),
                ("axis / quarter", tracks["axis / quarter"], "<= 1"),
            ],
        )


def pool(data: Path) -> Rows:
    """Rows of the sectors."""
    path = data / DATA["pool"][0] / "trial.py"
    spec: Any = importlib.util.spec_from_file_location("trial", path)
    trial = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(trial)
    pings, last = [], -1.0
    for time, azimuth, image, labels in trial.pool():
        last = max(time, last + 0.5)
        pings.append((last, *trial.crude(azimuth, image), labels))
    whole = [[pool_tracks(pings, sector, turn, 0.0) for turn in TURNS] for sector in SECTORS[:2]]
    part = [pool_tracks(pings, SECTORS[2], turn, turn) for turn in TURNS]
    held = [[pool_figures(pings, tracks) for tracks in row] for row in (*whole, part)]
    mean = float(np.mean([one["held"] for row in held for one in row]))
    apart = [difference(part[0], tracks) for tracks in part[1:]]
    for sector, row in zip(SECTORS, held, strict=True):
        values = [one["held"] for one in row]
        bounds = {"held": ">= 0.66", "elsewhere": "<= 3"}
        yield (
            f"{sector[0]:.5g} to {sector[1]:.5g}",
            [
                *((name, value, bounds.get(name, "")) for name, value in row[0].items()),
                ("mean over turns", float(np.mean(values)), ""),
                ("farthest from mean", float(np.abs(np.array(values) - mean).max()), "<= 0.05"),
            ],
        )
    yield "the last, turned too", [("farthest apart", max(apart), "<= 1e-09")]


def pool_tracks(
    pings: list[Any], sector: tuple[float, float], turn: float, with_sector: float
) -> list[dict[int, FloatArray]]:
    """Places of the published tracks by id, ping by ping, of data turned and turned back."""
    first, end = np.array(sector) + with_sector - (2.0 * math.pi if with_sector > 1.4 else 0.0)
    sensor = SensorModel(
        range_std=0.3, range_std_fraction=0.0, azimuth_std=0.05, min_range=1.0, max_range=20.0,
        azimuth_min=first, azimuth_max=end, detection_probability=0.85,
    )  # fmt: skip
    made = make_initiator("score", sensor=sensor, max_speed=1.5, false_tracks_per_hour=10.0)
    back, found = np.stack([unit(turn), unit(turn + 0.5 * math.pi)]), []
    for time, range_, azimuth, strength, _ in pings:
        made.process(Scan(time, range_, azimuth + turn, features={"intensity": strength}))
        found.append({track.track_id: back @ track.position for track in made.current})
    return found


def pool_figures(pings: list[Any], tracks: list[dict[int, FloatArray]]) -> dict[str, float]:
    """Share of the labels held, in all and by state, and tracks elsewhere a minute."""
    echoes = [np.c_[r * np.cos(a), r * np.sin(a)] for _, r, a, _, _ in pings]
    seen, held, near = Counter[str](), Counter[str](), set()
    for (*_, labels), places in zip(pings, tracks, strict=True):
        for _, state, distance, bearing in labels:
            truth = distance * unit(bearing)
            on = {track for track, place in places.items() if math.dist(place, truth) < 1.2}
            near |= on
            seen.update(["held", state])
            held.update(["held", state] if on else [])
        for track, place in places.items():
            often = [np.hypot(*(points - place).T).min(initial=9.0) < 1.0 for points in echoes]
            near |= {track} if np.mean(often) > 0.5 else set()
    minutes = (pings[-1][0] - pings[0][0]) / 60.0
    elsewhere = len(set().union(*tracks) - near) / minutes
    return {name: held[name] / seen[name] for name in seen} | {"elsewhere": elsewhere}


def difference(one: list[dict[int, FloatArray]], other: list[dict[int, FloatArray]]) -> float:
    """Largest distance between the same tracks; infinite where the ids differ."""
    if any(a.keys() != b.keys() for a, b in zip(one, other, strict=True)):
        return math.inf
    apart = [math.dist(a[i], b[i]) for a, b in zip(one, other, strict=True) for i in a]
    return max(apart, default=0.0)


def recordings(data: Path) -> Rows:
    """Rows of the harbour, with and without `min_speed`, and of the ride."""
    folders = sorted((data / DATA["recordings"][0]).glob("scenario*"))
    for min_speed in (0.5, 0.0):
        settings = identity.settings_of("estimated", min_speed=min_speed)
        found = [identity.watched_recording(folder, settings, GATE)[:2] for folder in folders]
        for name, parts, most in zip(
            ("published", "held"), zip(*found, strict=True), (3, 1), strict=True
        ):
            row = dict(zip(identity.HEADER, identity.row_of("", parts), strict=True))
            bounds = {"delay/s": "<= 4" if min_speed else "<= 3.4", "held": ">= 0.95"}
            bounds |= {"changes": f"<= {most}", "switches": f"<= {most}", "elsewhere": "<= 20"}
            yield (
                f"min_speed {min_speed:g}, {name}",
                [(column, float(row[column]), bound) for column, bound in bounds.items()],
            )
    if not (data / "joyride").is_dir():
        return
    truth = read_recording(data / "joyride")
    watched, ids = identity.Watched(GATE), set()
    with ExitStack() as stack:
        for result in opened(data / "joyride", JOYRIDE, stack).results:
            there = identity.truth_at(truth, result.stamp)
            watched.take(result.stamp, there, result.new, result.current)
            ids |= set(result.current.track_id.tolist())
    on = {track for tracks in watched.ids.values() for track in tracks} - {None}
    yield "ride", [("ids of vessel", float(len(on)), "<= 1"), ("tracks", float(len(ids)), "<= 4")]


DATA: dict[str, tuple[str, Callable[[Path], Rows]]] = {
    "lidar": ("lidar/walking_person", lidar),
    "pool": ("aquascan", pool),
    "recordings": ("autoferry", recordings),
}
"""Folder and rows of each."""
