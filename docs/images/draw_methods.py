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
"""Every method's operating points, a panel each, and their tables, from `tsepm evaluate`.

tsepm evaluate box --runs 110 --horizon 8
python docs/images/draw_methods.py build/evaluation/evaluation.csv
"""

from __future__ import annotations

import argparse
import csv
from collections.abc import Mapping, Sequence
from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
from matplotlib.axes import Axes

from tsepm_ros.tools.evaluation.intervals import IntervalEstimate, interval_error_bars
from tsepm_ros.tools.terminal import terminal_markdown_table
from tsepm_ros.whole_files import written_whole

Row = Mapping[str, str]
COLUMNS = 5
FULL, HOLLOW, BACKGROUND = "#0072B2", "#D55E00", "0.85"


def estimate(row: Row, name: str) -> IntervalEstimate:
    """A figure of a row."""
    return IntervalEstimate(*(float(row[f"{name}{end}"]) for end in ("", "_low", "_high")))


def false_per_hour(row: Row) -> float:
    """False and misplaced starts per hour; at least half a start in all runs."""
    hours = estimate(row, "false_per_run").high / estimate(row, "false_per_hour").high
    return max(float(row["false_per_hour"]), 0.5 / float(row["runs"]) / hours)


def three_digits(value: float) -> str:
    """A number with three digits and at most two decimals; empty for nan."""
    return f"{round(float(f'{value:.3g}'), 2):g}".replace("nan", "")


def with_interval(row: Row, name: str) -> str:
    """A figure and its interval; empty without a figure.

    Without the interval of a positive figure that reaches below 0: of few values with a long tail.
    """
    figure = estimate(row, name)
    value, low, high = map(three_digits, (figure.value, figure.low, figure.high))
    known = value and low and high and figure.low >= 0.0
    return f"{value} ({low}-{high})" if known else value


def panel(axis: Axes, method: str, rows: Sequence[Row], horizons: Sequence[str]) -> None:
    """One method's points in front of those of all methods."""
    last = [row for row in rows if row["scans"] == horizons[-1]]
    background = [(false_per_hour(row), float(row["found"])) for row in last]
    axis.plot(*zip(*background, strict=True), "o", color=BACKGROUND, markersize=4)
    for scans, colour, face in zip(horizons, (HOLLOW, FULL), ("white", FULL), strict=True):
        own = [row for row in rows if row["method"] == method and row["scans"] == scans]
        own.sort(key=false_per_hour)
        shares = [estimate(row, "found") for row in own]
        values = [share.value for share in shares]
        axis.errorbar(
            [false_per_hour(row) for row in own],
            values,
            yerr=interval_error_bars(values, shares),
            fmt="o",
            color=colour,
            markerfacecolor=face,
            elinewidth=0.6,
            markersize=5,
            label=f"{scans} pings",
        )
    axis.set_title(method, loc="left", fontsize=11, weight="bold")
    axis.set(xscale="log", ylim=(-0.03, 1.05))
    axis.grid(alpha=0.3)


def draw(rows: Sequence[Row], methods: Sequence[str], horizons: Sequence[str], path: Path) -> None:
    """Write the picture."""
    lines = -(-len(methods) // COLUMNS)
    size, shared = (14, 3.2 * lines), {"sharex": True, "sharey": True, "squeeze": False}
    figure, axes = plt.subplots(lines, COLUMNS, figsize=size, layout="constrained", **shared)
    for axis, method in zip(axes.flat, methods, strict=False):
        panel(axis, method, rows, horizons)
    for axis in axes.flat[len(methods) :]:
        axis.axis("off")
    axes[0, 0].legend(loc="lower right", fontsize=9)
    figure.supxlabel("false and misplaced tracks per hour (none in all runs: half a track)")
    figure.supylabel("share of targets with a true track, P_DT")
    figure.suptitle(
        f"{rows[0]['scenario']}: few to many false tracks; {rows[0]['runs']} runs, "
        f"seed {rows[0]['seed']}, 95 % intervals; grey: all methods after {horizons[-1]} scans",
        fontsize=11,
    )
    with written_whole(path) as temporary:
        figure.savefig(temporary, dpi=100)


def table(rows: Sequence[Row], method: str, horizons: Sequence[str]) -> str:
    """One method's points as Markdown, the horizons side by side."""
    heads = [part for scans in horizons for part in (f"P_DT, {scans} pings", "false/h")]
    own = {(row["point"], row["scans"]): row for row in rows if row["method"] == method}
    lines = []
    for point in dict.fromkeys(point for point, _ in own):
        cells = [f"`{method}` {point}"]
        for scans in horizons:
            row = own[point, scans]
            share = estimate(row, "found")
            cells.append(f"{share.value:.2f} ({share.low:.2f}-{share.high:.2f})")
            cells.append(with_interval(row, "false_per_hour"))
        lines.append([*cells, *(with_interval(row, key) for key in ("redundant_per_run", "nees"))])
    return terminal_markdown_table(
        ["method and setting", *heads, "redundant per run", "NEES"], lines
    )


def main() -> None:
    """Draw, and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("table", type=Path, help="evaluation.csv")
    parser.add_argument("--picture", type=Path, default=Path("docs/pictures/methods_curve.png"))
    options = parser.parse_args()
    with options.table.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    methods = list(dict.fromkeys(row["method"] for row in rows))
    horizons = sorted({row["scans"] for row in rows}, key=int)
    draw(rows, methods, horizons, options.picture)
    for method in methods:
        print(f"{method}\n\n{table(rows, method, horizons)}\n")


if __name__ == "__main__":
    main()
