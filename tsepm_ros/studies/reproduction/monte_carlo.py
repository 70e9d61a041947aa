"""Simulated runs of the reproductions, and the tracks started in them.

All tracks that a method starts in the scans of a scene, as arrays.

Simulated runs of the reproductions: scenes and counts.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.methods.registry import make_initiator
from tsepm_ros.methods.tsepm import Candidates, Tsepm, TsepmOptions
from tsepm_ros.numerics.arrays import IntArray
from tsepm_ros.studies.reproduction.published import (
    AREA_SIDE,
    COORDINATE,
    FIGURE_7_DENSITY,
    GATE_FACTOR,
    GATE_PROBABILITY,
    MAX_SPEED,
    PERIOD,
    RANGE_ERROR_FRACTION,
    TABLE_1,
    TABLE_1_DENSITY,
    TABLE_I_RULE,
    Table1Row,
)
from tsepm_ros.studies.reproduction.runs import Result
from tsepm_ros.studies.split_merge import SplitMerge, SplitMergeOptions
from tsepm_ros.tools.evaluation.simulated_run import (
    Judged,
    Outcome,
    SimulatedScene,
    measurement_sigma,
)
from tsepm_ros.tools.simulation import CLUTTER, Scenario, load_scenario
from tsepm_ros.tracker.options import CommonOptions
from tsepm_ros.tracker.pruning import READINGS
from tsepm_ros.tracker.sensor import SensorModel
from tsepm_ros.tracker.splitting import Gated, gate_within
from tsepm_ros.tracker.tracker import Tracker
from tsepm_ros.tracker.tracks import TrackArrays

AS_GIVEN: Mapping[str, Any] = MappingProxyType(
    {
        "clutter_density": "given",
        "detection_probability": "given",
        "plots": "off",
        "limit_speed": "off",
    }
)
"""Options with which the published methods are reproduced: nothing is learned."""


@dataclass(frozen=True)
class Started:
    """Tracks started in a scene, with equal numbers of hits.

    Attributes
    ----------
    scene : SimulatedScene
    tracks : TrackArrays
    """

    scene: SimulatedScene
    tracks: TrackArrays

    @classmethod
    def on(cls, scene: SimulatedScene, initiator: Tracker, scans: int) -> Started:
        """The tracks that a method starts in the first scans."""
        parts = [initiator.process(scan) for scan in scene.scans[:scans]]
        return cls(scene, TrackArrays.of([]).joined(*map(TrackArrays.of, parts)))

    @property
    def hits(self) -> IntArray:
        """(scan, detection) of each track's hits, (n, m, 2)."""
        count = int(self.tracks.hit_count.max(initial=0))
        return np.array(self.tracks.hits, np.int64).reshape(len(self.tracks), count, 2)

    def origins(self) -> IntArray:
        """Target of each track's hits, (n, m)."""
        offsets = np.cumsum([0, *map(len, self.scene.origins)])
        hits = self.hits
        origin = np.concatenate([*self.scene.origins, np.zeros(0, np.int64)])
        return origin[offsets[hits[..., 0]] + hits[..., 1]]

    def from_targets(self) -> IntArray:
        """Rows of the tracks that have more than half of their hits from one target."""
        origins = self.origins()
        same = (origins[:, :, None] == origins[:, None, :]).sum(axis=2)
        max_hits = np.where(origins == CLUTTER, 0, same).max(axis=1, initial=0)
        return np.flatnonzero(2 * max_hits > origins.shape[1])

    def judged(self) -> list[Judged]:
        """Judgements of the tracks from targets; all other tracks are false."""
        return self.scene.judge([self.tracks[int(row)] for row in self.from_targets()])

    def counts(self) -> tuple[int, int]:
        """Targets found, and false and misplaced tracks."""
        outcomes = [judgement.outcome for judgement in self.judged()]
        wrong = len(self.tracks) - len(outcomes) + outcomes.count(Outcome.MISPLACED)
        return outcomes.count(Outcome.TRUE), wrong


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
    }
)
"""Method and options of each curve, besides `SHARED_OPTIONS`."""


