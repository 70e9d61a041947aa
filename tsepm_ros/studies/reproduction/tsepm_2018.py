"""TSEPM 2018: Table 1, Figs. 5-8, and claims of the text on both."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.special import ndtr

from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.numerics.gaussian import gate_factor
from tsepm_ros.studies.reproduction import report
from tsepm_ros.studies.reproduction.monte_carlo import (
    CURVES,
    DENSITIES,
    ERRORS,
    OWN_GATE,
    RULE,
    STATED_MARGIN,
    TARGET,
    WEIGHTS,
    Counted,
    Point,
    run_comparison,
    run_table_1,
    sensor_at,
    table_1_cases,
)
from tsepm_ros.studies.reproduction.published import (
    FIGURE_7_DENSITY,
    FIGURE_7_MARKS,
    GATE_FACTOR,
    GATE_PROBABILITY,
    MAX_SPEED,
    PERIOD,
    RECOMMENDED,
    TABLE_1,
    TABLE_1_DENSITY,
    TABLE_1_DETECTION_PROBABILITIES,
    TABLE_1_RUNS,
    Table1Row,
)
from tsepm_ros.studies.reproduction.report import (
    Cell,
    Line,
    Panel,
    Part,
    Picture,
    Result,
    Setting,
    Table,
    column,
    ratio,
)
from tsepm_ros.tools.design.expected_counts import (
    false_start_probability,
    rule_detection_probability,
    unbounded_gate_areas,
)
from tsepm_ros.tools.evaluation.intervals import (
    Estimate,
    mean,
    mean_count,
    proportion,
    root_mean_square,
)
from tsepm_ros.tools.evaluation.simulated_run import measurement_sigma
from tsepm_ros.tracker.measurement import position_covariance
from tsepm_ros.tracker.pruning import READINGS
from tsepm_ros.tracker.sensor import SensorModel

FITTED_MARGIN = 159.78
"""g that fits most of P_F(1), m. The fit confirms only the form of the equation."""
SLIP_RULE = (4, 6)
MIN_SHOWN = 7
"""Minimum N of the rows of P_D and P_F(2) in the report."""
MAX_DETECTION_DIFFERENCE = 1e-4
MAX_FALSE_DIFFERENCE = 1e-3


TRUE_MARGIN = GATE_FACTOR * measurement_sigma(SensorModel(), TARGET)
"""The gate margin g from the larger axis of the error at the target, m."""


def detection(row: Table1Row) -> list[float]:
    """P_D of a row in closed form, at each p_d."""
    return [
        rule_detection_probability(*row.rule, p_d, GATE_PROBABILITY)
        for p_d in TABLE_1_DETECTION_PROBABILITIES
    ]


def detection_with_slip(row: Table1Row) -> list[float]:
    """P_D with an additional factor P p_d in the term of a fourth hit in the sixth scan.

    That term of 4/6 and 4/7 is ``p_d C(4, 2) h^3 (1 - h)^2`` with ``h = P p_d``.
    """
    lost = []
    for p_d in TABLE_1_DETECTION_PROBABILITIES:
        hit = GATE_PROBABILITY * p_d
        min_hits, scan = SLIP_RULE
        term = math.comb(scan - 2, min_hits - 2) * hit ** (min_hits - 1)
        lost.append(p_d * term * (1.0 - hit) ** (scan - min_hits) * (1.0 - hit))
    return [exact - term for exact, term in zip(detection(row), lost, strict=True)]


def false_before(row: Table1Row, margin: float) -> float:
    """P_F(1) of a row from the first-passage chain with a gate margin g, m."""
    areas = unbounded_gate_areas(MAX_SPEED, PERIOD, margin, row.rule[1])
    return false_start_probability(*row.rule, TABLE_1_DENSITY, areas)


def unmatched_detection() -> list[str]:
    """Rows whose P_D differs from the closed form."""
    return [row.name for row in TABLE_1 if not _is_near(detection(row), row)]


def _is_near(values: Sequence[float], row: Table1Row) -> bool:
    return np.allclose(values, row.detection, rtol=0.0, atol=MAX_DETECTION_DIFFERENCE)


def unmatched_false_before() -> list[str]:
    """Rows whose P_F(1) differs from the chain, even with the fitted margin."""
    return [
        row.name
        for row in TABLE_1
        if abs(false_before(row, FITTED_MARGIN) - row.false_before) > MAX_FALSE_DIFFERENCE
    ]


DENOMINATORS = {
    "share of first-scan starts": (
        Counted.STARTS_WITH_TRACK,
        Counted.FIRST_SCAN_STARTS,
    ),
    "per first-scan start": (Counted.FIRST_SCAN_TRACKS, Counted.FIRST_SCAN_STARTS),
    "per start, N scans": (Counted.WRONG, Counted.STARTS),
}
"""Readings of P_F(2): numerator and denominator."""
HALF_DIGIT = 0.5e-4
"""Half a unit of the last digit that the table prints."""


def reproduce(
    setting: Setting, by_density: Sequence[Point] = DENSITIES, by_error: Sequence[Point] = ERRORS
) -> list[Part]:
    """The parts of the source's chapter."""
    return [*table_1_parts(setting), *figure_parts(setting, by_density, by_error)]


