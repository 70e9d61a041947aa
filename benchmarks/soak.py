"""Memory and speed over many scans in one process.

Memory: slope of the resident set over the scans after a warm-up, by regression over means of equal
blocks (neighbouring samples are not independent; far less so their blocks). Time: processor time,
which other programs disturb least, of the first and the last thousand scans; and, since a machine's
speed drifts over minutes, the last thousand scan by scan beside a fresh initiator that has seen
only the scans of a few windows.

    python benchmarks/soak.py [--scans 100000] [--detections 250]
"""

from __future__ import annotations

import argparse
import json
import os

from tsepm_ros.numerics.arrays import FloatArray

os.environ["OMP_NUM_THREADS"] = "1"
os.environ["OPENBLAS_NUM_THREADS"] = "1"
os.environ["MKL_NUM_THREADS"] = "1"

import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from contenders import RawScan, Sea, make_contender

BUILD = Path(__file__).resolve().parents[1] / "build"
NAME = "tsepm-5/8"
PART = 1000
"""Scans at the beginning and at the end that are compared."""
LEAD = 100
"""Scans before the first part, and scans that the fresh initiator sees before the comparison."""
SAMPLE_EVERY = 50
BLOCKS = 40
WARM_UP = 0.1
"""Share of the run before memory is looked at."""


@dataclass(frozen=True)
class Slope:
    """Slope of a straight line and its standard error."""

    value: float
    error: float


@dataclass(frozen=True)
class Soak:
    """What a run gave.

    Attributes
    ----------
    scans : int
    detections : float
        Mean per scan.
    first, last : float
        Median processor time of the first and the last thousand scans, s.
    first_mean, last_mean : float
        Their means, s.
    beside_fresh : tuple of float
        Time of the last thousand scans as a multiple of a fresh initiator's, scan by scan: median,
        10 % and 90 %.
    memory_start, memory_end : float
        Resident set after the warm-up and at the end, MB (means of the first and last block).
    memory_per_thousand : Slope
        MB per 1000 scans.
    """

    scans: int
    detections: float
    first: float
    last: float
    first_mean: float
    last_mean: float
    beside_fresh: tuple[float, float, float]
    memory_start: float
    memory_end: float
    memory_per_thousand: Slope


