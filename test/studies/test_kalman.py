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
"""The plain Kalman tracker, against a filter by hand."""

import numpy as np
from support.builders import FIXED_RANGE_ERROR, scan_at

from tsepm_ros import make_initiator
from tsepm_ros.tracker.measurement import convert_measurements

STEP = np.array([60.0, 40.0])


def places(scans: int, start=(3000.0, 0.0), seed: int = 2) -> list[np.ndarray]:
    rng = np.random.default_rng(seed)
    return [start + k * STEP + rng.normal(0.0, 10.0, 2) for k in range(scans)]


def test_a_start_has_the_state_of_a_filter_by_hand():
    options = {"min_hits": 4, "window": 6, "process_noise": 0.01}
    made = make_initiator("kalman", sensor=FIXED_RANGE_ERROR, max_speed=10.0, **options)
    scans = [scan_at(12.0 * k, [place]) for k, place in enumerate(places(4))]
    (track,) = [track for scan in scans for track in made.process(scan)]
    f = np.kron(np.eye(2), [[1.0, 12.0], [0.0, 1.0]])
    q = 0.01 * np.kron(np.eye(2), [[12.0**3 / 3, 72.0], [72.0, 12.0]])
    h = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]])
    [first, *hits] = [convert_measurements(scan, FIXED_RANGE_ERROR, 0)[0] for scan in scans]
    x = h.T @ first["position"]
    p = h.T @ first["covariance"] @ h + np.diag([0.0, 25.0, 0.0, 25.0])
    for hit in hits:
        x, p = f @ x, f @ p @ f.T + q
        s = h @ p @ h.T + hit["covariance"]
        gain = p @ h.T @ np.linalg.inv(s)
        x, p = x + gain @ (hit["position"] - h @ x), p - gain @ s @ gain.T
    np.testing.assert_allclose(track.state, x, rtol=1e-9)
    np.testing.assert_allclose(track.covariance, p, rtol=1e-7, atol=1e-9)


def test_m_hits_within_n_scans_start_a_track_and_one_scan_later_they_do_not():
    for seen, starts in (("10101", 1), ("100101", 0)):
        made = make_initiator("kalman", sensor=FIXED_RANGE_ERROR)  # 3/5
        scans = [
            scan_at(12.0 * k, [place] if seen[k] == "1" else [])
            for k, place in enumerate(places(len(seen)))
        ]
        assert sum(len(made.process(scan)) for scan in scans) == starts


def test_a_confirmed_track_takes_its_detections_and_is_not_started_again():
    made = make_initiator("kalman", sensor=FIXED_RANGE_ERROR)
    starts = [
        track
        for k, place in enumerate(places(16))
        for track in made.process(scan_at(12.0 * k, [place]))
    ]
    assert len(starts) == len(made.current) == 1


def test_two_tracks_share_the_detections_so_that_both_have_one():
    # The nearest neighbour of track 0 is the only one in the gate of track 1.
    made = make_initiator("kalman", sensor=FIXED_RANGE_ERROR, min_hits=2, window=2)
    made.process(scan_at(0.0, [(3000.0, 0.0), (3000.0, 300.0)]))
    starts = made.process(scan_at(12.0, [(3000.0, 140.0), (3000.0, -80.0)]))
    assert sorted(track.hits for track in starts) == [((0, 0), (1, 1)), ((0, 1), (1, 0))]
