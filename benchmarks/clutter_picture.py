"""The race's figures as a picture."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

os.environ.setdefault(
    "MPLCONFIGDIR", str(Path(__file__).resolve().parents[1] / "build" / "matplotlib")
)

import matplotlib

matplotlib.use("Agg")

import numpy as np
from clutter_figures import REFERENCE, Heat, Summary, raw_before_cut, settled, summarise
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

# Colours that stay apart for colour-blind readers (Okabe and Ito).
STYLES = {
    "tsepm-3/4": ("#56B4E9", "v"),
    "tsepm-5/8": ("#0072B2", "o"),
    "tsepm-8/12": ("#009E73", "^"),
    "oracle-5/8": ("#000000", "s"),
    "stonesoup-5/8": ("#D55E00", "D"),
    "stonesoup-tuned-5/8": ("#E69F00", "D"),
    "stonesoup-xy-5/8": ("#B8A200", "D"),
    "norfair-5": ("#CC79A7", "P"),
}
SIZE = (15.0, 11.0)
DOTS_PER_INCH = 110

Figures = dict[str, list[Summary]]


def draw(heats: Sequence[Heat], path: Path) -> None:
    """Draw times, ratios, counts and memory against clutter density.

    Parameters
    ----------
    heats : sequence of Heat
        In the order of their densities.
    path : Path
        Where the picture goes.
    """
    figures = {name: [summarise(heat, name) for heat in heats] for name in heats[0].lanes}
    figure, axes = plt.subplots(2, 2, figsize=SIZE, layout="constrained")
    _draw_times(axes[0, 0], heats, figures)
    _draw_ratios(axes[0, 1], heats, figures)
    _draw_counts(axes[1, 0], heats, figures)
    _draw_memory(axes[1, 1], heats, figures)
    for axis in axes.flat:
        _dress(axis, heats)
    _title(figure, heats)
    _key(figure, figures)
    figure.savefig(path, dpi=DOTS_PER_INCH)
    plt.close(figure)


def _title(figure: Figure, heats: Sequence[Heat]) -> None:
    sea = heats[0].scene.sea
    figure.suptitle(
        f"{sea.max_range / 1e3:g} km disc, T = {sea.period:g} s, "
        f"{100 * sea.range_std_fraction:g} % and {np.degrees(sea.azimuth_std):g}°, "
        f"{len(heats[0].scene.scans)} scans a density; all contenders on the same scans, "
        "one thread each"
    )


def _key(figure: Figure, figures: Figures) -> None:
    """One legend for all parts."""
    marks = [
        Line2D([], [], color=STYLES[name][0], marker=STYLES[name][1], label=name)
        for name in figures
    ]
    hollow = Line2D([], [], color="grey", marker="o", markerfacecolor="white", linestyle="")
    hollow.set_label("stopped at a time limit (upper left)")
    figure.legend(handles=[*marks, hollow], loc="outside lower center", ncols=5)


def _dress(axis: Axes, heats: Sequence[Heat]) -> None:
    axis.set_xscale("log")
    axis.set_yscale("log")
    axis.set_xlabel("clutter density, per scan and m²")
    densities = [heat.density for heat in heats]
    labels = [heat.name.replace("e-0", "e-") for heat in heats]
    axis.set_xticks(densities, labels)
    axis.minorticks_off()
    axis.grid(alpha=0.3)


def _draw_times(axis: Axes, heats: Sequence[Heat], figures: Figures) -> None:
    """Median with a bar up to the worst scan; hollow where a contender was stopped."""
    axis.set_title("time per scan: median of settled scans, bar up to the worst of all")
    axis.set_ylabel("s")
    densities = np.array([heat.density for heat in heats])
    for place, (name, items) in enumerate(figures.items()):
        color, marker = STYLES[name]
        x = densities * 1.03 ** (place - len(figures) / 2)  # side by side
        median = np.array([item.median for item in items])
        worst = np.array([item.worst for item in items])
        axis.plot(x, median, color=color, label=name)
        axis.vlines(x, median, worst, color=color, alpha=0.6, linewidth=1.5)
        for at, value, item in zip(x, median, items, strict=True):
            face = "white" if item.stopped else color
            axis.plot(at, value, marker, color=color, markerfacecolor=face)
    period = heats[0].scene.sea.period
    axis.axhline(period, color="grey", linestyle="--", linewidth=1)
    axis.text(densities[0], period, " scan period", va="bottom", color="grey")
    axis.axhline(period / 10.0, color="grey", linestyle=":", linewidth=1)
    axis.text(densities[0], period / 10.0, " a tenth of it", va="bottom", color="grey")


def _draw_ratios(axis: Axes, heats: Sequence[Heat], figures: Figures) -> None:
    axis.set_title(f"processor time / that of {REFERENCE}, scan by scan: median and 10-90 %")
    axis.set_ylabel(f"times as long as {REFERENCE}")
    for name, items in figures.items():
        points = [
            (heat.density, item.ratio)
            for heat, item in zip(heats, items, strict=True)
            if item.ratio is not None
        ]
        if name == REFERENCE or not points:
            continue
        color, marker = STYLES[name]
        x = [density for density, _ in points]
        axis.plot(x, [ratio.median for _, ratio in points], marker + "-", color=color, label=name)
        axis.fill_between(
            x,
            [ratio.low for _, ratio in points],
            [ratio.high for _, ratio in points],
            color=color,
            alpha=0.15,
            linewidth=0,
        )
    axis.axhline(1.0, color="grey", linewidth=1)


def _draw_counts(axis: Axes, heats: Sequence[Heat], figures: Figures) -> None:
    """Measured counts as marks, the theory as lines."""
    axis.set_title("per settled scan: measured (marks) and splitting tree theory (lines)")
    axis.set_ylabel("count")
    x = np.array([heat.density for heat in heats])
    for name in heats[0].theory:
        color, marker = STYLES[name]
        items = figures[name]
        parts = [settled(item.scans) for item in items]
        expected = [(heat.theory[name], part) for heat, part in zip(heats, parts, strict=True)]
        potential = np.array([item.mean_counts.get("potential", np.nan) for item in items])
        raw = np.array([raw_before_cut(item.mean_counts) for item in items])
        axis.plot(x, potential, marker, color=color)
        axis.plot(
            x,
            np.where(raw > 0.0, raw, np.nan),
            marker,
            color=color,
            markerfacecolor="white",
        )
        axis.plot(x, [item.potential[part].mean() for item, part in expected], color=color)
        axis.plot(x, [item.raw[part].mean() for item, part in expected], "--", color=color)
    axis.set_ylim(bottom=0.03)
    axis.plot([], [], "o-", color="grey", label="potential tracks")
    axis.plot([], [], "o--", color="grey", markerfacecolor="white", label="raw confirmations")
    axis.legend(loc="upper left")


def _draw_memory(axis: Axes, heats: Sequence[Heat], figures: Figures) -> None:
    axis.set_title("peak memory of the process, imports included")
    axis.set_ylabel("MB")
    x = [heat.density for heat in heats]
    for name, items in figures.items():
        color, marker = STYLES[name]
        axis.plot(x, [item.memory for item in items], marker + "-", color=color, label=name)
    axis.axhline(1000.0, color="grey", linestyle="--", linewidth=1)
    axis.text(x[0], 1000.0, " 1 GB", va="bottom", color="grey")
