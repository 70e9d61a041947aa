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
from tsepm_ros.sensing import range_rates
from tsepm_ros.sensing.conversion import covariance_at
from tsepm_ros.sensing.sensor import SensorModel


def predict(
    state: FloatArray, covariance: FloatArray, step: FloatArray | float, noise: float = 0.0
) -> tuple[FloatArray, FloatArray]:
    """Carry states over a time step: ``F x``, ``F P F' + Q``.

    Parameters
    ----------
    state : (n, 4) ndarray
        m, m/s.
    covariance : (n, 4, 4) ndarray
    step : (n,) ndarray or float
        Time step of each, s; of either sign.
    noise : float
        q, m^2/s^3: the velocity's variance grows by q per second on each axis.

    Returns
    -------
    state : (n, 4) ndarray
    covariance : (n, 4, 4) ndarray
    """
    step = np.broadcast_to(step, len(state))
    state, covariance = state.copy(), covariance.copy()
    state[:, 0::2] += step[:, None] * state[:, 1::2]
    covariance[:, 0::2] += step[:, None, None] * covariance[:, 1::2]
    covariance[:, :, 0::2] += step[:, None, None] * covariance[:, :, 1::2]
    if noise:
        size = np.abs(step) * noise
        for axis in (0, 2):
            covariance[:, axis, axis] += size * step**2 / 3.0
            covariance[:, axis, axis + 1] += size * step / 2.0
            covariance[:, axis + 1, axis] += size * step / 2.0
            covariance[:, axis + 1, axis + 1] += size
    return state, covariance


def position_after(state: FloatArray, step: FloatArray | float) -> FloatArray:
    """Position ``H x`` (n, 2), m, of states (n, 4) after times, (n,) or the same for all, s."""
    position: FloatArray = state[:, 0::2] + np.asarray(step)[..., None] * state[:, 1::2]
    return position


def position_covariance_after(covariance: FloatArray, step: FloatArray) -> FloatArray:
    """Position covariance ``H P H'`` a short time after the state's, without process noise.

    Parameters
    ----------
    covariance : (n, 4, 4) ndarray
    step : (n,) ndarray
        s.

    Returns
    -------
    (n, 2, 2) ndarray
        m^2.
    """
    t = step[:, None, None]
    cross = covariance[:, 0::2, 1::2]
    return (
        covariance[:, 0::2, 0::2]
        + t * (cross + np.swapaxes(cross, 1, 2))
        + t * t * covariance[:, 1::2, 1::2]
    )


def innovations(
    state: FloatArray,
    covariance: FloatArray,
    step: FloatArray,
    detections: NDArray[np.void],
    sensor: SensorModel,
) -> tuple[FloatArray, FloatArray]:
    """How far detections are from where states expect them: ``z - H x``, ``H P H' + R(H x)``.

    Parameters
    ----------
    state : (n, 4) ndarray
    covariance : (n, 4, 4) ndarray
    step : (n,) ndarray
        Time of each detection after its state's, s.
    detections : (n,) ndarray of DETECTION
    sensor : SensorModel
        Range errors where a detection has none of its own.

    Returns
    -------
    innovation : (n, 2) ndarray
        m.
    spread : (n, 2, 2) ndarray
        Its covariance S, m^2.
    """
    expected = state[:, 0::2] + step[:, None] * state[:, 1::2]
    spread = position_covariance_after(covariance, step)
    spread += covariance_at(detections, expected, sensor)
    return detections["position"] - expected, spread


def update(
    state: FloatArray,
    covariance: FloatArray,
    step: FloatArray,
    innovation: FloatArray,
    spread: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Update states with a position measured `step` seconds after the state's time.

    ``K = P H' S^-1``, ``x + K (z - H x)``, ``P - K S K'``, ``H = [[1, s, 0, 0], [0, 0, 1, s]]``

    Parameters
    ----------
    state : (n, 4) ndarray
    covariance : (n, 4, 4) ndarray
    step : (n,) ndarray
        s.
    innovation : (n, 2) ndarray
        ``z - H x``, m.
    spread : (n, 2, 2) ndarray
        S, the innovation's covariance, m^2.

    Returns
    -------
    state : (n, 4) ndarray
    covariance : (n, 4, 4) ndarray
    """
    weight = kalman_gain(covariance, step, spread)
    state = state + (weight @ innovation[..., None])[..., 0]
    return state, covariance - weight @ spread @ np.swapaxes(weight, 1, 2)


def kalman_gain(covariance: FloatArray, step: FloatArray, spread: FloatArray) -> FloatArray:
    """Kalman gain ``K = P H' S^-1``, (n, 4, 2), for arguments as in `update`."""
    cross = covariance[:, :, 0::2] + step[:, None, None] * covariance[:, :, 1::2]
    weight: FloatArray = cross @ inverse(spread)
    return weight


def log_likelihood(
    state: FloatArray,
    covariance: FloatArray,
    owner: IntArray,
    step: FloatArray,
    innovation: FloatArray,
    spread: FloatArray,
    detections: NDArray[np.void],
    gate_probability: float,
) -> FloatArray:
    """Log of the density of detections where states expect them; -inf outside the gates.

    ``ln N(d; 0, S) + ln N(e; 0, S_e)`` with the innovation e of a range rate, if there is one,
    against the state that knows the position; both are independent, so that the squared distances
    add up, and the gate of a position and a range rate is that of three dimensions.

    Parameters
    ----------
    state : (n, 4) ndarray
    covariance : (n, 4, 4) ndarray
    owner : (p,) ndarray of int
        State of each detection.
    step : (p,) ndarray
        Time of each after its state's, s.
    innovation : (p, 2) ndarray
        Of the position, m.
    spread : (p, 2, 2) ndarray
        Its covariance, m^2.
    detections : (p,) ndarray of DETECTION
    gate_probability : float
        Probability that the gate holds a target's detection.

    Returns
    -------
    (p,) ndarray
        ln of 1/m^2, or of s/m^3.
    """
    density, distance = log_density(innovation, spread)
    gate = np.full(len(distance), gate_factor(gate_probability) ** 2)
    has = range_rates.measured(detections)
    if has.any():
        gate[has] = range_rates.gate_square(gate_probability)
        rows = np.flatnonzero(has & (distance <= gate))
        own, lag = owner[rows], step[rows]
        placed = update(state[own], covariance[own], lag, innovation[rows], spread[rows])
        error, variance, _ = range_rates.innovations(*placed, lag, detections[rows])
        density[rows] += range_rates.log_density(error, variance)
        distance[rows] += error**2 / variance
    return np.where(distance <= gate, density, -np.inf)


def gate_reach(gate_probability: float, detections: NDArray[np.void]) -> float:
    """Standard deviations of a position's innovation that the gate of `log_likelihood` reaches."""
    if range_rates.measured(detections).any():
        return math.sqrt(range_rates.gate_square(gate_probability))
    return gate_factor(gate_probability)
