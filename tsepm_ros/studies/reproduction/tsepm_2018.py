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
"""TSEPM 2018: Table 1, Figs. 5-8, and claims of the text on both."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import trapezoid
from scipy.special import ndtr

from tsepm_ros.numerics.gaussian import gaussian_gate_factor
from tsepm_ros.studies.reproduction.monte_carlo import (
    CURVES,
    DENSITIES,
    ERRORS,
    FIGURE_7_DENSITY,
    FIGURE_7_MARKS,
    GATE_PROBABILITY,
    MAX_SPEED,
    OWN_GATE,
    PERIOD,
    RECOMMENDED,
    RULE,
    STATED_MARGIN,
    TABLE_1,
    TABLE_1_DENSITY,
    TABLE_1_DETECTION_PROBABILITIES,
    TARGET,
    WEIGHTS,
    Counted,
    MonteCarloTable1Row,
    monte_carlo_comparison,
    monte_carlo_sensor,
    monte_carlo_table_1,
    monte_carlo_table_1_cases,
)
from tsepm_ros.studies.reproduction.report import (
    Cell,
    Part,
    ReportLine,
    ReportPanel,
    ReportPicture,
    ReportSetting,
    ReportTable,
    Result,
    report_column,
)
from tsepm_ros.tools.design.expected_counts import (
    expected_detection_probability,
    expected_false_start_probability,
    expected_unbounded_gate_areas,
)
from tsepm_ros.tools.evaluation.intervals import (
    IntervalEstimate,
    mean_count_interval,
    mean_interval,
    proportion_interval,
    root_mean_square_interval,
)
from tsepm_ros.tools.simulation import Scenario
from tsepm_ros.tracker.measurement import measurement_covariance
from tsepm_ros.tracker.pruning import READINGS

FITTED_MARGIN = 159.78
"""g that fits most of P_F(1), m. The fit confirms only the form of the equation."""
MIN_SHOWN = 7
"""Minimum N of the rows of P_D and P_F(2) in the report."""
MAX_DETECTION_DIFFERENCE = 1e-4
MAX_FALSE_DIFFERENCE = 1e-3
DENOMINATORS = {
    "share of first-scan starts": (
        Counted.STARTS_WITH_TRACK,
        Counted.FIRST_SCAN_STARTS,
    ),
    "per first-scan start": (Counted.FIRST_SCAN_TRACKS, Counted.FIRST_SCAN_STARTS),
    "per start, N scans": (Counted.WRONG, Counted.STARTS),
}
"""Readings of P_F(2): numerator and denominator."""
SHOWN = (
    "tsepm, f1 literal",
    "clutter test, size 0.5",
    "multiple model",
    OWN_GATE,
)
"""Curves that the report shows as numbers."""


def tsepm_2018_detection(row: MonteCarloTable1Row) -> list[float]:
    """P_D of a row in closed form, at each p_d."""
    return [
        expected_detection_probability(*row.rule, p_d, GATE_PROBABILITY)
        for p_d in TABLE_1_DETECTION_PROBABILITIES
    ]


def tsepm_2018_detection_with_slip(row: MonteCarloTable1Row) -> list[float]:
    """P_D with an additional factor P p_d in the term of a fourth hit in the sixth scan.

    That term of 4/6 and 4/7 is ``p_d C(4, 2) h^3 (1 - h)^2`` with ``h = P p_d``.
    """
    hits = [GATE_PROBABILITY * p_d for p_d in TABLE_1_DETECTION_PROBABILITIES]
    return [
        exact - p_d * 6.0 * hit**3 * (1.0 - hit) ** 2 * (1.0 - hit)
        for exact, p_d, hit in zip(
            tsepm_2018_detection(row), TABLE_1_DETECTION_PROBABILITIES, hits, strict=True
        )
    ]


def tsepm_2018_false_before(row: MonteCarloTable1Row, margin: float) -> float:
    """P_F(1) of a row from the first-passage chain with a gate margin g, m."""
    areas = expected_unbounded_gate_areas(MAX_SPEED, PERIOD, margin, row.rule[1])
    return expected_false_start_probability(*row.rule, TABLE_1_DENSITY, areas)


def tsepm_2018_unmatched_detection() -> list[str]:
    """Rows whose P_D differs from the closed form."""
    return [row.name for row in TABLE_1 if not _tsepm_2018_is_near(tsepm_2018_detection(row), row)]


def _tsepm_2018_is_near(values: Sequence[float], row: MonteCarloTable1Row) -> bool:
    return np.allclose(values, row.detection, rtol=0.0, atol=MAX_DETECTION_DIFFERENCE)


def tsepm_2018_unmatched_false_before() -> list[str]:
    """Rows whose P_F(1) differs from the chain, even with the fitted margin."""
    return [
        row.name
        for row in TABLE_1
        if abs(tsepm_2018_false_before(row, FITTED_MARGIN) - row.false_before)
        > MAX_FALSE_DIFFERENCE
    ]


def reproduce(
    setting: ReportSetting,
    by_density: Mapping[float, Scenario] = DENSITIES,
    by_error: Mapping[float, Scenario] = ERRORS,
) -> list[Part]:
    """The parts of the source's chapter."""
    return [
        *tsepm_2018_table_1_parts(setting),
        *tsepm_2018_figure_parts(setting, by_density, by_error),
    ]


