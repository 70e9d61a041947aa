"""P_D of `score` for targets whose detection probability is not as told, paired with being told.

The box's target appears after 16 pings of clutter:

- 0.6: it is detected with a probability of 0.6; told are 0.9, and 0.6;
- fades: it is detected with 0.9, and not at all in 4 pings in a row of every 16, from a random one
  on; told are 0.9, and its mean, 0.675.

All of a run has the same scenes. By the ping of the true start, P_D 8 and 16 pings after the target
appears, with 95 % intervals, and the difference of the runs to 0.95 times the P_D of being told
right. It holds if this is not below 0 with a confidence of 95 % (one-sided).

    python benchmarks/fading_targets.py [--runs 300] [--seed 1] [--workers 2]
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import fixed_threads  # noqa: F401
import numpy as np

from tsepm_ros import Scan, make_initiator
from tsepm_ros.tools.commands.arguments import add_runs, workers_of
from tsepm_ros.tools.evaluation.intervals import mean, proportion
from tsepm_ros.tools.evaluation.result_files import add_result, printed, write_table
from tsepm_ros.tools.evaluation.simulated_run import Outcome, SimulatedScene
from tsepm_ros.tools.simulation import load_scenario
from tsepm_ros.tools.terminal import with_progress

WARM_UP = 16
"""Pings of clutter alone before the target appears."""
HORIZONS = (8, 16)
"""Pings after which P_D counts."""
EVERY, FADED = 16, 4
"""Pings from fade to fade, and of a fade."""
REQUIRED = 0.95
"""Share of the P_D of being told right that is asked for."""
ONE_SIDED_95 = 1.6448536269514722
NEVER = 10**6
"""Ping of a start that does not come."""


@dataclass(frozen=True)
class Target:
    """A target and what is told of it.

    Attributes
    ----------
    share : float
        P_D while it has not faded.
    fades : bool
    told, right : float
        P_D as told, and as it is right in the mean.
    """

    share: float
    fades: bool
    told: float
    right: float


TARGETS = {
    "P_d 0.6": Target(0.6, False, 0.9, 0.6),
    "fades for 4 of 16 pings": Target(0.9, True, 0.9, 0.9 * (EVERY - FADED) / EVERY),
}


@dataclass(frozen=True)
class Job:
    """A run: a target, its seed, and the target false-track rate per hour."""

    target: Target
    seed: list[int]
    rate: float


def run(job: Job) -> tuple[int, int]:
    """Pings from the appearance of the target to its true start, told wrongly and rightly."""
    target = job.target
    box = replace(
        load_scenario("box", {"sensor.detection_probability": target.share}), warm_up=WARM_UP
    )
    scene = SimulatedScene.drawn(box, job.seed)
    if target.fades:
        first = int(np.random.default_rng([*job.seed, 1]).integers(EVERY))
        scene = faded(scene, first)
    return found(scene, target.told, job.rate), found(scene, target.right, job.rate)


def faded(scene: SimulatedScene, first: int) -> SimulatedScene:
    """The scene without the target's detections in its fades, from the ping `first` on."""
    scans: list[Scan] = []
    origins = []
    for index, (scan, origin) in enumerate(zip(scene.scans, scene.origins, strict=True)):
        kept = np.ones(len(origin), bool)
        if (index - first) % EVERY < FADED:
            kept = origin < 0
        scans.append(replace(scan, range=scan.range[kept], azimuth=scan.azimuth[kept]))
        origins.append(origin[kept])
    return replace(scene, scans=scans, origins=origins)


def found(scene: SimulatedScene, told: float, rate: float) -> int:
    """Pings from the appearance of the target to its true start."""
    sensor = replace(scene.scenario.sensor, detection_probability=told)
    initiator = make_initiator("score", sensor=sensor, false_tracks_per_hour=rate)
    tracks = []
    for index, scan in enumerate(scene.scans):
        new = initiator.process(scan)
        tracks += list(new)
        if len(new) and any(one.outcome is Outcome.TRUE for one in scene.judge(tracks)):
            return index + 1 - WARM_UP
    return NEVER


def table(options: argparse.Namespace) -> Iterator[Sequence[str]]:
    """P_D of both, and whether the asked share of it holds."""
    yield (
        "target",
        "target rate",
        "pings",
        "P_D, told 0.9",
        "P_D, told right",
        f"told 0.9 less {REQUIRED} of told right",
        "verdict",
    )
    for name, target in TARGETS.items():
        for rate in options.rate or [10.0]:
            jobs = [Job(target, [options.seed, index], rate) for index in range(options.runs)]
            pings = np.array(list(with_progress(options.workers.mapped(run, jobs), len(jobs))))
            for horizon in HORIZONS:
                yield [name, f"{rate:g}/h", str(horizon), *compared(pings <= horizon)]


def compared(seen: np.ndarray) -> list[str]:
    """Cells of both P_D, the difference, and the verdict, of pairs of runs (n, 2)."""
    shares = [proportion(int(column.sum()), len(seen)) for column in seen.T]
    margin = seen[:, 0] - REQUIRED * seen[:, 1]
    half = ONE_SIDED_95 * margin.std(ddof=1) / math.sqrt(len(margin))
    verdict = "cannot tell"
    if margin.mean() - half >= 0.0:
        verdict = "holds"
    elif margin.mean() + half < 0.0:
        verdict = "does not"
    return [*(f"{share:.3f}" for share in shares), f"{mean(margin):.3f}", verdict]


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    add_runs(parser, 300, "runs of a row")
    parser.add_argument(
        "--rate", type=float, action="append", help="target false-track rate, per hour; default 10"
    )
    add_result(parser)
    options = parser.parse_args(arguments)
    options.workers = workers_of(options)
    line = f"python benchmarks/fading_targets.py --runs {options.runs}"
    line += "".join(f" --rate {rate:g}" for rate in options.rate or ())
    measured = printed(table(options))
    write_table(options.result, line, measured, seed=options.seed, runs=options.runs)


if __name__ == "__main__":
    main()
