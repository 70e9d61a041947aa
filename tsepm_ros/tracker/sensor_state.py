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
"""What belongs to a sensor: its model, its last scan, and everything that is learned of it."""

from __future__ import annotations

import copy
import math
from collections import deque
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from tsepm_ros.numerics.arrays import (
    BoolArray,
    FloatArray,
    IntArray,
    RecordArray,
    appended,
    replaced,
    rows_of,
)
from tsepm_ros.tracker import motion, range_rates
from tsepm_ros.tracker.clusters.extended_targets import ExtendedTargets
from tsepm_ros.tracker.clusters.grouping import Clusters
from tsepm_ros.tracker.clutter.amplitude_law import ScanAmplitudes
from tsepm_ros.tracker.clutter.excess import PATH_SCANS, ConfirmedTargets
from tsepm_ros.tracker.clutter.fixed_places import LandMask
from tsepm_ros.tracker.clutter.learned import ClutterUse, Surroundings
from tsepm_ros.tracker.clutter.sensor_performance import FACTOR_STEP
from tsepm_ros.tracker.maintenance.confirmed_tracks import ConfirmedTracks
from tsepm_ros.tracker.maintenance.track_maintenance import TrackMaintenance
from tsepm_ros.tracker.measurement import (
    LEAST_ACROSS,
    MeasurementWindow,
    convert_measurements,
    measured_polar,
)
from tsepm_ros.tracker.method import Method
from tsepm_ros.tracker.options import GATE_PROBABILITY
from tsepm_ros.tracker.scan import (
    MIN_STANDING,
    Scan,
    check_scan,
    scan_of_rows,
    scan_positions,
    wrap,
)
from tsepm_ros.tracker.sensor import (
    EchoPoses,
    Picture,
    RangeErrors,
    SensorModel,
    SensorView,
    echo_poses,
    inside_coverage,
    scan_looked_at,
)
from tsepm_ros.tracker.sensor_alignment import (
    Alignment,
    Sightings,
)
from tsepm_ros.tracker.tracks import TrackArrays

SILENT_INTERVALS, FIRST_INTERVAL = 5.0, 12.0
"""Median intervals after which a sensor without a scan no longer counts, and the interval, s, of a
sensor of a single scan: choices."""
SCANS_BETWEEN_ERROR_UPDATES = 2, 32
"""Scans between two looks at the errors that tracks show, before enough are known, and later."""


class ClutterBefore(NamedTuple):
    """The clutter at the detections (d,) of a scan, as it is known before the scan.

    Attributes
    ----------
    density : (d,) ndarray
        1/m^2, times that of the range rates.
    of_rates : (d,) ndarray
        Density of the range rates, s/m, where they are used; else 1.
    sensor : SensorModel
        With the range rates of clutter.
    amplitudes : ScanAmplitudes or None
        What the amplitudes say; None where they do not count.
    """

    density: FloatArray
    of_rates: FloatArray
    sensor: SensorModel
    amplitudes: ScanAmplitudes | None


