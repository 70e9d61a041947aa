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
"""Amplitudes in deviations of their range: a profile over range that is learned over images.

Mean ``m`` and deviation ``d`` of the amplitudes at each range hold over images (gain over range,
reverberation, the ring of the transmission); each image has one gain ``g`` and one offset ``o`` of
its own (a gain that is adjusted; a logarithm)::

    x = min(max((a - o - g m) / (g d), -LIMIT), HIGHEST)

so that the holes of a range that is saturated, or of a logarithm, have a bounded part, and a single
cell of linear powers does not hide all around it. No bearing
is subtracted: a shadow behind a pile lowers a part of its bearings, and nothing else. A *streak*,
such as the pulse of another sonar, raises a bearing in most of its parts; it is standardised
by its own surroundings along the bearing.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from tsepm_ros.numerics.arrays import BoolArray, IntArray

Image = NDArray[np.float32]
"""(b, m): single precision is twice as fast, and finer than any sonar's."""

LIMIT = 2.5
"""Deviations from the mean beyond which an amplitude counts as the limit."""
HIGHEST = 100.0
"""Deviations as which a higher amplitude counts: the ring around it has a bounded part of it."""
PASSES = 3
"""Times that mean and deviation are taken, each within the limit by those before: an echo may fill
a tenth of a range."""
MEAN_DEVIATION = 1.25
"""Standard deviation of a normal law over its mean absolute one, which an echo moves less."""
MIN_CELLS = 24
"""Bearings without which a range, or ranges without which a part, has no statistics of its own."""
MIN_DEVIATION = 1e-6
"""Deviation, as a part of the mean, up to which all values are one: linear powers of a range may be
a millionth of those of another."""
MAX_BLACK = 1.0 - LIMIT**-2
"""Share of the cells with the least value of an image from which on this value is black: the mean
deviation of two values puts the rarer beyond the limit from there on."""
MEMORY = 16
"""Images over which a profile is learned."""
ROWS = 32
"""Bearings by which gain and offset of an image are found."""
MAX_SHAPE_CHANGE = 0.35
"""Median logarithm of the deviations over a profile's from which on it is another."""
PARTS = 8
"""Parts of a bearing."""
NEIGHBOURS = 9
"""Bearings of which the middle one may be a streak."""
MIN_STREAK_RISE = 0.15, 3.5
"""Least rise of a streak, in deviations of the amplitudes, and times the root of the ranges."""


class Profile(NamedTuple):
    """Mean and deviation of each range, (1, m), or of an image of few bearings, (1, 1)."""

    mean: Image
    deviation: Image
    images: int


def within_limit(a: Image, there: Image, total: Callable[[Image], Image]) -> tuple[Image, Image]:
    """Mean and deviation of the cells that are there, each taken within the limit by both."""
    count, limited = np.maximum(total(there), np.float32(1e-3)), a
    for _ in range(PASSES):
        mean = total(limited) / count
        deviation = MEAN_DEVIATION * total(np.abs(limited - mean) * there) / count
        reach = LIMIT * deviation
        limited = np.clip(a, mean - reach, mean + reach) * there
    return np.asarray(mean, np.float32), np.asarray(deviation, np.float32)


def profile_of(a: Image, measured: BoolArray) -> Profile:
    """The profile of a single image."""
    axis = 0 if len(a) >= MIN_CELLS else None
    # In double precision, the mean of equal values is their value.
    total = functools.partial(np.sum, axis=axis, keepdims=True, dtype=float)
    return Profile(*within_limit(a, measured.astype(np.float32), total), 0)


