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

Of TSEPM 2018 (Eqs. 4-5, Section 3.2, Step 2): `gate`, `split_paths`.

Of the likelihood-ratio method, with x, P the state of a hypothesis, S its innovation covariance::

    predicted     x <- F x,  P <- F P F' + Q
    child         by each z with d' S^-1 d <= gamma (d = z - H x)
    missed        without a detection of the scan
    started       by every detection; its velocity has variance v_max^2 / 4 on each axis
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from tsepm_ros.numerics.arrays import FloatArray, IntArray, replaced, rows_of, rows_of_least_cost
from tsepm_ros.numerics.discs import pairs_within_discs
from tsepm_ros.numerics.gaussian import gate_factor
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
from tsepm_ros.tracker.initial_state import new_paths
from tsepm_ros.tracker.measurement import covariance_at, major_sigma
from tsepm_ros.tracker.observation import Observation

MAX_GATED = 5_000_000
"""Largest number of detections in all gates of a scan; above, only the nearest are used."""
SPLIT_BLOCK = 1_000_000
"""Children processed together where a limit applies: bounds memory, not the result."""
GATE_MARGIN = 1.5
"""The error at the predicted position may be this much larger than at the detection's."""
RADIUS_ROUNDING = 1e-9
"""Relative margin of a radius beyond rounding errors."""


@dataclass(frozen=True)
class Gates:
    """The detections in each gate, as compressed rows.

    Attributes
    ----------
    start : (g + 1,) ndarray of int
        Gate i holds ``detection[start[i]:start[i + 1]]``.
    detection : (p,) ndarray of int
        Rows of the gated detections, ascending within a gate.
    cut : int
        Detections left out of gates because of `MAX_GATED`.
    """

    start: IntArray
    detection: IntArray
    cut: int = 0

    @cached_property
    def count(self) -> IntArray:
        """Number of detections in each gate, (g,)."""
        return self.start[1:] - self.start[:-1]


def gate(
    last_hits: NDArray[np.void],
    detections: NDArray[np.void],
    max_speed: float,
    probability: float,
    most: float = math.inf,
) -> Gates:
    """Find the detections inside the gate of each last hit (Eq. 4).

    ``|z_j - z_i| <= v_max |t_j - t_i| + alpha sigma_Rmax`` bounds the displacement of a target
    from hit i; sigma_Rmax is the major axis of hit i's error. Range rates of both, if used, must
    agree with each other and with the displacement along the line of sight, within the same
    probability (`range_rates.agree`).

    Parameters
    ----------
    last_hits : (g,) ndarray of DETECTION
        Last hits of the potential tracks, without duplicates.
    detections : (n,) ndarray of DETECTION
        Detections of the new scan.
    max_speed : float
        v_max, m/s.
    probability : float
        Gate probability P of Eq. 5.
    most : float, optional
        Pairs, see `neighbours`.

    Returns
    -------
    Gated
        A row per last hit.
    """
    margin = gate_factor(probability) * last_hits["major_sigma"]
    squared = gate_factor(probability) ** 2
    return gate_within(last_hits, detections, max_speed, margin, squared, most)


def gate_within(
    last_hits: NDArray[np.void],
    detections: NDArray[np.void],
    max_speed: float,
    margin: FloatArray,
    range_rate_gate: float = math.inf,
    most: float = math.inf,
) -> Gates:
    """Find the detections within ``v_max |t_j - t_i|`` and a margin (g,), m, of each last hit.

    Range rates are gated if `range_rate_gate` is finite. See `gate`.
    """
    n_gates = len(last_hits)
    if n_gates == 0 or len(detections) == 0:
        return Gates(np.zeros(n_gates + 1, np.int64), np.zeros(0, np.int64))
    times = detections["time"]
    first, last = times.min(), times.max()
    longest = np.maximum(np.abs(first - last_hits["time"]), np.abs(last - last_hits["time"]))
    # Slightly larger radii for the k-d tree's candidates; the exact test follows.
    radius = (margin + max_speed * longest) * (1.0 + RADIUS_ROUNDING)
    positions = np.ascontiguousarray(detections["position"])
    centres = np.ascontiguousarray(last_hits["position"])
    owner, candidate, cut = neighbours(positions, centres, radius, most)
    displacement = positions[candidate] - centres[owner]
    elapsed = np.abs(times[candidate] - last_hits["time"][owner])
    inside = np.hypot(displacement[:, 0], displacement[:, 1]) <= max_speed * elapsed + margin[owner]
    if math.isfinite(range_rate_gate) and range_rates.measured(detections).any():
        near = np.flatnonzero(inside)
        inside[near] = range_rates.agree(
            rows_of(last_hits, owner[near]),
            rows_of(detections, candidate[near]),
            max_speed,
            range_rate_gate,
        )
    start = np.zeros(n_gates + 1, np.int64)
    np.cumsum(np.bincount(owner[inside], minlength=n_gates), out=start[1:])
    return Gates(start, candidate[inside], cut)


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


