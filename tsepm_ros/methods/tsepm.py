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
"""TSEPM: track splitting, evaluating, pruning and merging, as published in 2018.

Li D., Lin Y., Zhang Y., "A track initiation method for the underwater target tracking
environment", China Ocean Eng. 32(2), 206-215, 2018. Its equations, with z_i the last hit of a
potential track, k T the time since, sigma_Rmax the major axis of its error, d_k the distance of hit
k from the one before, H_k the state's way to hit k::

    gate          |z_j - z_i| <= v_max k T + alpha sigma_Rmax                    (4)
                  alpha = sqrt(-2 ln(1 - P))                                     (5)
    positions     unbiased conversion of range and azimuth, covariance R         (6)-(11)
    rule          N_v >= M hits within N_a <= N scans                            Step 3
    state         X = (H'H)^-1 H' Z                                              (19)
    covariance    P = (H'H)^-1 H' R H (H'H)^-1                                   (20)
    distance      f(k) = (Z_k - H_k X)' (H_k P H_k' + R_k)^-1 (Z_k - H_k X)      (21), (22)
    evaluation    f_1 = max_k f(k)                                               (23)
    or            f_2 = 2 lambda sum_k pi d_k^2                                  (24), (25)
    pruning       f_1 <= gamma_TP = sqrt(-2 ln(1 - P_TP))                        (26)
    merging       confirmed in one scan, more than M/2 hits shared, and
                  (X_1 - X_2)' (P_1 + P_2)^-1 (X_1 - X_2) <= gamma_TM^2          (27)-(30)
    merged        X = sum p_i X_i,  P = sum p_i P_i,  p_i ~ f_1(i)               (31)-(33)

Readings
--------
- Eq. 4's margin is that of one detection, as printed, although both have errors.
- Eq. 21 adds the state's covariance to R although hit k is in the fit; kept.
- Eq. 22 is a squared distance, Eq. 26 an unsquared threshold: `pruning_reading`.
- Which of f_1 and f_2 prunes is not said: `evaluation`. Small is kept (Step 6), of f_2 too, where
  Section 3.5 rejects clutter that "exceeds" the threshold. V(k) in Eq. 25 is the area out to hit k.
- Eq. 30 tests four degrees of freedom with the threshold of two; kept, `merging_probability`.
- Groups are the connected components of the pairwise conditions. Eq. 31 weighs by f_1 as printed,
  so that the worse fit weighs more; "estimate again" (Step 7) may be `merging: refit` instead.
- A potential track with a gated detection keeps no branch without it, and only detections outside
  every gate start one (Steps 2 and 8), as printed.
- Eq. 16 is read as ``H_tM A^(ti - tM)``, in seconds, so that intervals may differ.

Paths that share a last hit share its gate. Where a limit cuts, the paths least like clutter are
kept; a path that is cut has no gate any more.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from types import MappingProxyType
from typing import Any, Self

import numpy as np
from scipy.special import chdtri

from tsepm_ros.methods import shared_hits
from tsepm_ros.numerics.arrays import (
    BoolArray,
    FloatArray,
    IntArray,
    RecordArray,
    Rows,
    rows_of,
    rows_of_groups,
    rows_of_least_cost,
)
from tsepm_ros.numerics.gaussian import gate_factor, squared_mahalanobis_distance
from tsepm_ros.parameters import parameter
from tsepm_ros.tracker import motion, range_rates
from tsepm_ros.tracker.initial_state import (
    ESTIMATORS,
    MAX_ROWS_TOGETHER,
    Fit,
    Paths,
    fit_states,
    new_paths,
)
from tsepm_ros.tracker.measurement import DETECTION, MeasurementWindow
from tsepm_ros.tracker.method import Method, MethodResult, ScanStatistics
from tsepm_ros.tracker.observation import Observation
from tsepm_ros.tracker.options import CommonOptions, MnOptions
from tsepm_ros.tracker.sensor import SensorModel
from tsepm_ros.tracker.splitting import RADIUS_ROUNDING, neighbours
from tsepm_ros.tracker.tracks import NO_TRACKS, ConfirmedTrack, TrackArrays, tracks_from_hits

SPLIT_BLOCK = 1_000_000
"""Children processed together where a limit applies: bounds memory, not the result."""

EVALUATIONS = ("normalized_distance", "clutter_statistic")

READINGS = ("literal", "squared")

MERGINGS = ("moments", "refit")

CONFIRMED_PER_PAIR = 0.25
"""Tracks that reach confirmation, per pair that a scan may have, at most: they are estimated."""
ROUNDING = 1e-9
"""Difference up to which evaluations of merged tracks are equal: then the shorter path counts."""


@dataclass(frozen=True, kw_only=True)
class TsepmOptions(MnOptions):
    """Options of the published method; the defaults are the paper's."""

    gate_probability: float = parameter(
        0.9,
        "Probability P that a detected target falls into the gate (Eq. 5)",
        positive=True,
        maximum=0.999999,
    )
    estimator: str = parameter(
        "unweighted",
        "Fit of a track. unweighted: least squares as published; weighted: least squares "
        "with errors re-evaluated at the fit",
        choices=ESTIMATORS,
    )
    evaluation: str = parameter(
        "normalized_distance",
        "Evaluation of a track. normalized_distance: f_1 (Eq. 23); clutter_statistic: Kennedy's "
        "f_2 (Eq. 25)",
        choices=EVALUATIONS,
    )
    pruning_probability: float = parameter(
        0.99,
        "Probability P_TP that a true track's distance passes (Eq. 26)",
        positive=True,
        maximum=0.999999,
    )
    pruning_reading: str = parameter(
        "literal",
        "Threshold of f_1. literal: that of Eq. 26 as printed; squared: its square",
        choices=READINGS,
    )
    clutter_test_size: float = parameter(
        0.05,
        "Nominal fraction of clutter tracks that pass Kennedy's test",
        positive=True,
        maximum=0.999999,
    )
    merging_probability: float = parameter(
        0.9, "Probability P_TM that two states overlap (Eq. 30)", positive=True, maximum=0.999999
    )
    merging: str = parameter(
        "moments",
        "Merged state. moments: by Eqs. 31-33; refit: fitted again to the union of the hits",
        choices=MERGINGS,
    )


