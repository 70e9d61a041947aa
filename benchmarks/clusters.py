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
"""Clusters, measured: what a learned extent does to targets of several echoes, and the paper's box.

- swimmers: starts, when, and NEES, for 3 and for 3 to 5 echoes, spread over 1 m and 3 m, with
  errors common to a ping and independent ones, beside one echo; 95 % intervals;
- two: two swimmers apart;
- vessels: starts and tracks of a vessel at 3 m/s with 3 to 8 highlights a ping along its extent;
- pool: swimmers held around a fast imaging sonar, by their echoes and the false detections;
- box: the largest likelihood ratio over the pings of the paper's box, uniform and lumpy, and
  whether clusters were ever made.

    python benchmarks/clusters.py swimmers [--runs 20] [--pings 40] [--density given|estimated]
                                        [--sensor given|unknown]
    python benchmarks/clusters.py pool [--runs 20] [--pings 240] [--swimmers 5] [--enter 0]
    python benchmarks/clusters.py box [--pings 2000]
"""

from __future__ import annotations

import argparse
import math
import os
from collections.abc import Iterable
from dataclasses import dataclass, replace

os.environ["OMP_NUM_THREADS"] = "1"
os.environ["OPENBLAS_NUM_THREADS"] = "1"

import numpy as np
from clusters_scenes import Pool, Swimmers, box

from tsepm_ros import SensorModel, make_initiator
from tsepm_ros.tools.terminal import terminal_progress
from tsepm_ros.tracker.clusters.extended_targets import LOG_RATIO

MAX_SPEED = 5.0
POOL_SPEED = 3.0
"""Of the method in the pool, m/s."""
KINDS = ("uniform", "smooth", "rough", "blocks")


@dataclass(frozen=True)
class Start:
    """A start: its ping (from 1), its target (-1: none), and its NEES."""

    ping: int
    target: int
    nees: float


@dataclass(frozen=True)
class Run:
    """A run: the ping from which clusters are made, the starts, and the tracks held at its end."""

    on: float
    starts: list[Start]
    held: int

    def after_on(self) -> list[Start]:
        """Starts from then on."""
        return [start for start in self.starts if start.ping >= self.on]


def seeds_of(options: argparse.Namespace) -> Iterable[int]:
    """Seeds of the runs, with progress on a terminal."""
    first, number = options.seed, options.runs
    return terminal_progress(range(first, first + number), number, "runs")


def run(
    scene: Swimmers, seed: int, density: str = "given", sensor: str = "given", **options: object
) -> Run:
    """Run the default method on a scene, its sensor given, or unknown."""
    model = scene.sensor if sensor == "given" else SensorModel()
    if density == "estimated":
        model = replace(model, clutter_density=1e-6)
    initiator = make_initiator(
        "score", sensor=model, max_speed=MAX_SPEED, clutter_density=density, **options
    )
    on, starts, origins = math.inf, [], []
    for number, ping in enumerate(scene.draw(seed), 1):
        origins.append(ping.origin)
        for track in initiator.process(ping.scan):
            own = [origins[scan][row] for scan, row in track.hits]
            target = max(range(len(ping.truth)), key=own.count)
            if 2 * own.count(target) <= len(own):
                starts.append(Start(number, -1, math.nan))
                continue
            error = track.state - ping.truth[target]
            nees = float(error @ np.linalg.solve(track.covariance, error))
            starts.append(Start(number, target, nees))
        if initiator.sensor.extended_targets.active:
            on = min(on, number)
    return Run(on, starts, len(initiator.current.sure))


def mean_nees(runs: list[Run]) -> str:
    """Mean NEES of the targets' first starts, with its interval."""
    values = [start.nees for one in runs for start in one.starts[:1] if math.isfinite(start.nees)]
    if len(values) < 2:
        return "-"
    half = 1.96 * np.std(values, ddof=1) / math.sqrt(len(values))
    return f"{np.mean(values):.2f} +- {half:.2f} ({len(values)})"


def first(one: Run, target: int = 0) -> float:
    """Ping of the first start of a target."""
    return min((start.ping for start in one.starts if start.target == target), default=math.inf)


