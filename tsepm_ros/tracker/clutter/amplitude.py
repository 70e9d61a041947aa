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
"""The amplitude of clutter: levels, texture, and normalised amplitudes of detections.

The normalised amplitude of a detection is u = -ln P(clutter is at least as strong), see
`amplitude_law`: it is free of the unit. Amplitudes are compared after taking away the level of
their ping and of their place (`level_of_ping`, `Levels`); what the levels leave
in common to neighbours, a texture, counts as a doubt about the law. Detections count as far as
they are not confirmed tracks'.

A level is a shift of the logarithms of amplitudes. It changes only as far as the detections
require, from long windows to short ones (Lepski, as in `density`), so that a level that does not
change costs nothing, and ties stay ties. An unknown target may have a detection a ping: as many do
not count in a rise.

A texture: paths of clutter lie within a neighbourhood. Where its amplitudes are alike, a path of
strong clutter is as likely as a single strong detection. The rank correlation of neighbours that
cannot be one target's gives the N of `amplitude_law`: those of one ping, and those of two pings
that are too far apart. A target has no part in it, however strong.

The references are detections of the last pings, as rows of one array, so that a ping costs a few
operations, whatever the number of pings.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tsepm_ros.numerics.arrays import FloatArray, IntArray, RecordArray, appended
from tsepm_ros.tracker.clutter.amplitude_law import MIN_REFERENCES, AmplitudeLaw, ScanAmplitudes
from tsepm_ros.tracker.polar_grid import (
    CHANCE_DEVIATIONS,
    MAX_DEVIATIONS,
    MEMORY_SCANS,
    RENEWAL_SHARE,
    BlockSums,
    Cells,
    PolarGrid,
)

MAX_PINGS, MAX_PER_PING = 64, 64
"""Pings in the reference, at most, and detections of each."""

REFERENCE = np.dtype(
    [
        ("ping", np.int64),  # number of its ping
        ("level", np.float64),  # of the ping
        ("at", np.int64),  # place in the levels of places
        ("raw", np.float64),  # logarithm less the level of the place
        ("value", np.float64),  # less the level of the ping too
        ("by_range", np.float64),  # level of the range, part of that of the place
        ("weight", np.float64),  # probability to be of clutter
        ("position", np.complex128),  # x + i y, m
        ("amplitude", np.float64),  # as measured
    ]
)
LAGS = 3
"""Pings before whose detections are neighbours too."""
LARGEST_CORRELATION = 0.95
"""Largest rank correlation that counts."""
PING_WINDOWS = (16, 4, 1)
"""Pings over which a level is judged, from long to short."""
PING_DEVIATIONS = 2.5
"""Standard deviations of the median's rank beyond which the level of pings changes."""
RANGE_DEVIATIONS = 3.0
"""Standard deviations of a change with range beyond which it counts."""
RANGE_TARGET_COUNT = 4.0
"""Detections at some range that may be of a target that is not known as likely."""
MAX_RANGE_CHANGES = 4
"""Changes with range that are looked for."""
CELLS_TOGETHER = 2
"""Cells of a clutter map along a side of a cell here."""
RINGS_PER_CELL = 4
"""Rings in a cell of a clutter map; a step with range is placed between two rings."""
MAX_TARGET_COUNT = 16.0
"""Detections in a window that may be of a target: at most this, or two and one a ping."""
TAIL_SAMPLES = 2.0
"""Samples of the tail for which each of its detections stands, in N; see `amplitude_law`."""
MAX_SAME_SHARE = 0.9
"""Share of one value from which on amplitudes say nothing: they are constant."""
WINSOR_QUANTILES = (0.05, 0.95)
"""Quantiles of amplitudes at which those of the levels of places end."""
MIN_SATURATED_COUNT = 4
"""References at the top value from which on it counts as the end of the scale, whatever level."""


def of_last_pings(references: RecordArray, pings: int) -> RecordArray:
    """References (n,) of the last pings; changes of them are kept."""
    ping = references["ping"]
    return references[np.searchsorted(ping, ping.max(initial=0) - pings, side="right") :]