def tsepm_2018_table_1_parts(setting: ReportSetting) -> list[Part]:
    """The table, its columns in closed form and simulated."""
    cases = monte_carlo_table_1_cases()
    results = dict(
        zip(cases, setting.results(monte_carlo_table_1, list(cases.values())), strict=True)
    )
    stated, _, _, predicted, _ = results.values()
    after = {
        f"{scene}; {name}": values
        for scene, runs in results.items()
        for name, values in _tsepm_2018_after(runs).items()
    }
    closest = [
        min(
            (name for name in after if name.startswith(f"{scene};") and name.endswith("literal")),
            key=lambda name: _tsepm_2018_log_distance(after[name]),
        )
        for scene in results
    ]
    return [
        "### Table 1",
        *_tsepm_2018_detection_parts(stated, predicted),
        *_tsepm_2018_before_parts(),
        *_tsepm_2018_after_parts(after, closest),
    ]


def tsepm_2018_ratio(part: ArrayLike, whole: ArrayLike) -> IntervalEstimate:
    """Ratio of two sums of counts over independent runs, with the interval of the delta method."""
    a, b = np.asarray(part, float), np.asarray(whole, float)
    if not b.sum() > 0.0:
        return IntervalEstimate.unknown()
    value = float(a.sum() / b.sum())
    if value == 0.0:
        return mean_count_interval([0]) / float(b.sum())
    spread = mean_interval((a - value * b) / b.mean())
    return IntervalEstimate(value, max(value + spread.low, 0.0), value + spread.high)


def _tsepm_2018_after(runs: Sequence[Result]) -> dict[str, list[IntervalEstimate]]:
    """P_F(2) of every row, by the reading of the denominator and of the threshold."""
    return {
        f"{denominator}, {reading}": [
            tsepm_2018_ratio(
                *(report_column(runs, f"{row.name} {reading}", column) for column in places)
            )
            for row in TABLE_1
        ]
        for denominator, places in DENOMINATORS.items()
        for reading in READINGS
    }


def _tsepm_2018_errors(runs: Sequence[Result], row: MonteCarloTable1Row) -> list[Cell]:
    """Root mean square errors of the target's first true tracks."""
    both = (Counted.POSITION_ERROR, Counted.VELOCITY_ERROR)
    errors = (report_column(runs, f"{row.name} literal", column) for column in both)
    return [root_mean_square_interval(values[np.isfinite(values)]) for values in errors]


