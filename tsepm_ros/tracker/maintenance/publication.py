"""Which held tracks are published: those whose target exists, moves, and is where they say.

A track is in one of three states. It is *published*; it is *withheld* while its target probably
exists no more, or its place is no longer known well enough to be recognised; or it is a *fixed*
echo, where a `min_speed` is given. It keeps its id in all of them.
"""

from __future__ import annotations

import numpy as np

from tsepm_ros.numerics.arrays import BoolArray, IntArray, changed
from tsepm_ros.tracker.clutter.target_strength import ratio_db
from tsepm_ros.tracker.maintenance import stationary
from tsepm_ros.tracker.maintenance.confirmed_tracks import HeldTracks, Status
from tsepm_ros.tracker.maintenance.stationary import SpeedPrior
from tsepm_ros.tracker.measurement import major_sigma
from tsepm_ros.tracker.tracks import TrackArrays

EXISTS = 0.5
"""Probability of existence below which a track is withheld, until it exists with `SURE`."""
STANDS_STILL = 0.5
"""Probability to stand still above which a start is no track; and of a fixed echo, that it exists
too."""
SURE = 0.9
"""Probability to stand still above which a published track becomes a fixed echo."""
RECOGNISED = 4.5
"""Position error, in those of a detection, up to which a target is recognised by its place."""
SHARE_OF_RANGE = 0.25
"""Position error up to which a track says where its target is, in the sensor's range."""


def judged(held: HeldTracks, prior: SpeedPrior) -> HeldTracks:
    """The rows after an update, with the figures of their tracks that only maintenance knows.

    A fit begins again with the filter's state where the motion has changed. Where the probability
    to stand still decides nothing, it is left to `stated`.
    """
    fits = stationary.begun_again(held.fits, held.tracks.state, held.tracks.covariance)
    probability = np.full(len(held), np.nan)
    if prior.min_speed:
        probability = fits.stationary_probability(prior, held.existence)
    tracks = changed(
        held.tracks,
        stationary_probability=probability,
        signal_to_clutter_db=ratio_db(held.strength_hits, held.strength_total),
        existence_probability=held.existence,
        time_since_hit=held.tracks.stamp - held.last_detected,
    )
    return changed(held, fits=fits, tracks=tracks)


def stated(held: HeldTracks, prior: SpeedPrior) -> HeldTracks:
    """The rows with the probability to stand still of all."""
    if not np.isnan(held.tracks.stationary_probability).any():
        return held
    probability = held.fits.stationary_probability(prior, held.existence)
    return changed(held, tracks=changed(held.tracks, stationary_probability=probability))


def stands_still(held: HeldTracks, prior: SpeedPrior) -> BoolArray:
    """Which tracks (n,) are fixed echoes; none without a `min_speed`.

    A start as soon as it more probably stands still than moves; a track that was published only
    when it is `SURE` to.
    """
    if not prior.min_speed:
        return np.zeros(len(held), bool)
    limit = np.where(held.announced, SURE, STANDS_STILL)
    return np.asarray(held.tracks.stationary_probability > limit)


def statuses(
    held: HeldTracks, prior: SpeedPrior, target_extent: float, max_range: float
) -> IntArray:
    """The `Status` of each track, (n,).

    It is located while the standard deviation of its position, along the major axis, is at most
    `RECOGNISED` times that of its last detection or `target_extent` (m), and at most
    `SHARE_OF_RANGE` of `max_range` (m).
    """
    sigma = major_sigma(held.tracks.covariance[:, 0::2, 0::2])
    limit = np.maximum(RECOGNISED * held.hit_sigma, target_extent)
    located = sigma <= np.minimum(limit, SHARE_OF_RANGE * max_range)
    exists = held.existence >= np.where(held.status == Status.WITHHELD, SURE, EXISTS)
    status = np.where(located & exists, Status.PUBLISHED, Status.WITHHELD)
    return np.where(stands_still(held, prior), Status.FIXED, status)


def fixed_echoes(held: HeldTracks) -> TrackArrays:
    """Fixed echoes that exist and stand still with more than 0.5, at their places."""
    still = held.existence * held.tracks.stationary_probability > STANDS_STILL
    rows = np.flatnonzero(still & (held.status == Status.FIXED))
    state, covariance = held.fits[rows].places()
    return changed(held.tracks.where(rows), state=state, covariance=covariance)
