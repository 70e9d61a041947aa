"""Paths held as numbers, against paths held one by one."""

from collections import Counter

import numpy as np
import pytest

from tsepm_ros.methods import tsepm
from tsepm_ros.methods.tsepm import MAX_COUNT, PathCounts
from tsepm_ros.tracker.splitting import Gated

Path = tuple[int, int, int]


def paths_of(counts: PathCounts) -> Counter[Path]:
    rows = zip(
        counts.last_hit.tolist(),
        counts.hit_count.tolist(),
        counts.first_scan.tolist(),
        counts.number.tolist(),
        strict=True,
    )
    found: Counter[Path] = Counter()
    for *path, number in rows:
        assert tuple(path) not in found
        assert number > 0
        found[tuple(path)] = number
    return found


def random_paths(seed: int, number: int) -> list[Path]:
    rng = np.random.default_rng(seed)
    return list(
        zip(
            rng.integers(100, 110, number).tolist(),
            rng.integers(1, 5, number).tolist(),
            rng.integers(7, 12, number).tolist(),
            strict=True,
        )
    )


def counts_of(paths: list[Path]) -> PathCounts:
    return PathCounts.of(*np.array(paths, np.int64).reshape(-1, 3).T)


@pytest.mark.parametrize("block", [1, 3, 32])
@pytest.mark.parametrize("number", [0, 1, 300])
def test_children_are_those_of_every_single_path(monkeypatch, number, block):
    monkeypatch.setattr(tsepm, "BLOCK", block)
    rng = np.random.default_rng(number)
    sizes = rng.integers(0, 6, 10)
    rows = [np.sort(rng.choice(20, size, replace=False)) for size in sizes]
    gated = Gated(np.concatenate([[0], np.cumsum(sizes)]), np.concatenate(rows), np.zeros(20, bool))
    ids = np.arange(500, 520)
    paths = random_paths(4, number)
    expected = Counter(
        (int(ids[row]), hits + 1, first) for last, hits, first in paths for row in rows[last - 100]
    )
    counts = counts_of(paths)
    assert paths_of(counts.children(counts.last_hit - 100, gated, ids)) == expected


def test_numbers_stop_before_they_overflow():
    n = 1000
    gated = Gated(np.arange(n + 1) * n, np.tile(np.arange(n), n), np.ones(n, bool))
    counts = PathCounts.of(np.arange(n), np.ones(n, np.int64), np.zeros(n, np.int64))
    for _ in range(8):
        counts = counts.children(np.arange(n), gated, np.arange(n))
    assert counts.number.tolist() == [MAX_COUNT] * n
    assert 0 < counts.total < 2**63
