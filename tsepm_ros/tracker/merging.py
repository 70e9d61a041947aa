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
"""Merging: of one target there is one track, under one id.

Starts of a scan are put against the confirmed tracks, by their hits and their states. Rules::

    among starts          the strongest first; of the others the score given the tracks that started
                          is reduced by the share of hits due to these (`hypotheses.given_starts`)
    beside a track        that was detected in this scan: the evidence exceeds the threshold by
                          ln 1000 (`same_place`; `confirmation`)
    of a lost track       r_i N(x_new - x_i; 0, P_new + P_i) / births > 1: it goes on (`continued`)
    on an older extent    the states of a start or track and an older one differ by no more than the
                          extent of a target: it is that target's (`of_older_targets`)
    before errors are     beside a track at twice the variances, of which half of the start's scans
    known                 have no other hit: it is that track's target (`may_have_track`)
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from scipy.spatial import cKDTree

from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray, replaced
from tsepm_ros.numerics.gaussian import is_significant, solve
from tsepm_ros.tracker.measurement import HIT_KEYS
from tsepm_ros.tracker.tracks import TrackArrays, TrackStatus

SAME_STATE_SQUARE = 7.78
"""Squared distance of two states that agree: chi-square of four degrees of freedom at 0.9."""
SECOND_TARGET_MARGIN = math.log(1e3)
"""Evidence above the threshold that a target beside a confirmed one needs: a choice.

