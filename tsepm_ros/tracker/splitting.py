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
"""Splitting: a potential track goes on by each detection in its gate, and every other starts one.

With x, P the state of a hypothesis, S its innovation covariance::

    predicted     x <- F x,  P <- F P F' + Q
    child         by each z with d' S^-1 d <= gamma (d = z - H x)
    missed        without a detection of the scan
    started       by every detection; its velocity has variance v_max^2 / 4 on each axis
"""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial import cKDTree

from tsepm_ros.numerics.arrays import FloatArray, IntArray, replaced
from tsepm_ros.numerics.discs import pairs_within_discs
from tsepm_ros.tracker import motion, range_rates
from tsepm_ros.tracker.evaluation import (
    FADED_AT_START,
    MAX_PAIRS_TOGETHER,
    fading_after_hit,
    fading_predicted,
    path_amplitudes,
    with_column,
)
from tsepm_ros.tracker.hypotheses import ExpectedDetections, Hypotheses, Tree
from tsepm_ros.tracker.initial_state import first_states, new_paths
from tsepm_ros.tracker.measurement import covariance_at, major_sigma
from tsepm_ros.tracker.observation import Observation

MAX_GATED = 5_000_000
"""Largest number of detections in all gates of a scan; above, only the nearest are used."""
GATE_MARGIN = 1.5
"""The error at the predicted position may be this much larger than at the detection's."""
RADIUS_ROUNDING = 1e-9
"""Relative margin of a radius beyond rounding errors."""