@dataclass(frozen=True)
class Estimates(Rows):
    """Tracks as estimated from their hits.

    Attributes
    ----------
    hits : (n, most) ndarray of int
        Detection ids, then NO_HIT.
    state, covariance : (n, 4), (n, 4, 4) ndarray
        At the last scan's stamp.
    evaluation : (n,) ndarray
        The method's figure; smaller is better.
    """

    hits: IntArray
    state: FloatArray
    covariance: FloatArray
    evaluation: FloatArray


@dataclass(frozen=True)
class Candidates(Estimates):
    """Tracks that reached confirmation, fitted and evaluated.

    Attributes
    ----------
    hits, state, covariance, evaluation
        As in `Estimates`, of M hits each.
    distance : (n,) ndarray
        f_1, also the weight in merging.
    """

    distance: FloatArray

    @classmethod
    def none(cls, hits: int) -> Self:
        """No tracks, of a number of hits."""
        figures = np.zeros(0)
        return cls(
            np.zeros((0, hits), np.int64), np.zeros((0, 4)), np.zeros((0, 4, 4)), figures, figures
        )


def path_cost(paths: Paths, detections: MeasurementWindow) -> FloatArray:
    """Clutter statistic per degree of freedom, (n,): small is target-like, 1 a track of clutter.

    The statistic is f_2 of the hits so far (Eq. 25). A path of one hit has none yet and counts as
    clutter.
    """
    cost = np.ones(len(paths))
    for rows, hits in paths.of_equal_count():
        if hits.shape[1] > 1:
            statistic = clutter_statistic(
                detections.column("position", hits), detections.column("clutter_density", hits)
            )
            cost[rows] = statistic / (2.0 * hits.shape[1] - 2.0)
    return cost


