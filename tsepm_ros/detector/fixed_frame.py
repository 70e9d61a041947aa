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
"""A grid of the fixed frame around a sensor that moves, on which backgrounds are learned.

The cell of an image at range r and azimuth a lies at ``p + r (cos(yaw + a), sin(yaw + a))``, with
the pose of its bearing. A cell of the grid is as large as those of the image on the mean of their
area. The grid follows the sensor by whole cells, and forgets what leaves it.

Poses have errors. The displacement d and the turn t of an image x from the mean m of the grid are
those of least squares, over blocks of cells at places q, with the slope g of m::

    x(q) = b (m(q) + g . d + (g x (q - p)) t),    d, t ~ N(0, DISPLACEMENT_DEVIATION)
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.detector.cfar import over_boxes
from tsepm_ros.detector.range_profile import Image
from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray

TURN = 2.0 * math.pi
MARGIN = 0.25
"""Part of the largest range by which the grid reaches further."""
MAX_CELLS_SHARE, MAX_SIDE_CELLS = 16.0, 2000
"""Cells of the grid over those of the image, and of a side, at most."""
CORRECTIONS = 4
"""Times that the pose of a place's bearing is found anew in a sweep."""
BLOCK = 4
"""Cells, each way, of a block whose means are compared: their noise is lower."""
COMPARED_BLOCKS = 2500
"""Blocks that are compared, about."""
ITERATIONS = 3
"""Steps of Gauss and Newton to the displacement of an image."""
DISPLACEMENT_DEVIATION = 4.0
"""Standard deviation of a displacement before an image is seen, cells."""
MIN_RESIDUAL = 1e-12
"""Mean square that is left after a displacement, at least: an image may be empty."""
AXIS_PARTS = 8
"""Parts of the smallest spacing by which the nearest cell of an axis is looked up."""
MAX_AXIS_PARTS = 100_000
"""Of these, at most."""