def neighbours(
    positions: FloatArray,
    centres: FloatArray,
    radius: FloatArray,
    most: float = math.inf,
) -> tuple[IntArray, IntArray, int]:
    """Pairs of centres and positions within their radius.

    Beyond a number of pairs, only the nearest positions of each centre are kept: the displacement
    is the first feature that separates targets from clutter.

    Parameters
    ----------
    positions : (n, 2) ndarray
        m.
    centres : (g, 2) ndarray
        m.
    radius : (g,) ndarray
        m.
    most : float, optional
        Pairs; never more than `MAX_GATED`, and always one of each centre.

    Returns
    -------
    centre, position : (p,) ndarray of int
        Rows of each pair, ascending.
    cut : int
        Pairs left out.
    """
    most = int(min(most, MAX_GATED))
    pairs = pairs_within_discs(positions, centres, radius, most)
    if pairs is not None:
        return *pairs, 0
    tree = cKDTree(positions)
    counts = tree.query_ball_point(centres, radius, return_length=True)
    nearest = min(max(most // len(centres), 1), len(positions))
    distance, kept = tree.query(centres, k=range(1, nearest + 1))
    near = np.where(distance <= radius[:, None] * (1.0 + RADIUS_ROUNDING), kept, len(positions))
    near = np.sort(near, axis=1)
    centre, index = np.nonzero(near < len(positions))
    cut = int(counts.sum()) - int(np.minimum(counts, nearest).sum())
    return centre, near[centre, index].astype(np.int64), cut


def predict(
    hypotheses: Hypotheses, interval: float, process_noise: float, sensor: int = 0
) -> Hypotheses:
    """The hypotheses after a time interval, s, with nearly constant velocity."""
    state, covariance = motion.predict(
        hypotheses.state, hypotheses.covariance, interval, process_noise
    )
    faded = with_column(hypotheses.faded, sensor, fading_predicted(hypotheses.faded[:, sensor]))
    return replaced(hypotheses, state=state, covariance=covariance, faded=faded)


def split(
    expected: ExpectedDetections,
    gate_probability: float,
    most: float = math.inf,
) -> tuple[IntArray, IntArray, int]:
    """Split every hypothesis: pairs with the detections that may be its next, no fewer than gated.

    The gate of the squared Mahalanobis distance is ``d' S^-1 d <= gamma``, of probability P_G; here
    its circumscribed circle of radius ``sqrt(gamma) sigma_max(S)``.

    Parameters
    ----------
    expected : ExpectedDetections
    gate_probability : float
        P_G.
    most : float, optional
        Pairs.

    Returns
    -------
    hypothesis, detection : (p,) ndarray of int
        Rows of each pair, ascending.
    cut : int
        Pairs left out by a limit, see `neighbours`.
    """
    detections = expected.detections
    if not len(expected.hypotheses.state) or not len(detections):
        return np.zeros(0, np.int64), np.zeros(0, np.int64), 0
    reach = motion.gate_reach(gate_probability, expected.rated)
    if expected.of_hypothesis is not None:
        centres, spread = expected.of_hypothesis
        radius = reach * major_sigma(spread) * (1.0 + RADIUS_ROUNDING)
    else:
        centres, radius = _widest_gate(expected, reach)
    positions = np.ascontiguousarray(detections["position"])
    return neighbours(positions, centres, radius, most)


def _widest_gate(expected: ExpectedDetections, reach: float) -> tuple[FloatArray, FloatArray]:
    """Positions of the hypotheses (n, 2), and radii that hold the gate of any detection."""
    state, covariance = expected.hypotheses.state, expected.hypotheses.covariance
    detections = expected.detections
    widest = detections[np.argmax(detections["azimuth_std"])].copy()
    widest["range_std"] = detections["range_std"].max()  # nan: the sensor model's
    positions = np.ascontiguousarray(state[:, 0::2])
    every = np.broadcast_to(widest, len(positions))
    error = major_sigma(covariance_at(every, positions, expected.sensor))
    longest = np.abs(detections["time"] - expected.stamp).max()
    position_sigma = major_sigma(covariance[:, 0::2, 0::2])
    speed_sigma = major_sigma(covariance[:, 1::2, 1::2])
    sigma = np.hypot(position_sigma + longest * speed_sigma, GATE_MARGIN * error)
    speed = np.hypot(state[:, 1], state[:, 3])
    return positions, reach * sigma + longest * speed


def start(observed: Observation, max_speed: float, window: int) -> Hypotheses:
    """Start a hypothesis from every detection, of the score ``ln(1 - p)``.

    With p the probability that the detection is a confirmed track's. The first range rate, if
    measured, updates the unknown velocity along the line of sight and contributes to the score.

    Parameters
    ----------
    observed : Observation
        The scan.
    max_speed : float
        v_max, m/s.
    window : int
        Hits that a hypothesis may have.

    Returns
    -------
    Hypotheses
        Of one hit each.
    """
    detections = observed.detections
    path, n = new_paths(observed.ids, observed.scan_index, window), len(detections)
    state, covariance, score = range_rates.begun(
        *first_states(detections, max_speed), detections, observed.clutter_sensor
    )
    # An echo is of a time after the stamp; a hypothesis' state is at the stamp.
    elapsed = observed.stamp - detections["time"]
    if elapsed.any():
        state, covariance = motion.predict(state, covariance, elapsed)
    row, none = np.arange(n), np.zeros(n, np.int64)
    told, total, increment = path_amplitudes(observed, row, none, np.zeros(n))
    score = score + increment + np.log1p(-observed.confirmed_probability)
    return Hypotheses(
        path.hits,
        path.hit_count,
        path.first_scan,
        state,
        covariance,
        score,
        np.full((n, observed.picture.sensors), FADED_AT_START),
        told,
        total,
    )


def expand(
    expected: ExpectedDetections,
    parts: tuple[Hypotheses, FloatArray, Hypotheses],
    pairs: tuple[IntArray, IntArray],
    kept: IntArray,
    observed: Observation,
) -> Tree:
    """The tree of the branches that are kept.

    Parameters
    ----------
    expected : ExpectedDetections
    parts : tuple of Hypotheses, (p,) ndarray, Hypotheses
        Those that leave the scan out, the scores of the children, and those that start in it.
    pairs : tuple of (p,) ndarray of int
        Hypothesis and detection of each child.
    kept : (k,) ndarray of int
        Rows of the parts, put together, in the order of their newest detections.
    observed : Observation
    """
    missed, score, started = parts
    number, first = int(np.count_nonzero(kept < len(missed.score))), len(score)
    ended = kept[number:] - len(missed.score)
    made = np.arange(first + len(started.score)) >= first  # the starts, and the kept children
    made[ended] = True
    rows = made[:first].nonzero()[0]  # in the order of the parents: these are read in turn
    new = Hypotheses.joined(
        *(
            _children(expected, pairs, rows[begin : begin + MAX_PAIRS_TOGETHER], score, observed)
            for begin in range(0, len(rows), MAX_PAIRS_TOGETHER)
        ),
        started,
    )
    hypotheses = Hypotheses.chosen((missed, kept[:number]), (new, (np.cumsum(made) - 1)[ended]))
    return Tree(hypotheses, number, observed.ids)


def _children(
    expected: ExpectedDetections,
    pairs: tuple[IntArray, IntArray],
    rows: IntArray,
    score: FloatArray,
    observed: Observation,
) -> Hypotheses:
    """The children of hypotheses and detections, of some rows (k,) of these pairs."""
    hypotheses, parent, row = expected.hypotheses, pairs[0][rows], pairs[1][rows]
    hits = hypotheses.hits.take(parent, axis=0)
    count = hypotheses.hit_count[parent]
    hits[np.arange(len(parent)), count] = observed.ids[row]
    told, total, _ = path_amplitudes(
        observed, row, hypotheses.amplitude_count[parent], hypotheses.amplitude_total[parent]
    )
    state, covariance = expected.updated(parent, row)
    faded, sensor = hypotheses.faded[parent], observed.picture.number
    return Hypotheses(
        hits,
        count + 1,
        hypotheses.first_scan[parent],
        state,
        covariance,
        score[rows],
        with_column(faded, sensor, fading_after_hit(faded[:, sensor])),
        told,
        total,
    )
