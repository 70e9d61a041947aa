# Copyright 2026 tsepm_ros developers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.
"""Hit counting along paths that grow from scan to scan, and the heuristic method.

`PathFollower` extends potential tracks; its `displacements` are the steps from hit to hit, which
rules of speed, acceleration and direction look at. The heuristic method is such a rule, as
Sequential 2014, Section 3.1 describes it, after Leung, Hu, Blanchette, "Evaluation of multiple
target track initiation techniques in real radar tracking environments", IEE Proc. RSN 143(4), 1996.

Positions r_i of consecutive scans are a track if they satisfy (Eq. 2)::

    v_min T <= |r_i - r_(i-1)| <= v_max T
    |(r_(i+1) - r_i) - (r_i - r_(i-1))| <= a_max T^2

and, optionally, if the angle between two steps is at most phi (Eqs. 3 and 4). "If there is
more than one return, the one with the minimum acceleration is used to form the new track."

Readings
--------
- T is the time between the detections. Velocities are over each step's own time, the acceleration
  is their difference over the time between the steps' middles: Eq. 2 where the times are equal.
- Any M of N scans: every detection of every scan may be a track's first. A track with a detection
  that satisfies the rules keeps no branch without it; one without waits, with the longer time in
  the limits. With M = N = 3, the default, the rules hold over three scans in a row.
- As printed the rules leave no room for errors, which is why the article finds that they do not
  suit a sonar: `gate_sigmas` widens the limit of the speed by the last hit's error, 0 as printed.
- Of confirmed tracks that share a detection the one with the smallest of the largest accelerations
  is published.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np

from tsepm_ros.methods import tsepm
from tsepm_ros.numerics.arrays import (
    BoolArray,
    FloatArray,
    IntArray,
    RecordArray,
    Rows,
    rows_of,
    rows_of_least_cost,
)
from tsepm_ros.parameters import parameter
from tsepm_ros.studies.assignment import (
    AssignmentPairs,
    best_assignment_of_each,
    disjoint_assignment,
)
from tsepm_ros.tracker.initial_state import NO_HIT, Fit, Paths, fit_states
from tsepm_ros.tracker.method import MethodResult, ScanStatistics
from tsepm_ros.tracker.observation import Observation
from tsepm_ros.tracker.options import MnOptions, hits_option, window_option
from tsepm_ros.tracker.tracks import TrackArrays

MAX_PAIRS = 1_000_000
"""Pairs of potential tracks and detections in a scan, at most: the shortest displacements."""


def labelled_operating_points(
    label: str, options: Sequence[str], points: Iterable[Sequence[float]]
) -> Mapping[str, Mapping[str, Any]]:
    """Values of some options at each operating point, by a label that is made of the values."""
    return MappingProxyType(
        {label.format(*point): dict(zip(options, point, strict=True)) for point in points}
    )


class PathHitCounter(tsepm.WindowedMethod):
    """A method that counts the hits of paths and puts out those that share no detection."""

    def fit(self, hits: RecordArray, paths: Paths) -> Fit:
        """Fit the states to the hits (n, m) of n paths."""
        return fit_states(hits, self.stamp, self.sensor, "unweighted")

    def evaluate(self, hits: RecordArray, fitted: Fit) -> FloatArray:
        """The method's figure, (n,), small for a target; f_1 (TSEPM 2018, Eq. 23) if not another.

        Parameters
        ----------
        hits : (n, m) ndarray of DETECTION
        fitted : Fit
        """
        return tsepm.normalized_distance(hits, fitted)

    def accept(self, estimates: tsepm.Estimates) -> BoolArray:
        """Which tracks may be published, (n,): those with a finite state estimate."""
        finite = np.isfinite(estimates.covariance).all(axis=(1, 2))
        return np.asarray(finite & np.isfinite(estimates.state).all(axis=1))

    def estimate(self, paths: Paths) -> tsepm.Estimates:
        """Fit and evaluate paths, block by block of equal hit counts."""
        n = len(paths)
        estimates = tsepm.Estimates(paths.hits, np.zeros((n, 4)), np.zeros((n, 4, 4)), np.zeros(n))
        for rows, ids in paths.of_equal_count():
            hits = self.detections[ids]
            fitted = self.fit(hits, paths[rows])
            estimates.state[rows], estimates.covariance[rows] = fitted.state, fitted.covariance
            estimates.evaluation[rows] = self.evaluate(hits, fitted)
        return estimates

    def preference(self, estimates: tsepm.Estimates) -> FloatArray:
        """Figure, (n,): of tracks that share a detection that of the smallest is published."""
        return estimates.evaluation

    def confirm(self, raw: Paths) -> tuple[TrackArrays, IntArray, int]:
        """The best of some paths that share no detection, as tracks.

        Parameters
        ----------
        raw : Paths

        Returns
        -------
        tracks : TrackArrays
            Their places as ids.
        hits : (n, most) ndarray of int
            Their detections' ids, with NO_HIT.
        refused : int
            Paths that may not be published; the others share a hit with a better one.
        """
        estimates = self.estimate(raw)
        estimates = estimates[self.accept(estimates)]
        best = estimates[disjoint_assignment(estimates.hits, self.preference(estimates))]
        return self.tracks(best), best.hits, len(raw) - len(estimates)


@dataclass(frozen=True)
class PathDisplacements(Rows):
    """Two steps that follow each other, a row each.

    Attributes
    ----------
    before, after : (p, 2) ndarray
        From the hit before the last to the last, and from there on, m.
    time_before, time_after : (p,) ndarray
        Times of the steps, s.
    """

    before: FloatArray
    after: FloatArray
    time_before: FloatArray
    time_after: FloatArray

    @classmethod
    def of(cls, position: FloatArray, time: FloatArray) -> PathDisplacements:
        """The steps between three positions (p, 3, 2), m, at times (p, 3), s."""
        step, elapsed = np.diff(position, axis=1), np.diff(time, axis=1)
        return cls(step[:, 0], step[:, 1], elapsed[:, 0], elapsed[:, 1])

    @property
    def acceleration(self) -> FloatArray:
        """Change of velocity over the time between the middles of the steps, (p,), m/s^2.

        For steps of one duration T it is ``|(r_3 - r_2) - (r_2 - r_1)| / T^2``; nan or infinite
        where a step takes no time.
        """
        with np.errstate(invalid="ignore", divide="ignore"):
            change = self.after / self.time_after[:, None] - self.before / self.time_before[:, None]
            time = 0.5 * (self.time_before + self.time_after)
            return np.hypot(change[:, 0], change[:, 1]) / np.abs(time)

    def faster_than(self, speed: float) -> BoolArray:
        """Whether the steps after have at least a speed (m/s), (p,)."""
        length = np.hypot(self.after[:, 0], self.after[:, 1])
        return np.asarray(length >= speed * np.abs(self.time_after))

    @property
    def turn(self) -> FloatArray:
        """Angle between the steps, (p,), rad; 0 where one has no length."""
        along = (self.before * self.after).sum(axis=1)
        across = self.before[:, 0] * self.after[:, 1] - self.before[:, 1] * self.after[:, 0]
        return np.abs(np.arctan2(across, along))


class PathFollower(PathHitCounter):
    """A hit counter that extends potential tracks from scan to scan.

    A method finds the detections that may extend each potential track (`pairs`) and chooses among
    them (`choose`). A detection that extends none starts a potential track, which ends N scans
    later. The hits of a confirmed track are no other's: potential tracks that share one end.
    """

    every_detection_starts: ClassVar[bool] = False
    """Whether a detection that extends a potential track starts another as well."""

    @abstractmethod
    def pairs(self, detections: RecordArray) -> tuple[AssignmentPairs, int]:
        """Potential tracks and detections that may extend them; and the pairs a limit left out."""

    def choose(self, pairs: AssignmentPairs) -> AssignmentPairs:
        """The pairs that become potential tracks: for each track the best.

        A first hit, of which no motion is known yet, is extended by every detection it may be.
        """
        single = self.potential.hit_count[pairs.parent] == 1
        return AssignmentPairs.joined(pairs[single], best_assignment_of_each(pairs[~single]))

    @property
    def ends_when_missed(self) -> bool:
        """Whether a potential track that no detection extends ends at once."""
        return False

    def step(self, observed: Observation) -> MethodResult:
        """Extend the potential tracks, confirm those of M hits, start new ones.

        See `Method.step`.
        """
        detections = observed.detections
        ids = self.begin(observed)
        pairs, cut_pairs = self.pairs(detections)
        extending, cut_potential, cut_raw = self._within_limits(self.choose(pairs))
        row = extending.row
        children = self.extended(extending.parent, ids[row], rows_of(detections, row))
        reached = children.hit_count >= self.options.min_hits
        tracks, hits, refused = self.confirm(children[reached])
        missed = np.ones(len(self.potential), bool)
        missed[extending.parent] = False
        waiting, terminated = self._waiting(children[~reached], self.potential[missed], hits)
        is_free = ~np.isin(ids, hits)
        if not self.every_detection_starts:
            is_free[row] = False
        free = np.flatnonzero(is_free)
        beyond = max(len(free) - self.max_tracks, 0)
        begun = free[: self.max_tracks]
        started = self.started(ids[begun], rows_of(detections, begun))
        self.potential, surplus = self._limit(type(started).joined(waiting, started))
        evaluated = int(np.count_nonzero(reached))
        return MethodResult(
            tracks,
            ScanStatistics(
                scans=1,
                detections=len(detections),
                potential_tracks=len(self.potential),
                started=len(started),
                split=len(children) + len(started),
                evaluated=evaluated,
                terminated=terminated,
                raw_confirmations=evaluated + cut_raw,
                pruned=refused,
                merged=evaluated - refused - len(tracks),
                confirmed=len(tracks),
                cut_potential_tracks=cut_pairs + cut_potential + beyond + surplus,
                cut_confirmations=cut_raw,
            ),
        )

    def potential_tracks(self, observed: Observation) -> TrackArrays:
        """Hypotheses with at least two hits; `evaluation` is the figure of the hits so far.

        See `Method.potential_tracks`.
        """
        estimates = self.estimate(self.potential[self.potential.hit_count > 1])
        return self.tracks(estimates[self.accept(estimates)])

    def _waiting(self, growing: Paths, missed: Paths, confirmed: IntArray) -> tuple[Paths, int]:
        """The potential tracks that go on, of those with and without a new hit; and how many end.

        Those end whose scans are over, and those with a hit that is a confirmed track's.
        """
        waiting = growing if self.ends_when_missed else type(growing).joined(growing, missed)
        ended = self.expired(waiting.first_scan)
        ended |= np.isin(waiting.hits, confirmed[confirmed != NO_HIT]).any(axis=1)
        going_on = waiting[~ended]
        return going_on, len(growing) + len(missed) - len(going_on)

    @property
    def max_tracks(self) -> int:
        """Potential tracks kept at most."""
        return int(max(min(self.common.max_potential_tracks, self.most_pairs), 1))

    def extended(self, parent: IntArray, ids: IntArray, detections: RecordArray) -> Paths:
        """Potential tracks that each add a detection; see `Paths.extended`."""
        return self.potential.extended(parent, ids)

    def reachable(
        self, detections: RecordArray, margin: FloatArray
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
            self.potential.last_hit, return_index=True, return_inverse=True
        )
        hits = self.detections[last_hits]
        gated = tsepm.gate_within(
            hits,
            detections,
            self.common.max_speed,
            margin[first],
            most=self.most_pairs,
        )
        owner = np.ascontiguousarray(hits["position"])

        def length(parent: IntArray, row: IntArray) -> FloatArray:
            displacement = detections["position"][row] - owner[gate[parent]]
            return np.hypot(displacement[:, 0], displacement[:, 1])

        most = int(max(min(self.most_pairs, MAX_PAIRS), 1))
        parent, row, cut = tsepm.split_paths(gate, gated, most, length, most)
        return parent, row, cut + gated.cut

    def displacements(
        self, detections: RecordArray, gate_sigmas: float
    ) -> tuple[IntArray, IntArray, PathDisplacements, BoolArray, int]:
        """The displacements to reachable detections from the last two hits of the potential tracks.

        Parameters
        ----------
        detections : (n,) ndarray of DETECTION
        gate_sigmas : float
            Margin of the reach, in standard deviations of the last hit.

        Returns
        -------
        parent, row : (p,) ndarray of int
            Rows of potential tracks and detections.
        displacements : PathDisplacements
        first : (p,) ndarray of bool
            Whether the track has one hit only; it then counts as both.
        cut : int
            Pairs that a limit left out.
        """
        tracks = self.potential
        sigma = self.detections[tracks.last_hit]["major_sigma"]
        parent, row, cut = self.reachable(detections, gate_sigmas * sigma)
        before = tracks.hits[np.arange(len(tracks)), np.maximum(tracks.hit_count - 2, 0)]
        known = self.detections[np.stack([before, tracks.last_hit], axis=1)]
        position = np.concatenate(
            [known["position"][parent], detections["position"][row, None]], axis=1
        )
        time = np.concatenate([known["time"][parent], detections["time"][row, None]], axis=1)
        return parent, row, PathDisplacements.of(position, time), tracks.hit_count[parent] == 1, cut

    def _within_limits(self, pairs: AssignmentPairs) -> tuple[AssignmentPairs, int, int]:
        """The best pairs within the limits, and how many potential and complete tracks are cut."""
        complete = self.potential.hit_count[pairs.parent] == self.options.min_hits - 1
        kept = []
        for part, limit in (
            (pairs[~complete], self.max_tracks),
            (pairs[complete], self.common.max_potential_tracks),
        ):
            kept.append(part[rows_of_least_cost(part.cost, limit)])
        counts = np.count_nonzero(~complete), np.count_nonzero(complete)
        cut = [int(count) - len(part) for count, part in zip(counts, kept, strict=True)]
        return AssignmentPairs.joined(*kept), cut[0], cut[1]

    def _limit(self, tracks: Paths) -> tuple[Paths, int]:
        """Keep the potential tracks of the most hits; returns them and the number cut."""
        kept = rows_of_least_cost(-tracks.hit_count.astype(float), self.max_tracks)
        return tracks[kept], len(tracks) - len(kept)


@dataclass(frozen=True, kw_only=True)
class StepLimitOptions(MnOptions):
    """Options of methods that limit the steps between consecutive hits."""

    min_step_speed: float = parameter(
        0.0, "Minimum speed of a step (v_min)", unit="m/s", minimum=0.0, maximum=1e4
    )
    gate_sigmas: float = parameter(
        0.0,
        "Margin of the speed limit for errors, in standard deviations of the last hit",
        minimum=0.0,
        maximum=100.0,
    )


@dataclass(frozen=True, kw_only=True)
class HeuristicOptions(StepLimitOptions):
    """Options of the heuristic method."""

    min_hits: int = hits_option(3, minimum=3)
    window: int = window_option(3, minimum=3)
    max_acceleration: float = parameter(
        1.0, "Maximum acceleration (a_max)", unit="m/s^2", positive=True, maximum=1e4
    )
    max_turn: float = parameter(
        math.pi,
        "Maximum angle between two steps (phi); pi: no limit",
        unit="rad",
        positive=True,
        maximum=math.pi,
    )


class HeuristicPathFollower(PathFollower):
    """The heuristic method: limits of speed and acceleration over consecutive scans."""

    Options = HeuristicOptions
    options: HeuristicOptions
    operating_points = labelled_operating_points(
        "{}/{}, {:g} m/s^2, {:g} sigma",
        ("min_hits", "window", "max_acceleration", "gate_sigmas"),
        (
            (5, 5, 1.0, 0.0),
            (4, 4, 1.0, 0.0),
            (3, 3, 0.3, 0.0),
            (3, 3, 1.0, 0.0),
            (6, 8, 2.0, 2.0),
            (4, 5, 2.0, 2.0),
            (3, 3, 2.0, 2.0),
        ),
    )
    every_detection_starts = True

    def pairs(self, detections: RecordArray) -> tuple[AssignmentPairs, int]:
        """The detections that satisfy the rules after each track's last hits, by acceleration."""
        options = self.options
        parent, row, displacements, first, cut = self.displacements(detections, options.gate_sigmas)
        acceleration = np.where(first, 0.0, displacements.acceleration)
        straight = displacements.turn <= options.max_turn
        straight &= acceleration <= options.max_acceleration
        kept = displacements.faster_than(options.min_step_speed) & (first | straight)
        return AssignmentPairs(parent[kept], row[kept], acceleration[kept]), cut

    def evaluate(self, hits: RecordArray, fitted: Fit) -> FloatArray:
        """Largest acceleration of each track, (n,), m/s^2; 0 of two hits."""
        n, count = hits.shape
        largest = np.zeros(n)
        for last in range(2, count):
            three = hits[:, last - 2 : last + 1]
            displacements = PathDisplacements.of(three["position"], three["time"])
            largest = np.maximum(largest, displacements.acceleration)
        return largest
