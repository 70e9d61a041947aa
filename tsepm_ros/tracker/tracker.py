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
"""The tracker: scans in, newly confirmed tracks out, by a method of choice.

For each scan: measure its detections, in the coverage and in the fixed frame; associate them with
the confirmed tracks, which are updated; learn the clutter from the rest; let the method split,
evaluate, prune and merge its hypotheses; hold the tracks that it confirms.
"""

from __future__ import annotations

import copy
import math

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.numerics.arrays import (
    BoolArray,
    FloatArray,
    IntArray,
    appended_arrays,
    changed,
    taken,
)
from tsepm_ros.tracker import initial_state, merging, motion, range_rates
from tsepm_ros.tracker.clusters.extended_targets import ExtendedTargets, extended_target_density
from tsepm_ros.tracker.clusters.grouping import Clusters
from tsepm_ros.tracker.clutter.amplitude_law import ScanAmplitudes
from tsepm_ros.tracker.clutter.excess import RECENT, ConfirmedTargets
from tsepm_ros.tracker.clutter.fixed_places import LandMask
from tsepm_ros.tracker.clutter.learned import Learned, LearnedScanClutter
from tsepm_ros.tracker.clutter.sensor_performance import STEP
from tsepm_ros.tracker.maintenance.data_association import MAX_LOG_FACTOR
from tsepm_ros.tracker.maintenance.track_maintenance import TrackMaintenance, best_confirmed
from tsepm_ros.tracker.measurement import (
    LEAST_ACROSS,
    MeasurementWindow,
    convert_measurements,
    major_sigma,
    measured_polar,
)
from tsepm_ros.tracker.method import Method, ScanStatistics, Step
from tsepm_ros.tracker.observation import Observation
from tsepm_ros.tracker.options import GATE_PROBABILITY
from tsepm_ros.tracker.scan import STANDING, Scan, check_scan, scan_of_rows, scan_positions
from tsepm_ros.tracker.sensor import (
    SensorEchoPoses,
    SensorModel,
    SensorView,
    inside_sensor_coverage,
    sensor_echo_poses,
    sensor_looked_at,
)
from tsepm_ros.tracker.tracks import NO_TRACKS, ConfirmedTrack, TrackArrays, TrackStatus

TRACK_IDS = 2**32
"""Number of track ids: they start again from 0, since messages have 32 bits for them."""
PAIRS_PER_SECOND = 100_000.0
"""Pairs of potential tracks and detections that a slow computer processes, 1/s: a choice."""
HELD_PER_PAIR = 0.05
"""Confirmed tracks, per pair that a scan may have, at most: each costs as much."""
LEAST_ROOM = 10
"""Tracks that a scan may confirm at least, however many are held."""
WHOLE_SHARE = 0.75
"""Share of the sector from which on a scan looked at the whole coverage."""
SOON, LATER = 2, 32
"""Scans between two looks at the errors that tracks show, before enough are known, and later."""
UNSURE = 4.0
"""Factor of the variances by which a start is beside a confirmed track before errors are learned:
they may be twice those stated."""
STANDING_PROBABILITY = 0.98
"""That a detection that stands is no start of a target's track."""


