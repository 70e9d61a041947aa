"""Tests for several detections of one target in a ping, and their dispersion.

How much closer than by chance clutter lies along, or across, the line of sight.

Places where detections lay close together ping after ping.

Whether targets have several detections a ping, told by how closely detections lie together.

The detections of a ping are drawn in random order. Of clutter, the next one is anywhere in the
coverage, whatever lies there already: if it falls into a box of some 10 m around an earlier one, it
falls into a smaller box in the middle of that with the ratio p of the two areas. Where targets have
several detections, it does so more often. With q the probability of it then, the likelihood ratio
of a ping, over the detections that fall into the larger boxes, is::

    L = prod q / p1  (into the smaller box),  (1 - q) / (1 - p1)  (beside it)

Under clutter the products of L over the pings are supermartingales, and so is their mean over
several sizes of box, several q, and all pings at which it may begin. The probability that it ever
exceeds 1 / a is at most a (Ville 1939), however many pings there are.

Clutter need not be uniform: p1 has `MARGIN` times the odds of p, so that this holds as long as
within a box detections are at most so much denser in the middle than around it.

Clutter on an arc or on a ray is close together along or across the line of sight only. The odds of
p are therefore multiplied by how much more often than by area the detections at the sides of the
smaller box are within its depth, and those before and behind it within its width: see
`StripCounts`. The factor is learned, and the bound holds approximately there. Echoes of one target
are near in both. Nearer to the sensor than a larger box's half width, that box does not count:
reverberation decays over such a distance.

The larger boxes are cut to the coverage and to where clutter is seen, and where they overlap those
of earlier detections, the next detection counts for the earliest only: of the later one's box that
part is left out (the union bound, which makes p larger).

A target is where it was a ping ago, within its reach. The earlier detections may therefore be only
those where detections were close together in each of the last `STREAKS` pings. What is chosen by
the pings before leaves the product a supermartingale; in dense clutter it leaves few detections
beside a target's.

How the detections of one target and ping scatter: what is error, and what is extent.

Within plots of m detections the sums of squared deviations along and across the line of sight have
the means ``(m - 1) (f s^2 + v)``, see `clustering`. The sensor's variance s^2 differs
between the two; the variance v of where on the target the detections arise does not.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from tsepm_ros.numerics import discs
from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray, changed
from tsepm_ros.numerics.discs import pairs_nearer
from tsepm_ros.tracker.clustering import EchoErrors, PlotExtent, crowded, pairs_within
from tsepm_ros.tracker.clutter.seen_extent import Region
from tsepm_ros.tracker.scan import Scan, wrap
from tsepm_ros.tracker.sensor import SensorModel

STRIP_MEMORY = 100.0
"""Pings that count: older ones fade."""
STRIP_PRIOR = 0.5
"""Detections for which an even distribution counts."""


class StripCounts:
    """Counts of detections in strips through smaller boxes, inside larger ones, but beside them.

    Of two detections in a larger box that are not as near as a smaller one across the line of
    sight, a share a is as near along it; evenly distributed, that is the ratio of the depths. Along
    and across independent, detections fall into the smaller box more often than by the areas by the
    factor of both shares to those ratios.

    Parameters
    ----------
    shape : tuple of int
        Tests and extents.
    """

    def __init__(self, shape: tuple[int, int]) -> None:
        self._found = np.zeros((2, *shape))
        self._expected = np.zeros((2, *shape))

    def count(
        self,
        test: IntArray,
        near: tuple[BoolArray, BoolArray],
        shares: tuple[FloatArray, FloatArray],
    ) -> None:
        """Count the detections of a ping that fall into larger boxes.

        Parameters
        ----------
        test : (f,) ndarray of int
            Of each, ascending.
        near : tuple of (f, e) ndarray of bool
            Whether it is as near as the smaller box along the line of sight, and across.
        shares : tuple of (f, e) ndarray
            Probabilities of it by the area.
        """
        self._found *= 1.0 - 1.0 / STRIP_MEMORY
        self._expected *= 1.0 - 1.0 / STRIP_MEMORY
        first = np.flatnonzero(np.diff(test, prepend=-1))
        for axis in (0, 1):
            beside = ~near[1 - axis]
            self._found[axis, test[first]] += np.add.reduceat(
                near[axis] & beside, first, dtype=float
            )
            expected = np.where(beside, shares[axis], 0.0)
            self._expected[axis, test[first]] += np.add.reduceat(expected, first)

    @property
    def concentration(self) -> FloatArray:
        """Factor on the odds of each test and extent, at least 1."""
        ratio = (self._found + STRIP_PRIOR) / (self._expected + STRIP_PRIOR)
        return np.asarray(np.maximum(ratio, 1.0).prod(axis=0))


MAX_CLOSE_DETECTIONS = 2000
"""Detections of a ping beyond which it ends every streak: bounds the time."""
MAX_PAIRS = 200_000
"""Pairs of detections within the extent, or of detections and places of streaks within the reach,
beyond which it does so too."""


class CloseStreaks:
    """Counts, at each detection, the pings in a row that had detections close together there.

    Parameters
    ----------
    extent : PlotExtent
        Within which two detections are close.
    """

    def __init__(self, extent: PlotExtent) -> None:
        self._extent = extent
        self._position = np.zeros((0, 2))
        self._length = np.zeros(0, np.int64)

    @property
    def longest(self) -> int:
        """Length of the longest streak, the last ping included; 0 where there is none."""
        return int(self._length.max(initial=0))

    def step(
        self, range: FloatArray, azimuth: FloatArray, position: FloatArray, reach: float
    ) -> IntArray:
        """Take a ping and return the length of the longest streak before it at each detection.

        Parameters
        ----------
        range, azimuth : (n,) ndarray
            m and rad.
        position : (n, 2) ndarray
            In the fixed frame, m.
        reach : float
            How far a target may move from ping to ping, m; an extent comes on top.

        Returns
        -------
        (n,) ndarray of int
            It depends on the pings before and on the detection's place alone.
        """
        n = len(range)
        near = self._near(range, position, reach)
        if (
            near is None
            or n > MAX_CLOSE_DETECTIONS
            or crowded(range, azimuth, self._extent, MAX_PAIRS)
        ):
            self._position, self._length = np.zeros((0, 2)), np.zeros(0, np.int64)
            return np.zeros(n, np.int64)
        length = np.zeros(n, np.int64)
        detection, place = near
        np.maximum.at(length, detection, self._length[place])
        first, second, _ = pairs_within(range, azimuth, self._extent)
        close = np.unique(np.concatenate([first, second]))
        self._position, self._length = position[close], length[close] + 1
        return length

    def _near(
        self, range: FloatArray, position: FloatArray, reach: float
    ) -> tuple[IntArray, IntArray] | None:
        """Pairs of detections and places of streaks within reach; None of more than `MAX_PAIRS`."""
        limit = reach + self._extent.across_at(range)
        return discs.pairs_within(self._position, position, limit, MAX_PAIRS)


SHORT_RANGE = 100.0
"""Range below which every length here is as much shorter, m: a tank or a room is no sea."""
OUTER = np.array([12.0, 24.0, 48.0, 96.0])
"""Half widths of the larger boxes, m: far below the scale on which clutter changes."""
STREAKS = ((0, 0), (0, 1), (0, 3), (1, 3))
"""Of each kind of streak the place in `CLOSE`, and the pings in a row, the last before, in which
detections were that close together at a place."""
STEP = 10.0
"""Reach of a target within a ping, m, where none is given."""
BOX_POINTS = 4
"""Points along each side of a larger box that tell what of it clutter is seen in."""
_BOX = np.stack(np.meshgrid(*2 * [2.0 * (np.arange(BOX_POINTS) + 0.5) / BOX_POINTS - 1.0]))
"""Places of these points along and across the box, in half widths."""
EXTENTS = (1.0, 2.0, 4.0, 8.0)
"""Half widths of the smaller boxes, m."""
HULLS = ((16.0, 16.0), (32.0, 8.0), (8.0, 32.0), (32.0, 32.0))
"""Half widths, along and across, of what is too long for a plot: highlights along a hull, m."""
BEAMS = (0.0, 0.03, 0.06)
"""What they have across the line of sight beside, rad."""
WIDEST = 16.0
"""Limit of what a beam adds that is learned, m."""
INSIDE = np.array([3.0, 12.0, 50.0, 200.0])
"""Odds of q over those of p1: the fewer of the detections are clutter, the larger."""
MARGIN = 1.5
"""Factor on the odds of p within which clutter may be denser in the middle of a box."""
MOST_DETECTIONS = 200
"""Detections that are looked at in a ping: bounds the time."""
CLOSE = PlotExtent(4.0, 4.0, 0.03, WIDEST), PlotExtent(16.0, 16.0)
"""Within which detections of a plot, or of a hull, are close together."""
PLAUSIBLE = math.log(100.0)
"""By how much the logarithm of what speaks for a hull may be smaller than for plots: a choice."""
CROWDED = 4.0
"""Area of all larger boxes, in those of the coverage, from which on too little of each is left."""
LEAST_ODDS = 1e-6
LARGEST_ODDS = 1.0
"""Odds of p1 from which on a detection tells too little."""


def unit_of(sensor: SensorModel) -> float:
    """Factor on the lengths of this module for a sensor, at most 1."""
    return min(sensor.max_range / SHORT_RANGE, 1.0)


class DetectionSpacing:
    """Judges from ping to ping how closely detections lie together.

    Parameters
    ----------
    sensor : SensorModel
        Its coverage and resolution.
    target_extent : float
        m; 0: every one of `EXTENTS` is tried, else this one.

    Attributes
    ----------
    log_ratio : float
        Logarithm of the likelihood ratio of several detections a target against clutter.
    last_log_ratio : float
        Logarithm of the largest L of the last ping.
    """

    def __init__(self, sensor: SensorModel, target_extent: float = 0.0) -> None:
        self._sensor, unit = sensor, unit_of(sensor)
        self._outer = unit * OUTER
        cell, beam = sensor.range_resolution, sensor.azimuth_resolution
        beams = ((beam, math.inf),) if beam else tuple((one, unit * WIDEST) for one in BEAMS)
        self._extents = [
            PlotExtent(one + cell, one, *width)
            for one in ((target_extent,) if target_extent else unit * np.array(EXTENTS))
            for width in beams
        ]
        self._plots = len(self._extents)
        if not target_extent:
            self._extents += [PlotExtent(*one) for one in unit * np.array(HULLS)]
        fields = [(one.along, one.across, one.beam, one.widest) for one in self._extents]
        self._along, self._across, self._beam, self._widest = np.array(fields).T
        shape = len(OUTER), len(STREAKS), len(self._extents), len(INSIDE)
        self._log, self._fit = np.full((2, *shape), -np.inf)
        self._streaks = [
            CloseStreaks(changed(extent.scaled(unit), beam=extent.beam)) for extent in CLOSE
        ]
        self._strips = StripCounts((len(OUTER), len(self._extents)))
        self._pings = 0
        self.log_ratio, self.last_log_ratio = -math.inf, 0.0

    @property
    def longest_streak(self) -> int:
        """Pings in a row, the last included, in which detections were close together."""
        return max(one.longest for one in self._streaks)

    @property
    def extent(self) -> PlotExtent:
        """The extent of plots for which most speaks."""
        return self._extents[int(np.argmax(self._evidence[: self._plots]))]

    @property
    def hull_extent(self) -> PlotExtent | None:
        """The extent of hulls for which most speaks; None where far more speaks for plots."""
        evidence = self._evidence
        hulls = evidence[self._plots :]
        if not len(hulls) or hulls.max() < evidence.max() - PLAUSIBLE:
            return None
        return self._extents[self._plots + int(np.argmax(hulls))]

    @property
    def _evidence(self) -> FloatArray:
        """Logarithm of what speaks for each extent, up to a constant.

        By the areas alone: a target's own echoes lie beside boxes that are too small for it.
        """
        return np.asarray(np.logaddexp.reduce(self._fit, axis=(0, 1, 3)))

    def observe(
        self,
        range: FloatArray,
        azimuth: FloatArray,
        position: FloatArray | None = None,
        reach: float = STEP,
        seen: Region | None = None,
    ) -> None:
        """Take the detections of a ping; beyond the coverage they do not count.

        Parameters
        ----------
        range, azimuth : (n,) ndarray
            m and rad.
        position : (n, 2) ndarray, optional
            In the fixed frame, m; by default the sensor stands still.
        reach : float, optional
            How far a target may move from ping to ping, m.
        seen : Region, optional
            Where clutter was seen in the pings before: beyond it, detections do not count either.
        """
        self._pings += 1
        # Adds up to less than 1 over all pings: 1 / (s ln(s + 1)^2), of which the first has 0.6.
        begins = -math.log(self._pings) - 2.0 * math.log(math.log1p(self._pings)) - 1.25
        self._log, self._fit = np.logaddexp(self._log, begins), np.logaddexp(self._fit, begins)
        self.last_log_ratio = 0.0
        if position is None:
            position = np.stack([range * np.cos(azimuth), range * np.sin(azimuth)], axis=1)
        covered = self._sensor.covers(range, azimuth)
        if seen is not None:
            covered &= seen.contains(range, azimuth)
        range, azimuth, position = range[covered], azimuth[covered], position[covered]
        streak = [one.step(range, azimuth, position, reach) for one in self._streaks]
        if len(range) >= 2:
            self._count(range, azimuth, np.stack(streak), seen)
        total = float(np.logaddexp.reduce(self._log, axis=None))
        self.log_ratio = total - math.log(self._log.size)

    def _count(
        self, range: FloatArray, azimuth: FloatArray, streak: IntArray, seen: Region | None
    ) -> None:
        """Multiply the likelihood ratios by those of a ping, with streaks before it (k, n)."""
        rows = self._drawn(azimuth)
        range, azimuth = range[rows], azimuth[rows]
        eligible = np.stack([streak[kind, rows] >= least for kind, least in STREAKS])
        area = self._sensor.coverage_area if seen is None else seen.area
        falls = _falls(_pairs(range, azimuth, self._outer), eligible, area, self._outer)
        if len(falls.earlier):
            larger = self._seen_area(range, azimuth, falls, seen)
            increments = self._increments(range, azimuth, falls, larger)
            first = np.flatnonzero(np.diff(falls.test, prepend=-1))
            for log, increment in zip((self._fit, self._log), increments, strict=True):
                tests, change = log.reshape(-1, *log.shape[2:]), np.add.reduceat(increment, first)
                tests[falls.test[first]] += change
            self.last_log_ratio = float(change.max(initial=0.0))

    def _seen_area(
        self, range: FloatArray, azimuth: FloatArray, falls: _Falls, seen: Region | None
    ) -> FloatArray:
        """Area of the larger box of each fall, as far as seen, (f,), m^2."""
        size = falls.test // len(STREAKS)
        boxes, box = np.unique(size * len(range) + falls.earlier, return_inverse=True)
        size, row = np.divmod(boxes, len(range))
        range, azimuth, half = range[row], azimuth[row], self._outer[size]
        area = self._area(range, azimuth, half, half)
        if seen is not None:
            area *= _seen_share(seen, range, azimuth, half)
        return area[box]

    def _drawn(self, azimuth: FloatArray) -> IntArray:
        """Detections in random order, of many only those of a wedge.

        The order is the same in every run.
        """
        rng = np.random.default_rng(self._pings)
        if len(azimuth) <= MOST_DETECTIONS:
            return rng.permutation(len(azimuth))
        first = rng.integers(len(azimuth) - MOST_DETECTIONS + 1)
        wedge = np.argsort(azimuth, kind="stable")[first : first + MOST_DETECTIONS]
        return rng.permutation(wedge)

    def _increments(
        self, range: FloatArray, azimuth: FloatArray, falls: _Falls, larger: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Logarithm of L of each fall into a box of an area (f,), by extent and q, (f, e, q).

        With the odds of p by the areas alone, and of clutter that may lie on arcs and rays.
        """
        size = falls.test // len(STREAKS)
        earlier, outer = falls.earlier, self._outer[size][:, None]
        centre, angle = range[earlier][:, None], azimuth[earlier][:, None]
        left = (larger - falls.crowd)[:, None]
        widest = np.minimum(centre * self._beam, self._widest)
        reach, reach_across = self._along, self._across + widest
        inner = self._area(centre, angle, reach, reach_across)
        odds = MARGIN * inner / np.maximum(left - inner, LEAST_ODDS * outer**2)
        near = falls.along[:, None] <= reach, falls.across[:, None] <= reach_across
        shares = np.minimum(reach / outer, 1.0), np.minimum(reach_across / outer, 1.0)
        self._strips.count(size, near, shares)
        hit = near[0] & near[1]
        used = (reach < outer) & (reach_across < outer) & (outer <= centre)
        concentrated = odds * self._strips.concentration[size]
        return _log_ratio(hit, used, odds), _log_ratio(hit, used, concentrated)

    def _area(
        self, range: FloatArray, azimuth: FloatArray, along: FloatArray, across: FloatArray
    ) -> FloatArray:
        """Area of boxes of half widths (...) around places (...), as far as covered, m^2."""
        sensor = self._sensor
        near = np.maximum(range - along, sensor.min_range)
        far = np.minimum(range + along, sensor.max_range)
        half = np.minimum(across / range, np.pi)
        width = 2.0 * half
        if not sensor.all_round:
            middle = sensor.azimuth_min + 0.5 * sensor.sector_width
            turn = np.abs(wrap(azimuth - middle))
            low = np.maximum(turn - half, -0.5 * sensor.sector_width)
            high = np.minimum(turn + half, 0.5 * sensor.sector_width)
            width = np.maximum(high - low, 0.0)
        area: FloatArray = 0.5 * np.maximum(far**2 - near**2, 0.0) * width
        return area


