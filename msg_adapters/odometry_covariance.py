"""The 6 x 6 covariances of nav_msgs/Odometry: x, y, z, then rotations about the x, y, z axes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

X, Y, YAW = 0, 1, 5

UNOBSERVED_VARIANCE = 1e6
"""Variance of what is not observed, in its own SI unit squared: 1 km, 1 km/s, 160 turns.

A zero would say that it is known exactly.
"""


def odometry_covariance(block: NDArray[np.float64], axes: Sequence[int]) -> NDArray[np.float64]:
    """Return a covariance in which only some axes are observed.

    Parameters
    ----------
    block : (k, k) ndarray
        Covariance of the observed axes.
    axes : sequence of int
        Their k places in the message.

    Returns
    -------
    (36,) ndarray
        Row by row; `UNOBSERVED_VARIANCE` on the rest of the diagonal.
    """
    full = UNOBSERVED_VARIANCE * np.eye(6)
    full[np.ix_(axes, axes)] = block
    return full.ravel()
