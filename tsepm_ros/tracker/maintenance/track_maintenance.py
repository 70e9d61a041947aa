"""Confirmed tracks maintained: carried from scan to scan, updated by their detections, and ended.

The states of tracks that a downstream tracker lists replace those here. The rules that end
tracks here apply only to tracks that it has not listed yet.
"""

from __future__ import annotations

import enum
import math
from collections import deque
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.numerics.arrays import (
    BoolArray,
    FloatArray,
    IntArray,
    array_rows_of_least_cost,
    changed,
    taken,
    with_rows,
)
from tsepm_ros.tracker import merging
from tsepm_ros.tracker.maintenance import data_association
from tsepm_ros.tracker.maintenance.confirmed_tracks import LISTED, SURE, ConfirmedTracks, Status
from tsepm_ros.tracker.maintenance.data_association import GatedDetections
from tsepm_ros.tracker.options import GATE_PROBABILITY, CommonOptions
from tsepm_ros.tracker.sensor import MIN_CLUTTER_DENSITY, SensorModel
from tsepm_ros.tracker.tracks import (
    MIN_EXISTENCE,
    NEW_TRACK_EXISTENCE,
    NO_TRACKS,
    PROBABLE,
    TrackArrays,
)

REMEMBERED_SCANS = 16
"""Scans whose detections of confirmed tracks are remembered, for starts by these."""
HOLD_SCANS = 50
"""Scans after whose time without a detection a track ends, where `hold_time` is 0: a choice."""
MOST_PLACES = 500
"""Fixed echoes outside the coverage whose places are remembered: the last ones."""


