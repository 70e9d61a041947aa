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
"""Association of a scan's detections with confirmed tracks: one global assignment.

A target exists with a probability r, which falls with every miss and rises with every detection
that fits (integrated probabilistic data association: Musicki, Evans, Stankovic, "Integrated
probabilistic data association", IEEE Trans. Autom. Control 39(6), 1994). Each detection is one
target's at most. Symbols, of track i and detection j::

    r_i         probability that the target exists
    L_ij        likelihood ratio of the detection: P_D N(z_j; H x_i, S_i) / lambda_j
    b_i         1 - P_D P_G: probability that the gate of an existing target stays empty
    Lambda_i    likelihood ratio of the scan, target against none

Detections are assigned so that the product of the ratios is largest (Blackman, "Multiple hypothesis
tracking for multiple target tracking", IEEE Aerosp. Electron. Syst. Mag. 19(1), 2004)::

    (1 - r_i + r_i L_ij) / (1 - r_i + r_i b_i)        of each assigned pair, above 1

For starts beside the tracks the detections keep their alternatives. The scan is less likely by the
factor f_ij if detection j is not there for target i, and j is a confirmed track's with the
probability p_j (linear multi-target: Musicki, La Scala, "Multi-target tracking in clutter without
measurement assignment", IEEE Trans. Aerosp. Electron. Syst. 44(3), 2008)::

    f_ij = (1 - r_i + r_i Lambda_i) / (1 - r_i + r_i (Lambda_i - L_ij))
    p_j  = 1 - 1 / prod_i f_ij

with L_ij / prod_k!=i f_kj, the f_kj of targets alone, for L_ij in all but the numerator of f_ij of
j itself: for each target, the detections of the others are clutter.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import min_weight_full_bipartite_matching

from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray, run_starts

MAX_LOG_FACTOR = 20.0
"""Logarithm of the largest factor by which detections are explained: p_j stays below 1."""


class Pairs(NamedTuple):
    """Tracks and detections in their gates, ascending, (p,) each.

    Attributes
    ----------
    track, row : (p,) ndarray of int
    ratio : (p,) ndarray
        L_ij.
    """

    track: IntArray
    row: IntArray
    ratio: FloatArray

    @classmethod
    def summed(cls, track: IntArray, row: IntArray, ratio: FloatArray, number: int) -> Pairs:
        """Each pair of a track and one of a number of detections once, with its summed ratios."""
        key = track * number + row
        order = key.argsort(kind="stable")
        first = run_starts(key[order])
        total = np.add.reduceat(ratio[order], first)
        return cls(*np.divmod(key[order[first]], max(number, 1)), total)


OwnDetections = tuple[IntArray, IntArray]
"""Detections of a scan that are confirmed tracks', with more than some probability: id of the
track, and detection, (k,) each."""


def confirmed_probability(
    existence: FloatArray, empty: FloatArray, pairs: Pairs, number: int
) -> FloatArray:
    """Probability p_j that each of a number of detections is a confirmed track's, (d,), below 1.

    Parameters
    ----------
    existence, empty : (n,) ndarray
        r_i and b_i.
    pairs : Pairs
    number : int
        d.
    """
    track, row, ratio = pairs
    r, b = existence[track], empty[track]

    def log_factor(competing: FloatArray) -> FloatArray:
        """``ln(1 + r_i L_ij / (1 - r_i + r_i (b_i + sum_k!=j L_ik)))``."""
        total = np.bincount(track, competing, minlength=len(existence))[track]
        others = np.maximum(total - competing, 0.0)  # the difference of the sums is rounded
        return np.log1p(r * ratio / (1.0 - r + r * (b + others)))

    alone = log_factor(ratio)
    explained = np.bincount(row, alone, minlength=number)[row] - alone
    factor = log_factor(ratio * np.exp(-np.minimum(explained, MAX_LOG_FACTOR)))
    total = np.bincount(row, factor, minlength=number)
    return np.asarray(-np.expm1(-np.minimum(total, MAX_LOG_FACTOR)))


def assigned(existence: FloatArray, empty: FloatArray, pairs: Pairs, number: int) -> IntArray:
    """Track to which each of a number of detections is assigned, (d,); -1 for none.

    Parameters
    ----------
    existence, empty : (n,) ndarray
        r_i and b_i.
    pairs : Pairs
    number : int
        d.
    """
    r, b = existence[pairs.track], empty[pairs.track]
    gain = np.log((1.0 - r + r * pairs.ratio) / (1.0 - r + r * b))
    better = (gain > 0.0).nonzero()[0]
    track, row, gain = pairs.track[better], pairs.row[better], gain[better]
    # Where the best detections of all tracks differ, they are the assignment.
    order = np.lexsort((-gain, track))
    best = order[run_starts(track[order])]
    owner = np.full(number, -1)
    owner[row[best]] = track[best]
    if np.count_nonzero(owner >= 0) < len(best):
        chosen = least_cost(track, row, -gain - 1.0, -1.0)
        owner[:] = -1
        owner[row[chosen]] = track[chosen]
    return owner


def least_cost(track: IntArray, row: IntArray, cost: FloatArray, alone: float) -> BoolArray:
    """Which pairs (p,) assign each track and each row at most once, with the least sum of costs.

    Parameters
    ----------
    track, row : (p,) ndarray of int
    cost : (p,) ndarray
        Of each pair; none may be 0.
    alone : float
        Of a track that is assigned nothing.
    """
    if not len(track):
        return np.zeros(0, bool)
    tracks, own = np.unique(track, return_inverse=True)
    rows, column = np.unique(row, return_inverse=True)
    every = np.arange(len(tracks))
    # A column of its own for each track: it is assigned nothing.
    places = np.append(own, every), np.append(column, len(rows) + every)
    matrix = csr_matrix((np.append(cost, np.full(len(tracks), alone)), places))
    return np.asarray(min_weight_full_bipartite_matching(matrix)[1][own] == column)
