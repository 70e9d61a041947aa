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
"""The law of clutter's amplitude, and what it makes of the echoes of a target.

The law is learned from a reference of clutter. The body goes by ranks, with ties as at least as
strong: ``P(z) = (1 + number >= z) / (1 + n)``. The k strongest determine a smooth tail. Its hazard
rises exponentially with the logarithm z of the amplitude (Gompertz's law), over the excess y = z -
t over the tail's begin t::

    P(z) = P(t) exp(-a (exp(b y) - 1) / b)

b = 0 is a Pareto law of the amplitude; its exponential law, Weibull's laws (also the tail of a K
distribution), and in good approximation the log-normal law have larger b. Both parameters are
integrated over: a with the prior 1 / a, which gives a closed form, b over a grid::

    P(z) = P(t) sum_b p(b | y) (1 + E_b(y) / sum_i E_b(y_i))^-k,   E_b(y) = (exp(b y) - 1) / b
    p(b | y) ~ p(b) exp(b sum_i y_i) (sum_i E_b(y_i))^-k

Decibels are logarithms already: the family is the same for them.

The amplitudes of a target's echoes give a likelihood ratio along a path. For clutter u = -ln
P(clutter is at least as strong) is exponential of mean 1, whatever the unit and the law. A
fluctuating target (Swerling I) with the signal-to-clutter ratio r is exponential of mean 1 + r. The
ratio is unknown, and the same along a path, so that the number n of a path's hits and the sum S of
their u are sufficient::

    L(n, S) = sum_k w_k (1 + r_k)^-n exp(S r_k / (1 + r_k))

with the prior w_k. The law of clutter is learned, and an error of it is common to the hits of a
path. It counts as an unknown scale of the u, which as many samples of clutter as N determine: with
the predictive density of all hits together (Lomax, of which the copula is Clayton's) ::

    v = N (exp(u / N) - 1),  V = sum v
    L(n, V) = sum_k w_k (1 + r_k)^-n ((1 + V / N) / (1 + V / (N (1 + r_k))))^(N + n)

which is the above for N to infinity. Its expectation in clutter is 1, over the scale too: that of
the product of the ratios of single hits would be larger. A level that is common to the clutter of a
neighbourhood (texture) acts as a smaller N.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray

MIN_REFERENCES = 20
"""Detections of clutter, or pairs of them, without which nothing is said of clutter."""
TAIL_COUNT, MAX_TAIL_SHARE = 4.0, 0.5
"""The tail holds the first times the square root of the reference's count, and at most the second
as a share of it."""
CURVATURES = np.array([-0.2, 0.0, 0.1, 0.2, 0.35, 0.5, 0.75, 1.0, 1.5, 2.0])
"""b times the mean excess."""
MAX_GROWTH = 30.0
"""Largest logarithm of a hazard's growth over the tail: no overflow."""
NORMALISED_REACH = 2.0
"""The normalised amplitude is at most ln(1 + n) and this."""
RANK_DEVIATIONS = 2.0
"""The tail is no thinner than the ranks allow, with so many standard deviations of their count."""
RATIOS_DB = np.arange(-5.0, 12.6, 2.5)
"""Signal-to-clutter ratios of the prior, which is uniform over them, dB.

The normalised amplitudes of stronger targets end where those of the strongest do: the law is not
known there.
"""
NO_SIGNAL_PROBABILITY = 0.4
"""Prior probability that the target is no stronger than clutter, r = 0."""
COUNT_STEP = 0.1
"""N goes in steps of this part, so that similar scans share a table."""
FIGURES_DB = np.arange(-5.0, 40.1, 1.0)
"""Ratios that may be published, dB."""
_ONE_MORE = 1.0 + 10.0 ** (FIGURES_DB[:, None] / 10.0)
_LOG_ONE_MORE, _OF_ONE_MORE = np.log(_ONE_MORE), 1.0 / _ONE_MORE
KNOWN_LAW_COUNT = 1e6
"""N with which the law of clutter is as good as known."""
GRID_END, GRID_POINTS = 4000.0, 320
"""End of the table's grid of V, and its points."""