@dataclass(frozen=True)
class Table1Case:
    """Parameters of a simulated run of the table.

    Attributes
    ----------
    scenario : Scenario
    fixed_margin : bool
        Whether every gate has `STATED_MARGIN`, instead of the margin of Eq. 4 at the detection.
    """

    scenario: Scenario
    fixed_margin: bool = False


class FixedMargin(Tsepm):
    """TSEPM 2018 with one gate margin, `STATED_MARGIN`, for all detections.

    Only the gate uses this margin; estimation, pruning and merging use each detection's errors.
    """

    def gated(self, last_hits: NDArray[np.void], detections: NDArray[np.void]) -> Gated:
        """See `Tsepm.gated`."""
        margin = np.full(len(last_hits), STATED_MARGIN)
        return gate_within(last_hits, detections, self.common.max_speed, margin)


def table_1_cases() -> dict[str, Table1Case]:
    """Scenes of Section 5.1, a disc of clutter and one target, by the reading of the errors.

    P_F(1) has one gate margin everywhere, that of the errors at 5000 m. The published simulation
    may have used this margin alone, or these errors too. Errors of equal size across and along the
    line of sight need an azimuth error other than the stated value.
    """
    target = np.array([COORDINATE, 5.0, COORDINATE, 0.0])
    window = max(row.rule[1] for row in TABLE_1)
    published = SensorModel(clutter_density=TABLE_1_DENSITY)
    sigma = RANGE_ERROR_FRACTION * COORDINATE
    same = dataclasses.replace(
        published,
        range_std=sigma,
        range_std_fraction=0.0,
        azimuth_std=sigma / published.max_range,  # never the larger axis
    )
    azimuth = f"azimuth {math.degrees(same.azimuth_std):.2f} degrees"

    def scenario(sensor: SensorModel) -> Scenario:
        return Scenario("section_5_1", window, PERIOD, sensor, targets=(target,))

    return {
        "the errors as stated": Table1Case(scenario(published)),
        f"the errors as stated, gate margin {STATED_MARGIN:.0f} m": Table1Case(
            scenario(published), fixed_margin=True
        ),
        f"errors of {sigma:g} m everywhere ({azimuth})": Table1Case(scenario(same)),
    }


class Counted(IntEnum):
    """Indices of the counts of `run_table_1`."""

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


def run_table_1(case: Table1Case, seed: list[int]) -> Result:
    """Start tracks by every rule and reading on one scene, and count as in `Counted`."""
    scene = SimulatedScene.drawn(case.scenario, seed)
    return {
        f"{row.name} {reading}": _table_1_counts(scene, row, reading, case.fixed_margin)
        for row in TABLE_1
        for reading in READINGS
    }


def _table_1_counts(
    scene: SimulatedScene, row: Table1Row, reading: str, fixed_margin: bool
) -> list[float]:
    min_hits, window = row.rule
    options = TsepmOptions(
        min_hits=min_hits,
        window=window,
        gate_probability=GATE_PROBABILITY,
        pruning_reading=reading,
    )
    method_class = FixedMargin if fixed_margin else Tsepm
    method = method_class(
        scene.scenario.sensor, CommonOptions(max_speed=MAX_SPEED, **AS_GIVEN), options
    )
    initiator = Tracker(method)
    started = Started.on(scene, initiator, window)
    found, wrong = started.counts()
    first = _of_first_scan(started)
    counts: dict[Counted, float] = {
        Counted.FIRST_SCAN_STARTS: int(np.count_nonzero(scene.origins[0] == CLUTTER)),
        Counted.FIRST_SCAN_TRACKS: len(first),
        Counted.STARTS_WITH_TRACK: len(np.unique(first)),
        Counted.STARTS: initiator.totals.started,
        Counted.WRONG: wrong,
        Counted.FOUND: found,
    }
    return [float(counts[place]) for place in Counted]


