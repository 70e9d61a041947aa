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
"""Content of a plan-position picture of a run, by scan."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from tsepm_ros.numerics.arrays import FloatArray, IntArray
from tsepm_ros.session.inputs import Arrival
from tsepm_ros.session.session import ScanResult
from tsepm_ros.tools.evaluation.simulated_run import (
    Judged,
    Outcome,
    judge_simulated_starts,
    simulated_origins_of,
)
from tsepm_ros.tools.replay.recording import Recording
from tsepm_ros.tools.simulation import Simulator
from tsepm_ros.tracker.measurement import convert_measurements
from tsepm_ros.tracker.scan import Scan
from tsepm_ros.tracker.sensor import SensorModel
from tsepm_ros.tracker.tracks import ConfirmedTrack, TrackArrays

ROUND_SECONDS = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 30.0, 60.0, 120.0, 300.0, 600.0)


@dataclass(frozen=True)
class SceneScan:
    """One scan in the fixed frame.

    Attributes
    ----------
    stamp : float
        s.
    detections : (n, 2) ndarray
        Positions, m.
    sensor : (3,) ndarray or None
        Position of the sensor at the nearest echo, m, and the heading of the vessel, rad, nan if
        unknown; None without a sensor pose.
    new, held : TrackArrays
        Tracks confirmed in this scan; all confirmed tracks after it.
    fixed_echoes : (n, 2) ndarray
        Positions of fixed echoes, with `min_speed`, m.
    restart : bool
        All tracks were discarded before this scan, and the scans of hits count from it.
    name : str
        Of the sensor, of several.
    """

    stamp: float
    detections: FloatArray
    sensor: FloatArray | None
    new: TrackArrays
    held: TrackArrays
    fixed_echoes: FloatArray = field(default_factory=lambda: np.zeros((0, 2)))
    restart: bool = False
    name: str = ""

    @classmethod
    def of(
        cls, result: ScanResult, sensor: SensorModel, mounting_yaw: float | None = 0.0
    ) -> SceneScan:
        """View of a processed scan.

        `mounting_yaw` is that of `scene_vessel_pose`.
        """
        return cls(
            stamp=result.stamp,
            detections=convert_measurements(result.scan, sensor, 0)["position"],
            sensor=scene_vessel_pose(result.scan, mounting_yaw),
            new=result.new,
            held=result.current.sure,
            fixed_echoes=result.fixed_echoes.state[:, 0::2].reshape(-1, 2),
            restart=result.arrival is Arrival.RESTART,
            name=result.scan.sensor,
        )


@dataclass
class RunScene:
    """A whole run.

    Attributes
    ----------
    title : str
        Source and method.
    scans : list of SceneScan
        In the order in which they were processed.
    truth : list of (m, 3) ndarray
        Time (s), x and y (m) of each target.
    judged : list of Judged, optional
        Outcome of each start, if the origin of the detections is known.
    """

    title: str
    scans: list[SceneScan] = field(default_factory=list)
    truth: list[FloatArray] = field(default_factory=list)
    judged: list[Judged] | None = None

    def judge(
        self, simulator: Simulator, recording: Recording, origins: Sequence[IntArray]
    ) -> None:
        """Judge the starts by the truth.

        Parameters
        ----------
        simulator : Simulator
        recording : Recording
        origins : sequence of (n,) ndarray of int
            As `simulated_recording` returns them; scans that were dropped are not in the scene.
        """
        of_sensors = {}
        for name in {view.name for view in self.scans}:
            rows = [row for row, scan in enumerate(recording.scans) if scan.sensor == name]
            processed = [view.stamp for view in self.scans if view.name == name]
            stamps = [recording.scans[row].time for row in rows]
            found = simulated_origins_of(processed, stamps, [origins[row] for row in rows])
            of_sensors[name] = iter(found)
        of_scans = [next(of_sensors[view.name]) for view in self.scans]
        self.judged = judge_simulated_starts(simulator, self.starts, of_scans)

    @property
    def starts(self) -> list[ConfirmedTrack]:
        """All confirmed tracks, with their states at confirmation."""
        return [track for view in self.scans for track in view.new]

    def starts_by(self, true: bool) -> list[ConfirmedTrack]:
        """True starts, or those with another outcome; starts without judgement count as true."""
        if self.judged is None:
            return self.starts if true else []
        return [start.track for start in self.judged if (start.outcome is Outcome.TRUE) is true]

    @property
    def true_starts(self) -> dict[int, Judged]:
        """The true start of each target that has one, by the target's index."""
        return {start.target: start for start in self.judged or [] if start.outcome is Outcome.TRUE}

    @property
    def true_places(self) -> FloatArray:
        """Place of each target with a true start at the time of that start, (n, 2) m.

        nan outside of the time of the target's path.
        """
        starts = [
            (self.truth[target], start.track.stamp) for target, start in self.true_starts.items()
        ]
        return np.array(
            [
                [np.interp(stamp, path[:, 0], axis, np.nan, np.nan) for axis in path[:, 1:].T]
                for path, stamp in starts
            ]
        ).reshape(-1, 2)

    @property
    def start_scans(self) -> dict[int, int]:
        """Number of the scan, from 1, that confirmed each start, by the track's id."""
        return {
            track_id: number
            for number, view in enumerate(self.scans, start=1)
            for track_id in view.new.track_id.tolist()
        }

    @property
    def hits(self) -> dict[int, FloatArray]:
        """Hits of each start, oldest first, by the track's id.

        Each is an (m, 3) array: number of the scan, from 1, x and y (m).
        """
        first, hits = 0, {}
        for index, view in enumerate(self.scans):
            if view.restart:
                first = index
            for track in view.new:
                places = [
                    (first + scan + 1, *self.scans[first + scan].detections[row])
                    for scan, row in track.hits
                    if first + scan <= index and row < len(self.scans[first + scan].detections)
                ]
                hits[track.track_id] = np.array(places).reshape(-1, 3)
        return hits

    def ways(self) -> dict[int, FloatArray]:
        """Way of each confirmed track by its id.

        Each is an (m, 3) array: x and y (m), and the time since its target was detected (s). A row
        of nan stands for scans in which the track coasted or stood still.
        """
        ways: dict[int, list[list[float]]] = {}
        before: set[int] = set()
        for view in self.scans:
            points = np.column_stack([view.held.state[:, 0::2], view.held.time_since_hit])
            for track_id, point in zip(view.held.track_id.tolist(), points.tolist(), strict=True):
                way = ways.setdefault(track_id, [])
                way += [point] if track_id in before or not way else [[np.nan] * 3, point]
            before = set(view.held.track_id.tolist())
        return {track_id: np.array(way) for track_id, way in ways.items()}

    @property
    def detections(self) -> FloatArray:
        """Positions of the detections of all scans, (n, 2) m."""
        return np.concatenate([np.zeros((0, 2)), *(view.detections for view in self.scans)])

    @property
    def own_ship(self) -> FloatArray:
        """Path of the sensor, (m, 3): x, y (m) and heading (rad, nan if unknown)."""
        return np.array([view.sensor for view in self.scans if view.sensor is not None]).reshape(
            -1, 3
        )


