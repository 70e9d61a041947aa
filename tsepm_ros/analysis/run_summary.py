"""What is kept of a run: enough for every figure, after any number of its scans."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tsepm_ros.analysis.bounds import cramer_rao
from tsepm_ros.analysis.gospa import gospa
from tsepm_ros.analysis.simulated_run import SimulatedRun
from tsepm_ros.analysis.truth import NO_TARGET, SIGMAS, Judged, Outcome, measurement_sigma
from tsepm_ros.numerics.arrays import FloatArray


@dataclass(frozen=True)
class StartSummary:
    """A start of which a target gave more than half of the hits.

    Attributes
    ----------
    scan : int
        Index of the scan that confirmed it.
    time : float
        Time from the first scan to that one, s.
    outcome : Outcome
    pure : bool
        All hits come from the target.
    position_error, velocity_error : float
        m and m/s.
    nees : float
    position_bound, velocity_bound : float
        Cramer-Rao bounds of the errors' root mean squares, m and m/s, for its own hits; nan where
        they are not all the target's, or of one time only.
    """

    scan: int
    time: float
    outcome: Outcome
    pure: bool
    position_error: float
    velocity_error: float
    nees: float
    position_bound: float
    velocity_bound: float


@dataclass(frozen=True)
class ScanRecord:
    """What stands after a scan.

    Attributes
    ----------
    false : int
        False starts in this scan.
    held : int
        Targets within 3 sigma of which a track is held; -1 where nothing is held at all.
    localisation, missed, false_held : float
        Parts of the squared GOSPA metric of the held tracks, m^2; nan where nothing is held at all.
    """

    false: int
    held: int = -1
    localisation: float = math.nan
    missed: float = math.nan
    false_held: float = math.nan


@dataclass(frozen=True)
class RunSummary:
    """What is kept of one run.

    Attributes
    ----------
    targets : int
        Targets in the scene.
    starts : tuple of StartRecord
        In order of confirmation.
    scans : tuple of ScanRecord
    """

    targets: int
    starts: tuple[StartSummary, ...]
    scans: tuple[ScanRecord, ...]

    def first(self, scans: int) -> RunSummary:
        """The run had it ended after so many scans.

        What a scan gives does not depend on later ones. (Targets that a scenario draws are drawn to
        stay in their ranges for the whole run.)
        """
        starts = tuple(start for start in self.starts if start.scan < scans)
        return RunSummary(self.targets, starts, self.scans[:scans])

    def count(self, *outcomes: Outcome) -> int:
        """Starts that are one of these."""
        false = sum(scan.false for scan in self.scans) if Outcome.FALSE in outcomes else 0
        return false + sum(start.outcome in outcomes for start in self.starts)

    @property
    def wrong(self) -> int:
        """Starts that are false or misplaced."""
        return self.count(Outcome.FALSE, Outcome.MISPLACED)

    def as_json(self) -> dict[str, Any]:
        """As lists of values, null for nan; :meth:`from_json` takes it."""
        starts = [_values(start) for start in self.starts]
        return {"targets": self.targets, "starts": starts, "scans": [*map(_values, self.scans)]}

    @classmethod
    def from_json(cls, content: dict[str, Any]) -> RunSummary:
        """The record that became this."""
        starts = (
            StartSummary(scan, time, Outcome(outcome), pure, *_numbers(more))
            for scan, time, outcome, pure, *more in content["starts"]
        )
        scans = (
            ScanRecord(false, held, *_numbers(more)) for false, held, *more in content["scans"]
        )
        return cls(content["targets"], tuple(starts), tuple(scans))


def _values(record: StartSummary | ScanRecord) -> list[Any]:
    values = [getattr(record, field.name) for field in dataclasses.fields(record)]
    values = [value.value if isinstance(value, Outcome) else value for value in values]
    return [None if value != value else value for value in values]  # nan is not JSON


def _numbers(values: Iterable[float | None]) -> list[float]:
    return [math.nan if value is None else value for value in values]


def record(run: SimulatedRun) -> RunSummary:
    """Judge a run and keep what counts."""
    judged = run.judged()
    false = np.zeros(len(run.scans), int)
    starts = []
    for one, scan in zip(judged, run.start_scans, strict=True):
        if one.outcome is Outcome.FALSE:
            false[scan] += 1
        else:
            starts.append(_start_record(run, one, scan))
    return RunSummary(
        targets=len(run.simulator.targets),
        starts=tuple(starts),
        scans=tuple(_scan_record(run, index, int(false[index])) for index in range(len(run.scans))),
    )


def _start_record(run: SimulatedRun, one: Judged, scan: int) -> StartSummary:
    bound = start_bound(run, one)
    return StartSummary(
        scan=scan,
        time=run.scans[scan].stamp - run.simulator.start,
        outcome=one.outcome,
        pure=one.pure,
        position_error=one.position_error,
        velocity_error=one.velocity_error,
        nees=one.nees,
        position_bound=math.sqrt(bound[0, 0] + bound[2, 2]),
        velocity_bound=math.sqrt(bound[1, 1] + bound[3, 3]),
    )


def start_bound(run: SimulatedRun, one: Judged) -> FloatArray:
    """Cramer-Rao bound of a start, (4, 4): of its hits, had they been at the target.

    nan where some hit is not the target's, or all hits are of one scan.
    """
    if not one.pure or one.target == NO_TARGET or len({scan for scan, _ in one.track.hits}) < 2:
        return np.full((4, 4), np.nan)
    echoes = (_echo(run, scan, row) for scan, row in one.track.hits)
    times, sensors, velocities = zip(*echoes, strict=True)
    states = np.array([run.simulator.truth(time)[one.target] for time in times])
    return cramer_rao(
        states[:, 0::2],
        times,
        sensors,
        run.scenario.sensor,
        one.track.stamp,
        states[:, 1::2] - velocities,
    )


def _echo(run: SimulatedRun, scan_index: int, row: int) -> tuple[float, FloatArray, FloatArray]:
    """Time (s) of a detection, and where the sensor was for it and how it moved, (2,) each."""
    scan = run.scans[scan_index]
    offset = 0.0 if scan.time_offset is None else float(scan.time_offset[row])
    poses = np.broadcast_to(scan.sensor_pose, (len(scan), 3))
    velocities = np.broadcast_to(scan.sensor_velocity, (len(scan), 2))
    return scan.stamp + offset, poses[row, :2], velocities[row]


def _scan_record(run: SimulatedRun, index: int, false: int) -> ScanRecord:
    """Compare what is held with the truth; c is 3 sigma, the mean over the targets."""
    held, stamp = run.held[index], run.scans[index].stamp
    targets = run.simulator.truth(stamp)[:, 0::2]
    if held is None or not len(targets):
        return ScanRecord(false)
    sensor = run.sensor_position(stamp)
    sigmas = [measurement_sigma(run.scenario.sensor, target - sensor) for target in targets]
    parts = gospa(held, targets, SIGMAS * float(np.mean(sigmas)))
    return ScanRecord(
        false, _near(held, targets, sigmas), parts.localisation, parts.missed, parts.false
    )


def _near(held: FloatArray, targets: FloatArray, sigmas: Sequence[float]) -> int:
    """Number of targets with a held track within 3 sigma."""
    offset = held[:, None, :] - targets[None, :, :]
    near = np.hypot(offset[..., 0], offset[..., 1]) <= SIGMAS * np.asarray(sigmas)
    return int(near.any(axis=0).sum())
