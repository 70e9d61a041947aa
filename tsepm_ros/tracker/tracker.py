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
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray, RecordArray, replaced
from tsepm_ros.tracker import initial_state, motion
from tsepm_ros.tracker.clusters.extended_targets import density_of_further
from tsepm_ros.tracker.clutter.fixed_places import LandMask
from tsepm_ros.tracker.maintenance.data_association import MAX_LOG_FACTOR
from tsepm_ros.tracker.maintenance.target_manoeuvre import TargetManoeuvre
from tsepm_ros.tracker.maintenance.track_maintenance import TrackMaintenance, best_confirmed
from tsepm_ros.tracker.measurement import MeasurementWindow, major_sigma
from tsepm_ros.tracker.merging import of_older_targets
from tsepm_ros.tracker.method import Method, MethodResult, ScanStatistics
from tsepm_ros.tracker.observation import Observation
from tsepm_ros.tracker.options import CommonOptions
from tsepm_ros.tracker.scan import Scan
from tsepm_ros.tracker.sensor import Picture, SensorModel
from tsepm_ros.tracker.sensor_alignment import Misalignment, misalignments
from tsepm_ros.tracker.sensor_state import ClutterBefore, Sensors, SensorState
from tsepm_ros.tracker.tracks import NO_TRACKS, ConfirmedTrack, TrackArrays

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
    maintenance : TrackMaintenance
        The confirmed tracks, carried to the last scan's stamp.
    sensors : Sensors
        Each sensor by its name: its model, its last scan, and what was learned of it.
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
        states = (
            SensorState(model, method, number) for number, model in enumerate(models.values())
        )
        self.sensors = Sensors(zip(models, states, strict=True))
        self.max_scan_time = math.inf
        self.next_track_id = 0
        self.land: LandMask | None = None
        self.maintenance = TrackMaintenance(method.common, len(models))
        self.method = method
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
        self.sensors = Sensors(
            (name, SensorState(state.model, self.method, state.number))
            for name, state in self.sensors.items()
        )
        self.sensor = next(iter(self.sensors.values()))
        self.method.sensor = self.sensor.model
        self.forget_potential_tracks()
        self.method.reset()
        self.maintenance.clear()
        self.maintenance.manoeuvre = TargetManoeuvre()

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
        other.sensors = Sensors(
            (
                (
                    name,
                    state.under(
                        method.sensor if name == sensor or method.sensors == 1 else state.model,
                        method,
                    ),
                )
                for name, state in self.sensors.items()
            ),
            self.sensors.oldest,
        )
        (other.sensor,) = (
            state for state in other.sensors.values() if state.number == self.sensor.number
        )
        other.maintenance = copy.copy(self.maintenance)
        other.method, other.maintenance.options = method, method.common
        if not kept:
            other._observed, other.window = None, MeasurementWindow()
        return other, kept

    @property
    def common(self) -> CommonOptions:
        """Options that all methods share."""
        return self.method.common

    @property
    def options(self) -> Any:
        """The method's own."""
        return self.method.options

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
        common, window = self.method.common, self.method.options.window
        state = self.sensor = self.sensors.looking(scan, self.stamp, common.max_detections)
        interval = 0.0 if self.stamp is None else scan.stamp - self.stamp
        self.stamp, self.scan_index = scan.stamp, self.scan_index + 1
        detections = state.measure(scan, self.scan_index, self.land)
        picture = self.sensors.picture(state, self.scan_index)
        clutter = state.clutter_at(detections, self.maintenance.confirmed, window)
        confirmed = self._associate(detections, clutter, picture)
        stands = state.standing(detections)
        confirmed = np.maximum(confirmed, STANDING_PROBABILITY * stands)
        self._learn(detections, confirmed, interval, picture)
        observed = self._observation(detections, clutter, confirmed, ~stands, interval, picture)
        result = self.method.step(observed)  # split, evaluate, prune, confirm
        self._observed = observed
        return self._hold(self._merge(result))

    def _associate(
        self, detections: RecordArray, clutter: ClutterBefore, picture: Picture
    ) -> FloatArray:
        """Carry confirmed tracks to the scan; returns p that each detection is one's, (d,).

        They take their detections at the density that was known before. With clusters, a target
        may have others beside its own.
        """
        state, extended, swept = self.sensor, self.sensor.extended_targets, 1.0
        if state.scan.swept is not None:
            swept = state.scan.swept[1] / state.model.sector_width
        turn = 1.0 if swept > WHOLE_SWEEP_SHARE else max(swept, 1e-3)
        several, self.method.sensor = extended.active, state.sensor_in_use
        in_use = state.detection_probability
        probability = self.method.maintain(
            self.maintenance,
            state.scan.stamp,
            detections,
            clutter.density,
            partial(state.detection_probability_at, probability=in_use),
            replaced(state.sensor_in_use, detection_probability=in_use),
            self.method.common.max_speed,
            picture.interval / turn,
            clutter.amplitudes,
            extent=extended.extent.along if several else 0.0,
            whole=swept > WHOLE_SWEEP_SHARE,
            picture=picture
            if turn == 1.0
            else replaced(picture, own=picture.own / turn, slowest=picture.slowest / turn),
        )
        if not several:
            return probability
        further = density_of_further(
            self.maintenance.confirmed,
            detections["position"],
            extended.extent,
            state.poses.middle[:2],
        )
        other = (1.0 - probability) * clutter.density / (clutter.density + further)
        return 1.0 - np.maximum(other, math.exp(-MAX_LOG_FACTOR))

    def _learn(
        self,
        detections: RecordArray,
        confirmed: FloatArray,
        interval: float,
        picture: Picture,
    ) -> None:
        """Learn from the detections, which are confirmed tracks' with a probability (d,)."""
        state, maintenance = self.sensor, self.maintenance
        state.learn_targets(detections, maintenance)
        if not state.extended_targets.active:
            maintenance.manoeuvre.update(
                *maintenance.innovations, self.method.common, interval, picture.interval
            )
        if state.scan.sensor:
            doubled = state.learn_alignment(detections, maintenance, self.sensors.values())
            maintenance.end(~doubled, "duplicate")
        state.learn(detections, confirmed, maintenance)
        if state.extended_targets.active:  # tracks of one target become one
            older = of_older_targets(maintenance.confirmed.tracks, NO_TRACKS, state.target_extent)
            maintenance.end(~older, "duplicate")
        detections["clutter_density"] = state.clutter.density

    def _observation(
        self,
        detections: RecordArray,
        clutter: ClutterBefore,
        confirmed: FloatArray,
        may_start: BoolArray,
        interval: float,
        picture: Picture,
    ) -> Observation:
        """What the method is given of the scan; its detections join the window."""
        state, maintenance = self.sensor, self.maintenance
        self.window.forget(self.scan_index + 1 - (picture.remembered or self.method.options.window))
        several, tracks = picture.sensors > 1, maintenance.confirmed.tracks
        in_use = state.detection_probability
        probable, _ = maintenance.probable_detections
        return Observation(
            stamp=state.scan.stamp,
            scan_index=self.scan_index,
            interval=interval,
            detections=detections,
            window=self.window,
            ids=self.window.append(detections),
            clutter_density=detections["clutter_density"] * clutter.of_rates,
            confirmed_probability=confirmed,
            may_start=may_start,
            tracks=tracks,
            detected=(tracks.track_id[:, None] == probable).any(axis=1),
            clutter_sensor=clutter.sensor,
            seen_extent=state.learned.clutter_map.seen.region.extent,
            sensor_position=state.poses.middle[:2],
            detection_probability=partial(state.detection_probability_at, probability=in_use),
            detection_probability_in_use=in_use,
            process_noise=maintenance.manoeuvre.process_noise(self.method.common, picture.interval),
            most_pairs=self.max_scan_time * PAIRS_PER_SECOND,
            picture=picture,
            begun=self.sensors.begun(picture, self.method.options.window) if several else None,
            errors=self.sensors.errors if several else None,
            amplitudes=clutter.amplitudes,
            predictive=state.clutter.predictive,
        )

    def _merge(self, result: MethodResult) -> MethodResult:
        """The result without the starts of targets that have a track; lost tracks go on from them.

        See `merging`.
        """
        self.revised, number = NO_TRACKS, len(result.tracks.track_id)
        if not number:
            return result
        state, maintenance = self.sensor, self.maintenance
        result = replaced(result, tracks=with_valid_covariances(result.tracks, self.method.common))
        counts = replaced(result.statistics, confirmed=result.statistics.confirmed - number)
        if result.paths:
            ids = maintenance.continued(result.tracks, result.paths, state.covered_area)
            again, result = result.where(ids >= 0), result.where(ids < 0)
            starts = again.tracks.numbered(ids[ids >= 0])
            self.revised = maintenance.find_again(starts, again.existences, again.paths)
            counts = replaced(counts, merged=counts.merged + len(starts))
        if result.paths and state.extended_targets.active:
            tracks = maintenance.confirmed.tracks
            older = of_older_targets(tracks, result.tracks, state.target_extent)
            result = result.where(~older[len(tracks) :])
        elif result.paths and state.errors_are_uncertain:
            factor = VARIANCE_FACTOR_BEFORE_LEARNING
            result = result.where(~maintenance.may_have_track(result.tracks, result.paths, factor))
        return replaced(result, statistics=counts)

    def _hold(self, starts: MethodResult) -> TrackArrays:
        """Hold the new tracks, and those that are published from now on; these are returned.

        What is theirs is taken back from the clutter.
        """
        state, maintenance = self.sensor, self.maintenance
        most_pairs = self.max_scan_time * PAIRS_PER_SECOND
        number = len(starts.tracks.track_id)
        limit = HELD_PER_PAIR * most_pairs - len(maintenance.confirmed.existence)
        room = int(max(min(limit, number), MIN_CONFIRMED_PER_SCAN))
        cut = max(number - room, 0)
        if cut:
            starts = starts.where(best_confirmed(starts.existences, starts.tracks.evaluation, room))
        if starts.target_probability is not None:
            state.learned.withdraw(state.clutter, starts.target_probability)
        new = starts.tracks
        if number:
            ids = free_ids(self.next_track_id, number - cut, maintenance.confirmed.tracks.track_id)
            self.next_track_id = int(ids[-1] + 1) % TRACK_IDS
            new = new.numbered(ids)
            state.take_hits(new, self.window)
            sigma = major_sigma(new.covariance[:, 0::2, 0::2])
            figures = initial_state.figures_of_hits(
                self.window, new.hits, new.stamp, new.state, sigma
            )
            new = maintenance.add(new, starts.existences, *figures, starts.paths)
        released = maintenance.released
        again = released.revision > 0
        if again.any():  # after they had coasted, or were outside the coverage
            self.revised = TrackArrays.joined(self.revised, released.where(again))
            released = released.where(~again)
        if len(released.track_id):  # confirmed now, after they had been held back
            first = np.array([hits[0][0] for hits in released.hits], np.int64)
            released = replaced(released, scan_count=self.scan_index + 1 - first)
            new = TrackArrays.joined(released, new)
        counts = starts.statistics
        self.statistics = replaced(
            counts,
            plots=counts.detections,
            confirmed=counts.confirmed + len(new.track_id),
            cut_confirmations=counts.cut_confirmations + cut,
            **state.received,
        )
        self.totals = self.totals + self.statistics
        return new

    @property
    def misalignments(self) -> dict[str, Misalignment]:
        """How each sensor's detections lie beside those of the others, where it is known."""
        return misalignments({name: state.alignment for name, state in self.sensors.items()})

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


def with_valid_covariances(tracks: TrackArrays, common: CommonOptions) -> TrackArrays:
    """Tracks with valid covariances and, if so set, a speed of at most `max_speed`."""
    tracks = tracks.proper()  # what follows inverts the covariances
    if common.limit_speed == "off":
        return tracks
    state, covariance = motion.limited(tracks.state, tracks.covariance, common.max_speed)
    return replaced(tracks, state=state, covariance=covariance).proper()


def free_ids(first: int, number: int, in_use: IntArray) -> IntArray:
    """The next ids from the first on, (number,), without those in use, which a tracker may give."""
    following = (first + np.arange(number + len(in_use))) % TRACK_IDS
    return following[~np.isin(following, in_use)][:number]
