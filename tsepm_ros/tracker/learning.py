"""Learning from the detections of a scan, and from hits of new tracks.

What the detections of a scan teach, beside their density: strengths and errors.

How well the hits of new tracks fit their states.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from tsepm_ros.numerics.arrays import FloatArray, IntArray, taken
from tsepm_ros.numerics.gaussian import squared_distance
from tsepm_ros.tracker.clutter import amplitude
from tsepm_ros.tracker.clutter.measurement_errors import MeasurementErrors
from tsepm_ros.tracker.clutter.scan_clutter import ScanClutter
from tsepm_ros.tracker.clutter.secondary_echoes import HeldTargets
from tsepm_ros.tracker.clutter.target_strength import ScanStrengths
from tsepm_ros.tracker.maintenance.confirmed_tracks import HeldTracks
from tsepm_ros.tracker.maintenance.track_maintenance import TrackMaintenance
from tsepm_ros.tracker.measurement import NAMES, major_sigma, measured_polar
from tsepm_ros.tracker.sensor import EchoPoses, SensorModel
from tsepm_ros.tracker.tracks import TrackArrays

INTENSITY = NAMES.index("intensity")


def judge_strengths(
    clutter: ScanClutter,
    detections: NDArray[np.void],
    scan_index: int,
    most_hits: int,
) -> ScanStrengths | None:
    """What the strengths of a scan's detections say, by the scans before.

    Their exponents become the field `strength` of the detections.

    Parameters
    ----------
    clutter : ScanClutter
        Without `strengths` these do not count.
    detections : (d,) ndarray of DETECTION
    scan_index : int
    most_hits : int
        Hits that a path may have.

    Returns
    -------
    ScanStrengths or None
        None where they say nothing.
    """
    if clutter.strengths is None:
        return None
    judged = clutter.strengths.judge(
        detections["features"][:, INTENSITY],
        scan_index,
        detections["index"],
        lambda: clutter.rings,
        detections["position"],
    )
    if judged is None:
        return None
    detections["strength"] = judged.extrapolated
    return ScanStrengths.of(judged.exponent, judged.samples, most_hits)


def learn_strengths(clutter: ScanClutter, detections: NDArray[np.void], moved: float) -> None:
    """Learn the law of the strengths of clutter from the scan that was judged.

    Parameters
    ----------
    clutter : ScanClutter
        With the `weight` of each detection.
    detections : (d,) ndarray of DETECTION
    moved : float
        Distance that a target moves at most from scan to scan, m.
    """
    if clutter.strengths is None:
        return
    sigma, error = np.sort(detections["major_sigma"]), 0.0
    if len(sigma):  # three times the median
        error = 1.5 * float(sigma[(len(sigma) - 1) // 2] + sigma[len(sigma) // 2])
    reach = moved * np.arange(amplitude.LAGS + 1.0) + math.sqrt(2.0) * error
    clutter.strengths.update(clutter.weight, (amplitude.LAGS + 1.0) * moved + error, reach)


def learn_errors(
    errors: MeasurementErrors,
    maintenance: TrackMaintenance,
    sensor: SensorModel,
    detections: NDArray[np.void],
) -> None:
    """Learn the sensor's errors from held tracks' detections, if these have its errors."""
    track_id, row = maintenance.own_detections
    rows = np.isnan(detections["range_std"][row])
    own = taken(detections, row[rows])
    variance = sensor.range_variance(measured_polar(own)[0])
    errors.update(track_id[rows], own, variance, maintenance.held.tracks.track_id)


def held_targets(held: HeldTracks, poses: EchoPoses) -> HeldTargets:
    """The held tracks in the sensor's frame."""
    range_, azimuth = poses.polar(held.tracks.state[:, 0::2])
    return HeldTargets(held.tracks.track_id, range_, azimuth, held.existence)


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
