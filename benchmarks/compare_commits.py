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
"""Compare the processor time of a ping or an image in two source trees, with default options.

    git worktree add --detach ../before <commit>
    python benchmarks/compare_commits.py ../before . [--runs 5] [--scenes 9 254 image-256x500]

Both trees run at once, a process each, and take the same scans or images in turn: the load of the
machine falls on both. The first two fifths are not counted. A ratio above 1 says that the second
tree is faster: of the medians of a run, the median run and its spread. The longest time is of all
scans, the first ones too, the median run. Then follows the ratio of the mean times, scans between
those that count included. The last column counts only scans after which both hold as many tracks,
published or not: who holds more has more to do. With one tree, its times alone.

Scenes are named by their mean number of detections; `empty` counts the pings without a detection
of a sonar that holds ten tracks, one in five, since what is learned in batches of four pings would
fall on each of four or on none, and `tsepm` is the published method, as published. Images are
float32, of a sonar at rest and of one that moves at 0.5 m/s and turns.
"""

from __future__ import annotations

import argparse
import itertools
import os
import pickle
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

Scans = Iterator[dict[str, Any]]
"""Arguments of the scans or images of a scene."""
SONAR = {"range_std": 0.2, "range_std_fraction": 0.0, "azimuth_std": 0.01, "max_range": 100.0}
PUBLISHED: Mapping[str, Any] = {
    "max_speed": 10.0, "min_hits": 5, "window": 8, "limit_speed": "off",
    "clutter_density": "given", "detection_probability": "given",
}  # fmt: skip
"""Options of `tsepm` as published."""
DISC = np.pi * 9000.0**2
"""Coverage of the calm and of the dense scenes, m^2."""
LARGEST = 600_000
"""Cells of an image above which fewer images are taken."""


@dataclass(frozen=True)
class Pings:
    """Detections of targets, and clutter all round.

    Attributes
    ----------
    targets : int
    clutter : float
        Mean number of false detections of a ping.
    interval : float
        Time between pings, s.
    number : int
        Of pings.
    sensor : dict
        Fields of the `SensorModel` that are given.
    empty : int, optional
        Every so manieth ping is empty, and these alone count; 0: none.
    method : str, optional
    """

    targets: int
    clutter: float
    interval: float
    number: int
    sensor: dict[str, float]
    empty: int = 0
    method: str = "score"

    def drawn(self, seed: int) -> Scans:
        """Arguments of each `Scan`."""
        rng = np.random.default_rng(seed)
        reach = self.sensor.get("max_range", 9000.0)
        error = self.sensor.get("range_std", 0.015 * reach / 3.0), 0.01
        place = rng.uniform(-0.6 * reach, 0.6 * reach, (self.targets, 2))
        velocity = rng.uniform(-0.01 * reach, 0.01 * reach, (self.targets, 2))
        velocity /= max(self.interval, 1.0)
        for k in range(self.number):
            # Targets go to and fro, so that they stay in the coverage.
            swing = abs((k * self.interval / 20.0 + 1.0) % 4.0 - 2.0) * 20.0
            x, y = (place + swing * velocity)[rng.random(self.targets) < 0.9].T
            count = rng.poisson(self.clutter)
            noise = rng.normal(0.0, error, (len(x), 2)).T
            far = reach * np.sqrt(rng.uniform(1e-4, 1.0, count))
            range_ = np.append(far, np.maximum(np.hypot(x, y) + noise[0], 0.01 * reach))
            round_ = rng.uniform(-np.pi, np.pi, count)
            scan = {"range": range_, "azimuth": np.append(round_, np.arctan2(y, x) + noise[1])}
            if self.empty and k % self.empty == self.empty - 1:
                scan = {name: values[:0] for name, values in scan.items()}
            yield {"stamp": 1.0 + k * self.interval} | scan

    def counted(self) -> slice:
        """Of the pings, those whose time counts."""
        first = self.number * 2 // 5
        if self.empty:
            return slice(first + self.empty - 1 - first % self.empty, None, self.empty)
        return slice(first, None)

    def process(self) -> tuple[Callable[[dict[str, Any]], Any], Callable[[], int]]:
        """What takes a scan's arguments, and what tells the number of tracks held."""
        import tsepm_ros

        sensor = tsepm_ros.SensorModel(**self.sensor)
        options: Mapping[str, Any] = {}
        if self.method == "tsepm":  # as published
            options = PUBLISHED
            sensor = tsepm_ros.SensorModel(clutter_density=self.clutter / DISC)
        tracker = tsepm_ros.make_initiator(self.method, sensor=sensor, **options)

        def held() -> int:
            maintenance = tracker.maintenance
            names = ("confirmed", "held", "_held")  # of now and of older trees
            tracks = (getattr(maintenance, name, None) for name in names)
            return next((len(one) for one in tracks if one is not None), 0)

        return lambda ping: tracker.process(tsepm_ros.Scan(**ping)), held


