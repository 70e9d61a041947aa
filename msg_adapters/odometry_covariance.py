"""The 6 x 6 covariances of nav_msgs/Odometry: x, y, z, then rotations about the x, y, z axes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

X, Y, YAW = 0, 1, 5

UNOBSERVED_VARIANCE = 1e6
"""Variance of an unobserved quantity, in its SI unit squared: 1 km, 1 km/s, 160 turns.

A variance of zero would mean an exactly known quantity.
"""

MAX_VARIANCE = 1e12
"""Maximum variance that is read, in the SI unit squared: 1000 km, which is no position at all.

A source writes a larger variance only for an unknown quantity, and in sums and squares it would
cancel the known variances by rounding.
"""


def limited(covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a covariance whose variances are at most `MAX_VARIANCE`.

    Larger variances are scaled down and keep their correlations: ``D C D`` is positive
    semi-definite if C is.

    Parameters
    ----------
    covariance : (n, n) ndarray
        C, finite.

    Returns
    -------
    (n, n) ndarray
        C itself if no variance is larger.
    """
    variance = np.diagonal(covariance)
    if (variance <= MAX_VARIANCE).all():
        return covariance
    scale = np.sqrt(MAX_VARIANCE / np.maximum(variance, MAX_VARIANCE))
    return scale[:, None] * covariance * scale


def odometry_covariance(block: NDArray[np.float64], axes: Sequence[int]) -> NDArray[np.float64]:
    """Return a 6 x 6 covariance in which only some axes are observed.

    Parameters
    ----------
    block : (k, k) ndarray
        Covariance of the observed axes.
    axes : sequence of int
        Their k indices in the message.

    Returns
    -------
    (36,) ndarray
        Row by row; `UNOBSERVED_VARIANCE` on the rest of the diagonal.
    """
    full = UNOBSERVED_VARIANCE * np.eye(6)
    full[np.ix_(axes, axes)] = block
    return full.ravel()
