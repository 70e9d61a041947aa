"""Confirmed tracks maintained: carried from scan to scan, updated by their detections, and ended.

The states of tracks that a downstream tracker lists replace the held states. The rules that end
tracks here apply only to tracks that it has not listed yet.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.environment.feature_association import Environment
from tsepm_ros.kinematics.track import NO_TRACKS, TrackArrays
from tsepm_ros.maintenance import (
    extended_targets,
    gated_detections,
    held_features,
    held_update,
    ipda,
    publication,
    repetition,
    state_mixtures,
    stationary,
)
from tsepm_ros.maintenance.downstream_tracker import DownstreamTracker, Tracker, declined
from tsepm_ros.maintenance.gated_detections import GATE_PROBABILITY, Neighbours
from tsepm_ros.maintenance.held_detections import (
    NO_ASSOCIATION,
    NO_OWN_DETECTIONS,
    HeldAssociation,
    OwnDetections,
)
from tsepm_ros.maintenance.held_tracks import HeldTracks
from tsepm_ros.maintenance.held_update import CoveredTracks
from tsepm_ros.maintenance.stationary import SpeedPrior
from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray
from tsepm_ros.numerics.rows import changed
from tsepm_ros.sensing.plot_features import Histories
from tsepm_ros.sensing.plots import PlotExtent
from tsepm_ros.sensing.sensor import MIN_CLUTTER_DENSITY, SensorModel

MIN_EXISTENCE = 0.01
"""Probability of existence below which a track ends."""
TRACKED_EXISTENCE = 0.99
"""Existence probability of a target that a downstream tracker lists: a choice."""
ALMOST_CERTAIN = 0.9
"""Probability from which on a detection is almost certainly a track's."""
PROBABLE = 0.5
"""Probability above which a detection is more probably a track's than not."""


NO_COVERED_TRACKS = CoveredTracks(np.zeros(0), np.zeros(0))


