"""Tests for several detections of one target in a ping, and their dispersion.

Whether targets have several detections a ping: what lies beside detections, and beside those of
confirmed tracks.

In boxes of several sizes along and across the line of sight, N detections are counted where the
clutter explains E: its mean density times the area, or as many as lie in two strips of the box's
area beside it, and before and behind it. Clutter that is dense in some place, on an arc or on a ray
fills a strip, too; the echoes of one target do not. Both counts fade. The logarithm of the
likelihood ratio of Poisson counts is::

    L = N ln(N / (MARGIN E)) - (N - MARGIN E)        N > MARGIN E

Targets have several detections once L is at least `LOG_RATIO` in some box, of the sum of two
counts:

- beside the detections of confirmed tracks: one a ping may be a second target's and does not
  count, unless it lies now on one side and now on the other. With m the mean offset over n pings, a
  the half width of the box and R the variance of the offset of two detections::

    on one side   n m' R^-1 m > SIDE
    resolved      n a^2 / R >= RESOLVED  and  a^2 / R >= CLEAR,  along and across

  What is resolved and not on one side counts whole. What is on one side does not count;
- beyond the largest box around these, beside every detection: of m detections in a box m - 2
  count, each member's part being (m - 2) / m. Two detections may be two targets.

The extent is that of the box of the largest L, with pairs that count (m - 1) / m of each member of
a group, and a ratio of at most `LARGEST`: a box that is too small misses some, one that is too
large has more clutter.

How the detections of one target and ping scatter: what is error, and what is extent.

Within plots of m detections the sums of squared deviations along and across the line of sight have
the means ``(m - 1) (f s^2 + v)``, see `grouping`. The sensor's variance s^2 differs
between the two; the variance v of where on the target the detections arise does not.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray
from tsepm_ros.numerics.discs import pairs_between
from tsepm_ros.tracker.clusters import grouping
from tsepm_ros.tracker.clusters.grouping import ClusterErrors, ClusterExtent
from tsepm_ros.tracker.clutter.excess import Excess
from tsepm_ros.tracker.scan import Scan, wrap
from tsepm_ros.tracker.sensor import SensorModel

SHORT_RANGE = 100.0
"""Range below which every length here is as much shorter, m: a tank or a room is no sea."""
EXTENTS = (1.0, 2.0, 4.0, 8.0, 16.0)
"""Half widths of the boxes, m."""
BEAMS = (0.0, 0.03, 0.06)
"""What the boxes have across the line of sight beside, rad."""
WIDEST = 16.0
"""Limit of what a beam adds that is learned, m."""
MEMORY = 100.0
"""Pings that count: older ones fade."""
_KEPT = 1.0 - 1.0 / MEMORY
MARGIN = 1.5
"""Factor within which clutter around a track may be denser than it is known: a choice."""
PRIOR = 0.1
"""Detections in the strips beside those that are counted."""
LOG_RATIO = math.log(1e6)
"""Logarithm of the likelihood ratio of several detections a target at which plots are made."""
LEAST = 1e-3
"""Pairs of clutter that are expected at least."""
LARGEST = 20.0
"""Ratio of counts to clutter beyond which smaller boxes are no better: a choice."""
SIDE = 9.21
"""Squared distance of a mean offset from 0: chi-square of two degrees of freedom at 0.99."""
RESOLVED = 20.0
"""Squared distance at which a target at the border of a box would have shown."""
CLEAR = 4.0
"""Squared half width of a box, in variances of an offset, from which on two detections count."""
SUSPICION = math.log(5.0)
"""L from which on second starts beside tracks wait: a choice."""
MOST_LOOKS = 5
"""Pings of a track within which second starts beside it wait while one ping after the other has
others beside it, more than clutter explains, if it shows by then whether these are a second
target's: a choice."""
MOST_CENTRES = 300
"""Detections of a ping beside which others are counted, neighbours in azimuth: bounds the time."""