class SensorState:
    """A sensor of the picture, as of its last scan.

    Parameters
    ----------
    model : SensorModel
        As given.
    method : Method
        Its options tell what is learned.
    number : int, optional
        Of the sensor in the picture, from 0.

    Attributes
    ----------
    model : SensorModel
        As given.
    sensor_in_use : SensorModel
        With the errors that confirmed tracks show.
    learned : Surroundings
        Models of the surroundings, learned from the sensor's scans.
    extended_targets : ExtendedTargets
        Makes clusters of the detections.
    scan : Scan
        The last one.
    scans : int
        Number of scans.
    in_window : deque of int
        Numbers of the last scans of a window, in the picture.
    poses : EchoPoses
        Of the last scan.
    clutter : ScanClutter
        At the detections of the last scan.
    received : dict
        Counts of the last scan's detections, fields of `ScanStatistics`.
    seen : dict of int to float
        Stamp of the last detection of each track, s, by the ids of these, of several sensors.
    alignment : Alignment
        How its detections lie beside tracks that other sensors see, too.
    own_detections : list of tuple of ndarray
        Tracks (k,) and a detection of each that is its own, to learn the errors from.
    """

    def __init__(self, model: SensorModel, method: Method, number: int = 0) -> None:
        self.model, self.learned, self.number = model, Surroundings.initial(model), number
        self.extended_targets = ExtendedTargets(model, method.common)
        self.in_window: deque[int] = deque()
        self.use(method, np.zeros(2, np.int64))
        self.scan, self.scans = Scan(0.0, np.zeros(0), np.zeros(0)), 0
        self.poses = EchoPoses(np.zeros(1), np.zeros((1, 3)))
        self.received: dict[str, int] = {}
        self.seen: dict[int, float] = {}
        self.alignment = Alignment()
        self._pose_before: tuple[float, FloatArray] | None = None
        self.own_detections: list[tuple[IntArray, RecordArray]] = []
        self.clutter = self.learned.at(self._clutter_use, (self.scan.range, self.scan.azimuth))

    def use(self, method: Method, steps: IntArray) -> None:
        """Take the options of a method; the errors begin with the steps (2,) from those given."""
        self.common, self._learns_from_confirmed = method.common, method.learns_from_confirmed
        estimated = self.common.clutter_density == "estimated"
        given = None if estimated else self.model.clutter_density
        self._clutter_use = ClutterUse(given, estimated and self._learns_from_confirmed)
        # The ratio of a target's amplitudes to the clutter's is one sensor's.
        self._alone = method.sensors == 1
        self._amplitudes_count = self.common.intensity == "auto" and self._learns_from_confirmed
        self._amplitudes_count &= self._alone
        self.in_window = deque(self.in_window, getattr(method.options, "window", None))
        self.sensor_in_use, self._steps, self._due = self._sensor_after(steps), steps, 0

    def under(self, model: SensorModel, method: Method) -> SensorState:
        """The state for another model or another method; what was learned and still holds stays."""
        other = copy.copy(self)
        other.model, other.learned = model, self.learned.under(model, self.model)
        other.extended_targets = self.extended_targets.under(model, method.common)
        other.use(
            method,
            self._steps
            * (
                other.learned.errors is self.learned.errors
                and method.common.sensor_errors == "learned"
            ),
        )
        return other

    @property
    def interval(self) -> float:
        """Median time between the last scans, s; 0 while it is unknown."""
        return self.learned.scan_interval.median

    @property
    def reach(self) -> float:
        """Distance that a target moves at most from scan to scan, m."""
        return self.common.max_speed * self.learned.scan_interval.median

    def lives(self, stamp: float) -> bool:
        """Whether the sensor is not silent at a time, s: for `SILENT_INTERVALS` intervals."""
        late = SILENT_INTERVALS * (self.interval or FIRST_INTERVAL)
        return self.scans > 0 and stamp - self.scan.stamp <= late

    # Measure.

    def measure(self, scan: Scan, scan_index: int, land: LandMask | None) -> RecordArray:
        """The detections in the coverage and not on land, or their clusters, in the fixed frame."""
        last = self.scan.stamp if self.scans else scan.stamp
        self.learned.scan_interval.update(scan.stamp - last)
        self.poses, self.scan = echo_poses(scan) or self.poses, scan
        if self.scans >= self._due:
            self._follow_errors()
        self.scans += 1
        self.in_window.append(scan_index)
        used, number = inside_coverage(scan, self.model), len(scan.range)
        covered = int(np.count_nonzero(used))
        if land is not None:
            used &= ~land.covers(scan_positions(scan))
        rows = used.nonzero()[0]
        self.received = {
            "detections": len(rows),
            "outside_coverage": number - covered,
            "on_land": covered - len(rows),
        }
        covered_scan = scan if len(rows) == number else scan_of_rows(scan, rows)
        if covered < number:
            self.learned.all_extent.update(scan.range, scan.azimuth, np.ones(number))
        runs = self.extended_targets.runs_of(covered_scan)
        detections = self._converted(covered_scan, scan_index, rows, runs)
        measured = covered_scan if runs is None else runs.scan
        made = self.extended_targets.clusters_of(measured, self.clutter.is_fixed)
        if made is not None:
            clusters = made if runs is None else made.traced_through(runs)
            detections = self._converted(covered_scan, scan_index, rows, clusters)
        return detections

    def _converted(
        self, scan: Scan, scan_index: int, rows: IntArray, clusters: Clusters | None
    ) -> RecordArray:
        """The detections or clusters of a scan in the fixed frame, with the clutter at them."""
        measured = scan if clusters is None else clusters.scan
        as_stated = scan.azimuth_std is not None or not self._learns_from_confirmed
        own = np.zeros(len(measured.range), bool) if clusters is None else clusters.own_range_std
        least = np.where(own | as_stated, 0.0, LEAST_ACROSS)
        detections = convert_measurements(
            measured, self.sensor_in_use, scan_index, least, self.number
        )
        polar = measured.range, measured.azimuth
        self.clutter = self.learned.at(self._clutter_use, polar, detections)
        detections["index"] = rows if clusters is None else rows[clusters.strongest]
        if clusters is not None and scan.range_std is None:
            detections["range_std"][~own] = np.nan
        return detections

    def clutter_at(
        self, detections: RecordArray, confirmed: ConfirmedTracks, most_hits: int
    ) -> ClutterBefore:
        """The clutter at the detections (d,), with confirmed tracks as of the last scan.

        Their amplitudes are judged, see `ClutterAmplitudes.judge`.
        """
        amplitudes, sensor, learned = None, self.sensor_in_use, self.learned
        if self._amplitudes_count:
            cells, (range_, _) = self.clutter.cells, self.clutter.polar
            amplitudes = learned.amplitudes.judge(detections, most_hits, cells, range_)
        of_rates = np.ones(len(detections))
        if sensor.range_rate_std:
            if self.common.clutter_density == "estimated":
                sensor = learned.clutter_range_rates.estimate(detections, sensor)
            of_rates = range_rates.clutter_density(detections, sensor)
        density = learned.before(self._clutter_use, self.clutter, self._targets(confirmed))
        return ClutterBefore(density * of_rates, of_rates, sensor, amplitudes)

    def standing(self, detections: RecordArray) -> BoolArray:
        """Which detections (d,) stand, and start no track; unknown says nothing."""
        stands = np.zeros(len(detections), bool)
        if self.common.start_standing == "off" and "standing" in self.scan.features:
            stands = self.scan.features["standing"][detections["index"]] >= MIN_STANDING
        self.received["standing"] = int(np.count_nonzero(stands))
        return stands

    def _targets(self, confirmed: ConfirmedTracks) -> ConfirmedTargets:
        """Confirmed tracks in the sensor's frame."""
        range_, azimuth = self.poses.polar(confirmed.tracks.state[:, 0::2])
        return ConfirmedTargets(confirmed.tracks.track_id, range_, azimuth, confirmed.existence)

    # Learn.

    def learn(
        self, detections: RecordArray, confirmed: FloatArray, maintenance: TrackMaintenance
    ) -> None:
        """Learn from a scan whose detections (d,) are confirmed tracks' with a probability (d,)."""
        tracks, learned, reach = maintenance.confirmed, self.learned, self.reach
        moves, targets = tracks.fits.moves, self._targets(tracks)
        weight = 1.0 - confirmed if self._learns_from_confirmed else np.ones(len(confirmed))
        self.clutter = learned.learn(
            self._clutter_use,
            self.clutter,
            self.scan.stamp,
            SensorView(
                self.model,
                tuple(self.poses.middle.tolist()),
                None if self.scan.swept is None else tuple(self.scan.swept.tolist()),
            ),
            weight,
            # In an area within the reach of one target while a hypothesis of it lives.
            math.pi * (reach * PATH_SCANS) ** 2,
            targets,
            maintenance.detections_of(moves),
        )
        whole = learned.batch.is_new
        if self.own_detections and (whole or learned.errors.young):
            self._learn_errors(tracks.tracks.track_id, moves)
        if self._learns_from_confirmed:
            self.extended_targets.learn(
                maintenance.probable_detections, tracks, self.clutter_density, whole
            )
        if self._amplitudes_count:
            learned.learn_amplitudes(detections, weight, reach)

    def take_hits(self, new: TrackArrays, window: MeasurementWindow) -> None:
        """Take the hits of new tracks, to learn the errors from; not of clusters."""
        if self.learned.errors.young and not self.extended_targets.active:
            track, hits = window.find(new.hits)
            mine = window.column("sensor", hits) == self.number
            self.own_detections.append((new.track_id[track[mine]], window[hits[mine]]))

    def learn_targets(self, detections: RecordArray, maintenance: TrackMaintenance) -> None:
        """Learn from the detections of confirmed tracks: P_D, and errors or the extent."""
        self.learned.detection_probability.update(*maintenance.covered, GATE_PROBABILITY)
        if self.extended_targets.active:
            innovations, rows = maintenance.innovations, maintenance.innovation_rows
            self.extended_targets.learn_scatter(*innovations, rows)
            return
        track_id, row = maintenance.own_detections
        rows = np.isnan(detections["range_std"][row]).nonzero()[0]
        if len(rows):
            self.own_detections.append((track_id[rows], rows_of(detections, row[rows])))

    def learn_alignment(
        self,
        detections: RecordArray,
        maintenance: TrackMaintenance,
        sensors: Iterable[SensorState],
    ) -> BoolArray:
        """Learn how detections lie beside tracks that other sensors see, too.

        A target that a wrong mounting doubles has a track of each sensor, see `_doubled`. Once
        enough is known, by others too, the later one of the two ends: a mask (n,).
        """
        stamp, tracks = self.scan.stamp, maintenance.confirmed.tracks
        motion_of_pose, seen = self._motion_of_pose(), self._sightings(detections, maintenance)
        rest = [one for one in sensors if one is not self and one.lives(stamp)]
        others = set[int]().union(*(one.sees(stamp) for one in rest))
        own = dict.fromkeys(maintenance.own_detections[0].tolist(), stamp)
        self.seen = self.seen_lately(stamp) | own
        doubled = np.zeros(len(tracks), bool)
        if not rest or motion_of_pose is None or not len(seen):
            return doubled
        used = np.isin(tracks.track_id[seen.track], list(others))
        row, other = self._doubled(seen, used, tracks, others, rest)
        used[row] = True
        seen.beside[row] = 0.5 * (seen.position[row] - tracks.state[other, 0::2])
        self._learn_distances(seen[used], tracks.state[:, 1::2], motion_of_pose)
        known = any(one.alignment.known for one in rest)
        doubled[np.maximum(seen.track[row], other)] = known and self.alignment.known
        return doubled

    def _motion_of_pose(self) -> FloatArray | None:
        """Velocity and turn rate since the last scan, m/s and rad/s; None where unknown."""
        stamp, pose = self.scan.stamp, self.poses.middle
        before, self._pose_before = self._pose_before, (stamp, pose)
        if before is None:
            return None
        moved = pose - before[1]
        moved[2] = wrap(moved[2])
        return np.asarray(moved / (stamp - before[0]))

    def _sightings(self, detections: RecordArray, maintenance: TrackMaintenance) -> Sightings:
        """The last scan's detections (d,) that are confirmed tracks' own."""
        (ids, rows), (innovation, _) = maintenance.own_detections, maintenance.innovations
        if len(innovation) != len(ids):  # a downstream tracker's tracks have none
            ids = ids[:0]
        tracks = maintenance.confirmed.tracks
        own, track = (ids[:, None] == tracks.track_id).nonzero()
        position = detections["position"][rows[own]]
        sight = (position - self.poses.middle[:2]) @ (1.0, 1j)
        residual = position - tracks.state[track, 0::2]
        return Sightings(track, position, sight, 0.5 * (innovation[own] + residual))

    def _doubled(
        self,
        seen: Sightings,
        shared: BoolArray,
        tracks: TrackArrays,
        others: set[int],
        rest: list[SensorState],
    ) -> tuple[IntArray, IntArray]:
        """Which detections (k,) of tracks that no other sensor sees are beside another track.

        It is the only track of others that moves alike and is as far away, where this sensor looks
        at that track without seeing it, or others at the first; see `DoubledTargets`. Returned are
        the rows of the detections and those of the other tracks.
        """
        sensor, alignment = self.sensor_in_use, self.alignment
        alone = np.flatnonzero(np.isin(tracks.track_id, list(others - self.seen.keys())))
        looked, looks = (
            np.any([one.looked_at(tracks.state[:, 0::2]) for one in who], axis=0)
            for who in (rest, [self])
        )
        deviation = np.sqrt(sensor.range_variance(np.abs(seen.sight)))
        alike, turned = seen.beside_tracks(tracks, alone, deviation)
        alike &= (looked[seen.track, None] | looks[alone]) & ~shared[:, None]
        row, column = np.nonzero(alike & (alike.sum(axis=1) == 1)[:, None])
        pairs = np.stack([seen.track[row], alone[column]])
        agree = alignment.doubled.agree(
            tracks.track_id[pairs],
            tracks.track_id,
            turned[row, column],
            sensor.azimuth_std,
            2.0 * alignment.fit[1, 0] if alignment.known else math.nan,
        )
        return row[agree], pairs[1, agree]

    def _learn_distances(
        self, seen: Sightings, velocity: FloatArray, motion_of_pose: FloatArray
    ) -> None:
        """Learn the alignment from detections beside tracks of velocities (n, 2)."""
        variances = self.model.range_variance(np.abs(seen.sight))
        speed = seen.in_sight(velocity[seen.track] - motion_of_pose[:2])
        speed[1] -= motion_of_pose[2]
        self.alignment.update(
            seen.in_sight(seen.beside),
            np.array([variances, np.full(len(variances), self.model.azimuth_std**2)]),
            float(motion.steps_of(self.interval)),
            speed,
        )

    def sees(self, stamp: float) -> set[int]:
        """Ids of the tracks that it detected lately, as of a time, s; others are forgotten."""
        self.seen = self.seen_lately(stamp)
        return set(self.seen)

    def seen_lately(self, stamp: float) -> dict[int, float]:
        """Stamps of the last detections of the tracks that it detected lately, by their ids."""
        late = stamp - SILENT_INTERVALS * self.interval
        return {key: last for key, last in self.seen.items() if last >= late}

    def _follow_errors(self) -> None:
        """Take the errors that confirmed tracks show into use, where they changed."""
        self._due = self.scans + SCANS_BETWEEN_ERROR_UPDATES[not self.learned.errors.young]
        if self.common.sensor_errors != "learned":
            return
        steps = self.learned.errors.followed(self._steps)
        if not self._alone:
            steps = np.maximum(steps, self.alignment.least_steps)
        if not np.array_equal(steps, self._steps):
            self.sensor_in_use, self._steps = self._sensor_after(steps), steps

    def _sensor_after(self, steps: IntArray) -> SensorModel:
        """The model with its errors so many steps (2,) from those given."""
        (along, turn), sensor = np.exp2(FACTOR_STEP * steps).tolist(), self.model
        return replaced(
            sensor,
            range_std=along * sensor.range_std,
            range_std_fraction=along * sensor.range_std_fraction,
            azimuth_std=turn * sensor.azimuth_std,
        )

    @property
    def errors_are_uncertain(self) -> bool:
        """Whether the errors of the last scan are followed, and too little is known of them."""
        learned = self.common.sensor_errors == "learned" and self.scan.range_std is None
        return learned and self.learned.errors.young

    def target_extent(self, positions: FloatArray) -> FloatArray:
        """Extent of targets at positions (n, 2), the largest, m."""
        extent = self.extended_targets.extent
        return np.maximum(extent.along, extent.across_at(self.poses.polar(positions)[0]))

    def _learn_errors(self, ids: IntArray, moves: BoolArray) -> None:
        """Learn the sensor's errors from confirmed tracks' detections, if these have its errors."""
        track_id, detections = zip(*self.own_detections, strict=True)
        own, self.own_detections = appended(*detections), []
        rows = np.isnan(own["range_std"]).nonzero()[0]
        own = rows_of(own, rows)
        variance = self.model.range_variance(measured_polar(own)[0])
        if self.scan.azimuth_std is None:
            own["azimuth_std"] = self.model.azimuth_std
        self.learned.errors.update(np.concatenate(track_id)[rows], own, variance, ids, moves)

    # What is in use.

    def looked_at(self, positions: FloatArray) -> BoolArray:
        """Whether the last scan looked at positions (n, 2)."""
        return scan_looked_at(self.scan, self.model, self.poses, positions)

    def detection_probability_at(
        self, positions: FloatArray, probability: float | None = None
    ) -> FloatArray:
        """Probability that a target at each position (n, 2) is detected in the last scan.

        Where the scan looked it is a given one, or that in use.
        """
        looked = scan_looked_at(self.scan, self.model, self.poses, positions)
        return np.where(
            looked, self.detection_probability if probability is None else probability, 0.0
        )

    @property
    def estimated_detection_probability(self) -> float:
        """Detection probability estimated from the confirmed tracks, whether it is used or not."""
        return self.learned.detection_probability.estimate(self.model.detection_probability)

    @property
    def detection_probability(self) -> float:
        """Detection probability in use: given or estimated."""
        stated, learned = self.model.detection_probability, self.learned.detection_probability
        return stated if self.common.detection_probability == "given" else learned.estimate(stated)

    @property
    def clutter_density(self) -> float:
        """Clutter density in use, 1/m^2: given, or the mean of the estimate over the coverage."""
        given = self.common.clutter_density == "given"
        return self.model.clutter_density if given else self.learned.clutter_map.mean

    @property
    def covered_area(self) -> float:
        """Area to which that density refers, m^2: the coverage, or where clutter is seen."""
        given = self.common.clutter_density == "given"
        return self.model.coverage_area if given else self.learned.clutter_map.seen.area

    @property
    def intensity(self) -> str:
        """Whether the amplitudes of the last scan counted, and why not, in words."""
        if self.common.intensity == "off" or not self._alone:
            return "not used: off" if self._alone else "not used: several sensors"
        return (
            self.learned.amplitudes.use if self._learns_from_confirmed else "not used by the method"
        )


