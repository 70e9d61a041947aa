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
"""Association: pairs of potential tracks and detections, and their assignment.

`assignment_within` gates pairs. `disjoint_assignment`, `nearest_first_assignment`,
`oldest_first_assignment` and `global_assignment` assign each track and each detection once;
`best_assignment_of_each` assigns each track once, and a detection to several tracks.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tsepm_ros.numerics.arrays import FloatArray, IntArray, Rows
from tsepm_ros.tracker.initial_state import NO_HIT
from tsepm_ros.tracker.maintenance.data_association import least_cost

BLOCK = 50_000
"""Rows processed together: bounds memory."""


@dataclass(frozen=True)
class AssignmentPairs(Rows):
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
    def none(cls) -> AssignmentPairs:
        """No pairs."""
        return cls(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0))


def assignment_within(
    parent: IntArray,
    row: IntArray,
    distance: Callable[[IntArray, IntArray], FloatArray],
    threshold: float,
) -> AssignmentPairs:
    """The pairs (parent, row), (p,), with a distance of at most `threshold`, which is their cost.

    Distances are computed in blocks, which bounds memory.
    """
    parts = [AssignmentPairs.none()]
    for first in range(0, len(parent), BLOCK):
        block = slice(first, first + BLOCK)
        pairs = AssignmentPairs(parent[block], row[block], distance(parent[block], row[block]))
        parts.append(pairs[pairs.cost <= threshold])
    return AssignmentPairs.joined(*parts)


def disjoint_assignment(members: IntArray, cost: FloatArray) -> IntArray:
    """Choose rows without common members, greedily by cost.

    Parameters
    ----------
    members : (n, m) ndarray of int
        Members of each row; NO_HIT is no member.
    cost : (n,) ndarray
        Smaller is better; of equal costs, the first row.

    Returns
    -------
    (k,) ndarray of int
        The rows chosen, ascending.
    """
    ids, member = np.unique(members, return_inverse=True)
    member = member.reshape(members.shape)
    no_member = int(np.searchsorted(ids, NO_HIT)) if NO_HIT in ids else -1
    taken = np.zeros(len(ids) + 1, bool)
    chosen: list[int] = []
    order = np.argsort(cost, kind="stable")
    for first in range(0, len(order), BLOCK):
        rows = order[first : first + BLOCK]
        rows = rows[~taken[member[rows]].any(axis=1)]
        used: set[int] = set()
        for row, row_members in zip(rows.tolist(), member[rows].tolist(), strict=True):
            if used.isdisjoint(row_members):
                chosen.append(row)
                used.update(row_members)
                used.discard(no_member)
        taken[list(used)] = True
    return np.sort(np.array(chosen, np.int64))


def nearest_first_assignment(pairs: AssignmentPairs) -> AssignmentPairs:
    """Assign each track and each detection at most once, the pair of least cost first."""
    return pairs[exclusive_assignment(pairs, pairs.cost)]


def global_assignment(pairs: AssignmentPairs, alone: float) -> AssignmentPairs:
    """Assign each track and each detection at most once, with the least sum of all costs.

    A track that is assigned nothing costs `alone`, the most that a pair costs.
    """
    chosen = least_cost(pairs.parent, pairs.row, pairs.cost + 1.0, alone + 1.0)  # none is 0
    return pairs[chosen]


def oldest_first_assignment(pairs: AssignmentPairs, first_scan: IntArray) -> AssignmentPairs:
    """Assign each track and each detection at most once, the oldest track first.

    Of tracks begun in the same scan the pair of least cost goes first.

    Parameters
    ----------
    pairs : AssignmentPairs
    first_scan : (t,) ndarray of int
        First scan of each track, by `pairs.parent`.
    """
    rank = np.empty(len(pairs))
    rank[np.lexsort((pairs.cost, first_scan[pairs.parent]))] = np.arange(len(pairs))
    return pairs[exclusive_assignment(pairs, rank)]


def exclusive_assignment(pairs: AssignmentPairs, rank: FloatArray) -> IntArray:
    """Rows (k,) with each track and each detection at most once, those of the smallest ranks."""
    members = np.stack([pairs.parent, -2 - pairs.row], axis=1)  # distinct, and never NO_HIT
    return disjoint_assignment(members, rank)


def best_assignment_of_each(pairs: AssignmentPairs) -> AssignmentPairs:
    """The pair of least cost of each track; several tracks may use a detection."""
    order = np.lexsort((pairs.row, pairs.cost, pairs.parent))
    first = np.flatnonzero(np.diff(pairs.parent[order], prepend=-1))
    return pairs[order[first]]
