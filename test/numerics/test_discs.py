"""Pairs within discs, against all distances."""

from __future__ import annotations

import numpy as np
import pytest

from tsepm_ros.numerics.discs import ALL_PAIRS, pairs_nearer, pairs_within


def places(kind: str, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    positions, centres = rng.uniform(-900.0, 900.0, (2, 300, 2))
    radius = rng.uniform(0.0, 150.0, 300)
    if kind == "one place":
        positions[:] = positions[0]
        centres[::2] = positions[0]
    elif kind == "one line":
        positions[:, 1] = 5.0
    elif kind == "all sizes":
        radius = 10.0 ** rng.uniform(-3.0, 6.0, 300)
    elif kind == "no size":
        radius[:], centres[:] = 0.0, positions
    return positions, centres, radius


@pytest.mark.parametrize("kind", ["even", "one place", "one line", "all sizes", "no size"])
@pytest.mark.parametrize("number", [20, 300])
def test_pairs_are_those_of_all_distances(kind, number):
    positions, centres, radius = places(kind, np.random.default_rng(5))
    positions = positions[:number]
    assert (number * len(centres) > ALL_PAIRS) == (number == 300)
    apart = centres[:, None] - positions
    expected = np.nonzero((apart**2).sum(axis=2) <= radius[:, None] ** 2)
    found = pairs_within(positions, centres, radius, 10**6)
    np.testing.assert_array_equal(found, expected)
    assert len(found[0])
    assert pairs_within(positions, centres, radius, len(found[0]) - 1) is None


@pytest.mark.parametrize("number", [5, 300])
def test_pairs_nearer_are_those_of_a_loop(number):
    positions = np.random.default_rng(6).uniform(0.0, 100.0, (number, 2))
    expected = {
        (i, j)
        for j in range(number)
        for i in range(j)
        if np.hypot(*(positions[i] - positions[j])) <= 30.0
    }
    first, second = pairs_nearer(positions, 30.0)
    assert set(zip(first.tolist(), second.tolist(), strict=True)) == expected
    assert expected


def test_a_search_ends_where_the_time_is_over():
    rng = np.random.default_rng(4)
    places = rng.uniform(0.0, 100.0, (3000, 2))
    asked = []

    def late(after: int) -> bool:
        asked.append(after)
        return len(asked) > after

    found = pairs_within(places, places, np.full(3000, 200.0), 10**7, lambda: late(100))
    assert found is not None
    assert len(found[0]) == 3000 * 3000
    assert len(asked) > 1
    parts = len(asked)
    asked.clear()
    assert pairs_within(places, places, np.full(3000, 200.0), 10**7, lambda: late(1)) is None
    assert len(asked) == 2 < parts
