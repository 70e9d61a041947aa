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
"""The threshold of confirmation, from drawn targets at a false-track rate.

Targets are drawn from the model of the likelihood-ratio method, anywhere in the coverage, as a
sensor would measure them: they move and fade. Their evidence is simulated without clutter. The
share that passes a threshold, and the excess over it, give the share for clutter by Wald's
identity:

``P_0(passes A) = E_1[1 / L at the passage; passes A]``

with P_0 for a start from clutter, E_1 for one from a target, and L the evidence that is tested: the
likelihood ratios summed over all starts, of which a target makes one at each of its detections
(Wald, "Sequential Analysis", 1947; Siegmund, "Sequential Analysis", 1985).

Every detection starts a hypothesis. The target false-track rate over the starts per hour is the
share of starts that may be confirmed falsely. At most this share of the starts from clutter passes
the threshold of `ScorePlan`::

    share         = false tracks per hour / (detections per scan * 3600 s / scan interval)
    A             = -ln(share) - the mean jump over it

A plan takes the time of some ten scans to simulate. Fast pings share it among two or more, from
two hits of a target on: some first scans of the hypotheses in each. Until it is ready Ville's
bound is the threshold, which holds for any targets.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from tsepm_ros.numerics.arrays import (
    BoolArray,
    FloatArray,
    IntArray,
    RecordArray,
    appended,
    replaced,
    rows_of,
)
from tsepm_ros.tracker import evaluation, motion, range_rates
from tsepm_ros.tracker.clutter import amplitude_law
from tsepm_ros.tracker.initial_state import first_states
from tsepm_ros.tracker.measurement import (
    DETECTION,
    LEAST_ACROSS,
    measured_polar,
    measurement_covariance,
)
from tsepm_ros.tracker.observation import Observation
from tsepm_ros.tracker.options import GATE_PROBABILITY, MIN_HITS, CommonOptions, ScoreOptions
from tsepm_ros.tracker.polar_grid import MEMORY_SCANS
from tsepm_ros.tracker.sensor import SensorModel

SIMULATED_TARGETS, THRESHOLD_TARGETS = 1500, 500
"""Simulated targets of a prediction, and of a threshold, whose standard error is 0.05 or so."""
MIN_STEPS, STEPS_PER_SECOND, DRAWING_STEPS = 80, 160, 1.5
"""Scans of simulated hypotheses in a scan, at least (some 20 ms, half of a plan of the default
window), and by the scan interval: pings of a second or more can wait for a whole plan. To draw a
scan of the targets counts as 1.5, in the first scan."""
STARTS_TOGETHER = 5
"""First scans whose hypotheses are simulated together, at most: bounds memory."""
PLAN_LEAD = 10.0
"""Log-likelihood ratio, that of two hits or so, by which a plan begins before it may be needed."""
SEED = 1
ANY_RATIO = -1.0
"""Stands for ratios of the prior."""
THRESHOLDS = np.arange(0.0, 40.0, 0.05)
"""Thresholds of a plan, in units of the log-likelihood ratio."""
MIN_PASSAGES = 30
"""Simulated passages of a threshold, at least, for a share of use."""
MAX_BELOW_VILLE = 2.5
"""The threshold is at most this far below Ville's: true targets may differ from the simulated."""


@dataclass(frozen=True, eq=False)
class MonteCarloTargets:
    """Targets that were detected in the first scan.

    Attributes
    ----------
    detections : list of (n,) ndarray of DETECTION
        As they would be measured in each scan. An array a scan: a single array of all scans, made
        while a node runs, leaves a gap of 6 MB that the allocator keeps.
    detected : (n, window) ndarray of bool
    amplitudes : (n, window) ndarray or None
        Normalised, of the detections.
    """

    detections: list[RecordArray]
    detected: BoolArray
    amplitudes: FloatArray | None

    def detections_of(self, target: IntArray, start: IntArray, scans: range) -> RecordArray:
        """Detections of targets (m,), each in one of the scans, by its place there: ascending."""
        return appended(
            *[rows_of(self.detections[k], target[start == place]) for place, k in enumerate(scans)]
        )

    def amplitude_increments(self, first: int) -> FloatArray:
        """What the amplitude of each target's detection adds in each scan, (n, window).

        Of the hypotheses that start in scan `first`; 0 before it.
        """
        increments = np.zeros(self.detected.shape)
        if self.amplitudes is not None:
            hit = self.detected[:, first:]
            totals = np.cumsum(np.where(hit, self.amplitudes[:, first:], 0.0), axis=1)
            counts = np.cumsum(hit, axis=1, dtype=np.int64)
            ratio = amplitude_law.RatioTable.for_count(
                amplitude_law.KNOWN_LAW_COUNT, self.detected.shape[1]
            )
            increments[:, first:] = np.diff(ratio.at(counts, totals), axis=1, prepend=0.0)
        return increments


