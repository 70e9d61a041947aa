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
"""Tracks started in simulated scenes, and the runs of TSEPM 2018: its numbers, scenes and counts.

A run function takes a case and a seed, and returns its numbers by name. A method that differs from
the package's in one step is here too: the gate, the evaluation or the merging of TSEPM 2018 read
in another way.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.methods import shared_hits, tsepm
from tsepm_ros.methods.registry import make_initiator
from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray, RecordArray
from tsepm_ros.numerics.gaussian import squared_mahalanobis_distance
from tsepm_ros.studies.reproduction.report import Result
from tsepm_ros.tools.evaluation.simulated_run import (
    Judged,
    Outcome,
    SimulatedScene,
    simulated_measurement_sigma,
)
from tsepm_ros.tools.simulation import CLUTTER, Scenario, load_scenario
from tsepm_ros.tracker.motion import position_after, position_covariance_after
from tsepm_ros.tracker.options import CommonOptions
from tsepm_ros.tracker.sensor import SensorModel
from tsepm_ros.tracker.tracker import Tracker
from tsepm_ros.tracker.tracks import NO_TRACKS, TrackArrays

AS_GIVEN: Mapping[str, Any] = MappingProxyType(
    {
        "clutter_density": "given",
        "detection_probability": "given",
        "limit_speed": "off",
    }
)
"""Options with which the published methods are reproduced: nothing is learned."""
TABLE_1_DETECTION_PROBABILITIES = (1.0, 0.9, 0.8)
TABLE_1_DENSITY = 1e-6
"""1/m^2."""
GATE_PROBABILITY = 0.9
MAX_SPEED = 10.0
"""m/s."""
PERIOD = 12.0
"""s."""
GATE_FACTOR = 2.146
"""alpha at 0.9, as printed below Eq. 5."""
RANGE_ERROR_FRACTION = 0.015
COORDINATE = 5000.0
"""Each coordinate of the target's initial position, m."""
FIGURE_7_DENSITY = 5e-6
"""1/m^2; Figs. 5 and 6 state no range of densities, Fig. 8 no density."""
FIGURE_7_MARKS = (75.0, 120.0)
"""Measurement errors between which P_D is said to fall."""
RULE = (5, 8)
TARGET = np.array([COORDINATE, COORDINATE])
SHARED_OPTIONS: dict[str, Any] = {
    "min_hits": RULE[0],
    "window": RULE[1],
    "gate_probability": GATE_PROBABILITY,
    **AS_GIVEN,
}
STATED_MARGIN = GATE_FACTOR * RANGE_ERROR_FRACTION * COORDINATE
"""alpha times the range error at a range of 5000 m, m."""
OWN_GATE = "multiple model, gate 0.99"
"""The multiple model with the gate that is its default; the other curves have the gate of 0.9."""
KENNEDY = {"evaluation": "clutter_statistic"}
CURVES: Mapping[str, tuple[str, Mapping[str, Any]]] = MappingProxyType(
    {
        "tsepm, f1 literal": ("tsepm", {"pruning_reading": "literal"}),
        "tsepm, f1 squared": ("tsepm", {"pruning_reading": "squared"}),
        "tsepm, f2 size 0.05": ("tsepm", {**KENNEDY, "clutter_test_size": 0.05}),
        "tsepm, f2 size 0.5": ("tsepm", {**KENNEDY, "clutter_test_size": 0.5}),
        "clutter test, size 0.05": ("clutter_test", {"clutter_test_size": 0.05}),
        "clutter test, size 0.5": ("clutter_test", {"clutter_test_size": 0.5}),
        "multiple model": ("multiple_model", {}),
        OWN_GATE: ("multiple_model", {"gate_probability": 0.99}),
    }
)
"""Method and options of each curve, besides `SHARED_OPTIONS`."""
WEIGHTS = ("f_1, as published", "equal", "1 / f_1", "the best member alone")
"""Weights of the members of a merged group, Eq. 31."""


