"""Features of plots, and whether a plot resembles those of a track (Environment 2018, Section 2).

Shen Y., "The target tracking algorithm based on environment technology", ICOI 2018. A target's
plots resemble each other in intensity, range width and azimuth width, and differ from clutter's and
from another target's. With u the mean of a track's n plots so far (Eq. 10) and u' the mean with one
more, the decision function is ``J = sum_p |u'_p - u_p|^2`` (Eq. 11), small for a plot of its own.

Readings
--------
- As printed, J adds squares of unlike units, and falls with ``1 / (n + 1)^2`` as the history grows,
  so that no threshold fits two tracks. `decision` reproduces the source's Table 1; no method uses
  it. Association uses the distance of the plot from the mean in units of the track's own standard
  deviation, ``t_p^2 = (z_p - u_p)^2 / (s_p^2 (1 + 1 / n_p))`` with the variance s_p^2 of the
  track's n_p plots. For a plot of the track with Gaussian features it has an F distribution with
  1 and n_p - 1 degrees of freedom. The chi-square quantile of its probability replaces each t_p^2:
  the gate of the sum then also holds for short histories.
- "The point track and track interval are used as feature distances" where a plot fits several
  tracks: the distance in position is added to J.
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
"""Probability that a plot of the target passes the gate of its features."""
MAX_PLOT_COUNT = 30
"""Number of plots averaged, K of Eq. 10: the aspect changes, and older plots fade."""
MIN_RELATIVE_STD = 0.01
"""Smallest standard deviation of a feature, as a fraction of its mean: sensors round."""
MAX_FEATURE = 1e100
"""Magnitude from which a feature counts as not measured: its square could overflow."""
MIN_TAIL_PROBABILITY = 1e-300
"""Floor of a tail probability, which keeps its quantile finite."""


def measured(scan: Scan) -> FloatArray:
    """Features of a scan's detections, (n, 3); nan where not measured."""
    if not scan.features:
        return np.full((len(scan), len(NAMES)), np.nan)
    columns = [scan.features.get(name, np.full(len(scan), np.nan)) for name in NAMES]
    values = np.stack(columns, axis=1)
    return np.where(np.abs(values) < MAX_FEATURE, values, np.nan)


def decision(history: FloatArray, candidate: FloatArray) -> FloatArray:
    """The decision function as printed (Eqs. 10 and 11).

    Parameters
    ----------
    history : (..., n, p) ndarray
        Features of a track's plots.
    candidate : (..., p) ndarray
        Features of the plot that may be the track's next.

    Returns
    -------
    (...) ndarray
        J, small for a plot of the same target.
    """
    n = history.shape[-2]
    mean = history.mean(axis=-2)
    after = (n * mean + candidate) / (n + 1)
    return np.asarray(np.square(after - mean).sum(axis=-1))


@dataclass(frozen=True)
class Histories(Rows):
    """Statistics of the features of tracks' plots, a row for each track.

    Attributes
    ----------
    count : (n, 3) ndarray
        Number of plots with each feature.
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
        """The histories after a further plot, (p, 3), of the rows (p,), each at most once."""
        updated = type(self)(self.count.copy(), self.mean.copy(), self.square.copy())
        has = np.isfinite(features)
        fading = np.minimum(1.0, (MAX_PLOT_COUNT - 1.0) / np.maximum(self.count[rows], 1.0))
        count = np.where(has, self.count[rows] * fading + 1.0, self.count[rows])
        deviation = np.where(has, features - self.mean[rows], 0.0)
        mean_change = deviation / np.maximum(count, 1.0)
        updated.count[rows] = count
        updated.mean[rows] += mean_change
        kept = np.where(has, fading, 1.0) * self.square[rows]
        updated.square[rows] = kept + deviation * (deviation - mean_change)
        return updated

    def dissimilarity(self, features: FloatArray) -> FloatArray:
        """Distance of each plot's features (n, 3) from those of its track, (n,).

        Chi-square distributed for plots of the same target; the number of comparable features
        (`known`) is the degrees of freedom.
        """
        known = self.known(features)
        freedom = np.where(known, self.count - 1.0, 1.0)
        variance = self.square / freedom
        variance = np.maximum(variance, np.square(MIN_RELATIVE_STD * self.mean))
        variance = variance * (1.0 + 1.0 / np.maximum(self.count, 1.0))
        squared_deviation = np.where(known, np.square(features - self.mean), 0.0)
        # A variance of 0: the distance is infinite for a different feature, 0 for an equal one.
        at_no_variance = np.where(squared_deviation > 0.0, np.inf, 0.0)
        with np.errstate(over="ignore"):
            distance = np.divide(
                squared_deviation, variance, out=at_no_variance, where=variance > 0.0
            )
        probability = np.maximum(fdtrc(1.0, freedom, distance), MIN_TAIL_PROBABILITY)
        return np.asarray(chdtri(1.0, probability).sum(axis=1))

    def known(self, features: FloatArray) -> BoolArray:
        """Which features of plots (n, 3) are comparable: measured, and twice in the track."""
        return np.isfinite(features) & (self.count >= 2.0)

    def resembled_by(self, features: FloatArray) -> BoolArray:
        """Whether plots (n, 3) resemble those of their tracks; true without comparable features."""
        freedom = self.known(features).sum(axis=1)
        gate = chdtri(np.maximum(freedom, 1), 1.0 - GATE_PROBABILITY)
        return np.asarray((self.dissimilarity(features) <= gate) | (freedom == 0))
