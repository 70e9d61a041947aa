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
"""Comparison of methods by their operating curves, at equal false-track rates and at equal P_DT."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.tools.evaluation.intervals import RESAMPLES, TAILS, TAILS_90, IntervalEstimate
from tsepm_ros.tools.evaluation.measures import RunMeasures
from tsepm_ros.tools.evaluation.performance import MIN_FALSE_STARTS, PerformanceCurve
from tsepm_ros.tools.evaluation.simulated_run import Outcome


@dataclass(frozen=True)
class Comparison:
    """Comparison of one method's point with another method's curve.

    Attributes
    ----------
    method, label : str
        The point.
    other : str
        The method of the curve.
    false, found : float
        The point's false starts per run and P_DT.
    other_found, found_difference : IntervalEstimate
        P_DT of the curve at the point's rate of false starts, and the point's P_DT less that.
    found_bounds : IntervalEstimate
        The same difference with one-sided 95 % bounds.
    other_false, false_ratio : IntervalEstimate
        False starts per run of the curve at the point's P_DT, and their false_ratio to the point's.
    """

    method: str
    label: str
    other: str
    false: float
    found: float
    other_found: IntervalEstimate
    found_difference: IntervalEstimate
    found_bounds: IntervalEstimate
    other_false: IntervalEstimate
    false_ratio: IntervalEstimate


Points = Mapping[tuple[str, str], Sequence[RunMeasures]]
"""Summaries of the runs of each point, by method and label."""


def compare(points: Points) -> list[Comparison]:
    """Compare every point with every other method's curve.

    The intervals are those of a percentile bootstrap over the runs. Run i is the same scene for all
    points, so all points share each resample. Resamples in which the curve does not reach the point
    are left out.

    Parameters
    ----------
    points : mapping of (str, str) to sequence of RunMeasures
        The same runs for each point, by its method and label.
    """
    false, found = _resampled(list(points.values()))
    methods = np.array([method for method, _ in points])
    curves = {  # through a method's points, in the sample and in its resamples
        method: [PerformanceCurve.of(*of_sample) for of_sample in zip(*pair, strict=True)]
        for method in methods.tolist()
        if (pair := [part[methods == method].T for part in (false, found)])
    }
    return [
        _compared(method, label, other, curves[other], false[row], found[row])
        for row, (method, label) in enumerate(points)
        for other in curves
        if other != method
    ]


def detection_at(curve: PerformanceCurve, false: FloatArray) -> FloatArray:
    """P_DT of a curve at rates of false starts per run, linear in their logarithm.

    nan below the lowest rate of the curve; constant above the highest.
    """
    return np.interp(np.log(false), curve.log_false, curve.found, left=np.nan)


def false_at(curve: PerformanceCurve, found: FloatArray) -> FloatArray:
    """False starts per run of a curve at values of P_DT.

    nan above the highest P_DT of the curve; constant below the lowest.
    """
    return np.exp(np.interp(found, curve.found, curve.log_false, right=np.nan))


def _compared(
    method: str,
    label: str,
    other: str,
    curves: list[PerformanceCurve],
    false: FloatArray,
    found: FloatArray,
) -> Comparison:
    """Compare a point with a curve, in the sample and in its resamples, (1 + b,) each."""
    pairs = list(zip(curves, false[:, None], found[:, None], strict=True))
    other_found = np.concatenate([detection_at(curve, rate) for curve, rate, _ in pairs])
    other_false = np.concatenate([false_at(curve, share) for curve, _, share in pairs])
    return Comparison(
        method,
        label,
        other,
        float(false[0]),
        float(found[0]),
        other_found=_interval(other_found),
        found_difference=_interval(found - other_found),
        found_bounds=_interval(found - other_found, TAILS_90),
        other_false=_interval(other_false),
        false_ratio=_interval(other_false / false),
    )


def _interval(values: FloatArray, tails: tuple[float, float] = TAILS) -> IntervalEstimate:
    """The sample's value, (1 + b,) first, with the interval of its resamples."""
    resamples = values[1:][np.isfinite(values[1:])]
    if np.isnan(values[0]) or not len(resamples):
        return IntervalEstimate.unknown()
    low, high = np.quantile(resamples, tails)
    return IntervalEstimate(float(values[0]), float(low), float(high))


def _resampled(points: Sequence[Sequence[RunMeasures]]) -> tuple[FloatArray, FloatArray]:
    """False starts per run and P_DT of each point, (n, 1 + b): of the sample and its resamples."""
    counts = [
        [(run.count(Outcome.TRUE), run.targets, run.wrong) for run in summaries]
        for summaries in points
    ]
    true, targets, wrong = np.moveaxis(np.array(counts, float), -1, 0)
    runs = true.shape[1]
    resamples = np.random.default_rng(0).multinomial(runs, np.full(runs, 1.0 / runs), RESAMPLES)
    weights = np.vstack([np.ones(runs), resamples]).T
    false = np.maximum(wrong @ weights, MIN_FALSE_STARTS) / runs
    return false, (true @ weights) / np.maximum(targets @ weights, 1.0)
