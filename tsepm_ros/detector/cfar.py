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
"""Detection at a constant false-alarm rate (CFAR): background, threshold, and what echoes measure.

Images are in deviations above their background, and smoothed over the extent of an echo.

*Normalised*: a cell is standardised by mean and deviation of the ring of cells around it, between a
guard that its own echo may fill and an outer box; sums over boxes cost the same for every size::

    x = (a - mean) / deviation,    of  a  up to  mean + LIMIT * deviation

so that other echoes and walls have a bounded part. Location and scale do the same to amplitudes,
powers and logarithms: the unit need not be known.

*Measured*: a peak is the highest cell within the box of an echo around it. The position is the
centroid of the amplitudes ``w`` above half of the largest in a window of twice the box, which is
centred on it. Its variance is that of a centroid of independent cells (speckle), and that of the
reflecting part, as it may lie anywhere in the width of the echo::

    x = sum(w x) / sum(w),    var x = sum(w^2 (x - mean)^2) / sum(w)^2 + width^2 / 12

with the equivalent width ``sum(w) / max(w)`` of the amplitudes summed over the other axis.

*Thresholded*: a stated number of false detections is kept. No law of the clutter is assumed. The
heights of the peaks of the last pings are pooled, and the threshold is the height above which the
stated number a ping lies::

    sum of w over the pooled peaks above the threshold  =  number * pings

A peak of clutter has the weight 1 in expectation, a moving target's 0: a target was near in the
last pings, but not long before, where clutter was as often. With ``r`` whether a detection of the
last pings lies within a gate of the peak, and ``c`` in which share of older pings one does::

    w = 1 - (r - c) / (1 - mean c);    0 where echoes come in more than half of the pings

so that places crowded with clutter are not taken for targets. Pings whose median peak differs from
the current one's beyond chance have another statistic (a step of the gain) and are left out.
"""

from __future__ import annotations

import functools
import math
from collections import deque
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from scipy import ndimage
from scipy.spatial import KDTree

from tsepm_ros.detector.range_profile import LIMIT, Image
from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray

Box = tuple[int, int]
"""Cells of an echo: bearings and ranges."""

STRIP = 40_000
"""Cells of a strip of an image."""
PASSES = 2
"""Times that mean and deviation of a ring are taken, each within the limit by those before."""
BLOCK = 4
"""Ranges of a block of a ring."""
MIN_RING = (25, 15)
"""Least size of the outer box, bearings and blocks: some hundred independent cells."""
SHADOW_WEIGHT = np.float32(0.02)
"""Of a cell in a shadow that has entered: where there is no other, it counts."""
MIN_DEVIATION = 0.1
"""Least deviation of a ring: where hardly a cell has an echo."""
CELL_LIMIT = (2.0, 30.0)
"""Most deviations that one cell brings into a sum over n: the first, plus the second / n."""
TIE = 1e-3
"""Height by which equal cells differ, so that levels of few bits have one highest cell."""
PEAKS = 400
"""Peaks that a pool should hold above the threshold."""
PINGS = (10, 40)
"""Least and most pings of a pool."""
RECENT_PINGS = 3
"""Pings in one of which a target comes again."""
EARLIER_OVER_RECENT = 4
"""Times as many pings before which clutter was as often, and a moving target elsewhere."""
RECURRENCE = (10, 24)
"""Least and most pings in which echoes of one place are counted."""
MAX_RECURRENCE = 0.5
"""Share of the pings with an echo in one place above which it is no false detection."""
MIN_LOOKS = 5
"""Least images by which it is told whether an echo stands."""
KEPT_LOOKS = 12
"""Images of a span of time as long ago as it lasts, about, that are kept for this."""
LINE_LIMITS = 2.0, 3
"""Level, in median peaks, and boxes along bearing, of what is one continuous thing."""
STRUCTURE_SHARE = 0.5
"""Part of what stands beside an echo below which the echo is of it."""
MEDIAN_TOLERANCE = 4.0, 0.01
"""Standard errors, and part of the median, by which medians of like pings may differ."""
MAX_CHANCE = 0.8
"""Largest chance that is corrected for."""
GATE_CHANCE = 0.1
"""Chance of coming again for which gates are widened."""
MAX_GATE = 2.5
"""Largest gate, in those of an echo at rest: its speed is unknown."""
MAX_TARGETS = 8.0
"""Peaks a ping that may count as moving targets; more where more detections are wanted."""
BACKGROUND_SHARE = 0.5
"""Part of the largest amplitude of a window below which a cell is background."""
CENTRINGS = 3
"""Times that the window is centred on the centroid."""


