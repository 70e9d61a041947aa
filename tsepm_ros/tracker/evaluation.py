"""Track evaluation (TSEPM 2018, Section 3.4): the fit of the hits to a single target."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.numerics.gaussian import squared_distance
from tsepm_ros.tracker.path_fit import Fit, position_covariances_at, positions_at

EVALUATIONS = ("normalized_distance", "clutter_statistic")


def normalized_distance(hits: NDArray[np.void], fit: Fit) -> FloatArray:
    """Largest normalised distance between hits and fit, f_1 (Eqs. 21-23).

    ``f(k) = (z_k - H x_k)' (H P_k H' + R_k)^-1 (z_k - H x_k)``, ``f_1 = max_k f(k)``

    As published, the state's covariance is added although the fit contains the hit, so f(k) is
    smaller than a chi-square variable.

    Parameters
    ----------
    hits : (n, m) ndarray of DETECTION
        The hits that were fitted.
    fit : Fit
        Their fit.

    Returns
    -------
    (n,) ndarray
        A squared distance, without unit.
    """
    time_after_state = fit.time_after_state
    residual = hits["position"] - positions_at(fit.state, time_after_state)
    residual_covariance = position_covariances_at(fit.covariance, time_after_state)
    residual_covariance = residual_covariance + fit.hit_covariance
    return squared_distance(residual, residual_covariance).max(axis=1)


def clutter_statistic(positions: FloatArray, clutter_density: FloatArray | float) -> FloatArray:
    """Kennedy's clutter statistic f_2 (Eqs. 24-25).

    ``f_2 = 2 sum_k lambda_k V(k)``, V(k) = pi d_k^2 the area out to the associated point at
    distance d_k from the previous hit, lambda_k the density there. For nearest points of pure
    clutter it is chi-square distributed with 2 M - 2 degrees of freedom; for a target it is small.

    Parameters
    ----------
    positions : (n, m, 2) ndarray
        Positions of the hits, oldest first, m.
    clutter_density : (n, m) ndarray or float
        lambda, 1/m^2: a common value, as published, or the value at each hit.

    Returns
    -------
    (n,) ndarray
    """
    squared_displacement = np.square(np.diff(positions, axis=1)).sum(axis=2)
    density = np.broadcast_to(clutter_density, positions.shape[:2])[:, 1:]
    statistic: FloatArray = 2.0 * np.pi * (density * squared_displacement).sum(axis=1)
    return statistic