def table_1_parts(setting: Setting) -> list[Part]:
    """The table, its columns in closed form and simulated."""
    cases = table_1_cases()
    results = dict(zip(cases, setting.results(run_table_1, list(cases.values())), strict=True))
    scenes = list(results)
    after = {
        f"{scene}; {name}": values
        for scene, runs in results.items()
        for name, values in _after(runs).items()
    }
    closest = [
        min(
            (name for name in after if name.startswith(f"{scene};") and name.endswith(end)),
            key=lambda name: _log_distance(after[name]),
        )
        for scene in scenes
        for end in READINGS
    ]
    return [
        "### Table 1",
        *_detection_parts(results[scenes[0]], results[scenes[3]]),
        *_before_parts(),
        *_after_parts(after, closest),
        _table_1_picture(after, closest),
    ]


def _after(runs: Sequence[Result]) -> dict[str, list[Estimate]]:
    """P_F(2) of every row, by the reading of the denominator and of the threshold."""
    return {
        f"{denominator}, {reading}": [
            ratio(*(column(runs, f"{row.name} {reading}", place) for place in places))
            for row in TABLE_1
        ]
        for denominator, places in DENOMINATORS.items()
        for reading in READINGS
    }


def _errors(runs: Sequence[Result], row: Table1Row) -> list[Cell]:
    """Root mean square errors of the target's first true tracks."""
    both = (Counted.POSITION_ERROR, Counted.VELOCITY_ERROR)
    errors = (column(runs, f"{row.name} literal", place) for place in both)
    return [root_mean_square(values[np.isfinite(values)]) for values in errors]


def _detection_parts(stated: Sequence[Result], predicted: Sequence[Result]) -> list[Part]:
    columns = {"M/N": ""}
    for p_d in TABLE_1_DETECTION_PROBABILITIES:
        columns |= {f"P_D at {p_d}, published": ".4f", f"closed form at {p_d}, difference": "+.4f"}
    columns |= {
        "simulated at 0.9": ".2f",
        "the same, hits predicted": ".2f",
        "position, rms, m": ".0f",
        "velocity, rms, m/s": ".1f",
    }
    rows: list[list[Cell]] = []
    for row in TABLE_1:
        cells: list[Cell] = [row.name]
        for published, computed in zip(row.detection, detection(row), strict=True):
            cells += [published, computed - published]
        cells += [
            proportion(int(column(runs, f"{row.name} literal", Counted.FOUND).sum()), len(runs))
            for runs in (stated, predicted)
        ]
        rows.append([*cells, *_errors(stated, row)])
    missed = [row for row in TABLE_1 if row.name in unmatched_detection()]
    slips = sum(_is_near(detection_with_slip(row), row) for row in missed)
    return [
        "**P_D.** The closed form `p_d P(Binomial(N-1, P p_d) >= M-1)`, P = 0.9, gives "
        f"{3 * (len(TABLE_1) - len(missed))} of {3 * len(TABLE_1)} entries within "
        f"{MAX_DETECTION_DIFFERENCE:g}; the rows {' and '.join(row.name for row in missed)} are "
        "lower in print. With one factor h = P p_d too many in the term of the sixth scan, "
        f"`6 p_d h^3 (1-h)^2`, {3 * slips} of their {3 * len(missed)} entries fit.",
        "Simulated are (Eq. 26 literal): true tracks in N scans, also with each hit predicted from "
        "the others in Eq. 22, and the errors of the first true track. *The larger M, the more "
        "accurate the state*: compare the rows of one N.",
        Table(
            "tsepm_2018_table_1_detection",
            columns,
            rows,
            [cells for cells, row in zip(rows, TABLE_1, strict=True) if row.rule[1] >= MIN_SHOWN],
            bounds=False,
            hidden=[name for name in columns if any(n in name for n in ("form", "1.0,", "0.8,"))],
        ),
    ]


