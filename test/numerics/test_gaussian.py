"""Covariances that rounding has left singular or not positive definite."""

import numpy as np
import pytest

from tsepm_ros.numerics.gaussian import inverse_covariance_or_nan, proper_covariance, solve
from tsepm_ros.studies.multiple_model import multiple_model_beyond_one


def ordinary(number: int, seed: int = 1) -> np.ndarray:
    """Covariances of positions (m) and velocities (m/s), strongly correlated."""
    factor = np.random.default_rng(seed).standard_normal((number, 4, 6))
    scale = np.array([150.0, 4.0, 90.0, 3.0])
    covariance = factor @ np.swapaxes(factor, 1, 2) * np.outer(scale, scale)
    return 0.5 * (covariance + np.swapaxes(covariance, 1, 2))


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
