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
"""The whole chain: images to tracks by detector and tracker as `tsepm init` leaves them.

    python benchmarks/chain.py run [--only pool fish ...] [--data FOLDER] [--seeds N] [--seed 1]
        [--kalman 3/5 2/3,0.3 ...] [--poses exact white slow] [--workers 2] [--json FILE]
        [--result FILE]
    python benchmarks/chain.py compare BEFORE.json AFTER.json

The answers to `tsepm init` are those of a data sheet (`chain_scenes.py`); its parameter file makes
the detector and the session, and nothing is set by hand but the accepted false tracks per hour. The
plain Kalman tracks beside it have the same detections. The source tree that is measured is the one
that Python imports (`PYTHONPATH`). Values of several runs have 95 % intervals, over the runs. The
file keeps the parts that a command does not run.

A row is a scene with a tracker, or with its detections, or targets in one state. Targets count
while they are in view:

- detected, false a scan: share of the targets with a detection within the gate, and detections that
  are neither near a target nor on structure nor told as standing; the others a scan;
- found: share of the targets that ever have a track that is said to be a target (status
  confirmed); delay: seconds to the first, median; of a target that is never found until it leaves;
- held: share of the time in which such a track is within the gate; held by any: any published
  track, also one that coasts or stands still;
- ids: of the tracks of a found target by CLEAR-MOT; MOTA and false rows a target as `tsepm score`
  counts them with the gate as cutoff, of the images that are labelled;
- tracks: ids said to be targets; on structure, open water: those that were never near a target, by
  the place at which they were first said to be one; over accepted: those in open water over the
  number that is accepted in that time;
- within 3 sigma: of held targets by their tracks' covariance, 0.989 where that is right.

The part `chance` tells chance from persistence: detections as they are, with the scans in random
order, with each scan turned at random, and drawn at random from the density that the tracker had
learned at last.
"""

from __future__ import annotations

import argparse
import contextlib
import functools
import io
import math
import time
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import chain_scenes as at
import fixed_threads  # noqa: F401  # before numpy
import numpy as np
from chain_scenes import BottomScene, ChainScene, Truth
from result_tables import PartRow, add_compare, estimate_text, print_part, write_table

from msg_adapters import seconds_to_ns
from msg_adapters.ping import ReadingOptions
from msg_adapters.point_cloud import detections_of_fields
from msg_adapters.sonar_images import detection_fields
from tsepm_ros.detector.detector import Detector
from tsepm_ros.detector.image import DetectorOptions
from tsepm_ros.numerics.arrays import BoolArray, FloatArray
from tsepm_ros.own_ship.pose_history import PoseSample
from tsepm_ros.session.session import ScanResult, Session
from tsepm_ros.session.turn import ImagePing
from tsepm_ros.settings.node_options import InitiatorNodeOptions, SonarDetectorNodeOptions
from tsepm_ros.settings.settings import (
    SONAR_DETECTOR,
    TRACK_INITIATOR,
    Settings,
    make_groups,
    settings_from,
)
from tsepm_ros.tools.commands.given_parameters import given_parameter_values
from tsepm_ros.tools.commands.init_command import add_init_arguments, run_init
from tsepm_ros.tools.evaluation.intervals import (
    IntervalEstimate,
    mean_count_interval,
    mean_interval,
    quantile_interval,
)
from tsepm_ros.tools.evaluation.result_files import add_result_file, mapped_results
from tsepm_ros.tools.evaluation.tracking_metrics import ClearMot, ClearMotCounts
from tsepm_ros.tools.replay.offline import FRAME
from tsepm_ros.tracker.scan import MIN_STANDING
from tsepm_ros.tracker.sensor import Coverage
from tsepm_ros.tracker.tracks import TrackArrays

RATES = 10.0, 1.0
"""False tracks per hour that are accepted."""
SIGMAS = 3.0
Groups = dict[type[Any], Any]
Options = argparse.Namespace
Rows = dict[str, PartRow]