def normalised(
    x: Image, defined: BoolArray, shadow: BoolArray, box: Box, wraps: bool
) -> tuple[Image, Image]:
    """Values (b, m) in deviations above the mean of the ring around each, and that mean.

    A shadow that has entered darkens no ring: what lies beside it would look bright.
    """
    packed = (np.packbits(some).tobytes() for some in (defined, shadow))
    weight, cells = _ring_weights(*packed, x.shape, box, wraps)
    limited = x
    for left in reversed(range(PASSES)):
        weighted = limited * weight
        mean = _ring(weighted, box, wraps) / cells
        variance = _ring(weighted * limited, box, wraps) / cells - mean * mean
        deviation = np.sqrt(np.maximum(variance, MIN_DEVIATION**2))
        if left:
            limited = np.minimum(x, _by_cell(mean + LIMIT * deviation, x))
    mean = _by_cell(mean, x)
    y = x - mean
    y /= _by_cell(deviation, x)
    return y * defined, mean


def _by_cell(blocks: Image, x: Image) -> Image:
    """Values of blocks at each cell of an image."""
    return np.stack([blocks] * BLOCK, axis=-1).reshape(len(x), -1)[:, : x.shape[1]]


def _ring(values: Image, box: Box, wraps: bool) -> Image:
    """Sums over the ring around each block of `BLOCK` ranges: a third of the time of cells."""
    b, m = values.shape
    lengths = box[0], math.ceil(box[1] / BLOCK)
    guard = [2 * length + 1 for length in lengths]
    outer = [max(least, 6 * n + 1) for least, n in zip(MIN_RING, lengths, strict=True)]
    padded = np.pad(values, ((0, 0), (0, -m % BLOCK))) if m % BLOCK else values
    blocks = padded.reshape(b, -1, BLOCK) @ np.ones(BLOCK, np.float32)
    sums = (over_boxes(np.add, blocks, size, wraps) for size in (outer, guard))
    return np.subtract(*sums)


@functools.lru_cache(maxsize=4)
def _ring_weights(
    defined: bytes, shadow: bytes, shape: tuple[int, int], box: Box, wraps: bool
) -> tuple[Image, Image]:
    """Weights of the cells, and of the ring around each block: mostly those of the image before."""
    there, dark = (
        np.unpackbits(np.frombuffer(bits, np.uint8), count=math.prod(shape)).reshape(shape)
        for bits in (defined, shadow)
    )
    weight = np.where(dark, SHADOW_WEIGHT, np.float32(1.0)) * there.astype(np.float32)
    return weight, np.asarray(np.maximum(_ring(weight, box, wraps), SHADOW_WEIGHT))


def cell_limit(box: Box) -> float:
    """The most deviations of a cell that count in a sum over a box."""
    return CELL_LIMIT[0] + CELL_LIMIT[1] / math.prod(box)


def smoothed(y: Image, box: Box, wraps: bool) -> Image:
    """Mean over the box of an echo; a single cell has a bounded part in that of many."""
    sums = over_boxes(np.add, np.minimum(y, cell_limit(box)), box, wraps)
    return np.asarray(sums / np.float32(math.prod(box)) + _ties(y.shape))


@functools.lru_cache(maxsize=4)
def _ties(shape: tuple[int, ...]) -> Image:
    return np.random.default_rng(0).random(shape, np.float32) * np.float32(TIE)


class Peaks(NamedTuple):
    """Peaks of a ping, highest first.

    Attributes
    ----------
    height : (n,) ndarray
    place : (n, 2) ndarray
        In gates: an echo at rest stays within 1 from ping to ping.
    area : float
        Of the image, in squares of a gate's half width.
    median, error : float
        Median height of all peaks of the ping, and its standard error.
    number : int
        Of all peaks.
    """

    height: FloatArray
    place: FloatArray
    area: float
    median: float
    error: float
    number: int