@dataclass(frozen=True)
class MonteCarloStarts:
    """Tracks started in a scene, with equal numbers of hits.

    Attributes
    ----------
    scene : SimulatedScene
    tracks : TrackArrays
    """

    scene: SimulatedScene
    tracks: TrackArrays

    @classmethod
    def on(cls, scene: SimulatedScene, initiator: Tracker, scans: int) -> MonteCarloStarts:
        """The tracks that a method starts in the first scans."""
        parts = [initiator.process(scan) for scan in scene.scans[:scans]]
        return cls(scene, TrackArrays.joined(NO_TRACKS, *map(TrackArrays.from_tracks, parts)))

    @property
    def hits(self) -> IntArray:
        """(scan, detection) of each track's hits, (n, m, 2)."""
        count = int(self.tracks.hit_count.max(initial=0))
        return np.array(self.tracks.hits.tolist(), np.int64).reshape(len(self.tracks), count, 2)

    def of_hits(self, values: Sequence[NDArray[Any]]) -> NDArray[Any]:
        """Values of each track's hits, (n, m), of values of the detections of each scan."""
        offsets, hits = np.cumsum([0, *map(len, values)]), self.hits
        return np.concatenate(values)[offsets[hits[..., 0]] + hits[..., 1]]

    def origins(self) -> IntArray:
        """Target of each track's hits, (n, m)."""
        return self.of_hits(self.scene.origins)

    def from_targets(self) -> BoolArray:
        """Whether each track has more than half of its hits from one target, (n,)."""
        origins = self.origins()
        same = (origins[:, :, None] == origins[:, None, :]).sum(axis=2)
        max_hits = np.where(origins == CLUTTER, 0, same).max(axis=1, initial=0)
        return np.asarray(2 * max_hits > origins.shape[1])

    def judged(self) -> list[Judged]:
        """Judgements of the tracks from targets; all other tracks are false."""
        rows = np.flatnonzero(self.from_targets())
        return self.scene.judge([self.tracks[int(row)] for row in rows])

    def counts(self) -> tuple[int, int]:
        """Targets found, and false and misplaced tracks."""
        outcomes = [judgement.outcome for judgement in self.judged()]
        wrong = len(self.tracks) - len(outcomes) + outcomes.count(Outcome.MISPLACED)
        return outcomes.count(Outcome.TRUE), wrong


def first_of_each_target(judged: Iterable[Judged]) -> list[Judged]:
    """Of the tracks with more than half of their hits from a target the first of each target."""
    first: dict[int, Judged] = {}
    for judgement in judged:
        if judgement.outcome is not Outcome.FALSE:
            first.setdefault(judgement.target, judgement)
    return list(first.values())


@dataclass(frozen=True)
class MonteCarloTable1Row:
    """A row of TSEPM 2018, Table 1: P_F(1), P_F(2), and P_D at p_d = 1.0, 0.9 and 0.8."""

    rule: tuple[int, int]
    false_before: float
    false_after: float
    detection: tuple[float, float, float]

    @property
    def name(self) -> str:
        """M/N."""
        return "{}/{}".format(*self.rule)


TABLE_1 = tuple(
    MonteCarloTable1Row((m, n), before, after, (one, two, three))
    for m, n, before, after, one, two, three in (
        (3, 4, 0.1822, 0.1004, 0.9720, 0.8149, 0.6470),
        (3, 5, 0.3953, 0.1253, 0.9963, 0.8788, 0.7445),
        (4, 5, 0.0545, 0.0276, 0.9477, 0.7509, 0.5494),
        (4, 6, 0.1554, 0.0618, 0.9871, 0.8348, 0.6506),
        (5, 6, 0.0151, 0.0048, 0.9185, 0.6819, 0.4558),
        (4, 7, 0.2621, 0.1007, 0.9944, 0.8676, 0.7161),
        (5, 7, 0.0536, 0.0174, 0.9842, 0.8217, 0.6243),
        (6, 7, 0.0040, 0.0015, 0.8857, 0.6119, 0.3715),
        (5, 8, 0.1319, 0.0418, 0.9973, 0.8749, 0.7187),
        (6, 8, 0.0170, 0.0059, 0.9743, 0.7819, 0.5535),
        (7, 8, 0.0010, 0.0003, 0.8503, 0.5440, 0.2987),
        (5, 9, 0.3446, 0.0997, 0.9996, 0.8925, 0.7650),
        (6, 9, 0.0497, 0.0194, 0.9950, 0.8572, 0.6725),
        (7, 9, 0.0025, 0.0083, 0.9619, 0.7367, 0.4822),
        (8, 9, 0.0002, 0.0000, 0.8131, 0.4797, 0.2375),
    )
)


