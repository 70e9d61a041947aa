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

import itertools
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from operator import itemgetter
from typing import Any

import numpy as np
from scipy.integrate import trapezoid
from scipy.special import ndtr

from tsepm_ros.methods.tsepm import READINGS, Candidates, Tsepm, TsepmOptions
from tsepm_ros.numerics.arrays import FloatArray, IntArray
from tsepm_ros.numerics.gaussian import gate_factor
from tsepm_ros.studies.reproduction.monte_carlo import (
    AS_GIVEN,
    CURVES,
    DENSITIES,
    ERRORS,
    FIGURE_7_DENSITY,
    FIGURE_7_MARKS,
    GATE_PROBABILITY,
    MAX_SPEED,
    OWN_GATE,
    PERIOD,
    RULE,
    STATED_MARGIN,
    TABLE_1,
    TABLE_1_DENSITY,
    TABLE_1_DETECTION_PROBABILITIES,
    TARGET,
    WEIGHTS,
    Counted,
    MonteCarloStarts,
    MonteCarloTable1Row,
    comparison,
    monte_carlo_sensor,
    table_1,
    table_1_cases,
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
    report_claim,
    report_claims,
    report_column,
    report_count,
    report_text,
)
from tsepm_ros.tools.design import expected_counts
from tsepm_ros.tools.evaluation.intervals import (
    IntervalEstimate,
    mean_count_interval,
    mean_interval,
    proportion_interval,
    ratio_interval,
    root_mean_square_interval,
)
from tsepm_ros.tools.evaluation.simulated_run import SimulatedScene
from tsepm_ros.tools.simulation import CLUTTER, Scenario
from tsepm_ros.tracker.measurement import measurement_covariance
from tsepm_ros.tracker.options import CommonOptions
from tsepm_ros.tracker.scan import scan_positions
from tsepm_ros.tracker.tracker import Tracker
from tsepm_ros.tracker.tracks import TrackArrays

FITTED_MARGIN = 159.78
"""g that fits most of P_F(1), m. The fit confirms only the form of the equation."""
TABLE_1_RUNS, FIGURE_RUNS = 150, 10
"""Runs on the page, of each scene."""
MIN_SHOWN = 8
"""Minimum N of the rows by rule in the report."""
MIN_ROWS = 13
"""Of 15 independent 95 % intervals fewer hold the true values with a probability of 0.04."""
STAGES = (
    "Steps 2-3, split: {} tracks of M hits",
    "Steps 4-6, evaluated, pruned: {}",
    "Step 7, merged: {}",
)
"""Titles of the picture of the stages."""
REACH = np.array([-1200.0, 1200.0])
"""Of this picture round the target's first position, m."""
RECOMMENDED = (5, 8), (6, 9)
"""Rules of the text for p_d = 0.9, P_D above 0.85 and P_F below 0.05."""
MAX_DETECTION_DIFFERENCE = 1e-4
MAX_FALSE_DIFFERENCE = 1e-3
DENOMINATORS = {
    "per start": (Counted.WRONG, Counted.STARTS),
    "per first start": (Counted.FIRST_SCAN_TRACKS, Counted.FIRST_SCAN_STARTS),
    "share of first starts": (Counted.STARTS_WITH_TRACK, Counted.FIRST_SCAN_STARTS),
}
"""Readings of P_F(2): numerator and denominator."""
SHOWN = (
    "tsepm, f1 literal",
    "clutter test, size 0.5",
    "multiple model",
    OWN_GATE,
)
"""Curves that the report shows as numbers."""


def detection(row: MonteCarloTable1Row) -> list[float]:
    """P_D of a row in closed form, at each p_d."""
    return [
        expected_counts.confirmation_probability(*row.rule, p_d, GATE_PROBABILITY)
        for p_d in TABLE_1_DETECTION_PROBABILITIES
    ]


def detection_with_slip(row: MonteCarloTable1Row) -> list[float]:
    """P_D with an additional factor P p_d in the term of a fourth hit in the sixth scan.

    That term of 4/6 and 4/7 is ``p_d C(4, 2) h^3 (1 - h)^2`` with ``h = P p_d``.
    """
    hits = [GATE_PROBABILITY * p_d for p_d in TABLE_1_DETECTION_PROBABILITIES]
    return [
        exact - p_d * 6.0 * hit**3 * (1.0 - hit) ** 2 * (1.0 - hit)
        for exact, p_d, hit in zip(
            detection(row), TABLE_1_DETECTION_PROBABILITIES, hits, strict=True
        )
    ]