@dataclass(frozen=True, eq=False)
class Ping:
    """The detections of an image as a message has them, own ship's pose, and the truth."""

    stamp: float
    fields: dict[str, FloatArray]
    pose: FloatArray | None
    truth: Truth
    labelled: bool

    def places(self) -> FloatArray:
        """Places of the detections in the fixed frame, (n, 2), m."""
        x, y, yaw = np.zeros(3) if self.pose is None else self.pose
        bearing = self.fields["azimuth"] + yaw
        range_ = self.fields["range"]
        return np.array([x + range_ * np.cos(bearing), y + range_ * np.sin(bearing)]).T


@functools.cache
def initialised(answers: tuple[str, ...], rate: float) -> tuple[Groups, Groups]:
    """Parameter groups of detector and tracker, from the file that `tsepm init` writes."""
    parser = argparse.ArgumentParser()
    add_init_arguments(parser)
    with TemporaryDirectory() as folder, contextlib.redirect_stdout(io.StringIO()):
        file = Path(folder) / "my_sonar.yaml"
        run_init(parser.parse_args([str(file), "--yes", "--false-tracks", f"{rate:g}", *answers]))
        values = [
            given_parameter_values([file], node) for node in ("/sonar_detector", "/track_initiator")
        ]
    return make_groups(SONAR_DETECTOR, values[0]), make_groups(TRACK_INITIATOR, values[1])


def detected(scene: ChainScene, seed: int) -> list[Ping]:
    """The detections of a scene by the detector that `tsepm init` describes."""
    groups, _ = initialised(scene.answers, RATES[0])
    detector = Detector(groups[DetectorOptions], groups[Coverage])
    sound_speed = groups[SonarDetectorNodeOptions].sound_speed
    pings = []
    for view in scene.views(seed):
        image = view.image
        scan = detector.process(image)
        ping = ImagePing(
            *(seconds_to_ns(image.stamp), FRAME, image.range, image.azimuth, image.intensity),
            sound_speed=sound_speed,
        )
        pose = None if image.sensor_pose is None else np.asarray(image.sensor_pose)
        fields = detection_fields(ping, scan)
        pings.append(Ping(image.stamp, fields, pose, view.truth, view.labelled))
    return pings


def tracked(
    pings: Sequence[Ping], session: Session, node: InitiatorNodeOptions
) -> Iterator[tuple[Ping, ScanResult]]:
    """Pings with their results, by a session as `tsepm run` has it; dropped ones have none."""
    options = ReadingOptions(node.bearing_reference, node.sound_speed)
    by_stamp = {seconds_to_ns(ping.stamp): ping for ping in pings}

    def add_pose(ping: Ping) -> None:
        if ping.pose is not None:
            session.add_own_ship(
                PoseSample(ping.stamp, *ping.pose.tolist(), frame_id=session.fixed_frame or FRAME)
            )

    add_pose(pings[0])
    for ping, after in zip(pings, [*pings[1:], None], strict=True):
        if after is not None:  # poses come faster than images
            add_pose(after)
        found = detections_of_fields(seconds_to_ns(ping.stamp), FRAME, ping.fields, options)
        session.add_scan(found.sensor_scan, now=(ping.stamp, math.nan))
        for result in session.process():
            yield by_stamp[result.stamp_ns], result
    for result in session.process(last=True):
        yield by_stamp[result.stamp_ns], result


KALMAN = "2/3,0.3,0.2,4", "3/5", "3/5,0.3,0.2,4", "4/6,0,0.2,4", "5/7,0,0.2,8"
"""Plain Kalman tracks: rules from quick to careful. The pages show the best for each scene."""


def settings_of(groups: Groups, kalman: str = "") -> Settings:
    """The settings of the groups, or those of plain Kalman tracks.

    Parameters
    ----------
    groups : dict
        Of the tracker.
    kalman : str, optional
        A rule such as 3/5, and by commas extent_std, m, process_noise, m^2/s^3, and misses; each
        echo counts then.
    """
    settings = settings_from(groups)
    if not kalman:
        return settings
    rule, *values = kalman.split(",")
    kinds = {"extent_std": float, "process_noise": float, "misses": int}
    options = {"method": "kalman"} | {
        f"kalman.{name}": kind(value)
        for (name, kind), value in zip(kinds.items(), values, strict=False)
    }
    own = settings_from(make_groups(TRACK_INITIATOR, options)).methods["kalman"]
    min_hits, window = map(int, rule.split("/"))
    return replace(
        settings,
        session=replace(settings.session, method="kalman"),
        common=replace(settings.common, target_extent=0.0),
        methods={"kalman": replace(own, min_hits=min_hits, window=window)},
    )


