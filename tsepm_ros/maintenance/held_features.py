"""What plots' features say of held tracks: factors of likelihood ratios, and plots of their own."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.environment.feature_association import Environment
from tsepm_ros.maintenance.gated_detections import GATE_PROBABILITY, Neighbours
from tsepm_ros.maintenance.held_tracks import HeldTracks
from tsepm_ros.numerics.arrays import FloatArray, IntArray
from tsepm_ros.numerics.gaussian import gate_factor
from tsepm_ros.sensing.plot_features import Histories
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


def own_plots(near: Neighbours, probability: FloatArray, number: int) -> IntArray:
    """Detection that is probably each track's own, (number,), by pairs' probabilities (p,).

    NO_HIT where there is none.
    """
    plots = np.full(number, NO_HIT)
    own = probability > OWN_PROBABILITY
    plots[near.track[own]] = near.row[own]
    return plots


def extended(histories: Histories, plots: IntArray, detections: NDArray[np.void]) -> Histories:
    """The histories after the tracks' own plots (n,), if any, of the detections (d,)."""
    own = np.flatnonzero(plots != NO_HIT)
    return histories.with_plots(own, detections["features"][plots[own]])


def outside_zones(plots: IntArray, environment: Environment) -> IntArray:
    """The plots (n,), NO_HIT for those in a clutter zone: two there are not two targets."""
    own = np.flatnonzero(plots != NO_HIT)
    plots = plots.copy()
    plots[own[environment.in_zone[plots[own]]]] = NO_HIT
    return plots
