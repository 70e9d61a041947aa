"""Whether targets have several detections a ping, told by how closely detections lie together.

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

The larger boxes are cut to the coverage and to where clutter is seen, and where they overlap those
of earlier detections, the next detection counts for the earliest only: of the later one's box that
part is left out (the union bound, which makes p larger).

A target is where it was a ping ago, within its reach. The earlier detections may therefore be only
those where detections were close together in each of the last `STREAKS` pings. What is chosen by
the pings before leaves the product a supermartingale; in dense clutter it leaves few detections
beside a target's.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from tsepm_ros.environment.close_streaks import CloseStreaks
from tsepm_ros.environment.seen_extent import Region
from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray
from tsepm_ros.numerics.discs import pairs_nearer
from tsepm_ros.sensing.plots import PlotExtent
from tsepm_ros.sensing.scan import wrap
from tsepm_ros.sensing.sensor import SensorModel

OUTER = (12.0, 24.0, 48.0, 96.0)
"""Half widths of the larger boxes, m: far below the scale on which clutter changes."""
STREAKS = ((0, 0), (0, 1), (0, 3), (1, 3))
"""Of each kind of streak the place in `CLOSE`, and the pings in a row, the last before, in which
detections were that close together at a place."""
STEP = 10.0
"""Reach of a target within a ping, m, where none is given."""
BOX_POINTS = 4
"""Points along each side of a larger box that tell what of it clutter is seen in."""
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


class DetectionSpacing:
    """Judges from ping to ping how closely detections lie together.

    Parameters
    ----------
    sensor : SensorModel
        Its coverage and resolution.
    target_extent : float
        m; 0: every one of `EXTENTS` is tried, else this one.
    """

    def __init__(self, sensor: SensorModel, target_extent: float = 0.0) -> None:
        self._sensor = sensor
        cell, beam = sensor.range_resolution, sensor.azimuth_resolution
        beams = ((beam, math.inf),) if beam else tuple((one, WIDEST) for one in BEAMS)
        self._extents = [
            PlotExtent(one + cell, one, *width)
            for one in ((target_extent,) if target_extent else EXTENTS)
            for width in beams
        ]
        self._plots = len(self._extents)
        if not target_extent:
            self._extents += [PlotExtent(*one) for one in HULLS]
        fields = [(one.along, one.across, one.beam, one.widest) for one in self._extents]
        self._along, self._across, self._beam, self._widest = np.array(fields).T
        shape = len(OUTER), len(STREAKS), len(self._extents), len(INSIDE)
        self._log = np.full(shape, -np.inf)
        self._streaks = [CloseStreaks(extent) for extent in CLOSE]
        self._pings = 0

    @property
    def log_ratio(self) -> float:
        """Logarithm of the likelihood ratio of several detections a target against clutter."""
        return float(np.logaddexp.reduce(self._log, axis=None)) - math.log(self._log.size)

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
        """Logarithm of what speaks for each extent, up to a constant."""
        return np.asarray(np.logaddexp.reduce(self._log, axis=(0, 1, 3)))

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
        self._log = np.logaddexp(self._log, begins)
        if position is None:
            position = np.stack([range * np.cos(azimuth), range * np.sin(azimuth)], axis=1)
        covered = self._sensor.covers(range, azimuth)
        if seen is not None:
            covered &= seen.contains(range, azimuth)
        range, azimuth, position = range[covered], azimuth[covered], position[covered]
        streak = [one.step(range, azimuth, position, reach) for one in self._streaks]
        if len(range) < 2:
            return
        rows = self._drawn(azimuth)
        range, azimuth = range[rows], azimuth[rows]
        eligible = [streak[kind][rows] >= least for kind, least in STREAKS]
        pairs = _pairs(range, azimuth)
        area = self._sensor.coverage_area if seen is None else seen.area
        for place, outer in enumerate(OUTER):
            near = pairs.within(2.0 * outer)
            if not len(near.later):
                continue
            larger: FloatArray | None = None
            for row, chosen in enumerate(eligible):
                number = int(np.count_nonzero(chosen))
                if not number or number * (2.0 * outer) ** 2 > CROWDED * area:
                    continue
                falls = _falls(near, chosen, outer)
                if not len(falls.place):
                    continue
                if larger is None:
                    larger = self._seen_area(range, azimuth, outer, near.earlier, seen)
                self._log[place, row] += self._increments(range, azimuth, falls, outer, larger)

    def _seen_area(
        self,
        range: FloatArray,
        azimuth: FloatArray,
        half: float,
        rows: IntArray,
        seen: Region | None,
    ) -> FloatArray:
        """Area of the boxes of a half width around some rows, as far as seen, (n,), m^2."""
        area = np.zeros(len(range))
        used = np.zeros(len(range), bool)
        used[rows] = True
        range, azimuth = range[used], azimuth[used]
        boxes = self._area(range, azimuth, np.array(half), np.array(half))
        area[used] = boxes if seen is None else boxes * _seen_share(seen, range, azimuth, half)
        return area

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
        self,
        range: FloatArray,
        azimuth: FloatArray,
        falls: _Falls,
        outer: float,
        larger: FloatArray,
    ) -> FloatArray:
        """Logarithms of L for the larger boxes of a half width and areas (n,), by extent and q."""
        _, earlier, along, across, crowd = falls
        centre, angle = range[earlier][:, None], azimuth[earlier][:, None]
        left = (larger[earlier] - crowd)[:, None]
        widest = np.minimum(centre * self._beam, self._widest)
        reach, reach_across = self._along, self._across + widest
        inner = self._area(centre, angle, reach, reach_across)
        odds = MARGIN * inner / np.maximum(left - inner, LEAST_ODDS * outer**2)
        hit = (along[:, None] <= reach) & (across[:, None] <= reach_across)
        used = (reach < outer) & (reach_across < outer) & (odds < LARGEST_ODDS)
        # q / p1 and (1 - q) / (1 - p1) of odds that are `INSIDE` times as large.
        beside = (1.0 + odds[..., None]) / (1.0 + INSIDE * odds[..., None])
        ratio = np.where(hit[..., None], INSIDE * beside, beside)
        increments: FloatArray = np.log(np.where(used[..., None], ratio, 1.0)).sum(axis=0)
        return increments

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


class _Pairs(NamedTuple):
    """Pairs of detections whose larger boxes may overlap, and how far they are apart, m."""

    earlier: IntArray
    later: IntArray
    along: FloatArray
    across: FloatArray

    def within(self, limit: float) -> _Pairs:
        """Those nearer than a limit on both axes."""
        near = (self.along < limit) & (self.across < limit)
        return _Pairs(self.earlier[near], self.later[near], self.along[near], self.across[near])


class _Falls(NamedTuple):
    """Detections that fall into the larger box of an earlier one, and the earliest such.

    How far they are apart along and across the line of sight (m), and what of the earlier one's
    box is left out as that of yet earlier ones (m^2).
    """

    place: IntArray
    earlier: IntArray
    along: FloatArray
    across: FloatArray
    crowd: FloatArray


def _pairs(range: FloatArray, azimuth: FloatArray) -> _Pairs:
    places = np.stack([range * np.cos(azimuth), range * np.sin(azimuth)], axis=1)
    earlier, later = pairs_nearer(places, 2.0 * math.sqrt(2.0) * max(OUTER))
    along = np.abs(range[earlier] - range[later])
    middle = 0.5 * (range[earlier] + range[later])
    across = middle * np.abs(wrap(azimuth[earlier] - azimuth[later]))
    return _Pairs(earlier, later, along, across)


def _falls(pairs: _Pairs, eligible: BoolArray, outer: float) -> _Falls:
    """Falls into the boxes of the eligible detections (n,), of a half width (m)."""
    kept = eligible[pairs.earlier]
    earlier, place = pairs.earlier[kept], pairs.later[kept]
    along, across = pairs.along[kept], pairs.across[kept]
    both = eligible[place]
    shared = np.maximum(2.0 * outer - along, 0.0) * np.maximum(2.0 * outer - across, 0.0)
    crowd = np.asarray(np.bincount(place[both], shared[both], minlength=len(eligible)), float)
    inside = np.flatnonzero((along <= outer) & (across <= outer))
    inside = inside[np.lexsort((earlier[inside], place[inside]))]
    place, first = np.unique(place[inside], return_index=True)
    inside = inside[first]
    earlier = earlier[inside]
    return _Falls(place, earlier, along[inside], across[inside], crowd[earlier])


def _seen_share(seen: Region, range: FloatArray, azimuth: FloatArray, half: float) -> FloatArray:
    """Share of boxes around places (n,) in which clutter is seen, (n,)."""
    range, azimuth = range[:, None], azimuth[:, None]
    steps = half * (2.0 * (np.arange(BOX_POINTS) + 0.5) / BOX_POINTS - 1.0)
    along, across = (part.ravel() for part in np.meshgrid(steps, steps))
    inside = seen.contains(np.maximum(range + along, 0.0), azimuth + across / range)
    return np.asarray(inside.mean(axis=1))
