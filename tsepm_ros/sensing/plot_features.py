"""Features of plots, and whether a plot resembles those of a track (Environment 2018, Section 2).

Shen Y., "The target tracking algorithm based on environment technology", ICOI 2018. A target's
plots resemble each other in intensity, range width and azimuth width, and differ from clutter's and
from another target's. With u the mean of a track's n plots so far (Eq. 10) and u' the mean with one
more, the decision function is ``J = sum_p |u'_p - u_p|^2`` (Eq. 11), small for a plot of its own.

Readings
--------
- As printed, J adds squares of unlike units, and falls with ``1 / (n + 1)^2`` as the history grows,
  so that no threshold fits two tracks, and no method associates by it: `decision` is there to
  reproduce the source's Table 1, not as an option. What is used here is the distance of the plot
  from the mean in units of its own spread, ``t_p^2 = (z_p - u_p)^2 / (s_p^2 (1 + 1 / n_p))`` with
  the variance s_p^2 of the track's n_p plots: of F distribution with 1 and n_p - 1 degrees of
  freedom for a plot of its own whose features are Gaussian. Each t_p^2 is put on the scale of
  chi-square by its probability, so that their sum has a gate that holds for short histories too.
- "The point track and track interval are used as feature distances" where a plot fits several
  tracks: the distance in position counts beside J.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from scipy.special import chdtri, fdtrc

from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray
from tsepm_ros.numerics.rows import Rows
from tsepm_ros.sensing.scan import Scan

NAMES = ("intensity", "range_width", "azimuth_width")
"""The features, in the order of their columns."""
GATE_PROBABILITY = 0.99
"""Probability that a plot of the target's own resembles the others."""
MOST_PLOTS = 30
"""Plots that count, K of Eq. 10: a target's aspect changes, and older ones fade."""
LEAST_SPREAD = 0.01
"""Standard deviation that a feature has at the least, of its mean: sensors round."""
LARGEST = 1e100
"""Magnitude from which on a feature counts as not measured: its square could overflow."""
LEAST_PROBABILITY = 1e-300
"""Floor of a probability, whose quantile stays finite."""


def measured(scan: Scan) -> FloatArray:
    """Features of a scan's detections, (n, 3); nan where not measured."""
    columns = [scan.features.get(name, np.full(len(scan), np.nan)) for name in NAMES]
    values = np.stack(columns, axis=1)
    return np.where(np.abs(values) < LARGEST, values, np.nan)


def decision(history: FloatArray, candidate: FloatArray) -> FloatArray:
    """The decision function as printed (Eqs. 10 and 11).

    Parameters
    ----------
    history : (..., n, p) ndarray
        Features of a track's plots.
    candidate : (..., p) ndarray
        Of the plot that may be its next.

    Returns
    -------
    (...) ndarray
        J, small for a plot of the track's own.
    """
    n = history.shape[-2]
    mean = history.mean(axis=-2)
    after = (n * mean + candidate) / (n + 1)
    return np.asarray(np.square(after - mean).sum(axis=-1))


@dataclass(frozen=True)
class Histories(Rows):
    """Features of the plots of tracks so far, a row each.

    Attributes
    ----------
    count : (n, 3) ndarray
        Plots that had each feature.
    mean : (n, 3) ndarray
        Eq. 10.
    square : (n, 3) ndarray
        Sum of the squared deviations from the mean.
    """

    count: FloatArray
    mean: FloatArray
    square: FloatArray

    @classmethod
    def of(cls, features: FloatArray) -> Self:
        """Histories of plots (n, m, 3); nan: no plot, or not measured."""
        has = np.isfinite(features)
        values = np.where(has, features, 0.0)
        count = has.sum(axis=1).astype(float)
        mean = values.sum(axis=1) / np.maximum(count, 1.0)
        square = np.where(has, np.square(values - mean[:, None]), 0.0).sum(axis=1)
        return cls(count, mean, square)

    def with_plots(self, rows: IntArray, features: FloatArray) -> Self:
        """The histories after one more plot, (p, 3), of some rows (p,), none of them twice."""
        made = type(self)(self.count.copy(), self.mean.copy(), self.square.copy())
        has = np.isfinite(features)
        fading = np.minimum(1.0, (MOST_PLOTS - 1.0) / np.maximum(self.count[rows], 1.0))
        count = np.where(has, self.count[rows] * fading + 1.0, self.count[rows])
        deviation = np.where(has, features - self.mean[rows], 0.0)
        share = deviation / np.maximum(count, 1.0)
        made.count[rows] = count
        made.mean[rows] += share
        kept = np.where(has, fading, 1.0) * self.square[rows]
        made.square[rows] = kept + deviation * (deviation - share)
        return made

    def dissimilarity(self, features: FloatArray) -> FloatArray:
        """How unlike its track's plots each of some plots (n, 3) is, (n,).

        Chi-square distributed for plots of the track's own, with as many degrees of freedom as
        features are known (`known`).
        """
        known = self.known(features)
        freedom = np.where(known, self.count - 1.0, 1.0)
        variance = self.square / freedom
        variance = np.maximum(variance, np.square(LEAST_SPREAD * self.mean))
        variance = variance * (1.0 + 1.0 / np.maximum(self.count, 1.0))
        misfit = np.where(known, np.square(features - self.mean), 0.0)
        # Where nothing ever varied, not even around 0: as far off as can be told, or not at all.
        largest = np.where(misfit > 0.0, np.inf, 0.0)
        with np.errstate(over="ignore"):
            distance = np.divide(misfit, variance, out=largest, where=variance > 0.0)
        probability = np.maximum(fdtrc(1.0, freedom, distance), LEAST_PROBABILITY)
        return np.asarray(chdtri(1.0, probability).sum(axis=1))

    def known(self, features: FloatArray) -> BoolArray:
        """Which features of plots (n, 3) can be compared: both have them, the track twice."""
        return np.isfinite(features) & (self.count >= 2.0)

    def resembled_by(self, features: FloatArray) -> BoolArray:
        """Whether plots (n, 3) resemble their tracks'; those that cannot be compared do."""
        freedom = self.known(features).sum(axis=1)
        gate = chdtri(np.maximum(freedom, 1), 1.0 - GATE_PROBABILITY)
        return np.asarray((self.dissimilarity(features) <= gate) | (freedom == 0))
