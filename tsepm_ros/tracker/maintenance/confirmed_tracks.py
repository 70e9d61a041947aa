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
"""The table of confirmed tracks: a row for each, with its `TrackStatus`.

A track keeps its id in all states. It is published from its announcement on, unless it stands
still; where its target probably exists no more, or has left the coverage, it is held silently.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray, Rows, replaced, with_rows
from tsepm_ros.tracker.clutter import amplitude_law
from tsepm_ros.tracker.clutter.amplitude_law import ScanAmplitudes
from tsepm_ros.tracker.maintenance.branches import Branches
from tsepm_ros.tracker.maintenance.stationary import (
    CHANGED_SHARE,
    MAX_CHANGE_ODDS,
    StraightFits,
)
from tsepm_ros.tracker.measurement import major_sigma
from tsepm_ros.tracker.options import GATE_PROBABILITY, CommonOptions
from tsepm_ros.tracker.tracks import EVEN_PROBABILITY, SURE_PROBABILITY, TrackArrays, TrackStatus

LISTED_TIME = -math.inf
"""Value of the time since which a track is unlisted, for a listed track."""
NEW_EXISTENCE_BY_SCANS = 0.005
"""Probability that a new track's target exists, by which the detection probability is learned.

In clutter alone a track is ever proven with this probability at most (Ville): the scans after a
false start say nothing of targets, whatever their number. A choice.
"""


SCANS_TO_VANISH = 50.0
"""Mean number of scans after which a target is gone, so that misses end its track: a choice.

