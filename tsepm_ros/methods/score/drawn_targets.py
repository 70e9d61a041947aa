"""Targets drawn from the model of the likelihood-ratio method, as a sensor would measure them.

They are anywhere in the coverage, move as the model's do, and may fade.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.environment import target_strength
from tsepm_ros.environment.target_strength import PathRatio
from tsepm_ros.methods.score import fading
from tsepm_ros.numerics.arrays import BoolArray, FloatArray
from tsepm_ros.sensing import range_rates
from tsepm_ros.sensing.conversion import DETECTION, position_covariance
from tsepm_ros.sensing.sensor import SensorModel

SIMULATED_TARGETS = 1500
SEED = 1
ANY_RATIO = -1.0
"""Stands for ratios of the prior."""


@dataclass(frozen=True, eq=False)
class DrawnTargets:
    """Targets that were detected in the first scan.

    Attributes
    ----------
    detections : list of (n,) ndarray of DETECTION
        As they would be measured in each scan. An array a scan: a single array of all scans, made
        while a node runs, leaves a gap of 6 MB that the allocator keeps.
    detected : (n, window) ndarray of bool
    exponents : (n, window) ndarray or None
        Of the strengths of the detections.
    """

    detections: list[NDArray[np.void]]
    detected: BoolArray
    exponents: FloatArray | None

    def strength_increments(self, first: int) -> FloatArray:
        """What the strength of each target's detection adds in each scan, (n, window).

        Of the hypotheses that start in scan `first`; 0 before it.
        """
        increments = np.zeros(self.detected.shape)
        if self.exponents is not None:
            hit = self.detected[:, first:]
            totals = np.cumsum(np.where(hit, self.exponents[:, first:], 0.0), axis=1)
            counts = np.cumsum(hit, axis=1, dtype=np.int64)
            ratio = PathRatio.of(target_strength.LAW_KNOWN, self.detected.shape[1])
            evidence = ratio.at(counts, totals)
            increments[:, first] = evidence[:, 0]
            increments[:, first + 1 :] = np.diff(evidence, axis=1)
        return increments


def draw_targets(
    sensor: SensorModel,
    max_speed: float,
    interval: float,
    window: int,
    process_noise: float,
    ratio: float | None,
    fades: bool,
) -> DrawnTargets:
    """Targets anywhere in the coverage."""
    rng = np.random.default_rng(SEED)
    square = rng.uniform(sensor.min_range**2, sensor.max_range**2, SIMULATED_TARGETS)
    truth = np.zeros((SIMULATED_TARGETS, 4))
    truth[:, 0] = np.sqrt(square)
    truth[:, 1::2] = rng.normal(0.0, max_speed / 2.0, (SIMULATED_TARGETS, 2))
    scans = []
    rate_errors = np.random.default_rng([SEED, 1]).standard_normal((window, SIMULATED_TARGETS))
    for scan in range(window):
        detections = np.zeros(SIMULATED_TARGETS, DETECTION)
        detections["range_rate_std"] = sensor.range_rate_std
        detections["covariance"] = errors_at(truth, sensor)
        rate, _, _ = range_rates.expected(detections, truth[:, 0::2], truth[:, 1::2])
        detections["range_rate"] = rate + sensor.range_rate_std * rate_errors[scan]
        detections["position"] = truth[:, 0::2] + _drawn(rng, truth, sensor)
        scans.append(detections)
        truth[:, 0::2] += interval * truth[:, 1::2]
        truth[:, 1::2] += rng.normal(
            0.0, math.sqrt(process_noise * interval), (SIMULATED_TARGETS, 2)
        )
    share = np.where(_faded(window) & fades, fading.FADED_FACTOR, 1.0)
    detected = rng.random((SIMULATED_TARGETS, window)) < sensor.detection_probability * share
    detected[:, 0] = True
    return DrawnTargets(scans, detected, _drawn_exponents(ratio, window))


def _drawn_exponents(ratio: float | None, window: int) -> FloatArray | None:
    """Exponents of the strengths of targets' detections, (n, window)."""
    if ratio is None:
        return None
    rng = np.random.default_rng([SEED, 2])
    means = np.full(SIMULATED_TARGETS, 1.0 + ratio)
    if ratio == ANY_RATIO:
        ratios, weights = target_strength.ratio_prior()
        means = 1.0 + rng.choice(ratios, SIMULATED_TARGETS, p=weights)
    return np.asarray(means[:, None] * rng.exponential(size=(SIMULATED_TARGETS, window)))


def _faded(window: int) -> BoolArray:
    """Whether the targets, detected in the first scan, have faded in each scan, (n, window)."""
    rng = np.random.default_rng([SEED, 2])
    draws = rng.random((SIMULATED_TARGETS, window))
    faded = draws < fading.FADED_AT_START
    for scan in range(1, window):
        before = faded[:, scan - 1].astype(np.float64)
        faded[:, scan] = draws[:, scan] < fading.predicted(before)
    return faded


def errors_at(state: FloatArray, sensor: SensorModel) -> FloatArray:
    """Covariance of a detection at each state's position, (n, 2, 2), m^2."""
    range_ = np.hypot(state[:, 0], state[:, 2])
    azimuth = np.arctan2(state[:, 2], state[:, 0])
    return position_covariance(range_, azimuth, sensor.range_variance(range_), sensor.azimuth_std)


def _drawn(rng: np.random.Generator, state: FloatArray, sensor: SensorModel) -> FloatArray:
    """Errors of the covariances of `errors_at`, along and across the line of sight, (n, 2), m."""
    range_ = np.hypot(state[:, 0], state[:, 2])
    straight = position_covariance(
        range_, np.zeros(len(state)), sensor.range_variance(range_), sensor.azimuth_std
    )
    along, across = rng.standard_normal((2, len(state))) * np.sqrt(
        [straight[:, 0, 0], straight[:, 1, 1]]
    )
    cosine, sine = state[:, 0] / range_, state[:, 2] / range_
    return np.stack([cosine * along - sine * across, sine * along + cosine * across], axis=1)