def draw_targets(model: PlanModel) -> MonteCarloTargets:
    """Targets anywhere in the coverage."""
    sensor, number, window, interval = model.sensor, model.number, model.scans, model.interval
    rng = np.random.default_rng(SEED)
    truth = np.zeros((number, 4))
    truth[:, 0] = np.sqrt(rng.uniform(sensor.min_range**2, sensor.max_range**2, number))
    truth[:, 1::2] = rng.normal(0.0, model.max_speed / 2.0, (number, 2))
    scans = []
    rate_errors = np.random.default_rng([SEED, 1]).standard_normal((window, number))
    for scan in range(window):
        detections = np.zeros(number, DETECTION)
        detections["range_rate_std"] = sensor.range_rate_std
        detections["covariance"] = errors_at(truth, sensor)
        rate, _, _ = range_rates.expected(detections, truth[:, 0::2], truth[:, 1::2])
        detections["range_rate"] = rate + sensor.range_rate_std * rate_errors[scan]
        detections["position"] = truth[:, 0::2] + _drawn(rng, truth, sensor)
        scans.append(detections)
        truth[:, 0::2] += interval * truth[:, 1::2]
        truth[:, 1::2] += rng.normal(0.0, math.sqrt(model.process_noise * interval), (number, 2))
    share = np.where(_faded(number, window) & model.fades, evaluation.FADED_FACTOR, 1.0)
    detected = rng.random((number, window)) < sensor.detection_probability * share
    detected[:, 0] = True
    return MonteCarloTargets(scans, detected, _drawn_amplitudes(model.ratio, number, window))


def _drawn_amplitudes(ratio: float | None, number: int, window: int) -> FloatArray | None:
    """Normalised amplitudes of targets' detections, (n, window)."""
    if ratio is None:
        return None
    rng = np.random.default_rng([SEED, 2])
    means = np.full(number, 1.0 + ratio)
    if ratio == ANY_RATIO:
        ratios, weights = amplitude_law.prior()
        means = 1.0 + rng.choice(ratios, number, p=weights)
    return np.asarray(means[:, None] * rng.exponential(size=(number, window)))


def _faded(number: int, window: int) -> BoolArray:
    """Whether the targets, detected in the first scan, have faded in each scan, (n, window)."""
    draws = np.random.default_rng([SEED, 2]).random((number, window))
    faded = draws < evaluation.FADED_AT_START
    for scan in range(1, window):
        before = faded[:, scan - 1].astype(np.float64)
        faded[:, scan] = draws[:, scan] < evaluation.fading_predicted(before)
    return faded


def errors_at(state: FloatArray, sensor: SensorModel) -> FloatArray:
    """Covariance of a detection at each state's position, (n, 2, 2), m^2."""
    range_ = np.hypot(state[:, 0], state[:, 2])
    azimuth = np.arctan2(state[:, 2], state[:, 0])
    return measurement_covariance(
        range_, azimuth, sensor.range_variance(range_), sensor.azimuth_std, LEAST_ACROSS
    )


