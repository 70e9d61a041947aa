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
"""The sensor model, its coverage, and the poses at its echoes."""

import dataclasses
import math

import numpy as np
import pytest

from tsepm_ros import Scan, SensorModel
from tsepm_ros.tracker.sensor import (
    FULL_TURN,
    Coverage,
    echo_poses,
    error_variances,
    inside_coverage,
    rays_go_on,
)


def sweep(number: int, turn_rate: float, seam: float, *, speed: float = 0.0):
    """Azimuths, times and poses of a beam that turns once in 2.5 s above a ship."""
    time = np.arange(number) * 2.5 / number
    azimuth = np.remainder(seam + time * 2 * np.pi / 2.5 + np.pi, 2 * np.pi) - np.pi
    yaw = 3.0 + turn_rate * time
    pose = np.stack([8.0 * time, 2.0 * time, np.remainder(yaw + np.pi, 2 * np.pi) - np.pi], axis=1)
    return azimuth, time, pose


@pytest.mark.parametrize("seam", [-3.1, 0.0, 2.0])
@pytest.mark.parametrize("turn_rate", [0.0, 0.2, -0.2])
def test_in_a_sweep_a_position_is_judged_by_the_pose_when_the_beam_is_there(turn_rate, seam):
    rng = np.random.default_rng(3)
    azimuth, time, pose = sweep(120, turn_rate, seam)
    range_ = rng.uniform(50.0, 900.0, 120)
    order = rng.permutation(120)
    scan = Scan(
        0.0,
        range_[order],
        azimuth[order],
        time_offset=(time + range_ / 1500.0)[order],
        sensor_pose=pose[order],
    )
    poses = echo_poses(scan)
    assert poses.by_azimuth
    # Places where the beam looks once, and when it does.
    when = rng.uniform(0.3, 2.2, 50)
    beam, far = seam + when * 2 * np.pi / 2.5, rng.uniform(100.0, 900.0, 50)
    sight = beam + 3.0 + turn_rate * when
    place = np.stack([8.0 * when, 2.0 * when], axis=1)
    place = place + far[:, None] * np.stack([np.cos(sight), np.sin(sight)], axis=1)
    found = poses.polar(place)
    np.testing.assert_allclose(found[0], far, atol=0.05)
    np.testing.assert_allclose(np.cos(found[1] - beam), 1.0, atol=1e-6)


EDGE = SensorModel(
    range_std=10.0,
    range_std_fraction=0.0,
    azimuth_std=0.01,
    min_range=500.0,
    max_range=1000.0,
    azimuth_min=-1.0,
    azimuth_max=1.0,
)


def test_detections_may_be_three_deviations_beyond_the_edge():
    range_ = [1029.0, 471.0, 1031.0, 469.0]
    used = inside_coverage(Scan(0.0, range_, np.zeros(4)), EDGE)
    assert used.tolist() == [True, True, False, False]
    azimuth = [1.029, -1.029, 1.031, -1.031, math.pi]
    used = inside_coverage(Scan(0.0, np.full(5, 700.0), azimuth), EDGE)
    assert used.tolist() == [True, True, False, False, False]
    own = {"range_std": [11.0, 10.0], "azimuth_std": [0.01, 0.011]}
    assert inside_coverage(Scan(0.0, [1031.0, 700.0], [0.0, -1.031], **own), EDGE).all()


def test_errors_of_detections_are_their_own_or_the_sensor_s():
    scan = Scan(0.0, [600.0, 800.0], [0.0, 1.0])
    range_, azimuth = error_variances(scan, EDGE)
    np.testing.assert_allclose(range_, 100.0)
    np.testing.assert_allclose(azimuth, 1e-4)
    own = scan.replaced(range_std=[1.0, 2.0], azimuth_std=[0.1, 0.02])
    range_, azimuth = error_variances(own, EDGE)
    np.testing.assert_allclose(range_, [1.0, 4.0])
    np.testing.assert_allclose(azimuth, [1e-2, 4e-4])


def test_errors_wider_than_a_sector_leave_no_azimuth_out():
    scan = Scan(0.0, np.full(5, 700.0), np.linspace(-3.0, 3.0, 5), azimuth_std=np.full(5, 1.0))
    assert inside_coverage(scan, EDGE).all()


INCREMENT = math.radians(0.25)

SLOPE = math.sin(INCREMENT) / math.sin(math.radians(20.0) - INCREMENT)


@pytest.mark.parametrize(("constant", "fraction"), [(0.0, 1e-6), (0.03, 0.0), (0.03, 0.01)])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_jump_is_one_beyond_the_slope_and_three_deviations_of_a_difference(
    constant, fraction, sign
):
    sensor = SensorModel(range_std=constant, range_std_fraction=fraction)
    deviation = math.sqrt(2.0) * math.hypot(constant, 5.0 * fraction)
    limit = SLOPE * 5.0 + 3.0 * deviation
    for share, expected in ((0.999, True), (1.001, False)):
        rays = [np.array([5.0]), np.array([5.0 + share * limit])]
        before, after = rays[:: int(sign)]
        assert rays_go_on(before, after, sign * INCREMENT, sensor).tolist() == [expected]


