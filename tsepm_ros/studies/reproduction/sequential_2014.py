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
"""Sequential 2014: Figs. 8-11, Table 1, and the methods that it finds unsuitable."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import binom

from tsepm_ros.methods.registry import make_initiator
from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.studies import sequential
from tsepm_ros.studies.assignment import AssignmentPairs, oldest_first_assignment
from tsepm_ros.studies.reproduction import monte_carlo
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
)
from tsepm_ros.tools.evaluation.intervals import (
    IntervalEstimate,
    mean_interval,
    proportion_interval,
    root_mean_square_interval,
)
from tsepm_ros.tools.evaluation.measures import cramer_rao_measure
from tsepm_ros.tools.evaluation.simulated_run import Judged, Outcome, SimulatedScene
from tsepm_ros.tools.simulation import Scenario
from tsepm_ros.tools.simulation.scenario import ScenarioWaypointMotion
from tsepm_ros.tracker.measurement import convert_measurements
from tsepm_ros.tracker.sensor import SensorModel
from tsepm_ros.tracker.tracks import ConfirmedTrack

SCANS = 10
"""Of the rule 6 of 10, and of two minutes with the interval of the text."""
PERIODS = (12.0, 8.0)
"""Of the text and Fig. 9, and of the list of parameters, s."""
DURATION = 120.0
"""s."""
RUNS = 400
"""Published, and on the page."""
TARGETS = 6
DISTANCE = 6000.0
"""Of the hexagon's corners, m."""
TARGET_SPEED = 5.0
"""m/s."""
MAX_SPEED = 10.0
"""m/s."""
SQUARE_SIDE = 400.0
"""m."""
PLATFORM_SPEED = 4.0
"""m/s."""
MAX_RANGE = 10_000.0
"""m."""
CLUTTER = 30
RANGE_ERROR_FRACTION = 0.015
ANGLE_ERROR_DEG = 1.0

FOUR_OR_MORE = 1.0
"""Probability that four or more targets are started, Fig. 8."""
ALL_SIX = 0.52
TIMES = np.array([72.0, 84.0, 96.0, 108.0, 120.0])
"""s."""
FORMED = np.array([1.1, 3.4, 5.3, 5.8, 6.0])
"""Tracks formed by these times, Fig. 9."""
TABLE_1 = {
    "least_squares": (82.3, 0.46, 8.6),
    "linear_fitting": (114.5, 4.2, 13.2),
    "kalman_filter": (210.6, 8.5, 12.7),
}
"""Errors of position (m), speed (m/s) and angle (degrees)."""


Scenes = Mapping[tuple[float, float], Scenario]
"""Scenes by interval (s) and p_d."""
ESTIMATORS = {
    "least_squares": "least squares",
    "linear_fitting": "linear fitting",
    "kalman_filter": "Kalman filter",
}


DETECTION_PROBABILITIES = (1.0, 0.9, 0.8)
ASSUMED = 0.9
"""Detection probability of the scene with the listed interval."""
MAIN = (PERIODS[0], ASSUMED)
"""The scene of Table 1's errors and of the pictures."""
TURN_RADIUS = 1.0
"""Turn radius of the platform at a corner, m; the published platform turns on the spot."""


