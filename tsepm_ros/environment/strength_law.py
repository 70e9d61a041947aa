"""The law of the strength of clutter, learned from a reference of it.

The body goes by ranks, with ties as at least as strong: ``P(z) = (1 + number >= z) / (1 + n)``. The
k strongest determine a smooth tail. Its hazard rises exponentially with the logarithm z of the
strength (Gompertz's law), over the excess y = z - t over the tail's begin t::

    P(z) = P(t) exp(-a (exp(b y) - 1) / b)

b = 0 is a Pareto law of the strength; its exponential law, Weibull's laws (also the tail of a K
distribution), and in good approximation the log-normal law have larger b. Both parameters are
integrated over: a with the prior 1 / a, which gives a closed form, b over a grid::

    P(z) = P(t) sum_b p(b | y) (1 + E_b(y) / sum_i E_b(y_i))^-k,   E_b(y) = (exp(b y) - 1) / b
    p(b | y) ~ p(b) exp(b sum_i y_i) (sum_i E_b(y_i))^-k

Decibels are logarithms already: the family is the same for them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tsepm_ros.numerics.arrays import FloatArray

MIN_REFERENCES = 20
"""Clutter detections without which nothing is said of a strength."""
TAIL_COUNT = 4.0
"""The tail holds this times the square root of the reference's count ..."""
MAX_TAIL_SHARE = 0.5
"""... and at most this share of it."""
CURVATURES = np.array([-0.2, 0.0, 0.1, 0.2, 0.35, 0.5, 0.75, 1.0, 1.5, 2.0])
"""b times the mean excess."""
MAX_GROWTH = 30.0
"""Largest logarithm of a hazard's growth over the tail: no overflow."""
REACH = 2.0
"""The exponent is at most ln(1 + n) and this."""
RANK_DEVIATIONS = 2.0
"""The tail is no thinner than the ranks allow, with so many standard deviations of their count."""


@dataclass(frozen=True, eq=False)
class StrengthLaw:
    """The law of clutter's strength.

    Attributes
    ----------
    values : (n,) ndarray
        The reference, ascending: logarithms of strengths.
    at_least : (n + 1,) ndarray
        Weight of the reference from each value on; 0 at the end.
    begin : float
        t.
    curvature, sums, share : (b,) ndarray
        b, sum_i E_b(y_i), and p(b | y).
    tail_count : float
        k.
    """

    values: FloatArray
    at_least: FloatArray
    begin: float
    curvature: FloatArray
    sums: FloatArray
    share: FloatArray
    tail_count: float

    @classmethod
    def of(cls, values: FloatArray, weights: FloatArray) -> StrengthLaw:
        """The law of a reference.

        Parameters
        ----------
        values, weights : (n,) ndarray
            Logarithms of strengths, and the probability that each is of clutter.
        """
        order = np.argsort(values, kind="stable")
        values, weights = values[order], weights[order]
        at_least = np.append(np.cumsum(weights[::-1])[::-1], 0.0)
        count = float(at_least[0])
        wanted = min(TAIL_COUNT * math.sqrt(count), MAX_TAIL_SHARE * count)
        # The first of its ties: a value is in the tail with all that equal it, or not.
        first = max(int(np.searchsorted(-at_least[:-1], -wanted, side="right")) - 1, 0)
        first = int(np.searchsorted(values, values[first]))
        begin, tail = float(values[first]), at_least[first]
        excess, weight = values[first:] - begin, weights[first:]
        total = float(excess @ weight)
        if total <= 0.0:
            none = np.zeros(0)
            return cls(values, at_least, begin, none, none, none, float(tail))
        curvature = CURVATURES * tail / total
        sums = _hazard_sums(curvature[:, None], excess) @ weight
        log_share = curvature * total - tail * np.log(sums)
        share = np.exp(log_share - log_share.max())
        return cls(values, at_least, begin, curvature, sums, share / share.sum(), float(tail))

    @property
    def count(self) -> float:
        """Weight of the reference, n."""
        return float(self.at_least[0])

    @property
    def reach(self) -> float:
        """The largest exponent that is told: all that is stronger counts as censored there."""
        return math.log1p(self.count) + REACH

    def exponent(self, values: FloatArray) -> FloatArray:
        """``u = -ln P(z)`` of values (m,), at least 0."""
        rank = self.at_least[np.searchsorted(self.values, values)]
        share = (1.0 + rank) / (1.0 + self.count)
        if len(self.curvature):
            rows = np.flatnonzero(values > self.begin)
            thinned = self.share @ np.exp(-self._tail_exponents(values[rows]))
            count = rank[rows]
            least = np.maximum(count - RANK_DEVIATIONS * np.sqrt(count), 0.0)
            tail = np.maximum(thinned * (1.0 + self.tail_count), least) / (1.0 + self.count)
            share[rows] = tail
        with np.errstate(divide="ignore"):
            exponent = -np.log(share)
        return np.asarray(np.clip(exponent, 0.0, self.reach))

    def extrapolated(self, values: FloatArray) -> FloatArray:
        """Mean exponent of values (m,) over the tails, without an end: for a figure in dB.

        It is not the exponent of the mean exceedance, which evidence needs.
        """
        exponent = self.exponent(values)
        rows = np.flatnonzero(values > self.begin)
        if len(self.curvature) and len(rows):
            begin = -math.log((1.0 + self.tail_count) / (1.0 + self.count))
            beyond = begin + self.share @ self._tail_exponents(values[rows])
            exponent[rows] = np.maximum(exponent[rows], beyond)
        return exponent

    def _tail_exponents(self, values: FloatArray) -> FloatArray:
        """Exponent over that of the tail's begin of values beyond it (m,), for each b, (b, m)."""
        excess = np.minimum(values - self.begin, MAX_GROWTH / abs(self.curvature[-1]))
        grown = _hazard_sums(self.curvature[:, None], excess) / self.sums[:, None]
        return np.asarray(self.tail_count * np.log1p(grown))


def _hazard_sums(curvature: FloatArray, excess: FloatArray) -> FloatArray:
    """E_b(y), by b (b, 1) and y (n,)."""
    flat = curvature == 0.0
    some = np.where(flat, 1.0, curvature)
    return np.asarray(np.where(flat, excess, np.expm1(some * excess) / some))