def _tsepm_2018_detection_parts(
    stated: Sequence[Result], predicted: Sequence[Result]
) -> list[Part]:
    columns = {"M/N": ""}
    for p_d in TABLE_1_DETECTION_PROBABILITIES:
        columns |= {f"P_D at {p_d}, published": ".4f", f"closed form at {p_d}, difference": "+.4f"}
    columns |= {
        "simulated at 0.9": ".2f (%)",
        "the same, hits predicted": ".2f (%)",
        "position, rms, m": ".0f",
        "velocity, rms, m/s": ".1f",
    }
    rows: list[list[Cell]] = []
    for row in TABLE_1:
        cells: list[Cell] = [row.name]
        for published, computed in zip(row.detection, tsepm_2018_detection(row), strict=True):
            cells += [published, computed - published]
        cells += [
            proportion_interval(
                int(report_column(runs, f"{row.name} literal", Counted.FOUND).sum()), len(runs)
            )
            for runs in (stated, predicted)
        ]
        rows.append([*cells, *_tsepm_2018_errors(stated, row)])
    missed = [row for row in TABLE_1 if row.name in tsepm_2018_unmatched_detection()]
    slips = sum(_tsepm_2018_is_near(tsepm_2018_detection_with_slip(row), row) for row in missed)
    return [
        "**P_D.** The closed form `p_d P(Binomial(N-1, P p_d) >= M-1)`, P = 0.9, gives "
        f"{3 * (len(TABLE_1) - len(missed))} of {3 * len(TABLE_1)} entries within "
        f"{MAX_DETECTION_DIFFERENCE:g}; the rows {' and '.join(row.name for row in missed)} are "
        "lower in print. With one factor h = P p_d too many in the term of the sixth scan, "
        f"`6 p_d h^3 (1-h)^2`, {3 * slips} of their {3 * len(missed)} entries fit.",
        "The columns *simulated* have the share of runs with a true track in N scans (Eq. 26 "
        "literal), the second with each hit predicted from the others in Eq. 22. The errors are "
        "those of the first true track. The text says that the state is more accurate the larger "
        "M is: compare the rows of one N.",
        ReportTable(
            "tsepm_2018_table_1_detection",
            columns,
            rows,
            [cells for cells, row in zip(rows, TABLE_1, strict=True) if row.rule[1] >= MIN_SHOWN],
            hidden=[name for name in columns if any(n in name for n in ("form", "1.0,", "0.8,"))],
        ),
    ]


def _tsepm_2018_before_parts() -> list[Part]:
    margins = {
        f"fitted g = {FITTED_MARGIN:.1f} m": FITTED_MARGIN,
        f"sigma at 5000 m, g = {STATED_MARGIN:.2f} m": STATED_MARGIN,
    }
    rows: list[list[Cell]] = [
        [
            row.name,
            row.false_before,
            *(tsepm_2018_false_before(row, margin) for margin in margins.values()),
        ]
        for row in TABLE_1
    ]
    missed = tsepm_2018_unmatched_false_before()
    return [
        "**P_F(1)** is a first-passage chain of one clutter start: k scans after the last hit, the "
        "gate `a_k = pi (v_max k T + g)^2` has a hit with `1 - exp(-lambda a_k)`. "
        f"{len(TABLE_1) - len(missed)} of {len(TABLE_1)} rows are as published within "
        f"{MAX_FALSE_DIFFERENCE:g}; the rows {', '.join(missed)} fit no g.",
        ReportTable(
            "tsepm_2018_table_1_before",
            {"M/N": "", "P_F(1), published": ".4f"} | dict.fromkeys(margins, ".4f"),
            rows,
            [row for row in rows if row[0] in missed],
        ),
    ]


