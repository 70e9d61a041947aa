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
"""Sensors beside each other."""

import math

import numpy as np
import pytest

from tsepm_ros import ConfirmedTrack
from tsepm_ros.tracker.sensor_alignment import (
    Alignment,
    DoubledTargets,
    Sightings,
    misalignments,
)
from tsepm_ros.tracker.tracks import TrackArrays


def test_errors_are_at_least_those_that_another_sensors_tracks_show_and_unknown_shows_none():
    alignment, rng = Alignment(), np.random.default_rng(3)
    for _ in range(50):
        assert alignment.known or not alignment.least_steps.any()
        distances = rng.normal([[0.0], [0.02]], [[1.0], [0.001]], (2, 4))  # a wrong mounting
        variances = np.array([np.full(4, 2.0**2), np.full(4, 0.01**2)])
        alignment.update(distances, variances)
    # Half of the stated range errors, and twice those of the azimuth, are 4 steps of 2^(1/4).
    assert alignment.least_steps.tolist() == [-4, 4]


def tracks_at(*states: tuple[float, float, float, float], spread: float = 0.01) -> TrackArrays:
    """Tracks of states x, vx, y, vy, with a variance of their velocities, m^2/s^2."""
    covariance = np.diag([1.0, spread, 1.0, spread])
    return TrackArrays.from_tracks(
        [
            ConfirmedTrack(place, 0.0, np.array(state), covariance, (), 0.0)
            for place, state in enumerate(states)
        ]
    )


def sighting(x: float, y: float) -> Sightings:
    """Detection of the first track, from a sensor in the origin."""
    place = np.array([[x, y]])
    return Sightings(np.zeros(1, np.int64), place, place @ (1.0, 1j), np.zeros((1, 2)))


def test_a_vector_in_sight_is_a_distance_and_an_angle():
    # Seen at 100 m to the north: 3 m farther, and 2 m to the west, which is counter-clockwise.
    distance = sighting(0.0, 100.0).in_sight(np.array([[-2.0, 3.0]]))
    assert distance.tolist() == [[pytest.approx(3.0)], [pytest.approx(0.02)]]


@pytest.mark.parametrize(
    ("x", "y", "speed", "alike"),
    [
        (99.5, 9.98, 1.0, True),  # turned by 0.1 rad
        (97.0, 24.3, 1.0, False),  # by 0.245 rad
        (93.3, 9.36, 1.0, False),  # 6.7 m nearer, with a deviation of 1 m
        (94.5, 9.48, 1.0, True),  # 5 m nearer
        (99.5, 9.98, 2.0, False),  # another velocity
    ],
)
def test_a_track_beside_a_detection_is_as_far_away_turned_a_little_and_moves_alike(
    x, y, speed, alike
):
    tracks = tracks_at((100.0, 1.0, 0.0, 0.0), (x, speed, y, 0.0))
    found, turned = sighting(100.0, 0.0).beside_tracks(tracks, np.array([1]), np.ones(1))
    assert found.tolist() == [[alike]]
    if alike:
        assert turned[0, 0] == pytest.approx(-0.1, abs=0.01), "the detection is to the right"


def test_pairs_count_that_are_turned_as_the_sensor_is_known_to_be_or_as_another_pair_is():
    doubled, ids = DoubledTargets(), np.arange(6)
    pair, other = np.array([[0], [1]]), np.array([[2], [3]])

    def agree(pairs, *turned, known=math.nan):
        return doubled.agree(pairs, ids, np.array(turned), 0.01, known).tolist()

    assert agree(pair, 0.05) == [False], "a single pair may be two things"
    assert agree(pair, 0.05, known=0.06) == [True]
    assert agree(pair, 0.05, known=0.08) == [False]
    assert agree(np.hstack([pair, other]), 0.05, 0.06) == [True, True]
    assert agree(np.array([[0], [4]]), 0.055) == [True], "as that of 2 and 3"
    ids = np.array([0, 1, 5])
    assert agree(pair, 0.05) == [False], "the others have ended"
    # The turn of a pair is a mean that fades: 0.8 * 0.05 + 0.2 * 0.15.
    assert agree(pair, 0.15, known=0.07 - 0.0199) == [True]
    assert doubled.agree(pair, ids, np.array([0.07]), 0.01, 0.0901).tolist() == [False]


def test_what_lies_beside_the_others_is_half_the_difference_of_two_and_the_farthest_is_first():
    made = {name: Alignment() for name in ("a", "b", "c")}
    rng, variances = np.random.default_rng(1), np.full((2, 20), 1e-4)
    assert misalignments(made) == {}
    for turn, alignment in zip((0.02, 0.0, 0.0), made.values(), strict=True):
        for _ in range(10):
            alignment.update(rng.normal([[0.0], [turn]], 0.01, (2, 20)), variances)
    found = misalignments(made)
    assert next(iter(found)) == "a" and len(found) == 3
    assert found["a"].azimuth == pytest.approx(0.02, abs=0.003)
    assert found["b"].azimuth == pytest.approx(-0.01, abs=0.003)
    assert found["a"].sentence("a").startswith("a sees targets 1.")
    assert found["b"].sentence("b", 0.1).startswith("b sees targets 0.")
    assert misalignments({"a": made["a"], "d": Alignment()}) == {}, "beside nothing known"
