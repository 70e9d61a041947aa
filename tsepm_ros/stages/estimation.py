"""Initial state and covariance from hits (TSEPM 2018, Section 3.3, Eqs. 12-20).

Least squares on the hits' positions, or maximum likelihood on their ranges and azimuths. The state
is ``[x, vx, y, vy]``; hit i at ``tau_i`` seconds after the state's time is at ``H_i X``,
``H_i = [[1, tau_i, 0, 0], [0, 0, 1, tau_i]]`` (Eqs. 16-18). All functions take a batch of n tracks
with m hits each.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.sensing import range_rates
from tsepm_ros.sensing.conversion import (
    covariance_at,
    major_sigma,
    measured_polar,
    pose_error_covariance,
    range_variance_at,
)
from tsepm_ros.sensing.detection_window import DetectionWindow
from tsepm_ros.sensing.scan import wrap
from tsepm_ros.sensing.sensor import SensorModel
from tsepm_ros.stages.paths import Paths

ESTIMATORS = ("unweighted", "weighted", "polar")
WEIGHTED_PASSES = 2
POLAR_PASSES = 10
POLAR_TOLERANCE = 1e-3
"""Step of the polar fit, in standard deviations of each component, that ends it."""
MIN_SENSOR_DISTANCE = 3.0
"""Distance of a hit from its sensor, in standard deviations of the fit, that a polar fit needs."""


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
        Covariance of each hit's position as the fit used it; for a polar fit at its state, m^2.
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
        Range errors, for the weighted and the polar fit.
    estimator : {"unweighted", "weighted", "polar"}
        As published (Eqs. 19-20); weighted with R re-evaluated at the fit, in two passes; or from
        there the maximum likelihood of ranges and azimuths (see `polar`).

    Returns
    -------
    Fit

    Notes
    -----
    Range rates, where hits have them, come last, as measurements beside the fit to the positions
    (`range_rates.fitted`).

    R at a fit is turned by the fit's own azimuth error. Where ``r s_a^2`` is not small beside s_r
    the covariance is therefore too small: for 5 hits at 5 km, 10 m and 2 (3) degrees the mean NEES
    is 4.3 (4.8) for the weighted fit and 4.3 (5.4) for the polar one; weighted with R at the true
    positions it is 4.0.
    """
    found = _fit_positions(hits, stamp, sensor, estimator)
    state, covariance = range_rates.fitted(found.state, found.covariance, found.tau, hits)
    return Fit(state, covariance, found.tau, found.hit_covariance)


def fit_paths(
    paths: Paths, window: DetectionWindow, stamp: float, sensor: SensorModel, estimator: str
) -> tuple[FloatArray, FloatArray]:
    """Fit the states of paths with different numbers of hits, at least two each.

    Parameters
    ----------
    paths : Paths
    window : DetectionWindow
        With their hits.
    stamp, sensor, estimator
        As in `fit`.

    Returns
    -------
    state : (n, 4) ndarray
    covariance : (n, 4, 4) ndarray
    """
    state, covariance = np.zeros((len(paths), 4)), np.zeros((len(paths), 4, 4))
    for rows, hits in paths.of_equal_count():
        fitted = fit(window[hits], stamp, sensor, estimator)
        state[rows], covariance[rows] = fitted.state, fitted.covariance
    return state, covariance


def _fit_positions(
    hits: NDArray[np.void], stamp: float, sensor: SensorModel, estimator: str
) -> Fit:
    """The fit to the positions alone."""
    tau = hits["time"] - stamp
    raw = hits["covariance"]
    state, covariance = unweighted(tau, hits["position"], raw)
    if estimator == "unweighted":
        return Fit(state, covariance, tau, raw)
    at_fit = raw
    for _ in range(WEIGHTED_PASSES):
        at_fit = covariance_at(hits, positions_at(state, tau), sensor)
        state, covariance = weighted(tau, hits["position"], at_fit, state)
    fitted = Fit(state, covariance, tau, at_fit)
    return polar(hits, fitted, sensor) if estimator == "polar" else fitted


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
    information = _inverse(covariances)  # (n, m, 2, 2)
    misfit = positions - positions_at(start, tau)
    pull = (information @ misfit[..., None])[..., 0]
    step, covariance = _solve(tau, information, pull)
    return start + step, covariance


@np.errstate(invalid="ignore", divide="ignore")  # numbers that give no fit: nan, never done
def polar(hits: NDArray[np.void], start: Fit, sensor: SensorModel) -> Fit:
    """Maximum likelihood of the measured ranges and azimuths, by Fisher scoring.

    A hit measures ``y = (r, a)``, expected at ``h(X)`` with covariance ``S = diag(s_r^2, s_a^2)``
    and what an uncertain sensor pose adds. s_r may grow with range, which alone counts in dS. With
    ``e = y - h(X)``::

        l(X) = -1/2 sum (e' S^-1 e + ln det S)
        I    = sum (dh' S^-1 dh + 1/2 tr(S^-1 dS S^-1 dS))    (Kay 1993, Eq. 3.31)
        X   <- X + I^-1 dl/dX,   P = I^-1

    A track keeps its start where `POLAR_PASSES` steps do not converge, and where range and azimuth
    are far from linear over its uncertainty, so that P would be much too small: it passes its
    sensor too closely, or the arc is deeper than the range error.

    Parameters
    ----------
    hits : (n, m) ndarray of DETECTION
        The hits of n tracks.
    start : Fit
        A fit near the solution: the weighted one.
    sensor : SensorModel
        Range errors where a hit has none of its own.

    Returns
    -------
    Fit
    """
    state, covariance = start.state.copy(), start.covariance.copy()
    hit_covariance = start.hit_covariance.copy()
    rows, current, spread = np.arange(len(hits)), start.state, start.covariance
    for _ in range(POLAR_PASSES):
        linear = _nearly_linear(hits[rows], start.tau[rows], current, spread, sensor)
        rows, current = rows[linear], current[linear]
        if not len(rows):
            break
        tau = start.tau[rows]
        step, spread = _solve(
            tau, *_polar_information(hits[rows], positions_at(current, tau), sensor)
        )
        current = current + step
        sigma = np.sqrt(np.diagonal(spread, axis1=1, axis2=2))
        done = (np.abs(step) <= POLAR_TOLERANCE * sigma).all(axis=1)
        found = rows[done]
        state[found], covariance[found] = current[done], spread[done]
        hit_covariance[found] = covariance_at(
            hits[found], positions_at(current[done], tau[done]), sensor
        )
        rows, current, spread = rows[~done], current[~done], spread[~done]
    return Fit(state, covariance, start.tau, hit_covariance)


