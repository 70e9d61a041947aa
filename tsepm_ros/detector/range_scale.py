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
the logarithm of the range are then shifted.

What stands out in the last images is kept as places in the fixed frame, so that an image of a
sensor that has moved is compared with what it should show from there. Where images in a row fit at
another shift, the same in all, and do not fit without it, the ranges were changed. Where poses are
not known, a turn is found from the images, and a motion goes on from image to image, as no change
of the range does. Before an image that comes after a pause there may be any motion: all is learned
anew.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np
from scipy.fft import irfft2, next_fast_len, rfft2

from tsepm_ros.detector.fixed_frame import PosedCells
from tsepm_ros.detector.image import SonarImage
from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray

BINS, SPAN = 128, 16.0
"""Places on the axis, and the ratio of its ends."""
BEARINGS = 64
"""Groups of bearings, about."""
KEPT_IMAGES, IMAGES_IN_A_ROW = 4, 3
"""Images that an image is compared with, and images that must show a change."""
LEAST_SHIFT, MIN_OVERLAP = 3, 0.25
"""Least shift, and least part of the axis that both images have."""
MAX_TURN_GROUPS = 12
"""Largest turn from the images before, in groups of bearings."""
MIN_CORRELATION, MAX_UNSHIFTED_SHARE = 0.25, 0.4
"""Correlation of what stands, and part of it that is left without the shift, at most."""
MIN_COMMON_CELLS = 6.0
"""Bright cells that carry a correlation: of few, some lie on others by chance."""
MIN_DEVIATIONS, MAX_DEVIATIONS = 2.0, 4.0
"""Deviations of its range above which a value counts, and by how many at most."""
LEAST_INTERVAL = 0.25
"""Time after an image in which others are not compared, s."""
LAST_INTERVALS, PAUSE_INTERVALS = 9, 1.75
"""Intervals of images whose median is usual, and how many usual intervals are a pause."""
FORGOTTEN_AFTER = 60.0
"""Time after the last image that shows a change after which it is not known any more, s."""


