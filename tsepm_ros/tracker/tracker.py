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
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray, replaced
from tsepm_ros.tracker import initial_state, merging, motion
from tsepm_ros.tracker.clusters.extended_targets import density_of_further
from tsepm_ros.tracker.clutter.amplitude_law import ScanAmplitudes
from tsepm_ros.tracker.clutter.fixed_places import LandMask
from tsepm_ros.tracker.clutter.sensor_performance import Misalignment
from tsepm_ros.tracker.maintenance.data_association import MAX_LOG_FACTOR
from tsepm_ros.tracker.maintenance.track_maintenance import TrackMaintenance, best_confirmed
from tsepm_ros.tracker.measurement import (
    MeasurementWindow,
    major_sigma,
)
from tsepm_ros.tracker.method import Method, MethodResult, ScanStatistics
from tsepm_ros.tracker.observation import Observation
from tsepm_ros.tracker.scan import MIN_STANDING, Scan, check_scan
from tsepm_ros.tracker.sensor import Picture, RangeErrors, SensorModel
from tsepm_ros.tracker.sensor_state import SensorState
from tsepm_ros.tracker.tracks import NO_TRACKS, ConfirmedTrack, TrackArrays, TrackStatus

TRACK_IDS = 2**32
"""Number of track ids: they start again from 0, since messages have 32 bits for them."""
PAIRS_PER_SECOND = 100_000.0
"""Pairs of potential tracks and detections that a slow computer processes, 1/s: a choice."""
HELD_PER_PAIR = 0.05
"""Confirmed tracks, per pair that a scan may have, at most: each costs as much."""
MIN_CONFIRMED_PER_SCAN = 10
"""Tracks that a scan may confirm at least, however many are held."""
WHOLE_SWEEP_SHARE = 0.75
"""Share of the sector from which on a scan looked at the whole coverage."""
VARIANCE_FACTOR_BEFORE_LEARNING = 4.0
"""Factor of the variances by which a start is beside a confirmed track before errors are learned:
they may be twice those stated."""
STANDING_PROBABILITY = 0.98
"""That a detection that stands is no start of a target's track."""


