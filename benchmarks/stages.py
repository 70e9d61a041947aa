"""Where the time of a scan goes: the functions that a method calls, at each clutter density.

Processor time by cProfile; a function's time includes that of what it calls.

    python benchmarks/stages.py [--densities 1e-6 5e-6 1e-5] [--scans 32] [--evaluation NAME]
"""

from __future__ import annotations

import argparse
import cProfile
import pstats
import re
import time

import fixed_threads  # noqa: F401  # before numpy
from scenes import make_scene

from tsepm_ros import Scan, make_initiator

CALLERS = re.compile("tsepm_ros/(initiation|methods)/")
LEAST = 0.005
"""Share of the time below which a function is not shown."""


def profile(method: str, density: float, scans: int, **options: str) -> None:
    """Run one scene and print the functions' shares of the mean scan."""
    scene = make_scene(density, scans, 1)
    initiator = make_initiator(method, sensor=scene.sea.sensor(), **options)
    profiler = cProfile.Profile(time.process_time)
    profiler.enable()
    for scan in scene.scans:
        initiator.process(Scan(scan.stamp, scan.range, scan.azimuth))
    profiler.disable()
    stats = pstats.Stats(profiler)
    raw = initiator.totals.raw_confirmations / scans
    total = stats.total_tt
    print(
        f"\n{density:g} per m^2: {1e3 * total / scans:.2f} ms a scan, {raw:.0f} raw confirmations"
    )
    for (file, _, name), (*_, callers) in sorted(stats.stats.items(), key=lambda item: -item[1][3]):
        ours = sum(times[3] for caller, times in callers.items() if CALLERS.search(caller[0]))
        if ours >= LEAST * total and "tsepm_ros" in file:
            where = file.rpartition("tsepm_ros/")[2].removesuffix(".py")
            print(f"  {where + ' ' + name:52s} {1e3 * ours / scans:8.3f} ms {ours / total:6.1%}")


def main() -> None:
    """Profile each density."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--method", default="tsepm")
    parser.add_argument("--densities", type=float, nargs="+", default=[2.5e-7, 1e-6, 5e-6, 1e-5])
    parser.add_argument("--scans", type=int, default=32)
    parser.add_argument("--evaluation", help="of the method tsepm")
    given = parser.parse_args()
    options = {"evaluation": given.evaluation} if given.evaluation else {}
    for density in given.densities:
        profile(given.method, density, given.scans, **options)


if __name__ == "__main__":
    main()
