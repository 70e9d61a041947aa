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
"""Promised properties of the default method `score`, measured; a Markdown table each.

- false-rate: false tracks per hour over their target rate, on clutter alone over the coverage;
- starts: errors of pure starts over their Cramer-Rao bound, and NEES, on scenes of the box, with
  the speed limit and without;
- speeds: NEES of true starts by the target's speed, and over all velocities up to `max_speed`;
- equal-false-rate: `score` against `tsepm` 5/8, in P_DT at equal false + misplaced starts per run
  and in these at equal P_DT, on scenes of the box with one change, and on two corners;
- design: P_DT and false tracks predicted by `tsepm design` against those of whole scenes.

With 95 % intervals. The runs of starts, speeds and equal-false-rate are kept; interrupted studies
continue.

    python benchmarks/promises.py false-rate [--runs 40] [--seed 1] [--workers 2]
"""

from __future__ import annotations

import argparse
import math
import shlex
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import fixed_threads
import numpy as np
from equal_rates import Comparison, compare
from result_tables import printed, write_table

from tsepm_ros import SensorModel
from tsepm_ros.tools.commands.arguments import add_runs_arguments
from tsepm_ros.tools.design.prediction import (
    PredictionCase,
    first_prediction,
    predicted_false_tracks_per_hour,
    predicted_score_window,
    prediction_clutter_scans,
    prediction_statistics,
)
from tsepm_ros.tools.evaluation.intervals import IntervalEstimate
from tsepm_ros.tools.evaluation.performance import (
    PerformanceEvaluated,
    PerformancePlan,
    evaluate_performance,
)
from tsepm_ros.tools.evaluation.result_files import add_result_file, result_code_key
from tsepm_ros.tools.evaluation.simulated_run import SimulatedOperatingPoint
from tsepm_ros.tools.simulation import Scenario, load_scenario
from tsepm_ros.tools.simulation.scenario import ScenarioTargetArea
from tsepm_ros.tools.terminal import terminal_progress
from tsepm_ros.tracker.options import CommonOptions, ScoreOptions

Rows = Iterator[Sequence[str]]
"""A header, then the rows of a table."""

BUILD = fixed_threads.BUILD / "promises"
MAX_DETECTIONS = 1.25e6
"""Maximum number of false detections for a rate of false tracks."""
STARTS_AT = {1e-8: 2.5, 1e-6: 1.0}
"""Densities of the starts, with factors of the number of runs."""
RATES = (1, 10, 100, 1000, 10000)
"""Target false-track rates of the sweep of `score`, per hour."""
SPEED_PARTS = range(4)
"""Parts of the disc of velocities, each with a speed of its own."""
WARM_UP = 16
"""Scans of clutter alone before the target of a scene appears."""
LEFT_OUT = 10
"""Scans of each run with clutter alone in which the hypotheses accumulate."""

HOLDS, DOES_NOT, OPEN = "holds", "does not", "cannot tell"
MAX_ERROR = 0.03
"""Maximum difference between the P_DT of `tsepm design` and the measured P_DT."""


def errors(factor: float) -> dict[str, float]:
    """The box's errors times a factor."""
    return {"range_std_fraction": factor * 0.015, "azimuth_std": factor * math.radians(1.0)}


CORNERS = ((1e-7, 1.0, 1.0 / 3.0, "1e-7, 1.0, a third"), (2e-6, 0.6, 2.0, "2e-6, 0.6, twice"))
CHANGED: dict[str, dict[str, float]] = {
    **{f"density {text}": {"clutter_density": float(text)} for text in ("1e-7", "3e-7", "2e-6")},
    **{f"p_d {share}": {"detection_probability": share} for share in (0.6, 0.8, 1.0)},
    "errors a third": errors(1.0 / 3.0),
    "errors twice": errors(2.0),
    **{
        name: {"clutter_density": density, "detection_probability": share, **errors(factor)}
        for density, share, factor, name in CORNERS
    },
}
"""Changes of the box by `equal-false-rate`; the box has 1e-6, 0.9, 1.5 % and 1 degree."""


def score_at(rate: float, **options: Any) -> SimulatedOperatingPoint:
    """The default method at a target false-track rate, per hour, perhaps with other options."""
    label = ", ".join([f"{rate:g}/h", *(f"{name} {value}" for name, value in options.items())])
    options = {"false_tracks_per_hour": float(rate), **options}
    return SimulatedOperatingPoint("score", label, options, version=result_code_key())


