"""Prediction of the share of starts from clutter that passes a threshold.

Targets are drawn from the model of the likelihood-ratio method, and their evidence is simulated
without clutter. The share that passes a threshold, and the excess over it, give the share for
clutter by Wald's identity:

``P_0(passes A) = E_1[1 / L at the passage; passes A]``

with P_0 for a start from clutter, E_1 for one from a target, and L the evidence that is tested: the
likelihood ratios summed over all starts, of which a target makes one at each of its detections
(Wald, "Sequential Analysis", 1947; Siegmund, "Sequential Analysis", 1985).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from tsepm_ros.kinematics import kalman
from tsepm_ros.methods.score import fading, likelihood_ratio
from tsepm_ros.methods.score.drawn_targets import (
    ANY_RATIO,
    DrawnTargets,
    draw_targets,
    errors_at,
)
from tsepm_ros.numerics.arrays import FloatArray, IntArray
from tsepm_ros.numerics.rows import taken
from tsepm_ros.sensing import range_rates
from tsepm_ros.sensing.sensor import SensorModel

THRESHOLDS = np.arange(0.0, 40.0, 0.05)
"""Thresholds of a plan, in units of the log-likelihood ratio."""
MIN_PASSAGES = 30
"""Simulated passages of a threshold, at least, for a share of use."""
MAX_BELOW_VILLE = 2.5
"""The threshold is at most this far below Ville's: true targets may differ from the simulated."""
ROUNDING_STEP = 0.1


def rounded(value: float) -> float:
    """A value above 0 in steps of 10 %, so that similar values share a plan."""
    return math.exp(ROUNDING_STEP * round(math.log(value) / ROUNDING_STEP))


def ville_threshold(false_share: float) -> float:
    """Threshold that at most this share of the starts from clutter passes, for any clutter.

    ``-ln(share)``, from P(sup L >= A) <= 1 / A for a likelihood ratio L of mean 1.
    """
    return -math.log(false_share)


def min_threshold(false_share: float) -> float:
    """Lower limit of the threshold for any targets: `MAX_BELOW_VILLE` below Ville's."""
    return ville_threshold(false_share) - MAX_BELOW_VILLE


@dataclass(frozen=True, eq=False)
class ScorePlan:
    """Shares of starts that pass each threshold, from clutter and from targets.

    Attributes
    ----------
    false_share : (t,) ndarray
        P_0 of passing each of the first of `THRESHOLDS`, per start from clutter; as far as enough
        of the simulated targets passed.
    passed_share : (t, scans) ndarray
        P_1 of having passed each of these by each scan, per target, from its first detection on.
    """

    false_share: FloatArray
    passed_share: FloatArray

    def threshold(self, false_share: float) -> float:
        """The least threshold that at most this share of the starts from clutter passes.

        Beyond what was simulated, the share falls as exp(-threshold). Never above Ville's.
        """
        highest = ville_threshold(false_share)
        low_enough = self.false_share <= false_share
        threshold = highest
        if low_enough.any():
            threshold = float(THRESHOLDS[np.argmax(low_enough)])
        elif len(low_enough):
            excess = math.log(self.false_share[-1] / false_share)
            threshold = THRESHOLDS[len(low_enough) - 1] + excess
        return min(max(threshold, min_threshold(false_share)), highest)

    def passed(self, threshold: float) -> FloatArray:
        """Share of the targets that have passed a threshold by each scan, (scans,).

        From the first detection on, and without clutter, which adds evidence of its own; 0 beyond
        the thresholds that were simulated.
        """
        row = math.ceil(threshold / THRESHOLDS[1])
        if row >= len(self.passed_share):
            return np.zeros(self.passed_share.shape[1])
        share: FloatArray = self.passed_share[row]
        return share


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
    strengths: bool = False,
) -> ScorePlan:
    """Simulate the evidence for targets drawn from the method's model.

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
    strengths : bool, optional
        Whether detections have a strength, of targets of any ratio of the prior.

    Returns
    -------
    ScorePlan
    """
    (plan,) = score_plans(
        sensor,
        max_speed=max_speed,
        interval=interval,
        windows=(window,),
        scans=window,
        gate_probability=gate_probability,
        process_noise=process_noise,
        deletion=deletion,
        min_hits=min_hits,
        ratio=ANY_RATIO if strengths else None,
    )
    return plan


def score_plans(
    sensor: SensorModel,
    *,
    max_speed: float,
    interval: float,
    windows: Sequence[int],
    scans: int,
    gate_probability: float,
    process_noise: float,
    deletion: float,
    min_hits: int,
    ratio: float | None = None,
    fades: bool = True,
) -> list[ScorePlan]:
    """The plans of several windows, from the same targets.

    Parameters
    ----------
    windows : sequence of int
    scans : int
        Scans through which the targets are followed, at least the longest window.
    ratio : float, optional
        Signal-to-clutter ratio of the targets, not in dB; `ANY_RATIO`: of the prior; None: their
        detections have no strength.
    fades : bool, optional
        Whether the targets fade, as the model's do: only these give `ScorePlan.false_share`.
        Otherwise they have the sensor's P_D throughout.
    sensor, max_speed, interval, gate_probability, process_noise, deletion, min_hits
        See `score_plan`.
    """
    targets = draw_targets(sensor, max_speed, interval, scans, process_noise, ratio, fades)
    evidences = np.full((len(windows), *targets.detected.shape), -np.inf)
    for first in range(scans):
        score = _scores(
            targets, first, sensor, max_speed, interval, gate_probability, process_noise, deletion
        )
        for evidence_of_window, window in zip(evidences, windows, strict=True):
            part = slice(first, min(first + window, scans))
            np.logaddexp(
                evidence_of_window[:, part], score[:, part], out=evidence_of_window[:, part]
            )
    enough = np.cumsum(targets.detected, axis=1) >= min_hits
    tested = np.where(targets.detected & enough, evidences, -np.inf)
    return [_plan(evidence, window) for evidence, window in zip(tested, windows, strict=True)]


