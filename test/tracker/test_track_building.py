"""Tracks from the detections that are their hits."""

from __future__ import annotations

import numpy as np
from support.builders import detections

from tsepm_ros.tracker.detection_window import DetectionWindow
from tsepm_ros.tracker.initial_state import NO_HIT
from tsepm_ros.tracker.tracks import tracks_from_hits


def filled_window() -> DetectionWindow:
    """Scans 0 to 3 of two detections each, ids 0 to 7; scan 0 is forgotten."""
    window = DetectionWindow()
    for scan in range(4):
        found = detections(np.zeros((2, 2)), 12.0 * scan + np.array([0.0, 0.5]))
        found["scan"], found["index"] = scan, [5, 9]
        window.append(found)
    window.forget(1)
    return window


def test_tracks_have_the_hits_given_and_times_from_the_first():
    hits = np.array([[2, 4, 7], [5, 6, NO_HIT]])
    state, covariance = np.arange(8.0).reshape(2, 4), np.zeros((2, 4, 4))
    tracks = tracks_from_hits(
        filled_window(),
        hits,
        stamp=36.0,
        scan_index=3,
        state=state,
        covariance=covariance,
        evaluation=np.array([1.0, 2.0]),
    )
    assert tracks.hits == [((1, 5), (2, 5), (3, 9)), ((2, 9), (3, 5))]
    assert tracks.hit_count.tolist() == [3, 2]
    assert tracks.scan_count.tolist() == [3, 2]
    assert tracks.age.tolist() == [24.0, 11.5]
    assert tracks.track_id.tolist() == [0, 1]
    assert np.isnan(tracks.score).all()
    assert tracks.state is state


def test_no_hits_are_no_tracks():
    tracks = tracks_from_hits(
        filled_window(),
        np.zeros((0, 3), np.int64),
        stamp=36.0,
        scan_index=3,
        state=np.zeros((0, 4)),
        covariance=np.zeros((0, 4, 4)),
        evaluation=np.zeros(0),
        score=np.zeros(0),
    )
    assert (len(tracks), tracks.hits) == (0, [])