def track_record(sizes: int) -> np.dtype[np.void]:
    """What lay beside the detections of a track: its record, for a number e of sizes of boxes.

    track_id; looks: pings with a detection; pings (e,): those with others beside it; offset
    (2, e): sum of the mean offsets of these along and across, m; decided: whether these, as far as
    the last ping shows, are of no second target.
    """
    return np.dtype(
        [
            *(("track_id", np.int64), ("looks", float), ("decided", bool)),
            *(("pings", float, (sizes,)), ("offset", float, (2, sizes))),
        ]
    )


def unit_of(sensor: SensorModel) -> float:
    """Factor on the lengths of this module for a sensor, at most 1."""
    return min(sensor.max_range / SHORT_RANGE, 1.0)


def extents_of(sensor: SensorModel) -> FloatArray:
    """The fields of `ClusterExtent` of each box, (4, e, 1), with the resolution of a sensor."""
    unit, cell, beam = unit_of(sensor), sensor.range_resolution, sensor.azimuth_resolution
    beams = ((beam, math.inf),) if beam else tuple((one, unit * WIDEST) for one in BEAMS)
    boxes = [(unit * one + cell, unit * one, *width) for one in EXTENTS for width in beams]
    return np.transpose(boxes)[..., None]


class Beside:
    """Detections in boxes around centres, by size of box and centre, (e, k) each.

    Attributes
    ----------
    number : ndarray
        Others in the box.
    strips : (2, e, k) ndarray
        Those in the strips of the same area beside it, and before and behind it.
    offset : (2, e, k) ndarray
        Mean of the others' offsets along and across, m.
    area : ndarray
        Of the box, m^2; 0 where it reaches the sensor.
    along, across : ndarray
        Half widths, m.
    near : (n,) ndarray of bool
        Detections in the largest box around some centre.
    """

    def __init__(self, scan: Scan, centre: IntArray, extents: FloatArray) -> None:
        range_, azimuth, k = scan.range[centre], scan.azimuth[centre], len(centre)
        self.across = ClusterExtent(*extents).across_at(range_)
        self.along = np.broadcast_to(extents[0], self.across.shape)
        # A distance is at most that along and that across.
        reach = 3.0 * (self.along.max(initial=0.0) + self.across.max(initial=0.0))
        places = grouping.in_sensor_frame(scan.range, scan.azimuth)
        row, other = pairs_between(places[centre], places, reach)
        far = scan.range[other] - range_[row]
        aside = range_[row] * wrap(scan.azimuth[other] - azimuth[row])
        near = (
            (np.abs(far) <= 3.0 * self.along.max(axis=0)[row])
            & (np.abs(aside) <= 3.0 * self.across.max(axis=0)[row])
            & (other != centre[row])
        )
        row, other, far, aside = row[near], other[near], far[near], aside[near]
        depth = np.abs(far) / self.along[:, row]
        width = np.abs(aside) / self.across[:, row]
        inside = (depth <= 1.0) & (width <= 1.0)
        self.near = np.zeros(len(scan), bool)
        self.near[centre] = self.near[other[inside[-1]]] = True
        beside = (depth <= 1.0) & (width > 2.0) & (width <= 3.0)
        behind = (width <= 1.0) & (depth > 2.0) & (depth <= 3.0)
        parts = np.stack([inside, beside, behind, inside * far, inside * aside])
        sums = _sums(np.asarray(parts, float), row, k)
        self.number, self.strips = sums[0], sums[1:3]
        self.offset = sums[3:] / np.maximum(self.number, 1.0)
        self.area = np.where(
            np.maximum(self.along, self.across) < range_, 4.0 * self.along * self.across, 0.0
        )


def log_ratio(
    found: FloatArray | float, expected: FloatArray | float, largest: float = math.inf
) -> FloatArray:
    """L of counts, (e,), for an excess of at most a largest ratio."""
    mean = MARGIN * expected
    excess = np.clip(found / mean, 1.0, largest)
    return np.asarray(found * np.log(excess) - mean * (excess - 1.0))


def beyond_one(number: FloatArray, one: FloatArray | float = 1.0) -> FloatArray:
    """Detections of a group beyond two, each member's part, from the number beside each."""
    return np.maximum(number - one, 0.0) / (number + 1.0)


