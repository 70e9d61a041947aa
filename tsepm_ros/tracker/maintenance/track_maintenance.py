"""Confirmed tracks maintained: carried from scan to scan, updated by their detections, and ended.

The states of tracks that a downstream tracker lists replace the held states. The rules that end
tracks here apply only to tracks that it has not listed yet.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray, changed
from tsepm_ros.tracker.clustering import PlotExtent
from tsepm_ros.tracker.maintenance import (
    duplicates,
    features,
    gated_detections,
    ipda,
    publication,
    stationary,
    track_update,
)
from tsepm_ros.tracker.maintenance.confirmed_tracks import HeldTracks, Status
from tsepm_ros.tracker.maintenance.external_tracker import (
    LISTED,
    DownstreamTracker,
    ExternalTracker,
    declined,
)
from tsepm_ros.tracker.maintenance.features import Environment
from tsepm_ros.tracker.maintenance.gated_detections import (
    GATE_PROBABILITY,
    NO_ASSOCIATION,
    NO_OWN_DETECTIONS,
    HeldAssociation,
    Neighbours,
    OwnDetections,
)
from tsepm_ros.tracker.maintenance.stationary import SpeedPrior
from tsepm_ros.tracker.maintenance.track_update import CoveredTracks
from tsepm_ros.tracker.measurement import Histories
from tsepm_ros.tracker.sensor import MIN_CLUTTER_DENSITY, SensorModel
from tsepm_ros.tracker.tracks import NO_TRACKS, TrackArrays

MIN_EXISTENCE = 0.01
"""Probability of existence below which a track ends."""
REMEMBERED_SCANS = 16
"""Scans whose detections of held tracks are remembered, for starts by these."""
HOLD_SCANS = 50
"""Scans after whose time without a detection a track ends, where `hold_time` is 0: a choice."""
MOST_PLACES = 500
"""Fixed echoes outside the coverage whose places are remembered: the last ones."""
TRACKED_EXISTENCE = 0.99
"""Existence probability of a target that a downstream tracker lists: a choice."""
ALMOST_CERTAIN = 0.9
"""Probability from which on a detection is almost certainly a track's."""
PROBABLE = 0.5
"""Probability above which a detection is more probably a track's than not."""


NO_COVERED_TRACKS = CoveredTracks(np.zeros(0), np.zeros(0))
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


