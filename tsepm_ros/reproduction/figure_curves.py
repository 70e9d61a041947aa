"""TSEPM 2018, Figs. 5-8: the curves over the clutter density and the measurement error."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tsepm_ros.analysis.intervals import Estimate, error_bars, mean_count, proportion
from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.reproduction import paired
from tsepm_ros.reproduction.document import Column, Picture, Table
from tsepm_ros.reproduction.monte_carlo import CURVES, Point
from tsepm_ros.reproduction.runs import Result


@dataclass(frozen=True)
class Curves:
    """The runs of two figures.

    Attributes
    ----------
    points : sequence of Point
    runs : sequence of sequence of dict
        Per point.
    """

    points: Sequence[Point]
    runs: Sequence[Sequence[Result]]

    def counted(self, name: str, place: int) -> FloatArray:
        """Target found (0 or 1), wrong tracks (false or misplaced) and starts, (3, runs)."""
        return np.array([run[name] for run in self.runs[place]], float).T

    def found(self, name: str, place: int) -> FloatArray:
        """Whether the target was found, per run."""
        return self.counted(name, place)[0]

    @property
    def places(self) -> range:
        """Places of the points."""
        return range(len(self.points))

    def place(self, value: float) -> int:
        """Place of the point at a value."""
        return [point.value for point in self.points].index(value)

    def detection(self, name: str) -> list[Estimate]:
        """P_D along the curve."""
        runs_found = (self.found(name, place) for place in self.places)
        return [proportion(int(found.sum()), len(found)) for found in runs_found]

    def per_start(self, name: str) -> list[Estimate]:
        """False and misplaced tracks per start along the curve."""
        return [paired.ratio(*self.counted(name, place)[1:]) for place in self.places]

    def density(self, name: str) -> list[Estimate]:
        """False and misplaced tracks per scan and km^2 along the curve."""
        units = [point.scenario.scans * point.scenario.area / 1e6 for point in self.points]
        wrong = [mean_count(self.counted(name, place)[1]) for place in self.places]
        return [count / unit for count, unit in zip(wrong, units, strict=True)]

    def rise(self, name: str, first: int = 0, last: int = -1) -> Estimate:
        """Difference of P_D from one point to a later one."""
        places = list(self.places)
        return paired.share_difference(
            self.found(name, places[last]), self.found(name, places[first])
        )

    def rise_of_false(
        self, before: tuple[str, int], after: tuple[str, int], per_start: bool
    ) -> Estimate:
        """Difference of P_F, per start or per run, from one point of a curve to another's."""
        (_, wrong, starts), (_, other_wrong, other_starts) = (
            self.counted(*point) for point in (before, after)
        )
        if per_start:
            return paired.ratio_difference((other_wrong, other_starts), (wrong, starts))
        return paired.mean_difference(other_wrong, wrong)

    def table(self, name: str, heading: str, spec: str) -> Table:
        """The curves as a table."""
        columns = [
            Column(heading, spec),
            Column("curve"),
            Column("P_D", ".3f"),
            Column("P_F per start", ".4f"),
            Column("false per scan and km²", ".4f"),
        ]
        per_curve = {
            curve: list(
                zip(self.detection(curve), self.per_start(curve), self.density(curve), strict=True)
            )
            for curve in CURVES
        }
        rows = [
            [point.value, curve, *per_curve[curve][place]]
            for place, point in enumerate(self.points)
            for curve in CURVES
        ]
        return Table(name, columns, rows)

    def picture(
        self,
        name: str,
        title: str,
        label: str,
        theory: Callable[[float], float] | None = None,
        marks: Sequence[float] = (),
    ) -> Picture:
        """P_D, P_F per start, and false tracks per scan and km^2, side by side.

        `theory` is P_D of one start without clutter as a function of the value; `marks` are values
        with a vertical line.
        """

        def draw(figure: Any) -> None:
            axes = figure.subplots(1, 3, sharex=True)
            x = np.array([point.value for point in self.points])
            panels: list[tuple[str, Callable[[str], list[Estimate]]]] = [
                ("P_D", self.detection),
                ("P_F per start", self.per_start),
                ("false + misplaced per scan and km²", self.density),
            ]
            for axis, (heading, values_of) in zip(axes, panels, strict=True):
                for k, curve in enumerate(CURVES):
                    _draw_curve(axis, x, values_of(curve), curve, k)
                axis.set_title(heading, loc="left", fontsize=10)
                axis.set_xlabel(label)
                axis.grid(alpha=0.3)
            for axis, (_, values_of) in zip(axes[1:], panels[1:], strict=True):
                values = [estimate.value for curve in CURVES for estimate in values_of(curve)]
                min_value = min((v for v in values if v > 0.0), default=1.0)
                axis.set(yscale="log", ylim=(0.5 * min_value, None))
            if theory:
                axes[0].plot(x, [theory(e) for e in x], "k:", label="one start, no clutter")
            for axis in axes:
                for mark in marks:
                    axis.axvline(mark, color="grey", lw=0.8, ls="--")
            axes[0].set_ylim(0.0, 1.04)
            axes[0].legend(fontsize=7)
            axes[0].get_figure().suptitle(
                f"{title} of TSEPM 2018 ({len(self.runs[0])} runs; 95 % intervals)"
            )

        return Picture(name, f"{title} of TSEPM 2018, regenerated", draw, (14.0, 5.0))


def _draw_curve(axis: Any, x: FloatArray, estimates: Sequence[Estimate], name: str, k: int) -> None:
    value = np.array([estimate.value for estimate in estimates])
    style = {"clutter": "--", "multiple": "-."}.get(name.split()[0], "-")
    axis.errorbar(
        x,
        value,
        yerr=error_bars(value, estimates),
        fmt="osD^vPX"[k],
        ls=style,
        color=f"C{k}",
        ms=4,
        lw=1,
        label=name,
    )
