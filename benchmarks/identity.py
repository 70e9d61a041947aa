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
"""One target, one identity: how confirmed tracks stay with their targets, and where others start.

    python benchmarks/identity.py recordings FOLDER [FOLDER ...]
    python benchmarks/identity.py scenes [--runs 40] [--seed 0]

`recordings` runs the method `score` on recordings with truth (folders of CSV files, bearings from
north) and prints for each, and in sum: the mean delay from the first scan to the first track on
each target, the share of the scans since then with a track on it, changes of its track's id,
identity switches by CLEAR-MOT and that share counted one to one, the maximum published speed of a
new and of a confirmed track, and tracks that started elsewhere. With `--list` every one of these is
named with its place, speed and way, and where its hits are, seen from the target of the nearest
bearing. The last row is for all confirmed tracks, published or not.

`scenes` does so for simulated targets that cross, overtake, turn and pass fixed echoes, in clutter,
for a radar of a scan in 1.7 s and a sonar of a ping in 12 s; echoes of targets closer together
than the resolution are one. Beside it, the errors of new tracks and of confirmed tracks: RMS of
position and velocity, NEES (ideal 4).

A track is on a target within `--gate` m (scenes: three errors of a detection). Where two targets
are not resolved, one track may be on both; by CLEAR-MOT on one alone.
"""

from __future__ import annotations

import argparse
import dataclasses
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import fixed_threads  # noqa: F401  # before numpy
import numpy as np
from clear_mot import ClearMot, Truth

from msg_adapters.ping import ReadingOptions
from tsepm_ros import ConfirmedTrack, Scan, SensorModel, make_initiator
from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.session.session import Session
from tsepm_ros.settings.node_options import SessionOptions
from tsepm_ros.settings.settings import Settings
from tsepm_ros.tools.replay.offline import offline_recording_results
from tsepm_ros.tools.replay.recording import Recording, read_recording
from tsepm_ros.tools.terminal import terminal_progress, terminal_table
from tsepm_ros.tracker.options import CommonOptions, ScoreOptions
from tsepm_ros.tracker.scan import wrap
from tsepm_ros.tracker.tracks import TrackArrays

HEADER = (
    "", "delay/s", "held", "changes", "switches", "one to one", "new m/s", "held m/s", "on target",
    "elsewhere",
)  # fmt: skip


