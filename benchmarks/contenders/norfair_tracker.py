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
"""norfair: its tracker's own initialisation, with a vectorised distance.

norfair counts frames, not seconds, and has no M/N rule: a track is initialised when its hits minus
its misses exceed a delay, chosen here so that 5 hits in a row suffice.
"""

from __future__ import annotations

import numpy as np
from norfair import Detection, OptimizedKalmanFilterFactory, Tracker
from norfair.tracker import TrackedObject

from contenders import Contender, FloatArray, Hits, RawScan, Sea

VELOCITY_NOISE = 1.0  # m^2 per scan^2: near constant velocity


class NorfairContender(Contender):
    """Positions in metres, Euclidean distance within a gate at the typical range."""

    def __init__(self, sea: Sea, min_hits: int, window: int) -> None:
        super().__init__(sea, min_hits, window)
        error = max(sea.azimuth_std, sea.range_std_fraction) * sea.typical_range
        move = sea.max_speed * sea.period
        self._tracker = Tracker(
            distance_function="euclidean",
            distance_threshold=move + sea.gate_sigmas * error,
            initialization_delay=min_hits - 1,
            hit_counter_max=window,
            past_detections_length=window,
            filter_factory=OptimizedKalmanFilterFactory(
                R=error**2, Q=VELOCITY_NOISE, pos_variance=error**2, vel_variance=(move / 2.0) ** 2
            ),
        )
        self._scan_index = 0
        self._known: set[int] = set()
        self._new: list[TrackedObject] = []

    def process(self, scan: RawScan) -> int:
        """See `Contender.process`."""
        x = scan.range * np.cos(scan.azimuth)
        y = scan.range * np.sin(scan.azimuth)
        detections = [
            Detection(np.array([[x[row], y[row]]]), data=(self._scan_index, row))
            for row in range(len(scan))
        ]
        active = self._tracker.update(detections)
        self._new = [track for track in active if track.id not in self._known]
        self._known = {track.id for track in active}
        self._scan_index += 1
        return len(self._new)

    def hits(self) -> list[Hits]:
        """See `Contender.hits`."""
        return [tuple(hit.data for hit in track.past_detections) for track in self._new]

    def states(self) -> FloatArray:
        """See `Contender.states`; norfair's velocities are per frame."""
        positions = np.array([track.estimate for track in self._new], float).reshape(-1, 2)
        moves = np.array([track.estimate_velocity for track in self._new], float).reshape(-1, 2)
        return np.stack([positions, moves / self.sea.period], axis=-1).reshape(-1, 4)

    def counts(self) -> dict[str, int]:
        """See `Contender.counts`."""
        return {"potential": sum(track.is_initializing for track in self._tracker.tracked_objects)}
