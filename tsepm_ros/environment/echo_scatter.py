"""How the detections of one target and ping scatter: what is error, and what is extent.

Within plots of m detections the sums of squared deviations along and across the line of sight have
the means ``(m - 1) (f s^2 + v)``, see `tsepm_ros.sensing.plots`. The sensor's variance s^2 differs
between the two; the variance v of where on the target the detections arise does not.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tsepm_ros.numerics.arrays import FloatArray, IntArray
from tsepm_ros.sensing.plots import EchoErrors, PlotExtent
from tsepm_ros.sensing.scan import Scan, wrap
from tsepm_ros.sensing.sensor import SensorModel

MEMORY = 50.0
"""Plots of several detections a ping that count: older ones fade."""
PRIOR = 0.5
"""Degrees of freedom for which the extent counts before anything is seen: v = extent^2 / 12, and
all error common to the ping."""
TRIPLES = 6.0
"""Degrees of freedom of plots of three and more from which on pairs do not count.

Detections of clutter are next to others by chance, and rarely in threes.
"""


@dataclass(frozen=True)
class EchoScatter:
    """Sums over the plots seen, for those of two detections and of more.

    Attributes
    ----------
    freedom : (2,) ndarray
        Degrees of freedom, ``sum (m - 1)``.
    plots : (2,) ndarray
        Number of plots.
    square : (2, 2) ndarray
        Squared deviations along and across, m^2.
    error : (2, 2) ndarray
        ``sum (m - 1) s^2`` along and across, m^2.
    """

    freedom: FloatArray
    plots: FloatArray
    square: FloatArray
    error: FloatArray

    @classmethod
    def nothing(cls) -> EchoScatter:
        """Before the first plot."""
        return cls(np.zeros(2), np.zeros(2), np.zeros((2, 2)), np.zeros((2, 2)))

    def after(self, scan: Scan, label: IntArray, sensor: SensorModel) -> EchoScatter:
        """With the plots of one more ping: detections and the group of each, (n,)."""
        _, first, group = np.unique(label, return_index=True, return_inverse=True)
        size = np.asarray(np.bincount(group), float)
        turn = wrap(scan.azimuth - scan.azimuth[first][group])
        own = scan.range_std
        range_variance = sensor.range_variance(scan.range) if own is None else own**2
        angle = sensor.azimuth_std if scan.azimuth_std is None else scan.azimuth_std
        kind = np.where(size == 2, 0, 1)

        def sums(values: FloatArray) -> FloatArray:
            """Over the plots of two, and of more, of values (p,)."""
            several = size > 1
            return np.asarray(np.bincount(kind[several], values[several], minlength=2), float)

        def mean(values: FloatArray) -> FloatArray:
            return np.asarray(np.bincount(group, values) / size)

        along = scan.range - mean(scan.range)[group]
        across = scan.range * (turn - mean(turn)[group])
        squares = [
            sums(np.asarray(np.bincount(group, apart**2), float)) for apart in (along, across)
        ]
        errors = [
            sums((size - 1) * mean(variance))
            for variance in (range_variance, (scan.range * angle) ** 2)
        ]
        kept = 1.0 - 1.0 / MEMORY
        return replace(
            self,
            freedom=kept * self.freedom + sums(size - 1.0),
            plots=kept * self.plots + sums(np.ones(len(size))),
            square=kept * self.square + np.stack(squares, axis=1),
            error=kept * self.error + np.stack(errors, axis=1),
        )

    @property
    def _counted(self) -> FloatArray:
        """Weight of the plots of two, and of more."""
        return np.array([self.freedom[1] < TRIPLES, 1.0])

    @property
    def mean_size(self) -> float:
        """Mean number of detections of a plot that has several."""
        weight = self._counted
        plots = max(float(weight @ self.plots), 1e-9)
        return 1.0 + float(weight @ self.freedom) / plots

    def errors(self, extent: PlotExtent) -> EchoErrors:
        """The errors of targets of an extent: f and v that solve both means, if f is possible."""
        weight = self._counted
        start = extent.along**2 / 12.0
        freedom = weight @ self.freedom + PRIOR
        found = (weight @ self.square + PRIOR * start) / freedom
        error = weight @ self.error / freedom
        apart = error[1] - error[0]
        independent = 0.0
        if abs(apart) > 1e-12:
            independent = float(np.clip((found[1] - found[0]) / apart, 0.0, 1.0))
        # The smaller scatter tells more precisely what is left for the extent.
        left = (found - independent * error) / np.maximum(found, 1e-12) ** 2
        total = (1.0 / np.maximum(found, 1e-12) ** 2).sum()
        return EchoErrors(independent, max(float(left.sum() / total), 0.0))
