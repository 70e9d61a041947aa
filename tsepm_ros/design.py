"""What a rule or a threshold gives, before it is used: detection, false tracks, time to confirm.

Targets are drawn as the likelihood-ratio method assumes them, and their scores followed without
clutter. That tells how soon they pass a threshold, and by how much they overshoot it; and, by
Wald's identity, how often clutter does:

``P_0(passes A) = E_1[1 / L at the passage; passes A]``

with L the likelihood ratio, P_0 for a start from clutter and E_1 for one from a target (Wald,
"Sequential Analysis", 1947; Siegmund, "Sequential Analysis", 1985).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from tsepm_ros import evidence, filtering
from tsepm_ros.conversion import position_covariance
from tsepm_ros.sensor import SensorModel
from tsepm_ros.splitting import gate_factor

BoolArray = NDArray[np.bool_]
FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

PATHS = 4000
SEED = 1
THRESHOLDS = np.arange(0.0, 40.0, 0.05)
"""Thresholds that are looked at, in units of the log-likelihood ratio."""


def rounded(value: float, digits: int = 2) -> float:
    """A value to some significant digits, so that near ones share a plan."""
    return float(f"{value:.{digits - 1}e}")


@dataclass(frozen=True, eq=False)
class ScorePlan:
    """Scores of targets from their first detection on.

    Attributes
    ----------
    score : (n, window) ndarray
        Log-likelihood ratio after each scan, -inf where the hypothesis has been deleted.
    testable : (n, window) ndarray of bool
        Scans that end in a detection and have enough of them.
    false_share : (t,) ndarray
        P_0 of passing each of `THRESHOLDS`, per start from clutter.
    """

    score: FloatArray
    testable: BoolArray
    false_share: FloatArray

    def threshold(self, false_share: float) -> float:
        """The least threshold that at most this share of the starts from clutter passes.

        Beyond what was simulated, the share falls as exp(-threshold).
        """
        fits = self.false_share <= false_share
        if fits.any():
            return float(THRESHOLDS[np.argmax(fits)])
        last = self.false_share[-1]
        return float(THRESHOLDS[-1] + math.log(max(last / false_share, 1.0)))

    def detection(self, threshold: float) -> FloatArray:
        """Share of targets confirmed by the end of each scan after the first hit, (window,)."""
        passed = np.where(self.testable, self.score, -np.inf) >= threshold
        shares: FloatArray = np.maximum.accumulate(passed, axis=1).mean(axis=0)
        return shares


@lru_cache(maxsize=64)
def score_plan(
    sensor: SensorModel,
    *,
    max_speed: float,
    interval: float,
    window: int,
    gate_probability: float,
    process_noise: float,
    deletion: float,
    min_hits: int,
) -> ScorePlan:
    """Follow the scores of targets drawn as the method assumes them.

    Parameters
    ----------
    sensor : SensorModel
    max_speed : float
        v_max, m/s.
    interval : float
        Time between scans, s.
    window : int
        Scans.
    gate_probability, process_noise, deletion, min_hits
        As in the method.

    Returns
    -------
    ScorePlan
    """
    rng = np.random.default_rng(SEED)
    square = rng.uniform(sensor.min_range**2, sensor.max_range**2, PATHS)
    truth = np.zeros((PATHS, 4))
    truth[:, 0] = np.sqrt(square)
    truth[:, 1::2] = rng.normal(0.0, max_speed / 2.0, (PATHS, 2))
    state, covariance = np.zeros((PATHS, 4)), np.zeros((PATHS, 4, 4))
    error = _errors(truth, sensor)
    state[:, 0::2] = truth[:, 0::2] + _drawn(rng, error)
    covariance[:, 0::2, 0::2] = error
    covariance[:, [1, 3], [1, 3]] = max_speed**2 / 4.0
    score = np.zeros((PATHS, window))
    hits = np.ones((PATHS, window), bool)
    gate = gate_factor(gate_probability) ** 2
    probability = np.full(PATHS, sensor.detection_probability)
    for scan in range(1, window):
        truth, _ = filtering.predict(truth, np.zeros_like(covariance), interval)
        truth[:, 1::2] += rng.normal(0.0, math.sqrt(process_noise * interval), (PATHS, 2))
        state, covariance = filtering.predict(state, covariance, interval, process_noise)
        innovation = truth[:, 0::2] + _drawn(rng, _errors(truth, sensor)) - state[:, 0::2]
        spread = covariance[:, 0::2, 0::2] + _errors(state, sensor)
        density, distance = filtering.log_density(innovation, spread)
        hit = (rng.random(PATHS) < sensor.detection_probability) & (distance <= gate)
        clutter = np.full(PATHS, sensor.clutter_density)
        gain = np.where(
            hit,
            evidence.hit_gain(density, sensor.detection_probability, clutter),
            evidence.miss_gain(probability, gate_probability),
        )
        score[:, scan] = score[:, scan - 1] + gain
        score[score[:, scan] < deletion, scan] = -np.inf
        updated = filtering.update(
            state[hit], covariance[hit], np.zeros(hit.sum()), innovation[hit], spread[hit]
        )
        state[hit], covariance[hit] = updated
        hits[:, scan] = hit
    testable = hits & (np.cumsum(hits, axis=1) >= min_hits)
    return ScorePlan(score, testable, _false_share(score, testable))


def _false_share(score: FloatArray, testable: BoolArray) -> FloatArray:
    """``E_1[exp(-score at the first passage); passes]`` for each of `THRESHOLDS`."""
    tested = np.where(testable, score, -np.inf)
    running = np.maximum.accumulate(tested, axis=1)
    shares = np.zeros(len(THRESHOLDS))
    for row, threshold in enumerate(THRESHOLDS):
        passed = running >= threshold
        first = passed.argmax(axis=1)
        value = tested[np.arange(len(tested)), first]
        shares[row] = np.where(passed[:, -1], np.exp(-value), 0.0).mean()
    return shares


def _errors(state: FloatArray, sensor: SensorModel) -> FloatArray:
    """Covariance of a detection at each state's position, (n, 2, 2), m^2."""
    range_ = np.hypot(state[:, 0], state[:, 2])
    azimuth = np.arctan2(state[:, 2], state[:, 0])
    return position_covariance(range_, azimuth, sensor.range_variance(range_), sensor.azimuth_std)


def _drawn(rng: np.random.Generator, covariance: FloatArray) -> FloatArray:
    """Errors with the given covariances, (n, 2), m."""
    root = np.linalg.cholesky(covariance)
    return np.asarray((root @ rng.standard_normal((len(root), 2, 1)))[..., 0])
