"""Confirming tracks by counting their hits within a window of scans: what such methods share."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.initiator import CommonOptions, Initiator, ScanStatistics
from tsepm_ros.kinematics.track import ConfirmedTrack, TrackArrays
from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray
from tsepm_ros.numerics.limits import keep_best
from tsepm_ros.numerics.rows import Rows
from tsepm_ros.sensing.conversion import DETECTION
from tsepm_ros.sensing.detection_window import DetectionWindow
from tsepm_ros.sensing.plot_features import Histories
from tsepm_ros.sensing.scan import Scan
from tsepm_ros.sensing.sensor import SensorModel
from tsepm_ros.stages import evaluation, pruning, splitting
from tsepm_ros.stages.association import Pairs, best_of_each, disjoint
from tsepm_ros.stages.estimation import Fit, fit
from tsepm_ros.stages.paths import NO_HIT, Paths, starting
from tsepm_ros.steps import Steps

BLOCK = 16_384
"""Tracks fitted together: bounds memory and keeps the work in the processor's cache."""
MAX_PAIRS = 1_000_000
"""Pairs of potential tracks and detections looked at in a scan; of more, the shortest steps."""


def check_rule(min_hits: int, window: int) -> None:
    """Refuse an M/N rule that nothing can satisfy.

    Raises
    ------
    ValueError
        If the window is shorter than the number of hits.
    """
    if window < min_hits:
        raise ValueError(f"window must be at least min_hits; got {window} and {min_hits}")


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


class HitCounter(Initiator):
    """A method that confirms tracks of M hits within N scans.

    Its `Options` have `min_hits` (M) and `window` (N).
    """

    def forget_potential_tracks(self) -> None:
        """See `Initiator.forget_potential_tracks`."""
        self._window = DetectionWindow()

    def _fit(self, hits: NDArray[np.void]) -> Fit:
        """Fit the states to the hits (n, m) of n tracks."""
        return fit(hits, self._now, self.sensor, "unweighted")

    def _evaluate(self, hits: NDArray[np.void], fitted: Fit) -> FloatArray:
        """The method's figure, (n,), small for a target; f_1 (TSEPM 2018, Eq. 23) if not another.

        Parameters
        ----------
        hits : (n, m) ndarray of DETECTION
        fitted : Fit
        """
        return evaluation.normalized_distance(hits, fitted)

    def _accept(self, estimates: Estimates) -> BoolArray:
        """Which tracks may be put out, (n,): those whose hits tell a state at all."""
        finite = np.isfinite(estimates.covariance).all(axis=(1, 2))
        return np.asarray(finite & np.isfinite(estimates.state).all(axis=1))

    def _estimate(self, paths: Paths) -> Estimates:
        n = len(paths)
        made = Estimates(np.zeros((n, 4)), np.zeros((n, 4, 4)), np.zeros(n))
        for count in np.unique(paths.hit_count):
            rows = np.flatnonzero(paths.hit_count == count)
            for first in range(0, len(rows), BLOCK):
                part = rows[first : first + BLOCK]
                hits = self._window[paths.hits[part, :count]]
                fitted = self._fit(hits)
                made.state[part], made.covariance[part] = fitted.state, fitted.covariance
                made.evaluation[part] = self._evaluate(hits, fitted)
        return made

    def _preference(self, paths: Paths, estimates: Estimates) -> FloatArray:
        """Which of the tracks that share a detection is put out: that of the smallest, (n,)."""
        return estimates.evaluation

    def _best(self, paths: Paths) -> tuple[Paths, Estimates, int]:
        """The best paths that share no detection, and how many are refused before."""
        estimates = self._estimate(paths)
        accepted = self._accept(estimates)
        candidates, estimates = paths[accepted], estimates[accepted]
        rows = disjoint(candidates.hits, self._preference(candidates, estimates))
        return candidates[rows], estimates[rows], len(paths) - len(candidates)

    def _confirm(self, raw: Paths) -> Confirmation:
        """Estimate the tracks that reached M hits and put out the best that share no detection."""
        best, estimates, refused = self._best(raw)
        tracks = self._tracks(best, estimates)
        return Confirmation(
            tracks.numbered(self._take_track_ids(len(tracks))),
            best.hits,
            pruned=refused,
            merged=len(raw) - refused - len(best),
        )

    def _tracks(self, paths: Paths, estimates: Estimates) -> TrackArrays:
        """Paths as tracks, without ids yet."""
        n = len(paths)
        hits = [
            self._window[ids[:count]]
            for ids, count in zip(paths.hits, paths.hit_count.tolist(), strict=True)
        ]
        first = self._window[paths.hits[:, 0]]
        return TrackArrays(
            track_id=np.zeros(n, np.int64),
            stamp=np.full(n, self.stamp or 0.0),
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
            age=(self.stamp or 0.0) - first["time"],
        )

    def _expired(self, first_scan: IntArray) -> BoolArray:
        return pruning.expired(self.scan_index + 1 - first_scan, self.options.window)

    def reason(self, track: ConfirmedTrack) -> str:
        """Its rule.

        See `Initiator.reason`.
        """
        rule = f"{self.options.min_hits}/{self.options.window}"
        return f"{super().reason(track)}, by the rule {rule}"


