"""Which held tracks are published: those that move; what stands still is a fixed echo."""

from __future__ import annotations

import numpy as np

from tsepm_ros.environment.target_strength import ratio_db
from tsepm_ros.kinematics.track import NO_TRACKS, TrackArrays
from tsepm_ros.maintenance import stationary
from tsepm_ros.maintenance.held_tracks import HeldTracks
from tsepm_ros.maintenance.stationary import SpeedPrior
from tsepm_ros.numerics.rows import changed

EXISTS = 0.5
"""Probability of existence from which a track that was held back is published: a choice."""
STANDS_STILL = 0.5
"""Probability of a target that exists and stands still above which it is a fixed echo."""


def judged(held: HeldTracks, prior: SpeedPrior) -> HeldTracks:
    """The rows after an update, with the strength of each, and the probability to stand still.

    A fit begins again with the filter's state where the motion has changed. Where the probability
    decides nothing, it is left to `stated`.
    """
    fits = stationary.begun_again(held.fits, held.tracks.state, held.tracks.covariance)
    probability = np.full(len(held), np.nan)
    if prior.min_speed:
        probability = fits.stationary_probability(prior)
    ratio = ratio_db(held.strength_hits, held.strength_total)
    tracks = changed(held.tracks, stationary_probability=probability, signal_to_clutter_db=ratio)
    return changed(held, fits=fits, tracks=tracks)


def stated(held: HeldTracks, prior: SpeedPrior) -> HeldTracks:
    """The rows with the probability to stand still of all."""
    rows = np.flatnonzero(np.isnan(held.tracks.stationary_probability))
    if not len(rows):
        return held
    probability = held.tracks.stationary_probability.copy()
    probability[rows] = held.fits[rows].stationary_probability(prior)
    return changed(held, tracks=changed(held.tracks, stationary_probability=probability))


def released(held: HeldTracks, prior: SpeedPrior) -> tuple[HeldTracks, TrackArrays]:
    """Publish the tracks that were held back and are sure to move now.

    Returns
    -------
    held : HeldTracks
    tracks : TrackArrays
        The tracks that are published now. A downstream tracker has known them from now on only.
    """
    if held.published.all():
        return held, NO_TRACKS
    held = stated(held, prior)
    sure = ~held.published & prior.sure_to_move(held.tracks.stationary_probability)
    sure &= held.existence >= EXISTS
    return changed(
        held,
        published=held.published | sure,
        unlisted_since=np.where(sure, held.tracks.stamp, held.unlisted_since),
    ), held.tracks.where(sure)


def fixed_echoes(held: HeldTracks) -> TrackArrays:
    """Tracks held back that exist and stand still with more than 0.5, at their places."""
    still = held.existence * held.tracks.stationary_probability > STANDS_STILL
    rows = np.flatnonzero(still & ~held.published)
    state, covariance = held.fits[rows].places()
    return changed(held.tracks.where(rows), state=state, covariance=covariance)