class Tracker:
    """Observes scans, lets a method confirm tracks, and maintains these.

    Parameters
    ----------
    method : Method
    sensors : mapping of str to SensorModel, optional
        Models of several sensors by name, of which each scan names one; by default a single sensor
        without a name, that of the method.

    Attributes
    ----------
    method : Method
    common : CommonOptions
        Options that all methods share.
    options : Options
        The method's own.
    maintenance : TrackMaintenance
        The confirmed tracks, carried to the last scan's stamp.
    sensors : dict of str to SensorState
        Each sensor: its model, its last scan, and what was learned of it.
    sensor : SensorState
        The sensor that looked last.
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

    def __init__(self, method: Method, sensors: Mapping[str, SensorModel] | None = None) -> None:
        models = sensors or {"": method.sensor}
        method.sensors = len(models)
        self.sensors = {
            name: SensorState(model, method, number)
            for number, (name, model) in enumerate(models.items())
        }
        self.max_scan_time = math.inf
        self.next_track_id = 0
        self.land: LandMask | None = None
        self.maintenance = TrackMaintenance(sensors=len(models))
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
        self.scan_index, self._oldest = -1, 0
        self.statistics = self.totals = ScanStatistics()
        self.revised = TrackArrays.from_tracks([])
        self.sensors = {
            name: SensorState(state.model, self.method, state.number)
            for name, state in self.sensors.items()
        }
        self.sensor = next(iter(self.sensors.values()))
        self.method.sensor = self.sensor.model
        self.forget_potential_tracks()
        self.maintenance.clear()

    def forget_potential_tracks(self) -> None:
        """Forget the potential tracks, but not confirmed tracks, what was learned, nor counts."""
        self._observed: Observation | None = None
        self.window = MeasurementWindow()
        self.method.forget()

    def with_settings(self, method: Method, sensor: str = "") -> tuple[Tracker, bool]:
        """The tracker as it goes on by another method, or other options, from the next scan.

        Tracks, ids, counts and what was learned and still holds stay. This one does not change,
        and is not to be used after the other has taken a scan.

        Parameters
        ----------
        method : Method
            Fresh; only its kind, sensor and options count where it is of the kind in use.
        sensor : str, optional
            Name of the sensor of several whose model is that of the method; the others keep theirs.

        Returns
        -------
        tracker : Tracker
        kept : bool
            Whether the potential tracks were kept: not by another method.

        Raises
        ------
        ValueError
            If there are several sensors, and the method takes a single one.
        """
        other, kept = copy.copy(self), type(method) is type(self.method)
        if kept:
            same_kind = copy.copy(self.method)
            kept = same_kind.configure(method.sensor, method.common, method.options)
            method = same_kind
        if len(self.sensors) > 1 and not method.several_sensors:
            raise ValueError(f"{type(method).__name__} takes one sensor, and there are several")
        method.sensors = len(self.sensors)
        if not kept:
            method.forget()
        other.sensors = {
            name: state.under(
                method.sensor if name == sensor or method.sensors == 1 else state.model, method
            )
            for name, state in self.sensors.items()
        }
        (other.sensor,) = (
            state for state in other.sensors.values() if state.number == self.sensor.number
        )
        other.maintenance = copy.copy(self.maintenance)
        other._use(method)
        if not kept:
            other._observed, other.window = None, MeasurementWindow()
        return other, kept

    def _use(self, method: Method) -> None:
        """Take a method with its sensor and options."""
        self.method, self.options = method, method.options
        self.common = self.maintenance.options = method.common

    def process(self, scan: Scan) -> TrackArrays:
        """Take one scan and return the tracks that it newly confirms.

        Parameters
        ----------
        scan : Scan
            The next scan, later than the one before of its sensor; not before that of another one.

        Returns
        -------
        TrackArrays
            Newly confirmed tracks only, their states at the scan's stamp: a sequence of
            `ConfirmedTrack`, or arrays.

        Raises
        ------
        ValueError
            If it is no `Scan`, the stamp is not later than the last one, the scan has more than
            `max_detections` detections, or it names an unknown sensor. The scan is then not taken
            and nothing has changed.
        """
        self.sensor = self._looking(scan)
        observed = self.observe(scan)  # measure, associate, learn
        step = self.method.step(observed)  # split, evaluate, prune, confirm, merge
        new, counts = self._hold(observed, step)
        self.statistics = replaced(counts, plots=counts.detections, **self.sensor.received)
        self.totals = self.totals + self.statistics
        return new

    def _looking(self, scan: Scan) -> SensorState:
        """The sensor of a scan; an error for a scan that cannot be taken, see `process`."""
        check_scan(scan, None, self.common.max_detections)
        unnamed = len(self.sensors) == 1 and not scan.sensor
        state = self.sensor if unnamed else self.sensors.get(scan.sensor)
        if state is None:
            raise ValueError(f"sensor must be one of {[*self.sensors]}; got {scan.sensor!r}")
        check_scan(scan, state.scan.stamp if state.scans else None, self.common.max_detections)
        if self.stamp is not None and scan.stamp < self.stamp:
            raise ValueError(
                f"stamp must not be before the last scan of another sensor; got {scan.stamp!r} "
                f"after {self.stamp!r}"
            )
        return state

    def observe(self, scan: Scan) -> Observation:
        """Measure a scan, associate its detections with the confirmed tracks, and learn from it.

        The confirmed tracks take their detections at the density that was known before.
        """
        state, maintenance = self.sensor, self.maintenance
        interval = 0.0 if self.stamp is None else scan.stamp - self.stamp
        self.stamp, self.scan_index = scan.stamp, self.scan_index + 1
        detections = state.measure(scan, self.scan_index, self.land)
        self.method.sensor, picture = state.in_use, self._picture()
        amplitudes = state.judge_amplitudes(detections, self.options.window)
        clutter_sensor, of_rates = state.clutter_rates(detections)
        before = state.clutter_before(maintenance.confirmed) * of_rates
        confirmed = self._carry_confirmed(scan, detections, before, amplitudes, picture)
        state.learn_targets(detections, maintenance)
        if not state.extended_targets.active:
            maintenance.manoeuvre.update(
                *maintenance.innovations, self.common, interval, picture.interval
            )
        if scan.sensor:
            others = (one for one in self.sensors.values() if one is not state)
            seen = set().union(*(one.sees(scan.stamp) for one in others))
            doubled = state.learn_alignment(detections, maintenance, seen)
            maintenance.end(~doubled, "duplicate")
        stands = self._stands(scan)[detections["index"]]
        state.received["standing"] = int(np.count_nonzero(stands))
        confirmed = np.maximum(confirmed, STANDING_PROBABILITY * stands)
        state.learn(detections, confirmed, maintenance)
        if state.extended_targets.active:  # tracks of one target become one
            maintenance.end(~self._on_older(NO_TRACKS), "duplicate")
        detections["clutter_density"] = state.clutter.density
        remembered = picture.remembered or self.options.window
        self.window.forget(self.scan_index + 1 - remembered)
        ids = self.window.append(detections)
        tracks = self.maintenance.confirmed.tracks
        return Observation(
            stamp=scan.stamp,
            scan_index=self.scan_index,
            interval=interval,
            median_interval=state.interval,
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
            seen_extent=state.learned.clutter_map.seen.region.extent,
            sensor_position=state.poses.middle[:2],
            detection_probability=state.detection_probability_at,
            detection_probability_in_use=state.detection_probability,
            process_noise=maintenance.manoeuvre.process_noise(self.common, picture.interval),
            most_pairs=self.max_scan_time * PAIRS_PER_SECOND,
            picture=picture,
            begun=self._begun(picture),
            errors=self._errors(),
            amplitudes=amplitudes,
            predictive=state.clutter.predictive,
        )

    def _picture(self) -> Picture:
        """The sensors, as the one looks that is in use."""
        state = self.sensor
        if len(self.sensors) == 1:
            interval, max_range = state.interval, state.model.max_range
            return Picture(interval=interval, own=interval, slowest=interval, max_range=max_range)
        stamp = state.scan.stamp
        living = [one for one in self.sensors.values() if one is state or one.lives(stamp)]
        intervals = [one.interval for one in living]
        known = [interval for interval in intervals if interval]
        slowest = max(intervals)
        oldest = min(one.in_window[0] for one in living if one.in_window)
        # Hits of a sensor that fell silent are forgotten with the next scan's pruning.
        self._oldest, oldest = oldest, min(oldest, self._oldest)
        return Picture(
            number=state.number,
            sensors=len(self.sensors),
            living=tuple(one.number for one in living),
            interval=1.0 / sum(1.0 / interval for interval in known) if known else 0.0,
            own=state.interval,
            slowest=slowest,
            counts_absence=state.interval >= slowest,
            max_range=max(one.model.max_range for one in living),
            remembered=self.scan_index + 1 - oldest,
            others=tuple((one.scan, one.model, one.poses) for one in living if one is not state),
        )

    def _begun(self, picture: Picture) -> IntArray | None:
        """See `Observation.begun`."""
        if picture.sensors == 1:
            return None
        scans = [one.in_window for one in self.sensors.values() if one.number in picture.living]
        kept = [[*each][len(each) == self.options.window :] for each in scans]
        return np.sort(np.concatenate(kept))

    def _errors(self) -> RangeErrors | None:
        """Errors in use of several sensors."""
        if len(self.sensors) == 1:
            return None
        models = [one.in_use for one in self.sensors.values()]
        return RangeErrors(
            np.array([model.range_std for model in models]),
            np.array([model.range_std_fraction for model in models]),
        )

    def _stands(self, scan: Scan) -> BoolArray:
        """Which detections of a scan (n,) stand, which are no clutter; unknown says nothing."""
        if self.common.start_standing == "on" or not self.method.learns_from_confirmed:
            return np.zeros(len(scan), bool)
        return np.asarray(scan.features.get("standing", np.zeros(len(scan))) >= MIN_STANDING)

    def _carry_confirmed(
        self,
        scan: Scan,
        detections: NDArray[np.void],
        clutter: FloatArray,
        amplitudes: ScanAmplitudes | None,
        picture: Picture,
    ) -> FloatArray:
        """Carry confirmed tracks to a scan; returns p that each detection is one's, (d,).

        With clusters, a target may have others beside its own.
        """
        state = self.sensor
        width = state.model.sector_width
        swept = 1.0 if scan.swept is None else min(max(scan.swept[1] / width, 1e-3), 1.0)
        whole = swept > WHOLE_SWEEP_SHARE
        turn = 1.0 if whole else swept
        probability = self.method.maintain(
            self.maintenance,
            scan.stamp,
            detections,
            clutter,
            state.detection_probability_at,
            replaced(state.in_use, detection_probability=state.detection_probability),
            self.common.max_speed,
            picture.interval / turn,
            amplitudes,
            extent=state.extended_targets.extent.along if state.extended_targets.active else 0.0,
            whole=whole,
            picture=replaced(picture, own=picture.own / turn, slowest=picture.slowest / turn),
        )
        if not state.extended_targets.active:
            return probability
        further = density_of_further(
            self.maintenance.confirmed,
            detections["position"],
            state.extended_targets.extent,
            state.poses.middle[:2],
        )
        other = (1.0 - probability) * clutter / (clutter + further)
        return 1.0 - np.maximum(other, math.exp(-MAX_LOG_FACTOR))

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
        extent = self.sensor.extended_targets.extent
        places = self.sensor.poses.polar(tracks.state[:, 0::2])
        size = np.maximum(extent.along, extent.across_at(places[0]))
        weak = starts.evaluation < merging.SECOND_TARGET_MARGIN
        size[len(tracks) - len(starts) :][weak] *= math.sqrt(3.0)
        older = np.zeros(len(judged), bool)
        older[judged] = merging.on_older_extent(tracks, size)
        return older

    def _hold(
        self, observed: Observation, step: MethodResult
    ) -> tuple[TrackArrays, ScanStatistics]:
        """Hold the tracks that a step confirms, and those of them that are published."""
        self.revised, counts = NO_TRACKS, step.statistics
        confirmed, merged, cut = len(step.tracks), 0, 0
        state = self.sensor
        if confirmed:
            step = self._merged(step)
            merged = confirmed - len(step.tracks)
            if self.method.learns_from_confirmed and state.extended_targets.active:
                number = len(self.maintenance.confirmed)
                step = step.where(~self._on_older(step.tracks)[number:])
            stated = state.scan.range_std is not None or state.extended_targets.active
            if step.paths and state.learned.errors.young and state.follows_errors and not stated:
                step = step.where(
                    ~self.maintenance.doubled(
                        step.tracks, step.paths, VARIANCE_FACTOR_BEFORE_LEARNING
                    )
                )
            limit = HELD_PER_PAIR * observed.most_pairs - len(self.maintenance.confirmed)
            room = int(max(min(limit, len(step.tracks)), MIN_CONFIRMED_PER_SCAN))
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
            released = replaced(released, scan_count=observed.scan_index + 1 - first)
            new = TrackArrays.joined(released, new)
        self._observed = observed
        return new, replaced(
            counts,
            merged=counts.merged + merged,
            confirmed=counts.confirmed - confirmed + len(new),
            cut_confirmations=counts.cut_confirmations + cut,
        )

    def _merged(self, step: MethodResult) -> MethodResult:
        """The step without the starts that continue confirmed tracks, which go on from them."""
        step = replaced(step, tracks=self._proper(step.tracks))
        if not step.paths:
            return step
        ids = self.maintenance.continued(step.tracks, step.paths, self.sensor.covered_area)
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
        return replaced(tracks, state=state, covariance=covariance).proper()

    def _add(self, step: MethodResult) -> TrackArrays:
        """Hold a method's newly confirmed tracks, and take back what is theirs from the clutter.

        Those that are published at once are returned.
        """
        state = self.sensor
        if step.target_probability is not None:
            state.learned.withdraw(state.clutter, step.target_probability)
        if step.target_hits is not None:
            state.learned.amplitudes.discount(*step.target_hits)
        tracks, number = step.tracks, len(step.tracks)
        if not number:
            return tracks
        tracks = tracks.numbered(self._take_track_ids(number))
        if state.learned.errors.young and not state.extended_targets.active:
            track, hits = self.window.find(tracks.hits)
            mine = self.window.column("sensor", hits) == state.number
            state.own.append((tracks.track_id[track[mine]], self.window[hits[mine]]))
        sigma = major_sigma(tracks.covariance[:, 0::2, 0::2])
        figures = initial_state.figures_of_hits(
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
    def misalignments(self) -> dict[str, Misalignment]:
        """How each sensor's detections lie beside those of the others, where it is known.

        The farthest is first, in its errors: another one lies beside it only. It is not applied:
        the pose of a sensor's scans is.
        """
        found = {}
        for name, state in self.sensors.items():
            learned = [one.learned.alignment for one in self.sensors.values() if one is not state]
            others = [one for one in learned if one.known]
            own = state.learned.alignment
            if own.known and others:
                mean = own.mean - np.mean([one.mean for one in others], axis=0)
                spread = np.mean([one.error**2 for one in others], axis=0) / len(others)
                error = np.sqrt(own.error**2 + spread)
                found[name] = Misalignment(*np.stack([mean, error], axis=1).ravel().tolist())
        return dict(sorted(found.items(), key=lambda one: -round(one[1].away, 3)))

    def seen_by(self, tracks: TrackArrays) -> NDArray[np.uint32]:
        """Sensors that detected tracks lately, or that a start has hits of, (n,).

        Bit k is that of the sensor of number k. Lately is within `SILENT_INTERVALS` of its own
        intervals; hits are those within its window.
        """
        seen = np.zeros(len(tracks), np.uint32)
        for state in self.sensors.values():
            late, scans = state.seen_lately(self.stamp or 0.0), set(state.in_window)
            hit = [not scans.isdisjoint(scan for scan, _ in hits) for hits in tracks.hits]
            of_sensor = np.isin(tracks.track_id, list(late)) | np.array(hit, bool)
            seen |= of_sensor.astype(np.uint32) << np.uint32(state.number)
        return seen

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
        """Why a track was confirmed, in a sentence, as the method's options are now.

        Of several sensors with those that have hits of it, while they remember these.
        """
        scans = {scan for scan, _ in track.hits}
        hits = {name: len(scans & {*state.in_window}) for name, state in self.sensors.items()}
        of_each = ", ".join(f"{name} {number}" for name, number in hits.items() if number and name)
        return self.method.reason(track) + (f"; hits of {of_each}" if of_each else "")
