"""Where the time of a scan goes: the published method's stages, at each clutter density.

python benchmarks/stages.py [--densities 1e-6 5e-6 1e-5] [--scans 32]
"""

from __future__ import annotations

import argparse
import os

os.environ["OMP_NUM_THREADS"] = "1"
os.environ["OPENBLAS_NUM_THREADS"] = "1"
os.environ["MKL_NUM_THREADS"] = "1"

import time
from collections import defaultdict
from typing import Any

import numpy as np
from scenes import make_scene

from tsepm_ros import Scan, SensorModel
from tsepm_ros.initiation.common_options import CommonOptions
from tsepm_ros.methods.tsepm.tsepm_method import Tsepm
from tsepm_ros.methods.tsepm.tsepm_options import TsepmOptions

STAGES = {
    "_receive": "convert",
    "_gate": "gate",
    "_split": "split",
    "_cut_hopeless": "cut hopeless",
    "_confirm": "M/N rule",
    "_estimate": "estimate and evaluate",
    "_prune": "prune",
    "_merge": "merge",
    "_start": "start",
    "_limit": "limit",
    "_follow": "gates of cut paths",
}
"""Methods of the initiator and what they do, in their order."""
HOLD = "hold"


def timed(initiator: Tsepm) -> dict[str, float]:
    """Make the initiator add up the processor time of each stage; returns the sums, s."""
    seconds: dict[str, float] = defaultdict(float)

    def watch(owner: object, name: str, stage: str) -> None:
        method = getattr(owner, name)

        def watched(*arguments: Any) -> Any:
            begin = time.process_time()
            try:
                return method(*arguments)
            finally:
                seconds[stage] += time.process_time() - begin

        setattr(owner, name, watched)

    for name, stage in STAGES.items():
        watch(initiator, name, stage)
    watch(initiator.hold, "step", HOLD)
    return seconds


def profile(density: float, scans: int, options: TsepmOptions) -> None:
    """Run one scene and print the stages' shares of the mean scan."""
    scene = make_scene(density, scans, 1)
    sensor = SensorModel(clutter_density=density)
    initiator = Tsepm(sensor, CommonOptions(), options)
    seconds = timed(initiator)
    begin = time.process_time()
    for scan in scene.scans:
        initiator.process(Scan(scan.stamp, scan.range, scan.azimuth))
    total = time.process_time() - begin
    seconds["convert"] -= seconds[HOLD]  # which is within it
    seconds["the rest"] = total - sum(seconds.values())
    raw = initiator.totals.raw_confirmations / scans
    print(
        f"\n{density:g} per m^2: {1e3 * total / scans:.2f} ms a scan, {raw:.0f} raw confirmations"
    )
    for stage in [HOLD, *STAGES.values(), "the rest"]:
        print(f"  {stage:22s} {1e3 * seconds[stage] / scans:8.3f} ms {seconds[stage] / total:6.1%}")


def main() -> None:
    """Profile each density."""
    parser = argparse.ArgumentParser(
        description=__doc__.splitlines()[0],
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    parser.add_argument("--densities", type=float, nargs="+", default=[2.5e-7, 1e-6, 5e-6, 1e-5])
    parser.add_argument("--scans", type=int, default=32)
    parser.add_argument("--evaluation", default="normalized_distance")
    arguments = parser.parse_args()
    print(f"evaluation: {arguments.evaluation}, numpy {np.__version__}")
    for density in arguments.densities:
        profile(density, arguments.scans, TsepmOptions(evaluation=arguments.evaluation))


if __name__ == "__main__":
    main()
