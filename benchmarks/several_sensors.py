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
"""Several sensors in one picture: a harbour's radar and lidar, and scenes of its own.

    python benchmarks/several_sensors.py harbour FOLDER [--result FILE]
    python benchmarks/several_sensors.py scenes [--seeds 20]

FOLDER is that of real data, with autoferry/scenarioN (radar) and autoferry/scenarioN/lidar.

The first prints a row for each way to use two sensors, the second a row for each scene. A target is
held while a sure track is within its distance, from its first echo on; elsewhere are tracks that
never came near a target.
"""

from __future__ import annotations

import argparse
import collections
import csv
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from result_tables import printed, write_table

from tsepm_ros import Scan, SensorModel, make_initiator
from tsepm_ros.tools.evaluation.result_files import add_result_file
from tsepm_ros.tools.simulation import Simulator
from tsepm_ros.tools.simulation.scenario import scenario_from
from tsepm_ros.tracker.tracks import TrackArrays

HELD, SEEN, JOINED = 40.0, 25.0, 25.0
"""Distances within which a track holds a target, an echo is a target's, and the tracks of two
trackers are one, m."""
HARBOUR = {
    "radar": SensorModel(
        range_std=8.0,
        range_std_fraction=0.0,
        azimuth_std=math.radians(1.0),
        max_range=600.0,
        detection_probability=0.92,
        clutter_density=5e-6,
    ),
    "lidar": SensorModel(
        range_std=2.5,
        range_std_fraction=0.0,
        azimuth_std=math.radians(1.5),
        max_range=130.0,
        detection_probability=0.9,
        clutter_density=1e-5,
    ),
}
POURED = SensorModel(
    range_std=8.0,
    range_std_fraction=0.0,
    azimuth_std=math.radians(1.5),
    max_range=600.0,
    detection_probability=0.9,
    clutter_density=5e-6,
)
Tracks = dict[int, np.ndarray]


@dataclass
class Figures:
    """Figures of scenes."""

    delays: list[float] = field(default_factory=list)
    shares: list[float] = field(default_factory=list)
    changes: int = 0
    matches: int = 0
    elsewhere: int = 0
    missed: int = 0

    def cells(self) -> list[str]:
        """Delay, share held, changes of id by place and of CLEAR-MOT, tracks elsewhere, missed."""
        delay = np.mean(self.delays) if self.delays else math.nan
        counts = self.changes, self.matches, self.elsewhere, self.missed
        return [f"{delay:.1f} s", f"{np.mean(self.shares):.3f}", *map(str, counts)]


def rows(path: Path) -> list[dict[str, str]]:
    """The rows of a CSV file."""
    with path.open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def harbour_scans(folder: Path, name: str) -> list[tuple[Scan, Tracks]]:
    """Scans of a sensor with the positions of the targets; x east, y north."""
    echoes, truth = collections.defaultdict(list), collections.defaultdict(dict)
    for row in rows(folder / "detections.csv"):
        bearing = 0.5 * math.pi - float(row["bearing_rad"])
        echoes[int(row["scan"])].append((float(row["range_m"]), bearing))
    for row in rows(folder / "target.csv"):
        place = np.array([float(row["east_m"]), float(row["north_m"])])
        truth[int(row["scan"])][int(row["target"])] = place
    scans = []
    for row in rows(folder / "own_ship.csv"):
        index = int(row["scan"])
        range_, azimuth = np.array(echoes[index]).reshape(-1, 2).T
        pose = float(row["east_m"]), float(row["north_m"]), 0.0
        scan = Scan(float(row["time_s"]), range_, azimuth, sensor_pose=pose, sensor=name)
        scans.append((scan, truth[index]))
    return in_order(scans)


def in_order(scans: list[tuple[Scan, Tracks]]) -> list[tuple[Scan, Tracks]]:
    """Scans in the order of their stamps; of equal ones of a sensor the first."""
    ordered, seen = [], set()
    for scan, truth in sorted(scans, key=lambda item: item[0].stamp):
        if (scan.sensor, scan.stamp) not in seen:
            seen.add((scan.sensor, scan.stamp))
            ordered.append((scan, truth))
    return ordered


def sure(tracks: TrackArrays) -> Tracks:
    """Positions of the tracks that probably exist and are known within the distance."""
    return {
        int(track.track_id): track.state[::2]
        for track in tracks
        if track.existence_probability >= 0.5
        and math.sqrt(np.linalg.eigvalsh(track.covariance[::2, ::2])[-1]) <= HELD
    }


