"""The sensor model: errors, coverage, and what is refused."""

import dataclasses
import math

import numpy as np
import pytest

from tsepm_ros import SensorModel


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