def _drawn(rng: np.random.Generator, state: FloatArray, sensor: SensorModel) -> FloatArray:
    """Errors of the covariances of `errors_at`, along and across the line of sight, (n, 2), m."""
    range_ = np.hypot(state[:, 0], state[:, 2])
    straight = errors_at(np.stack([range_, *np.zeros((3, len(state)))], axis=1), sensor)
    along, across = rng.standard_normal((2, len(state))) * np.sqrt(
        [straight[:, 0, 0], straight[:, 1, 1]]
    )
    cosine, sine = state[:, 0] / range_, state[:, 2] / range_
    return np.stack([cosine * along - sine * across, sine * along + cosine * across], axis=1)


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
        highest = -math.log(false_share)
        low_enough = self.false_share <= false_share
        threshold = highest
        if low_enough.any():
            threshold = float(THRESHOLDS[np.argmax(low_enough)])
        elif len(low_enough):
            excess = math.log(self.false_share[-1] / false_share)
            threshold = THRESHOLDS[len(low_enough) - 1] + excess
        return min(max(threshold, highest - MAX_BELOW_VILLE), highest)

    def passed(self, threshold: float) -> FloatArray:
        """Share of the targets that have passed a threshold by each scan, (scans,).

        From the first detection on, and without clutter, which adds evidence of its own; 0 beyond
        the thresholds that were simulated.
        """
        row = math.ceil(threshold / THRESHOLDS[1])
        if row >= len(self.passed_share):
            return np.zeros(self.passed_share.shape[1])
        return np.asarray(self.passed_share[row])


@dataclass(frozen=True)
class PlanModel:
    """What targets are drawn from, and how the method follows them.

    Attributes
    ----------
    sensor : SensorModel
    max_speed : float
        v_max, m/s.
    interval : float
        Time between scans, s.
    windows : tuple of int
        Scans, of each plan.
    deletion : float
        Score below which a hypothesis is deleted.
    scans : int
        Scans through which the targets are followed, at least the longest window.
    process_noise : float
        m^2/s^3. It changes a threshold by less than its error.
    ratio : float, optional
        Signal-to-clutter ratio of the targets, not in dB; `ANY_RATIO`: of the prior; None: their
        detections have no amplitude.
    fades : bool
        Whether the targets fade, as the method's do: only these give `ScorePlan.false_share`.
        Otherwise they have the sensor's P_D throughout.
    number : int
        Targets.
    """

    sensor: SensorModel
    max_speed: float
    interval: float
    windows: tuple[int, ...]
    deletion: float
    scans: int
    process_noise: float = 0.0
    ratio: float | None = None
    fades: bool = True
    number: int = THRESHOLD_TARGETS


class ScoreSimulation:
    """The evidence for drawn targets, by some first scans of the hypotheses after others.

    Attributes
    ----------
    plans : list of ScorePlan
        Of each window, once all first scans are simulated.
    """

    def __init__(self, model: PlanModel) -> None:
        self.plans: list[ScorePlan] = []
        self._model, self._targets, self._starts = model, draw_targets(model), 0
        self._evidences = np.full((len(model.windows), *self._targets.detected.shape), -np.inf)

    def run(self, starts: int) -> ScoreSimulation:
        """Simulate the hypotheses of so many first scans, those simulated before included."""
        if self.plans:
            return self
        windows, detected = self._model.windows, self._targets.detected
        end = min(starts, self._model.scans)
        while self._starts < end:
            together = range(self._starts, end)[:STARTS_TOGETHER]
            scores = _scores(self._targets, together, self._model)
            for first, score in zip(together, scores, strict=True):
                for evidence, window in zip(self._evidences, windows, strict=True):
                    part = slice(first, first + window)
                    np.logaddexp(evidence[:, part], score[:, part], out=evidence[:, part])
            self._starts = together.stop
        if self._starts == self._model.scans:
            enough = np.cumsum(detected, axis=1) >= MIN_HITS
            tested = np.where(detected & enough, self._evidences, -np.inf)
            self.plans = [
                _plan(evidence, window) for evidence, window in zip(tested, windows, strict=True)
            ]
            del self._targets, self._evidences  # megabytes
        return self


score_simulation = lru_cache(maxsize=64)(ScoreSimulation)
"""`ScoreSimulation`, one of a model for all trackers of a process."""


