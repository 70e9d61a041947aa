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
"""The plain Kalman tracker: M of N hits, the global nearest neighbour, L misses, constant velocity.

Bar-Shalom, Li, Kirubarajan, "Estimation with applications to tracking and navigation", 2001
(Sections 5.2 and 6.2); Blackman, Popoli, "Design and analysis of modern tracking systems", 1999
(Sections 6.2 and 6.4). A tentative track begins at a detection z, with a velocity of mean 0::

    x = [z_x, 0, z_y, 0]          P = diag(R, (v_max / 2)^2)
    x <- F x                      P <- F P F' + Q               prediction
    d = z - H x                   S = H P H' + R + s^2 I        innovation
    d' S^-1 d <= gamma                                          gate
    K = P H' S^-1                 x <- x + K d, P <- P - K S K' update

Q is that of white acceleration, s the error of an echo's place on a large target. Tentative and
confirmed tracks share one assignment of each track and each detection at most once. It pairs as
many as possible, confirmed tracks first; of these it has the least sum of ``d' S^-1 d + ln |S|``.

Readings
--------
- M hits within N scans confirm. A tentative track ends when M can no longer be reached.
- L scans in a row without a detection end a confirmed track, inside the coverage and outside.
- v_max is two standard deviations of a component of the velocity.
- The tracker's maintenance keeps the table of confirmed tracks; it neither associates nor ends
  them. They do not coast, and `min_speed` judges starts alone.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np

from tsepm_ros.numerics import gaussian
from tsepm_ros.numerics.arrays import (
    BoolArray,
    FloatArray,
    IntArray,
    RecordArray,
    replaced,
    rows_of,
)
from tsepm_ros.parameters import parameter
from tsepm_ros.studies.assignment import AssignmentPairs, global_assignment
from tsepm_ros.studies.multiple_model import (
    FilterFollower,
    FilterOptions,
    FilterTracks,
    filter_innovations,
    gated_by_filters,
)
from tsepm_ros.tracker import motion
from tsepm_ros.tracker.initial_state import first_states, new_paths
from tsepm_ros.tracker.maintenance.confirmed_tracks import ConfirmedTracks
from tsepm_ros.tracker.maintenance.track_maintenance import TrackMaintenance
from tsepm_ros.tracker.method import MethodResult
from tsepm_ros.tracker.observation import Observation
from tsepm_ros.tracker.options import hits_option, window_option
from tsepm_ros.tracker.tracks import EVEN_PROBABILITY, NEW_TRACK_EXISTENCE

UNASSIGNED_COST = 1e4
"""Cost of a tentative track without a detection; a confirmed one costs twice as much."""


@dataclass(frozen=True, kw_only=True)
class KalmanOptions(FilterOptions):
    """Options of the plain Kalman tracker."""

    min_hits: int = hits_option(3)
    window: int = window_option(5)
    misses: int = parameter(
        3, "Scans in a row without a detection that end a confirmed track", minimum=1, maximum=1000
    )
    extent_std: float = parameter(
        0.0,
        "Error of an echo's place on its target, on each axis, beside the sensor's errors",
        unit="m",
        minimum=0.0,
        maximum=1e3,
    )


class Kalman(FilterFollower):
    """The plain Kalman tracker, which maintains its confirmed tracks itself."""

    Options = KalmanOptions
    options: KalmanOptions
    operating_points = MappingProxyType(
        {
            f"{min_hits}/{window}": {"min_hits": min_hits, "window": window}
            for min_hits, window in (
                *((8, 10), (7, 8), (6, 8), (5, 6), (5, 7)),
                *((4, 6), (3, 5), (3, 4), (2, 3)),
            )
        }
    )
    potential: FilterTracks

    def maintain(
        self,
        maintenance: TrackMaintenance,
        stamp: float,
        detections: RecordArray,
        *scan: Any,
        **more: Any,
    ) -> FloatArray:
        """Assign a scan's detections to all tracks; update and end the confirmed ones.

        Returns
        -------
        (d,) ndarray
            Whether each detection is a confirmed track's, as a probability.
        """
        held, maintenance.confirmed = maintenance.confirmed, ConfirmedTracks.none()
        assigned = super().maintain(maintenance, stamp, detections, *scan, **more)
        noise, number = self.options.process_noise, len(held)
        self.potential = self.potential.predicted(stamp - self.stamp, noise)
        self.stamp, elapsed = stamp, stamp - held.tracks.stamp
        state, covariance = motion.predict(
            held.tracks.state, held.tracks.covariance, elapsed, noise
        )
        echoes = self.of_targets(detections)
        pairs, _ = self.gated(
            np.concatenate([state, self.potential.state]),
            np.concatenate([covariance, self.potential.covariance]),
            echoes,
        )
        first = UNASSIGNED_COST * (pairs.parent < number)
        pairs = self.choose(replaced(pairs, cost=pairs.cost - first))
        own = pairs[pairs.parent < number]
        row = own.parent
        state[row], covariance[row] = self.updated(
            state[row], covariance[row], rows_of(echoes, own.row)
        )
        missed, assigned[own.row] = held.covered_scans[:, 0] + 1.0, NEW_TRACK_EXISTENCE
        missed[row] = 0.0
        tracks = held.tracks.predicted(stamp)
        tracks = replaced(
            tracks,
            state=state,
            covariance=covariance,
            time_since_hit=np.where(missed, tracks.time_since_hit, 0.0),
        )
        maintenance.confirmed = replaced(
            ConfirmedTracks.from_tracks(tracks, held.existence),
            covered_scans=missed[:, None],
            announced=held.announced,
            unlisted_since=held.unlisted_since,
        )
        maintenance.end(missed < self.options.misses, "missed")
        return assigned

    def step(self, observed: Observation) -> MethodResult:
        """Take the detections that are no confirmed track's; see `PathFollower.step`."""
        free = observed.confirmed_probability <= EVEN_PROBABILITY
        echoes = self.of_targets(observed.detections[free])
        step = super().step(replace(observed, detections=echoes, ids=observed.ids[free]))
        number = len(self.potential)
        self.potential = self.potential[~self.hopeless]
        counts = replaced(
            step.statistics,
            detections=len(observed.detections),
            potential_tracks=len(self.potential),
            terminated=step.statistics.terminated + number - len(self.potential),
        )
        return replaced(step, statistics=counts)

    @property
    def hopeless(self) -> BoolArray:
        """Which tentative tracks can no longer reach M hits, (n,)."""
        left = self.potential.first_scan + self.options.window - 1 - self.scan_index
        return np.asarray(self.potential.hit_count + left < self.options.min_hits)

    def of_targets(self, detections: RecordArray) -> RecordArray:
        """The detections with the errors of their targets' middles: ``R + s^2 I``."""
        wide, variance = detections.copy(), self.options.extent_std**2
        wide["covariance"] += variance * np.eye(2)
        wide["major_sigma"] = np.sqrt(wide["major_sigma"] ** 2 + variance)
        return wide

    def pairs(self, detections: RecordArray) -> tuple[AssignmentPairs, int]:
        """The detections in the gates of the tentative tracks, which are predicted to the scan."""
        return self.gated(self.potential.state, self.potential.covariance, detections)

    def gated(
        self, state: FloatArray, covariance: FloatArray, detections: RecordArray
    ) -> tuple[AssignmentPairs, int]:
        """The detections in the gates of tracks, by ``-2 ln N(d; 0, S)``, and the pairs cut."""
        probability = self.options.gate_probability
        pairs, cut = gated_by_filters(
            state, covariance, detections, self.stamp, probability, self.most_pairs
        )
        of_track, of_detection = (state[pairs.parent], covariance[pairs.parent]), pairs.row
        found = rows_of(detections, of_detection)
        _, *innovation = filter_innovations(*of_track, self.stamp, found)
        return replaced(pairs, cost=-2.0 * gaussian.log_density(*innovation)[0]), cut

    def choose(self, pairs: AssignmentPairs) -> AssignmentPairs:
        """The global nearest neighbour."""
        return global_assignment(pairs, UNASSIGNED_COST)

    def updated(
        self, state: FloatArray, covariance: FloatArray, detections: RecordArray
    ) -> tuple[FloatArray, FloatArray]:
        """States (n, 4) and covariances (n, 4, 4) after the update by a detection each."""
        innovation = filter_innovations(state, covariance, self.stamp, detections)
        state, covariance = motion.update(state, covariance, *innovation)
        return state, gaussian.proper_covariance(covariance) if len(state) else covariance

    def started(self, ids: IntArray, detections: RecordArray) -> FilterTracks:
        """A track for each detection, carried from its time to the scan's stamp."""
        path = new_paths(ids, self.scan_index, self.options.min_hits)
        states = first_states(detections, self.common.max_speed)
        tracks = FilterTracks(path.hits, path.hit_count, path.first_scan, *states)
        return tracks.predicted(self.stamp - detections["time"], self.options.process_noise)

    def extended(self, parent: IntArray, ids: IntArray, detections: RecordArray) -> FilterTracks:
        """Tracks that are updated with a detection each; see `PathFollower.extended`."""
        tracks = self.potential.extended(parent, ids)
        state, covariance = self.updated(tracks.state, tracks.covariance, detections)
        return replaced(tracks, state=state, covariance=covariance)