ENDS = {
    "missed": "its target was missed too often",
    "left": "its target left the coverage",
    "not_detected": "its target was not detected for the longest coast",
    "duplicate": "it is of the same target as an older track",
    "replaced": "its detections are another target's, whose track begins",
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
    ending those whose target is gone, was not detected for a long time, or has an older track.

    Parameters
    ----------
    options : CommonOptions, optional
        With `hold_time`, `tracked_timeout`, `min_speed`, `max_speed` and `target_extent`.

    Attributes
    ----------
    confirmed : ConfirmedTracks
        Every confirmed track, published or not, with all that is known of it.
    tracker : ExternalTracker
        Whether a downstream tracker was heard since the last clearing, and still is.
    ended : dict
        Tracks that ended at the last step, or since the one before: id and reason in `ENDS`.
    confirmed_association : tuple of (p,) ndarray
        Detections of the last scan that may be the tracks', and the probability ``r_i beta_ij`` of
        each that the target exists and the detection is its.
    own_detections : OwnDetections
        Those that almost certainly are.
    probable_detections : OwnDetections
        Those that more probably are than not: at most one of each track.
    nearest_detections : OwnDetections
        The detection nearest to each track that was more probably detected than not.
    covered : tuple of (k,) ndarray
        Samples of the detection probability, see `ConfirmedTracks.updated`.
    released : TrackArrays
        Tracks that were published by the last step, after they had been held back.
    """

    def __init__(self, options: CommonOptions | None = None) -> None:
        self.options = options or CommonOptions()
        self.ended: dict[int, str] = {}
        self._cleared: dict[int, str] = {}
        self._forget()

    def _forget(self) -> None:
        self.confirmed = ConfirmedTracks.none()
        self.tracker, self._last_report = ExternalTracker.NONE, -math.inf
        self._begun: dict[tuple[int, int], int] = {}
        self._owned: deque[tuple[IntArray, IntArray]] = deque(maxlen=REMEMBERED_SCANS)
        self._forget_scan()

    def _forget_scan(self) -> None:
        """Forget what the last step found."""
        none = np.zeros(0, np.int64)
        self.confirmed_association, self.covered = (none, np.zeros(0)), (np.zeros(0), np.zeros(0))
        self.own_detections = self.probable_detections = self.nearest_detections = none, none
        self.released = NO_TRACKS

    @property
    def current(self) -> TrackArrays:
        """Published tracks, at the last scan's stamp; between `follow` and `step` at their own."""
        confirmed = self._state()
        return confirmed.tracks.where(confirmed.status == Status.PUBLISHED)

    def _state(self) -> ConfirmedTracks:
        """Every confirmed track, with its probability to stand still."""
        self.confirmed = self.confirmed.stated(self.options)
        return self.confirmed

    @property
    def fixed_echoes(self) -> TrackArrays:
        """Confirmed tracks that exist and stand still, at their places."""
        return self._state().fixed_echoes

    def detections_of_moving(self) -> IntArray:
        """Rows of the last scan's detections probably of confirmed tracks that move, (k,)."""
        ids, rows = self.probable_detections
        moving = self.confirmed.tracks.track_id[self.confirmed.fits.moves]
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
        *,
        whole: bool = True,
    ) -> FloatArray:
        """Predict the tracks to a scan, associate its detections, update the tracks, and end some.

        For the equations see `maintenance.data_association`.

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
            Median time between scans of the whole coverage, s; 0 if it is not known.
        whole : bool, optional
            Whether the scan looked at the whole coverage; a target elsewhere is not away otherwise.

        Returns
        -------
        (d,) ndarray
            Density at each detection, 1/m^2, of the confirmed targets' detections, to be added to
            the clutter density; see `data_association.associate`.
        """
        away = self._begin(stamp, interval, detectable)
        if not len(self.confirmed):
            return np.zeros(len(detections))
        confirmed = self.confirmed.predicted(stamp, max_speed, away)
        probability = detectable(confirmed.tracks.state[:, 0::2])
        covered = probability > 0.0
        confirmed = confirmed.existing(covered, covered | (whole & ~away))
        # Associate.
        empty = 1.0 - confirmed.visible * probability * GATE_PROBABILITY
        state, covariance = (
            np.concatenate(
                [getattr(confirmed.models, name), getattr(confirmed.fits, name)[:, None]], axis=1
            )
            for name in ("state", "covariance")
        )
        gated = self.gate(confirmed, state, covariance, stamp, detections, sensor)
        row, clutter = gated.row, np.maximum(clutter, MIN_CLUTTER_DENSITY)
        # A detection was possible where there is one, wherever the data sheet ends the coverage.
        scale = (confirmed.visible * sensor.detection_probability)[:, None, None] / clutter[row]
        ratios = gated.likelihood * scale[:, data_association.SEEKER]
        ratio, share, confirmed_density = data_association.associate(
            confirmed.existence, empty, confirmed.models.probability, ratios, row, clutter
        )
        # Update.
        mode_ratios = empty[:, None] + ratio.sum(axis=-1)
        state, covariance = data_association.updated_states(
            state, covariance, gated, ratio / mode_ratios[..., None]
        )
        # A downstream tracker has a speed limit of its own.
        limit = np.where(self._kept_by_tracker(confirmed), np.inf, max_speed)
        row, shares = row[:, 0], share[:, 0]
        confirmed, detected, scans = confirmed.updated(
            state, covariance, mode_ratios, empty, covered, limit
        )
        self.covered = detected, scans
        of_target = shares * confirmed.existence[:, None]
        confirmed = confirmed.with_amplitudes(row, of_target, detections["amplitude"])
        confirmed = confirmed.judged(self.options)
        sigma = self._take_own(confirmed, row, of_target, detections)
        # End.
        exists = confirmed.existence >= MIN_EXISTENCE
        explained = of_target.sum(axis=1)
        if len(detections):
            seen = np.flatnonzero(explained > PROBABLE)
            self.nearest_detections = confirmed.tracks.track_id[seen], row[seen, 0]
        kept = self.end(exists, np.where(covered, "missed", "left"))
        repeats = self._repeated(sigma[kept], explained[kept])
        self.end(~repeats, "duplicate")
        self._publish(sensor.max_range)
        return confirmed_density

    def gate(
        self,
        confirmed: ConfirmedTracks,
        state: FloatArray,
        covariance: FloatArray,
        stamp: float,
        detections: NDArray[np.void],
        sensor: SensorModel,
    ) -> GatedDetections:
        """Detections in the gates of tracks, and how well they fit; see `data_association.gate`."""
        means = np.stack([confirmed.tracks.state, confirmed.fits.state], axis=1)
        return data_association.gate(state, covariance, means, stamp, detections, sensor)

    def _take_own(
        self,
        confirmed: ConfirmedTracks,
        row: IntArray,
        of_target: FloatArray,
        detections: NDArray[np.void],
    ) -> FloatArray:
        """Hold the updated rows, with the detections (n, k) that are probably their own.

        Returns the error of the detection nearest to each, (n,), m.
        """
        possible, probable, certain = (
            (of_target > least).nonzero() for least in (0.0, PROBABLE, SURE)
        )
        self.confirmed_association = row[possible], of_target[possible]
        self.own_detections, self.probable_detections = (
            (confirmed.tracks.track_id[pairs[0]], row[pairs]) for pairs in (certain, probable)
        )
        own = taken(detections, row[probable])
        hits = np.stack([own["scan"], own["index"]], axis=1)
        self._owned.append((hits, self.probable_detections[0]))
        self.confirmed = with_rows(confirmed, probable[0], hit_sigma=own["major_sigma"])
        return detections["major_sigma"][row[:, 0]] if len(detections) else np.zeros(len(confirmed))

    def _publish(self, max_range: float) -> None:
        """Publish, withhold or fix each track; those that are published for the first time."""
        if self.options.min_speed:
            self._state()
        status = self.confirmed.statuses(self.options, max_range)
        listed = self._kept_by_tracker(self.confirmed)
        status = np.where(listed & (status == Status.WITHHELD), Status.PUBLISHED, status)
        new = (status == Status.PUBLISHED) & ~self.confirmed.announced
        self.confirmed = confirmed = changed(
            self.confirmed,
            status=status,
            announced=self.confirmed.announced | new,
            # A downstream tracker has known them from now on only.
            unlisted_since=np.where(
                new, self.confirmed.tracks.stamp, self.confirmed.unlisted_since
            ),
        )
        self.released = confirmed.tracks.where(new) if new.any() else NO_TRACKS

    def _remember_starts(self, tracks: TrackArrays) -> None:
        begun = {
            hit: i
            for i, hits in zip(tracks.track_id.tolist(), tracks.hits, strict=True)
            for hit in hits
        }
        newest = max((scan for scan, _ in begun), default=0)
        before = {hit: i for hit, i in self._begun.items() if hit[0] > newest - REMEMBERED_SCANS}
        self._begun = before | begun

    def recognised(self, starts: TrackArrays, coverage_area: float) -> IntArray:
        """Ids of the confirmed tracks that starts (n,) are, or continue; -1 for new targets.

        See `merging.own_starts` and `continued`. Targets are born, in the mean, as often as
        they vanish, uniform in the coverage (m^2) and the velocities up to `max_speed`. Fixed
        echoes and the tracks that a downstream tracker lists are left as they are.
        """
        confirmed = self.confirmed
        may = (confirmed.status != Status.FIXED) & ~self._kept_by_tracker(confirmed)
        rows = np.flatnonzero(may)
        if not len(starts) or not len(rows):
            return np.full(len(starts), -1)
        known = set(confirmed.tracks.track_id.tolist())
        by_scan = [
            {(scan, row): i for (scan, row), i in zip(hits.tolist(), ids.tolist(), strict=True)}
            for hits, ids in self._owned
        ]
        remembered = [*by_scan, self._begun]
        owned = {hit: i for claims in remembered for hit, i in claims.items() if i in known}
        mine = {hit for hits in starts.hits for hit in hits}
        busy = (
            {track for hit, track in by_scan[-1].items() if hit not in mine} if by_scan else set()
        )
        busy |= set(confirmed.tracks.track_id[~may].tolist())
        ids = merging.own_starts(starts, owned, frozenset(busy))
        others, lost = np.flatnonzero(ids < 0), rows[~np.isin(confirmed.tracks.track_id[rows], ids)]
        volume = coverage_area * math.pi * self.options.max_speed**2
        births = (
            (1.0 + len(confirmed))
            * data_association.SCANS_OF_FADING
            / data_association.SCANS_TO_VANISH
            / volume
        )
        ids[others] = merging.continued(
            starts.where(others),
            confirmed.tracks.where(lost),
            confirmed.existence[lost],
            owned,
            births,
        )
        return ids

    def add(
        self,
        tracks: TrackArrays,
        existence: float | FloatArray,
        misfit: float | FloatArray = 1.0,
        amplitudes: tuple[FloatArray, FloatArray] | None = None,
        hit_sigma: FloatArray | None = None,
    ) -> TrackArrays:
        """Hold newly confirmed tracks whose targets exist with a probability, a number or (n,).

        Their covariances are too small for the hits by factors `misfit`; `amplitudes` and
        `hit_sigma`: `ConfirmedTracks.from_tracks`.
        Those that are published at once are returned.
        """
        if not len(tracks):
            return tracks
        self._remember_starts(tracks)
        new = ConfirmedTracks.from_tracks(tracks, existence, misfit, amplitudes, hit_sigma)
        confirmed = ConfirmedTracks.joined(
            self.confirmed, changed(new, announced=np.zeros(len(new), bool))
        )
        confirmed = confirmed.judged(self.options).stated(self.options)
        first = len(confirmed) - len(new)
        fixed = confirmed.stands_still(self.options)[first:]
        status, announced = confirmed.status.copy(), confirmed.announced.copy()
        status[first:] = np.where(fixed, Status.FIXED, Status.PUBLISHED)
        announced[first:] = ~fixed
        self.confirmed = changed(confirmed, status=status, announced=announced)
        return confirmed.tracks.where(first + np.flatnonzero(~fixed))

    def revise(
        self,
        corrected: TrackArrays,
        replaced: Sequence[int] = (),
        existence: FloatArray | None = None,
    ) -> TrackArrays:
        """Correct the starts of confirmed tracks, by their ids, and end tracks that were replaced.

        A track that a downstream tracker lists does not end. With the `existence` of each, the
        tracks were lost and are found again.

        Returns
        -------
        TrackArrays
            The published tracks that were corrected.
        """
        if replaced:
            self.end(~np.isin(self.confirmed.tracks.track_id, replaced), "replaced")
        if not len(corrected):
            return corrected
        self._remember_starts(corrected)
        confirmed = self.confirmed.revised(corrected, existence)
        self.confirmed = confirmed.judged(self.options)
        current = self.current
        return current.where(np.isin(current.track_id, corrected.track_id))

    def follow(self, stamp: float, tracks: TrackArrays) -> None:
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
            `tsepm_ros.session.inputs.usable`.
        """
        self._listen(stamp)
        confirmed = self._state()
        since, ids = confirmed.unlisted_since, confirmed.tracks.track_id
        if self.tracker is not ExternalTracker.ALIVE:
            since = np.maximum(since, stamp)
        self.tracker, self._last_report = ExternalTracker.ALIVE, stamp
        over = (stamp - since > self.options.tracked_timeout) & ~np.isin(ids, tracks.track_id)
        over &= confirmed.announced & ((confirmed.status != Status.FIXED) | (since == LISTED))
        self.confirmed = changed(confirmed, unlisted_since=since)
        self._drop(~over, "tracker", self._cleared)
        self.add(tracks[~np.isin(tracks.track_id, ids)], NEW_TRACK_EXISTENCE)
        self.confirmed = self.confirmed.listed(tracks, NEW_TRACK_EXISTENCE)

    def _listen(self, stamp: float) -> None:
        """A tracker whose last report is too far from a time (s) is silent."""
        silent = abs(stamp - self._last_report) > self.options.tracked_timeout
        if self.tracker is ExternalTracker.ALIVE and silent:
            self.tracker = ExternalTracker.SILENT

    def _kept_by_tracker(self, confirmed: ConfirmedTracks) -> BoolArray:
        """Which tracks (n,) the downstream tracker keeps: those listed while it is heard."""
        return (confirmed.unlisted_since == LISTED) & (self.tracker is ExternalTracker.ALIVE)

    def clear(self) -> None:
        """End every track and forget what a downstream tracker said."""
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
        self._listen(stamp)
        fixed = self.confirmed.status == Status.FIXED
        away = fixed.copy()
        if fixed.any():
            away &= detectable(self.confirmed.tracks.state[:, 0::2]) <= 0.0
        last = self.confirmed.last_detected
        longest = self.options.hold_time or HOLD_SCANS * interval or np.inf
        away = away[self.end(fixed | (last >= stamp - longest), "not_detected")]
        most = MOST_PLACES if self.options.min_speed else 0
        if np.count_nonzero(away) > most:
            kept = ~away
            kept[np.flatnonzero(away)[np.count_nonzero(away) - most :]] = True
            away = away[self.end(kept, "forgotten")]
        return away

    def _repeated(self, detection_sigma: FloatArray, explained: FloatArray) -> BoolArray:
        """Which tracks have for some scans been where an older one is, (n,)."""
        tracks, before = self.confirmed.tracks, self.confirmed.agreeing_scans
        known = merging.located(tracks.covariance, detection_sigma)
        agrees = merging.agrees_with_older(tracks.state, tracks.covariance, known, explained)
        scans = np.where(agrees, before + 1, np.where(known, 0, before))
        self.confirmed = changed(self.confirmed, agreeing_scans=scans)
        return scans >= merging.SAME_SCANS

    def end(self, kept: BoolArray, reason: str | NDArray[np.str_]) -> BoolArray:
        """End all tracks but those kept and those that the downstream tracker lists.

        Returns which were kept.
        """
        if not kept.all():
            kept = kept | self._kept_by_tracker(self.confirmed)
            self._drop(kept, reason, self.ended)
        return kept

    def _drop(self, kept: BoolArray, reason: str | NDArray[np.str_], ended: dict[int, str]) -> None:
        """Keep some tracks (n,), and note the others that were announced as ended."""
        over = np.flatnonzero(self.confirmed.announced & ~kept)
        ids = self.confirmed.tracks.track_id[over].tolist()
        reasons = np.broadcast_to(reason, len(kept))[over].tolist()
        ended |= dict(zip(ids, reasons, strict=True))
        self.confirmed = self.confirmed[kept]


def best_confirmed(existence: FloatArray, evaluation: FloatArray, number: int) -> IntArray:
    """Rows of the new tracks (n,) that are kept, ascending.

    Those that exist most probably, and of equal ones those of the smallest evaluation.
    """
    rank = np.empty(len(existence))
    rank[np.lexsort((evaluation, -existence))] = np.arange(len(existence))
    return array_rows_of_least_cost(rank, number)
