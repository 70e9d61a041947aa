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
"""Whether all that stands in images lies at other ranges than before, by one factor.

A picture does not say its ranges. Where the operator changes them, each row has another range, and
all echoes lie at their ranges times one factor, by the ranges that are stated. Images on an axis of
the logarithm of the range are then shifted. An image is compared with the mean of the last ones at
every shift, and turned, since a sonar that turns sees what stands at other bearings and ranges.
Where another shift fits and none does not, in images in a row, the range was changed.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.numerics.arrays import BoolArray, FloatArray

BINS, SPAN = 128, 16.0
"""Places on the axis, and the ratio of its ends."""
BEARINGS = 64
"""Groups of bearings, about."""
FEWEST, MEAN_OF = 4, 4.0
"""Images of which the mean is known, and over which it is taken."""
LEAST_SHIFT, OVERLAP = 3, 0.25
"""Least shift, and least part of the axis that both images have."""
TURN = 12
"""Largest turn from the images before, in groups of bearings."""
FITS, FITS_NOT = 0.22, 0.4
"""Correlation of what stands, and part of it that is left without the shift, at most."""
LEAST, LARGEST = 2.0, 4.0
"""Deviations of its range above which a value counts, and by how many at most."""


class RangeScale:
    """Compares images of the same cells; two in a row must show a change."""

    def __init__(self) -> None:
        self._images, self._shift, self._stands = 0, 0, False
        self._mean = np.zeros(0)

    def factor(self, intensity: NDArray[np.generic], there: BoolArray, range: FloatArray) -> float:
        """Factor by which the echoes of an image lie farther than before; 1 where they do not.

        Parameters
        ----------
        intensity : (b, m) ndarray
        there : (b, m) ndarray of bool
            Whether each cell was measured.
        range : (m,) ndarray
            m, ascending.
        """
        image = _on_log_range(np.where(there, intensity, 0.0), range)
        if self._images and image.shape == self._mean.shape:
            turns, shifts, fit = _correlations(image, self._mean)
            near = np.abs(shifts) < LEAST_SHIFT
            same, other = np.where(near, fit, -1.0), np.where(near, -1.0, fit)
            shift, known = int(shifts[other.max(axis=0).argmax()]), self._shift
            changed = self._images >= FEWEST and self._stands
            changed = changed and other.max() > FITS and same.max() < FITS_NOT * other.max()
            self._shift = shift if changed else 0
            if changed and abs(shift - known) <= 1 and known:
                self._images, self._shift = 0, 0
                return float(SPAN ** (shift / BINS))
            if changed:
                return 1.0
            self._stands = bool(same.max() > FITS)
            if self._stands:
                self._mean = _turned(self._mean, int(turns[same.max(axis=1).argmax()]))
        self._images += 1
        rate = 1.0 / min(self._images, MEAN_OF)
        self._mean = image if rate == 1.0 else self._mean + rate * (image - self._mean)
        return 1.0


def _turned(image: FloatArray, turn: int) -> FloatArray:
    """An image (g, k) at bearings that are so many groups further on; 0 where it was not seen."""
    turned, rows = np.zeros_like(image), len(image) - abs(turn)
    if rows > 0:
        turned[max(turn, 0) :][:rows] = image[max(-turn, 0) :][:rows]
    return turned


def _on_log_range(values: NDArray[np.generic], range: FloatArray) -> FloatArray:
    """What stands out at each range of an image (b, m), over the logarithm of the range, (g, k)."""
    edges = np.searchsorted(range, range[-1] * SPAN ** (np.arange(-BINS, 1) / BINS))
    edges = np.minimum(edges, len(range) - 1)
    groups = np.linspace(0, len(values), min(BEARINGS, len(values)) + 1)[:-1].astype(int)
    sums = np.add.reduceat(values, groups, axis=0, dtype=np.float32)
    image = np.diff(np.cumsum(sums, axis=1)[:, edges], axis=1)
    image -= image.mean(axis=0)
    deviation = image.std(axis=0)
    image /= np.where(deviation > 0.0, deviation, 1.0)
    return np.asarray(np.clip(image - LEAST, 0.0, LARGEST))


def _correlations(
    image: FloatArray, before: FloatArray
) -> tuple[NDArray[np.int64], NDArray[np.int64], FloatArray]:
    """Turns (t,), shifts (s,), and the correlation of an image with one before at each, (t, s)."""
    size = len(image) + TURN, 2 * BINS
    parts = np.fft.rfft2(image, size), np.fft.rfft2(before, size).conj()
    common = np.fft.irfft2(parts[0] * parts[1], size)
    most = int((1.0 - OVERLAP) * BINS)
    turns, shifts = np.arange(-TURN, TURN + 1), np.arange(-most, most + 1)
    power = [np.append(0.0, np.cumsum((each**2).sum(axis=0))) for each in (image, before)]
    low, high = np.maximum(shifts, 0), BINS + np.minimum(shifts, 0)
    whole = (power[0][high] - power[0][low]) * (power[1][high - shifts] - power[1][low - shifts])
    fit = common[turns[:, None], shifts] / np.sqrt(np.maximum(whole, 1e-12))
    return turns, shifts, fit