def _scores(
    targets: DrawnTargets,
    first: int,
    sensor: SensorModel,
    max_speed: float,
    interval: float,
    gate_probability: float,
    process_noise: float,
    deletion: float,
) -> FloatArray:
    """Score after each scan of the hypotheses that start in scan `first`, (n, window).

    -inf before the start, without a detection in that scan, and after deletion.
    """
    window = targets.detected.shape[1]
    rows = np.flatnonzero(targets.detected[:, first])
    n = len(rows)
    state, covariance = np.zeros((n, 4)), np.zeros((n, 4, 4))
    detections = taken(targets.detections[first], rows)
    state[:, 0::2] = detections["position"]
    covariance[:, 0::2, 0::2] = detections["covariance"]
    covariance[:, [1, 3], [1, 3]] = max_speed**2 / 4.0
    state, covariance, start = range_rates.begun(state, covariance, detections, sensor)
    scores = np.full(targets.detected.shape, -np.inf)
    of_strength = targets.strength_increments(first)
    score = start + of_strength[rows, first]
    scores[rows, first] = score
    faded = np.full(n, fading.FADED_AT_START)
    for scan in range(first + 1, window):
        state, covariance = kalman.predict(state, covariance, interval, process_noise)
        target, at_stamp = np.arange(len(rows)), np.zeros(len(rows))
        detections = taken(targets.detections[scan], rows)
        innovation = detections["position"] - state[:, 0::2]
        innovation_covariance = covariance[:, 0::2, 0::2] + errors_at(state, sensor)
        density = kalman.log_likelihood(
            state,
            covariance,
            target,
            at_stamp,
            innovation,
            innovation_covariance,
            detections,
            gate_probability,
        )
        hit = targets.detected[rows, scan] & np.isfinite(density)
        clutter = sensor.clutter_density * range_rates.clutter_density(detections, sensor)
        faded = fading.predicted(faded)
        probability = sensor.detection_probability * fading.visible_share(faded)
        increment = likelihood_ratio.hit_increment(density, probability, clutter)
        increment = increment + of_strength[rows, scan]
        missed = likelihood_ratio.miss_increment(probability, gate_probability)
        faded = np.where(
            hit,
            fading.after_hit(faded),
            fading.after_miss(faded, probability, gate_probability),
        )
        score = score + np.where(hit, increment, missed)
        found = np.flatnonzero(hit)
        updated = kalman.update(
            state.take(found, axis=0),
            covariance.take(found, axis=0),
            at_stamp[found],
            innovation.take(found, axis=0),
            innovation_covariance.take(found, axis=0),
        )
        state[found], covariance[found] = range_rates.update(
            *updated, at_stamp[found], taken(detections, found)
        )
        kept = np.flatnonzero(score >= deletion)
        rows, score, faded = rows[kept], score[kept], faded[kept]
        state, covariance = state.take(kept, axis=0), covariance.take(kept, axis=0)
        scores[rows, scan] = score
    return scores


def _plan(tested: FloatArray, window: int) -> ScorePlan:
    """``E_1[exp(-evidence at the first passage); passes]`` in the window, and passages by scan."""
    running = np.maximum.accumulate(tested, axis=1)
    passed = np.stack([_at_least(column) for column in running.T], axis=1)
    used = np.count_nonzero(passed[:, window - 1] >= MIN_PASSAGES)
    # A target passes the thresholds above its largest evidence so far, up to the new largest.
    before = np.concatenate([np.full((len(tested), 1), -np.inf), running[:, : window - 1]], axis=1)
    in_window = running[:, :window]
    highest = np.where(in_window > before, np.exp(-in_window), 0.0).ravel()
    steps = np.zeros(len(THRESHOLDS) + 1)
    np.add.at(steps, np.searchsorted(THRESHOLDS, in_window.ravel(), side="right"), highest)
    np.subtract.at(steps, np.searchsorted(THRESHOLDS, before.ravel(), side="right"), highest)
    # From the highest threshold down: the shares fall over many powers of ten.
    false = np.cumsum(steps[::-1])[-2::-1][:used] / len(tested)
    return ScorePlan(false, passed[:used] / len(tested))


def _at_least(values: FloatArray) -> IntArray:
    """Number of the values (n,) that are at least each threshold, (t,)."""
    return np.asarray(len(values) - np.searchsorted(np.sort(values), THRESHOLDS))
