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
"""The improved sequential method: a gate of kinematics and sensor error, M of N (Sequential 2014).

Ji D., Li D., "An improved sequential initiation method for multitarget track in clutter with large
noise measurement", Math. Probl. Eng. 2014, 394297.

A detection continues a potential track whose last hit, k scans ago, it lies near (Eq. 7)::

    |r_(i+k) - r_i| <= v_max k T + 2 sigma

with sigma "the 1 standard error of measurement distance". A detection that was matched is removed,
the others start potential tracks (Steps 3-5); 6 hits within 10 scans are a track, fewer are none
(Section 4.1). The initial state is the least-squares fit (Eq. 11), or one of the two that the
article compares it with (Table 1). The article prints least squares only; what linear fitting and
the Kalman filter are is read here as written at each function.

Readings
--------
- k T is the time between the detections. The sensor moves: r is in the fixed frame.
- sigma is the deviation of the range error at the last hit; `gate_error` "major_axis" reads it as
  the larger axis of the position's error, as the papers of 2016 and 2018 do.
- Step 3 does not assign a detection in the gates of several tracks; `matching` has the
  readings. "oldest": the tracks in the order of their first scans, each with what is nearest to it
  of what is left; of tracks that Step 5 made in one scan, the nearest pair goes first. Section 4.1
  and Figs. 3 and 4 support the order of the scans: there points outside the gate, which start
  tracks of their own, keep none of the later ones from the track, and "if there are 6
  or more than 6 points which satisfy the threshold, it is considered that a track exists".
  "nearest": the nearest pair of all first, then the nearest of what is left; a track started by an
  echo outside the gate then takes the target's next ones, and the examples depend on where the
  points lie. "shared": each track takes what is nearest to it, and a detection "removed" only
  starts none; the article then starts a target once for each of its tracks, since no displacement
  merges them. Here, as with the other methods, the best of the tracks that share a hit is
  published.
- A track that can no longer reach M hits is deleted when its N scans are over (Section 4.1), not
  as soon as that is known: it matches, and so removes, detections until then.
- A confirmed track no longer matches detections: its target starts anew, as with the other methods.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from tsepm_ros.numerics.arrays import FloatArray, RecordArray
from tsepm_ros.parameters import parameter
from tsepm_ros.studies.assignment import (
    AssignmentPairs,
    best_assignment_of_each,
    nearest_first_assignment,
    oldest_first_assignment,
)
from tsepm_ros.studies.path_following import PathFollower
from tsepm_ros.tracker.initial_state import Fit, Paths, fit_states
from tsepm_ros.tracker.measurement import measured_polar, range_variance_at
from tsepm_ros.tracker.motion import predict, update
from tsepm_ros.tracker.options import MnOptions, hits_option, window_option
from tsepm_ros.tracker.sensor import SensorModel

ESTIMATORS = ("least_squares", "linear_fitting", "kalman_filter")


def sequential_estimate(
    hits: RecordArray, stamp: float, sensor: SensorModel, estimator: str, noise: float
) -> Fit:
    """Estimate the state at `stamp` from the hits of each track.

    Parameters
    ----------
    hits : (n, m) ndarray of DETECTION
        The hits of n tracks, m >= 2 at different times; nan where they are not.
    stamp : float
        Time of the state, s.
    sensor : SensorModel
    estimator : {"least_squares", "linear_fitting", "kalman_filter"}
        ``X = (H'H)^-1 H'Z`` (Eq. 11), `sequential_line`, or `sequential_kalman`.
    noise : float
        Process noise of the Kalman filter, m^2/s^3.

    Returns
    -------
    Fit
    """
    least_squares = fit_states(hits, stamp, sensor, "unweighted")
    if estimator == "least_squares":
        return least_squares
    time_after_state, raw = least_squares.time_after_state, hits["covariance"]
    if estimator == "kalman_filter":
        return Fit(
            *sequential_kalman(time_after_state, hits["position"], raw, noise),
            time_after_state,
            raw,
        )
    state, covariance = sequential_line(time_after_state, hits["position"], raw)
    # Where all hits are at one place there is no line.
    point = np.isnan(covariance).any(axis=(1, 2))
    state[point] = least_squares.state[point]
    covariance[point] = least_squares.covariance[point]
    return Fit(state, covariance, time_after_state, raw)


@np.errstate(invalid="ignore", divide="ignore")  # no line, or no time between the ends: nan
def sequential_line(
    time_after_state: FloatArray, positions: FloatArray, covariances: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Straight line through the hits' positions, run along from the first hit to the last.

    The line goes through the mean along the axis of largest variance, unit vector u (total least
    squares: no axis is special; the other reading is a regression of y on x). With
    ``a_i = u'(z_i - mean)`` the target is at ``mean + u a_m`` at the last hit's time and moves at
    ``u (a_m - a_1) / (t_m - t_1)``: the times of the hits between do not count, a loss against
    least squares. The covariance is to first order in the errors: along u from the ends, across u
    from the line's offset and slope. It is too small where the errors are not small against the
    path, since u is then uncertain.

    Parameters
    ----------
    time_after_state : (n, m) ndarray
        Time of each hit after the state's, s.
    positions : (n, m, 2) ndarray
        m.
    covariances : (n, m, 2, 2) ndarray
        R_i, m^2.

    Returns
    -------
    state : (n, 4) ndarray
    covariance : (n, 4, 4) ndarray
    """
    n, m = time_after_state.shape
    mean = positions.mean(axis=1)
    centred = positions - mean[:, None]
    scatter = np.swapaxes(centred, 1, 2) @ centred
    angle = 0.5 * np.arctan2(2.0 * scatter[:, 0, 1], scatter[:, 0, 0] - scatter[:, 1, 1])
    cosine, sine = np.cos(angle), np.sin(angle)
    axes = np.stack([cosine, sine, -sine, cosine], axis=1).reshape(n, 2, 2)  # rows: along, across
    along = (centred @ axes[:, 0, :, None])[..., 0]
    time = time_after_state[:, -1] - time_after_state[:, 0]
    speed = (along[:, -1] - along[:, 0]) / time
    velocity = axes[:, 0] * speed[:, None]
    state = np.zeros((n, 4))
    state[:, 1::2] = velocity
    state[:, 0::2] = mean + axes[:, 0] * along[:, -1:] - time_after_state[:, -1:] * velocity
    weights = np.zeros((n, 2, 2, m))  # axis; position, velocity
    weights[:, 0, 1, -1], weights[:, 0, 1, 0] = 1.0 / time, -1.0 / time
    weights[:, 0, 0] = -time_after_state[:, -1:] * weights[:, 0, 1]
    weights[:, 0, 0, -1] += 1.0
    slope = along / np.square(along).sum(axis=1, keepdims=True)  # of the line, by an error across
    position = along[:, -1] - time_after_state[:, -1] * speed
    weights[:, 1, 0] = 1.0 / m + position[:, None] * slope
    weights[:, 1, 1] = speed[:, None] * slope
    turned = axes[:, None] @ covariances @ np.swapaxes(axes, 1, 2)[:, None]  # (n, m, 2, 2)
    blocks = np.einsum("npam,nqbm,nmpq->npaqb", weights, weights, turned)
    covariance = np.einsum("npx,npaqb,nqy->nxayb", axes, blocks, axes).reshape(n, 4, 4)
    return state, covariance


@np.errstate(invalid="ignore", divide="ignore")  # equal times have no velocity: nan
def sequential_kalman(
    time_after_state: FloatArray, positions: FloatArray, covariances: FloatArray, noise: float
) -> tuple[FloatArray, FloatArray]:
    """Kalman filter over the hits, begun by two-point differencing, then carried to the stamp.

    The first two hits give position and velocity, ``x = z_2, v = (z_2 - z_1) / dt`` with the
    covariance that their errors make (Bar-Shalom, Li, Kirubarajan 2001, Section 5.5.3); the others
    update it. Without process noise this is weighted least squares. The article does not specify
    how its filter begins; the other reading is a velocity of zero.

    Parameters
    ----------
    time_after_state, positions, covariances
        As in `sequential_line`.
    noise : float
        Spectral density of the acceleration, m^2/s^3.

    Returns
    -------
    state : (n, 4) ndarray
    covariance : (n, 4, 4) ndarray
    """
    n, m = time_after_state.shape
    interval = time_after_state[:, 1] - time_after_state[:, 0]
    state, covariance = np.zeros((n, 4)), np.zeros((n, 4, 4))
    state[:, 0::2] = positions[:, 1]
    state[:, 1::2] = (positions[:, 1] - positions[:, 0]) / interval[:, None]
    per_second = 1.0 / interval[:, None, None]
    covariance[:, 0::2, 0::2] = covariances[:, 1]
    covariance[:, 0::2, 1::2] = covariance[:, 1::2, 0::2] = covariances[:, 1] * per_second
    covariance[:, 1::2, 1::2] = (covariances[:, 0] + covariances[:, 1]) * per_second**2
    if noise:  # the target may have turned between the two
        covariance[:, [1, 3], [1, 3]] += noise * np.abs(interval[:, None]) / 3.0
    for hit in range(2, m):
        elapsed = time_after_state[:, hit] - time_after_state[:, hit - 1]
        state, covariance = predict(state, covariance, elapsed, noise)
        innovation_covariance = covariance[:, 0::2, 0::2] + covariances[:, hit]
        innovation = positions[:, hit] - state[:, 0::2]
        state, covariance = update(
            state, covariance, np.zeros(n), innovation, innovation_covariance
        )
    return predict(state, covariance, -time_after_state[:, -1], noise)


@dataclass(frozen=True, kw_only=True)
class SequentialOptions(MnOptions):
    """Options of the improved sequential method; the defaults are the article's."""

    min_hits: int = hits_option(6)
    window: int = window_option(10)
    gate_sigmas: float = parameter(
        2.0,
        "Margin of the gate in standard deviations of the last hit's error (Eq. 7)",
        minimum=0.0,
        maximum=100.0,
    )
    gate_error: str = parameter(
        "range",
        "Error in the margin of the gate: range, or major_axis (of the position error)",
        choices=("range", "major_axis"),
    )
    matching: str = parameter(
        "oldest",
        "Assignment of a detection in the gates of several tracks: to the oldest track, "
        "to the track of the nearest pair (nearest), or to every track (shared)",
        choices=("oldest", "nearest", "shared"),
    )
    estimator: str = parameter(
        "least_squares", "Estimator of the initial state", choices=ESTIMATORS
    )
    process_noise: float = parameter(
        0.001,
        "Spectral density of a target's acceleration in the estimator kalman_filter",
        unit="m^2/s^3",
        minimum=0.0,
        maximum=100.0,
    )


class Sequential(PathFollower):
    """The improved sequential method of 2014: 6 of 10, matched detections removed."""

    Options = SequentialOptions
    options: SequentialOptions
    operating_points = MappingProxyType(
        {
            f"{min_hits}/{window}": {"min_hits": min_hits, "window": window}
            for min_hits, window in ((9, 10), (8, 10), (7, 10), (6, 10), (5, 8), (4, 6), (3, 5))
        }
    )

    def pairs(self, detections: RecordArray) -> tuple[AssignmentPairs, int]:
        """The detections in the gate of each potential track, by distance (Eq. 7)."""
        last_hits = self.detections[self.potential.last_hit]
        margin = self.options.gate_sigmas * self._sigma(last_hits)
        parent, row, cut = self.reachable(detections, margin)
        displacement = detections["position"][row] - last_hits["position"][parent]
        return AssignmentPairs(parent, row, np.hypot(displacement[:, 0], displacement[:, 1])), cut

    def _sigma(self, hits: RecordArray) -> FloatArray:
        """Standard deviation of each hit's error, (n,), m."""
        if self.options.gate_error == "major_axis":
            return np.asarray(hits["major_sigma"])
        return np.sqrt(range_variance_at(hits, measured_polar(hits)[0], self.sensor))

    def choose(self, pairs: AssignmentPairs) -> AssignmentPairs:
        """One detection at most for each track, by the reading of Step 3 that is chosen."""
        if self.options.matching == "shared":
            return best_assignment_of_each(pairs)
        if self.options.matching == "oldest":
            return oldest_first_assignment(pairs, self.potential.first_scan)
        return nearest_first_assignment(pairs)

    def fit(self, hits: RecordArray, paths: Paths) -> Fit:
        """See `PathHitCounter.fit`."""
        options = self.options
        return sequential_estimate(
            hits, self.stamp, self.sensor, options.estimator, options.process_noise
        )
