"""Paths through the tree of splits, as arrays."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from tsepm_ros.numerics.arrays import IntArray
from tsepm_ros.numerics.rows import Rows

NO_HIT = -1


@dataclass(frozen=True)
class Paths(Rows):
    """Detections that may be one target's, one a scan at most: a row each.

    Attributes
    ----------
    hits : (n, most) ndarray of int
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
        """Children that add a detection each: row i extends path `parent[i]`."""
        children = self[parent]
        children.hits[np.arange(len(parent)), children.hit_count] = detection
        return replace(children, hit_count=children.hit_count + 1)


def starting(detection: IntArray, scan_index: int, most: int) -> Paths:
    """New paths of one hit each, for at most so many hits (Step 8)."""
    hits = np.full((len(detection), most), NO_HIT, np.int64)
    hits[:, 0] = detection
    count = np.ones(len(detection), np.int64)
    return Paths(hits, count, np.full(len(detection), scan_index, np.int64))