@dataclass
class Held:
    """Counts of targets in one state."""

    seen: int = 0
    held: int = 0
    by_any: int = 0
    errors: int = 0
    within: int = 0

    @staticmethod
    def row(runs: Sequence[Held]) -> PartRow:
        """Shares, over runs."""
        return {
            "held": share([run.held for run in runs], [run.seen for run in runs]),
            "held by any": share([run.by_any for run in runs], [run.seen for run in runs]),
            "within 3 sigma": share([run.within for run in runs], [run.errors for run in runs]),
        }


def share(parts: Sequence[float], wholes: Sequence[float]) -> IntervalEstimate:
    """Ratio of sums over runs, with the interval of the runs' own ratios."""
    each = [part / whole for part, whole in zip(parts, wholes, strict=True) if whole]
    if not each:
        return IntervalEstimate.unknown()
    spread, value = mean_interval(each), sum(parts) / sum(wholes)
    return IntervalEstimate(
        value, value + spread.low - spread.value, value + spread.high - spread.value
    )


@dataclass
class Watch:
    """The tracks of a run beside its targets, ping by ping."""

    gate: float
    on_structure: Callable[[FloatArray], BoolArray]
    rate: float = math.nan
    states: dict[str, Held] = field(default_factory=partial(defaultdict, Held))
    first: dict[Any, float] = field(default_factory=dict)
    last: dict[Any, float] = field(default_factory=dict)
    found: dict[Any, float] = field(default_factory=dict)
    ids: dict[Any, set[int]] = field(default_factory=partial(defaultdict, set))
    near: set[int] = field(default_factory=set)
    began: dict[int, FloatArray] = field(default_factory=dict)
    counts: list[ClearMotCounts] = field(default_factory=list)
    stamps: list[float] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.clear = ClearMot(self.gate)

    def take(self, ping: Ping, result: ScanResult) -> None:
        """Take a ping."""
        gate, sure = self.gate, result.current.sure
        self.stamps.append(ping.stamp)
        anything = TrackArrays.joined(result.current, result.fixed_echoes)
        places = dict(zip(sure.track_id.tolist(), sure.state[:, 0::2], strict=True))
        for track, place in places.items():
            self.began.setdefault(track, place)
        for target, (place, state, _) in ping.truth.items():
            self.first.setdefault(target, ping.stamp)
            self.last[target] = ping.stamp
            offset = sure.state[:, 0::2] - place
            apart = np.linalg.norm(offset, axis=1)
            held = self.states[state]
            held.seen += 1
            held.by_any += bool(
                (np.linalg.norm(anything.state[:, 0::2] - place, axis=1) <= gate).any()
            )
            self.near |= set(sure.track_id[apart <= gate].tolist())
            if (apart <= gate).any():
                held.held += 1
                self.found.setdefault(target, ping.stamp)
                row = int(apart.argmin())
                spread = sure.covariance[row][np.ix_((0, 2), (0, 2))]
                held.errors += 1
                held.within += bool(offset[row] @ np.linalg.solve(spread, offset[row]) <= SIGMAS**2)
        if ping.labelled:
            self.counts.append(self.clear.take({k: v.place for k, v in ping.truth.items()}, places))
            for target, track in self.clear.now.items():
                self.ids[target].add(track)

    @property
    def hours(self) -> float:
        """Duration."""
        return (self.stamps[-1] - self.stamps[0]) / 3600.0 if self.stamps else 0.0

    def elsewhere(self) -> tuple[int, int]:
        """Tracks that were never near a target, on structure and in open water."""
        places = [place for track, place in self.began.items() if track not in self.near]
        built = int(self.on_structure(np.reshape(places, (-1, 2))).sum())
        return built, len(places) - built

    @staticmethod
    def row(runs: Sequence[Watch]) -> PartRow:
        """A row of runs."""
        row: PartRow = {}
        total = [ClearMotCounts.total(run.counts) for run in runs]
        if any(run.first for run in runs):
            row["found"] = share([len(run.found) for run in runs], [len(run.first) for run in runs])
            row["delay, s"] = quantile_interval(
                [run.found.get(k, run.last[k]) - run.first[k] for run in runs for k in run.first],
                0.5,
            )
            row |= Held.row([summed(run.states.values()) for run in runs])
            row["ids"] = share(
                [sum(len(ids) for ids in run.ids.values()) for run in runs],
                [len(run.ids) for run in runs],
            )
            row["MOTA"] = share([t.right for t in total], [t.targets for t in total])
            row["false rows a target"] = share([t.false for t in total], [t.targets for t in total])
        built, water = np.transpose([run.elsewhere() for run in runs])
        row["tracks"] = mean_count_interval([len(run.began) for run in runs])
        row["on structure"] = mean_count_interval(built)
        row["open water"] = mean_count_interval(water)
        accepted = float(np.mean([run.rate * run.hours for run in runs]))
        row["over accepted"] = row["open water"] / accepted
        return row


