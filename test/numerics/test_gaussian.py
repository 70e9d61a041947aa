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
"""Closed forms against general ones; covariances that rounding has left singular or indefinite."""

import numpy as np
import pytest
from scipy.stats import chi2, multivariate_normal

from tsepm_ros.numerics import gaussian
from tsepm_ros.numerics.gaussian import (
    gate_factor,
    inverse_covariance,
    inverse_covariance_or_nan,
    is_significant,
    mixture,
    proper_covariance,
    solve,
    squared_mahalanobis_distance,
)
from tsepm_ros.studies.multiple_model import multiple_model_beyond_one


def ordinary(number: int, seed: int = 1) -> np.ndarray:
    """Covariances of positions (m) and velocities (m/s), strongly correlated."""
    factor = np.random.default_rng(seed).standard_normal((number, 4, 6))
    scale = np.array([150.0, 4.0, 90.0, 3.0])
    covariance = factor @ np.swapaxes(factor, 1, 2) * np.outer(scale, scale)
    return 0.5 * (covariance + np.swapaxes(covariance, 1, 2))


def test_distances_densities_and_gates_are_those_of_the_general_formulas():
    rng = np.random.default_rng(2)
    difference, covariance = 100.0 * rng.standard_normal((40, 2)), ordinary(40)[:, 0::2, 0::2]
    distance = squared_mahalanobis_distance(difference, covariance)
    density, same = gaussian.log_density(difference, covariance)
    for d, c, square, log in zip(difference, covariance, distance, density, strict=True):
        assert square == pytest.approx(d @ np.linalg.inv(c) @ d)
        assert log == pytest.approx(multivariate_normal(cov=c).logpdf(d))
    np.testing.assert_array_equal(same, distance)
    skewed = covariance + rng.standard_normal((40, 2, 2))
    np.testing.assert_allclose(inverse_covariance(skewed), np.linalg.inv(skewed))
    for probability in (0.5, 0.9, 0.999):
        assert gate_factor(probability) ** 2 == pytest.approx(chi2(2).ppf(probability))
    edge = np.array([np.sqrt(chi2(2).ppf(0.999)), 0.0])
    for share, significant in ((1.01, True), (0.99, False)):
        found = is_significant(share * np.array([5.0, 3.0]) * edge, np.diag([25.0, 9.0]))
        assert bool(found) is significant


def test_a_mixture_has_the_moments_of_its_parts():
    rng = np.random.default_rng(3)
    weights = rng.dirichlet(np.ones(3), 5).T
    states, covariances = 10.0 * rng.standard_normal((3, 5, 4)), ordinary(15).reshape(3, 5, 4, 4)
    state, covariance = mixture(weights, states, covariances)
    for row in range(5):
        mean = sum(w * x for w, x in zip(weights[:, row], states[:, row], strict=True))
        second = sum(
            w * (p + np.outer(x, x))
            for w, x, p in zip(weights[:, row], states[:, row], covariances[:, row], strict=True)
        )
        np.testing.assert_allclose(state[row], mean)
        np.testing.assert_allclose(covariance[row], second - np.outer(mean, mean), atol=1e-9)


def test_a_proper_covariance_is_returned_as_it_is():
    covariance = ordinary(50)
    assert proper_covariance(covariance) is covariance
    assert not multiple_model_beyond_one(covariance).any()


@pytest.mark.parametrize("correlation", [1.0, 1.0026, 1.5, -1.1])
def test_a_correlation_beyond_one_is_repaired_and_its_neighbours_are_kept(correlation):
    covariance = ordinary(3)
    before = covariance.copy()
    sigma = np.sqrt(covariance[1].diagonal())
    covariance[1, 0, 1] = covariance[1, 1, 0] = correlation * sigma[0] * sigma[1]
    assert multiple_model_beyond_one(covariance).tolist() == [False, True, False]
    repaired = proper_covariance(covariance)
    np.linalg.cholesky(repaired)
    assert (repaired == np.swapaxes(repaired, 1, 2)).all()
    assert (repaired[[0, 2]] == before[[0, 2]]).all()
    assert (repaired[1].diagonal() >= covariance[1].diagonal() * (1 - 1e-6)).all()


@pytest.mark.parametrize("scale", [1e-12, 1.0, 1e15])
def test_a_singular_covariance_is_made_definite_without_a_change_of_its_size(scale):
    axes = np.array([3.0, 1e-3, -2.0, 1e-4])
    singular = scale * np.outer(axes, axes)[None]
    repaired = proper_covariance(singular)
    np.linalg.cholesky(repaired)
    assert repaired == pytest.approx(singular, rel=1e-6)


def test_no_variance_stays_at_zero_or_below():
    covariance = np.diag([100.0, -1e-20, 0.0, 4.0])[None]
    repaired = proper_covariance(covariance)
    np.linalg.cholesky(repaired)
    assert repaired[0].diagonal() == pytest.approx([100.0, 0.0, 0.0, 4.0], abs=1e-6)


def test_what_is_not_finite_is_kept():
    covariance = np.full((2, 4, 4), np.nan)
    covariance[1] = np.ones((4, 4))
    repaired = proper_covariance(covariance)
    assert np.isnan(repaired[0]).all()
    np.linalg.cholesky(repaired[1])
    assert len(proper_covariance(np.zeros((0, 4, 4)))) == 0


def test_an_inverse_of_singular_matrices_is_nan_and_that_of_others_is_not():
    covariance = ordinary(2)
    covariance[0] = 0.0
    inverted = inverse_covariance_or_nan(covariance)
    assert np.isnan(inverted[0]).all()
    assert inverted[1] @ covariance[1] == pytest.approx(np.eye(4), abs=1e-9)


def test_a_singular_covariance_can_be_solved_for():
    difference = np.array([[1.0, 0.0, 0.0, 0.0]] * 2)
    covariance = np.array([np.ones((4, 4)), np.eye(4)])
    with pytest.raises(np.linalg.LinAlgError):
        np.linalg.solve(covariance, difference[..., None])
    solved = solve(covariance, difference)
    assert solved[1] == pytest.approx([1.0, 0.0, 0.0, 0.0])
    assert difference[0] @ solved[0] > 1e6, "the states are far apart in that direction"