class MultiDetectionTest:
    """Counts the detections beside others, and beside those of confirmed tracks.

    Parameters
    ----------
    sensor : SensorModel
        Its accuracy, resolution and range.
    """

    def __init__(self, sensor: SensorModel) -> None:
        self._sensor = sensor
        self._extents = extents_of(sensor)
        sizes = self._extents.shape[1]
        self._pairs = Excess(*np.zeros((2, sizes)))
        # Expected by the area, and in the strips of both kinds: the largest counts.
        self._more = self._before = self._groups = Excess(np.zeros(sizes), np.zeros((3, sizes)))
        self._tracks = np.zeros(0, track_record(sizes))

    @property
    def log_ratio(self) -> float:
        """The largest L."""
        return _largest(self._more)

    @property
    def crowded(self) -> bool:
        """Whether groups are suspicious whatever tracks they are beside."""
        return _largest(self._groups) >= SUSPICION

    @property
    def extent(self) -> ClusterExtent:
        """Half widths of the box for which most speaks, by the areas alone."""
        ratios = log_ratio(self._pairs.counted, self._pairs.expected + LEAST, LARGEST)
        return ClusterExtent(*self._extents[:, np.argmax(ratios), 0].tolist())

    def waits(self, track_id: IntArray) -> BoolArray:
        """Whether second starts beside each track wait, (h,)."""
        tracks = self._tracks[self._tracks["decided"] | (self._tracks["looks"] > MOST_LOOKS)]
        return (self.log_ratio >= SUSPICION) | ~np.isin(track_id, tracks["track_id"])

    def update(self, scan: Scan, density: float) -> None:
        """Count the detections of a ping beside each other.

        Parameters
        ----------
        scan : Scan
            n detections.
        density : float
            Mean clutter density, 1/m^2.
        """
        beside = self._beside_each_other(scan)
        some = beside.number / (beside.number + 1.0)
        group = (beside.area > 0.0) & (beside.number[-1] > 1.0)
        expected = 0.5 * density * (group * beside.area).sum(axis=1)
        self._pairs = self._pairs.faded(_KEPT, (group * some).sum(axis=1), expected)
        self._before, groups = self._more, _beyond_two(beside, density)
        self._more = self._before.faded(_KEPT, groups.counted, groups.expected)
        self._groups = self._groups.faded(_KEPT, groups.counted, groups.expected)

    def update_tracks(
        self, scan: Scan, density: float, track_id: IntArray, own: IntArray, held: IntArray
    ) -> None:
        """Count what lies beside the detections of tracks instead, in the ping of `update`.

        Beyond the largest box around these, detections count beside each other.

        Parameters
        ----------
        scan : Scan
            n detections.
        density : float
            Mean clutter density, 1/m^2.
        track_id, own : (k,) ndarray of int
            Tracks, and the detection of each.
        held : (h,) ndarray of int
            Ids of all tracks that are held.
        """
        self._tracks = self._tracks[np.isin(self._tracks["track_id"], held)]
        if not len(own):
            return
        beside = Beside(scan, own, self._extents)
        variance = 2.0 * error_variances(scan, self._sensor)[:, own]
        least = np.minimum(beside.along**2 / variance[0], beside.across**2 / variance[1]).T
        tracks = np.zeros(len(own), self._tracks.dtype)
        _, row, known = np.intersect1d(track_id, self._tracks["track_id"], return_indices=True)
        tracks[row] = self._tracks[known]
        number, pings = beside.number.T, tracks["pings"]
        tracks["track_id"] = track_id
        tracks["looks"] += 1.0
        pings += number > 0.0
        tracks["offset"] += beside.offset.transpose(2, 0, 1)
        squares = (tracks["offset"] ** 2 / variance.T[..., None]).sum(axis=1)
        one_side = squares / np.maximum(pings, 1.0) > SIDE
        resolved = (pings * least >= RESOLVED) & (least >= CLEAR)
        # As long as these may be a second target's, one a ping does not count.
        found = np.where(one_side, 0.0, np.maximum(number - ~resolved, 0.0))
        looks = tracks["looks"][:, None]
        chance = LEAST - np.expm1(-density * beside.area.T)
        by_chance = log_ratio(pings, looks * chance) < SUSPICION
        often = (pings > 0.5 * looks) & ~one_side & ~by_chance
        tracks["decided"] = ~(often & (MOST_LOOKS * least >= RESOLVED)).any(axis=1)
        self._tracks = np.append(np.delete(self._tracks, known), tracks)
        used = beside.area > 0.0
        rest = grouping.chosen(scan, np.flatnonzero(~beside.near))
        groups = _beyond_two(self._beside_each_other(rest), density)
        self._more = self._before.faded(
            _KEPT,
            (used * found.T).sum(axis=1) + groups.counted,
            np.stack([density * beside.area.sum(axis=1), *(used * beside.strips).sum(axis=2)])
            + groups.expected,
        )

    def _beside_each_other(self, scan: Scan) -> Beside:
        """What lies beside each detection of a scan, or of those in some sector."""
        centre = np.argsort(scan.azimuth, kind="stable")
        first = int(7919 * scan.stamp) % max(len(centre) - MOST_CENTRES + 1, 1)
        return Beside(scan, centre[first : first + MOST_CENTRES], self._extents)


