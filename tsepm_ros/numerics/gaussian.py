"""Gaussian densities, distances, gates and mixtures."""

from __future__ import annotations

import math

import numpy as np

from tsepm_ros.numerics.arrays import BoolArray, FloatArray

SIGNIFICANT = 13.8
"""Squared distance that a bivariate Gaussian exceeds with a probability of 0.001."""


def gate_factor(probability: float) -> float:
    """Axis factor of the ellipse that holds a bivariate Gaussian with a probability (Eq. 5).

    ``alpha = sqrt(-2 ln(1 - P))``
    """
    return math.sqrt(-2.0 * math.log1p(-probability))


def squared_distance(difference: FloatArray, covariance: FloatArray) -> FloatArray:
    """``d' C^-1 d`` of (..., 2) vectors under (..., 2, 2) covariances."""
    x, y = difference[..., 0], difference[..., 1]
    xx, yy, xy = covariance[..., 0, 0], covariance[..., 1, 1], covariance[..., 0, 1]
    return (yy * x * x - 2.0 * xy * x * y + xx * y * y) / (xx * yy - xy * xy)


def is_significant(difference: FloatArray, covariance: FloatArray) -> BoolArray:
    """Whether (..., 2) vectors of (..., 2, 2) covariances differ from 0, at a level of 0.1 %."""
    return np.asarray(squared_distance(difference, covariance) > SIGNIFICANT)


def inverse(matrix: FloatArray) -> FloatArray:
    """Inverse of each (..., 2, 2) matrix, by its closed form."""
    a, b = matrix[..., 0, 0], matrix[..., 0, 1]
    c, d = matrix[..., 1, 0], matrix[..., 1, 1]
    inverted = np.empty_like(matrix)
    inverted[..., 0, 0], inverted[..., 0, 1] = d, -b
    inverted[..., 1, 0], inverted[..., 1, 1] = -c, a
    return inverted / (a * d - b * c)[..., None, None]


def log_density(innovation: FloatArray, covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Log of the Gaussian density of innovations, and their squared distances.

    ``ln N(d; 0, S) = -d' S^-1 d / 2 - ln(2 pi sqrt(|S|))``

    Parameters
    ----------
    innovation : (n, 2) ndarray
        d, m.
    covariance : (n, 2, 2) ndarray
        S, m^2.

    Returns
    -------
    log_density : (n,) ndarray
        ln of 1/m^2.
    distance : (n,) ndarray
        ``d' S^-1 d``.
    """
    distance = squared_distance(innovation, covariance)
    xx, yy, xy = covariance[..., 0, 0], covariance[..., 1, 1], covariance[..., 0, 1]
    return -0.5 * (distance + np.log(xx * yy - xy * xy)) - np.log(2.0 * np.pi), distance


def mixture(
    weights: FloatArray, states: FloatArray, covariances: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Means and covariances over alternatives, the spread of their means included.

    ``x = sum_i w_i x_i``, ``P = sum_i w_i (P_i + (x_i - x)(x_i - x)')``

    Parameters
    ----------
    weights : (m, ...) ndarray
        Probabilities of the m alternatives, of sum 1.
    states : (m, ..., 4) ndarray
    covariances : (m, ..., 4, 4) ndarray

    Returns
    -------
    state : (..., 4) ndarray
    covariance : (..., 4, 4) ndarray
    """
    difference = states - states[0]  # exact where the alternatives are equal
    mean = np.einsum("m...,m...i->...i", weights, difference)
    deviation = difference - mean
    second_moments = covariances + deviation[..., :, None] * deviation[..., None, :]
    covariance = np.einsum("m...,m...ij->...ij", weights, second_moments)
    return states[0] + mean, covariance
