"""States whose speed is limited: Gaussians conditioned on the velocity in the disc |v| <= v_max.

For a state x of mean m and covariance P, with the velocity v of mean m_v and covariance C::

    p      = P(|v| <= v_max)                      inside, under N(m_v, C)
    u, U   = mean and covariance of v given |v| <= v_max
    G      = P H' C^-1                            H picks the velocity
    m <- m + G (u - m_v),   P <- P + G (U - C) G'

(the conditional moments of a Gaussian of which a part is truncated, as in Simon, Simon,
"Constrained Kalman filtering via density function truncation for turbofan engine health
estimation", Int. J. Syst. Sci. 41(2), 2010, here of the disc and not of half-planes). The disc is
convex, so that the speed of the mean is at most v_max.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.special import log_ndtr

from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray
from tsepm_ros.numerics.gaussian import inverse
from tsepm_ros.sensing.conversion import major_sigma

MAX_OUTSIDE = 0.25
"""Probability of a velocity outside the disc up to which a state stays as it is.

The Gaussian with the moments of a truncated density has up to 0.22 outside again: a state that is
limited at every scan is limited once, unless detections move it outside.
"""
NEGLIGIBLE = 1e-9
"""Probability outside below which it counts as 0."""
NODES, WEIGHTS = np.polynomial.legendre.leggauss(40)
GRID = np.linspace(-1.0, 1.0, 21)
MIN_VARIANCE = 1e-18
"""Smallest variance of a velocity component, in v_max^2."""
MIN_RELATIVE_VARIANCE = 1e-10
"""Smallest variance that is left of a velocity component, as a part of that before."""
PASSES = 3
"""Times that the grid is narrowed to where the density is."""
LOG_DROP = 30.0
"""Logarithm of the factor below its maximum from which on the density does not count."""


class VelocityInDisc(NamedTuple):
    """Moments of velocities given that they are in the disc.

    Attributes
    ----------
    log_probability : (n,) ndarray
        Logarithm of the probability that they are.
    mean : (n, 2) ndarray
        m/s.
    covariance : (n, 2, 2) ndarray
        m^2/s^2.
    """

    log_probability: FloatArray
    mean: FloatArray
    covariance: FloatArray


def reaching_outside(
    state: FloatArray,
    covariance: FloatArray,
    max_speed: FloatArray | float,
    probability: float,
) -> IntArray:
    """Rows of states (n, 4) that may have more than a probability outside the disc.

    ``P(|v| > v_max) <= exp(-(v_max - |m_v|)^2 / (2 s^2))`` with the larger standard deviation s.
    """
    largest = major_sigma(covariance[:, 1::2, 1::2])
    margin = np.maximum(max_speed - np.hypot(state[:, 1], state[:, 3]), 0.0)
    return np.flatnonzero(margin < math.sqrt(-2.0 * math.log(probability)) * largest)


def log_probability(
    state: FloatArray, covariance: FloatArray, max_speed: FloatArray | float
) -> FloatArray:
    """Logarithm of the probability that the speed is at most v_max, (n,); 0 if negligibly less.

    Parameters
    ----------
    state, covariance : (n, 4), (n, 4, 4) ndarray
    max_speed : (n,) ndarray or float
        v_max, m/s.
    """
    result = np.zeros(len(state))
    rows = reaching_outside(state, covariance, max_speed, NEGLIGIBLE)
    if len(rows):
        radius = np.broadcast_to(max_speed, len(state))[rows]
        quadrature, _, _, _ = _quadrature(state[rows, 1::2], covariance[rows, 1::2, 1::2], radius)
        result[rows] = np.minimum(quadrature.log_integral, 0.0)
    return result


def limited(
    state: FloatArray, covariance: FloatArray, max_speed: FloatArray | float
) -> tuple[FloatArray, FloatArray]:
    """States conditioned on a speed of at most v_max; see the module.

    Those with a probability of at most `MAX_OUTSIDE` outside stay as they are, to the bit; also
    their mean is inside, for where the mean is not in a convex set, half of the probability is not.

    Parameters
    ----------
    state, covariance : (n, 4), (n, 4, 4) ndarray
    max_speed : (n,) ndarray or float
        v_max, m/s; infinite: the state stays.

    Returns
    -------
    state, covariance : (n, 4), (n, 4, 4) ndarray
    """
    rows = reaching_outside(state, covariance, max_speed, MAX_OUTSIDE)
    if not len(rows):
        return state, covariance
    velocity = _in_disc_of(rows, state, covariance, max_speed)
    cut = velocity.log_probability < math.log1p(-MAX_OUTSIDE)
    if not cut.any():
        return state, covariance
    velocity = VelocityInDisc(*(part[cut] for part in velocity))
    return _conditioned(state, covariance, rows[cut], velocity)


def slowed(
    state: FloatArray, covariance: FloatArray, max_speed: FloatArray | float
) -> tuple[FloatArray, FloatArray]:
    """As `limited`, but only states whose mean is faster than v_max."""
    rows = np.flatnonzero(np.hypot(state[:, 1], state[:, 3]) > max_speed)
    if not len(rows):
        return state, covariance
    velocity = _in_disc_of(rows, state, covariance, max_speed)
    return _conditioned(state, covariance, rows, velocity)


def _conditioned(
    state: FloatArray, covariance: FloatArray, rows: IntArray, velocity: VelocityInDisc
) -> tuple[FloatArray, FloatArray]:
    """The states, those in some rows with the moments of the velocity as given."""
    mean, spread = velocity.mean, velocity.covariance
    before = covariance[rows, 1::2, 1::2]
    gain = covariance[rows][:, :, 1::2] @ inverse(before)
    state, covariance = state.copy(), covariance.copy()
    state[rows] += (gain @ (mean - state[rows, 1::2])[..., None])[..., 0]
    state[rows, 1::2] = mean
    changed = covariance[rows] + gain @ (spread - before) @ np.swapaxes(gain, 1, 2)
    covariance[rows] = 0.5 * (changed + np.swapaxes(changed, 1, 2))
    return state, covariance


def _in_disc_of(
    rows: IntArray, state: FloatArray, covariance: FloatArray, max_speed: FloatArray | float
) -> VelocityInDisc:
    radius = np.broadcast_to(max_speed, len(state))[rows]
    return in_disc(state[rows, 1::2], covariance[rows, 1::2, 1::2], radius)


def in_disc(mean: FloatArray, covariance: FloatArray, radius: FloatArray) -> VelocityInDisc:
    """Probability and moments of Gaussians of two dimensions in a disc about the origin.

    Along the minor axis of the covariance in closed form (truncated Gaussian), along the major axis
    by Gauss-Legendre quadrature between the places where the density falls below its maximum by
    `LOG_DROP`: it is log-concave.

    Parameters
    ----------
    mean, covariance : (n, 2), (n, 2, 2) ndarray
    radius : (n,) ndarray
    """
    quadrature, axes, centre, deviation = _quadrature(mean, covariance, radius)
    chords, weight, scale = quadrature.chords, quadrature.weight, radius[:, None]
    minor, spread = _moments(chords, centre, deviation)
    weight = weight / weight.sum(axis=1)[:, None]
    points = np.stack([minor, quadrature.place], axis=-1)
    average = (weight[..., None] * points).sum(axis=1)
    apart = points - average[:, None]
    second = np.einsum("nk,nki,nkj->nij", weight, apart, apart)
    second[:, 0, 0] += (weight * spread).sum(axis=1)
    second[:, [0, 1], [0, 1]] += MIN_RELATIVE_VARIANCE * deviation**2  # positive definite
    average = np.einsum("nij,nj->ni", axes, average) * scale
    second = np.einsum("nij,njk,nlk->nil", axes, second, axes) * scale[..., None] ** 2
    return VelocityInDisc(np.minimum(quadrature.log_integral, 0.0), average, second)


class _Quadrature(NamedTuple):
    """Integral over the unit disc along the major axis.

    Attributes
    ----------
    log_integral : (n,) ndarray
    place : (n, k) ndarray
        On the major axis.
    chords : _Chords
        At these places.
    weight : (n, k) ndarray
        Of each chord, up to a factor.
    """

    log_integral: FloatArray
    place: FloatArray
    chords: _Chords
    weight: FloatArray


def _quadrature(
    mean: FloatArray, covariance: FloatArray, radius: FloatArray
) -> tuple[_Quadrature, FloatArray, FloatArray, FloatArray]:
    """The integral, and axes, centre and deviations of the Gaussian; see `in_disc`."""
    variance, axes = np.linalg.eigh(covariance)
    scale = radius[:, None]
    deviation = np.sqrt(np.maximum(variance / scale**2, MIN_VARIANCE))
    centre = np.einsum("nij,ni->nj", axes, mean) / scale
    # In the angle whose sine is the place on the major axis: the chords end smoothly.
    low, high = np.full(len(mean), -0.5 * np.pi), np.full(len(mean), 0.5 * np.pi)
    for _ in range(PASSES):
        angle = 0.5 * (low + high)[:, None] + 0.5 * (high - low)[:, None] * GRID
        density = _chords(np.sin(angle), centre, deviation).density
        counts = density >= density.max(axis=1, keepdims=True) - LOG_DROP
        first = np.maximum(counts.argmax(axis=1) - 1, 0)
        last = np.minimum(len(GRID) - counts[:, ::-1].argmax(axis=1), len(GRID) - 1)
        each = np.arange(len(mean))
        low, high = angle[each, first], angle[each, last]
    half = 0.5 * (high - low)
    angle = 0.5 * (low + high)[:, None] + half[:, None] * NODES
    place = np.sin(angle)
    chords = _chords(place, centre, deviation)
    peak = chords.density.max(axis=1)
    weight = np.exp(chords.density - peak[:, None]) * WEIGHTS * np.cos(angle)
    inside = peak + np.log(weight.sum(axis=1) * half)
    return _Quadrature(inside, place, chords, weight), axes, centre, deviation


class _Chords(NamedTuple):
    """Chords of the unit disc across places (n, k) on the major axis.

    Attributes
    ----------
    half : ndarray
        Half of the length.
    low, high : ndarray
        Ends in standard deviations, mirrored to the left of the mean.
    mirrored : ndarray of bool
    mass : ndarray
        Logarithm of the probability between the ends.
    density : ndarray
        Logarithm of the integral of the density along the chord.
    """

    half: FloatArray
    low: FloatArray
    high: FloatArray
    mirrored: BoolArray
    mass: FloatArray
    density: FloatArray


def _chords(place: FloatArray, centre: FloatArray, deviation: FloatArray) -> _Chords:
    """The chords across places (n, k) on the major axis."""
    chord = np.sqrt(np.maximum(1.0 - place**2, 1e-24))
    sigma, middle = deviation[:, :1], centre[:, :1]
    low, high = (-chord - middle) / sigma, (chord - middle) / sigma
    # The interval is mirrored to the left, where the distribution function keeps its digits.
    mirrored = low + high > 0.0
    low, high = np.where(mirrored, -high, low), np.where(mirrored, -low, high)
    upper = log_ndtr(high)
    mass = upper + np.log(-np.expm1(np.minimum(log_ndtr(low) - upper, -1e-300)))
    along = (place - centre[:, 1:]) / deviation[:, 1:]
    density = mass - 0.5 * along**2 - np.log(np.sqrt(2.0 * np.pi) * deviation[:, 1:])
    return _Chords(chord, low, high, mirrored, mass, density)


def _moments(
    chords: _Chords, centre: FloatArray, deviation: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Mean and variance on each chord, (n, k) each."""
    chord, low, high, mirrored, mass, _ = chords
    sigma, middle = deviation[:, :1], centre[:, :1]
    at_low = np.exp(-0.5 * low**2 - mass) / np.sqrt(2.0 * np.pi)
    at_high = np.exp(-0.5 * high**2 - mass) / np.sqrt(2.0 * np.pi)
    shift = np.clip(at_low - at_high, low, high)
    variance = 1.0 + low * at_low - high * at_high - shift**2
    variance = np.clip(variance, 0.0, np.minimum(1.0, 0.25 * (high - low) ** 2))
    mean = np.where(mirrored, -shift, shift) * sigma + middle
    return np.clip(mean, -chord, chord), variance * sigma**2