@dataclass(frozen=True)
class Table1Case:
    """Parameters of a simulated run of the table.

    Attributes
    ----------
    scenario : Scenario
    method : str
        Key of `TSEPM_AS_READ`.
    """

    scenario: Scenario
    method: str = "published"


class MonteCarloFixedMargin(tsepm.Tsepm):
    """TSEPM 2018 with one gate margin, `STATED_MARGIN`, for all detections.

    Only the gate uses this margin; estimation, pruning and merging use each detection's errors.
    """

    def gated(self, last_hits: RecordArray, detections: RecordArray) -> tsepm.Gates:
        """See `Tsepm.gated`."""
        margin = np.full(len(last_hits), STATED_MARGIN)
        return tsepm.gate_within(last_hits, detections, self.common.max_speed, margin)


class MonteCarloPredicted(tsepm.Tsepm):
    """TSEPM 2018 with Eq. 22 read as the distance of each hit from its prediction by the others.

    The prediction does not contain the hit, so that the covariance of Eq. 21 is exact.
    """

    def hits_before(self, hit: int, number: int) -> IntArray:
        """The hits that predict a hit: all others."""
        return np.delete(np.arange(number), hit)

    def estimated(self, ids: IntArray) -> tsepm.Candidates:
        """See `Tsepm.estimated`."""
        candidates, hits = super().estimated(ids), self.detections[ids]
        distances = [np.zeros(len(ids))]
        for column in range(hits.shape[1]):
            others = self.hits_before(column, hits.shape[1])
            if len(others) > 1:  # two positions at least have a velocity
                fitted, hit = self.fit(hits[:, others]), hits[:, [column]]
                time = hit["time"] - self.stamp
                misfit = hit["position"] - position_after(fitted.state[:, None], time)
                covariance = position_covariance_after(fitted.covariance[:, None], time)
                covariance += hit["covariance"]
                distances.append(squared_mahalanobis_distance(misfit, covariance)[:, 0])
        largest = np.max(distances, axis=0)
        return dataclasses.replace(candidates, distance=largest, evaluation=largest)


class MonteCarloPredictedByEarlier(MonteCarloPredicted):
    """The same with the prediction of each hit, from the third on, by those before it."""

    def hits_before(self, hit: int, number: int) -> IntArray:
        """See `MonteCarloPredicted.hits_before`."""
        return np.arange(hit)


TSEPM_AS_READ: Mapping[str, type[tsepm.Tsepm]] = MappingProxyType(
    {
        "published": tsepm.Tsepm,
        "fixed margin": MonteCarloFixedMargin,
        "predicted": MonteCarloPredicted,
        "predicted by earlier": MonteCarloPredictedByEarlier,
    }
)