class TrackMaintenance:
    """Maintains confirmed tracks.

    A scan is taken by predicting the tracks, associating the detections, updating the tracks, and
    ending those whose target is gone, was not detected for a long time, or has an older track.

    Parameters
    ----------
    hold_time : float
        Time, s, for which a track is held without a detection of its own; it ends at the first scan
        after that, or sooner, where its target was missed so often that it probably exists no more,
        or where it repeats an older track. 0: the time of `HOLD_SCANS` scans
        of the whole coverage.
    tracked_timeout : float, optional
        Time, s, after which a downstream tracker without a report is silent, and for which it may
        leave a track unlisted before that counts as declined.
    speed_prior : SpeedPrior, optional
        With a `min_speed` tracks are published while they move faster; until then they are held all
        the same.
    target_extent : float, optional
        m, 0 if not known: a position error below it still says where a target is.

    Attributes
    ----------
    held_association : HeldAssociation
        Detections of the last scan that may be the tracks'.
    own_detections : OwnDetections
        Those that almost certainly are.
    probable_detections : OwnDetections
        Those that more probably are than not: at most one of each track.
    nearest_detections : OwnDetections
        The detection nearest to each track that was more probably detected than not.
    covered : CoveredTracks
        Tracks that the last scan covered: an estimate of the detection probability learns from
        them.
    released : TrackArrays
        Tracks that were published by the last step, after they had been held back.
    """

    def __init__(
        self,
        hold_time: float = 0.0,
        tracked_timeout: float = 60.0,
        speed_prior: SpeedPrior | None = None,
        target_extent: float = 0.0,
    ) -> None:
        self.hold_time = hold_time
        self.tracked_timeout = tracked_timeout
        self.speed_prior = speed_prior or SpeedPrior()
        self.target_extent = target_extent
        self._ended: dict[int, str] = {}
        self._cleared: dict[int, str] = {}
        self._forget()

    def _forget(self) -> None:
        self._held = HeldTracks.none()
        self._tracker = DownstreamTracker()
        self._begun: dict[tuple[int, int], int] = {}
        self._owned: deque[tuple[IntArray, IntArray]] = deque(maxlen=REMEMBERED_SCANS)
        self.held_association, self.covered = NO_ASSOCIATION, NO_COVERED_TRACKS
        self.own_detections = self.probable_detections = NO_OWN_DETECTIONS
        self.nearest_detections = NO_OWN_DETECTIONS
        self.released = NO_TRACKS

    @property
    def held(self) -> HeldTracks:
        """Every track held, published or not, with all that is known of it."""
        return self._held

    @property
    def current(self) -> TrackArrays:
        """Published tracks, at the last scan's stamp; between `follow` and `step` at their own."""
        held = self._state()
        return held.tracks.where(held.status == Status.PUBLISHED)

    def _state(self) -> HeldTracks:
        """Every track held, with its probability to stand still."""
        self._held = publication.stated(self._held, self.speed_prior)
        return self._held

    @property
    def fixed_echoes(self) -> TrackArrays:
        """Held tracks that exist and stand still, at their places."""
        return publication.fixed_echoes(self._state())

    @property
    def ended(self) -> dict[int, str]:
        """Tracks that ended at the last step, or since the one before: id and reason in `ENDS`."""
        return self._ended

    @property
    def tracker(self) -> ExternalTracker:
        """Whether a downstream tracker was heard since the last clearing, and still is."""
        return self._tracker.status

    def detections_of_moving(self) -> IntArray:
        """Rows of the last scan's detections that are probably of held tracks that move, (k,)."""
        ids, rows = self.probable_detections
        if not len(ids):
            return rows
        moving = np.sort(self._held.tracks.track_id[self._held.fits.moves])
        return rows[np.searchsorted(moving, ids, "right") > np.searchsorted(moving, ids)]

    def step(
        self,
        stamp: float,
        detections: NDArray[np.void],
        clutter: FloatArray,
        detectable: Callable[[FloatArray], FloatArray],
        sensor: SensorModel,
        max_speed: float,
        interval: float = 0.0,
        environment: Environment | None = None,
        *,
        whole: bool = True,
    ) -> FloatArray:
        """Predict the tracks to a scan, associate its detections, update the tracks, and end some.

        For the equations see `maintenance.ipda` and `maintenance.state_mixtures`.

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
            v_max, m/s: the velocity after a turn is unknown up to it; see `held_update` too.
        interval : float, optional
            Median time between scans of the whole coverage, s; 0 if it is not known.
        environment : Environment, optional
            Clutter zones and encounters, in which plots' features count.
        whole : bool, optional
            Whether the scan looked at the whole coverage; a target elsewhere is not away otherwise.

        Returns
        -------
        (d,) ndarray
            Density at each detection, 1/m^2, of the held targets' detections, to be added to the
            clutter density; see `ipda.associate`.
        """
        away = self._begin(stamp, interval, detectable)
        if not len(self._held):
            return np.zeros(len(detections))
        # Predict.
        held = self._held.predicted(stamp, max_speed, away)
        # Associate.
        probability = detectable(held.tracks.state[:, 0::2])
        covered = probability > 0.0
        existence, visible = ipda.predicted(held.existence, held.visible, covered)
        proven, _ = ipda.predicted(held.proven, held.visible, covered)
        counts = covered | (whole & ~away)
        held = changed(
            held,
            existence=np.where(counts, existence, held.existence),
            proven=np.where(counts, proven, held.proven),
            visible=np.where(counts, visible, held.visible),
        )
        empty = 1.0 - held.visible * probability * GATE_PROBABILITY
        state, covariance = held.modes()
        means = np.stack([held.tracks.state, held.fits.state])
        gated = gated_detections.gate(state, covariance, means, stamp, detections, sensor)
        near = gated.filter
        clutter = np.maximum(clutter, MIN_CLUTTER_DENSITY)
        associate = partial(_associate, empty, detections, clutter, sensor, environment)
        association = associate(held, held.models.probability, near, gated.of_filter)
        # Update.
        held, plots = features.with_plots(
            held, near, association.probability, detections, environment
        )
        of_fit = associate(held, np.ones((1, len(held))), gated.fit, gated.of_fit)
        mode_ratios = ipda.scan_ratio(empty, association.ratio, near.track)
        shares = association.ratio / mode_ratios[:, near.track]
        state, covariance = track_update.updated_states(
            state, covariance, gated, np.append(shares, of_fit.probability)
        )
        odds = stationary.change_odds(
            held.fits.change_odds,
            stationary.scan_ratios(held.models.probability, association.ratio, near.track, empty),
            ipda.scan_ratio(empty, of_fit.ratio[0], gated.fit.track),
        )
        fits = changed(held.fits, state=state[-1], covariance=covariance[-1], change_odds=odds)
        # A downstream tracker has a speed limit of its own.
        limit = np.where(self._tracker.keeps(held.unlisted_since), np.inf, max_speed)
        held, self.covered = track_update.updated(
            held, state[:-1], covariance[:-1], mode_ratios, empty, covered, limit
        )
        of_target = association.probability * held.existence[near.track]
        probable = of_target > PROBABLE
        held = features.with_strengths(held, near, of_target, detections["strength"])
        held = publication.judged(changed(held, fits=fits), self.speed_prior)
        self.held_association = HeldAssociation(near.row, of_target)
        self.own_detections, self.probable_detections = (
            OwnDetections(held.tracks.track_id[near.track[own]], near.row[own])
            for own in (of_target > ALMOST_CERTAIN, probable)
        )
        own = detections[self.probable_detections.row]
        hits = np.stack([own["scan"], own["index"]], axis=1)
        self._owned.append((hits, self.probable_detections.track_id))
        hit_sigma, sigma = held.hit_sigma.copy(), np.zeros(len(held))
        if len(detections):
            sigma = detections["major_sigma"][near.nearest]
            hit_sigma[near.track[probable]] = detections["major_sigma"][near.row[probable]]
        self._held = changed(held, hit_sigma=hit_sigma)
        # End.
        exists = held.existence >= MIN_EXISTENCE
        kept = self._end(exists | ~covered, "missed")
        kept[kept] = self._end(exists[kept], "left")
        explained = np.asarray(np.bincount(near.track, of_target, len(held)), float)
        self.nearest_detections = NO_OWN_DETECTIONS
        if len(detections):
            seen = np.flatnonzero(explained > PROBABLE)
            self.nearest_detections = OwnDetections(held.tracks.track_id[seen], near.nearest[seen])
        self._end(~self._repeated(plots[kept], sigma[kept], explained[kept]), "duplicate")
        self._publish(sensor.max_range)
        return association.held_density

    def _publish(self, max_range: float) -> None:
        """Publish, withhold or fix each track; those that are published for the first time."""
        if self.speed_prior.min_speed:
            self._state()
        extent = self.target_extent
        status = publication.statuses(self._held, self.speed_prior, extent, max_range)
        listed = self._tracker.keeps(self._held.unlisted_since)
        status = np.where(listed & (status == Status.WITHHELD), Status.PUBLISHED, status)
        new = (status == Status.PUBLISHED) & ~self._held.announced
        self._held = held = changed(
            self._held,
            status=status,
            announced=self._held.announced | new,
            # A downstream tracker has known them from now on only.
            unlisted_since=np.where(new, self._held.tracks.stamp, self._held.unlisted_since),
        )
        self.released = held.tracks.where(new) if new.any() else NO_TRACKS

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
        """Ids of the held tracks that starts (n,) are, or continue; -1 for those of new targets.

        See `track_merging.own_starts` and `continued`. Targets are born, in the mean, as often as
        they vanish, uniform in the coverage (m^2) and the velocities up to `max_speed`. Fixed
        echoes and the tracks that a downstream tracker lists are left as they are.
        """
        held = self._held
        may = (held.status != Status.FIXED) & ~self._tracker.keeps(held.unlisted_since)
        rows = np.flatnonzero(may)
        if not len(starts) or not len(rows):
            return np.full(len(starts), -1)
        known = set(held.tracks.track_id.tolist())
        by_scan = [
            {(scan, row): i for (scan, row), i in zip(hits.tolist(), ids.tolist(), strict=True)}
            for hits, ids in self._owned
        ]
        remembered = [*by_scan, self._begun]
        owned = {hit: i for one in remembered for hit, i in one.items() if i in known}
        mine = {hit for hits in starts.hits for hit in hits}
        busy = (
            {track for hit, track in by_scan[-1].items() if hit not in mine} if by_scan else set()
        )
        busy |= set(held.tracks.track_id[~may].tolist())
        ids = duplicates.own_starts(starts, owned, frozenset(busy))
        others, lost = np.flatnonzero(ids < 0), rows[~np.isin(held.tracks.track_id[rows], ids)]
        volume = coverage_area * math.pi * self.speed_prior.max_speed**2
        births = (1.0 + len(held)) * ipda.SCANS_OF_FADING / ipda.SCANS_TO_VANISH / volume
        ids[others] = duplicates.continued(
            starts.where(others),
            held.tracks.where(lost),
            held.existence[lost],
            owned,
            births,
        )
        return ids

    def add(
        self,
        tracks: TrackArrays,
        existence: float | FloatArray,
        histories: Histories | None = None,
        misfit: float | FloatArray = 1.0,
        strengths: tuple[FloatArray, FloatArray] | None = None,
        hit_sigma: FloatArray | None = None,
    ) -> TrackArrays:
        """Hold newly confirmed tracks whose targets exist with a probability, a number or (n,).

        Their hits have features as in `histories`, if these are known; their covariances are too
        small for the hits by factors `misfit`; `strengths` and `hit_sigma` see `HeldTracks.of`.
        Those that are published at once are returned.
        """
        if not len(tracks):
            return tracks
        self._remember_starts(tracks)
        new = HeldTracks.of(tracks, existence, histories, misfit, strengths, hit_sigma)
        held = self._held.joined(changed(new, announced=np.zeros(len(new), bool)))
        held = publication.stated(publication.judged(held, self.speed_prior), self.speed_prior)
        first = len(held) - len(new)
        fixed = publication.stands_still(held, self.speed_prior)[first:]
        status, announced = held.status.copy(), held.announced.copy()
        status[first:] = np.where(fixed, Status.FIXED, Status.PUBLISHED)
        announced[first:] = ~fixed
        self._held = changed(held, status=status, announced=announced)
        return held.tracks.where(first + np.flatnonzero(~fixed))

    def revise(
        self,
        corrected: TrackArrays,
        replaced: Sequence[int] = (),
        existence: FloatArray | None = None,
    ) -> TrackArrays:
        """Correct the starts of held tracks, by their ids, and end tracks that were replaced.

        A track that a downstream tracker lists does not end. With the `existence` of each, the
        tracks were lost and are found again.

        Returns
        -------
        TrackArrays
            The published tracks that were corrected.
        """
        if replaced:
            self._end(~np.isin(self._held.tracks.track_id, replaced), "replaced")
        if not len(corrected):
            return corrected
        self._remember_starts(corrected)
        held = self._held.revised(corrected, existence)
        self._held = publication.judged(held, self.speed_prior)
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
            `tsepm_ros.tracker.maintenance.external_tracker.usable`.
        """
        tracker, held = self._tracker.at(stamp, self.tracked_timeout), self._state()
        since = tracker.unlisted_since(held.unlisted_since, stamp)
        self._tracker = tracker.heard(stamp)
        ids = held.tracks.track_id
        over = declined(since, ids, tracks.track_id, stamp, self.tracked_timeout)
        over &= held.announced & ((held.status != Status.FIXED) | (since == LISTED))
        self._cleared |= dict.fromkeys(ids[over].tolist(), "tracker")
        self._held = changed(held, unlisted_since=since).where(~over)
        self.add(tracks.where(~np.isin(tracks.track_id, ids)), TRACKED_EXISTENCE)
        self._held = self._held.listed(tracks, TRACKED_EXISTENCE)

    def clear(self) -> None:
        """End every track and forget what a downstream tracker said."""
        ids = self._held.tracks.track_id[self._held.announced].tolist()
        self._cleared |= dict.fromkeys(ids, "cleared")
        self._forget()

    def merge(self, extent: PlotExtent, sensor_position: FloatArray) -> None:
        """End tracks that may be of an older one's target, if it has an extent.

        See `track_merging.may_repeat_older`.
        """
        tracks = self._held.tracks
        self._end(~duplicates.may_repeat_older(tracks, extent, sensor_position), "duplicate")

    def _begin(
        self, stamp: float, interval: float, detectable: Callable[[FloatArray], FloatArray]
    ) -> BoolArray:
        """Begin a step: forget the last one's, and end the tracks that are over their time.

        Returns which are fixed echoes outside the coverage: these are remembered.
        """
        self._ended, self._cleared = self._cleared, {}
        self.held_association, self.covered = NO_ASSOCIATION, NO_COVERED_TRACKS
        self.own_detections = self.probable_detections = NO_OWN_DETECTIONS
        self.nearest_detections = NO_OWN_DETECTIONS
        self.released = NO_TRACKS
        self._tracker = self._tracker.at(stamp, self.tracked_timeout)
        fixed = self._held.status == Status.FIXED
        away = fixed & (detectable(self._held.tracks.state[:, 0::2]) <= 0.0)
        last = self._held.last_detected
        longest = self.hold_time or HOLD_SCANS * interval or np.inf
        away = away[self._end(fixed | (last >= stamp - longest), "not_detected")]
        most = MOST_PLACES if self.speed_prior.min_speed else 0
        if np.count_nonzero(away) > most:
            kept = ~away
            kept[np.flatnonzero(away)[np.count_nonzero(away) - most :]] = True
            away = away[self._end(kept, "forgotten")]
        return away

    def _repeated(
        self, plots: IntArray, detection_sigma: FloatArray, explained: FloatArray
    ) -> BoolArray:
        """Which tracks have for some scans been where an older one is, (n,)."""
        tracks, before = self._held.tracks, self._held.agreeing_scans
        known = duplicates.located(tracks.covariance, detection_sigma)
        agrees = duplicates.agrees_with_older(
            tracks.state, tracks.covariance, plots, known, explained
        )
        scans = np.where(agrees, before + 1, np.where(known, 0, before))
        self._held = changed(self._held, agreeing_scans=scans)
        return scans >= duplicates.SAME_SCANS

    def _end(self, kept: BoolArray, reason: str) -> BoolArray:
        """End all tracks but those kept and those that the downstream tracker lists.

        Returns which were kept.
        """
        if self._tracker.is_alive:
            kept = kept | self._tracker.keeps(self._held.unlisted_since)
        if not kept.all():
            held = self._held
            ended = held.tracks.track_id[held.announced & ~kept].tolist()
            self._ended = self._ended | dict.fromkeys(ended, reason)
            self._held = held.where(kept)
        return kept


def _associate(
    empty: FloatArray,
    detections: NDArray[np.void],
    clutter: FloatArray,
    sensor: SensorModel,
    environment: Environment | None,
    held: HeldTracks,
    mode_probability: FloatArray,
    near: Neighbours,
    likelihood: FloatArray,
) -> ipda.Association:
    """Association of a scan's detections by their likelihoods (m, p) in modes (m, n) of motion.

    A detection was possible where there is one, wherever the data sheet ends the coverage.
    """
    scale = held.visible[near.track] * sensor.detection_probability / clutter[near.row]
    if environment is not None:
        mean = ipda.mean_over_modes(mode_probability, likelihood, near.track)
        scale = scale * features.likelihood_factors(environment, held, near, mean, detections)
    return ipda.associate(
        held.existence,
        empty,
        mode_probability,
        likelihood * scale,
        near.track,
        near.row,
        clutter,
    )
