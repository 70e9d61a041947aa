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
"""The background that each cell has of its own: what its past predicts of it.

A wall, a pile, its shadow and the texture of the ground stand in the same cells of every image of a
sensor that does not move. Each cell has a running mean ``m`` of the values ``x`` and a running mean
``e`` of the absolute deviations of the smoothed ones; ``s`` is the median of ``e`` over the cells::

    z  = smoothed(normalised(x - b m)),    z' = z ((e + K s) / s)^-c

The data say how far the past predicts: ``b`` and ``c`` are regressions over the cells of each
image, in 0 to 1. Both are near 0 in noise and where the sensor moves, and ``b`` is near 1 at walls.

Values count up to `REACH` mean deviations. A cell that something has *entered* is frozen, for a
time; a cell that it has *left* learns in a few images; all cells are learned anew where
many have changed at once. A thing enters where cells become brighter; its shadow enters where an
area larger than echoes becomes darker, further below the level of its ranges than it was above.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy import ndimage

from tsepm_ros.detector.fixed_frame import FixedGrid, block_means
from tsepm_ros.detector.range_profile import Image
from tsepm_ros.numerics.arrays import BoolArray, FloatArray

MEMORY = 40
"""Images over which a cell's mean and deviation are learned."""
FIRST_IMAGES = 4
"""Images of which means are learned before they predict, and deviations from them are."""
PRIOR_IMAGES = 8
"""Images as many as which the median deviation counts for each cell's own."""
SETTLED_IMAGES = 15
"""Images before cells are frozen."""
REACH = 3.1
"""Mean deviations up to which a value counts, 2.5 standard deviations of a normal law."""
MIN_REACH_SHARE = 0.5
"""Part of the median deviation that is the least reach of a cell is counted in."""
KAPPA = 0.1
"""Part of the median deviation that is added to each."""
RECENT_IMAGES = 5.0
"""Images over which it is said that something entered, or left."""
CHANGE = 2.0
"""Mean deviations by which the mean of these images is another then."""
SHADE, SHADE_STEP = 1.0, 4
"""Mean deviations by which the mean of these images is another in a shadow, and ranges of which one
is looked at."""
MAX_BRIGHTNESS = 1.0
"""Deviations of its range up to which a cell is counted in for whether an area is bright."""
SHADE_ECHOES, SHADE_CELLS = 8.0, 100.0
"""Least area of a shadow, in boxes of an echo and in cells."""
WHOLE_IMAGES = 30
"""Images after which a cell learns with every second one."""
SCALE_PERIOD = 4
"""Images of which one makes the scale of the cells anew."""
MAX_HELD_TIMES = 80.0
"""Times that the slowest target leaves its place, for which a cell is frozen at most."""
MAX_CHANGED_SHARE = 0.25
"""Part of the cells that have changed from which on all are learned anew."""
MAX_BLOCK_MEAN = 9.0
"""Largest mean of a block of cells that counts."""
EVEN_VARIANCE = 1e-4
"""Variance of the logarithms of deviations that are alike."""
SAMPLED_CELLS = np.s_[::3, ::3]
"""Cells that are taken for the regression of deviations."""


def predicted(x: Image, mean: Image) -> tuple[float, float]:
    """How far means predict an image, over blocks of cells: ``b = sum x m / sum m^2``.

    Second, the part of the image that is explained: ``1 - sum (x - b m)^2 / sum x^2``.
    """
    now, past = (np.clip(block_means(a), -MAX_BLOCK_MEAN, MAX_BLOCK_MEAN) for a in (x, mean))
    common, square, whole = (
        float(np.vdot(*pair)) for pair in ((now, past), (past, past), (now, now))
    )
    share = min(max(common / max(square, 1e-9), 0.0), 1.0)
    return share, share * (2.0 * common - share * square) / max(whole, 1e-9)


def power(z: Image, deviation: Image, median: float) -> float:
    """How far deviations predict the absolute values of an image: the slope of the logarithms.

    ``c = sum log|z| (v - mean v) / sum (v - mean v)^2``, with ``v = log(e + K s)``.
    """
    v = np.log(deviation[SAMPLED_CELLS] + np.float32(KAPPA * median))
    u = np.log(np.maximum(np.abs(z[SAMPLED_CELLS]), np.float32(KAPPA * median)))
    v -= v.mean()
    return float(np.clip(np.vdot(u, v) / (float(np.vdot(v, v)) + EVEN_VARIANCE * v.size), 0.0, 1.0))