def scene_headline(scene: RunScene) -> str:
    """The result of a run in a sentence, such as "4 of 4 targets in 11 pings, no false track"."""
    pings = _pings(len(scene.scans))
    if scene.judged is None:
        held = f"{len(scene.scans[-1].held) if scene.scans else 0} held at the end"
        return f"{_tracks(len(scene.starts))} in {pings}, {held}"
    starts, start_scans = scene.true_starts, scene.start_scans
    if starts:
        last = max(start_scans[judgement.track.track_id] for judgement in starts.values())
        pings = _pings(last)
    counts = Counter(judgement.outcome for judgement in scene.judged)
    others = [outcome for outcome in (Outcome.MISPLACED, Outcome.REDUNDANT) if counts[outcome]]
    return ", ".join(
        [
            f"{len(starts)} of {len(scene.truth)} targets in {pings}",
            _tracks(counts[Outcome.FALSE], "false "),
            *(f"{counts[outcome]} {outcome.value}" for outcome in others),
        ]
    )


def _pings(number: int) -> str:
    return f"{number} ping{'' if number == 1 else 's'}"


def _tracks(number: int, kind: str = "") -> str:
    return f"{number or 'no'} {kind}track{'' if number == 1 or not number else 's'}"


def scene_target_name(index: int) -> str:
    """Name of a target in tables and pictures: A to Z, then by number. Tracks have numbers."""
    return chr(ord("A") + index) if index < 26 else f"T{index}"


def scene_velocity_seconds(scene: RunScene) -> float:
    """Time of the velocity arrows, s, round: a fast track's arrow is a 30th of the scene."""
    everything = np.concatenate([scene.detections, *(path[:, 1:] for path in scene.truth)])
    speeds = [float(np.hypot(*track.velocity)) for track in scene.starts]
    if not len(everything) or not speeds:
        return 60.0
    extent = float(np.ptp(everything, axis=0).max())
    wanted = extent / 30.0 / max(float(np.quantile(speeds, 0.9)), 1e-3)
    return max((second for second in ROUND_SECONDS if second <= wanted), default=ROUND_SECONDS[0])


def scene_vessel_pose(scan: Scan, mounting_yaw: float | None) -> FloatArray | None:
    """Position of the sensor at the nearest echo, and the heading of the vessel.

    Parameters
    ----------
    scan : Scan
        Registered in the fixed frame.
    mounting_yaw : float or None
        Angle from the bow to the sensor's azimuth 0, rad; None if the detections need no heading
        and the poses have none.

    Returns
    -------
    (3,) ndarray or None
        x, y (m) and heading (rad), nan if unknown; None without a sensor pose.
    """
    poses = np.reshape(scan.sensor_pose, (-1, 3))
    if not len(poses):
        return None
    times = None if len(poses) == 1 else scan.time_offset
    nearest = 0 if times is None else int(np.argmin(times))
    yaw = np.nan if mounting_yaw is None else mounting_yaw
    return np.asarray(poses[nearest] - [0.0, 0.0, yaw])