class TrackMaintenance:
    """Maintains confirmed tracks.

    A scan is taken by predicting the tracks, associating the detections, updating the tracks, and
    ending those whose target is gone, was not detected for a long time, or has an older track.

    Parameters
    ----------
    hold_time : float
        Time, s, for which a track is held without a detection of its own; it ends at the first scan
        after that, or sooner, where its target was missed so often that it probably exists no more,
        or where it repeats an older track.
    tracked_timeout : float, optional
        Time, s, after which a downstream tracker without a report is silent, and for which it may
        leave a track unlisted before that counts as declined.
    speed_prior : SpeedPrior, optional
        With a `min_speed` tracks are published once they are sure to move faster; until then they
        are held all the same.

    Attributes
    ----------
    held_association : HeldAssociation
        Detections of the last scan that may be the tracks'.
    own_detections : OwnDetections
        Those that almost certainly are.
    probable_detections : OwnDetections
        Those that more probably are than not: at most one of each track.
    covered : CoveredTracks
        Tracks that the last scan covered: an estimate of the detection probability learns from
        them.
    released : TrackArrays
        Tracks that were published by the last step, after they had been held back.
    """

    def __init__(
        self, hold_time: float, tracked_timeout: float = 60.0, speed_prior: SpeedPrior | None = None
    ) -> None:
        self.hold_time = hold_time
        self.tracked_timeout = tracked_timeout
        self.speed_prior = speed_prior or SpeedPrior()
        self._ended: list[int] = []
        self._cleared: list[int] = []
        self._forget()

    def _forget(self) -> None:
        self._held = HeldTracks.none()
        self._tracker = DownstreamTracker()
        self.held_association, self.covered = NO_ASSOCIATION, NO_COVERED_TRACKS
        self.own_detections = self.probable_detections = NO_OWN_DETECTIONS
        self.released = NO_TRACKS

    @property
    def held(self) -> HeldTracks:
        """Every track held, published or not, with all that is known of it."""
        return self._held

    @property
    def current(self) -> TrackArrays:
        """Published tracks, at the last scan's stamp; between `follow` and `step` at their own."""
        held = self._state()
        return held.tracks if held.published.all() else held.tracks.where(held.published)

    def _state(self) -> HeldTracks:
        """Every track held, with its probability to stand still."""
        self._held = publication.stated(self._held, self.speed_prior)
        return self._held

    @property
    def fixed_echoes(self) -> TrackArrays:
        """Held tracks, not published, that exist and stand still with more than 0.5."""
        return publication.fixed_echoes(self._state())

    @property
    def ended(self) -> list[int]:
        """Ids of the tracks that ended at the last step, or before it since the one before."""
        return self._ended

    @property
    def tracker(self) -> Tracker:
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
        environment: Environment | None = None,
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
        environment : Environment, optional
            Clutter zones and encounters, in which plots' features count.

        Returns
        -------
        (d,) ndarray
            Density at each detection, 1/m^2, of the held targets' detections, to be added to the
            clutter density; see `ipda.associate`.
        """
        self._begin(stamp)
        if not len(self._held):
            return np.zeros(len(detections))
        # Predict.
        held = self._held.predicted(stamp, max_speed)
        # Associate.
        probability = detectable(held.tracks.state[:, 0::2])
        empty = 1.0 - held.visible * probability * GATE_PROBABILITY
        state, covariance = held.modes()
        means = np.stack([held.tracks.state, held.fits.state])
        gated = gated_detections.gate(state, covariance, means, stamp, detections, sensor)
        near = gated.filter
        clutter = np.maximum(clutter, MIN_CLUTTER_DENSITY)
        associate = partial(_associate, empty, detections, clutter, sensor, environment)
        association = associate(held, held.models.probability, near, gated.of_filter)
        # Update.
        held, plots = held_features.with_plots(
            held, near, association.probability, detections, environment
        )
        of_fit = associate(held, np.ones((1, len(held))), gated.fit, gated.of_fit)
        mode_ratios = ipda.scan_ratio(empty, association.ratio, near.track)
        shares = association.ratio / mode_ratios[:, near.track]
        state, covariance = state_mixtures.updated_states(
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
        held, self.covered = held_update.updated(
            held, state[:-1], covariance[:-1], mode_ratios, empty, probability > 0.0, limit
        )
        of_target = association.probability * held.existence[near.track]
        held = held_features.with_strengths(held, near, of_target, detections["strength"])
        held = publication.judged(changed(held, fits=fits), self.speed_prior)
        self.held_association = HeldAssociation(near.row, of_target)
        self.own_detections, self.probable_detections = (
            OwnDetections(held.tracks.track_id[near.track[own]], near.row[own])
            for own in (of_target > ALMOST_CERTAIN, of_target > PROBABLE)
        )
        self._held = held
        # End.
        sigma = np.zeros(len(held))
        if len(detections):
            sigma = detections["major_sigma"][near.nearest]
        kept = self._end(held.existence >= MIN_EXISTENCE)
        self._end(~self._repeated(plots[kept], sigma[kept]))
        self._held, self.released = publication.released(self._held, self.speed_prior)
        return association.held_density

    def add(
        self,
        tracks: TrackArrays,
        existence: float | FloatArray,
        histories: Histories | None = None,
        misfit: float | FloatArray = 1.0,
        strengths: tuple[FloatArray, FloatArray] | None = None,
    ) -> TrackArrays:
        """Hold newly confirmed tracks whose targets exist with a probability, a number or (n,).

        Their hits have features as in `histories`, if these are known; their covariances are too
        small for the hits by factors `misfit`; their `strengths` see `HeldTracks.of`. Those that
        are published at once are returned.
        """
        if not len(tracks):
            return tracks
        new = HeldTracks.of(tracks, existence, histories, misfit, strengths)
        new = publication.stated(publication.judged(new, self.speed_prior), self.speed_prior)
        sure = self.speed_prior.sure_to_move(new.tracks.stationary_probability)
        self._held = self._held.joined(changed(new, published=sure))
        return new.tracks.where(sure)

    def revise(self, corrected: TrackArrays, replaced: Sequence[int] = ()) -> TrackArrays:
        """Correct the starts of held tracks, by their ids, and end tracks that were replaced.

        A track that a downstream tracker lists does not end.

        Returns
        -------
        TrackArrays
            The published tracks that were corrected.
        """
        if replaced:
            self._end(~np.isin(self._held.tracks.track_id, replaced))
        if not len(corrected):
            return corrected
        self._held = publication.judged(self._held.revised(corrected), self.speed_prior)
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
            `tsepm_ros.maintenance.downstream_tracker.usable`.
        """
        tracker, held = self._tracker.at(stamp, self.tracked_timeout), self._state()
        since = tracker.unlisted_since(held.unlisted_since, stamp)
        self._tracker = tracker.heard(stamp)
        ids = held.tracks.track_id
        over = declined(since, ids, tracks.track_id, stamp, self.tracked_timeout)
        over &= held.published
        self._cleared += ids[over].tolist()
        self._held = changed(held, unlisted_since=since).where(~over)
        self.add(tracks.where(~np.isin(tracks.track_id, ids)), TRACKED_EXISTENCE)
        self._held = self._held.listed(tracks, TRACKED_EXISTENCE)

    def clear(self) -> None:
        """End every track and forget what a downstream tracker said."""
        self._cleared += self._held.tracks.track_id[self._held.published].tolist()
        self._forget()

    def take_cleared(self) -> list[int]:
        """Ids of the tracks that ended since the last step; the next will not name them."""
        cleared, self._cleared = self._cleared, []
        return cleared

    def keep_ended(self) -> None:
        """Name the ids of the tracks that ended at the last step again at the next."""
        self._cleared = self._ended + self._cleared

    def merge(self, extent: PlotExtent, sensor_position: FloatArray) -> None:
        """End tracks that may be of an older one's target, if it has an extent.

        See `extended_targets.may_repeat_older`.
        """
        held = self._held
        repeats = extended_targets.may_repeat_older(held.tracks, extent, sensor_position)
        kept = ~repeats | self._tracker.keeps(held.unlisted_since)
        self._cleared += held.tracks.track_id[held.published & ~kept].tolist()
        self._held = held.where(kept)

    def _begin(self, stamp: float) -> None:
        """Begin a step: forget the last one's, and end the tracks that are over their time."""
        self._ended, self._cleared = self._cleared, []
        self.held_association, self.covered = NO_ASSOCIATION, NO_COVERED_TRACKS
        self.own_detections = self.probable_detections = NO_OWN_DETECTIONS
        self.released = NO_TRACKS
        self._tracker = self._tracker.at(stamp, self.tracked_timeout)
        self._end(self._held.last_detected >= stamp - self.hold_time)

    def _repeated(self, plots: IntArray, detection_sigma: FloatArray) -> BoolArray:
        """Which tracks have for some scans been where an older one is, (n,)."""
        tracks, before = self._held.tracks, self._held.agreeing_scans
        known = repetition.located(tracks.covariance, detection_sigma)
        agrees = repetition.agrees_with_older(tracks.state, tracks.covariance, plots, known)
        scans = np.where(agrees, before + 1, np.where(known, 0, before))
        self._held = changed(self._held, agreeing_scans=scans)
        return scans >= repetition.SAME_SCANS

    def _end(self, kept: BoolArray) -> BoolArray:
        """End all tracks but those kept and those that the downstream tracker lists.

        Returns which were kept.
        """
        if self._tracker.is_alive:
            kept = kept | self._tracker.keeps(self._held.unlisted_since)
        if not kept.all():
            held = self._held
            self._ended = self._ended + held.tracks.track_id[held.published & ~kept].tolist()
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
        scale = scale * held_features.likelihood_factors(environment, held, near, mean, detections)
    return ipda.associate(
        held.existence,
        empty,
        mode_probability,
        likelihood * scale,
        near.track,
        near.row,
        clutter,
    )
