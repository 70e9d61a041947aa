"""The three estimators of an initial state that Sequential 2014 (Section 4.2, Table 1) compares.

Ji D., Li D., "An improved sequential initiation method for multitarget track in clutter with large
noise measurement", Math. Probl. Eng. 2014, 394297. The article prints least squares only (Eq. 11);
what linear fitting and the Kalman filter are is read here as written at each function.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.kinematics.kalman import predict, update
from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.sensing.sensor import SensorModel
from tsepm_ros.stages.estimation import Fit, fit

ESTIMATORS = ("least_squares", "linear_fitting", "kalman_filter")


def estimate(
    hits: NDArray[np.void], stamp: float, sensor: SensorModel, estimator: str, noise: float
) -> Fit:
    """Estimate the state at `stamp` from the hits of each track.

    Parameters
    ----------
    hits : (n, m) ndarray of DETECTION
        The hits of n tracks, m >= 2 at different times; nan where they are not.
    stamp : float
        Time of the state, s.
    sensor : SensorModel
    estimator : {"least_squares", "linear_fitting", "kalman_filter"}
        ``X = (H'H)^-1 H'Z`` (Eq. 11), `line`, or `kalman`.
    noise : float
        Process noise of the Kalman filter, m^2/s^3.

    Returns
    -------
    Fit
    """
    least_squares = fit(hits, stamp, sensor, "unweighted")
    if estimator == "least_squares":
        return least_squares
    time_after_state, raw = least_squares.time_after_state, hits["covariance"]
    if estimator == "kalman_filter":
        return Fit(*kalman(time_after_state, hits["position"], raw, noise), time_after_state, raw)
    state, covariance = line(time_after_state, hits["position"], raw)
    # Where all hits are at one place there is no line.
    point = np.isnan(covariance).any(axis=(1, 2))
    state[point] = least_squares.state[point]
    covariance[point] = least_squares.covariance[point]
    return Fit(state, covariance, time_after_state, raw)


@np.errstate(invalid="ignore", divide="ignore")  # no line, or no time between the ends: nan
def line(
    time_after_state: FloatArray, positions: FloatArray, covariances: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Straight line through the hits' positions, run along from the first hit to the last.

    The line goes through the mean along the axis of largest variance, unit vector u (total least
    squares: no axis is special; the other reading is a regression of y on x). With
    ``a_i = u'(z_i - mean)`` the target is at ``mean + u a_m`` at the last hit's time and moves at
    ``u (a_m - a_1) / (t_m - t_1)``: the times of the hits between do not count, a loss against
    least squares. The covariance is to first order in the errors: along u from the ends, across u
    from the line's offset and slope. It is too small where the errors are not small against the
    path, since u is then uncertain.

    Parameters
    ----------
    time_after_state : (n, m) ndarray
        Time of each hit after the state's, s.
    positions : (n, m, 2) ndarray
        m.
    covariances : (n, m, 2, 2) ndarray
        R_i, m^2.

    Returns
    -------
    state : (n, 4) ndarray
    covariance : (n, 4, 4) ndarray
    """
    n, m = time_after_state.shape
    mean = positions.mean(axis=1)
    centred = positions - mean[:, None]
    scatter = np.swapaxes(centred, 1, 2) @ centred
    angle = 0.5 * np.arctan2(2.0 * scatter[:, 0, 1], scatter[:, 0, 0] - scatter[:, 1, 1])
    cosine, sine = np.cos(angle), np.sin(angle)
    axes = np.stack([cosine, sine, -sine, cosine], axis=1).reshape(n, 2, 2)  # rows: along, across
    along = (centred @ axes[:, 0, :, None])[..., 0]
    time = time_after_state[:, -1] - time_after_state[:, 0]
    speed = (along[:, -1] - along[:, 0]) / time
    velocity = axes[:, 0] * speed[:, None]
    state = np.zeros((n, 4))
    state[:, 1::2] = velocity
    state[:, 0::2] = mean + axes[:, 0] * along[:, -1:] - time_after_state[:, -1:] * velocity
    weights = np.zeros((n, 2, 2, m))  # axis; position, velocity
    weights[:, 0, 1, -1], weights[:, 0, 1, 0] = 1.0 / time, -1.0 / time
    weights[:, 0, 0] = -time_after_state[:, -1:] * weights[:, 0, 1]
    weights[:, 0, 0, -1] += 1.0
    slope = along / np.square(along).sum(axis=1, keepdims=True)  # of the line, by an error across
    place = along[:, -1] - time_after_state[:, -1] * speed
    weights[:, 1, 0] = 1.0 / m + place[:, None] * slope
    weights[:, 1, 1] = speed[:, None] * slope
    turned = axes[:, None] @ covariances @ np.swapaxes(axes, 1, 2)[:, None]  # (n, m, 2, 2)
    blocks = np.einsum("npam,nqbm,nmpq->npaqb", weights, weights, turned)
    covariance = np.einsum("npx,npaqb,nqy->nxayb", axes, blocks, axes).reshape(n, 4, 4)
    return state, covariance


@np.errstate(invalid="ignore", divide="ignore")  # equal times have no velocity: nan
def kalman(
    time_after_state: FloatArray, positions: FloatArray, covariances: FloatArray, noise: float
) -> tuple[FloatArray, FloatArray]:
    """Kalman filter over the hits, begun by two-point differencing, then carried to the stamp.

    The first two hits give position and velocity, ``x = z_2, v = (z_2 - z_1) / dt`` with the
    covariance that their errors make (Bar-Shalom, Li, Kirubarajan 2001, Section 5.5.3); the others
    update it. Without process noise this is weighted least squares. The article does not specify
    how its filter begins; the other reading is a velocity of zero.

    Parameters
    ----------
    time_after_state, positions, covariances
        As in `line`.
    noise : float
        Spectral density of the acceleration, m^2/s^3.

    Returns
    -------
    state : (n, 4) ndarray
    covariance : (n, 4, 4) ndarray
    """
    n, m = time_after_state.shape
    interval = time_after_state[:, 1] - time_after_state[:, 0]
    state, covariance = np.zeros((n, 4)), np.zeros((n, 4, 4))
    state[:, 0::2] = positions[:, 1]
    state[:, 1::2] = (positions[:, 1] - positions[:, 0]) / interval[:, None]
    per_second = 1.0 / interval[:, None, None]
    covariance[:, 0::2, 0::2] = covariances[:, 1]
    covariance[:, 0::2, 1::2] = covariance[:, 1::2, 0::2] = covariances[:, 1] * per_second
    covariance[:, 1::2, 1::2] = (covariances[:, 0] + covariances[:, 1]) * per_second**2
    if noise:  # the target may have turned between the two
        covariance[:, [1, 3], [1, 3]] += noise * np.abs(interval[:, None]) / 3.0
    for hit in range(2, m):
        elapsed = time_after_state[:, hit] - time_after_state[:, hit - 1]
        state, covariance = predict(state, covariance, elapsed, noise)
        innovation_covariance = covariance[:, 0::2, 0::2] + covariances[:, hit]
        innovation = positions[:, hit] - state[:, 0::2]
        state, covariance = update(
            state, covariance, np.zeros(n), innovation, innovation_covariance
        )
    return predict(state, covariance, -time_after_state[:, -1], noise)