def false_before(row: MonteCarloTable1Row, margin: float) -> float:
    """P_F(1) of a row from the first-passage chain with a gate margin g, m."""
    areas = expected_counts.unbounded_gate_areas(MAX_SPEED, PERIOD, margin, row.rule[1])
    return expected_counts.false_start_probability(*row.rule, TABLE_1_DENSITY, areas)


def unmatched_detection() -> list[str]:
    """Rows whose P_D differs from the closed form."""
    return [row.name for row in TABLE_1 if not _is_near(detection(row), row)]


def _is_near(values: Sequence[float], row: MonteCarloTable1Row) -> bool:
    return np.allclose(values, row.detection, rtol=0.0, atol=MAX_DETECTION_DIFFERENCE)


def unmatched_false_before() -> list[str]:
    """Rows whose P_F(1) differs from the chain, even with the fitted margin."""
    return [
        row.name
        for row in TABLE_1
        if abs(false_before(row, FITTED_MARGIN) - row.false_before) > MAX_FALSE_DIFFERENCE
    ]


def reproduce(
    setting: ReportSetting,
    by_density: Mapping[float, Scenario] = DENSITIES,
    by_error: Mapping[float, Scenario] = ERRORS,
) -> list[Part]:
    """The parts of the source's chapter."""
    return [
        *stage_parts(setting),
        *table_1_parts(setting),
        *figure_parts(setting, by_density, by_error),
    ]


def table_1_parts(setting: ReportSetting) -> list[Part]:
    """The table, its columns in closed form and simulated."""
    cases = table_1_cases()
    results = dict(
        zip(
            cases,
            setting.results(table_1, list(cases.values()), TABLE_1_RUNS),
            strict=True,
        )
    )
    readings = [
        Tsepm2018Reading.of(f"{scene}, {threshold}", runs, denominator)
        for scene, runs in results.items()
        for threshold in READINGS
        for denominator in DENOMINATORS
    ]
    return [
        "### Table 1",
        _claims(readings),
        *_detection_parts(readings[0], len(results["as stated"])),
        *_before_parts(),
        *_reading_parts(readings),
    ]


def tsepm_2018_ratio(part: FloatArray, whole: FloatArray) -> IntervalEstimate:
    """Ratio of two sums of counts over independent runs, above 0 also where there is no event."""
    if whole.any() and not part.any():
        return mean_count_interval([0]) / float(whole.sum())
    ratio = ratio_interval(part, whole)
    return IntervalEstimate(ratio.value, max(ratio.low, 0.0), ratio.high)


@dataclass(frozen=True)
class Tsepm2018Reading:
    """Table 1 as simulated by a reading.

    Attributes
    ----------
    name, denominator : str
    found, false : list of IntervalEstimate
        P_D at p_d = 0.9, and P_F(2), of each row.
    errors : list of list of IntervalEstimate
        Root mean square errors of the first true tracks, of each row: position, m, velocity, m/s.
    """

    name: str
    denominator: str
    found: list[IntervalEstimate]
    false: list[IntervalEstimate]
    errors: list[list[IntervalEstimate]]

    @classmethod
    def of(cls, name: str, runs: Sequence[Result], denominator: str) -> Tsepm2018Reading:
        """The reading of a threshold, the last word of its name, and of a denominator."""
        counts = np.array([[run[f"{r.name} {name.split()[-1]}"] for r in TABLE_1] for run in runs])
        rows = np.moveaxis(counts, 1, 0)
        part, whole = DENOMINATORS[denominator]
        both = [Counted.POSITION_ERROR, Counted.VELOCITY_ERROR]
        return cls(
            name,
            denominator,
            [proportion_interval(int(row[:, Counted.FOUND].sum()), len(runs)) for row in rows],
            [tsepm_2018_ratio(row[:, part], row[:, whole]) for row in rows],
            [
                [root_mean_square_interval(row[np.isfinite(row[:, k]), k]) for k in both]
                for row in rows
            ],
        )

    @property
    def agreeing(self) -> tuple[int, int]:
        """Rows whose published P_D, and P_F(2), lie in the interval."""
        rows = [*zip(TABLE_1, self.found, self.false, strict=True)]
        return (
            sum(found.low <= row.detection[1] <= found.high for row, found, _ in rows),
            sum(false.low <= row.false_after <= false.high for row, _, false in rows),
        )


