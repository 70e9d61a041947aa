"""Clutter behind echoes: multiple and indirect echoes, side lobes and spokes of interference.

A strong echo comes with others at its bearing, farther away: at multiples of its range, where the
sound or the radar pulse goes to and fro more than once, and at any range, over other reflectors
(Skolnik, "Introduction to Radar Systems", 3rd ed., 2001, Chap. 7). Interference fills a bearing in
one scan. These echoes move as the bearing does, which a map of the clutter in space does not
follow. Here the density that the map expects is multiplied by two factors, both 1 where nothing
shows that clutter is denser. Both count clutter in strips of several widths in bearing. Each makes
up for the whole excess: their product is cautious, since echoes of one cause are alike from scan to
scan, which a density does not describe.

In front of a detection, in its own scan: the level u of clutter in a strip has a gamma
distribution of mean 1 and variance ``1 / k = g - 1``, with the pair correlation g: pairs of
detections in all scans over those that the map expects (Moller, Waagepetersen, "Statistical
inference and simulation for spatial point processes", 2003). With N other detections where the map
expects E, the mean of u is ``(k + N) / (k + E)``. In even clutter g = 1, and so is the factor.

Behind a held target: the detections of the last scans there, with the bound of a Poisson mean
after t of an unknown target's, over those expected, ``low(N - t) / E``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from tsepm_ros.environment.clutter_map import MAX_DEVIATIONS, MEMORY, ClutterMap, poisson_bound
from tsepm_ros.numerics.arrays import FloatArray, IntArray

HALF_WIDTHS = 1, 2, 4, 8
"""Cells on either side of the middle of a strip."""
BEHIND = 3
"""Cells in range between a target and a strip behind it."""
TARGET_MEMORY = 20
"""Time constant, in scans, with which what is behind a target fades: its bearing changes."""
MAX_TARGET_COUNT = 5.0
"""Detections in a strip behind a target attributed to another: at most this, or two and one a
scan."""
MAX_PAIR_DEVIATIONS = 2.0
"""Standard deviations of a number of pairs within which clutter counts as even."""


class HeldTargets(NamedTuple):
    """Held tracks in the sensor's frame, (n,) each.

    Attributes
    ----------
    track_id : ndarray of int
    range, azimuth : ndarray
        m, rad.
    existence : ndarray
        Probability that the target exists.
    """

    track_id: IntArray
    range: FloatArray
    azimuth: FloatArray
    existence: FloatArray


@dataclass(frozen=True)
class _Behind:
    """Clutter behind a target in each strip (widths, 2), behind it and in the farther half."""

    scans: float
    count: FloatArray
    expected: FloatArray

    @property
    def factor(self) -> FloatArray:
        """Factor of each strip, at least 1."""
        target = min(self.scans + 2.0, MAX_TARGET_COUNT)
        low = poisson_bound(np.maximum(self.count - target, 0.0), -MAX_DEVIATIONS)
        seen = self.expected > 0.0
        return np.maximum(np.divide(low, self.expected, out=np.ones_like(low), where=seen), 1.0)


_NOTHING = _Behind(0.0, np.zeros((len(HALF_WIDTHS), 2)), np.zeros((len(HALF_WIDTHS), 2)))


class SecondaryEchoes:
    """Learns how much denser clutter is behind echoes.

    Attributes
    ----------
    pair_correlation : (w,) ndarray
        Pairs of clutter detections, one behind the other, over those expected, for each width of a
        strip; 1 before the first.
    """

    def __init__(self) -> None:
        self._pairs = np.zeros(len(HALF_WIDTHS))
        self._expected_pairs = np.zeros(len(HALF_WIDTHS))
        self._behind: dict[int, _Behind] = {}

    @property
    def pair_correlation(self) -> FloatArray:
        """See the class."""
        known = self._expected_pairs > 0.0
        ones = np.ones(len(HALF_WIDTHS))
        return np.divide(self._pairs, self._expected_pairs, out=ones, where=known)

    def behind_targets(
        self, clutter_map: ClutterMap, targets: HeldTargets, range: FloatArray, azimuth: FloatArray
    ) -> FloatArray:
        """Factor (n,) of the map's density at positions in the sensor's frame, by held targets."""
        if not len(targets.track_id):
            return np.ones(len(range))
        factor = self._grid_behind(clutter_map, targets)
        return np.asarray(factor[clutter_map.cells(range, azimuth)])

    def update(
        self,
        clutter_map: ClutterMap,
        targets: HeldTargets,
        range: FloatArray,
        azimuth: FloatArray,
        weight: FloatArray,
    ) -> FloatArray:
        """Learn from a scan, with the map after it.

        Parameters
        ----------
        clutter_map : ClutterMap
        targets : HeldTargets
        range, azimuth, weight : (n,) ndarray
            See `ClutterMap.update`.

        Returns
        -------
        (n,) ndarray
            Factor of the map's density at each detection.
        """
        cells = clutter_map.cells(range, azimuth)
        counts = np.zeros(clutter_map.shape)
        np.add.at(counts, cells, weight)
        count = _nearer(counts, clutter_map.wraps)
        expected = _nearer(clutter_map.expected, clutter_map.wraps)
        self._learn_behind(clutter_map, targets, count, expected)

        row, column = cells
        before, expected_before = count[:, row, column], expected[:, row, column]
        keep = 1.0 - 1.0 / MEMORY
        self._pairs = keep * self._pairs + before @ weight
        self._expected_pairs = keep * self._expected_pairs + expected_before @ weight
        factor = self._of_pairs(before, expected_before).max(axis=0)
        return factor * self._grid_behind(clutter_map, targets)[cells]

    def _of_pairs(self, count: FloatArray, expected: FloatArray) -> FloatArray:
        """Factors (w, n), at least 1, by the detections (w, n) in front of others."""
        low = poisson_bound(np.maximum(self._pairs - 1.0, 0.0), -MAX_PAIR_DEVIATIONS)
        known = self._expected_pairs > 0.0
        correlation = np.divide(low, self._expected_pairs, out=np.ones_like(low), where=known)
        variance = np.maximum(correlation - 1.0, 0.0)[:, None]
        return np.maximum((1.0 + variance * count) / (1.0 + variance * expected), 1.0)

    def _grid_behind(self, clutter_map: ClutterMap, targets: HeldTargets) -> FloatArray:
        """Factor of each cell of the map by held targets, (r, c)."""
        factor = np.ones(clutter_map.shape)
        columns = clutter_map.shape[1]
        rows, middles = clutter_map.cells(targets.range, targets.azimuth)
        for id_, existence, row, middle in zip(
            targets.track_id.tolist(), targets.existence, rows, middles, strict=True
        ):
            of_strips = 1.0 + existence * (self._behind.get(id_, _NOTHING).factor - 1.0)
            starts = _starts(clutter_map, row)
            for half_width, of_width in zip(HALF_WIDTHS, of_strips, strict=True):
                near = np.arange(middle - half_width, middle + half_width + 1)
                near = near % columns if clutter_map.wraps else near[(near >= 0) & (near < columns)]
                for start, of_strip in zip(starts, of_width, strict=True):
                    if of_strip > 1.0:
                        factor[start:, near] = np.maximum(factor[start:, near], of_strip)
        return factor

    def _learn_behind(
        self,
        clutter_map: ClutterMap,
        targets: HeldTargets,
        count: FloatArray,
        expected: FloatArray,
    ) -> None:
        """Learn how many detections are behind each target."""
        keep = 1.0 - 1.0 / TARGET_MEMORY
        behind = {}
        rows, middles = clutter_map.cells(targets.range, targets.azimuth)
        for id_, row, middle in zip(targets.track_id.tolist(), rows, middles, strict=True):
            starts = _starts(clutter_map, row)
            old = self._behind.get(id_, _NOTHING)
            found, mean = (
                np.maximum(sums[:, [-1], middle] - sums[:, starts, middle], 0.0)
                for sums in (count, expected)
            )
            behind[id_] = _Behind(
                keep * old.scans + 1.0, keep * old.count + found, keep * old.expected + mean
            )
        self._behind = behind


def _starts(clutter_map: ClutterMap, row: int) -> list[int]:
    """Rows at which the strips behind a target begin: behind it, and at half the area left."""
    start = min(row + BEHIND, clutter_map.shape[0])
    return [start, clutter_map.halfway(start)]


def _nearer(counts: FloatArray, wraps: bool) -> FloatArray:
    """Sums (w, r + 1, c) of counts (r, c) in the strip of each width, up to each row."""
    sums = np.zeros((len(HALF_WIDTHS), counts.shape[0] + 1, counts.shape[1]))
    along_range = np.cumsum(counts, axis=0)
    for strip, half_width in zip(sums, HALF_WIDTHS, strict=True):
        if wraps and 2 * half_width < counts.shape[1]:
            padded = np.pad(along_range, ((0, 0), (half_width, half_width)), mode="wrap")
        else:
            padded = np.pad(along_range, ((0, 0), (half_width, half_width)))
        total = np.pad(np.cumsum(padded, axis=1), ((0, 0), (1, 0)))
        width = 2 * half_width + 1
        strip[1:] = np.maximum(total[:, width:] - total[:, :-width], 0.0)  # rounding errors
    return sums
