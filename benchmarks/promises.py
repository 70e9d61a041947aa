"""What the package promises of its default method `score`, measured; a Markdown table each.

- wish: false tracks per hour over the wish, on clutter alone over the whole coverage;
- starts: errors of pure starts over their Cramer-Rao bound, and NEES, on scenes of the box;
- equal-footing: P_D beside that of `tsepm` at its own 5/8 at the same false + misplaced starts per
  run, and these at its P_D, on scenes of the box with one thing changed, and on two corners;
- design: P_D and false tracks that `tsepm design` predicts beside those of whole scenes.

With 95 % intervals. The runs of starts and equal-footing are kept: interrupted, they go on.

    python benchmarks/promises.py wish [--runs 40] [--seed 1] [--workers 2]
"""

from __future__ import annotations

import argparse
import math
import os
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from pathlib import Path

os.environ["OMP_NUM_THREADS"] = "1"
os.environ["OPENBLAS_NUM_THREADS"] = "1"

from promises_footing import CHANGED, CLOSE, closeness, difference, footing

from tsepm_ros import SensorModel
from tsepm_ros.analysis.intervals import Estimate
from tsepm_ros.analysis.operating_points import OperatingPoint, package_version
from tsepm_ros.analysis.performance import Evaluated, Plan, evaluate
from tsepm_ros.analysis.workers import Workers, with_progress
from tsepm_ros.design import search
from tsepm_ros.design.prediction import Case, false_tracks_per_hour, targets_found
from tsepm_ros.methods.score.score_options import ScoreOptions
from tsepm_ros.simulation import Scenario, load_scenario
from tsepm_ros.simulation.scenario import TargetArea

Rows = Iterator[Sequence[str]]
"""A header, then rows as they are measured."""

BUILD = Path(__file__).resolve().parents[1] / "build" / "promises"
DETECTIONS = 1.25e6
"""False detections, at most, that a rate of false tracks is measured with."""
STARTS_AT = {1e-8: 2.5, 1e-6: 1.0}
"""Densities at which starts are measured, and how many times the runs that are asked for."""
LEFT_OUT = 10
"""Scans of each part of clutter alone in which the hypotheses gather."""


def score_at(wish: float) -> OperatingPoint:
    """The default method at a wish."""
    options = {"false_tracks_per_hour": float(wish)}
    return OperatingPoint("score", f"{wish:g}/h", options, version=package_version())


def wish_kept(density: float, wish: float, hours: float, seed: int, workers: Workers) -> Estimate:
    """False tracks over the wish."""
    case = clutter_alone(density)
    rate = false_tracks_per_hour(
        case,
        "score",
        {"false_tracks_per_hour": float(wish)},
        scans=math.ceil(hours * case.scans_per_hour),
        seed=seed,
        workers=workers,
        progress=with_progress,
    )
    return rate.mapped(lambda one: one / wish)


def clutter_alone(density: float) -> Case:
    """The default sonar in clutter."""
    return Case(sensor=replace(SensorModel(), clutter_density=density), scans=LEFT_OUT)


def wish_table(options: argparse.Namespace) -> Rows:
    """False tracks over the wish."""
    yield "density [1/m^2]", "wish per hour", "hours", "false tracks per hour / wish"
    for density in (3e-7, 1e-6):
        for wish in (100, 10, 1):
            hours = min(options.runs / wish, DETECTIONS / clutter_alone(density).starts_per_hour)
            kept = wish_kept(density, wish, hours, options.seed, options.workers)
            yield f"{density:g}", f"{wish:g}", f"{hours:.3g}", f"{kept:.2f}"


def scene(name: str, **changes: float) -> Scenario:
    """The box with some of the sensor's values changed."""
    given = {f"sensor.{key}": value for key, value in changes.items()}
    return replace(load_scenario("box", given), name=name)


def starts_table(options: argparse.Namespace) -> Rows:
    """Errors of pure starts over their bound, and NEES."""
    shown = {
        "detection": "P_D",
        "position_to_bound": "position error / bound",
        "velocity_to_bound": "velocity error / bound",
        "pure_nees": "NEES, pure",
        "nees": "NEES, true",
    }
    yield "density [1/m^2]", "azimuth error", "wish", "runs", *shown.values()
    for density, more in STARTS_AT.items():
        runs = math.ceil(more * options.runs)
        for degrees in (1, 3):
            azimuth = math.radians(degrees)
            box = scene("box", clutter_density=density, azimuth_std=azimuth)
            [one] = evaluated(box, [score_at(wish) for wish in (1, 10)], runs, options)
            for point, figures in zip(one.points, one.figures, strict=True):
                cells = [figures.text(name, interval=name != "detection") for name in shown]
                yield f"{density:g}", f"{degrees} deg", point.label, str(runs), *cells


