"""States of held tracks after a scan: mixtures over which detection, if any, is the target's."""

from __future__ import annotations

import math

import numpy as np

from tsepm_ros.kinematics import kalman
from tsepm_ros.maintenance.gated_detections import GatedDetections
from tsepm_ros.numerics import grouped
from tsepm_ros.numerics.arrays import FloatArray, IntArray

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
    kalman_gain = kalman.kalman_gain(covariance, gated.time_after_scan, innovation_covariance)
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
