"""Cramer-Rao bound of the state of a confirmed track."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.sensing.sensor import SensorModel


def cramer_rao(
    positions: ArrayLike,
    times: ArrayLike,
    sensor_positions: ArrayLike,
    sensor: SensorModel,
    stamp: float,
    relative_velocities: ArrayLike | None = None,
) -> FloatArray:
    """Cramer-Rao bound of the state ``[x, vx, y, vy]`` from ranges and azimuths.

    No unbiased estimate from Gaussian ranges r and azimuths a of a constant-velocity target has a
    smaller covariance than ``I^-1`` (Kay, "Fundamentals of Statistical Signal Processing:
    Estimation Theory", 1993, Eq. 3.31)::

        I = sum_i dr dr' (1/v + (dv/dr)^2 / (2 v^2)) + da da' / s_a^2

    with dr and da the gradients of range and azimuth by the state. The second term is the
    information in the size of a range error, whose variance v grows with range. A range rate c
    adds ``dc dc' / s_c^2``.

    Parameters
    ----------
    positions : (..., m, 2) array_like
        True positions at the m hits, m.
    times : (..., m) array_like
        Times of the hits, s.
    sensor_positions : (2,) or (..., m, 2) array_like
        Positions of the sensor at the hits, m.
    sensor : SensorModel
        Range and azimuth errors.
    stamp : float
        Time of the state, s.
    relative_velocities : (..., m, 2) array_like, optional
        The target's velocity less the sensor's at each hit, m/s. Range rates count if they are
        given and the sensor's `range_rate_std` is above 0.

    Returns
    -------
    (..., 4, 4) ndarray
        m^2, m^2/s, m^2/s^2.

    Raises
    ------
    ValueError
        If all hits of a target have one time: its velocity has no bound.
    """
    elapsed = np.asarray(times, float) - stamp
    if not elapsed.shape[-1] or not np.ptp(elapsed, axis=-1).all():
        raise ValueError("times: the hits must have at least two different times")
    offset = np.asarray(positions, float) - np.asarray(sensor_positions, float)
    range_ = np.hypot(offset[..., 0], offset[..., 1])
    variance = sensor.range_variance(range_)
    range_information = 1.0 / variance + 0.5 * np.square(
        sensor.range_variance_slope(range_) / variance
    )
    along = offset / range_[..., None]
    across = np.stack([-along[..., 1], along[..., 0]], axis=-1)
    # Rows of a square root of I: both directions, each weighted by its information.
    directions = np.stack(
        [
            along * np.sqrt(range_information)[..., None],
            across / (range_ * sensor.azimuth_std)[..., None],
        ],
        axis=-2,
    )
    motion = np.stack([np.ones_like(elapsed), elapsed], axis=-1)
    root = directions[..., None] * motion[..., None, None, :]  # (..., m, 2, axis, derivative)
    root = root.reshape(*root.shape[:-4], -1, 4)
    information = np.swapaxes(root, -1, -2) @ root
    if relative_velocities is not None and sensor.range_rate_std > 0.0:
        turn_rate = (across * np.asarray(relative_velocities, float)).sum(axis=-1) / range_
        rate_root = (turn_rate[..., None] * across)[..., None] * motion[..., None, :]
        rate_root[..., 1] += along
        rate_root = rate_root.reshape(*rate_root.shape[:-2], 4) / sensor.range_rate_std
        information = information + np.swapaxes(rate_root, -1, -2) @ rate_root
    return np.asarray(np.linalg.inv(information), np.float64)