class CfarThreshold:
    """Learns the threshold from ping to ping.

    Parameters
    ----------
    number : float
        Wanted false detections a ping.

    Attributes
    ----------
    left_out : int
        Pings of the pool that are left out, since they have another statistic than the last one.
    evidence : (n,) ndarray
        Of the last ping's peaks: whether those above the threshold came again, less the chance, or
        stand; 0 below.
    cells : int
        Peaks of the last ping, the most detections that there could be.
    """

    def __init__(self, number: float) -> None:
        self._number = number
        pings = int(np.clip(math.ceil(PEAKS / number), *PINGS))
        self._pool: deque[tuple[Peaks, FloatArray, FloatArray]] = deque(maxlen=pings)
        # Places of detections, in gates, the number of the ping of each, and times of pings.
        self._places, self._pings, self._times = np.zeros((0, 2)), np.zeros(0, int), np.zeros(0)
        self.kept = int(8 * number + 100)
        self.evidence, self.cells, self.left_out = np.zeros(0), 0, 0

    def forget(self) -> None:
        """Clear the pool: peaks have another statistic from now on."""
        self._pool.clear()

    def follow(self, moved: Callable[[FloatArray], FloatArray]) -> None:
        """Place the detections so far where they lie in the next image; infinite: beyond it."""
        places = moved(self._places)
        seen = np.isfinite(places).all(axis=1)
        self._places, self._pings = places[seen], self._pings[seen]

    def update(
        self,
        peaks: Peaks,
        time: float,
        leaves: FloatArray,
        aside: BoolArray | None = None,
        repeated: bool = False,
    ) -> tuple[float, FloatArray]:
        """The threshold for a ping, learned with it, and how far each peak stands, (n,).

        Parameters
        ----------
        peaks : Peaks
        time : float
            Of the ping, s.
        leaves : (n,) ndarray
            Time in which the slowest target leaves the place of each peak, s.
        aside : (n,) ndarray of bool, optional
            Which peaks do not set the threshold.
        repeated : bool, optional
            Whether those that were in the ping before do not, either: in the first pings, they are
            more likely structure than false detections.
        """
        standing, recurs, again, repeats = self._again(peaks, time, leaves)
        fixed = recurs | (repeats & repeated) | (False if aside is None else aside)
        self._pool.append((peaks, np.where(fixed, 0.0, 1.0), np.where(fixed, 0.0, again)))
        like = [
            entry
            for entry in self._pool
            if abs(entry[0].median - peaks.median)
            <= MEDIAN_TOLERANCE[0] * math.hypot(entry[0].error, peaks.error)
            + MEDIAN_TOLERANCE[1] * peaks.median
        ]
        height = np.concatenate([entry[0].height for entry in like])
        order = np.argsort(-height, kind="stable")
        there, moving = (
            np.cumsum(np.concatenate([entry[column] for entry in like])[order]) / len(like)
            for column in (1, 2)
        )
        false = there - np.clip(moving, 0.0, max(MAX_TARGETS, self._number))
        beyond = np.flatnonzero(false > self._number)
        last = int(beyond[0]) if len(beyond) else len(height)
        level = float(height[order[last]]) if len(beyond) else 0.0
        self.left_out = len(self._pool) - len(like)
        detected = peaks.height > level
        self.evidence = np.where(detected, again + recurs, 0.0)
        self.cells = peaks.number
        self._keep(time, peaks.place[detected], 2.0 * float(leaves.max(initial=0.0)))
        return level, standing

    def _keep(self, time: float, place: FloatArray, window: float) -> None:
        """Keep the detections of a ping: of those long ago fewer, and none beyond the window."""
        self._places = np.concatenate([self._places, place])
        self._pings = np.append(self._pings, np.full(len(place), len(self._times)))
        self._times = times = np.append(self._times, time)
        crowded = KEPT_LOOKS * (times[2:] - times[:-2]) < time - times[1:-1]
        old = len(times) > RECURRENCE[1] and time - times[1] > window
        for ping in [0] if old else np.flatnonzero(crowded)[:1] + 1:
            self._times, kept = np.delete(times, ping), self._pings != ping
            self._places, self._pings = self._places[kept], self._pings[kept]
            self._pings -= self._pings > ping

    def _again(
        self, peaks: Peaks, time: float, leaves: FloatArray
    ) -> tuple[FloatArray, BoolArray, FloatArray, BoolArray]:
        """How far each peak stands, if it recurs, its evidence as a target, and if it repeats."""
        n, pings = len(peaks.height), len(self._times)
        if not n or not pings:
            return np.full(n, np.nan), np.zeros(n, bool), np.zeros(n), np.zeros(n, bool)
        squares = 4.0 * RECENT_PINGS * max(self._number, 1.0)
        gate = float(np.clip(math.sqrt(GATE_CHANCE * peaks.area / squares), 1.0, MAX_GATE))
        apart = _distance(self._places, self._pings, pings, peaks.place, gate)
        age = np.append(time - self._times, 0.0)
        window = np.maximum(2.0 * leaves, age[-MIN_LOOKS - 1] if pings >= MIN_LOOKS else np.inf)
        lasts = -np.diff(np.minimum(age[:, None], window), axis=0)
        standing = np.sum((apart < 1.0) * lasts, axis=0) / window
        standing[age[0] < 0.5 * window] = np.nan
        apart = apart[-RECURRENCE[1] :]
        pings = len(apart)
        recurs = np.sum(apart < 1.0, axis=0) > MAX_RECURRENCE * max(pings, RECURRENCE[0])
        recent = (apart < gate)[-RECENT_PINGS:].any(axis=0)
        before = (apart < gate)[: -EARLIER_OVER_RECENT * RECENT_PINGS]
        groups = len(before) // RECENT_PINGS
        if groups:
            grouped = before[: groups * RECENT_PINGS].reshape(groups, RECENT_PINGS, n)
            chance = grouped.any(axis=1).mean(axis=0)
        else:  # provisional: as if detections were spread evenly
            chance = np.full(n, -math.expm1(-squares * gate**2 / peaks.area))
        if pings == (EARLIER_OVER_RECENT + 1) * RECENT_PINGS:
            self.forget()
        again = (recent - chance) / (1.0 - min(float(chance.mean()), MAX_CHANCE))
        return standing, recurs, again, apart[-1] < 1.0