def lateness(one: Run, single: Run) -> float:
    """Pings by which a target is started later than with one echo."""
    return first(one) - first(single)


def swimmers(options: argparse.Namespace) -> None:
    """Print the table of swimmers."""
    plain = Swimmers(echoes=(1, 1), pings=options.pings, false=options.false)
    known_of = options.density, options.sensor
    single = [run(plain, seed, *known_of) for seed in seeds_of(options)]
    # Pings with one echo: as if clusters were on from the start.
    known = [replace(one, on=0.0) for one in single]
    print(
        f"{options.runs} runs of {options.pings} pings, {options.false:g} false detections a ping"
    )
    print(
        "| echoes | spread | errors | on (median, last) | starts | after on | false | late | NEES |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    row("1", "-", "-", single, known, single)
    for echoes in ((3, 3), (3, 5)):
        for spread in (1.0, 3.0):
            for common in (True, False):
                scene = replace(plain, echoes=echoes, spread=spread, common=common)
                runs = [run(scene, seed, *known_of) for seed in seeds_of(options)]
                name = "-".join(map(str, sorted(set(echoes))))
                kind = "common" if common else "independent"
                row(name, f"{spread:g} m", kind, runs, runs, single)


def row(
    echoes: str, spread: str, errors: str, runs: list[Run], judged: list[Run], single: list[Run]
) -> None:
    """Print a row of the table of swimmers."""
    on = [one.on for one in runs]
    starts = [sum(start.target == 0 for start in one.starts) for one in runs]
    after = [sum(start.target == 0 for start in one.after_on()) for one in judged]
    false = sum(start.target < 0 for one in runs for start in one.starts)
    late = [lateness(one, alone) for one, alone in zip(judged, single, strict=True)]
    print(
        f"| {echoes} | {spread} | {errors} | {np.median(on):g}, {max(on):g} "
        f"| {np.mean(starts):.2f}, at most {max(starts)} | {np.mean(after):.2f}, at most "
        f"{max(after)} | {false} | {np.mean(late):.2f}, at most {max(late):g} "
        f"| {mean_nees(judged)} |",
        flush=True,
    )


def two(options: argparse.Namespace) -> None:
    """Print how many of two swimmers are held, by how far they are apart."""
    print("| apart | spread | errors | both started | held at the end |\n|---|---|---|---|---|")
    for apart in (10.0, 20.0, 40.0):
        for spread, common in ((1.0, True), (3.0, True), (3.0, False)):
            scene = Swimmers(spread=spread, common=common, apart=(apart, 0.0), pings=options.pings)
            runs = [run(scene, seed, options.density, options.sensor) for seed in seeds_of(options)]
            both = np.mean([math.isfinite(max(first(one, 0), first(one, 1))) for one in runs])
            held = sorted(one.held for one in runs)
            kind = "common" if common else "independent"
            print(f"| {apart:g} m | {spread:g} m | {kind} | {both:.2f} | {held} |", flush=True)


def vessels(options: argparse.Namespace) -> None:
    """Print how many tracks a vessel starts, by the length of its extent."""
    print("| extent | on (median, last) | first start (median, last) | starts | held at the end |")
    print("|---|---|---|---|---|")
    for size in (20.0, 40.0, 60.0):
        scene = Swimmers(
            echoes=(3, 8), extent=size, speed=3.0, false=options.false, pings=options.pings
        )
        runs = [run(scene, seed, options.density, options.sensor) for seed in seeds_of(options)]
        on, begin = [one.on for one in runs], [first(one) for one in runs]
        starts = [len(one.starts) for one in runs]
        held = [one.held for one in runs]
        print(
            f"| {size:g} m | {np.median(on):g}, {max(on):g} | {np.median(begin):g}, {max(begin):g} "
            f"| {np.mean(starts):.2f}, at most {max(starts)} "
            f"| {np.mean(held):.2f}, at most {max(held)} |",
            flush=True,
        )


@dataclass(frozen=True)
class Watched:
    """What is held in the second half of a run in the pool, on average over its pings.

    Attributes
    ----------
    held : float
        Share of the swimmers with a track within 1.5 m.
    elsewhere : float
        Tracks more than 3 m from every swimmer.
    clusters : bool
        Whether clusters are made in the end.
    on : float
        Pings from the swimmers' first to the one from which on clusters are made.
    starts : int
        Of the run, elsewhere too.
    """

    held: float
    elsewhere: float
    clusters: bool
    on: float
    starts: int


def watched(scene: Pool, seed: int, **options: object) -> Watched:
    """Run the default method in the pool, with the density learned."""
    initiator = make_initiator("score", sensor=scene.sensor, max_speed=POOL_SPEED, **options)
    held, elsewhere, starts, on = [], [], 0, math.inf
    for number, ping in enumerate(scene.draw(seed)):
        starts += len(initiator.process(ping.scan))
        if initiator.sensor.extended_targets.active:
            on = min(on, number + 1 - scene.enter)
        if 2 * number < scene.pings:
            continue
        apart = ping.truth[:, None, 0::2] - initiator.current.sure.state[:, 0::2]
        distance = np.hypot(apart[..., 0], apart[..., 1])
        held.append(np.mean(distance.min(axis=1, initial=np.inf) < 1.5))
        elsewhere.append(np.sum(distance.min(axis=0, initial=np.inf) > 3.0))
    active = initiator.sensor.extended_targets.active
    return Watched(float(np.mean(held)), float(np.mean(elsewhere)), active, on, starts)


def pool(options: argparse.Namespace) -> None:
    """Print how many swimmers in the pool are held, by their echoes and the false detections."""
    print(
        "| echoes | false detections | with clusters | after pings | starts "
        "| held: mean, least | tracks elsewhere |"
    )
    print("|---|---|---|---|---|---|---|")
    for echoes in (1, 2, 3):
        for false in (4.0, 16.0, 50.0, 100.0):
            scene = Pool(options.swimmers, echoes, false, options.pings, options.enter)
            runs = [watched(scene, seed) for seed in seeds_of(options)]
            held, on = [one.held for one in runs], [one.on for one in runs if one.clusters]
            after = f"{np.mean(on):.1f}" if on else "-"
            print(
                f"| {echoes} | {false:g} | {len(on)} of {len(runs)} | {after} "
                f"| {np.mean([one.starts for one in runs]):.2f} "
                f"| {np.mean(held):.3f}, {min(held):.2f} "
                f"| {np.mean([one.elsewhere for one in runs]):.2f} |",
                flush=True,
            )


def paper_box(options: argparse.Namespace) -> None:
    """Print the largest likelihood ratios, and whether clusters were made."""
    for kind in options.kinds:
        initiator = make_initiator("score", sensor=SensorModel(), clutter_density="estimated")
        made, tracks, largest = False, 0, 0.0
        for scan in box(kind, options.pings, options.seed + 1):
            tracks += len(initiator.process(scan))
            made |= initiator.sensor.extended_targets.active
            largest = max(largest, initiator.sensor.extended_targets.test.log_ratio)
        print(
            f"{kind}: {options.pings} pings, {tracks} tracks, clusters: {made}; "
            f"largest log likelihood ratio {largest:.2f}, that of clusters {LOG_RATIO:.2f}",
            flush=True,
        )


def main() -> None:
    """Print what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    jobs = {"swimmers": swimmers, "two": two, "vessels": vessels, "pool": pool, "box": paper_box}
    parser.add_argument("job", choices=jobs)
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--density", choices=("given", "estimated"), default="given")
    parser.add_argument("--sensor", choices=("given", "unknown"), default="given")
    parser.add_argument("--false", type=float, default=20.0)
    parser.add_argument("--pings", type=int)
    parser.add_argument("--swimmers", type=int, default=5, help="in the pool")
    parser.add_argument("--enter", type=int, default=0, help="ping at which they do")
    parser.add_argument("--kinds", nargs="+", default=KINDS)
    options = parser.parse_args()
    options.pings = options.pings or {"box": 2000, "pool": 240}.get(options.job, 40)
    jobs[options.job](options)


if __name__ == "__main__":
    main()
