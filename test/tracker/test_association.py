"""Choosing rows that share nothing, the best first."""

from __future__ import annotations

import numpy as np
import pytest

from tsepm_ros.tracker import assignment
from tsepm_ros.tracker.assignment import (
    BLOCK,
    Pairs,
    best_of_each,
    disjoint,
    nearest_first,
    oldest_first,
    within,
)
from tsepm_ros.tracker.initial_state import NO_HIT


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
    assert disjoint(members, cost).tolist() == plain_disjoint(members, cost)


PAIRS = Pairs(np.array([0, 0, 1, 1, 2]), np.array([0, 1, 0, 1, 1]), np.array([3.0, 5, 1, 1, 2]))


def test_each_track_and_each_detection_is_matched_once():
    chosen = nearest_first(PAIRS)
    assert chosen.parent.tolist() == [1, 2]
    assert chosen.row.tolist() == [0, 1], "what is left of track 0 was taken"


@pytest.mark.parametrize(
    ("first_scan", "expected"),
    [
        ([5, 5, 5], [(1, 0), (2, 1)]),  # as the nearest first
        ([4, 5, 5], [(0, 0), (1, 1)]),
        ([4, 5, 3], [(0, 0), (2, 1)]),
    ],
)
def test_older_tracks_choose_before_younger(first_scan, expected):
    chosen = oldest_first(PAIRS, np.array(first_scan))
    assert sorted(zip(chosen.parent.tolist(), chosen.row.tolist(), strict=True)) == expected
    assert set(chosen.cost) <= set(PAIRS.cost)


def test_the_best_of_each_track_may_be_another_s_too():
    chosen = best_of_each(PAIRS)
    assert chosen.parent.tolist() == [0, 1, 2]
    assert chosen.row.tolist() == [0, 0, 1]


def test_no_further_block_of_pairs_is_looked_at_where_the_time_is_over():
    rows = np.arange(2 * BLOCK + 10)

    def far(parent, row):
        return np.asarray(parent % 2, float)

    every, cut = within(rows, rows, far, 0.5, lambda: False)
    assert (len(every), cut) == (BLOCK + 5, 0)
    some, cut = within(rows, rows, far, 0.5, lambda: True)
    assert (len(some), cut) == (BLOCK // 2, BLOCK + 10)