def _log_ratio(hit: BoolArray, used: BoolArray, odds: FloatArray) -> FloatArray:
    """Logarithm of L of each fall and extent (f, e), by q, (f, e, q); 0 where it is not used."""
    # q / p1 and (1 - q) / (1 - p1) of odds that are `INSIDE` times as large.
    beside = (1.0 + odds[..., None]) / (1.0 + INSIDE * odds[..., None])
    ratio = np.where(hit[..., None], INSIDE * beside, beside)
    counts = used & (odds < LARGEST_ODDS)
    return np.asarray(np.log(np.where(counts[..., None], ratio, 1.0)))


class _Pairs(NamedTuple):
    """Pairs of detections whose larger boxes may overlap, and how far they are apart, m.

    By the later detection, then by the earlier.
    """

    earlier: IntArray
    later: IntArray
    along: FloatArray
    across: FloatArray


class _Falls(NamedTuple):
    """Detections that fall into the larger box of an earlier one, and the earliest such, (f,) each.

    Attributes
    ----------
    test : ndarray of int
        Place in `OUTER` times the number of `STREAKS`, and place in these; ascending.
    earlier : ndarray of int
        The earlier detection.
    along, across : ndarray
        How far they are apart along and across the line of sight, m.
    crowd : ndarray
        What of the earlier one's box is left out as that of yet earlier ones, m^2.
    """

    test: IntArray
    earlier: IntArray
    along: FloatArray
    across: FloatArray
    crowd: FloatArray


