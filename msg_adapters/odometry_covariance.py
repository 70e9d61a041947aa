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

LARGEST_VARIANCE = 1e12
"""Variance that is read at the most, in its own SI unit squared: 1000 km, no position at all.

Beyond, a source only says that it does not know, and sums and squares lose what else is known.
"""


def limited(covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a covariance whose variances are `LARGEST_VARIANCE` at the most.

    What is larger is scaled down with its correlations: ``D C D`` is positive semi-definite where C
    is.

    Parameters
    ----------
    covariance : (n, n) ndarray
        C, of finite numbers.

    Returns
    -------
    (n, n) ndarray
        C itself where no variance is larger.
    """
    variance = np.diagonal(covariance)
    if (variance <= LARGEST_VARIANCE).all():
        return covariance
    scale = np.sqrt(LARGEST_VARIANCE / np.maximum(variance, LARGEST_VARIANCE))
    return scale[:, None] * covariance * scale


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
