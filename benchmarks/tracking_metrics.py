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
"""OSPA and GOSPA beside those of Stone Soup, on random sets of tracks and targets.

    pip install stonesoup
    python benchmarks/tracking_metrics.py

Each line has the largest difference over the sets, in cutoffs. The exit code is 1 if one is above
1e-6, and 0 with a sentence if Stone Soup is not installed. OSPA is compared with p = 1: for another
p Stone Soup assigns with the least sum of d in place of d^p, so that its OSPA is larger (1.9.1).
"""

from __future__ import annotations

import argparse
import datetime
import sys

import fixed_threads  # noqa: F401  # before numpy
import numpy as np

from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.tools.evaluation.tracking_metrics import gospa, ospa

TOLERANCE = 1e-6
"""Largest difference, in cutoffs."""


def stone_soup_distances(tracks: FloatArray, targets: FloatArray, cutoff: float) -> list[float]:
    """OSPA with p = 1, GOSPA with p = 2 and alpha = 2, and its squared parts, by Stone Soup."""
    from stonesoup.measures import Euclidean
    from stonesoup.metricgenerator.ospametric import GOSPAMetric, OSPAMetric
    from stonesoup.types.state import State

    time = datetime.datetime(2000, 1, 1, tzinfo=datetime.UTC)
    mine, true = (
        [State(place, timestamp=time) for place in places] for places in (tracks, targets)
    )
    plane = {"c": cutoff, "measure": Euclidean((0, 1))}
    if not mine and not true:  # not defined there
        return [0.0] * 5
    distance = OSPAMetric(p=1, **plane).compute_OSPA_distance(mine, true).value
    parts, _ = GOSPAMetric(p=2, **plane).compute_gospa_metric(mine, true)
    values = parts.value if hasattr(parts, "value") else parts
    names = ("distance", "localisation", "missed", "false")
    return [float(distance), *(float(values[name]) for name in names)]


def main() -> int:
    """Compare and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sets", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    try:
        import stonesoup
    except ImportError:
        print("left out: Stone Soup is not installed (pip install stonesoup)", file=sys.stderr)
        return 0
    rng = np.random.default_rng(options.seed)
    worst = np.zeros(5)
    for _ in range(options.sets):
        tracks, targets = (rng.uniform(0.0, 100.0, (rng.integers(0, 8), 2)) for _ in range(2))
        cutoff = float(rng.uniform(5.0, 80.0))
        parts = gospa(tracks, targets, cutoff)
        mine = [ospa(tracks, targets, cutoff, 1.0), parts.distance, *vars(parts).values()]
        theirs = stone_soup_distances(tracks, targets, cutoff)
        unit = np.array([cutoff, cutoff, *[cutoff**2] * 3])
        worst = np.maximum(worst, np.abs(np.subtract(mine, theirs)) / unit)
    print(f"Stone Soup {stonesoup.__version__}, {options.sets} sets, seed {options.seed}")
    names = ("OSPA, p = 1", "GOSPA", "localisation", "missed", "false")
    for name, difference in zip(names, worst, strict=True):
        print(f"{name:12}  largest difference {difference:.1e} of the cutoff")
    return int(worst.max() > TOLERANCE)


if __name__ == "__main__":
    raise SystemExit(main())