class WindowedMethod(Method):
    """A method that confirms tracks by M hits within a window of N scans.

    Its `Options` have `min_hits` (M) and `window` (N).

    Attributes
    ----------
    detections : MeasurementWindow
        Those of the last scans, to which hits of potential tracks refer.
    stamp : float
        Of the last scan, s.
    scan_index : int
        Of the last scan.
    most_pairs : float
        See `Observation`.
    potential : Paths
        Potential tracks.
    """

    def forget(self) -> None:
        """See `Method.forget`."""
        self.detections = MeasurementWindow()
        self.stamp, self.scan_index = 0.0, -1
        self.most_pairs = math.inf
        self.potential = self.started(np.zeros(0, np.int64), np.zeros(0, DETECTION))

    def configure(self, sensor: SensorModel, common: CommonOptions, options: Any) -> bool:
        """Change the options; a shorter window ends tracks, another number of hits starts over.

        See `Method.configure`.
        """
        kept = options.min_hits == self.options.min_hits
        super().configure(sensor, common, options)
        if not kept:
            self.forget()
        self.potential = self.potential[~self.expired(self.potential.first_scan)]
        return bool(kept)

    def started(self, ids: IntArray, detections: RecordArray) -> Paths:
        """Potential tracks of a detection each, by the ids of these in the window."""
        return new_paths(ids, self.scan_index, self.options.min_hits)

    def begin(self, observed: Observation) -> IntArray:
        """Take a scan; returns the ids of its detections, (d,)."""
        self.stamp, self.scan_index = observed.stamp, observed.scan_index
        self.most_pairs = observed.most_pairs
        self.detections = observed.window
        return observed.ids

    def expired(self, first_scan: IntArray) -> BoolArray:
        """Which paths have had their N scans, (n,), by the scans of their first hits (Step 3).

        A path that can no longer reach M hits still exists, and gates detections, until then.
        """
        return np.asarray(self.scan_index + 1 - first_scan >= self.options.window)

    def tracks(self, estimates: Estimates) -> TrackArrays:
        """Estimates as tracks, their places as ids."""
        return tracks_from_hits(
            self.detections,
            estimates.hits,
            stamp=self.stamp,
            scan_index=self.scan_index,
            state=estimates.state,
            covariance=estimates.covariance,
            evaluation=estimates.evaluation,
        )

    def reason(self, track: ConfirmedTrack) -> str:
        """The rule that the track satisfied.

        See `Method.reason`.
        """
        rule = f"{self.options.min_hits}/{self.options.window}"
        return f"{super().reason(track)}, by the rule {rule}"


