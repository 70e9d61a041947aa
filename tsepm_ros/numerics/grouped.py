"""Groups of rows: sums, maxima, ranks, and complete linkage.

Sums, maxima and ranks within groups of rows.

Groups by complete linkage.
"""

from __future__ import annotations

import numpy as np

from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray


def summed(score: FloatArray, group: IntArray, count: int) -> FloatArray:
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
    largest = largest_of(score, group, count)
    base = np.where(np.isfinite(largest), largest, 0.0)
    sums = np.bincount(group, np.exp(score - base[group]), minlength=count)
    with np.errstate(divide="ignore"):
        return np.asarray(np.log(sums) + base)


def largest_of(score: FloatArray, group: IntArray, count: int) -> FloatArray:
    """Largest score of each group, (count,); -inf for a group without hypotheses."""
    largest = np.full(count, -np.inf)
    np.maximum.at(largest, group, score)
    return largest


def among_best(group: IntArray, score: FloatArray, number: int) -> BoolArray:
    """Which rows are among a number of the largest scores of their group, (n,)."""
    kept = np.ones(len(group), bool)
    if len(group) <= number:
        return kept
    rows = np.flatnonzero(np.bincount(group)[group] > number)
    order = rows[np.lexsort((-score[rows], group[rows]))]
    place = np.arange(len(order)) - np.searchsorted(group[order], group[order])
    kept[order[place >= number]] = False
    return kept


def sums_over_hits(hits: IntArray, ids: IntArray, values: FloatArray) -> FloatArray:
    """Sum of the values of detections `ids` (c,), ascending, over the hits (n, m) of each path.

    `ids` holds at least one detection; other hits count 0.
    """
    place = np.minimum(np.searchsorted(ids, hits), len(ids) - 1)
    sums: FloatArray = np.where(ids[place] == hits, values[place], 0.0).sum(axis=1)
    return sums


def members_of_groups(labels: IntArray) -> list[IntArray]:
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
        count, place = count[order], np.arange(len(first))
        nearest = np.full(n, len(first))
        np.minimum.at(nearest, first, place)
        np.minimum.at(nearest, second, place)
        joined = (nearest[first] == place) & (nearest[second] == place)
        into = np.arange(n)
        into[second[joined]] = first[joined]
        size[first[joined]] += size[second[joined]]
        label = into[label]
        one, two = into[first], into[second]
        key = np.minimum(one, two) * n + np.maximum(one, two)
        key, inverse = np.unique(np.where(one == two, -1, key), return_inverse=True)
        distance = largest_of(distance, inverse, len(key))
        count = np.bincount(inverse, count, minlength=len(key)).astype(np.int64)
        first, second = key // n, key % n
        kept = (key >= 0) & (count == size[first] * size[second])
        first, second, distance, count = first[kept], second[kept], distance[kept], count[kept]
    return label