def _scores(targets: MonteCarloTargets, starts: range, model: PlanModel) -> FloatArray:
    """Score after each scan of the hypotheses that start in some scans (k,), (k, n, window).

    -inf before the start, without a detection in that scan, and after deletion. All are followed by
    their age together: those of the last start reach the end of the window first.
    """
    sensor, window = model.sensor, targets.detected.shape[1]
    start, rows = targets.detected[:, starts].T.nonzero()
    n, detections = len(rows), targets.detections_of(rows, start, starts)
    state, covariance, of_rate = range_rates.begun(
        *first_states(detections, model.max_speed), detections, sensor
    )
    scores = np.full((len(starts), *targets.detected.shape), -np.inf)
    of_amplitude = np.stack([targets.amplitude_increments(first) for first in starts])
    score = of_rate + of_amplitude[start, rows, starts.start + start]
    scores[start, rows, starts.start + start] = score
    faded = np.full(n, evaluation.FADED_AT_START)
    alive = np.ones(n, bool)
    for first in range(starts.start + 1, window):
        kept = np.flatnonzero(alive & (first + start < window))
        start, rows, score, faded = start[kept], rows[kept], score[kept], faded[kept]
        state, covariance = state.take(kept, axis=0), covariance.take(kept, axis=0)
        scan = first + start  # of each
        state, covariance = motion.predict(state, covariance, model.interval, model.process_noise)
        target, at_stamp = np.arange(len(rows)), np.zeros(len(rows))
        detections = targets.detections_of(rows, start, range(first, window)[: len(starts)])
        innovation = detections["position"] - state[:, 0::2]
        innovation_covariance = covariance[:, 0::2, 0::2] + errors_at(state, sensor)
        density = motion.log_likelihood(
            state,
            covariance,
            target,
            0.0,
            innovation,
            innovation_covariance,
            detections,
            target,
            GATE_PROBABILITY,
        )
        hit = targets.detected[rows, scan] & np.isfinite(density)
        clutter = sensor.clutter_density * range_rates.clutter_density(detections, sensor)
        faded = evaluation.fading_predicted(faded)
        probability = sensor.detection_probability * evaluation.visible_share(faded)
        increment = (
            evaluation.hit_increment(density, probability, clutter)
            + of_amplitude[start, rows, scan]
        )
        faded = np.where(
            hit,
            evaluation.fading_after_hit(faded),
            evaluation.fading_after_miss(faded, probability, GATE_PROBABILITY),
        )
        score = score + np.where(
            hit, increment, evaluation.miss_increment(probability, GATE_PROBABILITY)
        )
        hit_rows = np.flatnonzero(hit)
        updated = motion.update(
            state.take(hit_rows, axis=0),
            covariance.take(hit_rows, axis=0),
            at_stamp[hit_rows],
            innovation.take(hit_rows, axis=0),
            innovation_covariance.take(hit_rows, axis=0),
        )
        state[hit_rows], covariance[hit_rows] = range_rates.update(
            *updated, at_stamp[hit_rows], rows_of(detections, hit_rows)
        )
        alive = score >= model.deletion
        scores[start, rows, scan] = np.where(alive, score, -np.inf)
    return scores


def _plan(tested: FloatArray, window: int) -> ScorePlan:
    """``E_1[exp(-evidence at the first passage); passes]`` in the window, and passages by scan."""
    running = np.maximum.accumulate(tested, axis=1)
    passed = len(tested) - np.stack(
        [np.searchsorted(np.sort(column), THRESHOLDS) for column in running.T], axis=1
    )
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


