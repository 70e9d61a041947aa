"""What neighbouring clutter has in common beside the levels of its ping and place: a texture.

Paths of clutter lie within a neighbourhood. Where its strengths are alike, a path of strong clutter
is as likely as a single strong detection. The rank correlation of neighbours that cannot be one
target's gives the N of `target_strength`: those of one ping, and those of two pings that are too
far apart. A target has no part in it, however strong.
"""

from __future__ import annotations

import math

import numpy as np

from tsepm_ros.environment.strength_law import StrengthLaw
from tsepm_ros.environment.strength_reference import References
from tsepm_ros.numerics.arrays import FloatArray

LAGS = 3
"""Pings before whose detections are neighbours too."""
MEMORY = 50
"""Time constant, in pings, with which the correlation fades."""
DEVIATIONS = 2.0
"""Standard deviations of the correlation that do not count."""
MIN_PAIRS = 20
"""Pairs without which nothing is known."""
LARGEST_CORRELATION = 0.95
"""Largest rank correlation that counts."""


class Texture:
    """Learns the rank correlation of neighbouring clutter."""

    def __init__(self) -> None:
        self._products = self._count = 0.0

    @property
    def doubt(self) -> float:
        """1 / N, 0 for independent strengths.

        Kendall's correlation of Clayton's copula is ``1 / (1 + 2 N)``, and two thirds of Spearman's
        if that is small.
        """
        if self._count < MIN_PAIRS:
            return 0.0
        spearman = self._products / self._count - DEVIATIONS / math.sqrt(self._count)
        kendall = 2.0 / 3.0 * min(max(spearman, 0.0), LARGEST_CORRELATION)
        return 2.0 * kendall / (1.0 - kendall)

    def update(
        self,
        law: StrengthLaw,
        references: References,
        near: float,
        reach: FloatArray,
    ) -> None:
        """Learn from the last ping.

        Parameters
        ----------
        law : StrengthLaw
            Of the pings before it.
        references : References
            With the last ping.
        near : float
            Distance within which detections are neighbours, m.
        reach : (LAGS + 1,) ndarray
            Distance within which two detections may be one target's, in pings so far apart, m.
        """
        keep = 1.0 - 1.0 / MEMORY
        rows, begins = references.last(LAGS + 1), references.begins(LAGS + 1)
        own, position = begins[-1], rows["position"]
        least = np.zeros(len(rows))
        for lag, begin in zip(range(len(begins) - 1, 0, -1), begins, strict=False):
            least[begin:own] = reach[lag] ** 2
        # A ping has few references: all distances are cheaper than a tree.
        apart = position[own:, None] - position
        square = apart.real**2 + apart.imag**2
        one, two = np.nonzero((square < near**2) & (square > least))
        weight = rows["weight"]
        pairs = weight[own:][one] * weight[two]
        pairs[two >= own] *= 0.5  # each pair of the last ping is there twice
        rank = _uniform(law, rows["value"])
        self._products = keep * self._products + float(pairs @ (rank[own:][one] * rank[two]))
        self._count = keep * self._count + float(pairs.sum())


def _uniform(law: StrengthLaw, value: FloatArray) -> FloatArray:
    """Ranks of values (n,), scaled to mean 0 and variance 1."""
    share = law.at_least[np.searchsorted(law.values, value)] / law.count
    return np.asarray(math.sqrt(12.0) * (0.5 - share))
