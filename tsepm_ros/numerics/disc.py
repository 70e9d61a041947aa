"""Probability of a disc under a Gaussian."""

from __future__ import annotations

import numpy as np
from scipy.special import ndtr

from tsepm_ros.numerics.arrays import FloatArray

REACH = 8.0
"""Standard deviations beyond which the Gaussian is neglected."""
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(40)


def disc_probability(
    mean: FloatArray, covariance: FloatArray, radius: FloatArray | float
) -> FloatArray:
    """Probability that Gaussian vectors lie in discs around the origin, (..., n).

    With the axes of the ellipse, u along the minor and w along the major one::

        integral of N(u; m_u, s_u^2) P(|w| < sqrt(r^2 - u^2)) du

    with ``u = r sin(a)``, by Gauss-Legendre quadrature over that part of the disc which the
    Gaussian reaches. Whatever the sizes of disc and ellipse, the integrand is smooth between these
    limits.

    Parameters
    ----------
    mean : (n, 2) ndarray
    covariance : (n, 2, 2) ndarray
        Positive definite.
    radius : (...) ndarray or float
        r, m or whatever; 0 has probability 0.
    """
    radius = np.asarray(radius, float)[..., None]
    probability = np.zeros((*radius.shape[:-1], len(mean)))
    if not radius.any() or not len(mean):
        return probability
    square, axes = np.linalg.eigh(covariance)  # minor first
    minor, major = np.sqrt(np.maximum(square, np.finfo(float).tiny)).T
    away = np.hypot(mean[:, 0], mean[:, 1])
    probability[away + REACH * major <= radius] = 1.0
    cut = (np.abs(away - radius) < REACH * major) & (radius > 0.0)
    row = cut.nonzero()[-1]
    if len(row):
        across, along = np.einsum("nij,ni->jn", axes[row], mean[row])
        of_cut = np.broadcast_to(radius, cut.shape)[cut]
        probability[cut] = _integrals(across, along, minor[row], major[row], of_cut)
    return probability * (radius > 0.0)


def _integrals(
    across: FloatArray,
    along: FloatArray,
    minor: FloatArray,
    major: FloatArray,
    radius: FloatArray,
) -> FloatArray:
    """The integrals for means and deviations (n,) along both axes, and radii (n,)."""
    low, high = (
        np.arcsin(np.clip((across + side * REACH * minor) / radius, -1.0, 1.0)) for side in (-1, 1)
    )
    angle = 0.5 * (high + low)[:, None] + 0.5 * (high - low)[:, None] * _NODES
    chord = radius[:, None] * np.cos(angle)
    distance = (radius[:, None] * np.sin(angle) - across[:, None]) / minor[:, None]
    density = np.exp(-0.5 * distance**2) / (np.sqrt(2.0 * np.pi) * minor[:, None])
    inside = ndtr((chord - along[:, None]) / major[:, None])
    inside -= ndtr((-chord - along[:, None]) / major[:, None])
    values = density * inside * chord
    return np.asarray(0.5 * (high - low) * (values @ _WEIGHTS))