def shaded(darker: Image, before: Image, now: Image, least: float) -> BoolArray:
    """Which cells (b, m) are of a large connected area that a shadow covers.

    Parameters
    ----------
    darker : (b, m) ndarray
        By how many mean deviations each cell has become darker.
    before, now : (b, m) ndarray
        Its values: now far below 0 in a shadow, before far above 0 where a bright thing has left.
    least : float
        Cells of an area, at least.
    """
    some = np.s_[:, ::SHADE_STEP]
    label = ndimage.label(darker[some] > SHADE)[0]
    large = np.bincount(label.ravel()) * SHADE_STEP >= least
    large[0] = False
    if large.any():
        level = np.minimum(before[some], MAX_BRIGHTNESS) + np.minimum(now[some], MAX_BRIGHTNESS)
        large &= np.bincount(label.ravel(), level.ravel()) < 0.0
    return np.repeat(large[label], SHADE_STEP, axis=1)[:, : darker.shape[1]]


class CellStates(NamedTuple):
    """What is known of each cell of a grid, one array each; changed in place.

    Attributes
    ----------
    mean, deviation : ndarray
        Of the values, and mean absolute one of the smoothed values.
    age : ndarray
        Images in which the cell was looked at, up to `MEMORY`.
    changed : ndarray
        Mean of the last values, in deviations.
    held : ndarray
        Times that the slowest target leaves the place, for which the cell is frozen.
    """

    mean: Image
    deviation: Image
    age: Image
    changed: Image
    held: Image


def freeze(
    states: CellStates, entered: BoolArray, left: BoolArray, step: int, part: float
) -> BoolArray:
    """Which cells are frozen: something has entered; what it has left, or held too long, learns."""
    _, _, age, changed, held = states
    frozen = entered & (age >= SETTLED_IMAGES / step) & (held < MAX_HELD_TIMES)
    held += np.float32(step * part)
    held *= entered
    again = left | (held >= MAX_HELD_TIMES)
    if again.any():
        age[again], changed[again] = 2.0, 0.0
    return frozen