def _largest(more: Excess) -> float:
    """The largest L of counts, by size of box."""
    prior = np.array([[0.0], [PRIOR], [PRIOR]])
    return float(log_ratio(more.counted, (more.expected + prior).max(axis=0)).max())


def _beyond_two(beside: Beside, density: float) -> Excess:
    """Detections of groups beyond two, by size of box, and those that clutter explains."""
    used, mean = beside.area > 0.0, beside.area * density
    more = (mean + np.expm1(-mean)) / 3.0
    strips = (used * beyond_one(beside.strips)).sum(axis=2)
    found = (used * beyond_one(beside.number)).sum(axis=1)
    return Excess(found, np.stack([more.sum(axis=1), *strips]))


def error_variances(scan: Scan, sensor: SensorModel) -> FloatArray:
    """Variances of a scan's detections along and across the line of sight, (2, n), m^2."""
    along, angle = sensor.range_variance(scan.range), np.full(len(scan), sensor.azimuth_std)
    if scan.range_std is not None:
        along = scan.range_std**2
    if scan.azimuth_std is not None:
        angle = scan.azimuth_std
    return np.stack([along, (angle * scan.range) ** 2])


SCATTER_MEMORY = 50.0
"""Plots of several detections a ping that count: older ones fade."""
SCATTER_PRIOR = 0.5
"""Degrees of freedom for which the extent counts before anything is seen: v = extent^2 / 12, and
all error common to the ping."""
TRIPLES = 6.0
"""Degrees of freedom of plots of three and more from which on pairs do not count.

Detections of clutter are next to others by chance, and rarely in threes.
"""


def _sums(values: FloatArray, group: IntArray, count: int) -> FloatArray:
    """Sums of values (..., n) over the rows of each group (n,), ascending, (..., count)."""
    first = np.searchsorted(group, np.arange(count + 1))
    # The sum of an empty group is its first value here.
    with_end = np.append(values, np.zeros((*values.shape[:-1], 1)), axis=-1)
    sums = np.add.reduceat(with_end, first[:-1], axis=-1)
    return np.asarray(np.where(np.diff(first) > 0, sums, 0.0))


@dataclass(frozen=True)
class ClusterDispersion:
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
    def nothing(cls) -> ClusterDispersion:
        """Before the first plot."""
        return cls(np.zeros(2), np.zeros(2), np.zeros((2, 2)), np.zeros((2, 2)))

    def after(self, scan: Scan, label: IntArray, sensor: SensorModel) -> ClusterDispersion:
        """With the plots of one more ping: detections and the group of each, (n,)."""
        _, first, group = np.unique(label, return_index=True, return_inverse=True)
        size = np.asarray(np.bincount(group), float)
        turn = wrap(scan.azimuth - scan.azimuth[first][group])
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
        errors = [sums((size - 1) * mean(variance)) for variance in error_variances(scan, sensor)]
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
        return 1.0 + float(weight @ self.freedom) / max(float(weight @ self.plots), 1e-9)

    def errors(self, extent: ClusterExtent) -> ClusterErrors:
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
        return ClusterErrors(independent, max(float(left.sum() / total), 0.0))