def rate_ratio(
    density: float, rate: float, hours: float, seed: int, processes: int
) -> IntervalEstimate:
    """Rate of false tracks over the target rate."""
    case = clutter_alone(density)
    scans = math.ceil(hours * case.scans_per_hour)
    given = {"seed": seed, "processes": processes, "progress": terminal_progress}
    options = {"false_tracks_per_hour": float(rate)}
    return predicted_false_tracks_per_hour(case, "score", options, scans=scans, **given) / rate


def clutter_alone(density: float) -> PredictionCase:
    """The default sonar in clutter."""
    return PredictionCase(sensor=replace(SensorModel(), clutter_density=density), scans=LEFT_OUT)


def false_rate_table(options: argparse.Namespace) -> Rows:
    """Rates of false tracks over the target rates."""
    yield "density [1/m^2]", "accepted per hour", "hours", "false tracks per hour / accepted"
    for density in (3e-7, 1e-6):
        affordable = MAX_DETECTIONS / clutter_alone(density).starts_per_hour
        for rate in (100, 10, 1):
            hours = min(options.runs / rate, affordable)
            ratio = rate_ratio(density, rate, hours, options.seed, options.workers)
            yield f"{density:g}", f"{rate:g}", f"{hours:.3g}", f"{ratio:.2f}"


def scene(name: str, warm_up: int = WARM_UP, **changes: float) -> Scenario:
    """The box, after scans of clutter alone, with some of the sensor's values changed."""
    given = {f"sensor.{key}": value for key, value in changes.items()}
    return replace(load_scenario("box", given), name=name, warm_up=warm_up)


def starts_table(options: argparse.Namespace, densities: Mapping[float, float] = STARTS_AT) -> Rows:
    """Errors of pure starts over their bound, and NEES."""
    shown = {
        "found": "P_DT",
        "found_by_position": "P_DT by position",
        "position_to_bound": "position error / bound",
        "velocity_to_bound": "velocity error / bound",
        "pure_nees": "NEES, pure",
        "nees": "NEES, true",
    }
    yield "density [1/m^2]", "azimuth error", "target", "runs", *shown.values()
    for density, factor in densities.items():
        runs = math.ceil(factor * options.runs)
        for degrees in (1, 3):
            azimuth = math.radians(degrees)
            box = scene("box", options.warm_up, clutter_density=density, azimuth_std=azimuth)
            points = [score_at(1), score_at(10), score_at(10, limit_speed="off")]
            [result] = evaluated(box, points, runs, options)
            for point, measures in zip(result.points, result.measures, strict=True):
                cells = [measures.text(name, interval="found" not in name) for name in shown]
                yield f"{density:g}", f"{degrees} deg", point.label, str(runs), *cells


def speeds_table(options: argparse.Namespace, densities: Sequence[float] = (1e-8, 1e-6)) -> Rows:
    """NEES of true starts for targets of several speeds, and over all velocities.

    The speeds stand for parts of the disc |v| <= `max_speed` of equal area.
    """
    yield "density [1/m^2]", "speed [m/s]", "runs", "P_DT", "NEES, true"
    number = len(SPEED_PARTS)
    for density in densities:
        nees = []
        for part in SPEED_PARTS:
            speed = CommonOptions().max_speed * math.sqrt((part + 0.5) / number)
            name = f"box at {speed:.1f} m per s"
            box = scene(name, options.warm_up, clutter_density=density)
            state = box.targets[0].copy()
            state[1::2] *= speed / np.hypot(*state[1::2])
            moving = replace(box, targets=(state,))
            [measures] = evaluated(moving, [score_at(10)], options.runs, options)[0].measures
            nees.append(measures.nees)
            cells = [measures.text(column) for column in ("found", "nees")]
            yield f"{density:g}", f"{speed:.1f}", str(options.runs), *cells
        yield f"{density:g}", "all", str(number * options.runs), "", f"{mean_of(nees):.2f}"


