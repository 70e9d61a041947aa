"""Memory and speed over many scans in one process.

Memory: slope of the resident set over the scans after a warm-up, by regression over means of equal
blocks, since neighbouring samples depend on each other. Time: processor time of the first and the
last thousand scans. A machine's speed drifts over minutes, so the last thousand scans are also
compared, scan by scan, with a fresh initiator that has processed only a few windows.

    python benchmarks/soak.py [--scans 100000] [--detections 250]
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import fixed_threads
import numpy as np
from contenders import RawScan, Sea, make_contender
from scipy.stats import linregress

from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.whole_files import write_text

NAME = "tsepm-5/8"
PART = 1000
"""Number of scans compared at the beginning and at the end."""
LEAD = 100
"""Scans before the first part, and scans of the fresh initiator before the comparison."""
MIN_SCANS = 4 * (PART + LEAD)
SAMPLE_EVERY = 50
BLOCKS = 40
WARM_UP = 0.1
"""Share of the run before memory is measured."""


def resident_memory() -> float:
    """Resident set of this process, MB (Linux)."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


def clutter(sea: Sea, seed: int) -> Iterator[RawScan]:
    """Scans of clutter alone, without end."""
    rng = np.random.default_rng(seed)
    for index in itertools.count():
        number = rng.poisson(sea.clutter_density * sea.area)
        yield RawScan(
            stamp=index * sea.period,
            range=sea.max_range * np.sqrt(rng.uniform(1e-9, 1.0, number)),
            azimuth=rng.uniform(-np.pi, np.pi, number),
        )


def run(
    scans: int, mean: float, seed: int
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Process the scans and take time and memory.

    Returns detections, processor time (s), that of the fresh initiator, and the resident set (MB),
    (scans,) each, nan where not taken; made at full size beforehand, so that they do not grow.
    """
    sea = Sea(clutter_density=mean / Sea(clutter_density=0.0).area)
    contender, fresh = make_contender(NAME, sea), make_contender(NAME, sea)
    detections, own_seconds, fresh_seconds, memory = np.full((4, scans), np.nan)
    fresh_from = scans - PART - LEAD
    for index, scan in zip(range(scans), clutter(sea, seed), strict=False):
        detections[index] = len(scan)
        pair = [(contender, own_seconds)]
        if index >= fresh_from:
            pair.insert(index % 2, (fresh, fresh_seconds))  # alternating order
        for initiator, seconds in pair:
            begin = time.process_time()
            initiator.process(scan)
            seconds[index] = time.process_time() - begin
        if index % SAMPLE_EVERY == 0 and index < fresh_from:
            memory[index] = resident_memory()
        if (index + 1) % (scans // 10) == 0:
            print(f"{index + 1} scans, {resident_memory():.1f} MB", flush=True)
    return detections, own_seconds, fresh_seconds, memory


def summarise(
    detections: FloatArray, seconds: FloatArray, fresh_seconds: FloatArray, memory: FloatArray
) -> dict[str, Any]:
    """Times in s, memory in MB (means of the first and last block), its slope per 1000 scans."""
    scans = len(seconds)
    sampled = np.flatnonzero(~np.isnan(memory))
    sampled = sampled[sampled >= WARM_UP * scans]
    used = sampled[-(len(sampled) // BLOCKS * BLOCKS) :].reshape(BLOCKS, -1)
    fit = linregress(used.mean(axis=1) / 1000.0, memory[used].mean(axis=1))
    block = used.shape[1]
    first, last = seconds[LEAD : LEAD + PART], seconds[-PART:]
    low, median, high = np.percentile(last / fresh_seconds[-PART:], [10, 50, 90])
    return {
        "scans": scans,
        "detections": float(detections.mean()),
        "first": float(np.median(first)),
        "last": float(np.median(last)),
        "first_mean": float(first.mean()),
        "last_mean": float(last.mean()),
        "beside_fresh": (float(median), float(low), float(high)),
        "memory_start": float(memory[sampled[:block]].mean()),
        "memory_end": float(memory[sampled[-block:]].mean()),
        "memory_per_thousand": {"value": float(fit.slope), "error": float(fit.stderr)},
    }


def main() -> None:
    """Run, print and write soak.json."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scans", type=int, default=100_000)
    parser.add_argument("--detections", type=float, default=250.0, help="mean number per scan")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--output", type=Path, default=fixed_threads.BUILD, help="of soak.json")
    options = parser.parse_args()
    if options.scans < MIN_SCANS:
        parser.error(f"--scans must be at least {MIN_SCANS}")
    soak = summarise(*run(options.scans, options.detections, options.seed))
    slope, fresh = soak["memory_per_thousand"], soak["beside_fresh"]
    times = {name: 1e3 * soak[name] for name in ("first", "first_mean", "last", "last_mean")}
    print(
        f"{NAME}, {soak['scans']} scans, {soak['detections']:.0f} detections a scan\n"
        f"memory  {soak['memory_start']:.2f} MB after the warm-up, {soak['memory_end']:.2f} MB at "
        f"the end; slope {slope['value']:+.5f} +- {slope['error']:.5f} MB per 1000 scans\n"
        f"cpu     first {PART}: median {times['first']:.3f} ms, mean {times['first_mean']:.3f}; "
        f"last {PART}: median {times['last']:.3f}, mean {times['last_mean']:.3f}\n"
        f"        last {PART} beside a fresh initiator: {fresh[0]:.3f} times its time "
        f"(10-90 %: {fresh[1]:.3f} to {fresh[2]:.3f})"
    )
    options.output.mkdir(parents=True, exist_ok=True)
    target = options.output / "soak.json"
    write_text(target, json.dumps(soak, indent=1) + "\n")
    print(f"written: {target}")


if __name__ == "__main__":
    main()
