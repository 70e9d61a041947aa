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
"""What every method gives of a scan: counts, and a step with its new tracks."""

import numpy as np

from tsepm_ros import ConfirmedTrack
from tsepm_ros.tracker.method import MethodResult, ScanStatistics
from tsepm_ros.tracker.tracks import NEW_TRACK_EXISTENCE, TrackArrays


def tracks(number: int) -> TrackArrays:
    return TrackArrays.from_tracks(
        [ConfirmedTrack(k, 0.0, np.zeros(4), np.eye(4), ((0, k),), 0.0) for k in range(number)]
    )


def test_counts_add_up_but_for_the_potential_tracks_held_at_once():
    one = ScanStatistics(scans=1, detections=5, potential_tracks=7, merged=1)
    two = ScanStatistics(scans=1, detections=2, potential_tracks=3, confirmed=4)
    total = ScanStatistics(scans=2, detections=7, potential_tracks=7, merged=1, confirmed=4)
    assert one + two == two + one == total


def test_new_tracks_exist_with_the_method_s_probability_or_with_the_usual_one():
    assert MethodResult(tracks(2)).existences.tolist() == [NEW_TRACK_EXISTENCE] * 2
    step = MethodResult(tracks(3), existence=np.array([0.1, 0.2, 0.3]))
    part = step.where(np.array([True, False, True]))
    assert part.existences.tolist() == [0.1, 0.3]
    assert part.tracks.track_id.tolist() == [0, 2]
    assert MethodResult(tracks(3)).where(np.array([1])).existence is None


def test_hits_of_the_tracks_that_are_kept_stay_numbers_where_all_have_as_many():
    paths = np.array([1, 2, 3]), np.array([4, 5, 6]), np.array([7, 8, 9])
    result = MethodResult(tracks(3), paths=paths)
    for rows in (np.array([False, True, True]), np.array([1, 2])):
        kept = result.where(rows).paths
        assert [(path.dtype, path.tolist()) for path in kept] == [
            (np.int64, [4, 5, 6]),
            (np.int64, [7, 8, 9]),
        ]
    assert result.where(np.zeros(3, bool)).paths == ()
