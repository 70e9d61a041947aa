"""Streaks of pings with detections close together at a place."""

from __future__ import annotations

import numpy as np

from tsepm_ros.tracker import multi_detection
from tsepm_ros.tracker.clustering import PlotExtent
from tsepm_ros.tracker.multi_detection import CloseStreaks

EXTENT = PlotExtent(4.0, 4.0)


def step(streaks: CloseStreaks, range_, azimuth, reach=1.0):
    range_, azimuth = np.array(range_, float), np.array(azimuth, float)
    position = np.stack([range_ * np.cos(azimuth), range_ * np.sin(azimuth)], axis=1)
    return streaks.step(range_, azimuth, position, reach).tolist()


def test_a_streak_grows_where_detections_are_close_and_ends_with_the_first_ping_without():
    streaks = CloseStreaks(EXTENT)
    assert step(streaks, [100.0, 102.0, 200.0], [0.0, 0.0, 1.0]) == [0, 0, 0]
    # A detection alone, at 200 m, begins none.
    assert step(streaks, [101.0, 103.0, 200.0], [0.0, 0.0, 1.0]) == [1, 1, 0]
    # Nor does it go on where there is one detection, though it has the length so far.
    assert step(streaks, [102.0], [0.0]) == [2]
    assert step(streaks, [103.0, 104.0], [0.0, 0.0]) == [0, 0]


def test_a_target_moves_within_its_reach():
    for reach, length in ((20.0, 1), (5.0, 0)):
        streaks = CloseStreaks(EXTENT)
        step(streaks, [100.0, 102.0], [0.0, 0.0], reach)
        assert step(streaks, [120.0], [0.0], reach) == [length]


def test_the_length_at_a_place_does_not_depend_on_what_else_is_in_the_ping():
    lengths = []
    for others in ([], [101.0, 101.5, 250.0]):
        streaks = CloseStreaks(EXTENT)
        for _ in range(3):
            step(streaks, [100.0, 102.0], [0.0, 0.0])
        lengths.append(step(streaks, [100.0, *others], np.zeros(1 + len(others)))[0])
    assert lengths == [3, 3]


def test_a_sensor_that_moves_takes_no_streak_along():
    streaks = CloseStreaks(EXTENT)
    polar = np.array([100.0, 102.0]), np.zeros(2)
    streaks.step(*polar, np.array([[100.0, 0.0], [102.0, 0.0]]), 1.0)
    assert streaks.step(*polar, np.array([[150.0, 0.0], [152.0, 0.0]]), 1.0).tolist() == [0, 0]


def test_a_ping_of_very_many_detections_ends_every_streak():
    streaks = CloseStreaks(EXTENT)
    step(streaks, [100.0, 102.0], [0.0, 0.0])
    many = multi_detection.MAX_CLOSE_DETECTIONS + 1
    assert not any(step(streaks, np.full(many, 100.0), np.zeros(many)))
    assert step(streaks, [100.0, 102.0], [0.0, 0.0]) == [0, 0]


def test_a_ping_of_very_many_pairs_ends_every_streak(monkeypatch):
    lengths = []
    for most in (2, 30):
        monkeypatch.setattr(multi_detection, "MAX_PAIRS", most)
        streaks = CloseStreaks(EXTENT)
        crowd = np.linspace(100.0, 101.0, 5)  # 10 pairs
        step(streaks, crowd, np.zeros(5))
        lengths.append(max(step(streaks, crowd, np.zeros(5))))
    assert lengths == [0, 1]
