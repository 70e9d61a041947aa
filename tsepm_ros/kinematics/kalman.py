"""Kalman prediction and update of many tracks at once.

States are ``[x, vx, y, vy]``; motion is nearly constant velocity, with the transition matrix of
TSEPM 2018, Eq. 17, and white acceleration of a spectral density q (Bar-Shalom, Li, Kirubarajan,
"Estimation with Applications to Tracking and Navigation", 2001, section 6.2.2).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.numerics.arrays import FloatArray, IntArray
from tsepm_ros.numerics.gaussian import gate_factor, inverse, log_density
from tsepm_ros.numerics.rows import taken
from tsepm_ros.sensing import range_rates
from tsepm_ros.sensing.conversion import covariance_at
from tsepm_ros.sensing.sensor import SensorModel

_CONSTANT, _LINEAR, _SQUARE = np.zeros((3, 4, 4))
_CONSTANT[[1, 3], [1, 3]] = 1.0
_LINEAR[[0, 1, 2, 3], [1, 0, 3, 2]] = 1.0 / 2.0
_SQUARE[[0, 2], [0, 2]] = 1.0 / 3.0
"""Coefficients of `process_noise`, as a polynomial of the time."""


def predict(
    state: FloatArray,
    covariance: FloatArray,
    elapsed: FloatArray | float,
    noise: FloatArray | float = 0.0,
) -> tuple[FloatArray, FloatArray]:
    """Predict states over a time interval: ``F x``, ``F P F' + Q``.

    Parameters
    ----------
    state : (..., 4) ndarray
        m, m/s.
    covariance : (..., 4, 4) ndarray
    elapsed : (...) ndarray or float
        Interval of each, s; of either sign.
    noise : (...) ndarray or float
        q, m^2/s^3: the variance of each velocity component grows by q per second.

    Returns
    -------
    state : (..., 4) ndarray
    covariance : (..., 4, 4) ndarray
    """
    elapsed = np.asarray(elapsed, float)
    state, covariance = state.copy(), covariance.copy()
    step = elapsed[..., None]
    state[..., 0::2] += step * state[..., 1::2]
    # Views by axis; long rows are faster.
    rows = covariance.reshape(*covariance.shape[:-2], 2, 2, 4)
    rows[..., 0, :] += step[..., None] * rows[..., 1, :]
    columns = covariance.reshape(*covariance.shape[:-2], 8, 2)
    columns[..., 0] += step * columns[..., 1]
    noise = np.asarray(noise, float)
    if noise.any():
        covariance += process_noise(elapsed, np.abs(elapsed) * noise)
    return state, covariance


def process_noise(elapsed: FloatArray, velocity_variance: FloatArray) -> FloatArray:
    """Covariance Q (..., 4, 4) of white acceleration over times (...), s.

    ``v [[t^2 / 3, t / 2], [t / 2, 1]]`` for each axis, with the variance v (...) that it adds to
    each velocity, m^2/s^2.
    """
    t = elapsed[..., None, None]
    noise: FloatArray = (t * (t * _SQUARE + _LINEAR) + _CONSTANT) * velocity_variance[
        ..., None, None
    ]
    return noise


def position_after(state: FloatArray, time_after_state: FloatArray | float) -> FloatArray:
    """Position ``H x`` (..., 2), m, of states (..., 4) after times that broadcast, s."""
    after = np.asarray(time_after_state)[..., None]
    position: FloatArray = state[..., 0::2] + after * state[..., 1::2]
    return position


def position_covariance_after(covariance: FloatArray, time_after_state: FloatArray) -> FloatArray:
    """Position covariance ``H P H'`` a short time after the state's, without process noise.

    Parameters
    ----------
    covariance : (..., 4, 4) ndarray
    time_after_state : ndarray
        Of a shape that broadcasts, s.

    Returns
    -------
    (..., 2, 2) ndarray
        m^2.
    """
    if not time_after_state.any():
        return covariance[..., 0::2, 0::2].copy()
    t = time_after_state[..., None, None]
    cross = covariance[..., 0::2, 1::2]
    return (
        covariance[..., 0::2, 0::2]
        + t * (cross + np.swapaxes(cross, -1, -2))
        + t * t * covariance[..., 1::2, 1::2]
    )


def innovations(
    state: FloatArray,
    covariance: FloatArray,
    time_after_state: FloatArray,
    detections: NDArray[np.void],
    sensor: SensorModel,
) -> tuple[FloatArray, FloatArray]:
    """Innovations of detections and their covariances: ``z - H x``, ``H P H' + R(H x)``.

    Parameters
    ----------
    state : (n, 4) ndarray
    covariance : (n, 4, 4) ndarray
    time_after_state : (n,) ndarray
        Time of each detection after its state's, s.
    detections : (n,) ndarray of DETECTION
    sensor : SensorModel
        Range errors of detections without their own.

    Returns
    -------
    innovation : (n, 2) ndarray
        m.
    innovation_covariance : (n, 2, 2) ndarray
        S, m^2.
    """
    expected = state[:, 0::2] + time_after_state[:, None] * state[:, 1::2]
    innovation_covariance = position_covariance_after(covariance, time_after_state)
    innovation_covariance += covariance_at(detections, expected, sensor)
    return detections["position"] - expected, innovation_covariance


def update(
    state: FloatArray,
    covariance: FloatArray,
    time_after_state: FloatArray,
    innovation: FloatArray,
    innovation_covariance: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Update states with positions measured after the states' times.

    ``K = P H' S^-1``, ``x + K (z - H x)``, ``P - K S K'``, ``H = [[1, t, 0, 0], [0, 0, 1, t]]``

    Parameters
    ----------
    state : (n, 4) ndarray
    covariance : (n, 4, 4) ndarray
    time_after_state : (n,) ndarray
        s.
    innovation : (n, 2) ndarray
        ``z - H x``, m.
    innovation_covariance : (n, 2, 2) ndarray
        S, m^2.

    Returns
    -------
    state : (n, 4) ndarray
    covariance : (n, 4, 4) ndarray
    """
    gain = kalman_gain(covariance, time_after_state, innovation_covariance)
    state = state + (gain @ innovation[..., None])[..., 0]
    return state, covariance - gain @ innovation_covariance @ np.swapaxes(gain, -1, -2)


