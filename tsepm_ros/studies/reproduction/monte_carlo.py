"""Simulated runs of the reproductions: scenes, methods and counts.

A run function takes a case and a seed, and returns its numbers by name. A method that differs from
the package's in one step is here too: the gate, the evaluation or the merging of TSEPM 2018 read
in another way.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.methods.registry import make_initiator
from tsepm_ros.methods.tsepm import Candidates, Tsepm, TsepmOptions
from tsepm_ros.numerics.arrays import FloatArray, IntArray
from tsepm_ros.numerics.gaussian import squared_distance
from tsepm_ros.studies import sequential
from tsepm_ros.studies.reproduction import published
from tsepm_ros.studies.reproduction.published import (
    COORDINATE,
    FIGURE_7_DENSITY,
    GATE_FACTOR,
    GATE_PROBABILITY,
    MAX_SPEED,
    PERIOD,
    RANGE_ERROR_FRACTION,
    TABLE_1,
    TABLE_1_DENSITY,
    Table1Row,
)
from tsepm_ros.studies.reproduction.report import Result
from tsepm_ros.studies.sequential import SequentialOptions
from tsepm_ros.studies.split_merge import SplitMerge, SplitMergeOptions
from tsepm_ros.tools.evaluation.measures import cramer_rao
from tsepm_ros.tools.evaluation.simulated_run import (
    Judged,
    Outcome,
    SimulatedScene,
    measurement_sigma,
)
from tsepm_ros.tools.simulation import CLUTTER, Scenario, load_scenario
from tsepm_ros.tools.simulation.scenario import WaypointMotion
from tsepm_ros.tracker import merging
from tsepm_ros.tracker.measurement import convert
from tsepm_ros.tracker.motion import position_after, position_covariance_after
from tsepm_ros.tracker.options import CommonOptions
from tsepm_ros.tracker.pruning import READINGS
from tsepm_ros.tracker.sensor import SensorModel
from tsepm_ros.tracker.splitting import Gated, gate_within
from tsepm_ros.tracker.tracker import Tracker
from tsepm_ros.tracker.tracks import ConfirmedTrack, TrackArrays

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


def first_of_each_target(judged: Iterable[Judged]) -> list[Judged]:
    """Of the tracks with more than half of their hits from a target the first of each target."""
    first: dict[int, Judged] = {}
    for judgement in judged:
        if judgement.outcome is not Outcome.FALSE:
            first.setdefault(judgement.target, judgement)
    return list(first.values())


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


class FixedMargin(Tsepm):
    """TSEPM 2018 with one gate margin, `STATED_MARGIN`, for all detections.

    Only the gate uses this margin; estimation, pruning and merging use each detection's errors.
    """

    def gated(self, last_hits: NDArray[np.void], detections: NDArray[np.void]) -> Gated:
        """See `Tsepm.gated`."""
        margin = np.full(len(last_hits), STATED_MARGIN)
        return gate_within(last_hits, detections, self.common.max_speed, margin)


class Predicted(Tsepm):
    """TSEPM 2018 with Eq. 22 read as the distance of each hit from its prediction by the others.

    The prediction does not contain the hit, so that the covariance of Eq. 21 is exact.
    """

    def hits_before(self, hit: int, number: int) -> IntArray:
        """The hits that predict a hit: all others."""
        return np.delete(np.arange(number), hit)

    def estimated(self, ids: IntArray) -> Candidates:
        """See `Tsepm.estimated`."""
        candidates, hits = super().estimated(ids), self.detections[ids]
        distances = [np.zeros(len(ids))]
        for place in range(hits.shape[1]):
            others = self.hits_before(place, hits.shape[1])
            if len(others) > 1:  # two positions at least have a velocity
                fitted, hit = self.fit(hits[:, others]), hits[:, [place]]
                time = hit["time"] - self.stamp
                misfit = hit["position"] - position_after(fitted.state[:, None], time)
                covariance = position_covariance_after(fitted.covariance[:, None], time)
                covariance += hit["covariance"]
                distances.append(squared_distance(misfit, covariance)[:, 0])
        largest = np.max(distances, axis=0)
        return dataclasses.replace(candidates, distance=largest, evaluation=largest)


class PredictedByEarlier(Predicted):
    """The same with the prediction of each hit, from the third on, by those before it."""

    def hits_before(self, hit: int, number: int) -> IntArray:
        """See `Predicted.hits_before`."""
        return np.arange(hit)


TSEPM_AS_READ: Mapping[str, type[Tsepm]] = MappingProxyType(
    {
        "published": Tsepm,
        "fixed margin": FixedMargin,
        "predicted": Predicted,
        "predicted by earlier": PredictedByEarlier,
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
    azimuth = f"azimuth {math.degrees(same.azimuth_std):.2f} degrees"

    def scenario(sensor: SensorModel) -> Scenario:
        return Scenario("section_5_1", window, PERIOD, sensor, targets=(target,))

    return {
        "as stated": Table1Case(scenario(stated)),
        f"gate margin {STATED_MARGIN:.0f} m": Table1Case(scenario(stated), "fixed margin"),
        f"{sigma:g} m everywhere ({azimuth})": Table1Case(scenario(same)),
        "predicted from the others": Table1Case(scenario(stated), "predicted"),
        "predicted from those before": Table1Case(scenario(stated), "predicted by earlier"),
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
    POSITION_ERROR = 6
    """Error of the position of the target's first true track, m; nan without one."""
    VELOCITY_ERROR = 7
    """Length of the error of its velocity, m/s."""


