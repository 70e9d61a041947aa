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
"""Confirmed tracks in tests: a few tracks 1 km apart, and the steps that maintain them."""

import numpy as np

from support.builders import FIXED_RANGE_ERROR, detections
from tsepm_ros import ConfirmedTrack
from tsepm_ros.tracker.maintenance.track_maintenance import TrackMaintenance
from tsepm_ros.tracker.options import CommonOptions
from tsepm_ros.tracker.tracks import TrackArrays

NOTHING = detections(np.zeros((0, 2)), 0.0)
CLUTTER = 1e-6
P_D = 0.9
UNSEEN = 1e-9
MAX_SPEED = 10.0


def tracks(*ids: int, stamp: float = 0.0, x: float = 2000.0) -> TrackArrays:
    """Tracks 1 km apart that go 5 m/s along x."""
    return TrackArrays.from_tracks(
        [
            ConfirmedTrack(
                track_id=track_id,
                stamp=stamp,
                state=np.array([x, 5.0, 1000.0 * track_id, 0.0]),
                covariance=np.diag([50.0, 2.0, 50.0, 2.0]) ** 2,
                hits=((0, 0),),
                evaluation=0.0,
            )
            for track_id in ids
        ]
    )


def step(
    maintenance: TrackMaintenance, stamp: float, scan=NOTHING, detectable: float = UNSEEN, **options
) -> np.ndarray:
    """Process a scan; with `detectable` UNSEEN misses do not count, 0 is outside the coverage."""
    return maintenance.step(
        stamp,
        scan,
        np.full(len(scan), CLUTTER),
        lambda positions: np.full(len(positions), detectable),
        FIXED_RANGE_ERROR,
        MAX_SPEED,
        **options,
    )


def ids(maintenance: TrackMaintenance) -> list[int]:
    """Ids of the confirmed tracks, published or not."""
    return maintenance.confirmed.tracks.track_id.tolist()


def published(maintenance: TrackMaintenance) -> list[int]:
    return [track.track_id for track in maintenance.current]


def holding(*track_ids: int, hold_time: float = 1e6, existence: float = 0.9) -> TrackMaintenance:
    maintenance = TrackMaintenance(CommonOptions(hold_time=hold_time))
    maintenance.add(tracks(*track_ids), existence)
    return maintenance
