"""The amplitude of clutter: levels, texture, and exponents of detections.

What neighbouring clutter has in common beside the levels of its ping and place: a texture.

Paths of clutter lie within a neighbourhood. Where its strengths are alike, a path of strong clutter
is as likely as a single strong detection. The rank correlation of neighbours that cannot be one
target's gives the N of `amplitude_likelihood`: those of one ping, and those of two pings that are
too far apart. A target has no part in it, however strong.

Levels of the strength of clutter: from ping to ping, and from place to place.

A level is a shift of the logarithms of strengths. It changes only as far as the detections require,
from long windows to short ones (Lepski, as in `density`), so that a level that does not change
costs nothing, and ties stay ties. An unknown target may have a detection a ping: as many do not
count in a rise.

The strength of clutter, learned from scan to scan: exponents of detections.

The exponent of a detection is u = -ln P(clutter is at least as strong), see `amplitude_law`: it is
free of the unit. Strengths are compared after taking away the level of their ping and of their
place (`ping_level`, `PlaceLevels`); what the levels leave in common to neighbours, a texture,
counts as a doubt about the law (`amplitude_likelihood`). Detections of targets are weighed down by
the evidence of their positions alone: weighed by their strength, clutter would lose its tail.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.numerics.arrays import FloatArray, IntArray
from tsepm_ros.tracker.clutter.amplitude_law import (
    MAX_PER_PING,
    MAX_PINGS,
    MIN_REFERENCES,
    REFERENCE,
    AmplitudeLaw,
    References,
    keys_of,
    of_one_law,
    of_one_shape,
)
from tsepm_ros.tracker.clutter.excess import Cells

LAGS = 3
"""Pings before whose detections are neighbours too."""
MEMORY = 50
"""Time constant, in pings, with which the correlation fades."""
DEVIATIONS = 2.0
"""Standard deviations of the correlation that do not count."""
MIN_PAIRS = 20
"""Pairs without which nothing is known."""
LARGEST_CORRELATION = 0.95
"""Largest rank correlation that counts."""


class Texture:
    """Learns the rank correlation of neighbouring clutter."""

    def __init__(self) -> None:
        self._products = self._count = 0.0

    @property
    def doubt(self) -> float:
        """1 / N, 0 for independent strengths.

        Kendall's correlation of Clayton's copula is ``1 / (1 + 2 N)``, and two thirds of Spearman's
        if that is small.
        """
        if self._count < MIN_PAIRS:
            return 0.0
        spearman = self._products / self._count - DEVIATIONS / math.sqrt(self._count)
        kendall = 2.0 / 3.0 * min(max(spearman, 0.0), LARGEST_CORRELATION)
        return 2.0 * kendall / (1.0 - kendall)

    def update(
        self,
        law: AmplitudeLaw,
        references: References,
        near: float,
        reach: FloatArray,
    ) -> None:
        """Learn from the last ping.

        Parameters
        ----------
        law : AmplitudeLaw
            Of the pings before it.
        references : References
            With the last ping.
        near : float
            Distance within which detections are neighbours, m.
        reach : (LAGS + 1,) ndarray
            Distance within which two detections may be one target's, in pings so far apart, m.
        """
        keep = 1.0 - 1.0 / MEMORY
        rows, begins = references.last(LAGS + 1), references.begins(LAGS + 1)
        own, position = begins[-1], rows["position"]
        least = np.zeros(len(rows))
        for lag, begin in zip(range(len(begins) - 1, 0, -1), begins, strict=False):
            least[begin:own] = reach[lag] ** 2
        # A ping has few references: all distances are cheaper than a tree.
        apart = position[own:, None] - position
        square = apart.real**2 + apart.imag**2
        one, two = np.nonzero((square < near**2) & (square > least))
        weight = rows["weight"]
        pairs = weight[own:][one] * weight[two]
        pairs[two >= own] *= 0.5  # each pair of the last ping is there twice
        rank = _uniform(law, rows["value"])
        self._products = keep * self._products + float(pairs @ (rank[own:][one] * rank[two]))
        self._count = keep * self._count + float(pairs.sum())


def _uniform(law: AmplitudeLaw, value: FloatArray) -> FloatArray:
    """Ranks of values (n,), scaled to mean 0 and variance 1."""
    share = law.at_least[np.searchsorted(law.values, value)] / law.count
    return np.asarray(math.sqrt(12.0) * (0.5 - share))


PING_WINDOWS = (16, 4, 1)
"""Pings over which a level is judged, from long to short."""
PING_DEVIATIONS = 2.5
"""Standard deviations of the median's rank beyond which the level of pings changes."""
PLACE_DEVIATIONS = 1.25
"""Standard deviations of a window's mean within which the level of a place stays unchanged."""
RANGE_DEVIATIONS = 3.0
"""Standard deviations of a change with range beyond which it counts."""
RANGE_TARGET_COUNT = 4.0
"""Detections at some range that may be of a target that is not known as likely."""
MAX_RANGE_CHANGES = 4
"""Changes with range that are looked for."""
PLACE_MEMORY = 50
"""Time constant, in pings, with which the levels of places fade."""
CELLS_TOGETHER = 2
"""Cells of a clutter map along a side of a cell here."""
RINGS = 4
"""Rings in a cell of a clutter map; a step with range is placed between two rings."""
RINGS_TOGETHER = CELLS_TOGETHER * RINGS
"""Rings in a cell here."""
MIN_WINDOW_CELLS = 2
"""Cells along a side of the smallest window; each larger window is twice as wide."""
LEAST_UNIT = 1e-6
"""Unit of the learned sums below which they are rescaled to a unit of 1, before they overflow."""
MAX_TARGET_COUNT = 16.0
"""Detections in a window that may be of a target: at most this, or two and one a ping."""


