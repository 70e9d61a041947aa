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
"""Motion: Kalman filtering, a limited speed, and turns.

States are ``[x, vx, y, vy]``; motion is nearly constant velocity, with the transition matrix of
TSEPM 2018, Eq. 17, and white acceleration of a spectral density q (Bar-Shalom, Li, Kirubarajan,
"Estimation with Applications to Tracking and Navigation", 2001, section 6.2.2).

A limited speed is a Gaussian conditioned on the velocity in the disc |v| <= v_max. For a state x of
mean m and covariance P, with the velocity v of mean m_v and covariance C::

    p      = P(|v| <= v_max)                      inside, under N(m_v, C)
    u, U   = mean and covariance of v given |v| <= v_max
    G      = P H' C^-1                            H picks the velocity
    m <- m + G (u - m_v),   P <- P + G (U - C) G'

(the conditional moments of a Gaussian of which a part is truncated, as in Simon, Simon,
"Constrained Kalman filtering via density function truncation for turbofan engine health
estimation", Int. J. Syst. Sci. 41(2), 2010, here of the disc and not of half-planes). The disc is
convex, so that the speed of the mean is at most v_max.

Confirmed targets move at constant velocity, interrupted by turns: interacting multiple models
(Blom, Bar-Shalom, "The interacting multiple model algorithm for systems with Markovian switching
coefficients", IEEE Trans. Autom. Control 33(8), 1988): a target is in one of two modes, each with
its own state and covariance. A manoeuvre during missed detections therefore stays possible: the
covariance of the turning mode grows until a detection excludes the turn.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import log_ndtr

from tsepm_ros.numerics import gaussian
from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray, RecordArray, Rows, rows_of
from tsepm_ros.numerics.discs import NODES, WEIGHTS
from tsepm_ros.tracker import range_rates
from tsepm_ros.tracker.measurement import covariance_at, major_sigma
from tsepm_ros.tracker.sensor import SensorModel

_CONSTANT, _LINEAR, _SQUARE = np.zeros((3, 4, 4))
_CONSTANT[[1, 3], [1, 3]] = 1.0
_LINEAR[[0, 1, 2, 3], [1, 0, 3, 2]] = 1.0 / 2.0
_SQUARE[[0, 2], [0, 2]] = 1.0 / 3.0
"""Coefficients of `process_noise`, as a polynomial of the time."""
MAX_OUTSIDE_PROBABILITY = 0.25
"""Probability of a velocity outside the disc up to which a state stays as it is.

The Gaussian with the moments of a truncated density has up to 0.22 outside again: a state that is
limited at every scan is limited once, unless detections move it outside.
"""
NEGLIGIBLE_PROBABILITY = 1e-9
"""Probability outside below which it counts as 0."""
GRID = np.linspace(-1.0, 1.0, 21)
MIN_VARIANCE = 1e-18
"""Smallest variance of a velocity component, in v_max^2."""
MIN_RELATIVE_VARIANCE = 1e-10
"""Smallest variance that is left of a velocity component, as a part of that before."""
GRID_PASSES = 3
"""Times that the grid is narrowed to where the density is."""
LOG_DROP = 30.0
"""Logarithm of the factor below its maximum from which on the density does not count."""
MIN_STEP = 1.0
"""Time for which a scan counts at most, s: what happens after a mean number of scans happens after
so many seconds where they are faster. A choice."""
SCANS_TO_TURN = 30.0
"""Mean number of scans between turns or changes of speed: a choice."""
TURN_PERSISTENCE = 0.5
"""Probability that a turn goes on at the next scan: a choice."""
TURN_TIME = 5.0
"""Least time in which a target of any speed has turned, s."""
MIN_MODE_PROBABILITY = 1e-30
"""Floor of a mode's probability, which keeps its state defined."""


def steps_of(elapsed: FloatArray | float) -> FloatArray:
    """Scans for which the times between scans (...), s, count: 1, or less of fast scans."""
    return np.minimum(np.abs(elapsed) / MIN_STEP, 1.0)


