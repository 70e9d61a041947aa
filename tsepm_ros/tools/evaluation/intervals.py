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
"""Confidence intervals of estimates."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import gammaincinv
from scipy.stats import binomtest

from tsepm_ros.numerics.arrays import FloatArray

Z_95 = 1.959963984540054
"""Two-sided 95 % quantile of the normal distribution."""
TAILS, TAILS_90 = (0.025, 0.975), (0.05, 0.95)
"""Of the two-sided 95 % interval, and of that of 90 %, whose ends are one-sided 95 % bounds."""
RESAMPLES = 1000
"""Resamples of a bootstrap; their seed is fixed, so that results repeat."""


@dataclass(frozen=True)
class IntervalEstimate:
    """A value with its two-sided 95 % confidence interval."""

    value: float
    low: float
    high: float

    @classmethod
    def unknown(cls) -> IntervalEstimate:
        """No value and no interval."""
        return cls(math.nan, math.nan, math.nan)

    def mapped(self, function: Callable[[float], float]) -> IntervalEstimate:
        """An increasing function of the value and of the interval's ends."""
        return IntervalEstimate(function(self.value), function(self.low), function(self.high))

    def __truediv__(self, unit: float) -> IntervalEstimate:
        """The estimate in a unit above 0."""
        return self.mapped(lambda value: value / unit)

    def __format__(self, spec: str) -> str:
        """Format as ``value (low to high)``, each with `spec`."""
        return f"{self.value:{spec}} ({self.low:{spec}} to {self.high:{spec}})"

    def __sub__(self, other: IntervalEstimate) -> IntervalEstimate:
        """The difference from an estimate of other runs; of the same runs its interval is too wide.

        Zou, Donner, "Construction of confidence limits about effect measures", Statistics in
        Medicine 27, 2008.
        """
        value = self.value - other.value
        low = math.hypot(self.value - self.low, other.high - other.value)
        high = math.hypot(self.high - self.value, other.value - other.low)
        return IntervalEstimate(value, value - low, value + high)

    def text(self, spec: str) -> str:
        """Format as with `format`, or as a dash without a value."""
        return "-" if math.isnan(self.value) else f"{self:{spec}}"


def interval_error_bars(values: ArrayLike, estimates: Sequence[IntervalEstimate]) -> FloatArray:
    """Lengths of the error bars below and above values, (2, n); 0 without an interval."""
    low, high = np.array([(estimate.low, estimate.high) for estimate in estimates]).T
    return np.maximum(np.nan_to_num([values - low, high - values]), 0.0)


def proportion_interval(successes: int, trials: int) -> IntervalEstimate:
    """Proportion of successes with Wilson's interval."""
    if trials == 0:
        return IntervalEstimate(math.nan, 0.0, 1.0)
    interval = binomtest(successes, trials).proportion_ci(0.95, method="wilson")
    return IntervalEstimate(successes / trials, float(interval.low), float(interval.high))


def mean_interval(values: ArrayLike) -> IntervalEstimate:
    """Mean of independent values with the normal interval."""
    array = np.asarray(values, float)
    if len(array) == 0:
        return IntervalEstimate.unknown()
    centre = float(array.mean())
    deviation = float(array.std(ddof=1)) if len(array) > 1 else math.nan
    half = Z_95 * deviation / math.sqrt(len(array))
    return IntervalEstimate(centre, centre - half, centre + half)


def mean_count_interval(counts: ArrayLike, tails: tuple[float, float] = TAILS) -> IntervalEstimate:
    """Mean of independent counts with the exact Poisson interval, widened by their dispersion.

    Garwood's interval ("Fiducial limits for the Poisson distribution", Biometrika 28, 1936) of the
    sum divided by phi, times phi: the variance over the mean of the counts, at least 1. Without an
    event in r runs the upper end is 3.7 / r per run.
    """
    array = np.asarray(counts, float)
    if len(array) == 0:
        return IntervalEstimate.unknown()
    total, r = float(array.sum()), len(array)
    dispersion = 1.0
    if r > 1 and total > 0.0:
        dispersion = max(float(array.var(ddof=1)) * r / total, 1.0)
    events, scale = total / dispersion, dispersion / r
    low = float(gammaincinv(events, tails[0])) if events > 0.0 else 0.0
    return IntervalEstimate(
        total / r, scale * low, scale * float(gammaincinv(events + 1.0, tails[1]))
    )


def root_mean_square_interval(values: ArrayLike) -> IntervalEstimate:
    """Root mean square with the root of the mean square's interval, whose ends are at least 0."""
    square = mean_interval(np.square(np.asarray(values, float)))
    return square.mapped(lambda value: math.sqrt(max(value, 0.0)))


def ratio_interval(parts: ArrayLike, wholes: ArrayLike) -> IntervalEstimate:
    """Sum of the parts over the sum of the wholes of independent runs, by the delta method."""
    part, whole = np.asarray(parts, float), np.asarray(wholes, float)
    if not whole.sum() > 0.0:
        return IntervalEstimate.unknown()
    ratio = float(part.sum() / whole.sum())
    return mean_interval(ratio + (part - ratio * whole) / whole.mean())


def rms_ratio_interval(errors: ArrayLike, bounds: ArrayLike) -> IntervalEstimate:
    """Ratio of the root mean squares of errors and of their bounds, pair by pair.

    Its interval is that of the logarithm, by the delta method.
    """
    e2, b2 = np.square(np.asarray(errors, float)), np.square(np.asarray(bounds, float))
    if len(e2) == 0:
        return IntervalEstimate.unknown()
    ratio = math.sqrt(e2.mean() / b2.mean())
    if len(e2) == 1 or not ratio > 0.0:
        return IntervalEstimate(ratio, math.nan, math.nan)
    deviation = np.std(e2 / e2.mean() - b2 / b2.mean(), ddof=1)
    factor = math.exp(0.5 * Z_95 * deviation / math.sqrt(len(e2)))
    return IntervalEstimate(ratio, ratio / factor, ratio * factor)


def quantile_interval(values: ArrayLike, share: float) -> IntervalEstimate:
    """Quantile of independent values with the percentile interval of a bootstrap."""
    array = np.asarray(values, float)
    if len(array) == 0:
        return IntervalEstimate.unknown()
    rows = np.random.default_rng(0).integers(0, len(array), (RESAMPLES, len(array)))
    low, high = np.quantile(np.quantile(array[rows], share, axis=1), TAILS)
    return IntervalEstimate(float(np.quantile(array, share)), float(low), float(high))
