"""Levelling, against SciPy's rotations."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tsepm_ros.own_ship.attitude import AXES, angles_of, levelled, rotation_of

N = 500


def directions(azimuth, elevation):
    level = np.cos(elevation)
    return np.stack([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)], axis=-1)


@pytest.mark.parametrize("mounting_yaw", [0.0, 2.2])
@pytest.mark.parametrize("steepest", [0.0, 0.5, 1.5], ids=["no elevation", "half", "steep"])
def test_a_tilted_detection_lies_where_the_full_rotation_puts_it(steepest, mounting_yaw):
    rng = np.random.default_rng(1)
    slant, azimuth = rng.uniform(1.0, 9000.0, N), rng.uniform(-math.pi, math.pi, N)
    elevation = rng.uniform(-steepest, steepest, N)
    yaw, pitch, roll = rng.uniform(-1.0, 1.0, (3, N)) * [[math.pi], [1.5], [math.pi]]
    attitude = Rotation.from_euler("ZYX", np.stack([yaw, pitch, roll], axis=1))
    mounting = Rotation.from_euler("z", mounting_yaw)
    place = slant[:, None] * (attitude * mounting).apply(directions(azimuth, elevation))
    height = None if steepest == 0.0 else slant * np.sin(elevation)
    found, turned = levelled(slant * np.cos(elevation), azimuth, height, roll, pitch, mounting_yaw)
    heading = yaw + mounting_yaw
    np.testing.assert_allclose(found * np.cos(turned + heading), place[:, 0], atol=1e-8)
    np.testing.assert_allclose(found * np.sin(turned + heading), place[:, 1], atol=1e-8)


@pytest.mark.parametrize("zero", [0.0, -0.0])
def test_a_level_sensor_measures_in_the_horizontal_plane_to_the_bit(zero):
    rng = np.random.default_rng(2)
    range_, azimuth, height = rng.uniform(-9e3, 9e3, (3, N))  # any angle, not wrapped
    level = np.full(N, zero)
    for kwargs in ({}, {"mounting_yaw": 0.3}):
        found = levelled(range_, azimuth, height, level, level, **kwargs)
        np.testing.assert_array_equal(found, (range_, azimuth))


def test_those_received_level_stay_to_the_bit_beside_tilted_ones():
    roll, pitch = np.array([0.0, 0.1, 0.0]), np.array([0.0, 0.0, -0.1])
    range_, azimuth = np.full(3, 1234.567), np.full(3, 7.7)
    found, turned = levelled(range_, azimuth, None, roll, pitch)
    assert (found[0], turned[0]) == (1234.567, 7.7)
    assert (found[1:] < 1234.5).all()


@pytest.mark.parametrize(
    ("roll", "pitch", "azimuth", "elevation", "expected"),
    [
        (0.2, 0.0, math.pi / 2, -0.2, 1.0),  # port up, and looking as much below the deck
        (0.2, 0.0, -math.pi / 2, 0.2, 1.0),
        (0.0, 0.3, 0.0, 0.3, 1.0),  # bow down, and looking up from it
        (0.0, 0.3, math.pi, -0.3, 1.0),
        (0.0, 0.3, 0.0, 0.0, math.cos(0.3)),
        (0.25, 0.0, 0.0, 0.0, 1.0),  # a roll does nothing to what is ahead
        (math.pi, 0.0, 0.0, 0.0, 1.0),
    ],
)
def test_the_signs_are_those_of_rep_103(roll, pitch, azimuth, elevation, expected):
    found, turned = levelled(
        np.array([math.cos(elevation)]),
        np.array([azimuth]),
        np.array([math.sin(elevation)]),
        np.array([roll]),
        np.array([pitch]),
    )
    assert found[0] == pytest.approx(expected, rel=1e-14)
    assert math.remainder(turned[0] - azimuth, 2 * math.pi) == pytest.approx(0.0, abs=1e-14)


@pytest.mark.filterwarnings("error")
def test_a_range_may_vanish_and_a_height_be_absurd():
    quarter = np.full(2, math.pi / 2)
    found, _ = levelled(
        np.array([100.0, 1.0]), quarter, np.array([0.0, 1e308]), quarter, np.zeros(2)
    )
    assert found[0] < 1e-10
    assert found[1] > 1e300


@pytest.mark.parametrize("length", [1e-3, 1.0, 50.0])
def test_rotations_and_angles_are_those_of_scipy(length):
    rotations = Rotation.random(100, np.random.default_rng(3))
    for one in rotations:
        matrix = rotation_of((length * one.as_quat()).tolist())
        np.testing.assert_allclose(matrix, one.as_matrix(), atol=1e-14)
        np.testing.assert_allclose(angles_of(matrix), one.as_euler("ZYX"), atol=1e-9)


def test_what_has_no_direction_is_refused():
    with pytest.raises(ValueError, match="zero"):
        rotation_of((0.0, 0.0, 0.0, 0.0))
    with pytest.raises(ValueError, match="zero"):
        rotation_of((0.0, math.nan, 0.0, 1.0))
    with pytest.raises(ValueError, match="no heading"):
        angles_of(Rotation.from_euler("y", 90, degrees=True).as_matrix())


def test_the_axes_of_every_frame_are_right_handed():
    for axes in AXES.values():
        ahead, port, up = axes.T
        np.testing.assert_array_equal(np.cross(ahead, port), up)
    np.testing.assert_array_equal(AXES["sonar"] @ [1, 2, 3], [3, -2, 1])  # x up, y to starboard
    np.testing.assert_array_equal(AXES["optical"] @ [1, 2, 3], [-2, -3, 1])
