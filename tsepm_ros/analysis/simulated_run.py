"""One simulated run: its scans, the tracks started on them, and the held tracks."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Self

import numpy as np

from tsepm_ros.analysis.operating_points import OperatingPoint, TrackStarter
from tsepm_ros.analysis.truth import Judged, judge
from tsepm_ros.kinematics.track import ConfirmedTrack
from tsepm_ros.numerics.arrays import FloatArray, IntArray
from tsepm_ros.own_ship.pose_history import echo_poses
from tsepm_ros.sensing.scan import Scan
from tsepm_ros.simulation import Scenario, Simulator
from tsepm_ros.simulation.own_ship_motion import Motion


def judge_starts(
    simulator: Simulator, tracks: Sequence[ConfirmedTrack], origins: Sequence[IntArray]
) -> list[Judged]:
    """Judge tracks that were started on a simulator's scans, see `tsepm_ros.analysis.truth.judge`.

    `origins` are those of the processed scans, to which the tracks' hits refer.
    """
    scenario = simulator.scenario
    return judge(
        tracks,
        origins,
        simulator.truth,
        scenario.sensor,
        lambda stamp: scenario.own_ship.pose(stamp)[:2],
    )


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
        scans = [with_poses(item.scan, scenario.own_ship) for item in simulated]
        return cls(simulator, scans, [item.origin for item in simulated])

    @property
    def scenario(self) -> Scenario:
        """The simulator's scenario."""
        return self.simulator.scenario

    def sensor_position(self, stamp: float) -> FloatArray:
        """Position of the sensor at a time (s), (2,)."""
        return self.scenario.own_ship.pose(stamp)[:2]

    def judge(self, tracks: Sequence[ConfirmedTrack]) -> list[Judged]:
        """Judge tracks that were started on the scans, see `tsepm_ros.analysis.truth.judge`."""
        return judge_starts(self.simulator, tracks, self.origins)


@dataclass
class SimulatedRun(SimulatedScene):
    """The scans, starts and held tracks of one run.

    Attributes
    ----------
    starts : list of ConfirmedTrack
    start_scans : list of int
        Index of the scan that confirmed each start.
    corrections : list of ConfirmedTrack
        Later revisions of starts.
    correction_scans : list of int
        Index of the scan that brought each.
    held : list of (n, 2) ndarray or None
        Positions of the held tracks after each scan; None if the starter holds no tracks.
    """

    starts: list[ConfirmedTrack] = field(default_factory=list)
    start_scans: list[int] = field(default_factory=list)
    corrections: list[ConfirmedTrack] = field(default_factory=list)
    correction_scans: list[int] = field(default_factory=list)
    held: list[FloatArray | None] = field(default_factory=list)

    def judged(self) -> list[Judged]:
        """Judge the starts, as first published: revision 0."""
        return self.judge(self.starts)


def simulate(scenario: Scenario, seed: list[int], point: OperatingPoint) -> SimulatedRun:
    """Simulate a run and start tracks on it."""
    run = SimulatedRun.drawn(scenario, seed)
    starter = point.make(scenario)
    for index, scan in enumerate(run.scans):
        started = list(starter.process(scan))
        run.starts += started
        run.start_scans += [index] * len(started)
        corrected = list(getattr(starter, "revised", ()))
        run.corrections += corrected
        run.correction_scans += [index] * len(corrected)
        run.held.append(_held_positions(starter))
    return run


def with_poses(scan: Scan, own_ship: Motion) -> Scan:
    """A simulated scan with the sensor poses of its echoes, from the exact own-ship motion."""

    def poses_at(times: FloatArray) -> FloatArray:
        return np.array([own_ship.pose(time) for time in times]).reshape(-1, 3)

    pose = echo_poses(poses_at, scan.stamp, scan.time_offset, scan.azimuth)
    return dataclasses.replace(scan, sensor_pose=pose)


def _held_positions(starter: TrackStarter) -> FloatArray | None:
    held = getattr(starter, "current", None)
    return None if held is None else np.array(held.state)[:, 0::2]
