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
"""Splitting: gates and children against plain loops, and starts."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from support.builders import FIXED_RANGE_ERROR, detections, scan_at

from tsepm_ros import make_initiator
from tsepm_ros.numerics.gaussian import gate_factor
from tsepm_ros.tracker import splitting
from tsepm_ros.tracker.hypotheses import ExpectedDetections, Hypotheses
from tsepm_ros.tracker.splitting import Gates, children_in_gates, split_paths


@pytest.mark.parametrize("seed", range(5))
def test_residual_detections_are_those_in_no_gate(seed):
    rng = np.random.default_rng(seed)
    last = detections(rng.uniform(-1000, 1000, (30, 2)), 0.0, variance=1.0)
    last["major_sigma"] = rng.uniform(1.0, 60.0, 30)
    found = detections(rng.uniform(-1000, 1000, (200, 2)), 6.0)
    gated = splitting.gate(last, found, 10.0, 0.9)
    radius = 60.0 + gate_factor(0.9) * last["major_sigma"]
    distance = np.linalg.norm(found["position"][:, None] - last["position"], axis=2)
    expected = np.flatnonzero((distance > radius).all(axis=1))
    assert 20 < len(expected) < 180
    assert np.delete(np.arange(200), gated.detection).tolist() == expected.tolist()


def random_split(seed: int, ties: bool):
    rng = np.random.default_rng([4, seed])
    counts = rng.integers(0, 6, 30)
    start = np.concatenate([[0], np.cumsum(counts)])
    gated = Gates(start, rng.integers(0, 50, start[-1]))
    gates = rng.integers(0, 30, 80)
    prices = rng.integers(0, 8, (80, 50)) if ties else rng.random((80, 50))
    return gates, gated, lambda parent, detection: prices[parent, detection].astype(float)


@pytest.mark.parametrize("block", [1, 7, 64, 1_000_000])
@pytest.mark.parametrize("ties", [False, True], ids=["distinct", "ties"])
@pytest.mark.parametrize("limit", [1, 10, 100])
def test_split_within_keeps_exactly_the_best_children(monkeypatch, block, ties, limit):
    monkeypatch.setattr(splitting, "SPLIT_BLOCK", block)
    gates, gated, cost = random_split(limit, ties)
    everyone = children_in_gates(gates, gated)
    best = np.sort(np.argsort(cost(*everyone), kind="stable")[:limit])
    parent, detection, cut = split_paths(gates, gated, limit, cost)
    assert parent.tolist() == everyone[0][best].tolist()
    assert detection.tolist() == everyone[1][best].tolist()
    assert cut == len(everyone[0]) - limit


@pytest.mark.parametrize("few", [True, False], ids=["every pair", "the nearest"])
def test_neighbours_are_those_within_the_radius_and_beyond_a_number_the_nearest(few):
    rng = np.random.default_rng(9)
    positions, centres = rng.uniform(0.0, 100.0, (40, 2)), rng.uniform(0.0, 100.0, (6, 2))
    radius = rng.uniform(20.0, 60.0, 6)
    distance = np.hypot(*np.moveaxis(positions - centres[:, None], 2, 0))
    near = distance <= radius[:, None]
    most = 1000 if few else 30
    centre, place, cut = splitting.neighbours(positions, centres, radius, most=most)
    if not few:
        near &= distance.argsort(axis=1).argsort(axis=1) < most // 6
    assert list(zip(centre, place, strict=True)) == list(zip(*np.nonzero(near), strict=True))
    assert cut == (distance <= radius[:, None]).sum() - near.sum()
    assert (cut > 0) is not few


def test_a_gate_grows_with_the_time_of_either_sign_and_the_margin():
    last = detections([[0.0, 0.0]] * 3, [0.0, 4.0, 20.0])
    found = detections([[30.0, 0.0], [0.0, 61.0], [0.0, -101.5]], [10.0, 10.0, 10.0])
    gated = splitting.gate_within(last, found, 10.0, np.array([1.0, 1.5, 2.0]))
    assert [gated.detection[a:b].tolist() for a, b in itertools.pairwise(gated.start)] == [
        [0, 1],
        [0, 1],
        [0, 1, 2],
    ]
    assert gated.count.tolist() == [2, 2, 3]
    assert splitting.gate_within(last, found[:0], 10.0, np.ones(3)).count.tolist() == [
        0,
        0,
        0,
    ]


def test_detections_of_several_times_are_each_gated_at_their_own():
    last = detections([[0.0, 0.0]], [0.0])
    found = detections([[25.0, 0.0], [0.0, 25.0], [45.0, 0.0]], [2.0, 3.0, 4.0])
    assert splitting.gate_within(last, found, 10.0, np.zeros(1)).detection.tolist() == [1]
    assert splitting.gate_within(last, found, 12.5, np.zeros(1)).detection.tolist() == [
        0,
        1,
        2,
    ]


def hypotheses_at(places, speed=0.0):
    n = len(places)
    state = np.zeros((n, 4))
    state[:, 0::2], state[:, 1] = places, speed
    return replace(
        Hypotheses.none(3),
        hits=np.zeros((n, 3), np.int64),
        hit_count=np.ones(n, np.int64),
        state=state,
        covariance=np.broadcast_to(np.diag([400.0, 4.0, 900.0, 4.0]), (n, 4, 4)).copy(),
        score=np.zeros(n),
        faded=np.zeros((n, 1)),
    )


@pytest.mark.parametrize("times", [(0.0, 0.0), (1.0, 3.0), (-2.0, 2.0)])
def test_every_detection_in_a_hypothesis_gate_is_a_pair(times):
    rng = np.random.default_rng(4)
    hypotheses = hypotheses_at([[2000.0, 0.0], [0.0, 2500.0]], speed=6.0)
    around = hypotheses.state[:, None, 0::2] + rng.normal(0.0, 150.0, (2, 60, 2))
    found = detections(around.reshape(-1, 2), 0.0)
    found["time"] = 50.0 + rng.uniform(*times, 120) if times[0] != times[1] else 50.0
    found["azimuth_std"] = 0.02
    expected = ExpectedDetections.from_hypotheses(hypotheses, 50.0, found, FIXED_RANGE_ERROR)
    owner, row, cut = splitting.split(expected, 0.99)
    assert cut == 0
    every = np.repeat([0, 1], 120), np.tile(np.arange(120), 2)
    inside = np.isfinite(expected.log_likelihood(*every, 0.99))
    pairs = set(zip(owner.tolist(), row.tolist(), strict=True))
    assert pairs >= {(a, b) for a, b, c in zip(*every, inside, strict=True) if c}
    assert 10 < inside.sum() < len(pairs) < 160, "the circle about the gate, and not much more"


def test_a_hypothesis_is_predicted_with_its_fading():
    before = replace(hypotheses_at([[0.0, 0.0]], speed=2.0), faded=np.array([[0.3, 0.3]]))
    after = splitting.predict(before, 10.0, 0.5, sensor=1)
    assert after.state[0].tolist() == [20.0, 2.0, 0.0, 0.0]
    assert after.covariance[0, 1, 1] == pytest.approx(4.0 + 5.0)
    np.testing.assert_allclose(after.faded, [[0.3, 0.3 * 7.0 / 8.0 + 0.7 / 25.0]])


def test_every_detection_starts_a_hypothesis_of_unknown_velocity_at_the_stamp():
    made = make_initiator("score", sensor=FIXED_RANGE_ERROR)
    scan = scan_at(7.0, [(3000.0, 0.0), (0.0, 1000.0)], time_offset=[0.0, 2.0])
    observed = made.observe(scan)
    observed = replace(observed, confirmed_probability=np.array([0.0, 0.75]))
    started = splitting.start(observed, 10.0, 4)
    assert started.hits[:, 0].tolist() == observed.ids.tolist()
    assert started.hit_count.tolist() == [1, 1]
    np.testing.assert_allclose(started.state[:, 0::2], observed.detections["position"])
    assert started.covariance[:, 1, 1].tolist() == [25.0, 25.0]
    own = observed.detections["covariance"]
    np.testing.assert_allclose(started.covariance[0, 0::2, 0::2], own[0])
    grown = own[1] + 4.0 * 25.0 * np.eye(2)
    np.testing.assert_allclose(started.covariance[1, 0::2, 0::2], grown, err_msg="2 s before")
    np.testing.assert_allclose(started.score, [0.0, np.log(0.25)])
