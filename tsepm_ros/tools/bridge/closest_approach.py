"""Closest point of approach of targets and own ship at constant velocities."""

from __future__ import annotations

import numpy as np

from tsepm_ros.numerics.arrays import FloatArray

LEAST_SPEED = 1e-3
"""Relative speed, m/s, below which nothing approaches: rounding of equal velocities."""


def closest_approach(position: FloatArray, velocity: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Distance at the closest approach, and the time until then.

    With p and v of a target relative to own ship, ``t = -p . v / |v|^2`` and the distance is
    ``|p + v t|``.

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
    square = (velocity**2).sum(axis=1)
    moves = square > LEAST_SPEED**2
    time = np.where(moves, -(position * velocity).sum(axis=1) / np.where(moves, square, 1.0), 0.0)
    return np.hypot(*(position + velocity * time[:, None]).T), time
