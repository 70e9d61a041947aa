"""Scenes of several targets each, and when their simulation ends."""

import dataclasses

import numpy as np
import pytest

from tsepm_ros import SensorModel
from tsepm_ros.tools.design import prediction as scenes_module
from tsepm_ros.tools.design.prediction import MIN_TARGETS, Case, target_scenes, target_statistics
from tsepm_ros.tools.design.search import known_within
from tsepm_ros.tools.evaluation.workers import Workers

CASE = Case(sensor=SensorModel())


def states(case: Case, number: int) -> np.ndarray:
    return np.array([t for scene in target_scenes(case, number, 3) for t in scene.targets])


def test_targets_of_a_scene_stay_apart_and_in_the_coverage():
    times = CASE.interval * np.arange(CASE.scans)
    for scene in target_scenes(CASE, 100, 3):
        paths = [s[0::2] + times[:, None] * s[1::2] for s in scene.targets]
        assert all((np.hypot(*path.T) <= CASE.sensor.max_range).all() for path in paths)
        for row, one in enumerate(paths):
            for other in paths[:row]:  # two gates and four standard deviations at least
                assert np.hypot(*(one - other).T).min() > 2 * CASE.max_speed * CASE.interval


def test_a_target_depends_neither_on_the_others_nor_on_the_clutter():
    few, many = states(CASE, 20), states(CASE, 100)
    assert {tuple(state) for state in few} <= {tuple(state) for state in many}
    sparse = dataclasses.replace(CASE, sensor=SensorModel(clutter_density=1e-8))
    assert {tuple(state) for state in states(sparse, 20)} == {tuple(state) for state in few}
    assert all(len(scene.targets) == 1 for scene in target_scenes(sparse, 20, 3))


def test_places_are_uniform_over_the_coverage():
    case = dataclasses.replace(CASE, target_speed=0.0)
    square = (states(case, 2000)[:, 0::2] ** 2).sum(axis=1) / 9000.0**2
    assert np.quantile(square, [0.25, 0.5, 0.75]) == pytest.approx([0.25, 0.5, 0.75], abs=0.04)


def test_where_the_coverage_is_too_large_each_target_has_its_patch(monkeypatch):
    monkeypatch.setattr(scenes_module, "MAX_WHOLE_COVERAGE", 100.0)
    for scene in target_scenes(CASE, 5, 3):
        [state] = scene.targets
        x_min, x_max, y_min, y_max = scene.clutter_box
        end = state[0::2] + state[1::2] * scene.duration
        for x, y in (state[0::2], end):
            assert x_min < x < x_max and y_min < y < y_max
        assert scene.area < CASE.sensor.coverage_area


@pytest.mark.long
@pytest.mark.parametrize("processes", [1, 2])
def test_the_simulation_ends_when_enough_is_known(processes):
    case = Case(sensor=SensorModel(max_range=4000.0, clutter_density=1e-7), scans=6)
    found = target_statistics(
        case,
        "score",
        {"false_tracks_per_hour": 10.0},
        runs=60,
        seed=1,
        workers=Workers(processes=processes),
        enough=lambda detection: known_within(detection, 1.0),
    )
    assert MIN_TARGETS <= found.targets < 60
