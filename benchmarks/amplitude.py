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
"""What the amplitude of echoes is worth, and whether the target false-track rate holds with it.

- detection: P_DT of the box's target 8 pings after it appears, by its signal-to-clutter ratio, and
  false + misplaced starts; the law of the clutter's amplitude is learned from the 16 pings of
  clutter alone before. All targets, and the row without amplitudes, have the same positions in a
  run. The difference is that of P_DT from the row without amplitudes at the same measured false
  rate, which lies on the line through its points at a third of the target rate, at that and at
  thrice that.
- false: false starts on clutter alone, by the law of its amplitude and the target rate.

Intervals of values are two-sided (95 %). Bounds are one-sided (95 %), of differences over paired
runs (bootstrap).

    python benchmarks/amplitude.py detection [--runs 300] [--seed 1] [--workers 2] [--result FILE]
        [--rates 10 100] [--row "0 dB" ...]
"""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Iterator, Sequence

import fixed_threads  # noqa: F401  # before numpy
import numpy as np
from amplitude_scenes import (
    BOX,
    CLUTTER,
    CLUTTER_PINGS,
    NO_AMPLITUDE,
    TARGETS,
    Change,
    Job,
    Outcomes,
    clutter_alone,
    run,
    with_target,
)
from result_tables import printed, write_table

from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.tools.commands.arguments import add_runs_arguments
from tsepm_ros.tools.evaluation.intervals import (
    RESAMPLES,
    TAILS_90,
    IntervalEstimate,
    mean_count_interval,
    mean_interval,
    proportion_interval,
)
from tsepm_ros.tools.evaluation.result_files import add_result_file, mapped_results
from tsepm_ros.tools.simulation import Scenario
from tsepm_ros.tools.terminal import terminal_progress

RATES = (1.0, 10.0, 100.0)
"""Target false-track rates, per hour."""
AROUND = (1.0 / 3.0, 1.0, 3.0)
"""Parts of a target rate at which the row without amplitudes is measured."""
MOST_FALSE = 2.0
"""Largest measured false rate that is claimed, over the target rate."""


def runs_of(
    scene: Scenario, change: Change, rate: float, options: argparse.Namespace
) -> list[Outcomes]:
    """Outcomes of the runs of a scene, in order."""
    jobs = [Job(scene, change, [options.seed, index], rate) for index in range(options.runs)]
    return list(terminal_progress(mapped_results(run, jobs, options.workers), len(jobs)))


def counted(outcomes: Sequence[Outcomes]) -> FloatArray:
    """Whether each run found the target, and its wrong starts, (2, r)."""
    return np.array([(one.found, one.wrong) for one in outcomes], float).T


def gain_at_equal_rate(found: FloatArray, plain: FloatArray) -> IntervalEstimate:
    """P_DT less that of plain runs at the same measured false rate, with one-sided 95 % bounds.

    Parameters
    ----------
    found : (2, r) ndarray
        See `counted`.
    plain : (p, 2, r) ndarray
        The same for the plain runs of the same positions, by rising target rate.
    """
    r = found.shape[1]
    rows = np.random.default_rng(0).integers(0, r, (RESAMPLES, r))
    rows = np.concatenate([np.arange(r)[None], rows])
    gains = []
    for row in rows:
        share, wrong = found[:, row].mean(axis=1)
        plain_share, plain_wrong = plain[:, :, row].mean(axis=2).T
        log_rate = np.log(np.maximum(np.append(plain_wrong, wrong), 0.5 / r))
        gains.append(share - np.interp(log_rate[-1], log_rate[:-1], plain_share))
    return IntervalEstimate(float(gains[0]), *map(float, np.quantile(gains[1:], TAILS_90)))


def detection_table(options: argparse.Namespace) -> Iterator[Sequence[str]]:
    """P_DT by the target's amplitude."""
    yield (
        "target",
        "target rate",
        "P_DT",
        "less that without amplitudes at this false rate (one-sided bounds)",
        "false + misplaced/run",
        "false + misplaced",
        "NEES of true starts",
    )
    for rate in options.rates:
        scene, change = with_target(None), TARGETS[NO_AMPLITUDE][1]
        around = [runs_of(scene, change, part * rate, options) for part in AROUND]
        plain = np.array([counted(outcomes) for outcomes in around])
        for name, (ratio, change) in TARGETS.items():
            if name not in options.row:
                continue
            known = name == NO_AMPLITUDE
            outcomes = around[1] if known else runs_of(with_target(ratio), change, rate, options)
            found = counted(outcomes)
            nees = mean_interval([value for one in outcomes for value in one.nees])
            yield (
                name,
                f"{rate:g}/h",
                f"{proportion_interval(int(found[0].sum()), options.runs):.3f}",
                "-" if known else f"{gain_at_equal_rate(found, plain):+.3f}",
                f"{mean_count_interval(found[1]):.3f}",
                f"{found[1].sum():.0f}",
                nees.text(".2f"),
            )


def verdict(bounds: IntervalEstimate, limit: float) -> str:
    """Whether a value is at most a limit, by its one-sided bounds."""
    if bounds.high <= limit:
        return "yes"
    return "no" if bounds.low > limit else "undecided"


def false_table(options: argparse.Namespace) -> Iterator[Sequence[str]]:
    """False starts on clutter alone by its law."""
    yield (
        "clutter",
        "target rate",
        "false starts",
        "over the target rate (one-sided bounds)",
        f"at most {MOST_FALSE:g}",
        "a run, more than the rate allows (one-sided bounds)",
    )
    hours = CLUTTER_PINGS * BOX.period / 3600.0
    for name, (law, change) in CLUTTER.items():
        for rate in options.rates if name in options.row else ():
            counts = [one.wrong for one in runs_of(clutter_alone(law), change, rate, options)]
            a_run, allowed = mean_count_interval(counts, TAILS_90), rate * hours
            more = a_run.mapped(lambda count, allowed=allowed: count - allowed)
            yield (
                name,
                f"{rate:g}/h",
                str(sum(counts)),
                f"{a_run / allowed:.2f}",
                verdict(a_run / allowed, MOST_FALSE),
                f"{more:.2f}",
            )


COMMANDS = {"detection": (detection_table, TARGETS), "false": (false_table, CLUTTER)}


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    commands = parser.add_subparsers(dest="command", required=True)
    for name, (_, rows) in COMMANDS.items():
        command = commands.add_parser(name)
        add_runs_arguments(command, 300, "runs of a row and rate")
        command.add_argument("--rates", type=float, nargs="+", default=RATES, help="1/h")
        command.add_argument("--row", nargs="+", choices=rows, default=list(rows), help="rows")
        add_result_file(command)
    given = list(sys.argv[1:] if arguments is None else arguments)
    options = parser.parse_args(given)
    line = f"python benchmarks/amplitude.py {shlex.join(given)}"
    table = printed(COMMANDS[options.command][0](options))
    write_table(options.result, line, table, seed=options.seed, runs=options.runs)


if __name__ == "__main__":
    main()
