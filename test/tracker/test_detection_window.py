"""The window of recent detections, whose ids never change, and paths through it."""

import numpy as np
import pytest
from support.builders import detections

from tsepm_ros import SensorModel
from tsepm_ros.tracker.detection_window import DetectionWindow
from tsepm_ros.tracker.initial_state import MAX_ROWS_TOGETHER, NO_HIT, Paths, fit, fit_paths


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


def paths(hit_count: np.ndarray, most: int) -> Paths:
    place = np.arange(most)
    hits = np.where(place < hit_count[:, None], place, NO_HIT)
    return Paths(hits, hit_count, np.zeros(len(hit_count), np.int64))


def test_blocks_are_bounded():
    many = paths(np.full(MAX_ROWS_TOGETHER + 5, 2), 2)
    assert [len(rows) for rows, _ in many.of_equal_count()] == [MAX_ROWS_TOGETHER, 5]


@pytest.mark.parametrize("estimator", ["unweighted", "weighted"])
def test_paths_of_different_lengths_are_fitted_each_to_its_hits(estimator):
    window, rng = DetectionWindow(), np.random.default_rng(1)
    found = detections(1000.0 + rng.uniform(-50.0, 50.0, (5, 2)), 12.0 * np.arange(5))
    ids = window.append(found)
    several = paths(np.array([3, 5, 2]), 5)
    state, covariance = fit_paths(several, window, 60.0, SensorModel(), estimator)
    for row, count in enumerate(several.hit_count):
        alone = fit(window[ids[None, :count]], 60.0, SensorModel(), estimator)
        np.testing.assert_array_equal(state[row], alone.state[0])
        np.testing.assert_array_equal(covariance[row], alone.covariance[0])