Step = Callable[[Scan], Tracks]


def one_tracker(
    names: tuple[str, ...], poured: bool = False, rate: float = 1.0, **options: Any
) -> Step:
    """A tracker for the scans of some sensors: one picture, or as if they were one sensor's."""
    models = {name: HARBOUR[name] for name in names}
    sensor = POURED if poured else models
    options |= {"max_speed": 15.0, "false_tracks_per_hour": rate}
    tracker = make_initiator("score", sensor=sensor, **options)

    def step(scan: Scan) -> Tracks:
        if scan.sensor in names:
            if poured:
                later = tracker.stamp is None or scan.stamp > tracker.stamp
                stamp = scan.stamp if later else tracker.stamp + 1e-6
                scan = scan.replaced(sensor="", stamp=stamp)
            tracker.process(scan)
        return sure(tracker.current)

    return step


def joined_trackers() -> Step:
    """A tracker for each sensor; a track of the second within a distance of one is that."""
    parts = [one_tracker((name,)) for name in HARBOUR]
    known: dict[int, int] = {}

    def step(scan: Scan) -> Tracks:
        first, second = (part(scan) for part in parts)
        found = dict(first)
        for number, place in second.items():
            near = {key: np.hypot(*(place - first[key])) for key in first}
            partner = min(near, key=near.get) if near else None
            if partner is not None and near[partner] < JOINED:
                known[number] = partner
            else:
                found.setdefault(known.get(number, 10**6 + number), place)
        return found

    return step


def poured_into(method: str) -> Step:
    """Another method by both sensors' detections, poured into one; none of it is tuned."""
    tracker = make_initiator(method, sensor=POURED, max_speed=15.0, min_hits=3, window=5)

    def step(scan: Scan) -> Tracks:
        later = tracker.stamp is None or scan.stamp > tracker.stamp
        stamp = scan.stamp if later else tracker.stamp + 1e-6
        tracker.process(scan.replaced(sensor="", stamp=stamp))
        return sure(tracker.current)

    return step


def counted(figures: Figures, scans: list[tuple[Scan, Tracks]], step: Step, judged: str) -> None:
    """Add the figures of a scene; the truth counts at the scans of a sensor."""
    seen, first, owner, pair = {}, {}, {}, {}
    number, held = collections.Counter(), collections.Counter()
    ids, good = set(), set()
    for scan, truth in scans:
        tracks = step(scan)
        ids |= tracks.keys()
        pose = np.asarray(scan.sensor_pose)[:2]
        direction = np.stack([np.cos(scan.azimuth), np.sin(scan.azimuth)], axis=1)
        echoes, near = pose + scan.range[:, None] * direction, {}
        for name, place in truth.items():
            if len(echoes) and np.hypot(*(echoes - place).T).min() < SEEN:
                seen.setdefault(name, scan.stamp)
            close = {key: float(np.hypot(*(at - place))) for key, at in tracks.items()}
            close = {key: away for key, away in close.items() if away < HELD}
            good |= close.keys()
            if name not in seen or scan.sensor != judged:
                continue
            number[name] += 1
            near[name] = close
            if close:
                held[name] += 1
                first.setdefault(name, scan.stamp - seen[name])
                now = owner[name] if owner.get(name) in close else min(close, key=close.get)
                figures.changes += owner.get(name, now) != now
                owner[name] = now
        used = {pair[name] for name in near if pair.get(name) in near[name]}
        todo = {name for name in near if pair.get(name) not in near[name]}
        for _, name, key in sorted((near[n][key], n, key) for n in todo for key in near[n]):
            if name in todo and key not in used:
                figures.matches += pair.get(name, key) != key
                pair[name] = key
                used.add(key)
                todo.remove(name)
    figures.elsewhere += len(ids - good)
    figures.shares += [held[name] / number[name] for name in seen if number[name]]
    figures.delays += list(first.values())
    figures.missed += sum(number[name] > 0 and name not in first for name in seen)


def harbour(folder: Path) -> Iterator[list[str]]:
    """The header, and a row for each way to use the two sensors."""
    yield ["way", "delay", "held", "changes of id", "CLEAR-MOT", "elsewhere", "missed"]
    ways: dict[str, Callable[[], Step]] = {
        "radar": lambda: one_tracker(("radar",)),
        "lidar": lambda: one_tracker(("lidar",)),
        "both in one tracker": lambda: one_tracker(("radar", "lidar")),
        "two trackers, joined": joined_trackers,
        "both poured into one sensor": lambda: one_tracker(("radar", "lidar"), poured=True),
        "TSEPM 3/5, poured": lambda: poured_into("tsepm"),
        "plain Kalman 3/5, poured": lambda: poured_into("kalman"),
    }
    for name, make in ways.items():
        figures = Figures()
        for scene in sorted(folder.glob("autoferry/scenario*")):
            scans = harbour_scans(scene, "radar") + harbour_scans(scene / "lidar", "lidar")
            counted(figures, in_order(scans), make(), "lidar")
        yield [name, *figures.cells()]