def summed(states: Iterable[Held]) -> Held:
    """All states together."""
    rows = [vars(state) for state in states]
    return Held(**{name: sum(row[name] for row in rows) for name in vars(Held())})


@dataclass
class Detections:
    """Detections of a run beside its targets."""

    seen: dict[str, int] = field(default_factory=partial(defaultdict, int))
    found: dict[str, int] = field(default_factory=partial(defaultdict, int))
    false: int = 0
    built: int = 0
    standing: int = 0
    pings: int = 0

    @classmethod
    def of(cls, scene: ChainScene, pings: Sequence[Ping]) -> Detections:
        """Count them."""
        counts = cls(pings=len(pings))
        for ping in pings:
            places = ping.places()
            near = np.zeros(len(places), bool)
            for _, state, echo in ping.truth.values():
                own = np.linalg.norm(places - echo, axis=1) <= scene.gate
                counts.seen[state] += 1
                counts.found[state] += bool(own.any())
                near |= own
            built = scene.on_structure(places) & ~near
            stands = (ping.fields["standing"] >= MIN_STANDING) & ~near & ~built
            counts.built += int(built.sum())
            counts.standing += int(stands.sum())
            counts.false += int((~near & ~built & ~stands).sum())
        return counts

    @staticmethod
    def row(runs: Sequence[Detections], state: str = "") -> PartRow:
        """Share of the targets (in a state) that are detected, and of all also the others."""
        states = [state] if state else sorted({name for run in runs for name in run.seen})
        row = {
            "detected": share(
                [sum(run.found[name] for name in states) for run in runs],
                [sum(run.seen[name] for name in states) for run in runs],
            )
        }
        if not state:
            for column, name in (
                ("false a scan", "false"),
                ("on structure a scan", "built"),
                ("standing a scan", "standing"),
            ):
                row[column] = mean_interval([vars(run)[name] / run.pings for run in runs])
        return row


def shuffled(pings: Sequence[Ping], rng: np.random.Generator, _: Session) -> Iterator[Ping]:
    """The scans in random order, seen from where own ship is then."""
    for ping, other in zip(pings, rng.permutation(len(pings)).tolist(), strict=True):
        yield replace(ping, fields=pings[other].fields)


def turned(pings: Sequence[Ping], rng: np.random.Generator, session: Session) -> Iterator[Ping]:
    """Each scan turned at random, in the sector."""
    sensor = session.settings.sensor
    for ping in pings:
        beyond = ping.fields["azimuth"] - sensor.azimuth_min + rng.uniform(0.0, sensor.sector_width)
        azimuth = sensor.azimuth_min + beyond % sensor.sector_width
        yield replace(ping, fields={**ping.fields, "azimuth": azimuth})


def drawn(pings: Sequence[Ping], rng: np.random.Generator, session: Session) -> Iterator[Ping]:
    """Poisson of the density that a session has learned; other fields of detections at random."""
    sensor, density = session.settings.sensor, session.tracker.sensor.learned.clutter_map
    near, far = sensor.min_range**2, sensor.max_range**2
    names = pings[0].fields
    stock = {name: np.concatenate([ping.fields[name] for ping in pings]) for name in names}
    free = np.flatnonzero(~(stock["standing"] >= MIN_STANDING))
    free = free if len(free) else np.arange(len(stock["standing"]))
    for ping in pings:
        number = rng.poisson(CANDIDATES)
        range_ = np.sqrt(rng.uniform(near, far, number))
        azimuth = rng.uniform(sensor.azimuth_min, sensor.azimuth_max, number)
        expected = density.at(density.grid.cells(range_, azimuth)) * sensor.coverage_area
        chosen = rng.random(number) < expected / CANDIDATES
        rows = rng.choice(free, int(chosen.sum()))
        places = {"range": range_[chosen], "azimuth": azimuth[chosen]}
        yield replace(ping, fields={name: stock[name][rows] for name in names} | places)