def block_means(a: FloatArray | Image) -> FloatArray:
    """Means of blocks of cells (b, m)."""
    b, m = (min(BLOCK, n) for n in a.shape)
    rows = a[: len(a) // b * b, : a.shape[1] // m * m].reshape(len(a) // b, b, -1).sum(axis=1)
    return np.asarray(rows.reshape(len(rows), -1, m) @ np.full(m, 1.0 / (b * m), a.dtype))


def median(values: Image) -> float:
    """The median, in a fourth of the time of `np.median`."""
    middle = values.size // 2
    parts = np.partition(values.ravel(), middle)
    return float(parts[middle] + parts[: middle + values.size % 2].max()) / 2.0


def least_squares(
    residual: Callable[[FloatArray], tuple[FloatArray, FloatArray]],
    starts: Sequence[FloatArray],
    spread: FloatArray,
) -> FloatArray:
    """Unknowns (k,) of the least squares, from the best start by steps of Gauss and Newton.

    `residual` gives what is left of n values, (n,), and its slopes, (k, n); `spread` are the
    standard deviations of the unknowns before.
    """
    fits = [(*residual(start), start) for start in starts]
    rest, slopes, unknowns = min(fits, key=lambda fit: float(np.square(fit[0]).sum()))
    for left in reversed(range(ITERATIONS)):
        prior = max(float(np.mean(np.square(rest))), MIN_RESIDUAL) / np.square(spread)
        unknowns = unknowns + np.linalg.solve(
            slopes @ slopes.T + np.diag(prior), slopes @ rest - prior * unknowns
        )
        rest, slopes = residual(unknowns) if left else (rest, slopes)
    return unknowns


class ImageAxis:
    """Cells of an axis of an image, in any spacing: numbers of values, and values of numbers."""

    def __init__(self, centres: FloatArray) -> None:
        self._sign = -1.0 if centres[-1] < centres[0] else 1.0
        rising = self._sign * centres
        step = float(np.median(np.diff(rising))) if len(centres) > 1 else 1.0
        ends = rising[0] - step, rising[-1] + step
        self._values = np.concatenate([ends[:1], rising, ends[1:]])
        self._numbers = np.arange(-1.0, len(centres) + 1.0)
        parts = int(
            min(AXIS_PARTS * (ends[1] - ends[0]) / np.diff(self._values).min(), MAX_AXIS_PARTS)
        )
        self._start, self._scale = float(ends[0]), float((parts - 1) / (ends[1] - ends[0]))
        numbers = np.rint(np.interp(np.linspace(*ends, parts), self._values, self._numbers))
        self._nearest = np.where(numbers == len(centres), -1, numbers).astype(np.intp)

    def nearest(self, value: FloatArray | Image) -> IntArray:
        """Number of the nearest cell to each value; -1 beyond the ends."""
        number = np.rint(value * (self._sign * self._scale) - self._start * self._scale)
        return self._nearest.take(number.astype(np.intp), mode="clip")

    def numbers(self, value: FloatArray) -> FloatArray:
        """Fractional numbers of values; beyond the ends infinite."""
        numbers = np.interp(self._sign * value, self._values, self._numbers)
        return np.where((numbers <= -1.0) | (numbers >= self._numbers[-1]), np.inf, numbers)

    def values(self, number: FloatArray) -> FloatArray:
        """Values of fractional numbers."""
        return np.asarray(self._sign * np.interp(number, self._numbers, self._values))


class PosedCells:
    """Where the cells of images are in the fixed frame, by the poses of their bearings.

    They are the cells that a background is learned of, too, where the pose stays.

    Parameters
    ----------
    azimuth : (b,) ndarray
        rad.
    distance : (m,) ndarray
        m.

    Attributes
    ----------
    azimuth, distance : ndarray
        As given.
    axes : (ImageAxis, ImageAxis)
        Of both.
    pose : (b, 3) ndarray
        x, y, yaw at each bearing of the last image; of the first one where the pose stays.
    moves : bool
        Whether the cells of an image lie on others of the grid than those of the image before.
    shape : (int, int)
        Of the grid.
    origin : (2,) ndarray of int
        Numbers of its first cell in the fixed frame.
    """

    moves = False

    def __init__(self, azimuth: FloatArray, distance: FloatArray) -> None:
        self.azimuth, self.distance = azimuth, distance
        self.shape, self.origin = (len(azimuth), len(distance)), np.zeros(2, int)
        self.axes = ImageAxis(azimuth), ImageAxis(distance)
        self.pose = np.zeros((len(azimuth), 3))

    def at_cells(self, state: Image, some: Any = ...) -> Image:
        """Values of the grid at some cells of the image (b, m)."""
        return state[some]

    def sampled(
        self, step: int, turn: int, x: Image, z: Image, defined: BoolArray
    ) -> tuple[Any, Image, Image, BoolArray]:
        """Every `step`-th row of the grid, in turn, and images (b, m) in its cells."""
        rows = slice(turn % step, None, step)
        return rows, x[rows], z[rows], defined[rows]

    def places(self, cell: FloatArray) -> FloatArray:
        """Places (n, 2) in the fixed frame of fractional rows and columns of the image."""
        bearing, distance = (axis.values(cell[:, k]) for k, axis in enumerate(self.axes))
        row = np.clip(np.rint(cell[:, 0]), 0, len(self.pose) - 1).astype(int)
        at = self.pose[row]
        turned = at[:, 2] + bearing
        return at[:, :2] + distance[:, None] * np.stack([np.cos(turned), np.sin(turned)], axis=1)

    def cells(self, place: FloatArray) -> FloatArray:
        """Fractional rows and columns (n, 2) of places; infinite beyond the image."""
        polar = self.polar(place[:, 0], place[:, 1])
        return np.stack([axis.numbers(p) for axis, p in zip(self.axes, polar, strict=True)], 1)

    def polar(
        self, x: FloatArray, y: FloatArray, precision: type = float
    ) -> tuple[NDArray[Any], NDArray[Any]]:
        """Azimuth and range of places, from the poses of their bearings.

        Single `precision` is of places from the sensor, as those in the fixed frame may be large.
        """
        middle, home = float(self.azimuth[[0, -1]].mean()), self.pose[len(self.pose) // 2]
        pose = (self.pose - [*home[:2], TURN * np.rint(home[2] / TURN) - middle]).astype(precision)
        x, y = (x - home[0]).astype(precision), (y - home[1]).astype(precision)
        at = pose[len(pose) // 2]
        for left in range(CORRECTIONS if np.ptp(pose, axis=0).any() else 0, -1, -1):
            dx, dy = x - at[..., 0], y - at[..., 1]
            azimuth = np.arctan2(dy, dx) - at[..., 2]
            azimuth -= TURN * np.rint(azimuth / TURN) - middle
            if left:
                at = pose[np.maximum(self.axes[0].nearest(azimuth), 0)]
        return azimuth, np.sqrt(dx**2 + dy**2)  # a third of the time of `hypot`


class FixedGrid(PosedCells):
    """A grid of the fixed frame, on which the cells of the images of a moving sensor lie."""

    moves = True

    def __init__(self, azimuth: FloatArray, distance: FloatArray) -> None:
        super().__init__(azimuth, distance)
        reach, cells = float(distance[-1]), len(azimuth) * len(distance)
        area = 0.5 * float(np.ptp(azimuth)) * (reach**2 - float(distance[0]) ** 2)
        side = 2.0 * (1.0 + MARGIN) * reach
        self._cell = max(
            math.sqrt(area / cells),
            side / math.sqrt(MAX_CELLS_SHARE * cells),
            side / MAX_SIDE_CELLS,
        )
        n = math.ceil(side / self._cell) + 2
        self.shape, self.origin = (n, n), np.full(2, -n)  # far away: it comes with the first pose

    def displaced(self, mean: Image, x: Image, pose: FloatArray, before: FloatArray) -> FloatArray:
        """How far poses (b, 3) are from where an image fits the mean of the grid: x, y, yaw.

        The steps of Gauss and Newton begin with the displacement of the image before, or without.
        """
        few = math.ceil(math.sqrt(x.size / COMPARED_BLOCKS) / BLOCK)
        now = block_means(x)[::few, ::few].ravel()
        bearing = block_means((pose[:, 2] + self.azimuth)[:, None])[::few]
        arm_length = block_means(self.distance[None])[:, ::few] / self._cell
        corner = np.stack([block_means(pose[:, k, None])[::few] / self._cell for k in (0, 1)])
        low, part = self._around(mean, corner, bearing, float(arm_length[0, -1]))
        corner -= (self.origin + low)[:, None, None]
        level = over_boxes(np.add, part, (BLOCK + 1, BLOCK + 1), False).ravel()  # `share` scales it
        width, ends = part.shape[1], np.array(part.shape)[:, None, None] - 2.0

        def residual(moved: FloatArray) -> tuple[FloatArray, FloatArray]:
            turned = bearing + moved[2]
            arm = arm_length * np.stack([np.cos(turned), np.sin(turned)])
            place = corner + moved[:2, None, None] + arm
            there = ((place >= 0.0) & (place < ends)).all(axis=0)
            whole = np.clip(place, 0.0, ends).astype(np.intp)
            at, parts = whole[0] * width + whole[1], (place - whole).astype(np.float32)
            m, u, v = (_between_cells(level[k:], width, at, *parts) * there for k in (0, width, 1))
            slopes = np.stack([u - m, v - m, (v - m) * arm[0] - (u - m) * arm[1]])
            share = max(float(now @ m.ravel()) / max(float(np.vdot(m, m)), 1e-9), 1e-9)
            return now - share * m.ravel(), share * slopes.reshape(3, -1)

        # In cells; a turn moves the farthest by as much.
        units = np.array([self._cell, self._cell, 1.0])
        spread = DISPLACEMENT_DEVIATION / np.array([1.0, 1.0, arm_length[0, -1]])
        return least_squares(residual, [np.zeros(3), before / units], spread) * units

    def _around(
        self, mean: Image, corner: FloatArray, bearing: FloatArray, reach: float
    ) -> tuple[IntArray, Image]:
        """The first cell, (2,), and the part of the grid around an image, with a margin."""
        ends = corner + reach * np.stack([np.cos(bearing), np.sin(bearing)])
        ends = np.concatenate([corner, ends], axis=1) - self.origin[:, None, None]
        margin = 3.0 * DISPLACEMENT_DEVIATION + BLOCK
        low = np.clip(ends.min(axis=(1, 2)) - margin, 0.0, self.shape[0] - 3.0).astype(int)
        high = np.maximum(ends.max(axis=(1, 2)) + margin, low + 3.0).astype(int)
        return low, mean[low[0] : high[0], low[1] : high[1]]

    def look(self, pose: FloatArray) -> None:
        """Take the poses (b, 3) of an image."""
        self.pose, n = pose, self.shape[0]
        home = np.rint(pose[len(pose) // 2, :2] / self._cell).astype(int) - n // 2
        if np.abs(home - self.origin).max() * self._cell > 0.5 * MARGIN * self.distance[-1]:
            self.origin = home
        bearing, arm = pose[:, 2] + self.azimuth, (self.distance / self._cell).astype(np.float32)
        u, v = (
            np.clip(
                (pose[:, axis, None] / self._cell - self.origin[axis]).astype(np.float32)
                + np.outer(side(bearing).astype(np.float32), arm),
                0.0,
                n - 2.0,
            )
            for axis, side in enumerate((np.cos, np.sin))
        )
        i, j = np.floor(u), np.floor(v)
        # The number of the corner is exact in single precision: n^2 is below 2^24.
        self._corner, self._beyond_corner = (i * n + j).astype(np.intp), (u - i, v - j)
        self._ends = [(int(k.min()), int(k.max()) + 2) for k in (u, v)]

    def at_cells(self, state: Image, some: Any = ...) -> Image:
        """Values of the grid at some cells of the image (b, m): between four cells of the grid."""
        corner, p, q = (each[some] for each in (self._corner, *self._beyond_corner))
        return _between_cells(state.ravel(), self.shape[0], corner, p, q)

    def sampled(
        self, step: int, turn: int, x: Image, z: Image, defined: BoolArray
    ) -> tuple[Any, Image, Image, BoolArray]:
        """Every `step`-th row where the image is, in turn, and the nearest cells of images."""
        (first, last), columns = self._ends
        first += (first + int(self.origin[0]) + turn) % step  # rows of the ground
        box = slice(first, last, step), slice(*columns)
        along, across = (
            (np.arange(part.start, part.stop, part.step) + start) * self._cell
            for part, start in zip(box, self.origin, strict=True)
        )
        polar = self.polar(along[:, None], across, np.float32)
        row, column = (
            axis.nearest(of_axis) for axis, of_axis in zip(self.axes, polar, strict=True)
        )
        at, seen = row * x.shape[1] + column, (row >= 0) & (column >= 0)
        x, z, there = (each.ravel().take(at, mode="clip") for each in (x, z, defined))
        return box, x, z, there & seen


def shifted(state: Image, shift: IntArray, value: float = 0.0) -> Image:
    """A state of a grid of which the origin is shifted; a value where the grid is new."""
    if not shift.any():
        return state
    shift, n = np.clip(shift, -len(state), len(state)), len(state)
    there, here = (
        tuple(slice(max(sign * s, 0), n + min(sign * s, 0)) for s in shift.tolist())
        for sign in (1, -1)
    )
    moved = np.full_like(state, value)
    moved[here] = state[there]
    return moved


def _between_cells(flat: Image, width: int, corner: IntArray, p: Image, q: Image) -> Image:
    """Values at parts p and q of a cell beyond corners, of which a row further is a width away."""
    near, near_end, far, far_end = (
        flat[offset:].take(corner, mode="clip") for offset in (0, 1, width, width + 1)
    )
    near, far = near + q * (near_end - near), far + q * (far_end - far)
    return near + p * (far - near)
