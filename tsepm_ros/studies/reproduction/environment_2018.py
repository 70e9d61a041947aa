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
"""Environment 2018: Fig. 4, the time of closest approach, and the decision of Table 1."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np

from tsepm_ros.numerics.arrays import BoolArray, FloatArray
from tsepm_ros.studies.reproduction.report import (
    Cell,
    Part,
    ReportLine,
    ReportPanel,
    ReportPicture,
    ReportSetting,
    ReportTable,
)
from tsepm_ros.tools.evaluation.intervals import (
    IntervalEstimate,
    mean_interval,
    proportion_interval,
)
from tsepm_ros.tools.evaluation.measures import measured_closest_approach

ENCOUNTER = ((18_000.0, 187.0, 6.0, 330.0), (17_000.0, 189.0, 4.0, 190.0))
"""Targets A and B of Fig. 4: distance (m), azimuth (degrees), speed (m/s), heading (degrees)."""
ENVIRONMENT_TABLE_1 = ((16.038, 7.500), (22.449, 1.090))
"""Feature distances of detections 1 and 2 to the tracks A and B, to which they are said to belong.
"""


FEATURES = 3
RUNS = 400
"""On the page."""
TRIALS = 50
"""Simulated decisions per run."""
OFFSETS = (0.5, 1.0, 2.0, 3.0)
"""Differences between the targets' features, standard deviations of one detection."""
HISTORIES = ((10, 10), (3, 3), (30, 5))
"""Numbers of earlier detections of the tracks A and B."""
TIME_STEP = 1.0
"""Interval of the curves, s."""
SLOPES: dict[str, Callable[[FloatArray], tuple[float, float]]] = {
    "Eq. 2 as printed": lambda v: (v[1, 1] * v[0, 1], v[1, 0] - v[0, 0]),
    "Eq. 2 with its minus": lambda v: (v[1, 1] - v[0, 1], v[1, 0] - v[0, 0]),
    "phi_r from y": lambda v: (v[1, 0] - v[0, 0], v[1, 1] - v[0, 1]),
}
"""Numerator and denominator of Eq. 2 from the velocities of both targets (2, 2), as x, y."""
ANGLES = {"without quadrants": False, "with quadrants": True}
"""Whether the arctangents of Eqs. 2 and 8 take account of the quadrant."""
SIGNS: dict[str, Callable[[FloatArray], FloatArray]] = {
    "with bars": np.abs,
    "without bars": np.positive,
    "with a minus instead of bars": np.negative,
}
"""T_cpa of Eq. 9 from ``R cos(phi_r - theta) / v_r``."""
_AS_PRINTED, _WITH_MINUS, _FROM_NORTH = SLOPES
PICTURED = {
    "as printed": (_AS_PRINTED, "without quadrants", "with bars"),
    "Eq. 2 with its minus": (_WITH_MINUS, "without quadrants", "with bars"),
    "and phi_r from y, as theta": (_FROM_NORTH, "without quadrants", "with bars"),
    "and without the bars": (_FROM_NORTH, "without quadrants", "without bars"),
    "and with quadrants": (_FROM_NORTH, "with quadrants", "without bars"),
    "with all corrections": (_FROM_NORTH, "with quadrants", "with a minus instead of bars"),
}
"""Readings of the picture; each adds a correction to the previous reading."""


def reproduce(setting: ReportSetting) -> list[Part]:
    """Parts of the source's chapter."""
    return [*_encounter_parts(), *_decision_parts(setting)]


def encounter(azimuth_from: str = "y") -> FloatArray:
    """States of A and B at the beginning, (2, 4).

    Parameters
    ----------
    azimuth_from : {"y", "x"}
        Whether the azimuths of the positions are clockwise from north, as the headings, or
        counter-clockwise from the x axis.
    """
    distance, azimuth, speed, heading = np.array(ENCOUNTER).T
    azimuth, heading = np.radians(azimuth), np.radians(heading)
    first, second = np.sin(azimuth), np.cos(azimuth)
    x, y = (first, second) if azimuth_from == "y" else (second, first)
    return np.stack(
        [distance * x, speed * np.sin(heading), distance * y, speed * np.cos(heading)], axis=1
    )


def time_of_closest_approach(
    states: FloatArray, times: FloatArray, reading: tuple[str, str, str]
) -> FloatArray:
    """T_cpa (s) at each time (n,) of two targets (2, 4) by a reading of Eqs. 1-9."""
    slope, angles, sign = reading
    velocity = states[:, 1::2]
    relative = velocity[1] - velocity[0]
    x, y = (states[1, 0::2] - states[0, 0::2] + times[:, None] * relative).T  # Eqs. 5 and 6
    across, along = SLOPES[slope](velocity)
    direction = np.arctan2(across, along) - np.arctan2(x, y)
    if not ANGLES[angles]:
        direction = np.arctan(across / along) - np.arctan(x / y)
    along_course = np.hypot(x, y) * np.cos(direction) / np.hypot(*relative)  # Eqs. 1 and 7
    return np.asarray(SIGNS[sign](along_course))