CANDIDATES = 20_000
"""Mean number of places of which the drawn detections are thinned: many times their number."""
DISTURBED = {"scans in random order": shuffled, "scans turned": turned, "drawn": drawn}


@dataclass(frozen=True)
class Job:
    """A run of a scene."""

    part: str
    title: str
    seed: int
    options: Options


@dataclass
class Run:
    """What a job gives: its detections, and the tracks of each tracker."""

    detections: Detections
    watches: dict[str, Watch] = field(default_factory=dict)


def watched(
    scene: ChainScene, pings: Sequence[Ping], rate: float, kalman: str = ""
) -> tuple[Watch, Session]:
    """Follow the detections, by `score` at an accepted rate or by plain Kalman tracks."""
    _, groups = initialised(scene.answers, rate)
    session = Session(settings_of(groups, kalman))
    watch = Watch(scene.gate, scene.on_structure, math.nan if kalman else rate)
    for ping, result in tracked(pings, session, groups[InitiatorNodeOptions]):
        watch.take(ping, result)
    return watch, session


def done(job: Job) -> Run:
    """Run a job."""
    scene = PARTS[job.part](job.options)[job.title]
    pings = detected(scene, job.seed)
    run = Run(Detections.of(scene, pings))
    if job.part == "chance":
        watch, session = watched(scene, pings, RATES[0])
        run.watches["as they are"] = watch
        for name, disturb in DISTURBED.items():
            changed = disturb(pings, np.random.default_rng([job.seed, 1]), session)
            told = [replace(ping, truth={}) for ping in changed]
            run.watches[name] = watched(scene, told, RATES[0])[0]
        return run
    for rate in RATES:
        run.watches[f"score {rate:g}/h"] = watched(scene, pings, rate)[0]
    for rule in job.options.kalman:
        run.watches[f"kalman {rule}"] = watched(scene, pings, RATES[0], rule)[0]
    return run


Scenes = dict[str, ChainScene]


def pool_part(options: Options) -> Scenes:
    """A pool with swimmers."""
    return {"pool": at.pool(options.data)}


def clips_part(options: Options) -> Scenes:
    """Clips of a river."""
    return {name: at.clip(options.data, name) for name in ("lamprey1", "lamprey3")}


def radar_part(options: Options) -> Scenes:
    """Noise of a radar."""
    return {"BR24 noise": at.radar(options.data, options.images or 40)}


def fish_part(options: Options) -> Scenes:
    """Fish that pass an imaging sonar."""
    return {"fish": replace(at.FISH, views=partial(at.fish_views, images=options.images or 600))}


def bottom(
    drives: bool, cells: tuple[int, int], options: Options, poses: str = "exact"
) -> ChainScene:
    """A bottom, for 120 s at rest or for 60 s under way."""
    scene = BottomScene(drives, cells, 600, 0.1 if drives else 0.2, poses)
    return replace(scene, images=options.images or scene.images).scene()


def rest_part(options: Options) -> Scenes:
    """A bottom with a wall, piles and a diver before a sonar that does not move."""
    return {f"at rest, {b} x {m}": bottom(False, (b, m), options) for b, m in SIZES}


def drive_part(options: Options) -> Scenes:
    """The same before a sonar that drives."""
    return {
        f"drives, {b} x {m}, {poses} poses": bottom(True, (b, m), options, poses)
        for b, m in SIZES
        for poses in options.poses
    }


def basin_part(options: Options) -> Scenes:
    """Five swimmers in a basin before a slow scanner."""
    turns = options.images or at.TURNS
    return {"basin": replace(at.BASIN, views=partial(at.basin_views, turns=turns))}


def chance_part(options: Options) -> Scenes:
    """Detections as they are and disturbed, of a quarter of the cells."""
    return {name: bottom(name == "drives", SIZES[-1], options) for name in ("at rest", "drives")}


