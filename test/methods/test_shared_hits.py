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
"""Groups of tracks that share hits."""

import itertools

import numpy as np
import pytest
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from tsepm_ros.methods import shared_hits
from tsepm_ros.methods.shared_hits import groups
from tsepm_ros.numerics.gaussian import gate_factor

P_TM = 0.9


def every_pair(hits, states, covariances) -> np.ndarray:
    """Labels from a look at every pair."""
    n, m = hits.shape
    edges = []
    for i, j in itertools.combinations(range(n), 2):
        if 2 * len(set(hits[i]) & set(hits[j])) <= m:
            continue
        d = states[i] - states[j]
        if d @ np.linalg.solve(covariances[i] + covariances[j], d) <= gate_factor(P_TM) ** 2:
            edges.append((i, j))
    one, other = np.array(edges).reshape(-1, 2).T
    graph = csr_array((np.ones(len(edges)), (one, other)), shape=(n, n))
    return connected_components(graph, directed=False)[1]


def crowd(m: int, spread: float):
    """Tracks through the same few detections per scan, states more or less close."""
    rng = np.random.default_rng([5, m])
    hits = np.unique(rng.integers(0, 3, (150, m)) + 3 * np.arange(m), axis=0)
    root = rng.standard_normal((len(hits), 4, 6))
    return hits, spread * rng.standard_normal((len(hits), 4)), root @ np.swapaxes(root, 1, 2)


def partition(labels: np.ndarray) -> set[frozenset[int]]:
    return {frozenset(np.flatnonzero(labels == label).tolist()) for label in np.unique(labels)}


@pytest.mark.parametrize("spread", [0.5, 3.0, 8.0], ids=["close", "mixed", "apart"])
@pytest.mark.parametrize(
    ("m", "block"), [(3, 1), (4, 13), (5, 1), *((m, shared_hits.PAIR_BLOCK) for m in (6, 8, 12))]
)
def test_groups_are_those_of_a_look_at_every_pair(monkeypatch, block, m, spread):
    monkeypatch.setattr(shared_hits, "PAIR_BLOCK", block)
    scene = crowd(m, spread)
    assert partition(groups(*scene, P_TM)) == partition(every_pair(*scene))
