"""Scans and the sensor model: what is taken, and that all else is refused by its field's name."""

import dataclasses
import math

import numpy as np
import pytest

from tsepm_ros import Scan, SensorModel
from tsepm_ros.tracker.scan import FEATURES, MAX_MAGNITUDE, wrap

GOOD = {"stamp": 5.0, "range": [100.0, 200.0], "azimuth": [0.1, 0.2]}


def test_a_scan_has_arrays_of_float64_that_cannot_be_changed():
    scan = Scan(**GOOD, range_std=[1, 2], time_offset=(0, 1), features={"intensity": [3, 4]})
    for name in ("range", "azimuth", "range_std", "time_offset", "sensor_pose"):
        assert getattr(scan, name).dtype == np.float64
        assert not getattr(scan, name).flags.writeable
    assert scan.features["intensity"].dtype == np.float64
    assert not scan.features["intensity"].flags.writeable
    range_ = np.array([100.0])
    scan = Scan(0.0, range_, [0.0])
    range_[0] = -1.0
    assert scan.range[0] == 100.0


BAD = np.nan, np.inf, -np.inf
BAD_VALUES = [
    ("sensor_velocity", (math.nan, 0.0)),
    ("sensor_velocity", (1e7, 0.0)),
    *[("stamp", value) for value in (*BAD, None, "soon", [1.0, 2.0])],
    *[("range", [100.0, value]) for value in (*BAD, 0.0, -0.0, -5.0, 1e9, 1e-200)],
    *[("azimuth", [0.1, value]) for value in BAD],
    *[("range_std", [1.0, value]) for value in (*BAD, 0.0, -1.0, 1e9, 1e-200)],
    *[("azimuth_std", [0.1, value]) for value in (*BAD, 0.0, -0.1, 4.0, 1e-200)],
    *[("time_offset", [0.1, value]) for value in (*BAD, 1e7)],
    *[("sensor_pose", [0.0, value, 0.0]) for value in (*BAD, 1e10)],
    ("sensor_pose", [[0.0, 0.0, 0.0], [0.0, np.nan, 0.0]]),
    *[
        ("sensor_pose_covariance", np.diag([1.0, value, 1.0]))
        for value in (*BAD, -1.0, 1e14, 1e152, 1.7e308)
    ],
    ("sensor_pose_covariance", [[1.0, 2.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]),
    ("sensor_pose_covariance", [[1.0, 2.0, 0.0], [2.0, 1.0, 0.0], [0.0, 0.0, 1.0]]),
]


BAD_SHAPES = [
    *[("swept", arc) for arc in ([1.0], [7.0, 1.0], [0.0, -0.1], [0.0, 7.0], [np.nan, 1.0])],
    ("sensor_velocity", [1.0, 2.0, 3.0]),
    ("sensor_velocity", [[1.0, 2.0]]),
    *[("range", value) for value in ([[100.0, 200.0]], 100.0, None, ["far", "near"])],
    *[("azimuth", value) for value in ([0.1], 0.1, [[0.1], [0.2]])],
    *[("range_std", value) for value in ([1.0, 2.0, 3.0], 1.0)],
    ("azimuth_std", [0.1]),
    *[("time_offset", value) for value in ([0.1], 0.1)],
    ("sensor_pose", [0.0, 0.0]),
    ("sensor_pose", [[0.0, 0.0, 0.0]] * 3),
    ("sensor_pose", np.zeros((3, 2))),
    ("sensor_pose", None),
    ("sensor_pose_covariance", np.eye(2)),
    ("sensor_pose_covariance", 1.0),
]


BAD_LISTS = [
    ("range", [[100.0], [1.0, 2.0]]),
    ("sensor_pose", [[0.0, 0.0, 0.0], [0.0]]),
    ("stamp", 10**400),
    ("range", [1, 10**400]),
]


@pytest.mark.parametrize(
    ("name", "value"), [*BAD_VALUES, *BAD_SHAPES, *BAD_LISTS], ids=lambda value: str(value)[:40]
)
def test_a_bad_value_or_shape_is_refused_by_its_field_s_name(name, value):
    with pytest.raises(ValueError, match=rf"^{name}\b"):
        Scan(**{**GOOD, name: value})


@pytest.mark.parametrize(
    ("features", "sentence"),
    [
        *[
            ({"intensity": value}, r"features\['intensity'\]")
            for value in ([3.0], [[3.0, 4.0]], 3.0, ["loud", "quiet"])
        ],
        ({"colour": [1.0, 2.0]}, "features: unknown name 'colour'.*intensity"),
        (None, "features"),
    ],
    ids=str,
)
def test_a_bad_feature_is_refused_by_its_name(features, sentence):
    with pytest.raises(ValueError, match=f"^{sentence}"):
        Scan(**GOOD, features=features)


def test_every_named_feature_is_taken_and_may_be_unknown():
    scan = Scan(**GOOD, features={name: [np.nan, 1.0] for name in FEATURES})
    assert set(scan.features) == {"intensity", "range_width", "azimuth_width", "range_rate"}


def test_any_finite_angle_is_taken_and_wrapped():
    angle = np.array([-3.0, -0.5, 0.0, 1.0, 3.1])
    for turns in (-1000, -3, -1, 1, 2, 100_000):
        scan = Scan(0.0, np.ones(5), angle + 2 * math.pi * turns)
        np.testing.assert_allclose(scan.azimuth, angle, rtol=0, atol=1e-9)
    absurd = Scan(0.0, np.ones(3), [1e15, -1e300, 1.7e308]).azimuth
    assert (np.abs(absurd) <= math.pi).all()


def test_angles_inside_are_untouched_to_the_bit():
    inside = np.array([-math.pi, -1e-300, 0.1, 0.2, math.pi, np.nextafter(math.pi, 0)])
    np.testing.assert_array_equal(wrap(inside), inside)
    np.testing.assert_array_equal(wrap(np.append(inside, 4.0))[:-1], inside)
    assert Scan(0.0, inside[:1] + 10, inside[:1]).azimuth[0] == -math.pi


def test_one_pose_or_one_per_detection():
    assert Scan(**GOOD, sensor_pose=(1, 2, 3)).sensor_pose.tolist() == [1, 2, 3]
    for number in (2, 3):  # of three it is not one pose
        poses = np.arange(3.0 * number).reshape(number, 3)
        scan = Scan(0.0, [1.0] * number, [0.0] * number, sensor_pose=poses)
        np.testing.assert_array_equal(scan.sensor_pose, poses)
    assert Scan(**GOOD).sensor_pose.tolist() == [0, 0, 0]


@pytest.mark.parametrize("pose", [(1.0, 2.0, 3.0), np.zeros((0, 3))], ids=["one", "per detection"])
@pytest.mark.parametrize("empty", [[], (), np.zeros(0)], ids=["list", "tuple", "array"])
def test_an_empty_scan_is_a_scan(pose, empty):
    columns = dict.fromkeys(("range", "azimuth", "range_std", "azimuth_std", "time_offset"), empty)
    pose = {"sensor_pose": pose, "sensor_pose_covariance": np.eye(3)}
    scan = Scan(1.0, **columns, features={"intensity": empty}, **pose)
    assert len(scan) == 0
    assert scan.range.shape == scan.time_offset.shape == (0,)
    with pytest.raises(ValueError, match=r"^azimuth"):
        Scan(1.0, empty, [0.1])


@pytest.mark.parametrize("covariance", [np.zeros((3, 3)), np.ones((3, 3)), 1e-20 * np.eye(3)])
def test_semi_definite_pose_covariances_are_taken(covariance):
    np.testing.assert_array_equal(
        Scan(**GOOD, sensor_pose_covariance=covariance).sensor_pose_covariance, covariance
    )


def test_the_largest_values_are_still_taken():
    names = "range", "range_std", "azimuth_std", "time_offset"
    largest = {name: [MAX_MAGNITUDE[name]] for name in names}
    pose = MAX_MAGNITUDE["sensor_pose"], 0.0, 0.0
    assert len(Scan(0.0, azimuth=[0.0], sensor_pose=pose, **largest)) == 1


@pytest.mark.parametrize("stamp", [0, -1.5, 1.7e9, np.float32(3.0)])
def test_any_finite_stamp_is_taken(stamp):
    assert Scan(stamp, [], []).stamp == float(stamp)


def assert_same_fields(one: Scan, other: Scan) -> None:
    for field in dataclasses.fields(Scan):
        found, expected = getattr(one, field.name), getattr(other, field.name)
        if field.name == "features":
            assert list(found) == list(expected)
        else:
            np.testing.assert_array_equal(found, expected, err_msg=field.name)


def test_replaced_checks_the_new_fields_alone_and_keeps_the_others():
    scan = Scan(1.0, [100.0, 200.0], [0.1, 7.0], features={"intensity": [1.0, 2.0]})
    moved = scan.replaced(sensor_pose=[1.0, 2.0, 3.0], azimuth=[0.2, 4.0])
    expected = dataclasses.replace(scan, sensor_pose=[1.0, 2.0, 3.0], azimuth=[0.2, 4.0])
    assert_same_fields(moved, expected)
    assert moved.range is scan.range
    assert moved.features is scan.features
    for fields, sentence in [
        ({"sensor_pose": [1e10, 0.0, 0.0]}, "sensor_pose must be at most"),
        ({"azimuth": [0.0]}, "azimuth must have the shape"),
        ({"sensor_pose_covariance": -np.eye(3)}, "sensor_pose_covariance must be symmetric"),
    ]:
        with pytest.raises(ValueError, match=f"^{sentence}"):
            scan.replaced(**fields)


def test_a_trusted_scan_has_the_defaults_of_a_checked_one():
    range_, azimuth = np.array([100.0]), np.array([0.5])
    trusted = Scan.trusted(stamp=1.0, range=range_, azimuth=azimuth)
    assert trusted.range is range_
    assert len(trusted) == 1
    assert_same_fields(trusted, Scan(1.0, range_, azimuth))


def test_positions_are_ranges_and_azimuths():
    scan = Scan.from_xy(1.0, [3.0, 0.0, -5.0], [4.0, 2.0, 0.0], range_std=[1.0, 2.0, 3.0])
    np.testing.assert_allclose(scan.range, [5.0, 2.0, 5.0])
    np.testing.assert_allclose(scan.azimuth, [np.arctan2(4.0, 3.0), np.pi / 2, np.pi])
    np.testing.assert_array_equal(scan.range_std, [1.0, 2.0, 3.0])
    assert len(Scan.from_xy(2.0, [], [])) == 0


@pytest.mark.parametrize(
    ("x", "y", "sentence"),
    [
        ([1.0], [1.0, 2.0], "x and y must have one shape"),
        (1.0, 2.0, "x and y must have one shape"),
        ([np.nan], [0.0], "x and y must be finite"),
        ([0.0], [0.0], "range must be above 0"),
        (["far"], [0.0], "x must be an array of numbers"),
    ],
)
def test_positions_that_are_none_are_refused(x, y, sentence):
    with pytest.raises(ValueError, match=f"^{sentence}"):
        Scan.from_xy(0.0, x, y)


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
