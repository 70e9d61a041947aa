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
"""The plain Kalman tracker, against a filter by hand and a tracker written out."""

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment
from support.builders import FIXED_RANGE_ERROR, scan_at

from tsepm_ros import make_initiator
from tsepm_ros.methods.registry import make_method
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


class WrittenOut:
    """Tracks as dicts, a dense cost and scipy's assignment; hits and misses as text."""

    def __init__(self, min_hits, window, misses, process_noise, extent_std, max_speed, gate):
        self.rule, self.misses, self.q, self.gate = (min_hits, window), misses, process_noise, gate
        self.extra, self.speed = extent_std**2 * np.eye(2), max_speed / 2.0
        self.tracks, self.started, self.time = [], 0, None

    def step(self, time, positions, covariances):
        """States and covariances of the confirmed tracks, by id."""
        dt = 0.0 if self.time is None else time - self.time
        self.time = time
        f = np.kron(np.eye(2), [[1.0, dt], [0.0, 1.0]])
        noise = self.q * np.kron(np.eye(2), [[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
        h = np.kron(np.eye(2), [[1.0, 0.0]])
        errors = [covariance + self.extra for covariance in covariances]
        cost = np.zeros((len(self.tracks), len(positions)))
        for i, track in enumerate(self.tracks):
            track["x"], track["P"] = f @ track["x"], f @ track["P"] @ f.T + noise
            for j, (z, r) in enumerate(zip(positions, errors, strict=True)):
                s, d = h @ track["P"] @ h.T + r, z - h @ track["x"]
                distance = d @ np.linalg.solve(s, d)
                if distance <= self.gate:
                    first = 1e6 * (1 + (track["id"] is not None))
                    cost[i, j] = distance + np.log(np.linalg.det(s)) - first
        pairs = {i: j for i, j in zip(*linear_sum_assignment(cost), strict=True) if cost[i, j] < 0}
        for i, track in enumerate(self.tracks):
            track["seen"] += "+" if i in pairs else "-"
            if i in pairs:
                z, r, p = positions[pairs[i]], errors[pairs[i]], track["P"]
                k = p @ h.T @ np.linalg.inv(h @ p @ h.T + r)
                rest = np.eye(4) - k @ h  # Joseph's form
                track["x"] = track["x"] + k @ (z - h @ track["x"])
                track["P"] = rest @ p @ rest.T + k @ r @ k.T
            if track["id"] is None and track["seen"].count("+") == self.rule[0]:
                track["id"], self.started = self.started, self.started + 1
        self.tracks = [track for track in self.tracks if self.lives(track)]
        for j in set(range(len(positions))) - set(pairs.values()):
            x, p = h.T @ positions[j], h.T @ errors[j] @ h
            p[[1, 3], [1, 3]] = self.speed**2
            self.tracks.append({"x": x, "P": p, "seen": "+", "id": None})
        return {t["id"]: (t["x"], t["P"]) for t in self.tracks if t["id"] is not None}

    def lives(self, track):
        if track["id"] is not None:
            return not track["seen"].endswith("-" * self.misses)
        left = self.rule[1] - len(track["seen"])
        return track["seen"].count("+") + left >= self.rule[0]


@pytest.mark.parametrize(
    ("min_hits", "window", "misses", "extent_std"),
    [(2, 3, 2, 0.0), (3, 5, 1, 0.0), (3, 5, 4, 40.0), (4, 6, 3, 10.0)],
)
def test_every_track_starts_goes_on_and_ends_as_with_a_tracker_written_out(
    min_hits, window, misses, extent_std
):
    rng = np.random.default_rng([7, min_hits, misses])
    options = {"min_hits": min_hits, "window": window, "misses": misses, "extent_std": extent_std}
    options |= {"process_noise": 0.02}
    made = make_initiator("kalman", sensor=FIXED_RANGE_ERROR, max_speed=10.0, **options)
    written = WrittenOut(**options, max_speed=10.0, gate=-2.0 * np.log(0.01))
    places, velocity = rng.uniform(2000.0, 3000.0, (6, 2)), rng.normal(0.0, 5.0, (6, 2))
    time, most, ends, starts, twin = 0.0, 0, 0, 0, {}
    for _ in range(40):
        step = rng.choice([3.0, 12.0])
        time, places = time + step, places + step * velocity
        seen = (places + rng.normal(0.0, 15.0, (6, 2)))[rng.random(6) < 0.7]
        scan = scan_at(time, [*seen, *rng.uniform(1500.0, 3500.0, (rng.poisson(12), 2))])
        echoes = convert_measurements(scan, FIXED_RANGE_ERROR, 0)
        before = {track.track_id for track in made.current}
        starts += len(made.process(scan))
        expected = written.step(time, echoes["position"], echoes["covariance"])
        current = {track.track_id: track for track in made.current}
        assert made.maintenance.ended == dict.fromkeys(before - current.keys(), "missed")
        for track_id in current.keys() - twin.keys():  # those of one scan have no order
            x = current[track_id].state
            twin[track_id] = min(expected, key=lambda other: np.linalg.norm(expected[other][0] - x))
        assert sorted(twin[track_id] for track_id in current) == sorted(expected)
        for track_id, track in current.items():
            x, p = expected[twin[track_id]]
            np.testing.assert_allclose(track.state, x, rtol=1e-9, atol=1e-9)
            np.testing.assert_allclose(track.covariance, p, rtol=1e-9, atol=1e-9)
        most, ends = max(most, len(current)), ends + len(made.maintenance.ended)
    assert starts == written.started
    assert most >= 4 and ends >= 4


@pytest.mark.parametrize(
    ("last", "tracks"), [([(3000.0, 150.0)], 1), ([(3000.0, 20.0), (3000.0, -130.0)], 2)]
)
def test_a_confirmed_track_chooses_first_and_leaves_what_only_another_can_have(last, tracks):
    made = make_initiator("kalman", sensor=FIXED_RANGE_ERROR, min_hits=2, window=3)
    for k in range(2):
        made.process(scan_at(12.0 * k, [(3000.0, 0.0)]))
    # The second one starts a tentative track, to which 150 m is nearer, and -130 m too far.
    made.process(scan_at(24.0, [(3000.0, 0.0), (3000.0, 200.0)]))
    made.process(scan_at(36.0, last))
    assert made.current.time_since_hit.tolist() == [0.0] * tracks


def test_tracks_go_on_by_another_method_and_back():
    made = make_initiator("kalman", sensor=FIXED_RANGE_ERROR)
    for k, place in enumerate(places(6)):
        made.process(scan_at(12.0 * k, [place]))
    (before,) = made.current
    for name in ("score", "kalman"):
        made, kept = made.with_settings(make_method(name, sensor=FIXED_RANGE_ERROR))
        assert not kept and list(made.current.track_id) == [before.track_id]
        made.process(scan_at(made.stamp + 12.0, [before.predicted(made.stamp + 12.0).position]))
    (after,) = made.current
    assert after.track_id == before.track_id