def mean_of(estimates: Sequence[IntervalEstimate]) -> IntervalEstimate:
    """Mean of independent estimates, with its interval."""
    number = len(estimates)
    mean = sum(one.value for one in estimates) / number
    down = math.hypot(*(one.value - one.low for one in estimates)) / number
    up = math.hypot(*(one.high - one.value for one in estimates)) / number
    return IntervalEstimate(mean, mean - down, mean + up)


def evaluated(
    scene: Scenario,
    points: Sequence[SimulatedOperatingPoint],
    runs: int,
    options: argparse.Namespace,
    horizons: Sequence[int] = (),
) -> list[PerformanceEvaluated]:
    """Results of a scene after each horizon and after all scans; missing runs are done."""
    plan = PerformancePlan(
        scenarios=[scene], points=points, runs=runs, seed=options.seed, horizons=horizons
    )
    return evaluate_performance(plan, options.out / "runs", options.workers, terminal_progress)


HORIZONS = (8, 16)
MARGIN = 0.01
"""Loss of P_DT against the published method, at its false rate, that counts as none."""


def equal_rate_table(options: argparse.Namespace, rates: Sequence[float] = RATES) -> Rows:
    """`tsepm` at its own rule against the sweep of `score`."""
    points = [
        SimulatedOperatingPoint("tsepm", "5/8", version=result_code_key()),
        *map(score_at, rates),
    ]
    head = ["scene", "pings", "`tsepm` 5/8: P_DT", "its false + misplaced per run"]
    head += ["`score` at as many: P_DT", "`score` at its P_DT: false + misplaced per run"]
    head += ["verdict", "its P_DT less that of `score` (one-sided bounds)"]
    yield [*head, f"`score` not below by more than {MARGIN:g}"]
    for name in options.scene or CHANGED:
        box = scene(name, options.warm_up, **CHANGED[name])
        for result in evaluated(box, points, options.runs, options, HORIZONS):
            yield equal_rate_row(result)


def equal_rate_row(result: PerformanceEvaluated) -> list[str]:
    """The row of a scene after some pings.

    With more false starts than the last point of its sweep `score` has *at least* that point's
    P_DT; for a P_DT below its first point's it has *at most* that point's false starts. Above its
    highest P_DT, or below its fewest false starts, it is not compared.
    """
    names = [(point.method, point.label) for point in result.points]
    compared = compare(dict(zip(names, result.runs, strict=True)))
    [row] = [row for row in compared if row.method == "tsepm" and row.other == "score"]
    pairs = list(zip(result.points, result.measures, strict=True))
    [published] = [measures for point, measures in pairs if point.method == "tsepm"]
    false = [measures.false_per_run.value for point, measures in pairs if point.method == "score"]
    shares = [measures.found.value for point, measures in pairs if point.method == "score"]
    beyond = row.false > max(false)
    below = row.found < shares[false.index(min(false))]
    share, cost = f"{row.other_found:.2f}", f"{row.other_false:.2f}"
    if math.isnan(row.other_found.value):
        share = f"not reached: {min(false):.2f} or more"
    if math.isnan(row.other_false.value):
        cost = f"not reached: P_DT up to {max(shares):.2f}"
    return [
        result.scenario.name,
        str(result.scans),
        f"{published.found:.2f}",
        f"{published.false_per_run:.2f}",
        f"at least {share}" if beyond else share,
        f"at most {cost}" if below else cost,
        verdict(row, beyond=beyond, below=below),
        f"{row.found_bounds:+.3f}",
        within_margin(row.found_bounds, beyond=beyond),
    ]


def verdict(row: Comparison, *, beyond: bool, below: bool) -> str:
    """Whether `score` is better in P_DT or in false starts, with 95 %, and worse in neither."""
    better = row.found_difference.high < 0.0 or row.false_ratio.high < 1.0
    worse = (row.found_difference.low > 0.0 and not beyond) or (
        row.false_ratio.low > 1.0 and not below
    )
    if better == worse:
        return OPEN
    return HOLDS if better else DOES_NOT


def within_margin(loss: IntervalEstimate, *, beyond: bool) -> str:
    """Whether a loss of P_DT, by its one-sided bounds, is at most the margin.

    Where it is `beyond` the last point of the sweep, it may be less than it seems.
    """
    if loss.high <= MARGIN:
        return HOLDS
    return DOES_NOT if loss.low > MARGIN and not beyond else OPEN