def predict(
    state: FloatArray,
    covariance: FloatArray,
    elapsed: FloatArray | float,
    noise: FloatArray | float = 0.0,
) -> tuple[FloatArray, FloatArray]:
    """Predict states over a time interval: ``F x``, ``F P F' + Q``.

    Parameters
    ----------
    state : (..., 4) ndarray
        m, m/s.
    covariance : (..., 4, 4) ndarray
    elapsed : (...) ndarray or float
        Interval of each, s; of either sign.
    noise : (...) ndarray or float
        q, m^2/s^3: the variance of each velocity component grows by q per second.

    Returns
    -------
    state : (..., 4) ndarray
    covariance : (..., 4, 4) ndarray
    """
    elapsed = np.asarray(elapsed, float)
    state, covariance = state.copy(), covariance.copy()
    step = elapsed[..., None]
    state[..., 0::2] += step * state[..., 1::2]
    # Views by axis; long rows are faster.
    rows = covariance.reshape(*covariance.shape[:-2], 2, 2, 4)
    rows[..., 0, :] += step[..., None] * rows[..., 1, :]
    columns = covariance.reshape(*covariance.shape[:-2], 8, 2)
    columns[..., 0] += step * columns[..., 1]
    noise = np.asarray(noise, float)
    if noise.any():
        covariance += process_noise(elapsed, np.abs(elapsed) * noise)
    return state, covariance


def process_noise(elapsed: FloatArray, velocity_variance: FloatArray) -> FloatArray:
    """Covariance Q (..., 4, 4) of white acceleration over times (...), s.

    ``v [[t^2 / 3, t / 2], [t / 2, 1]]`` for each axis, with the variance v (...) that it adds to
    each velocity, m^2/s^2.
    """
    t = elapsed[..., None, None]
    return np.asarray(
        (t * (t * _SQUARE + _LINEAR) + _CONSTANT) * velocity_variance[..., None, None]
    )


def position_after(state: FloatArray, time_after_state: FloatArray | float) -> FloatArray:
    """Position ``H x`` (..., 2), m, of states (..., 4) after times that broadcast, s."""
    return np.asarray(state[..., 0::2] + np.asarray(time_after_state)[..., None] * state[..., 1::2])


def position_covariance_after(covariance: FloatArray, time_after_state: FloatArray) -> FloatArray:
    """Position covariance ``H P H'`` a short time after the state's, without process noise.

    Parameters
    ----------
    covariance : (..., 4, 4) ndarray
    time_after_state : ndarray
        Of a shape that broadcasts, s.

    Returns
    -------
    (..., 2, 2) ndarray
        m^2.
    """
    if not time_after_state.any():
        return covariance[..., 0::2, 0::2].copy()
    t = time_after_state[..., None, None]
    cross = covariance[..., 0::2, 1::2]
    return (
        covariance[..., 0::2, 0::2]
        + t * (cross + np.swapaxes(cross, -1, -2))
        + t * t * covariance[..., 1::2, 1::2]
    )


def innovations(
    state: FloatArray,
    covariance: FloatArray,
    time_after_state: FloatArray,
    detections: RecordArray,
    sensor: SensorModel,
) -> tuple[FloatArray, FloatArray]:
    """Innovations of detections and their covariances: ``z - H x``, ``H P H' + R(H x)``.

    Parameters
    ----------
    state : (n, 4) ndarray
    covariance : (n, 4, 4) ndarray
    time_after_state : (n,) ndarray
        Time of each detection after its state's, s.
    detections : (n,) ndarray of DETECTION
    sensor : SensorModel
        Range errors of detections without their own.

    Returns
    -------
    innovation : (n, 2) ndarray
        m.
    innovation_covariance : (n, 2, 2) ndarray
        S, m^2.
    """
    expected = state[:, 0::2] + time_after_state[:, None] * state[:, 1::2]
    innovation_covariance = position_covariance_after(covariance, time_after_state)
    innovation_covariance += covariance_at(detections, expected, sensor)
    return detections["position"] - expected, innovation_covariance


