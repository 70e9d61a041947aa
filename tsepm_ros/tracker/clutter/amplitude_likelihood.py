"""What the strengths of a target's echoes say: the likelihood ratio along a path.

For clutter u = -ln P(clutter is at least as strong) is exponential of mean 1, whatever the unit and
the law (`amplitude_law`). A fluctuating target (Swerling I) with the signal-to-clutter ratio r is
exponential of mean 1 + r. The ratio is unknown, and the same along a path, so that the number n of
a path's hits and the sum S of their u are sufficient::

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
from functools import lru_cache

import numpy as np

from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray

RATIOS_DB = np.arange(-5.0, 12.6, 2.5)
"""Signal-to-clutter ratios of the prior, which is uniform over them, dB.

The exponents of stronger targets end where those of the strongest do: the law is not known there.
"""
SAYS_NOTHING = 0.4
"""Prior probability that the target is no stronger than clutter, r = 0."""
COUNT_STEP = 0.1
"""N goes in steps of this part, so that similar scans share a table."""
FIGURES_DB = np.arange(-5.0, 40.1, 1.0)
"""Ratios that may be published, dB."""
_ONE_MORE = 1.0 + 10.0 ** (FIGURES_DB[:, None] / 10.0)
_LOG_ONE_MORE, _OF_ONE_MORE = np.log(_ONE_MORE), 1.0 / _ONE_MORE
LAW_KNOWN = 1e6
"""N with which the law of clutter is as good as known."""
GRID_END, GRID_POINTS = 4000.0, 320
"""End of the table's grid of V, and its points."""


def ratio_prior() -> tuple[FloatArray, FloatArray]:
    """Ratios r_k, linear, and their prior probabilities w_k; the first is 0."""
    ratios = np.append(0.0, 10.0 ** (RATIOS_DB / 10.0))
    weights = np.full(len(ratios), (1.0 - SAYS_NOTHING) / len(RATIOS_DB))
    weights[0] = SAYS_NOTHING
    return ratios, weights


def scaled(exponent: FloatArray, count: float) -> FloatArray:
    """The v of each u, (n,): the exponent in units of a scale that N samples determine."""
    v: FloatArray = count * np.expm1(np.minimum(exponent / count, 50.0))
    return v


def log_terms(hits: FloatArray, total: FloatArray, count: float) -> FloatArray:
    """``ln w_k`` + log-likelihood ratio of each ratio r_k, (k, ...).

    Parameters
    ----------
    hits, total : (...) ndarray
        n and V.
    count : float
        N.
    """
    ratios, weights = ratio_prior()
    shape = (-1, *[1] * np.ndim(total))
    one_more, log_weights = 1.0 + ratios.reshape(shape), np.log(weights).reshape(shape)
    power = np.log1p(total / count) - np.log1p(total / (count * one_more))
    return np.asarray(log_weights - hits * np.log(one_more) + (count + hits) * power)


def log_ratio(hits: FloatArray, total: FloatArray, count: float) -> FloatArray:
    """``ln L(n, V)``, (...); see `log_terms`."""
    return np.asarray(np.logaddexp.reduce(log_terms(hits, total, count), axis=0))


@dataclass(frozen=True, eq=False)
class PathRatio:
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
    def of(cls, count: float, most_hits: int) -> PathRatio:
        """The table for N, in steps of `COUNT_STEP`, and up to a number of hits."""
        step = math.floor(math.log(max(count, 0.1)) / COUNT_STEP)
        return _path_ratio(step, most_hits)

    def at(self, hits: IntArray, total: FloatArray) -> FloatArray:
        """``ln L(n, V)`` of paths, (p,) or of any shape: exactly 0 without a hit.

        Parameters
        ----------
        hits : ndarray of int
            n, up to the table's.
        total : ndarray
            V, of the same shape.
        """
        place = np.log1p(total) * ((GRID_POINTS - 1) / math.log1p(GRID_END))
        left = np.minimum(place.astype(np.int64), GRID_POINTS - 2)
        flat = self.table.ravel()
        index = hits * GRID_POINTS + left
        low = flat[index]
        value: FloatArray = low + (place - left) * (flat[index + 1] - low)
        return value


@lru_cache(maxsize=64)
def _path_ratio(step: int, most_hits: int) -> PathRatio:
    count = math.exp(COUNT_STEP * step)
    grid = np.expm1(np.linspace(0.0, math.log1p(GRID_END), GRID_POINTS))
    hits = np.arange(most_hits + 1.0)[:, None]
    table = log_ratio(np.broadcast_to(hits, (most_hits + 1, GRID_POINTS)), grid[None, :], count)
    table[0, 0] = 0.0
    return PathRatio(count, table)


@dataclass(frozen=True, eq=False)
class ScanAmplitudes:
    """What the strengths of a scan's detections say.

    Attributes
    ----------
    told : (d,) ndarray of bool
        Whether the strength of each counts.
    scaled : (d,) ndarray
        v of each; 0 where it does not count.
    ratio : PathRatio
    """

    told: BoolArray
    scaled: FloatArray
    ratio: PathRatio

    @classmethod
    def of(cls, exponent: FloatArray, count: float, most_hits: int) -> ScanAmplitudes:
        """The strengths of exponents u (d,), nan where they do not count.

        Parameters
        ----------
        exponent : (d,) ndarray
        count : float
            N.
        most_hits : int
            Hits that a path may have.
        """
        ratio = PathRatio.of(count, most_hits)
        told = np.isfinite(exponent)
        v = scaled(np.where(told, exponent, 0.0), ratio.count)
        return cls(told, v, ratio)


def ratio_db(hits: FloatArray, total: FloatArray) -> FloatArray:
    """Posterior mean of the signal-to-clutter ratio of targets, (n,), dB; nan without hits.

    Parameters
    ----------
    hits, total : (n,) ndarray
        n, not necessarily whole numbers of hits, and S of exponents without an end.
    """
    if not (hits > 0.0).any():
        return np.full(len(hits), np.nan)
    terms = -hits * _LOG_ONE_MORE - total * _OF_ONE_MORE
    share = np.exp(terms - terms.max(axis=0))
    mean = FIGURES_DB @ share / share.sum(axis=0)
    return np.asarray(np.where(hits > 0.0, mean, np.nan))