AS_LISTED = f"{__name__}:SequentialAsListed"
MATCHINGS = {
    "nearest pair first": ("sequential", "nearest"),
    "oldest first, of one scan the nearest pair": ("sequential", "oldest"),
    "oldest first, of one scan as listed": (AS_LISTED, "oldest"),
    "by several tracks": ("sequential", "shared"),
}
"""Method and value of `SequentialOptions.matching`, in the words of the tables."""
GATES = ("range", "major_axis")
MATCHED = tuple(itertools.product(GATES, MATCHINGS))
"""Meaning of sigma in Eq. 7, and track of a detection that several tracks match (Step 3)."""
DEFAULT_READING = (GATES[0], "oldest first, of one scan the nearest pair")
"""The default reading of the method."""
SIX_OF_TEN = {"min_hits": 6, "window": 10}
WIDER = {**SIX_OF_TEN, "gate_sigmas": 2.0}
CONVENTIONAL: dict[str, tuple[str, dict[str, Any]]] = {
    "heuristic, as printed": ("heuristic", {}),
    "heuristic, 6/10, 2 sigma": ("heuristic", {**WIDER, "max_acceleration": 2.0}),
    "logic, 6/10": ("logic", SIX_OF_TEN),
    "logic, ends when missed": ("logic", {"missed": "ends"}),
    "modified Hough, as printed": ("modified_hough", {}),
    "modified Hough, 6/10, 2 sigma": ("modified_hough", {**WIDER, "max_turn": 1.0}),
    "Hough, 15 angles, 900 m": ("hough", {**SIX_OF_TEN, "angles": 15, "cell": 900.0}),
    "Hough, 45 angles, 300 m": ("hough", {**SIX_OF_TEN, "angles": 45, "cell": 300.0}),
    "Hough, 90 angles, 150 m": ("hough", {**SIX_OF_TEN, "angles": 90, "cell": 150.0}),
    "Hough, 180 angles, 50 m": ("hough", {**SIX_OF_TEN, "angles": 180, "cell": 50.0}),
    "two points": ("sequential", {"min_hits": 2, "window": 2}),
    "sequential": ("sequential", {}),
}
"""Methods in the scene of 2014 that the source finds unsuitable, and its own."""
_KINDS = ("true", "all")
STARTS = {
    "T, s": "g",
    "p_d": "g",
    "sigma": "",
    "a detection is taken": "",
    "P(>= 4)": ".3f",
    "P(all six)": ".3f",
    "P(all six), first scan at 0": ".3f",
    **{f"targets at {time:g} s": ".2f" for time in TIMES},
    "all tracks at 120 s": ".2f",
}
PUBLISHED: list[Cell] = [
    "-",
    "-",
    "-",
    "published",
    FOUR_OR_MORE,
    ALL_SIX,
    "-",
    *FORMED,
    "-",
]


class SequentialAsListed(sequential.Sequential):
    """Step 3 read to the letter: each track in turn, in the order in which Step 5 made them.

    The tracks of one scan are made in the order of its detections, which the source leaves open.
    """

    def choose(self, pairs: AssignmentPairs) -> AssignmentPairs:
        """See `Sequential.choose`."""
        return oldest_first_assignment(pairs, self.potential.hits[:, 0])  # ids ascend


