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
"""Polar to Cartesian without bias, in the fixed frame; the window of detections."""

import math

import numpy as np
import pytest
from support.builders import detections, whitened

from tsepm_ros import Scan, SensorModel
from tsepm_ros.tracker.measurement import (
    LEAST_ACROSS,
    MeasurementWindow,
    convert_measurements,
    covariance_at,
    covariance_of_pose,
    measured_polar,
    measurement_covariance,
    unbiased_position,
)

SENSOR = SensorModel(range_std=12.0, range_std_fraction=0.01, azimuth_std=math.radians(2.0))

NODES, WEIGHTS = np.polynomial.hermite_e.hermegauss(60)

WEIGHTS = WEIGHTS / WEIGHTS.sum()

"""Quadrature over a standard normal variable."""


def moments(range_: float, azimuth: float, range_std: float, azimuth_std: float):
    """Exact mean and covariance of the converted measurement, by quadrature."""
    r, a = np.meshgrid(range_ + range_std * NODES, azimuth + azimuth_std * NODES, indexing="ij")
    points = unbiased_position(r, a, azimuth_std).reshape(-1, 2)
    weights = np.outer(WEIGHTS, WEIGHTS).ravel()
    mean = weights @ points
    return mean, (points - mean).T @ ((points - mean) * weights[:, None])


GEOMETRIES = pytest.mark.parametrize(
    ("range_", "azimuth", "range_std", "azimuth_std"),
    [
        pytest.param(5000.0, 0.3, 75.0, math.radians(1.0), id="sonar"),
        pytest.param(9000.0, -2.5, 10.0, math.radians(3.0), id="wide beam"),
        pytest.param(100.0, 1.5, 40.0, 0.5, id="very wide beam, near"),
        pytest.param(800.0, math.pi, 1.0, 0.001, id="narrow beam, behind"),
    ],
)


@GEOMETRIES
def test_mean_and_covariance_are_those_of_the_converted_measurement(
    range_, azimuth, range_std, azimuth_std
):
    mean, expected = moments(range_, azimuth, range_std, azimuth_std)
    true = range_ * np.array([math.cos(azimuth), math.sin(azimuth)])
    np.testing.assert_allclose(mean, true, rtol=0, atol=1e-11 * range_)
    covariance = measurement_covariance(range_, azimuth, range_std**2, azimuth_std)
    scale = np.abs(expected).max()
    np.testing.assert_allclose(covariance, expected, rtol=0, atol=1e-8 * scale)


def test_a_tiny_azimuth_error_costs_no_digits():
    # The closed form in b loses all digits of what s adds along the line of sight here.
    range_, variance, s = 1e6, 1e-8, 1e-5
    covariance = measurement_covariance(range_, 0.0, variance, s)
    assert covariance[0, 0] == pytest.approx(range_**2 * s**4 / 2 + variance, rel=1e-9)
    assert covariance[1, 1] == pytest.approx(range_**2 * s**2, rel=1e-9)


def test_an_uncertain_sensor_pose_widens_the_position_as_drawn_poses_do():
    # 200 000 draws: each entry of the whitened covariance within 5 standard errors, sqrt(2 / n),
    # and 1e-3 for what the first order leaves out (yaw variance of 1e-4).
    rng = np.random.default_rng(5)
    n, offset = 200_000, np.array([3000.0, -1000.0])
    covariance = np.array([[400.0, 50.0, 0.01], [50.0, 100.0, -0.02], [0.01, -0.02, 1e-4]])
    poses = rng.multivariate_normal(np.zeros(3), covariance, n)
    cosine, sine = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    placed = poses[:, :2] + np.stack(
        [cosine * offset[0] - sine * offset[1], sine * offset[0] + cosine * offset[1]], axis=1
    )
    expected = covariance_of_pose(offset, covariance)
    difference = np.abs(whitened(placed, expected) - np.eye(2)).max()
    assert difference < 5 * math.sqrt(2 / n) + 1e-3


@pytest.mark.parametrize("own", [{}, {"range_std": [40.0]}], ids=["model", "own error"])
def test_the_covariance_of_a_target_elsewhere_is_as_seen_from_the_sensor_there(own):
    place, pose = np.array([[1500.0, -800.0]]), (700.0, 900.0, 0.6)
    moved = convert_measurements(Scan(0.0, [3000.0], [0.2], sensor_pose=pose, **own), SENSOR, 0)
    still = convert_measurements(Scan(0.0, [3000.0], [0.2], **own), SENSOR, 0)
    expected = covariance_at(still, place - pose[:2], SENSOR)
    np.testing.assert_allclose(covariance_at(moved, place, SENSOR), expected)
    range_, azimuth = math.hypot(800.0, -1700.0), math.atan2(-1700.0, 800.0)
    variance = 40.0**2 if own else SENSOR.range_variance(range_)
    plain = measurement_covariance(range_, azimuth, variance, SENSOR.azimuth_std)
    np.testing.assert_allclose(expected[0], plain, rtol=1e-9)
    uncertain = np.array([[400.0, 50.0, 0.01], [50.0, 100.0, -0.02], [0.01, -0.02, 1e-4]])
    moved["sensor_pose_covariance"] = uncertain
    added = covariance_of_pose(place[0] - pose[:2], uncertain)
    found = covariance_at(moved, place, SENSOR)
    np.testing.assert_allclose(found, expected + added)


