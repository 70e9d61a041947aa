"""Plot features and strengths of held tracks: factors of likelihood ratios, the own plots."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.environment.feature_association import Environment
from tsepm_ros.maintenance.gated_detections import GATE_PROBABILITY, Neighbours
from tsepm_ros.maintenance.held_tracks import HeldTracks
from tsepm_ros.numerics.arrays import FloatArray, IntArray
from tsepm_ros.numerics.gaussian import gate_factor
from tsepm_ros.numerics.rows import changed
from tsepm_ros.sensing.plot_features import MAX_PLOT_COUNT
from tsepm_ros.stages.association import Pairs
from tsepm_ros.stages.paths import NO_HIT

OWN_PROBABILITY = 0.5
"""Association probability above which a detection is a track's own plot."""


def likelihood_factors(
    environment: Environment,
    held: HeldTracks,
    near: Neighbours,
    likelihood: FloatArray,
    detections: NDArray[np.void],
) -> FloatArray:
    """Factor that features put to each pair's likelihood ratio, (p,); see `Environment.factors`.

    Parameters
    ----------
    environment : Environment
    held : HeldTracks
        Predicted to the scan.
    near : Neighbours
    likelihood : (p,) ndarray
        Of the position and range rate, the mean over the modes; 0 outside the gate.
    detections : (d,) ndarray of DETECTION
    """
    if not len(near.track):
        return np.ones(0)
    error = detections["major_sigma"][near.nearest]
    state, covariance = held.tracks.state, held.tracks.covariance
    meets = environment.meeting(state, covariance, error, gate_factor(GATE_PROBABILITY))
    inside = likelihood > 0.0
    cost = np.full(len(likelihood), np.inf)
    cost[inside] = -2.0 * np.log(likelihood[inside])
    pairs = Pairs(near.track, near.row, cost)
    return environment.factors(held.histories, meets, pairs, detections["features"])


def with_strengths(
    held: HeldTracks, near: Neighbours, probability: FloatArray, strength: FloatArray
) -> HeldTracks:
    """The rows with the strengths of the detections that may be theirs.

    Older detections fade, over `MAX_PLOT_COUNT`: the aspect changes.

    Parameters
    ----------
    held : HeldTracks
    near : Neighbours
    probability : (p,) ndarray
        That each pair's detection is the track's target's.
    strength : (d,) ndarray
        Exponent of each detection; nan where it is not known.
    """
    known = np.isfinite(strength[near.row])
    if not known.any():
        return held
    track, share, n = near.track[known], probability[known], len(held)
    hits = np.bincount(track, share, minlength=n)
    total = np.bincount(track, share * strength[near.row[known]], minlength=n)
    keep = 1.0 - np.minimum(hits, 1.0) / MAX_PLOT_COUNT
    return changed(
        held,
        strength_hits=keep * held.strength_hits + hits,
        strength_total=keep * held.strength_total + total,
    )


def with_plots(
    held: HeldTracks,
    near: Neighbours,
    probability: FloatArray,
    detections: NDArray[np.void],
    environment: Environment | None,
) -> tuple[HeldTracks, IntArray]:
    """The rows with the features of the tracks' own plots, and the plots that separate tracks.

    A plot in a clutter zone separates no tracks: two plots there are not two targets.

    Parameters
    ----------
    held : HeldTracks
    near : Neighbours
    probability : (p,) ndarray
        Association probability of each pair.
    detections : (d,) ndarray of DETECTION
    environment : Environment or None
        Without it features do not count.

    Returns
    -------
    held : HeldTracks
    plots : (n,) ndarray of int
        Detection that is each track's own; NO_HIT where there is none.
    """
    plots = np.full(len(held), NO_HIT)
    if environment is None:
        return held, plots
    likely = probability > OWN_PROBABILITY
    plots[near.track[likely]] = near.row[likely]
    own = np.flatnonzero(plots != NO_HIT)
    histories = held.histories.with_plots(own, detections["features"][plots[own]])
    plots[own[environment.in_zone[plots[own]]]] = NO_HIT
    return changed(held, histories=histories), plots