def _tsepm_2018_after_parts(
    after: Mapping[str, list[IntervalEstimate]], closest: Sequence[str]
) -> list[Part]:
    factors = {name: math.exp(_tsepm_2018_log_distance(values)) for name, values in after.items()}
    order = sorted(factors, key=factors.__getitem__)
    readings: list[list[Cell]] = [
        [name, factors[name], _tsepm_2018_recommended(after[name]), _tsepm_2018_falls(after[name])]
        for name in order
    ]
    shown = [row for row in readings if row[0] in (*closest, order[0])]
    columns = {
        "reading": "",
        "factor": ".2f",
        f"rules with P_D > 0.85, P_F < 0.05 (text: {', '.join(sorted(RECOMMENDED))})": "",
        "P_F falls with M at each N": "",
    }
    rows: list[list[Cell]] = [
        [row.name, row.false_after, *(values[row_number] for values in after.values())]
        for row_number, row in enumerate(TABLE_1)
    ]
    return [
        "**P_F(2)** is simulated: N scans, the 9 km disc, one target, p_d = 0.9. The readings "
        "differ in its denominator; in Eq. 26's threshold, literal or squared; in the gate "
        f"margin, as stated or the {STATED_MARGIN:.0f} m of P_F(1); in the errors, as stated or "
        "those of 5000 m everywhere; and in Eq. 22, with each hit in the fit, or predicted from "
        "the others or from those before. *Factor* is the root mean square of the ratio's "
        f"logarithm, without 7/9, 8/9 and rows without a false track. Of {len(factors)} readings "
        "the table has the closest, and of each scene the closest denominator with Eq. 26 literal.",
        ReportTable(
            "tsepm_2018_table_1_readings", columns, readings, shown, hidden=list(columns)[-1:]
        ),
        ReportTable(
            "tsepm_2018_table_1_after",
            {"M/N": "", "published": ".4f"} | dict.fromkeys(after, ".4f"),
            rows,
            reported=[],
        ),
    ]


def _tsepm_2018_log_ratios(values: list[IntervalEstimate]) -> dict[str, float]:
    """ln(ours / published) of the rows where both are above 0 and possible.

    Pruning and merging only remove tracks, so a published P_F(2) above its P_F(1) is wrong.
    """
    return {
        row.name: math.log(estimate.value / row.false_after)
        for row, estimate in zip(TABLE_1, values, strict=True)
        if estimate.value > 0.0 and 0.0 < row.false_after <= row.false_before
    }


def _tsepm_2018_log_distance(values: list[IntervalEstimate]) -> float:
    """Root mean square of `_tsepm_2018_log_ratios`; infinite if there are none."""
    ratios = list(_tsepm_2018_log_ratios(values).values())
    return math.sqrt(float(np.mean(np.square(ratios)))) if ratios else math.inf


def _tsepm_2018_recommended(values: Sequence[IntervalEstimate]) -> str:
    names = [
        row.name
        for row, false in zip(TABLE_1, values, strict=True)
        if row.detection[1] > 0.85 and false.value < 0.05
    ]
    return ", ".join(names) or "none"


def _tsepm_2018_falls(values: Sequence[IntervalEstimate]) -> str:
    """Whether P_F(2) does not rise from a rule to that of one more hit."""
    false = {row.rule: value.value for row, value in zip(TABLE_1, values, strict=True)}
    falls = [false[m, n] >= false[m + 1, n] for m, n in false if (m + 1, n) in false]
    return "yes" if all(falls) else "no"


