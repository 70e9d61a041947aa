"""Paths through the tree of splits, as arrays."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Self

import numpy as np

from tsepm_ros.numerics.arrays import IntArray
from tsepm_ros.numerics.rows import Rows, changed

NO_HIT = -1
MAX_ROWS_TOGETHER = 16_384
"""Paths processed together: bounds memory and fits into the processor's cache."""


@dataclass(frozen=True)
class Paths(Rows):
    """Sequences of detections of possible targets, at most one per scan: a row each.

    Attributes
    ----------
    hits : (n, max_hits) ndarray of int
        Detection ids of the hits, oldest first, then NO_HIT.
    hit_count : (n,) ndarray of int
        N_v.
    first_scan : (n,) ndarray of int
        Scan index of the first hit; N_a follows from it.
    """

    hits: IntArray
    hit_count: IntArray
    first_scan: IntArray

    @property
    def last_hit(self) -> IntArray:
        """Detection id of each path's last hit, (n,)."""
        return self.hits[np.arange(len(self)), self.hit_count - 1]

    def extended(self, parent: IntArray, detection: IntArray) -> Self:
        """Children with a further detection each: row i extends path `parent[i]`."""
        children = self[parent]
        children.hits[np.arange(len(parent)), children.hit_count] = detection
        return changed(children, hit_count=children.hit_count + 1)

    def of_equal_count(self) -> Iterator[tuple[IntArray, IntArray]]:
        """Iterate over blocks of paths with the same number of hits.

        Yields
        ------
        rows : (r,) ndarray of int
            Paths, at most `MAX_ROWS_TOGETHER`.
        hits : (r, m) ndarray of int
            Detection ids of their hits, without NO_HIT.
        """
        for count in np.unique(self.hit_count):
            rows = np.flatnonzero(self.hit_count == count)
            for first in range(0, len(rows), MAX_ROWS_TOGETHER):
                block = rows[first : first + MAX_ROWS_TOGETHER]
                yield block, self.hits[block, :count]


def starting(detection: IntArray, scan_index: int, max_hits: int) -> Paths:
    """New paths of a single hit, with space for `max_hits` hits (Step 8)."""
    hits = np.full((len(detection), max_hits), NO_HIT, np.int64)
    hits[:, 0] = detection
    count = np.ones(len(detection), np.int64)
    return Paths(hits, count, np.full(len(detection), scan_index, np.int64))
