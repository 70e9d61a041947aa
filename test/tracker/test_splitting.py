"""Splitting: gates and children against plain loops, and starts."""

import numpy as np
import pytest
from support.builders import detections

from tsepm_ros.numerics.gaussian import gate_factor
from tsepm_ros.tracker import splitting
from tsepm_ros.tracker.splitting import Gated, children, gate, split_paths


@pytest.mark.parametrize("seed", range(5))
def test_residual_detections_are_those_in_no_gate(seed):
    rng = np.random.default_rng(seed)
    last = detections(rng.uniform(-1000, 1000, (30, 2)), 0.0, variance=1.0)
    last["major_sigma"] = rng.uniform(1.0, 60.0, 30)
    found = detections(rng.uniform(-1000, 1000, (200, 2)), 6.0)
    gated = gate(last, found, 10.0, 0.9)
    radius = 60.0 + gate_factor(0.9) * last["major_sigma"]
    distance = np.linalg.norm(found["position"][:, None] - last["position"], axis=2)
    expected = np.flatnonzero((distance > radius).all(axis=1))
    assert 20 < len(expected) < 180
    assert np.delete(np.arange(200), gated.detection).tolist() == expected.tolist()


def random_split(seed: int, ties: bool):
    rng = np.random.default_rng([4, seed])
    counts = rng.integers(0, 6, 30)
    start = np.concatenate([[0], np.cumsum(counts)])
    gated = Gated(start, rng.integers(0, 50, start[-1]))
    gates = rng.integers(0, 30, 80)
    prices = rng.integers(0, 8, (80, 50)) if ties else rng.random((80, 50))
    return gates, gated, lambda parent, detection: prices[parent, detection].astype(float)


@pytest.mark.parametrize("block", [1, 7, 64, 1_000_000])
@pytest.mark.parametrize("ties", [False, True], ids=["distinct", "ties"])
@pytest.mark.parametrize("limit", [1, 10, 100])
def test_split_within_keeps_exactly_the_best_children(monkeypatch, block, ties, limit):
    monkeypatch.setattr(splitting, "SPLIT_BLOCK", block)
    gates, gated, cost = random_split(limit, ties)
    everyone = children(gates, gated)
    best = np.sort(np.argsort(cost(*everyone), kind="stable")[:limit])
    parent, detection, cut = split_paths(gates, gated, limit, cost)
    assert parent.tolist() == everyone[0][best].tolist()
    assert detection.tolist() == everyone[1][best].tolist()
    assert cut == len(everyone[0]) - limit
