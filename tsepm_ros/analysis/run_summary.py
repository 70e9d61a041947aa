"""Summary of a run: the data of every measure, after any number of scans."""

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
    """A start with more than half of its hits from one target.

    Attributes
    ----------
    scan : int
        Index of the scan that confirmed it, from the first in which the targets are there.
    time : float
        Time from that scan to that one, s.
    outcome : Outcome
    pure : bool
        All hits come from the target.
    position_error, velocity_error : float
        m and m/s.
    nees : float
    position_bound, velocity_bound : float
        Cramer-Rao bounds of the errors' root mean squares, m and m/s, for its own hits; nan unless
        all hits are the target's and from two scans or more.
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
class ScanSummary:
    """False starts in a scan, and the held tracks after it.

    Attributes
    ----------
    false : int
        False starts in this scan.
    held : int
        Targets with a held track within 3 sigma; -1 if the starter holds no tracks.
    at : int
        Targets within 3 sigma of which a track was started, in this scan or before.
    corrections : int
        Starts that were corrected in this scan.
    right : int
        Targets with a true start, or with a start that a correction made true, so far.
    localisation, missed, false_held : float
        Parts of the squared GOSPA metric of the held tracks, m^2; nan if the starter holds no
        tracks.
    """

    false: int
    held: int = -1
    at: int = 0
    corrections: int = 0
    right: int = 0
    localisation: float = math.nan
    missed: float = math.nan
    false_held: float = math.nan


@dataclass(frozen=True)
class RunSummary:
    """Summary of one run.

    Attributes
    ----------
    targets : int
        Targets in the scene.
    starts : tuple of StartSummary
        In order of confirmation.
    scans : tuple of ScanSummary
    """

    targets: int
    starts: tuple[StartSummary, ...]
    scans: tuple[ScanSummary, ...]

    def first(self, scans: int) -> RunSummary:
        """Summary of the run up to a number of scans.

        The results of a scan do not depend on later scans. (A scenario draws its targets so that
        they stay in their ranges for the whole run.)
        """
        starts = tuple(start for start in self.starts if start.scan < scans)
        return RunSummary(self.targets, starts, self.scans[:scans])

    def count(self, *outcomes: Outcome) -> int:
        """Number of starts with one of the outcomes."""
        false = sum(scan.false for scan in self.scans) if Outcome.FALSE in outcomes else 0
        return false + sum(start.outcome in outcomes for start in self.starts)

    @property
    def wrong(self) -> int:
        """Number of false and misplaced starts."""
        return self.count(Outcome.FALSE, Outcome.MISPLACED)

    def as_json(self) -> dict[str, Any]:
        """The summary as lists of values, null for nan; see :meth:`from_json`."""
        starts = [_values(start) for start in self.starts]
        return {"targets": self.targets, "starts": starts, "scans": [*map(_values, self.scans)]}

    @classmethod
    def from_json(cls, content: dict[str, Any]) -> RunSummary:
        """The summary from the result of :meth:`as_json`."""
        starts = (
            StartSummary(scan, time, Outcome(outcome), pure, *_numbers(more))
            for scan, time, outcome, pure, *more in content["starts"]
        )
        scans = (ScanSummary(*values[:-3], *_numbers(values[-3:])) for values in content["scans"])
        return cls(content["targets"], tuple(starts), tuple(scans))


def _values(summary: StartSummary | ScanSummary) -> list[Any]:
    values = [getattr(summary, field.name) for field in dataclasses.fields(summary)]
    values = [value.value if isinstance(value, Outcome) else value for value in values]
    return [None if value != value else value for value in values]  # nan is not JSON


def _numbers(values: Iterable[float | None]) -> list[float]:
    return [math.nan if value is None else value for value in values]


def summarise(run: SimulatedRun) -> RunSummary:
    """Judge the starts of a run and summarise it; what was before its targets is left out."""
    first = run.scenario.warm_up
    judged = [
        (scan - first, start)
        for scan, start in zip(run.start_scans, run.judged(), strict=True)
        if scan >= first
    ]
    corrected = [
        (scan - first, revision)
        for scan, revision in zip(run.correction_scans, run.judge(run.corrections), strict=True)
        if scan >= first
    ]
    true = [
        (scan, one.target)
        for scan, one in [*judged, *corrected]
        if one.outcome in (Outcome.TRUE, Outcome.REDUNDANT)
    ]
    scans = range(run.scenario.scans)
    counts = zip(
        _in_each_scan([scan for scan, one in judged if one.outcome is Outcome.FALSE], scans),
        _so_far([(scan, target) for scan, one in judged for target in one.at], scans),
        _in_each_scan([scan for scan, _ in corrected], scans),
        _so_far(true, scans),
        strict=True,
    )
    return RunSummary(
        targets=len(run.simulator.targets),
        starts=tuple(
            _start_summary(run, one, scan)
            for scan, one in judged
            if one.outcome is not Outcome.FALSE
        ),
        scans=tuple(
            _scan_summary(run, scan, *row) for scan, row in zip(scans, counts, strict=True)
        ),
    )


def _in_each_scan(events: Sequence[int], scans: range) -> list[int]:
    """Number of the events in each scan."""
    return [events.count(scan) for scan in scans]


def _so_far(events: Sequence[tuple[int, int]], scans: range) -> list[int]:
    """Number of targets with an event, a scan and a target, up to each scan."""
    return [len({target for at, target in events if at <= scan}) for scan in scans]


def _start_summary(run: SimulatedRun, judged: Judged, scan: int) -> StartSummary:
    bound = start_bound(run, judged)
    return StartSummary(
        scan=scan,
        time=run.scans[run.scenario.warm_up + scan].stamp
        - run.simulator.start
        - run.scenario.target_start,
        outcome=judged.outcome,
        pure=judged.pure,
        position_error=judged.position_error,
        velocity_error=judged.velocity_error,
        nees=judged.nees,
        position_bound=math.sqrt(bound[0, 0] + bound[2, 2]),
        velocity_bound=math.sqrt(bound[1, 1] + bound[3, 3]),
    )


def start_bound(run: SimulatedRun, judged: Judged) -> FloatArray:
    """Cramer-Rao bound of a start, (4, 4), for hits at the target's true positions.

    nan unless all hits are the target's and from two scans or more.
    """
    if (
        not judged.pure
        or judged.target == NO_TARGET
        or len({scan for scan, _ in judged.track.hits}) < 2
    ):
        return np.full((4, 4), np.nan)
    echoes = (_echo(run, scan, row) for scan, row in judged.track.hits)
    times, sensors, velocities = zip(*echoes, strict=True)
    states = np.array([run.simulator.truth(time)[judged.target] for time in times])
    return cramer_rao(
        states[:, 0::2],
        times,
        sensors,
        run.scenario.sensor,
        judged.track.stamp,
        states[:, 1::2] - velocities,
    )


def _echo(run: SimulatedRun, scan_index: int, row: int) -> tuple[float, FloatArray, FloatArray]:
    """Time (s) of a detection, and the sensor's position and velocity then, (2,) each."""
    scan = run.scans[scan_index]
    offset = 0.0 if scan.time_offset is None else float(scan.time_offset[row])
    poses = np.broadcast_to(scan.sensor_pose, (len(scan), 3))
    velocities = np.broadcast_to(scan.sensor_velocity, (len(scan), 2))
    return scan.stamp + offset, poses[row, :2], velocities[row]


def _scan_summary(
    run: SimulatedRun, scan: int, false: int, at: int, corrections: int, right: int
) -> ScanSummary:
    """Compare the held tracks with the truth; c is 3 sigma, the mean over the targets."""
    index = run.scenario.warm_up + scan
    held, stamp = run.held[index], run.scans[index].stamp
    targets = run.simulator.truth(stamp)[:, 0::2]
    if held is None or not len(targets):
        return ScanSummary(false, -1, at, corrections, right)
    sensor = run.sensor_position(stamp)
    sigmas = [measurement_sigma(run.scenario.sensor, target - sensor) for target in targets]
    parts = gospa(held, targets, SIGMAS * float(np.mean(sigmas)))
    return ScanSummary(
        false,
        _targets_held(held, targets, sigmas),
        at,
        corrections,
        right,
        parts.localisation,
        parts.missed,
        parts.false,
    )


def _targets_held(held: FloatArray, targets: FloatArray, sigmas: Sequence[float]) -> int:
    """Number of targets with a held track within 3 sigma."""
    offset = held[:, None, :] - targets[None, :, :]
    near = np.hypot(offset[..., 0], offset[..., 1]) <= SIGMAS * np.asarray(sigmas)
    return int(near.any(axis=0).sum())
