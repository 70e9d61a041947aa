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
"""Crowds: confirmed tracks of targets close together, their starts and their ends, part by part.

    python benchmarks/crowds.py run [--only two box ...] [--runs N] [--seed 1] [--sure]
        [--json FILE]
    python benchmarks/crowds.py compare BEFORE.json AFTER.json

The source tree that is measured is the one that Python imports (`PYTHONPATH`). Values have 95 %
intervals. The file keeps the parts that a command does not run. With `--sure`, tracks count that
exist with a probability of at least a half and whose position error is below the gate.

Changes: identity switches by CLEAR-MOT. Held: share of the targets with a track of their own; all
held: share of the scans. Third: tracks within reach of a target beyond the number
of targets; elsewhere: other tracks; both a scan. Per target: tracks within reach. All of them count
from scan `SETTLED` on. Delay: scans from a target's first to its track, median.

In `groups` (20 runs, six minutes) all scans count. Found: share of the targets with a track; delay
of these, s; ids: switches a target; elsewhere: tracks a run that were never near a target; false: a
scan; GOSPA over its cutoff, which is the gate; NEES (ideal 4), and share of errors within 3 sigma.
`score` accepts 10 false tracks an hour; it has the defaults otherwise. The plain Kalman has the
errors and the process noise of the scene, four misses end its tracks.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import crowds_scenes as at
import fixed_threads  # noqa: F401  # before numpy
import numpy as np
from amplitude_scenes import BOX, TARGETS, Job, run, with_target
from clear_mot import ClearMot, Truth
from clusters_scenes import Swimmers
from fixed_echoes_scenes import Scene
from groups_scenes import GROUPS
from result_tables import PartRow, add_compare, print_part

from tsepm_ros import Scan, SensorModel, make_initiator
from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.tools.evaluation.intervals import (
    mean_count_interval,
    mean_interval,
    proportion_interval,
    quantile_interval,
)
from tsepm_ros.tools.evaluation.tracking_metrics import gospa
from tsepm_ros.tools.simulation import Simulator

SETTLED = 15
"""Scan, of a run or of a target, from which on tracks are counted."""
REACH = 1.5
"""Distance within which a track is in reach of a target, in gates."""
BOX_GATE = 370.0
"""Three errors of a detection in the middle of the box, m."""
PINGS = 8, 16
"""Pings of the box at which it is judged."""
SQUARE_OF_3_SIGMA = 11.83
"""Squared distance within which as many positions are as numbers within three errors: 99.73 %."""
TRACKERS: dict[str, dict[str, Any]] = {
    "score": {"false_tracks_per_hour": 10.0},
    "kalman 4/6": {"min_hits": 4, "window": 6, "misses": 4},
    "kalman 3/5": {"min_hits": 3, "window": 5, "misses": 4},
}
"""Methods of `groups`, with their options."""
W = TypeVar("W", bound="Watch")
Rows = Iterator[tuple[str, PartRow]]
Options = argparse.Namespace


def sure(tracks: Any, gate: float) -> Any:
    """The tracks that probably exist, with a position error of at most the gate (m)."""
    variance = np.linalg.eigvalsh(tracks.covariance[:, 0::2, 0::2])[:, 1]
    return tracks[~(tracks.existence_probability < 0.5) & (variance <= gate**2)]


@dataclass
class Watch:
    """The tracks of a run, scan by scan."""

    gate: float
    delays: dict[int, float] = field(default_factory=dict)
    near: list[int] = field(default_factory=list)
    targets: list[int] = field(default_factory=list)
    ids: list[set[int]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.clear = ClearMot(self.gate)

    def take(self, stamp: float, truth: Truth, current: Any) -> None:
        """Take a scan."""
        self.clear.take_states(truth, current)
        for target in truth:
            found = self.clear.matches[target]
            if found[-1] is not None:
                self.delays.setdefault(target, len(found) - 1)
        places = np.reshape([state[0::2] for state in truth.values()], (-1, 1, 2))
        apart = np.linalg.norm(current.state[:, 0::2] - places, axis=2)
        self.near.append(int((apart.min(axis=0, initial=math.inf) <= REACH * self.gate).sum()))
        self.targets.append(len(truth))
        self.ids.append(set(current.track_id.tolist()))

    def held(self) -> FloatArray:
        """Whether each target has a track of its own, by its scans."""
        rows = self.clear.matches.values()
        return np.array([[track is not None for track in row[SETTLED:]] for row in rows], float)

    def delay(self, target: int) -> float:
        """Scans from the target's first to its first track, or to the end of the run."""
        return self.delays.get(target, len(self.clear.matches[target]))


