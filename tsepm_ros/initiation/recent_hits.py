"""How well the hits of new tracks fit their states."""

from __future__ import annotations

from collections import deque
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from tsepm_ros.kinematics.track import TrackArrays
from tsepm_ros.numerics.arrays import FloatArray, IntArray
from tsepm_ros.numerics.gaussian import squared_distance

GOOD_FIT = 0.99
"""Probability up to which the squared distance of hits from their track is no misfit."""


class _Hits(NamedTuple):
    """What of a scan's detections counts, (d, ...) each."""

    detection: IntArray
    time: FloatArray
    position: FloatArray
    covariance: FloatArray
    strength: FloatArray


@cache
def _largest_good(freedom: int) -> float:
    """Quantile of chi-square at `GOOD_FIT`."""
    return float(chdtri(freedom, 1.0 - GOOD_FIT))


class RecentHits:
    """The detections of recent scans, to which the hits of new tracks refer."""

    def __init__(self) -> None:
        self._scans: deque[tuple[int, _Hits]] = deque()

    def append(self, scan_index: int, detections: NDArray[np.void], window: int) -> None:
        """Add a scan's detections, and forget those before a window of scans."""
        names = ("index", "time", "position", "covariance", "strength")
        self._scans.append((scan_index, _Hits(*(detections[name].copy() for name in names))))
        while self._scans[0][0] <= scan_index - window:
            self._scans.popleft()

    def strengths(self, tracks: TrackArrays) -> tuple[FloatArray, FloatArray]:
        """Number of hits of tracks with a strength, and the sum of their exponents, (n,) each."""
        sums = np.zeros((2, len(tracks)))
        for row in range(len(tracks)):
            for *_, strength in self._seen(tracks, row):
                known = strength[np.isfinite(strength)]
                sums[:, row] += [len(known), known.sum()]
        return sums[0], sums[1]

    def misfits(self, tracks: TrackArrays) -> FloatArray:
        """Factors by which the covariances of new tracks are too small for their hits, (n,).

        The squared distance of h hits from their track has 2 h - 4 degrees of freedom. Where it is
        beyond their `GOOD_FIT`, it is divided by them (Birge's ratio); else the factor is 1. Hits
        in scans that are forgotten do not count.
        """
        return np.array([self._misfit(tracks, row) for row in range(len(tracks))])

    def _misfit(self, tracks: TrackArrays, row: int) -> float:
        hits = self._seen(tracks, row)
        freedom = 2 * len(hits) - 4
        if freedom <= 0:
            return 1.0
        state = tracks.state[row]
        time, position, covariance, _ = map(np.concatenate, zip(*hits, strict=True))
        elapsed = time - tracks.stamp[row]
        expected = state[0::2] + elapsed[:, None] * state[1::2]
        square = squared_distance(position - expected, covariance).sum()
        return float(square / freedom) if square > _largest_good(freedom) else 1.0

    def _seen(self, tracks: TrackArrays, row: int) -> list[list[FloatArray]]:
        """Time, position, covariance and strength of a track's hits in the recent scans."""
        scans = dict(self._scans)
        return [
            [part[scans[scan].detection == index] for part in scans[scan][1:]]
            for scan, index in tracks.hits[row]
            if scan in scans
        ]
