"""The law of clutter's amplitude, and the reference that it is learned from.

The law of the strength of clutter, learned from a reference of it.

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

References of the strength of clutter: detections of the last pings, and whether they are alike.

They are rows of one array, so that a ping costs a few operations, whatever the number of pings.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import kolmogorov

from tsepm_ros.numerics.arrays import FloatArray, IntArray

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


class Exponents(NamedTuple):
    """Exponents of values, (m,) each.

    Attributes
    ----------
    told : ndarray
        ``u = -ln P(z)``, at least 0, up to the law's reach.
    extrapolated : ndarray
        Mean of u over the tails, without an end: for a figure in dB. It is not the exponent of the
        mean exceedance, which evidence needs.
    """

    told: FloatArray
    extrapolated: FloatArray


@dataclass(frozen=True, eq=False)
class AmplitudeLaw:
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
    def of(cls, values: FloatArray, weights: FloatArray) -> AmplitudeLaw:
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
        # Strong ones of nearly no weight, as of targets, may be far beyond the others.
        bounded = np.minimum(excess, MAX_GROWTH / curvature[-1])
        sums = _hazard_sums(curvature[:, None], bounded) @ weight
        log_share = curvature * total - tail * np.log(sums)
        share = np.exp(log_share - log_share.max())
        return cls(values, at_least, begin, curvature, sums, share / share.sum(), float(tail))

    @property
    def count(self) -> float:
        """Weight of the reference, n."""
        return float(self.at_least[0])

    @cached_property
    def constant_share(self) -> float:
        """Share of the median value: that of the commonest, if it is more than a half."""
        half = np.searchsorted(-self.at_least[:-1], -0.5 * self.count, side="right") - 1
        median = self.values[max(int(half), 0)]
        first = int(np.searchsorted(self.values, median))
        beyond = int(np.searchsorted(self.values, median, side="right"))
        return float(self.at_least[first] - self.at_least[beyond]) / max(self.count, 1e-9)

    def quantile(self, share: float) -> float:
        """Value of the reference below which a share of it is, whatever the weights."""
        place = share * (len(self.values) - 1)
        left = min(int(place), len(self.values) - 2)
        low, high = self.values[max(left, 0)], self.values[left + 1]
        return float(low + (place - left) * (high - low))

    @property
    def reach(self) -> float:
        """The largest exponent that is told: all that is stronger counts as censored there."""
        return math.log1p(self.count) + REACH

    def exponents(self, values: FloatArray) -> Exponents:
        """Exponents of values (m,)."""
        rank = self.at_least[np.searchsorted(self.values, values)]
        share = (1.0 + rank) / (1.0 + self.count)
        rows = np.flatnonzero(values > self.begin) if len(self.curvature) else np.zeros(0, np.int64)
        if len(rows):
            tails = self._tail_exponents(values[rows])
            count = rank[rows]
            least = np.maximum(count - RANK_DEVIATIONS * np.sqrt(count), 0.0)
            thinned = (self.share @ np.exp(-tails)) * (1.0 + self.tail_count)
            share[rows] = np.maximum(thinned, least) / (1.0 + self.count)
        told = np.minimum(np.maximum(-np.log(np.maximum(share, 1e-300)), 0.0), self.reach)
        if not len(rows):
            return Exponents(told, told)
        extrapolated = told.copy()
        begin = -math.log((1.0 + self.tail_count) / (1.0 + self.count))
        extrapolated[rows] = np.maximum(told[rows], begin + self.share @ tails)
        return Exponents(told, extrapolated)

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


SMALLEST_P_VALUE = 0.001
"""Probability (Kolmogorov-Smirnov) below which two references are not of one law."""
MAX_PINGS = 64
"""Pings in the reference, at most ..."""
MAX_PER_PING = 64
"""... and detections of each."""
INDEX_BITS = 32
"""Bits of a reference's key below those of its scan."""

