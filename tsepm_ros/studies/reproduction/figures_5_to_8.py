"""TSEPM 2018, Figs. 5-8: curves, and claims on them.

TSEPM 2018, Figs. 5-8: the curves over the clutter density and the measurement error.

TSEPM 2018, Figs. 5-8: claims of the text about the curves, and their verdicts.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from scipy.special import ndtr

from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.numerics.gaussian import gate_factor
from tsepm_ros.studies.reproduction import runs
from tsepm_ros.studies.reproduction.document import Column, Part, Picture, Table
from tsepm_ros.studies.reproduction.monte_carlo import (
    CURVES,
    DENSITIES,
    ERRORS,
    RULE,
    TARGET,
    Point,
    run_comparison,
    sensor_at,
)
from tsepm_ros.studies.reproduction.published import (
    FIGURE_7_DENSITY,
    FIGURE_7_MARKS,
    GATE_PROBABILITY,
    MAX_SPEED,
    PERIOD,
)
from tsepm_ros.studies.reproduction.runs import Result, Setting
from tsepm_ros.tools.design.expected_counts import rule_detection_probability
from tsepm_ros.tools.evaluation.intervals import Estimate, error_bars, mean, mean_count, proportion
from tsepm_ros.tracker.measurement import position_covariance


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
        return [runs.ratio(*self.counted(name, place)[1:]) for place in self.places]

    def density(self, name: str) -> list[Estimate]:
        """False and misplaced tracks per scan and km^2 along the curve."""
        units = [point.scenario.scans * point.scenario.area / 1e6 for point in self.points]
        wrong = [mean_count(self.counted(name, place)[1]) for place in self.places]
        return [count / unit for count, unit in zip(wrong, units, strict=True)]

    def rise(self, name: str, first: int = 0, last: int = -1) -> Estimate:
        """Difference of P_D from one point to a later one."""
        places = list(self.places)
        return runs.share_difference(
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
            return runs.ratio_difference((other_wrong, other_starts), (wrong, starts))
        return runs.mean_difference(other_wrong, wrong)

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


MAX_EQUAL_DIFFERENCE = 0.05
"""Maximum difference of two approximately equal P_D: a choice."""
MODEL = "multiple model"
READINGS = (
    ("tsepm, f1 literal", "clutter test, size 0.05"),
    ("tsepm, f1 squared", "clutter test, size 0.05"),
    ("tsepm, f1 literal", "clutter test, size 0.5"),
    ("tsepm, f1 squared", "clutter test, size 0.5"),
    ("tsepm, f2 size 0.05", "clutter test, size 0.05"),
    ("tsepm, f2 size 0.5", "clutter test, size 0.5"),
)
"""Possible curves of the source, which states neither its evaluation nor the test's size."""


def gate_hit_probability(error: float, k: int) -> float:
    """Probability that a target's detection lies in the gate of that k scans before (Eq. 4).

    Both detections have an error; the gate's margin covers only one.

    Parameters
    ----------
    error : float
        Larger axis of the measurement error at the target, m.
    k : int
        Interval of the two detections, scans.
    """
    sensor = sensor_at(error)
    range_, azimuth = float(np.hypot(*TARGET)), np.arctan2(TARGET[1], TARGET[0])
    covariance = 2.0 * position_covariance(
        range_, azimuth, sensor.range_variance(range_), sensor.azimuth_std
    )
    variances, axes = np.linalg.eigh(covariance)
    sigma = np.sqrt(variances)
    offset = axes.T @ np.array([5.0 * k * PERIOD, 0.0])
    radius = MAX_SPEED * k * PERIOD + gate_factor(GATE_PROBABILITY) * error
    x = np.linspace(-radius, radius, 4001)
    half = np.sqrt(radius**2 - x**2)
    density = np.exp(-0.5 * ((x - offset[0]) / sigma[0]) ** 2) / (np.sqrt(2 * np.pi) * sigma[0])
    across = ndtr((half - offset[1]) / sigma[1]) - ndtr((-half - offset[1]) / sigma[1])
    values = density * across
    return float(((values[1:] + values[:-1]) / 2 * np.diff(x)).sum())


