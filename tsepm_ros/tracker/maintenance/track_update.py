"""Update of confirmed tracks, and of the mixtures that their states are.

States of held tracks after a scan: mixtures over which detection, if any, is the target's.

Held tracks after a scan: their modes, states, probabilities and counts.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from tsepm_ros.numerics import grouped
from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray, changed
from tsepm_ros.tracker import motion
from tsepm_ros.tracker.maintenance import ipda
from tsepm_ros.tracker.maintenance.confirmed_tracks import HeldTracks
from tsepm_ros.tracker.maintenance.gated_detections import GATE_PROBABILITY, GatedDetections
from tsepm_ros.tracker.motion import InteractingModels

ROUNDING = 1e-12
"""Bound of the relative rounding error of a covariance."""
_BEYOND_ROUNDING = 1.0 + ROUNDING * np.eye(4)
_SQUARES = np.array([[3, 4], [4, 5]])
"""Places of the squares of innovations in the sums over pairs."""


def updated_states(
    state: FloatArray, covariance: FloatArray, gated: GatedDetections, probability: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Means and covariances of the mixtures, in each mode of motion.

    Parameters
    ----------
    state, covariance : (m, n, 4), (m, n, 4, 4) ndarray
        As predicted.
    gated : GatedDetections
        q pairs.
    probability : (q,) ndarray
        beta_j of each pair; with what is left to 1, beta_0, no detection is the target's.

    Returns
    -------
    state, covariance : (m, n, 4), (m, n, 4, 4) ndarray
    """
    if gated.updated is None:
        state, covariance = _by_positions(state, covariance, gated, probability)
    else:
        state, covariance = _by_updates(state, covariance, gated.owner, gated.updated, probability)
    # Rounding must not make it asymmetric, a part that would grow from scan to scan, or indefinite.
    return state, 0.5 * (covariance + np.swapaxes(covariance, -1, -2)) * _BEYOND_ROUNDING


def _by_positions(
    state: FloatArray, covariance: FloatArray, gated: GatedDetections, probability: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Mixtures where a single gain K serves all detections of a track.

    ``x + K v``, ``P - (1 - beta_0) K S K' + K (sum_j beta_j v_j v_j' - v v') K'`` with
    ``v = sum_j beta_j v_j``.
    """
    shape = state.shape[:-1]
    x, y = gated.innovation.T
    parts = np.empty((6, len(x)))
    parts[0], parts[1], parts[2], parts[3], parts[4], parts[5] = 1.0, x, y, x * x, x * y, y * y
    parts *= probability
    sums = grouped.sums(parts, gated.owner, math.prod(shape)).reshape(-1, *shape)
    detected, mean = sums[0], sums[1:3].transpose(1, 2, 0)
    square = sums[_SQUARES].transpose(2, 3, 0, 1)
    innovation_covariance = gated.innovation_covariance
    kalman_gain = motion.kalman_gain(covariance, gated.time_after_scan, innovation_covariance)
    change = (
        square
        - mean[..., :, None] * mean[..., None, :]
        - detected[..., None, None] * innovation_covariance
    )
    state = state + (kalman_gain @ mean[..., None])[..., 0]
    return state, covariance + kalman_gain @ change @ np.swapaxes(kalman_gain, -1, -2)


def _by_updates(
    state: FloatArray,
    covariance: FloatArray,
    owner: IntArray,
    updated: tuple[FloatArray, FloatArray],
    probability: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Mixtures of each predicted track and its updates by each of its detections.

    ``x + m``, ``beta_0 P + sum_j beta_j (P_j + d_j d_j') - m m'`` with ``d_j = x_j - x`` and
    ``m = sum_j beta_j d_j``.
    """
    updated_state, updated_covariance = updated
    moved = updated_state - state.reshape(-1, 4)[owner]
    second_moment = updated_covariance - covariance.reshape(-1, 4, 4)[owner]
    second_moment = second_moment + moved[..., :, None] * moved[..., None, :]
    mean, change = np.zeros_like(state), np.zeros_like(covariance)
    np.add.at(mean.reshape(-1, 4), owner, probability[:, None] * moved)
    np.add.at(change.reshape(-1, 4, 4), owner, probability[:, None, None] * second_moment)
    return state + mean, covariance + change - mean[..., :, None] * mean[..., None, :]


PROVING = 0.5
"""P_D by which tracks are proven: by that in use, a wrong one would never be corrected."""
DETECTED = 0.5
"""Probability of a detection from which a target counts as detected in a scan."""


class CoveredTracks(NamedTuple):
    """Samples of the detection probability: a row for each track that a scan covered.

    Attributes
    ----------
    detected : (k,) ndarray
        Probability that the target exists, by the scans since its start alone, and was detected.
    scans : (k,) ndarray
        Scans that covered the target since its last detection, this scan included.
    """

    detected: FloatArray
    scans: FloatArray


def updated(
    held: HeldTracks,
    state: FloatArray,
    covariance: FloatArray,
    mode_ratios: FloatArray,
    empty: FloatArray,
    covered: BoolArray,
    max_speed: FloatArray,
) -> tuple[HeldTracks, CoveredTracks]:
    """The predicted rows after a scan, and its samples of the detection probability.

    Parameters
    ----------
    held : HeldTracks
    state, covariance : (m, n, 4), (m, n, 4, 4) ndarray
        The modes, updated by the scan's detections.
    mode_ratios : (m, n) ndarray
        Lambda_im.
    empty : (n,) ndarray
        b_i.
    covered : (n,) ndarray of bool
        Which targets could be detected at all.
    max_speed : (n,) ndarray
        v_max, m/s: a mode whose mean is faster is conditioned on it; see `kinematics.speed_limit`.
    """
    # The tail above v_max stays: that of a turn, after which a fast target is as fast again.
    slow_state, slow_covariance = motion.slowed(
        state.reshape(-1, 4),
        covariance.reshape(-1, 4, 4),
        np.concatenate([max_speed] * len(state)),
    )
    probability, scan_ratio = ipda.updated_modes(held.models.probability, mode_ratios)
    models = InteractingModels(
        probability, slow_state.reshape(state.shape), slow_covariance.reshape(covariance.shape)
    )
    existence = ipda.updated_existence(held.existence, scan_ratio)
    proof = np.ones(len(held))
    seen = 1.0 - empty[covered]
    of_detections = (scan_ratio - empty)[covered]
    proof[covered] += PROVING * GATE_PROBABILITY * (of_detections / seen - 1.0)
    proven = ipda.updated_existence(held.proven, proof)
    of_target = 1.0 - empty / scan_ratio
    detected = of_target * existence
    scans = held.covered_scans + covered
    state, covariance = models.combined()
    held = changed(
        held,
        tracks=changed(held.tracks, state=state, covariance=covariance),
        models=models,
        existence=existence,
        proven=proven,
        visible=ipda.updated_visibility(held.visible, scan_ratio),
        covered_scans=scans * (1.0 - detected),
        last_detected=np.where(detected >= DETECTED, held.tracks.stamp, held.last_detected),
    )
    return held, CoveredTracks((of_target * proven)[covered], scans[covered])