@dataclass
class GroupWatch(Watch):
    """The tracks of a run of `groups`: all scans and the errors count."""

    stamps: list[float] = field(default_factory=list)
    begun: dict[int, float] = field(default_factory=dict)
    found: dict[int, float] = field(default_factory=dict)
    near_ids: set[int] = field(default_factory=set)
    misses: int = 0
    false: int = 0
    gospa: list[float] = field(default_factory=list)
    squares: list[tuple[float, float]] = field(default_factory=list)

    def take(self, stamp: float, truth: Truth, current: Any) -> None:
        """Take a scan."""
        super().take(stamp, truth, current)
        self.stamps.append(stamp)
        now, tracks = self.clear.now, dict(zip(current.track_id.tolist(), current, strict=True))
        self.misses += len(truth) - len(now)
        self.false += len(current) - len(now)
        self.begun |= {target: stamp for target in truth if target not in self.begun}
        self.found |= {target: stamp for target in now if target not in self.found}
        places = np.reshape([state[0::2] for state in truth.values()], (-1, 2))
        self.gospa.append(gospa(current.state[:, 0::2], places, self.gate).distance / self.gate)
        apart = np.linalg.norm(current.state[:, 0::2] - places[:, None], axis=2)
        self.near_ids |= set(current.track_id[(apart < self.gate).any(axis=0)].tolist())
        for target, track in now.items():
            error, covariance = tracks[track].state - truth[target], tracks[track].covariance
            of_place = np.linalg.solve(covariance[0::2, 0::2], error[0::2])
            square = error @ np.linalg.solve(covariance, error), error[0::2] @ of_place
            self.squares.append(square)

    @property
    def minutes(self) -> float:
        """Time from the first scan to the last."""
        return (self.stamps[-1] - self.stamps[0]) / 60.0

    def figures(self) -> dict[str, float]:
        """What the run comes to; nan without a track of a target."""
        delays = [self.found[target] - self.begun[target] for target in self.found]
        nees, of_place = np.reshape(self.squares or [(math.nan, math.nan)], (-1, 2)).T
        return {
            "found": len(self.found) / len(self.begun),
            "delay": float(np.mean(delays)) if delays else math.nan,
            "held": 1.0 - self.misses / sum(self.targets),
            "ids": self.clear.switches / len(self.begun),
            "elsewhere": len(set().union(*self.ids) - self.near_ids),
            "false": self.false / len(self.ids),
            "GOSPA": float(np.mean(self.gospa)),
            "NEES": float(nees.mean()),
            "within 3 sigma": float((of_place < SQUARE_OF_3_SIGMA).mean()) if delays else math.nan,
        }


def watches_of(
    seen: Callable[[np.random.Generator], Iterable[tuple[Scan, Truth]]],
    gate: float,
    options: Options,
    runs: int,
    method: str = "score",
    watch_of: type[W] = Watch,
    **given: object,
) -> list[W]:
    """Run a method on the scans of each run."""
    found = []
    for index in range(options.runs or runs):
        made, watch = make_initiator(method, **given), watch_of(gate)
        for scan, truth in seen(np.random.default_rng([options.seed, index])):
            made.process(scan)
            tracks = sure(made.current, gate) if options.sure else made.current.sure
            watch.take(scan.stamp, truth, tracks)
        found.append(watch)
    return found


def harbour(
    paths: at.Paths,
    options: Options,
    runs: int,
    sensor: SensorModel = at.HARBOUR,
    gate: float = 20.0,
    **given: object,
) -> list[Watch]:
    """Runs of boats in the harbour."""
    seen = partial(at.boats, sensor, paths)
    return watches_of(seen, gate, options, runs, sensor=sensor, **given)