class Texture:
    """Learns the rank correlation of neighbouring clutter."""

    def __init__(self) -> None:
        self._products = self._count = 0.0

    @property
    def doubt(self) -> float:
        """1 / N, 0 for independent amplitudes.

        Kendall's correlation of Clayton's copula is ``1 / (1 + 2 N)``, and two thirds of Spearman's
        if that is small.
        """
        if self._count < MIN_REFERENCES:
            return 0.0
        spearman = self._products / self._count - CHANCE_DEVIATIONS / math.sqrt(self._count)
        kendall = 2.0 / 3.0 * min(max(spearman, 0.0), LARGEST_CORRELATION)
        return 2.0 * kendall / (1.0 - kendall)

    def update(
        self,
        law: AmplitudeLaw,
        references: RecordArray,
        near: float,
        reach: FloatArray,
    ) -> None:
        """Learn from the last ping.

        Parameters
        ----------
        law : AmplitudeLaw
            Of the pings before it.
        references : (n,) ndarray of REFERENCE
            With the last ping.
        near : float
            Distance within which detections are neighbours, m.
        reach : (LAGS + 1,) ndarray
            Distance within which two detections may be one target's, in pings so far apart, m.
        """
        keep = 1.0 - 1.0 / MEMORY_SCANS
        rows = of_last_pings(references, LAGS + 1)
        lag, position = rows["ping"][-1] - rows["ping"], rows["position"]
        own = np.count_nonzero(lag)
        least = np.where(lag > 0, reach[lag] ** 2, 0.0)
        # A ping has few references: all distances are cheaper than a tree.
        apart = position[own:, None] - position
        square = apart.real**2 + apart.imag**2
        newest, any_row = np.nonzero((square < near**2) & (square > least))
        weight = rows["weight"]
        pairs = weight[own:][newest] * weight[any_row]
        pairs[any_row >= own] *= 0.5  # each pair of the last ping is there twice
        share = law.at_least[np.searchsorted(law.values, rows["value"])] / law.count
        rank = math.sqrt(12.0) * (0.5 - share)  # of mean 0 and variance 1
        self._products = keep * self._products + float(pairs @ (rank[own:][newest] * rank[any_row]))
        self._count = keep * self._count + float(pairs.sum())


def level_of_ping(
    level: float,
    values: FloatArray,
    sizes: Sequence[int],
    windows: Sequence[int] = PING_WINDOWS,
) -> float:
    """The level of the last ping.

    Parameters
    ----------
    level : float
        The level as a rule.
    values : (n,) ndarray
        Logarithms of amplitudes of the last pings, in order.
    sizes : sequence of int
        Number of values of each ping.
    windows : sequence of int
        Pings, from long to short; longer ones than there are pings do not count.

    Returns
    -------
    float
        The median of the shortest window that contradicts; `level` where none does.
    """
    for window in windows:
        if window <= len(sizes):
            level = level_of_window(level, values[len(values) - sum(sizes[-window:]) :], window)
    return level


