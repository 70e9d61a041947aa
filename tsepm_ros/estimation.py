"""Least-squares initial state and covariance (TSEPM 2018, Section 3.3, Eqs. 12-20).

The state is ``[x, vx, y, vy]``; hit i at ``tau_i`` seconds after the state's time measures
``z_i = H_i X``, ``H_i = [[1, tau_i, 0, 0], [0, 0, 1, tau_i]]`` (Eqs. 16-18). All functions take a
batch of n tracks with m hits each.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.conversion import covariance_at
from tsepm_ros.sensor import SensorModel

FloatArray = NDArray[np.float64]

ESTIMATORS = ("unweighted", "weighted")
WEIGHTED_PASSES = 2


@dataclass(frozen=True)
class Fit:
    """States fitted to a batch of tracks.

    Attributes
    ----------
    state : (n, 4) ndarray
        m, m/s.
    covariance : (n, 4, 4) ndarray
        Covariance of the state.
    tau : (n, m) ndarray
        Time of each hit after the state's time, s.
    hit_covariance : (n, m, 2, 2) ndarray
        Covariance of each hit as the fit used it, m^2.
    """

    state: FloatArray
    covariance: FloatArray
    tau: FloatArray
    hit_covariance: FloatArray


def fit(hits: NDArray[np.void], stamp: float, sensor: SensorModel, estimator: str) -> Fit:
    """Fit the state at `stamp` to the hits of each track.

    Parameters
    ----------
    hits : (n, m) ndarray of DETECTION
        The hits of n tracks, m >= 2 at different times.
    stamp : float
        Time of the state, s.
    sensor : SensorModel
        Range errors, for the weighted fit.
    estimator : {"unweighted", "weighted"}
        As published (Eqs. 19-20), or weighted with R re-evaluated at the fit, in two passes.

    Returns
    -------
    Fit
    """
    tau = hits["time"] - stamp
    raw = hits["covariance"]
    state, covariance = unweighted(tau, hits["position"], raw)
    if estimator == "unweighted":
        return Fit(state, covariance, tau, raw)
    at_fit = raw
    for _ in range(WEIGHTED_PASSES):
        at_fit = covariance_at(hits, positions_at(state, tau), sensor)
        state, covariance = weighted(tau, hits["position"], at_fit, state)
    return Fit(state, covariance, tau, at_fit)


def unweighted(
    tau: FloatArray, positions: FloatArray, covariances: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Unweighted least squares with the sandwich covariance.

    ``X = (H'H)^-1 H'Z`` (Eq. 19), ``P = (H'H)^-1 H'RH (H'H)^-1`` (Eq. 20). The axes share the
    times, so both reduce to the straight-line weights of position and velocity.

    Parameters
    ----------
    tau : (n, m) ndarray
        s.
    positions : (n, m, 2) ndarray
        m.
    covariances : (n, m, 2, 2) ndarray
        R_i, m^2.

    Returns
    -------
    state : (n, 4) ndarray
    covariance : (n, 4, 4) ndarray
    """
    n, m = tau.shape
    mean = tau.mean(axis=1, keepdims=True)
    centred = tau - mean
    with np.errstate(invalid="ignore", divide="ignore"):  # equal times have no fit: nan
        slope = centred / np.square(centred).sum(axis=1, keepdims=True)
    weights = np.stack([1.0 / m - mean * slope, slope], axis=1)  # (n, 2, m): position, velocity
    state = np.swapaxes(weights @ positions, 1, 2).reshape(n, 4)
    products = (weights[:, :, None] * weights[:, None, :]).reshape(n, 4, m)
    blocks = (products @ covariances.reshape(n, m, 4)).reshape(n, 2, 2, 2, 2)  # a, b, p, q
    return state, blocks.transpose(0, 3, 1, 4, 2).reshape(n, 4, 4)


def weighted(
    tau: FloatArray, positions: FloatArray, covariances: FloatArray, start: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Weighted least squares: ``P = (H'R^-1 H)^-1``, ``X = P H'R^-1 Z``.

    Parameters
    ----------
    tau, positions, covariances
        As in `unweighted`.
    start : (n, 4) ndarray
        Any state near the solution. The correction to it is what is solved for, so that large
        map coordinates cost no digits.

    Returns
    -------
    state : (n, 4) ndarray
    covariance : (n, 4, 4) ndarray
    """
    n = len(tau)
    information = np.linalg.inv(covariances)  # (n, m, 2, 2)
    powers = np.stack([np.ones_like(tau), tau, np.square(tau)], axis=1)  # (n, 3, m)
    moments = np.einsum("nem,nmpq->nepq", powers, information)
    order = np.add.outer([0, 1], [0, 1])  # tau^a tau^b = tau^(a + b)
    normal = moments[:, order].transpose(0, 3, 1, 4, 2).reshape(n, 4, 4)
    misfit = positions - positions_at(start, tau)
    pull = (information @ misfit[..., None])[..., 0]
    right = np.einsum("nam,nmp->npa", powers[:, :2], pull).reshape(n, 4)
    covariance = np.linalg.inv(normal)
    covariance = 0.5 * (covariance + np.swapaxes(covariance, 1, 2))
    return start + (covariance @ right[..., None])[..., 0], covariance


def mixture(
    weights: FloatArray, states: FloatArray, covariances: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Mean and covariance over alternatives, the spread of their means included.

    ``x = sum_i w_i x_i``, ``P = sum_i w_i (P_i + (x_i - x)(x_i - x)')``

    Parameters
    ----------
    weights : (n,) ndarray
        Probabilities, of sum 1.
    states : (n, 4) ndarray
    covariances : (n, 4, 4) ndarray

    Returns
    -------
    state : (4,) ndarray
    covariance : (4, 4) ndarray
    """
    state: FloatArray = weights @ states
    spread = states - state
    parts = covariances + spread[:, :, None] * spread[:, None, :]
    return state, np.einsum("n,nij->ij", weights, parts)


def positions_at(state: FloatArray, tau: FloatArray) -> FloatArray:
    """Position of each (n, 4) state at its m times, (n, m, 2), m."""
    return state[:, None, 0::2] + tau[:, :, None] * state[:, None, 1::2]


def position_covariances_at(covariance: FloatArray, tau: FloatArray) -> FloatArray:
    """Position covariance H_k P_k H_k' of each (n, 4, 4) at its m times, (n, m, 2, 2), m^2."""
    t = tau[:, :, None, None]
    cross = covariance[:, None, 0::2, 1::2]
    return (
        covariance[:, None, 0::2, 0::2]
        + t * (cross + np.swapaxes(cross, -1, -2))
        + t * t * covariance[:, None, 1::2, 1::2]
    )