class Tsepm(WindowedMethod):
    """The method of TSEPM 2018, step by step as in its Section 4."""

    Options = TsepmOptions
    options: TsepmOptions
    operating_points = MappingProxyType(
        {
            f"{min_hits}/{window}": {"min_hits": min_hits, "window": window}
            for min_hits, window in ((8, 12), (8, 16), (6, 8), (4, 5), (5, 8), (3, 3), (3, 4))
        }
        | {
            f"f2 {size:g}": {"evaluation": "clutter_statistic", "clutter_test_size": size}
            for size in (0.01, 0.05, 0.2)
        }
    )

    def step(self, observed: Observation) -> MethodResult:
        """Take one scan through Steps 2-8.

        See `Method.step`.
        """
        ids = self.begin(observed)
        last_hits, gate_of_path = np.unique(self.potential.last_hit, return_inverse=True)
        gated = self.gated(self.detections[last_hits], observed.detections)  # Step 2
        updated, cut_raw, cut_extended = self._split(gate_of_path, gated, ids)
        missed = self.potential[gated.count[gate_of_path] == 0]
        raw, potential, terminated = self._confirm(updated, missed)  # Step 3
        candidates = self._estimate(raw)  # Steps 4 and 5
        passes = np.isfinite(candidates.distance) & (candidates.evaluation <= self.threshold)
        kept = candidates[passes]  # Step 6
        tracks = self.merge(kept)  # Step 7
        residual = np.delete(ids, gated.detection)
        started = new_paths(residual, self.scan_index, self.options.min_hits)  # Step 8
        potential = Paths.joined(potential, started)
        self.potential = self._limit(potential)
        return MethodResult(
            tracks,
            ScanStatistics(
                scans=1,
                detections=len(observed.detections),
                potential_tracks=len(self.potential),
                started=len(started),
                split=len(updated) + len(started),
                evaluated=len(candidates),
                terminated=terminated,
                raw_confirmations=len(raw),
                pruned=len(candidates) - len(kept),
                merged=len(kept) - len(tracks),
                confirmed=len(tracks),
                cut_potential_tracks=gated.cut
                + cut_extended
                + (len(potential) - len(self.potential)),
                cut_confirmations=cut_raw,
            ),
        )

    def reason(self, track: ConfirmedTrack) -> str:
        """Its rule, and the evaluation with its threshold.

        See `Method.reason`.
        """
        name = "f_1" if self.options.evaluation == "normalized_distance" else "f_2"
        figure = f"{name} is {track.evaluation:.2f}"
        return f"{super().reason(track)}; {figure}, at most the threshold {self.threshold:.2f}"

    def potential_tracks(self, observed: Observation) -> TrackArrays:
        """Hypotheses with at least two hits; `evaluation` is f_1 of the hits so far.

        See `Method.potential_tracks`.
        """
        several = [
            self._estimate(self.potential[self.potential.hit_count == count], count)
            for count in range(2, self.options.min_hits)
        ]
        tracks = TrackArrays.joined(NO_TRACKS, *map(self.tracks, several))
        return tracks.numbered(np.arange(len(tracks)))

    def gated(self, last_hits: RecordArray, detections: RecordArray) -> Gates:
        """Detections in the gate of each last hit (Eqs. 4-5)."""
        factor, speed = gate_factor(self.options.gate_probability), self.common.max_speed
        margin = factor * last_hits["major_sigma"]
        return gate_within(last_hits, detections, speed, margin, factor**2, self.most_pairs)

    def _split(self, gate_of_path: IntArray, gated: Gates, ids: IntArray) -> tuple[Paths, int, int]:
        """Extend every track by each of its gated detections (Step 2).

        Returns the children, and how many were cut: of those with M hits, and of the others.
        """
        last = self.potential.hit_count == self.options.min_hits - 1
        limit = self.common.max_potential_tracks
        parts, cuts = [], []
        complete = int(max(min(limit, CONFIRMED_PER_PAIR * self.most_pairs), 1))
        for rows, most in (np.flatnonzero(last), complete), (np.flatnonzero(~last), limit):
            tracks = self.potential[rows]
            cost = partial(self._cost_of_children, tracks, ids)
            parent, newest, cut = split_paths(
                gate_of_path[rows], gated, most, cost, self.most_pairs
            )
            parts.append(tracks.extended(parent, ids[newest]))
            cuts.append(cut)
        return Paths.joined(*parts), cuts[0], cuts[1]

    def _cost_of_children(
        self, tracks: Paths, ids: IntArray, parent: IntArray, newest: IntArray
    ) -> FloatArray:
        """`path_cost` of the tracks (p,) with one more detection each."""
        return path_cost(tracks.extended(parent, ids[newest]), self.detections)

    def _confirm(self, updated: Paths, missed: Paths) -> tuple[Paths, Paths, int]:
        """Apply the M/N rule (Step 3).

        Returns the newly confirmed tracks, those that stay potential, and how many it ended.
        """
        reached = updated.hit_count >= self.options.min_hits
        waiting = Paths.joined(updated[~reached], missed)
        ended = self.expired(waiting.first_scan)
        return updated[reached], waiting[~ended], int(np.count_nonzero(ended))

    def _estimate(self, tracks: Paths, count: int | None = None) -> Candidates:
        """Estimate state and covariance and evaluate (Steps 4 and 5).

        `count` is the number of hits of each track, M if not given.
        """
        hits = tracks.hits[:, : count or self.options.min_hits]
        firsts = range(0, len(tracks), MAX_ROWS_TOGETHER)
        blocks = [self.estimated(hits[first : first + MAX_ROWS_TOGETHER]) for first in firsts]
        return Candidates.joined(Candidates.none(hits.shape[1]), *blocks)

    def estimated(self, ids: IntArray) -> Candidates:
        """The tracks of hits with some ids (n, m): fitted and evaluated (Steps 4 and 5)."""
        hits = self.detections[ids]
        fitted = self.fit(hits)
        distance = normalized_distance(hits, fitted)
        figure = distance
        if self.options.evaluation == "clutter_statistic":
            figure = clutter_statistic(hits["position"], hits["clutter_density"])
        return Candidates(ids, fitted.state, fitted.covariance, figure, distance)

    def fit(self, hits: RecordArray) -> Fit:
        """Fit the states to the hits (n, m) of n tracks (Step 4)."""
        return fit_states(hits, self.stamp, self.sensor, self.options.estimator)

    @property
    def threshold(self) -> float:
        """Largest evaluation with which a track is kept (Eq. 26, or the clutter test's)."""
        options = self.options
        if options.evaluation == "clutter_statistic":
            return clutter_threshold(options.clutter_test_size, options.min_hits)
        return distance_threshold(options.pruning_probability, options.pruning_reading)

    def merge(self, candidates: Candidates) -> TrackArrays:
        """Merge the tracks that seem to be one target's (Step 7)."""
        labels = shared_hits.groups(
            candidates.hits,
            candidates.state,
            candidates.covariance,
            self.options.merging_probability,
        )
        groups = rows_of_groups(labels)
        best = [
            members[0] if len(members) < 2 else self._best(candidates, members)
            for members in groups
        ]
        tracks = self.tracks(candidates[np.array(best, np.int64)])
        for row, members in enumerate(groups):
            if len(members) > 1:
                tracks.state[row], tracks.covariance[row] = self.merged(candidates[members])
        return tracks

    def _best(self, candidates: Candidates, members: IntArray) -> int:
        """The member of the least evaluation; of those equal to `ROUNDING`, of the shortest path.

        Exact ties are usual: with M hits in M equidistant scans the residuals of the fit at two of
        its hits depend on two hits only, that members share.
        """
        evaluation = candidates.evaluation[members]
        equal = members[evaluation <= evaluation.min() + ROUNDING]
        places = self.detections.column("position", candidates.hits[equal])
        length = np.hypot(*np.diff(places, axis=1).T).sum(axis=0)
        return int(equal[np.lexsort((*places.reshape(len(equal), -1).T, length))[0]])

    def merged(self, group: Candidates) -> tuple[FloatArray, FloatArray]:
        """State and covariance of a group."""
        if self.options.merging == "refit":
            union = self.fit(self.detections[np.unique(group.hits)][None])
            return union.state[0], union.covariance[0]
        return shared_hits.moments(group.state, group.covariance, group.distance)

    def _limit(self, tracks: Paths) -> Paths:
        """The best potential tracks, as many as may be held."""
        limit = self.common.max_potential_tracks
        if len(tracks) <= limit:
            return tracks
        return tracks[rows_of_least_cost(path_cost(tracks, self.detections), limit)]