def _before_parts() -> list[Part]:
    margins = {
        f"fitted g = {FITTED_MARGIN:.1f} m": FITTED_MARGIN,
        f"sigma at 5000 m, g = {STATED_MARGIN:.2f} m": STATED_MARGIN,
        f"sigma where the target is, g = {TRUE_MARGIN:.1f} m": TRUE_MARGIN,
    }
    rows: list[list[Cell]] = [
        [row.name, row.false_before, *(false_before(row, margin) for margin in margins.values())]
        for row in TABLE_1
    ]
    missed = unmatched_false_before()
    return [
        "**P_F(1)** is a first-passage chain of one clutter start: k scans after the last hit, the "
        "gate `a_k = pi (v_max k T + g)^2` has a hit with `1 - exp(-lambda a_k)`. "
        f"{len(TABLE_1) - len(missed)} of {len(TABLE_1)} rows are as published within "
        f"{MAX_FALSE_DIFFERENCE:g}; the rows {', '.join(missed)} fit no g.",
        Table(
            "tsepm_2018_table_1_before",
            {"M/N": "", "P_F(1), published": ".4f"} | dict.fromkeys(margins, ".4f"),
            rows,
            [row for row in rows if row[0] in missed],
            hidden=list(margins)[-1:],
        ),
    ]


def _after_parts(after: Mapping[str, list[Estimate]], closest: Sequence[str]) -> list[Part]:
    factors = {name: math.exp(_log_distance(values)) for name, values in after.items()}
    order = sorted(factors, key=factors.__getitem__)
    published = {row.name: row.false_after for row in TABLE_1}
    readings: list[list[Cell]] = [
        ["published", 1.0, len(TABLE_1), _recommended(published), _falls(published)]
    ]
    for name in order:
        values = after[name]
        ours = {row.name: value.value for row, value in zip(TABLE_1, values, strict=True)}
        found: list[Cell] = [name, factors[name], _inside(values), _recommended(ours), _falls(ours)]
        readings.append(found)
    shown = [row for row in readings if row[0] in (*closest[::2], order[0])]
    columns = {
        "reading": "",
        "factor": ".2f",
        f"published values inside, of {len(TABLE_1)}": "d",
        f"rules with P_D > 0.85, P_F < 0.05 (text: {', '.join(sorted(RECOMMENDED))})": "",
        "P_F falls with M at each N": "",
    }
    names = closest[::2]
    rows: list[list[Cell]] = [
        [row.name, row.false_after, *(after[name][place] for name in names)]
        for place, row in enumerate(TABLE_1)
    ]
    everything: list[list[Cell]] = [
        [row.name, name, values[place]]
        for place, row in enumerate(TABLE_1)
        for name, values in after.items()
    ]
    return [
        "**P_F(2)** is simulated: N scans, the 9 km disc, one target, p_d = 0.9. The readings "
        "differ in its denominator; in Eq. 26's threshold, literal or squared; in the gate "
        f"margin, as stated or the {STATED_MARGIN:.0f} m of P_F(1); in the errors, as stated or "
        "those of 5000 m everywhere; and in Eq. 22, with each hit in the fit, or predicted from "
        "the others or from those before. *Factor* is the root mean square of the ratio's "
        f"logarithm, without 7/9, 8/9 and rows without a false track. Of {len(factors)} readings "
        "the table has the closest, and of each scene the closest denominator with Eq. 26 literal; "
        "P_F falls with M at each N in "
        f"{sum(row[-1] == readings[0][-1] for row in shown)} of them.",
        Table("tsepm_2018_table_1_readings", columns, readings, shown, hidden=list(columns)[2::2]),
        "P_F(2) of the closest denominators, Eq. 26 literal:",
        Table(
            "tsepm_2018_table_1_after",
            {"M/N": "", "published": ".4f"} | dict.fromkeys(names, ".4f"),
            rows,
            [cells for cells, row in zip(rows, TABLE_1, strict=True) if row.rule[1] >= MIN_SHOWN],
            bounds=False,
            hidden=[names[2], names[-1]],
        ),
        Table(
            "tsepm_2018_table_1_after_all",
            {"M/N": "", "reading": "", "P_F(2)": ".4f"},
            everything,
            reported=(),
        ),
    ]


