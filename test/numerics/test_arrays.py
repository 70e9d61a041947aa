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
"""Tables of rows: parts, joined tables, and tables with other columns."""

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.special import logsumexp

from tsepm_ros.numerics.arrays import (
    Rows,
    among_best,
    appended,
    complete_linkage,
    largest_of_groups,
    log_sums,
    replaced,
    rows_of,
    rows_of_groups,
    rows_of_least_cost,
    sums_over_hits,
    with_rows,
)


@dataclass(frozen=True)
class Echoes(Rows):
    range: np.ndarray
    azimuth: np.ndarray


@dataclass(frozen=True)
class Pings(Rows):
    echoes: Echoes


@pytest.fixture
def echoes() -> Echoes:
    return Echoes(np.array([1.0, 2.0, 3.0]), np.array([0.1, 0.2, 0.3]))


def test_rows_are_taken_and_joined_column_by_column(echoes):
    part = echoes[np.array([2, 0])]
    assert (part.range.tolist(), part.azimuth.tolist()) == ([3.0, 1.0], [0.3, 0.1])
    joined = Echoes.joined(part, echoes[echoes.range > 1.5])
    assert (len(joined), joined.range.tolist()) == (4, [3.0, 1.0, 2.0, 3.0])
    assert Echoes.joined(echoes) is echoes


def test_a_column_that_a_table_has_not_is_refused_by_its_name(echoes):
    with pytest.raises(TypeError, match=r"Echoes has no \{'bearing'\}"):
        replaced(echoes, range=echoes.range, bearing=echoes.azimuth)


def test_rows_chosen_of_several_tables_follow_each_other(echoes):
    none = np.zeros(0, np.int64)
    made = Echoes.chosen((echoes, np.array([2, 0])), (echoes[none], none), (echoes, np.array([1])))
    assert type(made) is Echoes
    assert (made.range.tolist(), made.azimuth.tolist()) == ([3.0, 1.0, 2.0], [0.3, 0.1, 0.2])


@pytest.mark.parametrize("limit", [1, 3, 50, 199, 200, 1000])
@pytest.mark.parametrize("values", [3, 10_000], ids=["many ties", "few ties"])
def test_keep_best_keeps_the_smallest_and_of_ties_the_first(limit, values):
    cost = np.random.default_rng(limit).integers(0, values, 200).astype(float)
    expected = np.sort(np.argsort(cost, kind="stable")[:limit])
    assert rows_of_least_cost(cost, limit).tolist() == expected.tolist()


def test_sums_are_of_the_ratios_not_of_their_logarithms():
    rng = np.random.default_rng(1)
    score = rng.uniform(-800.0, 800.0, 300)  # beyond what exp can hold
    group = rng.integers(0, 20, 300)
    group[group == 7] = 8
    expected = [logsumexp(score[group == k]) if (group == k).any() else -np.inf for k in range(20)]
    np.testing.assert_allclose(log_sums(score, group, 20), expected)


def test_the_best_of_each_group_are_kept_and_of_ties_the_first():
    group = np.array([0, 1, 0, 0, 1, 2, 0])
    score = np.array([3.0, 1.0, 5.0, 3.0, 2.0, 0.0, 4.0])
    assert np.flatnonzero(~among_best(group, score, 3)).tolist() == [3]
    assert np.flatnonzero(~among_best(group, score, 2)).tolist() == [0, 3]
    assert np.flatnonzero(~among_best(group, score, 1)).tolist() == [0, 1, 3, 6]


def test_values_of_detections_are_summed_over_the_paths_that_have_them():
    hits = np.array([[2, 5, 9], [3, 7, -1], [9, 12, -1]])
    sums = sums_over_hits(hits, np.array([2, 7, 9]), np.array([0.5, 0.25, 1.0]))
    assert sums.tolist() == [1.5, 0.25, 1.0]


def test_groups_are_in_the_order_of_their_first_rows():
    groups = [rows.tolist() for rows in rows_of_groups(np.array([4, 1, 4, 0, 1]))]
    assert groups == [[0, 2], [1, 4], [3]]
    assert rows_of_groups(np.zeros(0, np.int64)) == []


@pytest.mark.parametrize("seed", range(6))
def test_the_nearest_groups_are_joined_while_all_their_members_are_pairs(seed):
    place = np.random.default_rng(seed).uniform(0.0, 6.0, 14)
    apart = np.abs(place[:, None] - place)
    first, second = np.nonzero(np.triu(apart <= 1.5, 1))
    groups = [{k} for k in range(14)]
    while True:
        far = {
            (a, b): max(apart[i, j] for i in groups[a] for j in groups[b])
            for a in range(len(groups))
            for b in range(a)
        }
        a, b = min(far, key=far.get)
        if far[a, b] > 1.5:
            break
        groups[b] |= groups.pop(a)
    labels = complete_linkage(14, first, second, apart[first, second])
    assert labels.tolist() == [min(next(g for g in groups if k in g)) for k in range(14)]


def test_rows_of_records_are_taken_in_the_shape_of_their_indices_and_appended():
    records = np.zeros(4, [("time", float), ("place", float, (2,))])
    records["time"], records["place"][:, 1] = [1.0, 2.0, 3.0, 4.0], 7.0
    assert rows_of(records, np.array([[3, 0], [1, 1]]))["time"].tolist() == [
        [4, 1],
        [2, 2],
    ]
    mask = np.array([False, True, True, False])
    assert rows_of(records, mask)["time"].tolist() == [2.0, 3.0]
    both = appended(records[:1], records[2:])
    assert both["time"].tolist() == [1.0, 3.0, 4.0] and (both["place"][:, 1] == 7.0).all()


def test_values_are_changed_in_some_rows_of_a_table_only(echoes):
    made = with_rows(echoes, np.array([2, 0]), range=np.array([9.0, 8.0]))
    assert made.range.tolist() == [8.0, 2.0, 9.0]
    assert made.azimuth is echoes.azimuth and echoes.range.tolist() == [1.0, 2.0, 3.0]


def test_rows_of_a_table_in_a_table_are_changed(echoes):
    made = with_rows(Pings(echoes), np.array([2, 0]), echoes=echoes[np.array([1, 2])])
    assert made.echoes.range.tolist() == [3.0, 2.0, 2.0]
    assert echoes.range.tolist() == [1.0, 2.0, 3.0]


def test_the_largest_of_a_group_without_rows_is_minus_infinity():
    found = largest_of_groups(np.array([3.0, -1.0, 5.0]), np.array([0, 2, 0]), 4)
    assert found.tolist() == [5.0, -np.inf, -1.0, -np.inf]
