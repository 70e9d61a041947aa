"""Base classes of the methods that confirm tracks by counting hits within a window of scans."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray, Rows, TimeLimit
from tsepm_ros.tracker import evaluation, pruning
from tsepm_ros.tracker.association import disjoint
from tsepm_ros.tracker.detection_window import DetectionWindow
from tsepm_ros.tracker.method import Method, Observation
from tsepm_ros.tracker.path_fit import Fit, Paths, fit
from tsepm_ros.tracker.tracks import ConfirmedTrack, TrackArrays, tracks_from_hits

GATING_SHARE = 0.1
"""Share of a time limit after which only the nearest detections are sought in the gates."""


@dataclass(frozen=True)
class Estimates(Rows):
    """Tracks as estimated from their hits.

    Attributes
    ----------
    state, covariance : (n, 4), (n, 4, 4) ndarray
        At the last scan's stamp.
    evaluation : (n,) ndarray
        The method's figure; smaller is better.
    """

    state: FloatArray
    covariance: FloatArray
    evaluation: FloatArray


@dataclass(frozen=True)
class Confirmation:
    """What became of the tracks that reached confirmation in a scan.

    Attributes
    ----------
    tracks : TrackArrays
        Those that were published.
    hits : (n, most) ndarray of int
        Their detections' ids, with NO_HIT.
    pruned, merged : int
        The others: refused, and with a hit of a better one.
    """

    tracks: TrackArrays
    hits: IntArray
    pruned: int
    merged: int


class WindowedMethod(Method):
    """A method that confirms tracks by M hits within a window of N scans.

    Its `Options` have `min_hits` (M) and `window` (N).

    Attributes
    ----------
    detections : DetectionWindow
        Those of the last scans, to which hits of potential tracks refer.
    stamp : float
        Of the last scan, s.
    scan_index : int
        Of the last scan.
    time_limit : TimeLimit
        Time that it may take.
    """

    def forget(self) -> None:
        """See `Method.forget`."""
        self.detections = DetectionWindow()
        self.stamp, self.scan_index = 0.0, -1
        self.time_limit = TimeLimit()

    def begin(self, observed: Observation) -> IntArray:
        """Take a scan; returns the ids of its detections, (d,)."""
        self.stamp, self.scan_index = observed.stamp, observed.scan_index
        self.time_limit = observed.time_limit
        self.detections = observed.window
        return observed.ids

    def late_after(self, share: float) -> Callable[[], bool] | None:
        """Whether a share of the scan's time is over; None where the time is not limited."""
        return partial(self.time_limit.used, share) if self.time_limit.finite else None

    def expired(self, first_scan: IntArray) -> BoolArray:
        """Which paths have had their N scans, (n,), by the scans of their first hits."""
        return pruning.expired(self.scan_index + 1 - first_scan, self.options.window)

    def reason(self, track: ConfirmedTrack) -> str:
        """The rule that the track satisfied.

        See `Method.reason`.
        """
        rule = f"{self.options.min_hits}/{self.options.window}"
        return f"{super().reason(track)}, by the rule {rule}"


class HitCounter(WindowedMethod):
    """A method that counts the hits of paths and puts out those that share no detection."""

    def fit(self, hits: NDArray[np.void]) -> Fit:
        """Fit the states to the hits (n, m) of n tracks."""
        return fit(hits, self.stamp, self.sensor, "unweighted")

    def evaluate(self, hits: NDArray[np.void], fitted: Fit) -> FloatArray:
        """The method's figure, (n,), small for a target; f_1 (TSEPM 2018, Eq. 23) if not another.

        Parameters
        ----------
        hits : (n, m) ndarray of DETECTION
        fitted : Fit
        """
        return evaluation.normalized_distance(hits, fitted)

    def accept(self, estimates: Estimates) -> BoolArray:
        """Which tracks may be published, (n,): those with a finite state estimate."""
        finite = np.isfinite(estimates.covariance).all(axis=(1, 2))
        return np.asarray(finite & np.isfinite(estimates.state).all(axis=1))

    def estimate(self, paths: Paths) -> Estimates:
        """Fit and evaluate paths, block by block of equal hit counts."""
        n = len(paths)
        estimates = Estimates(np.zeros((n, 4)), np.zeros((n, 4, 4)), np.zeros(n))
        for rows, ids in paths.of_equal_count():
            hits = self.detections[ids]
            fitted = self.fit(hits)
            estimates.state[rows], estimates.covariance[rows] = fitted.state, fitted.covariance
            estimates.evaluation[rows] = self.evaluate(hits, fitted)
        return estimates

    def preference(self, paths: Paths, estimates: Estimates) -> FloatArray:
        """Figure, (n,): of tracks that share a detection that of the smallest is published."""
        return estimates.evaluation

    def best(self, paths: Paths) -> tuple[Paths, Estimates, int]:
        """The best paths that share no detection, and how many are refused before."""
        estimates = self.estimate(paths)
        accepted = self.accept(estimates)
        candidates, estimates = paths[accepted], estimates[accepted]
        rows = disjoint(candidates.hits, self.preference(candidates, estimates))
        return candidates[rows], estimates[rows], len(paths) - len(candidates)

    def confirm(self, raw: Paths) -> Confirmation:
        """Estimate the tracks that reached M hits and publish the best that share no detection."""
        best, estimates, refused = self.best(raw)
        return Confirmation(
            self.tracks(best, estimates),
            best.hits,
            pruned=refused,
            merged=len(raw) - refused - len(best),
        )

    def tracks(self, paths: Paths, estimates: Estimates) -> TrackArrays:
        """Paths as tracks, their places as ids."""
        return tracks_from_hits(
            self.detections,
            paths.hits,
            stamp=self.stamp,
            scan_index=self.scan_index,
            state=estimates.state,
            covariance=estimates.covariance,
            evaluation=estimates.evaluation,
        )
