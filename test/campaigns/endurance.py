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
"""Hundreds of thousands of scans of `score` in one process: memory and time per scan.

Caches and clocks are shared: on a busy machine only memory is judged (--busy). This campaign is one
case: an interrupted call begins again.
"""

import argparse
import os
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import campaign  # noqa: F401 - the package as it is here
import numpy as np

from tsepm_ros import Scan, SensorModel, available_methods, make_initiator

PERIOD = 2.0
SENSOR = SensorModel(
    range_std=5.0, range_std_fraction=0.0, azimuth_std=0.01, max_range=2000.0,
    detection_probability=0.9, clutter_density=1e-6,
)  # fmt: skip
LIFE = 60
"""Mean life of a target, scans."""
TARGETS = 2.0
"""Mean number of targets."""
MAX_GROWTH = 1.0
MAX_SLOWER = 1.05


def scans(number: int, seed: int) -> Iterator[Scan]:
    """Scans of targets that come and go, and of clutter."""
    rng = np.random.default_rng(seed)
    targets = np.empty((0, 4))
    clutter = SENSOR.clutter_density * np.pi * SENSOR.max_range**2
    for index in range(number):
        targets = targets[rng.random(len(targets)) > 1.0 / LIFE]
        for _ in range(rng.poisson(TARGETS / LIFE)):
            place, velocity = rng.uniform(-1200, 1200, 2), rng.uniform(-4, 4, 2)
            targets = np.vstack([targets, [place[0], velocity[0], place[1], velocity[1]]])
        targets[:, ::2] += PERIOD * targets[:, 1::2]
        seen = targets[rng.random(len(targets)) < SENSOR.detection_probability]
        distance = np.hypot(seen[:, 0], seen[:, 2]) + rng.normal(0, SENSOR.range_std, len(seen))
        azimuth = np.arctan2(seen[:, 2], seen[:, 0])
        azimuth = azimuth + rng.normal(0, SENSOR.azimuth_std, len(seen))
        false = rng.poisson(clutter)
        distance = np.append(distance, SENSOR.max_range * np.sqrt(rng.uniform(1e-4, 1, false)))
        azimuth = np.append(azimuth, rng.uniform(-np.pi, np.pi, false))
        kept = (distance > 1.0) & (distance < SENSOR.max_range)
        yield Scan(PERIOD * index, distance[kept], azimuth[kept])


def resident_memory() -> float:
    """Resident set of this process, MB (Linux)."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


def main(arguments: list[str] | None = None) -> int:
    """Process the scans and judge."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scans", type=int, default=300_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--method", choices=available_methods(), default="score")
    parser.add_argument("--busy", action="store_true", help="the machine has other work")
    options = parser.parse_args(arguments)
    made = make_initiator(options.method, sensor=SENSOR, max_speed=6.0)
    tenth = options.scans // 10
    memory, seconds, started = [], [], 0
    begin = time.process_time()
    for index, scan in enumerate(scans(options.scans, options.seed)):
        started += len(made.process(scan))
        if (index + 1) % tenth == 0:
            memory.append(resident_memory())
            seconds.append((time.process_time() - begin) / tenth)
            begin = time.process_time()
            figures = f"{memory[-1]:.2f} MB, {1e3 * seconds[-1]:.3f} ms a scan"
            print(f"{index + 1} scans: {figures}, {started} tracks", flush=True)
    growth, slower = memory[-1] - memory[0], seconds[-1] / seconds[1]
    print(f"endurance of {options.method}, seed {options.seed}: memory {growth:+.2f} MB")
    print(f"last tenth {slower:.3f} times the second's time")
    return int(growth > MAX_GROWTH or (slower > MAX_SLOWER and not options.busy))


if __name__ == "__main__":
    sys.exit(main())