After the time of as many without a detection a track ends, where `hold_time` is 0.
"""
PROOF_DETECTION_PROBABILITY = 0.5
"""P_D by which tracks are proven: by that in use, a wrong one would never be corrected."""
AMPLITUDE_MEMORY = 30
"""Detections over which the amplitude of a track is averaged."""
MAX_ERROR_RATIO = 4.5
"""Position error, in those of a detection, up to which a target is recognised by its place."""
MAX_ERROR_SHARE_OF_RANGE = 0.25
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
    "status",
)
"""The fields of `TrackArrays` that a track has anew that a start continues."""
_FOUND_AGAIN = (
    "branches",
    "fits",
    "existence",
    "proven",
    "hit_sigma",
    "covered_scans",
    "last_detected",
    "last_place",
    "announced",
)
"""The fields of `ConfirmedTracks` that begin anew where a lost track is found again."""


@dataclass(frozen=True, eq=False)
class ConfirmedTracks(Rows):
    """Confirmed tracks, a row each.

    Attributes
    ----------
    tracks : TrackArrays
        Their states are the means over the branches.
    branches : Branches
        Which detections are the target's, in which mode of motion.
    fits : StraightFits
        Fits of constant velocity, by which it is judged whether the target stands still.
    existence : (n,) ndarray
        Probability r that the target exists.
    proven : (n,) ndarray
        The same for any P_D, from `NEW_EXISTENCE_BY_SCANS` at the start: by the scans since alone.
    covered_scans : (n, s) ndarray
        Scans of each sensor that covered the target since its last detection, each weighted by the
        probability that the last detection was before it.
    last_detected : (n,) ndarray
        Stamp of the last scan in which the target was probably detected, s.
    last_place : (n, 2) ndarray
        Its position then, m.
    unlisted_since : (n,) ndarray
        Time since which the downstream tracker has not listed the track, s; or `LISTED_TIME`.
    announced : (n,) ndarray of bool
        Whether the track was ever published.
    hit_sigma : (n, s) ndarray
        Standard deviation of the last detection by each sensor, along its major axis, m; of a new
        track its own.
    amplitude_hits, amplitude_total : (n,) ndarray
        Detections with an amplitude so far, each weighted by the probability that it is the
        track's, and the sum of their normalised amplitudes.
    """

    existence: FloatArray
    tracks: TrackArrays
    branches: Branches
    fits: StraightFits
    proven: FloatArray
    covered_scans: FloatArray
    last_detected: FloatArray
    last_place: FloatArray
    unlisted_since: FloatArray
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
        sensors: int = 1,
    ) -> ConfirmedTracks:
        """Rows of new tracks, whose targets exist with a probability, a number or (n,).

        Without `amplitudes` no amplitude of their hits is known: their number and the sum of their
        normalised amplitudes. The covariances are too small for the hits by factors `misfit`, a
        number or (n,), which counts in the fits. The last hits had the errors `hit_sigma`, by
        default those of the tracks, for each of some sensors.
        """
        n = len(tracks)
        if hit_sigma is None:
            hit_sigma = major_sigma(tracks.covariance[:, 0::2, 0::2])
        amplitude_hits, amplitude_total = amplitudes or (np.zeros(n), np.zeros(n))
        return cls(
            tracks=tracks,
            branches=Branches.from_states(tracks.state, tracks.covariance, sensors),
            fits=StraightFits.from_states(
                tracks.state, tracks.covariance * np.broadcast_to(misfit, n)[:, None, None]
            ),
            existence=np.array(np.broadcast_to(existence, n), float),
            proven=np.full(n, NEW_EXISTENCE_BY_SCANS),
            covered_scans=np.zeros((n, sensors)),
            last_detected=tracks.stamp,
            last_place=tracks.state[:, 0::2],
            unlisted_since=tracks.stamp,
            announced=np.ones(n, bool),
            hit_sigma=hit_sigma[:, None].repeat(sensors, axis=1),
            amplitude_hits=amplitude_hits,
            amplitude_total=amplitude_total,
        )

    @classmethod
    def none(cls, sensors: int = 1) -> ConfirmedTracks:
        """No rows, of some sensors."""
        return cls.from_tracks(TrackArrays.from_tracks([]), 0.0, sensors=sensors)

    @property
    def sensors(self) -> int:
        """Number of sensors."""
        return self.covered_scans.shape[1]

    def predicted(
        self,
        stamp: float,
        max_speed: float,
        process_noise: float,
        stays: BoolArray,
        min_speed: float = 0.0,
    ) -> ConfirmedTracks:
        """The rows at the stamp of a scan (s), before its detections.

        The covariances of `tracks` are not predicted; see `Branches.combined`.
        A target that turns has a velocity that is unknown up to `max_speed`, m/s; between turns its
        acceleration has the spectral density `process_noise`, m^2/s^3. Rows that stay
        (n,) are remembered as they are.
        """
        time_step = np.where(stays, 0.0, stamp - self.tracks.stamp)
        branches = self.branches.predicted(time_step, max_speed, process_noise)
        return replaced(
            self,
            tracks=replaced(
                self.tracks,
                stamp=np.full(len(self.existence), stamp),
                state=branches.mean()[0],
                age=self.tracks.age + stamp - self.tracks.stamp,
            ),
            branches=branches,
            fits=self.fits.predicted(time_step, min_speed),
        )

    def existing(
        self, stays: FloatArray, counts: BoolArray, sensor: int = 0, steps: float = 1.0
    ) -> ConfirmedTracks:
        """The rows with the probabilities r, and that of the proof, before a scan of a sensor.

        ``r <- r`` times the probability that the target stays, (n,), where the scan counts for it.
        There the target may have faded, too: for the `steps` for which the scan counts.
        """
        stays = np.where(counts, stays, 1.0)
        return replaced(
            self,
            existence=self.existence * stays,
            proven=self.proven * stays,
            branches=self.branches.fading(counts, sensor, steps),
        )

    def updated(
        self,
        branches: Branches,
        ratio: FloatArray,
        empty: FloatArray,
        fits: StraightFits,
        covered: BoolArray,
        sensor: int = 0,
    ) -> tuple[ConfirmedTracks, FloatArray, FloatArray]:
        """The predicted rows after a scan, and its samples of the detection probability.

        ``r <- Lambda r / (1 - r + Lambda r)``.

        Parameters
        ----------
        branches : Branches
        ratio, empty : (n,) ndarray
            Lambda_i and b_i.
        fits : StraightFits
        covered : (n,) ndarray of bool
            Which targets could be detected at all.
        sensor : int, optional
            Number of the sensor that looked.

        Returns
        -------
        confirmed : ConfirmedTracks
        detected : (k,) ndarray
            Of the tracks that the scan covered: probability that the target exists, by the scans
            since its start alone, and was detected.
        scans : (k,) ndarray
            Scans that covered it since its last detection, this scan included.
        """
        existence = _existing(self.existence, ratio)
        of_detections = (ratio - empty)[covered] / (1.0 - empty[covered])
        proof = np.ones_like(ratio)
        proof[covered] += PROOF_DETECTION_PROBABILITY * GATE_PROBABILITY * (of_detections - 1.0)
        proven = _existing(self.proven, proof)
        of_target = np.maximum(1.0 - empty / ratio, 0.0)
        detected = of_target * existence
        seen = detected >= EVEN_PROBABILITY
        scans = self.covered_scans[:, sensor] + covered
        covered_scans = self.covered_scans.copy()
        covered_scans[:, sensor] = scans * (1.0 - detected)
        mean, spread = branches.combined()
        confirmed = replaced(
            self,
            tracks=replaced(self.tracks, state=mean, covariance=spread),
            branches=branches,
            fits=fits,
            existence=existence,
            proven=proven,
            covered_scans=covered_scans,
            last_detected=np.where(seen, self.tracks.stamp, self.last_detected),
            last_place=np.where(seen[:, None], mean[:, 0::2], self.last_place),
        )
        return confirmed, (of_target * proven)[covered], scans[covered]

    def amplitude_increment(
        self, track: IntArray, row: IntArray, amplitudes: ScanAmplitudes
    ) -> FloatArray:
        """What the amplitudes of detections add to the log-likelihood ratio of tracks, (p,).

        ``ln L(n + 1, V + v) - ln L(n, V)``, as for a tentative track, see `amplitude_law`; n is
        rounded, and V with it.

        Parameters
        ----------
        track, row : (p,) ndarray of int
            Row of a track, and detection, of each pair.
        amplitudes : ScanAmplitudes
        """
        most = float(len(amplitudes.ratio.table) - 2)
        hits = np.minimum(np.rint(self.amplitude_hits), most)
        total = self.amplitude_total * hits / np.maximum(self.amplitude_hits, 0.5)
        return amplitudes.added(row, hits.astype(np.int64)[track], total[track])[2]

    def with_amplitudes(
        self, track: IntArray, probability: FloatArray, amplitude: FloatArray
    ) -> ConfirmedTracks:
        """The rows with the amplitudes of the detections that may be theirs.

        Older detections fade, over `AMPLITUDE_MEMORY`: the aspect changes.

        Parameters
        ----------
        track, probability, amplitude : (p,) ndarray
            Row of a track, the probability that a detection is its target's, and the normalised
            amplitude of this; nan where it is not known.
        """
        known = np.isfinite(amplitude).nonzero()[0]
        if not len(known):
            return self
        track, share = track[known], probability[known]
        hits = np.bincount(track, share, minlength=len(self))
        total = np.bincount(track, share * amplitude[known], minlength=len(self))
        keep = 1.0 - np.minimum(hits, 1.0) / AMPLITUDE_MEMORY
        return replaced(
            self,
            amplitude_hits=keep * self.amplitude_hits + hits,
            amplitude_total=keep * self.amplitude_total + total,
        )

    def continued(self, starts: TrackArrays, existence: FloatArray) -> ConfirmedTracks:
        """The rows; tracks that starts, by their ids, were found to continue go on from these.

        Each as its next revision, with the age since the first hit of all, and with the hits of the
        start, by which it is judged. Its target exists with a given probability.
        """
        tracks = self.tracks
        _, row, index = np.intersect1d(tracks.track_id, starts.track_id, return_indices=True)
        new = starts.where(index)
        new = replaced(new, age=np.maximum(new.age, tracks.age[row]))
        figures = {name: getattr(new, name) for name in _OF_START}
        tracks = with_rows(tracks, row, revision=tracks.revision[row] + 1, **figures)
        fresh = ConfirmedTracks.from_tracks(new, existence[index], sensors=self.sensors)
        fresh = replaced(fresh, proven=np.maximum(self.proven[row], NEW_EXISTENCE_BY_SCANS))
        confirmed = with_rows(self, row, **{name: getattr(fresh, name) for name in _FOUND_AGAIN})
        return replaced(confirmed, tracks=tracks)

    def listed(self, reported: TrackArrays, existence: float) -> ConfirmedTracks:
        """The rows with the states that a downstream tracker reports of tracks with their ids.

        Their targets exist with a probability; hits, evaluation and the time of the last detection
        stay as they are.
        """
        _, row, index = np.intersect1d(self.tracks.track_id, reported.track_id, return_indices=True)
        new = reported.where(index)
        age = self.tracks.age[row] + new.stamp - self.tracks.stamp[row]
        fresh = ConfirmedTracks.from_tracks(new, existence, sensors=self.sensors)
        confirmed = with_rows(
            self,
            row,
            branches=fresh.branches,
            fits=fresh.fits,
            existence=existence,
            proven=existence,
            last_place=new.state[:, 0::2],
            unlisted_since=LISTED_TIME,
            announced=True,
        )
        figures = {"stamp": new.stamp, "state": new.state, "covariance": new.covariance}
        tracks = with_rows(self.tracks, row, age=age, status=TrackStatus.CONFIRMED, **figures)
        return replaced(confirmed, tracks=tracks)

    def judged(self, options: CommonOptions) -> ConfirmedTracks:
        """The rows after an update, with the figures of their tracks that only maintenance knows.

        A fit begins again with the filter's state where the motion has changed. Where the
        probability to stand still decides nothing, it is left to `stated`.
        """
        fits, tracks = self.fits, self.tracks
        over = (fits.change_odds >= MAX_CHANGE_ODDS).nonzero()[0]
        if len(over):
            fresh = StraightFits.from_states(
                tracks.state[over], tracks.covariance[over], CHANGED_SHARE
            )
            fits = with_rows(fits, over, **fresh.__dict__)
        probability = np.full_like(self.existence, np.nan)
        if options.min_speed:
            probability = fits.stationary_probability(options, self.existence)
        tracks = replaced(
            tracks,
            stationary_probability=probability,
            signal_to_clutter_db=amplitude_law.ratio_db(self.amplitude_hits, self.amplitude_total),
            existence_probability=self.existence,
            time_since_hit=tracks.stamp - self.last_detected,
        )
        return replaced(self, fits=fits, tracks=tracks)

    def stated(self, options: CommonOptions) -> ConfirmedTracks:
        """The rows with the probability to stand still of all."""
        if not np.isnan(self.tracks.stationary_probability).any():
            return self
        probability = self.fits.stationary_probability(options, self.existence)
        return replaced(self, tracks=replaced(self.tracks, stationary_probability=probability))

    def stands_still(self, options: CommonOptions) -> BoolArray:
        """Which tracks (n,) are fixed echoes; none without a `min_speed`.

        A start as soon as it more probably stands still than moves; a track that was published only
        when it is `SURE_PROBABILITY` to.
        """
        if not options.min_speed:
            return np.zeros_like(self.announced)
        limit = np.where(self.announced, SURE_PROBABILITY, EVEN_PROBABILITY)
        return np.asarray(self.tracks.stationary_probability > limit)

    def statuses(
        self,
        options: CommonOptions,
        max_range: float,
        extent: float = 0.0,
        living: tuple[int, ...] = (0,),
    ) -> IntArray:
        """The `TrackStatus` of each track, (n,), where some sensors live.

        A track coasts unless it is located and exists. It is located while the standard deviation
        of its position, along the major axis, is at most `MAX_ERROR_RATIO` times that of its last
        detection by any of these, anywhere on a learned `extent` (m), or `target_extent`, and at
        most `MAX_ERROR_SHARE_OF_RANGE` of `max_range` (m).
        """
        sigma = major_sigma(self.tracks.covariance[:, 0::2, 0::2])
        error = np.hypot(self.hit_sigma[:, living].max(axis=1), extent / math.sqrt(12.0))
        limit = np.maximum(MAX_ERROR_RATIO * error, options.target_extent)
        located = sigma <= np.minimum(limit, MAX_ERROR_SHARE_OF_RANGE * max_range)
        exists = self.existence >= np.where(
            self.tracks.status == TrackStatus.COASTING, SURE_PROBABILITY, EVEN_PROBABILITY
        )
        status = np.where(located & exists, TrackStatus.CONFIRMED, TrackStatus.COASTING)
        return np.where(self.stands_still(options), TrackStatus.STANDS_STILL, status)

    @property
    def status(self) -> IntArray:
        """The `TrackStatus` of each track, (n,), as it was stated last."""
        return self.tracks.status

    @property
    def published(self) -> TrackArrays:
        """The tracks that are announced and do not stand still now."""
        return self.tracks.where(self.announced & (self.status != TrackStatus.STANDS_STILL))

    @property
    def fixed_echoes(self) -> TrackArrays:
        """Fixed echoes that exist and stand still with more than 0.5, at their places."""
        still = self.existence * self.tracks.stationary_probability > EVEN_PROBABILITY
        rows = (still & (self.status == TrackStatus.STANDS_STILL)).nonzero()[0]
        state, covariance = self.fits[rows].places()
        return replaced(self.tracks.where(rows), state=state, covariance=covariance)


def _existing(existence: FloatArray, ratio: FloatArray) -> FloatArray:
    """Probability of existence (n,) after a scan: ``Lambda r / (1 - (1 - Lambda) r)``."""
    return np.asarray(ratio * existence / (1.0 - (1.0 - ratio) * existence))