@dataclass(frozen=True)
class Tsepm2018Curves:
    """The runs of two figures.

    Attributes
    ----------
    scenes : mapping of float to Scenario
        By the value along the figure.
    runs : sequence of sequence of dict
        Per point.
    """

    scenes: Mapping[float, Scenario]
    runs: Sequence[Sequence[Result]]

    def found(self, name: str, place: int = 0) -> list[IntervalEstimate]:
        """P_D along the curve; at place 3 if any member of a merged group may be the target's."""
        found = [report_column(runs, name, place) for runs in self.runs]
        return [proportion_interval(int(runs.sum()), len(runs)) for runs in found]

    def per_start(self, name: str) -> list[IntervalEstimate]:
        """False and misplaced tracks per start along the curve."""
        return [
            tsepm_2018_ratio(report_column(runs, name, 1), report_column(runs, name, 2))
            for runs in self.runs
        ]

    def density(self, name: str) -> list[IntervalEstimate]:
        """False and misplaced tracks per scan and km^2 along the curve."""
        units = [scene.scans * scene.area / 1e6 for scene in self.scenes.values()]
        return [
            mean_count_interval(report_column(runs, name, 1)) / unit
            for runs, unit in zip(self.runs, units, strict=True)
        ]

    def table(self, name: str, heading: str, spec: str) -> ReportTable:
        """P_D, and false and misplaced tracks per start, for the CSV file."""
        columns = {heading: spec}
        values: list[Sequence[Cell]] = [[*self.scenes]]
        for curve in CURVES:
            columns |= {f"{curve}: P_D": ".2f", f"{curve}: P_F": ".2g"}
            values += [self.found(curve), self.per_start(curve)]
        for curve in (name for name in CURVES if "tsepm" in name):
            columns[f"{curve}: P_D, any"] = ".2f"
            values.append(self.found(curve, 3))
        return ReportTable(
            name,
            columns,
            list(zip(*values, strict=True)),
            reported=[],
        )

    def picture(
        self,
        name: str,
        title: str,
        label: str,
        theory: Callable[[float], float] | None = None,
        marks: Sequence[float] = (),
    ) -> ReportPicture:
        """P_D, P_F per start, and false tracks per scan and km^2, side by side.

        `theory` is P_D of one start without clutter as a function of the value; `marks` are values
        with a vertical line.
        """
        x = np.array([*self.scenes])
        panels = []
        for heading, values_of in (
            ("P_D", self.found),
            ("P_F per start", self.per_start),
            ("false + misplaced per scan and km²", self.density),
        ):
            along = {curve: values_of(curve) for curve in CURVES}
            lines = [
                ReportLine(x, values, curve, _tsepm_2018_style(curve, k))
                for k, (curve, values) in enumerate(along.items())
            ]
            positive = [v.value for values in along.values() for v in values if v.value > 0.0]
            settings = {"yscale": "log", "ylim": (0.5 * min(positive, default=1.0), None)}
            if heading == "P_D":
                settings = {"ylim": (0.0, 1.04)}
                if theory:
                    expected = [theory(value) for value in x]
                    style = {"color": "k", "ls": ":"}
                    lines.append(ReportLine(x, expected, "one start, no clutter", style))
            panels.append(
                ReportPanel(lines, {"title": heading, "xlabel": label, **settings}, marks)
            )
        return ReportPicture(
            name,
            f"{title} of TSEPM 2018, regenerated ({len(self.runs[0])} runs; 95 % intervals)",
            panels,
            (14.0, 5.0),
        )


def _tsepm_2018_style(name: str, k: int) -> dict[str, object]:
    dashes = {"clutter": "--", "multiple": "-."}.get(name.split()[0], "-")
    return {"fmt": "osD^vPX*"[k], "ls": dashes, "color": f"C{k}", "ms": 4, "lw": 1}


def tsepm_2018_gate_hit_probability(error: float) -> float:
    """Probability that a target's detection lies in the gate of that a scan before (Eq. 4).

    Both detections have an error; the gate's margin covers only one.

    Parameters
    ----------
    error : float
        Larger axis of the measurement error at the target, m.
    """
    sensor = monte_carlo_sensor(error)
    range_, azimuth = float(np.hypot(*TARGET)), np.arctan2(TARGET[1], TARGET[0])
    covariance = 2.0 * measurement_covariance(
        range_, azimuth, sensor.range_variance(range_), sensor.azimuth_std
    )
    variances, axes = np.linalg.eigh(covariance)
    sigma = np.sqrt(variances)
    offset = axes.T @ np.array([5.0 * PERIOD, 0.0])
    radius = MAX_SPEED * PERIOD + gaussian_gate_factor(GATE_PROBABILITY) * error
    x = np.linspace(-radius, radius, 4001)
    half = np.sqrt(radius**2 - x**2)
    density = np.exp(-0.5 * ((x - offset[0]) / sigma[0]) ** 2) / (np.sqrt(2 * np.pi) * sigma[0])
    across = ndtr((half - offset[1]) / sigma[1]) - ndtr((-half - offset[1]) / sigma[1])
    return float(trapezoid(density * across, x))