def _claims(readings: Sequence[Tsepm2018Reading]) -> ReportTable:
    """The claims on Table 1."""
    places, here = {row.rule: n for n, row in enumerate(TABLE_1)}, readings[0]
    p_d, p_f = (IntervalEstimate(value, value, value) for value in (0.85, 0.05))
    windows = np.array([row.rule[1] for row in TABLE_1])
    by_window = [np.flatnonzero(windows == n) for n in np.unique(windows)[1:]]
    both = sum(min(one.agreeing) >= MIN_ROWS for one in readings)
    rows = [
        report_count(
            "P_D is the closed form",
            [row.name not in unmatched_detection() for row in TABLE_1],
        ),
        report_count(
            "P_F(1) is the chain, its margin fitted",
            [row.name not in unmatched_false_before() for row in TABLE_1],
        ),
        [
            "P_D and P_F(2) come from one method",
            f"by {both} of {len(readings)} readings",
            "agrees" if both else "differs",
        ],
        *(
            claim
            for m, n in RECOMMENDED
            for claim in (
                report_claim(f"{m}/{n}: P_D - 0.85 > 0", here.found[places[m, n]] - p_d, "+.3f"),
                report_claim(f"{m}/{n}: 0.05 - P_F > 0", p_f - here.false[places[m, n]], "+.3f"),
            )
        ),
    ]
    for k, name in enumerate(("position", "velocity")):
        gains = [here.errors[min(own)][k] - here.errors[max(own)][k] for own in by_window]
        claim = f"at each N, the largest M has a smaller error of {name} than the smallest M"
        rows.append(report_count(claim, [gain.low > 0.0 for gain in gains]))
    return report_claims("tsepm_2018_table_1", rows)


def _detection_parts(stated: Tsepm2018Reading, runs: int) -> list[Part]:
    columns = {
        "M/N": "",
        "P_D at 0.9, published": ".4f",
        "closed form less it": "+.4f",
        "P_D, simulated": ".2f",
        "position, rms, m": ".0f",
        "velocity, rms, m/s": ".1f",
    }
    rows: list[list[Cell]] = [
        [
            row.name,
            row.detection[1],
            detection(row)[1] - row.detection[1],
            found,
            *errors,
        ]
        for row, found, errors in zip(TABLE_1, stated.found, stated.errors, strict=True)
    ]
    missed = [row for row in TABLE_1 if row.name in unmatched_detection()]
    slips = sum(_is_near(detection_with_slip(row), row) for row in missed)
    return [
        "**P_D.** The closed form `p_d P(Binomial(N-1, P p_d) >= M-1)` with P = 0.9 gives "
        f"{3 * (len(TABLE_1) - len(missed))} of {3 * len(TABLE_1)} entries within "
        f"{MAX_DETECTION_DIFFERENCE:g}. The rows {' and '.join(row.name for row in missed)} are "
        f"lower in print: {3 * slips} of their {3 * len(missed)} entries fit if the term of the "
        "sixth scan, `6 p_d h^3 (1-h)^2` with h = P p_d, gets a further factor h. *Simulated* is "
        f"the share of {runs} runs with a true track within N scans, with Eq. 26 read literally. "
        "Errors are those of the first true track.",
        ReportTable(
            "tsepm_2018_table_1_detection",
            columns,
            rows,
            [cells for cells, row in zip(rows, TABLE_1, strict=True) if row.rule[1] >= MIN_SHOWN],
            hidden=["closed form less it"],
        ),
    ]


def _before_parts() -> list[Part]:
    margins = {
        f"fitted g = {FITTED_MARGIN:.1f} m": FITTED_MARGIN,
        f"sigma at 5000 m, g = {STATED_MARGIN:.2f} m": STATED_MARGIN,
    }
    rows: list[list[Cell]] = [
        [
            row.name,
            row.false_before,
            *(false_before(row, margin) for margin in margins.values()),
        ]
        for row in TABLE_1
    ]
    missed = unmatched_false_before()
    return [
        "**P_F(1)** is a first-passage chain of one clutter start: k scans after the last hit, the "
        "gate `a_k = pi (v_max k T + g)^2` has a hit with a probability of `1 - exp(-lambda a_k)`. "
        f"With the fitted g, {len(TABLE_1) - len(missed)} of {len(TABLE_1)} rows are as published "
        f"within {MAX_FALSE_DIFFERENCE:g}; no g fits the rows {', '.join(missed)}.",
        ReportTable(
            "tsepm_2018_table_1_before",
            {"M/N": "", "P_F(1), published": ".4f"} | dict.fromkeys(margins, ".4f"),
            rows,
            [row for row in rows if row[0] in missed],
        ),
    ]