def one_start(error: float) -> float:
    """P_D of one start without clutter or pruning, with the gate of a measurement error."""
    return rule_detection_probability(*RULE, 0.9, gate_hit_probability(error, 1))


def parts(
    setting: Setting, by_density: Sequence[Point] = DENSITIES, by_error: Sequence[Point] = ERRORS
) -> list[Part]:
    """The curves, and the claims of the text about them."""
    results = setting.results(run_comparison, [*by_density, *by_error])
    densities = Curves(by_density, results[: len(by_density)])
    errors = Curves(by_error, results[len(by_density) :])
    verdicts = claims(densities, errors)
    return [
        "### Figs. 5-8",
        "The figures survive as orderings and two marks. Not said: p_d (here 0.9), the densities, "
        "what the measurement error is (here sigma_Rmax, the larger axis where the target is, both "
        "errors of Section 5.1 scaled alike), the target's heading (here along x), TSEPM's "
        "evaluation (f1 with Eq. 26 literal or squared, or Kennedy's f2), the test's size, what "
        f"P_F is a share of. All use {RULE[0]}/{RULE[1]}, gates of 0.9, 8 scans and clutter in "
        "36 km² round the target; false is false + misplaced.",
        Table(
            "tsepm_2018_figures_claims",
            [
                Column("figure"),
                Column("the text says"),
                *(Column(f"{a}; {b}".replace("clutter test", "test")) for a, b in READINGS),
            ],
            verdicts,
        ),
        f"Claims that hold, of {len(verdicts)}: "
        + "; ".join(
            f"{a} and {b} {sum(row[2 + place] == runs.HOLDS for row in verdicts)}"
            for place, (a, b) in enumerate(READINGS)
        )
        + ". No reading of the evaluation and of the test's size was chosen for that.",
        f"Approximately equal is within {MAX_EQUAL_DIFFERENCE:g}, which is a choice; a verdict "
        "*undecided* is one that the 95 % intervals leave open.",
        densities.table("tsepm_2018_figures_5_6", "density [1/m²]", ".1e"),
        errors.table("tsepm_2018_figures_7_8", "error [m]", "g"),
        densities.picture("tsepm_2018_figures_5_6", "Figs. 5 and 6", "clutter density [1/m²]"),
        errors.picture(
            "tsepm_2018_figures_7_8",
            "Figs. 7 and 8",
            f"measurement error [m], at {FIGURE_7_DENSITY:g} per m²",
            one_start,
            FIGURE_7_MARKS,
        ),
        *_gate_parts(),
    ]


Judge = Callable[[str, str], str]
"""Verdict on a claim, for the curves that stand for TSEPM and for the clutter test."""
UNITS = ("per start", "per run")
"""Readings of the denominator of P_F."""


def claims(densities: Curves, errors: Curves) -> list[list[str]]:
    """Claims of the text about the figures, with a verdict under each reading."""
    mark = errors.place(FIGURE_7_MARKS[1])
    listed: list[tuple[str, str, Judge]] = [
        ("5", "P_D of TSEPM and of the test approximately equal", partial(equal, densities)),
        (
            "5",
            "TSEPM's P_D does not decrease with density",
            lambda a, b: runs.is_not_below(densities.rise(a), MAX_EQUAL_DIFFERENCE),
        ),
        (
            "5",
            "the test's P_D does not decrease with density",
            lambda a, b: runs.is_not_below(densities.rise(b), MAX_EQUAL_DIFFERENCE),
        ),
        (
            "5",
            "the multiple model's P_D decreases with density, step by step",
            lambda a, b: falls(densities, MODEL),
        ),
        *_false_claims("6", densities),
        ("7", "P_D of TSEPM and of the test approximately equal", partial(equal, errors)),
        (
            "7",
            "the multiple model's P_D decreases, step by step",
            lambda a, b: falls(errors, MODEL),
        ),
        (
            "7",
            "TSEPM's P_D falls at each step from 75 to 120 m, faster than at any below 75 m",
            lambda a, b: falls_faster(errors, a),
        ),
        (
            "7",
            "TSEPM's P_D does not vary beyond 120 m",
            lambda a, b: runs.is_within(errors.rise(a, mark), MAX_EQUAL_DIFFERENCE),
        ),
        *_false_claims("8", errors),
        *(
            (
                "8",
                f"P_F of {who} rises with the error, {unit}",
                lambda a, b, place=place, unit=unit: rises(errors, (a, b, MODEL)[place], unit),
            )
            for place, who in enumerate(("TSEPM", "the test", "the multiple model"))
            for unit in UNITS
        ),
    ]
    return [
        [figure, text, *(judge(*reading) for reading in READINGS)] for figure, text, judge in listed
    ]


