# Copyright 2026 tsepm_ros developers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.
"""Gaussian densities, distances, gates and mixtures, and covariances after rounding."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from tsepm_ros.numerics.arrays import BoolArray, FloatArray

SIGNIFICANT_SQUARE = 13.8
"""Squared distance that a bivariate Gaussian exceeds with a probability of 0.001."""
UNLIKELY_SQUARE = 9.21
"""Squared distance that a bivariate Gaussian exceeds with a probability of 0.01."""
MIN_EIGENVALUE = 1e-12
"""Smallest eigenvalue of a correlation matrix that rounding cannot have made."""
REPAIRED_EIGENVALUE = 1e-9
"""Smallest eigenvalue of a correlation matrix that is repaired."""
MIN_VARIANCE_SHARE = 1e-24
"""Smallest variance of a repaired matrix, as a share of its largest."""


@lru_cache(maxsize=64)
def gate_factor(probability: float) -> float:
    """Axis factor of the ellipse that holds a bivariate Gaussian with a probability (Eq. 5).

    ``alpha = sqrt(-2 ln(1 - P))``
    """
    return math.sqrt(-2.0 * math.log1p(-probability))


def squared_mahalanobis_distance(difference: FloatArray, covariance: FloatArray) -> FloatArray:
    """Squared Mahalanobis distance ``d' C^-1 d`` of vectors (..., 2), covariances (..., 2, 2)."""
    x, y = difference[..., 0], difference[..., 1]
    xx, yy, xy = covariance[..., 0, 0], covariance[..., 1, 1], covariance[..., 0, 1]
    return (yy * x * x - 2.0 * xy * x * y + xx * y * y) / (xx * yy - xy * xy)


def is_significant(difference: FloatArray, covariance: FloatArray) -> BoolArray:
    """Whether (..., 2) vectors of (..., 2, 2) covariances differ from 0, at a level of 0.1 %."""
    return np.asarray(squared_mahalanobis_distance(difference, covariance) > SIGNIFICANT_SQUARE)


def inverse_covariance(matrix: FloatArray) -> FloatArray:
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
    distance = squared_mahalanobis_distance(innovation, covariance)
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


def proper_covariance(covariance: FloatArray) -> FloatArray:
    """Covariances that are symmetric and positive definite beyond the rounding.

    A matrix whose correlations have all eigenvalues above `MIN_EIGENVALUE` is left as it is, to the
    bit. Of another, the eigenvalues of the correlations are raised to `REPAIRED_EIGENVALUE`, which
    enlarges the variances by no more than rounding has lost.

    Parameters
    ----------
    covariance : (n, d, d) ndarray

    Returns
    -------
    (n, d, d) ndarray
        The argument itself where nothing is repaired; matrices that are not finite are kept.
    """
    variance = np.diagonal(covariance, axis1=1, axis2=2)
    finite = np.isfinite(covariance).all(axis=(1, 2))
    if (
        finite.all()
        and (variance > 0.0).all()
        and _is_definite_correlation(_scaled_covariance(covariance, variance))
    ):
        return covariance
    repaired = covariance.copy()
    for row in np.flatnonzero(finite):
        repaired[row] = _repaired_covariance(covariance[row])
    return repaired


@np.errstate(invalid="ignore")
def inverse_covariance_or_nan(matrices: FloatArray) -> FloatArray:
    """Inverse of each (..., d, d) matrix; nan for a singular matrix."""
    try:
        inverted = np.linalg.inv(matrices)
    except np.linalg.LinAlgError:
        singular = np.linalg.slogdet(matrices)[0] == 0.0
        inverted = np.linalg.inv(np.where(singular[..., None, None], np.nan, matrices))
    return inverted.astype(np.float64, copy=False)


def solve(covariance: FloatArray, difference: FloatArray) -> FloatArray:
    """``C^-1 d`` of covariances (n, d, d) and vectors (n, d); singular covariances are repaired."""
    try:
        solved = np.linalg.solve(covariance, difference[..., None])
    except np.linalg.LinAlgError:
        solved = np.linalg.solve(proper_covariance(covariance), difference[..., None])
    return solved[..., 0].astype(np.float64, copy=False)


def _scaled_covariance(covariance: FloatArray, variance: FloatArray) -> FloatArray:
    sigma = np.sqrt(variance)
    return covariance / sigma[..., :, None] / sigma[..., None, :]


def _is_definite_correlation(correlation: FloatArray) -> bool:
    """Whether all matrices are symmetric, and their eigenvalues are above MIN_EIGENVALUE."""
    if np.abs(correlation - np.swapaxes(correlation, -1, -2)).max(initial=0.0) > MIN_EIGENVALUE:
        return False
    try:
        np.linalg.cholesky(correlation - MIN_EIGENVALUE * np.eye(correlation.shape[-1]))
    except np.linalg.LinAlgError:
        return False
    return True


def _repaired_covariance(covariance: FloatArray) -> FloatArray:
    variance = np.diagonal(covariance).copy()
    largest = max(float(variance.max()), np.finfo(float).tiny / MIN_VARIANCE_SHARE)
    variance = np.maximum(variance, MIN_VARIANCE_SHARE * largest)
    if (np.diagonal(covariance) == variance).all() and _is_definite_correlation(
        _scaled_covariance(covariance, variance)
    ):
        return covariance
    correlation = _scaled_covariance(0.5 * (covariance + covariance.T), variance).clip(-1.0, 1.0)
    np.fill_diagonal(correlation, 1.0)
    values, vectors = np.linalg.eigh(correlation)
    correlation = (vectors * np.maximum(values, REPAIRED_EIGENVALUE)) @ vectors.T
    sigma = np.sqrt(variance)
    return np.asarray(0.5 * (correlation + correlation.T) * np.outer(sigma, sigma))