def _reading_parts(readings: Sequence[Tsepm2018Reading]) -> list[Part]:
    shown = [row for row, line in enumerate(TABLE_1) if line.rule in RECOMMENDED]
    columns = {
        "reading": "",
        "P_F(2) is": "",
        "P_D, 5/8": ".2f",
        "P_F(2), 5/8": ".3f",
        "P_D, 6/9": ".2f",
        "P_F(2), 6/9": ".3f",
        "rows of P_D": "",
        "rows of P_F(2)": "",
    }
    both = [(TABLE_1[row].detection[1], TABLE_1[row].false_after) for row in shown]
    published: list[Cell] = ["published", "-", *both[0], *both[1], "-", "-"]
    rows: list[list[Cell]] = [
        [
            *(one.name, one.denominator),
            *(column[row] for row in shown for column in (one.found, one.false)),
            *one.agreeing,
        ]
        for one in readings
    ]
    nearest = {row[0]: max((r for r in rows if r[0] == row[0]), key=itemgetter(-1)) for row in rows}
    return [
        "**P_D and P_F(2) together** are simulated in the 9 km disc with one target and p_d = 0.9. "
        "Each line is a reading. The threshold of Eq. 26 is literal or squared. The gate margin is "
        f"as stated, or the {STATED_MARGIN:.0f} m of P_F(1). The errors are as stated, or those at "
        "5000 m. In Eq. 22 the fit contains the hit, or predicts it from the other hits, or from "
        "the hits before. P_F(2) counts false and misplaced tracks per start (*per first start*: "
        "of the first scan); a line shows the denominator with which most rows agree. *Rows* is "
        "the number of published values, of 15, in our intervals. A reading agrees with "
        f"{MIN_ROWS} rows of both.",
        ReportTable(
            "tsepm_2018_table_1_readings",
            columns,
            [published, *rows],
            [published, *nearest.values()],
            hidden=("P_D, 6/9", "P_F(2), 6/9"),
        ),
    ]


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
        kinds: dict[str, tuple[str, Any, Iterable[str]]] = {
            "P_D": (".2f", self.found, CURVES),
            "P_F": (".2g", self.per_start, CURVES),
            "P_D, any": (".2f", partial(self.found, place=3), [c for c in CURVES if "tsepm" in c]),
        }
        columns, values = {heading: spec}, [[*self.scenes]]
        for kind, (text, values_of, curves) in kinds.items():
            columns |= {f"{curve}: {kind}": text for curve in curves}
            values += [values_of(curve) for curve in curves]
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
                ReportLine(x, values, curve, _style(curve, k))
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


def _style(name: str, k: int) -> dict[str, object]:
    dashes = {"clutter": "--", "multiple": "-."}.get(name.split()[0], "-")
    return {"fmt": "osD^vPX*"[k], "ls": dashes, "color": f"C{k}", "ms": 4, "lw": 1}


def gate_hit_probability(error: float) -> float:
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
    radius = MAX_SPEED * PERIOD + gate_factor(GATE_PROBABILITY) * error
    x = np.linspace(-radius, radius, 4001)
    half = np.sqrt(radius**2 - x**2)
    density = np.exp(-0.5 * ((x - offset[0]) / sigma[0]) ** 2) / (np.sqrt(2 * np.pi) * sigma[0])
    across = ndtr((half - offset[1]) / sigma[1]) - ndtr((-half - offset[1]) / sigma[1])
    return float(trapezoid(density * across, x))


def one_start(error: float) -> float:
    """P_D of one start without clutter or pruning, with the gate of a measurement error."""
    return expected_counts.confirmation_probability(*RULE, 0.9, gate_hit_probability(error))