NEAR = SensorModel(
    range_std=2.0,
    range_std_fraction=0.0,
    azimuth_std=math.radians(0.6),
    max_range=400.0,
    detection_probability=0.9,
    clutter_density=2e-6,
)
"""A sensor of the scenes, all around: a false detection a scan."""
ARC = math.radians(75.0)


@dataclass(frozen=True)
class SceneKind:
    """A scene of two sensors aboard one ship, at the origin.

    Attributes
    ----------
    models : mapping of str to SensorModel
    intervals : mapping of str to float
        s.
    range_error, azimuth_error : float
        Of the first sensor, m and rad.
    silent_after : float
        Time from which on the first sensor sends nothing, s.
    follows : bool
        Whether its pose is turned by what was said of it after a run as it is.
    targets : int
    """

    models: Mapping[str, SensorModel]
    intervals: Mapping[str, float]
    range_error: float = 0.0
    azimuth_error: float = 0.0
    silent_after: float = math.inf
    follows: bool = False
    targets: int = 6


def facing(model: SensorModel, middle: float, half: float) -> SensorModel:
    """A sensor that sees a sector about an azimuth."""
    return replace(model, azimuth_min=middle - half, azimuth_max=middle + half)


SLOW = replace(NEAR, max_range=1200.0, clutter_density=4e-7)
KINDS = {
    "back to back": SceneKind(
        {"ahead": facing(NEAR, 0.0, 0.5 * math.pi), "astern": facing(NEAR, math.pi, 0.5 * math.pi)},
        {"ahead": 1.0, "astern": 1.3},
    ),
    "overlapping": SceneKind(
        {"port": facing(NEAR, 0.6, ARC), "starboard": facing(NEAR, -0.6, ARC)},
        {"port": 1.0, "starboard": 1.3},
    ),
    "biased by 1 m and 0.5 degree": SceneKind(
        {"port": NEAR, "starboard": NEAR},
        {"port": 1.0, "starboard": 1.3},
        range_error=1.0,
        azimuth_error=math.radians(0.5),
    ),
    "one dies at 100 s": SceneKind(
        {"port": NEAR, "starboard": NEAR}, {"port": 1.0, "starboard": 1.3}, silent_after=100.0
    ),
    "10 Hz beside 0.2 Hz": SceneKind({"fast": NEAR, "slow": SLOW}, {"fast": 0.1, "slow": 5.0}),
    "mounting wrong by 3 degrees": SceneKind(
        {"port": NEAR, "starboard": NEAR},
        {"port": 1.0, "starboard": 1.3},
        azimuth_error=math.radians(3.0),
    ),
    "the same, corrected as said": SceneKind(
        {"port": NEAR, "starboard": NEAR},
        {"port": 1.0, "starboard": 1.3},
        azimuth_error=math.radians(3.0),
        follows=True,
    ),
    "clutter alone": SceneKind(
        {"fast": replace(NEAR, clutter_density=1e-5), "slow": SLOW},
        {"fast": 1.0, "slow": 2.5},
        targets=0,
    ),
}
DURATION = 200.0


