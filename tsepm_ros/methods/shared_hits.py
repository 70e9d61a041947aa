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
"""Tracks of one scan that share hits, as groups: those of one target (TSEPM 2018, Section 3.6).

Tracks confirmed in one scan are one target's where they share more than half of their hits and
their states are close (Eqs. 27-33, Step 7).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray
from tsepm_ros.numerics.gaussian import gate_factor
from tsepm_ros.tracker.merging import close

FEW_TRACKS = 16
"""Tracks up to which all pairs are compared: that takes less time than the search."""
PAIR_BLOCK = 200_000
"""Pairs processed together: bounds the memory of the search, not its result."""
MAX_SUBSETS = 70
"""Largest number of subsets of a track's hits in the search for overlapping tracks."""


def groups(
    hits: IntArray,
    states: FloatArray,
    covariances: FloatArray,
    probability: float,
) -> IntArray:
    """Group the tracks of one scan that meet the merging conditions.

    Two tracks merge where more than half of their hits are shared (condition b) and their states
    are close (condition c, Eq. 30; the distance has four degrees of freedom, Eq. 5 is the quantile
    for two: that for four at P is reached with ``1 - exp(-chi2(4).ppf(P) / 2)``, 0.980 for P =
    0.9). Groups are the connected components of these pairs.

    Two tracks that share more than half of their hits share a subset of that size: only tracks with
    a common subset are candidates. Pairs already connected by other pairs are skipped.

    Parameters
    ----------
    hits : (n, m) ndarray of int
        Detection ids of each track's hits, ascending in each row.
    states : (n, 4) ndarray
        States at the same time.
    covariances : (n, 4, 4) ndarray
        Their covariances.
    probability : float
        P_TM.

    Returns
    -------
    (n,) ndarray of int
        Label of each track's group.
    """
    n = len(hits)
    labels = np.arange(n)
    if n < 2:
        return labels
    threshold = gate_factor(probability) ** 2  # gamma_TM^2 of Eq. 30, by Eq. 5 as published

    def connect(first: IntArray, second: IntArray) -> IntArray:
        unconnected = labels[first] != labels[second]
        first, second = first[unconnected], second[unconnected]
        overlapping = overlap(hits, first, second)
        first, second = first[overlapping], second[overlapping]
        near = close(states, covariances, first, second, threshold)
        number = int(labels.max()) + 1
        edges = np.ones(np.count_nonzero(near), bool), (labels[first[near]], labels[second[near]])
        _, merged = connected_components(coo_matrix(edges, shape=(number, number)), directed=False)
        return merged[labels].astype(np.int64)

    if n <= FEW_TRACKS:
        return connect(*np.triu_indices(n, 1))
    sharing = tracks_by_shared_hits(hits)
    for first, second in sharing.consecutive_pairs(PAIR_BLOCK):
        labels = connect(first, second)
    for first, second in sharing.pairs(labels, PAIR_BLOCK):
        labels = connect(first, second)
    return labels


@dataclass(frozen=True)
class Sharing:
    """Tracks with a common subset of hits, as compressed rows.

    Attributes
    ----------
    start : (g + 1,) ndarray of int
        Subset i belongs to the tracks ``track[start[i]:start[i + 1]]``.
    track : (p,) ndarray of int
        Rows of the tracks, ascending within a subset.
    """

    start: IntArray
    track: IntArray

    def consecutive_pairs(self, block: int) -> Iterator[tuple[IntArray, IntArray]]:
        """Pairs of consecutive tracks in a subset, `block` at a time.

        They connect most tracks at the least cost.
        """
        same = np.ones(max(len(self.track) - 1, 0), bool)
        same[self.start[1:-1] - 1] = False
        rows = np.flatnonzero(same)
        for begin in range(0, len(rows), block):
            row = rows[begin : begin + block]
            yield self.track[row], self.track[row + 1]

    def pairs(self, labels: IntArray, block: int) -> Iterator[tuple[IntArray, IntArray]]:
        """All pairs of tracks that share a subset, about `block` at a time.

        Subsets are left out whose tracks have one label. A pair occurs once for every common
        subset.
        """
        label, begin, counts = labels[self.track], self.start[:-1], np.diff(self.start)
        mixed = np.minimum.reduceat(label, begin) != np.maximum.reduceat(label, begin)
        track, counts = self.track[np.repeat(mixed, counts)], counts[mixed]
        # Entry p is paired with the later entries of its subset.
        later = np.repeat(np.cumsum(counts), counts) - np.arange(len(track)) - 1
        work = np.cumsum(later)
        total = int(work[-1]) if len(work) else 0
        borders = np.unique(np.searchsorted(work, np.arange(0, total, block), side="right"))
        for begin, end in itertools.pairwise([*borders, len(later)]):
            entry = np.repeat(np.arange(begin, end), later[begin:end])
            first_pair = np.cumsum(later[begin:end]) - later[begin:end]
            offset = np.arange(len(entry)) - first_pair[entry - begin]
            yield track[entry], track[entry + 1 + offset]


def tracks_by_shared_hits(hits: IntArray) -> Sharing:
    """Find the tracks with common subsets of hits.

    Parameters
    ----------
    hits : (n, m) ndarray of int
        Detection ids, ascending in each row.

    Returns
    -------
    Sharing
        Subsets of the smallest size above m/2, so that every overlapping pair shares a subset; of
        fewer hits if a track would have more than `MAX_SUBSETS` subsets. Subsets of a single track
        are left out.
    """
    n, m = hits.shape
    size = m // 2 + 1
    while math.comb(m, size) > MAX_SUBSETS:
        size -= 1
    # The sum of a random number per hit identifies a subset. Two subsets with the same sum would
    # add a candidate, not change the result.
    ids, column = np.unique(hits, return_inverse=True)
    number = np.random.default_rng(0).integers(2**63, size=len(ids))[column.reshape(n, m)]
    key = np.concatenate(
        [number[:, subset].sum(axis=1) for subset in itertools.combinations(range(m), size)]
    )
    order = np.argsort(key, kind="stable")
    key = key[order]
    border = np.flatnonzero(np.diff(key, prepend=key[0] - 1, append=key[-1] + 1))
    counts = np.diff(border)
    shared = counts > 1
    start = np.zeros(np.count_nonzero(shared) + 1, np.int64)
    np.cumsum(counts[shared], out=start[1:])
    return Sharing(start, (order % n)[np.repeat(shared, counts)])


def overlap(hits: IntArray, first: IntArray, second: IntArray) -> BoolArray:
    """Test whether the tracks of each pair share more than half of their hits (condition b)."""
    same = hits[first][:, :, None] == hits[second][:, None, :]
    return 2 * np.count_nonzero(same, axis=(1, 2)) > hits.shape[1]


def moments(
    states: FloatArray, covariances: FloatArray, distances: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Merge one group by its weighted moments.

    ``p_i = f_1(i) / sum f_1`` (Eq. 31), ``X = sum p_i X_i`` (Eq. 32), ``P = sum p_i P_i`` (Eq. 33).
    As published, the worse fit has the larger weight, and the spread of the means is left out.

    Parameters
    ----------
    states : (g, 4) ndarray
    covariances : (g, 4, 4) ndarray
    distances : (g,) ndarray
        f_1 of each track. Where all are 0 (two hits fit any line) the weights are equal.

    Returns
    -------
    state : (4,) ndarray
    covariance : (4, 4) ndarray
    """
    total = distances.sum()
    weights = distances / total if total > 0 else np.full(len(distances), 1.0 / len(distances))
    return weights @ states, np.tensordot(weights, covariances, axes=1)
