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
"""Picture of an evaluation: its operating curves. It needs matplotlib."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.tools.evaluation.intervals import interval_error_bars
from tsepm_ros.tools.evaluation.measures import SECONDS_PER_HOUR
from tsepm_ros.tools.evaluation.performance import (
    MIN_FALSE_STARTS,
    PerformanceCurve,
    PerformanceEvaluated,
)
from tsepm_ros.tools.pictures import plan_position
from tsepm_ros.whole_files import write_whole_picture

# Colours that stay apart for colour-blind readers (Okabe and Ito).
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
MARKERS = "osD^vPX"
DOTS_PER_INCH = 110


def draw_operating_curve(
    evaluated: Sequence[PerformanceEvaluated], folder: Path, caption: str
) -> Path:
    """Draw the picture of one scenario.

    Parameters
    ----------
    evaluated : sequence of PerformanceEvaluated
        Evaluations of the scenario by horizon, a panel each.
    folder : Path
        Folder of the picture.
    caption : str
        Text below the title.

    Returns
    -------
    Path
    """
    name = evaluated[0].scenario.name
    figure = Figure(figsize=(1.5 + 6.5 * len(evaluated), 6.5), layout="constrained")
    axes = figure.subplots(1, len(evaluated), squeeze=False, sharey=True)[0]
    for axis, evaluation in zip(axes, evaluated, strict=True):
        _draw(axis, evaluation)
        axis.set_title(f"after {evaluation.scans} pings", loc="left", fontsize=10)
        axis.grid(alpha=0.3)
    title = f"{name}: targets found against false and misplaced tracks\n{caption}"
    figure.suptitle(title, fontsize=11)
    for axis, evaluation in zip(axes, evaluated, strict=True):  # after all other elements
        styles = _styles(evaluation)
        labels = [
            plan_position.PointLabel(point.label, x, y, styles[point.method][0])
            for point, x, y in zip(evaluation.points, *_coordinates(evaluation), strict=True)
        ]
        plan_position.label_points(axis, labels)
    path = folder / f"{name}_operating_curve.png"
    write_whole_picture(path, figure, DOTS_PER_INCH)
    return path


def _styles(evaluation: PerformanceEvaluated) -> dict[str, tuple[str, str]]:
    """Colour and marker of each method."""
    methods = dict.fromkeys(point.method for point in evaluation.points)
    cycles = [divmod(index, len(COLOURS)) for index in range(len(methods))]
    return {
        method: (COLOURS[index], MARKERS[(index + cycle) % len(MARKERS)])
        for method, (cycle, index) in zip(methods, cycles, strict=True)
    }


def _draw(axis: Axes, evaluation: PerformanceEvaluated) -> None:
    """A marker with intervals per point, and the operating curve of each method."""
    x, y = _coordinates(evaluation)
    false = [measures.false_density for measures in evaluation.measures]
    found = [measures.found for measures in evaluation.measures]
    x_bars, y_bars = interval_error_bars(x, false), interval_error_bars(y, found)
    methods = np.array([point.method for point in evaluation.points])
    for method, (colour, marker) in _styles(evaluation).items():
        rows = methods == method
        curve = PerformanceCurve.of(x[rows], y[rows])
        axis.plot(np.exp(curve.log_false), curve.found, color=colour, linewidth=1, alpha=0.6)
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
    axis.set(
        xscale="log",
        xlim=(0.5 * x.min(), None),
        ylim=(None, 1.06),
        xlabel="false and misplaced tracks per ping and km² (none in all runs: half a track)",
        ylabel="share of targets with a true track, P_DT",
    )
    axis.legend(loc="lower right")
    factor = evaluation.scenario.area / 1e6 * SECONDS_PER_HOUR / evaluation.scenario.period
    above = axis.secondary_xaxis(
        "top",
        functions=(
            lambda rate: np.multiply(rate, factor),
            lambda rate: np.divide(rate, factor),
        ),
    )
    above.set_xlabel("false and misplaced tracks per hour")


def _coordinates(evaluation: PerformanceEvaluated) -> tuple[FloatArray, FloatArray]:
    """Coordinates of the points: false starts per scan and km^2, and P_DT."""
    unit = evaluation.scans * evaluation.scenario.area / 1e6
    min_false = MIN_FALSE_STARTS / evaluation.measures[0].runs / unit
    false = np.array([measures.false_density.value for measures in evaluation.measures])
    found = np.array([measures.found.value for measures in evaluation.measures])
    return np.maximum(false, min_false), found
