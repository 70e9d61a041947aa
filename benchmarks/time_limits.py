"""Processor time of a scan under `max_scan_time` at the worst inputs, of every method.

- place: detections about one place, from all in the same place to 200 m apart;
- reach: detections over the whole coverage with a `max_speed` so large that every gate holds all.

The longest of the scans of each input, and what the limits cut.

    python benchmarks/time_limits.py [--limit 1.0] [--scans 6] [--method score ...]
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Iterator

import fixed_threads  # noqa: F401  # before numpy
import numpy as np

from tsepm_ros import Scan, SensorModel, make_initiator
from tsepm_ros.methods.registry import available_methods
from tsepm_ros.tools.terminal import markdown_table

PLACES = [(number, spread) for number in (300, 1000, 2000) for spread in (0.0, 5.0, 20.0, 200.0)]
"""Numbers of detections, and their standard deviation about the place on each axis, m."""
RANGE = 3000.0
"""Of the place, m."""
REACHES = (8, 300, 3000)
"""Numbers of detections over the whole coverage."""
SPEED, MAX_SPEED = 10.0, 1e4
"""`max_speed` of both, m/s."""
PERIOD = 12.0
"""Time from scan to scan, s."""


def about_a_place(number: int, spread: float, scans: int) -> Iterator[Scan]:
    """Scans of detections about one place."""
    rng = np.random.default_rng(1)
    for index in range(scans):
        along, across = spread * rng.standard_normal((2, number))
        yield Scan(PERIOD * index, np.abs(RANGE + along), across / RANGE)


def anywhere(number: int, scans: int) -> Iterator[Scan]:
    """Scans of detections over the whole coverage."""
    rng = np.random.default_rng(1)
    for index in range(scans):
        range_ = SensorModel().max_range * np.sqrt(rng.uniform(1e-6, 1.0, number))
        yield Scan(PERIOD * index, range_, rng.uniform(-math.pi, math.pi, number))


def longest(
    method: str, scans: Iterator[Scan], limit: float, max_speed: float
) -> tuple[float, int]:
    """Longest processor time of a scan, s, and the hypotheses and tracks that limits cut."""
    initiator = make_initiator(method, sensor=SensorModel(), max_speed=max_speed)
    initiator.max_scan_time = limit
    seconds = []
    for scan in scans:
        begin = time.process_time()
        initiator.process(scan)
        seconds.append(time.process_time() - begin)
    totals = initiator.totals
    return max(seconds), totals.cut_potential_tracks + totals.cut_confirmations


def rows(methods: list[str], limit: float, scans: int) -> Iterator[list[str]]:
    """A row for each method: its longest scan, and of which input."""
    for method in methods:
        found = []
        for number, spread in PLACES:
            given = about_a_place(number, spread, scans)
            name = f"{number} detections, {spread:g} m"
            found.append((*longest(method, given, limit, SPEED), name))
        for number in REACHES:
            given = anywhere(number, scans)
            found.append(
                (*longest(method, given, limit, MAX_SPEED), f"{number}, {MAX_SPEED:g} m/s")
            )
        seconds, cut, name = max(found)
        yield [f"`{method}`", f"{seconds:.2f} s", name, str(cut)]


def main() -> None:
    """Measure, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--limit", type=float, default=1.0, help="max_scan_time, s")
    parser.add_argument("--scans", type=int, default=6, help="of each input")
    parser.add_argument("--method", nargs="+", default=list(available_methods()))
    options = parser.parse_args()
    head = ["method", "longest scan", "of which input", "cut in all its scans"]
    print(markdown_table(head, list(rows(options.method, options.limit, options.scans))))


if __name__ == "__main__":
    main()