def update(
    state: FloatArray,
    covariance: FloatArray,
    time_after_state: FloatArray,
    innovation: FloatArray,
    innovation_covariance: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Update states with positions measured after the states' times.

    ``K = P H' S^-1``, ``x + K (z - H x)``, ``P - K S K'``, ``H = [[1, t, 0, 0], [0, 0, 1, t]]``

    Parameters
    ----------
    state : (n, 4) ndarray
    covariance : (n, 4, 4) ndarray
    time_after_state : (n,) ndarray
        s.
    innovation : (n, 2) ndarray
        ``z - H x``, m.
    innovation_covariance : (n, 2, 2) ndarray
        S, m^2.

    Returns
    -------
    state : (n, 4) ndarray
    covariance : (n, 4, 4) ndarray
    """
    gain = kalman_gain(covariance, time_after_state, innovation_covariance)
    state = state + (gain @ innovation[..., None])[..., 0]
    narrowed = covariance - gain @ innovation_covariance @ np.swapaxes(gain, -1, -2)
    # What rounding leaves unsymmetric grows from update to update: thousands would end it.
    return state, 0.5 * (narrowed + np.swapaxes(narrowed, -1, -2))


def kalman_gain(
    covariance: FloatArray, time_after_state: FloatArray, innovation_covariance: FloatArray
) -> FloatArray:
    """Kalman gain ``K = P H' S^-1``, (..., 4, 2), for arguments as in `update`."""
    cross = covariance[..., 0::2]
    if time_after_state.any():
        cross = cross + time_after_state[..., None, None] * covariance[..., 1::2]
    return np.asarray(cross @ gaussian.inverse_covariance(innovation_covariance))


def log_likelihood(
    state: FloatArray,
    covariance: FloatArray,
    owner: IntArray,
    stamp: float,
    innovation: FloatArray,
    innovation_covariance: FloatArray,
    detections: RecordArray,
    row: IntArray,
    gate_probability: float,
) -> FloatArray:
    """Log of the likelihood of pairs of states and detections; -inf outside the gates.

    ``ln N(d; 0, S) + ln N(e; 0, S_e)`` with the innovation e of a measured range rate against the
    state updated with the position. The innovations are independent: their squared Mahalanobis
    distances add up, and the gate of a position and a range rate has three dimensions.

    Parameters
    ----------
    state : (n, 4) ndarray
    covariance : (n, 4, 4) ndarray
    owner : (...) ndarray of int
        State of each pair.
    stamp : float
        The states', s.
    innovation : (..., 2) ndarray
        Innovation of each position, m.
    innovation_covariance : (..., 2, 2) ndarray
        m^2; without range rates of a shape that broadcasts.
    detections : (d,) ndarray of DETECTION
    row : (...) ndarray of int
        Detection of each pair.
    gate_probability : float
        Probability that the gate holds a target's detection.

    Returns
    -------
    (...) ndarray
        ln of 1/m^2, or of s/m^3.
    """
    density, distance = gaussian.log_density(innovation, innovation_covariance)
    gate: FloatArray | float = gaussian.gate_factor(gate_probability) ** 2
    measured = range_rates.measured(detections)
    if measured.any():
        gate = np.where(measured[row], range_rates.gate_square(gate_probability), gate)
        rows = (measured[row] & (distance <= gate)).nonzero()
        rated, candidates = owner[rows], rows_of(detections, row[rows])
        after = candidates["time"] - stamp
        updated = update(
            state[rated], covariance[rated], after, innovation[rows], innovation_covariance[rows]
        )
        error, variance, _ = range_rates.innovations(*updated, after, candidates)
        density[rows] += range_rates.log_density(error, variance)
        distance[rows] += error**2 / variance
    return np.where(distance <= gate, density, -np.inf)


def gate_reach(gate_probability: float, rated: bool) -> float:
    """Standard deviations of a position's innovation that the gate of `log_likelihood` reaches.

    With or without range rates.
    """
    if rated:
        return math.sqrt(range_rates.gate_square(gate_probability))
    return gaussian.gate_factor(gate_probability)


def beyond_max_speed(
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
    return (margin < math.sqrt(-2.0 * math.log(probability)) * largest).nonzero()[0]


def log_speed_probability(
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
    rows = beyond_max_speed(state, covariance, max_speed, NEGLIGIBLE_PROBABILITY)
    if len(rows):
        radius = np.broadcast_to(max_speed, len(state))[rows]
        result[rows] = _quadrature(state[rows, 1::2], covariance[rows, 1::2, 1::2], radius)[0]
    return result


def limited(
    state: FloatArray, covariance: FloatArray, max_speed: FloatArray | float
) -> tuple[FloatArray, FloatArray]:
    """States conditioned on a speed of at most v_max; see the module.

    Those with a probability of at most `MAX_OUTSIDE_PROBABILITY` outside stay as they are, to the
    bit; also their mean is inside, for where the mean is not in a convex set, half of the
    probability is not.

    Parameters
    ----------
    state, covariance : (n, 4), (n, 4, 4) ndarray
    max_speed : (n,) ndarray or float
        v_max, m/s; infinite: the state stays.

    Returns
    -------
    state, covariance : (n, 4), (n, 4, 4) ndarray
    """
    rows = beyond_max_speed(state, covariance, max_speed, MAX_OUTSIDE_PROBABILITY)
    return _conditioned(state, covariance, rows, max_speed, math.log1p(-MAX_OUTSIDE_PROBABILITY))


def slowed(
    state: FloatArray, covariance: FloatArray, max_speed: FloatArray | float
) -> tuple[FloatArray, FloatArray]:
    """As `limited`, but only states whose mean is faster than v_max."""
    rows = (np.hypot(state[:, 1], state[:, 3]) > max_speed).nonzero()[0]
    return _conditioned(state, covariance, rows, max_speed, math.inf)


def _conditioned(
    state: FloatArray,
    covariance: FloatArray,
    rows: IntArray,
    max_speed: FloatArray | float,
    limit: float,
) -> tuple[FloatArray, FloatArray]:
    """The states; those of the rows whose log-probability inside is below a limit, conditioned."""
    if not len(rows):
        return state, covariance
    radius = np.broadcast_to(max_speed, len(state))[rows]
    inside, mean, spread = moments_in_disc(state[rows, 1::2], covariance[rows, 1::2, 1::2], radius)
    cut = inside < limit
    if not cut.any():
        return state, covariance
    rows, mean, spread = rows[cut], mean[cut], spread[cut]
    before = covariance[rows, 1::2, 1::2]
    gain = covariance[rows][:, :, 1::2] @ gaussian.inverse_covariance(before)
    state, covariance = state.copy(), covariance.copy()
    state[rows] += (gain @ (mean - state[rows, 1::2])[..., None])[..., 0]
    state[rows, 1::2] = mean
    updated = covariance[rows] + gain @ (spread - before) @ np.swapaxes(gain, 1, 2)
    covariance[rows] = 0.5 * (updated + np.swapaxes(updated, 1, 2))
    return state, covariance


def moments_in_disc(
    mean: FloatArray, covariance: FloatArray, radius: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Probability and moments of Gaussians of two dimensions in a disc about the origin.

    Along the minor axis of the covariance in closed form (truncated Gaussian), along the major axis
    by Gauss-Legendre quadrature between the places where the density falls below its maximum by
    `LOG_DROP`: it is log-concave.

    Parameters
    ----------
    mean, covariance : (n, 2), (n, 2, 2) ndarray
    radius : (n,) ndarray

    Returns
    -------
    log_probability : (n,) ndarray
        Logarithm of the probability of the disc.
    mean, covariance : (n, 2), (n, 2, 2) ndarray
        Given that they are in the disc.
    """
    inside, offset, weight, chords, (axes, centre, deviation) = _quadrature(
        mean, covariance, radius
    )
    minor, spread = _chord_moments(chords, centre, deviation)
    scale = radius[:, None]
    weight = weight / weight.sum(axis=1)[:, None]
    points = np.stack([minor, offset], axis=-1)
    average = (weight[..., None] * points).sum(axis=1)
    apart = points - average[:, None]
    second = np.einsum("nk,nki,nkj->nij", weight, apart, apart)
    second[:, 0, 0] += (weight * spread).sum(axis=1)
    second[:, [0, 1], [0, 1]] += MIN_RELATIVE_VARIANCE * deviation**2  # positive definite
    average = np.einsum("nij,nj->ni", axes, average) * scale
    second = np.einsum("nij,njk,nlk->nil", axes, second, axes) * scale[..., None] ** 2
    return inside, average, second


def _quadrature(
    mean: FloatArray, covariance: FloatArray, radius: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, _Chords, tuple[FloatArray, ...]]:
    """The integral over the unit disc along the major axis; see `moments_in_disc`.

    Returns
    -------
    log_integral : (n,) ndarray
    place : (n, k) ndarray
        On the major axis.
    weight : (n, k) ndarray
        Of the chord at each place, up to a factor.
    chords : _Chords
        At these places.
    gaussian : tuple of ndarray
        Axes, centre and deviations, in units of the radius.
    """
    variance, axes = np.linalg.eigh(covariance)
    scale = radius[:, None]
    deviation = np.sqrt(np.maximum(variance / scale**2, MIN_VARIANCE))
    centre = np.einsum("nij,ni->nj", axes, mean) / scale
    # In the angle whose sine is the place on the major axis: the chords end smoothly.
    low, high = np.full(len(mean), -0.5 * np.pi), np.full(len(mean), 0.5 * np.pi)
    for _ in range(GRID_PASSES):
        angle = 0.5 * (low + high)[:, None] + 0.5 * (high - low)[:, None] * GRID
        density, _ = _chords_at(np.sin(angle), centre, deviation)
        counts = density >= density.max(axis=1, keepdims=True) - LOG_DROP
        first = np.maximum(counts.argmax(axis=1) - 1, 0)
        last = np.minimum(len(GRID) - counts[:, ::-1].argmax(axis=1), len(GRID) - 1)
        each = np.arange(len(mean))
        low, high = angle[each, first], angle[each, last]
    half = 0.5 * (high - low)
    angle = 0.5 * (low + high)[:, None] + half[:, None] * NODES
    offset = np.sin(angle)
    density, chords = _chords_at(offset, centre, deviation)
    peak = density.max(axis=1)
    weight = np.exp(density - peak[:, None]) * WEIGHTS * np.cos(angle)
    inside = np.minimum(peak + np.log(weight.sum(axis=1) * half), 0.0)
    return inside, offset, weight, chords, (axes, centre, deviation)


_Chords = tuple[FloatArray, FloatArray, FloatArray, BoolArray, FloatArray]
"""Of chords (n, k) of the unit disc: half of the length; low and high end in standard deviations,
mirrored to the left of the mean; whether they are; logarithm of the probability between them."""


def _chords_at(
    offset: FloatArray, centre: FloatArray, deviation: FloatArray
) -> tuple[FloatArray, _Chords]:
    """Log of the integrals of the density along chords across places (n, k) on the major axis."""
    chord = np.sqrt(np.maximum(1.0 - offset**2, 1e-24))
    sigma, middle = deviation[:, :1], centre[:, :1]
    low, high = (-chord - middle) / sigma, (chord - middle) / sigma
    # The interval is mirrored to the left, where the distribution function keeps its digits.
    mirrored = low + high > 0.0
    low, high = np.where(mirrored, -high, low), np.where(mirrored, -low, high)
    upper = log_ndtr(high)
    mass = upper + np.log(-np.expm1(np.minimum(log_ndtr(low) - upper, -1e-300)))
    along = (offset - centre[:, 1:]) / deviation[:, 1:]
    density = mass - 0.5 * along**2 - np.log(np.sqrt(2.0 * np.pi) * deviation[:, 1:])
    return density, (chord, low, high, mirrored, mass)


def _chord_moments(
    chords: _Chords, centre: FloatArray, deviation: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Mean and variance on each chord, (n, k) each."""
    chord, low, high, mirrored, mass = chords
    sigma, middle = deviation[:, :1], centre[:, :1]
    at_low = np.exp(-0.5 * low**2 - mass) / np.sqrt(2.0 * np.pi)
    at_high = np.exp(-0.5 * high**2 - mass) / np.sqrt(2.0 * np.pi)
    shift = np.clip(at_low - at_high, low, high)
    variance = 1.0 + low * at_low - high * at_high - shift**2
    variance = np.clip(variance, 0.0, np.minimum(1.0, 0.25 * (high - low) ** 2))
    mean = np.where(mirrored, -shift, shift) * sigma + middle
    return np.clip(mean, -chord, chord), variance * sigma**2


@dataclass(frozen=True, eq=False)
class InteractingModels(Rows):
    """States of tracks in the two modes: constant velocity and turning.

    Attributes
    ----------
    probability : (n, 2) ndarray
        Probability of each mode.
    state, covariance : (n, 2, 4), (n, 2, 4, 4) ndarray
        State and its covariance in each mode.
    """

    probability: FloatArray
    state: FloatArray
    covariance: FloatArray

    @classmethod
    def from_states(cls, state: FloatArray, covariance: FloatArray) -> InteractingModels:
        """Tracks with states (n, 4), covariances (n, 4, 4) and stationary mode probabilities."""
        turning = 1.0 / (1.0 + SCANS_TO_TURN * (1.0 - TURN_PERSISTENCE))
        probability = np.array([[1.0 - turning, turning]]).repeat(len(state), axis=0)
        return cls(
            probability, np.stack([state, state], axis=1), np.stack([covariance] * 2, axis=1)
        )

    def predicted(
        self, elapsed: FloatArray, max_speed: float, process_noise: float
    ) -> InteractingModels:
        """Predict the tracks to the next scan, over times (n,), s, of either sign.

        Between turns the acceleration has the spectral density `process_noise`, m^2/s^3.

        The states are mixed by the probabilities p_ij of a change from mode i to mode j::

            mu_j <- sum_i p_ij mu_i,    x_j <- sum_i p_ij mu_i x_i / mu_j

        and predicted. A turn begins with ``1 / SCANS_TO_TURN`` and goes on with `TURN_PERSISTENCE`,
        in `steps_of` the time. It ends at an unknown velocity of at most v_max: the variance of
        each component grows by v_max^2 / 4 over `TURN_TIME`.
        """
        steps = steps_of(elapsed)
        begun, ended = steps / SCANS_TO_TURN, steps * (1.0 - TURN_PERSISTENCE)
        change = np.array([[1.0 - begun, begun], [ended, 1.0 - ended]]).swapaxes(1, 2)
        joint = change * np.maximum(self.probability, MIN_MODE_PROBABILITY).T[..., None]
        probability = joint.sum(axis=0)
        # Of the second mode; the spread of two alternatives is w (1 - w) d d'.
        share = (joint[1] / probability)[..., None]
        apart, first = self.state[:, 1:] - self.state[:, :1], self.covariance[:, :1]
        spread = (1.0 - share)[..., None] * (apart[..., None] * apart[:, :, None])
        mixed = (
            self.state[:, :1] + share * apart,
            first + share[..., None] * (self.covariance[:, 1:] - first + spread),
        )
        noise = process_noise + np.array([0.0, (0.5 * max_speed) ** 2]) / np.maximum(
            np.abs(elapsed[:, None]), TURN_TIME
        )
        return InteractingModels(probability, *predict(*mixed, elapsed[:, None], noise))