def _pairs(range: FloatArray, azimuth: FloatArray, outer: FloatArray) -> _Pairs:
    places = np.stack([range * np.cos(azimuth), range * np.sin(azimuth)], axis=1)
    earlier, later = pairs_nearer(places, 2.0 * math.sqrt(2.0) * outer.max())
    order = np.lexsort((earlier, later))
    earlier, later = earlier[order], later[order]
    along = np.abs(range[earlier] - range[later])
    middle = 0.5 * (range[earlier] + range[later])
    across = middle * np.abs(wrap(azimuth[earlier] - azimuth[later]))
    return _Pairs(earlier, later, along, across)


def _falls(pairs: _Pairs, eligible: BoolArray, area: float, outer: FloatArray) -> _Falls:
    """Falls into the boxes of the detections that are eligible by each kind of streak, (s, n).

    Of tests whose boxes are not too many for the area (m^2) where clutter is seen.
    """
    number, n = eligible.sum(axis=1), eligible.shape[1]
    possible = (number > 0) & (number * (2.0 * outer[:, None]) ** 2 <= CROWDED * area)
    size, kind = possible.nonzero()
    width = 2.0 * outer[size][:, None]
    near = (pairs.along < width) & (pairs.across < width) & eligible[kind][:, pairs.earlier]
    tried, pair = near.nonzero()
    along, across, half = pairs.along[pair], pairs.across[pair], outer[size[tried]]
    earlier, later = pairs.earlier[pair], pairs.later[pair]
    both = eligible[kind[tried], later]
    shared = (2.0 * half - along) * (2.0 * half - across)
    place = tried * n + later
    crowd = np.asarray(np.bincount(place[both], shared[both], minlength=len(size) * n), float)
    inside = np.flatnonzero((along <= half) & (across <= half))
    inside = inside[np.flatnonzero(np.diff(place[inside], prepend=-1))]
    tried, earlier = tried[inside], earlier[inside]
    test = (size * len(STREAKS) + kind)[tried]
    return _Falls(test, earlier, along[inside], across[inside], crowd[tried * n + earlier])


