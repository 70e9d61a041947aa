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
"""Evaluation: how well the hits of a potential track fit a single target.

The track score of the likelihood-ratio method: each hypothesis assigns certain detections, at most
one a scan, to a target. Its score is the log-likelihood ratio of this assignment against clutter
only (Sittler 1964; Bar-Shalom, Blackman, Fitzgerald, "Dimensionless score function for multiple
hypothesis tracking", IEEE Trans. Aerosp. Electron. Syst. 43(1), 2007)::

    hit           s + ln(P_D N(z; H x, S) / lambda) + ln L(n + 1, V + v) - ln L(n, V)
    miss          s + ln(1 - P_D P_G)

with ln L(n, V) the ratio of the amplitudes of n hits, see `clutter.amplitude_law`. In
clutter alone, the mean of the ratio over all hypotheses of a start is a martingale of mean 1: the
probability that it ever reaches A is at most 1 / A (Ville 1939, Wald 1945). This bound does not
hold for the best hypothesis alone.

P_D is not a constant. A target is seen with the P_D in use, or it has faded to less: by aspect,
shadow or weather, or because the data sheet flatters. It is in either state for a while (the Markov
chain of Musicki, Evans, Stankovic, IEEE Trans. Autom. Control 39(6), 1994, with P_D above 0 in
both), so that a miss makes further misses cheaper. With f the probability that it has faded, from
scan to scan::

    predicted     f <- (1 - 1 / SCANS_FADED) f + (1 - f) / SCANS_SEEN
    P_D           P_D v,   v = 1 - (1 - b) f,   b = FADED_FACTOR
    hit           f <- b f / v
    miss          f <- f (1 - b P_D P_G) / (1 - P_D v P_G)

The score stays the likelihood ratio of a target drawn from this model. Over 15 scans of 12 s after
the first detection it loses 0.4 where P_D is 0.9 as told. Where P_D is 0.6 and told as 0.9, it
loses 2.6 instead of 4.7.

The velocity prior ends at v_max. The filters have a Gaussian prior of the velocity, of variance
v_max^2 / 4 on each axis. Of the Gaussian truncated at v_max, the likelihood ratio of a hypothesis
with the posterior N(x, P) is exactly ::

    s <- s + ln P(|v| <= v_max | N(x, P)) - ln P_0,    P_0 = 1 - exp(-2) of the prior

That is 0.15 more where the velocity is surely inside, and much less where it is surely outside. It
is a likelihood ratio of mean 1 under clutter as before: the bound on false confirmations holds.
"""

from __future__ import annotations

import math

import numpy as np

from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray, replaced
from tsepm_ros.tracker import motion
from tsepm_ros.tracker.clutter.sensor_performance import MAX_DETECTION_PROBABILITY
from tsepm_ros.tracker.hypotheses import ExpectedDetections, Hypotheses
from tsepm_ros.tracker.observation import Observation
from tsepm_ros.tracker.sensor import MIN_CLUTTER_DENSITY

SCANS_SEEN = 25.0
"""Mean number of scans for which a target is seen before it fades: a choice."""
SCANS_FADED = 8.0
"""Mean number of scans for which it then is faded: a choice."""
FADED_FACTOR = 0.02
"""Detection probability of a faded target, in that of a seen one: a choice."""
FADED_SHARE = SCANS_FADED / (SCANS_SEEN + SCANS_FADED)
"""Share of the time for which a target has faded."""
FADED_AT_START = FADED_SHARE * FADED_FACTOR / (1.0 - FADED_SHARE * (1.0 - FADED_FACTOR))
"""Probability that a target has faded, given its first detection."""
MAX_PAIRS_TOGETHER = 50_000
"""Pairs of hypotheses and detections that are scored together: bounds memory."""
LOG_GAIN = -math.log(-math.expm1(-2.0))
"""-ln P_0: what the evidence gains where the velocity is surely inside."""