def _log_ratios(values: list[Estimate]) -> dict[str, float]:
    """ln(ours / published) of the rows where both are above 0 and possible.

    Pruning and merging only remove tracks, so a published P_F(2) above its P_F(1) is wrong.
    """
    return {
        row.name: math.log(estimate.value / row.false_after)
        for row, estimate in zip(TABLE_1, values, strict=True)
        if estimate.value > 0.0 and 0.0 < row.false_after <= row.false_before
    }


def _log_distance(values: list[Estimate]) -> float:
    """Root mean square of `_log_ratios`; infinite if there are none."""
    ratios = list(_log_ratios(values).values())
    return math.sqrt(float(np.mean(np.square(ratios)))) if ratios else math.inf


def _inside(values: list[Estimate]) -> int:
    """Published values inside the intervals; they are rounded."""
    return sum(
        estimate.low - HALF_DIGIT <= row.false_after <= estimate.high + HALF_DIGIT
        for row, estimate in zip(TABLE_1, values, strict=True)
    )


def _recommended(false: dict[str, float]) -> str:
    names = [row.name for row in TABLE_1 if row.detection[1] > 0.85 and false[row.name] < 0.05]
    return ", ".join(names) or "none"


def _falls(false: dict[str, float]) -> str:
    pairs = [
        (false[fewer.name], false[more.name])
        for fewer in TABLE_1
        for more in TABLE_1
        if fewer.rule[1] == more.rule[1] and fewer.rule[0] + 1 == more.rule[0]
    ]
    return f"{sum(fewer >= more for fewer, more in pairs)} of {len(pairs)} pairs"