def difference(first: IntervalEstimate, second: IntervalEstimate) -> IntervalEstimate:
    """Difference of two independent shares with Newcombe's interval (Statist. Med. 17, 1998)."""
    gap = first.value - second.value
    down = math.hypot(first.value - first.low, second.high - second.value)
    up = math.hypot(first.high - first.value, second.value - second.low)
    return IntervalEstimate(gap, gap - down, gap + up)


def closeness(gap: IntervalEstimate) -> str:
    """Whether all, none or a part of the interval of a difference of P_DT is small."""
    if gap.low >= -MAX_ERROR and gap.high <= MAX_ERROR:
        return HOLDS
    return DOES_NOT if gap.low > MAX_ERROR or gap.high < -MAX_ERROR else OPEN


TARGET_RATE = 10.0
SPEED = 5.0


def design_table(options: argparse.Namespace) -> Rows:
    """Predictions of `tsepm design` against whole scenes."""
    head = ["density [1/m^2]", "pings", "P_DT, plan without clutter", "P_DT, simulated by design"]
    head += ["P_DT, whole scenes", "design less measured", f"within {MAX_ERROR}", "false/h, design"]
    yield [*head, "false + misplaced/h, whole scenes"]
    for density in (3e-7, 1e-6):
        for scans in HORIZONS:
            yield designed(density, scans, options)


def designed(density: float, scans: int, options: argparse.Namespace) -> list[str]:
    """The row of a density and a number of pings, at the window of the design."""
    sensor = replace(SensorModel(), clutter_density=density)
    case = PredictionCase(sensor=sensor, scans=scans, target_speed=SPEED)
    score = ScoreOptions(false_tracks_per_hour=TARGET_RATE)
    score = replace(score, window=predicted_score_window(case, score))
    planned = first_prediction(case, score, given_window=True).found[-1]
    given = {**asdict(case.common), **asdict(score)}
    simulation = {"seed": options.seed, "processes": options.workers, "progress": terminal_progress}
    simulated = prediction_statistics(case, "score", given, runs=options.runs, **simulation).found
    clutter = prediction_clutter_scans(case, TARGET_RATE)
    false = predicted_false_tracks_per_hour(case, "score", given, scans=clutter, **simulation)
    anywhere = ScenarioTargetArea(
        1, (sensor.min_range, sensor.max_range), (-math.pi, math.pi), SPEED
    )
    whole = Scenario(name="disc", scans=scans, sensor=sensor, areas=(anywhere,))
    point = SimulatedOperatingPoint("score", "designed", given, version=result_code_key())
    [measures] = evaluated(whole, [point], options.runs, options)[0].measures
    gap = difference(simulated, measures.found)
    shares = [f"{share:.3f}" for share in (planned, simulated, measures.found, gap)]
    rates = [f"{rate:.1f}" for rate in (false, measures.false_per_hour)]
    return [f"{density:g}", str(scans), *shares, closeness(gap), *rates]


COMMANDS = {
    "false-rate": (false_rate_table, 40, "maximum number of expected false tracks"),
    "starts": (starts_table, 600, "runs of a scene; 2.5 times as many at 1e-8"),
    "speeds": (speeds_table, 100, "runs of a scene"),
    "equal-false-rate": (equal_rate_table, 100, "runs of a scene"),
    "design": (design_table, 200, "targets simulated, and whole scenes"),
}


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    commands = parser.add_subparsers(dest="command", required=True)
    for name, (_, runs, what) in COMMANDS.items():
        command = commands.add_parser(name)
        add_runs_arguments(command, runs, what)
        command.add_argument(
            "--scene", action="append", choices=CHANGED, help="of equal-false-rate; default all"
        )
        add_result_file(command)
        command.add_argument(
            "--warm-up", type=int, default=WARM_UP, help="scans before the box's target appears"
        )
        command.add_argument("--out", type=Path, default=BUILD, help="folder of the runs done")
    options = parser.parse_args(arguments)
    table = printed(COMMANDS[options.command][0](options))
    line = f"python benchmarks/promises.py {options.command} --runs {options.runs}"
    line += "".join(f" --scene {shlex.quote(name)}" for name in options.scene or ())
    runs = 1 if options.command == "false-rate" else options.runs  # there: expected tracks
    write_table(options.result, line, table, seed=options.seed, runs=runs)


if __name__ == "__main__":
    main()
