"""Choosing rows that share nothing, the best first."""

import numpy as np
import pytest

from tsepm_ros.tracker import assignment
from tsepm_ros.tracker.assignment import BLOCK, disjoint, within
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


def test_no_further_block_of_pairs_is_looked_at_where_the_time_is_over():
    rows = np.arange(2 * BLOCK + 10)

    def far(parent, row):
        return np.asarray(parent % 2, float)

    every, cut = within(rows, rows, far, 0.5, lambda: False)
    assert (len(every), cut) == (BLOCK + 5, 0)
    some, cut = within(rows, rows, far, 0.5, lambda: True)
    assert (len(some), cut) == (BLOCK // 2, BLOCK + 10)
