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

from tsepm_ros.detector.fixed_frame import FixedGrid, PosedCells, block_means, median, shifted
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
SHADOW_HELD = np.float32(0.5)
"""What a cell of a shadow has below its mean, so that one dark image more or less ends none."""
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


def power(z: Image, deviation: Image, middle: float) -> float:
    """How far deviations predict the absolute values of an image: the slope of the logarithms.

    ``c = sum log|z| (v - mean v) / sum (v - mean v)^2``, with ``v = log(e + K s)``.
    """
    v = np.log(deviation[SAMPLED_CELLS] + np.float32(KAPPA * middle))
    u = np.log(np.maximum(np.abs(z[SAMPLED_CELLS]), np.float32(KAPPA * middle)))
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
    grid : PosedCells
        Of which cells: the image's, or those of the fixed frame where the sensor moves.
    area : int, optional
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
    shadow : ndarray of bool
        Cells (b, m) of the image that a shadow has entered; False where the sensor moves.
    """

    def __init__(self, grid: PosedCells, area: int = 1) -> None:
        self._grid, self._step = grid, 1
        self._shade = max(SHADE_ECHOES * area, SHADE_CELLS)
        self.images, self.age, self.share, self.explained = 0, 0.0, 0.0, 0.0
        self.power, self._median, self._origin = 0.0, 0.0, grid.origin

    def expected(self, x: Image) -> Image:
        """What the past predicts of an image, ``b m``."""
        shift = self._grid.origin - self._origin
        if not self.images:
            self._states = CellStates(*np.zeros((5, *self._grid.shape), np.float32))
            self._scale = np.ones((1, 1), np.float32)
        elif shift.any():
            new = 0.0, self._median, 0.0, 0.0, 0.0
            pairs = zip(self._states, new, strict=True)
            self._states = CellStates(*(shifted(state, shift, value) for state, value in pairs))
        self._origin, states = self._grid.origin, self._states
        self.shadow = np.asarray(
            not self._grid.moves and (states.held > 0.0) & (states.changed < 0.0)
        )
        mean = self._grid.at_cells(self._states.mean)
        self.share, explained = predicted(x, mean) if self.images >= FIRST_IMAGES else (0.0, 0.0)
        self.explained += (explained - self.explained) / min(self.images + 1, RECENT_IMAGES)
        return mean * np.float32(self.share)

    def displaced(self, x: Image, pose: FloatArray, before: FloatArray) -> FloatArray:
        """How far the poses (b, 3) of an image are from where it fits what is known of the grid."""
        grid = self._grid
        if self.images < FIRST_IMAGES or not isinstance(grid, FixedGrid):
            return np.zeros(3)
        return grid.displaced(
            shifted(self._states.mean, grid.origin - self._origin), x, pose, before
        )

    def looks(self, some: tuple[Any, ...]) -> tuple[Image, float]:
        """Images in which some cells (n,) were looked at, and the part of the image that is new.

        They count up to `MEMORY`. A sonar at rest looks at all cells in each image.
        """
        if not self._grid.moves:
            return np.full(len(some[0]), np.float32(MEMORY)), 0.0
        age, of_image = (self._grid.at_cells(self._states.age, at) for at in (some, SAMPLED_CELLS))
        return age * self._step, float(np.mean(of_image * self._step < PRIOR_IMAGES))

    def scaled(self, z: Image) -> Image:
        """A smoothed image whose deviations are alike, as far as the past predicts them."""
        if self.images < FIRST_IMAGES or self._median < 1e-6:
            return z
        deviation = self._grid.at_cells(self._states.deviation)
        now = power(z, deviation, self._median)
        self.power += (now - self.power) / min(self.images - FIRST_IMAGES + 1, RECENT_IMAGES)
        if self._grid.moves or self.images % SCALE_PERIOD == FIRST_IMAGES % SCALE_PERIOD:
            self._scale = (
                deviation * np.float32(1.0 / self._median) + np.float32(KAPPA)
            ) ** np.float32(-self.power)
        return np.asarray(z * self._scale)

    def learn(self, x: Image, z: Image, defined: BoolArray, part: float) -> None:
        """Learn an image and its smoothed values, which `scaled` was given.

        `part` is how much of its place the slowest target leaves from image to image.
        """
        moves, images = self._grid.moves, np.float32(self.images)
        self._step = step = 1 if self.images <= WHOLE_IMAGES or len(x) == 1 else 2
        some, x, z, defined = self._grid.sampled(step, self.images, x, z, defined)
        states = mean, deviation, age, changed, held = CellStates(*(a[some] for a in self._states))
        size, least = np.abs(z), np.float32(MIN_REACH_SHARE * self._median + 1e-6)
        far = z / np.maximum(deviation, least)
        counted = np.float32(REACH) / np.maximum(np.abs(far), np.float32(REACH))
        far *= counted * ((age >= FIRST_IMAGES) & defined)
        changed += (far - changed) * np.float32(step / RECENT_IMAGES)
        # Shadows on the ground move with the sensor; a thing on known ground widens no spread.
        covered = (
            np.False_
            if moves
            else shaded(
                -changed, np.where(held > 0.0, mean - SHADOW_HELD, mean), x, self._shade / step
            )
        )
        entered, left = (changed > CHANGE) | covered, (changed < -CHANGE) & ~covered
        many = (
            self.share < 0.5
            and self.images > SETTLED_IMAGES
            and np.mean(entered | left) > MAX_CHANGED_SHARE
        )
        free = defined & ~freeze(states, entered, left, step, part)
        if self.images < FIRST_IMAGES:
            self._states.deviation[:] = np.median(size[defined][::9]) if defined.any() else 0.0
        else:
            seen = (
                np.where(age < PRIOR_IMAGES, np.maximum(age, FIRST_IMAGES), images)
                if moves
                else images
            )
            rate = np.float32(step) / np.minimum(PRIOR_IMAGES - FIRST_IMAGES + seen, MEMORY)
            deviation += (size * counted - deviation) * rate * free
        np.copyto(counted, 1.0, where=age < FIRST_IMAGES)
        mean += counted * free / (age + np.float32(1 + moves)) * (x - mean)
        np.minimum(age + defined, np.float32(MEMORY / step), out=age)
        self._median = median(self._grid.at_cells(self._states.deviation, SAMPLED_CELLS))
        self.images, self.age = self.images + 1, self.age + part
        if many:
            self.images, self.age, self.share, self.power = 0, 0.0, 0.0, 0.0
