"""Paths that matter only by their number and their gates.

A gated detection starts no potential track (TSEPM 2018, Step 8). So a path that is cut must keep
its gate, and its children theirs, until the M/N rule would have ended them; else cutting would let
others start. Paths with the same last hit, number of hits and first scan have the same gates now
and ever after, so that a number stands for all of them.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from tsepm_ros.numerics.arrays import IntArray
from tsepm_ros.stages.paths import Paths
from tsepm_ros.stages.splitting import Gated

MAX_COUNT = 2**40
"""Numbers stop here: sums over the detections of a scan still fit 64 bits."""
BLOCK = 32
"""Kinds of paths split together: bounds memory."""


@dataclass(frozen=True)
class PathCounts:
    """Numbers of paths, a row for each last hit, number of hits and first scan.

    Attributes
    ----------
    last_hit : (n,) ndarray of int
        Detection id.
    hit_count : (n,) ndarray of int
        N_v.
    first_scan : (n,) ndarray of int
        Scan index of the first hit.
    number : (n,) ndarray of int
        Paths of this kind, at least 1.
    """

    last_hit: IntArray
    hit_count: IntArray
    first_scan: IntArray
    number: IntArray

    def __len__(self) -> int:
        """Number of rows."""
        return len(self.number)

    def __getitem__(self, rows: NDArray[np.generic]) -> PathCounts:
        """The given rows (indices or a mask)."""
        return PathCounts(
            self.last_hit[rows], self.hit_count[rows], self.first_scan[rows], self.number[rows]
        )

    @property
    def total(self) -> int:
        """Number of paths, exact up to 2^53."""
        return int(self.number.sum(dtype=np.float64))

    @staticmethod
    @cache
    def none() -> PathCounts:
        """No paths."""
        return PathCounts(*np.zeros((4, 0), np.int64))

    @classmethod
    def of(
        cls,
        last_hit: IntArray,
        hit_count: IntArray,
        first_scan: IntArray,
        number: IntArray | None = None,
    ) -> PathCounts:
        """Count paths given one by one, or in rows that may repeat; rows of 0 are left out."""
        if len(last_hit) == 0:
            return cls.none()
        columns = (last_hit, hit_count, first_scan)
        sizes = [int(np.ptp(column)) + 1 for column in columns]
        key = np.ravel_multi_index([column - column.min() for column in columns], sizes)
        _, first, place = np.unique(key, return_index=True, return_inverse=True)
        counts = np.zeros(len(first), np.int64)
        np.add.at(counts, place, 1 if number is None else number)
        counts = np.minimum(counts, MAX_COUNT)
        return cls(last_hit[first], hit_count[first], first_scan[first], counts)[counts > 0]

    @classmethod
    def of_paths(cls, paths: Paths) -> PathCounts:
        """Count paths, for when only their numbers and gates matter."""
        return cls.of(paths.last_hit, paths.hit_count, paths.first_scan)

    @classmethod
    def joined(cls, *parts: PathCounts) -> PathCounts:
        """The paths of all parts."""
        parts = tuple(part for part in parts if len(part))
        if not parts:
            return cls.none()
        return cls.of(
            np.concatenate([part.last_hit for part in parts]),
            np.concatenate([part.hit_count for part in parts]),
            np.concatenate([part.first_scan for part in parts]),
            np.concatenate([part.number for part in parts]),
        )

    def without(self, others: PathCounts) -> PathCounts:
        """These paths less others, which are among them."""
        negative = PathCounts(others.last_hit, others.hit_count, others.first_scan, -others.number)
        return PathCounts.joined(self, negative)

    def children(self, gate_of_row: IntArray, gated: Gated, ids: IntArray) -> PathCounts:
        """Paths that extend these by each of their gated detections.

        Per kind, the numbers over the last hits times the 0/1 matrix of gates and detections.

        Parameters
        ----------
        gate_of_row : (n,) ndarray of int
            The gate (row of `gated`) of each row.
        gated : Gated
            Detections in each gate.
        ids : (d,) ndarray of int
            Ids of the scan's detections.

        Returns
        -------
        PathCounts
        """
        if len(self) == 0:
            return self
        inside = csr_matrix(
            (np.ones(len(gated.detection), np.int64), gated.detection, gated.start),
            shape=(len(gated.start) - 1, len(ids)),
        ).T
        kinds, kind_of_row = np.unique(
            np.stack([self.hit_count, self.first_scan]), axis=1, return_inverse=True
        )
        kind_of_row = kind_of_row.reshape(-1)
        parts = []
        for first in range(0, kinds.shape[1], BLOCK):
            rows = np.flatnonzero((kind_of_row >= first) & (kind_of_row < first + BLOCK))
            numbers = np.zeros((inside.shape[1], BLOCK), np.int64)
            numbers[gate_of_row[rows], kind_of_row[rows] - first] = self.number[rows]
            sums = inside @ numbers
            detection, kind = np.nonzero(sums)
            hit_count, first_scan = kinds[:, kind + first]
            parts.append(
                PathCounts.of(ids[detection], hit_count + 1, first_scan, sums[detection, kind])
            )
        return PathCounts.joined(*parts)