def tsepm_2018_one_start(error: float) -> float:
    """P_D of one start without clutter or pruning, with the gate of a measurement error."""
    return expected_detection_probability(*RULE, 0.9, tsepm_2018_gate_hit_probability(error))


def tsepm_2018_figure_parts(
    setting: ReportSetting, by_density: Mapping[float, Scenario], by_error: Mapping[float, Scenario]
) -> list[Part]:
    """The curves, the burden, the weights of merging and the gate."""
    results = setting.results(monte_carlo_comparison, [*by_density.values(), *by_error.values()])
    densities = Tsepm2018Curves(by_density, results[: len(by_density)])
    errors = Tsepm2018Curves(by_error, results[len(by_density) :])
    return [
        "### Figs. 5-8",
        f"All use {RULE[0]}/{RULE[1]}, gates of 0.9 (the multiple model also its default, 0.99), "
        "p_d 0.9, 8 scans and clutter in 36 km² round a target that moves along x. TSEPM prunes by "
        "f1, with Eq. 26 literal or squared, or by Kennedy's f2; the clutter test is Kennedy's. "
        "The CSV files have all curves.",
        "P_F is the number of false and misplaced tracks per start, by density and by the larger "
        f"error where the target is (at {FIGURE_7_DENSITY:g} per m²); it may exceed 1, since a "
        "start splits. *Any*: P_D if a merged group counts as the target's where the merged state "
        "is within 3 sigma of it and any member has more than half of its hits from it; else its "
        "best member alone is judged.",
        densities.table("tsepm_2018_figures_5_6", "density [1/m²]", ".1e"),
        errors.table("tsepm_2018_figures_7_8", "error [m]", "g"),
        densities.picture("tsepm_2018_figures_5_6", "Figs. 5 and 6", "clutter density [1/m²]"),
        errors.picture(
            "tsepm_2018_figures_7_8",
            "Figs. 7 and 8",
            f"measurement error [m], at {FIGURE_7_DENSITY:g} per m²",
            tsepm_2018_one_start,
            FIGURE_7_MARKS,
        ),
        *_tsepm_2018_merging_parts(densities),
        *_tsepm_2018_gate_parts(),
    ]


def _tsepm_2018_merging_parts(densities: Tsepm2018Curves) -> list[Part]:
    """The burden before and after pruning and merging, and the weights of merging."""
    literal, last = SHOWN[0], densities.runs[-1]
    true, wrong, _, _, reached, left = (report_column(last, literal, k).mean() for k in range(6))
    errors = np.array([e for runs in densities.runs for run in runs for e in run["weights"]])
    published, *others = errors.reshape(-1, len(WEIGHTS)).T
    return [
        f"**The burden** ({literal}). Merging is said to reduce it. At "
        f"{max(densities.scenes):.0e} per m², {reached:.3g} tracks per run reach M hits in 8 "
        f"scans, pruning leaves {left:.3g}, and merging {wrong + true:.3g}.",
        f"**Merging by evaluation values** (Eq. 31, {literal}): the position of {len(published)} "
        "merged groups with a member from the target has an rms error of "
        f"{root_mean_square_interval(published):.0f} m. Mean difference from it, by other weights: "
        + "; ".join(
            f"{name} {mean_interval(own - published):+.1f} m"
            for name, own in zip(WEIGHTS[1:], others, strict=True)
        )
        + ".",
    ]


def _tsepm_2018_gate_parts() -> list[Part]:
    computed = "; ".join(
        f"{tsepm_2018_gate_hit_probability(error):.3f} and {tsepm_2018_one_start(error):.3f} at "
        f"{error:g} m"
        for error in (15.0, *FIGURE_7_MARKS, 180.0)
    )
    return [
        "**The gate.** The text explains Fig. 7 by the probability that a detected target falls "
        "into the gate of Eq. 4: roughly 1 below 75 m, 0.9 from 120 m on. Computed, with P_D of "
        f"one start by the closed form: {computed}."
    ]