def children_in_gates(gate_of_track: IntArray, gated: Gates) -> tuple[IntArray, IntArray]:
    """Split every potential track into one child per gated detection (Section 3.2).

    Parameters
    ----------
    gate_of_track : (n,) ndarray of int
        The gate (row of `gated`) that each potential track uses.
    gated : Gated
        Detections in each gate.

    Returns
    -------
    parent : (c,) ndarray of int
        Potential track of each child, ascending.
    detection : (c,) ndarray of int
        Detection that the child adds as its newest hit.
    """
    counts = gated.count[gate_of_track]
    parent = np.repeat(np.arange(len(gate_of_track)), counts)
    first_child = np.cumsum(counts) - counts
    child_of_parent = np.arange(len(parent)) - first_child[parent]
    return parent, gated.detection[gated.start[gate_of_track[parent]] + child_of_parent]


def split_paths(
    gate_of_track: IntArray,
    gated: Gates,
    limit: int,
    cost: Callable[[IntArray, IntArray], NDArray[np.float64]],
    most: float = math.inf,
) -> tuple[IntArray, IntArray, int]:
    """Split every potential track, and keep the `limit` children of least cost.

    Parameters
    ----------
    gate_of_track, gated
        As in `children_in_gates`.
    limit : int
        Largest number of children.
    cost : callable
        Cost of children (parent, detection); evaluated only above the limit.
    most : float, optional
        Children that are looked at, and those of one track more: those of no further tracks are.

    Returns
    -------
    parent, detection : (c,) ndarray of int
        As in `children_in_gates`.
    cut : int
        Children left out.
    """
    counts = gated.count[gate_of_track]
    total = int(counts.sum())
    if total <= limit:
        return *children_in_gates(gate_of_track, gated), 0
    parent = detection = np.zeros(0, np.int64)
    costs = np.zeros(0)
    begun = np.cumsum(counts) - counts
    looked = begun[: np.searchsorted(begun, most)]
    blocks = np.searchsorted(looked, np.arange(0, total, SPLIT_BLOCK))
    for begin, end in itertools.pairwise(np.unique([*blocks, len(looked)])):
        rows, added = children_in_gates(gate_of_track[begin:end], gated)
        parent = np.concatenate([parent, rows + begin])
        detection = np.concatenate([detection, added])
        costs = np.concatenate([costs, cost(rows + begin, added)])
        best = rows_of_least_cost(costs, limit)
        parent, detection, costs = parent[best], detection[best], costs[best]
    return parent, detection, total - len(parent)


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
    if not len(expected.hypotheses) or not len(detections):
        return np.zeros(0, np.int64), np.zeros(0, np.int64), 0
    reach = motion.gate_reach(gate_probability, detections)
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

    With p the probability that the detection is a confirmed track's. The velocity is unknown up to
    v_max: uniform over the disc, of variance v_max^2 / 4 on each axis. The first range rate, if
    measured, updates it along the line of sight and contributes to the score.

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
    state, covariance = np.zeros((n, 4)), np.zeros((n, 4, 4))
    state[:, 0::2] = detections["position"]
    covariance[:, 0::2, 0::2] = detections["covariance"]
    covariance[:, [1, 3], [1, 3]] = max_speed**2 / 4.0
    state, covariance, score = range_rates.begun(
        state, covariance, detections, observed.clutter_sensor
    )
    # An echo is of a time after the stamp; a hypothesis' state is at the stamp.
    elapsed = observed.stamp - detections["time"]
    if elapsed.any():
        state, covariance = motion.predict(state, covariance, elapsed)
    row, none = np.arange(n), np.zeros(n, np.int64)
    amplitude = path_amplitudes(observed, row, none, np.zeros(n))
    score = score + amplitude.increment + np.log1p(-observed.confirmed_probability)
    return Hypotheses(
        path.hits,
        path.hit_count,
        path.first_scan,
        state,
        covariance,
        score,
        np.full((n, observed.picture.sensors), FADED_AT_START),
        *amplitude,
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
    number = int(np.count_nonzero(kept < len(missed)))
    ended = kept[number:] - len(missed)
    made = np.bincount(ended, minlength=len(score) + len(started)) > 0
    rows = np.flatnonzero(made[: len(score)])  # in the order of the parents: these are read in turn
    firsts = range(0, max(len(rows), 1), MAX_PAIRS_TOGETHER)
    children = [
        _children(expected, pairs[0][part], pairs[1][part], score[part], observed)
        for part in (rows[begin : begin + MAX_PAIRS_TOGETHER] for begin in firsts)
    ]
    new = Hypotheses.joined(*children, started[made[len(score) :]])
    hypotheses = Hypotheses.chosen((missed, kept[:number]), (new, (np.cumsum(made) - 1)[ended]))
    return Tree(hypotheses, number, observed.ids)


def _children(
    expected: ExpectedDetections,
    parent: IntArray,
    row: IntArray,
    score: FloatArray,
    observed: Observation,
) -> Hypotheses:
    """The children of hypotheses and detections, with their scores, (p,)."""
    hypotheses = expected.hypotheses
    hits = hypotheses.hits.take(parent, axis=0)
    count = hypotheses.hit_count[parent]
    hits[np.arange(len(parent)), count] = observed.ids[row]
    amplitude = path_amplitudes(
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
        score,
        with_column(faded, sensor, fading_after_hit(faded[:, sensor])),
        amplitude.hits,
        amplitude.total,
        hypotheses.amplitude_score[parent] + amplitude.increment,
    )