def distance_threshold(probability: float, reading: str) -> float:
    """Threshold for `normalized_distance` (Eq. 26).

    ``gamma_TP = sqrt(-2 ln(1 - P_TP))``. Eq. 22 is a squared distance, so the reading ``literal``
    compares it with gamma_TP as printed, ``squared`` with gamma_TP^2.
    """
    gamma = gate_factor(probability)
    return gamma if reading == "literal" else gamma * gamma


def clutter_threshold(size: float, min_hits: int) -> float:
    """Threshold for `clutter_statistic`: the chi-square quantile with 2 M - 2 degrees of freedom.

    `size` is the nominal fraction of clutter tracks that pass. The measured fraction differs: a
    gate truncates the statistic, and split tracks use other points than the nearest.
    """
    return float(chdtri(2 * min_hits - 2, 1.0 - size))


def normalized_distance(hits: RecordArray, fit: Fit) -> FloatArray:
    """Largest squared Mahalanobis distance of hits from their fit, f_1 (Eqs. 21-23).

    ``f(k) = (z_k - H x_k)' (H P_k H' + R_k)^-1 (z_k - H x_k)``, ``f_1 = max_k f(k)``

    As published, the state's covariance is added although the fit contains the hit, so f(k) is
    smaller than a chi-square variable.

    Parameters
    ----------
    hits : (n, m) ndarray of DETECTION
        The hits that were fitted.
    fit : Fit
        Their fit.

    Returns
    -------
    (n,) ndarray
        A squared Mahalanobis distance, without unit.
    """
    time_after_state = fit.time_after_state
    residual = hits["position"] - motion.position_after(fit.state[:, None], time_after_state)
    covariance = motion.position_covariance_after(fit.covariance[:, None], time_after_state)
    residual_covariance = covariance + fit.hit_covariance
    return squared_mahalanobis_distance(residual, residual_covariance).max(axis=1)