A start with wrong hits briefly looks like a second target.
"""
NEAREST_TRACKS = 8
"""Nearest tracks among which older tracks are sought, the track itself included."""


def close(
    states: FloatArray, covariances: FloatArray, first: IntArray, second: IntArray, threshold: float
) -> BoolArray:
    """Test whether the states of each pair are close (condition c).

    ``(X1 - X2)' (P1 + P2)^-1 (X1 - X2) <= gamma_TM^2`` (Eqs. 28-30). As published, the two
    estimates count as independent although they share hits.
    """
    difference = states[first] - states[second]
    # The distance is at least that of each single component, which is cheap to test.
    variances = covariances[:, range(4), range(4)]
    bound = threshold * (1.0 + 1e-9) * (variances[first] + variances[second])
    near = np.asarray((np.square(difference) <= bound).all(axis=1))
    rows = np.flatnonzero(near)
    total = covariances[first[rows]] + covariances[second[rows]]
    solved = solve(total, difference[rows])
    near[rows] = (difference[rows] * solved).sum(axis=1) <= threshold
    return near


def hit_counts(
    paths: Sequence[IntArray], track_id: IntArray, hits: tuple[IntArray, IntArray]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Hits of tracks (m,) against those of starts (n,).

    Parameters
    ----------
    paths : sequence of (h,) ndarray of int
        Hits of the best hypothesis of each start, as `hit_keys`, ascending.
    track_id : (m,) ndarray of int
    hits : tuple of (k,) ndarray of int
        Hits of confirmed tracks, and the ids of these.

    Returns
    -------
    shared, later, beside : (n, m) ndarray
        Hits of the start; others since its first hit; others in scans with a hit of it.
    """
    keys, owners = hits
    own = np.stack([np.isin(keys, path) for path in paths])
    since = keys >= np.array([path[0] for path in paths])[:, None]
    in_scans = np.stack([np.isin(keys // HIT_KEYS, path // HIT_KEYS) for path in paths])
    kinds = np.array([own, since & ~own, in_scans & ~own], float) @ (owners[:, None] == track_id)
    return kinds[0], kinds[1], kinds[2]


def continued(
    starts: TrackArrays,
    paths: Sequence[IntArray],
    lost: TrackArrays,
    existence: FloatArray,
    last_place: FloatArray,
    hits: tuple[IntArray, IntArray],
    max_speed: float,
    births: float,
) -> IntArray:
    """Ids of the confirmed tracks that starts (n,) continue; -1 for none.

    A start may be of a track that has no other hit in this scan, and since the start's first hit
    few others. Of these the largest ratio above 1, to new targets, goes on; each track once::

        r_i max(N(x_new - x_i; 0, P_new + P_i), (1 - s_i) U_i) / births

    U_i is uniform over the places in reach since the last hit, after a time t, and over the
    velocities: ``1 / (pi (v_max t)^2 pi v_max^2)``. What stands still, with s_i, goes nowhere.

    Parameters
    ----------
    starts : TrackArrays
    paths : sequence of (h,) ndarray of int
        See `hit_counts`.
    lost : TrackArrays
        m, at the same time.
    existence : (m,) ndarray
        r_i.
    last_place : (m, 2) ndarray
        Where each was last detected, m.
    hits : tuple of (h,) ndarray of int
        See `hit_counts`.
    max_speed : float
        v_max, m/s.
    births : float
        Density of new targets within the mean length of fading, 1/(m^2 (m/s)^2).

    Returns
    -------
    (n,) ndarray of int
    """
    shared, later, _ = hit_counts(paths, lost.track_id, hits)
    apart = starts.state[:, None] - lost.state
    spread = starts.covariance[:, None] + lost.covariance
    square = (apart * solve(spread, apart)).sum(axis=2)
    density = -0.5 * (square + np.linalg.slogdet(2.0 * np.pi * spread)[1])
    reach = np.maximum(max_speed * lost.time_since_hit, np.finfo(float).tiny)
    with np.errstate(divide="ignore"):
        moves = np.log1p(-np.nan_to_num(lost.stationary_probability))
        anywhere = moves - 2.0 * np.log(np.pi * max_speed * reach)
    moved = np.linalg.norm(starts.state[:, None, 0::2] - last_place, axis=2)
    density = np.where(moved <= reach, np.maximum(density, anywhere), density)
    ratio = np.log(existence) + density - math.log(births)
    busy = (lost.time_since_hit <= 0.0) & (shared == 0.0)
    few = 0.5 * np.array([len(path) for path in paths])[:, None] - 1.0
    ratio[busy | (later > few)] = -np.inf
    ids = np.full(len(starts), -1)
    for start, row in enumerate(ratio):
        best = int(np.argmax(row))
        if row[best] > 0.0:
            ids[start] = lost.track_id[best]
            ratio[:, best] = -np.inf
    return ids


def same_place(state: FloatArray, covariance: FloatArray, tracks: TrackArrays) -> BoolArray:
    """Tracks from whose place that of a start does not differ, (..., m).

    Parameters
    ----------
    state, covariance : (..., 4), (..., 4, 4) ndarray
        Of the start, of shapes that broadcast with those of the tracks.
    tracks : TrackArrays
        m.
    """
    apart = (tracks.state - state)[..., 0::2]
    return ~is_significant(apart, (tracks.covariance + covariance)[..., 0::2, 0::2])


def may_have_track(
    starts: TrackArrays,
    paths: Sequence[IntArray],
    tracks: TrackArrays,
    hits: tuple[IntArray, IntArray],
    factor: float,
) -> BoolArray:
    """Which starts (n,) may be of tracks' targets, if all variances are larger by a factor.

    They are beside these, and half of their hits are of scans without another hit of theirs.

    Parameters
    ----------
    starts, tracks : TrackArrays
        n and m.
    paths, hits
        See `hit_counts`.
    factor : float
    """
    few = 2.0 * hit_counts(paths, tracks.track_id, hits)[2]
    wide = replaced(tracks, covariance=factor * tracks.covariance)
    near = same_place(starts.state[:, None], factor * starts.covariance[:, None], wide)
    number = np.array([len(path) for path in paths])
    return np.asarray((near & (few < number[:, None])).any(axis=1))


def on_older_extent(tracks: TrackArrays, size: FloatArray) -> BoolArray:
    """Which tracks may be of an older one's target, for their detections lie anywhere on it, (n,).

    ``d' (P_i + P_j)^-1 d`` of their states is within the gate for four dimensions. The covariances
    have the variance of the places added, and that of the velocities over a track's age.

    Parameters
    ----------
    tracks : TrackArrays
        n, oldest first.
    size : (n,) ndarray
        Extent of each one's target, m.
    """
    older = np.zeros(len(size), bool)
    variance, covariance = np.square(size) / 12.0, tracks.covariance.copy()
    covariance[:, [0, 2], [0, 2]] += variance[:, None]
    covariance[:, [1, 3], [1, 3]] += (variance / np.maximum(tracks.age, 1e-3) ** 2)[:, None]
    if len(size) >= 2:
        track, before = _pairs_with_older(tracks.state[:, 0::2])
        older[track[close(tracks.state, covariance, track, before, SAME_STATE_SQUARE)]] = True
    return older


def of_older_targets(
    confirmed: TrackArrays, starts: TrackArrays, extent: Callable[[FloatArray], FloatArray]
) -> BoolArray:
    """Which tracks, and starts after them, may be on the extent of an older target, (n,).

    A start without the margin of a second target is, up to twice the variance of a place on it. A
    fixed echo is no part of a target that moves. A track that coasts neither ends a track nor keeps
    a start from being a target's: its covariance grows until any place is on its extent.

    Parameters
    ----------
    confirmed, starts : TrackArrays
    extent : callable
        Extent of targets at positions (k, 2), m.
    """
    moves = confirmed.status == TrackStatus.CONFIRMED
    judged = np.append(moves, np.ones(len(starts), bool))
    tracks = TrackArrays.joined(confirmed, starts).where(judged)
    size = extent(tracks.state[:, 0::2])
    weak = starts.evaluation < SECOND_TARGET_MARGIN
    size[len(tracks) - len(starts) :][weak] *= math.sqrt(3.0)
    older = np.zeros(len(judged), bool)
    older[judged] = on_older_extent(tracks, size)
    return older


def _pairs_with_older(positions: FloatArray) -> tuple[IntArray, IntArray]:
    """Rows of each track and of an older track near it, (p,) and (p,)."""
    n = len(positions)
    if n <= NEAREST_TRACKS:  # all are
        return np.tril_indices(n, -1)
    _, nearest = cKDTree(positions).query(positions, k=NEAREST_TRACKS)
    track, older = np.repeat(np.arange(n), NEAREST_TRACKS), nearest.ravel()
    is_older = older < track
    return track[is_older], older[is_older]
