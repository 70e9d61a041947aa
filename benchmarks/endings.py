"""A track ends when its target is gone, at any ping rate: required values beside measured ones.

- vanish, leave: pings until no track of a target is published after it has gone, at once or by
  leaving the coverage, detected for 100 pings before;
- stays: share of the runs in which a target keeps one id for 400 pings, and of the pings since its
  start in which it is published;
- silent, shadow: share of the runs in which a target has the same id again after silences of 4 of
  every 16 pings, and after it has crossed a sector of 10 pings in which nothing is detected;
- quay: tracks ever on a swimmer of several echoes, and elsewhere, with what `tsepm init` writes;
- boats: two that sail 12 m apart and then apart, that cross at 9 m, one that glints: share of the
  runs with at most one switch of id (CLEAR-MOT), and tracks that ended though the boat was there;
- lidar, pool, recordings: see `endings_data.py`; in `--data`, left out where that is not there.

The larger axis (one standard deviation) of a published track's position is compared with its limit,
the larger of `target_extent` and 5 times that of a detection there, and with a quarter of
`max_range`: the largest ratios, and the share of the published tracks that are too wide by either.
Elsewhere: ids in the mean.

    python benchmarks/endings.py [SCENE ...] [--runs 20] [--workers 2] [--intervals 0.1 12]
        [--false 0 15] [--data FOLDER]

A column's name is followed by what is required; a value that fails ends in "!".
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import fixed_threads  # noqa: F401  # before numpy
import numpy as np
from endings_data import DATA
from endings_harbour import quay, sailed
from endings_scenes import Case, watched

from tsepm_ros.tools.commands.arguments import add_runs, workers_of
from tsepm_ros.tools.terminal import with_progress

Figure = tuple[str, float, str]
"""Name, value and bound, such as "<= 12"."""
Rows = Iterator[tuple[str, list[Figure]]]
AXES = ("axis / limit", np.max, "<= 1"), ("axis / quarter", np.max, "<= 1")
TRACKS = (*AXES, ("too wide", np.mean, ""), ("elsewhere", np.mean, ""))
OUT = tuple(
    (name, lambda out, share=share: np.nanquantile(out, share, method="inverted_cdf"))
    for name, share in (("median", 0.5), ("0.95", 0.95), ("max", 1.0))
)
KEPT = ("one id", np.mean), ("in current", np.mean), ("ids", np.mean)
SCENES: dict[str, dict[float, tuple[str, str, str]]] = {
    "vanish": {0.9: ("<= 12", "<= 25", "<= 40"), 0.6: ("<= 25", "<= 60", "<= 90")},
    "leave": {0.9: ("", "<= 25", ""), 0.6: ("", "<= 25", "")},
    "stays": {
        0.9: (">= 0.95", ">= 0.98", ""),
        0.6: (">= 0.95", ">= 0.95", ""),
        0.4: (">= 0.9", ">= 0.85", ""),
    },
    "silent": {0.9: (">= 0.9", "", "")},
    "shadow": {0.9: (">= 0.9", "", "")},
}
"""Bounds of each scene by P_D."""


def fails(value: float, bound: str) -> bool:
    """Whether a value misses its bound; a value that is not there does."""
    limit = float(bound[2:] or "nan")
    return bool(bound) and not (value <= limit if bound[0] == "<" else value >= limit)


def figures(
    runs: Sequence[dict[str, float]], columns: Sequence[Any], name: str = ""
) -> list[Figure]:
    """Figures of runs by name, function of the values (of `name`, if given), and bound."""
    return [
        (column, float(function([run[name or column] for run in runs])), bound)
        for column, function, bound in columns
    ]


def of_run(case: Case) -> dict[str, float]:
    """The figures of a case."""
    seen = watched(case)
    if case.scene in ("vanish", "leave"):
        return seen.of_tracks() | {"out": seen.pings_until_out()}
    ids = seen.ids(99 if case.scene == "shadow" else 0)
    one = len(ids) == 1 and (seen.on[-1] is not None or case.scene != "shadow")
    return seen.of_tracks() | {"one id": one, "in current": seen.held(), "ids": len(ids)}


def mapped(
    given: argparse.Namespace, function: Callable[..., Any], jobs: Sequence[Any]
) -> list[Any]:
    """Results of a function for each job."""
    return list(with_progress(workers_of(given).mapped(function, jobs), len(jobs)))


def targets(name: str, given: argparse.Namespace) -> Rows:
    """Rows of a scene of one target."""
    for probability, bounds in SCENES[name].items():
        for interval in given.intervals:
            for false in given.false:
                jobs = [
                    Case(name, interval, false, probability, given.seed + run)
                    for run in range(given.runs)
                ]
                runs = mapped(given, of_run, jobs)
                gone = "out" in runs[0]
                columns = [(*c, b) for c, b in zip(OUT if gone else KEPT, bounds, strict=True)]
                columns += [("no track", lambda out: np.isnan(out).sum(), "")] if gone else []
                row = figures(runs, columns, "out" if gone else "")
                text = f"P_D {probability:g}, {interval:g} s, {false:g} false"
                yield text, [*row, *figures(runs, TRACKS)]


def quays(given: argparse.Namespace) -> Rows:
    """Row of the quay: means, and the worst runs."""
    runs = mapped(given, quay, range(given.seed, given.seed + given.runs))
    worst = [("on swimmer", np.max, "<= 2"), ("elsewhere", np.max, "<= 2"), ("held", np.min, "")]
    means = [("on swimmer", np.mean, ""), ("held", np.mean, ">= 0.9"), *TRACKS]
    yield "the worst run", figures(runs, worst)
    yield "all", figures(runs, means)


def encounters(given: argparse.Namespace) -> Rows:
    """Rows of the boats."""
    for scene in ("together", "crossing", "glint"):
        jobs = [(scene, given.seed + run) for run in range(given.runs)]
        switches, ended = np.array(mapped(given, sailed, jobs)).T
        at_most_one = float((switches <= 1).mean())
        most = ("switches at most", float(switches.max()), "")
        yield (
            scene,
            [("at most 1", at_most_one, ">= 0.9"), most, ("ended", float(ended.sum()), "<= 0")],
        )


def print_rows(name: str, table: Rows) -> bool:
    """Print the rows of a table as they come; returns whether all figures hold."""
    print(f"\n{name}", flush=True)
    last, number = "", 0
    for text, row in table:
        names = [f"{column} {bound}".rstrip() for column, _, bound in row]
        header = " | ".join(names)
        if header != last:
            print(f"{'':26} | {header}")
        last = header
        cells = [f"{value:.3g}{'!' if fails(value, bound) else ''}" for _, value, bound in row]
        cells = [cell.rjust(len(column)) for cell, column in zip(cells, names, strict=True)]
        print(f"{text:26} | {' | '.join(cells)}", flush=True)
        number += sum(fails(value, bound) for _, value, bound in row)
    print(f"{name}: {f'{number} figures fail' if number else 'all hold'}", flush=True)
    return not number


def main() -> None:
    """Measure the scenes and print their tables."""
    names = (*SCENES, "quay", "boats", *DATA)
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("scenes", nargs="*", metavar="SCENE", help=", ".join(names))
    parser.add_argument("--intervals", type=float, nargs="+", default=(0.1, 0.2, 1.0, 4.0, 12.0))
    parser.add_argument("--false", type=float, nargs="+", default=(0.0, 2.0, 15.0), help="a ping")
    text = "folder of lidar/walking_person, aquascan, autoferry and joyride; default $TSEPM_DATA"
    parser.add_argument("--data", type=Path, default=os.environ.get("TSEPM_DATA", ""), help=text)
    add_runs(parser, 20)
    given = parser.parse_args()
    unknown = set(given.scenes) - set(names)
    if unknown:
        parser.error(f"{min(unknown)} is none of {', '.join(names)}")
    hold = []
    for name in given.scenes or names:
        if name in SCENES:
            table = targets(name, given)
        elif name not in DATA:
            table = quays(given) if name == "quay" else encounters(given)
        elif (folder := Path(given.data) / DATA[name][0]).is_dir():
            table = DATA[name][1](Path(given.data))
        else:
            print(f"\n{name}: left out, there is no {folder} (--data)")
            continue
        hold.append(print_rows(name, table))
    sys.exit(not all(hold))


if __name__ == "__main__":
    main()
