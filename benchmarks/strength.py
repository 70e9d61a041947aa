"""What the strength of echoes is worth, and whether the target false-track rate holds with it.

- detection: P_D of the box's target 8 pings after it appears, and false + misplaced starts an hour,
  by its signal-to-clutter ratio; the law of the clutter's strength is learned from the pings of
  clutter alone before it. All ratios, and the row without strengths, have the same positions.
- false: false starts per hour on clutter alone, by the law of its strength.

With 95 % intervals. The differences are those of paired runs.

    python benchmarks/strength.py detection [--runs 200] [--seed 1] [--workers 2]
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import fixed_threads  # noqa: F401
import numpy as np

from tsepm_ros import Scan, make_initiator
from tsepm_ros.analysis.intervals import Estimate, mean, mean_count, proportion
from tsepm_ros.analysis.simulated_run import judge_starts
from tsepm_ros.analysis.truth import Outcome
from tsepm_ros.analysis.workers import with_progress
from tsepm_ros.commands.arguments import add_runs, workers_of
from tsepm_ros.simulation import Scenario, Simulator, load_scenario
from tsepm_ros.simulation.strengths import ClutterStrength, TargetStrength

BOX = load_scenario("box")
WARM_UP = 16
"""Pings of clutter alone before the target appears."""
PINGS = 8
"""Pings within which it is to be found."""
CLUTTER_PINGS = 60
"""Pings of a run of clutter alone."""
RATES = (1.0, 10.0)
"""Target false-track rates, per hour."""
RATIOS: dict[str, float | None] = {
    "no strength": None,
    **{f"{ratio:g} dB": ratio for ratio in (0.0, 3.0, 6.0, 10.0)},
}
GAIN_AT = 30
"""Ping from which the gain is 20 dB higher, in the runs of that name."""

Change = Callable[[np.ndarray, Scan, int], np.ndarray]
"""The strengths as a sensor gives them, from those simulated, the scan and its index."""


def as_drawn(strength: np.ndarray, scan: Scan, index: int) -> np.ndarray:
    """The strengths as they are drawn."""
    return strength


def of_8_bits(strength: np.ndarray, scan: Scan, index: int) -> np.ndarray:
    """Steps of a twentieth of the mean, up to 255."""
    return np.clip(np.floor(20.0 * strength) + 1.0, 1.0, 255.0)


def with_a_step(strength: np.ndarray, scan: Scan, index: int) -> np.ndarray:
    """10 dB more beyond 7 km."""
    return np.where(scan.range > 7000.0, 10.0 * strength, strength)


def with_a_gain(strength: np.ndarray, scan: Scan, index: int) -> np.ndarray:
    """20 dB more from `GAIN_AT` on."""
    return 100.0 * strength if index >= GAIN_AT else strength


def all_equal(strength: np.ndarray, scan: Scan, index: int) -> np.ndarray:
    """One value for all."""
    return np.full(len(strength), 7.0)


def falling(strength: np.ndarray, scan: Scan, index: int) -> np.ndarray:
    """Of targets and clutter alike, with the fourth power of the range."""
    return strength * (5000.0 / scan.range) ** 4


CLUTTER: dict[str, tuple[ClutterStrength | None, Change]] = {
    "no strength": (None, as_drawn),
    "Rayleigh": (ClutterStrength(), as_drawn),
    "K, shape 0.5": (ClutterStrength("k", 0.5), as_drawn),
    "K, texture of 500 m and 3 min": (ClutterStrength("k", 0.5, 500.0, 180.0), as_drawn),
    "log-normal": (ClutterStrength("log_normal", 1.0), as_drawn),
    "8 bits": (ClutterStrength(), of_8_bits),
    "step of 10 dB at 7 km": (ClutterStrength(), with_a_step),
    "gain of 20 dB in the middle": (ClutterStrength(), with_a_gain),
}
"""Laws of the strength of clutter, and what the sensor makes of it."""
TARGETS: dict[str, tuple[float | None, Change]] = {
    **{name: (ratio, as_drawn) for name, ratio in RATIOS.items()},
    "all equal": (0.0, all_equal),
    "as clutter, both falling with range": (-30.0, falling),
}
"""Ratios of the target, dB, and what the sensor makes of its echoes."""


@dataclass(frozen=True)
class Job:
    """A run.

    Attributes
    ----------
    scene : Scenario
    change : callable
    seed : list of int
    rate : float
        Target false-track rate, per hour.
    appears : int
        Scan from which on the target is there.
    """

    scene: Scenario
    change: Change
    seed: list[int]
    rate: float
    appears: int


@dataclass(frozen=True)
class Outcomes:
    """Counts of a run: whether the target was found, and false and misplaced starts."""

    found: bool
    wrong: int


def run(job: Job) -> Outcomes:
    """Run `score` on a scene."""
    simulator = Simulator(job.scene, job.seed)
    initiator = make_initiator("score", sensor=job.scene.sensor, false_tracks_per_hour=job.rate)
    tracks, origins = [], []
    for index, simulated in enumerate(simulator):
        scan, kept = simulated.scan, (simulated.origin < 0) | (index >= job.appears)
        features = {}
        if job.scene.clutter_strength is not None:
            features["intensity"] = job.change(scan.features["intensity"], scan, index)[kept]
        scan = replace(scan, range=scan.range[kept], azimuth=scan.azimuth[kept], features=features)
        tracks += list(initiator.process(scan))
        origins.append(simulated.origin[kept])
    outcomes = [judged.outcome for judged in judge_starts(simulator, tracks, origins)]
    return Outcomes(
        found=Outcome.TRUE in outcomes,
        wrong=sum(outcome in (Outcome.FALSE, Outcome.MISPLACED) for outcome in outcomes),
    )


def box_with(ratio_db: float | None) -> Scenario:
    """The box; its target, once it appears, is where the scenario has it at the start."""
    state = BOX.targets[0].copy()
    state[0::2] -= WARM_UP * BOX.period * state[1::2]
    scene = replace(BOX, scans=WARM_UP + PINGS, targets=(state,))
    if ratio_db is None:
        return scene
    return replace(
        scene,
        clutter_strength=ClutterStrength(),
        target_strengths=(TargetStrength(ratio_db),),
    )


def runs_of(jobs: Sequence[Job], options: argparse.Namespace) -> list[Outcomes]:
    """Outcomes of runs, in order."""
    return list(with_progress(options.workers.mapped(run, jobs), len(jobs)))


def per_hour(counts: Sequence[int], pings: int) -> Estimate:
    """Rate of events in runs of so many pings."""
    hours = pings * BOX.period / 3600.0
    return mean_count(counts).mapped(lambda count: count / hours)


def detection_table(options: argparse.Namespace) -> Iterator[Sequence[str]]:
    """P_D by the target's ratio."""
    yield "target", "target rate", "P_D", "P_D less that without strengths", "false + misplaced/h"
    for rate in RATES:
        plain: list[Outcomes] = []
        for name, (ratio, change) in TARGETS.items():
            jobs = [
                Job(box_with(ratio), change, [options.seed, index], rate, WARM_UP)
                for index in range(options.runs)
            ]
            found = runs_of(jobs, options)
            plain = plain or found
            gain = [float(a.found) - float(b.found) for a, b in zip(found, plain, strict=True)]
            share = proportion(sum(one.found for one in found), len(found))
            false = per_hour([one.wrong for one in found], WARM_UP + PINGS)
            yield name, f"{rate:g}/h", f"{share:.3f}", f"{mean(gain):.3f}", f"{false:.2g}"


def false_table(options: argparse.Namespace) -> Iterator[Sequence[str]]:
    """False starts on clutter alone by its law."""
    yield "clutter", *(f"false/h at {rate:g}/h" for rate in RATES)
    for name, (law, change) in CLUTTER.items():
        scene = replace(BOX, scans=CLUTTER_PINGS, targets=(), clutter_strength=law)
        cells = []
        for rate in RATES:
            jobs = [
                Job(scene, change, [options.seed, index], rate, CLUTTER_PINGS)
                for index in range(options.runs)
            ]
            counts = [one.wrong for one in runs_of(jobs, options)]
            cells.append(f"{per_hour(counts, CLUTTER_PINGS):.2g}")
        yield name, *cells


COMMANDS = {"detection": detection_table, "false": false_table}


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    commands = parser.add_subparsers(dest="command", required=True)
    for name in COMMANDS:
        add_runs(commands.add_parser(name), 200, "runs of a row and rate")
    options = parser.parse_args(arguments)
    options.workers = workers_of(options)
    for index, cells in enumerate(COMMANDS[options.command](options)):
        print(f"| {' | '.join(cells)} |", flush=True)
        if not index:
            print("|---" * len(cells) + "|", flush=True)


if __name__ == "__main__":
    main()