class RangeScale:
    """Compares images of the same cells.

    Parameters
    ----------
    azimuth : (b,) ndarray
        rad.
    range : (m,) ndarray
        m.
    """

    def __init__(self, azimuth: FloatArray, range: FloatArray) -> None:
        self._changed, self._shown = 0, 0.0  # the shift that is known, and when it was seen
        self._stamps, self._compared = deque[float](maxlen=LAST_INTERVALS), -math.inf
        self._first = np.linspace(0, len(azimuth), min(BEARINGS, len(azimuth)) + 1)[:-1].astype(int)
        ranges = range[-1] * SPAN ** (np.arange(-BINS, 1) / BINS)
        self._edges = np.minimum(np.searchsorted(range, ranges), len(range) - 1)
        self._cells = PosedCells(azimuth[self._first], ranges[:-1] * SPAN ** (0.5 / BINS))
        self._step = float(np.ptp(azimuth)) * np.sign(azimuth[-1] - azimuth[0]) / len(self._first)
        self._groups = np.add.reduceat(np.eye(len(azimuth), dtype=np.float32), self._first)
        self._all_cells = self._sums(np.ones((len(azimuth), len(range))))
        self._learn_anew()

    def _learn_anew(self) -> None:
        self._kept = deque[tuple[FloatArray, FloatArray]](maxlen=KEPT_IMAGES)
        self._shifts = deque[int | None](maxlen=IMAGES_IN_A_ROW)
        self._changed, self._heading_error = 0, 0.0

    def add(self, image: SonarImage) -> float:
        """Compare an image of these cells with those before.

        Returns
        -------
        float
            How far what stands lies, over its distance when the ranges were given; 1: no change is
            known.
        """
        is_pause = self._pauses(image.stamp)
        if abs(image.stamp - self._shown) > FORGOTTEN_AFTER or (is_pause and not self._changed):
            self._learn_anew()
        if 0.0 <= image.stamp - self._compared < LEAST_INTERVAL:
            return float(SPAN ** (self._changed / BINS))
        pose = np.broadcast_to(np.asarray(image.sensor_pose), (len(image.azimuth), 3))
        self._cells.pose, self._compared = pose[self._first], image.stamp
        values = self._on_log_range(image)
        shift = self._shift_of(values) if len(self._kept) == KEPT_IMAGES else None
        stands = [each for each in self._shifts if not each][-1:] == [0]
        shift = shift if stands or self._changed or not shift else None
        self._shifts.append(shift)
        known = [each for each in self._shifts if each is not None]
        if len(known) == IMAGES_IN_A_ROW and np.ptp(known) <= 1:
            middle, self._shown = int(np.median(known)), image.stamp
            self._changed = middle if abs(middle - self._changed) >= LEAST_SHIFT else self._changed
        if not self._changed:
            self._shown = image.stamp
            if np.ptp([each for each in known if each] or [0]) > 1:  # a motion, which goes on
                self._learn_anew()
            if not shift:
                cells = np.argwhere(values).astype(float)
                self._kept.append((self._cells.places(cells), values[values != 0.0]))
        return float(SPAN ** (self._changed / BINS))

    def _pauses(self, stamp: float) -> bool:
        """Whether the images paused before one of a stamp, s, which is noted."""
        self._stamps.append(stamp)
        intervals = np.diff(self._stamps, prepend=-math.inf)
        return not 0.0 < intervals[-1] <= PAUSE_INTERVALS * float(np.median(intervals))

    def _on_log_range(self, image: SonarImage) -> FloatArray:
        """What stands out at each range of an image, over the logarithm of the range, (g, k)."""
        there = np.isfinite(image.intensity)
        sums, cells = (
            self._sums(np.where(there, image.intensity, 0.0)),
            self._all_cells if there.all() else self._sums(there),
        )
        level, groups = sums / np.maximum(cells, 1.0), np.maximum((cells > 0.0).sum(axis=0), 1)
        level = np.where(cells > 0.0, level - level.sum(axis=0) / groups, 0.0)
        deviation = np.sqrt(np.square(level).sum(axis=0) / groups)
        level /= np.where(deviation > 0.0, deviation, 1.0)
        return np.asarray(np.clip(level - MIN_DEVIATIONS, 0.0, MAX_DEVIATIONS))

    def _sums(self, values: FloatArray | BoolArray) -> FloatArray:
        """Sums of values (b, m) over groups of bearings and places on the axis, (g, k)."""
        of_groups = self._groups @ values.astype(np.float32)  # a fourth of the time of `reduceat`
        return np.diff(of_groups.cumsum(axis=1, dtype=float)[:, self._edges])

    def _shift_of(self, values: FloatArray) -> int | None:
        """By how much what stands is shifted; None if it is not seen. A turn is followed."""
        self._cells.pose[:, 2] += self._heading_error
        seen = np.zeros_like(values)
        for places, weights in self._kept:
            cells = np.rint(self._cells.cells(places))
            inside = ((cells >= 0) & (cells < values.shape)).all(axis=1)
            np.add.at(seen, tuple(cells[inside].astype(int).T), weights[inside])
        turns, shifts, fit = _correlations(values, seen)
        near = np.abs(shifts) < LEAST_SHIFT
        is_other = fit[:, near].max() < MAX_UNSHIFTED_SHARE * fit[:, ~near].max()
        fit[:, near == is_other] = -1.0
        best = np.unravel_index(fit.argmax(), fit.shape)
        turn, shift = int(turns[best[0]]), int(shifts[best[1]])
        common = values * np.roll(seen, (turn, shift), axis=(0, 1))
        if (
            fit.max() < MIN_CORRELATION
            or common.sum() ** 2 < MIN_COMMON_CELLS * np.square(common).sum()
        ):
            return None
        self._heading_error -= turn * self._step
        self._cells.pose[:, 2] -= turn * self._step
        return shift if is_other else 0


def _correlations(image: FloatArray, seen: FloatArray) -> tuple[IntArray, IntArray, FloatArray]:
    """Turns (t,), shifts (s,), and the correlation of an image with one before at each, (t, s)."""
    size = next_fast_len(len(image) + MAX_TURN_GROUPS, real=True), 2 * BINS
    parts = [rfft2(each.astype(np.float32), size) for each in (image, seen)]
    common = irfft2(parts[0] * parts[1].conj(), size)
    most = int((1.0 - MIN_OVERLAP) * BINS)
    turns, shifts = np.arange(-MAX_TURN_GROUPS, MAX_TURN_GROUPS + 1), np.arange(-most, most + 1)
    power = [np.append(0.0, np.cumsum((each**2).sum(axis=0))) for each in (image, seen)]
    low, high = np.maximum(shifts, 0), BINS + np.minimum(shifts, 0)
    whole = (power[0][high] - power[0][low]) * (power[1][high - shifts] - power[1][low - shifts])
    fit = common[turns[:, None], shifts] / np.sqrt(np.maximum(whole, 1e-12))
    return turns, shifts, fit
