"""Closest point of approach of targets and own ship at constant velocities."""

from __future__ import annotations

import numpy as np

from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.tracker.maintenance import features

LEAST_SPEED = 1e-3
"""Relative speed, m/s, below which nothing approaches: rounding of equal velocities."""


def closest_approach(position: FloatArray, velocity: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Distance at the closest approach, and the time until then.

    That of `tsepm_ros.tracker.maintenance.features`, with own ship as the first target.

    Parameters
    ----------
    position, velocity : (n, 2) ndarray
        Of the targets relative to own ship, m and m/s.

    Returns
    -------
    distance : (n,) ndarray
        m.
    time : (n,) ndarray
        s; below 0 where it was in the past, 0 where they move together.
    """
    moves = (velocity**2).sum(axis=1) > LEAST_SPEED**2
    state = np.empty((len(position), 4))
    state[:, 0::2], state[:, 1::2] = position, np.where(moves[:, None], velocity, 0.0)
    time, distance = features.closest_approach(np.zeros(4), state)
    return distance, time