def level_of_window(level: float, values: FloatArray, pings: int) -> float:
    """The level of a window of pings with values (n,): `level` if they do not contradict."""
    n = len(values)
    target = min(pings + 2.0, MAX_TARGET_COUNT)
    deviation = 0.5 * PING_DEVIATIONS * math.sqrt(n)
    middle = 0.5 * (n - target)
    low, high = math.floor(middle - deviation), math.ceil(0.5 * n + deviation)
    # Of n values in order, that at `low` is above the level if at most `low` are not.
    if low >= 0 and np.count_nonzero(values <= level) <= low:
        return float(np.sort(values)[math.floor(middle)])
    if high < n and np.count_nonzero(values < level) > high:
        return float(np.sort(values)[n // 2])
    return level


def level_by_range(
    count: FloatArray, total: FloatArray, top: float, deviation: float
) -> FloatArray:
    """Level of each ring, (r,): changes with range, each beyond doubt, the clearest first.

    A change is a power of the range or a step at some range; rings are nearly even in the range's
    logarithm. Of all changes, that which explains the most of the squares is taken, and then of
    what it leaves; none where none is beyond doubt.

    Parameters
    ----------
    count, total : (r,) ndarray
        Weight of the detections of each ring, and the sum of their deviations from their mean.
    top : float
        Most that a detection deviates.
    deviation : float
        Standard deviation of a detection.
    """
    level, everything = np.zeros(len(count)), float(count.sum())
    if everything <= 0.0:
        return level
    rings = np.arange(len(count))
    slope = rings - count @ rings / everything
    square, farthest = max(float(count @ slope**2), 1e-9), float(np.abs(slope[count > 0.0]).max())
    below = np.cumsum(count)[:-1]
    above = np.maximum(everything - below, 0.0)
    squares = np.append(below * above / everything, square)
    doubt = RANGE_TARGET_COUNT * top * np.append(np.ones(len(below)), farthest)
    doubt += RANGE_DEVIATIONS * deviation * np.sqrt(squares)
    for _ in range(MAX_RANGE_CHANGES):
        # Of a step, the sum below it; of the power, the sum over its rings.
        sums = np.append(np.cumsum(total)[:-1], total @ slope)
        clear = (np.abs(sums) > doubt) & (squares > 1e-9)  # with values on both sides
        if not clear.any():
            break
        best = int(np.argmax(np.where(clear, sums**2 / np.maximum(squares, 1e-9), 0.0)))
        change = sums[best] / squares[best] * slope
        if best < len(below):
            change = np.where(rings <= best, 1.0 / below[best], -1.0 / above[best]) * sums[best]
        level += change
        total = total - count * change
    return level


@dataclass
class Levels:
    """Levels over the cells of a clutter map, and by range over the rings of these.

    Parameters
    ----------
    shape : (int, int)
        Number of cells of the clutter map in range and in azimuth.
    wraps : bool
        Whether the last column is next to the first.
    """

    shape: tuple[int, int]
    wraps: bool

    def __post_init__(self) -> None:
        rows, columns = self.shape
        self.shape = -(-rows // CELLS_TOGETHER), max(columns // CELLS_TOGETHER, 1)
        rings = self.shape[0] * CELLS_TOGETHER * RINGS_PER_CELL
        # Weights, and sums of the weighted values, by ring and column.
        self._learned = np.zeros((2, rings * self.shape[1]))
        self._pings = 0.0
        self._deviation = self._top = self._centre = 0.0
        self._by_range = np.zeros(rings)
        # Of weights, and of what the levels by range leave.
        self._sums = [BlockSums(np.zeros(self.shape), self.wraps)] * 2
        # Sides of windows, cells: each half as wide as the one before, down to two.
        side = max(self.shape)
        self._sides = np.array([side >> k for k in range(side.bit_length() - 1)], np.int64)[:, None]

    def places_of(self, ring: IntArray, column: IntArray) -> IntArray:
        """Places (n,) in rings and columns of the clutter map, as numbers."""
        columns = self.shape[1]
        return np.asarray(ring * columns + np.minimum(column // CELLS_TOGETHER, columns - 1))

    def update(
        self,
        places: IntArray,
        values: FloatArray,
        weight: FloatArray,
        top: float,
        deviation: float,
    ) -> None:
        """Learn from a ping.

        Parameters
        ----------
        places : (n,) ndarray of int
            Of each detection, see `places_of`.
        values, weight : (n,) ndarray
            Deviation of each from the level of its ping, bounded around the level of its place, and
            its probability to be clutter.
        top, deviation : float
            The bound above the level of the place, and the standard deviation around that.
        """
        keep = 1.0 - 1.0 / MEMORY_SCANS
        self._learned *= keep
        self._pings = keep * self._pings + 1.0
        np.add.at(self._learned[0], places, weight)
        np.add.at(self._learned[1], places, weight * values)
        self._top, self._deviation = top, deviation

    def at(self, places: IntArray) -> FloatArray:
        """Level at places (n,), 0 where no window contradicts: by range, and then by cell."""
        if not self._pings or not self._deviation or not len(places):
            return np.zeros(len(places))
        rows, columns = self.shape
        row, column, side = (
            places // (CELLS_TOGETHER * RINGS_PER_CELL * columns),
            places % columns,
            self._sides,
        )
        bottom, left = row - side // 2, column - side // 2
        bottom = np.clip(bottom, 0, np.maximum(rows - side, 0))
        if not self.wraps:
            left = np.clip(left, 0, np.maximum(columns - side, 0))
        top = np.minimum(bottom + side, rows)
        count, total = (sums.over(bottom, top, left, side) for sums in self._sums)
        # As many detections as a target may have do not count in a rise.
        target = min(self._pings + 2.0, MAX_TARGET_COUNT)
        spread = MAX_DEVIATIONS * self._deviation
        some, without = np.maximum(count, 1e-9), np.maximum(count - target, 1e-9)
        mean = total / some
        high = mean + spread / np.sqrt(some)
        low = mean - target * self._top / without - spread / np.sqrt(without)
        level = np.zeros(len(places))
        for least, most in zip(low, np.maximum(high, low), strict=True):
            level = np.minimum(np.maximum(level, least), most)
        return self.by_range(places) + level

    def renew(self) -> None:
        """Take the levels from what was learned so far; those by range first."""
        left = self._learned.reshape(2, -1, self.shape[1]).copy()
        count, total = left.sum(axis=2)
        self._centre = float(total.sum() / max(count.sum(), 1e-9))
        total -= self._centre * count
        self._by_range = level_by_range(count, total, self._top, self._deviation)
        left[1] -= (self._centre + self._by_range)[:, None] * left[0]
        left = left.reshape(2, -1, CELLS_TOGETHER * RINGS_PER_CELL, self.shape[1]).sum(axis=2)
        self._sums = [BlockSums(values, self.wraps) for values in left]

    def by_range(self, places: IntArray) -> FloatArray:
        """Level by range at places (n,), as of the last `renew`."""
        return np.asarray(self._by_range[places // self.shape[1]])


class ClutterAmplitudes:
    """Learns the law of the amplitudes of clutter.

    Parameters
    ----------
    grid : PolarGrid
        Of the clutter map.

    Attributes
    ----------
    use : str
        Whether amplitudes count as of the last scan, in words.
    texture : Texture
    """

    def __init__(self, grid: PolarGrid) -> None:
        self._grid = grid
        self.use = "not used: no amplitudes"
        self._forget()

    def _forget(self) -> None:
        self._references = np.zeros(0, REFERENCE)
        self._places = Levels(self._grid.shape, self._grid.wraps)
        self._law: AmplitudeLaw | None = None
        self._top = math.inf, 1.0
        self._bounds = 0.0, 0.0, 0.0
        self._new = 0.0
        self._level = 0.0
        self._decibels = False
        self.texture = Texture()
        self._next: tuple[RecordArray, IntArray, FloatArray] | None = None

    def judge(
        self,
        detections: RecordArray,
        most_hits: int,
        cells: Cells,
        range: FloatArray,
    ) -> ScanAmplitudes | None:
        """What the amplitudes of a scan's detections say, by the scans before.

        Their normalised amplitudes without an end become the field `amplitude` of the detections.

        Parameters
        ----------
        detections : (d,) ndarray of DETECTION
            Amplitudes in any unit; nan where they are not measured.
        most_hits : int
            Hits that a path may have.
        cells : Cells
            Of the clutter map.
        range : (d,) ndarray
            m.

        Returns
        -------
        ScanAmplitudes or None
            None where amplitudes say nothing; `use` says why.
        """
        self._next = None
        amplitude = detections["intensity"]
        row = np.isfinite(amplitude).nonzero()[0]
        row = row[np.argsort(detections["index"][row], kind="stable")]
        if not len(row):
            self.use = "not used: no amplitudes"
            return None
        if not self._decibels and (amplitude[row] < 0.0).any():
            self._forget()
            self._decibels = True
        raw = amplitude[row] if self._decibels else np.log(np.maximum(amplitude[row], 1e-30))
        reference = np.empty(len(row), REFERENCE)
        cells = self._grid.divided(cells, range, RINGS_PER_CELL)
        reference["at"] = self._places.places_of(cells.row[row], cells.column[row])
        place_level = self._places.at(reference["at"])
        raw -= place_level
        level = self._level_with(raw)
        value = raw - level
        reference["raw"], reference["value"], reference["level"] = raw, value, level
        reference["position"] = detections["position"][row] @ (1.0, 1j)
        reference["amplitude"] = amplitude[row]
        reference["by_range"] = self._places.by_range(reference["at"])
        self._next = reference, row, place_level
        law = self._law
        if law is None or law.count < MIN_REFERENCES:
            self.use = "not used: too few amplitudes so far"
            return None
        if law.constant_share > MAX_SAME_SHARE:
            self.use = "not used: constant amplitudes"
            return None
        doubt = self.texture.doubt
        alike = "; neighbouring clutter is alike" if doubt > 0.0 else ""
        self.use = f"used: compared with {law.count:.0f} of clutter{alike}"
        normalised, extrapolated = np.full((2, len(amplitude)), np.nan)
        normalised[row], extrapolated[row] = law.normalised(value)
        top, share = self._top
        at_top = amplitude >= top
        normalised[at_top] = np.minimum(normalised[at_top], -math.log(share))
        detections["amplitude"] = extrapolated
        count = TAIL_SAMPLES * law.tail_count
        return ScanAmplitudes.from_normalised(normalised, 1.0 / (1.0 / count + doubt), most_hits)

    def _level_with(self, raw: FloatArray) -> float:
        """The level of a ping of logarithms (n,); the first has its median."""
        if not len(self._references):
            self._level = float(np.median(raw))
            return self._level
        rows = of_last_pings(self._references, PING_WINDOWS[0] - 1)
        likely = rows["weight"] > 0.5
        sizes = np.bincount(rows["ping"] - rows["ping"][0], likely).astype(int).tolist()
        raws = np.concatenate([rows["raw"][likely], raw])
        return level_of_ping(self._level, raws, [*sizes, len(raw)])

    @property
    def judged(self) -> bool:
        """Whether the last scan had amplitudes, which are not learned from yet."""
        return self._next is not None

    def update(self, weight: FloatArray, near: float, reach: FloatArray) -> None:
        """Learn from the scan that was judged last.

        Parameters
        ----------
        weight : (d,) ndarray
            Probability that each detection is of clutter.
        near : float
            Distance within which detections are neighbours, m.
        reach : (LAGS + 1,) ndarray
            Distance within which two detections may be one target's, in scans so far apart, m.
        """
        judged, self._next = self._next, None
        if judged is None:
            return
        ping, row, place_level = judged
        ping["weight"] = weight[row]
        # Evenly from all of a large ping: the order in the message does not matter.
        some = np.sort(np.argsort(ping["position"])[:: math.ceil(len(ping) / MAX_PER_PING)])
        ping, place_level = ping[some], place_level[some]
        law = self._law if self._law and self._law.count >= MIN_REFERENCES else None
        if law is not None:
            lowest, highest, spread = self._bounds
            value = place_level + np.minimum(np.maximum(ping["value"], lowest), highest)
            self._places.update(ping["at"], value, ping["weight"], highest, spread)
        before = of_last_pings(self._references, MAX_PINGS - 1)
        ping["ping"] = before["ping"][-1] + 1 if len(before) else 0
        self._references = appended(before, ping)
        if law is not None:
            self.texture.update(law, self._references, near, reach)
        self._new += float(ping["weight"].sum())
        if self._law is None or self._new > RENEWAL_SHARE * self._law.count:
            self._learn_law()

    def _learn_law(self) -> None:
        rows, before = self._references, self._level
        self._places.renew()
        by_range = self._places.by_range(rows["at"])
        change = by_range - rows["by_range"]
        rows["raw"] -= change
        rows["value"] -= change
        rows["by_range"] = by_range
        # The level as a rule; the pings that have it go with it.
        likely = rows["raw"][rows["weight"] > 0.5]
        self._level = level_of_window(before, likely, int(np.ptp(rows["ping"])) + 1)
        if self._level != before:
            usual = rows["level"] == before
            rows["level"][usual] = self._level
            rows["value"][usual] = rows["raw"][usual] - self._level
        self._top = _end_of_scale(rows["amplitude"], rows["weight"])
        law = self._law = AmplitudeLaw.from_values(rows["value"], rows["weight"])
        self._new = 0.0
        lowest, highest = map(law.quantile, WINSOR_QUANTILES)
        self._bounds = lowest, highest, float(np.clip(law.values, lowest, highest).std())


def _end_of_scale(amplitude: FloatArray, weight: FloatArray) -> tuple[float, float]:
    """The end of the scale, and the share of the reference there; infinite if it is not seen."""
    at_top = amplitude == amplitude.max()
    if at_top.sum() < MIN_SATURATED_COUNT:
        return math.inf, 1.0
    return float(amplitude.max()), float((1.0 + weight[at_top].sum()) / (1.0 + weight.sum()))