def _distance(
    detected: FloatArray, ping: IntArray, pings: int, place: FloatArray, gate: float
) -> FloatArray:
    """Distance of each place (n, 2) to the nearest of each ping's; infinite beyond, (pings, n)."""
    near = KDTree(detected, balanced_tree=False, compact_nodes=False).sparse_distance_matrix(
        KDTree(place), gate, p=np.inf, output_type="ndarray"
    )
    apart = np.full((pings, len(place)), np.inf)
    np.minimum.at(apart, (ping[near["i"]], near["j"]), near["v"])
    return apart


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


def peaks(z: Image, defined: BoolArray, box: Box, wraps: bool, most: int) -> tuple[Peaks, IntArray]:
    """The highest peaks above the background of an image (b, m), and their cells (n, 2)."""
    highest = over_boxes(np.maximum, z, [2 * length + 1 for length in box], wraps)
    flat = np.flatnonzero((z == highest) & (z > TIE) & defined)
    height = np.sort(z.ravel()[flat])[::-1].astype(float)
    at = np.array([0.75, 0.5, 0.25]) * (len(flat) - 1)
    lower, median, upper = np.interp(at, np.arange(len(flat)), height) if len(flat) else np.zeros(3)
    # Standard error of a median of normal values: 1.25 sigma / sqrt(n), sigma = 0.74 (q3 - q1).
    error = 0.93 * (upper - lower) / np.sqrt(max(len(flat), 1))
    flat = flat[z.ravel()[flat] >= height[:most].min(initial=np.inf)]
    flat = flat[np.argsort(-z.ravel()[flat])[:most]]
    cell = np.stack(np.unravel_index(flat, z.shape), axis=1)
    gate = np.array(box) + 1.0
    return Peaks(
        height=height[:most],
        place=cell / gate,
        area=z.size / float(gate.prod()),
        median=float(median),
        error=float(error),
        number=len(height),
    ), cell


def edge_threshold(pool: Sequence[tuple[FloatArray, float]], number: float) -> float:
    """Threshold of a part of the image whose cells have no past: ``number * part`` lie above.

    The pool has the heights of the peaks of each ping there, and the part of the image.
    """
    height = -np.sort(-np.concatenate([heights for heights, _ in pool]))
    most = int(number * sum(part for _, part in pool))
    return float(height[most]) if most < len(height) else 0.0


def along_line(z: Image, level: float, cell: IntArray, box: Box) -> BoolArray:
    """Which peaks at cells (n, 2) are of one thing that continues along bearing, (n,)."""
    label = ndimage.label(z > level)[0]
    length = [0, *(rows.stop - rows.start for rows, _ in ndimage.find_objects(label))]
    return np.asarray(np.array(length)[label[cell[:, 0], cell[:, 1]]] > LINE_LIMITS[1] * box[0])


