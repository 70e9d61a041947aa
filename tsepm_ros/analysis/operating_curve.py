"""Operating curves, and methods compared on them at equal false-track rates and equal P_D."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tsepm_ros.analysis.intervals import RESAMPLES, TAILS, Estimate
from tsepm_ros.analysis.run_summary import RunSummary
from tsepm_ros.analysis.truth import Outcome
from tsepm_ros.numerics.arrays import FloatArray

LEAST_FALSE = 0.5
"""False starts, in all runs, that a point counts at least: no logarithm of 0."""


@dataclass(frozen=True)
class Curve:
    """The best that a method's points give.

    Attributes
    ----------
    log_false : (n,) ndarray
        Logarithm of the false starts per run, ascending.
    detection : (n,) ndarray
        P_D, ascending: points with more false starts and no higher P_D are not on the curve.
    """

    log_false: FloatArray
    detection: FloatArray

    @classmethod
    def of(cls, false: FloatArray, detection: FloatArray) -> Curve:
        """The curve of points, (n,) false starts per run and (n,) P_D."""
        order = np.lexsort((-detection, false))
        best = np.maximum.accumulate(detection[order])
        kept = np.diff(best, prepend=-np.inf) > 0.0
        return cls(np.log(false[order][kept]), best[kept])

    def detection_at(self, false: FloatArray) -> FloatArray:
        """P_D at rates of false starts per run, linear in their logarithm.

        nan below the lowest rate of the curve; above the highest, what that gives.
        """
        return np.interp(np.log(false), self.log_false, self.detection, left=np.nan)

    def false_at(self, detection: FloatArray) -> FloatArray:
        """False starts per run at some P_D.

        nan above the highest P_D of the curve; below the lowest, what that costs.
        """
        return np.exp(np.interp(detection, self.detection, self.log_false, right=np.nan))


@dataclass(frozen=True)
class Comparison:
    """One method's point beside another method's curve.

    Attributes
    ----------
    method, label : str
        The point.
    other : str
        The method of the curve.
    false, detection : float
        The point's false starts per run and P_D.
    other_detection, gain : Estimate
        P_D of the curve at the point's rate of false starts; the point's less that.
    other_false, ratio : Estimate
        False starts per run of the curve at the point's P_D; these over the point's.
    """

    method: str
    label: str
    other: str
    false: float
    detection: float
    other_detection: Estimate
    gain: Estimate
    other_false: Estimate
    ratio: Estimate


Points = Mapping[tuple[str, str], Sequence[RunSummary]]
"""The records of each point, by method and label."""


def compare(points: Points) -> list[Comparison]:
    """Compare every point with every other method's curve.

    The intervals are those of a percentile bootstrap over the runs. Run i being the same scene for
    all, they are drawn for all points together. Resamples in which the curve does not reach the
    point are left out.

    Parameters
    ----------
    points : mapping of (str, str) to sequence of RunRecord
        The same runs for each point, by its method and label.
    """
    false, detection = _resampled(list(points.values()))
    methods = [method for method, _ in points]
    curves = {
        method: _curves(false, detection, [row for row, one in enumerate(methods) if one == method])
        for method in methods
    }
    return [
        _compared(method, label, other, curves[other], false[row], detection[row])
        for row, (method, label) in enumerate(points)
        for other in curves
        if other != method
    ]


def _curves(false: FloatArray, detection: FloatArray, rows: list[int]) -> list[Curve]:
    """The curve through some of the points, in the sample and in its resamples."""
    return [Curve.of(false[rows, b], detection[rows, b]) for b in range(false.shape[1])]


def _compared(
    method: str,
    label: str,
    other: str,
    curves: list[Curve],
    false: FloatArray,
    detection: FloatArray,
) -> Comparison:
    """Compare a point with a curve, in the sample and in its resamples, (1 + b,) each."""
    pairs = list(zip(curves, false[:, None], detection[:, None], strict=True))
    other_detection = np.concatenate([curve.detection_at(rate) for curve, rate, _ in pairs])
    other_false = np.concatenate([curve.false_at(share) for curve, _, share in pairs])
    return Comparison(
        method,
        label,
        other,
        float(false[0]),
        float(detection[0]),
        other_detection=_interval(other_detection),
        gain=_interval(detection - other_detection),
        other_false=_interval(other_false),
        ratio=_interval(other_false / false),
    )


def _interval(values: FloatArray) -> Estimate:
    """The first value, with the interval of the others."""
    others = values[1:][np.isfinite(values[1:])]
    if np.isnan(values[0]) or not len(others):
        return Estimate.unknown()
    low, high = np.quantile(others, TAILS)
    return Estimate(float(values[0]), float(low), float(high))


def _resampled(points: Sequence[Sequence[RunSummary]]) -> tuple[FloatArray, FloatArray]:
    """False starts per run and P_D of each point, (n, 1 + b): of the runs, and resampled."""
    counts = [
        [(record.count(Outcome.TRUE), record.targets, record.wrong) for record in records]
        for records in points
    ]
    true, targets, wrong = np.moveaxis(np.array(counts, float), -1, 0)
    runs = true.shape[1]
    resamples = np.random.default_rng(0).multinomial(runs, np.full(runs, 1.0 / runs), RESAMPLES)
    weights = np.vstack([np.ones(runs), resamples]).T
    false = np.maximum(wrong @ weights, LEAST_FALSE) / runs
    return false, (true @ weights) / np.maximum(targets @ weights, 1.0)