def _table_1_picture(after: Mapping[str, list[Estimate]], shown: Sequence[str]) -> Picture:
    names = [row.name for row in TABLE_1]
    chains = (
        (f"chain, g = {FITTED_MARGIN:.1f} m (fitted)", FITTED_MARGIN, "o"),
        (f"chain, g = {STATED_MARGIN:.0f} m (sigma at 5000 m)", STATED_MARGIN, "s"),
        (f"chain, g = {TRUE_MARGIN:.0f} m (sigma at 7071 m)", TRUE_MARGIN, "^"),
    )
    marks = {"color": "k", "marker": "x", "ls": ""}
    before = [Line(names, [row.false_before for row in TABLE_1], "published", marks)] + [
        Line(names, [false_before(row, g) for row in TABLE_1], name, {"marker": mark, "ls": ""})
        for name, g, mark in chains
    ]
    simulated = [Line(names, [row.false_after for row in TABLE_1], "published", marks)] + [
        Line(names, after[name], name, {"fmt": "o", "ms": 4}) for name in shown[::2]
    ]
    settings = {"yscale": "log", "ylim": (1e-4, 1.0)}
    return Picture(
        "tsepm_2018_table_1",
        f"Table 1 of TSEPM 2018 ({TABLE_1_RUNS} runs there): P_F before and after pruning and "
        "merging, published and here",
        [
            Panel(before, settings | {"title": "P_F(1)"}),
            Panel(simulated, settings | {"title": "P_F(2)"}),
        ],
        (13.0, 5.2),
    )


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
        return np.array([run[name][:3] for run in self.runs[place]], float).T

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
        return [report.ratio(*self.counted(name, place)[1:]) for place in self.places]

    def per_run(self, name: str) -> list[Estimate]:
        """False and misplaced tracks per run along the curve."""
        return [mean_count(self.counted(name, place)[1]) for place in self.places]

    def density(self, name: str) -> list[Estimate]:
        """False and misplaced tracks per scan and km^2 along the curve."""
        units = [point.scenario.scans * point.scenario.area / 1e6 for point in self.points]
        return [count / unit for count, unit in zip(self.per_run(name), units, strict=True)]

    def rise(self, name: str, first: int = 0, last: int = -1) -> Estimate:
        """Difference of P_D from one point to a later one."""
        places = list(self.places)
        return report.share_difference(
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
            return report.ratio_difference((other_wrong, other_starts), (wrong, starts))
        return report.mean_difference(other_wrong, wrong)

    def by_any_member(self, name: str) -> list[Estimate]:
        """P_D along a curve of TSEPM if any member of a merged group may be the target's."""
        found = [column(runs, name, 3) for runs in self.runs]
        return [proportion(int(runs.sum()), len(runs)) for runs in found]

    def figures(self, name: str, heading: str, spec: str) -> list[Part]:
        """The curves: P_D, and false and misplaced tracks per start and per run.

        The report shows P_D and false tracks per start of some in one table.
        """
        detection = {curve: self.detection(curve) for curve in CURVES} | {
            f"{curve}, any": self.by_any_member(curve) for curve in CURVES if "tsepm" in curve
        }
        per_start = {curve: self.per_start(curve) for curve in CURVES}
        points = [point.value for point in self.points]
        both: list[list[Cell]] = [
            [
                value,
                *(
                    f"{detection[curve][place].value:.2f}, {per_start[curve][place].value:.2g}"
                    for curve in SHOWN
                ),
                detection[f"{SHOWN[0]}, any"][place],
            ]
            for place, value in enumerate(points)
        ]
        columns = {heading: spec} | dict.fromkeys(SHOWN, "") | {f"{SHOWN[0]}, any": ".2f"}
        tables: list[Part] = [Table(f"{name}_shown", columns, both, bounds=False)]
        for suffix, values in (
            ("p_d", detection),
            ("per_start", per_start),
            ("per_run", {curve: self.per_run(curve) for curve in CURVES}),
        ):
            rows = [list(row) for row in zip(points, *values.values(), strict=True)]
            columns = {heading: spec} | dict.fromkeys(values, ".3g")
            tables.append(Table(f"{name}_{suffix}", columns, rows, reported=()))
        return tables

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
        x = np.array([point.value for point in self.points])
        panels = []
        for heading, values_of in (
            ("P_D", self.detection),
            ("P_F per start", self.per_start),
            ("false + misplaced per scan and km²", self.density),
        ):
            along = {curve: values_of(curve) for curve in CURVES}
            lines = [
                Line(x, values, curve, _style(curve, k))
                for k, (curve, values) in enumerate(along.items())
            ]
            positive = [v.value for values in along.values() for v in values if v.value > 0.0]
            settings = {"yscale": "log", "ylim": (0.5 * min(positive, default=1.0), None)}
            if heading == "P_D":
                settings = {"ylim": (0.0, 1.04)}
                if theory:
                    expected = [theory(value) for value in x]
                    style = {"color": "k", "ls": ":"}
                    lines.append(Line(x, expected, "one start, no clutter", style))
            panels.append(Panel(lines, {"title": heading, "xlabel": label, **settings}, marks))
        return Picture(
            name,
            f"{title} of TSEPM 2018, regenerated ({len(self.runs[0])} runs; 95 % intervals)",
            panels,
            (14.0, 5.0),
        )


def _style(name: str, k: int) -> dict[str, object]:
    dashes = {"clutter": "--", "multiple": "-."}.get(name.split()[0], "-")
    return {"fmt": "osD^vPX*"[k], "ls": dashes, "color": f"C{k}", "ms": 4, "lw": 1}


SHOWN = (
    "tsepm, f1 literal",
    "clutter test, size 0.5",
    "multiple model",
    OWN_GATE,
)
"""Curves that the report shows as numbers."""
MAX_EQUAL_DIFFERENCE = 0.05
"""Maximum difference of two approximately equal P_D: a choice."""
MODEL = "multiple model"
PAIRS = (
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


def figure_parts(
    setting: Setting, by_density: Sequence[Point], by_error: Sequence[Point]
) -> list[Part]:
    """The curves, and the claims of the text about them."""
    results = setting.results(run_comparison, [*by_density, *by_error])
    densities = Curves(by_density, results[: len(by_density)])
    errors = Curves(by_error, results[len(by_density) :])
    pairs = [f"{a}; {b}".replace("clutter test", "test") for a, b in PAIRS]
    return [
        "### Figs. 5-8",
        f"The claims of the text are judged in a CSV file. All use {RULE[0]}/{RULE[1]}, gates of "
        "0.9 (the multiple model also its default, 0.99), p_d 0.9, 8 scans and clutter in 36 km² "
        "round a target that moves along x. TSEPM prunes by f1, with Eq. 26 literal or squared, or "
        "by Kennedy's f2; the clutter test is Kennedy's.",
        Table(
            "tsepm_2018_figures_claims",
            {"figure": "", "the text says": ""} | dict.fromkeys(pairs, ""),
            claims(densities, errors),
            reported=(),
        ),
        "The cells have P_D, then false and misplaced tracks per start, by density and by the "
        f"larger error where the target is (at {FIGURE_7_DENSITY:g} per m²). *Any*: P_D if a "
        "merged group counts as the target's where the merged state is within 3 sigma of it and "
        "any member has more than half of its hits from it; else its best member alone is judged. "
        "Tracks per start may exceed 1, since a start splits: such a figure is no probability.",
        *densities.figures("tsepm_2018_figures_5_6", "density [1/m²]", ".1e"),
        *errors.figures("tsepm_2018_figures_7_8", "error [m]", "g"),
        densities.picture("tsepm_2018_figures_5_6", "Figs. 5 and 6", "clutter density [1/m²]"),
        errors.picture(
            "tsepm_2018_figures_7_8",
            "Figs. 7 and 8",
            f"measurement error [m], at {FIGURE_7_DENSITY:g} per m²",
            one_start,
            FIGURE_7_MARKS,
        ),
        *_merging_parts(densities),
        *_gate_parts(),
    ]


def _merging_parts(densities: Curves) -> list[Part]:
    """The burden before and after pruning and merging, and the weights of merging."""
    literal, squared = list(CURVES)[:2]
    burden: list[list[Cell]] = []
    for place, point in enumerate(densities.points):
        row: list[Cell] = [point.value]
        for name in (literal, squared):
            counts = [column(densities.runs[place], name, index) for index in (4, 5)]
            published = densities.counted(name, place)[1] + densities.found(name, place)
            row += [float(values.mean()) for values in (*counts, published)]
        burden.append(row)
    stages = ("reach M hits", "left by pruning", "false, misplaced, true after merging")
    names = {f"{name}: {stage}": ".3g" for name in (literal, squared) for stage in stages}
    errors = np.array([e for runs in densities.runs for run in runs for e in run["weights"]])
    by_weight = errors.reshape(-1, len(WEIGHTS)).T
    weights: list[list[Cell]] = [
        [name, root_mean_square(own), mean(own - by_weight[0])]
        for name, own in zip(WEIGHTS, by_weight, strict=True)
    ]
    return [
        f"**The burden** ({literal}). Merging is said to reduce it. At {burden[-1][0]:.0e} per m², "
        f"{burden[-1][1]:.3g} tracks per run reach M hits in 8 scans, pruning leaves "
        f"{burden[-1][2]:.3g}, and merging {burden[-1][3]:.3g}.",
        Table(
            "tsepm_2018_burden",
            {"density [1/m²]": ".1e"} | names,
            burden,
            reported=(),
        ),
        f"**Merging by evaluation values** (Eq. 31, {literal}): the position of "
        f"{by_weight.shape[1]} merged groups with a member from the target has an rms error of "
        f"{root_mean_square(by_weight[0]):.0f} m. Mean difference from it, by other weights: "
        + "; ".join(
            f"{name} {mean(own - by_weight[0]):+.1f} m"
            for name, own in list(zip(WEIGHTS, by_weight, strict=True))[1:]
        )
        + ".",
        Table(
            "tsepm_2018_weights",
            {"weights": "", "rms, m": ".0f", "mean difference from the published, m": "+.1f"},
            weights,
            reported=(),
        ),
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
            lambda a, b: report.is_not_below(densities.rise(a), MAX_EQUAL_DIFFERENCE),
        ),
        (
            "5",
            "the test's P_D does not decrease with density",
            lambda a, b: report.is_not_below(densities.rise(b), MAX_EQUAL_DIFFERENCE),
        ),
        (
            "5",
            "the multiple model's P_D decreases with density, step by step",
            lambda a, b: falls(densities, MODEL),
        ),
        (
            "5",
            "the same with its own gate, 0.99",
            lambda a, b: falls(densities, OWN_GATE),
        ),
        (
            "5",
            "with its own gate it is lower at the highest density than at the lowest",
            lambda a, b: report.is_below(densities.rise(OWN_GATE)),
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
            lambda a, b: report.is_within(errors.rise(a, mark), MAX_EQUAL_DIFFERENCE),
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
        [figure, text, *(judge(*reading) for reading in PAIRS)] for figure, text, judge in listed
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
        report.share_difference(curves.found(first, place), curves.found(second, place))
        for place in curves.places
    ]
    return report.everywhere([report.is_within(d, MAX_EQUAL_DIFFERENCE) for d in differences])


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
    return report.everywhere([report.is_below(difference) for difference in differences])


def falls(curves: Curves, name: str) -> str:
    """Whether P_D falls from each point to the next."""
    rises = [curves.rise(name, place - 1, place) for place in curves.places[1:]]
    return report.everywhere([report.is_below(rise) for rise in rises])


def falls_faster(curves: Curves, name: str) -> str:
    """Whether P_D falls at each step between the marks, faster than at each step below them."""
    first, last = map(curves.place, FIGURE_7_MARKS)
    found = np.array([curves.found(name, place) for place in curves.places])
    values = np.array([point.value for point in curves.points])
    slopes = (np.diff(found, axis=0) / np.diff(values)[:, None])[:last]
    between, below = slopes[first:], slopes[:first]
    verdicts = [report.is_below(mean(slope)) for slope in between]
    verdicts += [report.is_below(mean(slope - lower)) for slope in between for lower in below]
    return report.everywhere(verdicts)


def _gate_parts() -> list[Part]:
    columns = {"error [m]": "g", "one scan": ".4f", "two scans": ".4f", "P_D of one start": ".4f"}
    rows = [
        [error, gate_hit_probability(error, 1), gate_hit_probability(error, 2), one_start(error)]
        for error in (*(point.value for point in ERRORS), 300.0, 1000.0)
    ]
    return [
        "**The gate.** The text explains Fig. 7 by the probability that a detected target falls "
        "into the gate of Eq. 4: roughly 1 below 75 m, 0.9 from 120 m on. Computed, and P_D by "
        "the closed form with it:",
        Table(
            "tsepm_2018_gate",
            columns,
            rows,
            [row for row in rows if row[0] in (15.0, *FIGURE_7_MARKS, 180.0)],
            hidden=["two scans"],
        ),
    ]
