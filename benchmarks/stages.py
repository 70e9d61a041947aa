"""Profile of a scan: time and number of the calls of the functions that a method calls.

Processor time by cProfile; a function's time includes that of its callees. The number of array
operations is that of arithmetic, comparisons and subscripts in the package's own code, and of
calls, Python's and numpy's; for small pings these cost more than the numbers.

    python benchmarks/stages.py [--densities 1e-6 5e-6 1e-5] [--scans 32] [--evaluation NAME]
    python benchmarks/stages.py --method score --densities 3.6e-8 --scans 120
"""

from __future__ import annotations

import argparse
import cProfile
import dis
import pstats
import re
import sys
import time
from collections.abc import Callable
from types import FrameType

import fixed_threads  # noqa: F401  # before numpy
from scenes import make_scene

from tsepm_ros import Scan, make_initiator
from tsepm_ros.tracker.tracker import Tracker

CALLERS = re.compile("tsepm_ros/(initiation|methods)/")
MIN_SHARE = 0.005
"""Minimum share of the time for a function to be shown."""


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
    initiator.reset()
    operations = _operations(initiator, [Scan(s.stamp, s.range, s.azimuth) for s in scene.scans])
    raw = initiator.totals.raw_confirmations / scans
    total = stats.total_tt
    print(
        f"\n{density:g} per m^2: {1e3 * total / scans:.2f} ms a scan, {raw:.0f} raw confirmations, "
        f"{stats.total_calls / scans:.0f} calls, {operations:.0f} operations in the package's code"
    )
    for (file, _, name), (*_, callers) in sorted(stats.stats.items(), key=lambda item: -item[1][3]):
        own = sum(times[3] for caller, times in callers.items() if CALLERS.search(caller[0]))
        if own >= MIN_SHARE * total and "tsepm_ros" in file:
            where = file.rpartition("tsepm_ros/")[2].removesuffix(".py")
            calls = sum(times[0] for caller, times in callers.items() if CALLERS.search(caller[0]))
            print(
                f"  {where + ' ' + name:52s} {1e3 * own / scans:8.3f} ms {own / total:6.1%} "
                f"{calls / scans:7.1f} calls"
            )


def _operations(initiator: Tracker, scans: list[Scan]) -> float:
    """Arithmetic, comparisons and subscripts in the package's code, for the last scan."""
    for scan in scans[:-1]:
        initiator.process(scan)
    count = 0

    def trace(frame: FrameType, event: str, _: object) -> Callable[..., object] | None:
        nonlocal count
        if "tsepm_ros" not in frame.f_code.co_filename:
            return None
        frame.f_trace_opcodes, frame.f_trace_lines = True, False
        if event == "opcode":
            name = dis.opname[frame.f_code.co_code[frame.f_lasti]]
            count += name.startswith(("BINARY", "COMPARE", "UNARY", "STORE_SUBSCR"))
        return trace

    sys.settrace(trace)
    initiator.process(scans[-1])
    sys.settrace(None)
    return float(count)


def main() -> None:
    """Profile each density."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--method", default="tsepm")
    parser.add_argument("--densities", type=float, nargs="+", default=[2.5e-7, 1e-6, 5e-6, 1e-5])
    parser.add_argument("--scans", type=int, default=32)
    parser.add_argument("--evaluation", help="of the method tsepm")
    arguments = parser.parse_args()
    options = {"evaluation": arguments.evaluation} if arguments.evaluation else {}
    for density in arguments.densities:
        profile(arguments.method, density, arguments.scans, **options)


if __name__ == "__main__":
    main()
