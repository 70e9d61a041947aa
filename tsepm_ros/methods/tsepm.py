"""Track splitting, evaluating, pruning and merging (TSEPM 2018).

Li D., Lin Y., Zhang Y., "A track initiation method for the underwater target tracking
environment", China Ocean Eng. 32(2), 206-215, 2018.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tsepm_ros import evaluation, merging, pruning, splitting
from tsepm_ros.detection_window import DetectionWindow
from tsepm_ros.estimation import ESTIMATORS, Fit, fit
from tsepm_ros.initiator import CommonOptions, Initiator, ScanStatistics
from tsepm_ros.limits import keep_best
from tsepm_ros.parameters import check_group, parameter
from tsepm_ros.scan import Scan
from tsepm_ros.sensor import SensorModel
from tsepm_ros.track import ConfirmedTrack

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

NO_HIT = -1
MERGING_COST = 10.0
"""Time to merge a track, in times to estimate one, at most (measured: 2 to 5)."""
BLOCK = 16_384
"""Tracks fitted together: bounds memory and keeps the work in the processor's cache."""


@dataclass(frozen=True, kw_only=True)
class TsepmOptions:
    """Options of the published method; the defaults are the paper's.

    Raises
    ------
    ValueError
        Naming the option whose value is not allowed.
    """

    min_hits: int = parameter(5, "Hits that confirm a track (M)", minimum=2, maximum=32)
    window: int = parameter(
        8, "Scans within which they must come, the first hit's included (N)", minimum=2, maximum=64
    )
    gate_probability: float = parameter(
        0.9,
        "Probability P that a detected target falls into the gate (Eq. 5)",
        positive=True,
        maximum=0.999999,
    )
    estimator: str = parameter(
        "unweighted",
        "Least squares as published, or weighted with the errors re-evaluated at the fit",
        choices=ESTIMATORS,
    )
    evaluation: str = parameter(
        "normalized_distance",
        "What a track is evaluated by: f_1 (Eq. 23) or Kennedy's f_2 (Eq. 25)",
        choices=evaluation.EVALUATIONS,
    )
    pruning_probability: float = parameter(
        0.99,
        "Probability P_TP that a true track's distance passes (Eq. 26)",
        positive=True,
        maximum=0.999999,
    )
    pruning_reading: str = parameter(
        "literal",
        "Compare f_1 with the threshold of Eq. 26 as printed, or squared",
        choices=pruning.READINGS,
    )
    clutter_test_size: float = parameter(
        0.05,
        "Nominal share of clutter tracks that pass Kennedy's test",
        positive=True,
        maximum=0.999999,
    )
    merging_probability: float = parameter(
        0.9, "Probability P_TM that two states overlap (Eq. 30)", positive=True, maximum=0.999999
    )
    merging: str = parameter(
        "moments",
        "Merged state from Eqs. 31-33, or fitted again to the union of the hits",
        choices=merging.MERGINGS,
    )

    def __post_init__(self) -> None:
        check_group(self)
        if self.window < self.min_hits:
            raise ValueError(
                f"window must be at least min_hits; got {self.window} and {self.min_hits}"
            )


@dataclass(frozen=True)
class PotentialTracks:
    """Hypotheses as arrays, a row each.

    Attributes
    ----------
    hits : (n, M) ndarray of int
        Detection ids of the hits, oldest first, then NO_HIT.
    hit_count : (n,) ndarray of int
        N_v.
    first_scan : (n,) ndarray of int
        Scan index of the first hit; N_a follows from it.
    """

    hits: IntArray
    hit_count: IntArray
    first_scan: IntArray

    def __len__(self) -> int:
        """Number of tracks."""
        return len(self.hit_count)

    def __getitem__(self, rows: NDArray[np.generic]) -> PotentialTracks:
        """The tracks in the given rows (indices or a mask)."""
        return PotentialTracks(self.hits[rows], self.hit_count[rows], self.first_scan[rows])

    @property
    def last_hit(self) -> IntArray:
        """Detection id of each track's last hit, (n,)."""
        return self.hits[np.arange(len(self)), self.hit_count - 1]

    def extended(self, parent: IntArray, detection: IntArray) -> PotentialTracks:
        """Children that add a detection each: row i extends track `parent[i]`."""
        children = self[parent]
        children.hits[np.arange(len(parent)), children.hit_count] = detection
        return PotentialTracks(children.hits, children.hit_count + 1, children.first_scan)

    @classmethod
    def starting(cls, detection: IntArray, scan_index: int, width: int) -> PotentialTracks:
        """New potential tracks of one hit each (Step 8)."""
        hits = np.full((len(detection), width), NO_HIT, np.int64)
        hits[:, 0] = detection
        count = np.ones(len(detection), np.int64)
        return cls(hits, count, np.full(len(detection), scan_index, np.int64))

    @classmethod
    def joined(cls, *parts: PotentialTracks) -> PotentialTracks:
        """The tracks of all parts, in order."""
        return cls(
            np.concatenate([part.hits for part in parts]),
            np.concatenate([part.hit_count for part in parts]),
            np.concatenate([part.first_scan for part in parts]),
        )