def test_covariance_at_the_sensor_is_that_of_any_direction():
    hits = convert_measurements(Scan(0.0, [3000.0], [0.2]), SENSOR, 0)
    expected = measurement_covariance(0.0, 0.0, SENSOR.range_variance(0.0), SENSOR.azimuth_std)
    found = covariance_at(hits, np.zeros((1, 2)), SENSOR)
    np.testing.assert_allclose(found, expected[None], rtol=1e-12)


@pytest.mark.parametrize("range_", [1e-3, 5.0, 60.0, 300.0, 3000.0])
def test_the_error_across_is_at_least_that_along_where_it_is_asked_for(range_):
    # A target's extent and own ship's position errors act on both axes, at any range.
    sensor = SensorModel(range_std=8.0, range_std_fraction=0.0, azimuth_std=math.radians(1.0))
    scan = Scan(0.0, [range_], [0.4])
    hits = convert_measurements(scan, sensor, 0, LEAST_ACROSS)
    np.testing.assert_array_equal(
        hits["position"], convert_measurements(scan, sensor, 0)["position"]
    )
    there = np.array([[-0.7 * range_, 0.2 * range_]])
    for covariance, direction in (
        (hits["covariance"][0], [math.cos(0.4), math.sin(0.4)]),
        (covariance_at(hits, there, sensor)[0], there[0] / np.hypot(*there[0])),
    ):
        across = np.array([-direction[1], direction[0]])
        assert direction @ covariance @ direction == pytest.approx(8.0**2, rel=0.01)
        assert math.sqrt(across @ covariance @ across) >= 8.0 * (1.0 - 1e-9)
    if range_ > 1000.0:  # the azimuth error is the larger
        np.testing.assert_array_equal(
            hits["covariance"], convert_measurements(scan, sensor, 0)["covariance"]
        )


def test_what_was_measured_comes_back_from_a_detection():
    range_, azimuth = np.array([0.5, 3000.0, 9000.0]), np.array([0.1, 3.0, -2.0])
    given = {"azimuth_std": [0.5, 0.1, 0.01], "sensor_pose": (50.0, -8.0, 1.0)}
    detections = convert_measurements(Scan(7.0, range_, azimuth, **given), SENSOR, 0)
    assert detections["time"].tolist() == [7.0] * 3
    back_range, back_azimuth = measured_polar(detections)
    np.testing.assert_allclose(back_range, range_, rtol=1e-12)
    turn = np.remainder(back_azimuth - azimuth, 2 * np.pi)
    np.testing.assert_allclose(turn, 1.0, rtol=1e-12)


def test_an_intensity_that_no_square_holds_is_none():
    scan = Scan(0.0, [1e3] * 4, [0.0] * 4, features={"intensity": [5.0, np.inf, -1e100, np.nan]})
    found = convert_measurements(scan, SENSOR, 0)["intensity"]
    np.testing.assert_array_equal(found, [5.0, np.nan, np.nan, np.nan])
    np.testing.assert_array_equal(
        convert_measurements(Scan(0.0, [1e3], [0.0]), SENSOR, 0)["intensity"], np.nan
    )


def scan_of(n: int, scan: int) -> np.ndarray:
    found = detections(np.zeros((n, 2)), float(scan))
    found["scan"], found["index"] = scan, np.arange(n)
    return found


@pytest.fixture
def window() -> MeasurementWindow:
    window = MeasurementWindow()
    for scan, n in enumerate([3, 0, 2, 4]):
        window.append(scan_of(n, scan))
    return window


def test_detections_are_found_by_scan_and_index_while_they_are_here(window):
    track, ids = window.find([((0, 1), (2, 1)), (), ((1, 0), (3, 3), (3, 4))])
    assert track.tolist() == [0, 0, 2] and ids.tolist() == [1, 4, 8]
    assert [found.tolist() for found in window.find([])] == [[], []]
    window.forget(2)
    assert len(window) == 6 and window.first_id == 3
    assert window.find([((0, 1), (2, 1), (3, 0))])[1].tolist() == [4, 5]
    assert window.find([((0, 2),)])[1].tolist() == []
    assert window.column("index", np.array([[3, 4], [5, 8]])).tolist() == [[0, 1], [0, 3]]
    assert window[np.array([4])]["scan"].tolist() == [2]


def test_the_window_has_what_came_last_whatever_was_forgotten(window):
    """As detections put together anew in each scan, and ids that go on."""
    rng, kept, newest = np.random.default_rng(1), window[np.arange(9)], 3
    for _ in range(60):
        newest += 1
        found = scan_of(rng.poisson(8), newest)
        found["position"] = rng.normal(size=(len(found), 2))
        before = window.first_id + len(window)
        assert window.append(found).tolist() == list(range(before, before + len(found)))
        kept = np.concatenate([kept, found])
        oldest = rng.integers(newest - 20, newest + 2)
        window.forget(oldest)
        kept = kept[kept["scan"] >= oldest]
        assert window[window.first_id + np.arange(len(window))].tobytes() == kept.tobytes()


def test_a_scan_is_added_without_a_copy_of_the_window_but_for_the_few_times_that_it_doubles():
    window, copies = MeasurementWindow(), 0
    for scan in range(1000):
        before = window._detections
        window.append(scan_of(5, scan))
        copies += not np.shares_memory(before, window._detections)
    assert copies <= 12
    window.forget(995)
    for scan in range(1000, 1100):
        window.forget(scan - 5)
        window.append(scan_of(5, scan))
    assert len(window._room.base) <= 4 * len(window), "the room is given back"
