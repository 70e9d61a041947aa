"""Groups by complete linkage."""

from __future__ import annotations

import numpy as np

from tsepm_ros.numerics.arrays import FloatArray, IntArray
from tsepm_ros.numerics.grouped import largest_of


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