@dataclass(frozen=True)
class Candidates:
    """Tracks that reached confirmation, fitted and evaluated.

    Attributes
    ----------
    hits : (n, M) ndarray of int
        Detection ids.
    state, covariance : (n, 4), (n, 4, 4) ndarray
        The fit.
    distance : (n,) ndarray
        f_1, also the weight in merging.
    evaluation : (n,) ndarray
        The evaluation that pruning uses.
    """

    hits: IntArray
    state: FloatArray
    covariance: FloatArray
    distance: FloatArray
    evaluation: FloatArray

    def __len__(self) -> int:
        """Number of candidates."""
        return len(self.evaluation)

    def __getitem__(self, rows: NDArray[np.generic]) -> Candidates:
        """The candidates in the given rows (indices or a mask)."""
        return Candidates(
            self.hits[rows],
            self.state[rows],
            self.covariance[rows],
            self.distance[rows],
            self.evaluation[rows],
        )

    @classmethod
    def joined(cls, parts: list[Candidates]) -> Candidates:
        """The candidates of all parts, in order."""
        return cls(
            np.concatenate([part.hits for part in parts]),
            np.concatenate([part.state for part in parts]),
            np.concatenate([part.covariance for part in parts]),
            np.concatenate([part.distance for part in parts]),
            np.concatenate([part.evaluation for part in parts]),
        )


@dataclass(frozen=True)
class Cut:
    """Hypotheses that the limits removed from a scan's splitting."""

    confirmations: int
    potential_tracks: int