def _seen_share(
    seen: Region, range: FloatArray, azimuth: FloatArray, half: FloatArray
) -> FloatArray:
    """Share of boxes of half widths (m) around places in which clutter is seen, (n,) each."""
    along, across = _BOX.reshape(2, 1, -1) * half[:, None]
    range, azimuth = range[:, None], azimuth[:, None]
    inside = seen.contains(np.maximum(range + along, 0.0), azimuth + across / range)
    return np.asarray(inside.mean(axis=1))


SCATTER_MEMORY = 50.0
"""Plots of several detections a ping that count: older ones fade."""
SCATTER_PRIOR = 0.5
"""Degrees of freedom for which the extent counts before anything is seen: v = extent^2 / 12, and
all error common to the ping."""
TRIPLES = 6.0
"""Degrees of freedom of plots of three and more from which on pairs do not count.

Detections of clutter are next to others by chance, and rarely in threes.
"""


@dataclass(frozen=True)
class EchoScatter:
    """Sums over the plots seen, for those of two detections and of more.

    Attributes
    ----------
    freedom : (2,) ndarray
        Degrees of freedom, ``sum (m - 1)``.
    plots : (2,) ndarray
        Number of plots.
    square : (2, 2) ndarray
        Squared deviations along and across, m^2.
    error : (2, 2) ndarray
        ``sum (m - 1) s^2`` along and across, m^2.
    """

    freedom: FloatArray
    plots: FloatArray
    square: FloatArray
    error: FloatArray

    @classmethod
    def nothing(cls) -> EchoScatter:
        """Before the first plot."""
        return cls(np.zeros(2), np.zeros(2), np.zeros((2, 2)), np.zeros((2, 2)))

    def after(self, scan: Scan, label: IntArray, sensor: SensorModel) -> EchoScatter:
        """With the plots of one more ping: detections and the group of each, (n,)."""
        _, first, group = np.unique(label, return_index=True, return_inverse=True)
        size = np.asarray(np.bincount(group), float)
        turn = wrap(scan.azimuth - scan.azimuth[first][group])
        own = scan.range_std
        range_variance = sensor.range_variance(scan.range) if own is None else own**2
        angle = sensor.azimuth_std if scan.azimuth_std is None else scan.azimuth_std
        kind = np.where(size == 2, 0, 1)

        def sums(values: FloatArray) -> FloatArray:
            """Over the plots of two, and of more, of values (p,)."""
            several = size > 1
            return np.asarray(np.bincount(kind[several], values[several], minlength=2), float)

        def mean(values: FloatArray) -> FloatArray:
            return np.asarray(np.bincount(group, values) / size)

        along = scan.range - mean(scan.range)[group]
        across = scan.range * (turn - mean(turn)[group])
        squares = [
            sums(np.asarray(np.bincount(group, apart**2), float)) for apart in (along, across)
        ]
        errors = [
            sums((size - 1) * mean(variance))
            for variance in (range_variance, (scan.range * angle) ** 2)
        ]
        kept = 1.0 - 1.0 / SCATTER_MEMORY
        return replace(
            self,
            freedom=kept * self.freedom + sums(size - 1.0),
            plots=kept * self.plots + sums(np.ones(len(size))),
            square=kept * self.square + np.stack(squares, axis=1),
            error=kept * self.error + np.stack(errors, axis=1),
        )

    @property
    def _counted(self) -> FloatArray:
        """Weight of the plots of two, and of more."""
        return np.array([self.freedom[1] < TRIPLES, 1.0])

    @property
    def mean_size(self) -> float:
        """Mean number of detections of a plot that has several."""
        weight = self._counted
        plots = max(float(weight @ self.plots), 1e-9)
        return 1.0 + float(weight @ self.freedom) / plots

    def errors(self, extent: PlotExtent) -> EchoErrors:
        """The errors of targets of an extent: f and v that solve both means, if f is possible."""
        weight = self._counted
        start = extent.along**2 / 12.0
        freedom = weight @ self.freedom + SCATTER_PRIOR
        found = (weight @ self.square + SCATTER_PRIOR * start) / freedom
        error = weight @ self.error / freedom
        apart = error[1] - error[0]
        independent = 0.0
        if abs(apart) > 1e-12:
            independent = float(np.clip((found[1] - found[0]) / apart, 0.0, 1.0))
        # The smaller scatter tells more precisely what is left for the extent.
        left = (found - independent * error) / np.maximum(found, 1e-12) ** 2
        total = (1.0 / np.maximum(found, 1e-12) ** 2).sum()
        return EchoErrors(independent, max(float(left.sum() / total), 0.0))
