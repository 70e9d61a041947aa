"""Every method's operating points, a panel each, and their tables, from `tsepm evaluate`.

tsepm evaluate box --runs 110 --horizon 8
python benchmarks/methods_curve.py build/evaluation/evaluation.csv
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

Row = Mapping[str, str]
COLUMNS = 5
FULL, HOLLOW, OTHERS = "#0072B2", "#D55E00", "0.85"


def false_per_hour(row: Row) -> float:
    """False and misplaced starts; where there are none, half a start in all runs."""
    hours = float(row["false_per_run_high"]) / float(row["false_per_hour_high"])
    return max(float(row["false_per_hour"]), 0.5 / float(row["runs"]) / hours)


def three_digits(text: str) -> str:
    """A number without an exponent, of two decimals at most."""
    return f"{round(float(f'{float(text):.3g}'), 2):g}"


def with_interval(row: Row, name: str) -> str:
    """A figure and its interval; nothing where there is none."""
    values = [row[f"{name}{end}"] for end in ("", "_low", "_high")]
    if "nan" in values:
        return three_digits(values[0]).replace("nan", "")
    value, low, high = map(three_digits, values)
    return f"{value} ({low}-{high})"


def panel(axis: Axes, method: str, rows: Sequence[Row], horizons: Sequence[str]) -> None:
    """One method's points before those of all others."""
    last = [row for row in rows if row["scans"] == horizons[-1]]
    axis.plot(
        [false_per_hour(row) for row in last],
        [float(row["detection"]) for row in last],
        "o",
        color=OTHERS,
        markersize=4,
    )
    for scans, colour, face in zip(horizons, (HOLLOW, FULL), ("white", FULL), strict=True):
        own = [row for row in rows if row["method"] == method and row["scans"] == scans]
        own.sort(key=false_per_hour)
        value, low, high = (
            [float(row[f"detection{end}"]) for row in own] for end in ("", "_low", "_high")
        )
        bars = [
            [max(a - b, 0.0) for a, b in zip(value, low, strict=True)],
            [max(b - a, 0.0) for a, b in zip(value, high, strict=True)],
        ]
        axis.errorbar(
            [false_per_hour(row) for row in own],
            value,
            yerr=bars,
            fmt="o",
            color=colour,
            markerfacecolor=face,
            elinewidth=0.6,
            markersize=5,
            label=f"{scans} scans",
        )
    axis.set_title(method, loc="left", fontsize=11, weight="bold")
    axis.set_xscale("log")
    axis.set_ylim(-0.03, 1.05)
    axis.grid(alpha=0.3)


def draw(rows: Sequence[Row], path: Path) -> None:
    """Write the picture."""
    methods = list(dict.fromkeys(row["method"] for row in rows))
    horizons = sorted({row["scans"] for row in rows}, key=int)
    lines = -(-len(methods) // COLUMNS)
    figure, axes = plt.subplots(
        lines,
        COLUMNS,
        figsize=(14, 3.2 * lines),
        sharex=True,
        sharey=True,
        squeeze=False,
        layout="constrained",
    )
    for axis, method in zip(axes.flat, methods, strict=False):
        panel(axis, method, rows, horizons)
    axes[0, 0].legend(loc="lower right", fontsize=9)
    figure.supxlabel("false + misplaced starts per hour (none: half a start in all runs)")
    figure.supylabel("P_D")
    figure.suptitle(
        f"{rows[0]['scenario']}: few to many false tracks; {rows[0]['runs']} runs, "
        f"seed {rows[0]['seed']}, 95 % intervals; grey: all methods after {horizons[-1]} scans",
        fontsize=11,
    )
    figure.savefig(path, dpi=100)


def table(rows: Sequence[Row], method: str) -> str:
    """One method's points as Markdown, the horizons side by side."""
    horizons = sorted({row["scans"] for row in rows}, key=int)
    heads = [f"P_D, {scans} pings | false/h" for scans in horizons]
    lines = [f"| point | {' | '.join(heads)} | redundant per run | NEES |"]
    lines.append("|---" * (2 * len(horizons) + 3) + "|")
    own = {(row["point"], row["scans"]): row for row in rows if row["method"] == method}
    for point in dict.fromkeys(point for point, _ in own):
        cells = []
        for scans in horizons:
            row = own[point, scans]
            value, low, high = (
                f"{float(row[f'detection{end}']):.2f}" for end in ("", "_low", "_high")
            )
            cells += [f"{value} ({low}-{high})", with_interval(row, "false_per_hour")]
        cells += [with_interval(row, name) for name in ("redundant_per_run", "nees")]
        lines.append(f"| {point} | {' | '.join(cells)} |")
    return "\n".join(lines)


def main() -> None:
    """Draw, and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("table", type=Path, help="evaluation.csv")
    parser.add_argument("--picture", type=Path, default=Path("docs/pictures/methods_curve.png"))
    options = parser.parse_args()
    with options.table.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    draw(rows, options.picture)
    for method in dict.fromkeys(row["method"] for row in rows):
        print(f"{method}\n\n{table(rows, method)}\n")


if __name__ == "__main__":
    main()