def crowd(watches: list[Watch]) -> PartRow:
    """The row of runs whose targets are there together."""
    held = [watch.held() for watch in watches]
    changes = [watch.clear.switches for watch in watches]
    targets = np.array([watch.targets[SETTLED:] for watch in watches])
    near = np.array([watch.near[SETTLED:] for watch in watches])
    number = np.array([[len(ids) for ids in watch.ids[SETTLED:]] for watch in watches])
    return {
        "at most one change": proportion_interval(sum(n <= 1 for n in changes), len(changes)),
        "changes a run": mean_count_interval(changes),
        "held": mean_interval([one.mean() for one in held]),
        "all held": mean_interval([one.all(axis=0).mean() for one in held]),
        "third": mean_interval(np.maximum(near - targets, 0.0).mean(axis=1)),
        "elsewhere": mean_interval((number - near).mean(axis=1)),
        "per target": mean_interval(near.sum(axis=1) / targets.sum(axis=1)),
        "delay": quantile_interval(
            [w.delay(target) for w in watches for target in w.clear.matches], 0.5
        ),
    }


def two(options: Options) -> Rows:
    """Two boats that meet and part."""
    yield "12 m apart, errors 3 m", crowd(harbour(at.together, options, 20))
    yield "12 m apart, errors 5 m", crowd(harbour(at.together, options, 20, at.ROUGH))


def three(options: Options) -> Rows:
    """Three boats."""
    yield "three boats, 15 to 30 m apart", crowd(harbour(at.abreast, options, 10))
    yield "three boats that cross", crowd(harbour(at.crossing, options, 10))


def second(options: Options) -> Rows:
    """A second boat beside one that is held."""
    fine, coarse = ("3 m", at.HARBOUR, 20.0), ("12 m", at.COARSE, 35.0)
    cases = [(apart, fine, 10.0) for apart in (25.0, 50.0, 100.0)]
    cases += [(50.0, coarse, rate) for rate in (1.0, 10.0)]
    for apart, (errors, sensor, gate), rate in cases:
        paths = at.joined(apart)
        watches = harbour(paths, options, 12, sensor, gate, false_tracks_per_hour=rate)
        delays = [watch.delay(1) for watch in watches]
        row = {"delay": quantile_interval(delays, 0.5), "90 %": quantile_interval(delays, 0.9)}
        row["at most 3"] = proportion_interval(sum(n <= 3 for n in delays), len(delays))
        row["changes a run"] = mean_count_interval([watch.clear.switches for watch in watches])
        yield f"second at {apart:g} m, errors {errors}, {rate:g}/h", row


def box(options: Options) -> Rows:
    """The box of the paper, with its target and without."""
    for rate, runs in {1.0: 60, 10.0: 60, 100.0: 40}.items():
        for name, scene in {"target": BOX, "clutter": replace(BOX, targets=())}.items():
            near, far = [], []
            for index in range(options.runs or runs):
                made = make_initiator("score", sensor=BOX.sensor, false_tracks_per_hour=rate)
                near.append([math.inf])
                far.append([])
                for ping, simulated in enumerate(Simulator(scene, [options.seed, index])):
                    for track in made.process(simulated.scan):
                        apart = [math.dist(track.position, s[0::2]) for s in simulated.truth]
                        right = min(apart, default=math.inf) <= BOX_GATE
                        (near if right else far)[-1].append(ping)
            for pings in PINGS:
                found = sum(min(starts) < pings for starts in near)
                accepted = rate * pings * BOX.period / 3600.0
                false = mean_count_interval(
                    [sum(ping < pings for ping in starts) for starts in far]
                )
                row = {"P_DT": proportion_interval(found, len(near) if scene.targets else 0)}
                row |= {"false a run": false, "over accepted": false / accepted}
                yield f"{name}, {rate:g}/h, {pings} pings, {accepted * len(far):.3g} expected", row


def ends(options: Options) -> Rows:
    """A target that vanishes."""
    for period, (sensor, speed) in at.ENDS.items():
        gate = 3.0 * max(sensor.range_std, 0.5 * sensor.max_range * sensor.azimuth_std)
        seen = partial(at.vanishing, period)
        watches = watches_of(seen, gate, options, 5, sensor=sensor, max_speed=4.0 * speed)
        own = [watch.clear.last.get(0) for watch in watches]
        shown_in = [
            [n for n, ids in enumerate(watch.ids, 1) if id_ in ids]
            for watch, id_ in zip(watches, own, strict=True)
        ]
        scans = [max(shown, default=0) - at.VANISHES for shown in shown_in]
        left = [np.mean([len(ids) for ids in watch.ids[-20:]]) for watch in watches]
        row = {"held": mean_interval([watch.held().mean() for watch in watches])}
        row |= {
            "scans to its end": quantile_interval(scans, 0.5),
            "95 %": quantile_interval(scans, 0.95),
        }
        yield f"vanishes, {period:g} s", row | {"tracks 50 scans later": mean_interval(left)}