def table_1_cases() -> dict[str, Table1Case]:
    """Scenes of Section 5.1, a disc of clutter and one target, by the reading of the errors.

    P_F(1) has one gate margin everywhere, that of the errors at 5000 m. The published simulation
    may have used this margin alone, or these errors too. Errors of equal size across and along the
    line of sight need an azimuth error other than the stated value.
    """
    target = np.array([COORDINATE, 5.0, COORDINATE, 0.0])
    window = max(row.rule[1] for row in TABLE_1)
    stated = SensorModel(clutter_density=TABLE_1_DENSITY)
    sigma = RANGE_ERROR_FRACTION * COORDINATE
    same = dataclasses.replace(
        stated,
        range_std=sigma,
        range_std_fraction=0.0,
        azimuth_std=sigma / stated.max_range,  # never the larger axis
    )

    def scenario(sensor: SensorModel) -> Scenario:
        return Scenario("section_5_1", window, PERIOD, sensor, targets=(target,))

    return {
        "as stated": Table1Case(scenario(stated)),
        f"gate margin {STATED_MARGIN:.0f} m": Table1Case(scenario(stated), "fixed margin"),
        f"errors of {sigma:g} m": Table1Case(scenario(same)),
        "predicted from the others": Table1Case(scenario(stated), "predicted"),
        "predicted from those before": Table1Case(scenario(stated), "predicted by earlier"),
    }


class Counted(IntEnum):
    """Indices of the counts of `table_1`."""

    FIRST_SCAN_STARTS = 0
    """Clutter starts of the first scan."""
    FIRST_SCAN_TRACKS = 1
    """Tracks of these starts."""
    STARTS_WITH_TRACK = 2
    """Number of these starts with a track."""
    STARTS = 3
    """All starts of the N scans."""
    WRONG = 4
    """False and misplaced tracks of the N scans."""
    FOUND = 5
    """Whether the target was found."""
    POSITION_ERROR = 6
    """Error of the position of the target's first true track, m; nan without one."""
    VELOCITY_ERROR = 7
    """Length of the error of its velocity, m/s."""


def table_1(case: Table1Case, seed: list[int]) -> Result:
    """Start tracks by every rule and reading on one scene, and count as in `Counted`."""
    scene = SimulatedScene.drawn(case.scenario, seed)
    return {
        f"{row.name} {reading}": _table_1_counts(scene, row, reading, case.method)
        for row in TABLE_1
        for reading in tsepm.READINGS
    }


def _table_1_counts(
    scene: SimulatedScene, row: MonteCarloTable1Row, reading: str, as_read: str
) -> list[float]:
    """Counts in the order of `Counted`."""
    min_hits, window = row.rule
    options = tsepm.TsepmOptions(
        min_hits=min_hits,
        window=window,
        gate_probability=GATE_PROBABILITY,
        pruning_reading=reading,
    )
    common = CommonOptions(max_speed=MAX_SPEED, **AS_GIVEN)
    initiator = Tracker(TSEPM_AS_READ[as_read](scene.scenario.sensor, common, options))
    started = MonteCarloStarts.on(scene, initiator, window)
    true, wrong = started.counts()
    errors = [
        (judged.position_error, judged.velocity_error)
        for judged in started.judged()
        if judged.outcome is Outcome.TRUE
    ]
    false = ~started.from_targets()
    begin, origin = started.hits[false, :1], started.origins()[false, :1]
    first = begin[(begin[..., 0] == 0) & (origin == CLUTTER)][:, 1]  # their clutter of scan 0
    return [
        float(np.count_nonzero(scene.origins[0] == CLUTTER)),
        float(len(first)),
        float(len(np.unique(first))),
        float(initiator.totals.started),
        float(wrong),
        float(true),
        *(errors[0] if errors else (math.nan, math.nan)),
    ]


def monte_carlo_sensor(error: float) -> SensorModel:
    """The sensor of Section 5.1, its errors scaled to a major axis (m) at the target."""
    sensor = SensorModel()
    factor = error / simulated_measurement_sigma(sensor, TARGET)
    return dataclasses.replace(
        sensor,
        range_std_fraction=factor * sensor.range_std_fraction,
        azimuth_std=factor * sensor.azimuth_std,
    )


