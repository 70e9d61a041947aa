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
"""Hypotheses: which detections are one target's, and where it is; the tree of them after a scan.

Hypotheses are tentative (potential) tracks, in the order of their newest detections: those of one
newest detection are a run of rows, and those that end in the last scan come last.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Generic, TypeVar

import numpy as np
from scipy.special import expit

from tsepm_ros.numerics.arrays import (
    FloatArray,
    IntArray,
    RecordArray,
    Rows,
    log_sums,
    replaced,
    rows_of,
    sums_over_hits,
)
from tsepm_ros.tracker import motion, range_rates
from tsepm_ros.tracker.initial_state import Paths
from tsepm_ros.tracker.measurement import DETECTION, covariance_at
from tsepm_ros.tracker.sensor import SensorModel

PRIOR_TARGET_ODDS = 0.001
"""Prior odds, for the clutter map, that a detection is of a target that began in a given scan."""
_MARKS = np.zeros(1, DETECTION)
for _name in (
    *("time", "range_std", "azimuth_std", "least_across"),
    *("sensor_pose", "sensor_pose_covariance"),
):
    _MARKS[_name] = np.frombuffer(b"\xff" * 8)
_ERRORS = np.flatnonzero(_MARKS.view(np.uint8))
"""Bytes of a detection on which its innovation covariance with a hypothesis depends."""


@dataclass(frozen=True, eq=False)
class States(Rows):
    """States (n, 4) and covariances (n, 4, 4) that expect detections."""

    state: FloatArray
    covariance: FloatArray


@dataclass(frozen=True)
class Hypotheses(Paths):
    """Hypotheses as arrays, a row each.

    Attributes
    ----------
    hits, hit_count, first_scan
        As in `Paths`, for at most `window` hits.
    state, covariance : (n, 4), (n, 4, 4) ndarray
        At the last scan's stamp.
    score : (n,) ndarray
        Log-likelihood ratio of one more target, given the confirmed tracks.
    faded : (n, s) ndarray
        Probability that the target has faded for each sensor, see `evaluation`.
    amplitude_count, amplitude_total : (n,) ndarray
        Hits whose amplitude counts, and the sum of their normalised amplitudes; see
        `amplitude_law`.
    """

    state: FloatArray
    covariance: FloatArray
    score: FloatArray
    faded: FloatArray
    amplitude_count: IntArray
    amplitude_total: FloatArray

    @classmethod
    def none(cls, window: int, sensors: int = 1) -> Hypotheses:
        """No hypotheses."""
        count = np.zeros(0, np.int64)
        return cls(
            np.zeros((0, window), np.int64),
            count,
            count,
            np.zeros((0, 4)),
            np.zeros((0, 4, 4)),
            np.zeros(0),
            np.zeros((0, sensors)),
            count,
            np.zeros(0),
        )


@dataclass(frozen=True)
class Tree:
    """The hypotheses after a scan, in the order of their newest detections.

    Attributes
    ----------
    hypotheses : Hypotheses
    missed : int
        Number of those that leave the scan out: they come first.
    ids : (d,) ndarray of int
        Ids of the scan's detections, ascending.
    """

    hypotheses: Hypotheses
    missed: int
    ids: IntArray

    @cached_property
    def newest(self) -> IntArray:
        """Place in the scan of the last hit of each hypothesis that ends in it."""
        return self.hypotheses.last_hit[self.missed :] - (self.ids[0] if len(self.ids) else 0)

    @cached_property
    def evidence(self) -> FloatArray:
        """``ln sum_i exp(s_i)`` over the hypotheses that end in each detection, (d,)."""
        return self.summed(self.hypotheses.score)

    def summed(self, score: FloatArray) -> FloatArray:
        """Log of the likelihood ratios (n,), summed over those that end in each detection, (d,).

        -inf where none does.
        """
        return log_sums(score[self.missed :], self.newest, len(self.ids))

    def ending_in(self, detection: int) -> Hypotheses:
        """The hypotheses that end in a detection of the scan."""
        first, last = np.searchsorted(self.newest, [detection, detection + 1]) + self.missed
        return self.hypotheses[slice(first, last)]

    @property
    def target_probability(self) -> FloatArray:
        """Probability that each detection is that of a target not confirmed yet, (d,)."""
        return np.asarray(expit(self.evidence + math.log(PRIOR_TARGET_ODDS)))


@dataclass(frozen=True)
class Start:
    """A track to be confirmed.

    Attributes
    ----------
    hits : (h,) ndarray of int
        Detections that are credible hits of the target, ascending.
    path : (p,) ndarray of int
        Detections of the best hypothesis, ascending.
    detections, probability : (c,) ndarray
        All detections that may be the target's, ascending, and the probability of each.
    state, covariance : (4,), (4, 4) ndarray
    evidence : float
        Of the newest detection.
    newest : int
        That detection: the best hypothesis may have missed it.
    """

    hits: IntArray
    path: IntArray
    detections: IntArray
    probability: FloatArray
    state: FloatArray
    covariance: FloatArray
    evidence: float
    newest: int


def given_starts(hypotheses: Hypotheses, starts: Sequence[Start]) -> Hypotheses:
    """The hypotheses given new tracks too.

    ``s <- s - max(s, 0) sum_k p_k / n`` with p_k the probability that hit k of n is a new track's:
    as if each hit had the same increment.
    """
    score = hypotheses.score
    for start in starts:
        due = sums_over_hits(hypotheses.hits, start.detections, start.probability)
        score = score - due / hypotheses.hit_count * np.maximum(score, 0.0)
    return replaced(hypotheses, score=score)


H = TypeVar("H", States, Hypotheses)


@dataclass(frozen=True, eq=False)
class ExpectedDetections(Generic[H]):
    """What hypotheses expect of a scan's detections.

    Where the detections have one time and one error model, as without times and poses of their own,
    the innovation covariance, the gain and the updated covariance depend on the hypothesis alone.

    Attributes
    ----------
    hypotheses : States or Hypotheses
        Predicted to the scan.
    stamp : float
        The scan's, s.
    detections : (d,) ndarray of DETECTION
    sensor : SensorModel
    rated : bool
        Whether any detection has a range rate.
    of_hypothesis : tuple of (n, 2) and (n, 2, 2) ndarray, or None
        Expected position, m, and innovation covariance, m^2, of any detection; None where these
        differ from detection to detection.
    """

    hypotheses: H
    stamp: float
    detections: RecordArray
    sensor: SensorModel
    rated: bool
    of_hypothesis: tuple[FloatArray, FloatArray] | None

    @classmethod
    def from_hypotheses(
        cls,
        hypotheses: H,
        stamp: float,
        detections: RecordArray,
        sensor: SensorModel,
    ) -> ExpectedDetections[H]:
        """What hypotheses that are predicted to a scan expect of its detections."""
        common = None
        if len(detections) and len(hypotheses.state) and _alike(detections):
            first = detections[:1]
            after = first["time"] - stamp
            expected = motion.position_after(hypotheses.state, after)
            spread = motion.position_covariance_after(hypotheses.covariance, after)
            spread += covariance_at(first, expected, sensor)
            common = expected, spread
        rated = bool(range_rates.measured(detections).any())
        return cls(hypotheses, stamp, detections, sensor, rated, common)

    def innovations(self, parent: IntArray, row: IntArray) -> tuple[FloatArray, FloatArray]:
        """Innovations (p, 2), m, and their covariances (p, 2, 2), m^2, of pairs."""
        if not len(parent):  # as in an empty ping
            return np.zeros((0, 2)), np.zeros((0, 2, 2))
        if self.of_hypothesis is not None:
            expected, spread = self.of_hypothesis
            innovation = self.detections["position"].take(row, axis=0)
            innovation -= expected.take(parent, axis=0)
            return innovation, spread.take(parent, axis=0)
        detections = rows_of(self.detections, row)
        return motion.innovations(
            self.hypotheses.state[parent],
            self.hypotheses.covariance[parent],
            detections["time"] - self.stamp,
            detections,
            self.sensor,
        )

    def log_likelihood(
        self, parent: IntArray, row: IntArray, gate_probability: float
    ) -> FloatArray:
        """Log of the likelihood of each pair's detection, (p,); see `motion.log_likelihood`."""
        innovation, spread = self.innovations(parent, row)
        return motion.log_likelihood(
            self.hypotheses.state,
            self.hypotheses.covariance,
            parent,
            self.stamp,
            innovation,
            spread,
            self.detections,
            row,
            gate_probability,
        )

    def updated(self, parent: IntArray, row: IntArray) -> tuple[FloatArray, FloatArray]:
        """States (p, 4) and covariances (p, 4, 4) of hypotheses after a detection.

        The position comes first, then the range rate, where there is one.
        """
        state, covariance = self.hypotheses.state, self.hypotheses.covariance
        innovation, spread = self.innovations(parent, row)
        time_after_state = self.detections["time"][row] - self.stamp
        moved, narrowed = motion.update(
            state.take(parent, axis=0),
            covariance.take(parent, axis=0),
            time_after_state,
            innovation,
            spread,
        )
        if not self.rated:
            return moved, narrowed
        return range_rates.update(moved, narrowed, time_after_state, rows_of(self.detections, row))


def _alike(detections: RecordArray) -> bool:
    """Whether all detections have the time, the pose and the errors of the first."""
    errors = detections.view((np.uint8, detections.itemsize)).take(_ERRORS, axis=1)
    return bool((errors == errors[0]).all())
