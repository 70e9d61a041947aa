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
"""Scans: what is taken, and that all else is refused by its field's name."""

import dataclasses
import math

import numpy as np
import pytest

from tsepm_ros import Scan
from tsepm_ros.tracker.scan import FEATURES, MAX_MAGNITUDE, scan_arc_of, scan_of_rows, wrap

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
    *[
        ("swept", arc)
        for arc in ([1.0], [7.0, 1.0], [-7.0, 1.0], [0.0, -0.1], [0.0, 7.0], [np.nan, 1.0])
    ],
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
    assert set(scan.features) == {
        "intensity",
        "range_width",
        "azimuth_width",
        "range_rate",
        "standing",
    }


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


@pytest.mark.parametrize("stamp", [0, -1.5, 1.7e9, np.float32(3.0), 2**31 - 1e-6])
def test_any_stamp_that_a_message_can_have_is_taken(stamp):
    assert Scan(stamp, [], []).stamp == float(stamp)


@pytest.mark.parametrize("stamp", [1_700_000_000_000, 1_700_000_000 * 10**9, -(2**31)])
def test_a_stamp_in_milliseconds_or_nanoseconds_is_refused(stamp):
    with pytest.raises(ValueError, match=r"^stamp must be finite, in s, below 2\*\*31"):
        Scan(stamp, [], [])


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


def test_chosen_detections_keep_what_is_theirs():
    columns = {"range": [10.0, 20.0], "azimuth": [0.1, 0.2], "range_std": [1.0, 2.0]}
    columns |= {"azimuth_std": [0.01, 0.02], "time_offset": [0.3, 0.4]}
    columns |= {"sensor_pose": [[0.0, 1.0, 2.0], [3.0, 4.0, 5.0]]}
    columns |= {"sensor_velocity": [[1.0, 2.0], [3.0, 4.0]]}
    one = scan_of_rows(Scan(1.0, features={"intensity": [5.0, 6.0]}, **columns), np.array([1]))
    assert {name: getattr(one, name).tolist() for name in columns} == {
        name: [values[1]] for name, values in columns.items()
    }
    assert one.features["intensity"] == [6.0]


@pytest.mark.parametrize("azimuths", [[], [math.nan]])
def test_no_azimuth_has_no_arc(azimuths):
    assert scan_arc_of(np.array(azimuths)) is None


def test_the_smallest_arc_holds_all_and_is_as_narrow_as_any():
    rng = np.random.default_rng(2)
    for number in (1, 1, *rng.integers(1, 8, 200)):
        azimuths = rng.uniform(-10.0, 10.0, number)
        arc = scan_arc_of(np.append(azimuths, [math.nan, math.inf]))
        widths = [np.mod(azimuths - first, 2 * np.pi).max() for first in azimuths]
        assert arc.width == pytest.approx(min(widths), abs=1e-9)
        assert (np.mod(azimuths - arc.start + 1e-9, 2 * np.pi) <= arc.width + 2e-9).all()
        middle = math.remainder(arc.middle - arc.start - 0.5 * arc.width, 2 * math.pi)
        assert middle == pytest.approx(0.0, abs=1e-9)
        assert not arc.whole
