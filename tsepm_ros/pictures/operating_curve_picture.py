"""Pictures of an evaluation: operating curves, time to confirm, NEES. They need matplotlib."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import matplotlib

from tsepm_ros.numerics.arrays import FloatArray

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tsepm_ros.analysis.intervals import Estimate, error_bars
from tsepm_ros.analysis.measures import SECONDS_PER_HOUR
from tsepm_ros.analysis.operating_curve import LEAST_FALSE, Curve
from tsepm_ros.analysis.performance import Evaluated
from tsepm_ros.pictures.point_labels import PointLabel, label_points

# Colours that stay apart for colour-blind readers (Okabe and Ito).
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
MARKERS = "osD^vPX"
DOTS_PER_INCH = 110
IDEAL_NEES = 4.0
NEES_TICKS = (1.0, 2.0, 3.0, 4.0, 6.0, 10.0, 20.0)


def draw(evaluated: Sequence[Evaluated], folder: Path, caption: str) -> list[Path]:
    """Draw the pictures of one scenario.

    Parameters
    ----------
    evaluated : sequence of Evaluated
        The scenario's horizons, a panel each.
    folder : Path
        Where they go.
    caption : str
        What all of them say below their title.

    Returns
    -------
    list of Path
    """
    name = evaluated[0].scenario.name
    height = 2.0 + 0.26 * len(evaluated[0].points)
    panels = {
        "operating_curve": (_operating_curve, "P_D against false + misplaced starts", 6.5),
        "time_to_confirm": (
            _time_to_confirm,
            "time to confirm, median (full) and 95 % quantile (hollow)",
            height,
        ),
        "nees": (_nees, "NEES of pure starts (full) and of all true starts (hollow)", height),
    }
    written = []
    for kind, (panel, title, high) in panels.items():
        figure = _picture(evaluated, panel, f"{name}: {title}\n{caption}", high)
        if panel is _operating_curve:  # once all else is in its place
            for axis, one in zip(figure.axes, evaluated, strict=True):
                label_points(axis, _point_labels(one))
        written.append(folder / f"{name}_{kind}.png")
        figure.savefig(written[-1], dpi=DOTS_PER_INCH)
        plt.close(figure)
    return written


def _picture(
    evaluated: Sequence[Evaluated],
    panel: Callable[[Axes, Evaluated], None],
    title: str,
    height: float,
) -> Figure:
    """A panel per horizon, side by side."""
    width = 1.5 + 6.5 * len(evaluated)
    figure, axes = plt.subplots(
        1, len(evaluated), figsize=(width, height), squeeze=False, sharey=True, layout="constrained"
    )
    for axis, one in zip(axes[0], evaluated, strict=True):
        panel(axis, one)
        axis.set_title(f"after {one.scans} scans", loc="left", fontsize=10)
        axis.grid(alpha=0.3)
    figure.suptitle(title, fontsize=11)
    return figure


def _looks(one: Evaluated) -> dict[str, tuple[str, str]]:
    """Colour and marker of each method."""
    methods = dict.fromkeys(point.method for point in one.points)
    turns = [divmod(place, len(COLOURS)) for place in range(len(methods))]
    return {
        method: (COLOURS[place], MARKERS[(place + turn) % len(MARKERS)])
        for method, (turn, place) in zip(methods, turns, strict=True)
    }


def _operating_curve(axis: Axes, one: Evaluated) -> None:
    """A marker per point with its intervals, and the line that its method is compared by."""
    x, y = _places(one)
    false = [figures.false_density for figures in one.figures]
    detection = [figures.detection for figures in one.figures]
    x_bars, y_bars = error_bars(x, false), error_bars(y, detection)
    methods = np.array([point.method for point in one.points])
    for method, (colour, marker) in _looks(one).items():
        rows = methods == method
        curve = Curve.of(x[rows], y[rows])
        axis.plot(np.exp(curve.log_false), curve.detection, color=colour, linewidth=1, alpha=0.6)
        axis.errorbar(
            x[rows],
            y[rows],
            xerr=x_bars[:, rows],
            yerr=y_bars[:, rows],
            fmt=marker,
            color=colour,
            markersize=5,
            elinewidth=0.8,
            label=method,
        )
    axis.set(xscale="log", xlim=(0.5 * x.min(), None), ylim=(None, 1.06))
    axis.set(
        xlabel="false + misplaced per scan and km² (none: half a start in all runs)", ylabel="P_D"
    )
    axis.legend(loc="lower right")
    _hours(axis, one)


def _places(one: Evaluated) -> tuple[FloatArray, FloatArray]:
    """Where the points are: their false starts per scan and km^2, and P_D."""
    unit = one.scans * one.scenario.area / 1e6
    least = LEAST_FALSE / one.figures[0].runs / unit
    false = np.array([figures.false_density.value for figures in one.figures])
    detection = np.array([figures.detection.value for figures in one.figures])
    return np.maximum(false, least), detection


def _point_labels(one: Evaluated) -> list[PointLabel]:
    looks = _looks(one)
    return [
        PointLabel(point.label, x, y, looks[point.method][0])
        for point, x, y in zip(one.points, *_places(one), strict=True)
    ]


def _hours(axis: Axes, one: Evaluated) -> None:
    """The same axis per hour, above."""
    factor = one.scenario.area / 1e6 * SECONDS_PER_HOUR / one.scenario.period
    above = axis.secondary_xaxis(
        "top",
        functions=(
            lambda rate: np.multiply(rate, factor),
            lambda rate: np.divide(rate, factor),
        ),
    )
    above.set_xlabel("per hour")


def _time_to_confirm(axis: Axes, one: Evaluated) -> None:
    _rows(axis, one, "confirmation_median", "confirmation_95")
    axis.set(xlabel="s after the first scan", xlim=(0.0, None))


def _nees(axis: Axes, one: Evaluated) -> None:
    _rows(axis, one, "pure_nees", "nees")
    axis.axvline(IDEAL_NEES, color="grey", linestyle="--", linewidth=1)
    axis.annotate(
        " ideal 4", (IDEAL_NEES, 0.0), xycoords=("data", "axes fraction"), va="bottom", color="grey"
    )
    axis.set(xlabel="NEES", xscale="log")
    axis.set_xticks(NEES_TICKS, [f"{tick:g}" for tick in NEES_TICKS])
    axis.minorticks_off()


def _rows(axis: Axes, one: Evaluated, full: str, hollow: str) -> None:
    """Two figures of every point, a row each."""
    looks = _looks(one)
    for row, (point, figures) in enumerate(zip(one.points, one.figures, strict=True)):
        colour, marker = looks[point.method]
        for name, face, shift in ((full, colour, -0.12), (hollow, "white", 0.12)):
            estimate: Estimate = getattr(figures, name)
            value = np.array([estimate.value])
            axis.errorbar(
                value,
                [row + shift],
                xerr=error_bars(value, [estimate]),
                fmt=marker,
                color=colour,
                markerfacecolor=face,
                markersize=5,
                elinewidth=0.9,
            )
    labels = [f"{point.method}  {point.label}" for point in one.points]
    axis.set_yticks(range(len(labels)), labels, fontsize=9)
    axis.set_ylim(len(labels) - 0.4, -0.6)