def test_what_is_no_range_and_a_coarse_fan_always_jump():
    rays = np.array([math.nan, math.inf, 0.0, -1.0]), np.full(4, 5.0)
    sensor = SensorModel(range_std=1e3)
    for before, after in (rays, rays[::-1]):
        assert not rays_go_on(before, after, INCREMENT, sensor).any()
    for increment in (math.radians(3.1), math.nan):
        assert not rays_go_on(np.full(1, 5.0), np.full(1, 5.0), increment, sensor).any()


def test_the_range_variance_has_a_constant_and_a_growing_part():
    sensor = SensorModel(range_std=3.0, range_std_fraction=0.01)
    assert sensor.range_variance([0.0, 400.0]).tolist() == pytest.approx([9.0, 25.0])


@pytest.mark.parametrize("name", [field.name for field in dataclasses.fields(SensorModel)])
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, "wide", None, True], ids=str)
def test_what_is_no_finite_number_is_refused_by_name(name, value):
    with pytest.raises(ValueError, match=name):
        SensorModel(**{name: value})


OUT_OF_RANGE = {
    "range_std": (-1.0, 2e5, 1e155),
    "range_std_fraction": (-0.1, 1.1),
    "azimuth_std": (0.0, 1.1),
    "min_range": (-1.0, 9000.0, 1e300, 9000.0 - 1e-9),
    "max_range": (0.0, 5e-324, 1e-200),
    "azimuth_min": (4.0, -7.0, math.pi - 1e-9),
    "azimuth_max": (-4.0, 7.0, -math.pi + 1e-12),
    "detection_probability": (0.0, 1.01),
    "clutter_density": (0.0, -1e-6, 1e31),
    "range_rate_std": (5e-324, 1e-30),
    "clutter_range_rate": (1e-30,),
}


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        *[({name: value}, name) for name, values in OUT_OF_RANGE.items() for value in values],
        ({"range_std": 1e4, "azimuth_std": 1e-8}, "range_std must be at most 1e\\+11 m/rad"),
        ({"range_std": 0.0, "range_std_fraction": 0.0}, "range_std and range_std_fraction"),
    ],
)
def test_values_out_of_their_range_are_refused_by_name(values, sentence):
    with pytest.raises(ValueError, match=sentence):
        SensorModel(**values)


@pytest.mark.parametrize("value", [5, np.float64(5.0), np.float32(5.0), np.int64(5)], ids=repr)
def test_whole_and_numpy_numbers_are_numbers(value):
    assert type(SensorModel(range_std=value).range_std) is float


def test_coverage_is_a_ring_sector_with_its_edges():
    sensor = SensorModel(min_range=100.0, max_range=1000.0, azimuth_min=-0.5, azimuth_max=0.5)
    range_ = [500.0, 100.0, 1000.0, 99.9, 1000.1]
    assert sensor.covers(range_, np.zeros(5)).tolist() == [True, True, True, False, False]
    azimuth = [0.5, -0.5, 2 * math.pi + 0.2, 0.51, -0.51, math.pi]
    assert sensor.covers(np.full(6, 500.0), azimuth).tolist() == [True] * 3 + [False] * 3


def test_a_sector_astern_reaches_across_pi():
    sensor = SensorModel(azimuth_min=2.5, azimuth_max=3.8)
    azimuth = [3.0, -3.0, math.pi, 2.0, 0.0]
    assert sensor.covers(np.full(5, 500.0), azimuth).tolist() == [True] * 3 + [False] * 2


def test_a_full_circle_covers_every_azimuth_once():
    sensor = SensorModel(azimuth_min=-2 * math.pi, azimuth_max=2 * math.pi)
    assert sensor.sector_width == 2 * math.pi
    assert SensorModel().covers(np.full(100, 500.0), np.linspace(-10, 10, 100)).all()


def test_the_covered_area_is_what_drawn_points_say():
    # 200 000 points in the square around; the share inside within 5 standard errors.
    sensor = SensorModel(min_range=300.0, max_range=1000.0, azimuth_min=1.0, azimuth_max=4.5)
    x, y = np.random.default_rng(1).uniform(-1000, 1000, (2, 200_000))
    share = sensor.covers(np.hypot(x, y), np.arctan2(y, x)).mean()
    expected = sensor.coverage_area / 4e6
    assert abs(share - expected) < 5 * math.sqrt(expected * (1 - expected) / 200_000)


def test_a_turn_in_rounded_numbers_is_all_round():
    for half, all_round in ((3.1415, True), (3.14, True), (math.radians(179), True), (3.0, False)):
        sensor = SensorModel(azimuth_min=-half, azimuth_max=half)
        assert sensor.all_round is all_round
        assert bool(sensor.covers([100.0], [math.pi])[0]) is all_round


def test_a_coverage_is_all_round_from_a_full_turn_on():
    whole = Coverage(azimuth_min=0.0, azimuth_max=FULL_TURN)
    assert whole.all_round
    assert whole.sector_width == 2 * math.pi
    less = Coverage(azimuth_min=0.0, azimuth_max=FULL_TURN - 1e-6)
    assert not less.all_round
    assert less.sector_width == FULL_TURN - 1e-6
