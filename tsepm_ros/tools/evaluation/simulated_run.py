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
"""Simulated runs of an operating point: scans, tracks started on them and held, judged by truth.

A confirmed track belongs to a target that gave more than half of its hits. Each confirmed track of
a run has one outcome: *true* (the first track of a target within 3 sigma of it, sigma being the
larger axis of the measurement error there), *redundant* (a later track within 3 sigma of the
target), *misplaced* (a track farther from its target), *false* (a track without a target). Apart
from its hits, a track is *at* each target that is within 3 sigma of it.
"""

from __future__ import annotations

import enum
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.methods.registry import (
    make_initiator,
    outside_object,
    registered_method,
    registered_option_names,
)
from tsepm_ros.numerics.arrays import FloatArray, IntArray
from tsepm_ros.own_ship.pose_history import echo_poses
from tsepm_ros.parameters import meant_parameter
from tsepm_ros.tools.evaluation.result_files import result_code_key, result_outside_files
from tsepm_ros.tools.simulation import Scenario, Simulator
from tsepm_ros.tracker.measurement import major_sigma, measurement_covariance
from tsepm_ros.tracker.scan import Scan
from tsepm_ros.tracker.sensor import SensorModel
from tsepm_ros.tracker.tracker import Tracker
from tsepm_ros.tracker.tracks import ConfirmedTrack

NO_TARGET = -1
SIGMAS = 3.0


class Outcome(enum.StrEnum):
    """Outcome of a confirmed track."""

    TRUE = "true"
    REDUNDANT = "redundant"
    MISPLACED = "misplaced"
    FALSE = "false"


@dataclass(frozen=True, eq=False)
class Judged:
    """A confirmed track with its outcome and errors.

    Attributes
    ----------
    track : ConfirmedTrack
    outcome : Outcome
    target : int
        Index of the target that gave more than half of the hits, or NO_TARGET.
    pure : bool
        All hits come from that target.
    position_error, velocity_error : float
        Distance from that target's state, m and m/s; nan without a target.
    nees : float
        Normalised estimation error squared, ideally 4 on average; nan without a target.
    at : frozenset of int
        Targets within 3 sigma of the track at its stamp, whatever its hits.
    """

    track: ConfirmedTrack
    outcome: Outcome
    target: int
    pure: bool
    position_error: float
    velocity_error: float
    nees: float
    at: frozenset[int] = frozenset()


def simulated_measurement_sigma(sensor: SensorModel, offset: FloatArray) -> float:
    """Larger axis of the measurement error, m, for a target at `offset` (2,) from the sensor."""
    range_ = float(np.hypot(*offset))
    covariance = measurement_covariance(
        range_, np.arctan2(offset[1], offset[0]), sensor.range_variance(range_), sensor.azimuth_std
    )
    return float(major_sigma(covariance))


def simulated_limit(scenario: Scenario, target: FloatArray, time: float) -> float:
    """3 sigma of the measurement error's larger axis, m, for a target (4,) at a time, s.

    Of several sensors the largest of those that look at the target, or of all if none does.
    """
    found = []
    for scene in scenario.of_each.values():
        x, y, yaw = scene.sensor_pose(time)
        offset = target[0::2] - (x, y)
        azimuth = np.arctan2(offset[1], offset[0]) - yaw
        covers = scene.sensor.covers([np.hypot(*offset)], [azimuth])[0]
        found.append((covers, simulated_measurement_sigma(scene.sensor, offset)))
    return SIGMAS * max(found)[1]


def judge_simulated_starts(
    simulator: Simulator, tracks: Sequence[ConfirmedTrack], origins: Sequence[IntArray]
) -> list[Judged]:
    """Judge the confirmed tracks of a run on a simulator's scans.

    Parameters
    ----------
    simulator : Simulator
        With the scenario and the truth.
    tracks : sequence of ConfirmedTrack
        In the order of confirmation.
    origins : sequence of (n,) ndarray of int
        Per processed scan, to which the tracks' hits refer, the target index of each detection,
        negative for clutter.

    Returns
    -------
    list of Judged
        In the order of the tracks.
    """
    started: set[int] = set()
    judged = []
    for track in tracks:
        sources = np.array([origins[scan][index] for scan, index in track.hits])
        target = _simulated_majority(sources)
        truths = simulator.truth(track.stamp)
        at = frozenset(
            index
            for index, truth in enumerate(truths)
            if _simulated_distance(track, truth)
            <= simulated_limit(simulator.scenario, truth, track.stamp)
        )
        if target == NO_TARGET:
            judged.append(Judged(track, Outcome.FALSE, target, False, np.nan, np.nan, np.nan, at))
            continue
        error = track.state - truths[target]
        outcome = Outcome.MISPLACED
        if target in at:
            outcome = Outcome.REDUNDANT if target in started else Outcome.TRUE
            started.add(target)
        judged.append(
            Judged(
                track,
                outcome,
                target,
                bool((sources == target).all()),
                _simulated_distance(track, truths[target]),
                float(np.hypot(error[1], error[3])),
                float(error @ np.linalg.solve(track.covariance, error)),
                at,
            )
        )
    return judged


