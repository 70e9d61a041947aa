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
"""A sonar of which nothing is given: one swimmer, and clutter whose density nobody counted.

A forward-looking sonar (120 degrees, 300 m, a ping a second, 0.5 m and 1 degree, P_D 0.9) sees a
swimmer at 1 m/s on a straight course, 100 to 190 m away at first. Its detections go as messages
through a session with default settings, as in the node with only the topic remapped, and beside
it with exact figures. Printed: tracks in two minutes, and the ping of the first right one.

    python benchmarks/out_of_the_box.py [--runs 20] [--clutter 0.2 2 20 200]
"""

from __future__ import annotations

import argparse
import math
import os
from collections.abc import Iterator
from dataclasses import dataclass, replace

os.environ["OMP_NUM_THREADS"] = "1"
os.environ["OPENBLAS_NUM_THREADS"] = "1"

import numpy as np
from numpy.typing import NDArray
from result_tables import printed, write_table

from msg_adapters import make_header, write_detections
from msg_adapters.message_input import MessageInput
from tsepm_ros import Scan, SensorModel
from tsepm_ros.session.session import Session
from tsepm_ros.settings.node_options import InitiatorNodeOptions
from tsepm_ros.settings.settings import Settings
from tsepm_ros.tools.evaluation.result_files import add_result_file
from tsepm_ros.tools.terminal import terminal_progress
from tsepm_ros.tracker.options import CommonOptions

MAX_RANGE, HALF_SECTOR = 300.0, math.radians(60.0)
AREA = HALF_SECTOR * MAX_RANGE**2
RANGE_STD, AZIMUTH_STD, DETECTION_PROBABILITY = 0.5, math.radians(1.0), 0.9
SPEED = 1.0
CLOUD, LASER = "sensor_msgs/msg/PointCloud2", "sensor_msgs/msg/LaserScan"
MAX_LASER_CLUTTER = 20.0
"""False detections a ping that the rays of a LaserScan can hold."""
MAX_ERROR = 15.0
"""Distance from the swimmer up to which a new track is right: three standard deviations."""


@dataclass(frozen=True)
class Ping:
    """A scan, and where the swimmer is, (2,) m; nan outside the sector."""

    scan: Scan
    swimmer: NDArray[np.float64]


def pings(seed: int, clutter: float, number: int) -> Iterator[Ping]:
    """Draw the pings of a run."""
    rng = np.random.default_rng([seed, 12])
    distance, bearing = rng.uniform(100.0, 190.0), 0.7 * HALF_SECTOR * rng.uniform(-1.0, 1.0)
    heading = rng.uniform(-np.pi, np.pi)
    start = distance * np.array([math.cos(bearing), math.sin(bearing)])
    velocity = SPEED * np.array([math.cos(heading), math.sin(heading)])
    for stamp in range(number):
        place = start + stamp * velocity
        false = rng.poisson(clutter)
        range_ = MAX_RANGE * np.sqrt(rng.random(false))
        azimuth = rng.uniform(-HALF_SECTOR, HALF_SECTOR, false)
        r, a = math.hypot(*place), math.atan2(place[1], place[0])
        seen = r < MAX_RANGE and abs(a) < HALF_SECTOR
        errors, detected = rng.standard_normal(2), rng.random() < DETECTION_PROBABILITY
        if seen and detected:
            range_ = np.append(range_, r + RANGE_STD * errors[0])
            azimuth = np.append(azimuth, a + AZIMUTH_STD * errors[1])
        order = rng.permutation(len(range_))
        scan = Scan(float(stamp) + 1.0, np.maximum(range_[order], 0.1), azimuth[order])
        yield Ping(scan, place if seen else np.full(2, np.nan))


def exact(clutter: float) -> Settings:
    """Settings with the true figures."""
    sensor = SensorModel(
        range_std=RANGE_STD,
        range_std_fraction=0.0,
        azimuth_std=AZIMUTH_STD,
        max_range=MAX_RANGE,
        azimuth_min=-HALF_SECTOR,
        azimuth_max=HALF_SECTOR,
        detection_probability=DETECTION_PROBABILITY,
        clutter_density=max(clutter, 1e-3) / AREA,
    )
    common = CommonOptions(clutter_density="given", detection_probability="given")
    return replace(Settings(), sensor=sensor, common=common)


@dataclass(frozen=True)
class Run:
    """Tracks of a run: their number, the ping of the first right one (from 1), and the wrong."""

    tracks: int
    first: float
    wrong: int


def run(settings: Settings, scans: list[Ping], type_name: str) -> Run:
    """Process a run's messages as the node does."""
    session = Session(settings)
    arriving = MessageInput(session, InitiatorNodeOptions())
    tracks, first, wrong = 0, math.inf, 0
    for number, ping in enumerate(scans, 1):
        header = make_header(round(ping.scan.stamp * 1e9), "sonar")
        arriving.take_detections(
            write_detections(type_name, header, ping.scan, sound_speed=0.0), ping.scan.stamp
        )
        for result in session.process():
            for track in result.new:
                tracks += 1
                right = math.dist(track.state[0::2], ping.swimmer) < MAX_ERROR
                first = min(first, number) if right else first
                wrong += not right
    return Run(tracks, first, wrong)


def row(clutter: float, name: str, runs: list[Run]) -> list[str]:
    """A row of the table."""
    tracks = [one.tracks for one in runs]
    first = [one.first for one in runs]
    return [
        f"{clutter:g}",
        name,
        f"{np.mean(tracks):.2f}, at most {max(tracks)}",
        f"{np.median(first):g}, {np.quantile(first, 0.9, method='higher'):g}, {max(first):g}",
        str(sum(one.wrong for one in runs)),
    ]


def table(options: argparse.Namespace) -> Iterator[list[str]]:
    """Header and rows."""
    head = ["false a ping", "given, message", "tracks", "ping of the first right track"]
    yield [*head, "wrong"]
    for clutter in options.clutter:
        seeds = range(options.seed, options.seed + options.runs)
        scenes = [list(pings(seed, clutter, options.pings)) for seed in seeds]
        for name, settings, type_name in (
            ("exact figures, PointCloud2", exact(clutter), CLOUD),
            ("nothing, PointCloud2", Settings(), CLOUD),
            ("nothing, LaserScan", Settings(), LASER),
        ):
            if type_name == LASER and clutter > MAX_LASER_CLUTTER:
                continue
            shown = terminal_progress(scenes, len(scenes), f"{clutter:g} a ping, {name}")
            yield row(clutter, name, [run(settings, scene, type_name) for scene in shown])


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--pings", type=int, default=120)
    parser.add_argument("--clutter", type=float, nargs="+", default=[0.2, 2.0, 20.0, 200.0])
    add_result_file(parser)
    options = parser.parse_args()
    print(f"{options.runs} runs from seed {options.seed}, {options.pings} pings")
    clutter = " ".join(f"{value:g}" for value in options.clutter)
    line = f"python benchmarks/out_of_the_box.py --runs {options.runs} --clutter {clutter}"
    measured = printed(table(options))
    write_table(options.result, line, measured, seed=options.seed, runs=options.runs)


if __name__ == "__main__":
    main()
