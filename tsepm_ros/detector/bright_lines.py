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
"""Bearings and ranges that are bright in every image: bytes of gain, lines of a display.

What stands in the same column of every image at nearly all ranges is no echo. Such a line is left
out from the first images on, and named once it was bright in each of them. Of ranges these are
thin lines whose cells keep their values: the ring of the transmission, a wall and a flat bottom
may fill a range, with speckle.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from tsepm_ros.numerics.arrays import BoolArray, FloatArray

LOOKS = 10
"""Images in each of which a line must be bright, and images from look to look afterwards."""
BRIGHT_SHARE = 0.95
"""Share of an image's cells below a level that most cells of a bright line are above."""
SAMPLED_CELLS = 64
"""Cells of a line by which its median is found."""
MAX_CHANGE_SHARE = 0.15
"""Part of the median of a range by which most of its cells change from image to image."""
LINE_RANGES = 4
"""Most ranges of a line."""
RING_SHARE = 0.05
"""Part of the ranges, from the nearest used on, in which the ring of a transmission begins."""
MOST_NAMED = 8
"""Most bearings, or ranges, of a sentence."""
BRIGHTER = f"brighter, at least by half, than {BRIGHT_SHARE:.0%} of each of the first images"


def measured_values(image: NDArray[Any]) -> NDArray[Any]:
    """An image (b, m) with its lowest value where nothing was measured."""
    finite = np.isfinite(image)
    return np.where(finite, image, image.min(initial=0, where=finite))


def medians(values: NDArray[Any]) -> list[FloatArray]:
    """Median of each bearing, (b,), and of each range, (m,), by some cells of each."""
    steps = [max(n // SAMPLED_CELLS, 1) for n in values.shape]
    return [
        np.quantile(part, 0.5, axis=axis, method="lower")
        for part, axis in ((values[:, :: steps[1]], 1), (values[:: steps[0]], 0))
    ]


class BrightLines:
    """What is bright in every image of a shape.

    Attributes
    ----------
    bearings : (b,) ndarray of bool
        Bright bearings.
    ranges : (m,) ndarray of bool
        Bright ranges whose cells keep their values, in lines of at most `LINE_RANGES`.
    """

    def __init__(self, b: int, m: int) -> None:
        self._images, self._before = 0, np.zeros((0, 0), np.float32)
        self.bearings, self._all_ranges = np.ones(b, bool), np.ones(m, bool)
        self._steady, self.ranges = np.ones(m, bool), np.zeros(m, bool)

    def add(
        self, image: NDArray[Any], azimuth: FloatArray, distance: FloatArray, covered: BoolArray
    ) -> list[str]:
        """Take an image (b, m); sentences with the last of the first images.

        `covered`, (b, m) or (m,), are the cells in the coverage: a ring beside it is not named.
        """
        self._images += 1
        if self._images > LOOKS and self._images % LOOKS:
            return []
        values = measured_values(image).astype(np.float32)
        some = tuple(slice(None, None, max(n // SAMPLED_CELLS, 1)) for n in values.shape)
        level = np.quantile(values[some], BRIGHT_SHARE, method="lower")
        along, across = medians(values)
        self.bearings &= along > level
        self._all_ranges &= across > level
        before, self._before = self._before, values
        if before.shape == values.shape:
            change = medians(np.abs(values - before))[1]
            self._steady &= change <= MAX_CHANGE_SHARE * across
            runs, count = ndimage.label(self._all_ranges & self._steady)
            self.ranges = (runs > 0) & (np.bincount(runs, minlength=count + 1) <= LINE_RANGES)[runs]
        return self._sentences(azimuth, distance, covered) if self._images == LOOKS else []

    def _sentences(
        self, azimuth: FloatArray, distance: FloatArray, covered: BoolArray
    ) -> list[str]:
        beams, cells = np.flatnonzero(self.bearings), np.flatnonzero(self.ranges)
        used = np.flatnonzero(np.atleast_2d(covered).any(axis=0))
        wide = np.intersect1d(used, np.flatnonzero(self._all_ranges & ~self.ranges))
        named = ", ".join(f"{k} ({math.degrees(azimuth[k]):.1f})" for k in beams[:MOST_NAMED])
        near = ", ".join(f"{distance[k]:.4g}" for k in cells[:MOST_NAMED])
        span = distance[wide].min(initial=np.inf), distance[wide].max(initial=0.0)
        sentences = {
            f"{len(beams)} of {len(azimuth)} bearings are left out, since they are {BRIGHTER}; "
            f"numbers from 0 (azimuths in degrees): {named}. Bytes of gain before each row, and "
            "lines of a display, count as bearings and shift the others: cut them off the "
            "image": beams,
            f"{len(cells)} of {len(distance)} ranges are left out, since they are {BRIGHTER}: "
            f"{near} m. Bytes of gain, and lines of a display, count as ranges and shift the "
            "others: cut them off the image": cells,
            f"{len(wide)} of {len(distance)} ranges are {BRIGHTER}, from {span[0]:.4g} to "
            f"{span[1]:.4g} m. "
            + (
                "If that is the ring of the transmission, give sensor.min_range beyond it"
                if np.isin(used[: max(int(RING_SHARE * len(distance)), 1)], wide).any()
                else "A wall or a flat bottom all round is so; it becomes background"
            ): wide,
        }
        return [words for words, lines in sentences.items() if len(lines)]