def fitted(profile: Profile | None, a: Image, measured: BoolArray) -> Profile | None:
    """A profile in the gain and offset of an image; None where the image's has another shape.

    Gain and offset are ``g = median(d_image / d),    o = median(m_image - g m)``.
    """
    if profile is None:
        return None
    some = slice(None, None, max(len(a) // ROWS, 1) if len(a) >= MIN_CELLS else 1)
    mean, deviation, _ = profile_of(a[some], measured[some])
    good = (deviation > MIN_DEVIATION * np.abs(mean)) & (
        profile.deviation > MIN_DEVIATION * np.abs(profile.mean)
    )
    if not good.any():
        return None
    ratio = deviation[good] / profile.deviation[good]
    gain = np.median(ratio)
    if np.median(np.abs(np.log(ratio / gain))) > MAX_SHAPE_CHANGE:
        return None
    offset = np.median(mean[good] - gain * profile.mean[good])
    return Profile(gain * profile.mean + offset, gain * profile.deviation, profile.images)


def above_black(a: Image, measured: BoolArray, seed: int) -> tuple[Image, BoolArray]:
    """Values with noise in place of black, (b, m), and which cells are black.

    A sonar whose image is nearly all one value, the least, shows what is above a threshold of its
    own. That value has no spread by which the others could be judged: below it comes noise of an
    exponential law, of the mean of the step to the least value that is shown.
    """
    least = a.min(initial=np.inf, where=measured.all() or measured)
    black = measured & (a == least)
    number = np.count_nonzero(black)
    if number <= MAX_BLACK * np.count_nonzero(measured):
        return a, np.zeros_like(black)
    step = a.min(initial=np.inf, where=measured & ~black) - least
    if np.isfinite(step):
        noise = np.random.default_rng(seed).standard_exponential(number, np.float32)
        a = a.copy()
        a[black] -= step * noise
    return a, black


def standardised(
    profile: Profile | None, a: Image, measured: BoolArray
) -> tuple[Profile, Image, BoolArray]:
    """Standardise an image by a profile, and learn the profile with it.

    Parameters
    ----------
    profile : Profile or None
        Of the images before; None: of this one alone.
    a : (b, m) ndarray
        Amplitudes; 0 where not measured.
    measured : (b, m) ndarray of bool

    Returns
    -------
    profile : Profile
        In the gain and offset of this image, learned with it by ``1 / min(images, MEMORY)``::

            m += rate d mean(clip(x)),    d *= 1 + rate (1.25 mean |clip(x)| - 1)
    x : (b, m) ndarray
        0 where it is not defined.
    defined : (b, m) ndarray of bool
        Not defined: what was not measured, and ranges of one value, such as those that the
        transmission saturates.
    """
    known = fitted(profile, a, measured) or profile_of(a, measured)
    varies = known.deviation > MIN_DEVIATION * np.abs(known.mean)
    if not varies.any():  # an image of one value says nothing
        return profile or known, np.zeros_like(a), np.zeros_like(measured)
    scale = np.where(varies, known.deviation, np.float32(1.0))
    x = a - known.mean
    x *= np.float32(1.0) / scale
    np.clip(x, np.float32(-LIMIT), np.float32(HIGHEST), out=x)
    defined = measured & varies
    if not defined.all():
        x *= defined
    axis = 0 if len(a) >= MIN_CELLS else None
    count = np.maximum(
        defined.view(np.uint8).sum(axis, np.uint32, keepdims=True),  # a third of the time of bools
        1,
    ).astype(np.float32)
    limited = np.minimum(x, np.float32(LIMIT))
    middle = limited.sum(axis, keepdims=True) / count
    limited -= middle
    spread = np.abs(limited, out=limited).sum(axis, keepdims=True) * MEAN_DEVIATION / count
    rate = np.float32(1.0 / min(known.images + 1, MEMORY))
    mean = known.mean + rate * known.deviation * middle
    deviation = known.deviation * (1.0 + rate * (spread - 1.0))
    if not varies.all():  # these may vary from now on
        fresh = profile_of(a[:, ~varies[0]], measured[:, ~varies[0]])
        mean[~varies], deviation[~varies] = fresh.mean[0], fresh.deviation[0]
    return Profile(mean, np.asarray(deviation, np.float32), known.images + 1), x, defined


def streaks(x: Image, wraps: bool) -> IntArray:
    """Numbers of the bearings that are raised above their neighbours in most of their parts.

    The rise of a bearing is the lower median of those of its parts: a wall, a near echo and a
    shadow change some parts, a streak most.
    """
    b, m = x.shape
    parts = min(PARTS, m // MIN_CELLS)
    if parts < 3 or b < NEIGHBOURS:
        return np.zeros(0, int)
    width = m // parts
    cut = np.minimum(x[:, : width * parts], LIMIT).reshape(b, parts, width)
    cut = cut @ np.full(width, 1.0 / width, np.float32)
    padded = np.pad(cut, ((NEIGHBOURS // 2,) * 2, (0, 0)), "wrap" if wraps else "edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, NEIGHBOURS, 0)
    around = np.partition(windows, NEIGHBOURS // 2, axis=2)[..., NEIGHBOURS // 2]
    middle, least = (parts - 1) // 2, max(MIN_STREAK_RISE[0], MIN_STREAK_RISE[1] / math.sqrt(m))
    return np.flatnonzero(np.partition(cut - around, middle, axis=1)[:, middle] > least)


def without_streaks(x: Image, defined: BoolArray, wraps: bool) -> Image:
    """Values of which streaks are standardised by what is around each cell along the bearing."""
    raised = streaks(x, wraps)
    if len(raised):
        rows, there = x[raised], defined[raised].astype(np.float32)
        window = max(rows.shape[1] // PARTS, MIN_CELLS)
        total = functools.partial(ndimage.uniform_filter1d, size=window, axis=1)
        mean, deviation = within_limit(rows, there, total)
        even = (rows - np.maximum(mean, 0.0)) / np.maximum(deviation, 1.0)
        x = x.copy()
        x[raised] = np.maximum(even, -LIMIT) * there
    return x
