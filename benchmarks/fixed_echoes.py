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
"""Tracks on a quay with `min_speed`, measured.

Tracks published on a quay, whose echoes are piles that are seen seldom or random glints, in the
first minute and in the next four, and how a swimmer along it, 30 m off, is held.

    python benchmarks/fixed_echoes.py quay [--runs 20]
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterable
from dataclasses import replace

os.environ["OMP_NUM_THREADS"] = "1"
os.environ["OPENBLAS_NUM_THREADS"] = "1"

import numpy as np
from fixed_echoes_scenes import Scene, Target, piles

from tsepm_ros import make_initiator
from tsepm_ros.tools.terminal import terminal_progress
from tsepm_ros.tracker.scan import scan_of_rows

MIN_SPEED, MAX_SPEED = 0.3, 10.0
NEAR = 15.0
"""Distance within which a track is the swimmer's, m."""
LEARNING, ENTERS = 60, 180
"""Quay: pings of the first minute, and the ping at which the swimmer enters."""


def seeds(args: argparse.Namespace) -> Iterable[int]:
    """Seeds of the runs, with progress on a terminal."""
    return terminal_progress(range(args.seed, args.seed + args.runs), args.runs, "runs")


def run_quay(args: argparse.Namespace) -> None:
    """Print how many tracks a quay gives, and what becomes of a swimmer in front of it."""
    plain = Scene(false=5.0, pings=300)
    kinds = {
        "piles": plain,
        "glints": replace(plain, glints=12.0),
        "piles, sonar at 0.2 m/s": replace(plain, speed=0.2),
    }
    for name, kind in kinds.items():
        early, late, delay, held, on = np.array([quay_run(kind, s, args) for s in seeds(args)]).T
        print(
            f"{name}: {early.mean():.2f} tracks a run in the first minute, {late.mean():.2f} in "
            f"the next four; swimmer held from ping {np.median(delay):.0f} on in "
            f"{held.mean():.3f} of the pings; clusters on in {on.sum():.0f} of {args.runs}",
            flush=True,
        )


def quay_run(kind: Scene, seed: int, args: argparse.Namespace) -> tuple[int, int, int, float, bool]:
    """A quay, and a swimmer along it.

    Returns
    -------
    early, late : int
        Tracks elsewhere than at the swimmer, in the first `LEARNING` pings and later.
    delay : int
        Pings from the swimmer's first to a track near it.
    held : float
        Share of the pings from then on with a track near it.
    clusters_on : bool
        Whether clusters were made at the end.
    """
    rng = np.random.default_rng([seed, 20])
    swims = Target((120.0 - 0.3 * 60.0, -57.0), (0.3, 0.95), ENTERS)
    places = [] if kind.glints else piles(rng)
    scene = replace(kind, targets=[*places, swims])
    initiator = make_initiator(
        args.method,
        sensor=scene.sensor,
        max_speed=MAX_SPEED,
        min_speed=MIN_SPEED,
        clutter_density=args.density,
    )
    elsewhere, near = [], []
    for number, ping in enumerate(scene.draw(rng)):
        scan, place = ping.scan, ping.truth[-1]
        present = number >= ENTERS
        if not present:
            scan = scan_of_rows(scan, np.flatnonzero(ping.origin != len(places)))
        away = [np.hypot(*(place - track.position)) for track in initiator.process(scan)]
        elsewhere += [number for distance in away if not (present and distance < NEAR)]
        tracks = initiator.current.sure.state[:, 0::2]
        near.append(bool(np.hypot(*(tracks - place).T).min(initial=np.inf) < 5.0))
    early = sum(number < LEARNING for number in elsewhere)
    first = near.index(True, ENTERS) if True in near[ENTERS:] else kind.pings
    held = float(np.mean(near[first:])) if first < kind.pings else 0.0
    return (
        early,
        len(elsewhere) - early,
        first - ENTERS,
        held,
        initiator.sensor.extended_targets.active,
    )


def main() -> None:
    """Run a part."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("part", choices=["quay"])
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--method", default="score")
    parser.add_argument("--density", default="estimated")
    run_quay(parser.parse_args())


if __name__ == "__main__":
    main()