class Threshold:
    """The threshold, from the scan rate and the number of detections so far."""

    def __init__(self) -> None:
        self._counts: dict[int, deque[int]] = {}  # by the number of the sensor
        self._interval: dict[int, float] = {}
        self._last: Observation | None = None
        self._plan: ScorePlan | None = None  # of the last estimates, once it is ready
        self._simulated: dict[PlanModel, int] = {}  # first scans of each plan

    def observe(self, observed: Observation) -> None:
        """Count a scan's detections."""
        number = observed.picture.number
        self._counts.setdefault(number, deque(maxlen=MEMORY_SCANS)).append(len(observed.detections))
        self._interval[number] = observed.picture.own
        self._last = observed

    def false_share(self, false_tracks_per_hour: float) -> float | None:
        """Share of the starts from clutter that may be confirmed; None while the rate is unknown.

        The starts per scan are the mean of the detections, or those of the last scan if more; those
        of all living sensors are summed.
        """
        if self._last is None or not self._last.picture.own:
            return None
        starts_per_hour = 0.0
        for number in self._last.picture.living:
            counts, interval = self._counts.get(number), self._interval.get(number)
            if counts and interval:
                detections = max(sum(counts) / len(counts), counts[-1], 1e-3)
                starts_per_hour += detections * 3600.0 / interval
        return min(false_tracks_per_hour / starts_per_hour, 1.0)

    def prepare(
        self, sensor: SensorModel, common: CommonOptions, options: ScoreOptions, evidence: float
    ) -> None:
        """Go on with the plan, once in a scan, where its largest evidence comes near the threshold.

        What is simulated depends on the scans alone, so that results are equal between runs.

        Parameters
        ----------
        sensor : SensorModel
            As given.
        common : CommonOptions
            With the properties that are estimated.
        options : ScoreOptions
            With the target false-track rate.
        evidence : float
            Largest evidence that the scan may have.
        """
        share, lead = (
            self.false_share(options.false_tracks_per_hour),
            0.0 if self._plan else PLAN_LEAD,
        )
        if (
            share is None
            or self._last is None
            or -math.log(share) - evidence > MAX_BELOW_VILLE + lead
        ):
            return
        # In steps, so that similar estimates share a plan.
        model = PlanModel(
            coarse_sensor(sensor, self._last, common),
            common.max_speed,
            2.0 ** round(math.log2(self._last.picture.own)),
            (options.window,),
            options.deletion_threshold,
            options.window,
            ratio=None if self._last.amplitudes is None else ANY_RATIO,
        )
        starts = self._simulated.get(model, 0)
        drawing = 0.0 if model in self._simulated else DRAWING_STEPS * model.scans
        steps = max(MIN_STEPS, STEPS_PER_SECOND * self._last.picture.own) - drawing
        while starts < model.scans and steps > 0:
            steps -= model.scans - starts
            starts += 1
        self._simulated[model] = starts
        plans = score_simulation(model).run(starts).plans
        self._plan = plans[0] if starts == model.scans else None

    def value(self, false_tracks_per_hour: float) -> float:
        """The log-likelihood ratio that confirms; infinite while the scan rate is unknown."""
        share = self.false_share(false_tracks_per_hour)
        if share is None:
            return math.inf
        # Ville's bound: P(sup L >= A) <= 1 / A for a likelihood ratio L of mean 1.
        return self._plan.threshold(share) if self._plan else -math.log(share)


def coarse_sensor(sensor: SensorModel, observed: Observation, common: CommonOptions) -> SensorModel:
    """The sensor of a plan; estimates are rounded, so that similar estimates share a plan.

    The detection probability goes in steps of 0.1, the median of the clutter density in steps of
    half a decade, the farthest range of clutter and its range rate by factors of 2, and so does the
    area of the error ellipses where detections state errors, an extent or a pose that make it
    larger than the sensor's. Range rates count only where the scan has any.

    Parameters
    ----------
    sensor : SensorModel
        As given.
    observed : Observation
        The last scan, with the estimates.
    common : CommonOptions
        With the properties that are estimated.
    """
    changes: dict[str, float] = {}
    if common.detection_probability == "estimated":
        changes["detection_probability"] = max(round(observed.detection_probability_in_use, 1), 0.1)
    detections = observed.detections
    if common.clutter_density == "estimated" and len(detections):
        density = float(np.median(detections["clutter_density"]))
        farthest = sensor.max_range * 2.0 ** math.ceil(
            math.log2(observed.seen_extent.max_range / sensor.max_range) - 0.1
        )
        changes |= {
            "clutter_density": 10.0 ** (0.5 * round(2.0 * math.log10(density))),
            "clutter_range_rate": 2.0
            ** round(math.log2(observed.clutter_sensor.clutter_range_rate)),
            "max_range": farthest,
            "min_range": min(sensor.min_range, 0.5 * farthest),
        }
    if not range_rates.measured(detections).any():
        changes["range_rate_std"] = 0.0
    seen = np.stack([measured_polar(detections)[0], *np.zeros((3, len(detections)))], axis=1)
    square = np.linalg.det(detections["covariance"]) / np.linalg.det(errors_at(seen, sensor))
    step = round(0.5 * math.log2(max(float(np.median(square)), 1.0)))
    factor = min(2.0 ** (0.5 * step), 1.0 / sensor.azimuth_std)
    changes |= {
        "range_std": factor * sensor.range_std,
        "range_std_fraction": factor * sensor.range_std_fraction,
        "azimuth_std": factor * sensor.azimuth_std,
    }
    return replaced(sensor, **changes)