def _false_claims(figure: str, curves: Curves) -> list[tuple[str, str, Judge]]:
    return [
        (figure, f"P_F of {text}, {unit}", partial(judge, unit))
        for unit in UNITS
        for text, judge in (
            ("TSEPM below the test's", lambda unit, a, b: fewer(curves, a, b, unit)),
            (
                "the test below the multiple model's",
                lambda unit, a, b: fewer(curves, b, MODEL, unit),
            ),
        )
    ]


def equal(curves: Curves, first: str, second: str) -> str:
    """Whether P_D of two curves is about the same at each point."""
    differences = [
        runs.share_difference(curves.found(first, place), curves.found(second, place))
        for place in curves.places
    ]
    return runs.everywhere([runs.is_within(d, MAX_EQUAL_DIFFERENCE) for d in differences])


def fewer(curves: Curves, first: str, second: str, unit: str) -> str:
    """Whether P_F of a curve is below another's at each point."""
    pairs = [((second, place), (first, place)) for place in curves.places]
    return _all_fall(curves, pairs, unit)


def rises(curves: Curves, name: str, unit: str) -> str:
    """Whether P_F rises from each point to the next."""
    pairs = [((name, place), (name, place - 1)) for place in curves.places[1:]]
    return _all_fall(curves, pairs, unit)


def _all_fall(
    curves: Curves, pairs: Sequence[tuple[tuple[str, int], tuple[str, int]]], unit: str
) -> str:
    """Whether P_F of the second of each pair of points is below that of the first."""
    differences = [curves.rise_of_false(*pair, unit == "per start") for pair in pairs]
    return runs.everywhere([runs.is_below(difference) for difference in differences])


def falls(curves: Curves, name: str) -> str:
    """Whether P_D falls from each point to the next."""
    rises = [curves.rise(name, place - 1, place) for place in curves.places[1:]]
    return runs.everywhere([runs.is_below(rise) for rise in rises])


def falls_faster(curves: Curves, name: str) -> str:
    """Whether P_D falls at each step between the marks, faster than at each step below them."""
    first, last = map(curves.place, FIGURE_7_MARKS)
    found = np.array([curves.found(name, place) for place in curves.places])
    values = np.array([point.value for point in curves.points])
    slopes = (np.diff(found, axis=0) / np.diff(values)[:, None])[:last]
    between, below = slopes[first:], slopes[:first]
    verdicts = [runs.is_below(mean(slope)) for slope in between]
    verdicts += [runs.is_below(mean(slope - lower)) for slope in between for lower in below]
    return runs.everywhere(verdicts)


def _gate_parts() -> list[Part]:
    columns = [
        Column("error [m]", "g"),
        Column("one scan", ".4f"),
        Column("two scans", ".4f"),
        Column("P_D of one start", ".4f"),
    ]
    rows = [
        [error, gate_hit_probability(error, 1), gate_hit_probability(error, 2), one_start(error)]
        for error in (*(point.value for point in ERRORS), 300.0, 1000.0)
    ]
    return [
        "**The gate.** The text explains Fig. 7 by the probability that a detected target falls "
        "into the gate of Eq. 4: roughly 1 below 75 m, falling to 0.9 up to 120 m, 0.9 beyond. "
        "Computed: the difference of two detections has the errors of both, the margin only one, "
        "so that the probability goes on falling, without a mark, towards 1 - sqrt(1 - P) = "
        f"{1 - np.sqrt(1 - GATE_PROBABILITY):.3f} for equal axes and not 0.9; the last column is "
        "the closed form of Table 1 with it.",
        Table("tsepm_2018_gate", columns, rows),
    ]