def beside_structure(x: Image, past: Image, cell: IntArray, box: Box, wraps: bool) -> BoolArray:
    """Which echoes at cells (n, 2) are weak beside what stands within a box of them, (n,).

    Where poses have errors, edges are left of what stands; `x` is without the `past`.
    """
    own, around = (  # sums: both are of boxes of one size
        np.lib.stride_tricks.sliding_window_view(_padded(a, size, wraps), size)[tuple(cell.T)]
        for a, size in (
            (x, box),
            (over_boxes(np.add, past, box, wraps), [2 * length + 1 for length in box]),
        )
    )
    return np.asarray(own.sum(axis=(1, 2)) < STRUCTURE_SHARE * around.max(axis=(1, 2)))


def over_boxes(merge: np.ufunc, values: Image, size: Sequence[int], wraps: bool) -> Image:
    """Sums (`np.add`) or maxima (`np.maximum`) over a box around each cell of (b, m).

    The padded cells are one line: the next bearing is a row further along it. A strip of rows at a
    time stays in the cache of the processor.
    """
    padded = _padded(values, size, wraps)
    width, of_boxes = padded.shape[1], np.empty(values.shape, np.float32)
    rows = max(STRIP // width, size[0])
    for first in range(0, len(values), rows):
        line = _over_runs(merge, padded[first : first + rows + size[0] - 1].ravel(), size[1], 1)
        line, strip = _over_runs(merge, line, size[0], width), of_boxes[first : first + rows]
        strip[:] = np.ndarray(strip.shape, np.float32, line, strides=padded.strides)
    return of_boxes


def _padded(values: Image, size: Sequence[int], wraps: bool) -> Image:
    """Values (b, m) with what boxes around the outer cells need: 0, or the other end."""
    (b, m), (top, left) = values.shape, (length // 2 for length in size)
    padded = np.zeros((b + size[0] - 1, m + size[1] - 1), np.float32)
    padded[top : top + b, left : left + m] = values
    if wraps:
        padded[:, left : left + m] = values.take(np.arange(-top, len(padded) - top), 0, mode="wrap")
    return padded


def _over_runs(merge: np.ufunc, line: Image, length: int, step: int) -> Image:
    """Sums or maxima of runs of values a step apart: each of two runs of half the length.

    The halves of a maximum may overlap.
    """
    runs, lengths, disjoint = line, [length], merge is np.add
    while lengths[-1] > 1:
        lengths.append(lengths[-1] // 2 if disjoint else (lengths[-1] + 1) // 2)
    for n in reversed(lengths[:-1]):
        runs = merge(runs[: -(n // 2) * step], runs[n // 2 * step :])
        if disjoint and n % 2:
            runs = merge(runs[:-step], line[(n - 1) * step :])
    return runs


def echoes(y: Image, cell: IntArray, box: Box, wraps: bool) -> Echoes:
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
    steps, limit = [np.arange(-length, length + 1) for length in box], cell_limit(box)
    for _ in range(CENTRINGS):
        row, column = (cell[:, axis : axis + 1] + steps[axis] for axis in (0, 1))
        row = row % len(y) if wraps else np.clip(row, 0, len(y) - 1)
        window = y[row[:, :, None], column.clip(0, y.shape[1] - 1)[:, None, :]].astype(float)
        # At an edge as far to one side as to the other, so that it draws no echo to itself.
        room = np.minimum(cell, np.array(y.shape) - 1 - cell) + np.array([wraps * len(y), 0])
        weight = np.minimum(window, limit) * (np.abs(steps[0]) <= room[:, :1])[:, :, None]
        weight *= (np.abs(steps[1]) <= room[:, 1:])[:, None]
        weight = np.maximum(weight - BACKGROUND_SHARE * weight.max(axis=(1, 2), keepdims=True), 0.0)
        total = np.maximum(weight.sum(axis=(1, 2)), 1e-12)[:, None]
        along = weight.sum(axis=2), weight.sum(axis=1)
        offset = np.stack([w @ step for w, step in zip(along, steps, strict=True)], axis=1) / total
        start, cell = cell, cell + np.rint(offset).astype(int)
    width = total / np.maximum(np.stack([w.max(axis=1) for w in along], axis=1), 1e-12)
    apart = [(steps[axis] - offset[:, axis : axis + 1]) ** 2 for axis in (0, 1)]
    squares = (weight**2).sum(axis=2), (weight**2).sum(axis=1)
    speckle = np.stack([(s * d).sum(1) for s, d in zip(squares, apart, strict=True)], axis=1)
    middle = (slice(length - (length - 1) // 2, length + (length + 1) // 2) for length in box)
    excess = np.maximum(window[:, *middle].mean(axis=(1, 2)), 0.0)
    return Echoes(start + offset, np.sqrt(speckle / total**2 + width**2 / 12.0), width, excess)
