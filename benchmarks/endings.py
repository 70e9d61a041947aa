"""A track ends when its target is gone, at any ping rate: required values beside measured ones.

- vanish, leave: pings until no track of a target is published after it has gone, at once or by
  leaving the coverage, detected for 100 pings before;
- stays: share of the runs in which a target keeps one id for 400 pings, and of the pings since its
  start in which it is published;
- silent, shadow: share of the runs in which a target has the same id again after silences of 4 of
  every 16 pings, and after it has crossed a sector of 10 pings in which nothing is detected.

Below each row, the largest axis (one standard deviation) of any published track over its limit, 5
times that of a detection there with its extent or `target_extent`, over `max_range`, and the share
of the published tracks above 1 or 0.25 of them; and ids elsewhere than on the target, in the mean.

    python benchmarks/endings.py [vanish leave stays silent shadow] [--runs 20] [--workers 2]
        [--intervals 0.1 12] [--false 0 15]

A column NAME is followed by what is required of it; a cell that fails ends in "!".
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import fixed_threads  # noqa: F401  # before numpy
import numpy as np
from endings_scenes import SEEN, Case, Watched, watched

from tsepm_ros.commands.arguments import add_runs, workers_of
from tsepm_ros.progress import with_progress

INTERVALS = (0.1, 0.2, 1.0, 4.0, 12.0)
FALSE = (0.0, 2.0, 15.0)


@dataclass(frozen=True)
class Figure:
    """A measured value and its bound: at least `required`, or at most, if `most`."""

    name: str
    value: float
    required: float
    most: bool = False

    @property
    def fails(self) -> bool:
        """Whether the value misses its bound; a value that is not there does."""
        return not (self.value <= self.required if self.most else self.value >= self.required)

    def text(self) -> str:
        """The value, with a mark where it fails."""
        return f"{self.value:.3g}{'!' if self.fails else ''}"


Measured = dict[str, float]
"""Figures of one run by name; nan where there are none."""


def of_run(case: Case) -> Measured:
    """The figures of a case."""
    seen = watched(case)
    figures = of_tracks(seen)
    if case.scene in ("vanish", "leave"):
        last = max(k for k, there in enumerate(seen.there) if there)
        return figures | {"out": seen.pings_until_out(last)}
    first = next((k for k, track in enumerate(seen.on) if track is not None), None)
    held = math.nan if first is None else float(np.mean([bool(near) for near in seen.near[first:]]))
    ids = seen.ids(SEEN - 1) if case.scene == "shadow" else seen.ids()
    came = seen.on[-1] is not None or case.scene != "shadow"
    return figures | {"one id": float(len(ids) == 1 and came), "held": held, "ids": len(ids)}


def of_tracks(seen: Watched) -> Measured:
    """Figures of all published tracks."""
    on, ids = set().union(*seen.near), set().union(*seen.published)
    return {
        "axis / limit": seen.worst,
        "axis / max_range": seen.widest,
        "too wide": seen.wide / max(seen.rows, 1),
        "elsewhere": len(ids - on),
    }


def gone(limits: dict[float, tuple[float, float, float]]) -> Callable[..., list[Figure]]:
    """Figures of pings until a track is out, at most `limits` by P_D: median, 0.95 and all."""

    def figures(runs: Sequence[Measured], probability: float) -> list[Figure]:
        out = np.array([run["out"] for run in runs])
        out = out[np.isfinite(out)]
        if not len(out):
            return []
        shares = zip((0.5, 0.95, 1.0), limits[probability], strict=True)
        names = ("median", "0.95", "max")
        return [
            *(
                Figure(name, float(np.quantile(out, share, method="inverted_cdf")), limit, True)
                for name, (share, limit) in zip(names, shares, strict=True)
            ),
            Figure("runs with a track", len(out), 0),
        ]

    return figures


def kept(limits: dict[float, tuple[float, float]]) -> Callable[..., list[Figure]]:
    """Figures of a kept id, at least `limits` by P_D: share of runs, share of time published."""

    def figures(runs: Sequence[Measured], probability: float) -> list[Figure]:
        one, held = limits[probability]
        return [
            Figure("one id", float(np.mean([run["one id"] for run in runs])), one),
            Figure("in current", float(np.mean([run["held"] for run in runs])), held),
            Figure("ids a run", float(np.mean([run["ids"] for run in runs])), 0.0),
        ]

    return figures


SCENES: dict[str, tuple[tuple[float, ...], Callable[..., list[Figure]]]] = {
    "vanish": ((0.9, 0.6), gone({0.9: (12, 25, 40), 0.6: (25, 60, 90)})),
    "leave": ((0.9, 0.6), gone(dict.fromkeys((0.9, 0.6), (math.inf, 25, math.inf)))),
    "stays": ((0.9, 0.6, 0.4), kept({0.9: (0.95, 0.98), 0.6: (0.95, 0.95), 0.4: (0.9, 0.85)})),
    "silent": ((0.9,), kept({0.9: (0.9, 0.0)})),
    "shadow": ((0.9,), kept({0.9: (0.9, 0.0)})),
}
"""P_D of each scene, and its figures."""


def row(runs: Sequence[Measured], figures: list[Figure]) -> list[Figure]:
    """The figures of a row, with those of all published tracks."""
    bounds = {"axis / limit": 1.0, "axis / max_range": 0.25}
    wide = [
        Figure(name, max(run[name] for run in runs), bound, True) for name, bound in bounds.items()
    ]
    means = [
        Figure(name, float(np.mean([run[name] for run in runs])), math.inf, True)
        for name in ("too wide", "elsewhere")
    ]
    return [*figures, *wide, *means]


def rows(name: str, given: argparse.Namespace) -> Iterator[tuple[str, list[Figure]]]:
    """Rows of a scene: its case and its figures."""
    probabilities, figures = SCENES[name]
    for probability in probabilities:
        for interval in given.intervals:
            for false in given.false:
                jobs = [
                    Case(name, interval, false, probability, given.seed + run)
                    for run in range(given.runs)
                ]
                results = workers_of(given).mapped(of_run, jobs)
                runs = list(with_progress(results, len(jobs), name))
                text = f"P_D {probability:g}, {interval:g} s, {false:g} false"
                yield text, row(runs, figures(runs, probability))


def print_rows(name: str, table: Iterator[tuple[str, list[Figure]]]) -> bool:
    """Print the rows of a table as they come; returns whether all figures hold."""
    print(f"\n{name}", flush=True)
    last, fails = "", 0
    for text, figures in table:
        bounds = [
            ""
            if math.isinf(f.required) or not f.required
            else f" {'<' if f.most else '>'}= {f.required:g}"
            for f in figures
        ]
        header = " | ".join(f"{f.name}{b}" for f, b in zip(figures, bounds, strict=True))
        if header != last:
            print(f"{'':24} | {header}")
        last = header
        cells = (f.text().rjust(len(f.name + b)) for f, b in zip(figures, bounds, strict=True))
        print(f"{text:24} | {' | '.join(cells)}", flush=True)
        fails += sum(f.fails for f in figures)
    print(f"{name}: {'all hold' if not fails else f'{fails} figures fail'}", flush=True)
    return not fails


def main() -> None:
    """Measure the scenes and print their tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("scenes", nargs="*", metavar="scene", help=", ".join(SCENES))
    parser.add_argument("--intervals", type=float, nargs="+", default=INTERVALS, help="s")
    parser.add_argument("--false", type=float, nargs="+", default=FALSE, help="a ping")
    add_runs(parser, 20)
    given = parser.parse_args()
    hold = [print_rows(name, rows(name, given)) for name in given.scenes or SCENES]
    sys.exit(not all(hold))


if __name__ == "__main__":
    main()