def hit_increment(
    log_density: FloatArray, detection_probability: float | FloatArray, clutter: FloatArray
) -> FloatArray:
    """Score increment of a hit: ``ln(P_D N(z; H x, S) / lambda)``.

    Parameters
    ----------
    log_density : (n,) ndarray
        ln N, the density of the detection under the hypothesis, in the coordinates of the clutter
        density.
    detection_probability : float or (n,) ndarray
        P_D where the hypothesis expects its target; where it is 0, the increment is -inf.
    clutter : (n,) ndarray
        lambda at the detection: the density of its other possible causes, 1/m^2.

    Returns
    -------
    (n,) ndarray
    """
    probability = np.minimum(detection_probability, MAX_DETECTION_PROBABILITY)
    with np.errstate(divide="ignore"):
        ratio = np.log(probability / np.maximum(clutter, MIN_CLUTTER_DENSITY))
    return np.asarray(log_density + ratio)


def miss_increment(detection_probability: FloatArray, gate_probability: float) -> FloatArray:
    """Score increment, below 0, of a miss: ``ln(1 - P_D P_G)``; 0 where nothing can be detected.

    Parameters
    ----------
    detection_probability : (n,) ndarray
        P_D.
    gate_probability : float
        P_G: a detection outside the gate is missed too.

    Returns
    -------
    (n,) ndarray
    """
    probability = np.minimum(detection_probability, MAX_DETECTION_PROBABILITY)
    return np.asarray(np.log1p(-probability * gate_probability))


def fading_predicted(faded: FloatArray, steps: float = 1.0) -> FloatArray:
    """Probability that targets have faded (n,) at the next scan, which counts for some `steps`."""
    return np.asarray((1.0 - steps / SCANS_FADED) * faded + steps * (1.0 - faded) / SCANS_SEEN)


def with_column(values: FloatArray, column: int, of_column: FloatArray) -> FloatArray:
    """Values (n, s) with another column (n,)."""
    values = values.copy()
    values[:, column] = of_column
    return values


def visible_share(faded: FloatArray) -> FloatArray:
    """Mean detection probability of targets (n,), in that of a seen one."""
    return np.asarray(1.0 - (1.0 - FADED_FACTOR) * faded)


def fading_after_hit(faded: FloatArray) -> FloatArray:
    """Probability that targets have faded (n,) after a detection."""
    return np.asarray(FADED_FACTOR * faded / (1.0 - (1.0 - FADED_FACTOR) * faded))


def fading_after_miss(
    faded: FloatArray, detection_probability: FloatArray, gate_probability: float
) -> FloatArray:
    """Probability that targets have faded (n,) after a miss.

    Parameters
    ----------
    faded : (n,) ndarray
        Before it.
    detection_probability : (n,) ndarray
        Mean P_D of each: that of a seen target times `visible_share`.
    gate_probability : float
        P_G.
    """
    seen = detection_probability / (1.0 - (1.0 - FADED_FACTOR) * faded)
    missed = 1.0 - detection_probability * gate_probability
    return np.asarray(faded * (1.0 - FADED_FACTOR * seen * gate_probability) / missed)


