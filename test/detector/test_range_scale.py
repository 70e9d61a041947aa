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
"""A change of the range that a picture does not state shows in what stands."""

import math

import numpy as np
import pytest

from tsepm_ros.detector.image import SonarImage
from tsepm_ros.detector.range_scale import FORGOTTEN_AFTER, LEAST_INTERVAL, RangeScale

RANGE = 0.1 * (np.arange(400) + 0.5)
AZIMUTH = np.radians(60.0 - 120.0 * (np.arange(128.0) + 0.5) / 128.0)
POSTS = [(8.0, 4.0), (14.0, -6.0), (10.0, -9.0), (16.0, 7.0), (6.0, -2.0)]
WALL = 18.0


def found_in(images):
    """Changes of the factor, by image, in images (stamp, intensity, pose or None)."""
    scale, found, before = RangeScale(AZIMUTH, RANGE), {}, 1.0
    for index, (stamp, intensity, pose) in enumerate(images):
        factor = scale.add(SonarImage(stamp, RANGE, AZIMUTH, intensity, sensor_pose=pose))
        if factor != before:
            found[index] = before = factor
    return found


def picture(far, rng, *, standing=8):
    """Speckle, and things that stand, of which a picture shows those up to a range."""
    image = rng.rayleigh(1.0, (128, 400))
    places = np.random.default_rng(5)
    ranges, rows = places.uniform(4.0, 38.0, standing), places.integers(3, 125, standing)
    for cell, row in zip((ranges / far * 400).astype(int), rows, strict=True):
        echo = image[row - 2 : row + 3, max(cell - 3, 0) : cell + 4]
        echo += rng.rayleigh(5.0, echo.shape)
    return image


def factors(fars, *, seed=1, **more):
    """Changes that are found in pictures that show ranges up to these, every second."""
    rng = np.random.default_rng(seed)
    return found_in((float(k), picture(far, rng, **more), None) for k, far in enumerate(fars))


def seen(pose, rng, *, far=40.0, posts=POSTS, wall=WALL):
    """A picture up to a range of posts and a wall ahead, from a pose x, yaw."""
    x, yaw = pose
    reach, bearing = far * (np.arange(400.0) + 0.5) / 400.0, AZIMUTH[:, None] + yaw
    east, north = x + reach * np.cos(bearing), reach * np.sin(bearing)
    bright = np.where(np.abs(east - wall) < 0.3, 5.0, 1.0)
    for post in posts:
        bright[np.hypot(east - post[0], north - post[1]) < 0.3] = 7.0
    return bright * rng.rayleigh(1.0, east.shape)


@pytest.mark.parametrize("change", [0.5, 0.75, 1.5, 2.0])
def test_a_change_of_the_range_is_found_by_the_third_image_with_its_factor(change):
    found = factors([40.0] * 10 + [40.0 * change] * 10)
    assert found == {12: pytest.approx(1.0 / change, rel=0.03)}


def test_each_of_several_changes_is_found_until_the_ranges_are_those_given():
    found = factors([40.0] * 8 + [20.0] * 8 + [30.0] * 8 + [40.0] * 8)
    assert found == {10: 2.0, 18: pytest.approx(4.0 / 3.0, rel=0.03), 26: 1.0}


def test_images_of_one_range_show_no_change():
    assert factors([40.0] * 30) == {}
    assert factors([40.0] * 30, standing=0) == {}


def seen_turning(fars, *, rate=2.0, seed=1):
    """Factors found by a sonar that turns by so many degrees an image before a wall and posts."""
    rng = np.random.default_rng(seed)
    yaws = [np.radians(abs((rate * k) % 80.0 - 40.0) - 20.0) for k in range(len(fars))]
    return found_in(
        (float(k), seen((0.0, yaw), rng, far=far), None)
        for k, (far, yaw) in enumerate(zip(fars, yaws, strict=True))
    )


@pytest.mark.parametrize("rate", [1.0, 5.0])
def test_a_turn_before_a_wall_is_no_change_of_the_range(rate):
    assert seen_turning([40.0] * 40, rate=rate) == {}


@pytest.mark.parametrize("rate", [1.0, 5.0])
def test_a_change_of_the_range_is_found_while_the_sonar_turns(rate):
    found = seen_turning([40.0] * 20 + [20.0] * 20, rate=rate)
    assert found == {22: pytest.approx(2.0, rel=0.05)}


def seen_driving(stamps, places, *, poses=True, change=(), **scene):
    """Factors found on the way along x, m, at stamps, s; the range is halved from an image on."""
    rng = np.random.default_rng(3)
    return found_in(
        (
            stamp,
            seen((x, 0.0), rng, far=20.0 if change and k >= change else 40.0, **scene),
            (x, 0.0, 0.0) if poses else None,
        )
        for k, (stamp, x) in enumerate(zip(stamps, places, strict=True))
    )