def holds(times: FloatArray, values: FloatArray, closest: float) -> str:
    """Whether T_cpa (n,) is as in the text: >= 0 before, < 0 after, |T_cpa| falls, then rises."""
    before, after = times < closest, times > closest
    size = np.abs(values)
    conditions = (
        (values[before] >= 0.0).all(),
        (values[after] < 0.0).all(),
        (np.diff(size[before]) <= 0.0).all(),
        (np.diff(size[after]) >= 0.0).all(),
    )
    return "holds" if all(conditions) else "does not hold"


def _encounter_parts() -> list[Part]:
    states = encounter()
    time, distance = (float(value) for value in measured_closest_approach(states[1] - states[0]))
    start = float(np.hypot(*(states[1] - states[0])[0::2]))
    separating = measured_closest_approach(np.subtract(*encounter("x")))
    times = np.arange(0.0, 2.0 * time, TIME_STEP)
    exact = np.array(
        [measured_closest_approach(np.subtract(*_moved(states, time)))[0] for time in times],
        np.float64,
    )
    curves = {"closest approach, -r.v / |v|^2": exact}
    curves |= {
        name: time_of_closest_approach(states, times, reading) for name, reading in PICTURED.items()
    }
    rows = [
        _figure_4_row(name, times, curves[name], time)
        for name in ("closest approach, -r.v / |v|^2", "as printed", "with all corrections")
    ]
    readings = list(itertools.product(SLOPES, ANGLES, SIGNS))
    valid = [
        ", ".join(reading)
        for reading in readings
        if holds(times, time_of_closest_approach(states, times, reading), time) == "holds"
    ]
    return [
        "### Fig. 4: the time of closest approach",
        f"If azimuths and headings are from north, the targets are {start:.0f} m apart at first, "
        f"and closest after {time:.1f} s, {distance:.0f} m apart. If azimuths are from the x axis, "
        f"the targets only separate; they were closest {-float(separating[0]):.0f} s before the "
        "scene begins. By the text, the time of closest approach t_c is at least 0 and falls until "
        f"the targets meet; then it is below 0 and grows in size. {len(valid)} of {len(readings)} "
        f"combinations of readings of Eqs. 2, 8 and 9 agrees with this: {'; '.join(valid)}.",
        ReportTable(
            "environment_2018_figure_4",
            {
                "reading": "",
                "at first, s": ".1f",
                "just before the closest, s": ".1f",
                "just after, s": ".1f",
                "at the end, s": ".1f",
                "the text's description": "",
            },
            rows,
        ),
        _figure_4(states, times, curves, time),
    ]


def _moved(states: FloatArray, time: float) -> FloatArray:
    moved = states.copy()
    moved[:, 0::2] += time * states[:, 1::2]
    return moved


def _figure_4_row(name: str, times: FloatArray, values: FloatArray, closest: float) -> list[Cell]:
    before, after = (int(np.searchsorted(times, closest + side)) for side in (-1.0, 1.0))
    return [
        name,
        float(values[0]),
        float(values[before]),
        float(values[after]),
        float(values[-1]),
        holds(times, values, closest),
    ]


def _figure_4(
    states: FloatArray, times: FloatArray, curves: dict[str, FloatArray], closest: float
) -> ReportPicture:
    dashes = ("-", ":", "--", "-.", (0, (5, 5)), (0, (1, 1)), "--")
    left = [
        ReportLine(times, values, name, {"ls": line})
        for (name, values), line in zip(curves.items(), dashes, strict=True)
    ]
    right = [
        ReportLine(x + times * vx, y + times * vy, name)
        for name, (x, vx, y, vy) in zip("AB", states, strict=True)
    ]
    x, y = _moved(states, closest)[:, 0::2].T
    distance = float(np.hypot(*np.subtract(*_moved(states, closest))[0::2]))
    text = f"closest: {closest:.0f} s, {distance:.0f} m"
    right.append(ReportLine(x, y, text, {"color": "k", "ls": ":", "marker": "."}))
    return ReportPicture(
        "environment_2018_figure_4",
        "Fig. 4 of Environment 2018: the time of closest approach under each reading of Eqs. 1-9, "
        "and the targets' courses",
        [
            ReportPanel(left, {"xlabel": "time, s", "ylabel": "T_cpa, s", "title": "By reading"}),
            ReportPanel(
                right, {"xlabel": "x (east), m", "ylabel": "y (north), m", "aspect": "equal"}
            ),
        ],
    )


