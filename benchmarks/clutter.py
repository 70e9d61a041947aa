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
"""Time per scan, memory and counts against clutter density, of the package, the oracle and peers.

All contenders process the same scans in turn, each in its own process with one thread.
Prints tables and writes clutter.json.

    python benchmarks/clutter.py [--densities calm 1e-6 5e-6] [--contenders tsepm-5/8 norfair-5]
"""

from __future__ import annotations

import argparse
from pathlib import Path

import fixed_threads  # noqa: F401  # before numpy
from clutter_figures import Timing, theory_of
from clutter_report import agreement_text, as_json, environment, growth_text, timing_text
from contenders import CONTENDERS
from fixed_threads import BUILD
from peer_timing import time_peers
from scenes import DENSITIES, calm_density, make_scene

from tsepm_ros.whole_files import write_whole_text

CALM = "calm"


def density_of(name: str) -> float:
    """Clutter density of a name, 1/m^2."""
    return calm_density() if name == CALM else float(name)


def parse() -> argparse.Namespace:
    """Read the command line."""
    shown = argparse.ArgumentDefaultsHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0], formatter_class=shown)
    text = "clutter per scan and m^2, or calm: 10 detections a scan"
    names = [CALM, *(f"{density:g}" for density in DENSITIES)]
    parser.add_argument("--densities", nargs="+", default=names, help=text)
    parser.add_argument("--contenders", nargs="+", choices=CONTENDERS, default=[*CONTENDERS])
    parser.add_argument("--scans", type=int, default=32, help="scans per density")
    parser.add_argument("--seed", type=int, default=1)
    text = "scans per turn of a contender; 1: cold caches, more: warm caches"
    parser.add_argument("--block", type=int, default=1, help=text)
    parser.add_argument("--scan-limit", type=float, default=60.0, help="limit of a scan's time, s")
    parser.add_argument("--total-limit", type=float, default=120.0, help="limit of all scans, s")
    parser.add_argument("--output", type=Path, default=BUILD, help="folder for the JSON")
    options = parser.parse_args()
    if options.scans < 2 or options.block < 1:
        parser.error("--scans must be at least 2 and --block at least 1")
    # In the usual notation, ascending: 0.000001 becomes 1e-06.
    names = {density_of(name): name for name in options.densities}
    options.densities = [
        name if name == CALM else f"{density:g}" for density, name in sorted(names.items())
    ]
    return options


def main() -> None:
    """Time, print and write."""
    options = parse()
    print(" ".join(f"{name} {value}," for name, value in environment().items()).rstrip(","))
    timings = []
    for name in options.densities:
        scene = make_scene(density_of(name), options.scans, options.seed)
        limits = (options.scan_limit, options.total_limit)
        peers = time_peers(scene, options.contenders, limits, options.block)
        timings.append(Timing(name, scene, peers, theory_of(scene, options.contenders)))
        print(timing_text(timings[-1]), flush=True)
    if len(timings) > 1:
        print("\n" + growth_text(timings))
    print("\n" + agreement_text(timings))
    options.output.mkdir(parents=True, exist_ok=True)
    content = as_json(timings, {key: str(value) for key, value in vars(options).items()})
    write_whole_text(options.output / "clutter.json", content + "\n")
    print(f"\nwritten: {options.output / 'clutter.json'}")


if __name__ == "__main__":
    main()