def ping_level(
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
        Logarithms of strengths of the last pings, in order.
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
            level = window_level(level, values[len(values) - sum(sizes[-window:]) :], window)
    return level


def window_level(level: float, values: FloatArray, pings: int) -> float:
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
    reach = np.append(np.ones(len(below)), farthest)
    doubt = RANGE_TARGET_COUNT * top * reach
    doubt += RANGE_DEVIATIONS * deviation * np.sqrt(squares)
    for _ in range(MAX_RANGE_CHANGES):
        # Of a step, the sum below it; of the power, the sum over its rings.
        sums = np.append(np.cumsum(total)[:-1], total @ slope)
        clear = np.abs(sums) > doubt
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
class PlaceLevels:
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
        rings = self.shape[0] * RINGS_TOGETHER
        # Weights, and sums of the weighted values, by ring and column, in units that fade: a ping
        # costs what its detections cost, not what all places would.
        self._learned = np.zeros((2, rings * self.shape[1]))
        self._unit = 1.0
        self._pings = 0.0
        self._deviation = self._top = self._centre = 0.0
        self._by_range = np.zeros(rings)
        # Of weights, and of what the levels by range leave, before each row and column.
        self._sums = np.zeros((2, (self.shape[0] + 1) * (self.shape[1] + 1)))

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
        keep = 1.0 - 1.0 / PLACE_MEMORY
        self._unit *= keep
        if self._unit < LEAST_UNIT:
            self._learned *= self._unit
            self._unit = 1.0
        weight = weight / self._unit
        self._pings = keep * self._pings + 1.0
        np.add.at(self._learned[0], places, weight)
        np.add.at(self._learned[1], places, weight * values)
        self._top, self._deviation = top, deviation

    def withdraw(
        self, places: IntArray, values: FloatArray, weight: FloatArray, age: IntArray
    ) -> None:
        """Remove weight (n,) of detections of the last pings, learned so many pings ago.

        What has faded since is gone already: without it, a place would keep a sum without a weight,
        and a level without bounds.
        """
        weight = weight * (1.0 - 1.0 / PLACE_MEMORY) ** age / self._unit
        np.subtract.at(self._learned[0], places, weight)
        np.subtract.at(self._learned[1], places, weight * values)
        self._learned[0, places] = np.maximum(self._learned[0, places], 0.0)

    def at(self, places: IntArray) -> FloatArray:
        """Level at places (n,), 0 where no window contradicts: by range, and then by cell."""
        if not self._pings or not self._deviation or not len(places):
            return np.zeros(len(places))
        columns = self.shape[1]
        cells = places // (RINGS_TOGETHER * columns) * columns + places % columns
        # Of weights and sums, for each cell and each side of a window, (2, n, s).
        around = self._sums.take(self._corners[cells], axis=1)
        right, left = around[:, :, 0] - around[:, :, 1], around[:, :, 2] - around[:, :, 3]
        behind = around[:, :, 4] - around[:, :, 5]
        count, total = right - left + behind
        return self.by_range(places) + self._level(count.T, total.T)

    def renew(self) -> None:
        """Take the levels from what was learned so far; those by range first."""
        left = self._unit * self._learned.reshape(2, -1, self.shape[1])
        count, total = left.sum(axis=2)
        self._centre = float(total.sum() / max(count.sum(), 1e-9))
        total -= self._centre * count
        self._by_range = level_by_range(count, total, self._top, self._deviation)
        left[1] -= (self._centre + self._by_range)[:, None] * left[0]
        left = left.reshape(2, -1, RINGS_TOGETHER, self.shape[1]).sum(axis=2)
        sums = np.zeros((2, self.shape[0] + 1, self.shape[1] + 1))
        np.cumsum(np.cumsum(left, axis=1), axis=2, out=sums[:, 1:, 1:])
        self._sums = sums.reshape(2, -1)

    def by_range(self, places: IntArray) -> FloatArray:
        """Level by range at places (n,), as of the last `renew`."""
        return np.asarray(self._by_range[places // self.shape[1]])

    def _level(self, count: FloatArray, total: FloatArray) -> FloatArray:
        """Level (n,) that windows do not contradict, by their counts and sums (s, n).

        They go from wide to narrow. As many detections as a target may have do not count in a rise.
        """
        target = min(self._pings + 2.0, MAX_TARGET_COUNT)
        spread = PLACE_DEVIATIONS * self._deviation
        some, without = np.maximum(count, 1e-9), np.maximum(count - target, 1e-9)
        mean = total / some
        high = mean + spread / np.sqrt(some)
        low = mean - target * self._top / without - spread / np.sqrt(without)
        np.maximum(high, low, out=high)
        level = np.zeros(count.shape[1])
        for least, most in zip(low, high, strict=True):
            level = np.minimum(np.maximum(level, least), most)
        return level

    @cached_property
    def _corners(self) -> IntArray:
        """Corners of the windows around each cell, (c, 6, s), from the widest window on.

        They are places in the sums over all rows and columns before each: the upper and the bottom
        end of the right side, of the left side, and of the last column where the window goes on
        behind the first.
        """
        rows, columns = self.shape
        row, column = np.divmod(np.arange(rows * columns), columns)
        corners = []
        side = max(self.shape)
        while side >= MIN_WINDOW_CELLS:
            bottom = np.clip(row - side // 2, 0, max(rows - side, 0))
            upper = np.minimum(bottom + side, rows)
            if side >= columns:
                left, right = np.zeros_like(bottom), np.full_like(bottom, columns)
            elif self.wraps:
                left = (column - side // 2) % columns
                right = left + side
            else:
                left = np.clip(column - side // 2, 0, columns - side)
                right = left + side
            inside = np.minimum(right, columns)
            ends = [
                end * (columns + 1) + edge
                for edge in (inside, left, right - inside)
                for end in (upper, bottom)
            ]
            corners.append(ends)
            side //= 2
        by_side = np.array(corners, np.int64).reshape(-1, 6, rows * columns)
        # By cell: the corners of a cell's windows are beside each other.
        return np.ascontiguousarray(by_side.transpose(2, 1, 0))


TAIL_SAMPLES = 2.0
"""Samples of the tail for which each of its detections stands, in N; see `amplitude_likelihood`."""
MAX_SAME_SHARE = 0.9
"""Share of one value from which on strengths say nothing: they are constant."""
RENEWAL = 0.1
"""Share of new references from which on the law is made anew."""
TAIL_CHANGE = 4.0
"""New references for which each whose weight changes counts: it may be in the tail."""
WINSORISED = (0.05, 0.95)
"""Quantiles of strengths at which those of the levels of places end."""
LEAST_CHANGE = 0.05
"""Sum of the changes of weights of a ping's references that is worth the while."""
SATURATED = 4
"""References at the top value from which on it counts as the end of the scale, whatever level."""
MEMORY_QUANTILES = 256
"""Quantiles of the reference that outlive a restart."""


class Judged(NamedTuple):
    """What the strengths of a scan say.

    Attributes
    ----------
    exponent : (d,) ndarray
        u of each detection; nan where its strength is not known.
    extrapolated : (d,) ndarray
        The same without an end, for a figure in dB.
    samples : float
        N: samples of clutter that determine the scale of the exponents of one path.
    """

    exponent: FloatArray
    extrapolated: FloatArray
    samples: float


@dataclass
class ClutterAmplitudes:
    """Learns the law of the strengths of clutter.

    Parameters
    ----------
    shape : (int, int)
        Cells of the clutter map.
    wraps : bool
        Whether its last column is next to the first.

    Attributes
    ----------
    unsaid : str
        Why strengths do not count as of the last scan; empty where they do.
    """

    shape: tuple[int, int]
    wraps: bool
    unsaid: str = field(default="no strengths", init=False)

    def __post_init__(self) -> None:
        self._forget()

    def _forget(self) -> None:
        self._references = References()
        self._places = PlaceLevels(self.shape, self.wraps)
        self._law: AmplitudeLaw | None = None
        self._top = math.inf, 1.0
        self._bounds = 0.0, 0.0, 0.0
        self._learned_from = 0.0
        self._new = math.inf
        self._level = 0.0
        self._decibels = False
        self._texture = Texture()
        self._next: tuple[NDArray[np.void], IntArray, float] | None = None
        self._remembered: tuple[FloatArray, float] | None = None

    def judge(
        self,
        strength: FloatArray,
        scan: int,
        index: IntArray,
        rings: Callable[[], Cells],
        position: FloatArray,
    ) -> Judged | None:
        """Exponents of a scan's detections, by the scans before it.

        Parameters
        ----------
        strength : (d,) ndarray
            In any unit; nan where it is not measured.
        scan : int
            Its index.
        index : (d,) ndarray of int
            Index of each detection in the scan.
        rings : callable
            Cells of the clutter map, its rows divided into `RINGS`; called only if there are
            strengths.
        position : (d, 2) ndarray
            In the fixed frame, m.

        Returns
        -------
        Judged or None
            None where strengths say nothing; `unsaid` says why.
        """
        self._next = None
        row = np.flatnonzero(np.isfinite(strength))
        if not len(row):
            self.unsaid = "no strengths"
            return None
        if not self._decibels and (strength[row] < 0.0).any():
            self._forget()
            self._decibels = True
        raw = strength[row] if self._decibels else np.log(np.maximum(strength[row], 1e-30))
        one = np.empty(len(row), REFERENCE)
        one["key"] = keys_of(scan, index[row])
        cells = rings()
        one["at"] = self._places.places_of(cells.row[row], cells.column[row])
        place = self._places.at(one["at"])
        raw -= place
        level = self._level_with(raw)
        value = raw - level
        one["raw"], one["value"], one["place"] = raw, value, place
        one["position"] = position[row, 0] + 1j * position[row, 1]
        one["strength"] = strength[row]
        one["by_range"] = self._places.by_range(one["at"])
        self._next = one, row, level
        law = self._law
        if law is None or law.count < MIN_REFERENCES:
            self.unsaid = "too few strengths so far"
            return None
        if law.constant_share > MAX_SAME_SHARE:
            self.unsaid = "constant strengths"
            return None
        self.unsaid = ""
        exponent, extrapolated = np.full((2, len(strength)), np.nan)
        exponent[row], extrapolated[row] = law.exponents(value)
        top, share = self._top
        if top < math.inf:
            at_top = strength >= top
            exponent[at_top] = np.minimum(exponent[at_top], -math.log(share))
        count = TAIL_SAMPLES * law.tail_count
        return Judged(exponent, extrapolated, 1.0 / (1.0 / count + self.texture))

    def _level_with(self, raw: FloatArray) -> float:
        """The level of a ping of logarithms (n,); the first has its median."""
        references, before = self._references, PING_WINDOWS[0] - 1
        if not len(references):
            self._level = float(np.median(raw))
            return self._level
        rows = references.last(before)
        likely = rows["weight"] > 0.5
        sizes = np.add.reduceat(likely, references.begins(before), dtype=np.int64).tolist()
        values = np.concatenate([rows["raw"][likely], raw])
        return ping_level(self._level, values, [*sizes, len(raw)])

    @property
    def use(self) -> str:
        """Whether strengths count as of the last scan, in words."""
        if self.unsaid:
            return f"not used: {self.unsaid}"
        count = 0.0 if self._law is None else self._law.count
        alike = "; neighbouring clutter is alike" if self.texture > 0.0 else ""
        return f"used: compared with {count:.0f} of clutter{alike}"

    @property
    def texture(self) -> float:
        """1 / N of what neighbouring clutter has in common: 0 for independent strengths."""
        return self._texture.doubt

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
        ping, row, level = judged
        ping["weight"] = weight[row]
        order = np.argsort(ping["key"], kind="stable")
        ping = ping[order[:: max(math.ceil(len(order) / MAX_PER_PING), 1)]]
        law = self._law if self._law and self._law.count >= MIN_REFERENCES else None
        if law is not None:
            lowest, highest, spread = self._bounds
            ping["place"] += np.minimum(np.maximum(ping["value"], lowest), highest)
            self._places.update(ping["at"], ping["place"], ping["weight"], highest, spread)
        else:
            ping["place"] = np.nan
        self._references.append(ping, level)
        if law is not None:
            self._texture.update(law, self._references, near, reach)
        self._new += float(ping["weight"].sum())
        if self._new > RENEWAL * self._learned_from:
            self._learn_law()

    def discount(self, scan: IntArray, index: IntArray, probability: FloatArray) -> None:
        """Weigh references down that are probably of targets, by their positions alone.

        Parameters
        ----------
        scan, index : (k,) ndarray of int
            Scan of each detection, and its index there.
        probability : (k,) ndarray
            That each is of a target.
        """
        rows = self._references.rows
        if not len(rows) or not len(scan):
            return
        key = keys_of(scan, index)
        place = np.minimum(np.searchsorted(rows["key"], key), len(rows) - 1)
        known = np.flatnonzero(rows["key"][place] == key)
        place, before = place[known], rows["weight"][place[known]]
        gone = before - np.minimum(before, 1.0 - probability[known])
        if gone.sum() < LEAST_CHANGE:
            return
        _, ping = np.unique(scan[known], return_inverse=True)
        changed = np.flatnonzero(np.bincount(ping, gone)[ping] >= LEAST_CHANGE)
        if not len(changed):
            return
        place, gone = place[changed], gone[changed]
        rows["weight"][place] -= gone
        self._new += TAIL_CHANGE * float(gone.sum())
        levelled = np.flatnonzero(np.isfinite(rows["place"][place]))
        place, gone = place[levelled], gone[levelled]
        at, values = rows["at"][place], rows["place"][place]
        self._places.withdraw(at, values, gone, self._references.ages(place))

    def _learn_law(self) -> None:
        self._drop_other_laws()
        rows = self._references.rows
        self._places.renew()
        by_range = self._places.by_range(rows["at"])
        change = by_range - rows["by_range"]
        if change.any():
            rows["raw"] -= change
            rows["value"] -= change
            rows["by_range"] = by_range
        self._learn_level()
        values, weight = rows["value"], rows["weight"].copy()
        self._top = _top(rows["strength"], weight)
        if self._remembered is not None and weight.sum() >= MIN_REFERENCES:
            remembered, of_remembered = self._before_restart()
            values, weight = np.append(values, remembered), np.append(weight, of_remembered)
        law = self._law = AmplitudeLaw.of(values, weight)
        self._learned_from, self._new = law.count, 0.0
        lowest, highest = map(law.quantile, WINSORISED)
        spread = np.minimum(np.maximum(law.values, lowest), highest).std()
        self._bounds = lowest, highest, float(spread)

    def _learn_level(self) -> None:
        """Learn the level as a rule; the pings that have it go with it."""
        before, references = self._level, self._references
        rows = references.rows
        likely = rows["raw"][rows["weight"] > 0.5]
        self._level = window_level(before, likely, len(references))
        if self._level != before:
            references.relevel(before, self._level)

    def _before_restart(self) -> tuple[FloatArray, FloatArray]:
        """What was remembered and is of the same law as the pings, with its fading weight."""
        none = np.zeros(0)
        if self._remembered is None:
            return none, none
        raw, total = self._remembered
        left = 1.0 - len(self._references) / MAX_PINGS
        other = not of_one_law(raw, self._references.rows["raw"])
        if other or left <= 0.0:
            self._remembered = None
            return none, none
        return raw - self._level, np.full(len(raw), left * total / len(raw))

    @property
    def memory(self) -> tuple[FloatArray, float, bool]:
        """Quantiles of the reference, its weight, and whether it is of decibels."""
        if self._law is None:
            return *(self._remembered or (np.zeros(0), 0.0)), self._decibels
        shares = (np.arange(MEMORY_QUANTILES) + 0.5) / MEMORY_QUANTILES
        raw = np.quantile(self._references.rows["raw"], shares)
        return raw, self._law.count, self._decibels

    def remember(self, raw: FloatArray, weight: float, decibels: bool) -> None:
        """Begin with the memory of another run; it counts if the first pings are of its law."""
        if len(raw) and weight > 0.0:
            self._remembered, self._decibels = (raw, weight), decibels

    def _drop_other_laws(self) -> None:
        """Drop the pings before a change of level that has changed the law too, as of the unit."""
        if self._law is None:
            return
        width = self._law.quantile(0.75) - self._law.quantile(0.25)
        references = self._references
        levels = np.array(references.levels)
        far = np.flatnonzero(np.abs(levels - levels[-1]) > width)
        since = int(far[-1]) + 1 if len(far) else 0
        if not 0 < since < len(levels):
            return
        new = references.last(len(levels) - since)["value"]
        old = references.rows["value"][: len(references.rows) - len(new)]
        if min(len(old), len(new)) >= MIN_REFERENCES and not of_one_shape(old, new):
            self._level = float(levels[-1])
            references.drop(since)


def _top(strength: FloatArray, weight: FloatArray) -> tuple[float, float]:
    """The end of the scale, and the share of the reference there; infinite if it is not seen."""
    at_top = strength == strength.max()
    if at_top.sum() < SATURATED:
        return math.inf, 1.0
    share = (1.0 + weight[at_top].sum()) / (1.0 + weight.sum())
    return float(strength.max()), float(share)