def quay(options: Options) -> Rows:
    """A swimmer at a quay, and slow boats, with `min_speed`."""
    plain = Scene(false=5.0, pings=160)
    kinds = {"piles": (plain, at.piles), "glints": (replace(plain, glints=12.0), lambda _: [])}
    for name, (scene, fixed) in (kinds | {"moored boats": (plain, at.moored)}).items():
        seen = partial(at.at_quay, scene, fixed)
        watches = watches_of(seen, 6.0, options, 8, sensor=scene.sensor, min_speed=0.3)
        yield f"swimmer 10 m off {name}", crowd(watches)
    for speed in (1.0, 2.0):
        yield f"boat at {speed:g} m/s", crowd(harbour(at.alone(speed), options, 8, min_speed=0.5))


def several(options: Options) -> Rows:
    """Targets of several echoes."""
    one = Swimmers(pings=40)
    rows = {f"swimmer, {n} echoes": (replace(one, echoes=(n, n)), 9.0) for n in (1, 5)}
    rows["swimmer, 1 to 5 echoes"] = replace(one, echoes=(1, 5)), 9.0
    rows["vessel of 40 m"] = replace(one, echoes=(3, 8), extent=40.0, speed=3.0), 25.0
    for name, (scene, gate) in rows.items():
        seen = partial(at.swimmers, scene)
        yield name, crowd(watches_of(seen, gate, options, 6, sensor=scene.sensor, max_speed=5.0))
    given = {"sensor": at.BASIN, "max_speed": 1.5, "false_tracks_per_hour": 10.0}
    yield "five swimmers in a basin", crowd(watches_of(at.basin, 1.2, options, 6, **given))


def amplitude(options: Options) -> Rows:
    """The box with amplitudes, at 10/h."""
    for name in ("no amplitude", "0 dB", "3 dB", "6 dB", "10 dB"):
        ratio, change = TARGETS[name]
        jobs = [Job(with_target(ratio), change, [options.seed, n], 10.0) for n in range(12)]
        outcomes = [run(job) for job in jobs[: options.runs or None]]
        row = {"P_DT": proportion_interval(sum(one.found for one in outcomes), len(outcomes))}
        yield name, row | {"wrong a run": mean_count_interval([one.wrong for one in outcomes])}


def groups(options: Options) -> Rows:
    """Groups and other hard cases: `score` beside the plain Kalman."""
    for name, scene in GROUPS.items():
        for tracker, given in TRACKERS.items():
            method, own = tracker.split()[0], {"max_speed": scene.max_speed}
            if method == "kalman":
                own["process_noise"] = scene.process_noise
            seen = partial(scene.draw, scene.sensor)
            more = {"sensor": scene.sensor, **own, **given}
            watches = watches_of(seen, scene.gate, options, 20, method, GroupWatch, **more)
            table = [watch.figures() for watch in watches]
            columns = {key: np.array([row[key] for row in table]) for key in table[0]}
            row = {key: mean_interval(of[~np.isnan(of)]) for key, of in columns.items()}
            yield f"{name}, {tracker}", row


PARTS = {
    part.__name__: part
    for part in (two, second, three, box, ends, quay, several, amplitude, groups)
}


def measured(options: Options) -> None:
    """Run parts, print their tables, and write them."""
    for name in options.only:
        start = time.process_time()
        print_part(name, dict(PARTS[name](options)), options.json)
        print(f"\n{name}: {time.process_time() - start:.0f} s of processor time\n", flush=True)


def main() -> None:
    """Run or compare."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    commands = parser.add_subparsers(required=True)
    command = commands.add_parser("run")
    command.add_argument("--only", nargs="+", choices=PARTS, default=list(PARTS))
    command.add_argument("--runs", type=int, default=0, help="of each row; 0: the part's number")
    command.add_argument("--seed", type=int, default=1)
    command.add_argument("--sure", action="store_true")
    command.add_argument("--json", type=Path)
    command.set_defaults(run=measured)
    add_compare(commands)
    options = parser.parse_args()
    options.run(options)


if __name__ == "__main__":
    main()
