"""Pictures of an evaluation: operating curves, time to confirm, NEES. They need matplotlib."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.tools.evaluation.intervals import Estimate, error_bars
from tsepm_ros.tools.evaluation.measures import SECONDS_PER_HOUR
from tsepm_ros.tools.evaluation.performance import MIN_FALSE_STARTS, Curve, Evaluated
from tsepm_ros.tools.pictures.plan_marks import PointLabel, label_points
from tsepm_ros.whole_files import written_whole

matplotlib.use("Agg")


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
        Evaluations of the scenario by horizon, a panel each.
    folder : Path
        Folder of the pictures.
    caption : str
        Text below the title of each picture.

    Returns
    -------
    list of Path
    """
    name = evaluated[0].scenario.name
    height = 2.0 + 0.26 * len(evaluated[0].points)
    panels = {
        "operating_curve": (
            _operating_curve,
            "targets found against false and misplaced tracks",
            6.5,
        ),
        "time_to_confirm": (
            _time_to_confirm,
            "time to a true track, median (full) and 95 % quantile (hollow)",
            height,
        ),
        "nees": (
            _nees,
            "NEES of pure tracks (full) and of all true tracks (hollow)",
            height,
        ),
    }
    written = []
    for kind, (panel, title, panel_height) in panels.items():
        figure = _picture(evaluated, panel, f"{name}: {title}\n{caption}", panel_height)
        if panel is _operating_curve:  # after all other elements are placed
            for axis, evaluation in zip(figure.axes, evaluated, strict=True):
                label_points(axis, _point_labels(evaluation))
        written.append(folder / f"{name}_{kind}.png")
        with written_whole(written[-1]) as temporary:
            figure.savefig(temporary, dpi=DOTS_PER_INCH)
        plt.close(figure)
    return written


def _picture(
    evaluated: Sequence[Evaluated],
    panel: Callable[[Axes, Evaluated], None],
    title: str,
    height: float,
) -> Figure:
    """Panels side by side, one per horizon."""
    width = 1.5 + 6.5 * len(evaluated)
    figure, axes = plt.subplots(
        1, len(evaluated), figsize=(width, height), squeeze=False, sharey=True, layout="constrained"
    )
    for axis, evaluation in zip(axes[0], evaluated, strict=True):
        panel(axis, evaluation)
        axis.set_title(f"after {evaluation.scans} pings", loc="left", fontsize=10)
        axis.grid(alpha=0.3)
    figure.suptitle(title, fontsize=11)
    return figure


def _styles(evaluation: Evaluated) -> dict[str, tuple[str, str]]:
    """Colour and marker of each method."""
    methods = dict.fromkeys(point.method for point in evaluation.points)
    cycles = [divmod(index, len(COLOURS)) for index in range(len(methods))]
    return {
        method: (COLOURS[index], MARKERS[(index + cycle) % len(MARKERS)])
        for method, (cycle, index) in zip(methods, cycles, strict=True)
    }


def _operating_curve(axis: Axes, evaluation: Evaluated) -> None:
    """A marker with intervals per point, and the operating curve of each method."""
    x, y = _coordinates(evaluation)
    false = [measures.false_density for measures in evaluation.measures]
    detection = [measures.detection for measures in evaluation.measures]
    x_bars, y_bars = error_bars(x, false), error_bars(y, detection)
    methods = np.array([point.method for point in evaluation.points])
    for method, (colour, marker) in _styles(evaluation).items():
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
        xlabel="false and misplaced tracks per ping and km² (none in all runs: half a track)",
        ylabel="fraction of targets with a true track, P_D",
    )
    axis.legend(loc="lower right")
    _add_hourly_axis(axis, evaluation)


def _coordinates(evaluation: Evaluated) -> tuple[FloatArray, FloatArray]:
    """Coordinates of the points: false starts per scan and km^2, and P_D."""
    unit = evaluation.scans * evaluation.scenario.area / 1e6
    min_false = MIN_FALSE_STARTS / evaluation.measures[0].runs / unit
    false = np.array([measures.false_density.value for measures in evaluation.measures])
    detection = np.array([measures.detection.value for measures in evaluation.measures])
    return np.maximum(false, min_false), detection


def _point_labels(evaluation: Evaluated) -> list[PointLabel]:
    styles = _styles(evaluation)
    return [
        PointLabel(point.label, x, y, styles[point.method][0])
        for point, x, y in zip(evaluation.points, *_coordinates(evaluation), strict=True)
    ]


def _add_hourly_axis(axis: Axes, evaluation: Evaluated) -> None:
    """Second axis above: false starts per hour."""
    factor = evaluation.scenario.area / 1e6 * SECONDS_PER_HOUR / evaluation.scenario.period
    above = axis.secondary_xaxis(
        "top",
        functions=(
            lambda rate: np.multiply(rate, factor),
            lambda rate: np.divide(rate, factor),
        ),
    )
    above.set_xlabel("false and misplaced tracks per hour")


def _time_to_confirm(axis: Axes, evaluation: Evaluated) -> None:
    _rows(axis, evaluation, "confirmation_median", "confirmation_95")
    axis.set(xlabel="time from the first ping to the track, s", xlim=(0.0, None))


def _nees(axis: Axes, evaluation: Evaluated) -> None:
    _rows(axis, evaluation, "pure_nees", "nees")
    axis.axvline(IDEAL_NEES, color="grey", linestyle="--", linewidth=1)
    axis.annotate(
        " ideal 4", (IDEAL_NEES, 0.0), xycoords=("data", "axes fraction"), va="bottom", color="grey"
    )
    axis.set(
        xlabel="normalised estimation error squared (NEES); larger: over-confident", xscale="log"
    )
    axis.set_xticks(NEES_TICKS, [f"{tick:g}" for tick in NEES_TICKS])
    axis.minorticks_off()


def _rows(axis: Axes, evaluation: Evaluated, full: str, hollow: str) -> None:
    """Two figures per operating point, one row per point."""
    styles = _styles(evaluation)
    for row, (point, measures) in enumerate(
        zip(evaluation.points, evaluation.measures, strict=True)
    ):
        colour, marker = styles[point.method]
        for name, face, shift in ((full, colour, -0.12), (hollow, "white", 0.12)):
            estimate: Estimate = getattr(measures, name)
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
    labels = [f"{point.method}  {point.label}" for point in evaluation.points]
    axis.set_yticks(range(len(labels)), labels, fontsize=9)
    axis.set_ylim(len(labels) - 0.4, -0.6)