def simulated_origins_of(
    processed: Sequence[float], stamps: Sequence[float], origins: Sequence[IntArray]
) -> list[IntArray]:
    """Origins of the processed scans, to which hits refer; dropped scans have none.

    Parameters
    ----------
    processed : sequence of float
        Stamps of the scans that were processed, s.
    stamps : sequence of float
        Stamps of all scans, s, ascending. The nearest stamp counts, since clocks round.
    origins : sequence of (n,) ndarray of int
        Origins of all scans.
    """
    middle = 0.5 * (np.array(stamps[1:]) + np.array(stamps[:-1]))
    return [origins[index] for index in np.searchsorted(middle, processed)]


def _simulated_distance(track: ConfirmedTrack, truth: FloatArray) -> float:
    """Distance of a track from a target's state, m."""
    error = track.state - truth
    return float(np.hypot(error[0], error[2]))


def _simulated_majority(sources: NDArray[np.int64]) -> int:
    """The target that gave more than half of the hits, or NO_TARGET."""
    targets, counts = np.unique(sources[sources >= 0], return_counts=True)
    if len(targets) and 2 * counts.max() > len(sources):
        return int(targets[counts.argmax()])
    return NO_TARGET


class SimulatedTrackStarter(Protocol):
    """Interface of what is evaluated: an `Tracker`, or an object with the same `process`.

    The evaluation reads `stamp`, `state`, `covariance` (nan if unknown) and `hits` of its tracks.
    With the optional attribute `current`, tracks with a `state` (n, 4) at the last scan's
    stamp and, for CLEAR-MOT, a `track_id` (n,), the confirmed tracks are evaluated too.
    """

    def process(self, scan: Scan) -> Sequence[ConfirmedTrack]:
        """Process the next scan and return the tracks newly confirmed by it."""


def make_simulated_method(scenario: Scenario, method: str, options: Mapping[str, Any]) -> Tracker:
    """Make one of the package's own methods for a scenario's sensor or sensors."""
    models = {name: scene.sensor for name, scene in scenario.of_each.items()}
    return make_initiator(method, sensor=models, **options)


@dataclass(frozen=True)
class SimulatedOperatingPoint:
    """A method at one setting.

    Attributes
    ----------
    method, label : str
        Names of the method and of the setting in its sweep.
    options : mapping
        All options given to the method.
    factory : callable
        Makes a `SimulatedTrackStarter` from a scenario, `method` and `options`; importable by its
        name, so that other processes can make it too.
    version : str
        Version of an installed package that the results depend on, too.
    measures : tuple of str
        Measures from outside the package, ``module:function``, see `outside_measure`.
    """

    method: str
    label: str = "default"
    options: Mapping[str, Any] = field(default_factory=dict)
    factory: Callable[[Scenario, str, Mapping[str, Any]], SimulatedTrackStarter] = (
        make_simulated_method
    )
    version: str = ""
    measures: tuple[str, ...] = ()

    def make(self, scenario: Scenario) -> SimulatedTrackStarter:
        """Make a new track starter for a run."""
        return self.factory(scenario, self.method, self.options)

    @property
    def code(self) -> str:
        """Key of the code that makes it: of the package, and of what is not of the package."""
        own = [registered_method(self.method)] if self.factory is make_simulated_method else []
        measures = map(outside_measure, self.measures)
        return result_code_key(*result_outside_files(self.factory, *own, *measures))


Measure = Callable[[FloatArray, FloatArray], float]
"""A figure of a scan from the positions of the tracks (n, 2) and of the targets (m, 2), m."""


def outside_measure(name: str) -> Measure:
    """A measure from outside the package, by ``module:function``.

    Raises
    ------
    ValueError
        If it cannot be imported, cannot be called, or fails without tracks and targets.
    """
    function = outside_object(name)

    def measure(tracks: FloatArray, targets: FloatArray) -> float:
        try:
            return float(function(tracks.copy(), targets.copy()))
        except Exception as error:
            raise ValueError(
                f"{name}, called with positions {tracks.shape} of tracks and {targets.shape} of "
                f"targets, returned no number: {type(error).__name__}: {error}"
            ) from error

    measure.__module__ = getattr(function, "__module__", None) or name.partition(":")[0]
    measure(np.zeros((0, 2)), np.zeros((0, 2)))
    return measure