class Background:
    """Learns the background of the cells from image to image, for one box of an echo.

    Parameters
    ----------
    grid : FixedGrid, optional
        Of a sensor that moves: cells are those of the fixed frame. Else cells are the image's.
    area : int
        Cells of an echo.

    Attributes
    ----------
    images : int
        Learned since the beginning, or since all was learned anew.
    age : float
        Times that the slowest target would have left its place in these images.
    share : float
        The regression of means, b.
    explained : float
        Part of the last images that the means explain.
    power : float
        That of deviations, c.
    """

    def __init__(self, grid: FixedGrid | None = None, area: int = 1) -> None:
        self._grid, self._area = grid, area
        self.images, self.age, self.share, self.explained = 0, 0.0, 0.0, 0.0
        self.power, self._median, self._origin = 0.0, 0.0, np.zeros(2, int)

    def expected(self, x: Image) -> Image:
        """What the past predicts of an image, ``b m``."""
        grid = self._grid
        if not self.images:
            shape = x.shape if grid is None else grid.shape
            self._state = CellStates(*(np.zeros(shape, np.float32) for _ in range(5)))
            self._scale = np.ones((1, 1), np.float32)
        elif grid is not None and (grid.origin != self._origin).any():
            spread = self._state.deviation
            self._state = CellStates(
                *(
                    grid.moved_along(state, self._origin, self._median * (state is spread))
                    for state in self._state
                )
            )
        if grid is not None:
            self._origin = grid.origin
        mean = self._at_cells(self._state.mean)
        self.share, explained = predicted(x, mean) if self.images >= FIRST_IMAGES else (0.0, 0.0)
        self.explained += (explained - self.explained) / min(self.images + 1, RECENT_IMAGES)
        return mean * np.float32(self.share)

    def displaced(self, x: Image, pose: FloatArray, before: FloatArray) -> FloatArray:
        """How far the poses (b, 3) of an image are from where it fits what is known of the grid."""
        if self._grid is None or self.images < FIRST_IMAGES:
            return np.zeros(3)
        mean = self._grid.moved_along(self._state.mean, self._origin, 0.0)
        return self._grid.displaced(mean, x, pose, before)

    def _at_cells(self, state: Image, some: Any = ...) -> Image:
        """A state at some cells of the image."""
        return state[some] if self._grid is None else self._grid.at_cells(state, some)

    def looks(self, some: Any = SAMPLED_CELLS) -> Image:
        """Images in which some cells were looked at: up to `MEMORY`."""
        return self._at_cells(self._state.age, some) * (
            1 if self._grid is None else self._grid.box[0].step
        )

    def scaled(self, z: Image) -> Image:
        """A smoothed image whose deviations are alike, as far as the past predicts them."""
        if self.images < FIRST_IMAGES or self._median < 1e-6:
            return z
        deviation = self._at_cells(self._state.deviation)
        now = power(z, deviation, self._median)
        self.power += (now - self.power) / min(self.images - FIRST_IMAGES + 1, RECENT_IMAGES)
        if self._grid is not None or self.images % SCALE_PERIOD == FIRST_IMAGES % SCALE_PERIOD:
            self._scale = (
                deviation * np.float32(1.0 / self._median) + np.float32(KAPPA)
            ) ** np.float32(-self.power)
        return np.asarray(z * self._scale)

    def learn(self, x: Image, z: Image, defined: BoolArray, part: float) -> None:
        """Learn an image and its smoothed values, which `scaled` was given.

        `part` is how much of its place the slowest target leaves from image to image.
        """
        step, state, x, z, defined = self._next_rows(x, z, defined)
        mean, deviation, age, changed, _ = state
        size, least = np.abs(z), np.float32(MIN_REACH_SHARE * self._median + 1e-6)
        far = z / np.maximum(deviation, least)
        counted = np.float32(REACH) / np.maximum(np.abs(far), np.float32(REACH))
        far *= counted * ((age >= FIRST_IMAGES) & defined)
        changed += (far - changed) * np.float32(step / RECENT_IMAGES)
        entered, left = self._changes(changed, mean, x, step)
        many = (
            self.share < 0.5
            and self.images > SETTLED_IMAGES
            and np.mean(entered | left) > MAX_CHANGED_SHARE
        )
        free = defined & ~freeze(state, entered, left, step, part)
        if self.images < FIRST_IMAGES:
            known = size[defined][::9]
            self._state.deviation[:] = np.median(known) if len(known) else 0.0
        else:
            deviation += (size * counted - deviation) * self._rate(age, step) * free
        np.copyto(counted, 1.0, where=age < FIRST_IMAGES)
        prior = np.float32(1.0 if self._grid is None else 2.0)
        mean += counted * free / (age + prior) * (x - mean)
        np.minimum(age + defined, np.float32(MEMORY / step), out=age)
        self._median = float(np.median(self._at_cells(self._state.deviation, SAMPLED_CELLS)))
        self.images, self.age = self.images + 1, self.age + part
        if many:
            self.images, self.age, self.share, self.power = 0, 0.0, 0.0, 0.0

    def _next_rows(
        self, x: Image, z: Image, defined: BoolArray
    ) -> tuple[int, CellStates, Image, Image, BoolArray]:
        """Of which rows in turn one learns, and of these: states, values, and what is defined."""
        if self._grid is not None:
            states = CellStates(*(state[self._grid.box] for state in self._state))
            return 1, states, *self._grid.sampled(x, z, defined)
        step = 1 if self.images <= WHOLE_IMAGES or len(x) == 1 else 2
        rows = slice(self.images % step, None, step)
        states = CellStates(*(state[rows] for state in self._state))
        return step, states, x[rows], z[rows], defined[rows]

    def _changes(
        self, changed: Image, mean: Image, x: Image, step: int
    ) -> tuple[BoolArray, BoolArray]:
        """Which cells a thing or its shadow has entered, and which it has left."""
        entered, left = changed > CHANGE, changed < -CHANGE
        if self._grid is None:  # shadows on the ground move with the sensor
            least = max(SHADE_ECHOES * self._area, SHADE_CELLS) / step
            covered = shaded(-changed, mean, x, least)
            entered |= covered
            left &= ~covered
        return entered, left

    def _rate(self, age: Image, step: int) -> Image:
        """How fast deviations are learned."""
        seen = np.full_like(age, self.images)
        if self._grid is not None:  # a thing on known ground does not widen its spread
            seen = np.where(age < PRIOR_IMAGES, np.maximum(age, FIRST_IMAGES), seen)
        return np.float32(step) / np.minimum(np.float32(PRIOR_IMAGES - FIRST_IMAGES) + seen, MEMORY)