def clutter_statistic(positions: FloatArray, clutter_density: FloatArray | float) -> FloatArray:
    """Kennedy's clutter statistic f_2 (Eqs. 24-25).

    ``f_2 = 2 sum_k lambda_k V(k)``, V(k) = pi d_k^2 the area out to the associated point at
    distance d_k from the previous hit, lambda_k the density there. For nearest points of pure
    clutter it is chi-square distributed with 2 M - 2 degrees of freedom; for a target it is small.

    Parameters
    ----------
    positions : (n, m, 2) ndarray
        Positions of the hits, oldest first, m.
    clutter_density : (n, m) ndarray or float
        lambda, 1/m^2: a common value, as published, or the value at each hit.

    Returns
    -------
    (n,) ndarray
    """
    squared_displacement = np.square(np.diff(positions, axis=1)).sum(axis=2)
    density = np.broadcast_to(clutter_density, positions.shape[:2])[:, 1:]
    return np.asarray(2.0 * np.pi * (density * squared_displacement).sum(axis=1))


@dataclass(frozen=True)
class Gates:
    """The detections in each gate, as compressed rows.

    Attributes
    ----------
    start : (g + 1,) ndarray of int
        Gate i holds ``detection[start[i]:start[i + 1]]``.
    detection : (p,) ndarray of int
        Rows of the gated detections, ascending within a gate.
    cut : int
        Detections left out of gates because of `MAX_GATED`.
    """

    start: IntArray
    detection: IntArray
    cut: int = 0

    @cached_property
    def count(self) -> IntArray:
        """Number of detections in each gate, (g,)."""
        return self.start[1:] - self.start[:-1]