def simulated_operating_points(
    methods: Iterable[str],
    given: Mapping[str, Any] | None = None,
    *,
    defaults: bool = False,
    measures: Sequence[str] = (),
) -> list[SimulatedOperatingPoint]:
    """Operating points of the methods' sweeps, from few to many false tracks.

    Parameters
    ----------
    methods : iterable of str
    given : mapping, optional
        Options for the methods that have them. A method whose sweep varies a given option is
        evaluated at the given value only.
    defaults : bool, optional
        Evaluate each method at its default options, and those given, in place of its sweep.
    measures : sequence of str, optional
        See `SimulatedOperatingPoint`.

    Raises
    ------
    ValueError
        If no method has a given option; the message names the option.
    """
    for name in measures:
        outside_measure(name)
    given = given or {}
    methods = list(methods)
    known = {option for method in methods for option in registered_option_names(method)}
    for name in given:
        if name not in known:
            meant = meant_parameter(name, known)
            raise ValueError(f"{name} is not an option of {' or '.join(methods)}{meant}")
    return [
        replace(point, measures=tuple(measures))
        for method in methods
        for point in _simulated_sweep(method, given, defaults)
    ]


def _simulated_sweep(
    method: str, given: Mapping[str, Any], defaults: bool
) -> list[SimulatedOperatingPoint]:
    own = {name: value for name, value in given.items() if name in registered_option_names(method)}
    sweep = registered_method(method).operating_points
    if defaults or any(name in options for options in sweep.values() for name in own):
        sweep = {"as given" if own else "default": {}}
    return [
        SimulatedOperatingPoint(method, label, {**own, **options})
        for label, options in sweep.items()
    ]


@dataclass
class SimulatedScene:
    """The scans of a simulated run, and the origins of their detections.

    Attributes
    ----------
    simulator : Simulator
        With the scenario and the truth.
    scans : list of Scan
        With sensor poses from the exact own-ship motion.
    origins : list of (n,) ndarray of int
        Target of each detection of a scan, negative for clutter.
    """

    simulator: Simulator
    scans: list[Scan]
    origins: list[IntArray]

    @classmethod
    def drawn(cls, scenario: Scenario, seed: list[int]) -> Self:
        """Simulate the scans of a run."""
        simulator = Simulator(scenario, seed)
        simulated = list(simulator)
        scans = [with_simulated_poses(item.scan, scenario) for item in simulated]
        return cls(simulator, scans, [item.origin for item in simulated])

    @property
    def scenario(self) -> Scenario:
        """The simulator's scenario."""
        return self.simulator.scenario

    def judge(self, tracks: Sequence[ConfirmedTrack]) -> list[Judged]:
        """Judge tracks that were started on the scans, see `judge_simulated_starts`."""
        return judge_simulated_starts(self.simulator, tracks, self.origins)


@dataclass
class SimulatedRun(SimulatedScene):
    """The scans, starts and confirmed tracks of one run.

    Attributes
    ----------
    starts : list of (int, ConfirmedTrack)
        With the index of the scan that confirmed each.
    corrections : list of (int, ConfirmedTrack)
        Later revisions of starts, with the index of the scan that brought each.
    held : list of (n, 2) ndarray or None
        Positions of the tracks after each scan that neither coast nor stand still; None if the
        starter holds no tracks.
    held_ids : list of list of int or None
        Their ids; None if they have none.
    measured : list of tuple of float
        Measures from outside after each scan; none without held tracks.
    """

    starts: list[tuple[int, ConfirmedTrack]] = field(default_factory=list)
    corrections: list[tuple[int, ConfirmedTrack]] = field(default_factory=list)
    held: list[FloatArray | None] = field(default_factory=list)
    held_ids: list[list[int] | None] = field(default_factory=list)
    measured: list[tuple[float, ...]] = field(default_factory=list)

    def judged(self) -> list[Judged]:
        """Judge the starts, as first published: revision 0."""
        return self.judge([track for _, track in self.starts])


def simulate_run(
    scenario: Scenario, seed: list[int], point: SimulatedOperatingPoint
) -> SimulatedRun:
    """Simulate a run and start tracks on it."""
    run = SimulatedRun.drawn(scenario, seed)
    starter, measures = point.make(scenario), [*map(outside_measure, point.measures)]
    for index, scan in enumerate(run.scans):
        run.starts += [(index, track) for track in starter.process(scan)]
        run.corrections += [(index, track) for track in getattr(starter, "revised", ())]
        current = getattr(starter, "current", None)
        current = getattr(current, "sure", current)
        held = None if current is None else np.array(current.state)[:, 0::2]
        ids = getattr(current, "track_id", None)
        run.held.append(held)
        run.held_ids.append(None if ids is None else np.array(ids).tolist())
        targets = run.simulator.truth(scan.stamp)[:, 0::2]
        run.measured.append(
            () if held is None else tuple(measure(held, targets) for measure in measures)
        )
    return run


def with_simulated_poses(scan: Scan, scenario: Scenario) -> Scan:
    """A simulated scan with the sensor poses of its echoes, from the exact own-ship motion."""
    pose = scenario.of_each[scan.sensor].sensor_pose

    def poses_at(times: FloatArray) -> FloatArray:
        return np.array([pose(time) for time in times]).reshape(-1, 3)

    poses = echo_poses(poses_at, scan.stamp, scan.time_offset, scan.azimuth)
    return replace(scan, sensor_pose=poses)
