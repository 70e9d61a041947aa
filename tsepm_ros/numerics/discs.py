"""Discs: positions within them, and their probability under a Gaussian.

Probability of a disc under a Gaussian.

Positions within discs: pairs of centres and positions, without lists of Python objects.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree
from scipy.special import ndtr

from tsepm_ros.numerics.arrays import FloatArray, IntArray

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


ALL_PAIRS = 20_000
"""Pairs of centres and positions up to which every distance is taken."""
CENTRES_TOGETHER = 8_192
"""Centres of which pairs are sought together: bounds memory."""
CANDIDATES_TOGETHER = 1_000_000
"""Pairs whose distances are taken together: bounds memory."""
CELL_SIDE = 1.0
"""Side of a cell, in radii: smaller cells take more searches, larger ones more distances."""
CELLS_PER_ROOT = 4.0
"""Cells along each side of the grid at most, over the root of the number of positions."""


def squared_distances(centres: FloatArray, positions: FloatArray) -> FloatArray:
    """``|z - c|^2`` of all pairs of centres (g, 2) and positions (n, 2), (g, n)."""
    x = centres[:, :1] - positions[:, 0]
    y = centres[:, 1:] - positions[:, 1]
    x *= x
    y *= y
    x += y
    return x


def pairs_within(
    positions: FloatArray,
    centres: FloatArray,
    radius: FloatArray,
    most: int,
    late: Callable[[], bool] | None = None,
) -> tuple[IntArray, IntArray] | None:
    """Pairs of centres and positions within their radius, ``|z - c|^2 <= r^2``.

    Of many, positions are sorted by the cells of a grid. A centre looks at those in the cells that
    the square around its disc touches.

    Parameters
    ----------
    positions : (n, 2) ndarray
    centres : (g, 2) ndarray
    radius : (g,) ndarray
    most : int
        Pairs beyond which the search ends.
    late : callable, optional
        Whether the time is over; the search ends then. Of few pairs it is not asked.

    Returns
    -------
    centre, position : (p,) ndarray of int
        Rows of each pair, ascending; or None where there are more than `most`, or it was too late.
    """
    g, n = len(centres), len(positions)
    if g * n <= ALL_PAIRS:
        inside = squared_distances(centres, positions) <= (radius * radius)[:, None]
        centre, position = inside.nonzero()
        return (centre, position) if len(centre) <= most else None
    cells = _Cells(positions, float(np.median(radius)))
    found, number = [], 0
    for first in range(0, g, CENTRES_TOGETHER):
        part = slice(first, first + CENTRES_TOGETHER)
        for centre, position in cells.pairs(centres[part], radius[part]):
            number += len(centre)
            if number > most or (late is not None and late()):
                return None
            found.append(np.sort((centre + first) * n + position))
    pairs = np.concatenate(found) if found else np.zeros(0, np.int64)
    centre, position = np.divmod(pairs, n)
    return centre, position


def pairs_nearer(positions: FloatArray, distance: float) -> tuple[IntArray, IntArray]:
    """Pairs of positions (n, 2) that are no farther apart than a distance.

    Returns
    -------
    first, second : (p,) ndarray of int
        Rows, first < second; the pairs are in no order.
    """
    n = len(positions)
    if n * n <= ALL_PAIRS:
        near = squared_distances(positions, positions) <= distance * distance
        first, second = near.nonzero()
        once = first < second
        return first[once], second[once]
    pairs = cKDTree(positions).query_pairs(distance, output_type="ndarray")
    return pairs.min(axis=1, initial=n), pairs.max(axis=1, initial=-1)


class _Axis(NamedTuple):
    """Cells of equal side along an axis, m."""

    low: float
    extent: float
    number: int

    @classmethod
    def of(cls, values: FloatArray, radius: float, most: int) -> _Axis:
        """Cells over the extent of values (n,), no more than `most`."""
        low = float(values.min())
        extent = float(values.max()) - low
        return cls(low, extent, _parts(extent, radius, most))

    def cells(self, values: FloatArray) -> IntArray:
        """Index of the cell nearest to each value, (n,)."""
        cell = (values - self.low) / ((self.extent or 1.0) / self.number)
        return np.clip(cell, 0, self.number - 1, out=cell).astype(np.int64)


class _Cells:
    """Positions sorted by the cells of a grid, row by row, and where each cell begins."""

    def __init__(self, positions: FloatArray, radius: float) -> None:
        x, y = positions.T.copy()
        most = max(int(CELLS_PER_ROOT * math.sqrt(len(positions))), 1)
        self._columns = _Axis.of(x, radius, most)
        self._rows = _Axis.of(y, radius, most)
        extent = max(self._columns.extent, self._rows.extent)
        # Beyond rounding errors of the cells.
        self._margin = 1e-9 * (extent + float(np.abs(positions).max()))
        cell = self._rows.cells(y) * self._columns.number + self._columns.cells(x)
        self._order = np.argsort(cell, kind="stable")
        self._x, self._y = x[self._order], y[self._order]
        self._begin = np.zeros(self._columns.number * self._rows.number + 1, np.int64)
        np.cumsum(np.bincount(cell, minlength=len(self._begin) - 1), out=self._begin[1:])

    def pairs(self, centres: FloatArray, radius: FloatArray) -> Iterator[tuple[IntArray, IntArray]]:
        """Parts of the pairs of these centres; no centre is in two parts."""
        reach = radius + self._margin
        x, y = centres.T.copy()
        left, right = self._columns.cells(x - reach), self._columns.cells(x + reach)
        lowest, highest = self._rows.cells(y - reach), self._rows.cells(y + reach)
        rows = highest - lowest + 1
        owner = np.arange(len(centres)).repeat(rows)
        base = _counted(lowest, rows) * self._columns.number
        begin = self._begin.take(base + left.take(owner))
        number = self._begin.take(base + right.take(owner) + 1) - begin
        ends = np.cumsum(np.bincount(owner, number, minlength=len(centres)))
        square = radius * radius
        first = 0
        while first < len(centres):
            before = ends[first - 1] if first else 0.0
            last = int(np.searchsorted(ends, before + CANDIDATES_TOGETHER, side="right"))
            last = max(last, first + 1)
            part = slice(*np.searchsorted(owner, [first, last]))
            yield self._inside(x, y, square, owner[part], begin[part], number[part])
            first = last

    def _inside(
        self,
        x_of: FloatArray,
        y_of: FloatArray,
        square: FloatArray,
        owner: IntArray,
        begin: IntArray,
        number: IntArray,
    ) -> tuple[IntArray, IntArray]:
        """Of runs of sorted positions, the pairs that are inside."""
        centre, row = owner.repeat(number), _counted(begin, number)
        x = x_of.take(centre)
        x -= self._x.take(row)
        y = y_of.take(centre)
        y -= self._y.take(row)
        x *= x
        y *= y
        x += y
        inside = np.flatnonzero(x <= square.take(centre))
        return centre.take(inside), self._order.take(row.take(inside))


def _parts(side: float, radius: float, most: int) -> int:
    """Cells along a side of the grid, m."""
    wanted = side / (CELL_SIDE * radius) if radius > 0.0 else math.inf
    return max(math.ceil(wanted), 1) if wanted < most else most


def _counted(first: IntArray, number: IntArray) -> IntArray:
    """From each first, as many consecutive numbers as asked for, one after another."""
    ends = np.cumsum(number)
    total = int(ends[-1]) if len(ends) else 0
    return np.arange(total) + (first - ends + number).repeat(number)
