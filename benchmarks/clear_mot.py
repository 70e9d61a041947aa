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
"""CLEAR-MOT of states and tracks."""

from __future__ import annotations

from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.tools.evaluation import tracking_metrics
from tsepm_ros.tracker.tracks import TrackArrays

Truth = dict[int, FloatArray]
"""State (4,) of each target at a scan; nan where it is not there."""


class ClearMot(tracking_metrics.ClearMot):
    """Identity switches, from states."""

    def take_states(self, truth: Truth, tracks: TrackArrays) -> None:
        """Take a scan."""
        places = zip(tracks.track_id.tolist(), tracks.state[:, 0::2], strict=True)
        self.take({target: state[0::2] for target, state in truth.items()}, dict(places))

    def held(self) -> tuple[int, int]:
        """Scans with a track of its own, and all, of each target from its first track on."""
        found = [0, 0]
        for tracks in self.matches.values():
            first = next((k for k, track in enumerate(tracks) if track is not None), len(tracks))
            found[0] += sum(track is not None for track in tracks[first:])
            found[1] += len(tracks) - first
        return found[0], found[1]