@dataclass(frozen=True)
class Images:
    """Images of speckle over a ground, and a target.

    Attributes
    ----------
    beams, ranges : int
    moves : bool, optional
        Whether the sonar moves and turns, with poses.
    """

    beams: int
    ranges: int
    moves: bool = False

    @property
    def number(self) -> int:
        """Of images."""
        return 30 if self.beams * self.ranges > LARGEST else 60

    def drawn(self, seed: int) -> Scans:
        """Arguments of each `SonarImage`."""
        rng = np.random.default_rng(seed)
        range_ = 1.0 + 40.0 * (np.arange(self.ranges) + 0.5) / self.ranges
        azimuth = 1.1 * (2.0 * (np.arange(self.beams) + 0.5) / self.beams - 1.0)
        ground = np.exp(0.4 * rng.standard_normal((self.beams, self.ranges)))
        speckle = rng.rayleigh(1.0, (8, self.beams, self.ranges)) * ground
        for k in range(self.number):
            intensity = speckle[k % 8].astype(np.float32)
            row, column = self.beams // 2, (self.ranges // 3 + k) % self.ranges
            intensity[row : row + 3, column : column + 5] *= 6.0
            image = {"stamp": 0.1 * k, "range": range_, "azimuth": azimuth, "intensity": intensity}
            if self.moves:
                image["sensor_pose"] = np.array([0.05 * k, 0.0, 0.01 * k])
            yield image

    def counted(self) -> slice:
        """Of the images, those whose time counts."""
        return slice(self.number * 2 // 5, None)

    def process(self) -> tuple[Callable[[dict[str, Any]], Any], Callable[[], int]]:
        """What takes an image's arguments, and a number of tracks, which is always 0."""
        import tsepm_ros

        detector = tsepm_ros.make_detector()
        return lambda image: detector.process(tsepm_ros.SonarImage(**image)), lambda: 0


SCENES: dict[str, Pings | Images] = {
    "1": Pings(1, 0.1, 0.5, 160, SONAR),
    "9": Pings(2, 7.2, 0.5, 160, SONAR),
    "9-calm-12s": Pings(0, 9.0, 12.0, 160, {}),
    "25-2Hz": Pings(10, 16.0, 0.5, 160, SONAR),
    "25-10Hz": Pings(10, 16.0, 0.1, 200, SONAR),
    "254": Pings(1, 254.0, 12.0, 60, {}),
    "1272": Pings(1, 1272.0, 12.0, 32, {}),
    "empty": Pings(10, 16.0, 0.5, 240, SONAR, empty=5),
    "tsepm-1e-6": Pings(1, 1e-6 * DISC, 12.0, 40, {}, method="tsepm"),
    "tsepm-3e-6": Pings(1, 3e-6 * DISC, 12.0, 32, {}, method="tsepm"),
    "tsepm-5e-6": Pings(1, 5e-6 * DISC, 12.0, 24, {}, method="tsepm"),
} | {
    f"image-{beams}x{ranges}{'-moving' * moves}": Images(beams, ranges, moves)
    for (beams, ranges), moves in itertools.product(
        ((128, 400), (256, 500), (512, 1000), (1024, 2000)), (False, True)
    )
}


def serve() -> None:
    """Take a scene and turns from the standard input; write the time of each, s, and tracks."""
    with os.fdopen(os.dup(1), "w") as out:
        os.dup2(2, 1)  # what the package prints is no answer
        name, seed = pickle.load(sys.stdin.buffer)
        process, held = SCENES[name].process()
        for arguments in SCENES[name].drawn(seed):
            pickle.load(sys.stdin.buffer)  # its turn
            begin = time.process_time()
            process(arguments)
            print(time.process_time() - begin, held(), file=out, flush=True)


def run(name: str, seed: int, trees: Sequence[Path]) -> np.ndarray:
    """Time of each scan and tracks held after it, (n, trees, 2)."""
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

        def tell(side: subprocess.Popen[bytes], what: Any) -> None:
            assert side.stdin
            pickle.dump(what, side.stdin)
            side.stdin.flush()

        for side in sides:
            tell(side, (name, seed))
        rows = np.zeros((SCENES[name].number, len(trees), 2))
        for k, row in enumerate(rows):
            for i in range(len(trees))[:: 1 if k % 2 else -1]:
                tell(sides[i], None)
                answer = sides[i].stdout
                assert answer
                row[i] = [float(word) for word in answer.readline().split()]
        return rows


def line(name: str, runs: Sequence[np.ndarray]) -> str:
    """The row of a scene."""
    every = np.concatenate([rows[SCENES[name].counted()] for rows in runs])
    typical = 1e3 * np.median(every[..., 0], axis=0)
    longest = 1e3 * np.median([rows[..., 0].max(axis=0) for rows in runs], axis=0)
    times = "".join(f"{one:10.2f}" for one in (*typical, *longest))
    if len(typical) == 1:
        return f"{name:>22}{times}"
    ratios = [float(np.median(one[:, 0, 0] / one[:, 1, 0]))
              for one in (rows[SCENES[name].counted()] for rows in runs)]  # fmt: skip
    same = every[every[:, 0, 1] == every[:, 1, 1], :, 0]
    means = np.mean([rows[len(rows) * 2 // 5 :, :, 0].mean(axis=0) for rows in runs], axis=0)
    return (
        f"{name:>22}{times} {np.median(ratios):7.3f} ({min(ratios):.3f} .. {max(ratios):.3f}) "
        f"{means[0] / means[1]:7.3f} "
        f"{np.median(same[:, 0] / same[:, 1]):8.3f} ({len(same) / len(every):.0%})"
    )


def main() -> None:
    """Print a row for each scene."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("trees", nargs="*", type=Path, default=[Path()], help="before and after")
    parser.add_argument("--runs", type=int, default=3, help="for each scene, of a seed each")
    parser.add_argument("--scenes", nargs="+", choices=SCENES, default=list(SCENES))
    parser.add_argument("--serve", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.serve:
        serve()
        return
    print(f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors; times in ms")
    if len(given.trees) == 1:
        print(f"{'scene':>22}      time   longest")
    else:
        print(f"{'scene':>22}    before     after  longest before, after   ratio (least .. largest)"
              " of means where as many are held")  # fmt: skip
    for name in given.scenes:
        print(line(name, [run(name, seed, given.trees) for seed in range(given.runs)]), flush=True)


if __name__ == "__main__":
    main()
