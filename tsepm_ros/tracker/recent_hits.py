"""How well the hits of new tracks fit their states."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from tsepm_ros.numerics.arrays import FloatArray, IntArray
from tsepm_ros.numerics.gaussian import squared_distance
from tsepm_ros.tracker.measurement import major_sigma
from tsepm_ros.tracker.tracks import TrackArrays

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
    """Quantile of chi-square at `GOOD_FIT`; infinite without a degree of freedom."""
    if not freedom:
        return np.inf
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

    def of(
        self, tracks: TrackArrays
    ) -> tuple[FloatArray, tuple[FloatArray, FloatArray], FloatArray]:
        """What the recent hits of new tracks say: their misfits, strengths and last errors.

        Returns
        -------
        misfit : (n,) ndarray
            Factors by which the covariances of the tracks are too small for their hits. The squared
            distance of h hits from their track has 2 h - 4 degrees of freedom. Where it is beyond
            their `GOOD_FIT`, it is divided by them (Birge's ratio); else the factor is 1. Hits in
            scans that are forgotten do not count.
        strengths : tuple of (n,) ndarray
            Number of hits with a strength, and the sum of their exponents.
        hit_sigma : (n,) ndarray
            Standard deviation of the last hit along its major axis, m; that of the track where the
            hit is forgotten.
        """
        n = len(tracks)
        if not n:
            return np.ones(0), (np.zeros(0), np.zeros(0)), np.zeros(0)
        track, hits = self._seen(tracks)
        hit_sigma = major_sigma(tracks.covariance[:, 0::2, 0::2])
        hit_sigma[track] = major_sigma(hits.covariance)  # of several the last, the newest
        return self._misfits(tracks, track, hits), _strengths(n, track, hits.strength), hit_sigma

    @staticmethod
    def _misfits(tracks: TrackArrays, track: IntArray, hits: _Hits) -> FloatArray:
        freedom = np.maximum(2 * np.bincount(track, minlength=len(tracks)) - 4, 0)
        state, elapsed = tracks.state[track], hits.time - tracks.stamp[track]
        expected = state[:, 0::2] + elapsed[:, None] * state[:, 1::2]
        squares = squared_distance(hits.position - expected, hits.covariance)
        square = np.bincount(track, squares, minlength=len(tracks))
        freedoms, place = np.unique(freedom, return_inverse=True)
        good = np.array([_largest_good(int(number)) for number in freedoms])[place]
        return np.where(square > good, square / np.maximum(freedom, 1), 1.0)

    def _seen(self, tracks: TrackArrays) -> tuple[IntArray, _Hits]:
        """The tracks' hits in the recent scans, track by track, and the track of each."""
        numbers = [len(hits) for hits in tracks.hits]
        track = np.repeat(np.arange(len(tracks)), numbers)
        pairs = np.array([pair for hits in tracks.hits for pair in hits], np.int64).reshape(-1, 2)
        scans = np.array([scan for scan, _ in self._scans], np.int64)
        known = np.concatenate([hits.detection for _, hits in self._scans])
        width = max(int(known.max(initial=0)), int(pairs[:, 1].max(initial=0))) + 1
        keys = np.repeat(scans, [len(hits.detection) for _, hits in self._scans]) * width + known
        order = np.argsort(keys, kind="stable")
        wanted = pairs[:, 0] * width + pairs[:, 1]
        place = np.searchsorted(keys, wanted, sorter=order)
        inside = np.flatnonzero(place < len(keys))
        row = order[place[inside]]
        same = keys[row] == wanted[inside]
        parts = (np.concatenate(part)[row[same]] for part in self._columns())
        return track[inside[same]], _Hits(*parts)

    def _columns(self) -> Iterator[tuple[FloatArray, ...]]:
        """Each field of the scans."""
        return zip(*(hits for _, hits in self._scans), strict=True)


def _strengths(number: int, track: IntArray, strength: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Number of the strengths that are known, and their sum, (n,) each, by the track of each."""
    known = np.isfinite(strength)
    counts = np.bincount(track[known], minlength=number).astype(np.float64)
    total = np.asarray(np.bincount(track[known], strength[known], minlength=number), float)
    return counts, total