def evaluated(
    one: Scenario,
    points: Sequence[OperatingPoint],
    runs: int,
    options: argparse.Namespace,
    horizons: Sequence[int] = (),
) -> list[Evaluated]:
    """A scene's runs, those done that are not there yet, after each horizon and after all."""
    plan = Plan(scenarios=[one], points=points, runs=runs, seed=options.seed, horizons=horizons)
    return evaluate(plan, options.out / "runs", options.workers, with_progress)


RATES = (1, 10, 100, 1000, 10000)
"""Wishes of the sweep that is put beside the published method."""
HORIZONS = (8, 16)


def footing_table(options: argparse.Namespace) -> Rows:
    """`tsepm` at its own rule beside the sweep of `score`."""
    points = [OperatingPoint("tsepm", "5/8", version=package_version()), *map(score_at, RATES)]
    yield (
        "scene",
        "pings",
        "`tsepm` 5/8: P_D",
        "its false + misplaced per run",
        "`score` at as many: P_D",
        "`score` at its P_D: false + misplaced per run",
        "verdict",
    )
    for name in options.scene or CHANGED:
        box = scene(name, **CHANGED[name])
        for one in evaluated(box, points, options.runs, options, HORIZONS):
            yield footing(one)


WISH = 10.0
SPEED = 5.0


def design_table(options: argparse.Namespace) -> Rows:
    """What `tsepm design` says beside what whole scenes give."""
    yield (
        "density [1/m^2]",
        "pings",
        "P_D, plan without clutter",
        "P_D, simulated by design",
        "P_D, whole scenes",
        "design less measured",
        f"within {CLOSE}",
        "false/h, design",
        "false + misplaced/h, whole scenes",
    )
    for density in (3e-7, 1e-6):
        for scans in HORIZONS:
            yield designed(density, scans, options)


def designed(density: float, scans: int, options: argparse.Namespace) -> list[str]:
    """The row of a density and so many pings, at the window that the design chooses."""
    sensor = replace(SensorModel(), clutter_density=density)
    case = Case(sensor=sensor, scans=scans, target_speed=SPEED)
    wanted = ScoreOptions(false_tracks_per_hour=WISH)
    wanted = replace(wanted, window=search.score_window(case, wanted))
    [(_, planned)] = search.score_thresholds(case, wanted, [wanted.window])
    given = {**asdict(case.common), **asdict(wanted)}
    simulation = {"seed": options.seed, "workers": options.workers, "progress": with_progress}
    found = targets_found(case, "score", given, runs=options.runs, **simulation).detection
    clutter = search.clutter_scans(case, WISH)
    false = false_tracks_per_hour(case, "score", given, scans=clutter, **simulation)
    anywhere = TargetArea(1, (sensor.min_range, sensor.max_range), (-math.pi, math.pi), SPEED)
    whole = Scenario(name="disc", scans=scans, sensor=sensor, areas=(anywhere,))
    point = OperatingPoint("score", "designed", given, version=package_version())
    [figures] = evaluated(whole, [point], options.runs, options)[0].figures
    gap = difference(found, figures.detection)
    return [
        f"{density:g}",
        str(scans),
        f"{planned:.3f}",
        f"{found:.3f}",
        f"{figures.detection:.3f}",
        f"{gap:.3f}",
        closeness(gap),
        f"{false:.1f}",
        f"{figures.false_per_hour:.1f}",
    ]


COMMANDS = {
    "wish": (wish_table, 40, "false tracks expected, at most"),
    "starts": (starts_table, 600, "runs of a scene; 2.5 times as many at 1e-8"),
    "equal-footing": (footing_table, 100, "runs of a scene"),
    "design": (design_table, 200, "targets simulated, and whole scenes"),
}


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    commands = parser.add_subparsers(dest="command", required=True)
    for name, (_, runs, what) in COMMANDS.items():
        command = commands.add_parser(name)
        command.add_argument("--runs", type=int, default=runs, help=f"{what}; default {runs}")
        command.add_argument("--seed", type=int, default=1)
        command.add_argument("--workers", type=int, default=os.cpu_count() or 1)
        command.add_argument(
            "--scene", action="append", choices=CHANGED, help="of equal-footing; default all"
        )
        command.add_argument("--out", type=Path, default=BUILD, help="folder of the runs done")
    options = parser.parse_args(arguments)
    options.workers = Workers(processes=options.workers)
    for index, cells in enumerate(COMMANDS[options.command][0](options)):
        print(f"| {' | '.join(cells)} |", flush=True)
        if not index:
            print("|---" * len(cells) + "|", flush=True)


if __name__ == "__main__":
    sys.exit(main())
