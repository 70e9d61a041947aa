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

import numpy as np
import pytest

from tsepm_ros.detector.range_scale import RangeScale

RANGE = 0.1 * (np.arange(400) + 0.5)


def picture(far, rng, *, standing=8, cells=(128, 400)):
    """Speckle, and things that stand, of which a picture shows those up to a range."""
    image = rng.rayleigh(1.0, cells)
    places = np.random.default_rng(5)
    ranges, rows = places.uniform(4.0, 38.0, standing), places.integers(3, 125, standing)
    for cell, row in zip((ranges / far * cells[1]).astype(int), rows, strict=True):
        echo = image[row - 2 : row + 3, max(cell - 3, 0) : cell + 4]
        echo += rng.rayleigh(5.0, echo.shape)
    return image


def factors(fars, *, seed=1, **more):
    """Factors other than 1 that are found in pictures that show ranges up to these, by image."""
    rng, scale, found = np.random.default_rng(seed), RangeScale(), {}
    for index, far in enumerate(fars):
        image = picture(far, rng, **more)
        factor = scale.factor(image, np.isfinite(image), RANGE)
        if factor != 1.0:
            found[index] = factor
    return found


@pytest.mark.parametrize("change", [0.5, 0.75, 1.5, 2.0])
def test_a_change_of_the_range_is_found_by_the_second_image_with_its_factor(change):
    found = factors([40.0] * 10 + [40.0 * change] * 10)
    assert found == {11: pytest.approx(1.0 / change, rel=0.03)}


def test_each_of_several_changes_is_found():
    found = factors([40.0] * 8 + [20.0] * 8 + [40.0] * 8)
    assert list(found) == [9, 17]


def test_images_of_one_range_show_no_change():
    assert factors([40.0] * 60) == {}
    assert factors([40.0] * 60, standing=0) == {}


def seen_turning(fars, *, rate=2.0, seed=1):
    """Factors found by a sonar that turns by so many degrees an image before a wall and posts."""
    rng, scale, found = np.random.default_rng(seed), RangeScale(), {}
    azimuth = np.radians(60.0 - 120.0 * (np.arange(128.0)[:, None] + 0.5) / 128.0)
    posts = [(8.0, 4.0), (14.0, -6.0), (10.0, -9.0), (16.0, 7.0), (6.0, -2.0)]
    for index, far in enumerate(fars):
        yaw = np.radians(abs((rate * index) % 80.0 - 40.0) - 20.0)
        range_ = far * (np.arange(400.0) + 0.5) / 400.0
        x, y = range_ * np.cos(azimuth + yaw), range_ * np.sin(azimuth + yaw)
        bright = np.where(np.abs(x - 18.0) < 0.3, 5.0, 1.0)
        for post in posts:
            bright[np.hypot(x - post[0], y - post[1]) < 0.3] = 7.0
        image = bright * rng.rayleigh(1.0, x.shape)
        factor = scale.factor(image, np.isfinite(image), RANGE)
        if factor != 1.0:
            found[index] = factor
    return found


@pytest.mark.parametrize("rate", [1.0, 2.0, 5.0])
def test_a_turn_before_a_wall_is_no_change_of_the_range(rate):
    assert seen_turning([40.0] * 100, rate=rate) == {}


@pytest.mark.parametrize("rate", [1.0, 5.0])
def test_a_change_of_the_range_is_found_while_the_sonar_turns(rate):
    found = seen_turning([40.0] * 20 + [20.0] * 20, rate=rate)
    assert found == {21: pytest.approx(2.0, rel=0.05)}


def test_a_single_image_of_another_range_is_no_change():
    assert factors([40.0] * 10 + [20.0] + [40.0] * 10) == {}


def test_where_nothing_stands_nothing_is_said():
    assert factors([40.0] * 10 + [20.0] * 10, standing=0) == {}


@pytest.mark.parametrize("cells", [(1, 400), (3, 400)])
def test_few_bearings_show_no_change(cells):
    image = np.zeros(cells)
    scale = RangeScale()
    for _ in range(8):
        assert scale.factor(image, np.ones(cells, bool), RANGE) == 1.0