def gate_within(
    last_hits: RecordArray,
    detections: RecordArray,
    max_speed: float,
    margin: FloatArray,
    range_rate_gate: float = math.inf,
    most: float = math.inf,
) -> Gates:
    """Find the detections inside the gate of each last hit (Eq. 4).

    ``|z_j - z_i| <= v_max |t_j - t_i| + alpha sigma_Rmax`` bounds the displacement of a target
    from hit i; sigma_Rmax is the major axis of hit i's error. Range rates of both, if used, must
    agree with each other and with the displacement along the line of sight, within the same
    probability (`range_rates.agree`).

    Parameters
    ----------
    last_hits : (g,) ndarray of DETECTION
        Last hits of the potential tracks, without duplicates.
    detections : (n,) ndarray of DETECTION
        Detections of the new scan.
    max_speed : float
        v_max, m/s.
    margin : (g,) ndarray
        ``alpha sigma_Rmax``, m.
    range_rate_gate : float, optional
        ``alpha^2``, within which range rates agree; infinite: they do not count.
    most : float, optional
        Pairs, see `neighbours`.
    """
    n_gates = len(last_hits)
    if n_gates == 0 or len(detections) == 0:
        return Gates(np.zeros(n_gates + 1, np.int64), np.zeros(0, np.int64))
    times = detections["time"]
    first, last = times.min(), times.max()
    longest = np.maximum(np.abs(first - last_hits["time"]), np.abs(last - last_hits["time"]))
    # Slightly larger radii for the k-d tree's candidates; the exact test follows.
    radius = (margin + max_speed * longest) * (1.0 + RADIUS_ROUNDING)
    positions = np.ascontiguousarray(detections["position"])
    centres = np.ascontiguousarray(last_hits["position"])
    owner, candidate, cut = neighbours(positions, centres, radius, most)
    displacement = positions[candidate] - centres[owner]
    elapsed = np.abs(times[candidate] - last_hits["time"][owner])
    inside = np.hypot(displacement[:, 0], displacement[:, 1]) <= max_speed * elapsed + margin[owner]
    if math.isfinite(range_rate_gate) and range_rates.measured(detections).any():
        near = np.flatnonzero(inside)
        inside[near] = range_rates.agree(
            rows_of(last_hits, owner[near]),
            rows_of(detections, candidate[near]),
            max_speed,
            range_rate_gate,
        )
    start = np.zeros(n_gates + 1, np.int64)
    np.cumsum(np.bincount(owner[inside], minlength=n_gates), out=start[1:])
    return Gates(start, candidate[inside], cut)


def children_in_gates(gate_of_track: IntArray, gated: Gates) -> tuple[IntArray, IntArray]:
    """Split every potential track into one child per gated detection (Section 3.2).

    Parameters
    ----------
    gate_of_track : (n,) ndarray of int
        The gate (row of `gated`) that each potential track uses.
    gated : Gated
        Detections in each gate.

    Returns
    -------
    parent : (c,) ndarray of int
        Potential track of each child, ascending.
    detection : (c,) ndarray of int
        Detection that the child adds as its newest hit.
    """
    counts = gated.count[gate_of_track]
    parent = np.repeat(np.arange(len(gate_of_track)), counts)
    first_child = np.cumsum(counts) - counts
    child_of_parent = np.arange(len(parent)) - first_child[parent]
    return parent, gated.detection[gated.start[gate_of_track[parent]] + child_of_parent]


def split_paths(
    gate_of_track: IntArray,
    gated: Gates,
    limit: int,
    cost: Callable[[IntArray, IntArray], FloatArray],
    most: float = math.inf,
) -> tuple[IntArray, IntArray, int]:
    """Split every potential track, and keep the `limit` children of least cost.

    Parameters
    ----------
    gate_of_track, gated
        As in `children_in_gates`.
    limit : int
        Largest number of children.
    cost : callable
        Cost of children (parent, detection); evaluated only above the limit.
    most : float, optional
        Children that are looked at, and those of one track more: those of no further tracks are.

    Returns
    -------
    parent, detection : (c,) ndarray of int
        As in `children_in_gates`.
    cut : int
        Children left out.
    """
    counts = gated.count[gate_of_track]
    total = int(counts.sum())
    if total <= limit:
        return *children_in_gates(gate_of_track, gated), 0
    parent = detection = np.zeros(0, np.int64)
    costs = np.zeros(0)
    begun = np.cumsum(counts) - counts
    looked = begun[: np.searchsorted(begun, most)]
    blocks = np.searchsorted(looked, np.arange(0, total, SPLIT_BLOCK))
    for begin, end in itertools.pairwise(np.unique([*blocks, len(looked)])):
        rows, added = children_in_gates(gate_of_track[begin:end], gated)
        parent = np.concatenate([parent, rows + begin])
        detection = np.concatenate([detection, added])
        costs = np.concatenate([costs, cost(rows + begin, added)])
        best = rows_of_least_cost(costs, limit)
        parent, detection, costs = parent[best], detection[best], costs[best]
    return parent, detection, total - len(parent)