def smallest(distances: FloatArray) -> tuple[BoolArray, BoolArray]:
    """Whether detection 1 goes to A and detection 2 to B, by two rules.

    Parameters
    ----------
    distances : (..., 2, 2) ndarray
        J of each detection (row) with each track, A and B.

    Returns
    -------
    each : (..., 2) ndarray of bool
        Whether detection 1 goes to A and detection 2 to B by the smaller J of each detection.
    pairs : (...) ndarray of bool
        Whether both do, if the pair of the smallest J of all is taken first.
    """
    each = np.stack(
        [
            distances[..., 0, 0] < distances[..., 0, 1],
            distances[..., 1, 1] < distances[..., 1, 0],
        ],
        axis=-1,
    )
    straight = np.minimum(distances[..., 0, 0], distances[..., 1, 1])
    return each, straight < np.minimum(distances[..., 0, 1], distances[..., 1, 0])


def decision(history: FloatArray, candidate: FloatArray) -> FloatArray:
    """The decision function as printed (Eqs. 10 and 11).

    Parameters
    ----------
    history : (..., n, p) ndarray
        Features of a track's detections.
    candidate : (..., p) ndarray
        Features of the detection that may be the track's next.

    Returns
    -------
    (...) ndarray
        J, small for a detection of the same target.
    """
    n = history.shape[-2]
    mean = history.mean(axis=-2)
    after = (n * mean + candidate) / (n + 1)
    return np.asarray(np.square(after - mean).sum(axis=-1))


def decide(
    rng: np.random.Generator, trials: int, offset: float, histories: tuple[int, int]
) -> tuple[IntervalEstimate, IntervalEstimate]:
    """Simulate encounters of a target A and a target B, a detection of each, decided by Eqs. 10-11.

    The three features are independent and Gaussian, in units of one detection's standard deviation.

    Parameters
    ----------
    rng : Generator
    trials : int
    offset : float
        Difference of each feature of B from that of A.
    histories : (int, int)
        Numbers of earlier detections of A and of B.

    Returns
    -------
    each : IntervalEstimate
        Share of the detections that are decided rightly, each to the track of its smaller J.
    pairs : IntervalEstimate
        Share of the encounters, if the pair of the smallest J is taken first and the other
        detection goes to the other track.
    """
    centres = (0.0, offset)
    detections = rng.standard_normal((trials, 2, FEATURES)) + np.array(centres)[:, None]
    earlier = [
        rng.standard_normal((trials, 1, count, FEATURES)) + centre
        for count, centre in zip(histories, centres, strict=True)
    ]
    distances = np.stack([decision(history, detections) for history in earlier], axis=-1)
    each, pairs = smallest(distances)
    # The two detections of an encounter meet the same histories.
    return mean_interval(each.mean(axis=1)), proportion_interval(int(pairs.sum()), trials)


def _decision_parts(setting: ReportSetting) -> list[Part]:
    table = np.array(ENVIRONMENT_TABLE_1)
    each, pairs = smallest(table)
    rng = np.random.default_rng(setting.seed)
    trials = TRIALS * (setting.runs or RUNS)
    rows: list[list[Cell]] = []
    for histories in HISTORIES:
        for offset in OFFSETS:
            shares = decide(rng, trials, offset, histories)
            rows.append(["{}, {}".format(*histories), offset, *shares])
    (a1, b1), (a2, b2) = table
    alone = ", ".join(f"detection {k + 1} to {'AB'[int(own == k)]}" for k, own in enumerate(each))
    return [
        "### Table 1: association of the detections",
        "J is the dissimilarity of a detection and a track (Eqs. 10 and 11). The published J of "
        f"detection 1 is {a1:g} with the track A and {b1:g} with B; that of detection 2 is {a2:g} "
        f"and {b2:g}. The source gives detection 1 to A, and detection 2 to B. The smaller J of "
        f"each detection gives {alone}. Taking the smallest J of all first, and each detection and "
        f"track once, {'gives' if pairs else 'does not give'} the published decision.",
        "Units and variances are not printed. In the simulation, detections have three Gaussian "
        "features. *Offset* is the difference of the features of A and B, in standard deviations "
        f"of a detection. A row has {trials} encounters, with a detection of A and one of B.",
        ReportTable(
            "environment_2018_table_1",
            {
                "detections of A, B before": "",
                "offset": "g",
                "detections right, smaller J of each detection": ".3f",
                "encounters right, smallest J first": ".3f",
            },
            rows,
            [row for row in rows if row[0] != "3, 3" and row[1] in (1.0, 2.0)],
        ),
    ]
