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
"""Confirmed tracks carried in time, as arrays and for other libraries."""

import sys
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
from support.builders import detections

from tsepm_ros import ConfirmedTrack
from tsepm_ros.tracker.measurement import MeasurementWindow
from tsepm_ros.tracker.tracks import TrackArrays, tracks_from_hits


def track(track_id: int = 3, stamp: float = 100.0) -> ConfirmedTrack:
    root = np.random.default_rng(track_id).standard_normal((4, 6))
    state, hits = np.array([1000.0, 2.0, -500.0, -3.0]), ((0, 1), (2, 0))
    more = {"score": 7.0, "scan_count": 4, "age": 36.0}
    return ConfirmedTrack(track_id, stamp, state, root @ root.T, hits, 0.5, **more)


TRACKS = [track(1, 100.0), track(2, 112.0), track(3, 124.0)]


def test_many_tracks_are_predicted_to_one_time_as_each_alone():
    for one, alone in zip(TrackArrays.from_tracks(TRACKS).predicted(150.0), TRACKS, strict=True):
        expected = alone.predicted(150.0)
        assert (one.track_id, one.stamp, one.age) == (alone.track_id, 150.0, 186.0 - alone.stamp)
        assert one.time_since_hit == alone.time_since_hit + 150.0 - alone.stamp
        np.testing.assert_allclose(one.state, expected.state)
        np.testing.assert_allclose(one.covariance, expected.covariance)


def test_arrays_give_back_the_tracks_that_they_were_made_of():
    arrays = TrackArrays.joined(
        TrackArrays.from_tracks(TRACKS[:1]), TrackArrays.from_tracks(TRACKS[1:])
    )
    for one, expected in zip(arrays, TRACKS, strict=True):
        for name in ("track_id", "stamp", "hits", "evaluation", "score", "scan_count", "age"):
            assert getattr(one, name) == getattr(expected, name)
        np.testing.assert_array_equal(one.state, expected.state)
        np.testing.assert_array_equal(one.covariance, expected.covariance)
    assert [one.track_id for one in arrays.where(np.array([True, False, True]))] == [1, 3]
    assert [one.track_id for one in arrays[1:]] == [2, 3]


def test_a_track_is_shown_in_one_line():
    assert repr(track()) == (
        "ConfirmedTrack(3, 100 s, position (1000, -500) m, velocity (2.0, -3.0) m/s, 2 hits)"
    )
    assert repr(TrackArrays.from_tracks([])) == "TrackArrays([])"
    many = repr(TrackArrays.from_tracks([track(number) for number in range(5)]))
    assert many.count("ConfirmedTrack(") == 3 and many.endswith(", 5 in all)")
    assert "in all" not in repr(TrackArrays.from_tracks(TRACKS))
    assert track().since == 64.0, "36 s before its stamp"


def test_a_stone_soup_state_has_the_time_of_its_stamp():
    pytest.importorskip("stonesoup")
    state = track().as_stonesoup()
    np.testing.assert_array_equal(state.state_vector.ravel(), track().state)
    np.testing.assert_array_equal(state.covar, track().covariance)
    assert state.timestamp == datetime(1970, 1, 1, 0, 1, 40, tzinfo=UTC)
    naive = datetime(2026, 5, 1)
    assert track().as_stonesoup(naive).timestamp == naive + timedelta(seconds=100)


def test_without_stone_soup_the_error_names_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "stonesoup.types.state", None)
    with pytest.raises(ImportError, match="pip install stonesoup"):
        track().as_stonesoup()


@pytest.mark.parametrize("order_by_dim", [True, False])
def test_a_filterpy_filter_predicts_as_the_track_does_and_may_change_its_own(
    order_by_dim,
):
    """In filterpy's words: ``x = F x``, ``P = F P F'``, x as a column."""
    one = track()
    x, P = one.as_filterpy(order_by_dim=order_by_dim)
    assert x.shape == (4, 1)
    block = np.array([[1.0, 12.0], [0.0, 1.0]])
    F = np.kron(np.eye(2), block) if order_by_dim else np.kron(block, np.eye(2))
    later = one.predicted(112.0)
    order = [0, 1, 2, 3] if order_by_dim else [0, 2, 1, 3]
    np.testing.assert_allclose((F @ x).ravel(), later.state[order])
    np.testing.assert_allclose(F @ P @ F.T, later.covariance[order][:, order])
    x += 1.0
    P += 1.0
    np.testing.assert_array_equal(one.state, track().state)
    np.testing.assert_array_equal(one.covariance, track().covariance)


def test_tracks_know_the_scans_and_the_times_of_their_hits():
    window = MeasurementWindow()
    for scan, number in enumerate([2, 1, 3, 2]):
        found = detections(np.zeros((number, 2)), 12.0 * scan + np.arange(number))
        found["scan"], found["index"] = scan, np.arange(number)
        window.append(found)
    hits = np.array([[1, 2, 5], [3, 7, -1], [6, -1, -1]])
    state, covariance = np.arange(12.0).reshape(3, 4), np.tile(np.eye(4), (3, 1, 1))
    made = tracks_from_hits(
        window, hits, stamp=40.0, scan_index=3, state=state, covariance=covariance,
        evaluation=np.array([0.1, 0.2, 0.3]),
    )  # fmt: skip
    assert made.hits.tolist() == [((0, 1), (1, 0), (2, 2)), ((2, 0), (3, 1)), ((3, 0),)]
    assert made.hit_count.tolist() == [3, 2, 1]
    assert made.scan_count.tolist() == [4, 2, 1]
    assert made.age.tolist() == [39.0, 16.0, 4.0], "since the first hit"
    assert made.track_id.tolist() == [0, 1, 2] and np.isnan(made.score).all()
    assert made.numbered(np.array([7, 8, 9])).track_id.tolist() == [7, 8, 9]


def test_covariances_that_rounding_spoiled_are_repaired_and_others_stay():
    arrays = TrackArrays.from_tracks(TRACKS)
    assert arrays.proper() is arrays
    arrays.covariance[1, 0, 0] = -1.0
    repaired = arrays.proper()
    assert (np.linalg.eigvalsh(repaired.covariance) > 0.0).all()
    np.testing.assert_allclose(repaired.covariance[[0, 2]], arrays.covariance[[0, 2]], rtol=1e-9)