class Tsepm2018Stages(Tsepm):
    """TSEPM 2018 that keeps what each stage leaves, for a picture.

    Attributes
    ----------
    stages : three lists of (n, k, 2) ndarray
        Positions of the hits of tracks that reach M hits, and of those left by pruning; first and
        last positions of the states after merging, M - 1 scans apart.
    """

    def forget(self) -> None:
        """See `Method.forget`."""
        super().forget()
        self.stages: tuple[list[FloatArray], ...] = [], [], []

    def estimated(self, ids: IntArray) -> Candidates:
        """See `Tsepm.estimated`."""
        self.stages[0].append(self.detections[ids]["position"])
        return super().estimated(ids)

    def merge(self, candidates: Candidates) -> TrackArrays:
        """See `Tsepm.merge`."""
        tracks = super().merge(candidates)
        ends = np.reshape(tracks.state, (-1, 1, 4)) + np.zeros((1, 2, 1))
        ends[:, 0, 0::2] -= PERIOD * (self.options.min_hits - 1) * ends[:, 0, 1::2]
        self.stages[1].append(self.detections[candidates.hits]["position"])
        self.stages[2].append(ends[..., 0::2])
        return tracks


def stage_parts(setting: ReportSetting) -> list[Part]:
    """Figs. 1 to 4: the flow of the stages, drawn in one scene."""
    scenario = DENSITIES[TABLE_1_DENSITY]
    scene = SimulatedScene.drawn(scenario, [setting.seed, 0])
    common = CommonOptions(max_speed=MAX_SPEED, **AS_GIVEN)
    options = TsepmOptions(min_hits=RULE[0], window=RULE[1], gate_probability=GATE_PROBABILITY)
    method = Tsepm2018Stages(scenario.sensor, common, options)
    MonteCarloStarts.on(scene, Tracker(method), RULE[1])
    places = np.concatenate([scan_positions(scan) for scan in scene.scans])
    own = places[np.concatenate(scene.origins) != CLUTTER]
    target = ReportLine(
        own[:, 0], own[:, 1], "target", {"ls": "", "marker": "o", "color": "C2", "ms": 5}
    )
    dots = {"ls": "", "marker": ".", "color": "0.5", "ms": 3}
    every = ReportLine(places[:, 0], places[:, 1], "clutter", dots)
    panels = [([every, target], "Step 1: detections of all scans")]
    for title, parts in zip(STAGES, method.stages, strict=True):
        paths = np.concatenate(parts)
        apart = np.concatenate([paths, np.full((len(paths), 1, 2), np.nan)], axis=1)
        x, y = apart.reshape(-1, 2).T
        lines = ReportLine(x, y, style={"color": "C0", "lw": 0.7})
        panels.append(([lines, target], title.format(len(paths))))
    around = {"xlim": TARGET[0] + REACH, "ylim": TARGET[1] + REACH, "aspect": 1.0, "xlabel": "m"}
    caption = (
        f"Figs. 1 to 4 of TSEPM 2018: the four stages over {RULE[1]} scans of one scene, "
        f"{TABLE_1_DENSITY:g} false detections per m²; the numbers are of the whole scene"
    )
    drawn = [ReportPanel(lines, {**around, "title": title}) for lines, title in panels]
    return [ReportPicture("tsepm_2018_stages", caption, drawn, (14.0, 4.0))]


def figure_parts(
    setting: ReportSetting, by_density: Mapping[float, Scenario], by_error: Mapping[float, Scenario]
) -> list[Part]:
    """The curves, the burden, the weights of merging and the gate."""
    cases = [*by_density.values(), *by_error.values()]
    results = setting.results(comparison, cases, FIGURE_RUNS)
    densities = Tsepm2018Curves(by_density, results[: len(by_density)])
    errors = Tsepm2018Curves(by_error, results[len(by_density) :])
    return [
        "### Figs. 5-8",
        _curve_claims(densities, errors, [*map([*by_error].index, FIGURE_7_MARKS)]),
        f"The curves are of {len(results[0])} runs with the rule {RULE[0]}/{RULE[1]} over 8 scans, "
        "p_d 0.9, and clutter in 36 km² round the target. Gates are of 0.9; the multiple model "
        "also has 0.99. TSEPM prunes by f1, with Eq. 26 literal or squared, or by Kennedy's f2, as "
        "does the clutter test. P_F is the number of false and misplaced tracks per start; it may "
        "exceed 1, since a start splits. *Judged by any member*: a merged group within 3 sigma of "
        "the target is true if any member has more than half of its hits from the target; "
        "otherwise its best member is judged. A claim compares the ends of a curve, or two curves "
        f"at the greatest density or error. Figs. 7 and 8 are at {FIGURE_7_DENSITY:g} per m².",
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
        *_merging_parts(densities),
        *_gate_parts(),
    ]


