"""Images in deviations above their background, and smoothed over the extent of an echo.

*Conditioned*: an amplitude is standardised by mean and deviation of all bearings at its range (gain
over range, reverberation, the ring of the transmission), then of all ranges at its bearing (a
streak: the pulse of another sonar)::

    x = max((a - mean) / deviation, -LIMIT),    of  a  within  mean +- LIMIT * deviation

so that the holes of a range that is saturated, or of a logarithm, have a bounded part.

*Normalised*: the same with the ring of cells around each, between a guard that its own echo may
fill and an outer box; sums over boxes cost the same for every size. Amplitudes above the limit
count as the limit, so that other echoes and walls have a bounded part. Location and scale do the
same to amplitudes, powers and logarithms: the unit need not be known.
"""

from __future__ import annotations

import functools
import math
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from tsepm_ros.numerics.arrays import BoolArray

Image = NDArray[np.float32]
"""(b, m): single precision is twice as fast, and finer than any sonar's."""

Box = tuple[int, int]
"""Cells of an echo: bearings and ranges."""

Mode = Literal["wrap", "constant"]
Modes = tuple[Mode, Mode]
"""Of filters at the ends of the axes."""

LIMIT = 2.5
"""Deviations from the mean beyond which an amplitude counts as the limit."""
PASSES = 2
"""Times that mean and deviation are taken, each within the limit by those before; once more for
ranges and bearings, of which an echo may fill a tenth."""
MEAN_DEVIATION = 1.25
"""Standard deviation of a normal law over its mean absolute one, which an echo moves less."""
MIN_CELLS = 24
"""Cells without which a range, or a bearing, has no statistics of its own."""
BLOCK = 4
"""Ranges of a block of a ring."""
MIN_RING = (25, 15)
"""Least size of the outer box, bearings and blocks: some hundred independent cells."""
MIN_DEVIATION = 0.1
"""Least deviation of a ring: where hardly a cell has an echo."""
CELL_LIMIT = (2.0, 30.0)
"""Most deviations that one cell brings into a sum over n: the first, plus the second / n."""
TIE = 1e-3
"""Height by which equal cells differ, so that levels of few bits have one highest cell."""


def conditioned(amplitude: Image, measured: BoolArray) -> tuple[Image, BoolArray]:
    """Amplitudes in deviations of their range and bearing, and where these are defined.

    Parameters
    ----------
    amplitude : (b, m) ndarray
        0 where not measured.
    measured : (b, m) ndarray of bool

    Returns
    -------
    standardised : (b, m) ndarray
        0 where it is not defined.
    defined : (b, m) ndarray of bool
        Not defined: what was not measured, and ranges and bearings of one value, such as those
        that the transmission saturates.
    """
    for axis in (0, 1):
        if amplitude.shape[axis] < MIN_CELLS:
            continue
        there = measured.astype(np.float32)
        count = np.maximum(there.sum(axis, keepdims=True), 1)
        limited = amplitude
        for _ in range(PASSES + 1):
            mean = limited.sum(axis, keepdims=True) / count
            apart = np.abs(limited - mean) * there
            deviation = MEAN_DEVIATION * apart.sum(axis, keepdims=True) / count
            reach = LIMIT * deviation
            limited = np.clip(amplitude, mean - reach, mean + reach) * there
        measured = measured & (deviation > 1e-6)
        scale = np.where(deviation > 0.0, deviation, 1.0)
        least = np.maximum((amplitude - mean) / scale, -LIMIT)
        amplitude = np.asarray(least * measured, np.float32)
    return amplitude, measured


def normalised(x: Image, defined: BoolArray, box: Box, modes: Modes) -> tuple[Image, Image]:
    """Values (b, m) in deviations above the mean of the ring around each, and that mean."""
    cells, limited = _ring_cells(defined.tobytes(), defined.shape, box, modes), x
    there = defined.astype(np.float32)
    for _ in range(PASSES):
        mean = _ring(limited, box, modes) / cells
        variance = _ring(limited * limited, box, modes) / cells - mean * mean
        deviation = np.sqrt(np.maximum(variance, MIN_DEVIATION**2))
        limited = np.minimum(x, _by_cell(mean + LIMIT * deviation, x)) * there
    mean = _by_cell(mean, x)
    return np.asarray((x - mean) / _by_cell(deviation, x) * there, np.float32), mean


def _by_cell(blocks: Image, x: Image) -> Image:
    """Values of blocks at each cell of an image."""
    return np.asarray(np.repeat(blocks, BLOCK, axis=1)[:, : x.shape[1]])


def _ring(values: Image, box: Box, modes: Modes) -> Image:
    """Sums over the ring around each block of `BLOCK` ranges: a third of the time of cells."""
    b, m = values.shape
    lengths = box[0], math.ceil(box[1] / BLOCK)
    guard = [2 * length + 1 for length in lengths]
    outer = [max(least, 6 * n + 1) for least, n in zip(MIN_RING, lengths, strict=True)]
    padded = np.pad(values, ((0, 0), (0, -m % BLOCK)))
    blocks = padded.reshape(b, -1, BLOCK) @ np.ones(BLOCK, np.float32)
    sums = [
        ndimage.uniform_filter(blocks, size, mode=modes) * np.float32(math.prod(size))
        for size in (outer, guard)
    ]
    return np.asarray(sums[0] - sums[1])


@functools.lru_cache(maxsize=4)
def _ring_cells(defined: bytes, shape: tuple[int, int], box: Box, modes: Modes) -> Image:
    """Number of cells of the ring around each block: mostly the same as of the image before."""
    ones = np.frombuffer(defined, bool).reshape(shape)
    return np.asarray(np.maximum(_ring(ones.astype(np.float32), box, modes), 1.0))


def cell_limit(box: Box) -> float:
    """The most deviations of a cell that count in a sum over a box."""
    return CELL_LIMIT[0] + CELL_LIMIT[1] / math.prod(box)


def smoothed(y: Image, box: Box, modes: Modes) -> Image:
    """Mean over the box of an echo; a single cell has a bounded part in that of many."""
    z = ndimage.uniform_filter(np.minimum(y, cell_limit(box)), box, mode=modes)
    return np.asarray(z + _ties(z.shape))


@functools.lru_cache(maxsize=4)
def _ties(shape: tuple[int, ...]) -> Image:
    return np.random.default_rng(0).random(shape, np.float32) * np.float32(TIE)


class ClutterMap:
    """Mean of each cell over the pings, subtracted: it learns whatever stands.

    Parameters
    ----------
    pings : int
        Memory; 0: nothing is subtracted.
    """

    def __init__(self, pings: int) -> None:
        self._pings, self._seen = pings, 0
        self._mean: Image = np.zeros((0, 0), np.float32)

    def subtracted(self, x: Image, defined: BoolArray) -> Image:
        """Values (b, m) without the mean of the pings before; themselves for the first."""
        if not self._pings or x.shape != self._mean.shape:
            self._seen, self._mean = 1, x
            return x
        self._seen = min(self._seen + 1, self._pings)
        apart = np.asarray((x - self._mean) * defined, np.float32)
        self._mean = self._mean + apart / np.float32(self._seen)
        return apart
