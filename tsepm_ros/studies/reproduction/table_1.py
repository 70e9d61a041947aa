"""TSEPM 2018, Table 1: detection and false tracks of the rules M/N."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from tsepm_ros.studies.reproduction.document import Column, Part, Picture, Table
from tsepm_ros.studies.reproduction.monte_carlo import (
    STATED_MARGIN,
    Counted,
    run_table_1,
    table_1_cases,
)
from tsepm_ros.studies.reproduction.published import (
    COORDINATE,
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
from tsepm_ros.studies.reproduction.runs import Result, Setting, column, ratio
from tsepm_ros.tools.design.expected_counts import (
    false_start_probability,
    rule_detection_probability,
    unbounded_gate_areas,
)
from tsepm_ros.tools.evaluation.intervals import Estimate, error_bars, proportion
from tsepm_ros.tools.evaluation.simulated_run import measurement_sigma
from tsepm_ros.tracker.pruning import READINGS
from tsepm_ros.tracker.sensor import SensorModel

FITTED_MARGIN = 159.78
"""g that fits most of P_F(1), m. The fit confirms only the form of the equation."""
SLIP_RULE = (4, 6)
MAX_DETECTION_DIFFERENCE = 1e-4
MAX_FALSE_DIFFERENCE = 1e-3


def true_margin() -> float:
    """G from the larger axis of the error at the target, m."""
    target = np.array([COORDINATE, COORDINATE])
    return GATE_FACTOR * measurement_sigma(SensorModel(), target)


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
    return [
        row.name
        for row in TABLE_1
        if not np.allclose(detection(row), row.detection, rtol=0.0, atol=MAX_DETECTION_DIFFERENCE)
    ]


def unmatched_false_before() -> list[str]:
    """Rows whose P_F(1) differs from the chain, even with the fitted margin."""
    return [
        row.name
        for row in TABLE_1
        if abs(false_before(row, FITTED_MARGIN) - row.false_before) > MAX_FALSE_DIFFERENCE
    ]


DENOMINATORS = {
    "share of first-scan starts with a track": (
        Counted.STARTS_WITH_TRACK,
        Counted.FIRST_SCAN_STARTS,
    ),
    "tracks per first-scan start": (Counted.FIRST_SCAN_TRACKS, Counted.FIRST_SCAN_STARTS),
    "false + misplaced per start, N scans": (Counted.WRONG, Counted.STARTS),
}
"""Readings of P_F(2): numerator and denominator."""
HALF_DIGIT = 0.5e-4
"""Half a unit of the last digit that the table prints."""
MAX_RELATIVE_FACTOR = 1.1
"""Maximum factor of the closest readings, relative to the smallest."""


def parts(setting: Setting) -> list[Part]:
    """The table, its columns in closed form and simulated."""
    cases = table_1_cases()
    results = dict(zip(cases, setting.results(run_table_1, list(cases.values())), strict=True))
    after = {name: _after(runs) for name, runs in results.items()}
    stated = next(iter(results.values()))
    detected = [
        proportion(int(column(stated, f"{row.name} literal", Counted.FOUND).sum()), len(stated))
        for row in TABLE_1
    ]
    return [
        "### Table 1",
        *_detection_parts(detected),
        *_before_parts(),
        *_after_parts(after),
        _picture(after),
        _claims_table(after),
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


def _detection_parts(detected: list[Estimate]) -> list[Part]:
    columns = [Column("M/N")]
    for p_d in TABLE_1_DETECTION_PROBABILITIES:
        columns += [
            Column(f"P_D at {p_d}, published", ".4f"),
            Column("closed form", ".4f"),
            Column("difference", "+.4f"),
        ]
    columns.append(Column("simulated at 0.9, true track in N scans", ".3f"))
    rows: list[list[Any]] = []
    for row, simulated in zip(TABLE_1, detected, strict=True):
        cells: list[Any] = [row.name]
        for published, computed in zip(row.detection, detection(row), strict=True):
            cells += [published, computed, computed - published]
        rows.append([*cells, simulated])
    missed = unmatched_detection()
    slips = [
        np.allclose(
            detection_with_slip(row), row.detection, rtol=0.0, atol=MAX_DETECTION_DIFFERENCE
        )
        for row in TABLE_1
        if row.name in missed
    ]
    return [
        "**P_D** is the closed form `p_d P(Binomial(N-1, P p_d) >= M-1)` with P = 0.9: a start in "
        f"the first scan, no clutter, no pruning. It gives {3 * (len(TABLE_1) - len(missed))} of "
        f"{3 * len(TABLE_1)} entries within {MAX_DETECTION_DIFFERENCE:g}; the rows "
        f"{' and '.join(missed)} are lower in print. Closest reading: the term of "
        "the sixth scan, `6 p_d h^3 (1-h)^2` with h = P p_d, has one factor h too many "
        "there; with that slip "
        f"{3 * sum(slips)} of their {3 * len(missed)} entries fit. The published column is "
        "this closed form and no simulation; the last column is simulated, by this package's "
        "definition of a true track (literal pruning).",
        Table("tsepm_2018_table_1_detection", columns, rows),
    ]


def _before_parts() -> list[Part]:
    margins = {
        f"fitted g = {FITTED_MARGIN:.1f} m": FITTED_MARGIN,
        f"sigma at 5000 m, g = {STATED_MARGIN:.2f} m": STATED_MARGIN,
        f"sigma where the target is, g = {true_margin():.1f} m": true_margin(),
    }
    columns = [Column("M/N"), Column("P_F(1), published", ".4f")]
    for name in margins:
        columns += [Column(name, ".4f"), Column("difference", "+.4f")]
    rows: list[list[Any]] = []
    for row in TABLE_1:
        cells: list[Any] = [row.name, row.false_before]
        for margin in margins.values():
            value = false_before(row, margin)
            cells += [value, value - row.false_before]
        rows.append(cells)
    return [
        "**P_F(1)** is a first-passage chain: a clutter start, a hit of the gate "
        "`pi (v_max k T + g)^2` with `1 - exp(-lambda a_k)` k scans after the last, M hits within "
        "N scans; nothing splits. The fitted g only shows that the form is right; the stated "
        "2.146 x 0.015 x 5000 m is principled, and takes one coordinate of the target for its "
        f"range, which is 7071 m. The rows {', '.join(unmatched_false_before())} fit no g.",
        Table("tsepm_2018_table_1_before", columns, rows),
    ]


def _after_parts(after: Mapping[str, dict[str, list[Estimate]]]) -> list[Part]:
    named = {
        f"{scene}; {name}": values
        for scene, readings in after.items()
        for name, values in readings.items()
    }
    factors = {name: math.exp(_log_distance(values)) for name, values in named.items()}
    order = sorted(factors, key=factors.__getitem__)
    close = [name for name in order if factors[name] <= MAX_RELATIVE_FACTOR * factors[order[0]]]
    parts: list[Part] = [
        "**P_F(2)** is simulated: the method with the rule, N scans, the whole 9 km disc, one "
        "target, p_d = 0.9. What it is a share of, and whether Eq. 26's threshold is squared, the "
        f"source leaves open; and its P_F(1) has one gate margin, {STATED_MARGIN:.0f} m, "
        "everywhere. The simulation may have had that margin only, with the errors as stated, or "
        "the errors of 5000 m everywhere, which halve the azimuth's. A track counts by its best "
        "member's first hit. The table says by which factor each reading is apart (root mean "
        "square of the ratio's logarithm, and the worst row), which rows are not in the factor, "
        "and how many published values lie inside the intervals, give or take half a unit of "
        "their last digit. Left out are 8/9, printed as 0, 7/9, printed above its own P_F(1), "
        "which pruning and merging cannot do, and rows where nothing false was seen. Closest, "
        f"within {MAX_RELATIVE_FACTOR - 1:.0%} of the smallest factor: {_listed(close, factors)}. "
        f"The closest of {len(factors)} readings is close by choice, too.",
        Table(
            "tsepm_2018_table_1_readings",
            [
                Column("reading"),
                Column("factor", ".2f"),
                Column("worst row"),
                Column("not in the factor"),
                Column(f"published values inside, of {len(TABLE_1)}"),
            ],
            [
                [name, factors[name], _worst(values), _left_out(values), _inside(values)]
                for name in order
                for values in [named[name]]
            ],
        ),
    ]
    for number, (scene, readings) in enumerate(after.items(), 1):
        columns = [Column("M/N"), Column("P_F(2), published", ".4f")]
        columns += [Column(name, ".4f") for name in readings]
        rows = [
            [row.name, row.false_after, *(values[place] for values in readings.values())]
            for place, row in enumerate(TABLE_1)
        ]
        parts += [f"With {scene}:", Table(f"tsepm_2018_table_1_after_{number}", columns, rows)]
    return parts


def _closest(readings: Mapping[str, list[Estimate]], pruning: str) -> str:
    """The closest reading of the denominator, with a reading of the threshold."""
    names = [name for name in readings if name.endswith(pruning)]
    return min(names, key=lambda name: _log_distance(readings[name]))


def _listed(names: list[str], factors: Mapping[str, float]) -> str:
    return "; ".join(f"*{name}* ({factors[name]:.2f})" for name in names)


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


def _worst(values: list[Estimate]) -> str:
    """Row with the largest deviation from the published value, and its factor."""
    ratios = _log_ratios(values)
    if not ratios:
        return "-"
    name = max(ratios, key=lambda row: abs(ratios[row]))
    return f"{name}: {math.exp(ratios[name]):.2f}"


def _left_out(values: list[Estimate]) -> str:
    """Rows that are not in `_log_ratios`."""
    ratios = _log_ratios(values)
    return ", ".join(row.name for row in TABLE_1 if row.name not in ratios)


def _inside(values: list[Estimate]) -> int:
    """Published values inside the intervals; they are rounded."""
    return sum(
        estimate.low - HALF_DIGIT <= row.false_after <= estimate.high + HALF_DIGIT
        for row, estimate in zip(TABLE_1, values, strict=True)
    )


def _claims_table(after: Mapping[str, dict[str, list[Estimate]]]) -> Table:
    """Claims of the text about the table, by the published values and by ours."""
    published = {row.name: row.false_after for row in TABLE_1}
    rows = [
        ["published", _recommended(published), _falls_with_hits(published)],
        *(
            [f"{scene}; {name}", _recommended(ours), _falls_with_hits(ours)]
            for scene, readings in after.items()
            for name, values in readings.items()
            for ours in [_by_rule(values)]
        ),
    ]
    return Table(
        "tsepm_2018_table_1_claims",
        [
            Column("P_F(2)"),
            Column(
                "rules with P_D > 0.85 and P_F < 0.05 at p_d = 0.9 (text: "
                f"{', '.join(sorted(RECOMMENDED))})"
            ),
            Column("P_F falls with M at each N"),
        ],
        rows,
    )


def _by_rule(values: list[Estimate]) -> dict[str, float]:
    return {row.name: estimate.value for row, estimate in zip(TABLE_1, values, strict=True)}


def _recommended(false: dict[str, float]) -> str:
    names = [row.name for row in TABLE_1 if row.detection[1] > 0.85 and false[row.name] < 0.05]
    return ", ".join(names) or "none"


def _falls_with_hits(false: dict[str, float]) -> str:
    pairs = [
        (false[fewer.name], false[more.name])
        for fewer in TABLE_1
        for more in TABLE_1
        if fewer.rule[1] == more.rule[1] and fewer.rule[0] + 1 == more.rule[0]
    ]
    return f"{sum(fewer >= more for fewer, more in pairs)} of {len(pairs)} pairs"


def _picture(after: Mapping[str, dict[str, list[Estimate]]]) -> Picture:
    shown = {
        f"{scene}; {name}": readings[name]
        for scene, readings in after.items()
        for pruning in READINGS
        for name in [_closest(readings, pruning)]
    }

    def draw(figure: Any) -> None:
        axes = figure.subplots(1, 2, sharex=True)
        names = [row.name for row in TABLE_1]
        axes[0].plot(names, [row.false_before for row in TABLE_1], "kx", label="published")
        for name, margin, style in (
            (f"chain, g = {FITTED_MARGIN:.1f} m (fitted)", FITTED_MARGIN, "C0o"),
            (f"chain, g = {STATED_MARGIN:.0f} m (sigma at 5000 m)", STATED_MARGIN, "C1s"),
            (f"chain, g = {true_margin():.0f} m (sigma at 7071 m)", true_margin(), "C2^"),
        ):
            chain = [false_before(row, margin) for row in TABLE_1]
            axes[0].plot(names, chain, style, mfc="none", label=name)
        axes[0].set_title("P_F(1)", loc="left")
        axes[1].plot(names, [row.false_after for row in TABLE_1], "kx", label="published")
        for name, values in shown.items():
            shares = np.array([estimate.value for estimate in values])
            bars = error_bars(shares, values)
            axes[1].errorbar(names, shares, yerr=bars, fmt="o", ms=4, label=name)
        axes[1].set_title("P_F(2)", loc="left")
        for axis in axes:
            axis.set(yscale="log", ylim=(1e-4, 1.0))
            axis.tick_params(axis="x", rotation=60)
            axis.grid(alpha=0.3)
            axis.legend(fontsize=7, loc="upper center", bbox_to_anchor=(0.5, -0.15))

    return Picture(
        "tsepm_2018_table_1",
        f"Table 1 of TSEPM 2018 ({TABLE_1_RUNS} runs there): P_F before and after pruning and "
        "merging, published and here",
        draw,
        (11.0, 5.2),
    )