def _of_first_scan(started: Started) -> np.ndarray:
    """First hit of each false track that begins with clutter of the first scan."""
    false = np.ones(len(started.tracks), bool)
    false[started.from_targets()] = False
    hits, origins = started.hits, started.origins()
    if not len(hits):
        return np.zeros(0, np.int64)
    return hits[false & (hits[:, 0, 0] == 0) & (origins[:, 0] == CLUTTER), 0, 1]


@dataclass(frozen=True)
class Point:
    """A scene of the figures.

    Attributes
    ----------
    value : float
        Value on the axis of its figure.
    scenario : Scenario
    """

    value: float
    scenario: Scenario


def sensor_at(error: float) -> SensorModel:
    """The sensor of Section 5.1, its errors scaled to a major axis (m) at the target."""
    sensor = SensorModel()
    factor = error / measurement_sigma(sensor, TARGET)
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


DENSITIES = tuple(
    Point(density, _scenario(SensorModel(), density))
    for density in (0.5e-6, 1e-6, 2e-6, 3e-6, 4e-6, 5e-6)
)
"""Scenes of Figs. 5 and 6."""
ERRORS = tuple(
    Point(error, _scenario(sensor_at(error), FIGURE_7_DENSITY))
    for error in (15.0, 30.0, 50.0, 75.0, 97.5, 120.0, 150.0, 180.0)
)
"""Scenes of Figs. 7 and 8."""


def run_comparison(point: Point, seed: list[int]) -> Result:
    """Start tracks by every curve's method: target found, false and misplaced, starts."""
    scene = SimulatedScene.drawn(point.scenario, seed)
    results = {}
    for name, (method, options) in CURVES.items():
        initiator = make_initiator(
            method, sensor=point.scenario.sensor, max_speed=MAX_SPEED, **SHARED_OPTIONS, **options
        )
        found, wrong = Started.on(scene, initiator, RULE[1]).counts()
        results[name] = [float(found), float(wrong), float(initiator.totals.started)]
    return results


class SplitOnly(SplitMerge):
    """Split-merge 2016 without merging: every confirmed track is an output."""

    def merge(self, candidates: Candidates) -> tuple[TrackArrays, int]:
        """One track per candidate."""
        return self.tracks(candidates), 0


def run_four_targets(scenario: Scenario, seed: list[int]) -> Result:
    """Count tracks after splitting and after merging.

    Returns after each stage, for the coverage: tracks, and targets found; for the area of interest
    round each target: all tracks, and tracks that have more than half of their hits from the
    target.
    """
    scene = SimulatedScene.drawn(scenario, seed)
    options = SplitMergeOptions(min_hits=TABLE_I_RULE[0], window=TABLE_I_RULE[1])
    results: Result = {}
    for name, method_class in (("split", SplitOnly), ("merged", SplitMerge)):
        initiator = Tracker(method_class(scenario.sensor, CommonOptions(**AS_GIVEN), options))
        started = Started.on(scene, initiator, scenario.scans)
        results[name] = [float(len(started.tracks)), float(started.counts()[0])]
        near = np.zeros(len(started.tracks), bool)
        near[started.from_targets()] = True
        inside = [_inside(started, target) for target in range(len(scene.simulator.targets))]
        results[f"{name} areas"] = [float(rows.sum()) for rows in inside]
        results[f"{name} near"] = [float((rows & near).sum()) for rows in inside]
    return results


def _inside(started: Started, target: int) -> NDArray[np.bool_]:
    """Tracks all of whose hits lie in the area of interest round a target in mid run."""
    scene = started.scene
    centre = scene.simulator.truth(0.5 * scene.scenario.duration)[target, 0::2]
    inside = [
        (np.abs(x - centre[0]) <= 0.5 * AREA_SIDE) & (np.abs(y - centre[1]) <= 0.5 * AREA_SIDE)
        for x, y in (
            (scan.range * np.cos(scan.azimuth), scan.range * np.sin(scan.azimuth))
            for scan in scene.scans
        )
    ]
    offsets = np.cumsum([0, *map(len, inside)])
    hits = started.hits
    within = np.concatenate(inside)[offsets[hits[..., 0]] + hits[..., 1]]
    return np.asarray(within.all(axis=1))