def _curve_claims(
    density: Tsepm2018Curves, error: Tsepm2018Curves, between: Sequence[int]
) -> ReportTable:
    """The claims on the curves, as differences; those of Fig. 7 between two places of the curve."""
    tsepm, test, model, own = SHOWN
    by_error, (first, last) = error.found(tsepm), between
    equal = {
        "Fig. 5: P_D of TSEPM is constant": _ends(density.found(tsepm)),
        "Fig. 5: P_D of TSEPM, judged by any member, is constant": _ends(density.found(tsepm, 3)),
        "Fig. 5: P_D of TSEPM is that of the clutter test": (
            density.found(tsepm)[-1] - density.found(test)[-1]
        ),
        "Fig. 7: P_D of TSEPM is constant from 120 m on": by_error[last] - by_error[-1],
    }
    more = {
        "Fig. 7: P_D of TSEPM falls from 75 to 120 m": by_error[first] - by_error[last],
        "Fig. 5: P_D of the multiple model falls": _ends(density.found(model)),
        "Fig. 5: P_D of the multiple model with the gate 0.99 falls": _ends(density.found(own)),
    }
    for figure, curves in (("Fig. 6", density), ("Fig. 8", error)):
        false = {curve: curves.per_start(curve) for curve in SHOWN}
        more[f"{figure}: P_F of the clutter test exceeds TSEPM's"] = (
            false[test][-1] - false[tsepm][-1]
        )
        more[f"{figure}: P_F of the multiple model exceeds the test's"] = (
            false[model][-1] - false[test][-1]
        )
    rows = [report_claim(text, value, "+.2f", 0.0) for text, value in equal.items()]
    rows += [report_claim(text, value, "+.2f") for text, value in more.items()]
    rows += [
        report_count(
            f"Fig. 8: P_F rises, {curve}",
            [(b - a).low > 0.0 for a, b in itertools.pairwise(error.per_start(curve))],
        )
        for curve in (tsepm, test, model)
    ]
    return report_claims("tsepm_2018_figures", rows)


def _ends(values: Sequence[IntervalEstimate]) -> IntervalEstimate:
    """The first value less the last."""
    return values[0] - values[-1]


def _merging_parts(densities: Tsepm2018Curves) -> list[Part]:
    """The burden before and after pruning and merging, and the weights of merging."""
    literal, last = SHOWN[0], densities.runs[-1]
    true, wrong, _, _, reached, left = (report_column(last, literal, k) for k in range(6))
    burden = [
        report_text(mean_count_interval(counts), ".3g") for counts in (reached, left, wrong + true)
    ]
    errors = np.array([e for runs in densities.runs for run in runs for e in run["weights"]])
    published, *others = errors.reshape(-1, len(WEIGHTS)).T
    return [
        f"**The burden** ({literal}). At {max(densities.scenes):.0e} per m², {burden[0]} tracks "
        f"per run reach M hits in 8 scans, pruning leaves {burden[1]}, and merging {burden[2]}.",
        f"**Merging by evaluation values** (Eq. 31, {literal}): the position of {len(published)} "
        "merged groups with a member from the target has an rms error of "
        f"{report_text(root_mean_square_interval(published), '.0f')} m; other weights change the "
        "mean error by "
        + ", ".join(
            f"{report_text(mean_interval(own - published), '+.1f')} m ({name})"
            for name, own in zip(WEIGHTS[1:], others, strict=True)
        )
        + ".",
    ]


def _gate_parts() -> list[Part]:
    computed = "; ".join(
        f"{gate_hit_probability(error):.3f} and {one_start(error):.3f} at {error:g} m"
        for error in (15.0, *FIGURE_7_MARKS, 180.0)
    )
    return [
        "**The gate.** The source explains Fig. 7 by the probability that a detected target falls "
        "into the gate: roughly 1 for measurement errors below 75 m, and 0.9 from 120 m on. The "
        f"computed values of this probability, and of P_D of one start, are {computed}."
    ]