def run_table_1(case: Table1Case, seed: list[int]) -> Result:
    """Start tracks by every rule and reading on one scene, and count as in `Counted`."""
    scene = SimulatedScene.drawn(case.scenario, seed)
    return {
        f"{row.name} {reading}": _table_1_counts(scene, row, reading, case.method)
        for row in TABLE_1
        for reading in READINGS
    }


def _table_1_counts(
    scene: SimulatedScene, row: Table1Row, reading: str, as_read: str
) -> list[float]:
    min_hits, window = row.rule
    options = TsepmOptions(
        min_hits=min_hits,
        window=window,
        gate_probability=GATE_PROBABILITY,
        pruning_reading=reading,
    )
    method = TSEPM_AS_READ[as_read](
        scene.scenario.sensor, CommonOptions(max_speed=MAX_SPEED, **AS_GIVEN), options
    )
    initiator = Tracker(method)
    started = Started.on(scene, initiator, window)
    found, wrong = started.counts()
    errors = [
        (one.position_error, one.velocity_error)
        for one in started.judged()
        if one.outcome is Outcome.TRUE
    ]
    first = _of_first_scan(started)
    counts: dict[Counted, float] = {
        Counted.FIRST_SCAN_STARTS: int(np.count_nonzero(scene.origins[0] == CLUTTER)),
        Counted.FIRST_SCAN_TRACKS: len(first),
        Counted.STARTS_WITH_TRACK: len(np.unique(first)),
        Counted.STARTS: initiator.totals.started,
        Counted.WRONG: wrong,
        Counted.FOUND: found,
        Counted.POSITION_ERROR: errors[0][0] if errors else math.nan,
        Counted.VELOCITY_ERROR: errors[0][1] if errors else math.nan,
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


class Grouping(Tsepm):
    """TSEPM 2018 that keeps the members of every merged group, each as a track of their state."""

    def forget(self) -> None:
        """See `Method.forget`."""
        super().forget()
        self.groups: list[tuple[Candidates, TrackArrays]] = []

    def merged(self, group: Candidates) -> tuple[FloatArray, FloatArray]:
        """See `Tsepm.merged`."""
        state, covariance = super().merged(group)
        n = len(group.distance)
        at_state = dataclasses.replace(
            group, state=np.tile(state, (n, 1)), covariance=np.tile(covariance, (n, 1, 1))
        )
        self.groups.append((group, self.tracks(at_state)))
        return state, covariance


WEIGHTS = ("f_1, as published", "equal", "1 / f_1", "the best member alone")
"""Weights of the members of a merged group, Eq. 31."""


def weighted(group: Candidates) -> FloatArray:
    """States of a group by each of `WEIGHTS`, (4, 4)."""
    inverse = 1.0 / np.maximum(group.distance, 1e-12)
    moments = [
        merging.moments(group.state, group.covariance, weight)[0]
        for weight in (group.distance, np.ones(len(inverse)), inverse)
    ]
    return np.stack([*moments, group.state[np.argmin(group.evaluation)]])


def run_comparison(point: Point, seed: list[int]) -> Result:
    """Start tracks by every curve's method: target found, false and misplaced, starts.

    Further numbers of TSEPM: whether the target is found if a merged group is judged by any of its
    members; tracks that reach confirmation, and those left by pruning. ``weights`` has the errors
    of position, m, of each merged group with a member from the target, by each of `WEIGHTS`.
    """
    scene = SimulatedScene.drawn(point.scenario, seed)
    results: Result = {"weights": []}
    for name, (method, options) in CURVES.items():
        given = {"max_speed": MAX_SPEED, **SHARED_OPTIONS, **options}
        initiator = make_initiator(method, sensor=point.scenario.sensor, **given)
        if method == "tsepm":
            made = initiator.method
            initiator = Tracker(Grouping(made.sensor, made.common, made.options))
        started = Started.on(scene, initiator, RULE[1])
        found, wrong = started.counts()
        totals = initiator.totals
        results[name] = [float(found), float(wrong), float(totals.started)]
        if isinstance(initiator.method, Grouping):
            groups = [
                (scene.judge(list(tracks)), group) for group, tracks in initiator.method.groups
            ]
            found_by_any = found or any(
                one.outcome is Outcome.TRUE for judged, _ in groups for one in judged
            )
            left = totals.raw_confirmations - totals.pruned
            results[name] += [float(found_by_any), float(totals.raw_confirmations), float(left)]
            if name == next(iter(CURVES)):
                results["weights"] = _errors_by_weight(scene, groups)
    return results


def _errors_by_weight(
    scene: SimulatedScene, groups: Iterable[tuple[list[Judged], Candidates]]
) -> list[float]:
    errors: list[float] = []
    for judged, group in groups:
        if any(one.outcome is not Outcome.FALSE for one in judged):
            truth = scene.simulator.truth(judged[0].track.stamp)[0]
            x, y = (weighted(group) - truth)[:, 0::2].T
            errors += np.hypot(x, y).tolist()
    return errors


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
    min_hits, window = published.TABLE_I_RULE
    options = SplitMergeOptions(min_hits=min_hits, window=window)
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
    half = 0.5 * published.AREA_SIDE
    centre = scene.simulator.truth(0.5 * scene.scenario.duration)[target, 0::2]
    inside = [
        (np.abs(x - centre[0]) <= half) & (np.abs(y - centre[1]) <= half)
        for x, y in (
            (scan.range * np.cos(scan.azimuth), scan.range * np.sin(scan.azimuth))
            for scan in scene.scans
        )
    ]
    offsets = np.cumsum([0, *map(len, inside)])
    hits = started.hits
    within = np.concatenate(inside)[offsets[hits[..., 0]] + hits[..., 1]]
    return np.asarray(within.all(axis=1))


DETECTION_PROBABILITIES = (1.0, 0.9, 0.8)
ASSUMED = 0.9
"""Detection probability of the scene with the listed interval."""
TURN_RADIUS = 1.0
"""Turn radius of the platform at a corner, m; the published platform turns on the spot."""


MATCHINGS = {
    "nearest pair first": "nearest",
    "oldest track first": "oldest",
    "by several tracks": "shared",
}
"""Values of `SequentialOptions.matching`, in the words of the tables."""
GATES = ("range", "major_axis")
MATCHED = tuple(itertools.product(GATES, MATCHINGS))
"""Meaning of sigma in Eq. 7, and track of a detection that several tracks match (Step 3)."""
DEFAULT_READING = (GATES[0], "oldest track first")
"""The default reading of the method."""


def hexagon_case(period: float, detection_probability: float) -> Scenario:
    """The scene of Section 5, from time 0 to two minutes; every run draws the targets' headings.

    Parameters
    ----------
    period : float
        s.
    detection_probability : float
    """
    half = 0.5 * published.SQUARE_SIDE
    corners = ((-half, -half), (half, -half), (half, half), (-half, half))
    sensor = SensorModel(
        range_std_fraction=published.SEQUENTIAL_RANGE_ERROR_FRACTION,
        azimuth_std=math.radians(published.ANGLE_ERROR_DEG),
        max_range=published.MAX_RANGE,
        detection_probability=detection_probability,
        clutter_density=published.CLUTTER / (math.pi * published.MAX_RANGE**2),
    )
    return Scenario(
        "sequential_2014",
        scans=1 + int(published.DURATION // period),
        period=period,
        sensor=sensor,
        own_ship=WaypointMotion(
            corners, published.PLATFORM_SPEED, published.PLATFORM_SPEED / TURN_RADIUS, True
        ),
    )


def hexagon(rng: np.random.Generator) -> tuple[FloatArray, ...]:
    """States of the targets, with headings drawn."""
    azimuth = np.arange(published.TARGETS) * 2.0 * np.pi / published.TARGETS
    heading = rng.uniform(-np.pi, np.pi, published.TARGETS)
    x, y = published.DISTANCE * np.array([np.cos(azimuth), np.sin(azimuth)])
    vx, vy = published.TARGET_SPEED * np.array([np.cos(heading), np.sin(heading)])
    return tuple(np.stack([x, vx, y, vy], axis=1))


def hexagon_cases() -> dict[tuple[float, float], Scenario]:
    """Scenes by interval (s) and p_d; the source leaves both open."""
    text_period, list_period = published.PERIODS
    keys = [(text_period, p_d) for p_d in DETECTION_PROBABILITIES]
    return {key: hexagon_case(*key) for key in (*keys, (list_period, ASSUMED))}


def run_hexagon(scenario: Scenario, seed: list[int]) -> Result:
    """Start tracks by every reading.

    Returns cumulative counts per reading and scan: targets with a true track; targets with a track
    that has more than half of its hits from the target; all tracks. For the second kind of tracks
    of the default reading it also returns the errors of each estimator, and the bounds.
    """
    scene = _hexagon_scene(scenario, seed)
    results: Result = {}
    for gate, matching in MATCHED:
        method = sequential.Sequential(
            scenario.sensor,
            CommonOptions(max_speed=published.SEQUENTIAL_MAX_SPEED, **AS_GIVEN),
            SequentialOptions(gate_error=gate, matching=MATCHINGS[matching]),
        )
        started = Started.on(scene, Tracker(method), scenario.scans)
        judged = started.judged()
        results |= _counts_by_scan(started, f"{gate}, {matching}", judged)
        if (gate, matching) == DEFAULT_READING:
            results |= errors(started, first_of_each_target(judged))
    return results


def _counts_by_scan(started: Started, name: str, judged: Sequence[Judged]) -> Result:
    """Counts by the end of each scan: true tracks, first tracks of targets, all tracks."""
    scenario = started.scene.scenario
    true = [one for one in judged if one.outcome is Outcome.TRUE]
    stamps = {
        "true": [one.track.stamp for one in true],
        "near": [one.track.stamp for one in first_of_each_target(judged)],
        "all": started.tracks.stamp.tolist(),
    }
    counts = {}
    for kind, values in stamps.items():
        scan = np.round(np.array(values) / scenario.period)
        number = np.histogram(scan, np.arange(scenario.scans + 1) - 0.5)[0]
        counts[f"{name}: {kind}"] = np.cumsum(number).astype(float).tolist()
    return counts


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


def run_conventional(scenario: Scenario, seed: list[int]) -> Result:
    """Start tracks by the conventional methods: counts by scan, and errors of the position, m."""
    scene = _hexagon_scene(scenario, seed)
    results: Result = {}
    for name, (method, options) in CONVENTIONAL.items():
        speed = published.SEQUENTIAL_MAX_SPEED
        given = {"max_speed": speed, **AS_GIVEN, **options}
        initiator = make_initiator(method, sensor=scenario.sensor, **given)
        started = Started.on(scene, initiator, scenario.scans)
        judged = scene.judge(list(started.tracks))  # lines of Hough have any number of hits
        results |= _counts_by_scan(started, name, judged)
        results[name] = [float(one.position_error) for one in first_of_each_target(judged)]
    return results


def _hexagon_scene(scenario: Scenario, seed: list[int]) -> SimulatedScene:
    """The scene with headings drawn."""
    targets = hexagon(np.random.default_rng([*seed, 1]))
    return SimulatedScene.drawn(dataclasses.replace(scenario, targets=targets), seed)


def errors(started: Started, judged: list[Judged]) -> Result:
    """Errors of the estimators on the same hits, and their Cramer-Rao bounds.

    Returns
    -------
    dict
        Per estimator: distance (m), length of the velocity's error (m/s), speed less the true one
        (m/s), angle between the velocities (degrees), of each track in turn; and of each track the
        Cramer-Rao bounds of mean square distance (m^2) and velocity error (m^2/s^2), and whether
        all hits are the target's.
    """
    scene = started.scene
    results: Result = {name: [] for name in (*sequential.ESTIMATORS, "bound")}
    for judgement in judged:
        truth = scene.simulator.truth(judgement.track.stamp)[judgement.target]
        for name in sequential.ESTIMATORS:
            results[name] += _errors(_estimated(scene, judgement.track, name) - truth, truth)
        results["bound"] += [*_bound(scene, judgement), float(judgement.pure)]
    return results


def _estimated(scene: SimulatedScene, track: ConfirmedTrack, estimator: str) -> FloatArray:
    sensor = scene.scenario.sensor
    hits = np.array([convert(scene.scans[scan], sensor, scan)[row] for scan, row in track.hits])
    noise = SequentialOptions().process_noise
    return sequential.estimate(hits[None], track.stamp, sensor, estimator, noise).state[0]


def _errors(error: FloatArray, truth: FloatArray) -> list[float]:
    true, estimated = truth[1::2], truth[1::2] + error[1::2]
    angle = math.atan2(true[0] * estimated[1] - true[1] * estimated[0], float(true @ estimated))
    return [
        float(np.hypot(error[0], error[2])),
        float(np.hypot(error[1], error[3])),
        float(np.hypot(*estimated) - np.hypot(*true)),
        abs(math.degrees(angle)),
    ]


def _bound(scene: SimulatedScene, judgement: Judged) -> list[float]:
    """Bounds of the mean square errors at the hits' times, all taken as the target's."""
    stamps = np.array([scene.scans[scan].stamp for scan, _ in judgement.track.hits])
    scenario = scene.scenario
    positions = np.array([scene.simulator.truth(t)[judgement.target, 0::2] for t in stamps])
    own_ship = np.array([scenario.own_ship.pose(t)[:2] for t in stamps])
    bound = cramer_rao(positions, stamps, own_ship, scenario.sensor, judgement.track.stamp)
    return [float(np.trace(bound[place::2, place::2])) for place in (0, 1)]