def path_amplitudes(
    observed: Observation, row: IntArray, hits: IntArray, total: FloatArray
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Amplitudes of paths (p,) with a scan's detections as further hits, and what they add.

    Parameters
    ----------
    observed : Observation
    row : (p,) ndarray of int
        Detection of each.
    hits, total : (p,) ndarray
        Amplitudes before; 0 of a path that starts. See `Hypotheses`.

    Returns
    -------
    hits, total : (p,) ndarray
    increment : (p,) ndarray
        Of the score.
    """
    if observed.amplitudes is None:
        return hits, total, np.zeros(len(row))
    return observed.amplitudes.added(row, hits, total)


def evaluate(
    expected: ExpectedDetections,
    parent: IntArray,
    row: IntArray,
    observed: Observation,
    gate_probability: float,
) -> tuple[Hypotheses, FloatArray]:
    """Evaluate the branches of hypotheses: misses, and children by a detection.

    ``s + ln(1 - P_D P_G)`` and ``s + ln(P_D N(z; H x, S) / lambda)``, and what the amplitude adds.
    Of a miss outside the coverage the score stays: P_D is 0 there, and hypotheses predicted there
    have no children; else the evidence of clutter would grow.

    Parameters
    ----------
    expected : ExpectedDetections
        Of n hypotheses, predicted to the scan.
    parent, row : (p,) ndarray of int
        Hypothesis and detection of each child.
    observed : Observation
        The scan. From half of its time limit on no further block of children is scored; those of
        the best hypotheses come first.
    gate_probability : float
        P_G.

    Returns
    -------
    missed : Hypotheses
        Those that leave the scan out, (n,).
    score : (p,) ndarray
        Of the children; -inf outside the gate, and where P_D is 0.
    """
    hypotheses = expected.hypotheses
    detection_probability = observed.detection_probability(hypotheses.state[:, 0::2])
    sensor = observed.picture.number
    detection_probability = detection_probability * visible_share(hypotheses.faded[:, sensor])
    missed = miss(hypotheses, detection_probability, gate_probability, sensor)
    score = np.empty(len(parent))
    for first in range(0, len(parent), MAX_PAIRS_TOGETHER):
        part = slice(first, first + MAX_PAIRS_TOGETHER)
        score[part] = child_score(
            expected, detection_probability, parent[part], observed, row[part], gate_probability
        )
    return missed, score


def child_score(
    expected: ExpectedDetections,
    detection_probability: FloatArray,
    parent: IntArray,
    observed: Observation,
    row: IntArray,
    gate_probability: float,
) -> FloatArray:
    """Score of each child (p,) of a hypothesis and a detection.

    Parameters
    ----------
    expected : ExpectedDetections
    detection_probability : (n,) ndarray
        P_D where each expects its target.
    parent, row : (p,) ndarray of int
        Hypothesis and detection of each child.
    observed : Observation
    gate_probability : float
        P_G.

    Returns
    -------
    (p,) ndarray
        -inf outside the gate, or where P_D is 0.
    """
    density = expected.log_likelihood(parent, row, gate_probability)
    other = observed.clutter_density / (1.0 - observed.confirmed_probability)
    increment = hit_increment(density, detection_probability[parent], other[row])
    hypotheses = expected.hypotheses
    score: FloatArray = hypotheses.score[parent] + increment
    if observed.picture.sensors > 1:  # the window of a slow sensor has more scans of others
        score[hypotheses.hit_count[parent] >= hypotheses.hits.shape[1]] = -np.inf
    if observed.predictive is not None:
        score += observed.predictive.increment(hypotheses.hit_count, parent, row)
    if observed.amplitudes is not None:
        hits, total = hypotheses.amplitude_count[parent], hypotheses.amplitude_total[parent]
        score += observed.amplitudes.added(row, hits, total)[2]
    return score


def miss(
    predicted: Hypotheses,
    detection_probability: FloatArray,
    gate_probability: float,
    sensor: int = 0,
) -> Hypotheses:
    """The branches of all hypotheses that leave the scan out.

    Parameters
    ----------
    predicted : Hypotheses
    detection_probability : (n,) ndarray
        P_D where each expects its target.
    gate_probability : float
        P_G.
    sensor : int, optional
        Number of the sensor that looked.
    """
    faded = fading_after_miss(predicted.faded[:, sensor], detection_probability, gate_probability)
    increment = miss_increment(detection_probability, gate_probability)
    return replaced(
        predicted,
        score=predicted.score + increment,
        faded=with_column(predicted.faded, sensor, faded),
    )


def within_max_speed(hypotheses: Hypotheses, counts: BoolArray, max_speed: float) -> Hypotheses:
    """The hypotheses; those that count (n,) with their scores under the prior that ends at v_max.

    ``s + ln P(|v| <= v_max | N(x, P)) - ln P_0``. That of a single hit is as before: its posterior
    is the prior.
    """
    rows = np.flatnonzero(counts & (hypotheses.hit_count >= 2))
    gain = np.zeros(len(hypotheses))
    gain[rows] = LOG_GAIN + motion.log_speed_probability(
        hypotheses.state[rows], hypotheses.covariance[rows], max_speed
    )
    return replaced(hypotheses, score=hypotheses.score + gain)