def resident_memory() -> float:
    """Resident set of this process, MB (Linux)."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


def clutter(sea: Sea, seed: int) -> Iterator[RawScan]:
    """Scans of clutter alone, without end."""
    rng = np.random.default_rng(seed)
    index = 0
    while True:
        number = rng.poisson(sea.clutter_density * sea.area)
        yield RawScan(
            stamp=index * sea.period,
            range=sea.max_range * np.sqrt(rng.uniform(1e-9, 1.0, number)),
            azimuth=rng.uniform(-np.pi, np.pi, number),
        )
        index += 1


def memory_slope(scans: FloatArray, memory: FloatArray) -> Slope:
    """Least-squares slope per 1000 scans over the means of equal blocks."""
    used = len(scans) // BLOCKS * BLOCKS
    x = scans[-used:].reshape(BLOCKS, -1).mean(axis=1) / 1000.0
    y = memory[-used:].reshape(BLOCKS, -1).mean(axis=1)
    centred = x - x.mean()
    slope = float(centred @ y / (centred @ centred))
    residual = y - y.mean() - slope * centred
    variance = residual @ residual / (BLOCKS - 2) / (centred @ centred)
    return Slope(slope, float(np.sqrt(variance)))


@dataclass(frozen=True, eq=False)
class Trace:
    """A run's measurements, per scan; made at full size beforehand, so that they do not grow.

    Attributes
    ----------
    detections : (n,) ndarray
    seconds, fresh_seconds : (n,) ndarray
        Processor time of the initiator, and of the fresh one where it ran; nan elsewhere.
    memory : (n,) ndarray
        Resident set where it was sampled, MB; nan elsewhere.
    """

    detections: FloatArray
    seconds: FloatArray
    fresh_seconds: FloatArray
    memory: FloatArray


def run(scans: int, detections: float, seed: int) -> Trace:
    """Process the scans and take time and memory."""
    sea = Sea(clutter_density=detections / Sea(clutter_density=0.0).area)
    contender, fresh = make_contender(NAME, sea), make_contender(NAME, sea)
    trace = Trace(*np.full((4, scans), np.nan))
    fresh_from = scans - PART - LEAD
    for index, scan in zip(range(scans), clutter(sea, seed), strict=False):
        trace.detections[index] = len(scan)
        pair = [(contender, trace.seconds)]
        if index >= fresh_from:
            pair.insert(index % 2, (fresh, trace.fresh_seconds))  # in turn the first
        for one, seconds in pair:
            begin = time.process_time()
            one.process(scan)
            seconds[index] = time.process_time() - begin
        if index % SAMPLE_EVERY == 0 and index < fresh_from:
            trace.memory[index] = resident_memory()
        if (index + 1) % (scans // 10) == 0:
            print(f"{index + 1} scans, {resident_memory():.1f} MB", flush=True)
    return trace


def summarise(trace: Trace) -> Soak:
    """Make the figures from the measurements."""
    scans = len(trace.seconds)
    sampled = np.flatnonzero(~np.isnan(trace.memory))
    sampled = sampled[sampled >= WARM_UP * scans]
    memory = trace.memory[sampled]
    block = len(memory) // BLOCKS
    first, last = trace.seconds[LEAD : LEAD + PART], trace.seconds[-PART:]
    low, median, high = np.percentile(last / trace.fresh_seconds[-PART:], [10, 50, 90])
    return Soak(
        scans=scans,
        detections=float(trace.detections.mean()),
        first=float(np.median(first)),
        last=float(np.median(last)),
        first_mean=float(first.mean()),
        last_mean=float(last.mean()),
        beside_fresh=(float(median), float(low), float(high)),
        memory_start=float(memory[:block].mean()),
        memory_end=float(memory[-block:].mean()),
        memory_per_thousand=memory_slope(sampled.astype(float), memory),
    )


def main() -> None:
    """Run, print and write soak.json."""
    parser = argparse.ArgumentParser(
        description=__doc__.splitlines()[0],
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    parser.add_argument("--scans", type=int, default=100_000)
    parser.add_argument("--detections", type=float, default=250.0, help="mean number per scan")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--output", type=Path, default=BUILD, help="folder for soak.json")
    options = parser.parse_args()
    least = 4 * (PART + LEAD)
    if options.scans < least:
        parser.error(f"--scans must be at least {least}")
    found = summarise(run(options.scans, options.detections, options.seed))
    slope, fresh = found.memory_per_thousand, found.beside_fresh
    print(f"{NAME}, {found.scans} scans, {found.detections:.0f} detections a scan")
    print(
        f"memory  {found.memory_start:.2f} MB after the warm-up, {found.memory_end:.2f} MB at the "
        f"end; slope {slope.value:+.5f} +- {slope.error:.5f} MB per 1000 scans"
    )
    print(
        f"cpu     first {PART}: median {1e3 * found.first:.3f} ms, mean "
        f"{1e3 * found.first_mean:.3f}; last {PART}: median {1e3 * found.last:.3f}, mean "
        f"{1e3 * found.last_mean:.3f}"
    )
    print(
        f"        last {PART} beside a fresh initiator: {fresh[0]:.3f} times its time "
        f"(10-90 %: {fresh[1]:.3f} to {fresh[2]:.3f})"
    )
    options.output.mkdir(parents=True, exist_ok=True)
    target = options.output / "soak.json"
    target.write_text(json.dumps(asdict(found), indent=1) + "\n", encoding="utf-8")
    print(f"written: {target}")


if __name__ == "__main__":
    main()
