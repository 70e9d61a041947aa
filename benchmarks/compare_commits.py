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
"""Compare the processor time of a ping in two source trees.

    git worktree add --detach ../before <commit>
    python benchmarks/compare_commits.py ../before . [--runs 5] [--scenes 9 254]

Both trees run at once, a process each, and take the same pings in turn: the load of the machine
falls on both. Scenes are clutter with one target, or (25) with ten targets at 20 Hz, and are named
by their mean number of detections. Clutter and detection probability are learned, amplitudes are
not used. The first two fifths of the pings are not counted. A ratio above 1 says that the second
tree is faster: of the medians of a run, the median run and its spread. The last column counts only
pings after which both hold as many tracks, published or not: who holds more has more to do.
"""

from __future__ import annotations

import argparse
import os
import pickle
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

REACH, INTERVAL = 9000.0, 12.0
"""Range, m, and time between pings, s, of the scenes with one target."""
SCENES = {"9": (3.6e-8, 160), "25": (5e-4, 160), "254": (1e-6, 60), "1272": (5e-6, 32)}
"""Density of clutter, 1/m^2, and number of pings."""
LEARNED = {
    "clutter_density": "estimated",
    "detection_probability": "estimated",
    "plots": "off",
    "intensity": "off",
}


def pings(scene: str, seed: int) -> Iterator[dict[str, Any]]:
    """Arguments of the scans of a scene."""
    rng = np.random.default_rng(seed)
    density, number = SCENES[scene]
    reach, interval = (100.0, 0.05) if scene == "25" else (REACH, INTERVAL)
    place, velocity = np.array([[3000.0, 2000.0]]), np.array([[4.0, 0.0]])
    if scene == "25":
        place, velocity = rng.uniform(-60.0, 60.0, (10, 2)), rng.uniform(-1.0, 1.0, (10, 2))
    for k in range(number):
        count = rng.poisson(density * np.pi * reach**2)
        x, y = (place + k * interval * velocity)[rng.random(len(place)) < 0.9].T
        error = rng.normal(0.0, (0.2, 0.01), (len(x), 2)).T
        clutter = reach * np.sqrt(rng.uniform(1e-4, 1.0, count))
        yield {
            "stamp": 1.0 + k * interval,
            "range": np.append(clutter, np.hypot(x, y) + error[0]),
            "azimuth": np.append(rng.uniform(-np.pi, np.pi, count), np.arctan2(y, x) + error[1]),
        }


def serve() -> None:
    """Take pings from the standard input; write the time of each, s, and the tracks held."""
    with os.fdopen(os.dup(1), "w") as out:
        os.dup2(2, 1)  # what the package prints is no answer
        import tsepm_ros

        scene = pickle.load(sys.stdin.buffer)
        sensor: dict[str, Any] = {"clutter_density": SCENES[scene][0]}
        if scene == "25":
            sensor |= {"range_std": 0.2, "range_std_fraction": 0.0, "azimuth_std": 0.01}
            sensor |= {"max_range": 100.0}
        model = tsepm_ros.SensorModel(**sensor)
        tracker = tsepm_ros.make_initiator("score", sensor=model, **LEARNED)
        while (ping := pickle.load(sys.stdin.buffer)) is not None:
            scan = tsepm_ros.Scan(**ping)
            begin = time.process_time()
            tracker.process(scan)
            spent, held = time.process_time() - begin, tracker.maintenance
            names = ("confirmed", "held", "_held")  # of now and of older trees
            tracks = next(getattr(held, name) for name in names if hasattr(held, name))
            print(spent, len(tracks), file=out, flush=True)


def run(scene: str, seed: int, trees: list[Path]) -> np.ndarray:
    """Time of each ping and tracks held after it, (n, 2 trees, 2)."""
    single = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    with ExitStack() as stack:
        sides = [
            stack.enter_context(
                subprocess.Popen(
                    [sys.executable, __file__, "--serve"],
                    env={**os.environ, **single, "PYTHONPATH": str(tree.resolve())},
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                )
            )
            for tree in trees
        ]
        rows = []
        for ping in [scene, *pings(scene, seed), None]:
            row: list[Any] = [None, None]
            for i in (len(rows) % 2, 1 - len(rows) % 2):
                to, answer = sides[i].stdin, sides[i].stdout
                assert to and answer
                pickle.dump(ping, to)
                to.flush()
                row[i] = answer.readline().split() if isinstance(ping, dict) else []
            rows.append(row)
        times = np.array(rows[1:-1], float)
        return times[len(times) * 2 // 5 :]


def main() -> None:
    """Print a row for each scene."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("trees", nargs="*", type=Path, help="before and after")
    parser.add_argument("--runs", type=int, default=5, help="for each scene, of a seed each")
    parser.add_argument("--scenes", nargs="+", choices=SCENES, default=list(SCENES))
    parser.add_argument("--serve", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.serve:
        serve()
        return
    print(f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors")
    print("scene  before ms  after ms   ratio (least .. largest)   where as many are held")
    for scene in given.scenes:
        runs = [run(scene, seed, given.trees) for seed in range(given.runs)]
        ratios = [float(np.median(one[:, 0, 0] / one[:, 1, 0])) for one in runs]
        every = np.concatenate(runs)
        before, after = 1e3 * np.median(every[..., 0], axis=0)
        same = every[every[:, 0, 1] == every[:, 1, 1], :, 0]
        print(
            f"{scene:>5} {before:10.2f} {after:9.2f} {np.median(ratios):7.3f} "
            f"({min(ratios):.3f} .. {max(ratios):.3f}) {np.median(same[:, 0] / same[:, 1]):14.3f} "
            f"({len(same) / len(every):.0%})",
            flush=True,
        )


if __name__ == "__main__":
    main()
