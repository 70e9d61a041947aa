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
"""Measures of methods over many runs, each with its 95 % interval, from summaries of the runs.

A summary has the data of every measure, after any number of scans. Among the measures is the
Cramer-Rao bound of the state of a confirmed track.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.tools.evaluation.intervals import (
    IntervalEstimate,
    mean_count_interval,
    mean_interval,
    proportion_interval,
    quantile_interval,
    ratio_interval,
    rms_ratio_interval,
    root_mean_square_interval,
)
from tsepm_ros.tools.evaluation.simulated_run import (
    NO_TARGET,
    Judged,
    Outcome,
    SimulatedRun,
    simulated_limit,
)
from tsepm_ros.tools.evaluation.tracking_metrics import ClearMot, ClearMotCounts, gospa, ospa
from tsepm_ros.tools.simulation import Scenario
from tsepm_ros.tracker import motion
from tsepm_ros.tracker.sensor import SensorModel

SECONDS_PER_HOUR = 3600.0
MEASURED_ERRORS = "range_std", "range_std_fraction", "azimuth_std", "range_rate_std"
"""Errors of a sensor that bound those of a state."""


def cramer_rao_measure(
    positions: ArrayLike,
    times: ArrayLike,
    sensor_positions: ArrayLike,
    sensor: SensorModel | Sequence[SensorModel],
    stamp: float,
    relative_velocities: ArrayLike | None = None,
) -> FloatArray:
    """Cramer-Rao bound of the state ``[x, vx, y, vy]`` from ranges and azimuths.

    No unbiased estimate from Gaussian ranges r and azimuths a of a constant-velocity target has a
    smaller covariance than ``I^-1`` (Kay, "Fundamentals of Statistical Signal Processing:
    Estimation Theory", 1993, Eq. 3.31)::

        I = sum_i dr dr' (1/v + (dv/dr)^2 / (2 v^2)) + da da' / s_a^2

    with dr and da the gradients of range and azimuth by the state. The second term is the
    information in the size of a range error, whose variance v grows with range. A range rate c
    adds ``dc dc' / s_c^2``.

    Parameters
    ----------
    positions : (..., m, 2) array_like
        True positions at the m hits, m.
    times : (..., m) array_like
        Times of the hits, s.
    sensor_positions : (2,) or (..., m, 2) array_like
        Positions of the sensor at the hits, m.
    sensor : SensorModel or sequence of SensorModel
        Range and azimuth errors; of several sensors that of each hit.
    stamp : float
        Time of the state, s.
    relative_velocities : (..., m, 2) array_like, optional
        The target's velocity less the sensor's at each hit, m/s. Range rates count if they are
        given, of sensors whose `range_rate_std` is above 0.

    Returns
    -------
    (..., 4, 4) ndarray
        m^2, m^2/s, m^2/s^2.

    Raises
    ------
    ValueError
        If all hits of a target have one time: its velocity has no bound.
    """
    elapsed = np.asarray(times, float) - stamp
    if not elapsed.shape[-1] or not np.ptp(elapsed, axis=-1).all():
        raise ValueError("times: the hits must have at least two different times")
    offset = np.asarray(positions, float) - np.asarray(sensor_positions, float)
    range_ = np.hypot(offset[..., 0], offset[..., 1])
    models = [sensor] if isinstance(sensor, SensorModel) else sensor
    range_std, fraction, azimuth_std, rate_std = np.array(
        [[getattr(one, name) for one in models] for name in MEASURED_ERRORS]
    )
    variance = range_std**2 + (fraction * range_) ** 2
    range_information = 1.0 / variance + 0.5 * np.square(2.0 * fraction**2 * range_ / variance)
    along = offset / range_[..., None]
    across = np.stack([-along[..., 1], along[..., 0]], axis=-1)
    # Rows of a square root of I: both directions, each weighted by its information.
    directions = np.stack(
        [
            along * np.sqrt(range_information)[..., None],
            across / (range_ * azimuth_std)[..., None],
        ],
        axis=-2,
    )
    motion = np.stack([np.ones_like(elapsed), elapsed], axis=-1)
    root = directions[..., None] * motion[..., None, None, :]  # (..., m, 2, axis, derivative)
    root = root.reshape(*root.shape[:-4], -1, 4)
    information = np.swapaxes(root, -1, -2) @ root
    if relative_velocities is not None and rate_std.any():
        turn_rate = (across * np.asarray(relative_velocities, float)).sum(axis=-1) / range_
        rate_root = (turn_rate[..., None] * across)[..., None] * motion[..., None, :]
        rate_root[..., 1] += along
        rate_root = rate_root.reshape(*rate_root.shape[:-2], 4)
        rate_root /= np.where(rate_std > 0.0, rate_std, math.inf)[:, None]
        information = information + np.swapaxes(rate_root, -1, -2) @ rate_root
    return np.asarray(np.linalg.inv(information), np.float64)


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
    """False starts in a scan, and the confirmed tracks after it.

    Attributes
    ----------
    false : int
        False starts in this scan.
    held : int
        Targets with a confirmed track within 3 sigma; -1 if the starter holds no tracks.
    at : int
        Targets within 3 sigma of which a track was started, in this scan or before.
    corrections : int
        Tracks that starts continued in this scan, as their next revisions.
    right : int
        Targets with a true start, or with a track that a later start made true, so far.
    distances : tuple of float
        Of the confirmed tracks: OSPA, m, and the parts of GOSPA squared, m^2; empty without tracks
        or targets to compare. The cutoff is 3 sigma, the mean over the targets.
    clear : tuple of float
        Values of `ClearMotCounts`; empty without ids of the confirmed tracks, too.
    measured : tuple of float
        Measures from outside.
    """

    false: int
    held: int = -1
    at: int = 0
    corrections: int = 0
    right: int = 0
    distances: tuple[float, ...] = ()
    clear: tuple[float, ...] = ()
    measured: tuple[float, ...] = ()


@dataclass(frozen=True)
class RunMeasures:
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

    def first(self, scans: int) -> RunMeasures:
        """Summary of the run up to a number of scans.

        The results of a scan do not depend on later scans. (A scenario draws its targets so that
        they stay in their ranges for the whole run.)
        """
        starts = tuple(start for start in self.starts if start.scan < scans)
        return RunMeasures(self.targets, starts, self.scans[:scans])

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
        starts, scans = (
            [
                [
                    None if value != value else [*value] if isinstance(value, tuple) else value
                    for value in vars(summary).values()
                ]
                for summary in summaries
            ]
            for summaries in (self.starts, self.scans)  # nan is not JSON
        )
        return {"targets": self.targets, "starts": starts, "scans": scans}

    @classmethod
    def from_json(cls, content: dict[str, Any]) -> RunMeasures:
        """The summary from the result of :meth:`as_json`."""
        starts = (
            StartSummary(
                scan,
                time,
                Outcome(outcome),
                pure,
                *(math.nan if value is None else value for value in more),
            )
            for scan, time, outcome, pure, *more in content["starts"]
        )
        scans = (ScanSummary(*values[:-3], *map(tuple, values[-3:])) for values in content["scans"])
        return cls(content["targets"], tuple(starts), tuple(scans))


def summarise_measures(run: SimulatedRun) -> RunMeasures:
    """Judge the starts of a run and summarise it; what was before its targets is left out."""
    first = run.scenario.warm_up
    judged, corrected = (
        [
            (scan - first, judged_start)
            for (scan, _), judged_start in zip(
                tracks, run.judge([t for _, t in tracks]), strict=True
            )
            if scan >= first
        ]
        for tracks in (run.starts, run.corrections)
    )
    true = [
        (scan, judged_start.target)
        for scan, judged_start in [*judged, *corrected]
        if judged_start.outcome in (Outcome.TRUE, Outcome.REDUNDANT)
    ]
    false = [scan for scan, judged_start in judged if judged_start.outcome is Outcome.FALSE]
    near = [(scan, target) for scan, judged_start in judged for target in judged_start.at]
    clear = ClearMot(0.0)
    return RunMeasures(
        targets=len(run.simulator.targets),
        starts=tuple(
            _measured_start_summary(run, judged_start, scan)
            for scan, judged_start in judged
            if judged_start.outcome is not Outcome.FALSE
        ),
        scans=tuple(
            ScanSummary(
                false=false.count(scan),
                held=_measured_targets_held(run, scan),
                at=_measured_so_far(near, scan),
                corrections=[at for at, _ in corrected].count(scan),
                right=_measured_so_far(true, scan),
                measured=run.measured[first + scan],
                **_measured_distances(run, first + scan, clear),
            )
            for scan in range(run.scenario.scans)
        ),
    )


def _measured_so_far(events: Sequence[tuple[int, int]], scan: int) -> int:
    """Number of targets with an event, a scan and a target, up to a scan."""
    return len({target for at, target in events if at <= scan})


def _measured_start_summary(run: SimulatedRun, judged: Judged, scan: int) -> StartSummary:
    bound = measured_start_bound(run, judged)
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


def measured_start_bound(run: SimulatedRun, judged: Judged) -> FloatArray:
    """Cramer-Rao bound of a start, (4, 4), for hits at the target's true positions.

    nan unless all hits are the target's and from two scans or more.
    """
    if (
        not judged.pure
        or judged.target == NO_TARGET
        or len({scan for scan, _ in judged.track.hits}) < 2
    ):
        return np.full((4, 4), np.nan)
    echoes = (_measured_echo(run, scan, row) for scan, row in judged.track.hits)
    times, sensors, velocities = zip(*echoes, strict=True)
    states = np.array([run.simulator.truth(time)[judged.target] for time in times])
    return cramer_rao_measure(
        states[:, 0::2],
        times,
        sensors,
        [run.scenario.of_each[run.scans[scan].sensor].sensor for scan, _ in judged.track.hits],
        judged.track.stamp,
        states[:, 1::2] - velocities,
    )


def _measured_echo(
    run: SimulatedRun, scan_index: int, row: int
) -> tuple[float, FloatArray, FloatArray]:
    """Time (s) of a detection, and the sensor's position and velocity then, (2,) each."""
    scan = run.scans[scan_index]
    offset = 0.0 if scan.time_offset is None else float(scan.time_offset[row])
    poses = np.broadcast_to(scan.sensor_pose, (len(scan), 3))
    velocities = np.broadcast_to(scan.sensor_velocity, (len(scan), 2))
    return scan.stamp + offset, poses[row, :2], velocities[row]


def _measured_targets(run: SimulatedRun, index: int) -> tuple[FloatArray, FloatArray]:
    """Positions (m, 2) of the targets in a scan, and 3 sigma of the measurement there, (m,), m."""
    stamp = run.scans[index].stamp
    targets = run.simulator.truth(stamp)
    limits = [simulated_limit(run.scenario, target, stamp) for target in targets]
    return targets[:, 0::2], np.array(limits)


def _measured_targets_held(run: SimulatedRun, scan: int) -> int:
    """Targets with a confirmed track within 3 sigma; -1 if the starter holds no tracks."""
    index = run.scenario.warm_up + scan
    held, (targets, limits) = run.held[index], _measured_targets(run, index)
    if held is None or not len(targets):
        return -1
    offset = held[:, None, :] - targets
    near = np.hypot(offset[..., 0], offset[..., 1]) <= limits
    return int(near.any(axis=0).sum())


def _measured_distances(
    run: SimulatedRun, index: int, clear: ClearMot
) -> dict[str, tuple[float, ...]]:
    """Distances of the confirmed tracks from the targets after a scan; `clear` takes it."""
    held, ids, (targets, limits) = (
        run.held[index],
        run.held_ids[index],
        _measured_targets(run, index),
    )
    if held is None or not len(targets):
        return {}
    clear.gate = float(limits.mean())
    parts = gospa(held, targets, clear.gate)
    counts: tuple[float, ...] = ()
    if ids is not None:
        own = dict(zip(ids, held, strict=True))
        counts = tuple(vars(clear.take(dict(enumerate(targets)), own)).values())
    return {"distances": (ospa(held, targets, clear.gate), *vars(parts).values()), "clear": counts}


def _shown(heading: str, spec: str) -> dict[str, str]:
    """Metadata of a field: its heading in tables and its number format."""
    return {"heading": heading, "spec": spec}


@dataclass(frozen=True, kw_only=True)
class Measures:
    """Measures of a method over the runs of a scenario.

    *Pure* starts have all hits from one target. Redundant starts are excluded; misplaced starts
    are included, since without them the errors would be cut off at 3 sigma.

    Attributes
    ----------
    runs, scans : int
    found : IntervalEstimate
        P_DT: share of (run, target) pairs with a true start by the end of the run.
    found_by_position : IntervalEstimate
        Share of pairs with a start within 3 sigma of the target, whatever its hits.
    found_corrected : IntervalEstimate
        Share of pairs with a true start, or a track that a later start made true. All other
        measures are of starts as first published.
    corrections_per_run : IntervalEstimate
    false_per_run, false_density, false_per_hour : IntervalEstimate
        False and misplaced starts: per run, per scan and km^2 of coverage, and per hour.
    redundant_per_run : IntervalEstimate
    held : IntervalEstimate
        Share of targets with a confirmed track within 3 sigma at the end.
    confirmation_time, confirmation_median, confirmation_95 : IntervalEstimate
        Time from the first scan to the true starts, s: mean, median and 95 % quantile.
    position_error, velocity_error : IntervalEstimate
        Root mean square over the true starts, m and m/s.
    pure_position_error, pure_velocity_error : IntervalEstimate
        Root mean square over the pure starts, m and m/s.
    position_to_bound, velocity_to_bound : IntervalEstimate
        Errors of the pure starts over the root mean square of their Cramer-Rao bounds.
    nees, pure_nees : IntervalEstimate
        Mean over the true and over the pure starts; 4 is ideal.
    ospa : IntervalEstimate
        OSPA of the confirmed tracks, mean over the scans, m; the cutoff is 3 sigma.
    gospa, gospa_localisation, gospa_missed, gospa_false : IntervalEstimate
        GOSPA of the confirmed tracks, root mean square over the scans, m, and its parts, whose
        squares add up to its square.
    mota, motp : IntervalEstimate
        Accuracy and precision (m) of CLEAR-MOT.
    switches_per_run : IntervalEstimate
        Identity switches of CLEAR-MOT.
    outside : mapping of str to IntervalEstimate
        Measures from outside, means over the scans.
    """

    runs: int
    scans: int
    found: IntervalEstimate = field(metadata=_shown("P_DT", ".4f"))
    found_by_position: IntervalEstimate = field(metadata=_shown("P_DT by position", ".4f"))
    found_corrected: IntervalEstimate = field(metadata=_shown("P_DT with corrections", ".4f"))
    corrections_per_run: IntervalEstimate = field(metadata=_shown("corrections per run", ".2f"))
    false_per_run: IntervalEstimate = field(metadata=_shown("false + misplaced per run", ".2f"))
    false_density: IntervalEstimate = field(
        metadata=_shown("false + misplaced per scan and km^2", ".3g")
    )
    false_per_hour: IntervalEstimate = field(metadata=_shown("false + misplaced per hour", ".1f"))
    redundant_per_run: IntervalEstimate = field(metadata=_shown("redundant per run", ".2f"))
    held: IntervalEstimate = field(metadata=_shown("targets held at the end", ".4f"))
    confirmation_time: IntervalEstimate = field(metadata=_shown("time to confirm, mean [s]", ".1f"))
    confirmation_median: IntervalEstimate = field(
        metadata=_shown("time to confirm, median [s]", ".0f")
    )
    confirmation_95: IntervalEstimate = field(
        metadata=_shown("time to confirm, 95 % quantile [s]", ".0f")
    )
    position_error: IntervalEstimate = field(metadata=_shown("position error, RMS [m]", ".1f"))
    velocity_error: IntervalEstimate = field(metadata=_shown("velocity error, RMS [m/s]", ".2f"))
    pure_position_error: IntervalEstimate = field(
        metadata=_shown("position error of pure starts, RMS [m]", ".1f")
    )
    pure_velocity_error: IntervalEstimate = field(
        metadata=_shown("velocity error of pure starts, RMS [m/s]", ".2f")
    )
    position_to_bound: IntervalEstimate = field(
        metadata=_shown("position error / Cramer-Rao bound", ".3f")
    )
    velocity_to_bound: IntervalEstimate = field(
        metadata=_shown("velocity error / Cramer-Rao bound", ".3f")
    )
    nees: IntervalEstimate = field(metadata=_shown("NEES of true starts (ideal 4)", ".2f"))
    pure_nees: IntervalEstimate = field(metadata=_shown("NEES of pure starts (ideal 4)", ".2f"))
    ospa: IntervalEstimate = field(metadata=_shown("OSPA [m]", ".1f"))
    gospa: IntervalEstimate = field(metadata=_shown("GOSPA, RMS [m]", ".1f"))
    gospa_localisation: IntervalEstimate = field(metadata=_shown("of it localisation [m]", ".1f"))
    gospa_missed: IntervalEstimate = field(metadata=_shown("of it missed [m]", ".1f"))
    gospa_false: IntervalEstimate = field(metadata=_shown("of it false [m]", ".1f"))
    mota: IntervalEstimate = field(metadata=_shown("MOTA", ".3f"))
    motp: IntervalEstimate = field(metadata=_shown("MOTP [m]", ".1f"))
    switches_per_run: IntervalEstimate = field(metadata=_shown("identity switches per run", ".2f"))
    outside: Mapping[str, IntervalEstimate] = field(default_factory=dict)

    def estimate(self, name: str) -> IntervalEstimate:
        """A measure of the package or from outside."""
        return self.outside[name] if name in self.outside else getattr(self, name)

    def text(self, name: str, *, interval: bool = True) -> str:
        """A measure as text in its format, or a dash without a value."""
        text = self.estimate(name).text(SPECS.get(name, ".4g"))
        return text if interval else text.partition(" ")[0]


HEADINGS, SPECS = (
    {part.name: part.metadata[key] for part in fields(Measures) if part.metadata}
    for key in ("heading", "spec")
)
"""Heading and number format of each measure."""


def measures_of(
    scenario: Scenario,
    runs: Iterable[RunMeasures],
    scans: int | None = None,
    outside: Sequence[str] = (),
) -> Measures:
    """Measures of a method over runs.

    Parameters
    ----------
    scenario : Scenario
    runs : iterable of RunMeasures
    scans : int, optional
        Number of scans after which the runs end; the scenario's if not given.
    outside : sequence of str, optional
        Names of the measures from outside.
    """
    scans = scenario.scans if scans is None else scans
    runs = [run.first(scans) for run in runs]
    starts = [start for run in runs for start in run.starts]
    true = [start for start in starts if start.outcome is Outcome.TRUE]
    pure = [start for start in starts if start.pure and start.outcome is not Outcome.REDUNDANT]
    times = [start.time for start in true]
    return Measures(
        runs=len(runs),
        scans=scans,
        **_measured_counts(scenario, runs, scans),
        confirmation_time=mean_interval(times),
        confirmation_median=quantile_interval(times, 0.5),
        confirmation_95=quantile_interval(times, 0.95),
        **_measured_errors(true, pure),
        **_measured_tracking(runs),
        outside={
            name: mean_interval(_finite_means(runs, place)) for place, name in enumerate(outside)
        },
    )


def _finite_means(runs: Sequence[RunMeasures], place: int) -> list[float]:
    """Mean of a measure from outside over the scans of each run that have a finite value."""
    values = ([scan.measured[place] for scan in run.scans if scan.measured] for run in runs)
    finite = ([value for value in run if math.isfinite(value)] for run in values)
    return [math.fsum(run) / len(run) for run in finite if run]


def _measured_tracking(runs: Sequence[RunMeasures]) -> dict[str, IntervalEstimate]:
    """OSPA, GOSPA and CLEAR-MOT; without a value if the confirmed tracks are not known."""
    known = [[scan.distances for scan in run.scans if scan.distances] for run in runs]
    means = np.array([np.mean(run, axis=0) for run in known if run]).reshape(-1, 4)
    clear = [[ClearMotCounts(*scan.clear) for scan in run.scans if scan.clear] for run in runs]  # type: ignore[arg-type]
    counts = [ClearMotCounts.total(run) for run in clear if run]
    return {
        "ospa": mean_interval(means[:, 0]),
        "gospa": root_mean_square_interval(np.sqrt(means[:, 1:].sum(axis=1))),
        "gospa_localisation": root_mean_square_interval(np.sqrt(means[:, 1])),
        "gospa_missed": root_mean_square_interval(np.sqrt(means[:, 2])),
        "gospa_false": root_mean_square_interval(np.sqrt(means[:, 3])),
        "mota": ratio_interval([run.right for run in counts], [run.targets for run in counts]),
        "motp": ratio_interval([run.distance for run in counts], [run.matches for run in counts]),
        "switches_per_run": mean_count_interval([run.switches for run in counts]),
    }


def _measured_counts(
    scenario: Scenario, runs: Sequence[RunMeasures], scans: int
) -> dict[str, IntervalEstimate]:
    false = mean_count_interval([run.wrong for run in runs])
    targets = sum(run.targets for run in runs)
    held = [run.scans[-1].held for run in runs]
    corrections = [sum(scan.corrections for scan in run.scans) for run in runs]
    return {
        "found": proportion_interval(sum(run.count(Outcome.TRUE) for run in runs), targets),
        "found_by_position": proportion_interval(sum(run.scans[-1].at for run in runs), targets),
        "found_corrected": proportion_interval(sum(run.scans[-1].right for run in runs), targets),
        "corrections_per_run": mean_count_interval(corrections),
        "false_per_run": false,
        "false_density": false / (scans * scenario.area / 1e6),
        "false_per_hour": false.mapped(lambda v: v * SECONDS_PER_HOUR / (scans * scenario.period)),
        "redundant_per_run": mean_count_interval([run.count(Outcome.REDUNDANT) for run in runs]),
        "held": proportion_interval(sum(held), targets)
        if min(held) >= 0
        else IntervalEstimate.unknown(),
    }


def _measured_errors(
    true: Sequence[StartSummary], pure: Sequence[StartSummary]
) -> dict[str, IntervalEstimate]:
    bounded = [start for start in pure if not math.isnan(start.position_bound)]
    return {
        "position_error": root_mean_square_interval([start.position_error for start in true]),
        "velocity_error": root_mean_square_interval([start.velocity_error for start in true]),
        "pure_position_error": root_mean_square_interval([start.position_error for start in pure]),
        "pure_velocity_error": root_mean_square_interval([start.velocity_error for start in pure]),
        "position_to_bound": rms_ratio_interval(
            [start.position_error for start in bounded],
            [start.position_bound for start in bounded],
        ),
        "velocity_to_bound": rms_ratio_interval(
            [start.velocity_error for start in bounded],
            [start.velocity_bound for start in bounded],
        ),
        "nees": mean_interval([start.nees for start in true]),
        "pure_nees": mean_interval([start.nees for start in pure]),
    }


def measured_closest_approach(relative: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Time until two targets on straight courses are closest, and their distance then.

    ``T_cpa = -r.v / |v|^2``, ``d_cpa = |r + v T_cpa|``.

    Parameters
    ----------
    relative : (..., 4) ndarray
        State of one target less that of the other, at a common time.

    Returns
    -------
    time : (...) ndarray
        s; below 0 where they separate, 0 where they do not move against each other.
    distance : (...) ndarray
        m.
    """
    position, velocity = relative[..., 0::2], relative[..., 1::2]
    square = np.square(velocity).sum(axis=-1)
    approach = -(position * velocity).sum(axis=-1)
    time = np.divide(approach, square, out=np.zeros_like(square), where=square > 0.0)
    then = motion.position_after(relative, time)
    return time, np.asarray(np.hypot(then[..., 0], then[..., 1]))
