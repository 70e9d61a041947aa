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
"""Pairs of tracks and detections: gated in blocks, and assigned once or to several."""

import itertools

import numpy as np
import pytest

from tsepm_ros.studies import assignment
from tsepm_ros.studies.assignment import (
    AssignmentPairs,
    assignment_within,
    best_assignment_of_each,
    disjoint_assignment,
    global_assignment,
    nearest_first_assignment,
    oldest_first_assignment,
)
from tsepm_ros.tracker.initial_state import NO_HIT


def pairs(*rows: tuple[int, int, float]) -> AssignmentPairs:
    parent, row, cost = (np.array(column) for column in zip(*rows, strict=True))
    return AssignmentPairs(parent, row, cost.astype(float))


def listed(found: AssignmentPairs) -> list[tuple[int, int]]:
    return list(zip(found.parent.tolist(), found.row.tolist(), strict=True))


@pytest.mark.parametrize("block", [2, 50_000])
def test_pairs_within_the_threshold_are_kept_with_their_distance(block, monkeypatch):
    monkeypatch.setattr(assignment, "BLOCK", block)
    parent, row = np.array([0, 0, 1, 2, 2]), np.array([0, 1, 1, 0, 1])
    found = assignment_within(parent, row, lambda p, r: 1.0 * np.abs(p - r), 1.0)
    assert listed(found) == [(0, 0), (0, 1), (1, 1), (2, 1)]
    assert found.cost.tolist() == [0.0, 1.0, 0.0, 1.0]


@pytest.mark.parametrize("block", [3, 50_000])
def test_chosen_rows_are_those_of_a_plain_greedy_choice(block, monkeypatch):
    monkeypatch.setattr(assignment, "BLOCK", block)
    rng = np.random.default_rng(5)
    for _ in range(30):
        members = rng.integers(0, 12, (20, 3))
        members[rng.random((20, 3)) < 0.3] = NO_HIT
        cost = rng.integers(0, 6, 20).astype(float)
        expected, used = [], set()
        for row in np.argsort(cost, kind="stable"):
            own = set(members[row].tolist()) - {NO_HIT}
            if not own & used:
                expected.append(row)
                used |= own
        assert disjoint_assignment(members, cost).tolist() == sorted(expected)


def test_the_nearest_pair_goes_first_and_each_is_assigned_once():
    given = pairs((0, 0, 2.0), (0, 1, 1.0), (1, 1, 0.5), (1, 2, 3.0))
    assert listed(nearest_first_assignment(given)) == [(0, 0), (1, 1)]
    for one, other in itertools.combinations(listed(nearest_first_assignment(given)), 2):
        assert one[0] != other[0] and one[1] != other[1]


def test_the_oldest_track_goes_first_and_of_equal_age_the_nearest():
    given = pairs((0, 0, 9.0), (1, 0, 1.0), (2, 0, 5.0), (1, 1, 2.0), (2, 1, 1.0))
    assert listed(oldest_first_assignment(given, np.array([0, 4, 4]))) == [(0, 0), (2, 1)]
    assert listed(oldest_first_assignment(given, np.array([4, 4, 0]))) == [(2, 1), (1, 0)][::-1]


def test_the_best_pair_of_each_track_may_share_a_detection():
    given = pairs((0, 0, 2.0), (0, 1, 1.0), (1, 1, 0.5), (1, 2, 0.5))
    assert listed(best_assignment_of_each(given)) == [(0, 1), (1, 1)]


def plain_disjoint(members, cost):
    taken, chosen = set(), []
    for row in sorted(range(len(cost)), key=lambda one: (cost[one], one)):
        mine = set(members[row].tolist()) - {NO_HIT}
        if not mine & taken:
            taken |= mine
            chosen.append(row)
    return sorted(chosen)


@pytest.mark.parametrize("block", [1, 7, 50_000])
@pytest.mark.parametrize("seed", range(5))
def test_disjoint_rows_are_those_of_a_plain_loop(seed, block, monkeypatch):
    monkeypatch.setattr(assignment, "BLOCK", block)
    rng = np.random.default_rng(seed)
    members = rng.integers(-1, 40, (100, 3))
    cost = rng.integers(0, 10, 100).astype(float)
    assert disjoint_assignment(members, cost).tolist() == plain_disjoint(members, cost)


def test_the_global_assignment_has_the_least_sum_of_all_assignments():
    rng = np.random.default_rng(8)
    for _ in range(30):
        near = np.argwhere(rng.random((4, 4)) < 0.6)
        cost = rng.uniform(0.0, 9.0, len(near))
        given = AssignmentPairs(near[:, 0], near[:, 1], cost)
        found = global_assignment(given, 9.0)
        for side in (found.parent, found.row):
            assert len(set(side.tolist())) == len(side)
        least = min(
            cost[list(chosen)].sum() - 9.0 * len(chosen)
            for size in range(5)
            for chosen in itertools.combinations(range(len(near)), size)
            if all(len(set(near[list(chosen), side].tolist())) == size for side in (0, 1))
        )
        assert found.cost.sum() - 9.0 * len(found) == pytest.approx(least)
    assert len(global_assignment(AssignmentPairs.none(), 9.0)) == 0
