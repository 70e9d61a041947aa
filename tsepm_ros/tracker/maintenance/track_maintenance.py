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
"""Confirmed tracks maintained: carried from scan to scan, updated by their detections, and ended.

The states of tracks that a downstream tracker lists replace those here. The rules that end
tracks here apply only to tracks that it has not listed yet.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.numerics.arrays import (
    BoolArray,
    FloatArray,
    IntArray,
    replaced,
    rows_of,
    rows_of_least_cost,
)
from tsepm_ros.tracker import merging, motion
from tsepm_ros.tracker.clutter.amplitude_law import ScanAmplitudes
from tsepm_ros.tracker.clutter.excess import PATH_SCANS
from tsepm_ros.tracker.evaluation import SCANS_FADED
from tsepm_ros.tracker.maintenance import branches, data_association
from tsepm_ros.tracker.maintenance.branches import Gated
from tsepm_ros.tracker.maintenance.confirmed_tracks import (
    LISTED_TIME,
    SCANS_TO_VANISH,
    ConfirmedTracks,
)
from tsepm_ros.tracker.maintenance.data_association import Pairs
from tsepm_ros.tracker.maintenance.target_manoeuvre import TargetManoeuvre
from tsepm_ros.tracker.measurement import HIT_KEYS, hit_keys
from tsepm_ros.tracker.options import CommonOptions
from tsepm_ros.tracker.sensor import MIN_CLUTTER_DENSITY, Picture, SensorModel
from tsepm_ros.tracker.tracks import (
    EVEN_PROBABILITY,
    MIN_EXISTENCE,
    NEW_TRACK_EXISTENCE,
    NO_TRACKS,
    SURE_PROBABILITY,
    TrackArrays,
    TrackStatus,
)

MAX_REMEMBERED_PLACES = 500
"""Fixed echoes outside the coverage whose places are remembered: the last ones."""


ENDS = {
    "missed": "its target was missed too often",
    "left": "its position left the coverage, by the course last seen",
    "not_detected": "its target was not detected for too long",
    "duplicate": "it is of the same target as an older track",
    "tracker": "the downstream tracker does not list it",
    "forgotten": "fixed echoes that left the coverage later are remembered",
    "cleared": "all tracks were cleared",
}
"""Why a track ends, in words."""


class ExternalTracker(enum.Enum):
    """Status of a downstream tracker."""

    NONE = "none"
    ALIVE = "alive"
    SILENT = "silent"


class TrackMaintenance:
    """Maintains confirmed tracks.

    A scan is taken by predicting the tracks, associating the detections, updating the tracks, and
    ending those whose target is gone or was not detected for a long time.

    Parameters
    ----------
    options : CommonOptions, optional
        With `hold_time`, `tracked_timeout`, `min_speed`, `max_speed` and `target_extent`.
    sensors : int, optional
        Number of sensors of the picture.

    Attributes
    ----------
    confirmed : ConfirmedTracks
        Every confirmed track, published or not, with all that is known of it.
    manoeuvre : TargetManoeuvre
        What the tracks' innovations show of the acceleration of targets.
    tracker : ExternalTracker
        Whether a downstream tracker was heard since the last clearing, and still is.
    last_report : float
        Stamp of its last report, s; -inf: none.
    silence : float
        Time from there to the last scan but one, which it could answer, s; nan: none.
    ended : dict
        Tracks that ended, or are no longer published, at the last step or since the one before: id
        and reason in `ENDS`.
    own_detections : OwnDetections
        Those that almost certainly are.
    probable_detections : OwnDetections
        Those that more probably are than not: at most one of each track.
    innovations : tuple of (k, 2) and (k, 2, 2) ndarray
        Those of detections that almost certainly are tracks' own, and their covariances.
    innovation_rows : (k,) ndarray of int
        These detections.
    covered : tuple of (k,) ndarray
        Samples of the detection probability, see `ConfirmedTracks.updated`.
    released : TrackArrays
        Tracks that were published by the last step, after they had been held back; those that were
        found again have a revision above 0.
    """

    def __init__(self, options: CommonOptions | None = None, sensors: int = 1) -> None:
        self.options, self.sensors = options or CommonOptions(), sensors
        self.ended: dict[int, str] = {}
        self._cleared: dict[int, str] = {}
        self.manoeuvre = TargetManoeuvre()
        self._forget()

    def _forget(self) -> None:
        self.confirmed = ConfirmedTracks.none(self.sensors)
        self._remembered = PATH_SCANS
        self.tracker, self.last_report = ExternalTracker.NONE, -math.inf
        self._answerable = self.silence = math.nan  # the first: stamp of the last scan
        self._hits = np.zeros(0, np.int64), np.zeros(0, np.int64)
        self._forget_scan()

    def _forget_scan(self) -> None:
        """Forget what the last step found."""
        none = np.zeros(0, np.int64)
        self.covered = np.zeros(0), np.zeros(0)
        self.innovations = np.zeros((0, 2)), np.zeros((0, 2, 2))
        self.own_detections = self.probable_detections = none, none
        self.innovation_rows = none
        self.released = NO_TRACKS

    @property
    def current(self) -> TrackArrays:
        """Published tracks, those that coast too, at the last scan's stamp.

        Between `follow` and `step` each is at its own stamp.
        """
        return self._state().published

    def _state(self) -> ConfirmedTracks:
        """Every confirmed track, with its probability to stand still."""
        self.confirmed = self.confirmed.stated(self.options)
        return self.confirmed

    @property
    def fixed_echoes(self) -> TrackArrays:
        """Confirmed tracks that exist and stand still, at their places."""
        return self._state().fixed_echoes

    def detections_of(self, which: BoolArray) -> IntArray:
        """Rows of the last scan's detections probably of some confirmed tracks (n,), (k,)."""
        ids, rows = self.probable_detections
        moving = self.confirmed.tracks.track_id[which]
        return rows[(ids[:, None] == moving).any(axis=1)]

    def step(
        self,
        stamp: float,
        detections: NDArray[np.void],
        clutter: FloatArray,
        detectable: Callable[[FloatArray], FloatArray],
        sensor: SensorModel,
        max_speed: float,
        interval: float = 0.0,
        amplitudes: ScanAmplitudes | None = None,
        *,
        extent: float = 0.0,
        whole: bool = True,
        picture: Picture | None = None,
    ) -> FloatArray:
        """Predict the tracks to a scan, associate its detections, update the tracks, and end some.

        For the equations see `maintenance.data_association` and `branches`.

        Parameters
        ----------
        stamp : float
            The scan's, s.
        detections : (d,) ndarray of DETECTION
        clutter : (d,) ndarray
            Clutter density lambda at each detection, 1/m^2.
        detectable : callable
            P_D of targets at positions (n, 2).
        sensor : SensorModel
        max_speed : float
            v_max, m/s: the velocity after a turn is unknown up to it.
        interval : float, optional
            Mean time between scans of the whole coverage, s; 0 if it is not known.
        amplitudes : ScanAmplitudes, optional
            What the amplitudes of the detections say.
        extent : float, optional
            Extent of targets, if it was learned, m.
        whole : bool, optional
            Whether the scan looked at the whole coverage; a target elsewhere is not away otherwise.
        picture : Picture, optional
            The sensor that looked, among several.

        Returns
        -------
        (d,) ndarray
            Probability that each detection is a confirmed track's, see
            `data_association.confirmed_probability`.
        """
        picture = picture or Picture(own=interval, slowest=interval, max_range=sensor.max_range)
        away = self._begin(stamp, picture.slowest, detectable)
        if not len(self.confirmed.existence):
            return np.zeros(len(detections))
        clutter = np.maximum(clutter, MIN_CLUTTER_DENSITY)
        noise = self.manoeuvre.process_noise(self.options, interval)
        confirmed = self.confirmed.predicted(stamp, max_speed, noise, away, self.options.min_speed)
        probability = detectable(confirmed.tracks.state[:, 0::2])
        covered = probability > 0.0
        outside = whole & ~covered & ~picture.covered_by_others(confirmed.tracks.state[:, 0::2])
        stays = _stays(outside, interval, picture)
        steps = float(motion.steps_of(picture.own or motion.MIN_STEP))
        counts = (covered | whole) & ~away
        confirmed = confirmed.existing(stays, counts, picture.number, steps)
        # Split, evaluate, prune.
        gated = self.gate(confirmed, stamp, detections, sensor)
        if amplitudes is not None and len(gated.row):
            increment = confirmed.amplitude_increment(gated.track_of_pair, gated.row, amplitudes)
            gated = gated._replace(likelihood=gated.likelihood * np.exp(increment))
        evaluated = branches.evaluate(
            confirmed.branches,
            gated,
            probability,
            sensor.detection_probability,
            clutter,
            picture.number,
        )
        empty, pairs = evaluated.of_tracks(confirmed.branches, len(detections))
        scan = confirmed.existence, empty, pairs, len(detections)
        owner = data_association.assigned(*scan)
        confirmed_probability = data_association.confirmed_probability(*scan)
        # A downstream tracker has a speed limit of its own.
        listed = self._kept_by_tracker(confirmed)
        limit = np.where(listed, np.inf, max_speed)
        after, ratio, own = branches.split(
            confirmed.branches, evaluated, owner, limit, picture.number
        )
        fits = branches.straight_fits(confirmed.fits, evaluated, owner, empty, ratio)
        confirmed, detected, scans = confirmed.updated(
            after, ratio, empty, fits, covered, picture.number
        )
        self.covered = detected, scans
        of_target = own.ratio * confirmed.existence[own.track]
        confirmed = confirmed.with_amplitudes(
            own.track, of_target, detections["amplitude"][own.row]
        )
        confirmed = confirmed.judged(self.options)
        self._take_own(confirmed, listed, own._replace(ratio=of_target), gated, detections, picture)
        # End.
        exists = confirmed.existence >= MIN_EXISTENCE
        kept = self.end(exists, np.where(covered, "missed", "left"))
        self._publish(picture, extent, outside[kept])
        return confirmed_probability

    def gate(
        self,
        confirmed: ConfirmedTracks,
        stamp: float,
        detections: NDArray[np.void],
        sensor: SensorModel,
    ) -> Gated:
        """Detections in the gates of tracks, and how well they fit; see `branches.gate`."""
        return branches.gate(confirmed.branches, confirmed.fits, stamp, detections, sensor)

    def _take_own(
        self,
        confirmed: ConfirmedTracks,
        listed: BoolArray,
        pairs: Pairs,
        gated: Gated,
        detections: NDArray[np.void],
        picture: Picture,
    ) -> None:
        """Hold the updated rows, with the detections that are probably their own.

        Those that a downstream tracker lists (n,) show no innovation.
        """
        ids = confirmed.tracks.track_id
        certain, probable = (
            (pairs.ratio > least).nonzero()[0] for least in (SURE_PROBABILITY, EVEN_PROBABILITY)
        )
        self.own_detections, self.probable_detections = (
            (ids[pairs.track[rows]], pairs.row[rows]) for rows in (certain, probable)
        )
        certain = certain[~listed[pairs.track[certain]]]
        self.innovation_rows = pairs.row[certain]
        self.innovations = gated.innovations(pairs.track[certain], self.innovation_rows)
        own = rows_of(detections, pairs.row[probable])
        self._remembered = max(PATH_SCANS, picture.remembered)
        self._remember(hit_keys(own), ids[pairs.track[probable]])
        sigma = confirmed.hit_sigma.copy()
        sigma[pairs.track[probable], picture.number] = own["major_sigma"]
        self.confirmed = replaced(confirmed, hit_sigma=sigma)

    def _publish(self, picture: Picture, extent: float, outside: BoolArray) -> None:
        """State the status of each track, and which are published from now on or no longer.

        A track is no longer published that coasts below `min_existence`, or was not detected and is
        outside a coverage (n,) that was looked at whole. It is held silently, to be found again.
        """
        if self.options.min_speed:
            self._state()
        status = self.confirmed.statuses(self.options, picture.max_range, extent, picture.living)
        listed = self._kept_by_tracker(self.confirmed)
        sure, coasts = TrackStatus.CONFIRMED, TrackStatus.COASTING
        status = np.where(listed & (status == coasts), sure, status)
        least = self.options.min_existence
        left = (
            outside & (self.confirmed.last_detected < self.confirmed.tracks.stamp) & (least > 0.0)
        )
        lost = (status == coasts) & (self.confirmed.existence < least)
        gone = (lost | left) & ~listed & (status != TrackStatus.STANDS_STILL)
        if gone.any():
            self._note_ended(gone, np.where(left, "left", "missed"), self.ended)
        back = (self.confirmed.tracks.revision > 0) & (self.confirmed.existence >= EVEN_PROBABILITY)
        new = ((status == sure) | back) & ~self.confirmed.announced & ~gone
        tracks, announced = self.confirmed.tracks, self.confirmed.announced
        revision = tracks.revision + (gone & announced)
        tracks = replaced(tracks, status=status, revision=revision)
        self.confirmed = replaced(
            self.confirmed,
            tracks=tracks,
            announced=(announced | new) & ~gone,
            # A downstream tracker has known them from now on only.
            unlisted_since=np.where(new, tracks.stamp, self.confirmed.unlisted_since),
        )
        self.released = tracks.where(new) if new.any() else NO_TRACKS

    def _remember(self, keys: IntArray, track_id: IntArray) -> None:
        """Remember hits of tracks (h,), for some scans."""
        keys, ids = np.append(self._hits[0], keys), np.append(self._hits[1], track_id)
        kept = keys >= keys.max(initial=0) - self._remembered * HIT_KEYS
        self._hits = keys[kept], ids[kept]

    def continued(
        self, starts: TrackArrays, paths: Sequence[IntArray], coverage_area: float
    ) -> IntArray:
        """Ids of the confirmed tracks that starts (n,) continue; -1 for new targets.

        See `merging.continued`. Targets are born, in the mean, as often as they vanish, uniform in
        the coverage (m^2) and the velocities up to `max_speed`. Fixed echoes and the tracks that a
        downstream tracker lists are left as they are.
        """
        confirmed, max_speed = self.confirmed, self.options.max_speed
        may = (confirmed.status != TrackStatus.STANDS_STILL) & ~self._kept_by_tracker(confirmed)
        lost = confirmed[may.nonzero()[0]]
        if not len(starts) or not len(lost):
            return np.full(len(starts), -1)
        lost = lost.stated(self.options)
        births = (1.0 + len(confirmed)) * SCANS_FADED / SCANS_TO_VANISH
        return merging.continued(
            starts,
            paths,
            lost.tracks,
            lost.existence,
            lost.last_place,
            self._hits,
            max_speed,
            births / (coverage_area * math.pi * max_speed**2),
        )

    def may_have_track(
        self, starts: TrackArrays, paths: Sequence[IntArray], factor: float
    ) -> BoolArray:
        """Which starts (n,) may be of targets that exist; see `merging.may_have_track`."""
        known = self.confirmed.tracks.where(self.confirmed.existence > EVEN_PROBABILITY)
        return merging.may_have_track(starts, paths, known, self._hits, factor)

    def add(
        self,
        tracks: TrackArrays,
        existence: float | FloatArray,
        misfit: float | FloatArray = 1.0,
        amplitudes: tuple[FloatArray, FloatArray] | None = None,
        hit_sigma: FloatArray | None = None,
        paths: Sequence[IntArray] = (),
    ) -> TrackArrays:
        """Hold newly confirmed tracks whose targets exist with a probability, a number or (n,).

        Their covariances are too small for the hits by factors `misfit`; `amplitudes` and
        `hit_sigma`: `ConfirmedTracks.from_tracks`. The hits of their best hypotheses, `paths`, as
        `hit_keys`, tell whether a later start continues them.
        Those that are published at once are returned.
        """
        if not len(tracks):
            return tracks
        new = ConfirmedTracks.from_tracks(
            tracks, existence, misfit, amplitudes, hit_sigma, self.confirmed.sensors
        )
        self._remember_paths(tracks.track_id, paths)
        new = replaced(new, announced=np.zeros(len(new), bool))
        new = new.judged(self.options).stated(self.options)
        fixed = new.stands_still(self.options)
        status = np.where(fixed, TrackStatus.STANDS_STILL, TrackStatus.CONFIRMED)
        new = replaced(new, tracks=replaced(new.tracks, status=status), announced=~fixed)
        self.confirmed = ConfirmedTracks.joined(self.confirmed, new)
        return new.tracks.where(~fixed)

    def find_again(
        self, starts: TrackArrays, existence: FloatArray, paths: Sequence[IntArray]
    ) -> TrackArrays:
        """Let confirmed tracks go on from starts, by their ids, whose targets exist with (n,).

        Returns
        -------
        TrackArrays
            Those that are published.
        """
        if not len(starts):
            return starts
        self.confirmed = self.confirmed.continued(starts, existence).judged(self.options)
        self._remember_paths(starts.track_id, paths)
        current = self.current
        return current.where(np.isin(current.track_id, starts.track_id))

    def _remember_paths(self, track_id: IntArray, paths: Sequence[IntArray]) -> None:
        """Remember the hits of starts, by their tracks' ids."""
        if len(paths):
            self._remember(np.concatenate(paths), track_id.repeat(list(map(len, paths))))

    def follow(self, stamp: float, tracks: TrackArrays, unusable: Sequence[int] = ()) -> None:
        """Take over what a downstream tracker reports, before the next step.

        A track of the same id gets the tracker's state, and keeps its other figures; a track of
        another id joins. A track that the tracker listed before, and lists no more, ends. A track
        that it has not listed yet is held by the rules here, and ends where the tracker, heard all
        the while, has not listed it for `tracked_timeout`. After a silence, all begin to wait
        again.

        Parameters
        ----------
        stamp : float
            Time of the report, s; it may be later than the next step's.
        tracks : TrackArrays
            With stamps of their own, finite numbers and an id each, see
            `tsepm_ros.session.inputs.usable_input_tracks`.
        unusable : sequence of int, optional
            Ids of others that it lists, with figures that cannot be used.
        """
        self._listen(stamp)
        confirmed = self._state()
        since, ids = confirmed.unlisted_since, confirmed.tracks.track_id
        if self.tracker is not ExternalTracker.ALIVE:
            since = np.maximum(since, stamp)
        self.tracker, self.last_report = ExternalTracker.ALIVE, stamp
        over = stamp - since > self.options.tracked_timeout
        over &= ~np.isin(ids, [*tracks.track_id, *unusable])
        moves = confirmed.status != TrackStatus.STANDS_STILL
        over &= confirmed.announced & (moves | (since == LISTED_TIME))
        self.confirmed = replaced(confirmed, unlisted_since=since)
        self._drop(~over, "tracker", self._cleared)
        self.add(tracks[~np.isin(tracks.track_id, ids)], NEW_TRACK_EXISTENCE)
        self.confirmed = self.confirmed.listed(tracks, NEW_TRACK_EXISTENCE)

    def _listen(self, stamp: float) -> None:
        """A tracker whose last report is too long before a time (s) is silent."""
        silent = stamp - self.last_report > self.options.tracked_timeout
        if self.tracker is ExternalTracker.ALIVE and silent:
            self.tracker = ExternalTracker.SILENT

    def _kept_by_tracker(self, confirmed: ConfirmedTracks) -> BoolArray:
        """Which tracks (n,) the downstream tracker keeps: those listed while it is heard."""
        return (confirmed.unlisted_since == LISTED_TIME) & (self.tracker is ExternalTracker.ALIVE)

    def clear(self) -> None:
        """End every track and forget what a downstream tracker said, but not what was learned."""
        self._drop(np.zeros(len(self.confirmed), bool), "cleared", self._cleared)
        self._forget()

    def _begin(
        self, stamp: float, interval: float, detectable: Callable[[FloatArray], FloatArray]
    ) -> BoolArray:
        """Begin a step: forget the last one's, and end the tracks that are over their time.

        Returns which are fixed echoes outside the coverage: these are remembered.
        """
        self.ended, self._cleared = self._cleared, {}
        self._forget_scan()
        self._listen(self._answerable)
        before, self._answerable = self._answerable, stamp
        self.silence = before - self.last_report
        fixed = self.confirmed.tracks.status == TrackStatus.STANDS_STILL
        away = fixed.copy()
        if fixed.any():
            away &= detectable(self.confirmed.tracks.state[:, 0::2]) <= 0.0
        last = self.confirmed.last_detected
        hold_time, step = self.options.hold_time, interval and max(interval, motion.MIN_STEP)
        held = last >= stamp - (hold_time or SCANS_TO_VANISH * step or np.inf)
        # The usual interval follows another scan rate late: no scan has missed these yet.
        not_missed = (last >= before) & (not hold_time)
        away = away[self.end(fixed | held | not_missed, "not_detected")]
        most = MAX_REMEMBERED_PLACES if self.options.min_speed else 0
        if np.count_nonzero(away) > most:
            kept = ~away
            kept[away.nonzero()[0][np.count_nonzero(away) - most :]] = True
            away = away[self.end(kept, "forgotten")]
        return away

    def end(self, kept: BoolArray, reason: str | NDArray[np.str_]) -> BoolArray:
        """End all tracks but those kept and those that the downstream tracker lists.

        Returns which were kept.
        """
        if not kept.all():
            kept = kept | self._kept_by_tracker(self.confirmed)
            self._drop(kept, reason, self.ended)
        return kept

    def _drop(self, kept: BoolArray, reason: str | NDArray[np.str_], ended: dict[int, str]) -> None:
        """Keep some tracks (n,), and note the others that are published as ended."""
        self._note_ended(~kept, reason, ended)
        self.confirmed = self.confirmed[kept]

    def _note_ended(
        self, over: BoolArray, reason: str | NDArray[np.str_], ended: dict[int, str]
    ) -> None:
        """Note which of the tracks that are over (n,) were published, with the reason."""
        rows = (self.confirmed.announced & over).nonzero()[0]
        ids = self.confirmed.tracks.track_id[rows].tolist()
        ended |= dict(zip(ids, np.broadcast_to(reason, len(over))[rows].tolist(), strict=True))


def _stays(outside: BoolArray, interval: float, picture: Picture) -> FloatArray:
    """Probability that targets (n,) stay from a scan to the next one of any sensor.

    It is ``1 - 1 / SCANS_TO_VANISH`` over a scan of the slowest living sensor, or a second where
    that is longer. A target outside every coverage is as one that has faded, ``1 - 1 /
    SCANS_FADED``: it stays away or comes back.
    """
    slowest = max(picture.slowest, motion.MIN_STEP)
    vanished = (interval or motion.MIN_STEP) / slowest / SCANS_TO_VANISH
    left = picture.counts_absence * motion.steps_of(picture.slowest or slowest) / SCANS_FADED
    return np.where(outside, 1.0 - left, 1.0 - vanished)


def best_confirmed(existence: FloatArray, evaluation: FloatArray, number: int) -> IntArray:
    """Rows of the new tracks (n,) that are kept, ascending.

    Those that exist most probably, and of equal ones those of the smallest evaluation.
    """
    rank = np.empty(len(existence))
    rank[np.lexsort((evaluation, -existence))] = np.arange(len(existence))
    return rows_of_least_cost(rank, number)
