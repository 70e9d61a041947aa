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

from dataclasses import replace

import numpy as np
import pytest
from support.builders import FIXED_RANGE_ERROR, detections, observation_of, scan_at

from tsepm_ros import make_initiator
from tsepm_ros.tracker import splitting
from tsepm_ros.tracker.hypotheses import ExpectedDetections, Hypotheses


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
    observed = observation_of(made, scan)
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
