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
"""The profile over range, an image's own gain, and streaks."""

import numpy as np
import pytest

from tsepm_ros.detector.range_profile import (
    LIMIT,
    above_black,
    standardised,
    streaks,
    without_streaks,
)

B, M = 64, 200
ALL = np.ones((B, M), bool)
TVG = np.logspace(0, -2, M)


def speckle(rng, gain=1.0):
    return (gain * rng.rayleigh(1.0, (B, M))).astype(np.float32)


def after(pictures):
    """The last of some images, standardised by the profile of those before."""
    profile = None
    for picture in pictures:
        profile, x, defined = standardised(profile, np.asarray(picture, np.float32), ALL)
    return profile, x, defined


OWN = {
    "gain": lambda a: 3.0 * a,
    "offset": lambda a: a + 0.5,
    "none": lambda a: a,
}


@pytest.mark.parametrize("own", OWN)
def test_each_range_has_mean_0_and_deviation_1_also_in_an_image_of_another_gain(own):
    rng = np.random.default_rng(1)
    pictures = [speckle(rng, TVG) for _ in range(20)]
    _, x, _ = after([*pictures, OWN[own](speckle(rng, TVG))])
    assert abs(x.mean()) < 0.05
    assert x.std() == pytest.approx(1.0, abs=0.1)
    assert np.abs(x.mean(axis=0)).max() < 0.6
    assert x.min() >= -LIMIT


def test_an_echo_that_fills_a_range_of_one_image_hardly_moves_the_profile():
    rng = np.random.default_rng(2)
    quiet, _, _ = after([speckle(rng) for _ in range(20)])
    loud = speckle(rng)
    loud[:, 50] += 20.0
    profile, x, _ = standardised(quiet, loud, ALL)
    assert x[:, 50].mean() > 20.0, "the images before do not know it"
    assert profile.mean[0, 50] < quiet.mean[0, 50] + 0.2


@pytest.mark.parametrize(("decades", "is_another"), [(2.0, True), (0.8, True), (0.1, False)])
def test_a_profile_of_another_shape_is_learned_anew_at_once(decades, is_another):
    rng, gain = np.random.default_rng(3), np.logspace(0, -decades, M)
    profile, x, _ = after([*[speckle(rng, gain) for _ in range(20)], speckle(rng, gain[::-1])])
    assert profile.images == (1 if is_another else 21)
    assert np.abs(x.mean(axis=0)).max() < 0.6 or not is_another


def test_a_range_of_one_value_is_not_defined_whatever_the_value():
    picture = np.random.default_rng(9).rayleigh(1.0, (1500, 50)).astype(np.float32)
    picture[:, 10:20] = np.linspace(0.01, 1.0, 10)
    _, _, defined = standardised(None, picture, np.ones(picture.shape, bool))
    assert not defined[:, 10:20].any() and defined[:, 20:].all()


def test_ranges_of_one_value_are_not_defined_until_they_vary_and_an_empty_image_is_forgotten():
    rng = np.random.default_rng(4)
    pictures = [speckle(rng) for _ in range(12)]
    for picture in pictures[:6]:
        picture[:, :5] = 9.0
    _, x, defined = after(pictures[:6])
    assert not defined[:, :5].any() and defined[:, 5:].all() and not x[:, :5].any()
    profile, _, defined = after(pictures)
    assert defined.all()
    kept, _, defined = standardised(profile, np.full((B, M), 3.0, np.float32), ALL)
    assert kept is profile and not defined.any()


def test_a_streak_is_found_and_a_wall_and_a_shadow_are_none():
    x = np.random.default_rng(5).standard_normal((B, M)).astype(np.float32)
    assert len(streaks(x, wraps=False)) <= 1
    x[20, 60:] += 2.0
    x[30:33, 100:140] += 6.0
    x[40:43, 60:] -= 1.5
    assert streaks(x, wraps=False).tolist() == [20]


def test_a_streak_that_grows_with_range_is_as_even_as_other_bearings_and_an_echo_in_it_stays():
    rng = np.random.default_rng(6)
    x = rng.standard_normal((B, 400)).astype(np.float32)
    x[20] += 5.0 * rng.rayleigh(1.0, 400) * np.linspace(0.5, 4.0, 400)
    x[20, 210:214] = 80.0
    even = without_streaks(x, np.ones(x.shape, bool), wraps=False)
    thirds = np.delete(even[20], range(205, 219)).reshape(2, -1)
    assert np.abs(thirds.mean(axis=1)).max() < 0.4 and thirds.std(axis=1).max() < 1.5
    assert even[20, 210:214].min() > 2.0
    np.testing.assert_array_equal(np.delete(even, 20, axis=0), np.delete(x, 20, axis=0))


@pytest.mark.parametrize(("share", "is_black"), [(0.8, False), (0.88, True), (1.0, False)])
def test_black_is_noise_by_one_step_below_what_is_shown(share, is_black):
    rng = np.random.default_rng(5)
    a = rng.uniform(3.0, 9.0, (B, M)).astype(np.float32)
    a[rng.random(a.shape) < share] = 1.0
    there = rng.random(a.shape) < 0.9
    shown, black = above_black(a, there, 7)
    dark = there & (a == 1.0)
    assert (black == (dark & (share > 0.84))).all()
    np.testing.assert_array_equal(shown[~black], a[~black])
    if is_black:
        step = a[there & ~dark].min() - 1.0
        assert shown[black].max() <= 1.0
        np.testing.assert_allclose((1.0 - shown[black]).mean(), step, rtol=0.05)
        assert (above_black(a, there, 8)[0][black] != shown[black]).all()
