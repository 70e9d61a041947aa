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
"""Association of detections with confirmed tracks, against every assignment and plain loops."""

import itertools
import math
import time

import numpy as np
import pytest
from support import plain_confirmed_tracks

from tsepm_ros.tracker.maintenance.data_association import (
    Pairs,
    assigned,
    confirmed_probability,
)


def scene(seed: int, tracks: int = 4, detections: int = 5, gated: float = 0.6):
    """Existence, probability of an empty gate, and ratios (n, d), 0 outside the gates."""
    rng = np.random.default_rng(seed)
    ratio = rng.lognormal(1.0, 2.0, (tracks, detections)) * (
        rng.random((tracks, detections)) < gated
    )
    return rng.uniform(0.05, 1.0, tracks), rng.uniform(0.05, 1.0, tracks), ratio


def pairs_of(ratio: np.ndarray) -> Pairs:
    track, row = np.nonzero(ratio)
    return Pairs(track, row, ratio[track, row])


def gains(existence, empty, ratio) -> np.ndarray:
    r = existence[:, None]
    return np.where(
        ratio > 0.0, np.log((1.0 - r + r * ratio) / (1.0 - r + r * empty[:, None])), -np.inf
    )


def largest_gain(gain: np.ndarray) -> float:
    """Over every assignment of a detection, or none, to each track."""
    n, d = gain.shape
    best = 0.0
    for some in itertools.product(range(-1, d), repeat=n):
        taken = [j for j in some if j >= 0]
        if len(set(taken)) == len(taken):
            best = max(best, sum(gain[i, j] for i, j in enumerate(some) if j >= 0))
    return best


@pytest.mark.parametrize("seed", range(12))
def test_the_assignment_has_the_largest_gain_of_all_and_each_detection_one_track(seed):
    existence, empty, ratio = scene(seed)
    gain = gains(existence, empty, ratio)
    owner = assigned(existence, empty, pairs_of(ratio), ratio.shape[1])
    some = np.flatnonzero(owner >= 0)
    assert len(set(owner[some])) == len(some)
    assert (gain[owner[some], some] > 0.0).all()
    assert gain[owner[some], some].sum() == pytest.approx(largest_gain(gain))


def test_the_order_of_tracks_and_detections_changes_nothing():
    rng, (existence, empty, ratio) = np.random.default_rng(2), scene(3, 8, 9)
    owner = assigned(existence, empty, pairs_of(ratio), 9)
    probability = confirmed_probability(existence, empty, pairs_of(ratio), 9)
    track, row = rng.permutation(8), rng.permutation(9)
    other = existence[track], empty[track], pairs_of(ratio[track][:, row]), 9
    back = np.append(track, -1)[assigned(*other)]
    np.testing.assert_array_equal(back, owner[row])
    np.testing.assert_allclose(confirmed_probability(*other), probability[row])


@pytest.mark.parametrize("seed", range(4))
def test_detections_are_a_target_s_with_the_probability_of_plain_loops(seed):
    existence, empty, ratio = scene(seed)
    found = confirmed_probability(existence, empty, pairs_of(ratio), ratio.shape[1])
    expected = plain_confirmed_tracks.confirmed_probability(existence, empty, ratio)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12)


def test_of_one_target_the_detections_are_shared_by_bayes():
    # lambda is the denominator of L: odds of a detection to be the target's, against clutter.
    existence, empty, ratio = np.array([0.8]), np.array([0.1]), np.array([[9.0, 3.0]])
    found = confirmed_probability(existence, empty, pairs_of(ratio), 2)
    whole = 0.2 + 0.8 * (0.1 + 12.0)
    np.testing.assert_allclose(found, [0.8 * 9.0 / whole, 0.8 * 3.0 / whole])


@pytest.mark.parametrize("number", [0, 3])
@pytest.mark.parametrize("tracks", [0, 2])
def test_without_pairs_nothing_is_assigned(number, tracks):
    none = np.zeros(0, np.int64)
    scan = np.ones(tracks), np.full(tracks, 0.1), Pairs(none, none, np.zeros(0)), number
    assert assigned(*scan).tolist() == [-1] * number
    assert confirmed_probability(*scan).tolist() == [0.0] * number


@pytest.mark.parametrize("ratio", [1e-300, 1e-12, 1e12, 1e300])
def test_ratios_of_any_size_give_probabilities_below_one(ratio):
    existence, empty = np.array([1.0, 1.0, 1e-5]), np.array([1e-3, 1.0, 0.5])
    every = pairs_of(np.full((3, 2), ratio))
    found = confirmed_probability(existence, empty, every, 2)
    assert np.isfinite(found).all()
    assert (found >= 0.0).all() and (found < 1.0).all()
    assert assigned(existence, empty, every, 2).max() < 3


def test_many_tracks_that_compete_are_assigned_in_a_fraction_of_a_second():
    rng, n = np.random.default_rng(1), 2000
    track = np.arange(n).repeat(8)
    row = np.clip(track + rng.integers(-6, 7, len(track)), 0, n - 1)
    track, row = np.unique(np.stack([track, row]), axis=1)
    pairs = Pairs(track, row, rng.lognormal(2.0, 2.0, len(track)))
    begun = time.process_time()
    owner = assigned(np.full(n, 0.9), np.full(n, 0.2), pairs, n)
    confirmed_probability(np.full(n, 0.9), np.full(n, 0.2), pairs, n)
    assert time.process_time() - begun < 2.0
    assert math.isclose(len(set(owner[owner >= 0])), np.count_nonzero(owner >= 0))
