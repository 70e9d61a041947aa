"""The table of confirmed tracks: a row for each, and which are published.

A track is in one of three states. It is *published*; it is *withheld* while its target probably
exists no more, or its place is no longer known well enough to be recognised; or it is a *fixed*
echo, where a `min_speed` is given. It keeps its id in all of them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray, Rows, changed, with_rows
from tsepm_ros.tracker import motion
from tsepm_ros.tracker.clutter.amplitude_law import amplitude_law_ratio_db
from tsepm_ros.tracker.maintenance import data_association, stationary
from tsepm_ros.tracker.maintenance.data_association import (
    SCANS_OF_FADING,
    SCANS_TO_FADE,
    SCANS_TO_VANISH,
)
from tsepm_ros.tracker.maintenance.stationary import (
    CHANGED_SHARE,
    MAX_CHANGE_ODDS,
    StraightFits,
)
from tsepm_ros.tracker.measurement import major_sigma
from tsepm_ros.tracker.motion import InteractingModels
from tsepm_ros.tracker.options import GATE_PROBABILITY, CommonOptions
from tsepm_ros.tracker.tracks import PROBABLE, TrackArrays

LISTED = -math.inf
"""Value of the time since which a track is unlisted, for a listed track."""
UNPROVEN = 0.005
"""Probability that a new track's target exists, by which the detection probability is learned.

In clutter alone a track is ever proven with this probability at most (Ville): the scans after a
false start say nothing of targets, whatever their number. A choice.
"""


PROVING = 0.5
"""P_D by which tracks are proven: by that in use, a wrong one would never be corrected."""
AMPLITUDE_MEMORY = 30
"""Detections over which the amplitude of a track is averaged."""
SURE = 0.9
"""Probability to stand still above which a published track becomes a fixed echo."""
RECOGNISED = 4.5
"""Position error, in those of a detection, up to which a target is recognised by its place."""
SHARE_OF_RANGE = 0.25
"""Position error up to which a track says where its target is, in the sensor's range."""
_OF_START = (
    "hits",
    "hit_count",
    "state",
    "covariance",
    "evaluation",
    "score",
    "scan_count",
    "age",
)
"""The fields of `TrackArrays` that a corrected start has anew."""
_FOUND_AGAIN = (
    "existence",
    "proven",
    "hit_sigma",
    "visible",
    "covered_scans",
    "last_detected",
    "status",
    "announced",
    "agreeing_scans",
)
"""The fields of `ConfirmedTracks` that begin anew where a lost track is found again."""


class Status(IntEnum):
    """What becomes of a confirmed track: published, withheld while it is vague, or a fixed echo."""

    PUBLISHED = 0
    WITHHELD = 1
    FIXED = 2