SIZES = (256, 600), (128, 300)
PARTS: dict[str, Callable[[Options], Scenes]] = {
    "pool": pool_part,
    "clips": clips_part,
    "radar": radar_part,
    "fish": fish_part,
    "rest": rest_part,
    "drive": drive_part,
    "basin": basin_part,
    "chance": chance_part,
}
RECORDED = "pool", "clips", "radar"
"""Parts of real data."""
SEEDS = {"radar": 2, "fish": 2, "rest": 2, "drive": 2, "basin": 5, "chance": 2}
"""Seeds of a part; real recordings have one run."""


def part_rows(part: str, options: Options) -> Rows:
    """Run all scenes of a part."""
    seeds = options.seeds or SEEDS.get(part, 1)
    seeds = 1 if part in ("pool", "clips") else seeds
    scenes = PARTS[part](options)
    jobs = [Job(part, t, options.seed + k, options) for t in scenes for k in range(seeds)]
    runs = defaultdict(list)
    for job, run in zip(jobs, mapped_results(done, jobs, options.workers), strict=True):
        runs[job.title].append(run)
    rows: Rows = {}
    for title, done_ in runs.items():
        rows |= scene_rows(title, done_)
    return rows


def scene_rows(title: str, runs: Sequence[Run]) -> Rows:
    """The rows of a scene: its detections, its tracks, and its targets by state."""
    detections = [run.detections for run in runs]
    states = sorted({state for one in detections for state in one.seen})
    states = states if len(states) > 1 else []
    rows = {f"{title}: detections": Detections.row(detections)}
    rows |= {f"{title}, {s}: detections": Detections.row(detections, s) for s in states}
    for name in runs[0].watches:
        watches = [run.watches[name] for run in runs]
        rows[f"{title}: {name}"] = Watch.row(watches)
        for state in states if any(watch.states for watch in watches) else ():
            rows[f"{title}, {state}: {name}"] = Held.row([w.states[state] for w in watches])
    return rows


def measured(options: Options) -> None:
    """Run parts, print their tables, and write them."""
    if options.only is None:
        options.only = [part for part in PARTS if options.data or part not in RECORDED]
    elif options.data is None and set(options.only) & set(RECORDED):
        raise SystemExit(f"{', '.join(RECORDED)} need --data FOLDER")
    line = "python benchmarks/chain.py run"
    line += " --data FOLDER" if options.data else ""
    line += f" --seeds {options.seeds}" if options.seeds else ""
    rows: Rows = {}
    for part in options.only:
        start, own = time.perf_counter(), part_rows(part, options)
        rows |= own
        print_part(part, own, options.json)
        print(f"\n`{line} --only {part}`: {time.perf_counter() - start:.0f} s\n", flush=True)
    if set(options.only) != set(PARTS):
        line += f" --only {' '.join(options.only)}"
    columns = list(dict.fromkeys(column for row in rows.values() for column in row))
    table = [
        [*title.split(": "), *(estimate_text(row.get(column)) for column in columns)]
        for title, row in rows.items()
    ]
    result = ["scene", "by", *columns], table
    write_table(options.result, line, result, seed=options.seed, runs=options.seeds or 1)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run or compare."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    commands = parser.add_subparsers(required=True)
    command = commands.add_parser("run")
    command.add_argument("--only", nargs="+", choices=PARTS)
    command.add_argument("--data", type=Path, help="folder of the real data")
    command.add_argument("--seeds", type=int, default=0, help="of each scene; 0: the part's number")
    command.add_argument("--seed", type=int, default=1, help="the first")
    command.add_argument("--images", type=int, default=0, help="of a run; 0: the scene's number")
    command.add_argument(
        "--kalman", nargs="*", default=KALMAN, help="rules, with extent, process noise, misses"
    )
    command.add_argument("--poses", nargs="+", choices=at.POSES, default=["exact"])
    command.add_argument("--workers", type=int, default=2)
    command.add_argument("--json", type=Path)
    add_result_file(command)
    command.set_defaults(run=measured)
    add_compare(commands)
    options = parser.parse_args(arguments)
    options.run(options)


if __name__ == "__main__":
    main()
