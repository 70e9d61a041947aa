"""Paths through the tree of splits."""

from __future__ import annotations

import numpy as np
import pytest
from support.builders import detections

from tsepm_ros import SensorModel
from tsepm_ros.tracker.detection_window import DetectionWindow
from tsepm_ros.tracker.initial_state import MAX_ROWS_TOGETHER, NO_HIT, Paths, fit, fit_paths


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
