"""The window of recent detections: ids that never change."""

from __future__ import annotations

import numpy as np
import pytest
from support.builders import detections

from tsepm_ros.tracker.detection_window import DetectionWindow


def scan_of(n: int, scan: int) -> np.ndarray:
    found = detections(np.zeros((n, 2)), float(scan))
    found["scan"], found["index"] = scan, np.arange(n)
    return found


@pytest.fixture
def window() -> DetectionWindow:
    window = DetectionWindow()
    for scan, n in enumerate([3, 0, 2, 4]):
        window.append(scan_of(n, scan))
    return window


def test_ids_stay_the_same_when_old_scans_are_forgotten(window):
    before = window[np.array([4, 5, 8])]
    window.forget(2)
    after = window[np.array([4, 5, 8])]
    for name in ("scan", "index", "time"):
        np.testing.assert_array_equal(after[name], before[name])
    assert after["scan"].tolist() == [2, 3, 3]
    assert len(window) == 6
    assert window.append(scan_of(1, 4)).tolist() == [9]


def test_what_several_tracks_claim_is_one_of_theirs(window):
    window.note_held(np.array([4, 6, 6]), np.array([0.5, 0.5, 0.2]))
    window.note_held(np.array([4]), np.array([0.5]))
    np.testing.assert_allclose(
        window.held_probability(np.array([[3, 4], [5, 6]])), [[0.0, 0.75], [0, 0.6]]
    )


def test_a_certain_claim_that_is_rounded_up_is_certain(window):
    window.note_held(np.array([3]), np.array([1.0 + 1e-15]))
    assert window.held_probability(np.array([3])) == [1.0]


def test_claims_stay_with_their_detections(window):
    window.note_held(np.array([2, 8]), np.array([0.25, 0.75]))
    window.forget(2)
    assert window.held_probability(np.array([8])) == [0.75]
    added = window.append(scan_of(2, 4))
    assert window.held_probability(added).tolist() == [0.0, 0.0]
