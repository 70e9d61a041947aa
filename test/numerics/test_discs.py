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
"""Pairs within discs, against all distances, and the share of a Gaussian in a disc."""

import math

import numpy as np
import pytest
from scipy.integrate import dblquad
from scipy.stats import multivariate_normal, ncx2

from tsepm_ros.numerics.discs import (
    ALL_PAIRS,
    disc_probability,
    pairs_within_disc,
    pairs_within_discs,
)


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
    found = pairs_within_discs(positions, centres, radius, 10**6)
    np.testing.assert_array_equal(found, expected)
    assert len(found[0])
    assert pairs_within_discs(positions, centres, radius, len(found[0]) - 1) is None


@pytest.mark.parametrize("number", [5, 300])
def test_pairs_between_are_those_of_a_loop_in_their_order(number):
    rng = np.random.default_rng(6)
    positions, centres = rng.uniform(0.0, 100.0, (number, 2)), rng.uniform(0.0, 100.0, (20, 2))
    expected = [
        (i, j)
        for i in range(len(centres))
        for j in range(number)
        if np.hypot(*(positions[j] - centres[i])) <= 30.0
    ]
    row, other = pairs_within_disc(centres, positions, 30.0)
    assert list(zip(row.tolist(), other.tolist(), strict=True)) == expected
    assert expected and not len(pairs_within_disc(centres[:0], positions, 30.0)[0])


@pytest.mark.parametrize("sigma", [0.01, 0.3, 3.0, 100.0])
@pytest.mark.parametrize("away", [0.0, 0.7, 1.0, 4.0])
def test_for_a_circle_it_is_that_of_a_noncentral_chi_square(sigma, away):
    mean = away * np.array([[math.cos(1.0), math.sin(1.0)]])
    found = disc_probability(mean, sigma**2 * np.eye(2)[None], 1.0)
    expected = ncx2.cdf(1.0 / sigma**2, 2, (away / sigma) ** 2)
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-12)


@pytest.mark.parametrize("correlation", [-0.99, 0.0, 0.7])
@pytest.mark.parametrize("mean", [(0.0, 0.0), (0.8, -0.5), (2.0, 1.5)])
def test_for_an_ellipse_it_is_the_integral(correlation, mean):
    cross = correlation * 0.2 * 1.5
    covariance = np.array([[0.04, cross], [cross, 2.25]])
    density = multivariate_normal(mean, covariance).pdf

    def chord(x):
        return math.sqrt(max(1.0 - x * x, 0.0))

    expected, _ = dblquad(lambda y, x: density([x, y]), -1, 1, lambda x: -chord(x), chord)
    found = disc_probability(np.array([mean]), covariance[None], 1.0)
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-9)


def test_no_disc_and_no_rows_have_nothing():
    assert disc_probability(np.zeros((2, 2)), np.tile(np.eye(2), (2, 1, 1)), 0.0).tolist() == [0, 0]
    assert disc_probability(np.zeros((0, 2)), np.zeros((0, 2, 2)), 1.0).shape == (0,)