def hexagon_case(period: float, detection_probability: float) -> Scenario:
    """The scene of Section 5, from time 0 to two minutes; every run draws the targets' headings.

    Parameters
    ----------
    period : float
        s.
    detection_probability : float
    """
    half = 0.5 * SQUARE_SIDE
    corners = ((-half, -half), (half, -half), (half, half), (-half, half))
    sensor = SensorModel(
        range_std_fraction=RANGE_ERROR_FRACTION,
        azimuth_std=math.radians(ANGLE_ERROR_DEG),
        max_range=MAX_RANGE,
        detection_probability=detection_probability,
        clutter_density=CLUTTER / (math.pi * MAX_RANGE**2),
    )
    return Scenario(
        "sequential_2014",
        scans=1 + int(DURATION // period),
        period=period,
        sensor=sensor,
        own_ship=ScenarioWaypointMotion(
            corners, PLATFORM_SPEED, PLATFORM_SPEED / TURN_RADIUS, True
        ),
    )


def hexagon(rng: np.random.Generator) -> tuple[FloatArray, ...]:
    """States of the targets, with headings drawn."""
    azimuth = np.arange(TARGETS) * 2.0 * np.pi / TARGETS
    heading = rng.uniform(-np.pi, np.pi, TARGETS)
    x, y = DISTANCE * np.array([np.cos(azimuth), np.sin(azimuth)])
    vx, vy = TARGET_SPEED * np.array([np.cos(heading), np.sin(heading)])
    return tuple(np.stack([x, vx, y, vy], axis=1))


def hexagon_cases() -> dict[tuple[float, float], Scenario]:
    """Scenes by interval (s) and p_d; the source leaves both open."""
    text_period, list_period = PERIODS
    keys = [(text_period, p_d) for p_d in DETECTION_PROBABILITIES]
    return {key: hexagon_case(*key) for key in (*keys, (list_period, ASSUMED))}


def run_hexagon(scenario: Scenario, seed: list[int]) -> Result:
    """Start tracks by every reading.

    Returns cumulative counts per reading and scan: targets with a true track, and all tracks. Of
    the default reading it also returns the errors of each estimator.
    """
    scene = _hexagon_scene(scenario, seed)
    results: Result = {}
    for gate, matching in MATCHED:
        method, assigned = MATCHINGS[matching]
        started = _started(scene, method, {"gate_error": gate, "matching": assigned})
        judged = started.judged()
        results |= _counts_by_scan(started, f"{gate}, {matching}", judged)
        if (gate, matching) == DEFAULT_READING:
            results |= errors_2014(started, monte_carlo.first_of_each_target(judged))
    return results


def _started(
    scene: SimulatedScene, method: str, options: Mapping[str, Any]
) -> monte_carlo.MonteCarloStarts:
    given = {"max_speed": MAX_SPEED, **monte_carlo.AS_GIVEN, **options}
    initiator = make_initiator(method, sensor=scene.scenario.sensor, **given)
    return monte_carlo.MonteCarloStarts.on(scene, initiator, scene.scenario.scans)


def _counts_by_scan(
    started: monte_carlo.MonteCarloStarts, name: str, judged: Sequence[Judged]
) -> Result:
    """Counts by the end of each scan: true tracks, all tracks."""
    scenario = started.scene.scenario
    true = [each.track.stamp for each in judged if each.outcome is Outcome.TRUE]
    counts = {}
    for kind, values in (("true", true), ("all", started.tracks.stamp)):
        scan = np.round(np.array(values) / scenario.period)
        number = np.histogram(scan, np.arange(scenario.scans + 1) - 0.5)[0]
        counts[f"{name}: {kind}"] = np.cumsum(number).astype(float).tolist()
    return counts


def run_conventional(scenario: Scenario, seed: list[int]) -> Result:
    """Start tracks by the conventional methods: counts by scan, and errors of the position, m."""
    scene = _hexagon_scene(scenario, seed)
    results: Result = {}
    for name, (method, options) in CONVENTIONAL.items():
        started = _started(scene, method, options)
        judged = scene.judge(list(started.tracks))  # lines of Hough have any number of hits
        results |= _counts_by_scan(started, name, judged)
        results[name] = [
            float(each.position_error) for each in monte_carlo.first_of_each_target(judged)
        ]
    return results


def _hexagon_scene(scenario: Scenario, seed: list[int]) -> SimulatedScene:
    """The scene with headings drawn."""
    targets = hexagon(np.random.default_rng([*seed, 1]))
    return SimulatedScene.drawn(dataclasses.replace(scenario, targets=targets), seed)


def errors_2014(started: monte_carlo.MonteCarloStarts, judged: list[Judged]) -> Result:
    """Errors of the estimators on the same hits.

    Returns
    -------
    dict
        Per estimator: distance (m), length of the velocity's error (m/s), speed less the true one
        (m/s), angle between the velocities (degrees), of each track in turn; and whether all hits
        of each track are the target's.
    """
    scene = started.scene
    results: Result = {name: [] for name in ESTIMATORS}
    for judgement in judged:
        truth = scene.simulator.truth(judgement.track.stamp)[judgement.target]
        for name in ESTIMATORS:
            results[name] += _mean_errors(_estimated(scene, judgement.track, name) - truth, truth)
    return results | {"pure": [float(each.pure) for each in judged]}


def _estimated(scene: SimulatedScene, track: ConfirmedTrack, estimator: str) -> FloatArray:
    sensor = scene.scenario.sensor
    hits = np.array(
        [convert_measurements(scene.scans[scan], sensor, scan)[row] for scan, row in track.hits]
    )
    noise = sequential.SequentialOptions().process_noise
    return sequential.sequential_estimate(hits[None], track.stamp, sensor, estimator, noise).state[
        0
    ]


def _mean_errors(error: FloatArray, truth: FloatArray) -> list[float]:
    true, estimated = truth[1::2], truth[1::2] + error[1::2]
    angle = math.atan2(true[0] * estimated[1] - true[1] * estimated[0], float(true @ estimated))
    return [
        float(np.hypot(error[0], error[2])),
        float(np.hypot(error[1], error[3])),
        float(np.hypot(*estimated) - np.hypot(*true)),
        abs(math.degrees(angle)),
    ]


@dataclass(frozen=True)
class Counts2014:
    """Tracks started by a reading in the runs of a scene.

    Attributes
    ----------
    period, detection_probability : float
    gate, matching : str
    true, every : (runs, scans) ndarray
        Counts by the end of each scan: targets with a true track; all tracks.
    """

    period: float
    detection_probability: float
    gate: str
    matching: str
    true: FloatArray
    every: FloatArray

    @classmethod
    def of(
        cls, key: tuple[float, float], reading: tuple[str, str], runs: list[Result]
    ) -> Counts2014:
        """Counts of a reading in the runs of a scene, given by interval and p_d."""
        name = ", ".join(reading)
        counts = (np.array([run[f"{name}: {kind}"] for run in runs]) for kind in _KINDS)
        return cls(*key, *reading, *counts)

    def place(self, time: float, earlier: bool = False) -> int:
        """Index of the last scan by a time (s); the first scan is after an interval, or at 0."""
        return int(time // self.period) - (0 if earlier else 1)

    def formed(self, counts: FloatArray, earlier: bool = False) -> list[IntervalEstimate]:
        """Means at the times of Fig. 9."""
        return [mean_interval(counts[:, self.place(time, earlier)]) for time in TIMES]

    def at_least(self, number: int, earlier: bool = False) -> IntervalEstimate:
        """Share of the runs with at least this number of targets started within two minutes."""
        enough = self.true[:, self.place(DURATION, earlier)] >= number
        return proportion_interval(int(enough.sum()), len(enough))


def reproduce(setting: ReportSetting, scenes: Scenes | None = None) -> list[Part]:
    """The parts of its chapter, by default of all scenes."""
    scenes = hexagon_cases() if scenes is None else scenes
    results = dict(
        zip(scenes, setting.results(run_hexagon, list(scenes.values()), RUNS), strict=True)
    )
    counts = [
        Counts2014.of(key, reading, runs) for key, runs in results.items() for reading in MATCHED
    ]
    [others] = setting.results(run_conventional, [scenes[MAIN]], RUNS)
    return [
        *_start_parts(counts),
        *_conventional_parts(others),
        *_error_parts(results),
    ]


def _claims(one: Counts2014) -> list[list[Cell]]:
    """The figures of Figs. 8 and 9 by a reading."""
    return [
        report_claim(f"P(>= 4) = {FOUR_OR_MORE:g}", one.at_least(4), ".3f", FOUR_OR_MORE, 1.0),
        report_claim(f"P(all six) = {ALL_SIX:g}", one.at_least(6), ".3f", ALL_SIX, 1.0),
        *(
            report_claim(f"{mean:g} targets at {time:g} s", estimate, ".2f", mean, 1.0)
            for time, mean, estimate in zip(TIMES, FORMED, one.formed(one.true), strict=True)
        ),
    ]


def _start_parts(counts: list[Counts2014]) -> list[Part]:
    [default] = [one for one in _in_main(counts) if (one.gate, one.matching) == DEFAULT_READING]
    rows = _claims(default)
    agreeing = [[row[2] == "agrees" for row in _claims(one)] for one in counts]
    for row, number in zip(rows, np.sum(agreeing, axis=0), strict=True):
        row[1] = f"{row[1]}; {number} of {len(counts)}"
    both = sum(map(all, agreeing))
    rows.append(["all of these", f"{both} of {len(counts)}", "agrees" if both else "differs"])
    share = ALL_SIX ** (1.0 / TARGETS)  # of each target, started independently
    four_or_more = float(binom.sf(3, TARGETS, share))
    most = TARGETS * ALL_SIX + (TARGETS - 1) * (1.0 - ALL_SIX)
    return [
        "### Figs. 8 and 9: targets started",
        f"Each of {len(default.true)} runs lasts two minutes, with the rule 6/10. Six targets "
        f"start on a hexagon of {DISTANCE:g} m, at {TARGET_SPEED:g} m/s with random headings. The "
        f"platform goes round a square of {SQUARE_SIDE:g} m at {PLATFORM_SPEED:g} m/s. A scan has "
        f"{CLUTTER} clutter points (here Poisson) in {MAX_RANGE / 1000:g} km; errors are 1.5 % and "
        f"1 degree. The {len(counts)} readings differ in p_d, T, sigma in Eq. 7, and the track "
        "that gets a detection that several match. The first scan is after one interval. A target "
        "is started by a true track; P(>= 4) is the share of runs with four or more. Verdicts "
        f"count the error of the published figure, of {RUNS} runs, too; *x of {len(counts)}* "
        "readings agree.",
        report_claims("sequential_2014", rows),
        ReportTable(
            "sequential_2014_starts",
            STARTS,
            [PUBLISHED, *map(_row, counts)],
            [
                PUBLISHED,
                *(_row(one) for one in _in_main(counts) if one.gate == DEFAULT_READING[0]),
            ],
            hidden=(
                "T, s",
                "p_d",
                "sigma",
                *(f"targets at {time:g} s" for time in TIMES[:4]),
                "all tracks at 120 s",
            ),
        ),
        f"In this table T is {MAIN[0]:g} s, p_d is {MAIN[1]:g}, and sigma is the error of the "
        f"{DEFAULT_READING[0]}. The claims above are judged by the default, "
        f"*{DEFAULT_READING[1]}*. The source does not order tracks begun in one scan; *as listed* "
        "means that each takes its nearest detection in turn.",
        f"If the targets are independent, P(all six) = {ALL_SIX} means P(>= 4) = "
        f"{four_or_more:.3f}; all of {RUNS} runs then have four or more with a probability of "
        f"{four_or_more**RUNS:.1g}. In any case, P(all six) = {ALL_SIX} allows a mean of at most "
        f"{most:.2f} started targets.",
        _starts_picture(counts),
    ]


def _in_main(readings: Sequence[Counts2014]) -> list[Counts2014]:
    """The readings in the main scene."""
    return [
        reading for reading in readings if (reading.period, reading.detection_probability) == MAIN
    ]


def _conventional_parts(runs: list[Result]) -> list[Part]:
    rows: list[list[Cell]] = []
    for name in CONVENTIONAL:
        counts = (mean_interval([run[f"{name}: {kind}"][-2] for run in runs]) for kind in _KINDS)
        rows.append(
            [name, *counts, root_mean_square_interval(np.concatenate([run[name] for run in runs]))]
        )
    period, p_d = MAIN
    return [
        "### The conventional methods in this scene",
        "The source says that these methods cannot start the real tracks, and that Hough with few "
        "cells has large errors, and with many cells finds nothing. TSEPM 2018 calls the start "
        f"from two points inaccurate. The table is at 120 s, for T = {period:g} s, p_d = {p_d:g} "
        f"and {len(runs)} runs.",
        ReportTable(
            "sequential_2014_conventional",
            {
                "method": "",
                "targets with a true track": ".2f",
                "all tracks": ".1f",
                "position, rms, m": ".0f",
            },
            rows,
            rows[::2],
        ),
    ]


def _row(reading: Counts2014) -> list[Cell]:
    last = reading.place(DURATION)
    return [
        reading.period,
        reading.detection_probability,
        reading.gate,
        reading.matching,
        reading.at_least(4),
        reading.at_least(6),
        reading.at_least(6, earlier=True),
        *reading.formed(reading.true),
        mean_interval(reading.every[:, last]),
    ]


def _starts_picture(counts: list[Counts2014]) -> ReportPicture:
    numbers = range(1, TARGETS + 1)
    marks = {"color": "k", "marker": "x", "ms": 9, "mew": 2}
    left = [ReportLine([4, 6], [FOUR_OR_MORE, ALL_SIX], style=marks | {"ls": ""})]
    right = [ReportLine(TIMES, FORMED, "published", marks | {"ls": ":"})]
    for reading in _in_main(counts):
        style = {
            "color": f"C{list(MATCHINGS).index(reading.matching)}",
            "ls": "-" if reading.gate == DEFAULT_READING[0] else "--",
            "marker": ".",
        }
        formed = [point.value for point in reading.formed(reading.true)]
        left.append(ReportLine(numbers, [reading.at_least(k).value for k in numbers], style=style))
        right.append(ReportLine(TIMES, formed, f"{reading.matching}, {reading.gate}", style))
    settings = {"xlabel": "targets", "ylabel": "share of runs"}
    return ReportPicture(
        "sequential_2014_figures_8_9",
        f"Figs. 8 and 9 of Sequential 2014, T = {MAIN[0]:g} s and p_d = {MAIN[1]:g}, by who gets a "
        "detection that several tracks match and by sigma",
        [
            ReportPanel(
                left, settings | {"title": "At least so many are started", "ylim": (0.0, 1.05)}
            ),
            ReportPanel(
                right, {"xlabel": "time, s", "ylabel": "targets, mean", "ylim": (0.0, 6.5)}
            ),
        ],
    )


def min_speed_error(hits: int, period: float) -> float:
    """Minimum mean absolute speed error (m/s), without bias, from hits in successive scans.

    It follows from the Cramer-Rao bound of the velocity component along the line of sight, the
    smaller component, at the targets' distance.
    """
    positions = np.tile([DISTANCE, 0.0], (hits, 1))
    times = np.arange(hits) * period
    sensor = hexagon_case(period, ASSUMED).sensor
    bound = cramer_rao_measure(positions, times, np.zeros(2), sensor, times[-1])
    return float(np.sqrt(2.0 / np.pi * min(bound[1, 1], bound[3, 3])))


def _error_parts(results: dict[tuple[float, float], list[Result]]) -> list[Part]:
    here = results[MAIN]
    rows: list[list[Cell]] = [
        ["published", ESTIMATORS[name], position, speed, "-", "-", angle]
        for name, (position, speed, angle) in TABLE_1.items()
    ]
    rows += [["here", text, *_figures(_stacked(here, name))] for name, text in ESTIMATORS.items()]
    pure = [own for runs in results.values() for run in runs for own in run["pure"]]
    six, ten = (min_speed_error(hits, MAIN[0]) for hits in (6, SCANS))
    _, speed, angle = TABLE_1["least_squares"]
    across = TARGET_SPEED * math.sin(math.radians(angle))
    return [
        "### Table 1, Figs. 10 and 11: errors of the estimators",
        "The estimators have the same hits, those of each target's first track by the default "
        f"reading ({np.mean(pure):.2f} of these tracks have only hits of their target). Linear "
        "fitting is read as a straight line from the first hit to the last. The Kalman filter is "
        "read as begun with the first two hits.",
        report_claims(
            "sequential_2014_table_1",
            [
                report_claim(f"{ESTIMATORS[name]}: {text} {value:g}", estimate, ".2f", value, 1.0)
                for name, published in TABLE_1.items()
                for text, value, estimate in zip(
                    ("position, m,", "speed, m/s,", "angle, degrees,"),
                    published,
                    np.array(_figures(_stacked(here, name)))[[0, 1, 4]],
                    strict=True,
                )
            ],
        ),
        ReportTable(
            "sequential_2014_table_1",
            {
                "scene": "",
                "estimator": "",
                "position, mean, m": ".1f",
                "speed, mean difference, m/s": ".2f",
                "mean error of the speed, m/s": ".2f",
                "mean length of the velocity's error, m/s": ".2f",
                "angle, mean, degrees": ".1f",
            },
            rows,
            rows[len(TABLE_1) :],
            hidden=[
                "scene",
                "position, mean, m",
                "speed, mean difference, m/s",
                "angle, mean, degrees",
            ],
        ),
        "By the Cramer-Rao bound, the mean absolute error of an unbiased speed is at least "
        f"{six:.2f} m/s with six hits in six scans of {MAIN[0]:g} s, and {ten:.2f} m/s with ten "
        f"hits in ten scans. The published error is {speed:g} m/s. At {TARGET_SPEED:g} m/s the "
        f"published angle error, {angle:g} degrees, alone is a velocity error of {across:.2f} m/s.",
        _errors_picture(here),
    ]


def _stacked(runs: list[Result], estimator: str) -> FloatArray:
    """Errors of all tracks, (n, 4), see `errors_2014`."""
    return np.concatenate([np.reshape(run[estimator], (-1, 4)) for run in runs])


def _figures(errors: FloatArray) -> list[IntervalEstimate]:
    position, velocity, speed, angle = errors.T
    return [mean_interval(values) for values in (position, np.abs(speed), speed, velocity, angle)]


def _errors_picture(runs: list[Result]) -> ReportPicture:
    panels = []
    for column, top, text in (
        (1, 8.0, "length of the velocity's error, m/s"),
        (3, 90.0, "angle between the velocities, degrees"),
    ):
        bins, lines = np.linspace(0.0, top, 33), []
        for name, label in ESTIMATORS.items():
            values = np.minimum(_stacked(runs, name)[:, column], top)
            share = np.histogram(values, bins)[0] / max(len(values), 1)
            lines.append(ReportLine(bins[:-1], share, label, {"drawstyle": "steps-post"}))
        value = TABLE_1["least_squares"][1 if column == 1 else 2]
        title = f"dashed: least squares, published, {value:g}"
        settings = {"xlabel": text, "ylabel": "share of tracks", "title": title}
        panels.append(ReportPanel(lines, settings, [value]))
    return ReportPicture(
        "sequential_2014_figures_10_11",
        f"Figs. 10 and 11 of Sequential 2014, T = {MAIN[0]:g} s and p_d = {MAIN[1]:g}: errors of "
        "the velocity",
        panels,
    )