class Tracker:
    """Observes scans, lets a method confirm tracks, and maintains these.

    Parameters
    ----------
    method : Method

    Attributes
    ----------
    method : Method
    sensor : SensorModel
        As given.
    common : CommonOptions
        Options that all methods share.
    options : Options
        The method's own.
    maintenance : TrackMaintenance
        The confirmed tracks, carried to the last scan's stamp.
    learned : Learned
        Models of the surroundings, learned from the scans so far.
    extended_targets : ExtendedTargets
        Makes clusters of the detections.
    land : LandMask or None
        Land of the fixed frame: detections on it are left out. It stays through resets.
    window : MeasurementWindow
        Detections of the last scans, to which potential tracks and new tracks refer.
    revised : TrackArrays
        Confirmed tracks that a start of the last scan continued, as they are now: each with the
        hits of this, and its number of revisions; and those that are published again.
    statistics, totals : ScanStatistics
        Counts of the last scan, and sums since the start or the last reset.
    stamp : float or None
        Stamp of the last scan, s.
    scan_index : int
        Number of the last scan, from 0; -1 before the first.
    next_track_id : int
        Id of the next confirmed track; goes on through resets.
    max_scan_time : float
        Time that a scan may take on a slow computer, s: `PAIRS_PER_SECOND` bound what it may take
        on. Infinite unless set.
    """

    def __init__(self, method: Method) -> None:
        self.max_scan_time = math.inf
        self.next_track_id = 0
        self.land: LandMask | None = None
        self.maintenance = TrackMaintenance()
        self._use(method)
        self.reset()

    def __repr__(self) -> str:
        return (
            f"Tracker({type(self.method).__name__}, {self.totals.scans} scans, "
            f"{self.totals.confirmed} tracks confirmed, {len(self.current)} current)"
        )

    def reset(self) -> None:
        """Forget everything but the next track id, none is used twice, and the land."""
        self.stamp: float | None = None
        self.scan_index = -1
        self.statistics = self.totals = ScanStatistics()
        self.revised = TrackArrays.from_tracks([])
        self.learned = Learned.initial(self.sensor)
        self.method.sensor = self.sensor
        self._use(self.method)
        self.extended_targets = ExtendedTargets(self.sensor, self.common)
        self._received: dict[str, int] = {}
        self._own: list[tuple[IntArray, NDArray[np.void]]] = []
        self._poses = SensorEchoPoses(np.zeros(1), np.zeros((1, 3)))
        self._scan = Scan(0.0, np.zeros(0), np.zeros(0))
        self._clutter = self._clutter_at(np.zeros(0), np.zeros(0))
        self.forget_potential_tracks()
        self.maintenance.clear()

    def forget_potential_tracks(self) -> None:
        """Forget the potential tracks, but not confirmed tracks, what was learned, nor counts."""
        self._observed: Observation | None = None
        self.window = MeasurementWindow()
        self.method.forget()

    def with_settings(self, method: Method) -> tuple[Tracker, bool]:
        """The tracker as it goes on by another method, or other options, from the next scan.

        Tracks, ids, counts and what was learned and still holds stay. This one does not change,
        and is not to be used after the other has taken a scan.

        Parameters
        ----------
        method : Method
            Fresh; only its kind, sensor and options count where it is of the kind in use.

        Returns
        -------
        tracker : Tracker
        kept : bool
            Whether the potential tracks were kept: not by another method.
        """
        other, kept = copy.copy(self), type(method) is type(self.method)
        if kept:
            same_kind = copy.copy(self.method)
            kept = same_kind.configure(method.sensor, method.common, method.options)
            method = same_kind
        other.learned = self.learned.under(method.sensor, self.sensor)
        other.extended_targets = self.extended_targets.under(method.sensor, method.common)
        other.maintenance = copy.copy(self.maintenance)
        other._use(method)
        if not kept:
            other._observed, other.window = None, MeasurementWindow()
        return other, kept

    def _use(self, method: Method) -> None:
        """Take a method with its sensor and options."""
        self.method, self.sensor, self.options = method, method.sensor, method.options
        self._in_use, self._steps, self._due = method.sensor, np.zeros(2, np.int64), 0
        self.common = self.maintenance.options = method.common

    def process(self, scan: Scan) -> TrackArrays:
        """Take one scan and return the tracks that it newly confirms.

        Parameters
        ----------
        scan : Scan
            The next scan, later than the one before.

        Returns
        -------
        TrackArrays
            Newly confirmed tracks only, their states at the scan's stamp: a sequence of
            `ConfirmedTrack`, or arrays.

        Raises
        ------
        ValueError
            If it is no `Scan`, the stamp is not later than the last one, or the scan has more than
            `max_detections` detections. The scan is then not taken and nothing has changed.
        """
        check_scan(scan, self.stamp, self.common.max_detections)
        observed = self.observe(scan)  # measure, associate, learn
        step = self.method.step(observed)  # split, evaluate, prune, confirm, merge
        new, counts = self._hold(observed, step)
        self.statistics = changed(counts, plots=counts.detections, **self._received)
        self.totals = self.totals + self.statistics
        return new

    def observe(self, scan: Scan) -> Observation:
        """Measure a scan, associate its detections with the confirmed tracks, and learn from it.

        The confirmed tracks take their detections at the density that was known before.
        """
        interval = self._count_in(scan)
        if self.scan_index >= self._due:
            self._follow_errors()
        detections = self._detections(scan)
        amplitudes = self._clutter.judge_amplitudes(
            detections, self.scan_index, self.options.window
        )
        clutter_sensor, of_rates = self._clutter_rates(detections)
        before = self._clutter.before(self._confirmed_targets) * of_rates
        confirmed = self._carry_confirmed(scan, detections, before, amplitudes)
        self.learned.detection_probability.update(*self.maintenance.covered, GATE_PROBABILITY)
        if self.extended_targets.active:
            innovations, rows = self.maintenance.innovations, self.maintenance.innovation_rows
            self.extended_targets.learn_scatter(*innovations, rows)
        else:
            track_id, row = self.maintenance.own_detections
            rows = np.flatnonzero(np.isnan(detections["range_std"][row]))
            if len(rows):
                self._own.append((track_id[rows], taken(detections, row[rows])))
            self.maintenance.manoeuvre.update(
                *self.maintenance.innovations,
                self.common,
                interval,
                self.learned.scan_interval.median,
            )
        stands = self._stands(scan)[detections["index"]]
        self._received["standing"] = int(np.count_nonzero(stands))
        confirmed = np.maximum(confirmed, STANDING_PROBABILITY * stands)
        detections["clutter_density"] = self._learn_clutter(confirmed)
        if self.learned.batch.is_new or self.learned.errors.young:
            self._learn_errors()
        self._learn_extended_targets()
        self._clutter.learn_amplitudes(detections, self._reach)
        self.window.forget(self.scan_index + 1 - self.options.window)
        ids = self.window.append(detections)
        tracks = self.maintenance.confirmed.tracks
        return Observation(
            stamp=scan.stamp,
            scan_index=self.scan_index,
            interval=interval,
            median_interval=self.learned.scan_interval.median,
            detections=detections,
            window=self.window,
            ids=ids,
            clutter_density=detections["clutter_density"] * of_rates,
            confirmed_probability=confirmed,
            may_start=~stands,
            detected=tracks.where(
                (tracks.track_id[:, None] == self.maintenance.probable_detections[0]).any(axis=1)
            ),
            clutter_sensor=clutter_sensor,
            seen_extent=self.learned.clutter_map.seen.region.extent,
            sensor_position=self._poses.middle[:2],
            detection_probability=self.detection_probability_at,
            detection_probability_in_use=self.detection_probability,
            process_noise=self.maintenance.manoeuvre.process_noise(
                self.common, self.learned.scan_interval.median
            ),
            most_pairs=self.max_scan_time * PAIRS_PER_SECOND,
            amplitudes=amplitudes,
            predictive=self._clutter.predictive,
        )

    def _stands(self, scan: Scan) -> BoolArray:
        """Which detections of a scan (n,) stand, which are no clutter; unknown says nothing."""
        if self.common.start_standing == "on" or not self.method.most_tracks_true:
            return np.zeros(len(scan), bool)
        return np.asarray(scan.features.get("standing", np.zeros(len(scan))) >= STANDING)

    def _count_in(self, scan: Scan) -> float:
        """Count a scan in; returns the time since the one before, s."""
        interval = 0.0 if self.stamp is None else scan.stamp - self.stamp
        self.learned.scan_interval.update(interval)
        self.stamp = scan.stamp
        self.scan_index += 1
        self._poses = sensor_echo_poses(scan) or self._poses
        self._scan = scan
        return interval

    def _clutter_rates(self, detections: NDArray[np.void]) -> tuple[SensorModel, FloatArray]:
        """The sensor with its clutter's range rates, and the density of the detections' own."""
        self.learned.clutter_range_rates.update(detections)
        sensor = self._in_use
        if self.common.clutter_density == "estimated":
            sensor = self.learned.clutter_range_rates.estimate(sensor)
        return sensor, range_rates.clutter_density(detections, sensor)

    def _carry_confirmed(
        self,
        scan: Scan,
        detections: NDArray[np.void],
        clutter: FloatArray,
        amplitudes: ScanAmplitudes | None,
    ) -> FloatArray:
        """Carry confirmed tracks to a scan; returns p that each detection is one's, (d,).

        With clusters, a target may have others beside its own.
        """
        width = self.sensor.sector_width
        swept = 1.0 if scan.swept is None else min(max(scan.swept[1] / width, 1e-3), 1.0)
        whole = swept > WHOLE_SHARE
        probability = self.method.maintain(
            self.maintenance,
            scan.stamp,
            detections,
            clutter,
            self.detection_probability_at,
            changed(self._in_use, detection_probability=self.detection_probability),
            self.common.max_speed,
            self.learned.scan_interval.median / (1.0 if whole else swept),
            amplitudes,
            extent=self.extended_targets.extent.along if self.extended_targets.active else 0.0,
            whole=whole,
        )
        if not self.extended_targets.active:
            return probability
        further = extended_target_density(
            self.maintenance.confirmed,
            detections["position"],
            self.extended_targets.extent,
            self._poses.middle[:2],
        )
        other = (1.0 - probability) * clutter / (clutter + further)
        return 1.0 - np.maximum(other, math.exp(-MAX_LOG_FACTOR))

    def _learn_extended_targets(self) -> None:
        """Learn whether targets have several detections; tracks of one target become one then."""
        if self.method.most_tracks_true:
            self.extended_targets.learn(
                self.maintenance.probable_detections,
                self.maintenance.confirmed,
                self.clutter_density,
                self.learned.batch.is_new,
            )
        if self.extended_targets.active:
            self.maintenance.end(~self._on_older(NO_TRACKS), "duplicate")

    def _on_older(self, starts: TrackArrays) -> BoolArray:
        """Which tracks, and starts after them, may be on the extent of an older target, (n,).

        A start without the margin of a second target is, up to twice the variance of a place on
        it. A fixed echo is no part of a target that moves, and a track that coasts ends no track.
        """
        confirmed = self.maintenance.confirmed.tracks
        others = confirmed.status == TrackStatus.STANDS_STILL
        if not len(starts):
            others |= confirmed.status == TrackStatus.COASTING
        judged = np.append(~others, np.ones(len(starts), bool))
        tracks = TrackArrays.joined(confirmed, starts).where(judged)
        extent, places = self.extended_targets.extent, self._poses.polar(tracks.state[:, 0::2])
        size = np.maximum(extent.along, extent.across_at(places[0]))
        weak = starts.evaluation < merging.SECOND_TARGET_MARGIN
        size[len(tracks) - len(starts) :][weak] *= math.sqrt(3.0)
        older = np.zeros(len(judged), bool)
        older[judged] = merging.of_older(tracks, size)
        return older

    def _follow_errors(self) -> None:
        """Take the errors that confirmed tracks show into use, where they changed."""
        errors, sensor = self.learned.errors, self.sensor
        self._due = self.scan_index + (SOON if errors.young else LATER)
        if not self._follows_errors:
            return
        steps = errors.followed(self._steps)
        if not np.array_equal(steps, self._steps):
            along, turn = np.exp2(STEP * steps).tolist()
            self._steps = steps
            self._in_use = self.method.sensor = changed(
                sensor,
                range_std=along * sensor.range_std,
                range_std_fraction=along * sensor.range_std_fraction,
                azimuth_std=turn * sensor.azimuth_std,
            )

    @property
    def _follows_errors(self) -> bool:
        """Whether the errors that confirmed tracks show are used."""
        return self.common.sensor_errors != "given" and self.method.most_tracks_true

    def _learn_errors(self) -> None:
        """Learn the sensor's errors from confirmed tracks' detections, if these have its errors."""
        if not self._own:
            return
        track_id, detections = zip(*self._own, strict=True)
        own, confirmed, self._own = appended_arrays(*detections), self.maintenance.confirmed, []
        rows = np.flatnonzero(np.isnan(own["range_std"]))
        own = taken(own, rows)
        variance = self.sensor.range_variance(measured_polar(own)[0])
        if self._scan.azimuth_std is None:
            own["azimuth_std"] = self.sensor.azimuth_std
        ids, moves = confirmed.tracks.track_id, confirmed.fits.moves
        self.learned.errors.update(np.concatenate(track_id)[rows], own, variance, ids, moves)

    def _learn_clutter(self, confirmed: FloatArray) -> FloatArray:
        """Learn from what is probably clutter; returns the density at each detection, (d,)."""
        weight = 1.0 - confirmed if self.method.most_tracks_true else np.ones(len(confirmed))
        # In an area within the reach of one target while a hypothesis of it lives.
        reach = self._reach * RECENT
        area = math.pi * reach**2
        targets, moving = self._confirmed_targets, self.maintenance.detections_of_moving
        view = SensorView.from_scan(self._scan, self.sensor, self._poses.middle)
        return self._clutter.learn(self._scan.stamp, view, weight, area, targets, moving)

    def _confirmed_targets(self) -> ConfirmedTargets:
        """The confirmed tracks in the sensor's frame."""
        confirmed = self.maintenance.confirmed
        range_, azimuth = self._poses.polar(confirmed.tracks.state[:, 0::2])
        return ConfirmedTargets(confirmed.tracks.track_id, range_, azimuth, confirmed.existence)

    @property
    def _reach(self) -> float:
        """Distance that a target moves at most from scan to scan, m."""
        return self.common.max_speed * self.learned.scan_interval.median

    def _detections(self, scan: Scan) -> NDArray[np.void]:
        """The detections in the coverage and not on land, or their clusters, in the fixed frame."""
        used = inside_sensor_coverage(scan, self.sensor)
        covered = int(np.count_nonzero(used))
        if self.land is not None:
            used &= ~self.land.covers(scan_positions(scan))
        rows = np.flatnonzero(used)
        self._received = {
            "detections": len(rows),
            "outside_coverage": len(scan) - covered,
            "on_land": covered - len(rows),
        }
        covered_scan = scan if len(rows) == len(scan) else scan_of_rows(scan, rows)
        if covered < len(scan):
            self.learned.all_extent.update(scan.range, scan.azimuth, np.ones(len(scan)))
        runs = self.extended_targets.runs_of(covered_scan)
        detections = self._converted(covered_scan, rows, runs)
        measured = covered_scan if runs is None else runs.scan
        made = self.extended_targets.clusters_of(measured, self._clutter.is_fixed)
        if made is not None:
            detections = self._converted(
                covered_scan, rows, made if runs is None else made.traced_through(runs)
            )
        return detections

    def _converted(self, scan: Scan, rows: IntArray, clusters: Clusters | None) -> NDArray[np.void]:
        """The detections or clusters of a scan in the fixed frame, with the clutter at them."""
        measured = scan if clusters is None else clusters.scan
        as_stated = scan.azimuth_std is not None or not self.method.most_tracks_true
        own = np.zeros(len(measured), bool) if clusters is None else clusters.own_range_std
        least = np.where(own | as_stated, 0.0, LEAST_ACROSS)
        detections = convert_measurements(measured, self._in_use, self.scan_index, least)
        self._clutter = self._clutter_at(measured.range, measured.azimuth, detections)
        detections["index"] = rows if clusters is None else rows[clusters.strongest]
        if clusters is not None and scan.range_std is None:
            detections["range_std"][~own] = np.nan
        return detections

    def _clutter_at(
        self, range: FloatArray, azimuth: FloatArray, detections: NDArray[np.void] | None = None
    ) -> LearnedScanClutter:
        """Clutter at positions (n,); behind targets, where the confirmed tracks are targets."""
        return LearnedScanClutter(
            self.learned,
            self.common,
            self.sensor,
            self.method.most_tracks_true,
            range,
            azimuth,
            detections,
        )

    def detection_probability_at(self, positions: FloatArray) -> FloatArray:
        """Probability that a target at each position (n, 2) is detected in this scan."""
        covered = sensor_looked_at(self._scan, self.sensor, self._poses, positions)
        return np.where(covered, self.detection_probability, 0.0)

    def _hold(self, observed: Observation, step: Step) -> tuple[TrackArrays, ScanStatistics]:
        """Hold the tracks that a step confirms, and those of them that are published."""
        self.revised, counts = NO_TRACKS, step.statistics
        confirmed, merged, cut = len(step.tracks), 0, 0
        if confirmed:
            step = self._merged(step)
            merged = confirmed - len(step.tracks)
            if self.method.most_tracks_true and self.extended_targets.active:
                number = len(self.maintenance.confirmed)
                step = step.where(~self._on_older(step.tracks)[number:])
            stated = self._scan.range_std is not None or self.extended_targets.active
            if step.paths and self.learned.errors.young and self._follows_errors and not stated:
                step = step.where(~self.maintenance.doubled(step.tracks, step.paths, UNSURE))
            limit = HELD_PER_PAIR * observed.most_pairs - len(self.maintenance.confirmed)
            room = int(max(min(limit, len(step.tracks)), LEAST_ROOM))
            cut = max(len(step.tracks) - room, 0)
        if cut:
            step = step.where(best_confirmed(step.existences, step.tracks.evaluation, room))
        new = self._add(step)
        released = self.maintenance.released
        again = released.revision > 0
        if again.any():  # after they had coasted, or were outside the coverage
            self.revised = TrackArrays.joined(self.revised, released.where(again))
            released = released.where(~again)
        if len(released):  # confirmed now, after they had been held back
            first = np.array([hits[0][0] for hits in released.hits], np.int64)
            released = changed(released, scan_count=observed.scan_index + 1 - first)
            new = TrackArrays.joined(released, new)
        self._observed = observed
        return new, changed(
            counts,
            merged=counts.merged + merged,
            confirmed=counts.confirmed - confirmed + len(new),
            cut_confirmations=counts.cut_confirmations + cut,
        )

    def _merged(self, step: Step) -> Step:
        """The step without the starts that continue confirmed tracks, which go on from them."""
        step = changed(step, tracks=self._proper(step.tracks))
        if not step.paths:
            return step
        ids = self.maintenance.continued(step.tracks, step.paths, self.covered_area)
        again = step.where(ids >= 0)
        starts = again.tracks.numbered(ids[ids >= 0])
        self.revised = self.maintenance.find_again(starts, again.existences, again.paths)
        return step.where(ids < 0)

    def _proper(self, tracks: TrackArrays) -> TrackArrays:
        """The tracks with proper covariances and, if so set, a speed of at most `max_speed`."""
        tracks = tracks.proper()  # what follows inverts the covariances
        if self.common.limit_speed == "off" or not len(tracks):
            return tracks
        state, covariance = motion.limited(tracks.state, tracks.covariance, self.common.max_speed)
        return changed(tracks, state=state, covariance=covariance).proper()

    def _add(self, step: Step) -> TrackArrays:
        """Hold a method's newly confirmed tracks, and take back what is theirs from the clutter.

        Those that are published at once are returned.
        """
        if step.target_probability is not None:
            self._clutter.withdraw(step.target_probability)
        if step.target_hits is not None:
            self.learned.amplitudes.discount(*step.target_hits)
        tracks, number = step.tracks, len(step.tracks)
        if not number:
            return tracks
        tracks = tracks.numbered(self._take_track_ids(number))
        if self.learned.errors.young and not self.extended_targets.active:
            for track in tracks:
                hits = self.window.find(track.hits)
                self._own.append((np.full(len(hits), track.track_id), self.window[hits]))
        sigma = major_sigma(tracks.covariance[:, 0::2, 0::2])
        figures = initial_state.initial_state_figures(
            self.window, tracks.hits, tracks.stamp, tracks.state, sigma
        )
        return self.maintenance.add(tracks, step.existences, *figures, step.paths)

    def _take_track_ids(self, number: int) -> IntArray:
        """The next ids, (number,); passing over those in use, which a tracker may have given."""
        in_use = self.maintenance.confirmed.tracks.track_id
        following = (self.next_track_id + np.arange(number + len(in_use))) % TRACK_IDS
        taken = following[~np.isin(following, in_use)][:number]
        self.next_track_id = int(taken[-1] + 1) % TRACK_IDS
        return taken

    @property
    def current(self) -> TrackArrays:
        """Every published confirmed track, at the last scan's stamp."""
        return self.maintenance.current.proper()

    @property
    def fixed_echoes(self) -> TrackArrays:
        """Fixed echoes, with `min_speed`: their places, and the time `since` when."""
        return self.maintenance.fixed_echoes.proper()

    def potential_tracks(self) -> TrackArrays:
        """Hypotheses with at least two hits that may yet be confirmed, at the last scan's stamp.

        Their `track_id` is their place in the list.
        """
        if self._observed is None:
            return TrackArrays.from_tracks([])
        return self.method.potential_tracks(self._observed).proper()

    def reason(self, track: ConfirmedTrack) -> str:
        """Why a track was confirmed, in a sentence, as the method's options are now."""
        return self.method.reason(track)

    @property
    def estimated_detection_probability(self) -> float:
        """Detection probability estimated from the confirmed tracks, whether it is used or not."""
        return self.learned.detection_probability.estimate(self.sensor.detection_probability)

    @property
    def detection_probability(self) -> float:
        """Detection probability in use: given or estimated."""
        given = self.common.detection_probability == "given"
        return self.sensor.detection_probability if given else self.estimated_detection_probability

    @property
    def clutter_density(self) -> float:
        """Clutter density in use, 1/m^2: given, or the mean of the estimate over the coverage."""
        given = self.common.clutter_density == "given"
        return self.sensor.clutter_density if given else self.learned.clutter_map.mean

    @property
    def covered_area(self) -> float:
        """Area to which that density refers, m^2: the coverage, or where clutter is seen."""
        given = self.common.clutter_density == "given"
        return self.sensor.coverage_area if given else self.learned.clutter_map.seen.area

    @property
    def intensity(self) -> str:
        """Whether the amplitudes of the last scan counted, and why not, in words."""
        if self.common.intensity == "off":
            return "not used: off"
        return (
            self.learned.amplitudes.use
            if self.method.most_tracks_true
            else "not used by the method"
        )
