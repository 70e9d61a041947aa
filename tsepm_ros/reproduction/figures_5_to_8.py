"""TSEPM 2018, Figs. 5-8: three methods over the clutter density and the measurement error."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import ndtr

from tsepm_ros.analysis.intervals import Estimate, mean, mean_count, proportion
from tsepm_ros.design.mn_rules import rule_detection_probability
from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.numerics.gaussian import gate_factor
from tsepm_ros.reproduction import paired
from tsepm_ros.reproduction.document import Column, Part, Picture, Table
from tsepm_ros.reproduction.monte_carlo import (
    CURVES,
    ERRORS,
    RULE,
    TARGET,
    Point,
    density_points,
    error_points,
    run_comparison,
    sensor_at,
)
from tsepm_ros.reproduction.published_tsepm_2018 import (
    FIGURE_7_DENSITY,
    FIGURE_7_MARKS,
    GATE_PROBABILITY,
    MAX_SPEED,
    PERIOD,
)
from tsepm_ros.reproduction.runs import Result, Setting, column
from tsepm_ros.sensing.conversion import position_covariance

EQUAL = 0.05
"""Difference up to which two P_D count as approximately equal: a choice."""
MODEL = "multiple model"
READINGS = (
    ("tsepm, f1 literal", "clutter test, size 0.05"),
    ("tsepm, f1 squared", "clutter test, size 0.05"),
    ("tsepm, f1 literal", "clutter test, size 0.5"),
    ("tsepm, f1 squared", "clutter test, size 0.5"),
    ("tsepm, f2 size 0.05", "clutter test, size 0.05"),
    ("tsepm, f2 size 0.5", "clutter test, size 0.5"),
)
"""Curves that may be the source's: its evaluation and the test's size are not said."""


def gate_hit_probability(error: float, k: int) -> float:
    """Probability that a target's detection lies in the gate of the one k scans before (Eq. 4).

    Both detections have an error, of which the gate's margin knows one.

    Parameters
    ----------
    error : float
        Larger axis of the measurement error where the target is, m.
    k : int
        Scans between the two.
    """
    sensor = sensor_at(error)
    range_, azimuth = float(np.hypot(*TARGET)), np.arctan2(TARGET[1], TARGET[0])
    spread = 2.0 * position_covariance(
        range_, azimuth, sensor.range_variance(range_), sensor.azimuth_std
    )
    variances, axes = np.linalg.eigh(spread)
    sigma = np.sqrt(variances)
    offset = axes.T @ np.array([5.0 * k * PERIOD, 0.0])
    radius = MAX_SPEED * k * PERIOD + gate_factor(GATE_PROBABILITY) * error
    x = np.linspace(-radius, radius, 4001)
    half = np.sqrt(radius**2 - x**2)
    density = np.exp(-0.5 * ((x - offset[0]) / sigma[0]) ** 2) / (np.sqrt(2 * np.pi) * sigma[0])
    across = ndtr((half - offset[1]) / sigma[1]) - ndtr((-half - offset[1]) / sigma[1])
    values = density * across
    return float(((values[1:] + values[:-1]) / 2 * np.diff(x)).sum())


def parts(setting: Setting) -> list[Part]:
    """The curves, and what the text says of them."""
    by_density, by_error = density_points(), error_points()
    results = setting.results(run_comparison, [*by_density, *by_error])
    densities = Curves(by_density, results[: len(by_density)])
    errors = Curves(by_error, results[len(by_density) :])
    said = claims(densities, errors)
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
            said,
        ),
        f"Claims that hold, of {len(said)}: "
        + "; ".join(
            f"{a} and {b} {sum(row[2 + place] == paired.HOLDS for row in said)}"
            for place, (a, b) in enumerate(READINGS)
        )
        + ". No reading of the evaluation and of the test's size was chosen for that.",
        f"Approximately equal is within {EQUAL:g}, which is a choice; a verdict *cannot tell* is "
        "one that the 95 % intervals leave open.",
        densities.table("tsepm_2018_figures_5_6", "density [1/m²]", ".1e"),
        errors.table("tsepm_2018_figures_7_8", "error [m]", "g"),
        densities.picture("tsepm_2018_figures_5_6", "Figs. 5 and 6", "clutter density [1/m²]"),
        errors.picture(
            "tsepm_2018_figures_7_8",
            "Figs. 7 and 8",
            f"measurement error [m], at {FIGURE_7_DENSITY:g} per m²",
            theory=True,
        ),
        *_gate_parts(),
    ]


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

    def found(self, name: str, place: int) -> FloatArray:
        """Whether the target was found, per run."""
        return column(self.runs[place], name, 0)

    def wrong(self, name: str, place: int) -> FloatArray:
        """False and misplaced tracks, per run."""
        return column(self.runs[place], name, 1)

    def starts(self, name: str, place: int) -> FloatArray:
        """Potential tracks started, per run."""
        return column(self.runs[place], name, 2)

    @property
    def places(self) -> range:
        """Places of the points."""
        return range(len(self.points))

    def place(self, value: float) -> int:
        """Place of the point at a value."""
        return [point.value for point in self.points].index(value)

    def detection(self, name: str) -> list[Estimate]:
        """P_D along the curve."""
        found = [self.found(name, place) for place in self.places]
        return [proportion(int(one.sum()), len(one)) for one in found]

    def per_start(self, name: str) -> list[Estimate]:
        """False and misplaced tracks per start along the curve."""
        return [
            paired.ratio(self.wrong(name, place), self.starts(name, place)) for place in self.places
        ]

    def density(self, name: str) -> list[Estimate]:
        """False and misplaced tracks per scan and km^2 along the curve."""
        estimates = []
        for place, point in enumerate(self.points):
            unit = point.scenario.scans * point.scenario.area / 1e6
            one = mean_count(self.wrong(name, place))
            estimates.append(Estimate(one.value / unit, one.low / unit, one.high / unit))
        return estimates

    def rise(self, name: str, first: int = 0, last: int = -1) -> Estimate:
        """Difference of P_D from one point to a later one."""
        places = list(self.places)
        return paired.share_difference(
            self.found(name, places[last]), self.found(name, places[first])
        )

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

    def picture(self, name: str, title: str, label: str, theory: bool = False) -> Picture:
        """P_D, P_F per start, and false tracks per scan and km^2, side by side."""

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
                values = [one.value for curve in CURVES for one in values_of(curve)]
                axis.set_yscale("log")
                axis.set_ylim(bottom=0.5 * min((v for v in values if v > 0.0), default=1.0))
            if theory:
                axes[0].plot(x, [one_start(e) for e in x], "k:", label="one start, no clutter")
                for axis in axes:
                    for mark in FIGURE_7_MARKS:
                        axis.axvline(mark, color="grey", lw=0.8, ls="--")
            axes[0].set_ylim(0.0, 1.04)
            axes[0].legend(fontsize=7)
            axes[0].get_figure().suptitle(
                f"{title} of TSEPM 2018 ({len(self.runs[0])} runs; 95 % intervals)"
            )

        return Picture(name, f"{title} of TSEPM 2018, regenerated", draw, (14.0, 5.0))


def _draw_curve(axis: Any, x: FloatArray, estimates: Sequence[Estimate], name: str, k: int) -> None:
    value = np.array([one.value for one in estimates])
    low = np.array([one.low for one in estimates])
    high = np.array([one.high for one in estimates])
    bars = np.maximum(np.nan_to_num([value - low, high - value]), 0.0)
    style = {"clutter": "--", "multiple": "-."}.get(name.split()[0], "-")
    axis.errorbar(
        x, value, yerr=bars, fmt="osD^vPX"[k], ls=style, color=f"C{k}", ms=4, lw=1, label=name
    )


Judge = Callable[[str, str], str]
"""Verdict on a claim, for the curves that stand for TSEPM and for the clutter test."""


def claims(densities: Curves, errors: Curves) -> list[list[str]]:
    """What the text says of the figures, and whether it holds under each reading."""
    listed: list[tuple[str, str, Judge]] = [
        ("5", "P_D of TSEPM and of the test approximately equal", _equal(densities)),
        (
            "5",
            "TSEPM's P_D does not decrease with density",
            lambda a, b: paired.is_not_below(densities.rise(a), EQUAL),
        ),
        (
            "5",
            "the test's P_D does not decrease with density",
            lambda a, b: paired.is_not_below(densities.rise(b), EQUAL),
        ),
        (
            "5",
            "the multiple model's P_D decreases with density, step by step",
            lambda a, b: _falls(densities, MODEL),
        ),
        *_false_claims("6", densities),
        ("7", "P_D of TSEPM and of the test approximately equal", _equal(errors)),
        (
            "7",
            "the multiple model's P_D decreases, step by step",
            lambda a, b: _falls(errors, MODEL),
        ),
        (
            "7",
            "TSEPM's P_D falls at each step from 75 to 120 m, faster than at any below 75 m",
            lambda a, b: _falls_faster(errors, a),
        ),
        (
            "7",
            "TSEPM's P_D does not vary beyond 120 m",
            lambda a, b: paired.is_within(errors.rise(a, errors.place(FIGURE_7_MARKS[1])), EQUAL),
        ),
        *_false_claims("8", errors),
        *(
            (
                "8",
                f"P_F of {who} rises with the error, {unit}",
                lambda a, b, place=place, unit=unit: _rises(errors, (a, b, MODEL)[place], unit),
            )
            for place, who in enumerate(("TSEPM", "the test", "the multiple model"))
            for unit in UNITS
        ),
    ]
    return [
        [figure, text, *(judge(*reading) for reading in READINGS)] for figure, text, judge in listed
    ]


UNITS = ("per start", "per run")
"""Readings of what P_F is a share of."""


def _false_claims(figure: str, curves: Curves) -> list[tuple[str, str, Judge]]:
    made: list[tuple[str, str, Judge]] = []
    for unit in UNITS:

        def first(a: str, b: str, unit: str = unit) -> str:
            return _fewer(curves, a, b, unit)

        def second(a: str, b: str, unit: str = unit) -> str:
            return _fewer(curves, b, MODEL, unit)

        made.append((figure, f"P_F of TSEPM below the test's, {unit}", first))
        made.append((figure, f"P_F of the test below the multiple model's, {unit}", second))
    return made


def _equal(curves: Curves) -> Judge:
    def judge(one: str, other: str) -> str:
        differences = [
            paired.share_difference(curves.found(one, place), curves.found(other, place))
            for place in curves.places
        ]
        return paired.everywhere([paired.is_within(d, EQUAL) for d in differences])

    return judge


def _fewer(curves: Curves, one: str, other: str, unit: str) -> str:
    verdicts = []
    for place in curves.places:
        wrong = curves.wrong(one, place), curves.wrong(other, place)
        difference = paired.mean_difference(*wrong)
        if unit == "per start":
            starts = curves.starts(one, place), curves.starts(other, place)
            difference = paired.ratio_difference((wrong[0], starts[0]), (wrong[1], starts[1]))
        verdicts.append(paired.is_below(difference))
    return paired.everywhere(verdicts)


def _rises(curves: Curves, name: str, unit: str) -> str:
    """Whether P_F rises from each point to the next."""
    verdicts = []
    for place in list(curves.places)[1:]:
        before, after = curves.wrong(name, place - 1), curves.wrong(name, place)
        difference = paired.mean_difference(before, after)
        if unit == "per start":
            difference = paired.ratio_difference(
                (before, curves.starts(name, place - 1)), (after, curves.starts(name, place))
            )
        verdicts.append(paired.is_below(difference))
    return paired.everywhere(verdicts)


def _falls(curves: Curves, name: str) -> str:
    """Whether P_D falls from each point to the next."""
    steps = [curves.rise(name, place - 1, place) for place in list(curves.places)[1:]]
    return paired.everywhere([paired.is_below(step) for step in steps])


def _falls_faster(curves: Curves, name: str) -> str:
    """Whether P_D falls at each step between the marks, faster than at each step below them."""
    first, last = map(curves.place, FIGURE_7_MARKS)
    slopes = [_slope(curves, name, place) for place in range(last)]
    between, below = slopes[first:], slopes[:first]
    verdicts = [paired.is_below(mean(one)) for one in between]
    verdicts += [paired.is_below(mean(one - other)) for one in between for other in below]
    return paired.everywhere(verdicts)


def _slope(curves: Curves, name: str, place: int) -> FloatArray:
    """Rise of P_D from a point to the next, per unit and run."""
    step = curves.points[place + 1].value - curves.points[place].value
    return (curves.found(name, place + 1) - curves.found(name, place)) / step


def one_start(error: float) -> float:
    """P_D of one start without clutter or pruning at a measurement error, with its gate's size."""
    return rule_detection_probability(*RULE, 0.9, gate_hit_probability(error, 1))


def _gate_parts() -> list[Part]:
    columns = [
        Column("error [m]", "g"),
        Column("one scan", ".4f"),
        Column("two scans", ".4f"),
        Column("P_D of one start", ".4f"),
    ]
    rows = [
        [error, gate_hit_probability(error, 1), gate_hit_probability(error, 2), one_start(error)]
        for error in (*ERRORS, 300.0, 1000.0)
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
