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
"""Hypotheses and their tree against plain loops."""

from dataclasses import replace

import numpy as np
import pytest
from support.batches import batches
from support.builders import AS_GIVEN, FIXED_RANGE_ERROR, detections
from support.scenes import random_scene
from support.score_scenes import NEVER, given_confirmed, in_plain_loops, score

from tsepm_ros.tracker import motion
from tsepm_ros.tracker.hypotheses import (
    PRIOR_TARGET_ODDS,
    ExpectedDetections,
    Hypotheses,
    Start,
    Tree,
    given_starts,
)
from tsepm_ros.tracker.initial_state import NO_HIT


def test_given_a_start_the_score_falls_by_the_share_of_the_hits_that_are_its_own():
    of, none = Hypotheses.none(3), NO_HIT
    hypotheses = replace(
        of,
        hits=np.array([[1, 2, none], [1, 3, none], [2, none, none]]),
        hit_count=np.array([2, 2, 1]),
        score=np.array([6.0, 6.0, -1.0]),
    )
    likely = np.array([1, 2])
    start = Start(
        likely[:1], likely, likely, np.array([1.0, 0.5]), np.zeros(4), np.eye(4), 8.0, newest=2
    )
    given = given_starts(hypotheses, [start])
    np.testing.assert_allclose(given.score, [1.5, 3.0, -1.0])


@pytest.mark.parametrize("seed", batches(24, 8))
def test_hypotheses_and_scores_are_those_of_plain_loops(seed):
    scene = random_scene(seed)
    plain_scans, sensor, options = in_plain_loops(scene, seed)
    initiator = score(sensor, false_tracks_per_hour=NEVER, **AS_GIVEN, **options)
    compared = 0
    for scan, grown in zip(scene.as_scans(), plain_scans, strict=False):
        expected = grown.kept
        with given_confirmed(initiator, scene):
            assert len(initiator.process(scan)) == 0
        assert initiator.statistics.potential_tracks == len(expected)
        plain = {one.keys: one for one in expected}
        assert len(plain) == len(expected)
        found = initiator.potential_tracks()
        assert {track.hits for track in found} == {keys for keys in plain if len(keys) > 1}
        for row, hits in enumerate(found.hits):
            np.testing.assert_allclose(found.score[row], plain[hits].score, rtol=1e-7, atol=1e-7)
        inside = initiator.method.hypotheses
        inside = inside[(inside.hit_count > 1) & (inside.score > -np.inf)]
        for row, hits in enumerate(found.hits):
            np.testing.assert_allclose(inside.state[row], plain[hits].state, rtol=1e-6, atol=1e-5)
            scale = np.linalg.norm(plain[hits].covariance)
            np.testing.assert_allclose(
                inside.covariance[row], plain[hits].covariance, rtol=0, atol=1e-7 * scale
            )
        compared += len(found)
    assert compared > 0 or seed == 18, "in that scene nothing is left"


def test_a_tree_sums_the_ratios_of_the_hypotheses_that_end_in_each_detection():
    hypotheses = replace(
        Hypotheses.none(2),
        hits=np.array([[3, NO_HIT], [3, 7], [4, 7], [9, NO_HIT]]),
        hit_count=np.array([1, 2, 2, 1]),
        score=np.array([5.0, 1.0, 2.0, 0.5]),
    )
    tree = Tree(hypotheses, 1, np.array([7, 8, 9]))
    assert tree.newest.tolist() == [0, 0, 2]
    sums = [np.log(np.exp(1.0) + np.exp(2.0)), -np.inf, 0.5]
    np.testing.assert_allclose(tree.evidence, sums)
    assert tree.ending_in(0).hits.tolist() == [[3, 7], [4, 7]]
    assert len(tree.ending_in(1)) == 0
    assert tree.ending_in(2).score.tolist() == [0.5]
    odds = PRIOR_TARGET_ODDS * np.exp(sums)
    np.testing.assert_allclose(tree.target_probability, odds / (1.0 + odds))


@pytest.mark.parametrize("shared", [True, False], ids=["one error for all", "each its own"])
def test_pairs_are_updated_as_by_the_kalman_filter_alone(shared):
    rng = np.random.default_rng(1)
    found = detections([[3010.0, 5.0], [2990.0, -9.0], [3050.0, 30.0]], 12.0)
    found["azimuth_std"] = 0.01 if shared else [0.01, 0.02, 0.03]
    root = rng.normal(size=(2, 4, 4))
    made = replace(
        Hypotheses.none(2),
        hits=np.zeros((2, 2), np.int64),
        hit_count=np.ones(2, np.int64),
        state=np.array([[2980.0, 5.0, 0.0, 1.0], [3000.0, -3.0, 10.0, 2.0]]),
        covariance=100.0 * root @ np.swapaxes(root, 1, 2),
    )
    expected = ExpectedDetections.from_hypotheses(made, 10.0, found, FIXED_RANGE_ERROR)
    assert (expected.of_hypothesis is not None) == shared
    parent, row = np.array([0, 0, 1]), np.array([0, 2, 1])
    pairs = made.state[parent], made.covariance[parent]
    after = np.full(3, 2.0)
    innovation, spread = motion.innovations(*pairs, after, found[row], FIXED_RANGE_ERROR)
    for one, other in zip(expected.innovations(parent, row), (innovation, spread), strict=True):
        np.testing.assert_allclose(one, other)
    state, covariance = motion.update(*pairs, after, innovation, spread)
    found_state, found_covariance = expected.updated(parent, row)
    np.testing.assert_allclose(found_state, state)
    np.testing.assert_allclose(found_covariance, covariance, atol=1e-9)
