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
"""Discs: the positions within them, as arrays of pairs, and their probability under a Gaussian."""

from __future__ import annotations

import math

import numpy as np
from scipy.special import ndtr

from tsepm_ros.numerics.arrays import FloatArray, IntArray

REACH_DEVIATIONS = 8.0
"""Standard deviations beyond which the Gaussian is neglected."""
NODES, WEIGHTS = np.polynomial.legendre.leggauss(40)
"""Of Gauss-Legendre quadrature from -1 to 1."""
ALL_PAIRS = 20_000
"""Pairs of centres and positions up to which every distance is taken."""
CANDIDATES_TOGETHER = 4_000_000
"""Pairs whose distances are taken together, at most: bounds memory."""
ROWS_PER_ROOT = 2.0
"""Rows of cells at most, over the root of the number of positions."""
CELL_RADII = np.array([[0.25], [1.0]])
"""Width and height of a cell, in radii: a search costs by the row, a cell nothing."""


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
    probability[away + REACH_DEVIATIONS * major <= radius] = 1.0
    cut = (np.abs(away - radius) < REACH_DEVIATIONS * major) & (radius > 0.0)
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
        np.arcsin(np.clip((across + side * REACH_DEVIATIONS * minor) / radius, -1.0, 1.0))
        for side in (-1, 1)
    )
    angle = 0.5 * (high + low)[:, None] + 0.5 * (high - low)[:, None] * NODES
    chord = radius[:, None] * np.cos(angle)
    distance = (radius[:, None] * np.sin(angle) - across[:, None]) / minor[:, None]
    density = np.exp(-0.5 * distance**2) / (np.sqrt(2.0 * np.pi) * minor[:, None])
    inside = ndtr((chord - along[:, None]) / major[:, None])
    inside -= ndtr((-chord - along[:, None]) / major[:, None])
    return np.asarray(0.5 * (high - low) * ((density * inside * chord) @ WEIGHTS))


def pairs_within_discs(
    positions: FloatArray,
    centres: FloatArray,
    radius: FloatArray,
    most: int,
) -> tuple[IntArray, IntArray] | None:
    """Pairs of centres and positions within their radius, ``|z - c|^2 <= r^2``.

    Of many, positions are sorted by the cells of a grid, row by row. A centre looks at those from
    the first to the last cell of each row that the square around its disc touches.

    Parameters
    ----------
    positions : (n, 2) ndarray
    centres : (g, 2) ndarray
    radius : (g,) ndarray
    most : int
        Pairs beyond which the search ends.

    Returns
    -------
    centre, position : (p,) ndarray of int
        Rows of each pair, ascending; or None where there are more than `most`.
    """
    g, n = len(centres), len(positions)
    if g * n <= ALL_PAIRS:
        x, y = centres.T[..., None] - positions.T[:, None]
        within = x * x + y * y <= (radius * radius)[:, None]
        centre, position = within.nonzero()
        return (centre, position) if len(centre) <= most else None
    places, middle = positions.T.copy(), centres.T.copy()
    low, extent = places.min(axis=1, keepdims=True), np.ptp(places, axis=1, keepdims=True)
    margin = 1e-9 * float(np.abs(places).max())  # beyond rounding errors
    least = max(float(extent.max()) / (ROWS_PER_ROOT * math.sqrt(n)), margin)
    side = CELL_RADII * (max(float(np.median(radius)), least) or 1.0)
    last = np.floor(extent / side)
    columns, rows = (int(number) + 1 for number in last[:, 0])

    def cells(values: FloatArray) -> IntArray:  # columns and rows (2, k), the nearest of the grid
        cell = (values - low) / side
        return np.fmin(np.fmax(cell, 0.0, out=cell), last, out=cell).astype(np.int64)

    column, row = cells(places)
    cell = row * columns + column
    order = cell.argsort()
    places, begins = places[:, order], cell[order].searchsorted(np.arange(columns * rows + 1))
    square, reach = radius * radius, (1.0 + 1e-9) * radius + margin
    (left, bottom), (right, top) = cells(middle - reach), cells(middle + reach)
    parts, number, together = [], 0, max(CANDIDATES_TOGETHER // n, 1)
    for first in range(0, g, together):
        part = slice(first, first + together)
        touched = top[part] - bottom[part] + 1
        owner = np.arange(first, first + len(touched)).repeat(touched)
        of_row = _pair_numbers(bottom[part], touched) * columns
        begin = begins.take(of_row + left.take(owner))
        count = begins.take(of_row + right.take(owner) + 1) - begin
        centre, index = owner.repeat(count), _pair_numbers(begin, count)
        x, y = places.take(index, axis=1) - middle.take(centre, axis=1)
        inside = np.flatnonzero(x * x + y * y <= square.take(centre))
        number += len(inside)
        if number > most:
            return None
        key = centre.take(inside) * n  # ascending
        pairs = np.sort(key + order.take(index.take(inside)))
        parts.append((centre.take(inside), pairs - key))
    centre, position = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
    return centre, position


def pairs_within_disc(
    centres: FloatArray, positions: FloatArray, distance: float
) -> tuple[IntArray, IntArray]:
    """Rows of centres (k, 2) and positions (n, 2) no farther apart than a distance, ascending."""
    every = len(centres) * len(positions)
    pairs = pairs_within_discs(positions, centres, np.full(len(centres), distance), every)
    assert pairs is not None
    return pairs


def _pair_numbers(first: IntArray, number: IntArray) -> IntArray:
    """From each first, as many consecutive numbers as asked for, one after another."""
    ends = np.cumsum(number)
    return np.arange(ends[-1]) + (first - ends + number).repeat(number)
