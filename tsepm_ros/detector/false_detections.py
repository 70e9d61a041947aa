"""The threshold that keeps a stated number of false detections, learned from the peaks themselves.

No law of the clutter is assumed. The heights of the peaks of the last pings are pooled, and the
threshold is the height above which the stated number a ping lies::

    sum of w over the pooled peaks above the threshold  =  number * pings

A peak of clutter has the weight 1 in expectation, a moving target's 0: a target was near in the
last pings, but not long before, where clutter was as often. With ``r`` whether a detection of the
last pings lies within a gate of the peak, and ``c`` in which share of older pings one does::

    w = 1 - (r - c) / (1 - mean c);    0 where echoes come in more than half of the pings

so that places crowded with clutter are not taken for targets. Pings whose median peak differs from
the current one's beyond chance have another statistic (a step of the gain) and are left out.
"""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

import numpy as np
from scipy.spatial import KDTree

from tsepm_ros.numerics.arrays import BoolArray, FloatArray

PEAKS = 400
"""Peaks that a pool should hold above the threshold."""
PINGS = (10, 40)
"""Least and most pings of a pool."""
RECENT = 3
"""Pings in one of which a target comes again."""
LONG = 4
"""Times as many pings before which clutter was as often, and a moving target elsewhere."""
STANDS = (5, 24)
"""Least and most pings in which echoes of one place are counted."""
LIKE = 4.0, 0.01
"""Standard errors, and part of the median, by which medians of like pings may differ."""
MAX_CHANCE = 0.8
"""Largest chance that is corrected for."""
GATE_CHANCE = 0.1
"""Chance of coming again for which gates are widened."""
MAX_GATE = 2.5
"""Largest gate, in those of an echo at rest: its speed is unknown."""
MAX_TARGETS = 8.0
"""Peaks a ping that may count as moving targets; more where more detections are wanted."""


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


class Threshold:
    """Learns the threshold from ping to ping.

    Parameters
    ----------
    number : float
        Wanted false detections a ping.

    Attributes
    ----------
    measured : float
        False detections a ping that the pool has above the last threshold.
    recurring : float
        Detections of the last ping that came again, or stand, less those by chance.
    """

    def __init__(self, number: float) -> None:
        self._number = number
        pings = int(np.clip(math.ceil(PEAKS / number), *PINGS))
        self._pool: deque[tuple[Peaks, FloatArray, FloatArray]] = deque(maxlen=pings)
        self._detected: deque[FloatArray] = deque(maxlen=STANDS[1])
        self.kept = int(8 * number + 100)
        self.measured = math.nan
        self.recurring = 0.0

    def update(self, peaks: Peaks) -> float:
        """The threshold for a ping, learned with it."""
        stands, again = self._again(peaks)
        self._pool.append((peaks, np.where(stands, 0.0, 1.0), np.where(stands, 0.0, again)))
        like = [
            entry
            for entry in self._pool
            if abs(entry[0].median - peaks.median)
            <= LIKE[0] * math.hypot(entry[0].error, peaks.error) + LIKE[1] * peaks.median
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
        self.measured = float(false[last - 1]) if last else 0.0
        detected = peaks.height > level
        self.recurring = float((again + stands)[detected].sum())
        self._detected.append(peaks.place[detected])
        return level

    def _again(self, peaks: Peaks) -> tuple[BoolArray, FloatArray]:
        """Whether each peak stands still, and its evidence of being a target, (n,)."""
        n, pings = len(peaks.height), len(self._detected)
        if not n or not pings:
            return np.zeros(n, bool), np.zeros(n)
        squares = 4.0 * RECENT * max(self._number, 1.0)
        gate = float(np.clip(math.sqrt(GATE_CHANCE * peaks.area / squares), 1.0, MAX_GATE))
        apart = _apart(list(self._detected), peaks.place, gate)
        stands = (np.mean(apart < 1.0, axis=0) > 0.5) & (pings >= STANDS[0])
        recent = (apart < gate)[-RECENT:].any(axis=0)
        before = (apart < gate)[: -LONG * RECENT]
        groups = len(before) // RECENT
        if groups:
            shape = groups, RECENT, n
            chance = before[: groups * RECENT].reshape(shape).any(axis=1).mean(axis=0)
        else:  # provisional: as if detections were spread evenly
            chance = np.full(n, -math.expm1(-squares * gate**2 / peaks.area))
        if pings == (LONG + 1) * RECENT:
            self._pool.clear()
        return stands, (recent - chance) / (1.0 - min(float(chance.mean()), MAX_CHANCE))


def _apart(detected: list[FloatArray], place: FloatArray, gate: float) -> FloatArray:
    """Distance of each place (n, 2) to the nearest of each ping's; infinite beyond, (pings, n)."""
    ping = np.repeat(np.arange(len(detected)), [len(places) for places in detected])
    others = KDTree(np.concatenate(detected))
    near = others.sparse_distance_matrix(KDTree(place), gate, p=np.inf, output_type="ndarray")
    apart = np.full((len(detected), len(place)), np.inf)
    np.minimum.at(apart, (ping[near["i"]], near["j"]), near["v"])
    return apart
