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

The larger boxes are cut to the coverage, and where they overlap those of earlier detections, the
next detection counts for the earliest only: of the later one's box that part is left out (the union
bound, which makes p larger).
"""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial import cKDTree

from tsepm_ros.numerics.arrays import FloatArray, IntArray
from tsepm_ros.sensing.plots import PlotExtent
from tsepm_ros.sensing.scan import wrap
from tsepm_ros.sensing.sensor import SensorModel

OUTER = (12.0, 24.0)
"""Half widths of the larger boxes, m: far below the scale on which clutter changes."""
EXTENTS = (1.0, 2.0, 4.0, 8.0)
"""Half widths of the smaller boxes, m."""
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
        fields = [(one.along, one.across, one.beam, one.widest) for one in self._extents]
        self._along, self._across, self._beam, self._widest = np.array(fields).T
        self._log = np.full((len(OUTER), len(self._extents), len(INSIDE)), -np.inf)
        self._pings = 0

    @property
    def log_ratio(self) -> float:
        """Logarithm of the likelihood ratio of several detections a target against clutter."""
        return float(np.logaddexp.reduce(self._log, axis=None)) - math.log(self._log.size)

    @property
    def extent(self) -> PlotExtent:
        """The extent for which most speaks."""
        evidence = np.logaddexp.reduce(self._log, axis=(0, 2))
        return self._extents[int(np.argmax(evidence))]

    def observe(self, range: FloatArray, azimuth: FloatArray) -> None:
        """Take the detections of a ping, (n,) m and rad; beyond the coverage they do not count."""
        self._pings += 1
        # Adds up to less than 1 over all pings: 1 / (s ln(s + 1)^2), of which the first has 0.6.
        begins = -math.log(self._pings) - 2.0 * math.log(math.log1p(self._pings)) - 1.25
        self._log = np.logaddexp(self._log, begins)
        covered = self._sensor.covers(range, azimuth)
        range, azimuth = range[covered], azimuth[covered]
        if len(range) < 2:
            return
        rows = self._drawn(azimuth)
        range, azimuth = range[rows], azimuth[rows]
        for place, outer in enumerate(OUTER):
            self._log[place] += self._increments(range, azimuth, outer)

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

    def _increments(self, range: FloatArray, azimuth: FloatArray, outer: float) -> FloatArray:
        """Logarithms of L for the larger boxes of a half width, by extent and q."""
        place, earlier, along, across, crowd = _falls(range, azimuth, outer)
        if not len(place):
            return np.zeros(self._log.shape[1:])
        centre, angle = range[earlier][:, None], azimuth[earlier][:, None]
        left = self._area(centre, angle, np.array(outer), np.array(outer)) - crowd[:, None]
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
        """Area of boxes of half widths (...) around places (n, 1), as far as covered, m^2."""
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


def _falls(
    range: FloatArray, azimuth: FloatArray, outer: float
) -> tuple[IntArray, IntArray, FloatArray, FloatArray, FloatArray]:
    """Detections that fall into the box of an earlier one, and the earliest such.

    Returns the places of both, how far they are apart along and across the line of sight (m), and
    what of the earlier one's box is left out as that of yet earlier ones (m^2).
    """
    none = np.zeros(0, np.int64)
    tree = cKDTree(np.stack([range * np.cos(azimuth), range * np.sin(azimuth)], axis=1))
    pairs = tree.query_pairs(2.0 * math.sqrt(2.0) * outer, output_type="ndarray")
    if not len(pairs):
        return none, none, *np.zeros((3, 0))
    earlier, place = pairs.min(axis=1), pairs.max(axis=1)
    along = np.abs(range[earlier] - range[place])
    middle = 0.5 * (range[earlier] + range[place])
    across = middle * np.abs(wrap(azimuth[earlier] - azimuth[place]))
    shared = np.maximum(2.0 * outer - along, 0.0) * np.maximum(2.0 * outer - across, 0.0)
    crowd = np.bincount(place, shared, minlength=len(range))
    inside = np.flatnonzero((along <= outer) & (across <= outer))
    inside = inside[np.lexsort((earlier[inside], place[inside]))]
    place, first = np.unique(place[inside], return_index=True)
    inside = inside[first]
    earlier = earlier[inside]
    return place, earlier, along[inside], across[inside], crowd[earlier]