def kalman_gain(
    covariance: FloatArray, time_after_state: FloatArray, innovation_covariance: FloatArray
) -> FloatArray:
    """Kalman gain ``K = P H' S^-1``, (..., 4, 2), for arguments as in `update`."""
    cross = covariance[..., 0::2]
    if time_after_state.any():
        cross = cross + time_after_state[..., None, None] * covariance[..., 1::2]
    gain: FloatArray = cross @ inverse(innovation_covariance)
    return gain


def log_likelihood(
    state: FloatArray,
    covariance: FloatArray,
    owner: IntArray,
    time_after_state: FloatArray,
    innovation: FloatArray,
    innovation_covariance: FloatArray,
    detections: NDArray[np.void],
    gate_probability: float,
) -> FloatArray:
    """Log of the likelihood of detections, given states; -inf outside the gates.

    ``ln N(d; 0, S) + ln N(e; 0, S_e)`` with the innovation e of a measured range rate against the
    state updated with the position. The innovations are independent: their squared distances add
    up, and the gate of a position and a range rate has three dimensions.

    Parameters
    ----------
    state : (n, 4) ndarray
    covariance : (n, 4, 4) ndarray
    owner : (p,) ndarray of int
        State of each detection.
    time_after_state : (p,) ndarray
        Time of each detection after its state's, s.
    innovation : (p, 2) ndarray
        Innovation of each position, m.
    innovation_covariance : (p, 2, 2) ndarray
        m^2.
    detections : (p,) ndarray of DETECTION
    gate_probability : float
        Probability that the gate holds a target's detection.

    Returns
    -------
    (p,) ndarray
        ln of 1/m^2, or of s/m^3.
    """
    has_range_rate = range_rates.measured(detections)
    if not has_range_rate.any():
        return position_log_likelihood(innovation, innovation_covariance, gate_probability)
    density, distance = log_density(innovation, innovation_covariance)
    gate = np.full(len(distance), gate_factor(gate_probability) ** 2)
    gate[has_range_rate] = range_rates.gate_square(gate_probability)
    rows = np.flatnonzero(has_range_rate & (distance <= gate))
    rated, interval = owner[rows], time_after_state[rows]
    updated = update(
        state[rated],
        covariance[rated],
        interval,
        innovation[rows],
        innovation_covariance[rows],
    )
    error, variance, _ = range_rates.innovations(*updated, interval, taken(detections, rows))
    density[rows] += range_rates.log_density(error, variance)
    distance[rows] += error**2 / variance
    return np.where(distance <= gate, density, -np.inf)


def position_log_likelihood(
    innovation: FloatArray, innovation_covariance: FloatArray, gate_probability: float
) -> FloatArray:
    """As `log_likelihood`, of positions alone, (...); -inf outside the gates."""
    density, distance = log_density(innovation, innovation_covariance)
    return np.where(distance <= gate_factor(gate_probability) ** 2, density, -np.inf)


def gate_reach(gate_probability: float, detections: NDArray[np.void]) -> float:
    """Standard deviations of a position's innovation that the gate of `log_likelihood` reaches."""
    if range_rates.measured(detections).any():
        return math.sqrt(range_rates.gate_square(gate_probability))
    return gate_factor(gate_probability)