def scene_scans(kind: SceneKind, seed: int) -> tuple[list[Scan], np.ndarray]:
    """The scans of a scene, and its targets (n, 4): x, vx, y, vy at time 0."""
    first, farthest = next(iter(kind.models)), max(one.max_range for one in kind.models.values())
    area = {"ranges": [0.22 * farthest, 0.9 * farthest], "azimuths": [-math.pi, math.pi]}
    content = {
        "sensors": [*kind.models],
        "scans": round(DURATION / kind.intervals[first]),
        "targets": [{**area, "speed": speed, "count": kind.targets // 2} for speed in (0.7, 1.6)],
        **{
            name: {"period": kind.intervals[name], "sensor": asdict(model)}
            for name, model in kind.models.items()
        },
    }
    simulator, scans = Simulator(scenario_from(content), seed), []
    for scan in (simulated.scan for simulated in simulator):
        if scan.sensor != first:
            scans.append(scan)
        elif scan.stamp <= kind.silent_after:
            range_, azimuth = scan.range + kind.range_error, scan.azimuth + kind.azimuth_error
            scans.append(scan.replaced(range=range_, azimuth=azimuth))
    return scans, simulator.truth(0.0)


def scene_figures(kind: SceneKind, seed: int, rate: float) -> dict[str, float]:
    """Figures of a scene: held and doubled from 20 s after a target is covered, false tracks."""
    scans, targets = scene_scans(kind, seed)
    if kind.follows:
        turn = -math.radians(scene_figures(replace(kind, follows=False), seed, rate)["degrees"])
        turned = {next(iter(kind.models)): (0.0, 0.0, turn)}
        scans = [scan.replaced(sensor_pose=turned.get(scan.sensor, np.zeros(3))) for scan in scans]
    tracker = make_initiator("score", sensor=kind.models, max_speed=5.0, false_tracks_per_hour=rate)
    counts = collections.Counter()
    since, ids, true = np.full(kind.targets, np.nan), set(), set()
    said = math.nan
    first = next(iter(kind.models))
    for scan in scans:
        tracker.process(scan)
        state, number = tracker.current.state, tracker.current.track_id
        places = targets[:, 0::2] + scan.stamp * targets[:, 1::2]
        polar = np.hypot(*places.T), np.arctan2(places[:, 1], places[:, 0])
        alive = [
            model.covers(*polar)
            for name, model in kind.models.items()
            if not (name == first and scan.stamp > kind.silent_after)
        ]
        inside = np.any(alive, axis=0) if len(alive) else np.zeros(kind.targets, bool)
        alone = ~kind.models[first].covers(*polar)
        since = np.where(inside, np.where(np.isnan(since), scan.stamp, since), np.nan)
        ids |= set(number.tolist())
        away = np.hypot(*(places[:, None] - state[:, 0::2]).T).T
        true |= set(number[(away < HELD).any(axis=0)].tolist())
        for row in np.flatnonzero(scan.stamp - since >= 20.0):
            near = int((away[row] < HELD).sum())
            own = int((np.hypot(*(places - places[row]).T) < 2.0 * HELD).sum())
            counts["covered"] += 1
            counts["held"] += near > 0
            counts["doubled"] += near > own
            counts["alone"] += bool(alone[row])
            counts["held alone"] += bool(alone[row] and near)
        sentence = tracker.misalignments.get(first)
        if sentence and math.isnan(said) and "targets" in sentence.sentence(first):
            said = scan.stamp
    last = tracker.misalignments.get(first)
    return counts | {
        "false": len(ids - true),
        "said": said,
        "degrees": math.degrees(last.azimuth) if last else math.nan,
        "metres": last.range if last else math.nan,
    }


def scenes(seeds: int) -> Iterator[str]:
    """A row for each scene."""
    for name, kind in KINDS.items():
        rate = 30.0 if kind.targets else 100.0
        found = [scene_figures(kind, seed, rate) for seed in range(seeds)]
        names = ("covered", "held", "doubled", "alone", "held alone")
        sums = {key: sum(one.get(key, 0) for one in found) for key in names}
        total = {key: np.array([one[key] for one in found]) for key in ("false", "said", "degrees")}
        number = max(sums["covered"], 1)
        hours = seeds * DURATION / 3600.0
        false = total["false"].sum()
        said = total["said"][~np.isnan(total["said"])]
        yield (
            f"{name:30} held {sums['held'] / number:.3f} (where only the second covers: "
            f"{sums['held alone'] / max(sums['alone'], 1):.3f})  doubled "
            f"{sums['doubled'] / number:.3f}  false "
            f"{false / hours:5.1f}/h +- {math.sqrt(max(false, 1.0)) / hours:.1f}  said "
            f"{len(said)} of {seeds}, by {said.max() if len(said) else math.nan:.0f} s, "
            f"{np.nanmean(total['degrees']) if len(said) else math.nan:.2f} degrees"
        )


def main() -> None:
    """Print the rows."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=("harbour", "scenes"))
    parser.add_argument("folder", nargs="?", type=Path)
    parser.add_argument("--seeds", type=int, default=20)
    add_result_file(parser)
    options = parser.parse_args()
    if options.what == "harbour":
        line = "python benchmarks/several_sensors.py harbour FOLDER"
        write_table(options.result, line, printed(harbour(options.folder)), seed=1, runs=1)
    else:
        for row in scenes(options.seeds):
            print(row, flush=True)


if __name__ == "__main__":
    main()
