"""One simulated run: the scans, the tracks that are started, and those that are held."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.analysis.operating_points import OperatingPoint, TrackStarter
from tsepm_ros.analysis.truth import Judged, judge
from tsepm_ros.kinematics.track import ConfirmedTrack
from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.own_ship.pose_history import echo_poses
from tsepm_ros.sensing.scan import Scan
from tsepm_ros.simulation import Scenario, Simulator
from tsepm_ros.simulation.scenario import Motion


@dataclass
class SimulatedRun:
    """What happened in one run.

    Attributes
    ----------
    simulator : Simulator
        Knows the scenario and the truth.
    scans : list of Scan
        Placed by the exact own-ship motion.
    origins : list of (n,) ndarray of int
        Target of each scan's detections.
    starts : list of ConfirmedTrack
    start_scans : list of int
        Index of the scan that confirmed each start.
    held : list of (n, 2) ndarray or None
        Positions held after each scan; None where nothing is held at all.
    """

    simulator: Simulator
    scans: list[Scan] = field(default_factory=list)
    origins: list[NDArray[np.int64]] = field(default_factory=list)
    starts: list[ConfirmedTrack] = field(default_factory=list)
    start_scans: list[int] = field(default_factory=list)
    held: list[FloatArray | None] = field(default_factory=list)

    @property
    def scenario(self) -> Scenario:
        """The scenario that was run."""
        return self.simulator.scenario

    def sensor_position(self, stamp: float) -> FloatArray:
        """Where the sensor was at a time (s), (2,)."""
        return self.scenario.own_ship.pose(stamp)[:2]

    def judged(self) -> list[Judged]:
        """What each start is, see `tsepm_ros.analysis.truth.judge`."""
        return judge(
            self.starts,
            self.origins,
            self.simulator.truth,
            self.scenario.sensor,
            self.sensor_position,
        )


def simulate(scenario: Scenario, seed: list[int], point: OperatingPoint) -> SimulatedRun:
    """Simulate a run and start tracks on it."""
    run = SimulatedRun(Simulator(scenario, seed))
    starter = point.make(scenario)
    for index, simulated in enumerate(run.simulator):
        scan = placed(simulated.scan, scenario.own_ship)
        started = list(starter.process(scan))
        run.scans.append(scan)
        run.origins.append(simulated.origin)
        run.starts += started
        run.start_scans += [index] * len(started)
        run.held.append(_held_positions(starter))
    return run


def placed(scan: Scan, own_ship: Motion) -> Scan:
    """A simulated scan with the poses that place its echoes, from the exact own-ship motion."""

    def poses_at(times: FloatArray) -> FloatArray:
        return np.array([own_ship.pose(time) for time in times]).reshape(-1, 3)

    pose = echo_poses(poses_at, scan.stamp, scan.time_offset, scan.azimuth)
    return dataclasses.replace(scan, sensor_pose=pose)


def _held_positions(starter: TrackStarter) -> FloatArray | None:
    hold = getattr(starter, "hold", None)
    return None if hold is None else np.array(hold.current.state)[:, 0::2]