class PathFollower(HitCounter):
    """A hit counter that extends potential tracks from scan to scan.

    A method says which detections may extend which potential track (`_pairs`) and which of them do
    (`_choose`). A detection that extends none starts a potential track, which ends N scans later.
    The hits of a confirmed track are no other's: potential tracks that share one end.
    """

    every_detection_starts: ClassVar[bool] = False
    """Whether a detection that extends a potential track starts another as well."""

    @abstractmethod
    def _pairs(self, detections: NDArray[np.void]) -> tuple[Pairs, int]:
        """Potential tracks and detections that may extend them; and the pairs a limit left out."""

    def _choose(self, pairs: Pairs) -> Pairs:
        """The pairs that become potential tracks: for each track the best.

        A first hit, of which no motion is known yet, is extended by every detection it may be.
        """
        single = self._potential.hit_count[pairs.parent] == 1
        return Pairs.joined(pairs[single], best_of_each(pairs[~single]))

    @property
    def ends_when_missed(self) -> bool:
        """Whether a potential track that no detection extends ends at once."""
        return False

    def forget_potential_tracks(self) -> None:
        """See `Initiator.forget_potential_tracks`."""
        super().forget_potential_tracks()
        self._potential = self._started(np.zeros(0, np.int64), np.zeros(0, DETECTION))

    def _configure(self, sensor: SensorModel, common: CommonOptions, options: Any) -> bool:
        """Change the options; a shorter window ends tracks, another number of hits starts over.

        See `Initiator._configure`.
        """
        unlike = options.min_hits != self.options.min_hits
        super()._configure(sensor, common, options)
        if unlike:
            self.forget_potential_tracks()
            return False
        self._potential = self._potential[~self._expired(self._potential.first_scan)]
        return True

    def process(self, scan: Scan) -> TrackArrays:
        """Take one scan and return the tracks that it newly confirms.

        See `Initiator.process`.
        """
        detections = self._receive(scan)
        ids = self._window.append(detections)
        pairs, cut_pairs = self._pairs(detections)
        pairs = self._resembling(pairs, detections)
        extending, cut_potential, cut_raw = self._within_limits(self._choose(pairs))
        children = self._extended(extending.parent, ids[extending.row], detections[extending.row])
        reached = pruning.confirmed(children.hit_count, self.options.min_hits)
        confirmation = self._confirm(children[reached])
        missed = np.ones(len(self._potential), bool)
        missed[extending.parent] = False
        waiting, terminated = self._waiting(
            children[~reached], self._potential[missed], confirmation.hits
        )
        free = ~np.isin(ids, confirmation.hits)
        if not self.every_detection_starts:
            free[extending.row] = False
        beyond = max(int(np.count_nonzero(free)) - self._most, 0)
        started = self._started(ids[free][: self._most], detections[free][: self._most])
        self._potential, surplus = self._limit(type(started).joined(waiting, started))
        self._window.forget(self.scan_index + 2 - self.options.window)
        return self._deliver(
            confirmation.tracks,
            ScanStatistics(
                scans=1,
                detections=len(detections),
                potential_tracks=len(self._potential),
                started=len(started),
                terminated=terminated,
                raw_confirmations=int(np.count_nonzero(reached)) + cut_raw,
                pruned=confirmation.pruned,
                merged=confirmation.merged,
                confirmed=len(confirmation.tracks),
                cut_potential_tracks=cut_pairs + cut_potential + beyond + surplus,
                cut_confirmations=cut_raw,
            ),
        )

    def _resembling(self, pairs: Pairs, detections: NDArray[np.void]) -> Pairs:
        """The pairs but those in a clutter zone whose detection is unlike the track's hits."""
        if not self.common.plot_features:
            return pairs
        zone = np.flatnonzero(self._in_zone[pairs.row])
        hits = self._potential.hits[pairs.parent[zone]]
        some = hits != NO_HIT
        features = np.full((*hits.shape, 3), np.nan)
        features[some] = self._window[hits[some]]["features"]
        kept = np.ones(len(pairs), bool)
        kept[zone] = Histories.of(features).resembled_by(detections["features"][pairs.row[zone]])
        return pairs[kept]

    def potential_tracks(self) -> TrackArrays:
        """Hypotheses with at least two hits; `evaluation` is the figure of the hits so far.

        See `Initiator.potential_tracks`.
        """
        several = self._potential[self._potential.hit_count > 1]
        estimates = self._estimate(several)
        accepted = self._accept(estimates)
        tracks = self._tracks(several[accepted], estimates[accepted])
        return tracks.numbered(np.arange(len(tracks)))

    def _waiting(self, growing: Paths, missed: Paths, taken: IntArray) -> tuple[Paths, int]:
        """The potential tracks that go on, of those with and without a new hit; and how many end.

        Those end whose scans are over, and those with a hit that a confirmed track has taken.
        """
        waiting = growing if self.ends_when_missed else type(growing).joined(growing, missed)
        ended = self._expired(waiting.first_scan) | self._uses(waiting, taken)
        going_on = waiting[~ended]
        return going_on, len(growing) + len(missed) - len(going_on)

    @property
    def _most(self) -> int:
        """Potential tracks held at most."""
        return self.common.max_potential_tracks

    def _started(self, ids: IntArray, found: NDArray[np.void]) -> Paths:
        """New potential tracks of one hit each: detections found (n,), and their ids."""
        return starting(ids, self.scan_index, self.options.min_hits)

    def _extended(self, parent: IntArray, ids: IntArray, found: NDArray[np.void]) -> Paths:
        """Potential tracks that each add a detection; see `Paths.extended`."""
        return self._potential.extended(parent, ids)

    @staticmethod
    def _uses(paths: Paths, hits: IntArray) -> BoolArray:
        """Which paths have one of some hits, (n,)."""
        return np.asarray(np.isin(paths.hits, hits[hits != NO_HIT]).any(axis=1))

    def _reachable(
        self, detections: NDArray[np.void], margin: FloatArray
    ) -> tuple[IntArray, IntArray, int]:
        """Potential tracks and detections within ``v_max |dt|`` and a margin of their last hits.

        Parameters
        ----------
        detections : (n,) ndarray of DETECTION
        margin : (n,) ndarray
            Of each potential track, the same where the last hit is the same, m.

        Returns
        -------
        parent, row : (p,) ndarray of int
            Ascending.
        cut : int
            Pairs that a limit left out.
        """
        last_hits, first, gate = np.unique(
            self._potential.last_hit, return_index=True, return_inverse=True
        )
        hits = self._window[last_hits]
        gated = splitting.gate_within(hits, detections, self.common.max_speed, margin[first])
        owner = np.ascontiguousarray(hits["position"])

        def length(parent: IntArray, row: IntArray) -> FloatArray:
            step = detections["position"][row] - owner[gate[parent]]
            return np.hypot(step[:, 0], step[:, 1])

        parent, row, cut = splitting.split_within(gate, gated, MAX_PAIRS, length)
        return parent, row, cut + gated.cut

    def _steps(
        self, detections: NDArray[np.void], gate_sigmas: float
    ) -> tuple[IntArray, IntArray, Steps, BoolArray, int]:
        """The steps to reachable detections from the last two hits of the potential tracks.

        Parameters
        ----------
        detections : (n,) ndarray of DETECTION
        gate_sigmas : float
            Margin of the reach, in standard deviations of the last hit.

        Returns
        -------
        parent, row : (p,) ndarray of int
            Rows of potential tracks and detections.
        steps : Steps
        first : (p,) ndarray of bool
            Whether the track has one hit only; it then counts as both.
        cut : int
            Pairs that a limit left out.
        """
        tracks = self._potential
        sigma = self._window[tracks.last_hit]["major_sigma"]
        parent, row, cut = self._reachable(detections, gate_sigmas * sigma)
        before = tracks.hits[np.arange(len(tracks)), np.maximum(tracks.hit_count - 2, 0)]
        known = self._window[np.stack([before, tracks.last_hit], axis=1)]
        position = np.concatenate(
            [known["position"][parent], detections["position"][row, None]], axis=1
        )
        time = np.concatenate([known["time"][parent], detections["time"][row, None]], axis=1)
        return parent, row, Steps.of(position, time), tracks.hit_count[parent] == 1, cut

    def _within_limits(self, pairs: Pairs) -> tuple[Pairs, int, int]:
        """The best pairs within the limits, and how many potential and complete tracks are cut."""
        complete = self._potential.hit_count[pairs.parent] == self.options.min_hits - 1
        kept = []
        for part, limit in (
            (pairs[~complete], self._most),
            (pairs[complete], self.common.max_raw_confirmations),
        ):
            kept.append(part[keep_best(part.cost, limit)])
        counts = np.count_nonzero(~complete), np.count_nonzero(complete)
        cut = [int(count) - len(part) for count, part in zip(counts, kept, strict=True)]
        return Pairs.joined(*kept), cut[0], cut[1]

    def _limit(self, tracks: Paths) -> tuple[Paths, int]:
        """Keep the potential tracks of the most hits; returns them and the number cut."""
        kept = keep_best(-tracks.hit_count.astype(float), self._most)
        return tracks[kept], len(tracks) - len(kept)