def _scenario(sensor: SensorModel, density: float) -> Scenario:
    box = load_scenario("box", {"scans": RULE[1]})
    box_sensor = dataclasses.replace(
        sensor, max_range=box.sensor.max_range, clutter_density=density
    )
    return dataclasses.replace(box, sensor=box_sensor)


DENSITIES = {
    density: _scenario(SensorModel(), density) for density in (0.5e-6, 1e-6, 2e-6, 3e-6, 4e-6, 5e-6)
}
"""Scenes of Figs. 5 and 6."""
ERRORS = {
    error: _scenario(monte_carlo_sensor(error), FIGURE_7_DENSITY)
    for error in (15.0, 30.0, 50.0, 75.0, 97.5, 120.0, 150.0, 180.0)
}
"""Scenes of Figs. 7 and 8."""


class MonteCarloGrouping(tsepm.Tsepm):
    """TSEPM 2018 that keeps the members of every merged group, each as a track of their state."""

    def forget(self) -> None:
        """See `Method.forget`."""
        super().forget()
        self.groups: list[tuple[tsepm.Candidates, TrackArrays]] = []

    def merged(self, group: tsepm.Candidates) -> tuple[FloatArray, FloatArray]:
        """See `Tsepm.merged`."""
        state, covariance = super().merged(group)
        n = len(group.distance)
        at_state = dataclasses.replace(
            group, state=np.tile(state, (n, 1)), covariance=np.tile(covariance, (n, 1, 1))
        )
        self.groups.append((group, self.tracks(at_state)))
        return state, covariance


def weighted(group: tsepm.Candidates) -> FloatArray:
    """States of a group by each of `WEIGHTS`, (4, 4)."""
    inverse = 1.0 / np.maximum(group.distance, 1e-12)
    moments = [
        shared_hits.moments(group.state, group.covariance, weight)[0]
        for weight in (group.distance, np.ones(len(inverse)), inverse)
    ]
    return np.stack([*moments, group.state[np.argmin(group.evaluation)]])


def comparison(scenario: Scenario, seed: list[int]) -> Result:
    """Start tracks by every curve's method: target found, false and misplaced, starts.

    Further numbers of TSEPM: whether the target is found if a merged group is judged by any of its
    members; tracks that reach confirmation, and those left by pruning. ``weights`` has the errors
    of position, m, of each merged group with a member from the target, by each of `WEIGHTS`.
    """
    scene = SimulatedScene.drawn(scenario, seed)
    results: Result = {"weights": []}
    for name, (method, options) in CURVES.items():
        given = {"max_speed": MAX_SPEED, **SHARED_OPTIONS, **options}
        initiator = make_initiator(method, sensor=scenario.sensor, **given)
        if method == "tsepm":
            made = initiator.method
            initiator = Tracker(MonteCarloGrouping(made.sensor, made.common, made.options))
        started = MonteCarloStarts.on(scene, initiator, RULE[1])
        true, wrong = started.counts()
        totals = initiator.totals
        results[name] = [float(true), float(wrong), float(totals.started)]
        if isinstance(initiator.method, MonteCarloGrouping):
            groups = [
                (scene.judge(list(tracks)), group) for group, tracks in initiator.method.groups
            ]
            found_by_any = true or any(
                each.outcome is Outcome.TRUE for judged, _ in groups for each in judged
            )
            left = totals.raw_confirmations - totals.pruned
            results[name] += [float(found_by_any), float(totals.raw_confirmations), float(left)]
            if name == next(iter(CURVES)):
                results["weights"] = _errors_by_weight(scene, groups)
    return results


def _errors_by_weight(
    scene: SimulatedScene, groups: Iterable[tuple[list[Judged], tsepm.Candidates]]
) -> list[float]:
    errors: list[float] = []
    for judged, group in groups:
        if any(each.outcome is not Outcome.FALSE for each in judged):
            truth = scene.simulator.truth(judged[0].track.stamp)[0]
            x, y = (weighted(group) - truth)[:, 0::2].T
            errors += np.hypot(x, y).tolist()
    return errors
