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
STRIP_HEIGHT = 3.0
"""Height of a strip, in radii: lower strips take more searches, higher ones more distances."""
STRIPS_PER_ROOT = 4.0
"""Strips at most, over the root of the number of positions."""


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

    Of many, positions are sorted by strips in y and, in a strip, by x. A centre looks at those of
    each strip that its disc crosses which are between the ends of the disc there.

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
    strips = _Strips(positions, float(np.median(radius)))
    found, number = [], 0
    for first in range(0, g, CENTRES_TOGETHER):
        part = slice(first, first + CENTRES_TOGETHER)
        for centre, position in strips.pairs(centres[part], radius[part]):
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


class _Strips:
    """Positions sorted by strips in y, and by x in each."""

    def __init__(self, positions: FloatArray, radius: float) -> None:
        low, high = positions.min(axis=0), positions.max(axis=0)
        width, height = high - low
        most = max(int(STRIPS_PER_ROOT * math.sqrt(len(positions))), 1)
        wanted = height / (STRIP_HEIGHT * radius) if radius > 0.0 else math.inf
        self._number = max(min(math.ceil(wanted) if wanted < most else most, most), 1)
        self._low, self._width = low, float(width)
        self._stride = 2.0 * self._width + 1.0
        self._height = max(float(height) / self._number, 1e-9 * self._stride)
        x, y = (positions - low).T
        strip = np.minimum((y / self._height).astype(np.int64), self._number - 1)
        keys = strip * self._stride + x
        self._order = np.argsort(keys, kind="stable")
        self._keys = keys[self._order]
        self._positions = positions[self._order]
        # Beyond rounding errors of the keys.
        self._margin = 1e-9 * (self._stride + float(np.abs(positions).max()))

    def pairs(self, centres: FloatArray, radius: FloatArray) -> Iterator[tuple[IntArray, IntArray]]:
        """Parts of the pairs of these centres; no centre is in two parts."""
        x, y = (centres - self._low).T
        reach = radius + self._margin
        lowest = np.clip((y - reach) / self._height, 0, self._number - 1).astype(np.int64)
        highest = np.clip((y + reach) / self._height, 0, self._number - 1).astype(np.int64)
        strips = highest - lowest + 1
        owner = np.repeat(np.arange(len(centres)), strips)
        strip = _counted(lowest, strips)
        edge = strip * self._height
        away = np.maximum(np.maximum(edge - y[owner], y[owner] - edge - self._height), 0.0)
        half = np.sqrt(np.maximum(reach[owner] ** 2 - away**2, 0.0)) + self._margin
        base = strip * self._stride
        left = base + np.clip(x[owner] - half, -1.0, self._stride - 1.0)
        right = base + np.clip(x[owner] + half, -0.5, self._width + 0.5)
        begin = np.searchsorted(self._keys, left, side="left")
        number = np.maximum(np.searchsorted(self._keys, right, side="right") - begin, 0)
        ends = np.cumsum(np.bincount(owner, number, minlength=len(centres)))
        first = 0
        while first < len(centres):
            before = ends[first - 1] if first else 0.0
            last = int(np.searchsorted(ends, before + CANDIDATES_TOGETHER, side="right"))
            last = max(last, first + 1)
            rows = slice(*np.searchsorted(owner, [first, last]))
            yield self._inside(centres, radius, owner[rows], begin[rows], number[rows])
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
        centre, row = np.repeat(owner, number), _counted(begin, number)
        apart = centres[centre] - self._positions[row]
        inside = np.flatnonzero((apart * apart).sum(axis=1) <= (radius * radius)[centre])
        return centre[inside], self._order[row[inside]]


def _counted(first: IntArray, number: IntArray) -> IntArray:
    """From each first, as many consecutive numbers as asked for, one after another."""
    ends = np.cumsum(number)
    total = int(ends[-1]) if len(ends) else 0
    return np.arange(total) + np.repeat(first - ends + number, number)
