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
"""Whether targets stand still: the evidence of all their detections, for every confirmed track.

A target stands still, or moves slower than `min_speed`, or moves at up to v_max. The prior density
of its velocity v has a part for each::

    share / 2                 v = 0
    share / 2                 uniform on |v| < min_speed
    1 - share                 uniform on min_speed <= |v| <= r, with r = v_max, v_max / 2, ...

Without `min_speed` the first part has the whole share. The last part is a mixture of discs (see
`SPEED_SHARES`): its density falls with speed, nearly as that of a uniform speed and course does, so
that a v_max far above a target's speed hardly delays its track.

A constant velocity is fitted to the hits of a target's start and to all its later detections. Up to
a factor, the likelihood of v is the density of the fitted velocity, ``N(v; v^, P_v)``, which gives
the posterior probability that the target stands still. This evidence grows with every ping.

The fit hardly forgets, so that slow motion shows. A fixed echo that moves off leaves its fit
behind; the confirmed track follows it, since its filter allows for manoeuvres. With Lambda the
likelihood ratio of a scan, target against none (see `data_association`), of the filter and of the
fit, the odds that the motion has changed are (Shiryaev 1963)::

    o <- (o + 1 - exp(-t / TIME_TO_CHANGE)) Lambda_filter
         / ((1 - GLITCH_SHARE) Lambda_fit + GLITCH_SHARE Lambda_filter)

A single scan, however far off its detection is, multiplies them by at most 1 / GLITCH_SHARE. At
`MAX_CHANGE_ODDS` the fit begins again with the filter's state.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.special import softmax

from tsepm_ros.numerics import gaussian
from tsepm_ros.numerics.arrays import BoolArray, FloatArray, Rows, replaced
from tsepm_ros.numerics.discs import disc_probability
from tsepm_ros.numerics.gaussian import is_significant
from tsepm_ros.tracker import motion
from tsepm_ros.tracker.options import CommonOptions

STATIONARY_SHARE = 0.2
"""Prior share of starts that stand still, with the weight of `PRIOR_TRACKS` tracks: a choice."""
PRIOR_TRACKS = 5.0
SHARES = (np.arange(100) + 0.5) / 100.0
"""Shares of targets that stand still, over which is summed."""
CHANGED_SHARE = 0.1
"""The same after a change of motion: a choice."""
CERTAIN_DEVIATIONS = 12.0
"""Deviations from `min_speed` from which on a velocity up to v_max is certain: beyond, 1e-25."""
SPEED_SHARES = 0.5, 0.25, 0.125, 0.125
"""Prior shares, among moving targets, of those of at most v_max, v_max / 2, v_max / 4, ...