@dataclass(frozen=True, eq=False)
class AmplitudeLaw:
    """The law of clutter's amplitude.

    Attributes
    ----------
    values : (n,) ndarray
        The reference, ascending: logarithms of amplitudes.
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
    def from_values(cls, values: FloatArray, weights: FloatArray) -> AmplitudeLaw:
        """The law of a reference.

        Parameters
        ----------
        values, weights : (n,) ndarray
            Logarithms of amplitudes, and the probability that each is of clutter.
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
        last = len(self.values) - 1
        return float(np.interp(share * last, np.arange(last + 1), self.values))

    @property
    def reach(self) -> float:
        """The largest normalised amplitude: all that is stronger counts as censored there."""
        return math.log1p(self.count) + NORMALISED_REACH

    def normalised(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Normalised amplitudes of values (m,).

        Returns
        -------
        told : (m,) ndarray
            ``u = -ln P(z)``, at least 0, up to the law's reach.
        extrapolated : (m,) ndarray
            Mean of u over the tails, without an end: for a figure in dB. It is not the normalised
            amplitude of the mean exceedance, which evidence needs.
        """
        rank = self.at_least[np.searchsorted(self.values, values)]
        share = (1.0 + rank) / (1.0 + self.count)
        rows = np.flatnonzero(values > self.begin) if len(self.curvature) else np.zeros(0, np.int64)
        if len(rows):
            # Above the tail's begin, for each b, (b, m).
            excess = np.minimum(values[rows] - self.begin, MAX_GROWTH / abs(self.curvature[-1]))
            grown = _hazard_sums(self.curvature[:, None], excess) / self.sums[:, None]
            tails = self.tail_count * np.log1p(grown)
            count = rank[rows]
            least = np.maximum(count - RANK_DEVIATIONS * np.sqrt(count), 0.0)
            thinned = (self.share @ np.exp(-tails)) * (1.0 + self.tail_count)
            share[rows] = np.maximum(thinned, least) / (1.0 + self.count)
        told = np.minimum(np.maximum(-np.log(np.maximum(share, 1e-300)), 0.0), self.reach)
        if not len(rows):
            return told, told
        extrapolated = told.copy()
        begin = -math.log((1.0 + self.tail_count) / (1.0 + self.count))
        extrapolated[rows] = np.maximum(told[rows], begin + self.share @ tails)
        return told, extrapolated


def _hazard_sums(curvature: FloatArray, excess: FloatArray) -> FloatArray:
    """E_b(y), by b (b, 1) and y (n,)."""
    flat = curvature == 0.0
    some = np.where(flat, 1.0, curvature)
    return np.asarray(np.where(flat, excess, np.expm1(some * excess) / some))


def prior() -> tuple[FloatArray, FloatArray]:
    """Ratios r_k, linear, and their prior probabilities w_k; the first is 0."""
    ratios = np.append(0.0, 10.0 ** (RATIOS_DB / 10.0))
    weights = np.full(len(ratios), (1.0 - NO_SIGNAL_PROBABILITY) / len(RATIOS_DB))
    weights[0] = NO_SIGNAL_PROBABILITY
    return ratios, weights


def scaled_values(normalised: FloatArray, count: float) -> FloatArray:
    """The v of each u, (n,): the amplitude in units of a scale that N samples determine."""
    return np.asarray(count * np.expm1(np.minimum(normalised / count, 50.0)))


def log_terms(hits: FloatArray, total: FloatArray, count: float) -> FloatArray:
    """``ln w_k`` + log-likelihood ratio of each ratio r_k, (k, ...).

    Parameters
    ----------
    hits, total : (...) ndarray
        n and V.
    count : float
        N.
    """
    ratios, weights = prior()
    shape = (-1, *[1] * np.ndim(total))
    one_more, log_weights = 1.0 + ratios.reshape(shape), np.log(weights).reshape(shape)
    power = np.log1p(total / count) - np.log1p(total / (count * one_more))
    return np.asarray(log_weights - hits * np.log(one_more) + (count + hits) * power)


def log_ratio(hits: FloatArray, total: FloatArray, count: float) -> FloatArray:
    """``ln L(n, V)``, (...); see `log_terms`."""
    return np.asarray(np.logaddexp.reduce(log_terms(hits, total, count), axis=0))


@dataclass(frozen=True, eq=False)
class RatioTable:
    """``ln L(n, V)`` as a table over V, for the many paths of a scan.

    Attributes
    ----------
    count : float
        N.
    table : (n, g) ndarray
        By the number of hits, and over the grid of V, which is uniform in ln(1 + V).
    """

    count: float
    table: FloatArray

    @classmethod
    def for_count(cls, count: float, most_hits: int) -> RatioTable:
        """The table for N, in steps of `COUNT_STEP`, and up to a number of hits."""
        return _table(math.floor(math.log(max(count, 0.1)) / COUNT_STEP), most_hits)

    def at(self, hits: IntArray, total: FloatArray) -> FloatArray:
        """``ln L(n, V)`` of paths, (p,) or of any shape: exactly 0 without a hit.

        Parameters
        ----------
        hits : ndarray of int
            n; beyond the table's, that counts.
        total : ndarray
            V, of the same shape.
        """
        grid_position = np.log1p(total) * ((GRID_POINTS - 1) / math.log1p(GRID_END))
        left = np.minimum(grid_position.astype(np.int64), GRID_POINTS - 2)
        flat = self.table.ravel()
        index = np.minimum(hits, len(self.table) - 1) * GRID_POINTS + left
        low = flat[index]
        return np.asarray(low + (grid_position - left) * (flat[index + 1] - low))


@lru_cache(maxsize=64)
def _table(step: int, most_hits: int) -> RatioTable:
    count = math.exp(COUNT_STEP * step)
    grid = np.expm1(np.linspace(0.0, math.log1p(GRID_END), GRID_POINTS))
    hits = np.arange(most_hits + 1.0)[:, None]
    table = log_ratio(np.broadcast_to(hits, (most_hits + 1, GRID_POINTS)), grid[None, :], count)
    table[0, 0] = 0.0
    return RatioTable(count, table)


@dataclass(frozen=True, eq=False)
class ScanAmplitudes:
    """What the amplitudes of a scan's detections say.

    Attributes
    ----------
    told : (d,) ndarray of bool
        Whether the amplitude of each counts.
    scaled : (d,) ndarray
        v of each; 0 where it does not count.
    ratio : RatioTable
    """

    told: BoolArray
    scaled: FloatArray
    ratio: RatioTable

    @classmethod
    def from_normalised(
        cls, normalised: FloatArray, count: float, most_hits: int
    ) -> ScanAmplitudes:
        """What normalised amplitudes u say, (d,), nan where they do not count.

        Parameters
        ----------
        normalised : (d,) ndarray
        count : float
            N.
        most_hits : int
            Hits that a path may have.
        """
        ratio = RatioTable.for_count(count, most_hits)
        told = np.isfinite(normalised)
        return cls(told, scaled_values(np.where(told, normalised, 0.0), ratio.count), ratio)

    def added(
        self, row: IntArray, hits: IntArray, total: FloatArray
    ) -> tuple[IntArray, FloatArray, FloatArray]:
        """N and V of paths (p,) with detections `row` (p,) as further hits; ln of the ratio gained.

        ``ln L(n + 1, V + v) - ln L(n, V)``

        Parameters
        ----------
        row : (p,) ndarray of int
        hits, total : (p,) ndarray
            n and V before.
        """
        count, sums = hits + self.told[row], total + self.scaled[row]
        both = self.ratio.at(np.concatenate([hits, count]), np.concatenate([total, sums]))
        return count, sums, both[len(row) :] - both[: len(row)]


def ratio_db(hits: FloatArray, total: FloatArray) -> FloatArray:
    """Posterior mean of the signal-to-clutter ratio of targets, (n,), dB; nan without hits.

    Parameters
    ----------
    hits, total : (n,) ndarray
        n, not necessarily whole numbers of hits, and S of normalised amplitudes without an end.
    """
    if not (hits > 0.0).any():
        return np.full(len(hits), np.nan)
    terms = -hits * _LOG_ONE_MORE - total * _OF_ONE_MORE
    share = np.exp(terms - terms.max(axis=0))
    mean = FIGURES_DB @ share / share.sum(axis=0)
    return np.asarray(np.where(hits > 0.0, mean, np.nan))