@pytest.mark.parametrize("poses", [True, False])
@pytest.mark.parametrize(
    "scene, speed, pause",
    [({}, 2.0, 2.0), ({}, 0.5, 10.0), ({"posts": []}, 1.0, 5.0), ({"wall": 99.0}, 0.0, 30.0)],
)
def test_a_drive_at_what_stands_in_a_pause_of_the_images_is_a_motion(scene, speed, pause, poses):
    stamps = 0.5 * np.arange(24.0) + np.where(np.arange(24) < 12, 0.0, pause)
    places = np.where(np.arange(24) < 12, 0.0, speed * pause)
    assert seen_driving(stamps, places, poses=poses, **scene) == {}


def test_what_own_ship_moved_between_images_is_a_motion_where_poses_tell():
    stamps, places = 3.0 * np.arange(20.0), np.where(np.arange(20) < 10, 0.0, 4.0)
    assert seen_driving(stamps, places, posts=[]) == {}
    found = seen_driving(stamps, places, posts=[], poses=False)
    assert found == {12: pytest.approx(14.0 / 18.0, rel=0.05)}, "else nothing tells them apart"


def test_a_change_of_the_range_is_found_on_the_way():
    stamps = 0.5 * np.arange(24.0)
    assert seen_driving(stamps, 0.8 * stamps, change=12) == {14: pytest.approx(2.0, rel=0.05)}
    assert seen_driving(stamps, 0.8 * stamps) == {}
    assert seen_driving(stamps, 0.8 * stamps, poses=False) == {}, "a motion goes on"


@pytest.mark.parametrize("seed", range(3))
def test_a_change_of_the_range_is_found_at_a_rate_near_that_of_the_comparisons(seed):
    """Some images are left out, and that is no pause of the images."""
    stamps = 0.253 * np.arange(60.0) + np.random.default_rng(seed).uniform(-0.004, 0.004, 60)
    found = seen_driving(stamps, np.zeros(60), change=30)
    assert list(found.values()) == [pytest.approx(2.0, rel=0.05)] and min(found) <= 36


def test_a_single_image_of_another_range_is_no_change():
    assert factors([40.0] * 10 + [20.0] + [40.0] * 10) == {}


def test_where_nothing_or_one_thing_stands_nothing_is_said():
    assert factors([40.0] * 10 + [20.0] * 10, standing=0) == {}
    assert factors([40.0] * 10 + [20.0] * 10, standing=1) == {}


@pytest.mark.parametrize("interval", [0.02, 0.1, 0.2])
def test_of_images_that_come_fast_one_in_a_quarter_of_a_second_is_compared(interval):
    rng, each = np.random.default_rng(1), math.ceil(round(LEAST_INTERVAL / interval, 6))
    fars = np.where(np.arange(20 * each) < 10 * each, 40.0, 20.0)
    found = found_in((interval * k, picture(far, rng), None) for k, far in enumerate(fars))
    assert found == {12 * each: 2.0}


def test_a_change_that_images_do_not_show_any_more_is_forgotten():
    rng, last = np.random.default_rng(4), int(FORGOTTEN_AFTER)
    fars = [40.0] * 8 + [20.0] * 8
    images = [(float(k), picture(far, rng), None) for k, far in enumerate(fars)]
    images += [(16.0 + k, picture(20.0, rng, standing=0), None) for k in range(last + 5)]
    found = found_in(images)
    assert found == {10: 2.0, 16 + last: 1.0}


def test_bearings_that_are_never_sent_do_not_count():
    rng = np.random.default_rng(7)
    images = [picture(40.0 if k < 10 else 20.0, rng) for k in range(20)]
    for image in images:
        image[30:50] = np.nan
    assert found_in((float(k), image, None) for k, image in enumerate(images)) == {
        12: pytest.approx(2.0, rel=0.03)
    }
    images = [rng.rayleigh(1.0, (128, 400)) for _ in range(20)]
    for image in images:
        image[30:50] = np.nan
    assert found_in((float(k), image, None) for k, image in enumerate(images)) == {}


@pytest.mark.parametrize("bearings", [1, 3])
def test_few_bearings_show_no_change(bearings):
    azimuth, image = AZIMUTH[:bearings], np.zeros((bearings, 400))
    scale = RangeScale(azimuth, RANGE)
    for k in range(8):
        assert scale.add(SonarImage(float(k), RANGE, azimuth, image)) == 1.0
