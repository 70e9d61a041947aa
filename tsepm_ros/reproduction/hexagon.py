"""The simulated runs of Sequential 2014: six targets on a hexagon, a platform on a square."""

from __future__ import annotations

import dataclasses
import itertools
import math

import numpy as np

from tsepm_ros.analysis.bounds import cramer_rao
from tsepm_ros.analysis.simulated_run import SimulatedScene
from tsepm_ros.analysis.truth import Judged, Outcome
from tsepm_ros.initiation import initial_state
from tsepm_ros.initiation.common_options import CommonOptions
from tsepm_ros.initiation.initiator import Initiator
from tsepm_ros.kinematics.track import ConfirmedTrack
from tsepm_ros.methods.sequential import Sequential, SequentialOptions
from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.reproduction import published_2014 as published
from tsepm_ros.reproduction.runs import Result
from tsepm_ros.reproduction.started_tracks import AS_GIVEN, Started
from tsepm_ros.sensing.conversion import convert
from tsepm_ros.sensing.sensor import SensorModel
from tsepm_ros.simulation import Scenario
from tsepm_ros.simulation.own_ship_motion import WaypointMotion

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
READINGS = tuple(itertools.product(GATES, MATCHINGS))
"""Meaning of sigma in Eq. 7, and track of a detection that several tracks match (Step 3)."""
DEFAULT_READING = (GATES[0], "oldest track first")
"""The default reading of the method."""


def case(period: float, detection_probability: float) -> Scenario:
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
        range_std_fraction=published.RANGE_ERROR_FRACTION,
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


def cases() -> dict[tuple[float, float], Scenario]:
    """Scenes by interval (s) and p_d; the source leaves both open."""
    text_period, list_period = published.PERIODS
    keys = [(text_period, p_d) for p_d in DETECTION_PROBABILITIES]
    return {key: case(*key) for key in (*keys, (list_period, ASSUMED))}


def run_hexagon(scenario: Scenario, seed: list[int]) -> Result:
    """Start tracks by every reading.

    Returns cumulative counts per reading and scan: targets with a true track; targets with a track
    that has more than half of its hits from the target; all tracks. For the second kind of tracks
    of the default reading it also returns the errors of each estimator, and the bounds.
    """
    targets = hexagon(np.random.default_rng([*seed, 1]))
    scene = SimulatedScene.drawn(dataclasses.replace(scenario, targets=targets), seed)
    results: Result = {}
    for gate, matching in READINGS:
        method = Sequential(
            scenario.sensor,
            CommonOptions(max_speed=published.MAX_SPEED, **AS_GIVEN),
            SequentialOptions(gate_error=gate, matching=MATCHINGS[matching]),
        )
        started = Started.on(scene, Initiator(method), scenario.scans)
        judged = started.judged()
        true = [judgement for judgement in judged if judgement.outcome is Outcome.TRUE]
        for name, stamps in (
            ("true", [judgement.track.stamp for judgement in true]),
            ("near", [judgement.track.stamp for judgement in _first_of_each(judged)]),
            ("all", started.tracks.stamp.tolist()),
        ):
            scan = np.round(np.array(stamps) / scenario.period)
            counts = np.histogram(scan, np.arange(scenario.scans + 1) - 0.5)[0]
            results[f"{gate}, {matching}: {name}"] = np.cumsum(counts).astype(float).tolist()
        if (gate, matching) == DEFAULT_READING:
            results |= errors(started, _first_of_each(judged))
    return results


def _first_of_each(judged: list[Judged]) -> list[Judged]:
    first: dict[int, Judged] = {}
    for judgement in judged:
        first.setdefault(judgement.target, judgement)
    return list(first.values())


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
    results: Result = {name: [] for name in (*initial_state.ESTIMATORS, "bound")}
    for judgement in judged:
        truth = scene.simulator.truth(judgement.track.stamp)[judgement.target]
        for name in initial_state.ESTIMATORS:
            results[name] += _errors(_estimated(scene, judgement.track, name) - truth, truth)
        results["bound"] += [*_bound(scene, judgement), float(judgement.pure)]
    return results


def _estimated(scene: SimulatedScene, track: ConfirmedTrack, estimator: str) -> FloatArray:
    sensor = scene.scenario.sensor
    hits = np.array([convert(scene.scans[scan], sensor, scan)[row] for scan, row in track.hits])
    noise = SequentialOptions().process_noise
    return initial_state.estimate(hits[None], track.stamp, sensor, estimator, noise).state[0]


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