Limits below twice `min_speed` are left out. A choice.
"""
PROCESS_NOISE, TIME_TO_MIN_SPEED = 1e-4, 400.0
"""Spectral density of the acceleration in the fit, m^2/s^3: 0.1 m/s per 100 s, and `min_speed` per
400 s at most, so that slower speeds show."""
TIME_TO_CHANGE = 1e4
"""Mean time after which the motion of a target changes, s: a choice."""
GLITCH_SHARE = 0.02
"""Probability that the error of a detection is not as the fit expects: a choice."""
MAX_CHANGE_ODDS = 9.0
"""Odds of a change of motion from which the fit begins again."""


def stationary_probability(
    options: CommonOptions,
    state: FloatArray,
    covariance: FloatArray,
    share: FloatArray | float,
) -> FloatArray:
    """Probability that targets stand still or are slower than `min_speed`, (n,).

    Where a velocity is certain (`CERTAIN_DEVIATIONS`) it is 0, without the integrals.

    Parameters
    ----------
    options : CommonOptions
        With `min_speed` and `max_speed`.
    state, covariance : (n, 4), (n, 4, 4) ndarray
        Fitted without any knowledge of the velocity but the detections.
    share : (n,) ndarray or float
        Prior share of targets that stand still.
    """
    velocity, spread = state[:, 1::2], covariance[:, 1::2, 1::2]
    speed = np.hypot(velocity[:, 0], velocity[:, 1])
    # The trace is at least the variance along any axis; not a number is not certain.
    deviation = np.sqrt(np.maximum(spread[:, 0, 0] + spread[:, 1, 1], 0.0))
    moves = speed - options.min_speed > CERTAIN_DEVIATIONS * deviation
    moves &= (deviation > 0.0) & (speed <= options.max_speed)
    probability = np.zeros(len(velocity))
    doubtful = np.flatnonzero(~moves)
    if len(doubtful):
        share = np.broadcast_to(share, len(velocity))[doubtful]
        probability[doubtful] = _integrated(options, velocity[doubtful], spread[doubtful], share)
    return probability


def _integrated(
    options: CommonOptions, velocity: FloatArray, spread: FloatArray, share: FloatArray
) -> FloatArray:
    """`stationary_probability` of velocities (n, 2) with covariances (n, 2, 2)."""
    usable = np.isfinite(np.concatenate([velocity[:, None], spread], axis=1)).all(axis=(1, 2))
    velocity = np.where(usable[:, None], velocity, 0.0)
    spread = np.where(usable[:, None, None], spread, np.eye(2) * options.max_speed**2)
    still, min_speed = np.exp(gaussian.log_density(velocity, spread)[0]), options.min_speed
    shares, limits = _speed_limits(min_speed, options.max_speed)
    slow, *inside = disc_probability(velocity, spread, np.append(min_speed, limits))
    density = shares / (math.pi * (limits**2 - min_speed**2))
    fast = density @ np.maximum(np.array(inside) - slow, 0.0)
    if min_speed:
        still = 0.5 * (still + slow / (math.pi * min_speed**2))
    still = share * still
    fast = np.maximum((1.0 - share) * fast, np.finfo(float).tiny)
    return np.asarray(still / (still + fast))


@lru_cache
def _speed_limits(min_speed: float, max_speed: float) -> tuple[FloatArray, FloatArray]:
    """Prior shares of moving targets, and the speeds that each does not exceed, m/s."""
    limits = max_speed / 2.0 ** np.arange(len(SPEED_SHARES), dtype=float)
    limits = limits[: max(int((limits >= 2.0 * min_speed).sum()), 1)]
    shares = SPEED_SHARES[: len(limits)]
    return np.array(shares) / sum(shares), limits


@dataclass(frozen=True, eq=False)
class StraightFits(Rows):
    """Fits of constant velocity to all detections of targets, a row each.

    Attributes
    ----------
    state, covariance : (n, 4), (n, 4, 4) ndarray
    change_odds : (n,) ndarray
        Odds that the motion has changed since the fit began.
    share : (n,) ndarray
        Prior probability that the target stood still when the fit began.
    """

    state: FloatArray
    covariance: FloatArray
    change_odds: FloatArray
    share: FloatArray

    @classmethod
    def from_states(
        cls, state: FloatArray, covariance: FloatArray, share: float = STATIONARY_SHARE
    ) -> StraightFits:
        """Fits that begin with states (n, 4) and covariances (n, 4, 4)."""
        return cls(state, covariance, np.zeros(len(state)), np.full(len(state), share))

    def predicted(self, elapsed: FloatArray, min_speed: float = 0.0) -> StraightFits:
        """The fits after times (n,), s, of either sign."""
        state, covariance = motion.predict(
            self.state,
            self.covariance,
            elapsed,
            min(PROCESS_NOISE, (min_speed or math.inf) ** 2 / TIME_TO_MIN_SPEED),
        )
        begun = -np.expm1(-np.abs(elapsed) / TIME_TO_CHANGE)
        return replaced(
            self, state=state, covariance=covariance, change_odds=self.change_odds + begun
        )

    @property
    def moves(self) -> BoolArray:
        """Whether the velocity of each fit differs from 0, (n,); see `is_significant`."""
        return is_significant(self.state[:, 1::2], self.covariance[:, 1::2, 1::2])

    def stationary_probability(self, options: CommonOptions, existence: FloatArray) -> FloatArray:
        """Probability that the targets stand still or are slower than `min_speed`, (n,).

        How many stand still depends on the place. The prior share s of those whose motion has not
        changed has a Beta density of the mean `STATIONARY_SHARE`, which all that exist sharpen (n
        tracks of probabilities r_i, with p_i at even odds)::

            p(s) ~ s^(w share_0 - 1) (1 - s)^(w (1 - share_0) - 1)
                   prod_i (1 - r_i + r_i (s p_i + (1 - s) (1 - p_i)))

        Those whose r_i is not known (nan) do not count.
        """
        even = stationary_probability(options, self.state, self.covariance, 0.5)[:, None]
        new = self.share == STATIONARY_SHARE
        weight = np.where(new & (existence > 0.0), existence, 0.0)[:, None]
        share = np.where(new[:, None], SHARES, self.share[:, None])
        still, moves = share * even, (1.0 - share) * (1.0 - even)
        prior = np.log(SHARES) * (PRIOR_TRACKS * STATIONARY_SHARE - 1.0)
        prior += np.log1p(-SHARES) * (PRIOR_TRACKS * (1.0 - STATIONARY_SHARE) - 1.0)
        own = np.log1p(weight * (still + moves - 1.0))
        of_others = softmax(prior + own.sum(axis=0) - own, axis=1)
        still, moves = (of_others * still).sum(axis=1), (of_others * moves).sum(axis=1)
        return np.asarray(still / (still + moves))

    def places(self) -> tuple[FloatArray, FloatArray]:
        """States and covariances of the targets, given that they stand still.

        The position is ``x - P_xv P_v^-1 v`` with the covariance ``P_x - P_xv P_v^-1 P_vx``; the
        velocity is 0, with the fit's covariance.

        Returns
        -------
        state : (n, 4) ndarray
        covariance : (n, 4, 4) ndarray
        """
        cross = self.covariance[:, 0::2, 1::2]
        spread = self.covariance[:, 1::2, 1::2]
        gain = np.swapaxes(np.linalg.solve(spread, np.swapaxes(cross, 1, 2)), 1, 2)
        state, covariance = np.zeros_like(self.state), np.zeros_like(self.covariance)
        state[:, 0::2] = self.state[:, 0::2] - (gain @ self.state[:, 1::2, None])[..., 0]
        position = self.covariance[:, 0::2, 0::2] - gain @ np.swapaxes(cross, 1, 2)
        covariance[:, 0::2, 0::2] = 0.5 * (position + np.swapaxes(position, 1, 2))
        covariance[:, 1::2, 1::2] = spread
        return state, covariance


def change_odds(odds: FloatArray, of_filter: FloatArray, of_fit: FloatArray) -> FloatArray:
    """Odds (n,) that motions have changed, after a scan: of Lambda_filter and Lambda_fit, (n,)."""
    return np.asarray(odds * of_filter / ((1.0 - GLITCH_SHARE) * of_fit + GLITCH_SHARE * of_filter))
