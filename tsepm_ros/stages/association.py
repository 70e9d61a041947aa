"""Pairs of potential tracks and detections, and the choice of those that are used.

`disjoint`, `nearest_first` and `oldest_first` use each track and each detection once;
`best_of_each` each track once, and a detection for several; `within` chooses nothing yet.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tsepm_ros.numerics.arrays import FloatArray, IntArray
from tsepm_ros.numerics.rows import Rows
from tsepm_ros.stages.paths import NO_HIT

BLOCK = 50_000
"""Rows looked at together."""


@dataclass(frozen=True)
class Pairs(Rows):
    """Potential tracks and the detections that may extend them: a row each.

    Attributes
    ----------
    parent : (p,) ndarray of int
        Row of the potential track.
    row : (p,) ndarray of int
        Row of the detection.
    cost : (p,) ndarray
        Smaller is better.
    """

    parent: IntArray
    row: IntArray
    cost: FloatArray

    @classmethod
    def none(cls) -> Pairs:
        """No pairs."""
        return cls(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0))


def within(
    parent: IntArray,
    row: IntArray,
    distance: Callable[[IntArray, IntArray], FloatArray],
    threshold: float,
) -> Pairs:
    """The pairs (parent, row), (p,), whose distance is a threshold at most, with it as the cost.

    The distance is asked for in blocks, which bounds memory.
    """
    parts = [Pairs.none()]
    for first in range(0, len(parent), BLOCK):
        some = slice(first, first + BLOCK)
        block = Pairs(parent[some], row[some], distance(parent[some], row[some]))
        parts.append(block[block.cost <= threshold])
    return Pairs.joined(*parts)


def disjoint(members: IntArray, cost: FloatArray) -> IntArray:
    """Choose rows that have no member in common, always the best that is left.

    Parameters
    ----------
    members : (n, m) ndarray of int
        What each row uses; NO_HIT is nothing.
    cost : (n,) ndarray
        Smaller is better; of equal rows the first is.

    Returns
    -------
    (k,) ndarray of int
        The rows chosen, ascending.
    """
    names, member = np.unique(members, return_inverse=True)
    member = member.reshape(members.shape)
    nothing = int(np.searchsorted(names, NO_HIT)) if NO_HIT in names else -1
    taken = np.zeros(len(names) + 1, bool)
    chosen: list[int] = []
    order = np.argsort(cost, kind="stable")
    for first in range(0, len(order), BLOCK):
        rows = order[first : first + BLOCK]
        rows = rows[~taken[member[rows]].any(axis=1)]
        used: set[int] = set()
        for row, mine in zip(rows.tolist(), member[rows].tolist(), strict=True):
            if used.isdisjoint(mine):
                chosen.append(row)
                used.update(mine)
                used.discard(nothing)
        taken[list(used)] = True
    return np.sort(np.array(chosen, np.int64))


def nearest_first(pairs: Pairs) -> Pairs:
    """The pairs of which each track and each detection has one at most, best first."""
    return _exclusive(pairs, pairs.cost)


def oldest_first(pairs: Pairs, first_scan: IntArray) -> Pairs:
    """As `nearest_first`, but the tracks choose in turn, those begun earliest first.

    Of tracks begun in the same scan the better pair goes first.

    Parameters
    ----------
    pairs : Pairs
    first_scan : (t,) ndarray of int
        Of each track that `pairs.parent` counts.
    """
    turn = np.empty(len(pairs))
    turn[np.lexsort((pairs.cost, first_scan[pairs.parent]))] = np.arange(len(pairs))
    return _exclusive(pairs, turn)


def _exclusive(pairs: Pairs, turn: FloatArray) -> Pairs:
    """Each track and each detection once at most, the pair of the smallest turn first."""
    members = np.stack([pairs.parent, -2 - pairs.row], axis=1)  # apart, and never NO_HIT
    return pairs[disjoint(members, turn)]


def best_of_each(pairs: Pairs) -> Pairs:
    """The best pair of each track; a detection may be used by several."""
    order = np.lexsort((pairs.row, pairs.cost, pairs.parent))
    first = np.flatnonzero(np.diff(pairs.parent[order], prepend=-1))
    return pairs[order[first]]
