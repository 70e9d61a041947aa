"""Probability of a disc under a Gaussian."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import dblquad
from scipy.stats import multivariate_normal, ncx2

from tsepm_ros.numerics.discs import disc_probability


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


def test_a_thin_ellipse_within_the_disc_has_everything():
    covariance = np.diag([1e-8, 0.01])[None]
    np.testing.assert_allclose(disc_probability(np.zeros((1, 2)), covariance, 5.0), 1.0, rtol=1e-9)


def test_no_disc_and_no_rows_have_nothing():
    assert disc_probability(np.zeros((2, 2)), np.tile(np.eye(2), (2, 1, 1)), 0.0).tolist() == [0, 0]
    assert disc_probability(np.zeros((0, 2)), np.zeros((0, 2, 2)), 1.0).shape == (0,)
