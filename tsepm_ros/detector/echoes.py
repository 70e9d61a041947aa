"""Peaks of the smoothed image, and what is measured of their echoes.

A peak is the highest cell within the box of an echo around it. The position is the centroid of the
amplitudes ``w`` above half of the largest in a window of twice the box, which is centred on it. Its
variance is that of a centroid of independent cells (speckle), and that of the reflecting part, as
it may lie anywhere in the width of the echo::

    x = sum(w x) / sum(w),    var x = sum(w^2 (x - mean)^2) / sum(w)^2 + width^2 / 12

with the equivalent width ``sum(w) / max(w)`` of the amplitudes summed over the other axis.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tsepm_ros.detector.false_detections import Peaks
from tsepm_ros.detector.normalising import TIE, Box, Image, Modes, cell_limit
from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray

PART = 0.5
"""Part of the largest amplitude of a window below which a cell is background."""
CENTRINGS = 3
"""Times that the window is centred on the centroid."""


class Echoes(NamedTuple):
    """Echoes of n detections, in cells.

    Attributes
    ----------
    cell, deviation, width : (n, 2) ndarray
        Bearing and range, their standard deviations, and the extent.
    excess : (n,) ndarray
        Mean amplitude over the box, in deviations above the mean of the background.
    """

    cell: FloatArray
    deviation: FloatArray
    width: FloatArray
    excess: FloatArray


def found(
    z: Image, defined: BoolArray, box: Box, modes: Modes, most: int
) -> tuple[Peaks, IntArray]:
    """The highest peaks above the background of an image (b, m), and their cells (n, 2)."""
    flat = np.flatnonzero((z == _highest(z, box, modes)) & (z > TIE) & defined)
    height = z.ravel()[flat].astype(float)
    lower, median, upper = np.quantile(height, [0.25, 0.5, 0.75]) if len(flat) else np.zeros(3)
    # Standard error of a median of normal values: 1.25 sigma / sqrt(n), sigma = 0.74 (q3 - q1).
    error = 0.93 * (upper - lower) / np.sqrt(max(len(flat), 1))
    order = np.argsort(-height)[:most]
    cell = np.stack(np.unravel_index(flat[order], z.shape), axis=1)
    gate = np.array(box) + 1.0
    area = z.size / float(gate.prod())
    peaks = Peaks(height[order], cell / gate, area, float(median), float(error), len(flat))
    return peaks, cell


def _highest(z: Image, box: Box, modes: Modes) -> Image:
    """Highest of the cells up to a box around each (b, m): of runs that double in length."""
    for axis, length in enumerate(box):
        ends = [(0, 0), (0, 0)]
        ends[axis] = length, length
        run = np.moveaxis(np.pad(z, ends, modes[axis]), axis, 0)
        size = 1
        while 2 * size <= 2 * length + 1:
            run = np.maximum(run[:-size], run[size:])
            size *= 2
        rest = 2 * length + 1 - size
        z = np.moveaxis(np.maximum(run[: len(run) - rest], run[rest:]), 0, axis)
    return z


def measured(y: Image, cell: IntArray, box: Box, wraps: bool) -> Echoes:
    """Measure the echoes at peaks (n, 2) of the normalised image.

    Parameters
    ----------
    y : (b, m) ndarray
    cell : (n, 2) ndarray of int
    box : (int, int)
        Of an echo, in cells.
    wraps : bool
        Whether the last bearing is the neighbour of the first.
    """
    steps = [np.arange(-length, length + 1) for length in box]
    for _ in range(CENTRINGS):
        row, column = (cell[:, axis : axis + 1] + steps[axis] for axis in (0, 1))
        row = row % len(y) if wraps else np.clip(row, 0, len(y) - 1)
        column = np.clip(column, 0, y.shape[1] - 1)
        window = y[row[:, :, None], column[:, None, :]].astype(float)
        weight = np.minimum(window, cell_limit(box))
        weight = np.maximum(weight - PART * weight.max(axis=(1, 2), keepdims=True), 0.0)
        total = np.maximum(weight.sum(axis=(1, 2)), 1e-12)[:, None]
        along = weight.sum(axis=2), weight.sum(axis=1)
        offset = np.stack([w @ step for w, step in zip(along, steps, strict=True)], axis=1) / total
        start, cell = cell, cell + np.rint(offset).astype(int)
    width = total / np.maximum(np.stack([w.max(axis=1) for w in along], axis=1), 1e-12)
    apart = [(steps[axis] - offset[:, axis : axis + 1]) ** 2 for axis in (0, 1)]
    squares = (weight**2).sum(axis=2), (weight**2).sum(axis=1)
    speckle = np.stack([(s * d).sum(1) for s, d in zip(squares, apart, strict=True)], axis=1)
    deviation = np.sqrt(speckle / total**2 + width**2 / 12.0)
    rows, columns = (
        slice(length - (length - 1) // 2, length + (length + 1) // 2) for length in box
    )
    excess = np.maximum(window[:, rows, columns].mean(axis=(1, 2)), 0.0)
    return Echoes(start + offset, deviation, width, excess)