REFERENCE = np.dtype(
    [
        ("key", np.int64),  # of its scan and index there, see `keys_of`
        ("at", np.int64),  # place in the levels of places
        ("raw", np.float64),  # logarithm less the level of the place
        ("value", np.float64),  # less the level of the ping too
        ("by_range", np.float64),  # level of the range, part of that of the place
        ("place", np.float64),  # as the levels of places learned it, or nan
        ("weight", np.float64),  # probability to be of clutter
        ("position", np.complex128),  # x + i y, m
        ("strength", np.float64),  # as measured
    ]
)


def keys_of(scan: IntArray | int, index: IntArray) -> IntArray:
    """Keys of detections (n,), which ascend with the scan and with the index in it."""
    return np.asarray((np.asarray(scan, np.int64) << INDEX_BITS) + index)


class References:
    """The detections of the last pings, at most `MAX_PINGS`, as rows in one array.

    Attributes
    ----------
    levels : deque of float
        Level of each ping.
    """

    def __init__(self) -> None:
        self._buffer = np.zeros(2 * MAX_PINGS * MAX_PER_PING, REFERENCE)
        self._ends: deque[int] = deque([0])
        self.levels: deque[float] = deque()

    def __len__(self) -> int:
        """Number of pings."""
        return len(self.levels)

    @property
    def rows(self) -> NDArray[np.void]:
        """All references, by ping and index, (n,) of REFERENCE; changes of them are kept."""
        return self._buffer[self._ends[0] : self._ends[-1]]

    def last(self, pings: int) -> NDArray[np.void]:
        """References of the last pings, as `rows`."""
        return self._buffer[self._ends[-1 - min(pings, len(self))] : self._ends[-1]]

    def begins(self, pings: int) -> list[int]:
        """Places among `last` at which each of the last pings begins, in order."""
        ends = self._ends
        first = len(ends) - 1 - min(pings, len(self))
        return [ends[ping] - ends[first] for ping in range(first, len(ends) - 1)]

    def ages(self, places: IntArray) -> IntArray:
        """Pings after that of references at places among `rows`, (n,)."""
        ends = np.array(self._ends) - self._ends[0]
        return np.asarray(len(self) - np.searchsorted(ends, places, side="right"))

    def append(self, rows: NDArray[np.void], level: float) -> None:
        """Add a ping's references, of ascending keys; the oldest ping goes if there are too many.

        Parameters
        ----------
        rows : (n,) ndarray of REFERENCE
            From 1 to `MAX_PER_PING`.
        level : float
            Level of the ping.
        """
        if len(self) == MAX_PINGS:
            self.drop(1)
        if self._ends[-1] + len(rows) > len(self._buffer):
            first, kept = self._ends[0], self.rows.copy()
            self._buffer[: len(kept)] = kept
            self._ends = deque(end - first for end in self._ends)
        end = self._ends[-1] + len(rows)
        self._buffer[self._ends[-1] : end] = rows
        self._ends.append(end)
        self.levels.append(level)

    def drop(self, pings: int) -> None:
        """Drop the oldest pings."""
        for _ in range(pings):
            self._ends.popleft()
            self.levels.popleft()

    def relevel(self, before: float, level: float) -> None:
        """Give another level to the pings that have the level `before`."""
        for ping, (begin, end) in enumerate(pairwise(self._ends)):
            if self.levels[ping] == before:
                self.levels[ping] = level
                part = self._buffer[begin:end]
                part["value"] = part["raw"] - level


def of_one_law(one: FloatArray, other: FloatArray) -> bool:
    """Whether two samples may be of one law, by the test of Kolmogorov and Smirnov (asymptotic)."""
    both = np.concatenate([one, other])
    shares = [
        np.searchsorted(np.sort(sample), both, side="right") / len(sample)
        for sample in (one, other)
    ]
    distance = np.abs(shares[0] - shares[1]).max()
    size = len(one) * len(other) / len(both)
    return bool(kolmogorov(np.sqrt(size) * distance) >= SMALLEST_P_VALUE)


def of_one_shape(one: FloatArray, other: FloatArray) -> bool:
    """Whether two samples may be of one law but for their levels."""
    return of_one_law(one - np.median(one), other - np.median(other))