class Tsepm(Initiator):
    """The published method, step by step as in Section 4 of the paper."""

    Options = TsepmOptions
    options: TsepmOptions

    def reset(self) -> None:
        """Forget all scans and potential tracks. Track ids go on: none is used twice."""
        super().reset()
        self._window = DetectionWindow()
        self._potential = PotentialTracks.starting(np.zeros(0, np.int64), 0, self.options.min_hits)

    def configure(self, sensor: SensorModel, common: CommonOptions, options: Any) -> bool:
        """Change the options; another number of hits starts over, a shorter window ends tracks.

        See `Initiator.configure`.
        """
        old = self.options
        super().configure(sensor, common, options)
        if options.min_hits != old.min_hits:
            self.reset()
            return False
        scan_count = self.scan_index + 1 - self._potential.first_scan
        self._potential = self._potential[~pruning.expired(scan_count, options.window)]
        return True

    def process(self, scan: Scan) -> list[ConfirmedTrack]:
        """Take one scan and return the tracks that it newly confirms (Steps 1-8).

        See `Initiator.process`.
        """
        detections = self._receive(scan)
        ids = self._window.append(detections)
        gates, gated = self._gate(detections)
        updated, missed, cut = self._split(gates, gated, ids)
        raw, potential, terminated = self._confirm(updated, missed)
        candidates = self._estimate(raw)
        kept = self._prune(candidates)
        merging = self._in_time(kept)
        tracks = self._merge(merging)
        started = self._start(splitting.residual(len(ids), gated), ids)
        self._potential, cut_potential = self._limit(PotentialTracks.joined(potential, started))
        self._window.forget(self.scan_index + 2 - self.options.window)
        self._count(
            ScanStatistics(
                scans=1,
                detections=len(scan),
                potential_tracks=len(self._potential),
                started=len(started),
                terminated=terminated,
                raw_confirmations=len(raw),
                pruned=len(candidates) - len(kept),
                merged=len(merging) - len(tracks),
                confirmed=len(tracks),
                cut_potential_tracks=gated.cut + cut.potential_tracks + cut_potential,
                cut_confirmations=cut.confirmations
                + (len(raw) - len(candidates))
                + (len(kept) - len(merging)),
            )
        )
        return tracks

    def potential_tracks(self) -> list[ConfirmedTrack]:
        """Hypotheses with at least two hits; `evaluation` is f_1 of the hits so far.

        See `Initiator.potential_tracks`.
        """
        found: list[ConfirmedTrack] = []
        if self.stamp is None:
            return found
        for count in range(2, self.options.min_hits):
            tracks = self._potential[self._potential.hit_count == count]
            candidates = self._estimate(tracks, count)
            found.extend(
                self._track(len(found) + row, candidates, row) for row in range(len(candidates))
            )
        return found

    def _gate(self, detections: NDArray[np.void]) -> tuple[IntArray, splitting.Gated]:
        """Gate the scan: tracks that share a last hit share its gate (Step 2, Eqs. 4-5)."""
        last_hits, gate_of_track = np.unique(self._potential.last_hit, return_inverse=True)
        gated = splitting.gate(
            self._window[last_hits],
            detections,
            self.common.max_speed,
            self.options.gate_probability,
        )
        return gate_of_track, gated

    def _split(
        self, gates: IntArray, gated: splitting.Gated, ids: IntArray
    ) -> tuple[PotentialTracks, PotentialTracks, Cut]:
        """Extend every track by each of its gated detections (Step 2).

        Returns the children, the tracks without a gated detection, and what the limits cut.
        """
        last = self._potential.hit_count == self.options.min_hits - 1
        completed, cut_confirmations = self._split_part(
            np.flatnonzero(last), gates, gated, ids, self.common.max_raw_confirmations
        )
        extended, cut_potential = self._split_part(
            np.flatnonzero(~last), gates, gated, ids, self.common.max_potential_tracks
        )
        missed = self._potential[gated.count[gates] == 0]
        cut = Cut(cut_confirmations, cut_potential)
        return PotentialTracks.joined(completed, extended), missed, cut

    def _split_part(
        self, rows: IntArray, gates: IntArray, gated: splitting.Gated, ids: IntArray, limit: int
    ) -> tuple[PotentialTracks, int]:
        """Split some of the tracks; returns at most `limit` children and the number cut."""
        tracks = self._potential[rows]

        def cost(parent: IntArray, newest: IntArray) -> FloatArray:
            return self._cost(tracks.extended(parent, ids[newest]))

        parent, newest, cut = splitting.split_within(gates[rows], gated, limit, cost)
        return tracks.extended(parent, ids[newest]), cut

    def _confirm(
        self, updated: PotentialTracks, missed: PotentialTracks
    ) -> tuple[PotentialTracks, PotentialTracks, int]:
        """Apply the M/N rule (Step 3).

        Returns the newly confirmed tracks, those that stay potential, and how many it ended.
        """
        reached = pruning.confirmed(updated.hit_count, self.options.min_hits)
        waiting = PotentialTracks.joined(updated[~reached], missed)
        scan_count = self.scan_index + 1 - waiting.first_scan
        ended = pruning.expired(scan_count, self.options.window)
        return updated[reached], waiting[~ended], int(np.count_nonzero(ended))

    def _estimate(self, tracks: PotentialTracks, count: int | None = None) -> Candidates:
        """Estimate state and covariance and evaluate (Steps 4 and 5).

        `count` is the number of hits of each track, M if not given. At most half of a time limit is
        spent, on the tracks of smallest cost first; the others are left out.
        """
        count = count or self.options.min_hits
        order = np.arange(len(tracks))
        if self._time.finite and len(tracks) > BLOCK:
            order = np.argsort(self._cost(tracks), kind="stable")
        begin = self._time.elapsed
        blocks = [self._estimate_block(tracks.hits[order[:BLOCK], :count])]
        for first in range(BLOCK, len(tracks), BLOCK):
            if self._time.left < 0.5 * self._time.seconds:
                break
            rows = order[first : first + BLOCK]
            blocks.append(self._estimate_block(tracks.hits[rows, :count]))
        candidates = Candidates.joined(blocks)
        self._seconds_per_track = (self._time.elapsed - begin) / max(len(candidates), 1)
        return candidates[np.argsort(order[: len(candidates)])]

    def _in_time(self, candidates: Candidates) -> Candidates:
        """The best candidates, as many as can be merged in the time that is left."""
        if not self._time.finite or len(candidates) <= BLOCK:
            return candidates
        possible = self._time.left / (MERGING_COST * self._seconds_per_track)
        return candidates[keep_best(candidates.evaluation, max(int(possible), BLOCK))]

    def _estimate_block(self, ids: IntArray) -> Candidates:
        hits = self._window[ids]
        fitted = self._fit(hits)
        distance = evaluation.normalized_distance(hits, fitted)
        figure = distance
        if self.options.evaluation == "clutter_statistic":
            figure = evaluation.clutter_statistic(hits["position"], self.sensor.clutter_density)
        return Candidates(ids, fitted.state, fitted.covariance, distance, figure)

    def _fit(self, hits: NDArray[np.void]) -> Fit:
        assert self.stamp is not None
        return fit(hits, self.stamp, self.sensor, self.options.estimator)

    def _prune(self, candidates: Candidates) -> Candidates:
        """Remove the tracks whose evaluation exceeds its threshold (Step 6)."""
        options = self.options
        if options.evaluation == "clutter_statistic":
            threshold = pruning.clutter_threshold(options.clutter_test_size, options.min_hits)
        else:
            threshold = pruning.distance_threshold(
                options.pruning_probability, options.pruning_reading
            )
        return candidates[pruning.keep(candidates.evaluation, threshold)]

    def _merge(self, candidates: Candidates) -> list[ConfirmedTrack]:
        """Merge the tracks that seem to be one target's (Step 7)."""
        labels = merging.groups(
            candidates.hits,
            candidates.state,
            candidates.covariance,
            self.options.merging_probability,
        )
        return [self._merged(candidates, members) for members in merging.members_of_groups(labels)]

    def _merged(self, candidates: Candidates, members: IntArray) -> ConfirmedTrack:
        best = int(members[np.argmin(candidates.evaluation[members])])
        track = self._track(self._take_track_id(), candidates, best)
        if len(members) == 1:
            return track
        if self.options.merging == "refit":
            union = self._fit(self._window[np.unique(candidates.hits[members])][None])
            state, covariance = union.state[0], union.covariance[0]
        else:
            group = candidates[members]
            state, covariance = merging.moments(group.state, group.covariance, group.distance)
        return replace(track, state=state, covariance=covariance)

    def _track(self, track_id: int, candidates: Candidates, row: int) -> ConfirmedTrack:
        assert self.stamp is not None
        hits = self._window[candidates.hits[row]]
        return ConfirmedTrack(
            track_id=track_id,
            stamp=self.stamp,
            state=candidates.state[row],
            covariance=candidates.covariance[row],
            hits=tuple(zip(hits["scan"].tolist(), hits["index"].tolist(), strict=True)),
            evaluation=float(candidates.evaluation[row]),
            scan_count=self.scan_index + 1 - int(hits["scan"][0]),
            age=self.stamp - float(hits["time"][0]),
        )

    def _start(self, residual: IntArray, ids: IntArray) -> PotentialTracks:
        """Start a potential track from every residual detection (Step 8)."""
        return PotentialTracks.starting(ids[residual], self.scan_index, self.options.min_hits)

    def _limit(self, tracks: PotentialTracks) -> tuple[PotentialTracks, int]:
        """Keep the best potential tracks; returns them and the number cut."""
        cut = len(tracks) - self.common.max_potential_tracks
        if cut <= 0:
            return tracks, 0
        return tracks[keep_best(self._cost(tracks), self.common.max_potential_tracks)], cut

    def _cost(self, tracks: PotentialTracks) -> FloatArray:
        """Clutter statistic per degree of freedom: small is target-like, 1 a track of clutter.

        A track of one hit has none yet and counts as clutter.
        """
        cost = np.ones(len(tracks))
        for count in np.unique(tracks.hit_count[tracks.hit_count > 1]):
            rows = np.flatnonzero(tracks.hit_count == count)
            positions = self._window.positions(tracks.hits[rows, :count])
            statistic = evaluation.clutter_statistic(positions, self.sensor.clutter_density)
            cost[rows] = statistic / (2 * count - 2)
        return cost