@dataclass
class Watched:
    """What an operator sees of the targets, scan by scan."""

    gate: float
    ids: dict[int, list[int | None]] = field(default_factory=dict)
    delays: dict[int, float] = field(default_factory=dict)
    since: dict[int, float] = field(default_factory=dict)
    scans: int = 0
    held: int = 0
    changes: int = 0
    fastest_new: float = 0.0
    fastest_confirmed: float = 0.0
    on_target: int = 0
    elsewhere: list[int] = field(default_factory=list)
    errors: dict[str, list[FloatArray]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.clear = ClearMot(self.gate)

    def take(self, stamp: float, truth: Truth, new: TrackArrays, current: TrackArrays) -> None:
        """Take a scan."""
        self.clear.take_states(truth, current)
        self.fastest_new = max([self.fastest_new, *np.hypot(*new.state[:, 1::2].T)])
        self.fastest_confirmed = max([self.fastest_confirmed, *np.hypot(*current.state[:, 1::2].T)])
        for track in new:
            near = {t: math.dist(track.position, state[0::2]) for t, state in truth.items()}
            closest = min(near, key=lambda t: near[t], default=-1)
            if near.get(closest, math.inf) > self.gate:
                self.elsewhere.append(track.track_id)
                continue
            self.on_target += 1
            self.note_errors("new", truth[closest] - track.state, track.covariance)
        on = {target: self.last(target) for target in truth}
        for target, state in truth.items():
            since = self.since.setdefault(target, stamp)
            near = {track.track_id: math.dist(track.position, state[0::2]) for track in current}
            near = {id_: apart for id_, apart in near.items() if apart <= self.gate}
            before, now = on[target], None
            if before in near:
                now = before
            elif near:
                others = [on[other] for other in truth if other != target]
                free = [id_ for id_ in near if id_ not in others]
                now = min(free or near, key=lambda id_: near[id_])
            if now is not None:
                self.delays.setdefault(target, stamp - since)
                self.changes += before is not None and now != before
                row = current.track_id.tolist().index(now)
                self.note_errors("held", state - current.state[row], current.covariance[row])
            self.ids.setdefault(target, []).append(now)
            if target in self.delays:
                self.scans += 1
                self.held += now is not None

    def last(self, target: int) -> int | None:
        """Id of the track that was last on a target."""
        return next((id_ for id_ in reversed(self.ids.get(target, [])) if id_ is not None), None)

    def note_errors(self, of: str, error: FloatArray, covariance: FloatArray) -> None:
        """Note squared errors of position and velocity, and the NEES."""
        if np.isfinite(error).all():
            nees = error @ np.linalg.solve(covariance, error)
            place, speed = np.square(error[0::2]).sum(), np.square(error[1::2]).sum()
            self.errors.setdefault(of, []).append(np.array([place, speed, nees]))

    def mean_errors(self, of: str) -> list[str]:
        """RMS of position and velocity, median and mean NEES."""
        errors = np.array(self.errors.get(of, [np.full(3, np.nan)]))
        place, speed = np.sqrt(errors[:, :2].mean(axis=0))
        nees = errors[:, 2]
        return [f"{place:.1f}", f"{speed:.2f}", f"{np.median(nees):.2f}", f"{nees.mean():.2f}"]


def row_of(name: str, parts: Iterable[Watched]) -> list[str]:
    """The row of a table for one or more."""
    parts = list(parts)
    delays = [delay for part in parts for delay in part.delays.values()]
    own, scans = np.sum([part.clear.held() for part in parts], axis=0)
    return [
        name,
        f"{np.mean(delays or [np.nan]):.2f}",
        f"{sum(p.held for p in parts) / max(sum(p.scans for p in parts), 1):.3f}",
        f"{sum(p.changes for p in parts)}",
        f"{sum(p.clear.switches for p in parts)}",
        f"{own / max(scans, 1):.3f}",
        f"{max(p.fastest_new for p in parts):.1f}",
        f"{max(p.fastest_confirmed for p in parts):.1f}",
        f"{sum(p.on_target for p in parts)}",
        f"{sum(len(p.elsewhere) for p in parts)}",
    ]


# Recordings


def with_errors(recording: Recording, own: float) -> Recording:
    """Errors of each detection: range 8 m, bearing 1 degree, `own` m more in each coordinate."""
    scans = []
    for scan in recording.scans:
        range_ = np.maximum(scan.fields["range"], 1.0)
        errors = {
            "range_std": np.full(len(range_), math.hypot(8.0, own)),
            "azimuth_std": np.hypot(math.radians(1.0), own / range_),
        }
        scans.append(dataclasses.replace(scan, fields={**scan.fields, **errors}))
    return dataclasses.replace(recording, scans=scans)


def truth_at(recording: Recording, stamp: float) -> Truth:
    """States of the targets at a time; velocities from the positions."""
    return {target: state_at(path, stamp) for target, path in recording.targets.items()}


def state_at(path: FloatArray, stamp: float) -> FloatArray:
    """State (4,) on a recorded path (n, 5) at a time; the velocity is from the positions."""
    time, place = path[:, 0], path[:, 1::2]
    velocity = np.gradient(place, time, axis=0)
    columns = [place[:, 0], velocity[:, 0], place[:, 1], velocity[:, 1]]
    return np.array([np.interp(stamp, time, column) for column in columns])


def settings_of(
    how: str,
    max_speed: float = 15.0,
    max_range: float = 500.0,
    clutter_density: float = 1e-6,
    min_speed: float = 0.0,
) -> Settings:
    """`score` at 10 false tracks an hour; density and P_D as `how`: estimated or given."""
    return Settings(
        SessionOptions(method="score", own_ship_source="odometry"),
        SensorModel(
            range_std=10.4,
            range_std_fraction=0.0,
            max_range=max_range,
            detection_probability=0.92,
            clutter_density=clutter_density,
        ),
        CommonOptions(
            max_speed=max_speed,
            min_speed=min_speed,
            clutter_density=how,
            detection_probability=how,
        ),
        {"score": ScoreOptions(false_tracks_per_hour=10.0)},
    )


def watched_recording(
    folder: Path, settings: Settings, gate: float
) -> tuple[Watched, Watched, list[str]]:
    """What is seen of a recording, by published and by all confirmed tracks; tracks elsewhere.

    A confirmed track that is not published is a fixed echo, or one whose place is not known well
    enough.
    """
    recording = with_errors(read_recording(folder), 6.6)
    watched, of_confirmed = Watched(gate), Watched(gate)
    shown: dict[int, list[tuple[int, ConfirmedTrack]]] = {}
    session = Session(settings)
    for index, result in enumerate(
        offline_recording_results([(recording, session, ReadingOptions("north"))])
    ):
        truth = truth_at(recording, result.stamp)
        watched.take(result.stamp, truth, result.new, result.current.sure)
        of_confirmed.take(
            result.stamp, truth, result.new, session.tracker.maintenance.confirmed.tracks
        )
        for track in result.current.sure:
            shown.setdefault(track.track_id, []).append((index, track))
    lines = elsewhere_lines(watched, shown, recording)
    return watched, of_confirmed, [f"{folder.name} {line}" for line in lines]


def recordings(given: argparse.Namespace) -> None:
    """Run the recordings with learned figures, and with those of the data sheet."""
    for how in given.figures:
        settings = settings_of(
            how, given.max_speed, given.max_range, given.clutter_density, given.min_speed
        )
        found = [watched_recording(folder, settings, given.gate) for folder in given.folders]
        published, held, lines = zip(*found, strict=True)
        rows = [
            row_of(folder.name, [watched])
            for folder, watched in zip(given.folders, published, strict=True)
        ]
        rows += [row_of("all", published), row_of("all, confirmed tracks", held)]
        print(f"\nclutter density and detection probability {how}\n")
        print(terminal_table(HEADER, rows))
        if given.list:
            print("\n".join(["", *(line for part in lines for line in part)]))


def behind_target(recording: Recording, hits: Iterable[tuple[int, int]]) -> str:
    """The target whose bearing is nearest to that of hits, and their ranges over its range."""
    compared: dict[int, list[tuple[float, float]]] = {}
    for index, row in hits:
        scan = recording.scans[index]
        way = np.array([(ship.stamp, ship.x, 0.0, ship.y, 0.0) for ship in recording.own_ship])
        here = state_at(way, scan.time)[0::2]
        for target, state in truth_at(recording, scan.time).items():
            east, north = state[0::2] - here
            turn = scan.fields["bearing"][row] - math.atan2(east, north)
            ratio = scan.fields["range"][row] / math.hypot(east, north)
            compared.setdefault(target, []).append((abs(wrap(turn)), ratio))
    means = {target: np.mean(values, axis=0) for target, values in compared.items()}
    nearest = min(means, key=lambda target: means[target][0])
    turn, ratio = means[nearest]
    return f"{math.degrees(turn):.0f} degrees from target {nearest}, {ratio:.1f} times its range"


def elsewhere_lines(
    watched: Watched, held: dict[int, list[tuple[int, ConfirmedTrack]]], recording: Recording
) -> Iterator[str]:
    """Tracks elsewhere: place, speed and way, and their hits, seen from the nearest target."""
    for id_ in watched.elsewhere:
        (first, start), (last, end) = held[id_][0], held[id_][-1]
        speeds = [float(np.hypot(*track.velocity)) for _, track in held[id_]]
        yield (
            f"id {id_:2d} scans {first}-{last} from {start.position.round().astype(int)} to "
            f"{end.position.round().astype(int)}: {math.dist(start.position, end.position):.0f} m, "
            f"{len(start.hits)} hits, {speeds[0]:.1f} m/s, then {np.median(speeds):.1f} "
            f"(most {max(speeds):.1f}); hits {behind_target(recording, start.hits)}"
        )


# Scenes


@dataclass(frozen=True)
class Sonde:
    """A sensor, its clutter and resolution."""

    sensor: SensorModel
    interval: float
    scans: int
    resolution: float
    max_speed: float
    scale: float


RADAR = Sonde(
    SensorModel(range_std=8.0, range_std_fraction=0.0, max_range=600.0, clutter_density=5e-6),
    1.7, 80, 12.0, 15.0, 1.0,
)  # fmt: skip
SONAR = Sonde(SensorModel(clutter_density=1e-6, max_range=9000.0), 12.0, 50, 60.0, 10.0, 12.0)
SONDES = {"radar": RADAR, "sonar": SONAR}
SCENES = ("crossing", "overtaking", "turning", "fast", "fixed")


def path_of(name: str, rng: np.random.Generator, sonde: Sonde) -> list[FloatArray]:
    """Paths (k, 4) of the targets of a scene; lengths in units of the sensor's scale, m."""
    time = sonde.interval * np.arange(sonde.scans)
    unit, whole = sonde.scale, time[-1]
    speed = rng.uniform(0.2, 0.5) * sonde.max_speed
    heading = rng.uniform(-math.pi, math.pi)
    centre = unit * np.array([220.0, 0.0])

    def line(through: FloatArray, velocity: FloatArray, at: float) -> FloatArray:
        place = through + (time - at)[:, None] * velocity
        moving = np.broadcast_to(velocity, place.shape)
        return np.stack([place[:, 0], moving[:, 0], place[:, 1], moving[:, 1]], axis=1)

    def course(angle: float) -> FloatArray:
        return np.array([math.cos(angle), math.sin(angle)])

    first = line(centre, speed * course(heading), 0.5 * whole)
    across = course(heading + 0.5 * math.pi)
    if name == "crossing":
        turn = rng.choice([-1, 1]) * rng.uniform(0.5, 2.5)
        return [first, line(centre, 0.8 * speed * course(heading + turn), 0.5 * whole)]
    if name == "overtaking":
        beside = centre + unit * rng.uniform(15.0, 30.0) * across
        return [first, line(beside, 0.5 * speed * course(heading), 0.5 * whole)]
    if name == "turning":
        rate = np.zeros(len(time))
        begin = rng.uniform(0.3, 0.5) * whole
        for start in (begin, begin + 0.25 * whole):
            during = (time >= start) & (time < start + 6.0 * sonde.interval)
            rate[during] = rng.choice([-1, 1]) * rng.uniform(0.5, 1.6) / (6.0 * sonde.interval)
        angle = heading + np.cumsum(rate) * sonde.interval
        velocity = speed * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        place = np.cumsum(velocity, axis=0) * sonde.interval
        place += centre - place[len(time) // 2]
        return [np.stack([place[:, 0], velocity[:, 0], place[:, 1], velocity[:, 1]], axis=1)]
    if name == "fast":
        fast = 0.95 * sonde.max_speed * course(heading)
        return [line(centre, fast, 0.5 * whole)]
    fixed = [line(centre + unit * rng.uniform(-40.0, 40.0, 2), np.zeros(2), 0.0) for _ in range(3)]
    return [first, *fixed]  # passing fixed echoes


def seen(paths: list[FloatArray], sonde: Sonde, rng: np.random.Generator) -> Iterator[Scan]:
    """The scans: echoes within the resolution are one, of their middle."""
    sensor = sonde.sensor
    for index in range(sonde.scans):
        places: list[FloatArray] = []
        for path in paths:
            place = path[index, 0::2]
            near = [
                k for k, other in enumerate(places) if math.dist(place, other) < sonde.resolution
            ]
            if near:
                places[near[0]] = 0.5 * (places[near[0]] + place)
            elif rng.random() < sensor.detection_probability:
                places.append(place)
        points = np.reshape(places, (-1, 2))
        number = rng.poisson(sensor.clutter_density * sensor.coverage_area)
        range_ = np.hypot(*points.T)
        range_ = range_ + np.sqrt(sensor.range_variance(range_)) * rng.standard_normal(len(range_))
        azimuth = np.arctan2(points[:, 1], points[:, 0])
        azimuth = azimuth + sensor.azimuth_std * rng.standard_normal(len(azimuth))
        false = sensor.max_range * np.sqrt(rng.uniform(size=number))
        yield Scan(
            sonde.interval * index,
            np.append(np.abs(range_), false),
            np.append(azimuth, rng.uniform(-math.pi, math.pi, number)),
        )


def scenes(given: argparse.Namespace) -> None:
    """Run the scenes."""
    for sonde_name in given.sensors:
        sonde = SONDES[sonde_name]
        rows, errors = [], []
        for number, name in enumerate(SCENES):
            if name not in given.scenes:
                continue
            parts = []
            for run in terminal_progress(range(given.runs), given.runs, "runs"):
                rng = np.random.default_rng([given.seed, number, run])
                paths = path_of(name, rng, sonde)
                sigma = max(
                    math.sqrt(float(sonde.sensor.range_variance(220.0 * sonde.scale))),
                    220.0 * sonde.scale * sonde.sensor.azimuth_std,
                )
                made = make_initiator("score", sensor=sonde.sensor, max_speed=sonde.max_speed)
                watched = Watched(3.0 * sigma)
                for index, scan in enumerate(seen(paths, sonde, rng)):
                    new = made.process(scan)
                    truth = {
                        target: path[index]
                        for target, path in enumerate(paths)
                        if np.hypot(*path[index, 0::2]) < sonde.sensor.max_range
                    }
                    watched.take(scan.stamp, truth, new, made.current.sure)
                parts.append(watched)
            rows.append(row_of(name, parts))
            whole = Watched(0.0)
            for part in parts:
                for of, values in part.errors.items():
                    whole.errors.setdefault(of, []).extend(values)
            errors += [[name, of, *whole.mean_errors(of)] for of in ("new", "held")]
        print(f"\n{sonde_name}, {given.runs} runs of each scene, seed {given.seed}\n")
        print(terminal_table(HEADER, rows), flush=True)
        print()
        header = ("", "", "position/m", "velocity/(m/s)", "NEES median", "mean")
        print(terminal_table(header, errors), flush=True)


def main() -> None:
    """Run what is asked for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parts = parser.add_subparsers(required=True)
    of_recordings = parts.add_parser("recordings")
    of_recordings.add_argument("folders", type=Path, nargs="+")
    of_recordings.add_argument("--gate", type=float, default=40.0, help="m")
    of_recordings.add_argument("--max-range", type=float, default=500.0, help="m")
    of_recordings.add_argument("--max-speed", type=float, default=15.0, help="m/s")
    of_recordings.add_argument("--min-speed", type=float, default=0.0, help="m/s, 0: off")
    of_recordings.add_argument("--clutter-density", type=float, default=1e-6, help="1/m^2")
    of_recordings.add_argument(
        "--figures", nargs="+", choices=("estimated", "given"), default=("estimated", "given")
    )
    of_recordings.add_argument("--list", action="store_true", help="name the tracks elsewhere")
    of_recordings.set_defaults(run=recordings)
    of_scenes = parts.add_parser("scenes")
    of_scenes.add_argument("--runs", type=int, default=40)
    of_scenes.add_argument("--seed", type=int, default=0)
    of_scenes.add_argument("--scenes", nargs="+", choices=SCENES, default=SCENES)
    of_scenes.add_argument("--sensors", nargs="+", choices=tuple(SONDES), default=tuple(SONDES))
    of_scenes.set_defaults(run=scenes)
    given = parser.parse_args()
    given.run(given)


if __name__ == "__main__":
    main()