class Sensors(dict[str, SensorState]):
    """The sensors of a picture, by the names that their scans have.

    Parameters
    ----------
    states : iterable of (str, SensorState)
    oldest : int, optional

    Attributes
    ----------
    oldest : int
        Oldest scan in a window of a living sensor, at the last scan.
    """

    def __init__(self, states: Iterable[tuple[str, SensorState]], oldest: int = 0) -> None:
        super().__init__(states)
        self.oldest = oldest

    def looking(self, scan: Scan, last: float | None, max_detections: int) -> SensorState:
        """The sensor of a scan, after the last one of any; an error for a scan that is not taken.

        See `Tracker.process`.
        """
        name = getattr(scan, "sensor", "")
        state = self.get(name) if name or len(self) > 1 else next(iter(self.values()))
        check_scan(scan, state.scan.stamp if state and state.scans else None, max_detections)
        if state is None:
            raise ValueError(f"sensor must be one of {[*self]}; got {name!r}")
        if last is not None and scan.stamp < last:
            raise ValueError(
                f"stamp must not be before the last scan of another sensor; got {scan.stamp!r} "
                f"after {last!r}"
            )
        return state

    def picture(self, state: SensorState, scan_index: int) -> Picture:
        """The sensors, as one of them looks at a scan."""
        if len(self) == 1:
            interval, max_range = state.interval, state.model.max_range
            return Picture(interval=interval, own=interval, slowest=interval, max_range=max_range)
        stamp = state.scan.stamp
        living = [one for one in self.values() if one is state or one.lives(stamp)]
        intervals = [one.interval for one in living]
        known = [interval for interval in intervals if interval]
        slowest = max(intervals)
        oldest = min(one.in_window[0] for one in living if one.in_window)
        # Hits of a sensor that fell silent are forgotten with the next scan's pruning.
        self.oldest, oldest = oldest, min(oldest, self.oldest)
        return Picture(
            number=state.number,
            sensors=len(self),
            living=tuple(one.number for one in living),
            interval=1.0 / sum(1.0 / interval for interval in known) if known else 0.0,
            own=state.interval,
            slowest=slowest,
            counts_absence=state.interval >= slowest,
            max_range=max(one.model.max_range for one in living),
            remembered=scan_index + 1 - oldest,
            others=tuple((one.scan, one.model, one.poses) for one in living if one is not state),
        )

    def begun(self, picture: Picture, window: int) -> IntArray:
        """See `Observation.begun`; of several sensors."""
        scans = [one.in_window for one in self.values() if one.number in picture.living]
        return np.sort(np.concatenate([[*each][len(each) == window :] for each in scans]))

    @property
    def errors(self) -> RangeErrors:
        """Errors in use of several sensors."""
        models = [one.sensor_in_use for one in self.values()]
        return RangeErrors(
            np.array([model.range_std for model in models]),
            np.array([model.range_std_fraction for model in models]),
        )
