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
"""The plain Kalman tracker: M of N hits, gates, the global nearest neighbour, constant velocity.

Bar-Shalom, Li, Kirubarajan, "Estimation with applications to tracking and navigation", 2001
(Sections 5.2 and 6.2); Blackman, Popoli, "Design and analysis of modern tracking systems", 1999
(Sections 6.2 and 6.4). A tentative track begins at a detection z, with a velocity of mean 0::

    x = [z_x, 0, z_y, 0]          P = diag(R, (v_max / 2)^2)
    x <- F x                      P <- F P F' + Q               prediction
    d = z - H x                   S = H P H' + R                innovation
    d' S^-1 d <= gamma                                          gate
    K = P H' S^-1                 x <- x + K d, P <- P - K S K' update

Q is that of white acceleration. Each track and each detection is assigned once, so that the sum of
the squared distances is least; a track without a detection costs gamma.

Readings
--------
- A detection that is probably a confirmed track's is no tentative track's: confirmed tracks come
  first. They are held as with the other methods.
- v_max is two standard deviations of a component of the velocity.
- M hits within N scans confirm; a tentative track ends after N scans.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.numerics.arrays import FloatArray, IntArray, changed
from tsepm_ros.numerics.gaussian import gaussian_gate_factor, proper_covariance
from tsepm_ros.studies.assignment import AssignmentPairs, global_assignment
from tsepm_ros.studies.multiple_model import FilterOptions, gated_by_filters
from tsepm_ros.studies.path_following import Estimates, PathFollower
from tsepm_ros.tracker import motion
from tsepm_ros.tracker.evaluation import normalized_distance
from tsepm_ros.tracker.initial_state import Fit, Paths, initial_paths
from tsepm_ros.tracker.method import Step
from tsepm_ros.tracker.observation import Observation
from tsepm_ros.tracker.options import hits_option, window_option

CONFIRMED = 0.5
"""Probability above which a detection is a confirmed track's."""


@dataclass(frozen=True, kw_only=True)
class KalmanOptions(FilterOptions):
    """Options of the plain Kalman tracker."""

    min_hits: int = hits_option(3)
    window: int = window_option(5)


@dataclass(frozen=True)
class KalmanTracks(Paths):
    """Tentative tracks with a filter each.

    Attributes
    ----------
    hits, hit_count, first_scan
        As in `Paths`.
    state, covariance : (n, 4), (n, 4, 4) ndarray
        At the last scan's stamp.
    """

    state: FloatArray
    covariance: FloatArray

    def predicted(self, elapsed: FloatArray | float, noise: float) -> KalmanTracks:
        """The tracks after times, s, with a process noise, m^2/s^3."""
        state, covariance = motion.predict(self.state, self.covariance, elapsed, noise)
        return changed(self, state=state, covariance=covariance)


class Kalman(PathFollower):
    """The plain Kalman tracker: M of N hits, gates, the global nearest neighbour."""

    Options = KalmanOptions
    options: KalmanOptions
    operating_points = MappingProxyType(
        {
            f"{min_hits}/{window}": {"min_hits": min_hits, "window": window}
            for min_hits, window in ((8, 10), (7, 8), (6, 8), (5, 6), (4, 6), (3, 5), (3, 4))
        }
    )
    potential: KalmanTracks

    def step(self, observed: Observation) -> Step:
        """Take the detections that are no confirmed track's; see `PathFollower.step`."""
        free = observed.confirmed_probability <= CONFIRMED
        rest = replace(observed, detections=observed.detections[free], ids=observed.ids[free])
        step = super().step(rest)
        counts = changed(step.statistics, detections=len(observed.detections))
        return changed(step, statistics=counts)

    def begin(self, observed: Observation) -> IntArray:
        """Predict the tracks to the scan, and see `PathHitCounter.begin`."""
        self.potential = self.potential.predicted(observed.interval, self.options.process_noise)
        return super().begin(observed)

    def pairs(self, detections: NDArray[np.void]) -> tuple[AssignmentPairs, int]:
        """The detections in the gate of each track, by normalised distance."""
        tracks, probability = self.potential, self.options.gate_probability
        return gated_by_filters(
            tracks.state, tracks.covariance, detections, self.stamp, probability, self.most_pairs
        )

    def choose(self, pairs: AssignmentPairs) -> AssignmentPairs:
        """The global nearest neighbour."""
        return global_assignment(pairs, gaussian_gate_factor(self.options.gate_probability) ** 2)

    def started(self, ids: IntArray, detections: NDArray[np.void]) -> KalmanTracks:
        """A track for each detection, carried from its time to the scan's stamp."""
        path = initial_paths(ids, self.scan_index, self.options.min_hits)
        state, covariance = np.zeros((len(ids), 4)), np.zeros((len(ids), 4, 4))
        state[:, 0::2] = detections["position"]
        covariance[:, 0::2, 0::2] = detections["covariance"]
        covariance[:, 1::2, 1::2] = (0.5 * self.common.max_speed) ** 2 * np.eye(2)
        tracks = KalmanTracks(path.hits, path.hit_count, path.first_scan, state, covariance)
        return tracks.predicted(self.stamp - detections["time"], self.options.process_noise)

    def extended(
        self, parent: IntArray, ids: IntArray, detections: NDArray[np.void]
    ) -> KalmanTracks:
        """Tracks that are updated with a detection each; see `PathFollower.extended`."""
        tracks = self.potential.extended(parent, ids)
        state, covariance, after = tracks.state, tracks.covariance, detections["time"] - self.stamp
        innovation = detections["position"] - motion.position_after(state, after)
        spread = motion.position_covariance_after(covariance, after) + detections["covariance"]
        state, covariance = motion.update(state, covariance, after, innovation, spread)
        covariance = proper_covariance(covariance) if len(ids) else covariance
        return changed(tracks, state=state, covariance=covariance)

    def estimate(self, paths: Paths) -> Estimates:
        """The filter's state, and f_1 (TSEPM 2018, Eq. 23) of the hits around it."""
        assert isinstance(paths, KalmanTracks)
        figure = np.zeros(len(paths))
        for rows, ids in paths.of_equal_count():
            hits = self.detections[ids]
            state, covariance, after = paths.state[rows], paths.covariance[rows], hits["time"]
            fitted = Fit(state, covariance, after - self.stamp, hits["covariance"])
            figure[rows] = normalized_distance(hits, fitted)
        return Estimates(paths.state, paths.covariance, figure)
