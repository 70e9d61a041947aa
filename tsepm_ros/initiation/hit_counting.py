"""Confirming tracks by counting their hits within a window of scans: what such methods share."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.initiation.method import Method
from tsepm_ros.initiation.observation import Observation
from tsepm_ros.kinematics.track import ConfirmedTrack, TrackArrays
from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray
from tsepm_ros.numerics.rows import Rows
from tsepm_ros.sensing.detection_window import DetectionWindow
from tsepm_ros.stages import evaluation, pruning
from tsepm_ros.stages.association import disjoint
from tsepm_ros.stages.estimation import Fit, fit
from tsepm_ros.stages.paths import Paths

BLOCK = 16_384
"""Tracks fitted together: bounds memory and keeps the work in the processor's cache."""


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
        Those put out.
    hits : (n, most) ndarray of int
        Their detections' ids, with NO_HIT.
    pruned, merged : int
        The others: refused, and with a hit of a better one.
    """

    tracks: TrackArrays
    hits: IntArray
    pruned: int
    merged: int


class HitCounter(Method):
    """A method that confirms tracks of M hits within N scans.

    Its `Options` have `min_hits` (M) and `window` (N).
    """

    def forget(self) -> None:
        """See `Method.forget`."""
        self.detections = DetectionWindow()
        self.stamp, self.scan_index = 0.0, -1

    def begin(self, observed: Observation) -> IntArray:
        """Take a scan's detections into the window; returns their ids, (d,)."""
        self.stamp, self.scan_index = observed.stamp, observed.scan_index
        return self.detections.append(observed.detections)

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
        """Which tracks may be put out, (n,): those whose hits tell a state at all."""
        finite = np.isfinite(estimates.covariance).all(axis=(1, 2))
        return np.asarray(finite & np.isfinite(estimates.state).all(axis=1))

    def estimate(self, paths: Paths) -> Estimates:
        """Fit and evaluate paths, block by block of equal hit counts."""
        n = len(paths)
        made = Estimates(np.zeros((n, 4)), np.zeros((n, 4, 4)), np.zeros(n))
        for count in np.unique(paths.hit_count):
            rows = np.flatnonzero(paths.hit_count == count)
            for first in range(0, len(rows), BLOCK):
                part = rows[first : first + BLOCK]
                hits = self.detections[paths.hits[part, :count]]
                fitted = self.fit(hits)
                made.state[part], made.covariance[part] = fitted.state, fitted.covariance
                made.evaluation[part] = self.evaluate(hits, fitted)
        return made

    def preference(self, paths: Paths, estimates: Estimates) -> FloatArray:
        """Which of the tracks that share a detection is put out: that of the smallest, (n,)."""
        return estimates.evaluation

    def best(self, paths: Paths) -> tuple[Paths, Estimates, int]:
        """The best paths that share no detection, and how many are refused before."""
        estimates = self.estimate(paths)
        accepted = self.accept(estimates)
        candidates, estimates = paths[accepted], estimates[accepted]
        rows = disjoint(candidates.hits, self.preference(candidates, estimates))
        return candidates[rows], estimates[rows], len(paths) - len(candidates)

    def confirm(self, raw: Paths) -> Confirmation:
        """Estimate the tracks that reached M hits and put out the best that share no detection."""
        best, estimates, refused = self.best(raw)
        return Confirmation(
            self.tracks(best, estimates),
            best.hits,
            pruned=refused,
            merged=len(raw) - refused - len(best),
        )

    def tracks(self, paths: Paths, estimates: Estimates) -> TrackArrays:
        """Paths as tracks, without ids yet."""
        n = len(paths)
        hits = [
            self.detections[ids[:count]]
            for ids, count in zip(paths.hits, paths.hit_count.tolist(), strict=True)
        ]
        first = self.detections[paths.hits[:, 0]]
        return TrackArrays(
            track_id=np.zeros(n, np.int64),
            stamp=np.full(n, self.stamp),
            state=estimates.state,
            covariance=estimates.covariance,
            hits=[
                tuple(zip(found["scan"].tolist(), found["index"].tolist(), strict=True))
                for found in hits
            ],
            hit_count=paths.hit_count,
            evaluation=estimates.evaluation,
            score=np.full(n, np.nan),
            scan_count=self.scan_index + 1 - first["scan"],
            age=self.stamp - first["time"],
        )

    def expired(self, first_scan: IntArray) -> BoolArray:
        """Which paths have had their N scans, (n,), by the scans of their first hits."""
        return pruning.expired(self.scan_index + 1 - first_scan, self.options.window)

    def reason(self, track: ConfirmedTrack) -> str:
        """Its rule.

        See `Method.reason`.
        """
        rule = f"{self.options.min_hits}/{self.options.window}"
        return f"{super().reason(track)}, by the rule {rule}"
