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
"""Arrays whose rows belong together: tables, groups of rows, and limits of number."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

BoolArray = NDArray[np.bool_]
FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
RecordArray = NDArray[np.void]

T = TypeVar("T")


def replaced(table: T, **columns: Any) -> T:
    """A table (a dataclass without slots) with other columns, or parts.

    As `dataclasses.replace`, without a constructor: a tenth of the time.
    """
    new = object.__new__(type(table))
    new.__dict__.update(table.__dict__, **columns)
    if len(new.__dict__) > len(table.__dict__):
        raise TypeError(f"{type(table).__name__} has no {set(columns) - set(table.__dict__)}")
    return new


def rows_of(records: RecordArray, rows: NDArray[np.generic]) -> RecordArray:
    """Rows of a structured array, as ``records[rows]``: indices of any shape, or a mask (n,).

    Whole records are copied; ``[]`` copies field by field, which takes over ten times as long.
    """
    index: Any = rows.nonzero()[0] if rows.dtype == bool else rows
    return records.take(index, axis=0)


def appended(records: RecordArray, *more: RecordArray) -> RecordArray:
    """Structured arrays (n,) one after the other.

    As blocks of bytes, which is many times faster than field by field.
    """
    blocks = [part.view((np.void, part.itemsize)) for part in (records, *more)]
    return np.concatenate(blocks).view(records.dtype)


def with_rows(table: T, rows: IntArray, **values: Any) -> T:
    """A table with other values in some rows: of columns, or rows of tables in it."""
    columns: dict[str, Any] = {}
    for name, value in values.items():
        column = table.__dict__[name]
        if isinstance(column, np.ndarray):
            columns[name] = column.copy()
            columns[name][rows] = value
        else:
            index = np.arange(len(column))
            index[rows] = len(column) + np.arange(len(value))
            columns[name] = column.joined(column, value)[index]
    return replaced(table, **columns)


@dataclass(frozen=True, eq=False)
class Rows:
    """Columns of equal length, the fields of a subclass: arrays, or tables of such columns."""

    def __len__(self) -> int:
        """Number of rows."""
        return len(next(iter(self.__dict__.values())))

    def __getitem__(self, rows: NDArray[np.generic] | slice) -> Self:
        """The given rows: indices, a mask, or a slice, which is a view."""
        row: Any = rows  # several columns take indices faster than a mask
        if isinstance(rows, np.ndarray) and rows.dtype == bool:
            row = rows.nonzero()[0]
        new, columns = object.__new__(type(self)), self.__dict__
        for name in self.__dataclass_fields__:
            column = columns[name]
            new.__dict__[name] = (
                column.take(row, axis=0)
                if isinstance(column, np.ndarray) and not isinstance(row, slice)
                else column[row]
            )
        return new

    @classmethod
    def joined(cls, *parts: Self) -> Self:
        """The rows of all parts, in order."""
        if len(parts) == 1:
            return parts[0]
        columns = {}
        for name in cls.__dataclass_fields__:
            columns_of_parts = [getattr(part, name) for part in parts]
            array = isinstance(columns_of_parts[0], np.ndarray)
            columns[name] = (
                np.concatenate(columns_of_parts)
                if array
                else type(columns_of_parts[0]).joined(*columns_of_parts)
            )
        return cls(**columns)

    @classmethod
    def chosen(cls, *parts: tuple[Self, IntArray]) -> Self:
        """The given rows of each part, in order."""
        ends = np.cumsum([len(rows) for _, rows in parts]).tolist()
        places = [slice(begin, end) for begin, end in zip([0, *ends], ends, strict=False)]
        chosen = []
        for name in cls.__dataclass_fields__:
            columns = [table.__dict__[name] for table, _ in parts]
            column = np.empty((ends[-1], *columns[0].shape[1:]), columns[0].dtype)
            for values, (_, rows), place in zip(columns, parts, places, strict=True):
                # "clip" writes into the place at once; "raise", the default, copies.
                values.take(rows, 0, column[place], "clip")
            chosen.append(column)
        return cls(*chosen)


def run_starts(labels: IntArray) -> IntArray:
    """First row of each run of equal labels (n,)."""
    starts = np.ones(len(labels), bool)
    np.not_equal(labels[1:], labels[:-1], out=starts[1:])
    return starts.nonzero()[0]


def log_sums(score: FloatArray, group: IntArray, count: int) -> FloatArray:
    """Log of the summed likelihood ratios of each group, ``ln sum_i exp(s_i)``.

    Parameters
    ----------
    score : (n,) ndarray
    group : (n,) ndarray of int
        Group of each hypothesis, 0 to count - 1.
    count : int

    Returns
    -------
    (count,) ndarray
        -inf for a group without hypotheses.
    """
    largest = largest_of_groups(score, group, count)
    base = np.where(np.isfinite(largest), largest, 0.0)
    sums = np.bincount(group, np.exp(score - base[group]), minlength=count)
    with np.errstate(divide="ignore"):
        return np.asarray(np.log(sums) + base)


def largest_of_groups(score: FloatArray, group: IntArray, count: int) -> FloatArray:
    """Largest score of each group, (count,); -inf for a group without hypotheses."""
    largest = np.full(count, -np.inf)
    np.maximum.at(largest, group, score)
    return largest


def among_best(group: IntArray, score: FloatArray, number: int) -> BoolArray:
    """Which rows are among a number of the largest scores of their group, (n,)."""
    kept = np.ones(len(group), bool)
    rows = np.flatnonzero(np.bincount(group)[group] > number)
    order = rows[np.lexsort((-score[rows], group[rows]))]
    index = np.arange(len(order)) - np.searchsorted(group[order], group[order])
    kept[order[index >= number]] = False
    return kept


def sums_over_hits(hits: IntArray, ids: IntArray, values: FloatArray) -> FloatArray:
    """Sum of the values of detections `ids` (c,), ascending, over the hits (n, m) of each path.

    `ids` holds at least one detection; other hits count 0.
    """
    index = np.minimum(np.searchsorted(ids, hits), len(ids) - 1)
    return np.asarray(np.where(ids[index] == hits, values[index], 0.0).sum(axis=1))


def rows_of_groups(labels: IntArray) -> list[IntArray]:
    """Rows of each group, groups in the order of their first rows."""
    order = np.argsort(labels, kind="stable")
    borders = np.flatnonzero(np.diff(labels[order])) + 1
    parts = np.split(order, borders) if len(order) else []
    return sorted(parts, key=lambda rows: int(rows[0]))


def complete_linkage(n: int, first: IntArray, second: IntArray, distance: FloatArray) -> IntArray:
    """Groups of detections every two of which are a pair.

    The two nearest groups are joined, the distance of groups being that of their farthest members,
    as long as all their members are pairs. In each round here all groups are joined that are each
    other's nearest, which comes to the same groups: joining others makes none of them nearer.

    Parameters
    ----------
    n : int
        Number of detections.
    first, second, distance : (p,) ndarray
        Pairs, first < second, and the distance of each.

    Returns
    -------
    (n,) ndarray of int
        The first member of each detection's group.
    """
    label, size = np.arange(n), np.ones(n, np.int64)
    count = np.ones(len(first), np.int64)
    while len(first):
        order = np.lexsort((second, first, distance))
        first, second, distance = first[order], second[order], distance[order]
        count, index = count[order], np.arange(len(first))
        nearest = np.full(n, len(first))
        np.minimum.at(nearest, first, index)
        np.minimum.at(nearest, second, index)
        joined = (nearest[first] == index) & (nearest[second] == index)
        into = np.arange(n)
        into[second[joined]] = first[joined]
        size[first[joined]] += size[second[joined]]
        label = into[label]
        low, high = into[first], into[second]
        key = np.minimum(low, high) * n + np.maximum(low, high)
        key, inverse = np.unique(np.where(low == high, -1, key), return_inverse=True)
        distance = largest_of_groups(distance, inverse, len(key))
        count = np.bincount(inverse, count, minlength=len(key)).astype(np.int64)
        first, second = key // n, key % n
        kept = (key >= 0) & (count == size[first] * size[second])
        first, second, distance, count = first[kept], second[kept], distance[kept], count[kept]
    return label


def rows_of_least_cost(cost: FloatArray, limit: int) -> IntArray:
    """Rows of the `limit` smallest costs, in ascending order of rows.

    Ties are kept in the order of their rows: the choice is the same on every machine.

    Parameters
    ----------
    cost : (n,) ndarray
        Smaller is better.
    limit : int
        Number to keep, at least 1.
    """
    if len(cost) <= limit:
        return np.arange(len(cost))
    largest_kept = np.partition(cost, limit - 1)[limit - 1]
    kept = cost < largest_kept
    ties = np.flatnonzero(cost == largest_kept)
    kept[ties[: limit - np.count_nonzero(kept)]] = True
    return np.flatnonzero(kept)
