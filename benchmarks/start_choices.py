"""Starts of `score` with other values of a constant of its start rule, in the same scenes.

The box's target appears after 16 pings of clutter. Each value is compared with the built one: P_D
after 8 and 16 pings, other starts and corrections per run, and the difference in P_D after 16 pings
over the pairs of runs, with 95 % intervals. The constants are those of `methods/score/starts.py`;
the rule that corrects starts (`revisions.py`) stays as built.

    python benchmarks/start_choices.py MAX_HELD_SHARE --value 0.3 --rate 20 --rate 100
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from unittest.mock import patch

import fixed_threads  # noqa: F401

from tsepm_ros.methods.score import confirmation
from tsepm_ros.methods.score.confirmation import MIN_HIT_PROBABILITY
from tsepm_ros.studies.reproduction.report import share_difference
from tsepm_ros.tools.commands.arguments import add_runs, workers_of
from tsepm_ros.tools.evaluation.measures import RunSummary, measures_of, summarise
from tsepm_ros.tools.evaluation.result_files import add_result, printed, write_table
from tsepm_ros.tools.evaluation.simulated_run import OperatingPoint, Outcome, simulate
from tsepm_ros.tools.simulation import Scenario, load_scenario
from tsepm_ros.tools.terminal import with_progress

CHOICES = {
    "MAX_HELD_SHARE": (0.0, 1.0),
    "MIN_PURITY_PROBABILITY": (MIN_HIT_PROBABILITY, 1.0),
    "SECOND_TARGET_MARGIN": (0.0, math.inf),
    "TARGET_BIRTH_RATE": (0.0, math.inf),
}
"""Constants of the start rule, with the least and the largest value that takes effect."""
WARM_UP = 16
"""Pings of clutter alone before the target appears."""
EARLY = 8
"""Pings after the target appears in which P_D is counted too."""
HEADER = (
    "target rate",
    "value",
    "P_D, 8 pings",
    "P_D, 16 pings",
    "difference from the built rule",
    "with corrections",
    "false + misplaced per run",
    "redundant per run",
    "corrections per run",
)


@dataclass(frozen=True)
class Job:
    """A run: a constant and its value, the target false-track rate per hour, and the seed."""

    choice: str
    value: float
    rate: float
    seed: list[int]


@cache
def box() -> Scenario:
    """The box scene after a warm-up."""
    return replace(load_scenario("box", {}), warm_up=WARM_UP)


def run(job: Job) -> RunSummary:
    """Simulate a run with the constant changed."""
    point = OperatingPoint("score", options={"false_tracks_per_hour": job.rate})
    with patch.object(confirmation, job.choice, job.value):
        return summarise(simulate(box(), job.seed, point))


def found(run: RunSummary) -> bool:
    """Whether the target has a true start."""
    return run.count(Outcome.TRUE) > 0


def cells(runs: Sequence[RunSummary], built: Sequence[RunSummary]) -> list[str]:
    """Cells of the runs with a value, beside those of the built rule."""
    early, late = measures_of(box(), runs, EARLY), measures_of(box(), runs)
    difference = share_difference([found(one) for one in runs], [found(one) for one in built])
    return [
        early.text("detection"),
        late.text("detection"),
        "" if runs is built else f"{difference:+.3f}",
        late.text("detection_corrected", interval=False),
        late.text("false_per_run"),
        f"{late.redundant_per_run:.3f}",
        late.text("corrections_per_run"),
    ]


def table(options: argparse.Namespace) -> Iterator[Sequence[str]]:
    """The values, the built rule's first, at each rate."""
    yield HEADER
    as_built = float(getattr(confirmation, options.choice))
    values = [as_built, *(v for v in options.value if not math.isclose(v, as_built, rel_tol=1e-5))]
    for rate in options.rate or [20.0]:
        jobs = [
            Job(options.choice, value, rate, [options.seed, index])
            for value in values
            for index in range(options.runs)
        ]
        runs = list(with_progress(options.workers.mapped(run, jobs), len(jobs)))
        of_value = [
            runs[first : first + options.runs] for first in range(0, len(runs), options.runs)
        ]
        for value, some in zip(values, of_value, strict=True):
            name = f"{value:g}" + (", as built" if value == as_built else "")
            yield [f"{rate:g}/h", name, *cells(some, of_value[0])]


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("choice", choices=CHOICES, help="constant of the start rule")
    parser.add_argument(
        "--value",
        type=float,
        action="append",
        default=[],
        help="beside the built one; a margin is a natural logarithm",
    )
    parser.add_argument(
        "--rate", type=float, action="append", help="target false-track rate, per hour; default 20"
    )
    add_runs(parser, 300, "runs of a row")
    add_result(parser)
    options = parser.parse_args(arguments)
    least, largest = CHOICES[options.choice]
    for value in options.value:
        if not least <= value <= largest:
            parser.error(f"{options.choice} must be from {least:g} to {largest:g}; got {value:g}")
    options.workers = workers_of(options)
    line = f"python benchmarks/start_choices.py {options.choice}"
    line += "".join(f" --value {value:g}" for value in options.value)
    line += "".join(f" --rate {rate:g}" for rate in options.rate or ())
    line += f" --runs {options.runs} --seed {options.seed}"
    measured = printed(table(options))
    write_table(options.result, line, measured, seed=options.seed, runs=options.runs)


if __name__ == "__main__":
    main()