def _nearly_linear(
    hits: NDArray[np.void],
    tau: FloatArray,
    state: FloatArray,
    covariance: FloatArray,
    sensor: SensorModel,
) -> NDArray[np.bool_]:
    """Which of n tracks have ranges and azimuths nearly linear in their states, (n,).

    Over a position's standard deviation s, at range r, the azimuth turns by up to s/r and the arc
    departs from its tangent by s^2 / 2r, which is compared with the range's deviation.
    """
    offset = positions_at(state, tau) - hits["sensor_pose"][..., :2]
    range_ = np.hypot(offset[..., 0], offset[..., 1])
    sigma = major_sigma(position_covariances_at(covariance, tau))
    depth = 0.5 * np.square(sigma)
    linear = range_ > MIN_SENSOR_DISTANCE * sigma
    linear &= depth < range_ * np.sqrt(range_variance_at(hits, range_, sensor))
    return linear.all(axis=1)


def _polar_information(
    hits: NDArray[np.void], positions: FloatArray, sensor: SensorModel
) -> tuple[FloatArray, FloatArray]:
    """Fisher information on each hit's position, and the gradient of its log-likelihood.

    Parameters
    ----------
    hits : (n, m) ndarray of DETECTION
    positions : (n, m, 2) ndarray
        Where the likelihood is taken, m.
    sensor : SensorModel
        Range errors where a hit has none of its own.

    Returns
    -------
    information : (n, m, 2, 2) ndarray
        1/m^2.
    gradient : (n, m, 2) ndarray
        1/m.
    """
    offset = positions - hits["sensor_pose"][..., :2]
    x, y = offset[..., 0], offset[..., 1]
    range_ = np.hypot(x, y)
    cosine, sine = x / range_, y / range_
    jacobian = np.stack([cosine, sine, -sine / range_, cosine / range_], axis=-1)
    jacobian = jacobian.reshape(*range_.shape, 2, 2)  # of range and azimuth by position
    across = np.swapaxes(jacobian, -1, -2)
    covariance = jacobian @ pose_error_covariance(offset, hits["sensor_pose_covariance"]) @ across
    covariance[..., 0, 0] += range_variance_at(hits, range_, sensor)
    covariance[..., 1, 1] += np.square(hits["azimuth_std"])
    information = _inverse(covariance)
    measured_range, measured_azimuth = measured_polar(hits)
    error = np.stack([measured_range - range_, wrap(measured_azimuth - np.arctan2(y, x))], axis=-1)
    gradient = (information @ error[..., None])[..., 0]
    # What a range error tells by its size, where its deviation grows with range.
    slope = np.where(np.isnan(hits["range_std"]), sensor.range_variance_slope(range_), 0.0)
    of_range = information[..., 0, 0].copy()
    gradient[..., 0] += 0.5 * slope * (np.square(gradient[..., 0]) - of_range)
    information[..., 0, 0] += 0.5 * np.square(slope * of_range)
    return across @ information @ jacobian, (across @ gradient[..., None])[..., 0]


def _solve(
    tau: FloatArray, information: FloatArray, pull: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Correction to the states and its covariance, from what each hit says of its position.

    ``P = (sum H_i' J_i H_i)^-1``, ``dX = P sum H_i' g_i``

    Parameters
    ----------
    tau : (n, m) ndarray
        s.
    information : (n, m, 2, 2) ndarray
        J_i, 1/m^2.
    pull : (n, m, 2) ndarray
        g_i: J_i times the misfit, or the gradient of a log-likelihood, 1/m.

    Returns
    -------
    correction : (n, 4) ndarray
    covariance : (n, 4, 4) ndarray
    """
    n = len(tau)
    powers = np.stack([np.ones_like(tau), tau, np.square(tau)], axis=1)  # (n, 3, m)
    moments = np.einsum("nem,nmpq->nepq", powers, information)
    order = np.add.outer([0, 1], [0, 1])  # tau^a tau^b = tau^(a + b)
    normal = moments[:, order].transpose(0, 3, 1, 4, 2).reshape(n, 4, 4)
    right = np.einsum("nam,nmp->npa", powers[:, :2], pull).reshape(n, 4)
    covariance = _inverse(normal)
    covariance = 0.5 * (covariance + np.swapaxes(covariance, 1, 2))
    return (covariance @ right[..., None])[..., 0], covariance


@np.errstate(invalid="ignore")
def _inverse(matrices: FloatArray) -> FloatArray:
    """Inverse of each matrix; nan where it is singular: such a track has no fit."""
    try:
        inverse = np.linalg.inv(matrices)
    except np.linalg.LinAlgError:
        singular = np.linalg.slogdet(matrices)[0] == 0.0
        inverse = np.linalg.inv(np.where(singular[..., None, None], np.nan, matrices))
    return inverse.astype(np.float64, copy=False)


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
