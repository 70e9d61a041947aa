"""Positions within discs: pairs of centres and positions, without lists of Python objects."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np
from scipy.spatial import cKDTree

from tsepm_ros.numerics.arrays import FloatArray, IntArray

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


class _Cells:
    """Positions sorted by the cells of a grid, row by row, and where each cell begins."""

    def __init__(self, positions: FloatArray, radius: float) -> None:
        self._low = positions.min(axis=0)
        extent = positions.max(axis=0) - self._low
        most = max(int(CELLS_PER_ROOT * math.sqrt(len(positions))), 1)
        self._number = np.array([_parts(float(side), radius, most) for side in extent])
        self._side = np.where(extent > 0.0, extent, 1.0) / self._number
        # Beyond rounding errors of the cells.
        self._margin = 1e-9 * (float(extent.max()) + float(np.abs(positions).max()))
        column, row = self._of(positions)
        cell = row * self._number[0] + column
        order = np.argsort(cell, kind="stable")
        self._order = order
        self._x, self._y = positions[order].T.copy()
        self._begin = np.zeros(int(self._number.prod()) + 1, np.int64)
        np.cumsum(np.bincount(cell, minlength=len(self._begin) - 1), out=self._begin[1:])

    def _of(self, places: FloatArray) -> IntArray:
        """Column and row of the cell nearest to places (n, 2), (2, n)."""
        cell = np.clip((places - self._low) / self._side, 0, self._number - 1)
        return np.asarray(cell.astype(np.int64).T)

    def pairs(self, centres: FloatArray, radius: FloatArray) -> Iterator[tuple[IntArray, IntArray]]:
        """Parts of the pairs of these centres; no centre is in two parts."""
        reach = (radius + self._margin)[:, None]
        left, lowest = self._of(centres - reach)
        right, highest = self._of(centres + reach)
        rows = highest - lowest + 1
        owner = np.arange(len(centres)).repeat(rows)
        base = _counted(lowest, rows) * self._number[0]
        begin = self._begin.take(base + left.take(owner))
        number = self._begin.take(base + right.take(owner) + 1) - begin
        ends = np.cumsum(np.bincount(owner, number, minlength=len(centres)))
        first = 0
        while first < len(centres):
            before = ends[first - 1] if first else 0.0
            last = int(np.searchsorted(ends, before + CANDIDATES_TOGETHER, side="right"))
            last = max(last, first + 1)
            part = slice(*np.searchsorted(owner, [first, last]))
            yield self._inside(centres, radius, owner[part], begin[part], number[part])
            first = last

    def _inside(
        self,
        centres: FloatArray,
        radius: FloatArray,
        owner: IntArray,
        begin: IntArray,
        number: IntArray,
    ) -> tuple[IntArray, IntArray]:
        """Of runs of sorted positions, the pairs that are inside."""
        centre, row = owner.repeat(number), _counted(begin, number)
        x = centres[:, 0].take(centre)
        x -= self._x.take(row)
        y = centres[:, 1].take(centre)
        y -= self._y.take(row)
        x *= x
        y *= y
        x += y
        inside = np.flatnonzero(x <= (radius * radius).take(centre))
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
