"""Confidence intervals of what studies report."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

Z_95 = 1.959963984540054
"""Two-sided 95 % quantile of the normal distribution."""


@dataclass(frozen=True)
class Estimate:
    """A figure with its two-sided 95 % confidence interval."""

    value: float
    low: float
    high: float

    def __format__(self, spec: str) -> str:
        """Format as ``value (low to high)``, each with `spec`."""
        return f"{self.value:{spec}} ({self.low:{spec}} to {self.high:{spec}})"


def proportion(successes: int, trials: int) -> Estimate:
    """Share of successes with Wilson's interval."""
    if trials == 0:
        return Estimate(math.nan, 0.0, 1.0)
    share = successes / trials
    z2 = Z_95**2 / trials
    centre = (share + z2 / 2) / (1 + z2)
    half = Z_95 * math.sqrt(share * (1 - share) / trials + z2 / (4 * trials)) / (1 + z2)
    return Estimate(share, max(centre - half, 0.0), min(centre + half, 1.0))


def mean(values: ArrayLike) -> Estimate:
    """Mean of independent values with the normal interval."""
    array = np.asarray(values, float)
    if len(array) == 0:
        return Estimate(math.nan, math.nan, math.nan)
    centre = float(array.mean())
    if len(array) == 1:
        return Estimate(centre, math.nan, math.nan)
    half = Z_95 * float(array.std(ddof=1)) / math.sqrt(len(array))
    return Estimate(centre, centre - half, centre + half)