@dataclass(frozen=True, eq=False)
class ConfirmedTracks(Rows):
    """Confirmed tracks, a row each.

    Attributes
    ----------
    tracks : TrackArrays
        Their states are the means over the modes of motion.
    models : InteractingModels
        State and probability of each mode.
    fits : StraightFits
        Fits of constant velocity, by which it is judged whether the target stands still.
    existence : (n,) ndarray
        Probability r that the target exists.
    proven : (n,) ndarray
        The same for any P_D, from `UNPROVEN` at the start: by the scans since alone.
    visible : (n,) ndarray
        Probability s that the target, if it exists, is visible: not faded.
    covered_scans : (n,) ndarray
        Scans that covered the target since its last detection, each weighted by the probability
        that the last detection was before it.
    last_detected : (n,) ndarray
        Stamp of the last scan in which the target was probably detected, s.
    agreeing_scans : (n,) ndarray of int
        Scans in a row in which the track agreed with an older track.
    unlisted_since : (n,) ndarray
        Time since which the downstream tracker has not listed the track, s; or `LISTED`.
    status : (n,) ndarray of int
        Whether the track is published: a value of `Status`.
    announced : (n,) ndarray of bool
        Whether the track was ever published.
    hit_sigma : (n,) ndarray
        Standard deviation of the last detection, along its major axis, m; of a new track its own.
    amplitude_hits, amplitude_total : (n,) ndarray
        Detections with an amplitude so far, each weighted by the probability that it is the
        track's, and the sum of their normalised amplitudes.
    """

    existence: FloatArray
    tracks: TrackArrays
    models: InteractingModels
    fits: StraightFits
    proven: FloatArray
    visible: FloatArray
    covered_scans: FloatArray
    last_detected: FloatArray
    agreeing_scans: IntArray
    unlisted_since: FloatArray
    status: IntArray
    announced: BoolArray
    hit_sigma: FloatArray
    amplitude_hits: FloatArray
    amplitude_total: FloatArray

    @classmethod
    def from_tracks(
        cls,
        tracks: TrackArrays,
        existence: float | FloatArray,
        misfit: float | FloatArray = 1.0,
        amplitudes: tuple[FloatArray, FloatArray] | None = None,
        hit_sigma: FloatArray | None = None,
    ) -> ConfirmedTracks:
        """Rows of new tracks, whose targets exist with a probability, a number or (n,).

        Without `amplitudes` no amplitude of their hits is known: their number and the sum of their
        normalised amplitudes. The covariances are too small for the hits by factors `misfit`, a
        number or (n,), which counts in the fits. The last hits had the errors `hit_sigma`, by
        default those of the tracks.
        """
        n = len(tracks)
        amplitude_hits, amplitude_total = amplitudes or (np.zeros(n), np.zeros(n))
        return cls(
            tracks=tracks,
            models=InteractingModels.from_states(tracks.state, tracks.covariance),
            fits=StraightFits.from_states(
                tracks.state, tracks.covariance * np.broadcast_to(misfit, n)[:, None, None]
            ),
            existence=np.array(np.broadcast_to(existence, n), float),
            proven=np.full(n, UNPROVEN),
            visible=np.ones(n),
            covered_scans=np.zeros(n),
            last_detected=tracks.stamp,
            agreeing_scans=np.zeros(n, np.int64),
            unlisted_since=tracks.stamp,
            status=np.full(n, Status.PUBLISHED, np.int64),
            announced=np.ones(n, bool),
            hit_sigma=major_sigma(tracks.covariance[:, 0::2, 0::2])
            if hit_sigma is None
            else hit_sigma,
            amplitude_hits=amplitude_hits,
            amplitude_total=amplitude_total,
        )

    @classmethod
    def none(cls) -> ConfirmedTracks:
        """No rows."""
        return cls.from_tracks(TrackArrays.from_tracks([]), 0.0)

    def predicted(self, stamp: float, max_speed: float, stays: BoolArray) -> ConfirmedTracks:
        """The rows at the stamp of a scan (s), before its detections.

        A target that turns has a velocity that is unknown up to `max_speed`, m/s. Rows that stay
        (n,) are remembered as they are.
        """
        time_step = np.where(stays, 0.0, stamp - self.tracks.stamp)
        models = self.models.predicted(time_step, max_speed)
        state, covariance = models.combined()
        return changed(
            self,
            tracks=changed(
                self.tracks,
                stamp=np.full(len(self), stamp),
                state=state,
                covariance=covariance,
                age=self.tracks.age + stamp - self.tracks.stamp,
            ),
            models=models,
            fits=self.fits.predicted(time_step),
        )

    def existing(self, covered: BoolArray, counts: BoolArray) -> ConfirmedTracks:
        """The rows with the probabilities r, that of the proof, and s of targets before a scan.

        ``r <- (1 - 1 / SCANS_TO_VANISH) r``,
        ``s <- (1 - 1 / SCANS_TO_FADE) s + (1 - s) / SCANS_OF_FADING``. A target outside the
        coverage (not `covered`) is as one that has faded, ``r <- (1 - 1 / SCANS_OF_FADING) r``: it
        stays away or comes back. A scan that does not count for a target changes nothing.
        """
        stays = np.where(covered, 1.0 - 1.0 / SCANS_TO_VANISH, 1.0 - 1.0 / SCANS_OF_FADING)
        stays = np.where(counts, stays, 1.0)
        still = (1.0 - 1.0 / SCANS_TO_FADE) * self.visible + (1.0 - self.visible) / SCANS_OF_FADING
        return changed(
            self,
            existence=self.existence * stays,
            proven=self.proven * stays,
            visible=np.where(counts, still, self.visible),
        )

    def updated(
        self,
        state: FloatArray,
        covariance: FloatArray,
        mode_ratios: FloatArray,
        empty: FloatArray,
        covered: BoolArray,
        max_speed: FloatArray,
    ) -> tuple[ConfirmedTracks, FloatArray, FloatArray]:
        """The predicted rows after a scan, and its samples of the detection probability.

        The probabilities of the filter's modes become ``mu_im Lambda_im / Lambda_i`` with
        ``Lambda_i = sum_m mu_im Lambda_im``, and that of a visible target ``1 - (1 - s) /
        Lambda_i``: of a faded target nothing is detected.

        Parameters
        ----------
        state, covariance : (n, 3, 4), (n, 3, 4, 4) ndarray
            The filter's modes and the fit, updated by the scan's detections.
        mode_ratios : (n, 3) ndarray
            Lambda_im.
        empty : (n,) ndarray
            b_i.
        covered : (n,) ndarray of bool
            Which targets could be detected at all.
        max_speed : (n,) ndarray
            v_max, m/s: a mode whose mean is faster is conditioned on it; see `motion.slowed`.

        Returns
        -------
        confirmed : ConfirmedTracks
        detected : (k,) ndarray
            Of the tracks that the scan covered: probability that the target exists, by the scans
            since its start alone, and was detected.
        scans : (k,) ndarray
            Scans that covered it since its last detection, this scan included.
        """
        # The tail above v_max stays: that of a turn, after which a fast target is as fast again.
        of_filter = state[:, :-1], covariance[:, :-1]
        slow = motion.slowed(
            of_filter[0].reshape(-1, 4), of_filter[1].reshape(-1, 4, 4), max_speed.repeat(2)
        )
        weighted = self.models.probability * mode_ratios[:, :-1]
        ratio = weighted.sum(axis=1)
        models = InteractingModels(
            weighted / ratio[:, None],
            slow[0].reshape(of_filter[0].shape),
            slow[1].reshape(of_filter[1].shape),
        )
        odds = stationary.change_odds(self.fits.change_odds, ratio, mode_ratios[:, -1])
        existence = data_association.updated_existence(self.existence, ratio)
        proof = np.ones_like(ratio)
        of_detections = (ratio - empty)[covered] / (1.0 - empty[covered])
        proof[covered] += PROVING * GATE_PROBABILITY * (of_detections - 1.0)
        proven = data_association.updated_existence(self.proven, proof)
        of_target = 1.0 - empty / ratio
        detected = of_target * existence
        scans = self.covered_scans + covered
        mean, spread = models.combined()
        confirmed = changed(
            self,
            tracks=changed(self.tracks, state=mean, covariance=spread),
            models=models,
            fits=changed(
                self.fits, state=state[:, -1], covariance=covariance[:, -1], change_odds=odds
            ),
            existence=existence,
            proven=proven,
            visible=1.0 - (1.0 - self.visible) / ratio,
            covered_scans=scans * (1.0 - detected),
            last_detected=np.where(detected >= PROBABLE, self.tracks.stamp, self.last_detected),
        )
        return confirmed, (of_target * proven)[covered], scans[covered]

    def with_amplitudes(
        self, row: IntArray, probability: FloatArray, amplitude: FloatArray
    ) -> ConfirmedTracks:
        """The rows with the amplitudes of the detections that may be theirs.

        Older detections fade, over `AMPLITUDE_MEMORY`: the aspect changes.

        Parameters
        ----------
        row, probability : (n, k) ndarray
            Detections near each track, and the probability that each is its target's.
        amplitude : (d,) ndarray
            Normalised amplitude of each detection; nan where it is not known.
        """
        known = np.isfinite(amplitude)
        if not known.any():
            return self
        share = np.where(known[row], probability, 0.0)
        hits = share.sum(axis=1)
        total = (share * np.where(known, amplitude, 0.0)[row]).sum(axis=1)
        keep = 1.0 - np.minimum(hits, 1.0) / AMPLITUDE_MEMORY
        return changed(
            self,
            amplitude_hits=keep * self.amplitude_hits + hits,
            amplitude_total=keep * self.amplitude_total + total,
        )

    def revised(
        self, corrected: TrackArrays, existence: FloatArray | None = None
    ) -> ConfirmedTracks:
        """The rows with the starts of tracks, by their ids, that were corrected.

        Each goes on from the corrected state, as its next revision. Its target exists as before, or
        with a given probability if it was just found again: then its age stays, since
        the first hit of all. Its hits are those of the start, by which it is judged.
        """
        tracks = self.tracks
        _, row, index = np.intersect1d(tracks.track_id, corrected.track_id, return_indices=True)
        new = corrected.where(index)
        if existence is not None:
            new = changed(new, age=np.maximum(new.age, tracks.age[row]))
        figures = {name: getattr(new, name) for name in _OF_START}
        tracks = with_rows(tracks, row, revision=tracks.revision[row] + 1, **figures)
        fresh = ConfirmedTracks.from_tracks(new, 0.0 if existence is None else existence[index])
        started = ["models", "fits"]
        if existence is not None:
            fresh = changed(fresh, proven=np.maximum(self.proven[row], UNPROVEN))
            started += _FOUND_AGAIN
        confirmed = with_rows(self, row, **{name: getattr(fresh, name) for name in started})
        return changed(confirmed, tracks=tracks)

    def listed(self, reported: TrackArrays, existence: float) -> ConfirmedTracks:
        """The rows with the states that a downstream tracker reports of tracks with their ids.

        Their targets exist with a probability; hits and evaluation stay as they are.
        """
        _, row, index = np.intersect1d(self.tracks.track_id, reported.track_id, return_indices=True)
        new = reported.where(index)
        age = self.tracks.age[row] + new.stamp - self.tracks.stamp[row]
        fresh = ConfirmedTracks.from_tracks(new, existence)
        confirmed = with_rows(
            self,
            row,
            models=fresh.models,
            fits=fresh.fits,
            existence=existence,
            proven=existence,
            last_detected=np.maximum(self.last_detected[row], new.stamp),
            unlisted_since=LISTED,
            status=Status.PUBLISHED,
            announced=True,
        )
        figures = {"stamp": new.stamp, "state": new.state, "covariance": new.covariance}
        return changed(confirmed, tracks=with_rows(self.tracks, row, age=age, **figures))

    def judged(self, options: CommonOptions) -> ConfirmedTracks:
        """The rows after an update, with the figures of their tracks that only maintenance knows.

        A fit begins again with the filter's state where the motion has changed. Where the
        probability to stand still decides nothing, it is left to `stated`.
        """
        fits, tracks = self.fits, self.tracks
        over = np.flatnonzero(fits.change_odds >= MAX_CHANGE_ODDS)
        if len(over):
            fresh = StraightFits.from_states(
                tracks.state[over], tracks.covariance[over], CHANGED_SHARE
            )
            fits = with_rows(fits, over, **fresh.__dict__)
        probability = np.full_like(self.existence, np.nan)
        if options.min_speed:
            probability = fits.stationary_probability(options, self.existence)
        tracks = changed(
            tracks,
            stationary_probability=probability,
            signal_to_clutter_db=amplitude_law_ratio_db(self.amplitude_hits, self.amplitude_total),
            existence_probability=self.existence,
            time_since_hit=tracks.stamp - self.last_detected,
        )
        return changed(self, fits=fits, tracks=tracks)

    def stated(self, options: CommonOptions) -> ConfirmedTracks:
        """The rows with the probability to stand still of all."""
        if not np.isnan(self.tracks.stationary_probability).any():
            return self
        probability = self.fits.stationary_probability(options, self.existence)
        return changed(self, tracks=changed(self.tracks, stationary_probability=probability))

    def stands_still(self, options: CommonOptions) -> BoolArray:
        """Which tracks (n,) are fixed echoes; none without a `min_speed`.

        A start as soon as it more probably stands still than moves; a track that was published only
        when it is `SURE` to.
        """
        if not options.min_speed:
            return np.zeros_like(self.announced)
        limit = np.where(self.announced, SURE, PROBABLE)
        return np.asarray(self.tracks.stationary_probability > limit)

    def statuses(self, options: CommonOptions, max_range: float) -> IntArray:
        """The `Status` of each track, (n,).

        It is located while the standard deviation of its position, along the major axis, is at most
        `RECOGNISED` times that of its last detection or `target_extent` (m), and at most
        `SHARE_OF_RANGE` of `max_range` (m).
        """
        sigma = major_sigma(self.tracks.covariance[:, 0::2, 0::2])
        limit = np.maximum(RECOGNISED * self.hit_sigma, options.target_extent)
        located = sigma <= np.minimum(limit, SHARE_OF_RANGE * max_range)
        exists = self.existence >= np.where(self.status == Status.WITHHELD, SURE, PROBABLE)
        status = np.where(located & exists, Status.PUBLISHED, Status.WITHHELD)
        return np.where(self.stands_still(options), Status.FIXED, status)

    @property
    def fixed_echoes(self) -> TrackArrays:
        """Fixed echoes that exist and stand still with more than 0.5, at their places."""
        still = self.existence * self.tracks.stationary_probability > PROBABLE
        rows = np.flatnonzero(still & (self.status == Status.FIXED))
        state, covariance = self.fits[rows].places()
        return changed(self.tracks.where(rows), state=state, covariance=covariance)
